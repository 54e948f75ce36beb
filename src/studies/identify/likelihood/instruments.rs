//! Instruments for the regressors of λ: what of `i_k²/gap_k²` repeats with the angle of the shaft.

use std::ops::Range;

use nalgebra::{DMatrix, SMatrix};

use super::equations::Bearing;
use super::filter::{Data, Track};

/// Harmonics of the shaft angle in an instrument.
const HARMONICS: usize = 12;
/// Mean, cosines, sines.
const TERMS: usize = 2 * HARMONICS + 1;
/// Turns in a stretch of rows, as the on-line estimator remembers, and the fewest stretches of a recording.
const TURNS: f64 = 8.0;
const STRETCHES: usize = 6;
/// Harmonics that the few rows of a turn do not tell apart share their amplitude: added to the diagonal, relative to the rows.
const RIDGE: f64 = 1e-6;

/// Fourier series of `i_k²/gap_k²` over the shaft angle, one for each stretch of rows.
///
/// The series of a stretch is fitted to the stretches before and after it. So it contains neither the noise of the currents that drive an
/// interval, nor what the controller makes of the noise of the positions there.
#[derive(Clone, Debug)]
pub(super) struct Instruments {
    rows: usize,
    series: Vec<SMatrix<f64, TERMS, 3>>,
}

#[inline(always)]
fn terms([cos, sin]: [f64; 2]) -> [f64; TERMS] {
    let mut terms = [1.0; TERMS];
    let (mut c, mut s) = (1.0, 0.0);
    for pair in terms[1..].chunks_exact_mut(2) {
        (c, s) = (c * cos - s * sin, s * cos + c * sin);
        pair.copy_from_slice(&[c, s]);
    }
    terms
}

impl Instruments {
    /// The instruments of the intervals of a recording.
    pub fn new(data: &Data, bearing: &Bearing, track: &Track, segments: &[Range<usize>]) -> Self {
        let all = data.at.len();
        let rows = || segments.iter().flat_map(|segment| segment.clone().skip(1));
        let angle: f64 = rows().map(|row| (data.omega[row] * data.h).abs()).sum();
        let per_turn = std::f64::consts::TAU * rows().count() as f64 / angle.max(1e-9);
        let length = ((TURNS * per_turn) as usize).min(all / STRETCHES).max(1);
        let count = all.div_ceil(length);
        let mut sums = vec![(DMatrix::<f64>::zeros(TERMS, TERMS), DMatrix::<f64>::zeros(TERMS, 3)); count];
        for row in rows() {
            let (gram, right) = &mut sums[row / length];
            let (terms, squares) = (terms(data.middle[row]), data.square(bearing, row));
            let gaps = bearing.gaps_at(&track.state[row]);
            for i in 0..TERMS {
                for l in 0..=i {
                    gram[(i, l)] += terms[i] * terms[l];
                }
                for k in 0..3 {
                    right[(i, k)] += terms[i] * squares[k] / (gaps[k] * gaps[k]);
                }
            }
        }
        let series = (0..count).map(|at| {
            let beside = [at.checked_sub(1), Some(at + 1)].into_iter().flatten().filter_map(|at| sums.get(at));
            let (mut gram, mut right) = (DMatrix::zeros(TERMS, TERMS), DMatrix::zeros(TERMS, 3));
            for (more, of) in beside {
                gram += more;
                right += of;
            }
            let ridge = RIDGE * gram[(0, 0)];
            (0..TERMS).for_each(|i| gram[(i, i)] += ridge);
            let solved = gram.cholesky().map(|cholesky| cholesky.solve(&right));
            solved.map_or(SMatrix::zeros(), |solved| SMatrix::from_fn(|i, k| solved[(i, k)]))
        });
        Self { rows: length, series: series.collect() }
    }

    /// `i_k²/gap_k²` as it repeats, at an angle in the interval that ends at a row, A²/m².
    #[inline(always)]
    pub fn at(&self, row: usize, angle: [f64; 2]) -> [f64; 3] {
        let (terms, series) = (terms(angle), &self.series[row / self.rows]);
        std::array::from_fn(|k| (0..TERMS).map(|i| terms[i] * series[(i, k)]).sum())
    }
}
