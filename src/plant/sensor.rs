//! Sensors of position and current: gain error, offset, noise, resolution, delay.
//!
//! ```text
//! reading = round((1 + gain error) x(t − delay) + offset + noise)    to multiples of the resolution
//! ```
//!
//! A parameter of 0 switches its effect off exactly. The encoder of the rotor angle has no errors.

use serde::{Deserialize, Serialize};

use crate::bearing::array;
use crate::invalid::Checks;
use crate::machine::Machine;
use crate::plant::noise::Noise;
use crate::plant::{INSTANT_TOLERANCE, check_step};
use crate::variables::unit::{AMPERE, METRE, ONE, SECOND};
use crate::variables::{Array, Saved, Variables};

/// The longest delay, in samples.
pub const LONGEST_DELAY: usize = 16;

/// The sensors of position and current; by default without errors, at 10 kHz.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Machine, default)]
#[serde(default, bound = "[f64; N]: Saved, [f64; K]: Saved")]
pub struct SensorConfig<const N: usize = 2, const K: usize = 3> {
    /// Standard deviation of the noise on the measured positions
    #[parameter(name = "sensor.positionNoise", unit = METRE, min = 0.0, nominal = 1e-7)]
    pub position_noise_m: f64,
    /// Standard deviation of the noise on im
    #[parameter(name = "sensor.currentNoise", unit = AMPERE, min = 0.0, nominal = 1e-2)]
    pub current_noise_a: f64,
    /// Resolution of the measured positions; 0 for no rounding
    #[parameter(name = "sensor.positionResolution", unit = METRE, min = 0.0, nominal = 1e-7)]
    pub position_resolution_m: f64,
    /// Resolution of im; 0 for no rounding
    #[parameter(name = "sensor.currentResolution", unit = AMPERE, min = 0.0, nominal = 1e-3)]
    pub current_resolution_a: f64,
    /// Offset of the sensor of {reading}: its reading with the rotor in the centre
    #[parameter(names = context.of_readings("sensor.offset"), unit = METRE, nominal = 1e-6)]
    pub position_offset_m: [f64; N],
    /// Relative gain error of the sensor of {reading}
    #[parameter(names = context.of_readings("sensor.gainError"), unit = ONE, above = -1.0, nominal = 0.01)]
    pub position_gain_error: [f64; N],
    /// Offset of the current sensor of {magnet}: its reading without current
    #[parameter(names = context.of_magnets("sensor.currentOffset"), unit = AMPERE, nominal = 1e-2)]
    pub current_offset_a: [f64; K],
    /// Relative gain error of the current sensor of {magnet}
    #[parameter(names = context.of_magnets("sensor.currentGainError"), unit = ONE, above = -1.0, nominal = 0.01)]
    pub current_gain_error: [f64; K],
    /// Delay of the measured positions and im, up to 16 sample times
    #[parameter(name = "sensor.delay", unit = SECOND, min = 0.0, nominal = 1e-4, display_unit = "µs")]
    pub delay_s: f64,
    /// Sample time of the sensors
    #[parameter(name = "sensor.Ts", unit = SECOND, above = 0.0, nominal = 1e-4, display_unit = "µs", value = 1e-4)]
    pub step_s: f64,
    /// Seed of the noise; equal seeds give equal noise
    #[parameter(name = "sensor.seed", start = 1)]
    pub seed: i32,
}

impl<const N: usize, const K: usize> SensorConfig<N, K> {
    /// Checks sample time and delay.
    pub(crate) fn check(&self, checks: &mut Checks) {
        check_step("sensor.Ts", self.step_s, checks);
        let (longest_s, wanted) =
            (LONGEST_DELAY as f64 * self.step_s, format!("a time from 0 to {LONGEST_DELAY} sample times"));
        checks.number(self.delay_s <= longest_s, "sensor.delay", (self.delay_s, "s"), wanted);
    }

    /// The readings for a true sample.
    pub fn read(&self, truth: &Sample<N, K>, noise: &mut Channels<N, K>) -> Sample<N, K> {
        Sample {
            position_m: array::from_fn(|n| {
                let value = with_errors(truth.position_m[n], self.position_gain_error[n], self.position_offset_m[n]);
                rounded(noise.position[n].measure(value, self.position_noise_m), self.position_resolution_m)
            }),
            current_a: array::from_fn(|k| {
                let value = with_errors(truth.current_a[k], self.current_gain_error[k], self.current_offset_a[k]);
                rounded(noise.current[k].measure(value, self.current_noise_a), self.current_resolution_a)
            }),
        }
    }
}

/// The noise generators of all sensors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "[Noise; N]: Saved, [Noise; K]: Saved")]
pub struct Channels<const N: usize = 2, const K: usize = 3> {
    /// Of the positions.
    pub position: [Noise; N],
    /// Of the currents.
    pub current: [Noise; K],
}

impl<const N: usize, const K: usize> Channels<N, K> {
    /// Statistically independent generators from one seed, which may be any number: positions first.
    pub fn new(seed: i32) -> Self {
        let mut channels = Noise::sequence(u64::from(seed.cast_unsigned()));
        Self { position: std::array::from_fn(|_| channels()), current: std::array::from_fn(|_| channels()) }
    }
}

fn with_errors(value: f64, gain_error: f64, offset: f64) -> f64 {
    if gain_error == 0.0 && offset == 0.0 { value } else { (1.0 + gain_error) * value + offset }
}

/// `value` rounded to a multiple of `resolution`.
fn rounded(value: f64, resolution: f64) -> f64 {
    if resolution == 0.0 { value } else { (value / resolution).round() * resolution }
}

/// Positions and currents, true or measured.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "[f64; N]: Saved, [f64; K]: Saved")]
pub struct Sample<const N: usize = 2, const K: usize = 3> {
    /// Positions, in m: (Y, Z) of the planar rotor.
    pub position_m: [f64; N],
    /// Currents, in A.
    pub current_a: [f64; K],
}

/// Samples taken but not yet delivered (sensor delay).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "[f64; N]: Saved, [f64; K]: Saved")]
pub struct DelayLine<const N: usize = 2, const K: usize = 3> {
    /// Number of samples taken; sample k is taken at `start + k · T_s − delay` and delivered at `start + k · T_s`.
    pub taken: u64,
    ring: Array<Sample<N, K>, { LONGEST_DELAY + 1 }>,
}

impl<const N: usize, const K: usize> DelayLine<N, K> {
    /// A delay line; samples up to the start equal the one at the start.
    pub fn new(at_start: Sample<N, K>, delay_samples: f64) -> Self {
        Self { taken: (delay_samples + INSTANT_TOLERANCE) as u64 + 1, ring: Array([at_start; LONGEST_DELAY + 1]) }
    }

    /// Adds a sample.
    pub fn take(&mut self, now: Sample<N, K>) {
        self.ring[(self.taken % (LONGEST_DELAY as u64 + 1)) as usize] = now;
        self.taken += 1;
    }

    /// Sample k; it must be one of the last `LONGEST_DELAY + 1` taken.
    pub fn sample(&self, k: u64) -> Sample<N, K> {
        self.ring[(k % (LONGEST_DELAY as u64 + 1)) as usize]
    }
}
