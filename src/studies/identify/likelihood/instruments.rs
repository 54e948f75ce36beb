//! Instruments for the regressors of λ: what of `i_k²/gap_k²` repeats with the angle of the shaft, and what the controller makes of past innovations.

use nalgebra::{DMatrix, SMatrix};

use super::equations::Bearing;
use super::filter::{self, Data, Track};

/// Harmonics of the shaft angle in an instrument.
const HARMONICS: usize = 12;
/// Mean, cosines, sines.
const PERIODIC: usize = 2 * HARMONICS + 1;
/// Exponential means of the innovations, by which the answer of a controller to noise is described: from the last sample to [`SLOWEST_S`].
const MEANS: usize = 8;
const SLOWEST_S: f64 = 0.02;
const TERMS: usize = PERIODIC + 2 * MEANS;
/// Turns in a stretch of rows, and stretches in a recording at least.
const TURNS: f64 = 8.0;
const STRETCHES: usize = 6;

/// Exponential means of past innovations.
#[derive(Clone, Copy, Debug)]
pub(super) struct Past {
    means: [[f64; 2]; MEANS],
    weights: [f64; MEANS],
}

impl Past {
    pub fn new(h: f64) -> Self {
        let ratio = (SLOWEST_S / h).max(2.0);
        let samples = |j: usize| libm::pow(ratio, j as f64 / (MEANS - 1) as f64);
        Self { means: [[0.0; 2]; MEANS], weights: std::array::from_fn(|j| 1.0 / samples(j)) }
    }

    /// Takes in a whitened innovation.
    #[inline(always)]
    pub fn add(&mut self, innovation: [f64; 2]) {
        for (mean, weight) in self.means.iter_mut().zip(self.weights) {
            mean[0] += weight * (innovation[0] - mean[0]);
            mean[1] += weight * (innovation[1] - mean[1]);
        }
    }
}

#[inline(always)]
fn terms([cos, sin]: [f64; 2], past: &Past) -> [f64; TERMS] {
    let mut terms = [1.0; TERMS];
    let (mut c, mut s) = (1.0, 0.0);
    for pair in terms[1..PERIODIC].chunks_exact_mut(2) {
        (c, s) = (c * cos - s * sin, s * cos + c * sin);
        pair.copy_from_slice(&[c, s]);
    }
    terms[PERIODIC..].copy_from_slice(past.means.as_flattened());
    terms
}

/// Coefficients of the terms of `i_k²/gap_k²`, for each stretch of rows.
///
/// Those of a stretch are fitted to the stretches before and behind it. So the instruments hold neither the noise of the currents that drive the
/// interval, nor what the controller makes of the noise of the positions there, but by the innovations, which are white.
#[derive(Clone, Debug)]
pub(super) struct Instruments {
    rows: usize,
    coefficients: Vec<SMatrix<f64, TERMS, 3>>,
}

impl Instruments {
    /// The instruments of a recording.
    pub fn new(data: &Data, bearing: &Bearing, track: &Track, variance: f64, segments: &[std::ops::Range<usize>]) -> Self {
        let speed = data.omega.iter().map(|omega| omega.abs()).sum::<f64>() / data.omega.len() as f64;
        let turns = TURNS * std::f64::consts::TAU / (speed * data.h).max(1e-9);
        let length = (turns as usize).min(data.omega.len() / STRETCHES).max(1);
        let count = data.omega.len().div_ceil(length);
        let mut sums = vec![(DMatrix::<f64>::zeros(TERMS, TERMS), DMatrix::<f64>::zeros(TERMS, 3)); count];
        for segment in segments {
            filter::innovations(data, bearing, track, variance, segment.clone(), |row, past| {
                let (gram, right) = &mut sums[row / length];
                let (terms, squares, gaps) =
                    (terms(data.middle[row], past), data.square(bearing, row), bearing.gaps_at(&track.state[row]));
                for i in 0..TERMS {
                    for l in 0..=i {
                        gram[(i, l)] += terms[i] * terms[l];
                    }
                    for k in 0..3 {
                        right[(i, k)] += terms[i] * squares[k] / (gaps[k] * gaps[k]);
                    }
                }
            });
        }
        let coefficients = (0..count).map(|at| {
            let beside = [at.checked_sub(1), Some(at + 1)].into_iter().flatten().filter_map(|at| sums.get(at));
            let (mut gram, mut right) = (DMatrix::zeros(TERMS, TERMS), DMatrix::zeros(TERMS, 3));
            for (more, of) in beside {
                gram += more;
                right += of;
            }
            // Harmonics that so few rows of a turn do not tell apart share their amplitude.
            let ridge = 1e-6 * gram[(0, 0)];
            (0..TERMS).for_each(|i| gram[(i, i)] += ridge);
            let solved = gram.cholesky().map(|cholesky| cholesky.solve(&right));
            solved.map_or(SMatrix::zeros(), |solved| SMatrix::from_fn(|i, k| solved[(i, k)]))
        });
        Self { rows: length, coefficients: coefficients.collect() }
    }

    /// `i_k²/gap_k²` by the terms, at an angle in the interval that ends at a row, A²/m².
    #[inline(always)]
    pub fn at(&self, row: usize, angle: [f64; 2], past: &Past) -> [f64; 3] {
        let (terms, coefficients) = (terms(angle, past), &self.coefficients[row / self.rows]);
        std::array::from_fn(|k| (0..TERMS).map(|i| terms[i] * coefficients[(i, k)]).sum())
    }
}
