//! The sample instants of a sampled model, however the importer cuts time into steps.

use serde::{Deserialize, Serialize};

/// Sample instants `start + count × period`, each taken once.
///
/// The samples of a communication step from t over h are those in [t, t + h): the inputs set before the step are valid
/// at t and held until t + h. Importers compute t and h in floating point and may add up steps, so an instant that lies
/// within [`Clock::TOLERANCE`] periods before t + h belongs to the next step, which begins there. No sample is lost or
/// doubled thereby, not even by steps shorter than the tolerance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Clock {
    start_s: f64,
    period_s: f64,
    taken: u64,
}

impl Clock {
    /// Width of the tolerance in sample periods. Adding up 10⁶ steps of 10⁻⁴ s misses 100 s by 2·10⁻⁵ periods.
    pub const TOLERANCE: f64 = 1e-3;

    /// A clock whose first sample is at `start_s` and whose others follow every `period_s`, both in seconds.
    pub fn new(start_s: f64, period_s: f64) -> Self {
        Self { start_s, period_s, taken: 0 }
    }

    /// The instant of the next sample before the end of a step, which is thereby taken; `None` when there is none left.
    pub fn next_before(&mut self, end_s: f64) -> Option<f64> {
        let instant_s = self.start_s + self.taken as f64 * self.period_s;
        (instant_s < end_s - Self::TOLERANCE * self.period_s).then(|| {
            self.taken += 1;
            instant_s
        })
    }

    /// How many samples were taken.
    pub fn taken(&self) -> u64 {
        self.taken
    }

    /// Whether a run with samples every `period_s` can go on from `time_s` with this clock: the samples before are taken,
    /// the others are not. A clock read from a file may fail this.
    pub fn suits(&self, period_s: f64, time_s: f64) -> bool {
        let numbers = self.start_s.is_finite() && self.period_s == period_s && period_s > 0.0;
        let instant_s = |count: u64| self.start_s + count as f64 * self.period_s;
        // The end of the last step is `time_s`, so this is the comparison by which samples were taken.
        let complete = instant_s(self.taken) >= time_s - Self::TOLERANCE * self.period_s;
        // Importers may begin a step a little before the end of the last one.
        let ahead_s = self.period_s + 1e-6 * time_s.abs().max(1.0);
        numbers && complete && (self.taken == 0 || instant_s(self.taken - 1) <= time_s + ahead_s)
    }
}
