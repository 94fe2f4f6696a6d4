//! The logarithmic residual of a fit and its Jacobian, reduced to the small triangle that least squares needs.
//!
//! Cost (Huynh et al. 2021, Eq. 22): Σ W |ln H_s − ln H|² over outputs, inputs and lines, the phase difference taken to
//! its principal value. Each block of rows is folded into an upper triangle R by Householder reflections as soon as it is
//! computed, so RᵀR = [J r]ᵀ[J r] without the thousands of rows ever standing side by side.

use crate::impedance::SpringDamper;
use crate::lanes::{Complex, REGISTERS, Real, lanes};
use crate::mechanism::finite;
use crate::solver::{Solver, load};
use crate::system::LinearSystem;
use crate::{Error, Result};
use nalgebra::Complex as C64;
use pulp::{Arch, Simd, WithSimd, bytemuck};
use rayon::prelude::*;

/// Lines that one task works on: small enough to share a fit among threads, and fixed, so that results do not depend on
/// how many there are.
const LINES_PER_TASK: usize = 64;
/// Tasks that are not worth a second thread.
const TASKS_PER_THREAD: usize = 4;
/// Rows that are gathered before they are folded in; a block of this height and some twenty columns stays in cache.
const ROWS_PER_BLOCK: usize = 128;
/// Most evaluation points that are handled at a time; arrays are padded to it.
const MAX_LANES: usize = 8 * REGISTERS;

/// One measured response matrix and the model that is to reproduce it.
#[derive(Debug, Clone)]
pub struct Target {
    system: LinearSystem,
    /// All arrays below are padded to a multiple of [`MAX_LANES`], with zero weight.
    s: Vec<C64<f64>>,
    lines: usize,
    /// 1/H measured, `[output][input][line]`.
    inverse: Vec<C64<f64>>,
    /// √W in both parts, likewise.
    root_weight: Vec<C64<f64>>,
    /// W of the price in both parts, likewise.
    price_weight: Vec<C64<f64>>,
}

impl Target {
    /// `measured` (receptances), `weights` and `prices` are `[output][input][line]`; a line of zero weight is left out
    /// whatever it holds. `prices` are the weights of a second cost, told beside the first; it counts lines that have a
    /// weight.
    ///
    /// # Errors
    /// [`Error::Length`], [`Error::Value`] for a negative weight, a number that is not finite or a weighted zero.
    pub fn new(
        system: LinearSystem,
        s: &[C64<f64>],
        measured: &[C64<f64>],
        weights: &[f64],
        prices: &[f64],
    ) -> Result<Self> {
        let (p, m) = system.shape();
        let lines = s.len();
        for (what, got) in
            [("measured", measured.len()), ("weights", weights.len()), ("prices", prices.len())]
        {
            if got != p * m * lines || lines == 0 {
                return Err(Error::Length { what, needed: p * m * lines, got });
            }
        }
        finite("s", s.iter().flat_map(|s| [s.re, s.im]))?;
        let padded = lines.next_multiple_of(MAX_LANES);
        let mut padded_s = s.to_vec();
        padded_s.resize(padded, s[lines - 1]);
        let mut inverse = vec![C64::new(1.0, 0.0); p * m * padded];
        let mut root_weight = vec![C64::new(0.0, 0.0); p * m * padded];
        let mut price_weight = root_weight.clone();
        for (i, ((&value, &weight), &price)) in measured.iter().zip(weights).zip(prices).enumerate() {
            for got in [weight, price] {
                if !(got >= 0.0 && got.is_finite()) {
                    return Err(Error::Value {
                        what: "weight",
                        got,
                        expected: "a finite number, zero or more",
                    });
                }
            }
            if weight == 0.0 {
                continue;
            }
            if value.norm_sqr() == 0.0 || !value.norm_sqr().is_finite() {
                return Err(Error::Value {
                    what: "measured response",
                    got: value.norm(),
                    expected: "a finite number other than zero, since its logarithm is fitted",
                });
            }
            let at = i / lines * padded + i % lines;
            inverse[at] = value.inv();
            root_weight[at] = C64::new(weight.sqrt(), weight.sqrt());
            price_weight[at] = C64::new(price, price);
        }
        Ok(Self { system, s: padded_s, lines, inverse, root_weight, price_weight })
    }
}

/// A fit over several targets that share their impedances.
#[derive(Debug, Clone)]
pub struct Problem {
    targets: Vec<Target>,
    branches: usize,
}

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
    fn zeros(width: usize) -> Self {
        Self { width, values: vec![0.0; width * width], price: 0.0 }
    }

    /// The cost Σ W |r|².
    pub fn cost(&self) -> f64 {
        (0..self.width).map(|i| self.values[i * self.width + self.width - 1].powi(2)).sum()
    }
}

impl Problem {
    /// Joins targets over one list of impedances.
    ///
    /// # Errors
    /// [`Error::Length`] where the targets disagree on the number of impedances, or there is none.
    pub fn new(targets: Vec<Target>) -> Result<Self> {
        let branches = targets.first().map_or(0, |t| t.system.branches());
        if targets.is_empty() {
            return Err(Error::Length { what: "targets", needed: 1, got: 0 });
        }
        for target in &targets {
            if target.system.branches() != branches {
                return Err(Error::Length {
                    what: "impedances",
                    needed: branches,
                    got: target.system.branches(),
                });
            }
        }
        Ok(Self { targets, branches })
    }

    /// Number of impedances.
    pub fn branches(&self) -> usize {
        self.branches
    }

    /// The triangle of [J r] for the `free` parameters (indices into all stiffnesses, then all dampings), J with respect
    /// to their logarithms.
    ///
    /// # Errors
    /// Mismatched lengths, [`Error::Singular`], [`Error::ZeroResponse`].
    pub fn reduce(&self, impedances: &[SpringDamper], free: &[usize]) -> Result<Triangle> {
        let count = self.branches * SpringDamper::PARAMETERS;
        if let Some(&got) = free.iter().find(|&&i| i >= count) {
            return Err(Error::Index { what: "parameter", count, got });
        }
        let tasks: Vec<(&Target, usize)> = self
            .targets
            .iter()
            .flat_map(|target| (0..target.lines).step_by(LINES_PER_TASK).map(move |start| (target, start)))
            .collect();
        for target in &self.targets {
            target.system.check(impedances)?;
        }
        let one = |&(target, start): &(&Target, usize)| {
            Arch::new().dispatch(Task { target, impedances, free, start })
        };
        // A small problem is solved before a second thread would have woken up.
        let parts: Vec<Result<Triangle>> = if tasks.len() <= TASKS_PER_THREAD {
            tasks.iter().map(one).collect()
        } else {
            tasks.par_iter().map(one).collect()
        };
        let mut total = Triangle::zeros(free.len() + 1);
        for part in parts {
            Arch::new().dispatch(Merge { into: &mut total, part: &part? });
        }
        Ok(total)
    }

    /// Costs of many impedance sets, in parallel.
    ///
    /// # Errors
    /// As [`Self::reduce`].
    pub fn costs(&self, sets: &[Vec<SpringDamper>]) -> Result<Vec<f64>> {
        sets.par_iter().map(|set| Ok(self.reduce(set, &[])?.cost())).collect()
    }
}

/// Rows waiting to be folded: column-major, one register per group of rows.
struct Block<S: Simd> {
    groups: Vec<S::f64s>,
    height: usize,
    filled: usize,
}

impl<S: Simd> Block<S> {
    fn new(simd: S, width: usize, height: usize) -> Self {
        Self { groups: vec![simd.splat_f64s(0.0); width * height], height, filled: 0 }
    }

    /// Puts the real and imaginary parts of one column into the next rows.
    #[inline(always)]
    fn put(&mut self, column: usize, parts: [Real<S>; 2]) {
        let at = column * self.height + self.filled;
        for (place, register) in
            self.groups[at..at + 2 * REGISTERS].iter_mut().zip(parts.iter().flat_map(|part| part.0))
        {
            *place = register;
        }
    }

    /// Folds the filled rows into `triangle`: one Householder reflection per column over its diagonal and the block.
    #[inline(always)]
    fn fold(&mut self, simd: S, triangle: &mut Triangle) {
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
            for (k, other) in (j + 1..width).zip(tail.chunks_exact_mut(self.height)) {
                let other = &mut other[..filled];
                let entry = &mut triangle.values[j * width + k];
                let step = factor * (*entry + dot(simd, column, other));
                *entry -= step;
                let step = simd.splat_f64s(step);
                for (value, &u) in other.iter_mut().zip(column.iter()) {
                    *value = simd.negate_mul_add_e_f64s(step, u, *value);
                }
            }
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

struct Task<'a> {
    target: &'a Target,
    impedances: &'a [SpringDamper],
    free: &'a [usize],
    start: usize,
}

impl WithSimd for Task<'_> {
    type Output = Result<Triangle>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Result<Triangle> {
        let target = self.target;
        let (p, m) = target.system.shape();
        let r = target.system.branches();
        let mirrored = target.system.mirrored();
        let width = self.free.len() + 1;
        let columns: Vec<_> = self.free.iter().map(|&i| (i / r, i % r)).collect();
        let per_chunk = 2 * REGISTERS * if mirrored { p * (p + 1) / 2 } else { p * m };
        let height = per_chunk * ROWS_PER_BLOCK.div_ceil(per_chunk * S::F64_LANES);
        let mut block = Block::<S>::new(simd, width, height);
        let mut triangle = Triangle::zeros(width);
        let mut solver = Solver::new(simd, &target.system, self.impedances, target.lines);
        let mut products = vec![Complex::zero(simd); r];
        let mut slopes = Vec::with_capacity(r);
        let (mut price, mut rest) = (Real::splat(simd, 0.0), Real::splat(simd, 0.0));
        let end = (self.start + LINES_PER_TASK).min(target.s.len());
        for start in (self.start..end).step_by(lanes::<S>()) {
            let s = load(simd, &target.s, start);
            solver.solve(simd, s, start, width > 1)?;
            slopes.clear();
            slopes.extend(self.impedances.iter().map(|z| z.log_gradient(simd, s)));
            for (a, b) in (0..p).flat_map(|a| (0..if mirrored { a + 1 } else { m }).map(move |b| (a, b))) {
                let h = solver.h[a * m + b];
                let (mut residual, mut root) = self.deviation(simd, h, (a, b), start, &mut price)?;
                if mirrored && a != b {
                    let (other, other_root) = self.deviation(simd, h, (b, a), start, &mut price)?;
                    (residual, root) = joined(simd, (residual, root), (other, other_root), &mut rest);
                }
                block.put(width - 1, [residual[0].mul(simd, root), residual[1].mul(simd, root)]);
                let scale = h.inverse(simd).scale(simd, root.neg(simd));
                if width > 1 {
                    let (y, x) = (&solver.at_outputs()[a..], &solver.at_inputs[b..]);
                    for ((product, &y), &x) in
                        products.iter_mut().zip(y.iter().step_by(p)).zip(x.iter().step_by(m))
                    {
                        *product = y.mul(simd, x).mul(simd, scale);
                    }
                }
                for (column, &(kind, branch)) in columns.iter().enumerate() {
                    let value = products[branch].mul(simd, slopes[branch][kind]);
                    block.put(column, [value.re, value.im]);
                }
                block.filled += 2 * REGISTERS;
            }
            if block.filled + per_chunk > height {
                block.fold(simd, &mut triangle);
            }
        }
        block.fold(simd, &mut triangle);
        let corner = &mut triangle.values[width * width - 1];
        *corner = corner.hypot(rest.as_slice().iter().sum::<f64>().sqrt());
        triangle.price = price.as_slice().iter().sum();
        Ok(triangle)
    }
}

impl Task<'_> {
    /// ln of modelled over measured response as real and imaginary part, and √W; adds to the price.
    #[inline(always)]
    fn deviation<S: Simd>(
        &self,
        simd: S,
        h: Complex<S>,
        (a, b): (usize, usize),
        start: usize,
        price: &mut Real<S>,
    ) -> Result<([Real<S>; 2], Real<S>)> {
        let target = self.target;
        let at = (a * target.system.shape().1 + b) * target.s.len() + start;
        let ratio = h.mul(simd, load(simd, &target.inverse, at));
        let (mut log, mut phase) = (ratio.norm_squared(simd), ratio.im);
        if !principal_logarithm::<S>(&mut log, &mut phase, &ratio.re) {
            return Err(Error::ZeroResponse { output: a, input: b, line: start });
        }
        let square = log.mul(simd, log).add_mul(simd, phase, phase);
        *price = price.add_mul(simd, square, load(simd, &target.price_weight, at).re);
        Ok(([log, phase], load(simd, &target.root_weight, at).re))
    }
}

/// Two rows with one Jacobian, H_ab = H_ba, as one: their weighted mean under the sum of their weights; what separates
/// them no parameter changes, it goes to `rest`.
#[inline(always)]
fn joined<S: Simd>(
    simd: S,
    (first, v): ([Real<S>; 2], Real<S>),
    (second, w): ([Real<S>; 2], Real<S>),
    rest: &mut Real<S>,
) -> ([Real<S>; 2], Real<S>) {
    let (v, w) = (v.mul(simd, v), w.mul(simd, w));
    let total = v.add(simd, w).add(simd, Real::splat(simd, f64::MIN_POSITIVE));
    let share = w.div(simd, total);
    let mut mean = first;
    for i in 0..2 {
        let apart = second[i].sub(simd, first[i]);
        mean[i] = first[i].add_mul(simd, share, apart);
        *rest = rest.add_mul(simd, share.mul(simd, v), apart.mul(simd, apart));
    }
    (mean, total.sqrt(simd))
}

/// ln|z| from |z|² in `log`, and arg z from its parts; false where z is zero or not finite.
#[inline(always)]
fn principal_logarithm<S: Simd>(log: &mut Real<S>, phase: &mut Real<S>, re: &Real<S>) -> bool {
    let mut valid = true;
    let lanes = log.as_mut_slice().iter_mut().zip(phase.as_mut_slice()).zip(re.as_slice());
    for ((log, im), &re) in lanes {
        valid &= *log > 0.0 && log.is_finite();
        *log = 0.5 * log.ln();
        *im = im.atan2(re);
    }
    valid
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
