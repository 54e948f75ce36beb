//! Samples as they come in: which can be used, which are missing, which sensor is stuck, and the rotation of the rotor.

use nalgebra::SVector;
use serde::{Deserialize, Serialize};

use super::angle::Rotation;

/// As many samples of one position equal to the last bit, while others move, are a sensor that is stuck. More missing samples in a row are a
/// measurement that is lost.
pub const STUCK_SAMPLES: u32 = 25;

/// How a sample can be used.
#[derive(Debug)]
pub enum Taken<const N: usize> {
    /// All of it, but for sensors that are stuck, a measured speed that is not that of the angle, and an angle whose filter has not settled.
    Usable { stuck: [bool; N], contradiction: bool, settling: bool },
    /// Nothing: not finite, or outside the gap.
    Missing,
    /// Nothing: the positions and currents of the sample before.
    Repeated,
}

/// The readings of N positions and K currents of late.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Readings<const N: usize, const K: usize> {
    position_m: SVector<f64, N>,
    current_a: SVector<f64, K>,
    /// Since how many samples each position has read the same, its smallest step and the mean of its steps, m.
    same: SVector<u32, N>,
    smallest_m: SVector<f64, N>,
    mean_m: SVector<f64, N>,
    /// Missing samples in a row.
    pub missing: u32,
    rotation: Option<Rotation>,
}

impl<const N: usize, const K: usize> Readings<N, K> {
    pub fn start() -> Self {
        Self {
            position_m: SVector::zeros(),
            current_a: SVector::zeros(),
            same: SVector::zeros(),
            smallest_m: SVector::repeat(f64::MAX),
            mean_m: SVector::zeros(),
            missing: 0,
            rotation: None,
        }
    }

    /// The rotation at the last sample that could be used.
    pub fn rotation(&self) -> Rotation {
        self.rotation.unwrap_or(Rotation::start(0.0, 0.0))
    }

    /// Takes in a sample with the rotor's angle, rad, and speed, rad/s; `in_gap` says whether the rotor is within the gaps of all magnets.
    pub fn take(
        &mut self,
        position_m: [f64; N],
        current_a: [f64; K],
        [theta_rad, omega_rad_s]: [f64; 2],
        step_s: f64,
        in_gap: bool,
    ) -> Taken<N> {
        // No measurement of a machine is as large, whatever its unit; squares of it do not overflow.
        let usable = |x: f64| x.abs() < 1.0e12;
        let turning = usable(theta_rad) && usable(omega_rad_s);
        match &mut self.rotation {
            Some(rotation) if turning => rotation.advance(step_s, theta_rad, omega_rad_s),
            Some(rotation) => rotation.coast(step_s),
            None if turning => self.rotation = Some(Rotation::start(theta_rad, omega_rad_s)),
            None => (),
        }
        if !(turning && in_gap && position_m.iter().chain(&current_a).all(|x| usable(*x))) {
            self.missing = self.missing.saturating_add(1);
            return Taken::Missing;
        }
        let (position, current) = (SVector::from(position_m), SVector::from(current_a));
        let repeated = position == self.position_m && current == self.current_a;
        for n in 0..N {
            let step_m = (position[n] - self.position_m[n]).abs();
            if step_m == 0.0 {
                self.same[n] = self.same[n].saturating_add(1);
            } else {
                self.same[n] = 0;
                self.smallest_m[n] = self.smallest_m[n].min(step_m);
                self.mean_m[n] += (step_m - self.mean_m[n]) / f64::from(STUCK_SAMPLES);
            }
        }
        (self.position_m, self.current_a) = (position, current);
        if repeated {
            self.missing = self.missing.saturating_add(1);
            return Taken::Repeated;
        }
        self.missing = 0;
        let moving = self.same.min() == 0;
        // Steps of less than eight times the smallest one are those of a still rotor behind a quantised sensor.
        let stuck = |n: usize| self.same[n] >= STUCK_SAMPLES && self.mean_m[n] > 8.0 * self.smallest_m[n];
        let (contradiction, settling) = (self.rotation().contradicts(), self.rotation().is_settling(step_s));
        Taken::Usable { stuck: std::array::from_fn(|n| moving && stuck(n)), contradiction, settling }
    }
}
