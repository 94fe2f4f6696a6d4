//! Complex arithmetic and the complex-symmetric LDLᵀ factorization over SIMD lanes, one evaluation point per lane.

use pulp::{Simd, bytemuck};

/// One complex number per lane, real and imaginary parts in registers of their own.
#[derive(Debug, Clone, Copy)]
pub struct Complex<S: Simd> {
    /// Real parts.
    pub re: S::f64s,
    /// Imaginary parts.
    pub im: S::f64s,
}

impl<S: Simd> Complex<S> {
    /// Zero in every lane.
    #[inline(always)]
    pub fn zero(simd: S) -> Self {
        Self { re: simd.splat_f64s(0.0), im: simd.splat_f64s(0.0) }
    }

    /// self + b.
    #[inline(always)]
    pub fn add(self, simd: S, b: Self) -> Self {
        Self { re: simd.add_f64s(self.re, b.re), im: simd.add_f64s(self.im, b.im) }
    }

    /// self · b.
    #[inline(always)]
    pub fn mul(self, simd: S, b: Self) -> Self {
        Self {
            re: simd.negate_mul_add_e_f64s(self.im, b.im, simd.mul_f64s(self.re, b.re)),
            im: simd.mul_add_e_f64s(self.im, b.re, simd.mul_f64s(self.re, b.im)),
        }
    }

    /// −self.
    #[inline(always)]
    pub fn neg(self, simd: S) -> Self {
        Self { re: simd.neg_f64s(self.re), im: simd.neg_f64s(self.im) }
    }

    /// self · a for a real a.
    #[inline(always)]
    pub fn scale(self, simd: S, a: S::f64s) -> Self {
        Self { re: simd.mul_f64s(self.re, a), im: simd.mul_f64s(self.im, a) }
    }

    /// self + a·b.
    #[inline(always)]
    pub fn add_mul(self, simd: S, a: Self, b: Self) -> Self {
        Self {
            re: simd.negate_mul_add_e_f64s(a.im, b.im, simd.mul_add_e_f64s(a.re, b.re, self.re)),
            im: simd.mul_add_e_f64s(a.im, b.re, simd.mul_add_e_f64s(a.re, b.im, self.im)),
        }
    }

    /// self − a·b.
    #[inline(always)]
    pub fn sub_mul(self, simd: S, a: Self, b: Self) -> Self {
        Self {
            re: simd.mul_add_e_f64s(a.im, b.im, simd.negate_mul_add_e_f64s(a.re, b.re, self.re)),
            im: simd.negate_mul_add_e_f64s(a.im, b.re, simd.negate_mul_add_e_f64s(a.re, b.im, self.im)),
        }
    }

    /// self + a·b for a real a.
    #[inline(always)]
    pub fn add_scaled(self, simd: S, a: S::f64s, b: Self) -> Self {
        Self { re: simd.mul_add_e_f64s(a, b.re, self.re), im: simd.mul_add_e_f64s(a, b.im, self.im) }
    }

    /// |self|².
    #[inline(always)]
    pub fn norm_squared(self, simd: S) -> S::f64s {
        simd.mul_add_e_f64s(self.re, self.re, simd.mul_f64s(self.im, self.im))
    }

    /// 1 / self.
    #[inline(always)]
    pub fn inverse(self, simd: S) -> Self {
        self.conj_over(simd, self.norm_squared(simd))
    }

    /// Conjugate of self divided by a real.
    #[inline(always)]
    fn conj_over(self, simd: S, size: S::f64s) -> Self {
        let scale = simd.div_f64s(simd.splat_f64s(1.0), size);
        Self { re: simd.mul_f64s(self.re, scale), im: simd.neg_f64s(simd.mul_f64s(self.im, scale)) }
    }

    /// The number in one lane.
    #[inline(always)]
    pub fn lane(&self, lane: usize) -> (f64, f64) {
        (slice_of::<S>(&self.re)[lane], slice_of::<S>(&self.im)[lane])
    }

    /// Overwrites the number in one lane.
    #[inline(always)]
    pub fn set_lane(&mut self, lane: usize, (re, im): (f64, f64)) {
        slice_of_mut::<S>(&mut self.re)[lane] = re;
        slice_of_mut::<S>(&mut self.im)[lane] = im;
    }
}

/// The lanes of one register as a slice.
#[inline(always)]
pub fn slice_of<S: Simd>(register: &S::f64s) -> &[f64] {
    bytemuck::cast_slice(std::slice::from_ref(register))
}

/// The lanes of one register as a mutable slice.
#[inline(always)]
pub fn slice_of_mut<S: Simd>(register: &mut S::f64s) -> &mut [f64] {
    bytemuck::cast_slice_mut(std::slice::from_mut(register))
}

/// Offset of row i in a packed lower triangle.
#[inline(always)]
pub const fn row(i: usize) -> usize {
    i * (i + 1) / 2
}

/// Factors a packed lower triangle Z = L D Lᵀ in place, without pivoting: L below, 1/D on the diagonal.
///
/// Safe where the imaginary part is definite (damped, s = iω); elsewhere a pivot can be small. Returned per lane is the
/// smallest |d_j|² − floor_j, negative where a pivot fell below its floor. `column` is scratch of length n.
#[inline(always)]
pub fn factor<S: Simd>(
    simd: S,
    z: &mut [Complex<S>],
    n: usize,
    floor: &[S::f64s],
    column: &mut [Complex<S>],
) -> S::f64s {
    match n {
        3 => factor_n(simd, z, 3, floor, column),
        6 => factor_n(simd, z, 6, floor, column),
        9 => factor_n(simd, z, 9, floor, column),
        _ => factor_n(simd, z, n, floor, column),
    }
}

#[inline(always)]
fn factor_n<S: Simd>(
    simd: S,
    z: &mut [Complex<S>],
    n: usize,
    floor: &[S::f64s],
    column: &mut [Complex<S>],
) -> S::f64s {
    let mut margin = simd.splat_f64s(f64::INFINITY);
    for j in 0..n {
        let pivot = z[row(j) + j];
        let size = pivot.norm_squared(simd);
        margin = simd.min_f64s(margin, simd.sub_f64s(size, floor[j]));
        let inverse = pivot.conj_over(simd, size);
        z[row(j) + j] = inverse;
        for i in j + 1..n {
            column[i] = z[row(i) + j]; // L·D, before it becomes L
        }
        for i in j + 1..n {
            let tail = &mut z[row(i)..row(i) + i + 1];
            let l = column[i].mul(simd, inverse);
            tail[j] = l;
            for (entry, &above) in tail[j + 1..].iter_mut().zip(&column[j + 1..]) {
                *entry = entry.sub_mul(simd, l, above);
            }
        }
    }
    margin
}

/// Solves Z x = b in place after [`factor`].
#[inline(always)]
pub fn solve<S: Simd>(simd: S, z: &[Complex<S>], n: usize, x: &mut [Complex<S>]) {
    match n {
        3 => solve_n(simd, &z[..6], 3, &mut x[..3]),
        6 => solve_n(simd, &z[..21], 6, &mut x[..6]),
        9 => solve_n(simd, &z[..45], 9, &mut x[..9]),
        _ => solve_n(simd, z, n, x),
    }
}

#[inline(always)]
fn solve_n<S: Simd>(simd: S, z: &[Complex<S>], n: usize, x: &mut [Complex<S>]) {
    for i in 1..n {
        let (known, rest) = x.split_at_mut(i);
        let mut sum = rest[0];
        for (&l, &value) in z[row(i)..row(i) + i].iter().zip(known.iter()) {
            sum = sum.sub_mul(simd, l, value);
        }
        rest[0] = sum;
    }
    for (i, value) in x.iter_mut().enumerate() {
        *value = value.mul(simd, z[row(i) + i]);
    }
    for i in (1..n).rev() {
        let (open, solved) = x.split_at_mut(i);
        for (&l, value) in z[row(i)..row(i) + i].iter().zip(open.iter_mut()) {
            *value = value.sub_mul(simd, l, solved[0]);
        }
    }
}
