//! Right-hand sides and solutions over SIMD lanes, three columns side by side.
//!
//! Three columns share every load of a factor's entry and hide each other's latency; what is left over goes one by one.

use crate::lanes::{Complex, Real, SIDE_BY_SIDE, row};
use pulp::Simd;

/// An n×m matrix of complex lanes, stored in blocks of three columns and single ones after them.
pub(crate) struct Columns<S: Simd> {
    n: usize,
    m: usize,
    values: Vec<Complex<S>>,
}

impl<S: Simd> Columns<S> {
    pub(crate) fn zeros(simd: S, n: usize, m: usize) -> Self {
        Self { n, m, values: vec![Complex::zero(simd); n * m] }
    }

    fn whole(&self) -> usize {
        self.m / SIDE_BY_SIDE * SIDE_BY_SIDE
    }

    #[inline(always)]
    fn place(&self, i: usize, column: usize) -> usize {
        if column < self.whole() {
            column / SIDE_BY_SIDE * SIDE_BY_SIDE * self.n + i * SIDE_BY_SIDE + column % SIDE_BY_SIDE
        } else {
            column * self.n + i
        }
    }

    /// Entry (i, column).
    #[inline(always)]
    pub(crate) fn at(&self, i: usize, column: usize) -> Complex<S> {
        self.values[self.place(i, column)]
    }

    /// One lane of an entry.
    pub(crate) fn set_lane(&mut self, i: usize, column: usize, lane: usize, value: (f64, f64)) {
        let place = self.place(i, column);
        self.values[place].set_lane(lane, value);
    }

    /// X = Z⁻¹ Bᵀ for the m rows of B (m×n), with the factor of [`crate::lanes::factor`].
    #[inline(always)]
    pub(crate) fn solve(&mut self, simd: S, z: &[Complex<S>], rows: &[f64]) {
        let (n, whole) = (self.n, self.whole());
        let (blocks, singles) = self.values.split_at_mut(whole * n);
        for (block, rows) in
            blocks.chunks_exact_mut(SIDE_BY_SIDE * n).zip(rows.chunks_exact(SIDE_BY_SIDE * n))
        {
            solve_block::<S, SIDE_BY_SIDE>(simd, z, rows, block.as_chunks_mut().0);
        }
        for (single, rows) in singles.chunks_exact_mut(n).zip(rows[whole * n..].chunks_exact(n)) {
            solve_block::<S, 1>(simd, z, rows, single.as_chunks_mut().0);
        }
    }

    /// Σ_i weights_i X_(i, column).
    #[inline(always)]
    pub(crate) fn dot(&self, simd: S, weights: &[f64], column: usize) -> Complex<S> {
        let start = self.place(0, column);
        let stride = if column < self.whole() { SIDE_BY_SIDE } else { 1 };
        let mut sum = Complex::zero(simd);
        for (&weight, &value) in weights.iter().zip(self.values[start..].iter().step_by(stride)) {
            sum = sum.add_scaled(simd, Real::splat(simd, weight), value);
        }
        sum
    }
}

#[inline(always)]
fn solve_block<S: Simd, const M: usize>(simd: S, z: &[Complex<S>], rows: &[f64], x: &mut [[Complex<S>; M]]) {
    let n = x.len();
    for i in 0..n {
        let (known, rest) = x.split_at_mut(i);
        let mut sum = [Complex::zero(simd); M];
        for b in 0..M {
            sum[b] = Complex::splat(simd, rows[b * n + i]);
        }
        for (&l, value) in z[row(i)..row(i) + i].iter().zip(known.iter()) {
            for b in 0..M {
                sum[b] = sum[b].sub_mul(simd, l, value[b]);
            }
        }
        rest[0] = sum;
    }
    for (i, value) in x.iter_mut().enumerate() {
        for entry in value {
            *entry = entry.mul(simd, z[row(i) + i]);
        }
    }
    for i in (1..n).rev() {
        let (open, solved) = x.split_at_mut(i);
        let value = solved[0];
        for (&l, place) in z[row(i)..row(i) + i].iter().zip(open.iter_mut()) {
            for b in 0..M {
                place[b] = place[b].sub_mul(simd, l, value[b]);
            }
        }
    }
}
