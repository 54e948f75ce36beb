//! Sample instants of a sampled model, independent of the communication steps.

use serde::{Deserialize, Serialize};

/// Sample instants `start + count × period`, each taken once.
///
/// The samples of a communication step from t over h are those in [t, t + h): the inputs set before the step are valid at t and
/// held until t + h. Importers compute t and h in floating point and may add up steps, so an instant less than
/// [`Clock::TOLERANCE`] periods, or a rounding error of the time, before t + h belongs to the next step. No sample is lost or repeated,
/// not even with steps shorter than the tolerance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Clock {
    start_s: f64,
    period_s: f64,
    taken: u64,
}

impl Clock {
    /// Width of the tolerance in sample periods. The sum of 10⁶ steps of 10⁻⁴ s differs from 100 s by 2·10⁻⁵ periods.
    pub const TOLERANCE: f64 = 1e-3;

    /// The tolerance in seconds at an instant. Times far from 0 have a coarse resolution: 2·10⁻⁷ s at the time of day in seconds since
    /// 1970, which is more than 10⁻³ periods of a fast clock.
    fn tolerance_s(&self, instant_s: f64) -> f64 {
        (Self::TOLERANCE * self.period_s).max(4.0 * f64::EPSILON * instant_s.abs()).min(0.5 * self.period_s)
    }

    /// A clock with its first sample at `start_s` and the others every `period_s`, both in seconds.
    pub fn new(start_s: f64, period_s: f64) -> Self {
        Self { start_s, period_s, taken: 0 }
    }

    /// Takes the next sample before the end of a step and returns its instant; `None` if there is none left.
    pub fn next_before(&mut self, end_s: f64) -> Option<f64> {
        let instant_s = self.start_s + self.taken as f64 * self.period_s;
        (instant_s < end_s - self.tolerance_s(instant_s)).then(|| {
            self.taken += 1;
            instant_s
        })
    }

    /// Whether a step that has taken all earlier samples ends at the next instant.
    pub fn is_due(&self, end_s: f64) -> bool {
        let instant_s = self.start_s + self.taken as f64 * self.period_s;
        instant_s <= end_s + self.tolerance_s(instant_s)
    }

    /// Number of samples taken.
    pub fn taken(&self) -> u64 {
        self.taken
    }

    /// Whether a run with samples every `period_s` can continue from `time_s` with this clock: it has taken all samples before,
    /// and none after. A clock read from a file may fail this.
    pub fn suits(&self, period_s: f64, time_s: f64) -> bool {
        let numbers = self.start_s.is_finite() && self.period_s == period_s && period_s > 0.0;
        let instant_s = |count: u64| self.start_s + count as f64 * self.period_s;
        // `time_s` is the end of the last step: the same comparison as when samples are taken.
        let complete = instant_s(self.taken) >= time_s - self.tolerance_s(time_s);
        // Importers may start a step slightly before the end of the last one.
        let ahead_s = self.period_s + 1e-6 * time_s.abs().max(1.0);
        numbers && complete && (self.taken == 0 || instant_s(self.taken - 1) <= time_s + ahead_s)
    }
}
