//! A recording as the passes of the filter read it: shaft, currents and their origin, row by row.

use std::borrow::Cow;
use std::ops::Range;

use super::expected::Expected;
use super::rotor::{Interval, Rotor, Shaft, Squares, State};
use super::{Missing, Origin};
use crate::estimation::Hold;

/// A recording as the passes need it.
pub(super) struct Data<'a, const N: usize, const K: usize> {
    pub h: f64,
    pub position: [&'a [f64]; N],
    pub current: [Cow<'a, [f64]>; K],
    pub omega: &'a [f64],
    pub hold: Hold,
    /// cos θ, sin θ at the samples, and in the middle of the interval that ends there.
    pub at: Vec<[f64; 2]>,
    pub middle: Vec<[f64; 2]>,
    /// Half the number of rows over which ω̇ is taken.
    pub half_width: usize,
    /// Samples that were not recorded; empty if there are none.
    pub missing: &'a [Missing],
    /// The first of its magnets among those of the recording.
    pub first: usize,
    /// Whether currents that were filled count as not known.
    pub distrusts_filled: bool,
    /// Errors of currents that were filled, and of those that are not known, A.
    pub filled_a: [f64; K],
    pub unknown_a: [f64; K],
}

/// Factor of the measurement variance of a row that was not recorded: the filter predicts across it.
const UNKNOWN: f64 = 1e10;
/// Rows after a current that is not known in which the filter finds the velocity again.
const FOUND_AGAIN: usize = 4;

impl<const N: usize, const K: usize> Data<'_, N, K> {
    #[inline(always)]
    pub fn is_missing(&self, row: usize) -> bool {
        self.missing.get(row).is_some_and(|missing| missing.position)
    }

    /// Whether a current of a row is not known.
    #[inline(always)]
    pub fn is_unknown(&self, row: usize) -> bool {
        self.missing.get(row).is_some_and(|missing| {
            missing.current[self.first..][..K].iter().any(|of| self.trusted(*of) == Origin::Unknown)
        })
    }

    /// Whether an innovation tells of the noise: not where the position was not recorded, nor where the force is not known.
    #[inline(always)]
    pub fn tells(&self, row: usize) -> bool {
        self.missing.is_empty()
            || !self.is_missing(row) && !(row.saturating_sub(FOUND_AGAIN)..=row).any(|row| self.is_unknown(row))
    }

    #[inline(always)]
    fn trusted(&self, origin: Origin) -> Origin {
        if origin == Origin::Filled && self.distrusts_filled { Origin::Unknown } else { origin }
    }

    /// The origin of the currents of the interval that ends at a row. Where a current is not known on either side the interval is not, whatever a sample stands
    /// for: the readings of the currents are then compared over the same intervals.
    #[inline(always)]
    fn origin(&self, row: usize) -> [Origin; K] {
        let [before, here] = [row - 1, row].map(|row| &self.missing[row].current[self.first..][..K]);
        std::array::from_fn(|k| match (self.hold, self.trusted(before[k].max(here[k]))) {
            (_, Origin::Unknown) => Origin::Unknown,
            (Hold::HeldBefore, _) => here[k],
            (Hold::HeldAfter, _) => before[k],
            (Hold::Linear, either) => either,
        })
    }

    /// Variance of the position reading in a row.
    #[inline(always)]
    pub fn variance(&self, row: usize, variance: f64) -> f64 {
        if self.is_missing(row) { UNKNOWN * variance } else { variance }
    }

    /// Variance that the acceleration by a slow force gains in so many rows.
    #[inline(always)]
    pub fn slow(&self, rotor: &Rotor<N, K>, rows: usize) -> f64 {
        rotor.slow * rotor.slow * rows as f64 * self.h
    }

    #[inline(always)]
    fn rate(&self, row: usize) -> f64 {
        let (from, to) = (row.saturating_sub(self.half_width), (row + self.half_width).min(self.omega.len() - 1));
        (self.omega[to] - self.omega[from]) / ((to - from) as f64 * self.h)
    }

    #[inline(always)]
    pub fn shaft(&self, row: usize) -> Shaft {
        let [cos, sin] = self.at[row];
        let omega = self.omega[row];
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

    /// The interval that ends at `row`, and the shaft in its middle.
    #[inline(always)]
    pub fn interval(
        &self,
        rotor: &Rotor<N, K>,
        track: &Track<N, K>,
        row: usize,
        from: &Shaft,
        to: &Shaft,
    ) -> (Interval<N, K>, Shaft) {
        let between = self.shaft_between(row, from, to);
        let states = [&track.state[row - 1], &track.state[row]];
        let mut interval =
            rotor.interval(states, &self.squares(rotor, row), track.regressors(row), [*from, between, *to]);
        if !self.missing.is_empty() {
            for (k, origin) in self.origin(row).into_iter().enumerate() {
                let error_a = match origin {
                    Origin::Recorded => continue,
                    Origin::Filled => self.filled_a[k],
                    Origin::Unknown => self.unknown_a[k],
                };
                let factor = (error_a / rotor.noise).max(1.0);
                interval.noise[k] = interval.noise[k].map(|noise| noise * factor);
            }
        }
        (interval, between)
    }

    /// Factors of the noise of the currents in the interval that ends at a row: errors of currents that were not recorded are what they are.
    #[inline(always)]
    pub fn scales(&self, row: usize, factors: [f64; K]) -> [f64; K] {
        if self.missing.is_empty() {
            return factors;
        }
        let origin = self.origin(row);
        std::array::from_fn(|k| if origin[k] == Origin::Recorded { factors[k] } else { 1.0 })
    }

    /// Squared currents that the interval ending at `row` is driven by, A².
    #[inline(always)]
    pub fn squares(&self, rotor: &Rotor<N, K>, row: usize) -> Squares<K> {
        let read = |row: usize| std::array::from_fn(|k| self.current[k][row]);
        match self.hold {
            Hold::HeldBefore => rotor.squares(read(row), None),
            Hold::HeldAfter => rotor.squares(read(row - 1), None),
            Hold::Linear => rotor.squares(read(row), Some(read(row - 1))),
        }
    }

    /// Readings of the positions in a row, m.
    #[inline(always)]
    pub fn read(&self, row: usize) -> [f64; N] {
        self.position.map(|position| position[row])
    }
}

/// The trajectory about which a pass is linearised.
#[derive(Clone, Debug, Default)]
pub(super) struct Track<const N: usize, const K: usize> {
    /// At every row.
    pub state: Vec<State<N>>,
    /// Expected values, by row; empty as long as they are not known.
    pub expected: Vec<Expected<N, K>>,
}

impl<const N: usize, const K: usize> Track<N, K> {
    fn regressors(&self, row: usize) -> Option<[f64; K]> {
        self.expected.get(row).map(|of| of.pulls.map(f64::from))
    }
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
