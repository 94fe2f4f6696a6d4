//! A fit: which impedances move together, what is known of them beforehand, and the descent to the lowest cost.

use crate::impedance::SpringDamper;
use crate::least_squares::{Answer, Descent, Settings, descend};
use crate::residual::Problem;
use crate::triangle::Triangle;
use crate::{Error, Result};

/// What is known of a parameter before anything is measured: the row (x − mean)/deviation beside those of the data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// Index of the parameter.
    pub parameter: usize,
    /// Its expected logarithm.
    pub mean: f64,
    /// One over the standard deviation of that.
    pub weight: f64,
}

/// A problem and the parameters to solve it for; a parameter is the logarithm of a number that several impedances may
/// share.
#[derive(Debug, Clone)]
pub struct Fit<'a> {
    /// The measured responses and their models.
    pub problem: &'a Problem,
    /// All impedances; those that belong to a parameter are overwritten.
    pub impedances: Vec<SpringDamper>,
    /// For every parameter the numbers that it sets (indices into all stiffnesses, then all dampings).
    pub free: Vec<Vec<usize>>,
    /// Priors, any number per parameter.
    pub priors: Vec<Prior>,
}

impl Fit<'_> {
    /// The impedances of one parameter set.
    #[must_use]
    pub fn impedances_at(&self, x: &[f64]) -> Vec<SpringDamper> {
        let mut set = self.impedances.clone();
        let r = set.len();
        for (tied, value) in self.free.iter().zip(x) {
            let value = value.exp();
            for &i in tied {
                if i < r { set[i].stiffness = value } else { set[i - r].damping = value }
            }
        }
        set
    }

    /// The triangle of [J r] with the rows of the priors, which count in its cost and its price; none where the model
    /// has no answer.
    ///
    /// # Errors
    /// Mismatched lengths.
    ///
    /// # Panics
    /// For a parameter out of range; [`Self::descend`] refuses those.
    pub fn triangle(&self, x: &[f64]) -> Result<Option<Triangle>> {
        let set = self.impedances_at(x);
        if set.iter().any(|z| z.check().is_err()) {
            return Ok(None);
        }
        let Some(mut triangle) = self.problem.answer(&set, &self.free)? else { return Ok(None) };
        let width = triangle.width;
        for prior in &self.priors {
            let mut row = Triangle::zeros(width);
            let (i, off) = (prior.parameter, prior.weight * (x[prior.parameter] - prior.mean));
            row.values[i * width + i] = prior.weight;
            row.values[i * width + width - 1] = off;
            row.price = off * off;
            triangle.merge(&row);
        }
        Ok(Some(triangle))
    }

    /// Goes down to the lowest cost within the bounds.
    ///
    /// `watch` hears of every evaluation with the lowest price so far, and says whether to go on.
    ///
    /// # Errors
    /// Mismatched lengths, indices out of range.
    pub fn descend(
        &self,
        start: &[f64],
        lower: &[f64],
        upper: &[f64],
        settings: Settings,
        mut watch: impl FnMut(f64) -> bool,
    ) -> Result<Descent> {
        for (what, got) in [("start", start.len()), ("lower", lower.len()), ("upper", upper.len())] {
            if got != self.free.len() {
                return Err(Error::Length { what, needed: self.free.len(), got });
            }
        }
        let count = SpringDamper::PARAMETERS * self.impedances.len();
        if let Some(&got) = self.free.iter().flatten().find(|&&i| i >= count) {
            return Err(Error::Index { what: "parameter", count, got });
        }
        if let Some(prior) = self.priors.iter().find(|prior| prior.parameter >= self.free.len()) {
            let (count, got) = (self.free.len(), prior.parameter);
            return Err(Error::Index { what: "parameter of a prior", count, got });
        }
        let evaluate = |x: &[f64], best: f64| {
            if !watch(best) {
                return Ok(Answer::Stop);
            }
            Ok(self.triangle(x)?.map_or(Answer::Nowhere, Answer::Here))
        };
        descend(evaluate, start, lower, upper, settings)
    }
}
