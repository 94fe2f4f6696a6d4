//! The matrices of one posture, where it is hit and where it is watched: all of H(s) that impedances leave alone.

use crate::impedance::{Direction, Drive, SpringDamper};
use crate::mechanism::finite;
use crate::{Error, Result};
use nalgebra::Complex as C64;

/// What does not change while impedances do: the matrices of one posture, where it is hit and where it is watched.
#[derive(Debug, Clone)]
pub struct LinearSystem {
    pub(crate) n: usize,
    /// M, C, K by rows, without the impedances.
    pub(crate) mass: Vec<f64>,
    pub(crate) damping: Vec<f64>,
    pub(crate) stiffness: Vec<f64>,
    pub(crate) directions: Vec<Direction>,
    /// Drives by coordinate; the springs of their shafts stand in `stiffness`.
    pub(crate) drives: Vec<(usize, Drive)>,
    /// Rows of the output and input Jacobians; one shared list where `same`.
    pub(crate) outputs: Vec<f64>,
    pub(crate) inputs: Vec<f64>,
    /// Per coordinate, size of what stands in its row of K, C and M.
    pub(crate) sizes: Vec<[f64; 3]>,
    pub(crate) symmetric: bool,
    pub(crate) same: bool,
}

impl LinearSystem {
    /// Collects row-major matrices: `mass`, `damping`, `stiffness` (n×n), `outputs` (p×n), `inputs` (m×n).
    ///
    /// # Errors
    /// [`Error::Length`], [`Error::Value`], [`Error::Index`] for a direction on a missing coordinate.
    pub fn new(
        n: usize,
        [mass, damping, stiffness]: [Vec<f64>; 3],
        directions: Vec<Direction>,
        outputs: Vec<f64>,
        inputs: Vec<f64>,
    ) -> Result<Self> {
        for (what, matrix) in [("mass", &mass), ("damping", &damping), ("stiffness", &stiffness)] {
            if matrix.len() != n * n {
                return Err(Error::Length { what, needed: n * n, got: matrix.len() });
            }
            finite(what, matrix.iter().copied())?;
        }
        for (what, rows) in [("outputs", &outputs), ("inputs", &inputs)] {
            if n == 0 || rows.is_empty() || rows.len() % n != 0 {
                return Err(Error::Length { what, needed: n, got: rows.len() });
            }
            finite(what, rows.iter().copied())?;
        }
        for direction in &directions {
            match direction {
                Direction::Coordinate(i) if *i >= n => {
                    return Err(Error::Index { what: "coordinate", count: n, got: *i });
                }
                Direction::Dense(b) if b.len() != n => {
                    return Err(Error::Length { what: "direction", needed: n, got: b.len() });
                }
                Direction::Dense(b) => finite("direction", b.iter().copied())?,
                Direction::Coordinate(_) => {}
            }
        }
        let symmetric = [&mass, &damping, &stiffness].into_iter().all(|matrix| is_symmetric(matrix, n));
        let same = outputs == inputs;
        let sizes = (0..n).map(|i| [&stiffness, &damping, &mass].map(|a| size_of_row(a, n, i))).collect();
        let drives = Vec::new();
        Ok(Self { n, mass, damping, stiffness, directions, drives, outputs, inputs, sizes, symmetric, same })
    }

    /// The same system with drives on coordinates of its own, the springs w²k of their shafts being in the stiffness.
    ///
    /// # Errors
    /// [`Error::Index`] for a drive on a missing coordinate.
    pub fn with_drives(self, drives: Vec<(usize, Drive)>) -> Result<Self> {
        match drives.iter().find(|(i, _)| *i >= self.n) {
            Some(&(got, _)) => Err(Error::Index { what: "coordinate of a drive", count: self.n, got }),
            None => Ok(Self { drives, ..self }),
        }
    }

    /// Number of impedances.
    pub fn branches(&self) -> usize {
        self.directions.len()
    }

    /// Outputs p and inputs m.
    pub fn shape(&self) -> (usize, usize) {
        (self.outputs.len() / self.n, self.inputs.len() / self.n)
    }

    /// Whether H is symmetric, X serving on both sides.
    pub(crate) fn mirrored(&self) -> bool {
        self.same && self.symmetric
    }

    /// Refuses a list of impedances that does not match the directions.
    ///
    /// # Errors
    /// [`Error::Length`], [`Error::Value`].
    pub fn check(&self, impedances: &[SpringDamper]) -> Result<()> {
        if impedances.len() != self.branches() {
            return Err(Error::Length { what: "impedances", needed: self.branches(), got: impedances.len() });
        }
        impedances.iter().try_for_each(SpringDamper::check)
    }

    /// Z at one point, by rows, for the pivoted solver.
    pub(crate) fn dense(&self, s: C64<f64>, impedances: &[SpringDamper]) -> Vec<C64<f64>> {
        let mut z: Vec<_> = (0..self.n * self.n)
            .map(|i| s * s * self.mass[i] + s * self.damping[i] + self.stiffness[i])
            .collect();
        for (i, drive) in &self.drives {
            z[i * self.n + i] -= drive.turn(s) * drive.gain;
        }
        for (direction, impedance) in self.directions.iter().zip(impedances) {
            let value = s * impedance.damping + impedance.stiffness;
            match direction {
                Direction::Coordinate(i) => z[i * self.n + i] += value,
                Direction::Dense(b) => {
                    for i in 0..self.n {
                        for j in 0..self.n {
                            z[i * self.n + j] += value * (b[i] * b[j]);
                        }
                    }
                }
            }
        }
        z
    }
}

/// Whether the asymmetry is rounding only; what is below the tolerance is dropped by using the lower triangle.
fn is_symmetric(matrix: &[f64], n: usize) -> bool {
    let scale = matrix.iter().fold(0.0_f64, |a, v| a.max(v.abs()));
    (0..n).all(|i| (0..i).all(|j| (matrix[i * n + j] - matrix[j * n + i]).abs() <= 1e-13 * scale))
}

/// Size of what stands in row i of a symmetric matrix, in the units of its diagonal: the diagonal entry, or what
/// eliminating another row puts there.
fn size_of_row(matrix: &[f64], n: usize, i: usize) -> f64 {
    let beside = (0..n).filter(|&j| j != i && matrix[i * n + j] != 0.0).map(|j| {
        let (entry, other) = (matrix[i * n + j].abs(), matrix[j * n + j].abs());
        if other > 0.0 { entry * (entry / other) } else { entry }
    });
    beside.fold(matrix[i * n + i].abs(), f64::max)
}
