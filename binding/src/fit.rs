//! The fitting problem: residual and Jacobian as a small triangle.

use crate::convert::{array, numbers, raise};
use crate::response::{LinearSystem, impedances, points};
use armonic_core::residual::{self, Target};
use nalgebra::Complex;
use numpy::{PyArrayDyn, PyReadonlyArrayDyn};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

type Array<'py> = PyReadonlyArrayDyn<'py, f64>;
type Points<'py> = PyReadonlyArrayDyn<'py, Complex<f64>>;
/// System, points (L,), measured receptances (L, p, m), weights (L, p, m).
type TargetArgument<'py> = (PyRef<'py, LinearSystem>, Points<'py>, Points<'py>, Array<'py>);

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
    #[pyo3(signature = (targets, *, prices = None))]
    fn new(targets: Vec<TargetArgument<'_>>, prices: Option<Vec<Array<'_>>>) -> PyResult<Self> {
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
                Target::new(system.inner.clone(), &s, &measured, &weights, &prices).map_err(raise)
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
        free: Vec<usize>,
    ) -> PyResult<(Bound<'py, PyArrayDyn<f64>>, f64)> {
        let sets = impedances(&stiffness, &damping)?;
        let [set] = &sets[..] else {
            return Err(PyValueError::new_err("stiffness: expected shape (1, r)"));
        };
        let triangle = py.detach(|| self.inner.reduce(set, &free)).map_err(raise)?;
        Ok((array(py, triangle.values, &[triangle.width, triangle.width])?, triangle.price))
    }

    /// Upper triangle (c+1, c+1) of [J r] at one impedance set, J by the logarithms of the `free` parameters.
    fn reduce<'py>(
        &self,
        py: Python<'py>,
        stiffness: Array<'py>,
        damping: Array<'py>,
        free: Vec<usize>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        Ok(self.reduce_priced(py, stiffness, damping, free)?.0)
    }

    /// Costs (P,) of many impedance sets.
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
