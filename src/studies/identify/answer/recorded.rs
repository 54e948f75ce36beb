//! A recording as input of the likelihood, and its properties without a model.

use std::f64::consts::TAU;

use super::restored::Signals;
use crate::estimation::Hold;
use crate::studies::identify::likelihood::{Part, Recording};
use crate::studies::identify::plausible::REST_RAD_S;
use crate::studies::identify::{Samples, Stated, rms};
use crate::studies::statistics::spread;

/// The recording of a machine with this meaning of a current sample.
pub fn recording(samples: &Samples, stated: &Stated, hold: Hold) -> Recording {
    let (count, position_m, current_a) = (samples.len(), samples.position_m.clone(), samples.currents(hold));
    let rotation = |column: &[f64]| if column.is_empty() { vec![0.0; count] } else { column.to_vec() };
    let (theta_rad, omega_rad_s) = (rotation(&samples.theta_rad), rotation(&samples.omega_rad_s));
    let [position_noise_m, current_noise_a] = stated.noise.map(|noise| (noise > 0.0).then_some(noise));
    let mut recording = Recording {
        start_s: samples.start_s,
        step_s: samples.step_s,
        position_m,
        current_a,
        theta_rad,
        omega_rad_s,
        has_mark: samples.rotation.has_mark(),
        usable: Vec::new(),
        position_error_m: Vec::new(),
        square_error_a2: Vec::new(),
        hold,
        position_noise_m,
        current_noise_a,
    };
    if !samples.missing.is_empty() {
        restore(&mut recording, samples, &stated.parts);
    }
    let signals = recording.position_m.iter().chain(&recording.current_a);
    let signals: Vec<&Vec<f64>> = signals.chain([&recording.theta_rad, &recording.omega_rad_s]).collect();
    recording.usable = (0..count).map(|row| signals.iter().all(|signal| signal[row].is_finite())).collect();
    recording
}

/// The same recording with another meaning of a current sample. Only currents recorded at another rate need to be restored again.
pub fn read_as(of: &Recording, samples: &Samples, stated: &Stated, hold: Hold) -> Recording {
    match samples.apart {
        Some(_) => recording(samples, stated, hold),
        None => Recording { hold, ..of.clone() },
    }
}

/// Longest time for which the force of a magnet may be unknown, s: about that in which the errors of an unstable rotor grow, √(m/ks). Over
/// longer times the trajectory follows its own linearisation, and searches with bench parameters converged slowly.
const LONGEST_S: f64 = 0.01;

/// Restores missing readings from the response of the controller. A current that is missing for longer, by itself, is interpolated: the
/// motion continues under an unknown force. Rows whose positions cannot be restored are not used.
fn restore(recording: &mut Recording, samples: &Samples, parts: &[Part]) {
    let positions = recording.position_m.len();
    let lacks = |row: usize, signal: usize| samples.missing[row] >> signal & 1 != 0;
    let errors = |signal: usize| -> Vec<f32> {
        (0..samples.missing.len()).map(|row| if lacks(row, signal) { f32::INFINITY } else { 0.0 }).collect()
    };
    recording.position_error_m = (0..positions).map(errors).collect();
    recording.square_error_a2 = (positions..positions + recording.current_a.len()).map(errors).collect();
    for part in parts {
        let (coordinates, magnets) = (part.body.coordinates(), part.body.magnets());
        let gap_m = |position_m: &[Vec<f64>], row: usize, k: usize| {
            part.body.gap_at(k, |position| position_m[part.positions + position][row])
        };
        let pull = |k: usize| -> Vec<f64> {
            let of = |(row, i): (usize, &f64)| (i / gap_m(&recording.position_m, row, k)).powi(2);
            recording.current_a[part.magnets + k].iter().enumerate().map(of).collect()
        };
        let pulls: Vec<Vec<f64>> = (0..magnets).map(pull).collect();
        let measured = &recording.position_m[part.positions..][..coordinates];
        let of: Vec<&[f64]> = pulls.iter().chain(measured).map(Vec::as_slice).collect();
        let is_missing = |row: usize, signal: usize| match signal.checked_sub(magnets) {
            Some(position) => lacks(row, part.positions + position),
            None => lacks(row, positions + part.magnets + signal),
        };
        let along = |k: usize, n: usize| part.body.gap_at(k, |_| 0.0) - part.body.gap_at(k, |at| f64::from(at == n));
        let directions: Vec<Vec<f64>> = (0..magnets).map(|k| (0..coordinates).map(|n| along(k, n)).collect()).collect();
        let signals = Signals::new(of, &directions, &recording.theta_rad, is_missing);
        let (of_pulls, of_positions): (Vec<_>, Vec<_>) =
            signals.restored().into_iter().partition(|((_, signal), _)| *signal < magnets);
        for ((row, signal), [value, std]) in of_positions {
            let position = part.positions + signal - magnets;
            recording.position_m[position][row] = value;
            recording.position_error_m[position][row] = std as f32;
        }
        let rms_a = |of: &Vec<f64>| rms(of.iter().copied().filter(|i| i.is_finite()));
        let largest_a: Vec<f64> = recording.current_a.iter().map(rms_a).collect();
        for ((row, signal), [value, std]) in of_pulls {
            let (magnet, square_m2) = (part.magnets + signal, gap_m(&recording.position_m, row, signal).powi(2));
            // A current missing for longer, by itself, is missing because of its value: an outlier, or clipped.
            let is_odd = recording.current_a[magnet][row].is_nan() && (0..positions).all(|signal| !lacks(row, signal));
            if !is_odd && std * square_m2 < largest_a[magnet].powi(2) {
                recording.current_a[magnet][row] = (value.max(0.0) * square_m2).sqrt();
                recording.square_error_a2[magnet][row] = (std * square_m2) as f32;
            }
        }
    }
    // Other positions are not even bridged: the controller responds to its reading, and the filter would attribute that to the magnets.
    for (position_m, error_m) in recording.position_m.iter_mut().zip(&mut recording.position_error_m) {
        for (position_m, error_m) in position_m.iter_mut().zip(error_m).filter(|(_, error_m)| error_m.is_infinite()) {
            (*position_m, *error_m) = (f64::NAN, 0.0);
        }
    }
    for (current_a, error_a2) in recording.current_a.iter_mut().zip(&recording.square_error_a2) {
        let known: Vec<usize> = (0..error_a2.len()).filter(|row| error_a2[*row].is_finite()).collect();
        let gaps = known.iter().zip(&known[1.min(known.len())..]);
        for (from, to) in gaps.filter(|(from, to)| (*to - *from) as f64 * samples.step_s <= LONGEST_S) {
            let [first, last] = [from, to].map(|row| current_a[*row]);
            for (at, current_a) in current_a[*from..*to].iter_mut().enumerate().skip(1) {
                *current_a = first + (last - first) * at as f64 / (to - from) as f64;
            }
        }
    }
}

impl Recording {
    /// Some of its rows.
    pub(in crate::studies::identify) fn part(&self, of: std::ops::Range<usize>) -> Self {
        let each = |columns: &[Vec<f64>]| columns.iter().map(|column| column[of.clone()].to_vec()).collect();
        let errors = |columns: &[Vec<f32>]| columns.iter().map(|column| column[of.clone()].to_vec()).collect();
        Self {
            position_m: each(&self.position_m),
            current_a: each(&self.current_a),
            theta_rad: self.theta_rad[of.clone()].to_vec(),
            omega_rad_s: self.omega_rad_s[of.clone()].to_vec(),
            usable: self.usable[of.clone()].to_vec(),
            position_error_m: errors(&self.position_error_m),
            square_error_a2: errors(&self.square_error_a2),
            ..*self
        }
    }

    /// The rows that are used.
    pub(in crate::studies::identify) fn used(&self) -> impl Iterator<Item = usize> + Clone + '_ {
        (0..self.usable.len()).filter(|j| self.usable[*j])
    }

    pub(in crate::studies::identify) fn turns(&self) -> f64 {
        self.used().map(|j| self.omega_rad_s[j].abs()).sum::<f64>() * self.step_s / TAU
    }

    pub(in crate::studies::identify) fn at_rest(&self) -> bool {
        self.turns() * TAU < REST_RAD_S * self.step_s * self.usable.len() as f64
    }

    /// Mean and variance over the rows that are used.
    pub(super) fn spread(&self, of: &[f64]) -> [f64; 2] {
        spread(self.used().map(|j| of[j]))
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
