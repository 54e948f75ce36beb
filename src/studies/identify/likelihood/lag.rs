//! Currents that lag behind their commands.
//!
//! First-order amplifiers whose commands c are held over a sample time h give `i(u h) = c + (i_0 − c) exp(−u h/τ)`, u from 0 to 1. With
//! `∫ e^{−xu} du = (1 − e^{−x})/x` and `∫ (1 − u) e^{−xu} du = (1 − ∫ e^{−xu} du)/x` follow two moments of i², which give the effect of its force on velocity
//! and position in that time. For negative lags, which a search may pass through, the first moment of `exp` is continued as τ/h.

use super::case::Case;
use crate::estimation::Hold;

/// Step of central differences, s: far below a sample time.
const STEP_S: f64 = 2e-8;

/// Currents for one lag.
#[derive(Clone, Debug)]
pub(super) struct Lag {
    /// Moments of `exp(−u h/τ)` and of its square, weighted by 1 and by 1 − u.
    moments: [[f64; 2]; 2],
    magnets: usize,
    /// Currents at the start of the interval that ends at a row, by magnet, as readings in A.
    start_a: Vec<f64>,
}

impl Lag {
    /// Currents of a recording whose amplifiers lag, and the same for a lag one step longer and one step shorter. None if currents are continuous.
    pub fn of(case: &Case<'_>, lag_s: f64) -> Option<[Self; 3]> {
        let is_held = case.recording.hold != Hold::Linear;
        is_held.then(|| [0.0, STEP_S, -STEP_S].map(|step_s| Self::with(case, lag_s + step_s)))
    }

    fn with(case: &Case<'_>, lag_s: f64) -> Self {
        let h = case.recording.step_s;
        let decay = if lag_s > 0.0 { libm::exp(-h / lag_s) } else { 0.0 };
        let moments = [1.0, 2.0].map(|power| {
            let (ratio, decay) = (lag_s / (h * power), libm::pow(decay, power));
            let mean = ratio * (1.0 - decay);
            [mean, ratio * (1.0 - mean)]
        });
        let magnets = case.current.len();
        let mut start_a = vec![0.0; magnets * case.recording.rows()];
        for (k, read) in case.current.iter().enumerate() {
            for segment in &case.segments {
                let mut at = read[segment.start];
                for row in segment.clone().skip(1) {
                    start_a[magnets * row + k] = at;
                    let command = read[case.commanded(row)];
                    at = command + (at - command) * decay;
                }
            }
        }
        Self { moments, magnets, start_a }
    }

    /// Current of a magnet at the start of the interval that ends at a row, as a reading in A.
    #[inline(always)]
    pub fn start_a(&self, row: usize, k: usize) -> f64 {
        self.start_a[self.magnets * row + k]
    }

    /// Mean square of a current over an interval and its moment weighted by 1 − u, from command and initial value, A².
    #[inline(always)]
    pub fn squares(&self, command: f64, start: f64) -> [f64; 2] {
        let excess = start - command;
        [0, 1].map(|of| {
            let settled = [1.0, 0.5][of] * command * command;
            settled + 2.0 * command * excess * self.moments[0][of] + excess * excess * self.moments[1][of]
        })
    }
}

/// Derivative of the mean square with respect to the lag, from its values for a longer and a shorter one, A²/s.
#[inline(always)]
pub(super) fn derivative(more: f64, less: f64) -> f64 {
    (more - less) / (2.0 * STEP_S)
}
