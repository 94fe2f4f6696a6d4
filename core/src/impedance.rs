//! Joint impedances z(s): what acts between two sides of a joint, as a function of the Laplace variable.
//!
//! An impedance sits on a direction b of coordinate space and adds z(s) b bᵀ to the dynamic stiffness. A spring-damper
//! on one coordinate is the virtual joint of Huynh et al. 2021 (Eqs. 12, 13); a row of a bushing is a dense direction.

use crate::mechanism::finite;
use crate::{Error, Result};
use nalgebra::Complex as C64;
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

/// The numbers of a motor behind a flexible shaft, controlled by itself (Do et al. 2022, Eqs. 1 to 4, Appendix A).
///
/// With w the motor's turn per unit of the coordinate, B q̈_m + (D_m + K_D) q̇_m + (k + K_P) q_m + K_I ∫q_m equals
/// w k q less what feedback of the link side takes off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveNumbers {
    /// w: one, or one over the characteristic radius of a prismatic joint, 1/m.
    pub scale: f64,
    /// k, N m/rad.
    pub shaft: f64,
    /// B, behind the gear, kg m².
    pub inertia: f64,
    /// D_m + K_D, N m s/rad.
    pub damping: f64,
    /// k + K_P, N m/rad.
    pub stiffness: f64,
    /// K_I, N m/(rad s).
    pub integral: f64,
    /// Gains on the coordinate itself: of its position, velocity and integral.
    pub link: [f64; 3],
}

/// What a drive adds to the dynamic stiffness of its coordinate beside the spring w²k of its shaft, −w k t(s), with
/// t(s) the motor's turn per unit of the coordinate: a ratio of polynomials.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drive {
    /// w, k and K_P.
    pub(crate) springs: [f64; 3],
    /// w k.
    pub(crate) gain: f64,
    /// Coefficients of t's numerator, lowest power first.
    pub(crate) numerator: [f64; 3],
    /// Coefficients of t's denominator, lowest power first; the leading one is B.
    pub(crate) denominator: [f64; 4],
    /// Degree of the denominator: 2, or 3 with an integrator.
    pub(crate) degree: usize,
}

impl Drive {
    /// The impedance of a drive.
    ///
    /// # Errors
    /// [`Error::Value`] for a number that is not finite or an inertia that is not positive.
    pub fn new(numbers: &DriveNumbers) -> Result<Self> {
        let DriveNumbers { scale, shaft, inertia, damping, stiffness, integral, link } = *numbers;
        finite("drive", [scale, shaft, inertia, damping, stiffness, integral].into_iter().chain(link))?;
        if inertia <= 0.0 {
            return Err(Error::Value {
                what: "inertia of a drive",
                got: inertia,
                expected: "a positive number",
            });
        }
        let (gain, [k, d, i], springs) = (scale * shaft, link, [scale, shaft, stiffness - shaft]);
        Ok(if integral == 0.0 && i == 0.0 {
            let denominator = [stiffness, damping, inertia, 0.0];
            Self { springs, gain, numerator: [gain - k, -d, 0.0], denominator, degree: 2 }
        } else {
            let denominator = [integral, stiffness, damping, inertia];
            Self { springs, gain, numerator: [-i, gain - k, -d], denominator, degree: 3 }
        })
    }

    /// B.
    pub(crate) fn inertia(&self) -> f64 {
        self.denominator[self.degree]
    }

    /// A drive `share` of the way to another of the same kind.
    pub(crate) fn between(&self, other: &Self, share: f64) -> Self {
        let mix = |a: f64, b: f64| a + share * (b - a);
        Self {
            springs: std::array::from_fn(|i| mix(self.springs[i], other.springs[i])),
            gain: mix(self.gain, other.gain),
            numerator: std::array::from_fn(|i| mix(self.numerator[i], other.numerator[i])),
            denominator: std::array::from_fn(|i| mix(self.denominator[i], other.denominator[i])),
            degree: self.degree,
        }
    }

    /// t at one s.
    pub fn turn(&self, s: C64<f64>) -> C64<f64> {
        let horner =
            |c: &[f64]| c.iter().rev().fold(C64::new(0.0, 0.0), |sum, &c| sum * s + C64::new(c, 0.0));
        horner(&self.numerator) / horner(&self.denominator)
    }

    /// t and dt/ds at each lane's s.
    #[inline(always)]
    pub fn turn_lanes<S: Simd>(&self, simd: S, s: Complex<S>) -> (Complex<S>, Complex<S>) {
        let (num, num_slope) = horner(simd, &self.numerator, s);
        let (den, den_slope) = horner(simd, &self.denominator[..=self.degree], s);
        let inverse = den.inverse(simd);
        let turn = num.mul(simd, inverse);
        (turn, num_slope.sub_mul(simd, turn, den_slope).mul(simd, inverse))
    }
}

/// A real polynomial and its derivative at each lane's s.
#[inline(always)]
fn horner<S: Simd>(simd: S, coefficients: &[f64], s: Complex<S>) -> (Complex<S>, Complex<S>) {
    let last = coefficients.len() - 1;
    let (mut value, mut slope) = (Complex::splat(simd, coefficients[last]), Complex::zero(simd));
    for &c in coefficients[..last].iter().rev() {
        slope = value.add_mul(simd, slope, s);
        value = Complex::splat(simd, c).add_mul(simd, value, s);
    }
    (value, slope)
}

/// Along which direction of coordinate space an impedance acts.
#[derive(Debug, Clone, PartialEq)]
pub enum Direction {
    /// On one coordinate alone.
    Coordinate(usize),
    /// On a combination of coordinates (one entry each).
    Dense(Vec<f64>),
}
