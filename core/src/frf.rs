//! Frequency responses H(s) = J_out Z(s)⁻¹ J_inᵀ and their sensitivities to every impedance parameter.
//!
//! Z(s) = s² M + s C + K + Σ z_r(s) b_r b_rᵀ (Huynh et al. 2021, Eqs. 21 to 28 with Jacobians for the pose differences).
//! With X = Z⁻¹ J_inᵀ and Y = Z⁻ᵀ J_outᵀ, ∂H_ab/∂z_r = −(b_rᵀ Y_a)(b_rᵀ X_b): products of what is already there.

use crate::impedance::SpringDamper;
use crate::lanes::{Complex, lanes};
use crate::mechanism::finite;
use crate::solver::{Slot, Solver, load, store};
use crate::system::LinearSystem;
use crate::{Error, Result};
use nalgebra::Complex as C64;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

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
        let mut solver = Solver::new(simd, self.system, self.impedances, count);
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
            solver.solve(simd, points[group], start, false)?;
            for (&value, place) in solver.h.iter().zip(self.values.chunks_exact_mut(count)) {
                store(simd, value, &mut place[start..]);
            }
            if want {
                solver.each_input(simd, |entry, value| at_inputs[entry * groups + group] = value);
                solver.each_output(simd, |entry, value| at_outputs[entry * groups + group] = value);
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
