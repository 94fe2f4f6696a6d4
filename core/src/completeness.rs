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

/// Entries of two matrices that go the same way.
type Pair = [f64; 2];

/// The check, with its memory.
pub(crate) struct Completeness {
    /// Which poles are real, and stay so; the others stand for conjugate pairs.
    real: Vec<bool>,
    /// Real and imaginary parts of the poles.
    found: [Vec<f64>; 2],
    /// M, and K with the drives at rest, side by side.
    matrices: Vec<Pair>,
}

impl Completeness {
    /// For n coordinates and poles of the kinds given.
    pub(crate) fn new(n: usize, poles: &[C64<f64>]) -> Self {
        Self {
            real: poles.iter().map(|pole| pole.im == 0.0).collect(),
            found: [(); 2].map(|()| vec![0.0; poles.len()]),
            matrices: vec![[0.0; 2]; n * n],
        }
    }

    /// Whether the poles, in the order of their kinds, are all poles of `system`, each once.
    #[inline(always)]
    pub(crate) fn holds(&mut self, system: &System<'_>, poles: impl Iterator<Item = C64<f64>>) -> bool {
        let count: usize = self.real.iter().map(|&real| if real { 1 } else { 2 }).sum();
        if count != 2 * system.n + system.drives.iter().map(|(_, drive)| drive.degree).sum::<usize>() {
            return false;
        }
        let [re, im] = &mut self.found;
        let (mut sum, mut size, mut product) = (0.0, 0.0, Product::new());
        for (mode, (pole, &real)) in poles.zip(&self.real).enumerate() {
            let square = pole.norm_sqr();
            let length = square.sqrt();
            if real != (pole.im == 0.0) || (!real && pole.im <= DISTINCT * length) {
                return false;
            }
            let near = DISTINCT * DISTINCT * square;
            let mut again = false;
            for (re, im) in re[..mode].iter().zip(&im[..mode]) {
                let (x, y) = (pole.re - re, pole.im - im);
                again |= x * x + y * y <= near;
            }
            if again {
                return false;
            }
            (re[mode], im[mode]) = (pole.re, pole.im);
            let times = if real { 1.0 } else { 2.0 };
            sum += times * pole.re;
            size += times * length;
            product.times(if real { length } else { square });
        }
        let Some((trace, volume)) = invariants(system, &mut self.matrices) else { return false };
        let off = (product.logarithm() - volume).abs();
        (sum - trace).abs() <= INVARIANT * size && (off.is_nan() || off <= INVARIANT * count as f64)
    }
}

/// A product of many positive numbers, of any size, by its logarithm.
#[derive(Clone, Copy)]
struct Product {
    factor: f64,
    logarithm: f64,
}

impl Product {
    fn new() -> Self {
        Self { factor: 1.0, logarithm: 0.0 }
    }

    /// Logarithms are slow: one is taken where the factor would leave the range of numbers.
    #[inline(always)]
    fn times(&mut self, value: f64) {
        let product = self.factor * value;
        if product > 1e-140 && product < 1e140 {
            self.factor = product;
        } else {
            self.logarithm += self.factor.ln() + value.ln();
            self.factor = 1.0;
        }
    }

    fn logarithm(&self) -> f64 {
        self.logarithm + self.factor.ln()
    }
}

/// Sum of all poles, and the logarithm of the size of their product (NaN where it does not exist), from the matrices.
///
/// The sum is −tr M⁻¹C − Σ d/B, the product det Z(0) Π k / (det M Π B) over the denominators k + … + B s^degree of the
/// drives. `matrices` has room for n×n. None where the mass matrix is not positive definite.
#[inline(always)]
fn invariants(system: &System<'_>, matrices: &mut [Pair]) -> Option<(f64, f64)> {
    let n = system.n;
    for (pair, (&m, &k)) in matrices.iter_mut().zip(system.mass.iter().zip(system.stiffness)) {
        *pair = [m, k];
    }
    let (mut trace, mut above, mut below) = (0.0, Product::new(), Product::new());
    for (i, drive) in system.drives {
        let degree = drive.degree;
        let (last, lead) = (drive.denominator[0], drive.denominator[degree]);
        trace -= drive.denominator[degree - 1] / lead;
        above.times(last.abs());
        below.times(lead.abs());
        matrices[i * n + i][1] -= drive.gain * drive.numerator[0] / last;
    }
    eliminate(matrices, n);
    for i in 0..n {
        let [mass, stiffness] = matrices[i * n + i];
        if !(mass > 0.0 && mass.is_finite()) {
            return None;
        }
        below.times(mass);
        above.times(if stiffness == 0.0 { f64::NAN } else { stiffness.abs() });
    }
    for i in 0..n {
        // Row i of L⁻¹ of the mass, in place of L's.
        for j in 0..i {
            let mut sum = matrices[i * n + j][0];
            for k in j + 1..i {
                sum += matrices[i * n + k][0] * matrices[k * n + j][0];
            }
            matrices[i * n + j][0] = -sum;
        }
        // tr M⁻¹C = Σ_i (L⁻¹ C L⁻ᵀ)_ii / D_i.
        let row = &matrices[i * n..][..n];
        let left = |a: usize| if a == i { 1.0 } else { row[a][0] };
        let mut part = 0.0;
        for a in 0..=i {
            if system.diagonal {
                part += left(a) * left(a) * system.damping[a * n + a];
            } else {
                for b in 0..=i {
                    part += left(a) * system.damping[a * n + b] * left(b);
                }
            }
        }
        trace -= part / row[i][0];
    }
    Some((trace, above.logarithm() - below.logarithm()))
}

/// Symmetric elimination of both matrices in place: L below the diagonal, D on it.
#[inline(always)]
fn eliminate(matrices: &mut [Pair], n: usize) {
    for i in 0..n {
        let (done, rest) = matrices.split_at_mut(i * n);
        let row = &mut rest[..n];
        for j in 0..i {
            let above = &done[j * n..][..n];
            let mut sum = row[j];
            for k in 0..j {
                for (sum, (a, b)) in sum.iter_mut().zip(row[k].iter().zip(&above[k])) {
                    *sum -= a * b;
                }
            }
            row[j] = sum; // L_ij D_j, scaled below
        }
        let mut pivot = row[i];
        for j in 0..i {
            let inverse = done[j * n + j].map(|d| 1.0 / d);
            for ((pivot, entry), inverse) in pivot.iter_mut().zip(&mut row[j]).zip(inverse) {
                let scaled = *entry * inverse;
                *pivot -= scaled * *entry;
                *entry = scaled;
            }
        }
        row[i] = pivot;
    }
}
