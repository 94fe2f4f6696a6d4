//! Modes followed along a walk, and the matrices of robots at rest that it runs on.

use crate::convert::{array, borrowed, numbers, raise};
use crate::response::{DRIVE_NUMBERS, drive};
use armonic_core::modes::{self, Walk};
use nalgebra::Complex;
use numpy::{PyArrayDyn, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

type Array<'py> = PyReadonlyArrayDyn<'py, f64>;
type ComplexArray<'py> = PyReadonlyArrayDyn<'py, Complex<f64>>;
type Out<'py, T> = Bound<'py, PyArrayDyn<T>>;
/// Poles (P, m), shapes (P, m, n + d), energy shares (P, m, n), or (P, m, 0) without springs, residuals (P,), likeness (P, m).
type Followed<'py> =
    (Out<'py, Complex<f64>>, Out<'py, Complex<f64>>, Out<'py, f32>, Out<'py, f64>, Out<'py, f64>);

/// Modes of the first system followed through the others, as far as they can be; see `armonic_core::modes::follow`.
#[pyfunction]
#[pyo3(signature = (mass, damping, stiffness, drives, drive_coordinates, springs, poles, shapes))]
#[allow(clippy::too_many_arguments)] // arrays of one walk
pub fn follow<'py>(
    py: Python<'py>,
    mass: Array<'py>,
    damping: Array<'py>,
    stiffness: Array<'py>,
    drives: Array<'py>,
    drive_coordinates: Vec<usize>,
    springs: Array<'py>,
    poles: ComplexArray<'py>,
    shapes: ComplexArray<'py>,
) -> PyResult<Followed<'py>> {
    let n = mass.shape().last().copied().unwrap_or(0);
    let square = [None, Some(n), Some(n)];
    let d = drive_coordinates.len();
    let mass = borrowed("mass", &mass, &square)?;
    let damping = borrowed("damping", &damping, &square)?;
    let stiffness = borrowed("stiffness", &stiffness, &square)?;
    let sets = drives.shape().first().copied().unwrap_or(0);
    let rows = numbers("drives", &drives, &[None, Some(d), Some(DRIVE_NUMBERS)])?;
    if sets == 0 {
        return Err(PyValueError::new_err("drives: expected one set or one per system"));
    }
    let set = |case: usize| {
        let of = |(i, &place): (usize, &usize)| {
            Ok((place, drive(&rows[(case * d + i) * DRIVE_NUMBERS..][..DRIVE_NUMBERS])?))
        };
        drive_coordinates.iter().enumerate().map(of).collect::<PyResult<Vec<_>>>()
    };
    let drives = (0..sets).map(set).collect::<PyResult<Vec<_>>>()?;
    let poles = numbers("poles", &poles, &[None])?;
    let m = poles.len();
    let shapes = numbers("shapes", &shapes, &[Some(m), Some(n)])?;
    let springs = borrowed("springs", &springs, &[None, Some(n)])?;
    let walk =
        Walk { n, mass: &mass, damping: &damping, stiffness: &stiffness, drives: &drives, springs: &springs };
    let out = py.detach(|| modes::follow(&walk, &poles, &shapes)).map_err(raise)?;
    let p = out.reached;
    Ok((
        array(py, out.poles, &[p, m])?,
        array(py, out.shapes, &[p, m, n + d])?,
        array(py, out.shares, &[p, m, if springs.is_empty() { 0 } else { n }])?,
        array(py, out.residuals, &[p])?,
        array(py, out.likeness, &[p, m])?,
    ))
}
