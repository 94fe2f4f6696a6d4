//! A robot as it moves: links, springs, bushings, drives and their control as one first-order system ẏ = f(t, y).
//!
//! M(q) q̈ + b + g + D q̇ + springs + W k(W q − q_m) = Jᵀw and B q̈_m + D_m q̇_m − k(W q − q_m) = τ_m (Do et al. 2022,
//! Eqs. 1, 2 and 4), about a reference: y = [δq, δq_m, q̇, q̇_m, torques of integrators, work of the excitations, work of
//! the motors, what is dissipated]. Deviations, not coordinates, are integrated, so that small vibrations keep their digits.

use crate::bushing::{self, Bushing};
use crate::dynamics::{Workspace, composite_mass};
use crate::joint_law::{Drag, Spring};
use crate::mechanism::{Mechanism, finite};
use crate::spatial::{Wrench, angular, linear, stack};
use crate::waveform::Waveform;
use crate::{Error, Result};
use nalgebra::{DMatrix, Vector3};

/// States after the velocities and integrators: works of excitations and motors, dissipation.
pub const WORKS: usize = 3;

/// A coordinate that moves less than this share of its own inertia once the others are free moves no mass.
const PIVOT_FLOOR: f64 = 1e-13;

/// A wrench on a frame, with one course over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Excitation {
    /// Index of the frame at whose origin it acts.
    pub frame: usize,
    /// Force over moment per unit of the waveform.
    pub direction: Wrench,
    /// Whether the direction turns with the frame; else it is fixed in the world.
    pub own_axes: bool,
    /// How strong it is, and when.
    pub waveform: Waveform,
}

/// One motor behind a flexible shaft.
#[derive(Debug, Clone, PartialEq)]
pub struct Motor {
    /// Which of the moving coordinates it drives.
    pub coordinate: usize,
    /// w: one, or one over the characteristic radius, 1/m.
    pub scale: f64,
    /// Its shaft.
    pub shaft: Spring,
    /// Deflection w q − q_m of the shaft at the reference.
    pub deflection: f64,
    /// B, behind the gear, kg m².
    pub inertia: f64,
    /// What brakes the motor.
    pub drag: Drag,
}

/// Torques τ = feedforward − P δz − V ż − I ∫δz, z = [q; q_m]; matrices (motors × (n + motors)) by rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Law {
    /// Torque at the reference, N m.
    pub feedforward: Vec<f64>,
    /// P.
    pub position: Vec<f64>,
    /// V.
    pub velocity: Vec<f64>,
    /// I, a row per integrator.
    pub integral: Vec<f64>,
    /// The motors that have an integrator.
    pub integrating: Vec<usize>,
}

/// Everything that moves, and what moves it; immutable.
#[derive(Debug, Clone)]
pub struct Plant {
    /// The links.
    pub mechanism: Mechanism,
    /// All coordinates of the reference.
    pub reference: Vec<f64>,
    /// The n coordinates that move.
    pub moving: Vec<usize>,
    /// Springs on them, unloaded at the reference.
    pub springs: Vec<Spring>,
    /// What brakes them.
    pub drags: Vec<Drag>,
    /// Constant forces on them.
    pub preload: Vec<f64>,
    /// Springs between frames.
    pub bushings: Vec<Bushing>,
    /// The motors.
    pub motors: Vec<Motor>,
    /// Their control.
    pub law: Law,
    /// What acts from outside.
    pub excitations: Vec<Excitation>,
}

/// Scratch memory of one plant.
#[derive(Debug, Clone)]
pub struct Scratch {
    ws: Workspace,
    q: Vec<f64>,
    qd: Vec<f64>,
    still: Vec<f64>,
    force: Vec<f64>,
    mass: DMatrix<f64>,
    /// Joint torque of every motor as last applied.
    pub torque: Vec<f64>,
}

/// What the control does at an instant.
#[derive(Debug, Clone, Copy)]
pub enum Command<'a> {
    /// It follows its law from instant to instant.
    Continuous,
    /// It holds these torques.
    Held(&'a [f64]),
}

impl Plant {
    /// Checks that all parts fit.
    ///
    /// # Errors
    /// [`Error::Length`], [`Error::Index`], [`Error::Value`].
    pub fn check(&self) -> Result<()> {
        let (n, nm) = (self.n(), self.motors.len());
        self.mechanism.check("reference", &self.reference)?;
        let length = |what, needed, got| match needed == got {
            true => Ok(()),
            false => Err(Error::Length { what, needed, got }),
        };
        length("springs", n, self.springs.len())?;
        length("drags", n, self.drags.len())?;
        length("preload", n, self.preload.len())?;
        finite("preload", self.preload.iter().copied())?;
        length("feedforward", nm, self.law.feedforward.len())?;
        length("position gains", nm * (n + nm), self.law.position.len())?;
        length("velocity gains", nm * (n + nm), self.law.velocity.len())?;
        length("integral gains", self.law.integrating.len() * (n + nm), self.law.integral.len())?;
        let index = |what, count, got| match got < count {
            true => Ok(()),
            false => Err(Error::Index { what, count, got }),
        };
        self.moving.iter().try_for_each(|&c| index("moving coordinate", self.mechanism.n(), c))?;
        self.law.integrating.iter().try_for_each(|&i| index("integrating motor", nm, i))?;
        self.springs.iter().try_for_each(Spring::check)?;
        self.drags.iter().try_for_each(Drag::check)?;
        for motor in &self.motors {
            index("coordinate of a motor", n, motor.coordinate)?;
            motor.shaft.check()?;
            motor.drag.check()?;
            if !(motor.inertia > 0.0 && motor.inertia.is_finite()) {
                let expected = "a positive number";
                return Err(Error::Value { what: "inertia of a drive", got: motor.inertia, expected });
            }
        }
        for excitation in &self.excitations {
            self.mechanism.frame(excitation.frame)?;
            finite("direction", excitation.direction.iter().copied())?;
            excitation.waveform.check()?;
        }
        Ok(())
    }

    /// Number n of coordinates that move.
    pub fn n(&self) -> usize {
        self.moving.len()
    }

    /// Number of coordinates and motors.
    pub fn bodies(&self) -> usize {
        self.n() + self.motors.len()
    }

    /// Length of y.
    pub fn states(&self) -> usize {
        2 * self.bodies() + self.law.integrating.len() + WORKS
    }

    /// Memory for it.
    pub fn scratch(&self) -> Scratch {
        let all = self.mechanism.n();
        Scratch {
            ws: Workspace::new(&self.mechanism),
            q: self.reference.clone(),
            qd: vec![0.0; all],
            still: vec![0.0; all],
            force: vec![0.0; self.n()],
            mass: DMatrix::zeros(all, all),
            torque: vec![0.0; self.motors.len()],
        }
    }

    /// ẏ at time t, by the formulas that hold at the instant `within` the same piece of every waveform.
    ///
    /// # Errors
    /// [`Error::MassNotPositiveDefinite`].
    pub fn rates(
        &self,
        s: &mut Scratch,
        [t, within]: [f64; 2],
        y: &[f64],
        command: Command<'_>,
        out: &mut [f64],
    ) -> Result<()> {
        let (n, z) = (self.n(), self.bodies());
        let (position, rest) = y.split_at(z);
        let (velocity, rest) = rest.split_at(z);
        let integrators = &rest[..self.law.integrating.len()];
        self.place(s, position, velocity);
        let bushed = self.bushing_forces(s)?;
        s.ws.place(&self.mechanism, &s.q);
        s.ws.drive(&self.mechanism, &s.qd, &s.still, self.mechanism.gravity());
        let given = self.excite(s, t, within)?;
        self.link_forces(s, bushed.0.as_deref());
        let (mut lost, mut driven) = (bushed.1, 0.0);
        for i in 0..n {
            let (spring, drag) = (self.springs[i].torque(position[i]), self.drags[i].torque(velocity[i]));
            lost += drag * velocity[i];
            s.force[i] += self.preload[i] - spring - drag;
        }
        match command {
            Command::Continuous => self.control(position, velocity, integrators, &mut s.torque),
            Command::Held(torque) => s.torque.copy_from_slice(torque),
        }
        for (j, motor) in self.motors.iter().enumerate() {
            let shaft = motor.shaft.torque(self.twist(j, position));
            let drag = motor.drag.torque(velocity[n + j]);
            s.force[motor.coordinate] -= motor.scale * shaft;
            out[z + n + j] = (shaft + s.torque[j] - drag) / motor.inertia;
            lost += drag * velocity[n + j];
            driven += s.torque[j] * velocity[n + j];
        }
        composite_mass(&self.mechanism, &mut s.ws, &mut s.mass);
        self.solve(s, &mut out[z..z + n])?;
        out[..z].copy_from_slice(velocity);
        for (k, _) in self.law.integrating.iter().enumerate() {
            out[2 * z + k] = dot(&self.law.integral[k * z..(k + 1) * z], position);
        }
        out[2 * z + integrators.len()..].copy_from_slice(&[given, driven, lost]);
        Ok(())
    }

    /// Torques of the law at a deviation.
    pub fn control(&self, position: &[f64], velocity: &[f64], integrators: &[f64], torque: &mut [f64]) {
        let z = self.bodies();
        for (j, torque) in torque.iter_mut().enumerate() {
            let row = j * z..(j + 1) * z;
            *torque = self.law.feedforward[j]
                - dot(&self.law.position[row.clone()], position)
                - dot(&self.law.velocity[row], velocity);
        }
        for (&j, held) in self.law.integrating.iter().zip(integrators) {
            torque[j] -= held;
        }
    }

    /// Deflection of a shaft.
    pub fn twist(&self, j: usize, position: &[f64]) -> f64 {
        let motor = &self.motors[j];
        motor.deflection + motor.scale * position[motor.coordinate] - position[self.n() + j]
    }

    /// Kinetic and potential energy at a state, J; gravity counts from the world origin.
    ///
    /// # Errors
    /// As [`Self::rates`].
    pub fn energy(&self, s: &mut Scratch, y: &[f64]) -> Result<[f64; 2]> {
        let (n, z) = (self.n(), self.bodies());
        let (position, velocity) = (&y[..z], &y[z..2 * z]);
        self.place(s, position, velocity);
        let mut potential = 0.0;
        for bushing in &self.bushings {
            potential += bushing::energy(&self.mechanism, &mut s.ws, &s.q, bushing)?;
        }
        s.ws.place(&self.mechanism, &s.q);
        s.ws.drive(&self.mechanism, &s.qd, &s.still, &Vector3::zeros());
        let mut kinetic = 0.0;
        for (twist, inertia) in s.ws.twist.iter().zip(&s.ws.inertia) {
            kinetic += 0.5 * twist.dot(&inertia.momentum(twist));
            potential -= inertia.first.dot(self.mechanism.gravity());
        }
        for i in 0..n {
            potential += self.springs[i].energy(position[i]) - self.preload[i] * position[i];
        }
        for (j, motor) in self.motors.iter().enumerate() {
            kinetic += 0.5 * motor.inertia * velocity[n + j].powi(2);
            potential += motor.shaft.energy(self.twist(j, position));
        }
        Ok([kinetic, potential])
    }

    fn place(&self, s: &mut Scratch, position: &[f64], velocity: &[f64]) {
        for (i, &c) in self.moving.iter().enumerate() {
            s.q[c] = self.reference[c] + position[i];
            s.qd[c] = velocity[i];
        }
    }

    /// Forces of all bushings on all coordinates, and the power that they dissipate.
    fn bushing_forces(&self, s: &mut Scratch) -> Result<(Option<Vec<f64>>, f64)> {
        let (mut forces, mut lost) = (None::<Vec<f64>>, 0.0);
        for bushing in &self.bushings {
            let (force, power) = bushing::force_and_loss(&self.mechanism, &mut s.ws, &s.q, &s.qd, bushing)?;
            let sum = forces.get_or_insert_with(|| vec![0.0; force.len()]);
            sum.iter_mut().zip(force.iter()).for_each(|(sum, f)| *sum += f);
            lost += power;
        }
        Ok((forces, lost))
    }

    /// Puts the excitations on their links; the power that they give.
    fn excite(&self, s: &mut Scratch, t: f64, within: f64) -> Result<f64> {
        let mut given = 0.0;
        for excitation in &self.excitations {
            let value = excitation.waveform.value(t, within);
            let frame = self.mechanism.frame(excitation.frame)?;
            if let (Some(node), true) = (frame.node, value != 0.0) {
                let at = s.ws.frame_pose(&self.mechanism, excitation.frame)?;
                let (mut force, mut moment) = (linear(&excitation.direction), angular(&excitation.direction));
                if excitation.own_axes {
                    (force, moment) = (at.rotation * force, at.rotation * moment);
                }
                let wrench = stack(force, moment + at.translation.cross(&force)) * value;
                given += wrench.dot(&s.ws.twist[node]);
                s.ws.force[node] -= wrench;
            }
        }
        Ok(given)
    }

    /// Collects what gravity, motion and excitations ask of the moving coordinates, with the sign of a driving force.
    fn link_forces(&self, s: &mut Scratch, bushings: Option<&[f64]>) {
        for (i, node) in self.mechanism.nodes().iter().enumerate().rev() {
            if let Some(parent) = node.parent {
                let child = s.ws.force[i];
                s.ws.force[parent] += child;
            }
        }
        for (i, &c) in self.moving.iter().enumerate() {
            let node = self.mechanism.node_of(c);
            s.force[i] = -s.ws.axis[c].dot(&s.ws.force[node]) - bushings.map_or(0.0, |b| b[c]);
        }
    }

    /// Accelerations of the moving coordinates by an in-place Cholesky factorization.
    fn solve(&self, s: &mut Scratch, out: &mut [f64]) -> Result<()> {
        let (n, mass, moving) = (self.n(), &mut s.mass, &self.moving);
        for j in 0..n {
            let cj = moving[j];
            let size = mass[(cj, cj)];
            for k in 0..j {
                let ck = moving[k];
                mass[(cj, cj)] -= mass[(cj, ck)].powi(2);
            }
            // Rounding can leave a singular matrix a last pivot just above zero.
            if mass[(cj, cj)].is_nan() || mass[(cj, cj)] <= PIVOT_FLOOR * size {
                return Err(Error::MassNotPositiveDefinite);
            }
            mass[(cj, cj)] = mass[(cj, cj)].sqrt();
            for i in j + 1..n {
                let ci = moving[i];
                let mut entry = mass[(ci, cj)];
                for k in 0..j {
                    entry -= mass[(ci, moving[k])] * mass[(cj, moving[k])];
                }
                mass[(ci, cj)] = entry / mass[(cj, cj)];
            }
        }
        for i in 0..n {
            let mut sum = s.force[i];
            for k in 0..i {
                sum -= mass[(moving[i], moving[k])] * out[k];
            }
            out[i] = sum / mass[(moving[i], moving[i])];
        }
        for i in (0..n).rev() {
            let mut sum = out[i];
            for k in i + 1..n {
                sum -= mass[(moving[k], moving[i])] * out[k];
            }
            out[i] = sum / mass[(moving[i], moving[i])];
        }
        Ok(())
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
