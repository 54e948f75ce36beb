//! Meaning of the readings of the currents, decided by likelihood.

use super::diagnosis::{self, Take, VERY_STRONG};
use super::likelihood::{DELAY, DYNAMICS, Hold, Knowledge, LAG, Options};
use super::samples::Samples;
use super::tolerance::plain;
use super::units::significant;
use super::{Stated, answer};
use crate::table::Table;
use crate::variables::Choice;

/// Meaning of the readings of the currents.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Currents {
    /// Time that a sample stands for.
    pub hold: Hold,
    /// Whether the currents follow what is held with a lag.
    pub lag: bool,
}

impl Currents {
    fn name(self) -> String {
        format!("{}{}", self.hold.name(), if self.lag { " with a lag" } else { "" })
    }

    /// The options of `identify` for it.
    fn options(self) -> String {
        format!("--hold {}{}", self.hold.name(), if self.lag { " --estimate lag" } else { "" })
    }
}

/// Readings that are tried, those without a lag first. Currents that are continuous follow nothing.
const READINGS: [Currents; 5] = [
    MEASURED,
    Currents { hold: Hold::HeldAfter, lag: false },
    Currents { hold: Hold::Linear, lag: false },
    Currents { hold: Hold::HeldBefore, lag: true },
    Currents { hold: Hold::HeldAfter, lag: true },
];

/// By so much a parameter raises the log-likelihood by chance (Akaike 1974). A lag of 50 µs that was worth 2.7 to 3.3 on the stretch moved λ by 5 to 26 of
/// its deviations over the whole recording.
const BY_CHANCE: f64 = 1.0;

/// Those of a sensor, that stand for the time before the sample.
const MEASURED: Currents = Currents { hold: Hold::HeldBefore, lag: false };

/// Readings of the currents, and by how much less likely than the best each is: differences of log-likelihoods, infinite where nothing fits.
#[derive(Clone, Copy, Debug)]
pub struct Holds(pub [(Currents, f64); 5]);

impl Holds {
    /// Tries the readings on a bearing whose bench is exactly as stated but for a lag of the currents, or else the delay of the positions, and the dynamics.
    #[must_use]
    pub fn of(samples: &Samples, stated: &Stated) -> Self {
        let of = answer::recording(samples, stated, stated.hold);
        let take = |at: usize| {
            let currents = READINGS[at];
            let stated = stated.clone().read_as(currents);
            let recording = answer::read_as(&of, samples, &stated, currents.hold);
            let mut options = Options { parts: stated.parts, slow_force: false, leaves_out: true };
            let kept = [if currents.lag { LAG } else { DELAY }, DYNAMICS];
            let others = options.bench().filter(|of| !kept.contains(&plain(&of.name)));
            others.for_each(|of| of.knowledge = Knowledge::Exact);
            Take { recording, options, machine: stated.machine, bearing: 0 }
        };
        let less: [f64; READINGS.len()] = diagnosis::holds(take);
        Self(std::array::from_fn(|at| (READINGS[at], less[at])))
    }

    /// Those that fit at all, the most likely first.
    pub(super) fn ranked(&self) -> Vec<Currents> {
        let mut ranked: Vec<_> = self.0.iter().filter(|(_, less)| less.is_finite()).collect();
        ranked.sort_by(|a, b| a.1.total_cmp(&b.1));
        ranked.into_iter().map(|(currents, _)| *currents).collect()
    }

    /// The same without those that have a lag.
    pub(super) fn without_lag(&self) -> impl Iterator<Item = Currents> {
        self.ranked().into_iter().filter(|of| !of.lag)
    }

    /// Other readings without a lag that are as good as the best one.
    #[must_use]
    pub fn as_likely(&self, chosen: Currents) -> Vec<Hold> {
        let is_as_good = |of: &Currents| *of != chosen && self.less(*of).is_some_and(|less| less < VERY_STRONG);
        self.without_lag().filter(is_as_good).map(|of| of.hold).collect()
    }

    /// By how much less likely than the best a reading is.
    fn less(&self, of: Currents) -> Option<f64> {
        self.0.iter().find(|(currents, _)| *currents == of).map(|(_, less)| *less)
    }

    /// The most likely one; none if nothing fits.
    fn best(&self) -> Option<Currents> {
        self.ranked().first().copied()
    }

    /// That of measured currents, unless another one is clearly more likely; else the most likely one without a lag, unless one with a lag explains more than
    /// chance.
    #[must_use]
    pub fn most_likely(&self) -> Currents {
        let is_within = |of: &Currents, most: f64| self.less(*of).is_some_and(|less| less < most);
        let measured = Some(MEASURED).filter(|of| is_within(of, VERY_STRONG));
        let plain = self.without_lag().next().filter(|of| is_within(of, BY_CHANCE));
        measured.or(plain).or(self.best()).unwrap_or(MEASURED)
    }

    /// The objection to a stated reading, if another one is clearly more likely.
    pub(super) fn against(&self, stated: Currents) -> Option<String> {
        let (less, best) = (self.less(stated)?, self.best()?);
        let by =
            if less.is_finite() { format!(" by {} in log-likelihood", significant(less, 3)) } else { String::new() };
        (less > VERY_STRONG).then(|| {
            let (stated, options, best) = (stated.name(), best.options(), best.name());
            format!("currents that are read as {stated} are less likely than as {best}{by}: {options}, or --hold auto")
        })
    }

    /// The comparison as a table; none if nothing fits.
    #[must_use]
    pub fn table(&self, chosen: Currents) -> Option<Table> {
        self.best()?;
        let rows = self.0.iter().map(|(currents, less)| {
            let mark = if *currents == chosen { "chosen" } else { "" };
            let less = if less.is_finite() { format!("{less:.1}") } else { "does not fit".into() };
            vec![currents.name(), less, mark.to_owned()]
        });
        Some(Table {
            title: "What a current sample stands for".into(),
            note: "How much less likely the same data are with each reading (differences of log-likelihoods).".into(),
            head: ["", "less likely by", ""].map(String::from).into(),
            rows: rows.collect(),
        })
    }
}
