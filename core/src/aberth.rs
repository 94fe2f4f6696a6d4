//! Simultaneous iteration on all eigenvalues of one matrix polynomial with real coefficients, in SIMD lanes.
//!
//! Ehrlich-Aberth: z_i ← z_i − 1 / (tr(P⁻¹P')(z_i) − Σ_{j≠i} 1/(z_i − z_j)) (Bini & Noferini 2013). The points
//! are pairs, which stand for themselves and their conjugates, and singles. A pair cannot turn into two real numbers, so
//! that one which crosses the real axis is broken into singles; these may end as real numbers or as a pair.

use crate::lanes::{Complex, Real, lanes};
use crate::polynomial::{Polynomial, Work, argument};
use nalgebra::Complex as C64;
use pulp::Simd;

/// A point is done where a bound for the smallest singular value of P is below this share of its size, once rows and
/// columns of Σ|C_k||z|^k are of like size: it is an eigenvalue of a polynomial this close, row by row.
const SINGULAR: f64 = 4.0 * f64::EPSILON;
/// Or where the step is below this share of the point.
const STILL: f64 = 2.0 * f64::EPSILON;
/// Below this, squares underflow and no test means anything.
const SMALLEST: f64 = 1e-140;
/// At an eigenvalue of any multiplicity the iteration takes more than this share of Newton's inverse step; next to a
/// point that stands there already it takes next to nothing of it.
const FREE: f64 = 0.3;
/// Points that sit on the real axis would never leave it: they start off it by this share of themselves.
const KICK: f64 = 0.02;

/// Points of one kind.
#[derive(Default)]
pub(crate) struct Points {
    pub(crate) at: Vec<C64<f64>>,
    /// Size of the last step; none where the point is done.
    step: Vec<Option<f64>>,
}

impl Points {
    pub(crate) fn push(&mut self, at: C64<f64>) {
        self.at.push(at);
        self.step.push(Some(f64::INFINITY));
    }
}

/// All points of one polynomial.
#[derive(Default)]
pub(crate) struct Cloud {
    /// In the upper half-plane, each with its conjugate.
    pub(crate) pairs: Points,
    pub(crate) singles: Points,
    /// Indices of points that are not done, singles after pairs, and of pairs that are to be broken.
    open: Vec<usize>,
    broken: Vec<usize>,
}

impl Cloud {
    /// How many eigenvalues the points stand for.
    pub(crate) fn count(&self) -> usize {
        2 * self.pairs.at.len() + self.singles.at.len()
    }

    /// Adds a point on the real axis, a little off it, and never where another one stands.
    pub(crate) fn push_real(&mut self, x: f64) {
        let index = self.singles.at.len() as f64;
        let side = if self.singles.at.len().is_multiple_of(2) { KICK } else { -KICK };
        self.singles.push(C64::new(x, side * x.abs() / (1.0 + 0.1 * index)));
    }

    /// Σ 1/(z − z_j) over all points and conjugates of pairs; a point that stands at z itself adds nothing.
    ///
    /// Pairs look up only: to them singles appear in the upper half-plane, so that one which has taken the conjugate of
    /// their eigenvalue drives them off. At an eigenvalue of their own the sum need not be exact.
    #[inline(always)]
    fn repulsion<S: Simd>(&self, simd: S, z: Complex<S>, pairs: bool) -> Complex<S> {
        let least = Real::splat(simd, f64::MIN_POSITIVE);
        let mut sum = Complex::zero(simd);
        for point in &self.pairs.at {
            let y = Real::splat(simd, point.im);
            // 1/(z − z_j) + 1/(z − z̄_j) = 2(z − x_j) / ((z − z_j)(z − z̄_j)), its denominator without cancellation.
            let x = z.re.sub(simd, Real::splat(simd, point.re));
            let (below, above) = (z.im.sub(simd, y), z.im.add(simd, y));
            let re = x.mul(simd, x).sub_mul(simd, below, above);
            let im = x.mul(simd, below.add(simd, above));
            let size = re.mul(simd, re).add_mul(simd, im, im);
            let scale = Real::splat(simd, 2.0).div(simd, size.max(simd, least));
            let (re, im) = (re.mul(simd, scale), im.mul(simd, scale));
            sum.re = sum.re.add_mul(simd, x, re).add_mul(simd, z.im, im);
            sum.im = sum.im.add_mul(simd, z.im, re).sub_mul(simd, x, im);
        }
        for point in &self.singles.at {
            let x = z.re.sub(simd, Real::splat(simd, point.re));
            let height = if pairs { point.im.abs() } else { point.im };
            let y = z.im.sub(simd, Real::splat(simd, height));
            let size = x.mul(simd, x).add_mul(simd, y, y);
            let scale = Real::splat(simd, 1.0).div(simd, size.max(simd, least));
            sum.re = sum.re.add_mul(simd, x, scale);
            sum.im = sum.im.sub_mul(simd, y, scale);
        }
        sum
    }

    fn point(&self, index: usize) -> C64<f64> {
        let pairs = self.pairs.at.len();
        if index < pairs { self.pairs.at[index] } else { self.singles.at[index - pairs] }
    }

    /// Which half of the work a point belongs to: pair or single, inside or outside the unit circle.
    fn kind(&self, index: usize) -> (bool, bool) {
        (index < self.pairs.at.len(), argument(self.point(index)).0)
    }

    /// Moves one point by `step`; `done` if it is the last time.
    fn advance(&mut self, index: usize, step: C64<f64>, done: bool) {
        let pairs = self.pairs.at.len();
        let (set, i) =
            if index < pairs { (&mut self.pairs, index) } else { (&mut self.singles, index - pairs) };
        let new = set.at[i] - step;
        set.step[i] = (!done).then(|| step.norm());
        if index < pairs && new.im <= 0.0 {
            self.broken.push(index);
            set.at[i].re = new.re; // where it goes is decided once the sweep is over
        } else {
            set.at[i] = new;
        }
    }

    /// Turns pairs that crossed the real axis into two singles each, along it rather than across.
    fn break_pairs(&mut self) {
        self.broken.sort_unstable();
        while let Some(index) = self.broken.pop() {
            let at = self.pairs.at.swap_remove(index);
            self.pairs.step.swap_remove(index);
            self.singles.push(C64::new(at.re + at.im, KICK * at.im));
            self.singles.push(C64::new(at.re - at.im, -0.7 * KICK * at.im));
        }
    }

    /// One sweep over all points that are not done, each kind by itself; whether any is left.
    #[inline(always)]
    fn sweep<S: Simd>(&mut self, simd: S, polynomial: &Polynomial, work: &mut Work<S>) -> bool {
        let mut open = std::mem::take(&mut self.open);
        let steps = self.pairs.step.iter().chain(&self.singles.step).enumerate();
        open.clear();
        open.extend(steps.filter(|(_, step)| step.is_some()).map(|(i, _)| i));
        open.sort_by_key(|&i| self.kind(i)); // stable: a run repeats itself
        let mut start = 0;
        while start < open.len() {
            let kind = self.kind(open[start]);
            let same = open[start..].iter().take(lanes::<S>()).take_while(|&&i| self.kind(i) == kind).count();
            self.step_group(simd, polynomial, work, kind, &open[start..start + same]);
            start += same;
        }
        self.open = open;
        self.break_pairs();
        self.pairs.step.iter().chain(&self.singles.step).any(Option::is_some)
    }

    #[inline(always)]
    fn step_group<S: Simd>(
        &mut self,
        simd: S,
        polynomial: &Polynomial,
        work: &mut Work<S>,
        (pairs, outside): (bool, bool),
        group: &[usize],
    ) {
        let (mut z, mut w) = (Complex::zero(simd), Complex::zero(simd));
        for lane in 0..lanes::<S>() {
            let point = self.point(group[lane.min(group.len() - 1)]); // lanes left over repeat the last
            let argument = argument(point).1;
            z.set_lane(lane, (point.re, point.im));
            w.set_lane(lane, (argument.re, argument.im));
        }
        work.evaluate(simd, polynomial, outside, w);
        let (norm, size) = work.equilibrate(simd, polynomial.m);
        let (trace, pivot) = work.trace(simd, polynomial.m);
        let repulsion = self.repulsion(simd, z, pairs);
        for (lane, &index) in group.iter().enumerate() {
            let of = |(re, im)| C64::new(re, im);
            let (point, mut slope) = (of(z.lane(lane)), of(trace.lane(lane)));
            if outside {
                let w = of(w.lane(lane));
                slope = w * (polynomial.count() as f64 - w * slope);
            }
            let mut away = of(repulsion.lane(lane));
            let last = if pairs {
                away += C64::new(0.0, -0.5 / point.im); // from its own conjugate
                self.pairs.step[index]
            } else {
                self.singles.step[index - self.pairs.at.len()]
            };
            let mut step = (slope - away).inv();
            let of = |square: Real<S>| square.as_slice()[lane].sqrt();
            let (size, norm, pivot) = (size.as_slice()[lane], of(norm), of(pivot));
            // Where the push is as strong as the pull, another point already stands at this eigenvalue.
            let free = if pivot > 0.0 {
                (slope - away).norm() > FREE * slope.norm()
            } else {
                step = C64::new(0.0, 0.0); // no telling how far
                away.norm() * point.norm() * STILL.sqrt() < 1.0
            };
            let singular = pivot <= SINGULAR * norm && size > SMALLEST && free;
            if !singular && (pivot == 0.0 || !step.is_finite()) {
                step = 0.1 * point; // anywhere else will do
            }
            if singular && step.norm() > last.unwrap_or(0.0) {
                step = C64::new(0.0, 0.0); // rounding only
            }
            // Newton's step must be small too: beside another point the whole step always is.
            let least = STILL * point.norm();
            let still = step.norm() <= least && slope.norm() * least >= 1.0 && size > SMALLEST;
            self.advance(index, step, singular || still);
        }
    }

    /// Sweeps until every point is done; how many, and whether they were enough.
    #[inline(always)]
    pub(crate) fn settle<S: Simd>(
        &mut self,
        simd: S,
        polynomial: &Polynomial,
        work: &mut Work<S>,
        limit: usize,
    ) -> (usize, bool) {
        for sweep in 1..=limit {
            if !self.sweep(simd, polynomial, work) {
                return (sweep, true);
            }
        }
        (limit, false)
    }
}
