//! Angle, speed and acceleration of the rotor, filtered from measurements.
//!
//! A critically damped g-h-k filter of the measured angle (fading memory of degree two; E. Brookner, *Tracking and Kalman Filtering Made Easy*,
//! 1998, section 1.3). Its memory follows from the noise of the angle: an exact angle is not smoothed. The noise is estimated from third differences,
//! which a constant acceleration does not affect. The measured speed initialises the filter and is compared with it later.

use std::f64::consts::TAU;

use libm::{cbrt, exp, sincos, sqrt};
use serde::{Deserialize, Serialize};

/// Time constant for white noise of 1 rad on the angle, s. It grows with the cube root of the noise, as in the Kalman filter of a motion with
/// white jerk. Noise of 3° leaves an error of 0.4 % in ω at 10 kHz.
const TIME_S: f64 = 0.024;

/// Time over which the measured speed is averaged at the start, s: the time constant for noise of 3°.
const START_S: f64 = 9.0e-3;

/// Time constants after which the filter has settled: `(1 + 6 + 6²/2) e⁻⁶`, 6 %, of an initial angle error are left. Without this wait 20 of 24 runs with
/// encoders of 20 and 32 counts and estimated noise were off by up to 19 standard deviations, because the force at a wrong speed was taken for a
/// backward force; with it 2 are, by up to 7.
const SETTLED: f64 = 6.0;

/// Time constant of the means of speeds and noise, s: long compared with the intervals between counts of a coarse encoder.
const MEAN_TIME_S: f64 = 0.1;

/// The rotation of the rotor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Rotation {
    /// Angle, rad.
    pub theta_rad: f64,
    pub omega_rad_s: f64,
    /// ω̇, rad/s².
    pub acceleration_rad_s2: f64,
    /// Relative variance of the unbalance force, `ω² e^{jθ}`, due to the noise of the angle.
    pub variance: f64,
    /// The last measured angle, rad, and its latest first and second differences.
    measured_rad: [f64; 3],
    /// Variance of the measured angle, rad².
    noise_rad2: f64,
    /// Means of the measured speed and of the speed from differences of measured angles, rad/s.
    mean_rad_s: [f64; 2],
    /// Samples since the start.
    samples: u32,
    /// Whether the last angle was too far off, which the next one confirms or not.
    has_jumped: bool,
}

impl Rotation {
    /// The rotation at a first sample.
    pub fn start(theta_rad: f64, omega_rad_s: f64) -> Self {
        Self { theta_rad, omega_rad_s, measured_rad: [theta_rad, 0.0, 0.0], samples: 1, ..Self::default() }
    }

    /// Predicts over a sample without a measurement.
    pub fn coast(&mut self, step_s: f64) {
        self.predict(step_s);
        self.measured_rad = [self.theta_rad, self.omega_rad_s * step_s, self.acceleration_rad_s2 * step_s * step_s];
    }

    fn predict(&mut self, step_s: f64) {
        self.theta_rad += (self.omega_rad_s + 0.5 * self.acceleration_rad_s2 * step_s) * step_s;
        self.omega_rad_s += self.acceleration_rad_s2 * step_s;
    }

    /// Updates the filter with the angle and speed measured one sample later.
    pub fn advance(&mut self, step_s: f64, theta_rad: f64, omega_rad_s: f64) {
        self.predict(step_s);
        let error = angle_difference(self.theta_rad, theta_rad);
        let jumps = error.abs() > 1.0;
        let has_jumped = self.has_jumped;
        self.has_jumped = jumps && !has_jumped;
        if self.has_jumped {
            // Too far off to be noise: a wrong reading, which counts as missing, unless the next one confirms it.
            self.measured_rad[0] = theta_rad;
            return;
        }
        let first = match has_jumped && !jumps {
            true => self.omega_rad_s * step_s,
            false => angle_difference(self.measured_rad[0], theta_rad),
        };
        let weight = (step_s / MEAN_TIME_S).min(1.0);
        self.mean_rad_s[0] += (omega_rad_s - self.mean_rad_s[0]) * weight;
        self.mean_rad_s[1] += (first / step_s - self.mean_rad_s[1]) * weight;
        if jumps {
            // Start again.
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
            // Third differences have 20 times the variance of white noise.
            let weight = weight.max(1.0 / f64::from(self.samples - 3));
            self.noise_rad2 += (third * third / 20.0 - self.noise_rad2) * weight;
        }
        if f64::from(self.samples) * step_s < START_S {
            self.omega_rad_s += (omega_rad_s - self.omega_rad_s) / f64::from(self.samples);
        }
        if self.samples <= 4 {
            return;
        }
        let r = exp(-step_s / self.time_constant_s());
        let q = 1.0 - r;
        self.theta_rad += (1.0 - r * r * r) * error;
        self.omega_rad_s += 1.5 * q * q * (1.0 + r) * error / step_s;
        self.acceleration_rad_s2 += q * q * q * error / (step_s * step_s);
        // Variances of the smoothed angle and of the speed, for r near 1; at first the speed is no better than that from the first and last angles.
        let samples = f64::from(self.samples);
        let speed_variance = (2.0 / (samples * samples)).max(1.75 * q * q * q) / (step_s * step_s);
        let relative = 2.0 / self.omega_rad_s.abs().max(1.0);
        self.variance = self.noise_rad2 * ((33.0 / 16.0 * q).min(1.0) + relative * relative * speed_variance);
    }

    /// Time constant of the filter, s.
    fn time_constant_s(&self) -> f64 {
        TIME_S * cbrt(sqrt(self.noise_rad2))
    }

    /// Whether angle and speed still depend on the initial values.
    pub fn is_settling(&self, step_s: f64) -> bool {
        // No time constant exceeds that for noise of 1 rad, at which every angle is a jump.
        let time_s = f64::from(self.samples) * step_s;
        time_s < SETTLED * TIME_S && time_s < SETTLED * self.time_constant_s()
    }

    /// Whether the measured speed is not that of the angle: in other units, with the wrong sign, missing. A tenth is more than the error of an encoder;
    /// 3 rad/s are three counts of an encoder of 64 within the time constant of the means.
    pub fn is_speed_wrong(&self) -> bool {
        let [measured, from_angle] = self.mean_rad_s;
        (measured - from_angle).abs() > 0.1 * measured.abs().min(from_angle.abs()) + 3.0
    }

    /// The rotation interpolated between this one and another, at a fraction of the time.
    pub fn between(&self, other: &Self, fraction: f64) -> Self {
        let omega_rad_s = self.omega_rad_s + fraction * (other.omega_rad_s - self.omega_rad_s);
        let theta_rad = self.theta_rad + fraction * angle_difference(self.theta_rad, other.theta_rad);
        Self { theta_rad, omega_rad_s, ..*other }
    }
}

/// Cosine and sine of an angle.
pub fn cos_sin(angle_rad: f64) -> [f64; 2] {
    let (sin, cos) = sincos(angle_rad);
    [cos, sin]
}

/// Difference of two angles, wrapped or not, rad in [−π, π].
#[inline(always)]
pub fn angle_difference(from_rad: f64, to_rad: f64) -> f64 {
    let difference = to_rad - from_rad;
    difference - TAU * (difference / TAU).round()
}
