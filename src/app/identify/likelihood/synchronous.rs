//! Motion and squared currents as periodic functions of the shaft angle, freed of noise: they drive the sensitivities of long recordings.
//!
//! Noise of the sensors stands in the innovations, and in the regressors too: in the measured currents, and in the motion, for the
//! controller feeds it back. So the score `Σ φᵀ S⁻¹ e` has an expectation at the truth that grows with time, while its standard deviation grows
//! with the root of time. Regressors that know only what repeats from turn to turn (instruments) have none.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use super::equations::Bearing;
use super::filter::{Data, Track};

/// Harmonics of the shaft angle at most: lobes of the path, and the kinks where the smallest force goes from one magnet to another.
const HARMONICS: usize = 12;
/// Samples per turn and harmonic at least.
const SAMPLES: f64 = 2.5;
/// Turns of a window: what changes more slowly is followed, and noise has `(2 · 12 + 1)/(32 · 200)` of its variance at 200 samples a turn.
const TURNS: f64 = 32.0;
/// Turns of the shortest window.
const SHORTEST_TURNS: f64 = 4.0;
/// Part of the variance of the motion that need not repeat. Where more does not, it is excitation of another kind
/// (a run-up, a modulation, steps of the load), and the regressors are the measured ones.
const UNREPEATED: f64 = 0.02;
/// Rows whose regressors remain the measured ones, in windows over the whole of a longer recording: what does not repeat tells as well, and over so many
/// rows the bias is small beside the standard deviation.
pub(super) const MEASURED: usize = 20_000;
/// Windows to each side that a window takes its regressors from.
const NEIGHBOURS: usize = 8;
/// Squared currents of the three magnets, y, z.
const SIGNALS: usize = 5;

/// Squared currents of an interval, and the motion at its middle or end, as far as they repeat.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Repeated {
    pub squares: [f64; 3],
    pub position: [f64; 2],
    /// By the shaft angle, m/rad.
    pub slope: [f64; 2],
}

#[derive(Clone, Debug)]
struct Window {
    rows: Range<usize>,
    /// Inverse of the normal equations; `None` where the angle does not separate the harmonics.
    inverse: Option<DMatrix<f64>>,
    /// Mean, then cos and sin of each harmonic, by signal; empty where the signals do not repeat.
    fit: Vec<[f64; SIGNALS]>,
}

/// The fit of one window.
struct Own {
    fit: Vec<[f64; SIGNALS]>,
    /// Variance of y and z that does not repeat, and all of it, in m².
    unexplained: f64,
    varying: f64,
}

/// The periodic part of a recording, window by window.
#[derive(Clone, Debug, Default)]
pub(super) struct Synchronous {
    windows: Vec<Window>,
    terms: usize,
    /// One window of so many keeps the measured regressors.
    every: usize,
}

/// 1, cos θ, sin θ, cos 2θ, … by rotation.
#[inline(always)]
fn terms(count: usize, [c, s]: [f64; 2]) -> [f64; 1 + 2 * HARMONICS] {
    let mut basis = [0.0; 1 + 2 * HARMONICS];
    basis[0] = 1.0;
    let (mut a, mut b) = (c, s);
    for pair in basis[1..count].chunks_exact_mut(2) {
        pair[0] = a;
        pair[1] = b;
        (a, b) = (a * c - b * s, b * c + a * s);
    }
    basis
}

impl Repeated {
    /// The position at an angle that lies so much before.
    #[inline(always)]
    pub fn before(&self, angle: f64) -> [f64; 2] {
        std::array::from_fn(|a| self.position[a] - angle * self.slope[a])
    }
}

impl Synchronous {
    pub fn new(data: &Data, segments: &[Range<usize>]) -> Self {
        let turns = |rows: &Range<usize>| {
            data.omega[rows.clone()].iter().map(|omega| omega.abs()).sum::<f64>() * data.h / std::f64::consts::TAU
        };
        let slowest = segments.iter().map(|rows| rows.len() as f64 / turns(rows)).fold(f64::INFINITY, f64::min);
        let harmonics = ((slowest / SAMPLES) as usize).min(HARMONICS);
        let terms_count = 1 + 2 * harmonics;
        let mut windows = Vec::new();
        for segment in segments.iter().filter(|segment| harmonics > 0 && turns(segment) >= SHORTEST_TURNS) {
            let count = ((turns(segment) / TURNS).round() as usize).max(1);
            let edge = |n: usize| segment.start + segment.len() * n / count;
            windows.extend((0..count).map(|n| {
                let rows = edge(n)..edge(n + 1);
                let mut normal = vec![0.0; terms_count * terms_count];
                for row in rows.clone() {
                    let basis = terms(terms_count, data.at[row]);
                    for i in 0..terms_count {
                        for l in 0..=i {
                            normal[i * terms_count + l] += basis[i] * basis[l];
                        }
                    }
                }
                let full = |i: usize, l: usize| normal[i.max(l) * terms_count + i.min(l)] / rows.len() as f64;
                let inverse = DMatrix::from_fn(terms_count, terms_count, full).cholesky().map(|a| a.inverse());
                Window { rows, inverse, fit: Vec::new() }
            }));
        }
        let rows: usize = segments.iter().map(Range::len).sum();
        Self {
            windows,
            terms: terms_count,
            every: std::env::var("EVERY").map_or(rows.div_ceil(MEASURED), |e| e.parse().unwrap()),
        }
    }

    /// Fits the trajectory and the squared currents.
    ///
    /// Noise of a window must not decide on its own regressors: 25 coefficients to 6400 rows would be enough for a bias of 30 standard deviations in the
    /// delay. So each window takes the mean of the fits of its neighbours.
    pub fn fit(&mut self, data: &Data, bearing: &Bearing, track: &Track) {
        let own: Vec<Option<Own>> = self.windows.iter().map(|window| self.own(window, data, bearing, track)).collect();
        for (at, window) in self.windows.iter_mut().enumerate() {
            window.fit.clear();
            let Some(Some(here)) = own.get(at).filter(|_| at % self.every != self.every / 2) else { continue };
            let near = at.saturating_sub(NEIGHBOURS)..(at + NEIGHBOURS + 1).min(own.len());
            let others: Vec<&Own> = near.filter(|other| *other != at).filter_map(|other| own[other].as_ref()).collect();
            if others.is_empty() {
                continue;
            }
            let mut mean = vec![[0.0; SIGNALS]; self.terms];
            for other in &others {
                for (mean, fit) in mean.iter_mut().zip(&other.fit) {
                    for (mean, fit) in mean.iter_mut().zip(fit) {
                        *mean += fit / others.len() as f64;
                    }
                }
            }
            // Harmonics are orthogonal over whole turns.
            let differs: f64 = (0..self.terms)
                .map(|i| {
                    let weight = if i == 0 { 1.0 } else { 0.5 };
                    weight * (3..SIGNALS).map(|a| (mean[i][a] - here.fit[i][a]).powi(2)).sum::<f64>()
                })
                .sum();
            if here.unexplained + differs <= UNREPEATED * here.varying {
                window.fit = mean;
            }
        }
    }

    /// Least squares over one window.
    fn own(&self, window: &Window, data: &Data, bearing: &Bearing, track: &Track) -> Option<Own> {
        let inverse = window.inverse.as_ref()?;
        let count = self.terms;
        let mut sums = [[0.0; SIGNALS]; 1 + 2 * HARMONICS];
        let mut powers = [0.0; SIGNALS];
        for row in window.rows.clone() {
            let basis = terms(count, data.at[row]);
            // The first row of a recording ends no interval.
            let square = data.square(bearing, row.max(1));
            let [y, z, ..] = track.state[row];
            let signals = [square[0], square[1], square[2], y, z];
            for (sum, basis) in sums[..count].iter_mut().zip(basis) {
                for (sum, signal) in sum.iter_mut().zip(signals) {
                    *sum += basis * signal;
                }
            }
            for (power, signal) in powers.iter_mut().zip(signals) {
                *power += signal * signal;
            }
        }
        let rows = window.rows.len() as f64;
        let mut own = Own { fit: vec![[0.0; SIGNALS]; count], unexplained: 0.0, varying: 0.0 };
        for signal in 0..SIGNALS {
            let right = DVector::from_fn(count, |i, _| sums[i][signal] / rows);
            let solved = inverse * &right;
            for (fit, solved) in own.fit.iter_mut().zip(solved.iter()) {
                fit[signal] = *solved;
            }
            if signal >= 3 {
                let power = powers[signal] / rows;
                own.varying += power - right[0] * right[0];
                own.unexplained += power - solved.dot(&right);
            }
        }
        Some(own)
    }

    /// The window that a row is in, from that of the row before.
    #[inline(always)]
    pub fn window(&self, row: usize, before: usize) -> usize {
        let mut at = before;
        while at < self.windows.len() && self.windows[at].rows.end <= row {
            at += 1;
        }
        at
    }

    /// What repeats, at the angle with that cos and sin.
    #[inline(always)]
    pub fn repeated(&self, window: usize, row: usize, angle: [f64; 2]) -> Option<Repeated> {
        let window = self.windows.get(window).filter(|window| window.rows.contains(&row) && !window.fit.is_empty())?;
        let basis = terms(self.terms, angle);
        let mut sums = [0.0; SIGNALS];
        for (fit, basis) in window.fit.iter().zip(basis) {
            for (sum, fit) in sums.iter_mut().zip(fit) {
                *sum += basis * fit;
            }
        }
        let mut slope = [0.0; 2];
        for (n, pair) in window.fit[1..].chunks_exact(2).enumerate() {
            let (c, s) = (basis[1 + 2 * n], basis[2 + 2 * n]);
            for a in 0..2 {
                slope[a] += (n + 1) as f64 * (c * pair[1][3 + a] - s * pair[0][3 + a]);
            }
        }
        Some(Repeated { squares: [sums[0], sums[1], sums[2]], position: [sums[3], sums[4]], slope })
    }
}
