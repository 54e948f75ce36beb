//! The columns of a recording as the likelihood takes them.

use crate::estimation::{EstimatorConfig, Hold};
use crate::studies::identify::likelihood::{self, Missing, Origin};
use crate::studies::identify::read::{REST_RAD_S, Rotation, Samples};

/// Columns of a recording.
#[derive(Clone, Debug, Default)]
pub struct Columns {
    pub step_s: f64,
    pub position_m: Vec<[f64; 2]>,
    pub current_a: Vec<[f64; 3]>,
    pub theta_rad: Vec<f64>,
    pub omega_rad_s: Vec<f64>,
    pub usable: Vec<bool>,
    pub missing: Vec<Missing>,
}

/// The columns, if a current sample stands for this.
pub fn columns(samples: &Samples, hold: Hold) -> Columns {
    let currents = samples.currents(hold);
    let count = samples.len();
    let position_m: Vec<[f64; 2]> = (0..count).map(|j| [samples.position_m[0][j], samples.position_m[1][j]]).collect();
    let mut current_a: Vec<[f64; 3]> = (0..count).map(|j| [currents[0][j], currents[1][j], currents[2][j]]).collect();
    let missing = missing(samples, &mut current_a);
    let rotation = |column: &[f64]| if column.is_empty() { vec![0.0; count] } else { column.to_vec() };
    let known = samples.rotation != Rotation::Unknown;
    let theta_rad = rotation(if known { &samples.theta_rad } else { &[] });
    let omega_rad_s = rotation(if known { &samples.omega_rad_s } else { &[] });
    let finite = |j: usize| {
        position_m[j].iter().chain(&current_a[j]).chain([&theta_rad[j], &omega_rad_s[j]]).all(|value| value.is_finite())
    };
    let usable = (0..count).map(finite).collect();
    Columns { step_s: samples.step_s, position_m, current_a, theta_rad, omega_rad_s, usable, missing }
}

/// Samples that were not recorded. A current that is missing for long, by itself, gets a straight line: the motion goes on without its force being known.
fn missing(samples: &Samples, current_a: &mut [[f64; 3]]) -> Vec<Missing> {
    let positions = samples.position_m.len();
    let lacks = |row: usize, signal: usize| samples.missing[row] >> signal & 1 != 0;
    let mut missing = vec![Missing::default(); samples.missing.len()];
    for (row, missing) in missing.iter_mut().enumerate() {
        missing.position = (0..positions).any(|signal| lacks(row, signal));
        for k in (0..3).filter(|k| lacks(row, positions + k)) {
            let is_filled = current_a[row][k].is_finite();
            missing.current[k] = if is_filled { Origin::Filled } else { Origin::Unknown };
        }
    }
    let bridge = |k: usize| {
        let known: Vec<usize> = (0..missing.len()).filter(|row| missing[*row].current[k] != Origin::Unknown).collect();
        for (from, to) in known.iter().zip(&known[1.min(known.len())..]) {
            let [first, last] = [from, to].map(|row| current_a[*row][k]);
            for (at, current_a) in current_a[*from..*to].iter_mut().enumerate().skip(1) {
                current_a[k] = first + (last - first) * at as f64 / (to - from) as f64;
            }
        }
    };
    (0..3).for_each(bridge);
    missing
}

impl Columns {
    pub fn recording(&self, config: &EstimatorConfig, hold: Hold) -> likelihood::Recording<'_> {
        likelihood::Recording {
            step_s: self.step_s,
            position_m: &self.position_m,
            current_a: &self.current_a,
            theta_rad: &self.theta_rad,
            omega_rad_s: &self.omega_rad_s,
            usable: &self.usable,
            missing: &self.missing,
            hold,
            position_noise_m: (config.position_noise_m > 0.0).then_some(config.position_noise_m),
            current_noise_a: (config.current_noise_a > 0.0).then_some(config.current_noise_a),
        }
    }

    pub fn part(&self, of: std::ops::Range<usize>) -> Self {
        Self {
            step_s: self.step_s,
            position_m: self.position_m[of.clone()].to_vec(),
            current_a: self.current_a[of.clone()].to_vec(),
            theta_rad: self.theta_rad[of.clone()].to_vec(),
            omega_rad_s: self.omega_rad_s[of.clone()].to_vec(),
            usable: self.usable[of.clone()].to_vec(),
            missing: self.missing.get(of).unwrap_or_default().to_vec(),
        }
    }

    pub fn used(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.usable.len()).filter(|j| self.usable[*j])
    }

    pub fn turns(&self) -> f64 {
        self.used().map(|j| self.omega_rad_s[j].abs()).sum::<f64>() * self.step_s / std::f64::consts::TAU
    }

    pub fn at_rest(&self) -> bool {
        self.turns() * std::f64::consts::TAU < REST_RAD_S * self.step_s * self.usable.len() as f64
    }

    /// rms of the currents, and of the positions about their mean.
    pub fn sizes(&self) -> [f64; 2] {
        let count = self.used().count().max(1) as f64;
        let currents = self.used().flat_map(|j| self.current_a[j]).map(|i| i * i).sum::<f64>() / (3.0 * count);
        let mut motion = 0.0;
        for a in 0..2 {
            let mean = self.used().map(|j| self.position_m[j][a]).sum::<f64>() / count;
            motion += self.used().map(|j| (self.position_m[j][a] - mean).powi(2)).sum::<f64>() / count;
        }
        [currents.sqrt(), motion.sqrt()]
    }

    /// Whether neither the rotor nor its currents vary beyond a few per cent.
    pub fn still(&self) -> bool {
        let count = self.used().count().max(1) as f64;
        let [_, motion_rms] = self.sizes();
        let varies = (0..3).any(|k| {
            let mean = self.used().map(|j| self.current_a[j][k]).sum::<f64>() / count;
            let square = self.used().map(|j| (self.current_a[j][k] - mean).powi(2)).sum::<f64>() / count;
            square.sqrt() > 0.1 * mean.abs()
        });
        motion_rms < 5e-6 && !varies
    }
}
