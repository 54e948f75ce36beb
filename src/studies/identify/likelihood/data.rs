//! A recording as read by the passes of the filter: shaft, currents and their origin, row by row.

use std::ops::Range;

use super::case::Case;
use super::filter::Levels;
use super::lag;
use super::rotor::{ByMagnet, Interval, Rotor, Shaft, Squares, State};
use crate::bearing::array;
use crate::estimation::Hold;

/// Smallest gap used for the noise, relative to the nominal one.
const MIN_GAP: f64 = 0.05;
/// Rows after an unknown current until the filter has recovered the velocity.
const RECOVERY_ROWS: usize = 4;

impl Case<'_> {
    /// Whether a position of a row was not recorded.
    #[inline(always)]
    pub fn is_missing(&self, row: usize) -> bool {
        self.position_error.iter().any(|error_m| error_m[row] > 0.0)
    }

    /// Whether a current of the interval that ends at a row was not recorded.
    pub fn is_restored(&self, row: usize) -> bool {
        (0..self.square_error.len()).any(|k| self.error_a2(row, k, 1.0) > 0.0)
    }

    /// Whether an innovation is informative about noise: not where the position was not recorded, nor within
    /// [`RECOVERY_ROWS`] rows after an unknown current.
    #[inline(always)]
    pub fn is_informative(&self, row: usize) -> bool {
        let is_unknown = |row: usize| self.square_error.iter().any(|error_a2| error_a2[row].is_infinite());
        !self.is_missing(row) && !(row.saturating_sub(RECOVERY_ROWS)..=row).any(is_unknown)
    }

    /// Part of the readings of currents that were restored, or of which nothing is known.
    pub fn part_restored(&self) -> f64 {
        let restored = self.square_error.iter().copied().flatten().filter(|error_a2| **error_a2 != 0.0);
        restored.count() as f64 / (self.square_error.len() * self.at.len()).max(1) as f64
    }

    /// Standard deviation of the squared current `k` of the interval that ends at a row, A²: 0 if recorded. `level` scales the errors of restored readings.
    fn error_a2(&self, row: usize, k: usize, level: f64) -> f64 {
        let Some(error_a2) = self.square_error.get(k) else { return 0.0 };
        let of = |row: usize| match error_a2[row] {
            error_a2 if error_a2.is_finite() => (level * f64::from(error_a2)).min(self.unknown_a2[k]),
            _ => self.unknown_a2[k],
        };
        match self.recording.hold {
            Hold::HeldBefore | Hold::HeldAfter => of(self.commanded(row)),
            Hold::Linear => 0.5 * libm::hypot(of(row - 1), of(row)),
        }
    }

    /// Row whose reading is the command of the interval that ends at a row, if commands are held.
    #[inline(always)]
    pub fn commanded(&self, row: usize) -> usize {
        row - usize::from(self.recording.hold == Hold::HeldAfter)
    }

    #[inline(always)]
    fn rate(&self, row: usize) -> f64 {
        let omega = &self.recording.omega_rad_s;
        let (from, to) = (row.saturating_sub(self.half_width), (row + self.half_width).min(self.recording.rows() - 1));
        (omega[to] - omega[from]) / ((to - from) as f64 * self.recording.step_s)
    }

    #[inline(always)]
    pub fn shaft(&self, row: usize) -> Shaft {
        let [cos, sin] = self.at[row];
        let omega = self.recording.omega_rad_s[row];
        Shaft { cos, sin, speed: omega, square: omega * omega, rate: self.rate(row) }
    }

    #[inline(always)]
    fn shaft_between(&self, row: usize, from: &Shaft, to: &Shaft) -> Shaft {
        let [cos, sin] = self.middle[row];
        let mean = |a: f64, b: f64| 0.5 * (a + b);
        let [speed, square] = [mean(from.speed, to.speed), mean(from.square, to.square)];
        Shaft { cos, sin, speed, square, rate: mean(from.rate, to.rate) }
    }
}

/// A piece of a recording: the counted rows within the filtered ones. A filter starts at the first row of `filtered`.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Piece {
    /// Index of the recording.
    pub recording: usize,
    pub filtered: Range<usize>,
    pub counted: Range<usize>,
    /// Rows per block, and the row from which blocks are counted.
    pub block: usize,
    pub blocks_from: usize,
}

/// Input of a pass of the filter.
#[derive(Clone, Copy)]
pub(super) struct Input<'a> {
    pub case: &'a Case<'a>,
    pub rotor: &'a Rotor,
    pub piece: &'a Piece,
}

/// The same with the sizes of a machine: N coordinates, K magnets.
#[derive(Clone, Copy)]
pub(super) struct Pass<'a, const N: usize, const K: usize> {
    pub input: Input<'a>,
    /// Readings of the positions, m.
    pub position: [&'a [f64]; N],
    current: [&'a [f64]; K],
    /// Trajectory by row.
    pub state: &'a [State<N>],
}

impl<'a, const N: usize, const K: usize> Pass<'a, N, K> {
    pub fn of(input: Input<'a>) -> Self {
        Self {
            input,
            position: array::from_fn(|n| input.case.position[n]),
            current: array::from_fn(|k| input.case.current[k]),
            state: input.case.state.as_chunks().0.as_chunks().0,
        }
    }

    /// Expected `i_k²/gap_k²` and state, if known.
    #[inline(always)]
    pub fn expected(&self, row: usize) -> Option<([f64; K], State<N>)> {
        let size = K + 2 * N;
        let of = self.input.case.expected.get(size * row..size * (row + 1))?;
        let state = array::from_fn(|d| array::from_fn(|n| f64::from(of[K + N * d + n])));
        Some((array::from_fn(|k| f64::from(of[k])), state))
    }

    /// Variances of the position readings in a row.
    #[inline(always)]
    pub fn variance(&self, row: usize, levels: &Levels) -> [f64; N] {
        let Input { case, rotor, .. } = self.input;
        let exponent = case.exponent + levels.exponent;
        let variance = case.position_noise * case.position_noise;
        let grown = |at: f64| libm::pow((1.0 + at / rotor.nominal_m).max(MIN_GAP), 2.0 * exponent);
        let mut variances =
            if exponent == 0.0 { [variance; N] } else { array::map(self.state[row][0], |at| variance * grown(at)) };
        for (variance, error_m) in variances.iter_mut().zip(&case.position_error) {
            *variance += f64::from(error_m[row]).powi(2);
        }
        variances
    }

    /// Variance gained by the acceleration of a slow force in this number of rows.
    #[inline(always)]
    pub fn slow(&self, rows: usize, levels: &Levels) -> f64 {
        let rotor = self.input.rotor;
        levels.slow * levels.slow * (rotor.slow * rotor.slow * rows as f64 * rotor.h)
    }

    /// The interval that ends at `row`.
    pub fn interval(&self, row: usize, from: &Shaft, to: &Shaft) -> Interval<N, K> {
        let Input { case, rotor, .. } = self.input;
        let between = case.shaft_between(row, from, to);
        let states = [&self.state[row - 1], &self.state[row]];
        let expected = self.expected(row).map(|(pulls, _)| pulls);
        rotor.interval(states, &self.squares(row), expected, [*from, between, *to])
    }

    /// Factors on the noise of the currents in the interval that ends at a row, together with the errors of those that were not recorded.
    pub fn scales(&self, row: usize, levels: &Levels) -> ByMagnet {
        let (case, mut factors) = (self.input.case, levels.currents);
        for (k, factor) in factors.iter_mut().enumerate().take(case.square_error.len()) {
            let [error_a2, of_level] =
                array::map([1.0, levels.restored], |of| case.error_a2(row, k, of * case.restored));
            if error_a2 > 0.0 {
                let noise_a2 = self.read_squares(row).std[k];
                *factor = libm::hypot(*factor * noise_a2, of_level) / libm::hypot(noise_a2, error_a2);
            }
        }
        factors
    }

    /// Squared currents in the interval that ends at `row`, A², with the noise of their readings alone.
    fn read_squares(&self, row: usize) -> Squares<K> {
        let Input { case, rotor, .. } = self.input;
        let read = |row: usize| array::map(self.current, |current| current[row]);
        match (&rotor.lag, case.recording.hold) {
            (None, Hold::Linear) => rotor.squares(read(row), Some(read(row - 1))),
            (None, _) => rotor.squares(read(case.commanded(row)), None),
            (Some([lag, ..]), _) => rotor.lagged_squares(lag, read(case.commanded(row)), row),
        }
    }

    /// Squared currents in the interval that ends at `row`, A², with the errors of those that were not recorded.
    pub fn squares(&self, row: usize) -> Squares<K> {
        let (case, mut squares) = (self.input.case, self.read_squares(row));
        for k in 0..case.square_error.len() {
            squares.std[k] = libm::hypot(squares.std[k], case.error_a2(row, k, case.restored));
        }
        squares
    }

    /// Derivative of the acceleration with respect to the lag in the interval that ends at a row, with the magnets at
    /// a point, and the column of the lag; none without one.
    pub fn by_lag(&self, row: usize, at: &[f64; N]) -> Option<(usize, [f64; N])> {
        let Input { case, rotor, .. } = self.input;
        let ([_, more, less], command) = (rotor.lag.as_ref()?, array::map(self.current, |of| of[case.commanded(row)]));
        let [more, less] = array::map([more, less], |lag| rotor.lagged_squares::<K>(lag, command, row).middle);
        let by_lag: [f64; K] = array::from_fn(|k| lag::derivative(more[k], less[k]));
        let mut column = [0.0; N];
        rotor.add_pulls(&mut column, rotor.gaps(at), by_lag);
        Some((rotor.layout.base + rotor.places.lag?, column))
    }
}
