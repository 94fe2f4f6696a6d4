//! Solves Z(s) X = J_inᵀ and Zᵀ(s) Y = J_outᵀ for one SIMD register of evaluation points.
//!
//! Symmetric systems go through the unpivoted LDLᵀ of [`crate::lanes`]; a lane whose pivots cancelled, and every lane of a
//! system that is not symmetric, is solved by Gauss elimination with row exchanges.

use crate::frf::LinearSystem;
use crate::impedance::{Direction, SpringDamper};
use crate::lanes::{self, Complex, row, slice_of};
use crate::{Error, Result};
use nalgebra::Complex as C64;
use pulp::{Simd, bytemuck};

/// A pivot whose size fell below this share of the terms that made it has lost six digits: that lane is solved again.
const PIVOT_FLOOR: f64 = 1e-6;

/// Loads up to one register's worth of complex numbers from `start`; past the end the last one is repeated.
///
/// Lanes come in the architecture's shuffled order; [`store`] undoes it, and arithmetic by lanes does not care.
#[inline(always)]
pub(crate) fn load<S: Simd>(simd: S, from: &[C64<f64>], start: usize) -> Complex<S> {
    let mut pair = [simd.splat_f64s(0.0); 2];
    let flat: &mut [C64<f64>] = bytemuck::cast_slice_mut(&mut pair);
    let rest = &from[start..];
    if rest.len() >= S::F64_LANES {
        flat[..S::F64_LANES].copy_from_slice(&rest[..S::F64_LANES]); // of constant length: no call
    } else {
        flat[..rest.len()].copy_from_slice(rest);
        flat[rest.len()..].fill(rest[rest.len() - 1]);
    }
    let [re, im] = simd.deinterleave_shfl_f64s(pair);
    Complex { re, im }
}

/// Stores a register's worth of complex numbers at `start`, cut at the end of `to`.
#[inline(always)]
pub(crate) fn store<S: Simd>(simd: S, value: Complex<S>, to: &mut [C64<f64>], start: usize) {
    let pair = simd.interleave_shfl_f64s([value.re, value.im]);
    let flat: &[C64<f64>] = bytemuck::cast_slice(&pair);
    let rest = &mut to[start..];
    if rest.len() >= S::F64_LANES {
        rest[..S::F64_LANES].copy_from_slice(&flat[..S::F64_LANES]);
    } else {
        rest.copy_from_slice(&flat[..rest.len()]);
    }
}

/// Solves one register of evaluation points at a time; memory is allocated once and reused.
pub(crate) struct Solver<'a, S: Simd> {
    system: &'a LinearSystem,
    impedances: &'a [SpringDamper],
    /// Size of the terms on the diagonal of Z: of order s⁰, s¹ and s².
    scale: Vec<[f64; 3]>,
    floor: Vec<S::f64s>,
    column: Vec<Complex<S>>,
    z: Vec<Complex<S>>,
    x: Vec<Complex<S>>,
    y: Vec<Complex<S>>,
    /// H, p×m.
    pub(crate) h: Vec<Complex<S>>,
    /// b_rᵀ Y_a, r×p.
    pub(crate) at_outputs: Vec<Complex<S>>,
    /// b_rᵀ X_b, r×m.
    pub(crate) at_inputs: Vec<Complex<S>>,
}

impl<'a, S: Simd> Solver<'a, S> {
    pub(crate) fn new(simd: S, system: &'a LinearSystem, impedances: &'a [SpringDamper]) -> Self {
        let (n, r) = (system.n, system.branches());
        let (p, m) = system.shape();
        let zero = Complex::zero(simd);
        let mut scale: Vec<_> = (0..n)
            .map(|i| [&system.stiffness, &system.damping, &system.mass].map(|a| a[i * n + i].abs()))
            .collect();
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
            scale,
            floor: vec![simd.splat_f64s(0.0); n],
            column: vec![zero; n],
            z: vec![zero; row(n)],
            x: vec![zero; n * m],
            y: vec![zero; if system.same { 0 } else { n * p }],
            h: vec![zero; p * m],
            at_outputs: vec![zero; r * p],
            at_inputs: vec![zero; r * m],
        }
    }

    /// Fills `h` and, where `branches`, `at_outputs` and `at_inputs` for one register of points; `start` is the index of
    /// its first point, for the error message.
    #[inline(always)]
    pub(crate) fn solve(&mut self, simd: S, s: Complex<S>, start: usize, branches: bool) -> Result<()> {
        let (n, (p, m)) = (self.system.n, self.system.shape());
        let mut trusted = 0_u64;
        if self.system.symmetric {
            self.assemble(simd, s);
            let margin = lanes::factor(simd, &mut self.z, n, &self.floor, &mut self.column);
            for b in 0..m {
                let column = &mut self.x[b * n..(b + 1) * n];
                splat_row(simd, &self.system.inputs[b * n..(b + 1) * n], column);
                lanes::solve(simd, &self.z, n, column);
            }
            if !self.system.same {
                for a in 0..p {
                    let column = &mut self.y[a * n..(a + 1) * n];
                    splat_row(simd, &self.system.outputs[a * n..(a + 1) * n], column);
                    lanes::solve(simd, &self.z, n, column);
                }
            }
            let mut size = simd.splat_f64s(0.0);
            for value in &self.x {
                size = simd.add_f64s(size, value.norm_squared(simd));
            }
            for (lane, (&margin, &size)) in
                slice_of::<S>(&margin).iter().zip(slice_of::<S>(&size)).enumerate()
            {
                trusted |= u64::from(margin >= 0.0 && size.is_finite()) << lane;
            }
        }
        for lane in 0..S::F64_LANES {
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
        let size = simd.sqrt_f64s(size2);
        for i in 0..n {
            let [k, c, mass] = self.scale[i].map(|v| simd.splat_f64s(v));
            let scale = simd.mul_add_e_f64s(size2, mass, simd.mul_add_e_f64s(size, c, k));
            let scale = simd.mul_f64s(scale, simd.splat_f64s(PIVOT_FLOOR));
            self.floor[i] = simd.mul_f64s(scale, scale);
            for j in 0..=i {
                let at = i * n + j;
                let mass = simd.splat_f64s(self.system.mass[at]);
                let c = simd.splat_f64s(self.system.damping[at]);
                let k = simd.splat_f64s(self.system.stiffness[at]);
                self.z[row(i) + j] = Complex {
                    re: simd.mul_add_e_f64s(s2.re, mass, simd.mul_add_e_f64s(s.re, c, k)),
                    im: simd.mul_add_e_f64s(s2.im, mass, simd.mul_f64s(s.im, c)),
                };
            }
        }
        for (direction, impedance) in self.system.directions.iter().zip(self.impedances) {
            let value = impedance.value(simd, s);
            match direction {
                Direction::Coordinate(i) => self.z[row(*i) + i] = self.z[row(*i) + i].add(simd, value),
                Direction::Dense(b) => {
                    for i in 0..n {
                        for j in 0..=i {
                            let weight = simd.splat_f64s(b[i] * b[j]);
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
        let (n, (p, m)) = (self.system.n, self.system.shape());
        let (re, im) = s.lane(lane);
        let order: Vec<_> = (0..S::F64_LANES).map(|i| C64::new(i as f64, 0.0)).collect();
        let line = start + load(simd, &order, 0).lane(lane).0 as usize;
        let z = self.system.dense(C64::new(re, im), self.impedances);
        let transposed: Vec<_> = (0..n * n).map(|i| z[i % n * n + i / n]).collect();
        let x = pivoted_solve(n, z, &self.system.inputs).ok_or(Error::Singular { line })?;
        for (place, value) in self.x.iter_mut().zip(&x[..n * m]) {
            place.set_lane(lane, (value.re, value.im));
        }
        if self.system.same && self.system.symmetric {
            return Ok(());
        }
        let y = pivoted_solve(n, transposed, &self.system.outputs).ok_or(Error::Singular { line })?;
        self.y.resize(n * p, Complex::zero(simd));
        for (place, value) in self.y.iter_mut().zip(&y) {
            place.set_lane(lane, (value.re, value.im));
        }
        Ok(())
    }

    /// H and the branch projections from X and Y.
    #[inline(always)]
    fn project(&mut self, simd: S, branches: bool) {
        let (n, (p, m)) = (self.system.n, self.system.shape());
        for a in 0..p {
            let jacobian = &self.system.outputs[a * n..(a + 1) * n];
            for b in 0..m {
                self.h[a * m + b] = dot(simd, jacobian, &self.x[b * n..(b + 1) * n]);
            }
        }
        if !branches {
            return;
        }
        let y = if self.y.is_empty() { &self.x } else { &self.y };
        for (branch, direction) in self.system.directions.iter().enumerate() {
            for (solution, count, place) in [(y, p, &mut self.at_outputs), (&self.x, m, &mut self.at_inputs)]
            {
                for a in 0..count {
                    let column = &solution[a * n..(a + 1) * n];
                    place[branch * count + a] = match direction {
                        Direction::Coordinate(i) => column[*i],
                        Direction::Dense(b) => dot(simd, b, column),
                    };
                }
            }
        }
    }
}

#[inline(always)]
fn splat_row<S: Simd>(simd: S, row: &[f64], column: &mut [Complex<S>]) {
    for (place, &value) in column.iter_mut().zip(row) {
        *place = Complex { re: simd.splat_f64s(value), im: simd.splat_f64s(0.0) };
    }
}

#[inline(always)]
fn dot<S: Simd>(simd: S, weights: &[f64], column: &[Complex<S>]) -> Complex<S> {
    let mut sum = Complex::zero(simd);
    for (&weight, &value) in weights.iter().zip(column) {
        sum = sum.add_scaled(simd, simd.splat_f64s(weight), value);
    }
    sum
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
