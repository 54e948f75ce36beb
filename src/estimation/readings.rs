//! Samples as they come in: which can be used, which are missing, which sensor is stuck, and the rotation of the rotor.

use nalgebra::SVector;
use serde::{Deserialize, Serialize};

use super::angle::Rotation;
use super::prediction_error::BRIDGED;

/// As many samples of one position equal to the last bit, while others move, are a sensor that is stuck. More missing samples in a row are a
/// measurement that is lost.
pub const STUCK_SAMPLES: u32 = 25;

/// How a sample can be used.
#[derive(Debug)]
pub enum Taken<const N: usize> {
    /// All of it, but for sensors that are stuck, and a measured speed that is not that of the angle.
    Usable { stuck: [bool; N], contradiction: bool },
    /// Nothing: not finite, or outside the gap.
    Missing,
    /// Nothing: readings of the sample before.
    Repeated,
}

/// One reading of late, in m or A.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Reading {
    last: f64,
    /// Since how many samples it has been the same.
    same: u32,
    /// The smallest of its steps, if there was one, and their mean.
    smallest: Option<f64>,
    mean: f64,
}

impl Reading {
    fn take(&mut self, now: f64) {
        let step = (now - self.last).abs();
        self.last = now;
        if step == 0.0 {
            self.same = self.same.saturating_add(1);
        } else {
            self.same = 0;
            self.smallest = Some(self.smallest.map_or(step, |smallest| smallest.min(step)));
            self.mean += (step - self.mean) / f64::from(STUCK_SAMPLES);
        }
    }

    /// Whether it is not by its steps that it may stay the same: steps of less than eight times the smallest one are those of a still rotor behind a
    /// quantised sensor.
    fn is_fine(&self) -> bool {
        self.smallest.is_some_and(|smallest| self.mean > 8.0 * smallest)
    }
}

/// The readings of N positions and K currents of late.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Readings<const N: usize, const K: usize> {
    positions: SVector<Reading, N>,
    currents: SVector<Reading, K>,
    /// Missing samples in a row.
    missing: u32,
    rotation: Option<Rotation>,
}

impl<const N: usize, const K: usize> Readings<N, K> {
    pub fn start() -> Self {
        let (positions, currents) = (SVector::repeat(Reading::default()), SVector::repeat(Reading::default()));
        Self { positions, currents, missing: 0, rotation: None }
    }

    /// Whether more samples are missing than a gap has.
    pub fn are_lost(&self) -> bool {
        self.missing > STUCK_SAMPLES
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
        let of_positions = self.positions.iter_mut().zip(position_m);
        of_positions.chain(self.currents.iter_mut().zip(current_a)).for_each(|(reading, now)| reading.take(now));
        let all = || self.positions.iter().chain(&self.currents);
        // One reading that was not taken anew makes a gap as long as that can be bridged: a current may really stay the same.
        let held = |of: &Reading| of.is_fine() && (1..=BRIDGED).contains(&of.same);
        if all().all(|of| of.same > 0) || all().any(held) {
            self.missing = self.missing.saturating_add(1);
            return Taken::Repeated;
        }
        self.missing = 0;
        let moving = self.positions.iter().any(|of| of.same == 0);
        let stuck = |of: &Reading| moving && of.same >= STUCK_SAMPLES && of.is_fine();
        let contradiction = self.rotation().contradicts();
        Taken::Usable { stuck: std::array::from_fn(|n| stuck(&self.positions[n])), contradiction }
    }
}
