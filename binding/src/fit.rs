//! The fitting problem: residual and Jacobian as a small triangle.

use crate::convert::{array, numbers, raise};
use crate::response::{LinearSystem, impedances, points};
use armonic_core::fit::{Fit, Prior};
use armonic_core::least_squares::{Ending, Settings};
use armonic_core::residual::{self, Deviation, Target};
use nalgebra::Complex;
use numpy::{PyArrayDyn, PyReadonlyArrayDyn};
use pyo3::exceptions::{PyKeyboardInterrupt, PyValueError};
use pyo3::prelude::*;
use std::time::{Duration, Instant};

/// How often a long run looks whether somebody wants it to stop.
const PATIENCE: Duration = Duration::from_millis(50);

type Array<'py> = PyReadonlyArrayDyn<'py, f64>;
type Points<'py> = PyReadonlyArrayDyn<'py, Complex<f64>>;
/// System, points (L,), measured receptances (L, p, m), weights (L, p, m).
type TargetArgument<'py> = (PyRef<'py, LinearSystem>, Points<'py>, Points<'py>, Array<'py>);

/// One number, or several that have one value: indices into all stiffnesses, then all dampings.
#[derive(FromPyObject)]
enum Tied {
    One(usize),
    Several(Vec<usize>),
}

fn groups(free: Vec<Tied>) -> Vec<Vec<usize>> {
    free.into_iter()
        .map(|tied| match tied {
            Tied::One(index) => vec![index],
            Tied::Several(indices) => indices,
        })
        .collect()
}

/// Parameters, cost and price where a run ended, the parameters of the lowest price, the price after each evaluation,
/// and how it ended.
type DescentResult<'py> = (
    Bound<'py, PyArrayDyn<f64>>,
    f64,
    Bound<'py, PyArrayDyn<f64>>,
    f64,
    Bound<'py, PyArrayDyn<f64>>,
    &'static str,
);

/// Measured responses and the models that are to reproduce them, immutable.
#[pyclass(frozen, module = "armonic._core")]
pub struct Problem {
    inner: residual::Problem,
}

/// `[line][output][input]` to `[output][input][line]`.
fn lines_last<T: Copy>(values: &[T], lines: usize) -> Vec<T> {
    let pairs = values.len() / lines.max(1);
    (0..values.len()).map(|i| values[i % lines * pairs + i / lines]).collect()
}

#[pymethods]
impl Problem {
    #[new]
    #[pyo3(signature = (targets, *, prices = None, relative = false))]
    fn new(
        targets: Vec<TargetArgument<'_>>,
        prices: Option<Vec<Array<'_>>>,
        relative: bool,
    ) -> PyResult<Self> {
        let deviation = if relative { Deviation::Relative } else { Deviation::Logarithmic };
        if prices.as_ref().is_some_and(|prices| prices.len() != targets.len()) {
            return Err(PyValueError::new_err("prices: expected one array per target"));
        }
        let targets = targets
            .into_iter()
            .enumerate()
            .map(|(index, (system, s, measured, weights))| {
                let (p, m) = system.inner.shape();
                let s = points(&s)?;
                let shape = [Some(s.len()), Some(p), Some(m)];
                let measured = lines_last(&numbers("measured", &measured, &shape)?, s.len());
                let weights = lines_last(&numbers("weights", &weights, &shape)?, s.len());
                let prices = match &prices {
                    Some(prices) => lines_last(&numbers("prices", &prices[index], &shape)?, s.len()),
                    None => weights.clone(),
                };
                let target = Target::new(system.inner.clone(), &s, &measured, &weights, &prices);
                Ok(target.map_err(raise)?.with_deviation(deviation))
            })
            .collect::<PyResult<Vec<_>>>()?;
        Ok(Self { inner: residual::Problem::new(targets).map_err(raise)? })
    }

    /// Upper triangle (c+1, c+1) of [J r] at one impedance set, J by the logarithms of the `free` parameters, and the
    /// cost under the weights of the price.
    fn reduce_priced<'py>(
        &self,
        py: Python<'py>,
        stiffness: Array<'py>,
        damping: Array<'py>,
        free: Vec<Tied>,
    ) -> PyResult<(Bound<'py, PyArrayDyn<f64>>, f64)> {
        let sets = impedances(&stiffness, &damping)?;
        let [set] = &sets[..] else {
            return Err(PyValueError::new_err("stiffness: expected shape (1, r)"));
        };
        let free = groups(free);
        let triangle = py.detach(|| self.inner.reduce(set, &free)).map_err(raise)?;
        Ok((array(py, triangle.values, &[triangle.width, triangle.width])?, triangle.price))
    }

    /// Upper triangle (c+1, c+1) of [J r] at one impedance set, J by the logarithms of the `free` parameters.
    fn reduce<'py>(
        &self,
        py: Python<'py>,
        stiffness: Array<'py>,
        damping: Array<'py>,
        free: Vec<Tied>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        Ok(self.reduce_priced(py, stiffness, damping, free)?.0)
    }

    /// Bounded least squares from `start` (c,), logarithms of the `free` parameters; `priors` are (parameter, expected
    /// logarithm, one over its standard deviation). `watch` gets the evaluations so far and the lowest
    /// price before each evaluation.
    #[pyo3(signature = (stiffness, damping, free, start, lower, upper, *, priors, tolerance, evaluations, radius, watch))]
    #[allow(clippy::too_many_arguments)] // named in Python
    fn descend<'py>(
        &self,
        py: Python<'py>,
        stiffness: Array<'py>,
        damping: Array<'py>,
        free: Vec<Tied>,
        start: Array<'py>,
        lower: Array<'py>,
        upper: Array<'py>,
        priors: Vec<(usize, f64, f64)>,
        tolerance: f64,
        evaluations: usize,
        radius: f64,
        watch: Option<Py<PyAny>>,
    ) -> PyResult<DescentResult<'py>> {
        let mut sets = impedances(&stiffness, &damping)?;
        let (Some(set), true) = (sets.pop(), sets.is_empty()) else {
            return Err(PyValueError::new_err("stiffness: expected shape (1, r)"));
        };
        let shape = [None];
        let [start, lower, upper] = [("start", &start), ("lower", &lower), ("upper", &upper)]
            .map(|(name, values)| numbers(name, values, &shape));
        let (start, lower, upper) = (start?, lower?, upper?);
        let priors = priors.into_iter().map(|(parameter, mean, weight)| Prior { parameter, mean, weight });
        let fit = Fit { problem: &self.inner, impedances: set, free: groups(free), priors: priors.collect() };
        let settings = Settings { tolerance, evaluations, radius };
        let mut broken: Option<PyErr> = None;
        let (mut count, mut last) = (0_usize, Instant::now());
        let descent = py.detach(|| {
            fit.descend(&start, &lower, &upper, settings, |best| {
                let impatient = last.elapsed() >= PATIENCE;
                if impatient || watch.is_some() {
                    let heard = Python::attach(|py| {
                        if impatient {
                            last = Instant::now();
                            py.check_signals()?;
                        }
                        watch.as_ref().map_or(Ok(()), |watch| watch.call1(py, (count, best)).map(|_| ()))
                    });
                    broken = heard.err();
                }
                count += 1;
                broken.is_none()
            })
        });
        let descent = descent.map_err(raise)?;
        let ending = match (descent.ending, broken) {
            (_, Some(error)) if !error.is_instance_of::<PyKeyboardInterrupt>(py) => return Err(error),
            (Ending::Converged, _) => "converged",
            (Ending::Limit, _) => "limit",
            (Ending::Stopped, _) => "interrupted",
        };
        let as_array = |values: Vec<f64>| {
            let count = values.len();
            array(py, values, &[count])
        };
        Ok((
            as_array(descent.x)?,
            descent.cost,
            as_array(descent.best)?,
            descent.price,
            as_array(descent.history)?,
            ending,
        ))
    }

    /// Costs (P,) of many impedance sets; infinite where the model has no answer.
    fn costs<'py>(
        &self,
        py: Python<'py>,
        stiffness: Array<'py>,
        damping: Array<'py>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let sets = impedances(&stiffness, &damping)?;
        let costs = py.detach(|| self.inner.costs(&sets)).map_err(raise)?;
        let count = costs.len();
        array(py, costs, &[count])
    }
}
