//! Identification from a recording of a test bench, with the estimator that runs on line.

pub mod axial;
pub mod likelihood;

mod answer;
mod diagnosis;
mod faults;
mod read;
mod tolerance;
mod track;
mod twin;

use std::f64::consts::TAU;

pub use self::answer::{Answer, Question, answer};
pub use self::tolerance::{named, of_estimator, quantity, tolerance};
pub use self::track::{Track, best_hold, estimator, json, recording, tables, track, track_every};
pub use self::twin::{Stated, Twin};

use self::likelihood::{BENCH, DELAY, Told};
use self::read::significant;
pub use self::read::{Axial, Finding, Reading, Rotation, Samples, Unusable, duration_s, rate_s};
use crate::estimation::{EstimatorConfig, Hold, Method};
use crate::table::Table;

/// The methods by the names of the interface.
pub const METHODS: [(&str, Method); 3] =
    [("paperLiteral", Method::PaperLiteral), ("paper", Method::Paper), ("predictionError", Method::PredictionError)];

/// Meanings of samples of currents, by the names of the interface.
pub const HOLDS: [(&str, Hold); 3] =
    [("heldBefore", Hold::HeldBefore), ("heldAfter", Hold::HeldAfter), ("linear", Hold::Linear)];

/// The name of a meaning of samples of currents.
fn name_of(hold: Hold) -> &'static str {
    HOLDS.iter().find(|(_, known)| *known == hold).map_or("", |(name, _)| name)
}

/// Why no identification was made.
#[derive(Clone, Debug, thiserror::Error)]
pub enum Failed {
    /// The estimator refuses its parameters.
    #[error("the estimator cannot be started: {}", .0.join("; "))]
    Refused(Vec<String>),
}

/// The window of one revolution that fits the recording, in seconds; the paper's where the speed is not known.
#[must_use]
pub fn one_revolution(samples: &Samples) -> f64 {
    let known: Vec<f64> = samples.omega_rad_s.iter().copied().filter(|omega| omega.is_finite()).collect();
    let mean = known.iter().sum::<f64>().abs() / known.len().max(1) as f64;
    let window_s = if mean > 0.0 { TAU / mean } else { 0.02 };
    // Two periods of the slowest that the window can see, eight samples at least.
    (window_s.min(0.2) / samples.step_s).round().max(8.0) * samples.step_s
}

/// How much less likely a stretch of a recording is with each reading of a current sample, in the order of [`HOLDS`]: differences of
/// log-likelihoods, 0 for the best, infinite where nothing fits.
#[derive(Clone, Copy, Debug)]
pub struct Holds(pub [f64; 3]);

impl Holds {
    /// Tries the readings on a bearing, the delay of whose positions is as well known as in `bench`.
    #[must_use]
    pub fn of(samples: &Samples, config: &EstimatorConfig, bench: &[Told; BENCH]) -> Self {
        let mut options = likelihood::Options::new(config.m_kg, config.gap_m, config.alpha_rad);
        options.bench[DELAY] = bench[DELAY];
        Self(diagnosis::holds(&HOLDS.map(|(_, hold)| diagnosis::Take {
            columns: answer::columns(samples, hold),
            options: options.clone(),
            hold,
            config: config.clone(),
        })))
    }

    /// The most likely one; none if nothing fits.
    fn best(&self) -> Option<usize> {
        let best = (0..HOLDS.len()).min_by(|a, b| self.0[*a].total_cmp(&self.0[*b]));
        best.filter(|best| self.0[*best].is_finite())
    }

    /// That of measured currents, unless another one is clearly more likely.
    #[must_use]
    pub fn most_likely(&self) -> Hold {
        HOLDS[self.best().filter(|_| self.0[0] >= diagnosis::VERY_STRONG).unwrap_or(0)].1
    }

    /// The objection to a stated reading, if another one is clearly more likely.
    fn against(&self, stated: Hold) -> Option<String> {
        let ((name, _), less) = HOLDS.iter().zip(self.0).find(|((_, hold), _)| *hold == stated)?;
        let best = HOLDS[self.best()?].0;
        let by =
            if less.is_finite() { format!(" by {} in log-likelihood", significant(less, 3)) } else { String::new() };
        (less > diagnosis::VERY_STRONG).then(|| {
            format!("currents that are read as {name} are less likely than as {best}{by}: --hold {best}, or auto")
        })
    }

    /// The comparison as a table; none if nothing fits.
    #[must_use]
    pub fn table(&self, chosen: Hold) -> Option<Table> {
        self.best()?;
        let note = "How much less likely the same data are with each reading (differences of log-likelihoods).";
        Some(holds_beside(note, "less likely by", self.0.map(|less| format!("{less:.1}")), chosen))
    }
}

/// A table with a number for each reading of a current, in the order of [`HOLDS`].
fn holds_beside(note: &str, column: &str, numbers: [String; 3], chosen: Hold) -> Table {
    let rows = HOLDS.iter().zip(numbers).map(|((name, hold), number)| {
        let mark = if *hold == chosen { "chosen" } else { "" };
        vec![(*name).to_owned(), number, mark.to_owned()]
    });
    Table {
        title: "What a current sample stands for".into(),
        note: note.into(),
        head: ["", column, ""].map(String::from).into(),
        rows: rows.collect(),
    }
}
