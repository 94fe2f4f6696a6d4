//! Solves Z(s) X = J_inᵀ and Zᵀ(s) Y = J_outᵀ for one group of evaluation points, one per SIMD lane.
//!
//! Symmetric systems go through the unpivoted LDLᵀ of [`crate::lanes`]; a lane whose pivots cancelled, and every lane of a
//! system that is not symmetric, is solved by Gauss elimination with row exchanges.

use crate::columns::Columns;
use crate::impedance::{Direction, SpringDamper};
use crate::lanes::{self, Complex, REGISTERS, Real, SIDE_BY_SIDE, lanes, row};
use crate::system::LinearSystem;
use crate::{Error, Result};
use nalgebra::Complex as C64;
use pulp::{Simd, bytemuck};
use std::mem::MaybeUninit;

/// A pivot whose size fell below this share of the terms that made it has lost three digits: that lane is solved again.
/// What earlier pivots above the floor lost adds up to less than 1e-10 of the response.
const PIVOT_FLOOR: f64 = 1e-3;

/// Results are hundreds of kilobytes that are written once: zeroing them first would cost as much as computing them.
pub(crate) type Slot = MaybeUninit<C64<f64>>;

/// Loads [`lanes`] complex numbers from `start`; past the end the last one is repeated.
///
/// Lanes come in the architecture's shuffled order; [`store`] undoes it, and arithmetic by lanes does not care.
#[inline(always)]
pub(crate) fn load<S: Simd>(simd: S, from: &[C64<f64>], start: usize) -> Complex<S> {
    let mut pairs = [[simd.splat_f64s(0.0); 2]; REGISTERS];
    let flat: &mut [C64<f64>] = bytemuck::cast_slice_mut(pairs.as_flattened_mut());
    let rest = &from[start..];
    if rest.len() >= lanes::<S>() {
        flat[..lanes::<S>()].copy_from_slice(&rest[..lanes::<S>()]); // of constant length: no call
    } else {
        flat[..rest.len()].copy_from_slice(rest);
        flat[rest.len()..].fill(rest[rest.len() - 1]);
    }
    let pairs = pairs.map(|pair| simd.deinterleave_shfl_f64s(pair));
    Complex { re: Real(pairs.map(|[re, _]| re)), im: Real(pairs.map(|[_, im]| im)) }
}

/// Stores [`lanes`] complex numbers at the beginning of `to`, as many as fit.
#[inline(always)]
pub(crate) fn store<S: Simd>(simd: S, value: Complex<S>, to: &mut [Slot]) {
    if to.len() >= lanes::<S>() {
        let place = to.as_mut_ptr().cast::<[S::f64s; 2]>();
        for i in 0..REGISTERS {
            let pair = simd.interleave_shfl_f64s([value.re.0[i], value.im.0[i]]);
            // SAFETY: `to` has room for REGISTERS pairs of registers, which are `lanes` complex numbers.
            unsafe { place.add(i).write_unaligned(pair) };
        }
    } else {
        store_some(simd, value, to);
    }
}

/// The last, incomplete group of lines; kept apart so that whole groups never pass through memory.
#[cold]
#[inline(never)]
fn store_some<S: Simd>(simd: S, value: Complex<S>, to: &mut [Slot]) {
    for i in 0..REGISTERS {
        let pair = simd.interleave_shfl_f64s([value.re.0[i], value.im.0[i]]);
        let flat: &[C64<f64>] = bytemuck::cast_slice(&pair);
        for (place, &value) in to.iter_mut().skip(i * S::F64_LANES).zip(flat) {
            place.write(value);
        }
    }
}

/// Solves one group of evaluation points at a time; memory is allocated once and reused.
pub(crate) struct Solver<'a, S: Simd> {
    system: &'a LinearSystem,
    impedances: &'a [SpringDamper],
    /// Number of evaluation points, the padding of the last group left out.
    count: usize,
    /// Size of the terms on the diagonal of Z: of order s⁰, s¹ and s².
    scale: Vec<[f64; 3]>,
    floor: Vec<Real<S>>,
    scratch: Vec<Complex<S>>,
    z: Vec<Complex<S>>,
    x: Columns<S>,
    /// Empty where X serves as Y.
    y: Option<Columns<S>>,
    /// H, p×m.
    pub(crate) h: Vec<Complex<S>>,
    /// b_rᵀ Y_a, r×p; empty where X serves as Y.
    at_outputs: Vec<Complex<S>>,
    /// b_rᵀ X_b, r×m.
    pub(crate) at_inputs: Vec<Complex<S>>,
}

impl<'a, S: Simd> Solver<'a, S> {
    pub(crate) fn new(
        simd: S,
        system: &'a LinearSystem,
        impedances: &'a [SpringDamper],
        count: usize,
    ) -> Self {
        let (n, r) = (system.n, system.branches());
        let (p, m) = system.shape();
        let zero = Complex::zero(simd);
        let mirrored = system.mirrored();
        let mut scale = system.sizes.clone();
        for (direction, impedance) in system.directions.iter().zip(impedances) {
            for (i, scale) in scale.iter_mut().enumerate() {
                let b = match direction {
                    Direction::Coordinate(c) => f64::from(u8::from(*c == i)),
                    Direction::Dense(b) => b[i] * b[i],
                };
                scale[0] += b * impedance.stiffness.abs();
                scale[1] += b * impedance.damping.abs();
            }
        }
        Self {
            system,
            impedances,
            count,
            scale,
            floor: vec![Real::splat(simd, 0.0); n],
            scratch: vec![zero; SIDE_BY_SIDE * n],
            z: vec![zero; row(n)],
            x: Columns::zeros(simd, n, m),
            y: (!mirrored).then(|| Columns::zeros(simd, n, p)),
            h: vec![zero; p * m],
            at_outputs: vec![zero; if mirrored { 0 } else { r * p }],
            at_inputs: vec![zero; r * m],
        }
    }

    /// Fills `h` and, where `branches`, the projections on the impedances' directions for one group of points; `start` is the index of
    /// its first point, for the error message.
    #[inline(always)]
    pub(crate) fn solve(&mut self, simd: S, s: Complex<S>, start: usize, branches: bool) -> Result<()> {
        let (n, (_, m)) = (self.system.n, self.system.shape());
        let mut trusted = 0_u64;
        if self.system.symmetric {
            self.assemble(simd, s);
            let margin = lanes::factor(simd, &mut self.z, n, &self.floor, &mut self.scratch);
            self.x.solve(simd, &self.z, &self.system.inputs);
            if let Some(y) = &mut self.y {
                y.solve(simd, &self.z, &self.system.outputs);
            }
            // A pivot that broke down spoils every entry of its column of X.
            let mut size = Real::splat(simd, 0.0);
            for b in 0..m {
                size = size.add(simd, self.x.at(0, b).norm_squared(simd));
            }
            for (lane, (&margin, &size)) in margin.as_slice().iter().zip(size.as_slice()).enumerate() {
                trusted |= u64::from(margin >= 0.0 && size.is_finite()) << lane;
            }
        }
        for lane in 0..lanes::<S>() {
            if trusted >> lane & 1 == 0 {
                self.solve_lane(simd, s, lane, start)?;
            }
        }
        self.project(simd, branches);
        Ok(())
    }

    /// Lower triangle of Z, and the size of the terms on its diagonal.
    #[inline(always)]
    fn assemble(&mut self, simd: S, s: Complex<S>) {
        let n = self.system.n;
        let s2 = s.mul(simd, s);
        let size2 = s.norm_squared(simd);
        let size = size2.sqrt(simd);
        let (mass, damping, stiffness) = (&self.system.mass, &self.system.damping, &self.system.stiffness);
        for i in 0..n {
            let [k, c, m] = self.scale[i].map(|v| Real::splat(simd, v));
            let scale = k.add_mul(simd, size, c).add_mul(simd, size2, m);
            let floor = scale.mul(simd, Real::splat(simd, PIVOT_FLOOR));
            self.floor[i] = floor.mul(simd, floor);
            let entries = self.z[row(i)..row(i) + i + 1].iter_mut();
            let terms = mass[i * n..].iter().zip(&damping[i * n..]).zip(&stiffness[i * n..]);
            for (entry, ((&m, &c), &k)) in entries.zip(terms) {
                let [k, c, m] = [k, c, m].map(|v| Real::splat(simd, v));
                *entry = Complex {
                    re: k.add_mul(simd, s.re, c).add_mul(simd, s2.re, m),
                    im: s.im.mul(simd, c).add_mul(simd, s2.im, m),
                };
            }
        }
        for (i, drive) in &self.system.drives {
            let entry = &mut self.z[row(*i) + i];
            let gain = Real::splat(simd, -drive.gain);
            *entry = entry.add_scaled(simd, gain, drive.turn_lanes(simd, s).0);
        }
        for (direction, impedance) in self.system.directions.iter().zip(self.impedances) {
            let value = impedance.value(simd, s);
            match direction {
                Direction::Coordinate(i) => self.z[row(*i) + i] = self.z[row(*i) + i].add(simd, value),
                Direction::Dense(b) => {
                    for i in 0..n {
                        for j in 0..=i {
                            let weight = Real::splat(simd, b[i] * b[j]);
                            self.z[row(i) + j] = self.z[row(i) + j].add_scaled(simd, weight, value);
                        }
                    }
                }
            }
        }
    }

    /// One lane again, or for the first time if Z is not symmetric: Gauss with row exchanges.
    #[cold]
    fn solve_lane(&mut self, simd: S, s: Complex<S>, lane: usize, start: usize) -> Result<()> {
        let n = self.system.n;
        let (re, im) = s.lane(lane);
        let order: Vec<_> = (0..lanes::<S>()).map(|i| C64::new(i as f64, 0.0)).collect();
        let line = (start + load(simd, &order, 0).lane(lane).0 as usize).min(self.count - 1);
        let singular = || Error::Singular { line, hz: im / std::f64::consts::TAU };
        let z = self.system.dense(C64::new(re, im), self.impedances);
        let x = pivoted_solve(n, z.clone(), &self.system.inputs).ok_or_else(singular)?;
        for (i, value) in x.iter().enumerate() {
            self.x.set_lane(i % n, i / n, lane, (value.re, value.im));
        }
        if let Some(columns) = &mut self.y {
            let transposed = (0..n * n).map(|i| z[i % n * n + i / n]).collect();
            let y = pivoted_solve(n, transposed, &self.system.outputs).ok_or_else(singular)?;
            for (i, value) in y.iter().enumerate() {
                columns.set_lane(i % n, i / n, lane, (value.re, value.im));
            }
        }
        Ok(())
    }

    /// H and the branch projections from X and Y.
    #[inline(always)]
    fn project(&mut self, simd: S, branches: bool) {
        let (n, (p, m)) = (self.system.n, self.system.shape());
        let mirrored = self.y.is_none();
        for a in 0..p {
            let jacobian = &self.system.outputs[a * n..(a + 1) * n];
            for b in 0..if mirrored { a + 1 } else { m } {
                let response = self.x.dot(simd, jacobian, b);
                self.h[a * m + b] = response;
                if mirrored {
                    self.h[b * m + a] = response;
                }
            }
        }
        if branches {
            let (mut at_inputs, mut at_outputs) =
                (std::mem::take(&mut self.at_inputs), std::mem::take(&mut self.at_outputs));
            self.each_input(simd, |entry, value| at_inputs[entry] = value);
            self.each_output(simd, |entry, value| at_outputs[entry] = value);
            (self.at_inputs, self.at_outputs) = (at_inputs, at_outputs);
        }
    }

    /// Hands every b_rᵀ X_b to `put` with its place in r×m.
    #[inline(always)]
    pub(crate) fn each_input(&self, simd: S, put: impl FnMut(usize, Complex<S>)) {
        project_on(simd, &self.system.directions, &self.x, self.system.shape().1, put);
    }

    /// Hands every b_rᵀ Y_a to `put` with its place in r×p; none where X serves as Y.
    #[inline(always)]
    pub(crate) fn each_output(&self, simd: S, put: impl FnMut(usize, Complex<S>)) {
        if let Some(y) = &self.y {
            project_on(simd, &self.system.directions, y, self.system.shape().0, put);
        }
    }

    /// b_rᵀ Y_a, r×p.
    #[inline(always)]
    pub(crate) fn at_outputs(&self) -> &[Complex<S>] {
        if self.y.is_some() { &self.at_outputs } else { &self.at_inputs }
    }
}

/// Components of every one of `count` solutions along every direction.
#[inline(always)]
fn project_on<S: Simd>(
    simd: S,
    directions: &[Direction],
    x: &Columns<S>,
    count: usize,
    mut put: impl FnMut(usize, Complex<S>),
) {
    for (branch, direction) in directions.iter().enumerate() {
        for column in 0..count {
            let value = match direction {
                Direction::Coordinate(i) => x.at(*i, column),
                Direction::Dense(b) => x.dot(simd, b, column),
            };
            put(branch * count + column, value);
        }
    }
}

/// Solves Z x = b for every row b of `rights`; `None` where Z is singular to rounding.
fn pivoted_solve(n: usize, mut z: Vec<C64<f64>>, rights: &[f64]) -> Option<Vec<C64<f64>>> {
    let mut x: Vec<_> = rights.iter().map(|&v| C64::new(v, 0.0)).collect();
    let size = z.iter().fold(0.0_f64, |a, v| a.max(v.norm()));
    for j in 0..n {
        let best = (j..n).max_by(|&a, &b| z[a * n + j].norm().total_cmp(&z[b * n + j].norm()))?;
        let pivot = z[best * n + j].norm();
        if pivot.is_nan() || pivot <= f64::EPSILON * size {
            return None;
        }
        for k in 0..n {
            z.swap(j * n + k, best * n + k);
        }
        for column in x.chunks_exact_mut(n) {
            column.swap(j, best);
        }
        for i in j + 1..n {
            let factor = z[i * n + j] / z[j * n + j];
            for k in j..n {
                let term = factor * z[j * n + k];
                z[i * n + k] -= term;
            }
            for column in x.chunks_exact_mut(n) {
                let term = factor * column[j];
                column[i] -= term;
            }
        }
    }
    for column in x.chunks_exact_mut(n) {
        for i in (0..n).rev() {
            let rest: C64<f64> = (i + 1..n).map(|k| z[i * n + k] * column[k]).sum();
            column[i] = (column[i] - rest) / z[i * n + i];
        }
    }
    Some(x)
}
