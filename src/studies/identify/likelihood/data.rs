//! A recording as the passes of the filter read it: shaft, currents and their origin, row by row.

use std::borrow::Cow;
use std::ops::Range;

use super::equations::{Bearing, Interval, Shaft, Squares, State};
use super::expected::Expected;
use super::{Missing, Origin};
use crate::estimation::Hold;

/// A recording as the passes need it.
#[derive(Debug)]
pub(super) struct Data<'a> {
    pub h: f64,
    pub position: &'a [[f64; 2]],
    pub current: Cow<'a, [[f64; 3]]>,
    pub omega: &'a [f64],
    pub hold: Hold,
    /// cos θ, sin θ at the samples, and in the middle of the interval that ends there.
    pub at: Vec<[f64; 2]>,
    pub middle: Vec<[f64; 2]>,
    /// Half the number of rows over which ω̇ is taken.
    pub half_width: usize,
    /// Samples that were not recorded; empty if there are none.
    pub missing: &'a [Missing],
    /// Errors of currents that were filled, and of those that are not known, A.
    pub filled_a: [f64; 3],
    pub unknown_a: [f64; 3],
}

/// Factor of the measurement variance of a row that was not recorded: the filter predicts across it.
const UNKNOWN: f64 = 1e10;
/// Rows after a current that is not known in which the filter finds the velocity again.
const FOUND_AGAIN: usize = 4;

impl Data<'_> {
    #[inline(always)]
    pub fn is_missing(&self, row: usize) -> bool {
        self.missing.get(row).is_some_and(|missing| missing.position)
    }

    /// Whether a current of a row is not known.
    #[inline(always)]
    pub fn is_unknown(&self, row: usize) -> bool {
        self.missing.get(row).is_some_and(|missing| missing.current.contains(&Origin::Unknown))
    }

    /// Whether an innovation tells of the noise: not where the position was not recorded, nor where the force is not known.
    #[inline(always)]
    pub fn tells(&self, row: usize) -> bool {
        self.missing.is_empty()
            || !self.is_missing(row) && !(row.saturating_sub(FOUND_AGAIN)..=row).any(|row| self.is_unknown(row))
    }

    /// The origin of the currents of the interval that ends at a row. Where a current is not known on either side the interval is not, whatever a sample stands
    /// for: the readings of the currents are then compared over the same intervals.
    #[inline(always)]
    fn origin(&self, row: usize) -> [Origin; 3] {
        let [before, here] = [self.missing[row - 1].current, self.missing[row].current];
        std::array::from_fn(|k| match (self.hold, before[k].max(here[k])) {
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
    pub fn slow(&self, bearing: &Bearing, rows: usize) -> f64 {
        bearing.slow * bearing.slow * rows as f64 * self.h
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
        Shaft { cos, sin, square: omega * omega, rate: self.rate(row) }
    }

    #[inline(always)]
    fn shaft_between(&self, row: usize, from: &Shaft, to: &Shaft) -> Shaft {
        let [cos, sin] = self.middle[row];
        Shaft { cos, sin, square: 0.5 * (from.square + to.square), rate: 0.5 * (from.rate + to.rate) }
    }

    /// The interval that ends at `row`, and the shaft in its middle.
    #[inline(always)]
    pub fn interval(
        &self,
        bearing: &Bearing,
        track: &Track,
        row: usize,
        from: &Shaft,
        to: &Shaft,
    ) -> (Interval, Shaft) {
        let between = self.shaft_between(row, from, to);
        let states = [&track.state[row - 1], &track.state[row]];
        let mut interval =
            bearing.interval(states, &self.squares(bearing, row), track.regressors(row), [*from, between, *to]);
        if !self.missing.is_empty() {
            for (k, origin) in self.origin(row).into_iter().enumerate() {
                let error_a = match origin {
                    Origin::Recorded => continue,
                    Origin::Filled => self.filled_a[k],
                    Origin::Unknown => self.unknown_a[k],
                };
                let factor = (error_a / bearing.noise).max(1.0);
                interval.noise[k] = interval.noise[k].map(|noise| noise * factor);
            }
        }
        (interval, between)
    }

    /// Factors of the noise of the currents in the interval that ends at a row: errors of currents that were not recorded are what they are.
    #[inline(always)]
    pub fn scales(&self, row: usize, factors: [f64; 3]) -> [f64; 3] {
        if self.missing.is_empty() {
            return factors;
        }
        let origin = self.origin(row);
        std::array::from_fn(|k| if origin[k] == Origin::Recorded { factors[k] } else { 1.0 })
    }

    /// Squared currents that the interval ending at `row` is driven by, A².
    #[inline(always)]
    pub fn squares(&self, bearing: &Bearing, row: usize) -> Squares {
        match self.hold {
            Hold::HeldBefore => bearing.squares(self.current[row], None),
            Hold::HeldAfter => bearing.squares(self.current[row - 1], None),
            Hold::Linear => bearing.squares(self.current[row], Some(self.current[row - 1])),
        }
    }
}

/// The trajectory about which a pass is linearised.
#[derive(Clone, Debug, Default)]
pub(super) struct Track {
    /// (y, z, ẏ, ż) at every row.
    pub state: Vec<State>,
    /// Expected values, by row; empty as long as it is not known.
    pub expected: Vec<Expected>,
}

impl Track {
    fn regressors(&self, row: usize) -> Option<[f64; 3]> {
        self.expected.get(row).map(|of| [of[0], of[1], of[2]].map(f64::from))
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
