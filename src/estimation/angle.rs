//! Angle, speed and acceleration of the rotor, filtered from measurements.
//!
//! A critically damped g-h-k filter of the measured angle (fading memory of degree two; E. Brookner, *Tracking and Kalman Filtering Made Easy*,
//! 1998, section 1.3), whose memory follows from the noise of the angle: nothing is smoothed where the angle is exact. The noise is found from
//! third differences, in which a constant acceleration does not show. The measured speed starts the filter, and is compared with it.

use std::f64::consts::TAU;

use libm::{cbrt, exp, sincos, sqrt};
use serde::{Deserialize, Serialize};

/// Time constant for white noise of 1 rad on the angle, s. It grows with the cube root of the noise, as in the Kalman filter of a motion whose
/// jerk is white. Noise of 3° leaves 0.4 % in ω at 10 kHz.
const TIME_S: f64 = 0.024;

/// For so long the measured speed is averaged at the start, s: the time constant for noise of 3°.
const START_S: f64 = 9.0e-3;

/// Time constants after which the filter has settled: of a wrong angle at the start `(1 + 6 + 6²/2) e⁻⁶`, 6 %, are left. Without this wait 20 of 24 runs with
/// encoders of 20 and 32 counts and estimated noise were up to 19 deviations off, for the force at a wrong speed passed for one that turns backward; with
/// it 2 are, up to 7.
const SETTLED: f64 = 6.0;

/// Time constant of the means of speeds and noise, s: long beside the differences of a coarse encoder.
const MEAN_TIME_S: f64 = 0.1;

/// The rotation of the rotor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Rotation {
    /// Angle, rad.
    pub theta_rad: f64,
    pub omega_rad_s: f64,
    /// ω̇, rad/s².
    pub acceleration_rad_s2: f64,
    /// Relative variance of the force of an unbalance, `ω² e^{jθ}`, by the noise of the angle.
    pub variance: f64,
    /// The last measured angle, rad, and its last first and second differences.
    measured_rad: [f64; 3],
    /// Variance of the measured angle, rad².
    noise_rad2: f64,
    /// Means of the measured speed and of the differences of measured angles, rad/s.
    mean_rad_s: [f64; 2],
    /// Samples since the start.
    samples: u32,
}

impl Rotation {
    /// At a first sample.
    pub fn start(theta_rad: f64, omega_rad_s: f64) -> Self {
        Self { theta_rad, omega_rad_s, measured_rad: [theta_rad, 0.0, 0.0], samples: 1, ..Self::default() }
    }

    /// Goes on for a sample without a measurement.
    pub fn coast(&mut self, step_s: f64) {
        self.predict(step_s);
        self.measured_rad = [self.theta_rad, self.omega_rad_s * step_s, self.acceleration_rad_s2 * step_s * step_s];
    }

    fn predict(&mut self, step_s: f64) {
        self.theta_rad += (self.omega_rad_s + 0.5 * self.acceleration_rad_s2 * step_s) * step_s;
        self.omega_rad_s += self.acceleration_rad_s2 * step_s;
    }

    /// Takes in the measured angle and speed one sample later.
    pub fn advance(&mut self, step_s: f64, theta_rad: f64, omega_rad_s: f64) {
        self.predict(step_s);
        let error = turned(self.theta_rad, theta_rad);
        let first = turned(self.measured_rad[0], theta_rad);
        let part = (step_s / MEAN_TIME_S).min(1.0);
        let is_new = error.abs() > 1.0;
        // The first angle of all has no difference.
        let follows_new = self.samples == 1 && self.measured_rad[1] != 0.0;
        // New angles one after the other are none in rad.
        if !is_new || follows_new {
            self.mean_rad_s[0] += (omega_rad_s - self.mean_rad_s[0]) * part;
            self.mean_rad_s[1] += (first / step_s - self.mean_rad_s[1]) * part;
        }
        if is_new {
            // So far off it is no noise.
            let Self { mean_rad_s, noise_rad2, .. } = *self;
            let measured_rad = [theta_rad, first, 0.0];
            *self = Self { measured_rad, mean_rad_s, noise_rad2, ..Self::start(theta_rad, omega_rad_s) };
            return;
        }
        self.samples = self.samples.saturating_add(1);
        let second = first - self.measured_rad[1];
        let third = second - self.measured_rad[2];
        self.measured_rad = [theta_rad, first, second];
        if self.samples > 3 {
            // They have 20 times the variance of white noise.
            let part = part.max(1.0 / f64::from(self.samples - 3));
            self.noise_rad2 += (third * third / 20.0 - self.noise_rad2) * part;
        }
        if f64::from(self.samples) * step_s < START_S {
            self.omega_rad_s += (omega_rad_s - self.omega_rad_s) / f64::from(self.samples);
        }
        if self.samples <= 4 {
            return;
        }
        let r = exp(-step_s / self.memory_s());
        let left = 1.0 - r;
        self.theta_rad += (1.0 - r * r * r) * error;
        self.omega_rad_s += 1.5 * left * left * (1.0 + r) * error / step_s;
        self.acceleration_rad_s2 += left * left * left * error / (step_s * step_s);
        // Variances of the smoothed angle and of the speed, for r near 1; at first the speed is no better than that between the first and the
        // last angle.
        let samples = f64::from(self.samples);
        let of_speed = (2.0 / (samples * samples)).max(1.75 * left * left * left) / (step_s * step_s);
        let relative = 2.0 / self.omega_rad_s.abs().max(1.0);
        self.variance = self.noise_rad2 * ((33.0 / 16.0 * left).min(1.0) + relative * relative * of_speed);
    }

    /// Memory of the filter, s.
    fn memory_s(&self) -> f64 {
        TIME_S * cbrt(sqrt(self.noise_rad2))
    }

    /// Whether angle and speed still show how the filter started.
    pub fn is_settling(&self, step_s: f64) -> bool {
        // Noise of 1 rad is a new angle each time: later than this no memory needs a look.
        let time_s = f64::from(self.samples) * step_s;
        time_s < SETTLED * TIME_S && time_s < SETTLED * self.memory_s()
    }

    /// Whether the measured speed is not that of the angle: in other units, with the other sign, missing. A tenth is more than the
    /// error of an encoder, and 3 rad/s three counts of one of 64 within the time of the means.
    pub fn contradicts(&self) -> bool {
        let [speed, turning] = self.mean_rad_s;
        (speed - turning).abs() > 0.1 * speed.abs().min(turning.abs()) + 3.0
    }

    /// The rotation between this one and another, at a part of the time.
    pub fn between(&self, other: &Self, part: f64) -> Self {
        let omega_rad_s = self.omega_rad_s + part * (other.omega_rad_s - self.omega_rad_s);
        Self { theta_rad: self.theta_rad + part * turned(self.theta_rad, other.theta_rad), omega_rad_s, ..*other }
    }
}

/// Cosine and sine of an angle.
pub fn turn(angle_rad: f64) -> [f64; 2] {
    let (sin, cos) = sincos(angle_rad);
    [cos, sin]
}

/// By how much an angle has grown, rad in [−π, π], the angles wrapped or not.
#[inline(always)]
pub fn turned(from_rad: f64, to_rad: f64) -> f64 {
    let by = to_rad - from_rad;
    by - TAU * (by / TAU).round()
}
