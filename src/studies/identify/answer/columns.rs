//! The columns of a recording as the likelihood takes them.

use crate::estimation::Hold;
use crate::studies::identify::Stated;
use crate::studies::identify::likelihood::{self, Missing, Origin, Part};
use crate::studies::identify::read::{REST_RAD_S, Rotation, Samples};

/// Columns of a recording.
#[derive(Clone, Debug, Default)]
pub struct Columns {
    pub step_s: f64,
    pub position_m: Vec<Vec<f64>>,
    pub current_a: Vec<Vec<f64>>,
    pub theta_rad: Vec<f64>,
    pub omega_rad_s: Vec<f64>,
    pub usable: Vec<bool>,
    pub missing: Vec<Missing>,
}

/// The columns, if a current sample stands for this.
pub fn columns(samples: &Samples, hold: Hold) -> Columns {
    let (count, position_m, mut current_a) = (samples.len(), samples.position_m.clone(), samples.currents(hold));
    let missing = missing(samples, &mut current_a);
    let rotation = |column: &[f64]| if column.is_empty() { vec![0.0; count] } else { column.to_vec() };
    let known = samples.rotation != Rotation::Unknown;
    let theta_rad = rotation(if known { &samples.theta_rad } else { &[] });
    let omega_rad_s = rotation(if known { &samples.omega_rad_s } else { &[] });
    let finite = |j: usize| {
        let signals = position_m.iter().chain(&current_a).chain([&theta_rad, &omega_rad_s]);
        signals.map(|signal| signal[j]).all(f64::is_finite)
    };
    let usable = (0..count).map(finite).collect();
    Columns { step_s: samples.step_s, position_m, current_a, theta_rad, omega_rad_s, usable, missing }
}

/// Samples that were not recorded. A current that is missing for long, by itself, gets a straight line: the motion goes on without its force being known.
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
        for (from, to) in known.iter().zip(&known[1.min(known.len())..]) {
            let [first, last] = [from, to].map(|row| current_a[*row]);
            for (at, current_a) in current_a[*from..*to].iter_mut().enumerate().skip(1) {
                *current_a = first + (last - first) * at as f64 / (to - from) as f64;
            }
        }
    }
    missing
}

impl Columns {
    pub fn recording(&self, stated: &Stated, hold: Hold) -> likelihood::Recording<'_> {
        let [position_noise_m, current_noise_a] = stated.noise.map(|noise| (noise > 0.0).then_some(noise));
        likelihood::Recording {
            step_s: self.step_s,
            position_m: &self.position_m,
            current_a: &self.current_a,
            theta_rad: &self.theta_rad,
            omega_rad_s: &self.omega_rad_s,
            usable: &self.usable,
            missing: &self.missing,
            hold,
            position_noise_m,
            current_noise_a,
        }
    }

    pub fn part(&self, of: std::ops::Range<usize>) -> Self {
        Self {
            step_s: self.step_s,
            position_m: self.position_m.iter().map(|column| column[of.clone()].to_vec()).collect(),
            current_a: self.current_a.iter().map(|column| column[of.clone()].to_vec()).collect(),
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

    /// rms of the currents of a part of the motion, and of its positions about their mean.
    pub fn sizes(&self, part: &Part) -> [f64; 2] {
        let count = self.used().count().max(1) as f64;
        let square = |of: &Vec<f64>| self.used().map(|j| of[j] * of[j]).sum::<f64>();
        let (magnets, coordinates) = (part.body.magnets(), part.body.coordinates());
        let currents = self.current_a[part.magnets..][..magnets].iter().map(square).sum::<f64>();
        let currents = currents / (magnets as f64 * count);
        let mut motion = 0.0;
        for position_m in &self.position_m[part.positions..][..coordinates] {
            let mean = self.used().map(|j| position_m[j]).sum::<f64>() / count;
            motion += self.used().map(|j| (position_m[j] - mean).powi(2)).sum::<f64>() / count;
        }
        [currents.sqrt(), motion.sqrt()]
    }

    /// Whether neither the rotor nor its currents vary beyond a few per cent.
    pub fn still(&self, parts: &[Part]) -> bool {
        let count = self.used().count().max(1) as f64;
        let motion_rms = parts.iter().map(|part| self.sizes(part)[1]).fold(0.0, f64::max);
        let varies = self.current_a.iter().any(|current_a| {
            let mean = self.used().map(|j| current_a[j]).sum::<f64>() / count;
            let square = self.used().map(|j| (current_a[j] - mean).powi(2)).sum::<f64>() / count;
            square.sqrt() > 0.1 * mean.abs()
        });
        motion_rms < 5e-6 && !varies
    }
}
