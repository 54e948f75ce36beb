//! A recording as the passes of the filter read it: shaft, currents and their origin, row by row.

use std::ops::Range;

use super::case::Case;
use super::filter::Levels;
use super::lag;
use super::rotor::{ByMagnet, Interval, Rotor, Shaft, Squares, State};
use crate::estimation::Hold;

/// Least gap that noise is reckoned with, relative to the nominal one.
const LEAST_GAP: f64 = 0.05;
/// Rows after a current that is not known in which the filter finds the velocity again.
const FOUND_AGAIN: usize = 4;

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

    /// Whether an innovation tells of the noise: not where the position was not recorded, nor where nothing tells a current.
    #[inline(always)]
    pub fn tells(&self, row: usize) -> bool {
        let is_unknown = |row: usize| self.square_error.iter().any(|error_a2| error_a2[row].is_infinite());
        !self.is_missing(row) && !(row.saturating_sub(FOUND_AGAIN)..=row).any(is_unknown)
    }

    /// Error of the squared current `k` of the interval that ends at a row, A²: 0 if its readings were recorded. `level` is that of the errors of
    /// restored readings.
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

    /// The row whose reading is the command of the interval that ends at a row, if it is held.
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
        Shaft {
            cos,
            sin,
            speed: mean(from.speed, to.speed),
            square: mean(from.square, to.square),
            rate: mean(from.rate, to.rate),
        }
    }
}

/// The trajectory about which a pass is linearised.
#[derive(Clone, Debug, Default)]
pub(super) struct Track {
    /// Coordinates and rates, row by row.
    pub state: Vec<f64>,
    /// Expected values of every row, in single precision, for there are many: `i_k²/gap_k²` in A²/m² over the interval that ends there, then coordinates
    /// and rates. Empty as long as it is not known.
    pub expected: Vec<f32>,
}

/// A piece of a recording: the rows that count, within those that are filtered. The first row of `filtered` starts a filter.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Piece {
    pub filtered: Range<usize>,
    pub counted: Range<usize>,
    /// Rows of a block; blocks are counted from `blocks_from`.
    pub block: usize,
    pub blocks_from: usize,
}

/// The subject of a pass of the filter.
#[derive(Clone, Copy)]
pub(super) struct On<'a> {
    pub case: &'a Case<'a>,
    pub rotor: &'a Rotor,
    pub piece: &'a Piece,
}

/// The same with the sizes of a machine: N coordinates, K magnets.
#[derive(Clone, Copy)]
pub(super) struct Pass<'a, const N: usize, const K: usize> {
    pub on: On<'a>,
    /// Readings of the positions, m.
    pub position: [&'a [f64]; N],
    current: [&'a [f64]; K],
    /// The trajectory.
    pub state: &'a [State<N>],
}

impl<'a, const N: usize, const K: usize> Pass<'a, N, K> {
    pub fn of(on: On<'a>) -> Self {
        Self {
            on,
            position: std::array::from_fn(|n| on.case.position[n]),
            current: std::array::from_fn(|k| on.case.current[k]),
            state: on.case.track.state.as_chunks().0.as_chunks().0,
        }
    }

    /// Pulls and state as they were to be expected, if they are known.
    #[inline(always)]
    pub fn expected(&self, row: usize) -> Option<([f64; K], State<N>)> {
        let size = K + 2 * N;
        let of = self.on.case.track.expected.get(size * row..size * (row + 1))?;
        let state = std::array::from_fn(|d| std::array::from_fn(|n| f64::from(of[K + N * d + n])));
        Some((std::array::from_fn(|k| f64::from(of[k])), state))
    }

    /// Variances of the position readings in a row, where noise grows with the gap to this power.
    #[inline(always)]
    pub fn variance(&self, row: usize, exponent: f64) -> [f64; N] {
        let On { case, rotor, .. } = self.on;
        let variance = case.position_noise * case.position_noise;
        let grown = |at: f64| libm::pow((1.0 + at / rotor.nominal_m).max(LEAST_GAP), 2.0 * exponent);
        let mut of = if exponent == 0.0 { [variance; N] } else { self.state[row][0].map(|at| variance * grown(at)) };
        for (of, error_m) in of.iter_mut().zip(&case.position_error) {
            *of += f64::from(error_m[row]).powi(2);
        }
        of
    }

    /// Variance that the acceleration by a slow force gains in so many rows.
    #[inline(always)]
    pub fn slow(&self, rows: usize) -> f64 {
        let rotor = self.on.rotor;
        rotor.slow * rotor.slow * rows as f64 * rotor.h
    }

    /// The interval that ends at `row`.
    pub fn interval(&self, row: usize, from: &Shaft, to: &Shaft) -> Interval<N, K> {
        let On { case, rotor, .. } = self.on;
        let between = case.shaft_between(row, from, to);
        let states = [&self.state[row - 1], &self.state[row]];
        let expected = self.expected(row).map(|(pulls, _)| pulls);
        rotor.interval(states, &self.squares(row), expected, [*from, between, *to])
    }

    /// Factors of the noise of the currents in the interval that ends at a row, or of the errors of those that were not recorded.
    pub fn scales(&self, row: usize, levels: &Levels) -> ByMagnet {
        let (case, mut factors) = (self.on.case, levels.currents);
        for (k, factor) in factors.iter_mut().enumerate().take(case.square_error.len()) {
            let [error_a2, of_level] = [1.0, levels.restored].map(|of| case.error_a2(row, k, of * case.restored));
            if error_a2 > 0.0 {
                *factor = of_level / error_a2;
            }
        }
        factors
    }

    /// Squared currents that the interval ending at `row` is driven by, A².
    pub fn squares(&self, row: usize) -> Squares<K> {
        let On { case, rotor, .. } = self.on;
        let read = |row: usize| self.current.map(|current| current[row]);
        let mut squares = match (&rotor.lag, case.recording.hold) {
            (None, Hold::Linear) => rotor.squares(read(row), Some(read(row - 1))),
            (None, _) => rotor.squares(read(case.commanded(row)), None),
            (Some([lag, ..]), _) => rotor.following(lag, read(case.commanded(row)), row),
        };
        for k in 0..case.square_error.len() {
            squares.std[k] = libm::hypot(squares.std[k], case.error_a2(row, k, case.restored));
        }
        squares
    }

    /// Derivative of the acceleration to the lag in the interval that ends at a row, by magnets that pull from a point, with the place of the lag; none without one.
    pub fn by_lag(&self, row: usize, at: &[f64; N]) -> Option<(usize, [f64; N])> {
        let On { case, rotor, .. } = self.on;
        let ([_, more, less], command) = (rotor.lag.as_ref()?, self.current.map(|of| of[case.commanded(row)]));
        let [more, less] = [more, less].map(|lag| rotor.following::<K>(lag, command, row).middle);
        let by_lag: [f64; K] = std::array::from_fn(|k| lag::derivative(more[k], less[k]));
        let mut column = [0.0; N];
        rotor.add_pulls(&mut column, rotor.gaps(at), by_lag);
        Some((rotor.layout.base + rotor.places.lag?, column))
    }
}
