//! Runs in time as Python calls them: the plant from its tables, and what a run gives back.

use crate::convert::{array, numbers, raise};
use crate::mechanism::{Bushing, Mechanism};
use armonic_core::joint_law::{Drag, Spring};
use armonic_core::plant::{self, Command, Excitation, Law, Motor};
use armonic_core::sampled_control::Sampled;
use armonic_core::simulate::{self, Ending, Settings, row_length};
use armonic_core::spatial::Wrench;
use armonic_core::waveform::Waveform;
use numpy::{PyArrayDyn, PyReadonlyArrayDyn};
use pyo3::exceptions::{PyKeyboardInterrupt, PyValueError};
use pyo3::prelude::*;
use std::time::{Duration, Instant};

/// How often a long run looks whether somebody wants it to stop, and says how far it is.
const PATIENCE: Duration = Duration::from_millis(50);

type Array<'py> = PyReadonlyArrayDyn<'py, f64>;
type Out<'py> = PyResult<Bound<'py, PyArrayDyn<f64>>>;
/// Frame, direction, own axes, kind of waveform, its numbers, its samples.
type ExcitationArgument = (usize, [f64; 6], bool, String, Vec<f64>, Vec<f64>);
/// Period, delay, velocities by differences, encoder steps, motor positions of the reference, torques at the start.
type SampledArgument = (f64, f64, bool, Vec<f64>, Vec<f64>, Vec<f64>);
/// Rows, ending, time and body of it, steps, steps taken back, evaluations.
type RunResult<'py> = (Bound<'py, PyArrayDyn<f64>>, &'static str, f64, usize, usize, usize, usize);

/// A robot as it moves, immutable.
#[pyclass(frozen, module = "armonic._core")]
pub struct Plant {
    inner: plant::Plant,
}

#[pymethods]
impl Plant {
    /// Tables with a row per moving coordinate, per motor and per integrator.
    #[new]
    #[pyo3(signature = (mechanism, *, reference, moving, springs, drags, preload, bushings, motors, feedforward,
        position, velocity, integral, integrating, excitations))]
    #[allow(clippy::too_many_arguments)] // named in Python
    fn new(
        mechanism: &Mechanism,
        reference: Array<'_>,
        moving: Vec<usize>,
        springs: Array<'_>,
        drags: Array<'_>,
        preload: Array<'_>,
        bushings: Vec<PyRef<'_, Bushing>>,
        motors: Array<'_>,
        feedforward: Array<'_>,
        position: Array<'_>,
        velocity: Array<'_>,
        integral: Array<'_>,
        integrating: Vec<usize>,
        excitations: Vec<ExcitationArgument>,
    ) -> PyResult<Self> {
        let n = Some(moving.len());
        let table =
            |name: &str, values: &Array<'_>, rows, columns| numbers(name, values, &[rows, Some(columns)]);
        let springs = table("springs", &springs, n, 3)?;
        let drags = table("drags", &drags, n, 3)?;
        let motors = table("motors", &motors, None, 10)?;
        let count = motors.len() / 10;
        let width = moving.len() + count;
        let law = Law {
            feedforward: numbers("feedforward", &feedforward, &[Some(count)])?,
            position: table("position", &position, Some(count), width)?,
            velocity: table("velocity", &velocity, Some(count), width)?,
            integral: table("integral", &integral, Some(integrating.len()), width)?,
            integrating,
        };
        let inner = plant::Plant {
            mechanism: mechanism.inner.clone(),
            reference: numbers("reference", &reference, &[None])?,
            springs: springs.chunks_exact(3).map(spring).collect(),
            drags: drags.chunks_exact(3).map(drag).collect(),
            preload: numbers("preload", &preload, &[n])?,
            moving,
            bushings: bushings.iter().map(|b| b.inner.clone()).collect(),
            motors: motors.chunks_exact(10).map(motor).collect(),
            law,
            excitations: excitations.into_iter().map(excitation).collect::<PyResult<_>>()?,
        };
        inner.check().map_err(raise)?;
        Ok(Self { inner })
    }

    /// ẏ at a time, (states,), by the formulas of the excitations that hold at `within`.
    fn rates<'py>(&self, py: Python<'py>, t: f64, y: Array<'py>, within: f64) -> Out<'py> {
        let y = numbers("y", &y, &[Some(self.inner.states())])?;
        let mut out = vec![0.0; y.len()];
        let scratch = &mut self.inner.scratch();
        self.inner.rates(scratch, [t, within], &y, Command::Continuous, &mut out).map_err(raise)?;
        array(py, out, &[y.len()])
    }

    /// What a run keeps of an instant, (numbers,).
    fn record<'py>(&self, py: Python<'py>, t: f64, y: Array<'py>, within: f64) -> Out<'py> {
        let y = numbers("y", &y, &[None])?;
        let row = simulate::record(&self.inner, [t, within], &y).map_err(raise)?;
        let width = row.len();
        array(py, row, &[width])
    }

    /// Instants at which an excitation jumps or bends, in no order.
    fn breaks(&self) -> Vec<f64> {
        self.inner.excitations.iter().flat_map(|e| e.waveform.breaks()).collect()
    }

    /// Number of states.
    #[getter]
    fn states(&self) -> usize {
        self.inner.states()
    }

    /// Runs it from y (states,); `progress` hears the time and may raise to end the run.
    #[pyo3(signature = (start, *, longest, step, samples, relative, absolute, sampled, progress))]
    #[allow(clippy::too_many_arguments)] // named in Python
    fn run<'py>(
        &self,
        py: Python<'py>,
        start: Array<'py>,
        longest: f64,
        step: f64,
        samples: usize,
        relative: f64,
        absolute: Array<'py>,
        sampled: Option<SampledArgument>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<RunResult<'py>> {
        let start = numbers("start", &start, &[None])?;
        let sampled = sampled.map(|(period, delay, difference, resolution, motor_reference, held)| Sampled {
            period,
            delay,
            difference,
            resolution,
            motor_reference,
            held,
        });
        let absolute = numbers("absolute", &absolute, &[None])?;
        let settings = Settings { longest, step, samples, relative, absolute, sampled };
        let mut broken = None;
        let run = py.detach(|| {
            let mut last = Instant::now();
            let mut go_on = |time: f64| {
                if last.elapsed() < PATIENCE {
                    return true;
                }
                last = Instant::now();
                let heard = Python::attach(|py| {
                    py.check_signals()?;
                    progress.as_ref().map_or(Ok(()), |progress| progress.call1(py, (time,)).map(|_| ()))
                });
                broken = heard.err();
                broken.is_none()
            };
            simulate::simulate(&self.inner, &start, &settings, &mut go_on)
        });
        if let Some(error) = broken.filter(|e| !e.is_instance_of::<PyKeyboardInterrupt>(py)) {
            return Err(error);
        }
        let run = run.map_err(raise)?;
        let (ending, time, body) = match run.ending {
            Ending::Complete => ("complete", step * (samples.max(1) - 1) as f64, 0),
            Ending::Diverged { time, body } => ("diverged", time, body),
            Ending::Stalled { time } => ("stalled", time, 0),
            Ending::Stopped { time } => ("interrupted", time, 0),
        };
        let width = row_length(&self.inner);
        let shape = [run.rows.len() / width, width];
        Ok((array(py, run.rows, &shape)?, ending, time, body, run.steps, run.rejected, run.evaluations))
    }
}

fn spring(row: &[f64]) -> Spring {
    Spring { stiffness: row[0], cubic: row[1], gap: row[2] }
}

fn drag(row: &[f64]) -> Drag {
    Drag { damping: row[0], dry: row[1], speed: row[2] }
}

fn motor(row: &[f64]) -> Motor {
    Motor {
        coordinate: row[0] as usize,
        scale: row[1],
        shaft: spring(&row[2..5]),
        deflection: row[5],
        inertia: row[6],
        drag: drag(&row[7..10]),
    }
}

fn excitation((frame, direction, own_axes, kind, n, values): ExcitationArgument) -> PyResult<Excitation> {
    let wanted = match kind.as_str() {
        "constant" | "half-sine" => 3,
        "sine" => 5,
        "sweep" => 6,
        "samples" => 2,
        other => return Err(PyValueError::new_err(format!("excitation: found kind {other:?}"))),
    };
    if n.len() != wanted || (kind == "samples" && values.len() < 2) {
        return Err(PyValueError::new_err(format!("excitation: expected {wanted} numbers for {kind}")));
    }
    let waveform = match kind.as_str() {
        "constant" => Waveform::Constant { start: n[0], end: n[1], value: n[2] },
        "half-sine" => Waveform::HalfSine { start: n[0], end: n[1], peak: n[2] },
        "sine" => Waveform::Sine { start: n[0], end: n[1], amplitude: n[2], freq_hz: n[3], phase: n[4] },
        "sweep" => {
            let (freq_hz, logarithmic) = ([n[3], n[4]], n[5] != 0.0);
            Waveform::Sweep { start: n[0], end: n[1], amplitude: n[2], freq_hz, logarithmic }
        }
        _ => Waveform::Samples { start: n[0], step: n[1], values },
    };
    Ok(Excitation { frame, direction: Wrench::from_column_slice(&direction), own_axes, waveform })
}
