//! Sensors of position and current: gain error, offset, noise, resolution, delay.
//!
//! ```text
//! reading = round((1 + gain error) x(t − delay) + offset + noise)    to whole multiples of the resolution
//! ```
//!
//! A parameter of 0 switches its effect off exactly. The angle of the rotor comes from an encoder without errors.

use serde::{Deserialize, Serialize};

use crate::invalid::Checks;
use crate::plant::check_step;
use crate::plant::noise::Noise;

/// The longest delay, in samples.
pub const LONGEST_DELAY: usize = 16;

/// The sensors of position and current.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SensorConfig {
    /// Standard deviation of the position noise, in m; 0 for none.
    pub position_noise_m: f64,
    /// Standard deviation of the current noise, in A; 0 for none.
    pub current_noise_a: f64,
    /// Time between samples `T_s`, in s.
    pub step_s: f64,
    /// Seed of the noise; the same seed gives the same noise.
    pub seed: u64,
    /// Resolution of the position, in m; 0 for one without limit.
    pub position_resolution_m: f64,
    /// Resolution of the current, in A; 0 for one without limit.
    pub current_resolution_a: f64,
    /// Readings Ym and Zm of a rotor in the centre, in m.
    pub position_offset_m: [f64; 2],
    /// Readings of the currents without current, in A.
    pub current_offset_a: [f64; 3],
    /// Relative error of the gain of Ym and Zm.
    pub position_gain_error: [f64; 2],
    /// Relative error of the gain of the readings of the currents.
    pub current_gain_error: [f64; 3],
    /// Delay of positions and currents, in s.
    pub delay_s: f64,
}

impl Default for SensorConfig {
    /// Without errors, 10 kHz.
    fn default() -> Self {
        Self {
            position_noise_m: 0.0,
            current_noise_a: 0.0,
            step_s: 1e-4,
            seed: 0,
            position_resolution_m: 0.0,
            current_resolution_a: 0.0,
            position_offset_m: [0.0; 2],
            current_offset_a: [0.0; 3],
            position_gain_error: [0.0; 2],
            current_gain_error: [0.0; 3],
            delay_s: 0.0,
        }
    }
}

impl SensorConfig {
    /// Reports what is wrong, by the names of the interface.
    pub(crate) fn check(&self, checks: &mut Checks) {
        checks.not_negative("sensor.positionNoise", self.position_noise_m, "m");
        checks.not_negative("sensor.currentNoise", self.current_noise_a, "A");
        check_step("sensor.Ts", self.step_s, checks);
        checks.not_negative("sensor.positionResolution", self.position_resolution_m, "m");
        checks.not_negative("sensor.currentResolution", self.current_resolution_a, "A");
        for (name, offset) in ["sensor.offsetY", "sensor.offsetZ"].into_iter().zip(self.position_offset_m) {
            checks.finite(name, offset, "m");
        }
        const OFFSETS: [&str; 3] = ["sensor.currentOffset[1]", "sensor.currentOffset[2]", "sensor.currentOffset[3]"];
        for (name, offset) in OFFSETS.into_iter().zip(self.current_offset_a) {
            checks.finite(name, offset, "A");
        }
        const GAINS: [&str; 5] = [
            "sensor.gainErrorY",
            "sensor.gainErrorZ",
            "sensor.currentGainError[1]",
            "sensor.currentGainError[2]",
            "sensor.currentGainError[3]",
        ];
        let errors = self.position_gain_error.into_iter().chain(self.current_gain_error);
        for (name, error) in GAINS.into_iter().zip(errors) {
            checks.require(error.is_finite() && error > -1.0, name, error, "a finite number above -1");
        }
        // A sample time that was refused is not held against the delay as well.
        let longest_s = LONGEST_DELAY as f64 * self.step_s;
        checks.require(
            self.delay_s >= 0.0 && (self.delay_s <= longest_s || !(longest_s.is_finite() && longest_s > 0.0)),
            "sensor.delay",
            format_args!("{} s", self.delay_s),
            format!("a time from 0 to {LONGEST_DELAY} sample times"),
        );
    }

    /// What the sensors read of a true sample, with noise of Y, Z, and the three currents.
    pub fn read(&self, truth: &Sample, noise: &mut [Noise; 5]) -> Sample {
        let [noise_y, noise_z, noise_1, noise_2, noise_3] = noise;
        let position = |a: usize, noise: &mut Noise| {
            let value = with_errors(truth.position_m[a], self.position_gain_error[a], self.position_offset_m[a]);
            rounded(noise.measure(value, self.position_noise_m), self.position_resolution_m)
        };
        let current = |k: usize, noise: &mut Noise| {
            let value = with_errors(truth.current_a[k], self.current_gain_error[k], self.current_offset_a[k]);
            rounded(noise.measure(value, self.current_noise_a), self.current_resolution_a)
        };
        Sample {
            position_m: [position(0, noise_y), position(1, noise_z)],
            current_a: [current(0, noise_1), current(1, noise_2), current(2, noise_3)],
        }
    }
}

fn with_errors(value: f64, gain_error: f64, offset: f64) -> f64 {
    if gain_error == 0.0 && offset == 0.0 { value } else { (1.0 + gain_error) * value + offset }
}

/// `value` as the nearest whole multiple of `resolution`.
fn rounded(value: f64, resolution: f64) -> f64 {
    if resolution == 0.0 { value } else { (value / resolution).round() * resolution }
}

/// Position and currents, true or as read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// Position (Y, Z), in m.
    pub position_m: [f64; 2],
    /// Currents, in A.
    pub current_a: [f64; 3],
}

/// Samples taken but not yet delivered (sensor delay).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DelayLine {
    /// Number of samples taken; sample k is taken at `start + k · T_s − delay` and delivered at `start + k · T_s`.
    pub taken: u64,
    ring: [Sample; LONGEST_DELAY + 1],
}

impl DelayLine {
    /// Samples that would have been taken before the start are those of the start.
    pub fn new(at_start: Sample, delay_samples: f64) -> Self {
        Self { taken: delay_samples as u64 + 1, ring: [at_start; LONGEST_DELAY + 1] }
    }

    /// Takes one more sample.
    pub fn take(&mut self, now: Sample) {
        self.ring[(self.taken % (LONGEST_DELAY as u64 + 1)) as usize] = now;
        self.taken += 1;
    }

    /// Sample k, if it is one of the last that were taken.
    pub fn sample(&self, k: u64) -> Sample {
        self.ring[(k % (LONGEST_DELAY as u64 + 1)) as usize]
    }
}
