//! Python binding of the Armonic core: NumPy in and out, shape checks, errors to exceptions, the GIL released.

mod convert;
mod descent;
mod fit;
mod mechanism;
mod modes;
mod response;

use pyo3::prelude::*;

/// Compiled core of Armonic (Rust).
#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<mechanism::Mechanism>()?;
    module.add_class::<mechanism::Bushing>()?;
    module.add_class::<response::LinearSystem>()?;
    module.add_class::<fit::Problem>()?;
    module.add_function(wrap_pyfunction!(descent::descend, module)?)?;
    module.add_function(wrap_pyfunction!(modes::follow, module)?)?;
    module.add_function(wrap_pyfunction!(response::responses, module)?)?;
    Ok(())
}
