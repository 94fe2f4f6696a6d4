//! All modes of a robot followed from posture to posture, each set checked to be complete.
//!
//! Every pole is carried on by [`crate::eigenpairs`] from its neighbour, all modes side by side in SIMD lanes. A step is
//! accepted where every shape resembles the one before; else it is halved along the straight line between the two
//! systems' matrices. That all poles are there, once each, follows from their number, their distances and two invariants
//! of the characteristic polynomial: the sum of its roots and their product.

use crate::eigenpairs::{Refiner, System};
use crate::impedance::Drive;
use crate::lanes::{Complex, Real, lanes};
use crate::{Error, Result};
use nalgebra::Complex as C64;
use pulp::{Arch, Simd, WithSimd};

/// Least modal assurance criterion between a shape and the one it came from.
const ALIKE: f64 = 0.9;
/// A step is taken in parts down to this share of it.
const SHORTEST: f64 = 1.0 / 4096.0;
/// Poles closer than this share of their size count as one pole found twice.
const DISTINCT: f64 = 1e-8;
/// Relative deviation of the invariants that rounding may cause.
const INVARIANT: f64 = 1e-9;

/// The systems of a walk, one after the other.
#[derive(Debug, Clone, Copy)]
pub struct Walk<'a> {
    /// Number of coordinates.
    pub n: usize,
    /// M of every system (P×n×n).
    pub mass: &'a [f64],
    /// C of every system (P×n×n), or one for all.
    pub damping: &'a [f64],
    /// K of every system (P×n×n).
    pub stiffness: &'a [f64],
    /// Drives of every system, or one list for all.
    pub drives: &'a [Vec<(usize, Drive)>],
}

/// Modes along a walk; those of the start stand first, polished.
#[derive(Debug, Clone)]
pub struct Modes {
    /// λ (P×m), rad/s.
    pub poles: Vec<C64<f64>>,
    /// Shapes (P×m×(n+d)), coordinates before motors, of one in the Hermitian mass norm, uᵀMu real; empty if not wanted.
    pub shapes: Vec<C64<f64>>,
    /// Largest residual of each system, as a share of what is tolerated (P).
    pub residuals: Vec<f64>,
    /// Modal assurance criterion with the shape before (P×m), the smallest over the halves of a step.
    pub likeness: Vec<f64>,
    /// Systems that were reached; the first that was not needs another solver.
    pub reached: usize,
}

impl<'a> Walk<'a> {
    /// Number of systems.
    pub fn count(&self) -> usize {
        self.mass.len() / (self.n * self.n).max(1)
    }

    fn check(&self) -> Result<()> {
        let (count, size) = (self.count(), self.n * self.n);
        for (what, got, needed) in [
            ("mass", self.mass.len(), count * size),
            ("stiffness", self.stiffness.len(), count * size),
            ("damping", self.damping.len(), if self.damping.len() == size { size } else { count * size }),
            ("drives", self.drives.len(), if self.drives.len() == 1 { 1 } else { count }),
        ] {
            if got != needed || self.n == 0 {
                return Err(Error::Length { what, needed, got });
            }
        }
        for drives in self.drives {
            if drives.len() != self.drives[0].len() {
                return Err(Error::Length {
                    what: "drives",
                    needed: self.drives[0].len(),
                    got: drives.len(),
                });
            }
            if let Some(&(got, _)) = drives.iter().find(|(i, _)| *i >= self.n) {
                return Err(Error::Index { what: "coordinate of a drive", count: self.n, got });
            }
        }
        Ok(())
    }

    fn system(&self, index: usize) -> System<'a> {
        let size = self.n * self.n;
        let of = |matrices: &'a [f64]| {
            if matrices.len() == size { matrices } else { &matrices[index * size..][..size] }
        };
        System {
            n: self.n,
            mass: of(self.mass),
            damping: of(self.damping),
            stiffness: of(self.stiffness),
            drives: &self.drives[if self.drives.len() == 1 { 0 } else { index }],
        }
    }
}

/// Follows the modes of the first system through the others.
///
/// `poles` (m) and `shapes` (m×n, coordinates only) are those of the first system, one of each conjugate pair and every
/// real pole; together they must be complete. The walk ends early where a step fails: poles that meet, repeated poles,
/// pairs that turn into real poles.
///
/// # Errors
/// [`Error::Length`], [`Error::Index`].
pub fn follow(walk: &Walk<'_>, poles: &[C64<f64>], shapes: &[C64<f64>], want_shapes: bool) -> Result<Modes> {
    walk.check()?;
    if poles.is_empty() || shapes.len() != poles.len() * walk.n {
        let needed = poles.len().max(1) * walk.n;
        return Err(Error::Length { what: "shapes", needed, got: shapes.len() });
    }
    Ok(Arch::new().dispatch(Follow { walk, poles, shapes, want_shapes }))
}

struct Follow<'a> {
    walk: &'a Walk<'a>,
    poles: &'a [C64<f64>],
    shapes: &'a [C64<f64>],
    want_shapes: bool,
}

impl WithSimd for Follow<'_> {
    type Output = Modes;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Modes {
        let Self { walk, poles, shapes, want_shapes } = self;
        let (count, m) = (walk.count(), poles.len());
        let width = walk.n + walk.drives[0].len();
        let mut out = Modes {
            poles: Vec::with_capacity(count * m),
            shapes: Vec::with_capacity(if want_shapes { count * m * width } else { 0 }),
            residuals: Vec::with_capacity(count),
            likeness: Vec::with_capacity(count * m),
            reached: 0,
        };
        let mut follower = Follower::new(simd, walk.n, width - walk.n, poles, shapes);
        for index in 0..count {
            let system = walk.system(index);
            let before = walk.system(index.saturating_sub(1));
            follower.likeness.fill(1.0);
            let Some(residual) = follower.advance(simd, &before, &system, index == 0) else { break };
            out.residuals.push(residual);
            out.likeness.extend_from_slice(&follower.likeness);
            out.poles.extend((0..m).map(|mode| follower.now.pole(mode)));
            if want_shapes {
                for mode in 0..m {
                    out.shapes.extend((0..width).map(|i| follower.now.entry(mode, i)));
                }
            }
            out.reached += 1;
        }
        out
    }
}

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

    fn entry(&self, mode: usize, i: usize) -> C64<f64> {
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
struct Follower<S: Simd> {
    modes: usize,
    /// Which poles are real, and stay so.
    real: Vec<bool>,
    now: Pairs<S>,
    next: Pairs<S>,
    refiner: Refiner<S>,
    likeness: Vec<f64>,
    found: Vec<C64<f64>>,
    inverse: Vec<f64>,
}

impl<S: Simd> Follower<S> {
    fn new(simd: S, n: usize, drives: usize, poles: &[C64<f64>], shapes: &[C64<f64>]) -> Self {
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
            real: poles.iter().map(|pole| pole.im == 0.0).collect(),
            next: now.clone(),
            now,
            refiner: Refiner::new(simd, n, drives),
            likeness: vec![1.0; m],
            found: Vec::with_capacity(m),
            inverse: vec![0.0; n * n],
        }
    }

    /// Brings the modes from system `a` to `b`, in parts where one step is too far; the largest residual at `b`.
    #[inline(always)]
    fn advance(&mut self, simd: S, a: &System<'_>, b: &System<'_>, first: bool) -> Option<f64> {
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
        if !self.complete(system) {
            return None;
        }
        std::mem::swap(&mut self.now, &mut self.next);
        Some(worst.sqrt())
    }

    /// Whether the next poles are all poles of `system`, each once.
    fn complete(&mut self, system: &System<'_>) -> bool {
        let count: usize = self.real.iter().map(|&real| if real { 1 } else { 2 }).sum();
        if count != 2 * system.n + system.drives.iter().map(|(_, drive)| drive.degree).sum::<usize>() {
            return false;
        }
        self.found.clear();
        let (mut sum, mut size, mut product) = (0.0, 0.0, 0.0);
        for (mode, &real) in self.real.iter().enumerate() {
            let pole = self.next.pole(mode);
            let square = pole.norm_sqr();
            if real != (pole.im == 0.0) || (!real && pole.im <= DISTINCT * square.sqrt()) {
                return false;
            }
            let near = DISTINCT * DISTINCT * square;
            if self.found.iter().any(|other| (pole - other).norm_sqr() <= near) {
                return false;
            }
            self.found.push(pole);
            let times = if real { 1.0 } else { 2.0 };
            sum += times * pole.re;
            size += times * square.sqrt();
            product += 0.5 * times * square.ln();
        }
        let Some((trace, volume)) = invariants(system, &mut self.inverse) else { return false };
        let tolerance = INVARIANT * count as f64;
        (sum - trace).abs() <= INVARIANT * size && !((product - volume).abs() > tolerance)
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

/// Sum of all poles, and the logarithm of the size of their product (NaN where it does not exist), from the matrices.
///
/// The sum is −tr M⁻¹C − Σ d/B, the product det Z(0) Π k / (det M Π B) over the denominators k + … + B s^degree of the
/// drives. `inverse` has room for n×n. None where the mass matrix is not positive definite.
fn invariants(system: &System<'_>, inverse: &mut [f64]) -> Option<(f64, f64)> {
    let n = system.n;
    // M = L D Lᵀ, then L⁻¹ in place.
    let factor = inverse;
    factor.copy_from_slice(system.mass);
    let mut volume = -eliminate(factor, n, true)?;
    let mut trace = 0.0;
    for i in 0..n {
        for j in 0..i {
            let mut sum = factor[i * n + j];
            for k in j + 1..i {
                sum += factor[i * n + k] * factor[k * n + j];
            }
            factor[i * n + j] = -sum;
        }
        // Row i of L⁻¹ over its pivot: tr M⁻¹C = Σ_i (L⁻¹ C L⁻ᵀ)_ii / D_i.
        for a in 0..=i {
            let left = if a == i { 1.0 } else { factor[i * n + a] };
            for b in 0..=i {
                let c = system.damping[a * n + b];
                if c != 0.0 {
                    let right = if b == i { 1.0 } else { factor[i * n + b] };
                    trace -= left * c * right / factor[i * n + i];
                }
            }
        }
    }
    factor.copy_from_slice(system.stiffness);
    for (i, drive) in system.drives {
        let degree = drive.degree;
        let (last, lead) = (drive.denominator[0], drive.denominator[degree]);
        trace -= drive.denominator[degree - 1] / lead;
        volume += (last / lead).abs().ln();
        factor[i * n + i] -= drive.gain * drive.numerator[0] / last;
    }
    volume += eliminate(factor, n, false).unwrap_or(f64::NAN);
    Some((trace, volume))
}

/// Symmetric elimination in place, L below the diagonal and pivots on it; Σ ln |pivot|. None where a pivot vanishes, or is
/// not positive if it must be.
fn eliminate(matrix: &mut [f64], n: usize, positive: bool) -> Option<f64> {
    let mut volume = 0.0;
    for i in 0..n {
        for j in 0..i {
            let mut sum = matrix[i * n + j];
            for k in 0..j {
                sum -= matrix[i * n + k] * matrix[j * n + k];
            }
            matrix[i * n + j] = sum; // L_ij D_j, scaled below
        }
        let mut pivot = matrix[i * n + i];
        for j in 0..i {
            let scaled = matrix[i * n + j] / matrix[j * n + j];
            pivot -= scaled * matrix[i * n + j];
            matrix[i * n + j] = scaled;
        }
        if pivot == 0.0 || !pivot.is_finite() || (positive && pivot < 0.0) {
            return None;
        }
        matrix[i * n + i] = pivot;
        volume += pivot.abs().ln();
    }
    Some(volume)
}
