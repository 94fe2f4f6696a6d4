//! Joint impedances z(s): what acts between two sides of a joint, as a function of the Laplace variable.
//!
//! An impedance sits on a direction b of coordinate space and adds z(s) b bᵀ to the dynamic stiffness. A spring-damper
//! on one coordinate is the virtual joint of Huynh et al. 2021 (Eqs. 12, 13); a row of a bushing is a dense direction.

use crate::{Error, Result};
use pulp::Simd;

use crate::lanes::{Complex, Real};

/// z(s) = k + s d.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpringDamper {
    /// k, N m/rad or N/m.
    pub stiffness: f64,
    /// d, N m s/rad or N s/m.
    pub damping: f64,
}

impl SpringDamper {
    /// Numbers that a fit may change: k and d.
    pub const PARAMETERS: usize = 2;

    /// Refuses numbers that are not finite.
    ///
    /// # Errors
    /// [`Error::Value`].
    pub fn check(&self) -> Result<()> {
        for (what, got) in [("stiffness", self.stiffness), ("damping", self.damping)] {
            if !got.is_finite() {
                return Err(Error::Value { what, got, expected: "a finite number" });
            }
        }
        Ok(())
    }

    /// z at each lane's s.
    #[inline(always)]
    pub fn value<S: Simd>(&self, simd: S, s: Complex<S>) -> Complex<S> {
        let (k, d) = (Real::splat(simd, self.stiffness), Real::splat(simd, self.damping));
        Complex { re: k.add_mul(simd, s.re, d), im: s.im.mul(simd, d) }
    }

    /// ∂z/∂ln k = k and ∂z/∂ln d = s d at each lane's s.
    #[inline(always)]
    pub fn log_gradient<S: Simd>(&self, simd: S, s: Complex<S>) -> [Complex<S>; Self::PARAMETERS] {
        [Complex::splat(simd, self.stiffness), s.scale(simd, Real::splat(simd, self.damping))]
    }
}

/// Along which direction of coordinate space an impedance acts.
#[derive(Debug, Clone, PartialEq)]
pub enum Direction {
    /// On one coordinate alone.
    Coordinate(usize),
    /// On a combination of coordinates (one entry each).
    Dense(Vec<f64>),
}
