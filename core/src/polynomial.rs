//! A matrix polynomial with real coefficients, and the trace of P⁻¹P', over SIMD lanes, one point per lane.

use crate::lanes::{Complex, Real};
use nalgebra::Complex as C64;
use pulp::Simd;

/// Entries of the matrices that are summed together: their sums fill the registers.
const TOGETHER: usize = 3;
/// Σ C_k z^k, packed for a sum over k: blocks of [`TOGETHER`] entries of C_k beside those of (k+1) C_(k+1).
struct Form {
    coefficients: Vec<[f64; 2 * TOGETHER]>,
    /// |C_k|, packed likewise.
    sizes: Vec<[f64; TOGETHER]>,
    /// Frobenius norms of C_k.
    norms: Vec<f64>,
}

impl Form {
    /// From the matrices C_0 … C_p, each by rows.
    fn new(matrices: &[&[f64]]) -> Self {
        let entries = matrices[0].len();
        let mut coefficients = Vec::with_capacity(entries.div_ceil(TOGETHER) * matrices.len());
        for start in (0..entries).step_by(TOGETHER) {
            for (k, matrix) in matrices.iter().enumerate() {
                let mut packed = [0.0; 2 * TOGETHER];
                for e in start..entries.min(start + TOGETHER) {
                    packed[e - start] = matrix[e];
                    packed[TOGETHER + e - start] =
                        matrices.get(k + 1).map_or(0.0, |next| (k + 1) as f64 * next[e]);
                }
                coefficients.push(packed);
            }
        }
        let size = |packed: &[f64; 2 * TOGETHER]| std::array::from_fn(|e| packed[e].abs());
        let sizes = coefficients.iter().map(size).collect();
        let norm = |matrix: &&[f64]| matrix.iter().map(|v| v * v).sum::<f64>().sqrt();
        Self { coefficients, sizes, norms: matrices.iter().map(norm).collect() }
    }
}

/// P(z) = z^p I − A_1 z^(p−1) − … − A_p, and the reversed polynomial z^p P(1/z), which stays in range outside the unit
/// circle.
pub(crate) struct Polynomial {
    pub(crate) m: usize,
    pub(crate) degree: usize,
    inside: Form,
    outside: Form,
}

impl Polynomial {
    /// From A_1 … A_p (p×m×m).
    pub(crate) fn new(m: usize, coefficients: &[f64]) -> Self {
        let mut leading = vec![0.0; m * m];
        leading.iter_mut().step_by(m + 1).for_each(|v| *v = 1.0);
        let negative: Vec<_> = coefficients.iter().map(|v| -v).collect();
        let mut matrices = vec![&leading[..]];
        matrices.extend(negative.chunks_exact(m * m));
        let outside = Form::new(&matrices);
        matrices.reverse();
        Self { m, degree: matrices.len() - 1, inside: Form::new(&matrices), outside }
    }

    /// Number of eigenvalues.
    pub(crate) fn count(&self) -> usize {
        self.m * self.degree
    }

    /// Norms of the coefficients of z^0 … z^p.
    pub(crate) fn norms(&self) -> &[f64] {
        &self.inside.norms
    }
}

/// Memory for the polynomial at one group of points.
pub(crate) struct Work<S: Simd> {
    powers: Vec<Complex<S>>,
    lengths: Vec<Real<S>>,
    /// P, and P', by rows; the last block may have entries that belong to neither.
    value: Vec<Complex<S>>,
    slope: Vec<Complex<S>>,
    /// Σ|C_k||z|^k, likewise.
    size: Vec<Real<S>>,
}

/// Whether a point belongs to the reversed polynomial, and the number that goes into it.
pub(crate) fn argument(z: C64<f64>) -> (bool, C64<f64>) {
    if z.norm_sqr() > 1.0 { (true, z.inv()) } else { (false, z) }
}

impl<S: Simd> Work<S> {
    pub(crate) fn new(simd: S, m: usize, degree: usize) -> Self {
        let entries = (m * m).next_multiple_of(TOGETHER);
        let (zero, real) = (Complex::zero(simd), Real::splat(simd, 0.0));
        Self {
            powers: vec![zero; degree + 1],
            lengths: vec![real; degree + 1],
            value: vec![zero; entries],
            slope: vec![zero; entries],
            size: vec![real; entries],
        }
    }

    /// P, by rows, in one lane.
    pub(crate) fn value(&self, lane: usize) -> impl Iterator<Item = C64<f64>> + Clone {
        self.value.iter().map(move |entry| entry.lane(lane)).map(|(re, im)| C64::new(re, im))
    }

    /// Sets P and P' at the arguments `z`; Σ‖C_k‖|z|^k.
    #[inline(always)]
    pub(crate) fn evaluate(
        &mut self,
        simd: S,
        polynomial: &Polynomial,
        outside: bool,
        z: Complex<S>,
    ) -> Real<S> {
        let form = if outside { &polynomial.outside } else { &polynomial.inside };
        let radius = z.norm_squared(simd).sqrt(simd);
        let (mut power, mut size) = (Complex::splat(simd, 1.0), Real::splat(simd, 0.0));
        let mut length = Real::splat(simd, 1.0);
        for (i, &norm) in form.norms.iter().enumerate() {
            (self.powers[i], self.lengths[i]) = (power, length);
            size = size.add_mul(simd, Real::splat(simd, norm), length);
            power = power.mul(simd, z);
            length = length.mul(simd, radius);
        }
        let powers = &self.powers[..form.norms.len()];
        let values = self.value.as_chunks_mut::<TOGETHER>().0;
        let slopes = self.slope.as_chunks_mut::<TOGETHER>().0;
        let blocks = form.coefficients.chunks_exact(powers.len());
        for ((block, value), slope) in blocks.zip(values).zip(slopes) {
            let mut sums = [Complex::zero(simd); 2 * TOGETHER];
            for (coefficients, &power) in block.iter().zip(powers) {
                for i in 0..2 * TOGETHER {
                    sums[i] = sums[i].add_scaled(simd, Real::splat(simd, coefficients[i]), power);
                }
            }
            value.copy_from_slice(&sums[..TOGETHER]);
            slope.copy_from_slice(&sums[TOGETHER..]);
        }
        let lengths = &self.lengths[..form.norms.len()];
        let blocks = form.sizes.chunks_exact(lengths.len());
        for (block, place) in blocks.zip(self.size.as_chunks_mut::<TOGETHER>().0) {
            let mut sums = [Real::splat(simd, 0.0); TOGETHER];
            for (sizes, &length) in block.iter().zip(lengths) {
                for i in 0..TOGETHER {
                    sums[i] = sums[i].add_mul(simd, Real::splat(simd, sizes[i]), length);
                }
            }
            place.copy_from_slice(&sums);
        }
        size
    }

    /// Divides rows and columns of P and P' by their largest sizes, so that these are at most one; the square of the
    /// norm of all sizes, and the largest of the smallest row.
    ///
    /// An entry may be small beside the others and yet known to as many digits: where a channel follows itself only, its
    /// entries shrink like z^p inside the unit circle. What is singular to rounding shows between rows and columns of
    /// like size.
    #[inline(always)]
    pub(crate) fn equilibrate(&mut self, simd: S, m: usize) -> (Real<S>, Real<S>) {
        let (least, zero) = (Real::splat(simd, f64::MIN_POSITIVE), Real::splat(simd, 0.0));
        let mut smallest = Real::splat(simd, f64::INFINITY);
        for i in 0..m {
            let row = i * m..(i + 1) * m;
            let largest = self.size[row.clone()].iter().fold(zero, |max, &size| max.max(simd, size));
            smallest = smallest.min(simd, largest);
            self.divide(simd, row, largest.max(simd, least));
        }
        let mut square = zero;
        for j in 0..m {
            let column = (j..m * m).step_by(m);
            let largest = column.clone().fold(zero, |max, e| max.max(simd, self.size[e]));
            self.divide(simd, column.clone(), largest.max(simd, least));
            square = column.fold(square, |sum, e| sum.add_mul(simd, self.size[e], self.size[e]));
        }
        (square, smallest)
    }

    #[inline(always)]
    fn divide(&mut self, simd: S, entries: impl Iterator<Item = usize>, size: Real<S>) {
        let scale = Real::splat(simd, 1.0).div(simd, size);
        for e in entries {
            self.size[e] = self.size[e].mul(simd, scale);
            self.value[e] = self.value[e].scale(simd, scale);
            self.slope[e] = self.slope[e].scale(simd, scale);
        }
    }

    /// tr(P⁻¹P') and a bound from above for the smallest squared singular value of P, by elimination with partial
    /// pivoting; overwrites both.
    #[inline(always)]
    pub(crate) fn trace(&mut self, simd: S, m: usize) -> (Complex<S>, Real<S>) {
        let (a, b) = (&mut self.value, &mut self.slope);
        let (mut least, mut last) = (Real::splat(simd, f64::INFINITY), Real::splat(simd, 0.0));
        for j in 0..m {
            for i in j + 1..m {
                let longer = a[i * m + j].norm_squared(simd).sub(simd, a[j * m + j].norm_squared(simd));
                for c in j..m {
                    swap(simd, longer, a, j * m + c, i * m + c);
                }
                for c in 0..m {
                    swap(simd, longer, b, j * m + c, i * m + c);
                }
            }
            let pivot = a[j * m + j];
            let size = pivot.norm_squared(simd);
            (least, last) = (least.min(simd, size), size);
            let scale =
                Real::splat(simd, 1.0).div(simd, size.max(simd, Real::splat(simd, f64::MIN_POSITIVE)));
            let inverse = Complex { re: pivot.re, im: pivot.im.neg(simd) }.scale(simd, scale);
            a[j * m + j] = inverse;
            for i in j + 1..m {
                let l = a[i * m + j].mul(simd, inverse);
                for c in j + 1..m {
                    a[i * m + c] = a[i * m + c].sub_mul(simd, l, a[j * m + c]);
                }
                for c in 0..m {
                    b[i * m + c] = b[i * m + c].sub_mul(simd, l, b[j * m + c]);
                }
            }
        }
        // The diagonal of U⁻¹ B: column c of it down to row c.
        let mut trace = Complex::zero(simd);
        for c in 0..m {
            for i in (c..m).rev() {
                let mut sum = b[i * m + c];
                for l in i + 1..m {
                    sum = sum.sub_mul(simd, a[i * m + l], b[l * m + c]);
                }
                b[i * m + c] = sum.mul(simd, a[i * m + i]);
            }
            trace = trace.add(simd, b[c * m + c]);
        }
        // ‖P x‖ / ‖x‖ for x = U⁻¹ e_m, times the last pivot: far below it where the null vector hardly moves row m.
        let mut square = Real::splat(simd, 1.0);
        b[m - 1] = Complex::splat(simd, 1.0);
        for i in (0..m - 1).rev() {
            let mut sum = Complex::zero(simd);
            for l in i + 1..m {
                sum = sum.sub_mul(simd, a[i * m + l], b[l]);
            }
            b[i] = sum.mul(simd, a[i * m + i]);
            square = square.add(simd, b[i].norm_squared(simd));
        }
        (trace, least.min(simd, last.div(simd, square)))
    }
}

/// Exchanges two numbers in the lanes where `wanted` is not negative.
#[inline(always)]
fn swap<S: Simd>(simd: S, wanted: Real<S>, numbers: &mut [Complex<S>], i: usize, j: usize) {
    let (a, b) = (numbers[i], numbers[j]);
    let pick = |a: Complex<S>, b: Complex<S>| Complex {
        re: wanted.where_not_negative(simd, b.re, a.re),
        im: wanted.where_not_negative(simd, b.im, a.im),
    };
    (numbers[i], numbers[j]) = (pick(a, b), pick(b, a));
}
