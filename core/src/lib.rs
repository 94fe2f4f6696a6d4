//! Numerical core of Armonic: the mechanics, linearization and frequency responses of flexible-joint robots.
//!
//! Data walks one way: a [`mechanism::Mechanism`] is compiled once, [`linearize`] turns it into matrices at an
//! operating point, [`frf`] turns those into frequency responses with their sensitivities, and [`residual`] compares
//! these with a measurement. Units are SI and radians throughout; six-vectors stack the linear part over the angular.

mod aberth;
pub mod bushing;
mod columns;
mod completeness;
pub mod dynamics;
pub mod eigenpairs;
pub mod error;
pub mod fit;
mod follower;
pub mod frf;
pub mod impedance;
pub mod joint_law;
pub mod lanes;
pub mod least_squares;
pub mod linearize;
pub mod matrix_polynomial;
pub mod mechanism;
pub mod modes;
mod null_vector;
pub mod plant;
mod polynomial;
pub mod residual;
pub mod sampled_control;
pub mod simulate;
mod solver;
pub mod spatial;
pub mod system;
pub mod triangle;
pub mod waveform;

pub use error::Error;

/// Result of everything in this crate that can fail.
pub type Result<T> = std::result::Result<T, Error>;
