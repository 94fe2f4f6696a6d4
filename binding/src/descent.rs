//! Bounded least squares as Python calls it: what listens on the way, and what comes back.

use crate::convert::{array, numbers};
use armonic_core::least_squares::{self, Answer, Descent, Ending, Settings};
use armonic_core::triangle::Triangle;
use numpy::{PyArrayDyn, PyReadonlyArrayDyn};
use pyo3::exceptions::{PyArithmeticError, PyKeyboardInterrupt, PyValueError};
use pyo3::prelude::*;
use std::time::{Duration, Instant};

/// How often a long run looks whether somebody wants it to stop.
const PATIENCE: Duration = Duration::from_millis(50);

type Array<'py> = PyReadonlyArrayDyn<'py, f64>;

/// Parameters, cost and price where a run ended, the parameters of the lowest price, the price after each evaluation,
/// and how it ended.
pub type DescentResult<'py> = (
    Bound<'py, PyArrayDyn<f64>>,
    f64,
    Bound<'py, PyArrayDyn<f64>>,
    f64,
    Bound<'py, PyArrayDyn<f64>>,
    &'static str,
);

/// Hears of every evaluation; stops the run for Ctrl-C and for whatever `watch` raises.
pub struct Listener {
    watch: Option<Py<PyAny>>,
    evaluations: usize,
    last: Instant,
    broken: Option<PyErr>,
}

impl Listener {
    pub fn new(watch: Option<Py<PyAny>>) -> Self {
        Self { watch, evaluations: 0, last: Instant::now(), broken: None }
    }

    /// Whether to go on to the next evaluation.
    pub fn go_on(&mut self, best: f64) -> bool {
        let impatient = self.last.elapsed() >= PATIENCE;
        if impatient || self.watch.is_some() {
            let heard = Python::attach(|py| {
                if impatient {
                    self.last = Instant::now();
                    py.check_signals()?;
                }
                let told = (self.evaluations, best);
                self.watch.as_ref().map_or(Ok(()), |watch| watch.call1(py, told).map(|_| ()))
            });
            self.broken = heard.err();
        }
        self.evaluations += 1;
        self.broken.is_none()
    }

    /// The run as Python gets it; an exception other than Ctrl-C comes out.
    pub fn result<'py>(self, py: Python<'py>, descent: Descent) -> PyResult<DescentResult<'py>> {
        let ending = match (descent.ending, self.broken) {
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
}

/// Start and bounds, (c,) each.
pub fn box_of(
    start: &Array<'_>,
    lower: &Array<'_>,
    upper: &Array<'_>,
) -> PyResult<(Vec<f64>, Vec<f64>, Vec<f64>)> {
    let start = numbers("start", start, &[None])?;
    let shape = [Some(start.len())];
    Ok((start, numbers("lower", lower, &shape)?, numbers("upper", upper, &shape)?))
}

/// Bounded least squares over the triangles, (c+1, c+1), that `triangle` returns at x (c,); an ArithmeticError of it, or
/// a number that is not finite, says that there is no answer there.
#[pyfunction]
#[pyo3(signature = (triangle, start, lower, upper, *, tolerance, evaluations, radius, watch))]
#[allow(clippy::too_many_arguments)] // named in Python
pub fn descend<'py>(
    py: Python<'py>,
    triangle: &Bound<'py, PyAny>,
    start: Array<'py>,
    lower: Array<'py>,
    upper: Array<'py>,
    tolerance: f64,
    evaluations: usize,
    radius: f64,
    watch: Option<Py<PyAny>>,
) -> PyResult<DescentResult<'py>> {
    let (start, lower, upper) = box_of(&start, &lower, &upper)?;
    let mut listener = Listener::new(watch);
    let evaluate = |x: &[f64], best: f64| {
        if !listener.go_on(best) {
            return Ok(Answer::Stop);
        }
        match triangle.call1((array(py, x.to_vec(), &[x.len()])?,)) {
            Ok(found) => answer(&found, x.len() + 1),
            Err(error) if error.is_instance_of::<PyArithmeticError>(py) => Ok(Answer::Nowhere),
            Err(error) if error.is_instance_of::<PyKeyboardInterrupt>(py) => Ok(Answer::Stop),
            Err(error) => Err(error),
        }
    };
    let settings = Settings { tolerance, evaluations, radius };
    let descent = least_squares::descend(evaluate, &start, &lower, &upper, settings)?;
    listener.result(py, descent)
}

fn answer(found: &Bound<'_, PyAny>, width: usize) -> PyResult<Answer> {
    let found: Array<'_> =
        found.extract().map_err(|_| PyValueError::new_err("triangle: expected an array of float64"))?;
    let values = numbers("triangle", &found, &[Some(width), Some(width)])?;
    if !values.iter().all(|value| value.is_finite()) {
        return Ok(Answer::Nowhere);
    }
    Ok(Answer::Here(Triangle::priced_by_itself(width, values)))
}
