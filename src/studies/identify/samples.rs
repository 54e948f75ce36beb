//! The samples of a recording: currents by the meaning of a sample, gaps, angle and speed.

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
    Stated,
}

impl Rotation {
    /// Whether the angle counts from a mark of the shaft, and not from its position at the first sample.
    pub fn has_mark(self) -> bool {
        matches!(self, Rotation::Both | Rotation::Angle)
    }
}

/// Uniformly sampled signals, in SI units; NaN where not known.
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
    /// Currents by magnet as recorded, in A; NaN where missing, empty for a magnet that is not used.
    pub current_a: Vec<Vec<f64>>,
    /// By row, a bit for each position, then each current, that was not recorded; short gaps are filled from their neighbours. Empty if none is missing.
    pub missing: Vec<u32>,
    /// Angle of the rotor, unwrapped, in rad; empty if not known.
    pub theta_rad: Vec<f64>,
    /// Speed, in rad/s; empty if not known.
    pub omega_rad_s: Vec<f64>,
    /// Source of angle and speed.
    pub rotation: Rotation,
    /// Jump of the recorded angle when it wraps, in rad as read; `None` if it does not wrap.
    pub wrap_rad: Option<f64>,
    /// Units assumed for the recorded signals: time, positions, currents, angle, speed.
    pub units: Vec<Option<&'static str>>,
    /// Currents that were recorded at another rate, with their places in samples from the first.
    pub apart: Option<Vec<Vec<(f64, f64)>>>,
    /// Remarks, in sentences.
    pub notes: Vec<String>,
}

impl Samples {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.position_m.first().map_or(0, Vec::len)
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether both hold the same positions and currents.
    pub fn has_readings_of(&self, other: &Self) -> bool {
        // NaN where a reading is missing is equal to itself.
        let [own, other] = [self, other].map(|of| of.position_m.iter().chain(&of.current_a).flatten());
        own.map(|value| value.to_bits()).eq(other.map(|value| value.to_bits()))
    }

    /// The currents at every sample; NaN where unavailable.
    pub fn currents(&self, how: Hold) -> Vec<Vec<f64>> {
        match &self.apart {
            Some(apart) => apart.iter().map(|known| signals::resampled(known, self.len(), how)).collect(),
            None => self.current_a.clone(),
        }
    }

    /// Positions, then currents, with NaN in filled gaps as well.
    pub(super) fn unfilled(&self, how: Hold) -> Vec<Vec<f64>> {
        let mut columns = [self.position_m.clone(), self.currents(how)].concat();
        for (at, column) in columns.iter_mut().enumerate() {
            let missing = self.missing.iter().zip(column).filter(|(missing, _)| **missing >> at & 1 != 0);
            missing.for_each(|(_, value)| *value = f64::NAN);
        }
        columns
    }

    /// Sets angle and speed, deriving one from the other or both from the stated speed.
    pub(super) fn set_rotation(&mut self, theta: &Known, omega: &Known, stated_rad_s: Option<f64>) {
        [self.theta_rad, self.omega_rad_s] = [theta, omega].map(|known| signals::straight(known, self.len(), true));
        if self.machine.planes == 0 {
            return;
        }
        self.rotation = match (self.theta_rad.is_empty(), self.omega_rad_s.is_empty(), stated_rad_s) {
            (false, false, _) => Rotation::Both,
            (false, true, _) => Rotation::Angle,
            (true, false, _) => Rotation::Speed,
            (true, true, Some(speed)) => {
                self.omega_rad_s = vec![speed; self.len()];
                self.notes.push(format!("The speed is taken to be {} rad/s, as stated.", significant(speed, 6)));
                Rotation::Stated
            }
            (true, true, None) => Rotation::Unknown,
        };
        if stated_rad_s.is_some() && self.rotation != Rotation::Stated {
            self.notes.push("--speed is not used: the recording has angle or speed.".into());
        }
        let note = match self.rotation {
            Rotation::Both => return,
            Rotation::Angle => {
                self.omega_rad_s = signals::slope(&self.theta_rad, self.step_s);
                "There is no speed; it is the slope of the angle."
            }
            Rotation::Speed | Rotation::Stated => {
                // Trapezoidal rule.
                let mut angle = 0.0;
                let turned = |omega: &[f64]| {
                    angle += 0.5 * (omega[0] + omega[1]) * self.step_s;
                    angle
                };
                self.theta_rad = [0.0].into_iter().chain(self.omega_rad_s.windows(2).map(turned)).collect();
                "There is no angle; it is the integral of the speed, and the phase of the unbalance counts from it."
            }
            Rotation::Unknown => "There is neither angle nor speed: the unbalance cannot be identified.",
        };
        self.notes.push(note.into());
    }
}
