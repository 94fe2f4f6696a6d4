//! Eigenpairs Z(λ)u = 0 of one system, one per SIMD lane, by Rayleigh-quotient iteration.
//!
//! Z(λ) = λ²M + λC + K − Σ w k t(λ) is complex symmetric, so u is its own left vector: the quotient λ − uᵀZu / uᵀZ'u is
//! then exact to second order in u, and each solution y = Z⁻¹Z'u to third order in the error of the pair.

use crate::impedance::Drive;
use crate::lanes::{self, Complex, Real, SIDE_BY_SIDE, row};
use pulp::Simd;
use std::ops::Range;

/// Matrices of one robot at rest, symmetric, by rows; the springs w²k of the shafts stand in the stiffness.
#[derive(Debug, Clone, Copy)]
pub struct System<'a> {
    /// Number of coordinates.
    pub n: usize,
    /// M (n×n).
    pub mass: &'a [f64],
    /// C (n×n).
    pub damping: &'a [f64],
    /// Whether C has nothing beside its diagonal, as joint dampers give it.
    pub diagonal: bool,
    /// K (n×n).
    pub stiffness: &'a [f64],
    /// Drives by coordinate.
    pub drives: &'a [(usize, Drive)],
}

/// Largest residual ‖Zu‖ of an accepted pair, as a share of |λ|²‖Mu‖ in units of the masses.
pub const RESIDUAL: f64 = 1e-10;
/// Last change of λ, as a share of it, from which what is left is of a higher order than rounding.
const LAST_STEP: f64 = 1e-6;
const ITERATIONS: usize = 6;
/// The factor is taken this share of the pole beside it, for at the pole itself it does not exist.
const BESIDE: f64 = 1e-14;

/// Scratch memory of the iteration for n coordinates.
pub(crate) struct Refiner<S: Simd> {
    z: Vec<Complex<S>>,
    scratch: Vec<Complex<S>>,
    no_floor: Vec<Real<S>>,
    /// Mu, Cu, Ku.
    products: Vec<[Complex<S>; 3]>,
    /// Z'u, then the solution.
    slope: Vec<Complex<S>>,
    /// t and t' of every drive at the poles of every group.
    turns: Vec<(Complex<S>, Complex<S>)>,
}

/// How an iteration ended.
pub(crate) struct Ending<S: Simd> {
    /// Whether every lane is below its tolerance.
    pub converged: bool,
    /// Squared residual over its scale, per lane.
    pub residual: Real<S>,
    /// Solutions that it took.
    pub iterations: usize,
}

impl<S: Simd> Refiner<S> {
    pub(crate) fn new(simd: S, n: usize, drives: usize, groups: usize) -> Self {
        let zero = Complex::zero(simd);
        Self {
            z: vec![zero; row(n)],
            scratch: vec![zero; SIDE_BY_SIDE * n],
            no_floor: vec![Real::splat(simd, 0.0); n],
            products: vec![[zero; 3]; n],
            slope: vec![zero; n],
            turns: vec![(zero, zero); groups * drives],
        }
    }

    /// Moves `pole` and `shape` (n) of one group to an eigenpair near by; leaves Mu in [`Self::momentum`], t in
    /// [`Self::turn`]. `turned`: t of these drives stands there for the pole already.
    #[inline(always)]
    pub(crate) fn refine(
        &mut self,
        simd: S,
        system: &System<'_>,
        group: usize,
        turned: bool,
        pole: &mut Complex<S>,
        shape: &mut [Complex<S>],
    ) -> Ending<S> {
        let rounding = Real::splat(simd, 32.0 * f64::EPSILON * fastest(system));
        let drives = system.drives.len();
        let turns = group * drives..(group + 1) * drives;
        if !turned {
            self.turn_all(simd, system, turns.clone(), *pole);
        }
        self.multiply(simd, system, shape);
        let mut ending =
            Ending { converged: false, residual: Real::splat(simd, f64::INFINITY), iterations: 0 };
        for iteration in 0..=ITERATIONS {
            ending.iterations = iteration;
            let (step, residual) = self.quotient(simd, system, turns.clone(), *pole, shape);
            *pole = pole.add(simd, step.neg(simd));
            let size = pole.norm_squared(simd);
            let floor = rounding.add_mul(simd, size, Real::splat(simd, RESIDUAL));
            let scale = self.kinetic(simd, shape);
            let relative = residual.div(simd, scale.mul(simd, floor).mul(simd, floor));
            let moved = step.norm_squared(simd).div(simd, size);
            ending.residual = relative;
            let good = |lanes: &[f64], limit: f64| lanes.iter().all(|&v| v <= limit);
            if good(relative.as_slice(), 1.0) && good(moved.as_slice(), LAST_STEP * LAST_STEP) {
                ending.converged = true;
                // The last step is so short that t goes along with it in a straight line.
                for (turn, slope) in &mut self.turns[turns] {
                    *turn = turn.sub_mul(simd, *slope, step);
                }
                return ending;
            }
            if iteration == ITERATIONS || !pole.norm_squared(simd).as_slice().iter().all(|v| v.is_finite()) {
                return ending;
            }
            self.turn_all(simd, system, turns.clone(), *pole);
            self.slope(simd, system, turns.clone(), *pole, shape);
            self.factor(simd, system, turns.clone(), *pole);
            self.solve(simd, shape);
            self.multiply(simd, system, shape);
        }
        ending
    }

    /// (Mu)_i.
    #[inline(always)]
    pub(crate) fn momentum(&self, i: usize) -> Complex<S> {
        self.products[i][0]
    }

    /// t of every drive, for one group.
    #[inline(always)]
    pub(crate) fn turn(&self, group: usize, drives: usize) -> &[(Complex<S>, Complex<S>)] {
        &self.turns[group * drives..(group + 1) * drives]
    }

    #[inline(always)]
    fn turn_all(&mut self, simd: S, system: &System<'_>, turns: Range<usize>, pole: Complex<S>) {
        for ((_, drive), turn) in system.drives.iter().zip(&mut self.turns[turns]) {
            *turn = drive.turn_lanes(simd, pole);
        }
    }

    #[inline(always)]
    fn multiply(&mut self, simd: S, system: &System<'_>, shape: &[Complex<S>]) {
        let n = system.n;
        for (i, products) in self.products.iter_mut().enumerate() {
            let c = if system.diagonal {
                shape[i].scale(simd, Real::splat(simd, system.damping[i * n + i]))
            } else {
                product(simd, &system.damping[i * n..][..n], shape)
            };
            let [m, k] = [system.mass, system.stiffness].map(|matrix| &matrix[i * n..][..n]);
            *products = [product(simd, m, shape), c, product(simd, k, shape)];
        }
    }

    /// Z'(λ)u = 2λMu + Cu − Σ w k t' u.
    #[inline(always)]
    fn slope(
        &mut self,
        simd: S,
        system: &System<'_>,
        turns: Range<usize>,
        pole: Complex<S>,
        shape: &[Complex<S>],
    ) {
        let twice = pole.add(simd, pole);
        for (slope, [m, c, _]) in self.slope.iter_mut().zip(&self.products) {
            *slope = c.add_mul(simd, twice, *m);
        }
        for ((i, drive), (_, turn_slope)) in system.drives.iter().zip(&self.turns[turns]) {
            let gain = Real::splat(simd, -drive.gain);
            self.slope[*i] = self.slope[*i].add_scaled(simd, gain, turn_slope.mul(simd, shape[*i]));
        }
    }

    /// uᵀZu / uᵀZ'u, and the squared norm of Zu after the step that it suggests, each entry over its mass.
    #[inline(always)]
    fn quotient(
        &mut self,
        simd: S,
        system: &System<'_>,
        turns: Range<usize>,
        pole: Complex<S>,
        shape: &[Complex<S>],
    ) -> (Complex<S>, Real<S>) {
        self.slope(simd, system, turns.clone(), pole, shape);
        // The third product becomes the residual Zu.
        for [m, c, k] in &mut self.products {
            *k = k.add_mul(simd, pole, c.add_mul(simd, pole, *m));
        }
        for ((i, drive), (turn, _)) in system.drives.iter().zip(&self.turns[turns]) {
            let gain = Real::splat(simd, -drive.gain);
            let residual = &mut self.products[*i][2];
            *residual = residual.add_scaled(simd, gain, turn.mul(simd, shape[*i]));
        }
        let (mut above, mut below) = (Complex::zero(simd), Complex::zero(simd));
        for ((&u, [_, _, residual]), &slope) in shape.iter().zip(&self.products).zip(&self.slope) {
            above = above.add_mul(simd, u, *residual);
            below = below.add_mul(simd, u, slope);
        }
        let step = above.mul(simd, below.inverse(simd));
        let mut norm = Real::splat(simd, 0.0);
        for (i, ([_, _, residual], &slope)) in self.products.iter().zip(&self.slope).enumerate() {
            let left = residual.sub_mul(simd, step, slope).norm_squared(simd);
            norm = norm.add_mul(simd, left, Real::splat(simd, 1.0 / system.mass[i * system.n + i]));
        }
        (step, norm)
    }

    /// uᴴMu.
    #[inline(always)]
    fn kinetic(&self, simd: S, shape: &[Complex<S>]) -> Real<S> {
        let mut sum = Real::splat(simd, 0.0);
        for (&u, [m, _, _]) in shape.iter().zip(&self.products) {
            sum = sum.add_mul(simd, u.re, m.re).add_mul(simd, u.im, m.im);
        }
        sum
    }

    /// Factors Z beside the pole.
    #[inline(always)]
    fn factor(&mut self, simd: S, system: &System<'_>, turns: Range<usize>, pole: Complex<S>) {
        let n = system.n;
        let aside = pole.scale(simd, Real::splat(simd, BESIDE));
        let s = pole.add(simd, aside);
        let s2 = s.mul(simd, s);
        for i in 0..n {
            let entries = &mut self.z[row(i)..row(i) + i + 1];
            let rows = system.mass[i * n..].iter().zip(&system.stiffness[i * n..]);
            for (entry, (&m, &k)) in entries.iter_mut().zip(rows) {
                let [k, m] = [k, m].map(|v| Real::splat(simd, v));
                *entry = Complex { re: k.add_mul(simd, s2.re, m), im: s2.im.mul(simd, m) };
            }
            let first = if system.diagonal { i } else { 0 };
            for (entry, &c) in entries[first..].iter_mut().zip(&system.damping[i * n + first..]) {
                *entry = entry.add_scaled(simd, Real::splat(simd, c), s);
            }
        }
        for ((i, drive), (turn, slope)) in system.drives.iter().zip(&self.turns[turns]) {
            let entry = &mut self.z[row(*i) + i];
            let turn = turn.add_mul(simd, *slope, aside);
            *entry = entry.add_scaled(simd, Real::splat(simd, -drive.gain), turn);
        }
        lanes::factor(simd, &mut self.z, n, &self.no_floor, &mut self.scratch);
    }

    /// `shape` becomes Z⁻¹ Z'u, of length one.
    #[inline(always)]
    fn solve(&mut self, simd: S, shape: &mut [Complex<S>]) {
        let n = shape.len();
        let (z, x) = (&self.z, &mut self.slope);
        for i in 0..n {
            let mut sum = x[i];
            for (&l, &value) in z[row(i)..row(i) + i].iter().zip(x.iter()) {
                sum = sum.sub_mul(simd, l, value);
            }
            x[i] = sum;
        }
        for i in 0..n {
            x[i] = x[i].mul(simd, z[row(i) + i]);
        }
        for i in (1..n).rev() {
            let (open, solved) = x.split_at_mut(i);
            for (&l, place) in z[row(i)..row(i) + i].iter().zip(open.iter_mut()) {
                *place = place.sub_mul(simd, l, solved[0]);
            }
        }
        let mut size = Real::splat(simd, 0.0);
        for value in x.iter() {
            size = size.add(simd, value.norm_squared(simd));
        }
        let scale = Real::splat(simd, 1.0).div(simd, size.sqrt(simd));
        for (place, value) in shape.iter_mut().zip(x.iter()) {
            *place = value.scale(simd, scale);
        }
    }
}

/// A row of a real matrix times a vector.
#[inline(always)]
fn product<S: Simd>(simd: S, row: &[f64], vector: &[Complex<S>]) -> Complex<S> {
    let mut sum = Complex::zero(simd);
    for (&entry, &value) in row.iter().zip(vector) {
        sum = sum.add_scaled(simd, Real::splat(simd, entry), value);
    }
    sum
}

/// Largest K_ii / M_ii: what cancels in the residual of the slowest mode is of this size.
fn fastest(system: &System<'_>) -> f64 {
    (0..system.n)
        .map(|i| (system.stiffness[i * system.n + i] / system.mass[i * system.n + i]).abs())
        .fold(0.0, f64::max)
}
