//! A recording as the passes of the filter read it: shaft, currents and their origin, row by row.

use std::ops::Range;

use super::Origin;
use super::case::Case;
use super::lag;
use super::rotor::{ByMagnet, Interval, Rotor, Shaft, Squares, State};
use crate::estimation::Hold;

/// Factor of the measurement variance of a row that was not recorded: the filter predicts across it.
const UNKNOWN: f64 = 1e10;
/// Least gap that noise is reckoned with, relative to the nominal one.
const LEAST_GAP: f64 = 0.05;
/// Rows after a current that is not known in which the filter finds the velocity again.
const FOUND_AGAIN: usize = 4;

impl Case<'_> {
    #[inline(always)]
    pub fn is_missing(&self, row: usize) -> bool {
        self.recording.missing.get(row).is_some_and(|missing| missing.position)
    }

    /// Where the currents of a row come from; there are rows that were not recorded.
    fn origins(&self, row: usize) -> &[Origin] {
        &self.recording.missing[row].current[self.first..][..self.current.len()]
    }

    /// Whether a current is known well enough to be counted on.
    fn is_known(&self, origin: Origin) -> bool {
        origin == Origin::Recorded || origin == Origin::Filled && !self.distrusts_filled
    }

    /// Whether a current of a row is not known.
    #[inline(always)]
    fn is_unknown(&self, row: usize) -> bool {
        !self.recording.missing.is_empty() && self.origins(row).iter().any(|of| !self.is_known(*of))
    }

    /// Whether the force of a magnet is not known in the interval that ends at a row.
    pub fn is_adrift(&self, row: usize) -> bool {
        !self.recording.missing.is_empty() && (0..self.current.len()).any(|k| !self.is_known(self.origin(row, k)))
    }

    /// Whether an innovation tells of the noise: not where the position was not recorded, nor where the force is not known.
    #[inline(always)]
    pub fn tells(&self, row: usize) -> bool {
        self.recording.missing.is_empty()
            || !self.is_missing(row) && !(row.saturating_sub(FOUND_AGAIN)..=row).any(|row| self.is_unknown(row))
    }

    /// The origin of the current `k` of the interval that ends at a row.
    fn origin(&self, row: usize, k: usize) -> Origin {
        let [before, here] = [row - 1, row].map(|row| self.origins(row)[k]);
        match self.recording.hold {
            Hold::HeldBefore => here,
            Hold::HeldAfter => before,
            Hold::Linear => before.max(here),
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
    /// Squared currents that were not recorded, of the interval that ends at a row, as they were to be expected, with their standard deviations, A². Empty as long
    /// as they are not known.
    pub predicted: Vec<[f32; 2]>,
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
            current: std::array::from_fn(|k| &on.case.filled[k][..]),
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
        let variance = if case.is_missing(row) { UNKNOWN * variance } else { variance };
        if exponent == 0.0 {
            return [variance; N];
        }
        let grown = |at: f64| libm::pow((1.0 + at / rotor.nominal_m).max(LEAST_GAP), 2.0 * exponent);
        self.state[row][0].map(|at| variance * grown(at))
    }

    /// Variance that the acceleration by a slow force gains in so many rows.
    #[inline(always)]
    pub fn slow(&self, rows: usize) -> f64 {
        let rotor = self.on.rotor;
        rotor.slow * rotor.slow * rows as f64 * rotor.h
    }

    /// The interval that ends at `row`.
    #[inline(always)]
    pub fn interval(&self, row: usize, from: &Shaft, to: &Shaft) -> Interval<N, K> {
        let On { case, rotor, .. } = self.on;
        let between = case.shaft_between(row, from, to);
        let states = [&self.state[row - 1], &self.state[row]];
        let expected = self.expected(row).map(|(pulls, _)| pulls);
        rotor.interval(states, &self.squares(row), expected, [*from, between, *to])
    }

    /// Factors of the noise of the currents in the interval that ends at a row: errors of currents that were not recorded are what they are.
    #[inline(always)]
    pub fn scales(&self, row: usize, mut factors: ByMagnet) -> ByMagnet {
        let case = self.on.case;
        if !case.recording.missing.is_empty() {
            (0..K).filter(|k| case.origin(row, *k) != Origin::Recorded).for_each(|k| factors[k] = 1.0);
        }
        factors
    }

    /// Squared currents that the interval ending at `row` is driven by, A².
    #[inline(always)]
    pub fn squares(&self, row: usize) -> Squares<K> {
        let On { case, rotor, .. } = self.on;
        let read = |row: usize| self.current.map(|current| current[row]);
        let mut squares = match (&rotor.lag, case.recording.hold) {
            (None, Hold::Linear) => rotor.squares(read(row), Some(read(row - 1))),
            (None, _) => rotor.squares(read(case.commanded(row)), None),
            (Some([lag, ..]), _) => rotor.following(lag, read(case.commanded(row)), row),
        };
        if case.recording.missing.is_empty() {
            return squares;
        }
        for k in 0..K {
            let error_a = match (case.origin(row, k), case.track.predicted.get(K * row + k)) {
                (Origin::Recorded, _) => continue,
                (Origin::Filled, Some(predicted)) => {
                    let [square, std] = predicted.map(f64::from);
                    (squares.start[k], squares.middle[k], squares.end[k]) = (square, square, square);
                    squares.std[k] = std;
                    continue;
                }
                (Origin::Filled, None) if !case.distrusts_filled => case.filled_a[k],
                _ => case.unknown_a[k],
            };
            squares.std[k] *= (error_a / rotor.noise).max(1.0);
        }
        squares
    }

    /// Derivative of the acceleration to the lag in the interval that ends at a row, by magnets that pull from a point, with the place of the lag; none without one.
    #[inline(always)]
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
