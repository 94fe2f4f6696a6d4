//! The logarithmic residual of a fit and its Jacobian, reduced to the small triangle that least squares needs.
//!
//! Cost (Huynh et al. 2021, Eq. 22): Σ W |ln H_s − ln H|² over outputs, inputs and lines, the phase difference taken to
//! its principal value; or Σ W |H_s/H − 1|², which knows no logarithm. Rows go into a [`Triangle`] as they are computed.

use crate::impedance::SpringDamper;
use crate::lanes::{Complex, REGISTERS, Real, lanes};
use crate::mechanism::finite;
use crate::solver::{Solver, load};
use crate::system::LinearSystem;
use crate::triangle::{Block, Triangle};
use crate::{Error, Result};
use nalgebra::Complex as C64;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Lines that one task works on: small enough to share a fit among threads, and fixed, so that results do not depend on
/// how many there are.
const LINES_PER_TASK: usize = 64;
/// Tasks that are not worth a second thread.
const TASKS_PER_THREAD: usize = 4;
/// Rows that are gathered before they are folded in: enough to hide what each reflection costs beside its arithmetic,
/// few enough that some twenty columns stay in cache.
const ROWS_PER_BLOCK: usize = 256;
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
    deviation: Deviation,
}

/// What a residual is of a modelled response H_s and a measured one H.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Deviation {
    /// ln H_s − ln H, the phase difference at its principal value (Huynh et al. 2021, Eq. 22).
    Logarithmic,
    /// H_s/H − 1.
    Relative,
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
        let deviation = Deviation::Logarithmic;
        Ok(Self { system, s: padded_s, lines, inverse, root_weight, price_weight, deviation })
    }

    /// The same with another residual.
    #[must_use]
    pub fn with_deviation(self, deviation: Deviation) -> Self {
        Self { deviation, ..self }
    }
}

/// A fit over several targets that share their impedances.
#[derive(Debug, Clone)]
pub struct Problem {
    targets: Vec<Target>,
    branches: usize,
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

    /// The triangle of [J r] for the `free` parameters, J with respect to their logarithms. A parameter is the list of
    /// numbers that it multiplies (indices into all stiffnesses, then all dampings): one, or several that are tied.
    ///
    /// # Errors
    /// Mismatched lengths, [`Error::Singular`], [`Error::ZeroResponse`].
    pub fn reduce(&self, impedances: &[SpringDamper], free: &[Vec<usize>]) -> Result<Triangle> {
        let count = self.branches * SpringDamper::PARAMETERS;
        if let Some(&got) = free.iter().flatten().find(|&&i| i >= count) {
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
            total.merge(&part?);
        }
        Ok(total)
    }

    /// Costs of many impedance sets, in parallel; infinite where the model has no answer.
    ///
    /// # Errors
    /// Mismatched lengths or numbers that are not finite.
    pub fn costs(&self, sets: &[Vec<SpringDamper>]) -> Result<Vec<f64>> {
        sets.par_iter()
            .map(|set| self.answer(set, &[]).map(|r| r.map_or(f64::INFINITY, |r| r.cost())))
            .collect()
    }

    /// [`Self::reduce`], with nothing where the model has no answer: singular, zero or infinite.
    ///
    /// # Errors
    /// Mismatched lengths or numbers that are not finite.
    pub fn answer(&self, impedances: &[SpringDamper], free: &[Vec<usize>]) -> Result<Option<Triangle>> {
        match self.reduce(impedances, free) {
            Ok(triangle) => Ok(Some(triangle)),
            Err(Error::Singular { .. } | Error::ZeroResponse { .. }) => Ok(None),
            Err(error) => Err(error),
        }
    }
}

struct Task<'a> {
    target: &'a Target,
    impedances: &'a [SpringDamper],
    free: &'a [Vec<usize>],
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
        let columns: Vec<Vec<_>> =
            self.free.iter().map(|tied| tied.iter().map(|&i| (i / r, i % r)).collect()).collect();
        let joined_rows = mirrored && target.deviation == Deviation::Logarithmic;
        let per_chunk = 2 * REGISTERS * if joined_rows { p * (p + 1) / 2 } else { p * m };
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
                if width > 1 {
                    let (y, x) = (&solver.at_outputs()[a..], &solver.at_inputs[b..]);
                    for ((product, &y), &x) in
                        products.iter_mut().zip(y.iter().step_by(p)).zip(x.iter().step_by(m))
                    {
                        *product = y.mul(simd, x);
                    }
                }
                // One place that fills rows: what is called from several is not inlined, and then not vectorized.
                let first = self.deviation(simd, h, (a, b), start, &mut price)?;
                let mut rows = [(first, h.inverse(simd)); 2];
                let mut count = 1;
                if mirrored && a != b {
                    let second = self.deviation(simd, h, (b, a), start, &mut price)?;
                    if joined_rows {
                        rows[0].0 = joined(simd, first, second, &mut rest);
                    } else {
                        rows[1].0 = second;
                        count = 2;
                    }
                }
                if target.deviation == Deviation::Relative {
                    rows[0].1 = self.inverse(simd, (a, b), start);
                    if count == 2 {
                        rows[1].1 = self.inverse(simd, (b, a), start);
                    }
                }
                for ((residual, root), per_response) in &rows[..count] {
                    block.put(width - 1, [residual[0].mul(simd, *root), residual[1].mul(simd, *root)]);
                    let scale = per_response.scale(simd, root.neg(simd));
                    for (column, tied) in columns.iter().enumerate() {
                        let mut value = Complex::zero(simd);
                        for &(kind, branch) in tied {
                            value = value.add_mul(simd, products[branch], slopes[branch][kind]);
                        }
                        let value = value.mul(simd, scale);
                        block.put(column, [value.re, value.im]);
                    }
                    block.filled += 2 * REGISTERS;
                }
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
    /// Where one response stands in the target's arrays.
    #[inline(always)]
    fn at(&self, (a, b): (usize, usize), start: usize) -> usize {
        (a * self.target.system.shape().1 + b) * self.target.s.len() + start
    }

    /// 1/H measured.
    #[inline(always)]
    fn inverse<S: Simd>(&self, simd: S, pair: (usize, usize), start: usize) -> Complex<S> {
        load(simd, &self.target.inverse, self.at(pair, start))
    }

    /// How modelled and measured response differ, as real and imaginary part, and √W; adds to the price.
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
        let at = self.at((a, b), start);
        let ratio = h.mul(simd, load(simd, &target.inverse, at));
        let mut parts = [ratio.norm_squared(simd), ratio.im];
        let [log, phase] = &mut parts;
        let valid = match target.deviation {
            Deviation::Logarithmic => principal_logarithm::<S>(log, phase, &ratio.re),
            Deviation::Relative => {
                let valid = log.as_slice().iter().all(|size| size.is_finite());
                *log = ratio.re.sub(simd, Real::splat(simd, 1.0));
                valid
            }
        };
        if !valid {
            return Err(Error::ZeroResponse { output: a, input: b, line: start });
        }
        let square = parts[0].mul(simd, parts[0]).add_mul(simd, parts[1], parts[1]);
        *price = price.add_mul(simd, square, load(simd, &target.price_weight, at).re);
        Ok((parts, load(simd, &target.root_weight, at).re))
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
