//! Control by a computer: torques that are found at even instants, held, and late.

use crate::plant::Plant;

/// Two times closer than this share of the period are one.
const SAME: f64 = 1e-6;

/// How the computer samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Sampled {
    /// Time between instants, s.
    pub period: f64,
    /// Time from an instant until its torques act, s.
    pub delay: f64,
    /// Whether velocities are differences of positions; else they are measured.
    pub difference: bool,
    /// Steps of the motors' encoders, rad after the gear; zero where they are exact.
    pub resolution: Vec<f64>,
    /// Motor positions of the reference, on which the encoders' steps lie.
    pub motor_reference: Vec<f64>,
    /// Torques that act until the first instant's do, N m.
    pub held: Vec<f64>,
}

/// Sampled control as it goes on: what it has seen, and the torques that wait to act.
pub(crate) struct Computer<'a> {
    sampled: &'a Sampled,
    count: usize,
    seen: Option<Vec<f64>>,
    integrals: Vec<f64>,
    waiting: Vec<(f64, Vec<f64>)>,
    held: Vec<f64>,
}

impl<'a> Computer<'a> {
    /// Begins with the integrals of the state y.
    pub(crate) fn new(plant: &Plant, sampled: &'a Sampled, y: &[f64]) -> Self {
        let z = plant.bodies();
        let integrals = y[2 * z..2 * z + plant.law.integrating.len()].to_vec();
        Self { sampled, count: 0, seen: None, integrals, waiting: Vec::new(), held: sampled.held.clone() }
    }

    /// Torques that act from the instant `t` on, after what is due has been sampled.
    pub(crate) fn at(&mut self, plant: &Plant, t: f64, y: &[f64]) -> &[f64] {
        let near = SAME * self.sampled.period;
        if (t - self.sampled.period * self.count as f64).abs() <= near {
            let torque = self.sample(plant, y);
            self.waiting.push((t + self.sampled.delay, torque));
            self.count += 1;
        }
        while self.waiting.first().is_some_and(|(due, _)| *due <= t + near) {
            self.held = self.waiting.remove(0).1;
        }
        &self.held
    }

    /// Torques that act now.
    pub(crate) fn held(&self) -> &[f64] {
        &self.held
    }

    fn sample(&mut self, plant: &Plant, y: &[f64]) -> Vec<f64> {
        let (n, z, period) = (plant.n(), plant.bodies(), self.sampled.period);
        let mut position = y[..z].to_vec();
        let steps = self.sampled.resolution.iter().zip(&self.sampled.motor_reference);
        for (x, (step, reference)) in position[n..].iter_mut().zip(steps) {
            if *step > 0.0 {
                *x = ((*x + reference) / step).round() * step - reference;
            }
        }
        let velocity = match &self.seen {
            _ if !self.sampled.difference => y[z..2 * z].to_vec(),
            Some(seen) => position.iter().zip(seen).map(|(x, before)| (x - before) / period).collect(),
            None => vec![0.0; z],
        };
        for (k, held) in self.integrals.iter_mut().enumerate() {
            let row = &plant.law.integral[k * z..(k + 1) * z];
            *held += period * row.iter().zip(&position).map(|(gain, x)| gain * x).sum::<f64>();
        }
        let mut torque = vec![0.0; plant.motors.len()];
        plant.control(&position, &velocity, &self.integrals, &mut torque);
        self.seen = Some(position);
        torque
    }
}
