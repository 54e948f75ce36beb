//! Checks of incoming samples: usable, missing or repeated, stuck sensors, and the rotation of the rotor.

use nalgebra::SVector;
use serde::{Deserialize, Serialize};

use super::angle::Rotation;
use crate::bearing::array;

/// A position sensor is stuck if it repeats a value to the last bit for this many samples while others move. More missing samples in a row mean that the
/// measurement is lost.
pub const STUCK_SAMPLES: u32 = 25;

/// Whether a sample can be used.
#[derive(Debug)]
pub enum SampleStatus<const N: usize> {
    /// Usable, except for stuck sensors, a measured speed that is not that of the angle, and an angle filter that has not settled.
    Usable { stuck: [bool; N], wrong_speed: bool, settling: bool },
    /// Not finite, or outside the gap.
    Missing,
    /// Equal to the sample before in all positions and currents.
    Repeated,
}

/// The last readings of N positions and K currents, and their statistics.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Readings<const N: usize, const K: usize> {
    position_m: SVector<f64, N>,
    current_a: SVector<f64, K>,
    /// For each position: samples for which it has not changed, its smallest step and its mean step, m.
    unchanged: SVector<u32, N>,
    min_step_m: SVector<f64, N>,
    mean_step_m: SVector<f64, N>,
    /// Missing samples in a row.
    pub missing: u32,
    rotation: Option<Rotation>,
}

impl<const N: usize, const K: usize> Readings<N, K> {
    pub fn start() -> Self {
        Self {
            position_m: SVector::zeros(),
            current_a: SVector::zeros(),
            unchanged: SVector::zeros(),
            min_step_m: SVector::repeat(f64::MAX),
            mean_step_m: SVector::zeros(),
            missing: 0,
            rotation: None,
        }
    }

    /// The filtered rotation at the present sample.
    pub fn rotation(&self) -> Rotation {
        self.rotation.unwrap_or(Rotation::start(0.0, 0.0))
    }

    /// Checks a sample with the rotor's angle, rad, and speed, rad/s; `in_gap` states whether the rotor is within the gaps of all magnets.
    pub fn update(
        &mut self,
        position_m: [f64; N],
        current_a: [f64; K],
        [theta_rad, omega_rad_s]: [f64; 2],
        step_s: f64,
        in_gap: bool,
    ) -> SampleStatus<N> {
        // No real measurement is that large, in any unit; the squares of smaller ones do not overflow.
        let usable = |x: f64| x.abs() < 1.0e12;
        let has_rotation = usable(theta_rad) && usable(omega_rad_s);
        match &mut self.rotation {
            Some(rotation) if has_rotation => rotation.advance(step_s, theta_rad, omega_rad_s),
            Some(rotation) => rotation.coast(step_s),
            None if has_rotation => self.rotation = Some(Rotation::start(theta_rad, omega_rad_s)),
            None => (),
        }
        if !(has_rotation && in_gap && position_m.iter().chain(&current_a).all(|x| usable(*x))) {
            self.missing = self.missing.saturating_add(1);
            return SampleStatus::Missing;
        }
        let (position, current) = (SVector::from(position_m), SVector::from(current_a));
        let repeated = position == self.position_m && current == self.current_a;
        for n in 0..N {
            let step_m = (position[n] - self.position_m[n]).abs();
            if step_m == 0.0 {
                self.unchanged[n] = self.unchanged[n].saturating_add(1);
            } else {
                self.unchanged[n] = 0;
                self.min_step_m[n] = self.min_step_m[n].min(step_m);
                self.mean_step_m[n] += (step_m - self.mean_step_m[n]) / f64::from(STUCK_SAMPLES);
            }
        }
        (self.position_m, self.current_a) = (position, current);
        if repeated {
            self.missing = self.missing.saturating_add(1);
            return SampleStatus::Repeated;
        }
        self.missing = 0;
        let moving = self.unchanged.min() == 0;
        // A mean step of less than eight times the smallest one is that of a rotor at rest and a quantised sensor.
        let stuck = |n: usize| self.unchanged[n] >= STUCK_SAMPLES && self.mean_step_m[n] > 8.0 * self.min_step_m[n];
        let (wrong_speed, settling) = (self.rotation().is_speed_wrong(), self.rotation().is_settling(step_s));
        SampleStatus::Usable { stuck: array::from_fn(|n| moving && stuck(n)), wrong_speed, settling }
    }
}
