//! Whether a set of poles is all of a system, each once.
//!
//! Poles that satisfy Z(λ)u = 0, differ from each other and are as many as the characteristic polynomial has roots are all
//! of them. That nothing slipped through at the resolution of the distances is seen from two invariants of the polynomial,
//! the sum of its roots, which the fastest poles rule, and their product, in which every pole weighs the same.

use crate::eigenpairs::System;
use nalgebra::Complex as C64;

/// Poles closer than this share of their size count as one pole found twice.
const DISTINCT: f64 = 1e-8;
/// Relative deviation of the invariants that rounding may cause.
const INVARIANT: f64 = 1e-9;

/// The check, with its memory.
pub(crate) struct Completeness {
    /// Which poles are real, and stay so; the others stand for conjugate pairs.
    real: Vec<bool>,
    found: Vec<C64<f64>>,
    inverse: Vec<f64>,
}

impl Completeness {
    /// For n coordinates and poles of the kinds given.
    pub(crate) fn new(n: usize, poles: &[C64<f64>]) -> Self {
        Self {
            real: poles.iter().map(|pole| pole.im == 0.0).collect(),
            found: Vec::with_capacity(poles.len()),
            inverse: vec![0.0; n * n],
        }
    }

    /// Whether the poles (by index) are all poles of `system`, each once.
    #[inline(always)]
    pub(crate) fn holds(&mut self, system: &System<'_>, pole: impl Fn(usize) -> C64<f64>) -> bool {
        let count: usize = self.real.iter().map(|&real| if real { 1 } else { 2 }).sum();
        if count != 2 * system.n + system.drives.iter().map(|(_, drive)| drive.degree).sum::<usize>() {
            return false;
        }
        self.found.clear();
        let (mut sum, mut size, mut product) = (0.0, 0.0, 0.0);
        for (mode, &real) in self.real.iter().enumerate() {
            let pole = pole(mode);
            let square = pole.norm_sqr();
            if real != (pole.im == 0.0) || (!real && pole.im <= DISTINCT * square.sqrt()) {
                return false;
            }
            let near = DISTINCT * DISTINCT * square;
            if self.found.iter().any(|other| (pole - other).norm_sqr() <= near) {
                return false;
            }
            self.found.push(pole);
            let times = if real { 1.0 } else { 2.0 };
            sum += times * pole.re;
            size += times * square.sqrt();
            product += 0.5 * times * square.ln();
        }
        let Some((trace, volume)) = invariants(system, &mut self.inverse) else { return false };
        let tolerance = INVARIANT * count as f64;
        let off = (product - volume).abs();
        (sum - trace).abs() <= INVARIANT * size && (off.is_nan() || off <= tolerance)
    }
}

/// Sum of all poles, and the logarithm of the size of their product (NaN where it does not exist), from the matrices.
///
/// The sum is −tr M⁻¹C − Σ d/B, the product det Z(0) Π k / (det M Π B) over the denominators k + … + B s^degree of the
/// drives. `inverse` has room for n×n. None where the mass matrix is not positive definite.
fn invariants(system: &System<'_>, inverse: &mut [f64]) -> Option<(f64, f64)> {
    let n = system.n;
    // M = L D Lᵀ, then L⁻¹ in place.
    let factor = inverse;
    factor.copy_from_slice(system.mass);
    let mut volume = -eliminate(factor, n, true)?;
    let mut trace = 0.0;
    for i in 0..n {
        for j in 0..i {
            let mut sum = factor[i * n + j];
            for k in j + 1..i {
                sum += factor[i * n + k] * factor[k * n + j];
            }
            factor[i * n + j] = -sum;
        }
        // Row i of L⁻¹ over its pivot: tr M⁻¹C = Σ_i (L⁻¹ C L⁻ᵀ)_ii / D_i.
        for a in 0..=i {
            let left = if a == i { 1.0 } else { factor[i * n + a] };
            for b in 0..=i {
                let c = system.damping[a * n + b];
                if c != 0.0 {
                    let right = if b == i { 1.0 } else { factor[i * n + b] };
                    trace -= left * c * right / factor[i * n + i];
                }
            }
        }
    }
    factor.copy_from_slice(system.stiffness);
    for (i, drive) in system.drives {
        let degree = drive.degree;
        let (last, lead) = (drive.denominator[0], drive.denominator[degree]);
        trace -= drive.denominator[degree - 1] / lead;
        volume += (last / lead).abs().ln();
        factor[i * n + i] -= drive.gain * drive.numerator[0] / last;
    }
    volume += eliminate(factor, n, false).unwrap_or(f64::NAN);
    Some((trace, volume))
}

/// Symmetric elimination in place, L below the diagonal and pivots on it; Σ ln |pivot|. None where a pivot vanishes, or is
/// not positive if it must be.
fn eliminate(matrix: &mut [f64], n: usize, positive: bool) -> Option<f64> {
    let mut volume = 0.0;
    for i in 0..n {
        for j in 0..i {
            let mut sum = matrix[i * n + j];
            for k in 0..j {
                sum -= matrix[i * n + k] * matrix[j * n + k];
            }
            matrix[i * n + j] = sum; // L_ij D_j, scaled below
        }
        let mut pivot = matrix[i * n + i];
        for j in 0..i {
            let scaled = matrix[i * n + j] / matrix[j * n + j];
            pivot -= scaled * matrix[i * n + j];
            matrix[i * n + j] = scaled;
        }
        if pivot == 0.0 || !pivot.is_finite() || (positive && pivot < 0.0) {
            return None;
        }
        matrix[i * n + i] = pivot;
        volume += pivot.abs().ln();
    }
    Some(volume)
}
