//! Python binding of the Armonic core: NumPy in and out, shape checks, errors to exceptions, the GIL released.

mod convert;
mod descent;
mod fit;
mod matrix_polynomial;
mod mechanism;
mod modes;
mod response;
mod simulate;

use pyo3::prelude::*;

/// Compiled core of Armonic (Rust).
#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<mechanism::Mechanism>()?;
    module.add_class::<mechanism::Bushing>()?;
    module.add_class::<response::LinearSystem>()?;
    module.add_class::<fit::Problem>()?;
    module.add_class::<simulate::Plant>()?;
    module.add_function(wrap_pyfunction!(descent::descend, module)?)?;
    module.add_function(wrap_pyfunction!(modes::follow, module)?)?;
    module.add_function(wrap_pyfunction!(matrix_polynomial::polynomial_backward_errors, module)?)?;
    module.add_function(wrap_pyfunction!(matrix_polynomial::polynomial_eigenvalues, module)?)?;
    module.add_function(wrap_pyfunction!(matrix_polynomial::polynomial_shapes, module)?)?;
    module.add_function(wrap_pyfunction!(response::responses, module)?)?;
    Ok(())
}
