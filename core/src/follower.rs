//! One step of continuation: every mode carried from one system to the next, all side by side in SIMD lanes.
//!
//! A step is accepted where every shape resembles the one before and the set is complete; else it is halved along the
//! straight line between the two systems' matrices, so that a veering is followed through, however sharp.

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

/// Poles and shapes of all modes, in groups of lanes.
#[derive(Clone)]
pub(crate) struct Pairs<S: Simd> {
    width: usize,
    poles: Vec<Complex<S>>,
    /// Group by group, `width` entries each.
    shapes: Vec<Complex<S>>,
}

impl<S: Simd> Pairs<S> {
    pub(crate) fn pole(&self, mode: usize) -> C64<f64> {
        let (re, im) = self.poles[mode / lanes::<S>()].lane(mode % lanes::<S>());
        C64::new(re, im)
    }

    pub(crate) fn entry(&self, mode: usize, i: usize) -> C64<f64> {
        let (group, lane) = (mode / lanes::<S>(), mode % lanes::<S>());
        let (re, im) = self.shapes[group * self.width + i].lane(lane);
        C64::new(re, im)
    }
}

/// Matrices on the straight line between those of two systems.
struct Between {
    matrices: [Vec<f64>; 3],
    drives: Vec<(usize, Drive)>,
}

impl Between {
    /// `share` of the way from `a` to `b`.
    fn new(a: &System<'_>, b: &System<'_>, share: f64) -> Self {
        let mix = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + share * (b - a)).collect();
        let drives = a.drives.iter().zip(b.drives).map(|((i, a), (_, b))| (*i, a.between(b, share)));
        Self {
            matrices: [mix(a.mass, b.mass), mix(a.damping, b.damping), mix(a.stiffness, b.stiffness)],
            drives: drives.collect(),
        }
    }

    fn system(&self, n: usize) -> System<'_> {
        let [mass, damping, stiffness] = &self.matrices;
        System { n, mass, damping, stiffness, drives: &self.drives }
    }
}

/// The modes where the walk stands, and the memory for the next step.
pub(crate) struct Follower<S: Simd> {
    modes: usize,
    complete: Completeness,
    pub(crate) now: Pairs<S>,
    next: Pairs<S>,
    refiner: Refiner<S>,
    /// Modal assurance criterion with the shapes before, the least over the parts of a step.
    pub(crate) likeness: Vec<f64>,
    energies: Vec<Real<S>>,
}

impl<S: Simd> Follower<S> {
    pub(crate) fn new(simd: S, n: usize, drives: usize, poles: &[C64<f64>], shapes: &[C64<f64>]) -> Self {
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
            now,
            refiner: Refiner::new(simd, n, drives),
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
        let width = self.now.width;
        self.next.poles.copy_from_slice(&self.now.poles);
        self.next.shapes.copy_from_slice(&self.now.shapes);
        let mut worst = 0.0_f64;
        for group in 0..self.next.poles.len() {
            let shape = &mut self.next.shapes[group * width..][..width];
            let ending =
                self.refiner.refine(simd, system, &mut self.next.poles[group], &mut shape[..system.n]);
            if !ending.converged {
                return None;
            }
            worst = ending.residual.as_slice().iter().fold(worst, |a, &v| a.max(v));
            let before = &self.now.shapes[group * width..][..width];
            let alike = normalize(simd, system, &self.refiner, before, shape, first);
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
        if !self.complete.holds(system, |mode| next.pole(mode)) {
            return None;
        }
        std::mem::swap(&mut self.now, &mut self.next);
        Some(worst.sqrt())
    }

    /// Appends to `out` the share of every coordinate in the elastic energy of every mode (m×n): its spring, or its shaft
    /// and the spring K_P of its motor.
    #[inline(always)]
    pub(crate) fn energy_shares(
        &mut self,
        simd: S,
        system: &System<'_>,
        springs: &[f64],
        out: &mut Vec<f32>,
    ) {
        let n = system.n;
        let (width, start) = (self.now.width, out.len());
        out.resize(start + self.modes * n, 0.0);
        for (group, shape) in self.now.shapes.chunks_exact(width).enumerate() {
            let mut total = Real::splat(simd, 0.0);
            for ((energy, &u), &k) in self.energies.iter_mut().zip(shape).zip(springs) {
                *energy = u.norm_squared(simd).mul(simd, Real::splat(simd, k));
            }
            for ((i, drive), &motor) in system.drives.iter().zip(&shape[n..]) {
                let [w, k, own] = drive.springs.map(|v| Real::splat(simd, v));
                let wound = motor.neg(simd).add_scaled(simd, w, shape[*i]).norm_squared(simd);
                let held = motor.norm_squared(simd).mul(simd, own);
                self.energies[*i] = self.energies[*i].add(simd, held.add_mul(simd, k, wound));
            }
            for &energy in &self.energies {
                total = total.add(simd, energy);
            }
            for (lane, &total) in total.as_slice().iter().enumerate() {
                let mode = group * lanes::<S>() + lane;
                if mode < self.modes && total > 0.0 {
                    let row = &mut out[start + mode * n..][..n];
                    for (share, energy) in row.iter_mut().zip(&self.energies) {
                        *share = (energy.as_slice()[lane] / total) as f32;
                    }
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
    before: &[Complex<S>],
    shape: &mut [Complex<S>],
    first: bool,
) -> Real<S> {
    let n = system.n;
    for (d, (i, _)) in system.drives.iter().enumerate() {
        shape[n + d] = refiner.turn(d).mul(simd, shape[*i]);
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
    let length = square.norm_squared(simd).sqrt(simd);
    let mut phase = zero;
    for lane in 0..lanes::<S>() {
        let (re, im) = square.lane(lane);
        let cosine = if length.as_slice()[lane] > 0.0 { re / length.as_slice()[lane] } else { 1.0 };
        let (half_cosine, half_sine) =
            ((0.5 * (1.0 + cosine)).max(0.0).sqrt(), (0.5 * (1.0 - cosine)).max(0.0).sqrt());
        let (re, im) = (half_cosine, if im >= 0.0 { -half_sine } else { half_sine });
        let (cross_re, cross_im) = cross.lane(lane);
        let turned = re * cross_re - im * cross_im;
        let sign = if first || turned >= 0.0 { 1.0 } else { -1.0 };
        phase.set_lane(lane, (sign * re, sign * im));
    }
    let scale = phase.scale(simd, one.div(simd, size.sqrt(simd)));
    for entry in shape.iter_mut() {
        *entry = entry.mul(simd, scale);
    }
    alike
}
