//! Eigenvalues of matrix polynomials P(z) = z^p I − A_1 z^(p−1) − … − A_p with real coefficients, order after order.
//!
//! The poles of vector autoregressions of many orders are m·p numbers each, whose companion matrices cost (m·p)³. Here
//! all eigenvalues of one order are iterated side by side ([`crate::aberth`]) at a cost of m³p², starting from those of
//! the order before. Bini & Noferini, Solving polynomial eigenvalue problems by means of the Ehrlich-Aberth method,
//! Linear Algebra Appl. 439 (2013).

use crate::aberth::Cloud;
use crate::lanes::{Complex, lanes};
use crate::null_vector::{NullVector, normalize};
use crate::polynomial::{Polynomial, Work, argument};
use crate::{Error, Result};
use nalgebra::Complex as C64;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Orders that are walked one after the other; runs of them are independent, so that threads do not change a result.
const RUN: usize = 8;
/// How often an order is started; after the first time without its neighbour.
const ATTEMPTS: usize = 3;
/// Sweeps after which a start is given up.
const SWEEPS: usize = 200;
/// Largest difference between the sum of all eigenvalues, or squares, and what it is known to be, as a share of the sum
/// of their sizes.
const COMPLETE: f64 = 1e-7;
/// Eigenvalues below this share of what is expected of the largest tell nothing: they are zeros to rounding.
const SMALL: f64 = 1e-8;
/// Points that start from known eigenvalues move by multiples of this share.
const APART: f64 = 1e-6;
/// Rounds of balancing.
const BALANCING: usize = 10;
/// Points of eigenvectors that are treated as one task.
const TASK: usize = 256;

/// The eigenvalues of one order.
#[derive(Debug, Clone, PartialEq)]
pub struct Spectrum {
    /// m·p numbers by rising |arg z|, each in the upper half-plane followed by its exact conjugate; the others are real.
    pub eigenvalues: Vec<C64<f64>>,
    /// Sweeps over all eigenvalues that were open.
    pub sweeps: usize,
    /// Whether every eigenvalue was found to rounding; else another solver is needed.
    pub converged: bool,
}

/// Eigenvalues of several orders, each from its A_1 … A_p (p×m×m); neighbours in the list should resemble each other.
///
/// # Errors
/// [`Error::Length`] if an order is not a whole number of m×m matrices, at least one; [`Error::Value`] if a number is not
/// finite.
pub fn eigenvalues(m: usize, orders: &[&[f64]]) -> Result<Vec<Spectrum>> {
    for coefficients in orders {
        check(m, coefficients)?;
    }
    // The last runs are the long ones: they go first.
    let runs: Vec<_> = orders.chunks(RUN).rev().collect();
    let found: Vec<Vec<_>> =
        runs.into_par_iter().with_max_len(1).map(|orders| Arch::new().dispatch(Walk { m, orders })).collect();
    Ok(found.into_iter().rev().flatten().collect())
}

/// Unit vectors (k×m) with P(z) v = 0 for k eigenvalues, the largest entry of each real and positive.
///
/// # Errors
/// As [`eigenvalues`].
pub fn shapes(m: usize, coefficients: &[f64], poles: &[C64<f64>]) -> Result<Vec<C64<f64>>> {
    check(m, coefficients)?;
    let (scaled, scales) = balanced(m, coefficients);
    let (mut vectors, _) = null_vectors(m, &scaled, poles);
    for vector in vectors.chunks_exact_mut(m) {
        vector.iter_mut().zip(&scales).for_each(|(entry, scale)| *entry *= scale);
        normalize(vector);
    }
    Ok(vectors)
}

/// σ_min(P(z)) / Σ‖A_k‖|z|^(p−k), A_0 = I, at k numbers z: how far, as a share, the polynomial is from one with that
/// eigenvalue (Tisseur, Linear Algebra Appl. 309 (2000)). Frobenius norms.
///
/// # Errors
/// As [`eigenvalues`].
pub fn backward_errors(m: usize, coefficients: &[f64], poles: &[C64<f64>]) -> Result<Vec<f64>> {
    check(m, coefficients)?;
    Ok(null_vectors(m, coefficients, poles).1)
}

fn check(m: usize, coefficients: &[f64]) -> Result<()> {
    let (size, got) = (m * m, coefficients.len());
    if size == 0 || got == 0 || !got.is_multiple_of(size) {
        let needed = (got / size.max(1)).max(1) * size.max(1);
        return Err(Error::Length { what: "coefficients", needed, got });
    }
    match coefficients.iter().find(|v| !v.is_finite()) {
        Some(&got) => Err(Error::Value { what: "coefficients", got, expected: "finite numbers" }),
        None => Ok(()),
    }
}

struct Walk<'a> {
    m: usize,
    orders: &'a [&'a [f64]],
}

impl WithSimd for Walk<'_> {
    type Output = Vec<Spectrum>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<Spectrum> {
        let (m, size) = (self.m, self.m * self.m);
        let longest = self.orders.iter().map(|order| order.len() / size).max().unwrap_or(0);
        let mut work = Work::new(simd, m, longest);
        let mut out: Vec<Spectrum> = Vec::with_capacity(self.orders.len());
        for order in self.orders {
            // Matrices of zeros at the end are eigenvalues of zero, which no iteration reaches.
            let zeros = order.chunks_exact(size).rev().take_while(|a| a.iter().all(|v| *v == 0.0)).count();
            let (scaled, _) = balanced(m, &order[..order.len() - zeros * size]);
            let polynomial = Polynomial::new(m, &scaled);
            let before = out.last().filter(|spectrum| spectrum.converged);
            let mut known = before.map_or(&[][..], |spectrum| &spectrum.eigenvalues);
            let (mut eigenvalues, mut sweeps, mut converged) = (Vec::new(), 0, false);
            for attempt in 0..ATTEMPTS {
                let mut cloud = start(&polynomial, known, attempt);
                let (taken, settled) = cloud.settle(simd, &polynomial, &mut work, SWEEPS);
                eigenvalues = symmetric(&cloud, zeros * m);
                sweeps += taken;
                converged = settled && complete(m, order, &eigenvalues);
                if converged {
                    break;
                }
                known = &[];
            }
            out.push(Spectrum { eigenvalues, sweeps, converged });
        }
        out
    }
}

/// Whether the eigenvalues and their squares add up to the traces of the companion matrix and its square, tr A_1 and
/// tr A_1² + 2 tr A_2: one that is missing or stands there twice shows.
fn complete(m: usize, order: &[f64], eigenvalues: &[C64<f64>]) -> bool {
    let (first, second) = order.split_at(m * m);
    let trace = |a: &[f64]| a.iter().step_by(m + 1).take(m).sum::<f64>();
    let square: f64 = (0..m * m).map(|e| first[e] * first[e % m * m + e / m]).sum();
    let near =
        |sum: f64, expected: f64, size: f64| size.is_finite() && (sum - expected).abs() <= COMPLETE * size;
    let of = |f: fn(&C64<f64>) -> f64| eigenvalues.iter().map(f).sum::<f64>();
    near(of(|z| z.re), trace(first), of(|z| z.norm()))
        && near(of(|z| (z * z).re), square + 2.0 * trace(second), of(|z| z.norm_sqr()))
}

/// S⁻¹A_kS for all coefficients and the diagonal of S, powers of two that bring rows and columns of Σ|A_k| to like size:
/// channels in units of their own leave the eigenvalues as they are, but not what rounding does to them.
fn balanced(m: usize, coefficients: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let mut sizes = vec![0.0; m * m];
    for matrix in coefficients.chunks_exact(m * m) {
        sizes.iter_mut().zip(matrix).for_each(|(sum, v)| *sum += v.abs());
    }
    let mut scales = vec![1.0; m];
    for _ in 0..BALANCING {
        for i in 0..m {
            let beside = || (0..m).filter(|&j| j != i);
            let row: f64 = beside().map(|j| sizes[i * m + j] * scales[j]).sum::<f64>() / scales[i];
            let column: f64 = beside().map(|j| sizes[j * m + i] / scales[j]).sum::<f64>() * scales[i];
            if row > 0.0 && column > 0.0 {
                scales[i] *= (0.5 * (row / column).log2()).round().clamp(-500.0, 500.0).exp2();
            }
        }
    }
    let entry = |(e, v): (usize, &f64)| v * scales[e % m] / scales[e / m % m];
    (coefficients.iter().enumerate().map(entry).collect(), scales)
}

/// Points to start from: eigenvalues of another order, and new ones for those that are missing.
fn start(polynomial: &Polynomial, known: &[C64<f64>], attempt: usize) -> Cloud {
    let mut cloud = Cloud::default();
    let count = polynomial.count();
    let circles = circles(polynomial);
    let largest = circles.iter().map(|(radius, _)| *radius).fold(0.0, f64::max);
    let mut known: Vec<_> = known.iter().filter(|z| z.im >= 0.0 && z.norm() > SMALL * largest).collect();
    for (i, z) in known.iter().enumerate() {
        if z.im > 0.0 && cloud.count() + 2 <= count {
            // Points that stand together would stay together, and double eigenvalues do.
            cloud.pairs.push(**z * (1.0 + APART * i as f64));
        } else if z.im == 0.0 && cloud.count() < count {
            cloud.push_real(z.re);
        }
    }
    let missing = count - cloud.count();
    if known.is_empty() {
        for (radius, points) in circles {
            scatter(&mut cloud, radius, points, attempt);
        }
    } else if missing > 0 {
        known.sort_by(|a, b| a.norm_sqr().total_cmp(&b.norm_sqr()));
        scatter(&mut cloud, known[known.len() / 2].norm(), missing, attempt);
    }
    cloud
}

/// Spreads points over a circle, pairs and a real one if the number is odd; a little off it, which breaks symmetries
/// that the iteration would keep.
fn scatter(cloud: &mut Cloud, radius: f64, points: usize, attempt: usize) {
    let pairs = points / 2;
    for j in 0..pairs {
        let angle = PI * (j as f64 + 0.5) / pairs as f64;
        let off = 1.0 + 0.03 * (7.0 * angle + (pairs + attempt) as f64).sin();
        cloud.pairs.push(C64::from_polar(radius * off, angle));
    }
    if points % 2 == 1 {
        cloud.push_real(radius);
    }
}

/// Radii and how many eigenvalues are expected near each: the upper hull of log‖C_k‖ over k (Bini & Noferini).
fn circles(polynomial: &Polynomial) -> Vec<(f64, usize)> {
    let mut hull: Vec<(usize, f64)> = Vec::new();
    for (k, norm) in polynomial.norms().iter().enumerate().filter(|(_, norm)| **norm > 0.0) {
        let next = (k, norm.ln());
        let slope = |a: (usize, f64), b: (usize, f64)| (b.1 - a.1) / (b.0 - a.0) as f64;
        while let [.., a, b] = hull[..] {
            if slope(a, b) > slope(b, next) {
                break;
            }
            hull.pop();
        }
        hull.push(next);
    }
    let edge = |w: &[(usize, f64)]| {
        let degrees = w[1].0 - w[0].0;
        (((w[0].1 - w[1].1) / degrees as f64).exp(), degrees * polynomial.m)
    };
    hull.windows(2).map(edge).collect()
}

/// The eigenvalues that a cloud stands for, and zeros. Singles become real, or pairs, whichever moves them less.
fn symmetric(cloud: &Cloud, zeros: usize) -> Vec<C64<f64>> {
    let singles = &cloud.singles.at;
    let mut moves = Vec::new();
    for (i, z) in singles.iter().enumerate() {
        moves.push((2.0 * z.im.abs(), i, i));
        moves.extend((0..i).map(|j| ((z - singles[j].conj()).norm(), i, j)));
    }
    moves.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut taken = vec![false; singles.len()];
    let mut upper = cloud.pairs.at.clone();
    upper.resize(upper.len() + zeros, C64::new(0.0, 0.0));
    for (_, i, j) in moves {
        if taken[i] || taken[j] {
            continue;
        }
        (taken[i], taken[j]) = (true, true);
        if i == j {
            upper.push(C64::new(singles[i].re, 0.0));
        } else {
            let mean = 0.5 * (singles[i] + singles[j].conj());
            if mean.im == 0.0 {
                upper.push(mean);
            }
            upper.push(C64::new(mean.re, mean.im.abs()));
        }
    }
    upper.sort_by(|a, b| a.arg().total_cmp(&b.arg()).then(a.re.total_cmp(&b.re)));
    let mut all = Vec::with_capacity(2 * upper.len());
    for z in upper {
        all.push(z);
        if z.im != 0.0 {
            all.push(z.conj());
        }
    }
    all
}

fn null_vectors(m: usize, coefficients: &[f64], poles: &[C64<f64>]) -> (Vec<C64<f64>>, Vec<f64>) {
    let polynomial = Polynomial::new(m, coefficients);
    let parts: Vec<_> = poles
        .par_chunks(TASK)
        .map(|poles| Arch::new().dispatch(NullVectors { polynomial: &polynomial, poles }))
        .collect();
    let mut out = (Vec::with_capacity(poles.len() * m), Vec::with_capacity(poles.len()));
    for (vectors, errors) in parts {
        out.0.extend(vectors);
        out.1.extend(errors);
    }
    out
}

struct NullVectors<'a> {
    polynomial: &'a Polynomial,
    poles: &'a [C64<f64>],
}

impl WithSimd for NullVectors<'_> {
    type Output = (Vec<C64<f64>>, Vec<f64>);

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Self { polynomial, poles } = self;
        let m = polynomial.m;
        let mut work = Work::new(simd, m, polynomial.degree);
        let (mut vectors, mut errors) = (vec![C64::new(0.0, 0.0); poles.len() * m], vec![0.0; poles.len()]);
        let mut order: Vec<_> = (0..poles.len()).collect();
        order.sort_by_key(|&i| argument(poles[i]).0);
        let (near, far) = order.split_at(order.partition_point(|&i| !argument(poles[i]).0));
        let mut solver = NullVector::new(m);
        for (outside, list) in [(false, near), (true, far)] {
            for group in list.chunks(lanes::<S>()) {
                let mut z = Complex::zero(simd);
                for lane in 0..lanes::<S>() {
                    let w = argument(poles[group[lane.min(group.len() - 1)]]).1;
                    z.set_lane(lane, (w.re, w.im));
                }
                let size = work.evaluate(simd, polynomial, outside, z);
                for (lane, &index) in group.iter().enumerate() {
                    let vector = &mut vectors[index * m..][..m];
                    let shortest = solver.find(work.value(lane).take(m * m), vector);
                    let size = size.as_slice()[lane];
                    errors[index] = if size > 0.0 { shortest / size } else { 0.0 }; // an eigenvalue of zero
                }
            }
        }
        (vectors, errors)
    }
}
