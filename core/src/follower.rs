//! One step of continuation: every mode carried from one system to the next, all side by side in SIMD lanes.
//!
//! A step is accepted where every shape resembles the one before and the set is complete; else it is halved along the
//! straight line between the two systems' matrices, so that a veering which a step begins or ends in is
//! followed through. One that lies wholly within a step leaves shapes as they were, and is passed as a crossing.

use crate::completeness::Completeness;
use crate::eigenpairs::{Refiner, System};
use crate::impedance::Drive;
use crate::lanes::{Complex, Real, lanes};
use nalgebra::Complex as C64;
use pulp::Simd;

/// Least modal assurance criterion between a shape and the one it came from.
const ALIKE: f64 = 0.9;
/// A step is taken in parts down to this share of it.
const SHORTEST: f64 = 1.0 / 4096.0;
/// Steps are alike where the mass matrix changes by the same to this share of the change.
const STEADY: f64 = 0.2;

/// Poles and shapes of all modes, in groups of lanes.
#[derive(Clone)]
struct Pairs<S: Simd> {
    width: usize,
    poles: Vec<Complex<S>>,
    /// Group by group, `width` entries each.
    shapes: Vec<Complex<S>>,
}

impl<S: Simd> Pairs<S> {
    fn pole(&self, mode: usize) -> C64<f64> {
        let (re, im) = self.poles[mode / lanes::<S>()].lane(mode % lanes::<S>());
        C64::new(re, im)
    }
}

/// Matrices on the straight line between those of two systems.
struct Between {
    matrices: [Vec<f64>; 3],
    diagonal: bool,
    drives: Vec<(usize, Drive)>,
}

impl Between {
    /// `share` of the way from `a` to `b`.
    fn new(a: &System<'_>, b: &System<'_>, share: f64) -> Self {
        let mix = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + share * (b - a)).collect();
        let drives = a.drives.iter().zip(b.drives).map(|((i, a), (_, b))| (*i, a.between(b, share)));
        Self {
            matrices: [mix(a.mass, b.mass), mix(a.damping, b.damping), mix(a.stiffness, b.stiffness)],
            diagonal: a.diagonal && b.diagonal,
            drives: drives.collect(),
        }
    }

    fn system(&self, n: usize) -> System<'_> {
        let [mass, damping, stiffness] = &self.matrices;
        System { n, mass, damping, diagonal: self.diagonal, stiffness, drives: &self.drives }
    }
}

/// Where the modes are going: on long steps a curve through the places before is a better start than the last of them.
struct Trend<S: Simd> {
    /// The modes one and two places before those where the walk stands.
    before: [Pairs<S>; 2],
    /// Mass matrix where the walk stands, and its change in the step there.
    mass: Vec<f64>,
    change: Vec<f64>,
    /// How many steps like the one to come have been taken, with modes known before and after.
    steady: usize,
    /// Whether some step took more than one iteration.
    long: bool,
}

impl<S: Simd> Trend<S> {
    fn new(pairs: &Pairs<S>, n: usize) -> Self {
        let zero = vec![0.0; n * n];
        let before = [pairs.clone(), pairs.clone()];
        Self { before, mass: zero.clone(), change: zero, steady: 0, long: false }
    }

    /// Looks at the step to `system`; whether the modes are expected to go on as they did.
    #[inline(always)]
    fn goes_on(&mut self, system: &System<'_>) -> bool {
        if !self.long {
            return false;
        }
        let n = system.n;
        let (mut size, mut off) = (0.0, 0.0);
        for i in 0..n {
            for j in 0..=i {
                let weight = 1.0 / (self.mass[i * n + i] * self.mass[j * n + j]);
                let (before, now) = (self.change[i * n + j], system.mass[i * n + j] - self.mass[i * n + j]);
                size += weight * before * before;
                off += weight * (now - before) * (now - before);
            }
        }
        self.steady = if size > 0.0 && off < STEADY * STEADY * size { self.steady + 1 } else { 0 };
        self.steady > 0
    }

    /// The next point of the parabola, or line, through the modes before and those of `now`.
    #[inline(always)]
    fn ahead(&self, simd: S, now: &Pairs<S>, next: &mut Pairs<S>) {
        let [one, two] = &self.before;
        let weights = if self.steady > 1 { [3.0, -3.0, 1.0] } else { [2.0, -1.0, 0.0] };
        let [a, b, c] = weights.map(|weight| Real::splat(simd, weight));
        for i in 0..next.poles.len() {
            let sum = now.poles[i].scale(simd, a).add_scaled(simd, b, one.poles[i]);
            next.poles[i] = sum.add_scaled(simd, c, two.poles[i]);
        }
        for i in 0..next.shapes.len() {
            let sum = now.shapes[i].scale(simd, a).add_scaled(simd, b, one.shapes[i]);
            next.shapes[i] = sum.add_scaled(simd, c, two.shapes[i]);
        }
    }

    /// The walk has come to `system`; hands over the memory of modes that are no longer needed for those before.
    #[inline(always)]
    fn arrived(&mut self, system: &System<'_>, iterations: usize, before: &mut Pairs<S>) {
        self.long |= iterations > 1;
        self.before.swap(0, 1);
        std::mem::swap(&mut self.before[0], before);
        for ((change, old), &new) in self.change.iter_mut().zip(&mut self.mass).zip(system.mass) {
            *change = new - *old;
            *old = new;
        }
    }
}

/// The modes where the walk stands, and the memory for the next step.
pub(crate) struct Follower<S: Simd> {
    modes: usize,
    complete: Completeness,
    now: Pairs<S>,
    next: Pairs<S>,
    trend: Trend<S>,
    refiner: Refiner<S>,
    /// Whether all systems have the same drives.
    same_drives: bool,
    /// Whether the refiner has turns of the drives for the poles where the walk stands.
    turned: bool,
    /// Modal assurance criterion with the shapes before, the least over the parts of a step.
    pub(crate) likeness: Vec<f64>,
    energies: Vec<Real<S>>,
}

impl<S: Simd> Follower<S> {
    pub(crate) fn new(
        simd: S,
        n: usize,
        drives: usize,
        same_drives: bool,
        poles: &[C64<f64>],
        shapes: &[C64<f64>],
    ) -> Self {
        let (m, width) = (poles.len(), n + drives);
        let groups = m.div_ceil(lanes::<S>());
        let zero = Complex::zero(simd);
        let mut now = Pairs { width, poles: vec![zero; groups], shapes: vec![zero; groups * width] };
        for slot in 0..groups * lanes::<S>() {
            let (group, lane) = (slot / lanes::<S>(), slot % lanes::<S>());
            let mode = slot.min(m - 1); // lanes that are left over repeat the last mode
            now.poles[group].set_lane(lane, (poles[mode].re, poles[mode].im));
            for i in 0..n {
                let entry = shapes[mode * n + i];
                now.shapes[group * width + i].set_lane(lane, (entry.re, entry.im));
            }
        }
        Self {
            modes: m,
            complete: Completeness::new(n, poles),
            next: now.clone(),
            trend: Trend::new(&now, n),
            now,
            refiner: Refiner::new(simd, n, drives, groups),
            same_drives,
            turned: false,
            likeness: vec![1.0; m],
            energies: vec![Real::splat(simd, 0.0); n],
        }
    }

    /// Brings the modes from system `a` to `b`, in parts where one step is too far; the largest residual at `b`.
    #[inline(always)]
    pub(crate) fn advance(&mut self, simd: S, a: &System<'_>, b: &System<'_>, first: bool) -> Option<f64> {
        let (mut done, mut goal) = (0.0, 1.0);
        let mut between = None;
        loop {
            let system = between.as_ref().map_or(*b, |between: &Between| between.system(b.n));
            match self.step(simd, &system, first) {
                Some(residual) if goal == 1.0 => return Some(residual),
                Some(_) => (done, goal) = (goal, f64::min(1.0, 3.0 * goal - 2.0 * done)),
                None if first || goal - done <= SHORTEST => return None,
                None => goal = 0.5 * (done + goal),
            }
            between = (goal < 1.0).then(|| Between::new(a, b, goal));
        }
    }

    /// One step to `system`; nothing has moved where it fails.
    #[inline(always)]
    fn step(&mut self, simd: S, system: &System<'_>, first: bool) -> Option<f64> {
        if self.trend.goes_on(system) {
            self.trend.ahead(simd, &self.now, &mut self.next);
            self.turned = false;
            if let Some(residual) = self.refine(simd, system, first) {
                return Some(residual);
            }
        }
        self.next.poles.copy_from_slice(&self.now.poles);
        self.next.shapes.copy_from_slice(&self.now.shapes);
        self.refine(simd, system, first)
    }

    /// From what stands in `next` to the modes of `system`.
    #[inline(always)]
    fn refine(&mut self, simd: S, system: &System<'_>, first: bool) -> Option<f64> {
        let width = self.now.width;
        let turned = std::mem::replace(&mut self.turned, false);
        let (mut worst, mut iterations) = (0.0_f64, 0);
        for group in 0..self.next.poles.len() {
            let shape = &mut self.next.shapes[group * width..][..width];
            let pole = &mut self.next.poles[group];
            let ending = self.refiner.refine(simd, system, group, turned, pole, &mut shape[..system.n]);
            if !ending.converged {
                return None;
            }
            iterations = iterations.max(ending.iterations);
            worst = ending.residual.as_slice().iter().fold(worst, |a, &v| a.max(v));
            let before = &self.now.shapes[group * width..][..width];
            let alike = normalize(simd, system, &self.refiner, group, before, shape, first);
            let start = group * lanes::<S>();
            for (lane, &alike) in alike.as_slice().iter().enumerate().take(self.modes - start) {
                if !(first || alike >= ALIKE) {
                    return None;
                }
                let likeness = &mut self.likeness[start + lane];
                *likeness = likeness.min(alike);
            }
        }
        let next = &self.next;
        if !self.complete.holds(system, (0..self.modes).map(|mode| next.pole(mode))) {
            return None;
        }
        std::mem::swap(&mut self.now, &mut self.next);
        self.trend.arrived(system, iterations, &mut self.next);
        self.turned = self.same_drives;
        Some(worst.sqrt())
    }

    /// Appends to `out` the poles (m).
    #[inline(always)]
    pub(crate) fn put_poles(&self, out: &mut Vec<C64<f64>>) {
        let start = out.len();
        out.resize(start + self.modes, C64::new(0.0, 0.0));
        for (group, pole) in self.now.poles.iter().enumerate() {
            let rows = &mut out[start + group * lanes::<S>()..];
            let parts = pole.re.as_slice().iter().zip(pole.im.as_slice());
            for (out, (&re, &im)) in rows.iter_mut().zip(parts) {
                *out = C64::new(re, im);
            }
        }
    }

    /// Appends to `out` the shapes (m×(n+d)).
    #[inline(always)]
    pub(crate) fn put_shapes(&self, out: &mut Vec<C64<f64>>) {
        let (start, width) = (out.len(), self.now.width);
        out.resize(start + self.modes * width, C64::new(0.0, 0.0));
        for (group, shape) in self.now.shapes.chunks_exact(width).enumerate() {
            let rows = &mut out[start + group * lanes::<S>() * width..];
            for (i, entry) in shape.iter().enumerate() {
                let parts = entry.re.as_slice().iter().zip(entry.im.as_slice());
                for (row, (&re, &im)) in rows.chunks_exact_mut(width).zip(parts) {
                    row[i] = C64::new(re, im);
                }
            }
        }
    }

    /// Appends to `out` the share of every coordinate in the elastic energy of every mode (m×n): its spring, or its shaft
    /// and the spring K_P of its motor.
    #[inline(always)]
    pub(crate) fn put_shares(&mut self, simd: S, system: &System<'_>, springs: &[f64], out: &mut Vec<f32>) {
        let (n, width, start) = (system.n, self.now.width, out.len());
        out.resize(start + self.modes * n, 0.0);
        let least = Real::splat(simd, f64::MIN_POSITIVE);
        for (group, shape) in self.now.shapes.chunks_exact(width).enumerate() {
            for ((energy, &u), &k) in self.energies.iter_mut().zip(shape).zip(springs) {
                *energy = u.norm_squared(simd).mul(simd, Real::splat(simd, k));
            }
            for ((i, drive), &motor) in system.drives.iter().zip(&shape[n..]) {
                let [w, k, own] = drive.springs.map(|v| Real::splat(simd, v));
                let wound = motor.neg(simd).add_scaled(simd, w, shape[*i]).norm_squared(simd);
                let held = motor.norm_squared(simd).mul(simd, own);
                self.energies[*i] = self.energies[*i].add(simd, held.add_mul(simd, k, wound));
            }
            let mut total = Real::splat(simd, 0.0);
            for &energy in &self.energies {
                total = total.add(simd, energy);
            }
            let scale = Real::splat(simd, 1.0).div(simd, total.max(simd, least));
            let rows = &mut out[start + group * lanes::<S>() * n..];
            for (i, energy) in self.energies.iter().enumerate() {
                let share = energy.mul(simd, scale);
                for (row, &share) in rows.chunks_exact_mut(n).zip(share.as_slice()) {
                    row[i] = share as f32;
                }
            }
        }
    }
}

/// Scales shapes (coordinates given, motors filled in) to uᴴMu = 1 with uᵀMu real, the sign nearest to the shape before;
/// returns the modal assurance criterion with that one.
#[inline(always)]
fn normalize<S: Simd>(
    simd: S,
    system: &System<'_>,
    refiner: &Refiner<S>,
    group: usize,
    before: &[Complex<S>],
    shape: &mut [Complex<S>],
    first: bool,
) -> Real<S> {
    let n = system.n;
    let turns = refiner.turn(group, system.drives.len());
    for (d, ((i, _), (turn, _))) in system.drives.iter().zip(turns).enumerate() {
        shape[n + d] = turn.mul(simd, shape[*i]);
    }
    let zero = Complex::zero(simd);
    // uᴴMu, uᵀMu, and the Hermitian product with the shape before.
    let (mut size, mut square, mut cross) = (Real::splat(simd, 0.0), zero, zero);
    for i in 0..shape.len() {
        let u = shape[i];
        let momentum = match i.checked_sub(n) {
            None => refiner.momentum(i),
            Some(d) => u.scale(simd, Real::splat(simd, system.drives[d].1.inertia())),
        };
        size = size.add_mul(simd, u.re, momentum.re).add_mul(simd, u.im, momentum.im);
        square = square.add_mul(simd, u, momentum);
        let old = before[i];
        let conjugate = Complex { re: old.re, im: old.im.neg(simd) };
        cross = cross.add_mul(simd, conjugate, momentum);
    }
    let one = Real::splat(simd, 1.0);
    let alike = if first { one } else { cross.norm_squared(simd).div(simd, size) };
    // e^{-iφ/2} for uᵀMu of angle φ, from half-angle formulas.
    let half = Real::splat(simd, 0.5);
    let least = Real::splat(simd, f64::MIN_POSITIVE);
    let cosine = square.re.div(simd, square.norm_squared(simd).sqrt(simd).max(simd, least));
    let root = |v: Real<S>| v.mul(simd, half).max(simd, Real::splat(simd, 0.0)).sqrt(simd);
    let (real, imaginary) = (root(one.add(simd, cosine)), root(one.sub(simd, cosine)));
    let mut phase =
        Complex { re: real, im: square.im.where_not_negative(simd, imaginary.neg(simd), imaginary) };
    if !first {
        let turned = phase.re.mul(simd, cross.re).sub_mul(simd, phase.im, cross.im);
        let sign = turned.where_not_negative(simd, one, one.neg(simd));
        phase = phase.scale(simd, sign);
    }
    let scale = phase.scale(simd, one.div(simd, size.sqrt(simd)));
    for entry in shape.iter_mut() {
        *entry = entry.mul(simd, scale);
    }
    alike
}
