//! Complex arithmetic and the complex-symmetric LDLᵀ factorization over SIMD lanes, one evaluation point per lane.

use pulp::{Simd, bytemuck};

/// Registers that every number here spans: two of them share the cost of the loops around the arithmetic.
pub const REGISTERS: usize = 2;

/// Evaluation points that are handled at a time.
pub const fn lanes<S: Simd>() -> usize {
    REGISTERS * S::F64_LANES
}

/// One real number per lane.
#[derive(Debug, Clone, Copy)]
pub struct Real<S: Simd>(pub [S::f64s; REGISTERS]);

impl<S: Simd> Real<S> {
    /// The same number in every lane.
    #[inline(always)]
    pub fn splat(simd: S, value: f64) -> Self {
        Self([simd.splat_f64s(value); REGISTERS])
    }

    #[inline(always)]
    fn map2(self, b: Self, f: impl Fn(S::f64s, S::f64s) -> S::f64s) -> Self {
        Self([f(self.0[0], b.0[0]), f(self.0[1], b.0[1])])
    }

    /// self + b.
    #[inline(always)]
    pub fn add(self, simd: S, b: Self) -> Self {
        self.map2(b, |a, b| simd.add_f64s(a, b))
    }

    /// self − b.
    #[inline(always)]
    pub fn sub(self, simd: S, b: Self) -> Self {
        self.map2(b, |a, b| simd.sub_f64s(a, b))
    }

    /// self · b.
    #[inline(always)]
    pub fn mul(self, simd: S, b: Self) -> Self {
        self.map2(b, |a, b| simd.mul_f64s(a, b))
    }

    /// self / b.
    #[inline(always)]
    pub fn div(self, simd: S, b: Self) -> Self {
        self.map2(b, |a, b| simd.div_f64s(a, b))
    }

    /// The smaller of the two.
    #[inline(always)]
    pub fn min(self, simd: S, b: Self) -> Self {
        self.map2(b, |a, b| simd.min_f64s(a, b))
    }

    /// The larger of the two.
    #[inline(always)]
    pub fn max(self, simd: S, b: Self) -> Self {
        self.map2(b, |a, b| simd.max_f64s(a, b))
    }

    /// `yes` where self ≥ 0, else `no`.
    #[inline(always)]
    pub fn where_not_negative(self, simd: S, yes: Self, no: Self) -> Self {
        let zero = simd.splat_f64s(0.0);
        let one = |i: usize| {
            let mask = simd.greater_than_or_equal_f64s(self.0[i], zero);
            simd.select_f64s(mask, yes.0[i], no.0[i])
        };
        Self([one(0), one(1)])
    }

    /// −self.
    #[inline(always)]
    pub fn neg(self, simd: S) -> Self {
        Self([simd.neg_f64s(self.0[0]), simd.neg_f64s(self.0[1])])
    }

    /// √self.
    #[inline(always)]
    pub fn sqrt(self, simd: S) -> Self {
        Self([simd.sqrt_f64s(self.0[0]), simd.sqrt_f64s(self.0[1])])
    }

    /// self + a·b.
    #[inline(always)]
    pub fn add_mul(self, simd: S, a: Self, b: Self) -> Self {
        let one = |i: usize| simd.mul_add_e_f64s(a.0[i], b.0[i], self.0[i]);
        Self([one(0), one(1)])
    }

    /// self − a·b.
    #[inline(always)]
    pub fn sub_mul(self, simd: S, a: Self, b: Self) -> Self {
        let one = |i: usize| simd.negate_mul_add_e_f64s(a.0[i], b.0[i], self.0[i]);
        Self([one(0), one(1)])
    }

    /// The lanes as a slice.
    #[inline(always)]
    pub fn as_slice(&self) -> &[f64] {
        bytemuck::cast_slice(&self.0)
    }

    /// The lanes as a mutable slice.
    #[inline(always)]
    pub fn as_mut_slice(&mut self) -> &mut [f64] {
        bytemuck::cast_slice_mut(&mut self.0)
    }
}

/// One complex number per lane, real and imaginary parts in registers of their own.
#[derive(Debug, Clone, Copy)]
pub struct Complex<S: Simd> {
    /// Real parts.
    pub re: Real<S>,
    /// Imaginary parts.
    pub im: Real<S>,
}

impl<S: Simd> Complex<S> {
    /// A real number in every lane.
    #[inline(always)]
    pub fn splat(simd: S, value: f64) -> Self {
        Self { re: Real::splat(simd, value), im: Real::splat(simd, 0.0) }
    }

    /// Zero in every lane.
    #[inline(always)]
    pub fn zero(simd: S) -> Self {
        Self::splat(simd, 0.0)
    }

    /// self + b.
    #[inline(always)]
    pub fn add(self, simd: S, b: Self) -> Self {
        Self { re: self.re.add(simd, b.re), im: self.im.add(simd, b.im) }
    }

    /// self · b.
    #[inline(always)]
    pub fn mul(self, simd: S, b: Self) -> Self {
        Self {
            re: self.re.mul(simd, b.re).sub_mul(simd, self.im, b.im),
            im: self.re.mul(simd, b.im).add_mul(simd, self.im, b.re),
        }
    }

    /// −self.
    #[inline(always)]
    pub fn neg(self, simd: S) -> Self {
        Self { re: self.re.neg(simd), im: self.im.neg(simd) }
    }

    /// self · a for a real a.
    #[inline(always)]
    pub fn scale(self, simd: S, a: Real<S>) -> Self {
        Self { re: self.re.mul(simd, a), im: self.im.mul(simd, a) }
    }

    /// self + a·b.
    #[inline(always)]
    pub fn add_mul(self, simd: S, a: Self, b: Self) -> Self {
        Self {
            re: self.re.add_mul(simd, a.re, b.re).sub_mul(simd, a.im, b.im),
            im: self.im.add_mul(simd, a.re, b.im).add_mul(simd, a.im, b.re),
        }
    }

    /// self − a·b.
    #[inline(always)]
    pub fn sub_mul(self, simd: S, a: Self, b: Self) -> Self {
        Self {
            re: self.re.sub_mul(simd, a.re, b.re).add_mul(simd, a.im, b.im),
            im: self.im.sub_mul(simd, a.re, b.im).sub_mul(simd, a.im, b.re),
        }
    }

    /// self + a·b for a real a.
    #[inline(always)]
    pub fn add_scaled(self, simd: S, a: Real<S>, b: Self) -> Self {
        Self { re: self.re.add_mul(simd, a, b.re), im: self.im.add_mul(simd, a, b.im) }
    }

    /// |self|².
    #[inline(always)]
    pub fn norm_squared(self, simd: S) -> Real<S> {
        self.im.mul(simd, self.im).add_mul(simd, self.re, self.re)
    }

    /// 1 / self.
    #[inline(always)]
    pub fn inverse(self, simd: S) -> Self {
        self.conj_over(simd, self.norm_squared(simd))
    }

    /// Conjugate of self divided by a real.
    #[inline(always)]
    fn conj_over(self, simd: S, size: Real<S>) -> Self {
        let scale = Real::splat(simd, 1.0).div(simd, size);
        Self { re: self.re.mul(simd, scale), im: self.im.mul(simd, scale).neg(simd) }
    }

    /// The number in one lane.
    #[inline(always)]
    pub fn lane(&self, lane: usize) -> (f64, f64) {
        (self.re.as_slice()[lane], self.im.as_slice()[lane])
    }

    /// Overwrites the number in one lane.
    #[inline(always)]
    pub fn set_lane(&mut self, lane: usize, (re, im): (f64, f64)) {
        self.re.as_mut_slice()[lane] = re;
        self.im.as_mut_slice()[lane] = im;
    }
}

/// Offset of row i in a packed lower triangle.
#[inline(always)]
pub const fn row(i: usize) -> usize {
    i * (i + 1) / 2
}

/// Rows that [`factor`] and columns that a solution treats together: they share every load of the factor, and their
/// accumulators stay in registers.
pub const SIDE_BY_SIDE: usize = 3;

/// Factors a packed lower triangle Z = L D Lᵀ in place, without pivoting: L below, 1/D on the diagonal.
///
/// Safe where the imaginary part is definite (damped, s = iω); elsewhere a pivot can be small. Returned per lane is the
/// smallest |d_j|² − floor_j, negative where a pivot fell below its floor. `scratch` has room for n × [`SIDE_BY_SIDE`].
#[inline(always)]
pub fn factor<S: Simd>(
    simd: S,
    z: &mut [Complex<S>],
    n: usize,
    floor: &[Real<S>],
    scratch: &mut [Complex<S>],
) -> Real<S> {
    let mut margin = Real::splat(simd, f64::INFINITY);
    let whole = n / SIDE_BY_SIDE * SIDE_BY_SIDE;
    for start in (0..whole).step_by(SIDE_BY_SIDE) {
        let scratch = scratch.as_chunks_mut::<SIDE_BY_SIDE>().0;
        margin = margin.min(simd, factor_rows(simd, z, start, floor, scratch));
    }
    for start in whole..n {
        margin = margin.min(simd, factor_rows::<S, 1>(simd, z, start, floor, scratch.as_chunks_mut().0));
    }
    margin
}

/// Rows `start` to `start + M` of the factor, those above being done.
#[inline(always)]
fn factor_rows<S: Simd, const M: usize>(
    simd: S,
    z: &mut [Complex<S>],
    start: usize,
    floor: &[Real<S>],
    y: &mut [[Complex<S>; M]],
) -> Real<S> {
    let (above, rows) = z.split_at_mut(row(start));
    let y = &mut y[..start];
    let at = |b: usize| row(start + b) - row(start);
    // Y = L D for these rows: forward substitution against the rows above.
    for k in 0..start {
        let mut sum = [Complex::zero(simd); M];
        for b in 0..M {
            sum[b] = rows[at(b) + k];
        }
        for (&l, y) in above[row(k)..row(k) + k].iter().zip(y.iter()) {
            for b in 0..M {
                sum[b] = sum[b].sub_mul(simd, l, y[b]);
            }
        }
        y[k] = sum;
    }
    // L = Y D⁻¹, and what is left of the diagonal block.
    for (k, y) in y.iter().enumerate() {
        let inverse = above[row(k) + k];
        for b in 0..M {
            rows[at(b) + k] = y[b].mul(simd, inverse);
        }
    }
    let mut block = [[Complex::zero(simd); M]; M];
    for b in 0..M {
        let line = &rows[at(b)..at(b) + start + b + 1];
        for c in 0..=b {
            let mut sum = line[start + c];
            for (&l, y) in line[..start].iter().zip(y.iter()) {
                sum = sum.sub_mul(simd, l, y[c]);
            }
            block[b][c] = sum;
        }
    }
    let mut margin = Real::splat(simd, f64::INFINITY);
    for j in 0..M {
        let size = block[j][j].norm_squared(simd);
        margin = margin.min(simd, size.sub(simd, floor[start + j]));
        let inverse = block[j][j].conj_over(simd, size);
        for b in j + 1..M {
            let l = block[b][j].mul(simd, inverse);
            for c in j + 1..=b {
                block[b][c] = block[b][c].sub_mul(simd, l, block[c][j]);
            }
            rows[at(b) + start + j] = l;
        }
        rows[at(j) + start + j] = inverse;
    }
    margin
}
