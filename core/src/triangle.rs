//! Upper triangles in place of tall blocks of rows: all that least squares needs of a Jacobian and its residual.
//!
//! Rows are folded into R by Householder reflections as soon as they are computed, so RᵀR = [J r]ᵀ[J r] without the
//! thousands of rows ever standing side by side.

use crate::lanes::{REGISTERS, Real};
use pulp::{Arch, Simd, WithSimd, bytemuck};

/// Columns that one reflection is applied to at a time.
const TOGETHER: usize = 3;

/// Upper triangle R, (c+1)×(c+1) by rows: the last column belongs to the residual, the others to the free parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Triangle {
    /// Number of free parameters c plus one.
    pub width: usize,
    /// R by rows.
    pub values: Vec<f64>,
    /// The second cost, under the weights of the price.
    pub price: f64,
}

impl Triangle {
    pub(crate) fn zeros(width: usize) -> Self {
        Self { width, values: vec![0.0; width * width], price: 0.0 }
    }

    /// A triangle by rows, width×width, whose price is its own cost.
    pub fn priced_by_itself(width: usize, values: Vec<f64>) -> Self {
        let mut triangle = Self { width, values, price: 0.0 };
        triangle.price = triangle.cost();
        triangle
    }

    /// The cost Σ W |r|².
    pub fn cost(&self) -> f64 {
        (0..self.width).map(|i| self.values[i * self.width + self.width - 1].powi(2)).sum()
    }

    /// Takes the rows of another triangle of the same width in, and its price.
    pub fn merge(&mut self, part: &Self) {
        Arch::new().dispatch(Merge { into: self, part });
    }
}

/// Rows waiting to be folded: column-major, one register per group of rows.
pub(crate) struct Block<S: Simd> {
    groups: Vec<S::f64s>,
    pub(crate) height: usize,
    pub(crate) filled: usize,
}

impl<S: Simd> Block<S> {
    pub(crate) fn new(simd: S, width: usize, height: usize) -> Self {
        Self { groups: vec![simd.splat_f64s(0.0); width * height], height, filled: 0 }
    }

    /// Puts the real and imaginary parts of one column into the next rows.
    #[inline(always)]
    pub(crate) fn put(&mut self, column: usize, parts: [Real<S>; 2]) {
        let at = column * self.height + self.filled;
        for (place, register) in
            self.groups[at..at + 2 * REGISTERS].iter_mut().zip(parts.iter().flat_map(|part| part.0))
        {
            *place = register;
        }
    }

    /// Folds the filled rows into `triangle`: one Householder reflection per column over its diagonal and the block.
    #[inline(always)]
    pub(crate) fn fold(&mut self, simd: S, triangle: &mut Triangle) {
        let (width, filled) = (triangle.width, std::mem::take(&mut self.filled));
        for j in 0..width {
            let (head, tail) = self.groups.split_at_mut((j + 1) * self.height);
            let column = &mut head[j * self.height..j * self.height + filled];
            let below = dot(simd, column, column);
            if below == 0.0 {
                continue;
            }
            let top = triangle.values[j * width + j];
            let length = -(top * top + below).sqrt().copysign(top);
            let factor = (length - top) / length;
            let scale = simd.splat_f64s(1.0 / (top - length));
            for value in column.iter_mut() {
                *value = simd.mul_f64s(*value, scale);
            }
            triangle.values[j * width + j] = length;
            let row = &mut triangle.values[j * width + j + 1..(j + 1) * width];
            let mut groups = tail.chunks_exact_mut(TOGETHER * self.height);
            let mut entries = row.chunks_exact_mut(TOGETHER);
            for (columns, entries) in groups.by_ref().zip(entries.by_ref()) {
                reflect::<S, TOGETHER>(simd, column, columns, self.height, entries, factor);
            }
            let rest = groups.into_remainder().chunks_exact_mut(self.height);
            for (columns, entry) in rest.zip(entries.into_remainder()) {
                reflect::<S, 1>(simd, column, columns, self.height, std::slice::from_mut(entry), factor);
            }
        }
    }
}

/// Applies the reflection along (1, `u`) to N columns at a time, whose tops are `entries`: so the sums of one hide the
/// latency of the others.
#[inline(always)]
fn reflect<S: Simd, const N: usize>(
    simd: S,
    u: &[S::f64s],
    columns: &mut [S::f64s],
    height: usize,
    entries: &mut [f64],
    factor: f64,
) {
    let zero = simd.splat_f64s(0.0);
    let mut sums = [[zero; 2]; N];
    let mut pairs = u.chunks_exact(2);
    for (i, pair) in pairs.by_ref().enumerate() {
        for n in 0..N {
            let at = n * height + 2 * i;
            sums[n][0] = simd.mul_add_e_f64s(pair[0], columns[at], sums[n][0]);
            sums[n][1] = simd.mul_add_e_f64s(pair[1], columns[at + 1], sums[n][1]);
        }
    }
    for &last in pairs.remainder() {
        for n in 0..N {
            sums[n][0] = simd.mul_add_e_f64s(last, columns[n * height + u.len() - 1], sums[n][0]);
        }
    }
    let mut steps = [zero; N];
    for n in 0..N {
        let dot = simd.reduce_sum_f64s(simd.add_f64s(sums[n][0], sums[n][1]));
        let step = factor * (entries[n] + dot);
        entries[n] -= step;
        steps[n] = simd.splat_f64s(step);
    }
    for (i, &u) in u.iter().enumerate() {
        for n in 0..N {
            let value = &mut columns[n * height + i];
            *value = simd.negate_mul_add_e_f64s(steps[n], u, *value);
        }
    }
}

#[inline(always)]
fn dot<S: Simd>(simd: S, a: &[S::f64s], b: &[S::f64s]) -> f64 {
    let mut sums = [simd.splat_f64s(0.0); 4];
    let (a4, b4) = (a.chunks_exact(4), b.chunks_exact(4));
    for (&x, &y) in a4.remainder().iter().zip(b4.remainder()) {
        sums[0] = simd.mul_add_e_f64s(x, y, sums[0]);
    }
    for (x, y) in a4.zip(b4) {
        for i in 0..4 {
            sums[i] = simd.mul_add_e_f64s(x[i], y[i], sums[i]);
        }
    }
    let halves = [simd.add_f64s(sums[0], sums[1]), simd.add_f64s(sums[2], sums[3])];
    simd.reduce_sum_f64s(simd.add_f64s(halves[0], halves[1]))
}

struct Merge<'a> {
    into: &'a mut Triangle,
    part: &'a Triangle,
}

impl WithSimd for Merge<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let width = self.part.width;
        let height = width.div_ceil(S::F64_LANES);
        let mut block = Block::<S>::new(simd, width, height);
        for column in 0..width {
            for row in 0..=column {
                let group = &mut block.groups[column * height + row / S::F64_LANES];
                let lanes: &mut [f64] = bytemuck::cast_slice_mut(std::slice::from_mut(group));
                lanes[row % S::F64_LANES] = self.part.values[row * width + column];
            }
        }
        block.filled = height;
        block.fold(simd, self.into);
        self.into.price += self.part.price;
    }
}
