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
        let scale = simd.div_f64s(simd.splat_f64s(1.0), self.norm_squared(simd));
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
/// Safe where the imaginary part is definite (damped, s = iω); elsewhere a pivot can be small, so the smallest ratio
/// |d_j|² / scale_j² per lane is returned for the caller to judge (`scale_squared` holds the squared size of the terms
/// that made each diagonal entry).
#[inline(always)]
pub fn factor<S: Simd>(simd: S, z: &mut [Complex<S>], n: usize, scale_squared: &[S::f64s]) -> S::f64s {
    let mut worst = simd.splat_f64s(f64::INFINITY);
    for j in 0..n {
        let pivot = z[row(j) + j];
        worst = simd.min_f64s(worst, simd.div_f64s(pivot.norm_squared(simd), scale_squared[j]));
        let inverse = pivot.inverse(simd);
        z[row(j) + j] = inverse;
        // Column j still holds L·D; row by row it updates what lies right of it, then becomes L.
        for i in j + 1..n {
            let l = z[row(i) + j].mul(simd, inverse);
            let (head, tail) = z.split_at_mut(row(i));
            for k in j + 1..i {
                tail[k] = tail[k].sub_mul(simd, l, head[row(k) + j]);
            }
            tail[i] = tail[i].sub_mul(simd, l, tail[j]);
        }
        for i in j + 1..n {
            z[row(i) + j] = z[row(i) + j].mul(simd, inverse);
        }
    }
    worst
}

/// Solves Z x = b in place after [`factor`].
#[inline(always)]
pub fn solve<S: Simd>(simd: S, z: &[Complex<S>], n: usize, x: &mut [Complex<S>]) {
    for i in 1..n {
        let mut sum = x[i];
        for k in 0..i {
            sum = sum.sub_mul(simd, z[row(i) + k], x[k]);
        }
        x[i] = sum;
    }
    for i in 0..n {
        x[i] = x[i].mul(simd, z[row(i) + i]);
    }
    for i in (1..n).rev() {
        let value = x[i];
        for k in 0..i {
            x[k] = x[k].sub_mul(simd, z[row(i) + k], value);
        }
    }
}
