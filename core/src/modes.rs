//! All modes of a robot followed from posture to posture, each set checked to be complete.
//!
//! Steps are those of [`crate::follower`], the check is that of [`crate::completeness`]; where one fails the walk ends and
//! says how far it came, for a dense solver to take over.

use crate::eigenpairs::System;
use crate::follower::Follower;
use crate::impedance::Drive;
use crate::{Error, Result};
use nalgebra::Complex as C64;
use pulp::{Arch, Simd, WithSimd};

/// The systems of a walk, one after the other.
#[derive(Debug, Clone, Copy)]
pub struct Walk<'a> {
    /// Number of coordinates.
    pub n: usize,
    /// M of every system (P×n×n).
    pub mass: &'a [f64],
    /// C of every system (P×n×n), or one for all.
    pub damping: &'a [f64],
    /// K of every system (P×n×n).
    pub stiffness: &'a [f64],
    /// Drives of every system, or one list for all.
    pub drives: &'a [Vec<(usize, Drive)>],
    /// Stiffness of every coordinate's own spring (P×n), or one list for all; empty where no shares are wanted.
    pub springs: &'a [f64],
}

/// Modes along a walk; those of the start stand first, polished.
#[derive(Debug, Clone)]
pub struct Modes {
    /// λ (P×m), rad/s.
    pub poles: Vec<C64<f64>>,
    /// Shapes (P×m×(n+d)), coordinates before motors, of one in the Hermitian mass norm, uᵀMu real.
    pub shapes: Vec<C64<f64>>,
    /// Share of each coordinate's springs in the elastic energy (P×m×n), or nothing.
    pub shares: Vec<f32>,
    /// Largest residual of each system, as a share of what is tolerated (P).
    pub residuals: Vec<f64>,
    /// Modal assurance criterion with the shape before (P×m), the smallest over the halves of a step.
    pub likeness: Vec<f64>,
    /// Systems that were reached; the first that was not needs another solver.
    pub reached: usize,
}

impl<'a> Walk<'a> {
    /// Number of systems.
    pub fn count(&self) -> usize {
        self.mass.len() / (self.n * self.n).max(1)
    }

    fn check(&self) -> Result<()> {
        let (count, size) = (self.count(), self.n * self.n);
        for (what, got, needed) in [
            ("mass", self.mass.len(), count * size),
            ("stiffness", self.stiffness.len(), count * size),
            ("damping", self.damping.len(), if self.damping.len() == size { size } else { count * size }),
            (
                "springs",
                self.springs.len(),
                if self.springs.is_empty() || self.springs.len() == self.n {
                    self.springs.len()
                } else {
                    count * self.n
                },
            ),
            ("drives", self.drives.len(), if self.drives.len() == 1 { 1 } else { count }),
        ] {
            if got != needed || self.n == 0 {
                return Err(Error::Length { what, needed, got });
            }
        }
        for drives in self.drives {
            if drives.len() != self.drives[0].len() {
                return Err(Error::Length {
                    what: "drives",
                    needed: self.drives[0].len(),
                    got: drives.len(),
                });
            }
            if let Some(&(got, _)) = drives.iter().find(|(i, _)| *i >= self.n) {
                return Err(Error::Index { what: "coordinate of a drive", count: self.n, got });
            }
        }
        Ok(())
    }

    fn springs(&self, index: usize) -> &'a [f64] {
        if self.springs.len() == self.n { self.springs } else { &self.springs[index * self.n..][..self.n] }
    }

    /// Whether no damping matrix has anything beside its diagonal.
    fn diagonal(&self) -> bool {
        let zero_beside =
            |(i, row): (usize, &[f64])| row.iter().enumerate().all(|(j, &c)| c == 0.0 || j == i % self.n);
        self.damping.chunks_exact(self.n).enumerate().all(zero_beside)
    }

    fn system(&self, index: usize, diagonal: bool) -> System<'a> {
        let size = self.n * self.n;
        let of = |matrices: &'a [f64]| {
            if matrices.len() == size { matrices } else { &matrices[index * size..][..size] }
        };
        System {
            n: self.n,
            mass: of(self.mass),
            damping: of(self.damping),
            diagonal,
            stiffness: of(self.stiffness),
            drives: &self.drives[if self.drives.len() == 1 { 0 } else { index }],
        }
    }
}

/// Follows the modes of the first system through the others.
///
/// `poles` (m) and `shapes` (m×n, coordinates only) are those of the first system, one of each conjugate pair and every
/// real pole; together they must be complete. The walk ends early where a step fails: poles that meet, repeated poles,
/// pairs that turn into real poles.
///
/// # Errors
/// [`Error::Length`], [`Error::Index`].
pub fn follow(walk: &Walk<'_>, poles: &[C64<f64>], shapes: &[C64<f64>]) -> Result<Modes> {
    walk.check()?;
    if poles.is_empty() || shapes.len() != poles.len() * walk.n {
        let needed = poles.len().max(1) * walk.n;
        return Err(Error::Length { what: "shapes", needed, got: shapes.len() });
    }
    Ok(Arch::new().dispatch(Follow { walk, poles, shapes }))
}

struct Follow<'a> {
    walk: &'a Walk<'a>,
    poles: &'a [C64<f64>],
    shapes: &'a [C64<f64>],
}

impl WithSimd for Follow<'_> {
    type Output = Modes;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Modes {
        let Self { walk, poles, shapes } = self;
        let (count, m) = (walk.count(), poles.len());
        let width = walk.n + walk.drives[0].len();
        let mut out = Modes {
            poles: Vec::with_capacity(count * m),
            shapes: Vec::with_capacity(count * m * width),
            shares: Vec::with_capacity(if walk.springs.is_empty() { 0 } else { count * m * walk.n }),
            residuals: Vec::with_capacity(count),
            likeness: Vec::with_capacity(count * m),
            reached: 0,
        };
        let (diagonal, same_drives) = (walk.diagonal(), walk.drives.len() == 1);
        let mut follower = Follower::new(simd, walk.n, width - walk.n, same_drives, poles, shapes);
        for index in 0..count {
            let system = walk.system(index, diagonal);
            let before = walk.system(index.saturating_sub(1), diagonal);
            follower.likeness.fill(1.0);
            let Some(residual) = follower.advance(simd, &before, &system, index == 0) else { break };
            out.residuals.push(residual);
            out.likeness.extend_from_slice(&follower.likeness);
            follower.put_poles(&mut out.poles);
            follower.put_shapes(&mut out.shapes);
            if !walk.springs.is_empty() {
                follower.put_shares(simd, &system, walk.springs(index), &mut out.shares);
            }
            out.reached += 1;
        }
        out
    }
}
