//! A recording as the likelihood takes it, and what it shows without a model.

use std::f64::consts::TAU;

use crate::estimation::Hold;
use crate::studies::identify::Stated;
use crate::studies::identify::likelihood::{Missing, Origin, Part, Recording};
use crate::studies::identify::plausible::REST_RAD_S;
use crate::studies::identify::samples::{Rotation, Samples};

/// The recording of a machine, if a current sample stands for this.
pub fn recording(samples: &Samples, stated: &Stated, hold: Hold) -> Recording {
    let (count, position_m, mut current_a) = (samples.len(), samples.position_m.clone(), samples.currents(hold));
    let missing = missing(samples, &mut current_a);
    let known = samples.rotation != Rotation::Unknown;
    let rotation = |column: &[f64]| if known && !column.is_empty() { column.to_vec() } else { vec![0.0; count] };
    let (theta_rad, omega_rad_s) = (rotation(&samples.theta_rad), rotation(&samples.omega_rad_s));
    let finite = |j: usize| {
        let signals = position_m.iter().chain(&current_a).chain([&theta_rad, &omega_rad_s]);
        signals.map(|signal| signal[j]).all(f64::is_finite)
    };
    let usable = (0..count).map(finite).collect();
    let [position_noise_m, current_noise_a] = stated.noise.map(|noise| (noise > 0.0).then_some(noise));
    Recording {
        step_s: samples.step_s,
        position_m,
        current_a,
        theta_rad,
        omega_rad_s,
        usable,
        missing,
        hold,
        position_noise_m,
        current_noise_a,
    }
}

/// Time over which the force of a magnet may be unknown, s: about that in which an unstable rotor multiplies its errors, √(m/ks). With bench parameters, searches crept along
/// longer ones, where the trajectory follows its own linearisation.
const LONGEST_S: f64 = 0.01;

/// Samples that were not recorded. A current that is missing for a while, by itself, gets a straight line: the motion goes on without its force being known.
fn missing(samples: &Samples, current_a: &mut [Vec<f64>]) -> Vec<Missing> {
    let (positions, magnets) = (samples.position_m.len(), current_a.len());
    let lacks = |row: usize, signal: usize| samples.missing[row] >> signal & 1 != 0;
    let mut missing = vec![Missing::default(); samples.missing.len()];
    for (row, missing) in missing.iter_mut().enumerate() {
        missing.position = (0..positions).any(|signal| lacks(row, signal));
        for k in (0..magnets).filter(|k| lacks(row, positions + k)) {
            let is_filled = current_a[k][row].is_finite();
            missing.current[k] = if is_filled { Origin::Filled } else { Origin::Unknown };
        }
    }
    for (k, current_a) in current_a.iter_mut().enumerate() {
        let known: Vec<usize> = (0..missing.len()).filter(|row| missing[*row].current[k] != Origin::Unknown).collect();
        let gaps = known.iter().zip(&known[1.min(known.len())..]);
        for (from, to) in gaps.filter(|(from, to)| (*to - *from) as f64 * samples.step_s <= LONGEST_S) {
            let [first, last] = [from, to].map(|row| current_a[*row]);
            for (at, current_a) in current_a[*from..*to].iter_mut().enumerate().skip(1) {
                *current_a = first + (last - first) * at as f64 / (to - from) as f64;
            }
        }
    }
    missing
}

impl Recording {
    /// Some of its rows.
    pub(in crate::studies::identify) fn part(&self, of: std::ops::Range<usize>) -> Self {
        let each = |columns: &[Vec<f64>]| columns.iter().map(|column| column[of.clone()].to_vec()).collect();
        Self {
            position_m: each(&self.position_m),
            current_a: each(&self.current_a),
            theta_rad: self.theta_rad[of.clone()].to_vec(),
            omega_rad_s: self.omega_rad_s[of.clone()].to_vec(),
            usable: self.usable[of.clone()].to_vec(),
            missing: self.missing.get(of.clone()).unwrap_or_default().to_vec(),
            ..*self
        }
    }

    /// The rows that are used.
    pub(in crate::studies::identify) fn used(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.usable.len()).filter(|j| self.usable[*j])
    }

    pub(in crate::studies::identify) fn turns(&self) -> f64 {
        self.used().map(|j| self.omega_rad_s[j].abs()).sum::<f64>() * self.step_s / TAU
    }

    pub(in crate::studies::identify) fn at_rest(&self) -> bool {
        self.turns() * TAU < REST_RAD_S * self.step_s * self.usable.len() as f64
    }

    /// Mean of the rows that are used, and the mean square of what differs from it.
    fn spread(&self, of: &[f64]) -> [f64; 2] {
        let count = self.used().count().max(1) as f64;
        let mean = self.used().map(|j| of[j]).sum::<f64>() / count;
        [mean, self.used().map(|j| (of[j] - mean).powi(2)).sum::<f64>() / count]
    }

    /// rms of the currents of a part of the motion, and of its positions about their mean.
    pub(in crate::studies::identify) fn sizes(&self, part: &Part) -> [f64; 2] {
        let count = self.used().count().max(1) as f64;
        let square = |of: &Vec<f64>| self.used().map(|j| of[j] * of[j]).sum::<f64>();
        let (magnets, coordinates) = (part.body.magnets(), part.body.coordinates());
        let currents = self.current_a[part.magnets..][..magnets].iter().map(square).sum::<f64>();
        let positions = self.position_m[part.positions..][..coordinates].iter();
        let motion: f64 = positions.map(|position_m| self.spread(position_m)[1]).sum();
        [(currents / (magnets as f64 * count)).sqrt(), motion.sqrt()]
    }

    /// Whether neither the rotor nor its currents vary beyond a few per cent.
    pub(in crate::studies::identify) fn still(&self, parts: &[Part]) -> bool {
        let motion_rms = parts.iter().map(|part| self.sizes(part)[1]).fold(0.0, f64::max);
        let varies = self.current_a.iter().map(|current_a| self.spread(current_a));
        motion_rms < 5e-6 && !varies.into_iter().any(|[mean, square]| square.sqrt() > 0.1 * mean.abs())
    }
}
