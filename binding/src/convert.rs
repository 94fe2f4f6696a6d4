//! Shapes, row-major copies and errors between NumPy and the core.

use armonic_core::Error;
use armonic_core::spatial::Transform;
use nalgebra::{Matrix3, Vector3};
use numpy::ndarray;
use numpy::{PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods, ToPyArray};
use pyo3::exceptions::{PyArithmeticError, PyValueError};
use pyo3::prelude::*;
use std::borrow::Cow;

/// Arguments that do not fit raise `ValueError`; a computation without an answer raises `ArithmeticError`.
pub fn raise(error: Error) -> PyErr {
    match error {
        Error::MassNotPositiveDefinite | Error::Singular { .. } | Error::ZeroResponse { .. } => {
            PyArithmeticError::new_err(error.to_string())
        }
        _ => PyValueError::new_err(error.to_string()),
    }
}

/// Copies an array of a known shape to row-major numbers; `None` in `shape` takes any length.
pub fn numbers<T: numpy::Element + Copy>(
    name: &str,
    array: &PyReadonlyArrayDyn<'_, T>,
    shape: &[Option<usize>],
) -> PyResult<Vec<T>> {
    borrowed(name, array, shape).map(Cow::into_owned)
}

/// The numbers of an array as in [`numbers`], copied only if they do not stand by rows.
pub fn borrowed<'a, T: numpy::Element + Copy>(
    name: &str,
    array: &'a PyReadonlyArrayDyn<'_, T>,
    shape: &[Option<usize>],
) -> PyResult<Cow<'a, [T]>> {
    let got = array.shape();
    if got.len() != shape.len() || got.iter().zip(shape).any(|(g, s)| s.is_some_and(|s| s != *g)) {
        let wanted: Vec<_> = shape.iter().map(|s| s.map_or("any".into(), |s| s.to_string())).collect();
        return Err(PyValueError::new_err(format!(
            "{name}: found an array of shape {got:?}, expected ({})",
            wanted.join(", ")
        )));
    }
    match array.as_slice() {
        Ok(by_rows) if array.is_c_contiguous() => Ok(Cow::Borrowed(by_rows)), // a slice may also run by columns
        _ => Ok(Cow::Owned(array.as_array().iter().copied().collect())),
    }
}

/// A 4×4 homogeneous matrix, by rows, as a transform; its rotation must be one.
pub fn transform(name: &str, m: &[f64]) -> PyResult<Transform> {
    let rotation = Matrix3::new(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]);
    let error = (rotation * rotation.transpose() - Matrix3::identity()).amax();
    if error.is_nan() || error > 1e-9 || rotation.determinant() < 0.0 || m[12..16] != [0.0, 0.0, 0.0, 1.0] {
        return Err(PyValueError::new_err(format!(
            "{name}: found a 4x4 matrix that is not a rigid transform, expected a rotation, a translation and [0, 0, 0, 1]"
        )));
    }
    Ok(Transform { rotation, translation: Vector3::new(m[3], m[7], m[11]) })
}

/// A transform as 4×4 numbers by rows.
pub fn homogeneous(t: &Transform, out: &mut [f64]) {
    out.fill(0.0);
    for i in 0..3 {
        for j in 0..3 {
            out[4 * i + j] = t.rotation[(i, j)];
        }
        out[4 * i + 3] = t.translation[i];
    }
    out[15] = 1.0;
}

/// Row-major numbers as a NumPy array of the given shape.
pub fn array<'py, T: numpy::Element>(
    py: Python<'py>,
    values: Vec<T>,
    shape: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    numpy::PyArray1::from_vec(py, values).reshape(shape.to_vec())
}

/// Row-major numbers of the given shape as a NumPy array with its axes in another order, without copying.
pub fn permuted<'py, T: numpy::Element>(
    py: Python<'py>,
    values: Vec<T>,
    shape: &[usize],
    order: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    let by_rows =
        ndarray::Array::from_shape_vec(shape, values).map_err(|e| PyValueError::new_err(e.to_string()))?;
    Ok(PyArrayDyn::from_owned_array(py, by_rows.permuted_axes(order)))
}

/// A small vector as a NumPy array.
pub fn vector<'py>(py: Python<'py>, values: &[f64]) -> Bound<'py, PyArrayDyn<f64>> {
    values.to_pyarray(py).to_dyn().clone()
}
