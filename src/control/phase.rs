//! Angles that grow at a constant rate between samples.

use serde::{Deserialize, Serialize};

/// `base + rate · (count · T_s)`, with a new base when the rate changes, so that it does not drift.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Phase {
    /// The angle at the sample at which the rate last changed.
    pub base: f64,
    /// Number of that sample.
    pub base_sample: u64,
    /// Rate since then, per s.
    pub rate: f64,
}

impl Phase {
    /// The angle at a sample, for samples every `step_s` in s.
    pub fn at(&self, sample: u64, step_s: f64) -> f64 {
        self.base + self.rate * ((sample - self.base_sample) as f64 * step_s)
    }

    /// Whether its count is consistent with a state after `samples` samples.
    pub fn is_in_order(&self, samples: u64) -> bool {
        self.base_sample < samples.max(1)
    }
}
