//! Meaning of the current samples, decided by likelihood.

use super::diagnosis::{self, Trial};
use super::likelihood::{Hold, Options};
use super::samples::Samples;
use super::units::significant;
use super::{Stated, answer};
use crate::bearing::array;
use crate::estimation::VERY_STRONG;
use crate::table::Table;
use crate::variables::Choice;

/// Meaning of the current samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Currents {
    /// Time that a sample stands for.
    pub hold: Hold,
    /// Whether the currents follow the held values with a lag.
    pub lag: bool,
}

impl Currents {
    fn name(self) -> String {
        format!("{}{}", self.hold.name(), if self.lag { " with a lag" } else { "" })
    }

    /// The options of `identify` that select it.
    fn options(self) -> String {
        format!("--hold {}{}", self.hold.name(), if self.lag { " --estimate lag" } else { "" })
    }
}

/// Meanings to compare, those without a lag first. Continuous currents are not commands, and do not lag.
const MEANINGS: [Currents; 5] = [
    MEASURED,
    Currents { hold: Hold::HeldAfter, lag: false },
    Currents { hold: Hold::Linear, lag: false },
    Currents { hold: Hold::HeldBefore, lag: true },
    Currents { hold: Hold::HeldAfter, lag: true },
];

/// Amount by which a parameter raises the log-likelihood by chance (Akaike 1974). A lag of 50 µs that raised it by 2.7 to 3.3 on the
/// stretch moved λ by 5 to 26 of its standard deviations over the whole recording.
const BY_CHANCE: f64 = 1.0;

/// Measured currents, which stand for the time before the sample.
const MEASURED: Currents = Currents { hold: Hold::HeldBefore, lag: false };

/// Meanings of the currents, with the difference between the greatest log-likelihood and theirs; infinite if they do not fit.
#[derive(Clone, Copy, Debug)]
pub struct Holds(pub [(Currents, f64); 5]);

impl Holds {
    /// Compares the meanings with what is stated about the bench.
    pub fn of(samples: &Samples, stated: &Stated) -> Self {
        let of = answer::recording(samples, stated, stated.hold);
        let trial = |at: usize| {
            let currents = MEANINGS[at];
            let stated = stated.clone().read_as(currents);
            let recording = answer::read_as(&of, samples, &stated, currents.hold);
            let options = Options { parts: stated.parts, slow_force: false, excludes_rows: true, corrects_bias: true };
            Trial { recording, options, machine: stated.machine, bearing: 0 }
        };
        let deficits: [f64; MEANINGS.len()] = diagnosis::holds(trial);
        Self(array::from_fn(|at| (MEANINGS[at], deficits[at])))
    }

    /// Those that fit, the most likely first.
    pub(super) fn ranked(&self) -> Vec<Currents> {
        let mut ranked: Vec<_> = self.0.iter().filter(|(_, deficit)| deficit.is_finite()).collect();
        ranked.sort_by(|a, b| a.1.total_cmp(&b.1));
        ranked.into_iter().map(|(currents, _)| *currents).collect()
    }

    /// The same without those that have a lag.
    pub(super) fn without_lag(&self) -> impl Iterator<Item = Currents> {
        self.ranked().into_iter().filter(|of| !of.lag)
    }

    /// Other meanings without a lag that are about as likely as the best one.
    pub fn equally_likely(&self, chosen: Currents) -> Vec<Hold> {
        let is_as_good = |of: &Currents| *of != chosen && self.is_within(*of, VERY_STRONG);
        self.without_lag().filter(is_as_good).map(|of| of.hold).collect()
    }

    /// Difference between the greatest log-likelihood and that of a meaning.
    fn deficit(&self, of: Currents) -> Option<f64> {
        self.0.iter().find(|(currents, _)| *currents == of).map(|(_, deficit)| *deficit)
    }

    fn is_within(&self, of: Currents, most: f64) -> bool {
        self.deficit(of).is_some_and(|deficit| deficit < most)
    }

    /// The most likely one, if any without a lag fits. Where only a lag lets the search converge, something else is wrong.
    fn best(&self) -> Option<Currents> {
        self.without_lag().next()?;
        self.ranked().first().copied()
    }

    /// Measured currents, unless another meaning is clearly more likely; else the best without a lag, unless a lag explains more than chance.
    pub fn most_likely(&self) -> Currents {
        let measured = Some(MEASURED).filter(|of| self.is_within(*of, VERY_STRONG));
        let plain = self.without_lag().next().filter(|of| self.is_within(*of, BY_CHANCE));
        measured.or(plain).or(self.best()).unwrap_or(MEASURED)
    }

    /// The objection to a stated meaning, if another one is clearly more likely, and the options for it.
    pub(super) fn against(&self, stated: Currents) -> Option<[String; 2]> {
        let (deficit, best) = (self.deficit(stated)?, self.best()?);
        let by = deficit.is_finite().then(|| format!(" by {} in log-likelihood", significant(deficit, 3)));
        let by = by.unwrap_or_default();
        (deficit > VERY_STRONG).then(|| {
            let (stated, options, best) = (stated.name(), best.options(), best.name());
            let why = format!("currents that are read as {stated} are less likely than as {best}{by}");
            [why, format!("{options}, or --hold auto")]
        })
    }

    /// The comparison as a table, if any meaning fits.
    pub fn table(&self, chosen: Currents) -> Option<Table> {
        self.best()?;
        let rows = self.0.iter().map(|(currents, deficit)| {
            let mark = if *currents == chosen { "chosen" } else { "" };
            let deficit = if deficit.is_finite() { format!("{deficit:.1}") } else { "does not fit".into() };
            vec![currents.name(), deficit, mark.to_owned()]
        });
        let note = "How much less likely the same data are with each reading (differences of log-likelihoods).";
        Some(Table::new("Meaning of a current sample", note, ["", "less likely by", ""], rows))
    }
}
