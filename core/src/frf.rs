//! Frequency responses H(s) = J_out Z(s)⁻¹ J_inᵀ and their sensitivities to every impedance parameter.
//!
//! Z(s) = s² M + s C + K + Σ z_r(s) b_r b_rᵀ (Huynh et al. 2021, Eqs. 21 to 28 with Jacobians for the pose differences).
//! With X = Z⁻¹ J_inᵀ and Y = Z⁻ᵀ J_outᵀ, ∂H_ab/∂z_r = −(b_rᵀ Y_a)(b_rᵀ X_b): products of what is already there.

use crate::impedance::{Direction, SpringDamper};
use crate::mechanism::finite;
use crate::solver::{Solver, load, store};
use crate::{Error, Result};
use nalgebra::Complex as C64;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// What does not change while impedances do: the matrices of one posture, where it is hit and where it is watched.
#[derive(Debug, Clone)]
pub struct LinearSystem {
    pub(crate) n: usize,
    /// M, C, K by rows, without the impedances.
    pub(crate) mass: Vec<f64>,
    pub(crate) damping: Vec<f64>,
    pub(crate) stiffness: Vec<f64>,
    pub(crate) directions: Vec<Direction>,
    /// Rows of the output and input Jacobians; one shared list where `same`.
    pub(crate) outputs: Vec<f64>,
    pub(crate) inputs: Vec<f64>,
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
        Ok(Self { n, mass, damping, stiffness, directions, outputs, inputs, symmetric, same })
    }

    /// Number of impedances.
    pub fn branches(&self) -> usize {
        self.directions.len()
    }

    /// Outputs p and inputs m.
    pub fn shape(&self) -> (usize, usize) {
        (self.outputs.len() / self.n, self.inputs.len() / self.n)
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

/// Responses of one batch, each `[case][output][input][line]`; sensitivities `[case][parameter][output][input][line]`
/// with the stiffnesses of all branches before their dampings.
#[derive(Debug, Clone)]
pub struct Responses {
    /// H.
    pub values: Vec<C64<f64>>,
    /// ∂H/∂k_r then ∂H/∂d_r; empty unless asked for.
    pub sensitivities: Vec<C64<f64>>,
}

/// Receptances of a batch of cases at the points `s` (rad/s), cases in parallel, points in SIMD lanes.
///
/// `systems` and `impedances` pair up; either may hold one entry that serves all cases (one posture under many
/// parameter sets, or many postures with one). All systems of a batch have one shape.
///
/// # Errors
/// Mismatched lengths, numbers that are not finite, [`Error::Singular`].
pub fn responses(
    systems: &[LinearSystem],
    impedances: &[Vec<SpringDamper>],
    s: &[C64<f64>],
    sensitivities: bool,
) -> Result<Responses> {
    let cases = systems.len().max(impedances.len());
    for (what, got) in [("systems", systems.len()), ("impedances", impedances.len())] {
        if got != cases && got != 1 {
            return Err(Error::Length { what, needed: cases, got });
        }
    }
    let first = &systems[0];
    let (p, m) = first.shape();
    for system in systems {
        if system.shape() != (p, m) || system.branches() != first.branches() {
            return Err(Error::Length {
                what: "system",
                needed: p * m,
                got: system.shape().0 * system.shape().1,
            });
        }
    }
    finite("s", s.iter().flat_map(|s| [s.re, s.im]))?;
    let per_case = p * m * s.len();
    let parameters = if sensitivities { first.branches() * SpringDamper::PARAMETERS } else { 0 };
    let mut out = Responses {
        values: vec![C64::new(0.0, 0.0); cases * per_case],
        sensitivities: vec![C64::new(0.0, 0.0); cases * parameters * per_case],
    };
    if per_case == 0 || cases == 0 {
        return Ok(out);
    }
    let run = |case: usize, values: &mut [C64<f64>], sensitivities: &mut [C64<f64>]| {
        let system = &systems[if systems.len() == 1 { 0 } else { case }];
        let impedances = &impedances[if impedances.len() == 1 { 0 } else { case }];
        system.check(impedances)?;
        Arch::new().dispatch(OneCase { system, impedances, s, values, sensitivities })
    };
    if cases == 1 {
        run(0, &mut out.values, &mut out.sensitivities)?;
    } else if parameters == 0 {
        let values = out.values.par_chunks_mut(per_case).enumerate();
        values.try_for_each(|(case, values)| run(case, values, &mut []))?;
    } else {
        let values = out.values.par_chunks_mut(per_case);
        let pairs = values.zip(out.sensitivities.par_chunks_mut(parameters * per_case)).enumerate();
        pairs.try_for_each(|(case, (values, sensitivities))| run(case, values, sensitivities))?;
    }
    Ok(out)
}

struct OneCase<'a> {
    system: &'a LinearSystem,
    impedances: &'a [SpringDamper],
    s: &'a [C64<f64>],
    values: &'a mut [C64<f64>],
    sensitivities: &'a mut [C64<f64>],
}

impl WithSimd for OneCase<'_> {
    type Output = Result<()>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Result<()> {
        let (p, m) = self.system.shape();
        let (count, r) = (self.s.len(), self.system.branches());
        let mut solver = Solver::new(simd, self.system, self.impedances);
        let want = !self.sensitivities.is_empty();
        for start in (0..count).step_by(S::F64_LANES) {
            let s = load(simd, self.s, start);
            solver.solve(simd, s, start, want)?;
            for entry in 0..p * m {
                store(simd, solver.h[entry], &mut self.values[entry * count..(entry + 1) * count], start);
            }
            if !want {
                continue;
            }
            let mirrored = self.system.same && self.system.symmetric;
            for branch in 0..r {
                let slope = self.impedances[branch].gradient(simd, s, false)[1];
                for a in 0..p {
                    let y = solver.at_outputs[branch * p + a].neg(simd);
                    for b in 0..if mirrored { a + 1 } else { m } {
                        let by_stiffness = y.mul(simd, solver.at_inputs[branch * m + b]);
                        let by_damping = by_stiffness.mul(simd, slope);
                        for (kind, value) in [by_stiffness, by_damping].into_iter().enumerate() {
                            let entry = |a, b| (((kind * r + branch) * p + a) * m + b) * count;
                            store(simd, value, &mut self.sensitivities[entry(a, b)..][..count], start);
                            if mirrored && a != b {
                                store(simd, value, &mut self.sensitivities[entry(b, a)..][..count], start);
                            }
                        }
                    }
                }
            }
        }
        Ok(())
    }
}
