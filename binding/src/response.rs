//! Linear systems and their frequency responses.

use crate::convert::{numbers, permuted, raise};
use armonic_core::frf;
use armonic_core::impedance::{Direction, Drive, DriveNumbers, SpringDamper};
use armonic_core::system;
use nalgebra::Complex;
use numpy::{PyArrayDyn, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

type Array<'py> = PyReadonlyArrayDyn<'py, f64>;
type ComplexArray<'py> = Bound<'py, PyArrayDyn<Complex<f64>>>;

/// Matrices of one posture without their impedances, immutable.
#[pyclass(frozen, module = "armonic._core")]
pub struct LinearSystem {
    pub inner: system::LinearSystem,
}

#[pymethods]
impl LinearSystem {
    /// A direction with a single entry of one is an impedance on that coordinate.
    #[new]
    #[pyo3(signature = (*, mass, damping, stiffness, directions, outputs, inputs, drives = None, drive_coordinates = None))]
    #[allow(clippy::too_many_arguments)] // keywords of Python
    fn new(
        mass: Array<'_>,
        damping: Array<'_>,
        stiffness: Array<'_>,
        directions: Array<'_>,
        outputs: Array<'_>,
        inputs: Array<'_>,
        drives: Option<Array<'_>>,
        drive_coordinates: Option<Vec<usize>>,
    ) -> PyResult<Self> {
        let n = mass.shape().first().copied().unwrap_or(0);
        let square = [Some(n), Some(n)];
        let matrices = [
            numbers("mass", &mass, &square)?,
            numbers("damping", &damping, &square)?,
            numbers("stiffness", &stiffness, &square)?,
        ];
        let rows = [None, Some(n)];
        let directions = numbers("directions", &directions, &rows)?;
        let directions = directions.chunks_exact(n.max(1)).map(direction).collect();
        let outputs = numbers("outputs", &outputs, &rows)?;
        let inputs = numbers("inputs", &inputs, &rows)?;
        let drives = match &drives {
            Some(drives) => numbers("drives", drives, &[None, Some(DRIVE_NUMBERS)])?,
            None => Vec::new(),
        };
        let drives = drives.chunks_exact(DRIVE_NUMBERS).map(drive).collect::<PyResult<Vec<_>>>()?;
        let places = drive_coordinates.unwrap_or_default();
        if places.len() != drives.len() {
            return Err(PyValueError::new_err("drive_coordinates: expected one per drive"));
        }
        let drives = places.into_iter().zip(drives).collect();
        let inner = system::LinearSystem::new(n, matrices, directions, outputs, inputs)
            .and_then(|system| system.with_drives(drives))
            .map_err(raise)?;
        Ok(Self { inner })
    }
}

/// Numbers of one drive: w, k, B, D_m + K_D, k + K_P, K_I, then the gains on its coordinate: of position, velocity and
/// integral.
pub const DRIVE_NUMBERS: usize = 9;

/// A drive from its row of numbers.
pub fn drive(row: &[f64]) -> PyResult<Drive> {
    let numbers = DriveNumbers {
        scale: row[0],
        shaft: row[1],
        inertia: row[2],
        damping: row[3],
        stiffness: row[4],
        integral: row[5],
        link: [row[6], row[7], row[8]],
    };
    Drive::new(&numbers).map_err(raise)
}

fn direction(row: &[f64]) -> Direction {
    let mut entries = row.iter().enumerate().filter(|(_, v)| **v != 0.0);
    match (entries.next(), entries.next()) {
        (Some((i, &1.0)), None) => Direction::Coordinate(i),
        _ => Direction::Dense(row.to_vec()),
    }
}

/// Impedance sets from stiffness and damping, each (P, r).
pub fn impedances(stiffness: &Array<'_>, damping: &Array<'_>) -> PyResult<Vec<Vec<SpringDamper>>> {
    let branches = stiffness.shape().last().copied().unwrap_or(0);
    let k = numbers("stiffness", stiffness, &[None, Some(branches)])?;
    let d = numbers("damping", damping, &[Some(stiffness.shape()[0]), Some(branches)])?;
    let one = |case: usize| {
        (0..branches)
            .map(|i| case * branches + i)
            .map(|i| SpringDamper { stiffness: k[i], damping: d[i] })
            .collect()
    };
    Ok((0..stiffness.shape()[0]).map(one).collect())
}

/// Complex numbers of shape (L,).
pub fn points(s: &PyReadonlyArrayDyn<'_, Complex<f64>>) -> PyResult<Vec<Complex<f64>>> {
    numbers("s", s, &[None])
}

/// Receptances (P, L, p, m) at the points `s`, and their derivatives (P, L, p, m, 2r) or `None`.
///
/// The arrays are views with the lines contiguous.
#[pyfunction]
#[pyo3(signature = (systems, stiffness, damping, s, *, sensitivities = false))]
#[allow(clippy::type_complexity)] // a pair of arrays
pub fn responses<'py>(
    py: Python<'py>,
    systems: Vec<PyRef<'py, LinearSystem>>,
    stiffness: Array<'py>,
    damping: Array<'py>,
    s: PyReadonlyArrayDyn<'py, Complex<f64>>,
    sensitivities: bool,
) -> PyResult<(ComplexArray<'py>, Option<ComplexArray<'py>>)> {
    if systems.is_empty() {
        return Err(PyValueError::new_err("systems: found an empty list, expected one system or more"));
    }
    let impedances = impedances(&stiffness, &damping)?;
    let s = points(&s)?;
    let systems: Vec<_> = systems.iter().map(|system| &system.inner).collect();
    let (p, m) = systems[0].shape();
    let parameters = SpringDamper::PARAMETERS * systems[0].branches();
    let cases = systems.len().max(impedances.len());
    let out = py.detach(|| frf::responses(&systems, &impedances, &s, sensitivities)).map_err(raise)?;
    let values = permuted(py, out.values, &[cases, p, m, s.len()], &[0, 3, 1, 2])?;
    let slopes = match sensitivities {
        true => Some(permuted(py, out.sensitivities, &[cases, parameters, p, m, s.len()], &[0, 4, 2, 3, 1])?),
        false => None,
    };
    Ok((values, slopes))
}
