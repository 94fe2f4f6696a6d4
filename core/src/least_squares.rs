//! Bounded least squares over triangles: a trust region in parameters of one scale, such as logarithms.
//!
//! Every step minimizes the linearized residual within a ball and within the bounds; a parameter that a step would carry
//! through its bound is put on it and held while the others are solved for again. (Moré 1978 for the ball; the bounds
//! are an active set that is chosen anew at every step.)

use crate::triangle::Triangle;
use nalgebra::{DMatrix, DVector};

/// A column of the Jacobian, or a direction, below this share of the largest is rounding: the data do not see it, and the
/// parameter is left where it is instead of being steered by noise.
const UNSEEN: f64 = 1e-11;
/// How near to the ball's surface a step must end.
const ON_SURFACE: f64 = 0.1;
/// Trials of the damping before the last one is taken.
const DAMPINGS: usize = 20;
/// Most often that parameters are put on their bounds within one step.
const HOLDINGS: usize = 6;

/// When to stop, and how far to go at first.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// Relative change of the cost, and of the parameters, at which the run has converged.
    pub tolerance: f64,
    /// Most evaluations.
    pub evaluations: usize,
    /// Radius of the first ball; one is a factor of e in one logarithm.
    pub radius: f64,
}

/// Why a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// Cost or parameters settled.
    Converged,
    /// The evaluations were used up.
    Limit,
    /// The caller wanted no more.
    Stopped,
}

/// Where a run ended.
#[derive(Debug, Clone)]
pub struct Descent {
    /// The parameters of the lowest cost, (c,).
    pub x: Vec<f64>,
    /// That cost; infinite if there was no answer at the start.
    pub cost: f64,
    /// The parameters of the lowest price on the way.
    pub best: Vec<f64>,
    /// That price.
    pub price: f64,
    /// Lowest price after each evaluation.
    pub history: Vec<f64>,
    /// Why it ended.
    pub ending: Ending,
}

/// What an evaluation may say instead of a triangle.
pub enum Answer {
    /// The triangle at these parameters.
    Here(Triangle),
    /// There is no answer there: the step was too far.
    Nowhere,
    /// Stop.
    Stop,
}

/// Minimizes the cost of the triangles that `evaluate` returns, within the bounds.
///
/// A start outside of the bounds is put on them.
///
/// # Errors
/// Those of `evaluate`.
pub fn descend<E>(
    mut evaluate: impl FnMut(&[f64], f64) -> Result<Answer, E>,
    start: &[f64],
    lower: &[f64],
    upper: &[f64],
    settings: Settings,
) -> Result<Descent, E> {
    let bounds = Bounds { lower, upper };
    let mut run = Descent {
        x: bounds.clamped(start),
        cost: f64::INFINITY,
        best: bounds.clamped(start),
        price: f64::INFINITY,
        history: Vec::new(),
        ending: Ending::Limit,
    };
    let mut radius = settings.radius;
    let mut here: Option<Linear> = None;
    let mut candidate = run.x.clone();
    let mut promised = 0.0;
    while run.history.len() < settings.evaluations {
        let answer = match evaluate(&candidate, run.price)? {
            Answer::Here(triangle) => Some(triangle),
            Answer::Nowhere => None,
            Answer::Stop => {
                run.ending = Ending::Stopped;
                break;
            }
        };
        if let Some(triangle) = answer.as_ref().filter(|triangle| triangle.price < run.price) {
            (run.price, run.best) = (triangle.price, candidate.clone());
        }
        run.history.push(run.price);
        let cost = answer.as_ref().map_or(f64::INFINITY, Triangle::cost);
        let length = distance(&candidate, &run.x);
        let gained = (run.cost - cost) / promised;
        if let Some(triangle) = answer.filter(|_| here.is_none() || (gained > 1e-4 && cost.is_finite())) {
            let settled = here.is_some() && gained > 0.25 && run.cost - cost <= settings.tolerance * run.cost;
            (run.x, run.cost) = (candidate.clone(), cost);
            here = Some(Linear::of(&triangle));
            if settled {
                run.ending = Ending::Converged;
                break;
            }
        }
        let Some(linear) = &here else { break }; // no answer at the start
        if run.history.len() > 1 {
            radius = match gained {
                g if g > 0.75 => radius.max(2.0 * length),
                g if g > 0.25 => radius,
                g if g > 0.0 => 0.5 * length,
                _ => 0.25 * length,
            };
        }
        let step = linear.step(&run.x, &bounds, radius);
        promised = run.cost - linear.cost_after(&step);
        let size = run.x.iter().map(|v| v * v).sum::<f64>().sqrt();
        let shortest = settings.tolerance * (settings.tolerance + size);
        if step.norm() <= shortest
            || promised.is_nan()
            || promised <= f64::EPSILON * settings.tolerance * run.cost
        {
            run.ending = Ending::Converged;
            break;
        }
        let moved: Vec<_> = run.x.iter().zip(step.iter()).map(|(x, p)| x + p).collect();
        candidate = bounds.clamped(&moved);
    }
    Ok(run)
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

struct Bounds<'a> {
    lower: &'a [f64],
    upper: &'a [f64],
}

impl Bounds<'_> {
    fn clamped(&self, x: &[f64]) -> Vec<f64> {
        x.iter().zip(self.lower).zip(self.upper).map(|((x, l), u)| x.max(*l).min(*u)).collect()
    }
}

/// The residual's linear model at one point.
struct Linear {
    jacobian: DMatrix<f64>,
    residual: DVector<f64>,
}

impl Linear {
    fn of(triangle: &Triangle) -> Self {
        let (width, count) = (triangle.width, triangle.width - 1);
        let entry = |i: usize, j: usize| triangle.values[i * width + j];
        let mut jacobian = DMatrix::from_fn(width, count, entry);
        let largest = jacobian.column_iter().map(|c| c.norm()).fold(0.0, f64::max);
        for mut column in jacobian.column_iter_mut() {
            if column.norm() <= UNSEEN * largest {
                column.fill(0.0);
            }
        }
        Self { jacobian, residual: DVector::from_fn(width, |i, _| entry(i, count)) }
    }

    fn cost_after(&self, step: &DVector<f64>) -> f64 {
        (&self.residual + &self.jacobian * step).norm_squared()
    }

    /// The step within the ball and the bounds.
    fn step(&self, x: &[f64], bounds: &Bounds<'_>, radius: f64) -> DVector<f64> {
        let gradient = self.jacobian.tr_mul(&self.residual);
        let mut step = DVector::<f64>::zeros(x.len());
        let mut free: Vec<usize> = (0..x.len())
            .filter(|&i| {
                let pushed_out = (x[i] <= bounds.lower[i] && gradient[i] > 0.0)
                    || (x[i] >= bounds.upper[i] && gradient[i] < 0.0);
                gradient[i] != 0.0 && !pushed_out
            })
            .collect();
        for _ in 0..HOLDINGS {
            if free.is_empty() {
                break;
            }
            let mut held = step.clone();
            for &i in &free {
                held[i] = 0.0;
            }
            let rest = (radius * radius - held.norm_squared()).sqrt().max(0.1 * radius);
            let part = within_ball(
                &self.jacobian.select_columns(&free),
                &(&self.residual + &self.jacobian * &held),
                rest,
            );
            step = held;
            let mut stopped = false;
            free = free
                .iter()
                .zip(part.iter())
                .filter_map(|(&i, &p)| {
                    let inside = (x[i] + p).max(bounds.lower[i]).min(bounds.upper[i]);
                    let out = x[i] + p != inside;
                    step[i] = if out { inside - x[i] } else { p };
                    stopped |= out;
                    (!out).then_some(i)
                })
                .collect();
            if !stopped {
                break;
            }
        }
        step
    }
}

/// argmin |r + J p| over |p| ≤ radius.
fn within_ball(jacobian: &DMatrix<f64>, residual: &DVector<f64>, radius: f64) -> DVector<f64> {
    let largest = jacobian.column_iter().map(|c| c.norm()).fold(0.0, f64::max);
    // Never quite zero, so that a direction that is not seen has no step.
    let least = (UNSEEN * largest).powi(2).max(f64::MIN_POSITIVE);
    let qr = jacobian.clone().qr();
    let (r, target) = (qr.r(), qr.q().tr_mul(residual));
    let (mut step, mut slope) = damped(&r, &target, least);
    let mut length = step.norm();
    if length <= radius * (1.0 + ON_SURFACE) {
        return step;
    }
    let (mut low, mut high) = (least, (r.tr_mul(&target).norm() / radius).max(2.0 * least));
    let mut damping = least;
    for _ in 0..DAMPINGS {
        let newton = damping + (length - radius) / radius * (length / slope).powi(2);
        damping = if newton > low && newton < high { newton } else { (low * high).sqrt().max(1e-3 * high) };
        (step, slope) = damped(&r, &target, damping);
        length = step.norm();
        if (length - radius).abs() <= ON_SURFACE * radius {
            break;
        }
        if length > radius { low = damping } else { high = damping }
    }
    if length > radius { step * (radius / length) } else { step }
}

/// argmin |t + R p|² + μ|p|², and |L⁻¹p| with L Lᵀ = RᵀR + μ, from which Newton's step on |p| follows.
fn damped(r: &DMatrix<f64>, target: &DVector<f64>, damping: f64) -> (DVector<f64>, f64) {
    let count = r.ncols();
    let mut tall = DMatrix::zeros(r.nrows() + count, count);
    tall.view_mut((0, 0), (r.nrows(), count)).copy_from(r);
    for i in 0..count {
        tall[(r.nrows() + i, i)] = damping.sqrt();
    }
    let mut right = DVector::zeros(r.nrows() + count);
    right.rows_mut(0, r.nrows()).copy_from(target);
    let qr = tall.qr();
    qr.q_tr_mul(&mut right);
    let upper = qr.unpack_r();
    let mut step = -right.rows(0, count).clone_owned();
    upper.solve_upper_triangular_mut(&mut step);
    let mut slope = step.clone();
    upper.tr_solve_upper_triangular_mut(&mut slope);
    (step.clone(), slope.norm())
}
