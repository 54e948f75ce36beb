//! The samples of a recording: their currents by what a sample stands for, their gaps, angle and speed.

use super::signals::{self, Known};
use super::units::significant;
use crate::estimation::Hold;
use crate::machine::Machine;

/// Where angle and speed of the rotor come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rotation {
    /// Neither is known.
    #[default]
    Unknown,
    /// Both were recorded.
    Both,
    /// The angle was recorded; the speed is its slope.
    Angle,
    /// The speed was recorded; the angle is its integral, from 0 at the first sample.
    Speed,
    /// The speed is stated; the angle is its integral.
    Told,
}

/// Signals at a uniform pace, in SI units; NaN where nothing is known.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Samples {
    /// The machine.
    pub machine: &'static Machine,
    /// Instant of the first sample, in seconds.
    pub start_s: f64,
    /// Sample time, in seconds.
    pub step_s: f64,
    /// Positions in the order of the readings, in m.
    pub position_m: Vec<Vec<f64>>,
    /// Currents by magnet as recorded, in A; NaN where there was none, and empty for a magnet that is not used.
    pub current_a: Vec<Vec<f64>>,
    /// By row, which positions and currents were not recorded, one bit for each of them in this order; short gaps are filled from their neighbours. Empty if
    /// nothing is missing.
    pub missing: Vec<u32>,
    /// Angle of the rotor, unwrapped, in rad; empty if not known.
    pub theta_rad: Vec<f64>,
    /// Speed, in rad/s; empty if not known.
    pub omega_rad_s: Vec<f64>,
    /// Where the two come from.
    pub rotation: Rotation,
    /// By how much the recorded angle jumps back when it wraps, in rad as read; none if it does not.
    pub wrap_rad: Option<f64>,
    /// The units that the recorded signals were taken to be in: time, positions, currents, angle, speed.
    pub units: Vec<Option<&'static str>>,
    /// The currents at places of their own, in samples from the first, if they were recorded at another rate.
    pub apart: Option<Vec<Vec<(f64, f64)>>>,
    /// Remarks, in sentences.
    pub notes: Vec<String>,
}

impl Samples {
    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.position_m.first().map_or(0, Vec::len)
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The currents with a value at every sample where one can be had.
    #[must_use]
    pub fn currents(&self, how: Hold) -> Vec<Vec<f64>> {
        match &self.apart {
            Some(apart) => apart.iter().map(|current| signals::resampled(current, self.len(), how)).collect(),
            None => self.current_a.clone(),
        }
    }

    /// Positions, then currents, NaN also where a gap was filled.
    pub(super) fn unfilled(&self) -> Vec<Vec<f64>> {
        let mut columns = [self.position_m.clone(), self.currents(Hold::Linear)].concat();
        for (at, column) in columns.iter_mut().enumerate() {
            let missing = self.missing.iter().zip(column).filter(|(missing, _)| **missing >> at & 1 != 0);
            missing.for_each(|(_, value)| *value = f64::NAN);
        }
        columns
    }

    /// Takes over angle and speed, and completes one from the other or from the speed that was told.
    pub(super) fn take_rotation(&mut self, theta: &Known, omega: &Known, told_rad_s: Option<f64>) {
        let count = |known: &Known| if known.is_empty() { 0 } else { self.len() };
        let [theta, omega] = [theta, omega].map(|known| signals::straight(known, count(known), true));
        (self.theta_rad, self.omega_rad_s) = (theta, omega);
        if self.machine.planes == 0 {
            return;
        }
        self.rotation = match (self.theta_rad.is_empty(), self.omega_rad_s.is_empty(), told_rad_s) {
            (false, false, _) => Rotation::Both,
            (false, true, _) => Rotation::Angle,
            (true, false, _) => Rotation::Speed,
            (true, true, Some(speed)) => {
                self.omega_rad_s = vec![speed; self.len()];
                self.notes.push(format!("The speed is taken to be {} rad/s, as stated.", significant(speed, 6)));
                Rotation::Told
            }
            (true, true, None) => Rotation::Unknown,
        };
        if told_rad_s.is_some() && self.rotation != Rotation::Told {
            self.notes.push("--speed is not used: the recording has angle or speed.".into());
        }
        let note = match self.rotation {
            Rotation::Both => return,
            Rotation::Angle => {
                self.omega_rad_s = signals::slope(&self.theta_rad, self.step_s);
                "There is no speed; it is the slope of the angle."
            }
            Rotation::Speed | Rotation::Told => {
                let mut angle = 0.0;
                let turned = |omega: &f64| {
                    angle += omega * self.step_s;
                    angle
                };
                self.theta_rad =
                    [0.0].into_iter().chain(self.omega_rad_s.iter().map(turned)).take(self.len()).collect();
                "There is no angle; it is the integral of the speed, and the phase of the unbalance counts from it."
            }
            Rotation::Unknown => "There is neither angle nor speed: the unbalance cannot be identified.",
        };
        self.notes.push(note.into());
    }
}
