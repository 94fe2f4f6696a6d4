//! Eigenvalues and null vectors of matrix polynomials.

use crate::convert::{array, borrowed, numbers, raise};
use armonic_core::matrix_polynomial::{backward_errors, eigenvalues, shapes};
use nalgebra::Complex;
use numpy::{PyArrayDyn, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use std::borrow::Cow;

type Array<'py> = PyReadonlyArrayDyn<'py, f64>;
type ComplexArray<'py> = PyReadonlyArrayDyn<'py, Complex<f64>>;
type Out<'py, T> = Bound<'py, PyArrayDyn<T>>;

/// The matrices A_1 … A_p by rows, and their size m.
fn matrices<'a>(coefficients: &'a Array<'_>, m: usize) -> PyResult<Cow<'a, [f64]>> {
    borrowed("coefficients", coefficients, &[None, Some(m), Some(m)])
}

fn size(coefficients: &Array<'_>) -> usize {
    coefficients.shape().last().copied().unwrap_or(0)
}

/// Eigenvalues (m p,), sweeps and convergence of every order; see `armonic_core::matrix_polynomial::eigenvalues`.
#[pyfunction]
#[allow(clippy::type_complexity)] // three lists
pub fn polynomial_eigenvalues<'py>(
    py: Python<'py>,
    coefficients: Vec<Array<'py>>,
) -> PyResult<(Vec<Out<'py, Complex<f64>>>, Vec<usize>, Vec<bool>)> {
    let m = coefficients.first().map_or(1, size);
    let orders = coefficients.iter().map(|a| matrices(a, m)).collect::<PyResult<Vec<_>>>()?;
    let orders: Vec<&[f64]> = orders.iter().map(AsRef::as_ref).collect();
    let found = py.detach(|| eigenvalues(m, &orders)).map_err(raise)?;
    let sweeps = found.iter().map(|spectrum| spectrum.sweeps).collect();
    let converged = found.iter().map(|spectrum| spectrum.converged).collect();
    let arrays = found.into_iter().map(|spectrum| {
        let count = spectrum.eigenvalues.len();
        array(py, spectrum.eigenvalues, &[count])
    });
    Ok((arrays.collect::<PyResult<_>>()?, sweeps, converged))
}

/// Null vectors (k, m) of P at its eigenvalues; see `armonic_core::matrix_polynomial::shapes`.
#[pyfunction]
pub fn polynomial_shapes<'py>(
    py: Python<'py>,
    coefficients: Array<'py>,
    poles: ComplexArray<'py>,
) -> PyResult<Out<'py, Complex<f64>>> {
    let m = size(&coefficients);
    let matrices = matrices(&coefficients, m)?;
    let poles = numbers("poles", &poles, &[None])?;
    let vectors = py.detach(|| shapes(m, &matrices, &poles)).map_err(raise)?;
    array(py, vectors, &[poles.len(), m])
}

/// Relative backward errors (k,) of numbers that are taken for eigenvalues; see
/// `armonic_core::matrix_polynomial::backward_errors`.
#[pyfunction]
pub fn polynomial_backward_errors<'py>(
    py: Python<'py>,
    coefficients: Array<'py>,
    poles: ComplexArray<'py>,
) -> PyResult<Out<'py, f64>> {
    let m = size(&coefficients);
    let matrices = matrices(&coefficients, m)?;
    let poles = numbers("poles", &poles, &[None])?;
    let errors = py.detach(|| backward_errors(m, &matrices, &poles)).map_err(raise)?;
    array(py, errors, &[poles.len()])
}
