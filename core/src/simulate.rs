//! Time integration of a plant: from break to break of its excitations and its control, with dense output at even samples.
//!
//! The steps are those of a library: Dormand and Prince's method of order 8 with its interpolant of order 7 (Hairer,
//! Nørsett and Wanner 1993, II.5 and II.6).

use crate::plant::{Command, Plant, Scratch, WORKS};
use crate::sampled_control::{Computer, Sampled};
use crate::{Error, Result};
use differential_equations::error::Error as Refusal;
use differential_equations::interpolate::Interpolation;
use differential_equations::methods::ExplicitRungeKutta;
use differential_equations::ode::{ODE, OrdinaryNumericalMethod};
use std::cell::RefCell;

/// A deviation, rad or m, that no robot reaches: the run has left the model.
const BEYOND: f64 = 1e3;
/// Steps without an end in sight of one piece of a run.
const MOST_STEPS: usize = 50_000_000;
/// A step may be shortened to this share of itself to meet a sample, where no interpolant comes between.
const LANDS: f64 = 0.75;
/// Two instants closer than this share of the sampling time are one.
const SAME: f64 = 1e-9;

/// How a run is done.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Time between samples, s; the first is at zero.
    pub step: f64,
    /// Number of samples.
    pub samples: usize,
    /// The longest step that explicit methods try, s; infinite if nothing is known.
    pub longest: f64,
    /// Relative tolerance of a step.
    pub relative: f64,
    /// Absolute tolerance of each state.
    pub absolute: Vec<f64>,
    /// A computer as control.
    pub sampled: Option<Sampled>,
}

/// How a run came to its end.
#[derive(Debug, Clone, PartialEq)]
pub enum Ending {
    /// At its last sample.
    Complete,
    /// A coordinate or motor left all bounds.
    Diverged {
        /// When.
        time: f64,
        /// Which of the coordinates, then motors.
        body: usize,
    },
    /// The steps became too short to go on.
    Stalled {
        /// When.
        time: f64,
    },
    /// The listener wanted no more.
    Stopped {
        /// When.
        time: f64,
    },
}

/// A run.
#[derive(Debug, Clone)]
pub struct Run {
    /// Rows of [`row_length`] numbers, one per sample that was reached.
    pub rows: Vec<f64>,
    /// How it ended.
    pub ending: Ending,
    /// Steps taken.
    pub steps: usize,
    /// Steps taken back.
    pub rejected: usize,
    /// Evaluations of ẏ by the integration.
    pub evaluations: usize,
}

/// Numbers of a row: y without integrators and works, accelerations, torques of springs, shafts and motors, values of the
/// excitations, kinetic and potential energy, work of excitations and motors, dissipation.
pub fn row_length(plant: &Plant) -> usize {
    3 * plant.bodies() + plant.n() + 2 * plant.motors.len() + plant.excitations.len() + 2 + WORKS
}

/// The plant as the library asks for it.
struct Equations<'a> {
    plant: &'a Plant,
    within: f64,
    held: Option<&'a [f64]>,
    scratch: &'a RefCell<Scratch>,
}

impl Equations<'_> {
    fn command(&self) -> Command<'_> {
        self.held.map_or(Command::Continuous, Command::Held)
    }
}

impl ODE<f64, Vec<f64>> for Equations<'_> {
    fn diff(&self, t: f64, y: &Vec<f64>, out: &mut Vec<f64>) {
        let scratch = &mut self.scratch.borrow_mut();
        if self.plant.rates(scratch, [t, self.within], y, self.command(), out).is_err() {
            // A step that comes here is taken back and tried shorter.
            out.fill(f64::NAN);
        }
    }
}

/// Runs a plant from a state; `go_on` hears the time now and then and may end the run.
///
/// # Errors
/// Those of [`Plant::check`], [`Error::Length`], [`Error::Value`], [`Error::MassNotPositiveDefinite`] at the start.
pub fn simulate(
    plant: &Plant,
    start: &[f64],
    settings: &Settings,
    go_on: &mut dyn FnMut(f64) -> bool,
) -> Result<Run> {
    plant.check()?;
    for (what, got) in [("start", start.len()), ("absolute tolerances", settings.absolute.len())] {
        if got != plant.states() {
            return Err(Error::Length { what, needed: plant.states(), got });
        }
    }
    crate::mechanism::finite("start", start.iter().copied())?;
    if let Some(sampled) = &settings.sampled {
        let lengths = [
            ("encoder steps", sampled.resolution.len()),
            ("motor reference", sampled.motor_reference.len()),
            ("held torques", sampled.held.len()),
        ];
        for (what, got) in lengths {
            if got != plant.motors.len() {
                return Err(Error::Length { what, needed: plant.motors.len(), got });
            }
        }
    }
    let breaks = breaks(plant, settings);
    let mut walk = Walk {
        plant,
        settings,
        scratch: RefCell::new(plant.scratch()),
        y: start.to_vec(),
        step: 0.0,
        sampled: 0,
        run: Run { rows: Vec::new(), ending: Ending::Complete, steps: 0, rejected: 0, evaluations: 0 },
    };
    walk.run.rows.reserve(settings.samples * row_length(plant));
    let mut computer = settings.sampled.as_ref().map(|sampled| Computer::new(plant, sampled, start));
    for piece in breaks.windows(2) {
        let held = computer.as_mut().map(|computer| computer.at(plant, piece[0], &walk.y).to_vec());
        if let Some(ending) = walk.cross(piece[0], piece[1], held.as_deref(), go_on)? {
            walk.run.ending = ending;
            return Ok(walk.run);
        }
    }
    // The last sample sees the forces as they are just before.
    let [from, to] = [breaks[breaks.len() - 2], breaks[breaks.len() - 1]];
    let held = computer.as_ref().map(Computer::held);
    let equations = Equations { plant, within: 0.5 * (from + to), held, scratch: &walk.scratch };
    while walk.sampled < settings.samples {
        walk.run.rows.extend(row(&equations, to, &walk.y)?);
        walk.sampled += 1;
    }
    Ok(walk.run)
}

/// A run as it goes on.
struct Walk<'a> {
    plant: &'a Plant,
    settings: &'a Settings,
    scratch: RefCell<Scratch>,
    y: Vec<f64>,
    /// Length of the next step; zero before the first.
    step: f64,
    /// Samples that were reached.
    sampled: usize,
    run: Run,
}

impl Walk<'_> {
    /// Integrates over one piece; the method begins anew there, with the step that it had.
    fn cross(
        &mut self,
        from: f64,
        to: f64,
        held: Option<&[f64]>,
        go_on: &mut dyn FnMut(f64) -> bool,
    ) -> Result<Option<Ending>> {
        let (plant, settings) = (self.plant, self.settings);
        let near = SAME * settings.step;
        let equations = Equations { plant, within: 0.5 * (from + to), held, scratch: &self.scratch };
        while self.sampled < settings.samples && self.instant() <= from + near {
            self.run.rows.extend(row(&equations, from, &self.y)?);
            self.sampled += 1;
        }
        let mut method = ExplicitRungeKutta::dop853()
            .rtol(settings.relative)
            .atol(settings.absolute.clone())
            .h_max(settings.longest)
            .max_steps(MOST_STEPS)
            .h0(self.step.min(to - from));
        let begun = method.init(&equations, from, to, &self.y).map_err(|_| Error::MassNotPositiveDefinite)?;
        self.run.evaluations += begun.function;
        while to - method.t() > 0.5 * near {
            if !go_on(method.t()) {
                return Ok(Some(Ending::Stopped { time: method.t() }));
            }
            let (before, left) = (method.t(), to - method.t());
            if method.h() > left * (1.0 - 1e-9) {
                method.set_h(left);
            } else {
                self.step = method.h();
                method.set_h(self.landing(before));
            }
            self.run.steps += 1;
            match method.step(&equations) {
                Ok(evaluations) => self.run.evaluations += evaluations.function,
                // It only warns that steps are as long as stability allows, and goes on when asked again.
                Err(Refusal::Stiffness { .. }) => continue,
                Err(_) => return Ok(Some(Ending::Stalled { time: before })),
            }
            if method.t() == before {
                self.run.rejected += 1;
                self.step = method.h();
                if self.step < 1e-14 * (1.0 + before) {
                    return Ok(Some(Ending::Stalled { time: before }));
                }
                continue;
            }
            let bodies = &method.y()[..plant.bodies()];
            if let Some(body) = bodies.iter().position(|x| x.is_nan() || x.abs() > BEYOND) {
                return Ok(Some(Ending::Diverged { time: method.t(), body }));
            }
            let mut slopes = None;
            while self.sampled < settings.samples && self.instant() < f64::min(method.t() + near, to - near) {
                let t = self.instant();
                let landed = (method.t() - t).abs() <= near;
                let state = if landed {
                    method.y().clone()
                } else {
                    let slopes = slopes.get_or_insert_with(|| {
                        self.run.evaluations += 2;
                        slopes_of(&equations, &method)
                    });
                    between(&mut method, slopes, t).map_err(|_| Error::MassNotPositiveDefinite)?
                };
                self.run.rows.extend(row(&equations, t, &state)?);
                self.sampled += 1;
            }
        }
        self.y.clone_from(method.y());
        Ok(None)
    }

    /// The step to take: a little shorter than the method would have it where the next sample is then met exactly.
    fn landing(&self, now: f64) -> f64 {
        let due = self.instant() - now;
        let even = due / (due / self.step - 1e-9).ceil().max(1.0);
        if even > LANDS * self.step && even <= self.step { even } else { self.step }
    }

    /// When the next sample is due.
    fn instant(&self) -> f64 {
        self.settings.step * self.sampled as f64
    }
}

/// Sum of ẏ at both ends of the step just taken.
fn slopes_of(equations: &Equations<'_>, method: &impl OrdinaryNumericalMethod<f64, Vec<f64>>) -> Vec<f64> {
    let (mut sum, mut other) = (vec![0.0; method.y().len()], vec![0.0; method.y().len()]);
    equations.diff(method.t_prev(), method.y_prev(), &mut sum);
    equations.diff(method.t(), method.y(), &mut other);
    sum.iter_mut().zip(&other).for_each(|(sum, other)| *sum += other);
    sum
}

/// y within the step just taken.
///
/// The interpolant is y(θ) = H(θ) + θ²(1 − θ)² C(θ) with Hermite's cubic H, but the library (0.7.0) takes C at 1 − θ. So
/// it is asked for the mirrored instant, and its cubic is exchanged for the right one: with Δ = y₁ − y₀,
/// H(θ) − H(1 − θ) = (2θ − 1) [Δ + θ (1 − θ) (2Δ − h (ẏ₀ + ẏ₁))].
fn between<M>(method: &mut M, slopes: &[f64], t: f64) -> std::result::Result<Vec<f64>, Refusal<f64, Vec<f64>>>
where
    M: OrdinaryNumericalMethod<f64, Vec<f64>> + Interpolation<f64, Vec<f64>>,
{
    let (from, to) = (method.t_prev(), method.t());
    let (h, theta) = (to - from, (t - from) / (to - from));
    let mut y = method.interpolate((from + (to - t)).clamp(from, to))?;
    for (i, y) in y.iter_mut().enumerate() {
        let rise = method.y()[i] - method.y_prev()[i];
        *y += (2.0 * theta - 1.0) * (rise + theta * (1.0 - theta) * (2.0 * rise - h * slopes[i]));
    }
    Ok(y)
}

/// Instants where an excitation or the control jumps, with both ends of the run, each once and in order; on the samples
/// that they nearly meet.
fn breaks(plant: &Plant, settings: &Settings) -> Vec<f64> {
    let last = settings.step * (settings.samples.max(1) - 1) as f64;
    let mut breaks: Vec<f64> = plant.excitations.iter().flat_map(|e| e.waveform.breaks()).collect();
    if let Some(sampled) = &settings.sampled {
        let count = (last / sampled.period) as usize + 1;
        let instants = (0..count).map(|k| sampled.period * k as f64);
        breaks.extend(instants.flat_map(|t| [t, t + sampled.delay]));
    }
    let near = SAME * settings.step;
    for t in &mut breaks {
        let sample = (*t / settings.step).round() * settings.step;
        if (*t - sample).abs() <= near {
            *t = sample;
        }
    }
    breaks.retain(|t| (near..last - near).contains(t));
    breaks.extend([0.0, last.max(near * 10.0)]);
    breaks.sort_by(f64::total_cmp);
    breaks.dedup_by(|b, a| *b - *a <= near);
    breaks
}

/// What is kept of an instant: see [`row_length`].
///
/// # Errors
/// [`Error::MassNotPositiveDefinite`], [`Error::Length`].
pub fn record(plant: &Plant, [t, within]: [f64; 2], y: &[f64]) -> Result<Vec<f64>> {
    if y.len() != plant.states() {
        return Err(Error::Length { what: "state", needed: plant.states(), got: y.len() });
    }
    row(&Equations { plant, within, held: None, scratch: &RefCell::new(plant.scratch()) }, t, y)
}

fn row(equations: &Equations<'_>, t: f64, y: &[f64]) -> Result<Vec<f64>> {
    let plant = equations.plant;
    let (n, z) = (plant.n(), plant.bodies());
    let scratch = &mut equations.scratch.borrow_mut();
    let mut rates = vec![0.0; y.len()];
    plant.rates(scratch, [t, equations.within], y, equations.command(), &mut rates)?;
    let mut row = Vec::with_capacity(row_length(plant));
    row.extend_from_slice(&y[..2 * z]);
    row.extend_from_slice(&rates[z..2 * z]);
    row.extend((0..n).map(|i| plant.springs[i].torque(y[i])));
    row.extend((0..plant.motors.len()).map(|j| plant.motors[j].shaft.torque(plant.twist(j, &y[..z]))));
    row.extend_from_slice(&scratch.torque);
    row.extend(plant.excitations.iter().map(|e| e.waveform.value(t, equations.within)));
    row.extend_from_slice(&plant.energy(scratch, y)?);
    row.extend_from_slice(&y[y.len() - WORKS..]);
    Ok(row)
}
