//! The fitting problem: residual and Jacobian as a small triangle.

use crate::convert::{array, numbers, raise};
use crate::descent::{DescentResult, Listener, box_of};
use crate::response::{LinearSystem, impedances, points};
use armonic_core::fit::{Fit, Prior};
use armonic_core::least_squares::Settings;
use armonic_core::residual::{self, Deviation, Target};
use nalgebra::Complex;
use numpy::{PyArrayDyn, PyReadonlyArrayDyn};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

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

    /// Upper triangle (c+1, c+1) of [J r] at one impedance set, J by the logarithms of the `free` parameters.
    fn reduce<'py>(
        &self,
        py: Python<'py>,
        stiffness: Array<'py>,
        damping: Array<'py>,
        free: Vec<Tied>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let sets = impedances(&stiffness, &damping)?;
        let [set] = &sets[..] else {
            return Err(PyValueError::new_err("stiffness: expected shape (1, r)"));
        };
        let free = groups(free);
        let triangle = py.detach(|| self.inner.reduce(set, &free)).map_err(raise)?;
        array(py, triangle.values, &[triangle.width, triangle.width])
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
        let (start, lower, upper) = box_of(&start, &lower, &upper)?;
        let priors = priors.into_iter().map(|(parameter, mean, weight)| Prior { parameter, mean, weight });
        let fit = Fit { problem: &self.inner, impedances: set, free: groups(free), priors: priors.collect() };
        let settings = Settings { tolerance, evaluations, radius };
        let mut listener = Listener::new(watch);
        let descent =
            py.detach(|| fit.descend(&start, &lower, &upper, settings, |best| listener.go_on(best)));
        listener.result(py, descent.map_err(raise)?)
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
