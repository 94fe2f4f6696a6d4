//! What acts in a joint besides a linear spring and damper: hardening, backlash and dry friction.

use crate::mechanism::finite;
use crate::{Error, Result};

/// Torque k x + c x³ of a deflection, of which the first `gap` is free play; x = e − e clamped to ± gap / 2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spring {
    /// k, N m/rad or N/m.
    pub stiffness: f64,
    /// c, N m/rad³ or N/m³.
    pub cubic: f64,
    /// Free play from stop to stop, rad or m.
    pub gap: f64,
}

impl Spring {
    /// Refuses numbers that make no spring.
    ///
    /// # Errors
    /// [`Error::Value`].
    pub fn check(&self) -> Result<()> {
        finite("spring", [self.stiffness, self.cubic, self.gap])?;
        if self.gap < 0.0 {
            return Err(Error::Value { what: "backlash", got: self.gap, expected: "zero or more" });
        }
        Ok(())
    }

    fn stretch(&self, deflection: f64) -> f64 {
        let half = 0.5 * self.gap;
        deflection - deflection.clamp(-half, half)
    }

    /// Torque that resists the deflection.
    pub fn torque(&self, deflection: f64) -> f64 {
        let x = self.stretch(deflection);
        x * (self.stiffness + self.cubic * x * x)
    }

    /// Energy that it holds, J.
    pub fn energy(&self, deflection: f64) -> f64 {
        let x = self.stretch(deflection);
        0.5 * x * x * (self.stiffness + 0.5 * self.cubic * x * x)
    }
}

/// Drag d v + c tanh(v / v₀): viscous, and dry friction rounded off where the motion turns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drag {
    /// d, N m s/rad or N s/m.
    pub damping: f64,
    /// c, N m or N.
    pub dry: f64,
    /// v₀, the speed at which three quarters of the dry friction are there, rad/s or m/s.
    pub speed: f64,
}

impl Drag {
    /// Refuses numbers that make no friction.
    ///
    /// # Errors
    /// [`Error::Value`].
    pub fn check(&self) -> Result<()> {
        finite("friction", [self.damping, self.dry, self.speed])?;
        if self.speed <= 0.0 {
            return Err(Error::Value {
                what: "speed of dry friction",
                got: self.speed,
                expected: "above zero",
            });
        }
        Ok(())
    }

    /// Torque that resists the motion.
    pub fn torque(&self, velocity: f64) -> f64 {
        let dry = if self.dry == 0.0 { 0.0 } else { self.dry * (velocity / self.speed).tanh() };
        self.damping * velocity + dry
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn torque_is_the_slope_of_the_energy() {
        let spring = Spring { stiffness: 3e4, cubic: 2e8, gap: 1e-3 };
        for e in [-4e-3, -2e-4, 0.0, 3e-4, 2e-3] {
            let h = 1e-7;
            let slope = (spring.energy(e + h) - spring.energy(e - h)) / (2.0 * h);
            assert!((slope - spring.torque(e)).abs() < 1e-6 * 3e4);
        }
    }
}
