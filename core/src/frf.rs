//! Frequency responses H(s) = J_out Z(s)⁻¹ J_inᵀ and their sensitivities to every impedance parameter.
//!
//! Z(s) = s² M + s C + K + Σ z_r(s) b_r b_rᵀ (Huynh et al. 2021, Eqs. 21 to 28 with Jacobians for the pose differences).
//! With X = Z⁻¹ J_inᵀ and Y = Z⁻ᵀ J_outᵀ, ∂H_ab/∂z_r = −(b_rᵀ Y_a)(b_rᵀ X_b): products of what is already there.

use crate::impedance::{Direction, SpringDamper};
use crate::lanes::{Complex, lanes};
use crate::mechanism::finite;
use crate::solver::{Solver, load, store};
use crate::{Error, Result};
use nalgebra::Complex as C64;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use std::mem::MaybeUninit;

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
    systems: &[&LinearSystem],
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
    let first = systems[0];
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
    let mut out =
        Responses { values: Vec::new(), sensitivities: Vec::with_capacity(cases * parameters * per_case) };
    out.values.reserve_exact(cases * per_case);
    if per_case == 0 || cases == 0 {
        return Ok(out);
    }
    let run = |case: usize, values: &mut [Slot], sensitivities: &mut [Slot]| {
        let system = systems[if systems.len() == 1 { 0 } else { case }];
        let impedances = &impedances[if impedances.len() == 1 { 0 } else { case }];
        system.check(impedances)?;
        Arch::new().dispatch(OneCase { system, impedances, s, values, sensitivities })
    };
    let values = &mut out.values.spare_capacity_mut()[..cases * per_case];
    let slopes = &mut out.sensitivities.spare_capacity_mut()[..cases * parameters * per_case];
    if cases == 1 {
        run(0, values, slopes)?;
    } else if parameters == 0 {
        let values = values.par_chunks_mut(per_case).enumerate();
        values.try_for_each(|(case, values)| run(case, values, &mut []))?;
    } else {
        let values = values.par_chunks_mut(per_case);
        let pairs = values.zip(slopes.par_chunks_mut(parameters * per_case)).enumerate();
        pairs.try_for_each(|(case, (values, slopes))| run(case, values, slopes))?;
    }
    // SAFETY: every case has stored all lines of all its entries, and those fill both lengths.
    unsafe {
        out.values.set_len(cases * per_case);
        out.sensitivities.set_len(cases * parameters * per_case);
    }
    Ok(out)
}

/// Results are hundreds of kilobytes that are written once: zeroing them first would cost as much as computing them.
pub(crate) type Slot = MaybeUninit<C64<f64>>;

struct OneCase<'a> {
    system: &'a LinearSystem,
    impedances: &'a [SpringDamper],
    s: &'a [C64<f64>],
    values: &'a mut [Slot],
    sensitivities: &'a mut [Slot],
}

impl WithSimd for OneCase<'_> {
    type Output = Result<()>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Result<()> {
        let (p, m) = self.system.shape();
        let (count, r) = (self.s.len(), self.system.branches());
        let groups = count.div_ceil(lanes::<S>());
        let mut solver = Solver::new(simd, self.system, self.impedances);
        let want = !self.sensitivities.is_empty();
        let zero = Complex::zero(simd);
        // Projections are gathered over all lines, so that every entry is then written as one stream.
        let mut points = vec![zero; groups];
        let mirrored = self.system.mirrored();
        let mut at_outputs = vec![zero; if want && !mirrored { r * p * groups } else { 0 }];
        let mut at_inputs = vec![zero; if want { r * m * groups } else { 0 }];
        // The last group reaches back over lines already done, so that all but the shortest lists fill whole groups.
        let start_of = |group: usize| (group * lanes::<S>()).min(count.saturating_sub(lanes::<S>()));
        for group in 0..groups {
            let start = start_of(group);
            points[group] = load(simd, self.s, start);
            solver.solve(simd, points[group], start, want)?;
            for (&value, place) in solver.h.iter().zip(self.values.chunks_exact_mut(count)) {
                store(simd, value, &mut place[start..]);
            }
            for (from, to) in
                [(solver.at_outputs(), &mut at_outputs), (&solver.at_inputs[..], &mut at_inputs)]
            {
                for (&value, stream) in from.iter().zip(to.chunks_exact_mut(groups)) {
                    stream[group] = value;
                }
            }
        }
        if !want {
            return Ok(());
        }
        let at_outputs = if mirrored { &at_inputs } else { &at_outputs };
        let (by_stiffness, by_damping) = self.sensitivities.split_at_mut(r * p * m * count);
        for (branch, a) in (0..r).flat_map(|branch| (0..p).map(move |a| (branch, a))) {
            let entry = |a, b| ((branch * p + a) * m + b) * count;
            let y = &at_outputs[(branch * p + a) * groups..][..groups];
            for b in 0..if mirrored { a + 1 } else { m } {
                let x = &at_inputs[(branch * m + b) * groups..][..groups];
                let stiffness = &mut by_stiffness[entry(a, b)..][..count];
                let damping = &mut by_damping[entry(a, b)..][..count];
                for (group, ((&y, &x), &s)) in y.iter().zip(x).zip(&points).enumerate() {
                    let start = start_of(group);
                    let slope = y.mul(simd, x).neg(simd);
                    store(simd, slope, &mut stiffness[start..]);
                    store(simd, slope.mul(simd, s), &mut damping[start..]);
                }
                if mirrored && a != b {
                    by_stiffness.copy_within(entry(a, b)..entry(a, b) + count, entry(b, a));
                    by_damping.copy_within(entry(a, b)..entry(a, b) + count, entry(b, a));
                }
            }
        }
        Ok(())
    }
}
