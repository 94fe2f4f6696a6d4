//! Forces over time: how strong an excitation is at each instant, and where its formula changes.

use crate::mechanism::finite;
use crate::{Error, Result};
use std::f64::consts::{PI, TAU};

/// How an excitation runs over time; zero where nothing is said. Times in s, amplitudes in N or N m.
#[derive(Debug, Clone, PartialEq)]
pub enum Waveform {
    /// One value from `start` to `end`, which may be infinite.
    Constant {
        /// First instant.
        start: f64,
        /// Instant at which it is over.
        end: f64,
        /// Value in between.
        value: f64,
    },
    /// Half a period of a sine: the force of a hammer.
    HalfSine {
        /// First instant.
        start: f64,
        /// Instant at which it is over.
        end: f64,
        /// Largest value.
        peak: f64,
    },
    /// A sine from `start` to `end`.
    Sine {
        /// First instant.
        start: f64,
        /// Instant at which it is over.
        end: f64,
        /// Largest value.
        amplitude: f64,
        /// Frequency, Hz.
        freq_hz: f64,
        /// Phase at `start`, rad.
        phase: f64,
    },
    /// A sine whose frequency runs from one value to another.
    Sweep {
        /// First instant.
        start: f64,
        /// Instant at which it is over.
        end: f64,
        /// Largest value.
        amplitude: f64,
        /// Frequency at `start` and at `end`, Hz.
        freq_hz: [f64; 2],
        /// Whether the frequency grows by the same factor, not the same number, per second.
        logarithmic: bool,
    },
    /// Values at even instants, joined by straight lines.
    Samples {
        /// Instant of the first value.
        start: f64,
        /// Time between values.
        step: f64,
        /// The values.
        values: Vec<f64>,
    },
}

impl Waveform {
    /// Refuses numbers that make no waveform.
    ///
    /// # Errors
    /// [`Error::Value`].
    pub fn check(&self) -> Result<()> {
        let (start, end) = self.span();
        finite("start of an excitation", [start])?;
        if end.is_nan() || end < start {
            return Err(Error::Value {
                what: "end of an excitation",
                got: end,
                expected: "a time after its start",
            });
        }
        match self {
            Self::Constant { value, .. } => finite("value", [*value]),
            Self::HalfSine { peak, .. } => finite("peak", [*peak, end]),
            Self::Sine { amplitude, freq_hz, phase, .. } => finite("sine", [*amplitude, *freq_hz, *phase]),
            Self::Sweep { amplitude, freq_hz, .. } => {
                finite("sweep", [*amplitude, freq_hz[0], freq_hz[1], end])
            }
            Self::Samples { values, .. } => finite("values", values.iter().copied()),
        }
    }

    /// First and last instant at which it may be other than zero.
    pub fn span(&self) -> (f64, f64) {
        match self {
            Self::Constant { start, end, .. }
            | Self::HalfSine { start, end, .. }
            | Self::Sine { start, end, .. }
            | Self::Sweep { start, end, .. } => (*start, *end),
            Self::Samples { start, step, values } => {
                (*start, start + step * (values.len().max(1) - 1) as f64)
            }
        }
    }

    /// Instants at which the formula changes, so that no step of an integration reaches across them.
    pub fn breaks(&self) -> Vec<f64> {
        match self {
            Self::Samples { start, step, values } => {
                (0..values.len()).map(|i| start + step * i as f64).collect()
            }
            _ => [self.span().0, self.span().1].into_iter().filter(|t| t.is_finite()).collect(),
        }
    }

    /// Value at `t` by the formula that holds at `within`, an instant inside the same piece.
    pub fn value(&self, t: f64, within: f64) -> f64 {
        let (start, end) = self.span();
        if !(start..end).contains(&within) {
            return 0.0;
        }
        match self {
            Self::Constant { value, .. } => *value,
            Self::HalfSine { peak, .. } => peak * (PI * (t - start) / (end - start)).sin(),
            Self::Sine { amplitude, freq_hz, phase, .. } => {
                amplitude * (TAU * freq_hz * (t - start) + phase).sin()
            }
            Self::Sweep { amplitude, freq_hz: [from, to], logarithmic, .. } => {
                let (x, length) = (t - start, end - start);
                let turns = if *logarithmic && from != to {
                    let rate = (to / from).ln() / length;
                    from * (rate * x).exp_m1() / rate
                } else {
                    from * x + 0.5 * (to - from) * x * x / length
                };
                amplitude * (TAU * turns).sin()
            }
            Self::Samples { step, values, .. } => {
                let i = (((within - start) / step) as usize).min(values.len() - 2);
                let share = (t - start) / step - i as f64;
                values[i] + share * (values[i + 1] - values[i])
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_formula_holds_up_to_its_end_seen_from_within() {
        let hit = Waveform::Constant { start: 0.2, end: 0.206, value: 50.0 };
        assert_eq!(hit.value(0.206, 0.203), 50.0);
        assert_eq!(hit.value(0.206, 0.207), 0.0);
        assert_eq!(hit.breaks(), [0.2, 0.206]);
    }

    #[test]
    fn a_sweep_passes_every_frequency() {
        for logarithmic in [false, true] {
            let sweep =
                Waveform::Sweep { start: 1.0, end: 3.0, amplitude: 1.0, freq_hz: [5.0, 50.0], logarithmic };
            let phase = |t: f64| {
                // The slope of asin where the sine passes zero upwards: count zero crossings instead.
                let n = 200_000;
                let values: Vec<f64> =
                    (0..=n).map(|i| sweep.value(1.0 + (t - 1.0) * i as f64 / n as f64, 2.0)).collect();
                values.windows(2).filter(|w| w[0] <= 0.0 && w[1] > 0.0).count()
            };
            let turns = if logarithmic { 45.0 / (10.0_f64.ln() / 2.0) } else { 55.0 };
            assert!((phase(3.0) as f64 - turns).abs() <= 1.0);
        }
    }

    #[test]
    fn samples_are_joined_by_straight_lines() {
        let measured = Waveform::Samples { start: 0.0, step: 0.5, values: vec![0.0, 2.0, 1.0] };
        assert_eq!(measured.value(0.25, 0.3), 1.0);
        assert_eq!(measured.value(0.75, 0.6), 1.5);
        assert_eq!(measured.value(2.0, 2.0), 0.0);
    }
}
