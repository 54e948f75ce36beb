//! Hostile courses: conditions of real test benches. A valid estimate must be right in every one of them.
//!
//! Each of the [`courses`] runs many times in closed loop, with the noise known to the estimator and estimated by it. [`judge`] finds the
//! largest error of valid estimates in stated standard deviations, the fraction of time with a valid estimate, and how often validity
//! changed.

pub mod altered;
mod courses;

use super::cases::Draw;
use super::figures::{self, CONFIDENT, is_contact, touched};
use super::{NOISE, built_in, cases, drawn_again, or_dash, study};
use crate::simulation::{Recording, Scenario, Stopped, simulate};
use crate::studies::parallel::in_order_shown;
use crate::studies::statistics::mean;
use crate::table::Table;
use altered::{Alter, Wires};
use fmu_export::variable::Value;

pub use super::figures::{Trial, VALID_FROM_S};
pub use courses::courses;

/// Requirement on the estimates of a course.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Requirement {
    /// An estimate that is right, most of the time.
    Valid,
    /// No valid estimate that is wrong: something is false, or changes too fast to be identified.
    NotWrong,
    /// No valid estimate: the readings contradict each other.
    NotValid,
    /// Nothing: another bearing without the fault would give the same data.
    Nothing,
}

/// Changes the scenario of a run; the number is its seed.
type Set = Box<dyn Fn(&mut Scenario, u64) + Send + Sync>;

/// A course: how the scenario of its runs, and the readings, differ from the nominal.
pub struct Course {
    /// Short description.
    pub name: String,
    /// The requirement.
    pub asked: Requirement,
    /// The built-in scenario that it modifies.
    base: &'static str,
    /// Sensor noise, in m and A.
    noise: [f64; 2],
    /// Length of a run, in s.
    length_s: f64,
    set: Set,
    /// The error of the readings.
    alter: Option<Alter>,
    /// Runs only with the noise known, or only estimated: the other makes no difference, or the stated noise is the error.
    only: Option<bool>,
    /// The rotor is meant to touch its backup bearing.
    rubs: bool,
    /// The bearing is drawn at random; one that touches down early is drawn again.
    drawn: bool,
    /// Whether the estimator knows the noise.
    pub noise_is_known: bool,
}

impl Course {
    /// The number of runs that violate the requirement.
    fn wrong(&self, trials: &[Trial]) -> usize {
        let is_wrong = |trial: &&Trial| trial.is_beyond() || (self.asked == Requirement::NotValid && trial.valid > 0.0);
        trials.iter().filter(is_wrong).count()
    }

    /// The word for the noise in titles.
    fn noise_in_words(&self) -> &'static str {
        if self.noise_is_known { "known" } else { "estimated" }
    }

    /// The title of these runs among those of all studies.
    pub fn title(&self) -> String {
        format!("hostile: {}, noise {}", self.name, self.noise_in_words())
    }

    /// The scenario of the run with this seed, in the draw numbered `attempt`.
    pub fn scenario(&self, seed: u64, attempt: u64) -> Scenario {
        let mut scenario = study("", &built_in(self.base), self.noise, self.noise_is_known, 1).scenario;
        scenario.duration_s = self.length_s;
        // Seeds of different draws are far apart.
        (self.set)(&mut scenario, seed + (attempt << 32));
        scenario.set("plant", "sensor.seed", seed as i32);
        scenario
    }

    fn trial(&self, seed: u64) -> Result<Trial, Stopped> {
        drawn_again(seed, |attempt| {
            let scenario = self.scenario(seed, attempt);
            let wires = Wires::new(&scenario);
            let mut alter = self.alter.as_ref().map(|alter| alter(&scenario, seed));
            let wanted = |path: &str| {
                let quantities = ["lambdaHat", "lambdaStdTotal", "estimator.valid"];
                is_contact(path) || quantities.iter().any(|quantity| path.contains(quantity))
            };
            let mut altered = |time_s: f64, values: &mut [Value]| {
                if let Some(alter) = &mut alter {
                    wires.alter(time_s, values, alter);
                }
            };
            let run = simulate::run_altered(&scenario, &wanted, &mut altered)?;
            let mut trial = judge(&scenario, &run.recording, self.rubs);
            if run.error.is_some() {
                trial.touched_s = trial.touched_s.or(run.recording.time_s.last().copied());
            }
            // A bearing that is not drawn would touch down again.
            Ok((trial, if self.drawn { VALID_FROM_S } else { f64::NEG_INFINITY }))
        })
    }
}

/// Judges a run by its valid samples and at its end; it ends when the rotor touches down, unless that is part of the course.
pub fn judge(scenario: &Scenario, recording: &Recording, rubs: bool) -> Trial {
    let touched = touched(recording).filter(|_| !rubs);
    let last = touched.unwrap_or(recording.time_s.len()).checked_sub(1);
    let instants_s: Vec<f64> = last.map(|last| recording.time_s[last]).into_iter().collect();
    figures::judge(scenario, recording, &instants_s, touched)
}

/// Makes `runs` runs of every course, on all processors; the trials of each course are in the order of the seeds.
///
/// # Errors
/// All parameters that a model refuses; the reason why a run ended early.
pub fn run(courses: &[Course], runs: usize, first_seed: u64) -> Result<Vec<Vec<Trial>>, Stopped> {
    let trial = |index: usize| courses[index / runs].trial(first_seed + (index % runs) as u64);
    let all = in_order_shown("runs", courses.len() * runs, &trial);
    let mut all = all.into_iter();
    courses.iter().map(|_| all.by_ref().take(runs).collect()).collect()
}

/// The number of runs that violate the requirement, and of all runs with a requirement.
pub fn wrong(courses: &[Course], found: &[Vec<Trial>], known: bool) -> (usize, usize) {
    let is_counted = |course: &Course| course.noise_is_known == known && course.asked != Requirement::Nothing;
    let counted = courses.iter().zip(found).filter(|(course, _)| is_counted(course));
    counted.fold((0, 0), |(wrong, runs), (course, trials)| (wrong + course.wrong(trials), runs + trials.len()))
}

/// A row for each course.
pub fn table(courses: &[Course], found: &[Vec<Trial>]) -> Table {
    let head =
        ["", "wrong", "worst", "error, %", "stated, %", "seed", "valid, %", "changes", "± at the end, %", "error/±"];
    let row = |(course, trials): (&Course, &Vec<Trial>)| {
        let (seed, worst) = figures::worst(trials);
        let samples = trials.iter().filter_map(|trial| trial.samples.last()).filter(|sample| sample.valid);
        // Standard deviations, and errors in units of these.
        let at_end: Vec<_> = samples
            .flat_map(|sample| sample.total.iter().zip(&sample.error))
            .map(|(std, error)| [*std, if *error == 0.0 { 0.0 } else { error / std }])
            .collect();
        let square = |which: usize| at_end.iter().map(|end| end[which] * end[which]).sum::<f64>() / at_end.len() as f64;
        let of_worst = |text: String| if worst.ratio > 0.0 { text } else { "–".into() };
        let mark = match course.asked {
            Requirement::Valid => "",
            Requirement::NotWrong => " *",
            Requirement::NotValid => " **",
            Requirement::Nothing => " ***",
        };
        let ended = trials.iter().filter(|trial| trial.touched_s.is_some()).count();
        let ended = if ended > 0 { format!(" ({ended} ended by contact)") } else { String::new() };
        vec![
            format!("{}, {}{mark}{ended}", course.name, course.noise_in_words()),
            format!("{}/{}", course.wrong(trials), trials.len()),
            or_dash(worst.ratio, 1),
            of_worst(or_dash(100.0 * worst.error, 2)),
            of_worst(or_dash(100.0 * worst.std, 2)),
            of_worst(format!("{seed} at {:.3} s", worst.time_s)),
            or_dash(100.0 * mean(trials.iter().map(|trial| trial.valid)), 0),
            trials.iter().map(|trial| trial.changes).max().unwrap_or(0).to_string(),
            or_dash(100.0 * square(0).sqrt(), 2),
            or_dash(square(1).sqrt(), 2),
        ]
    };
    let seeds = found.first().and_then(|trials| Some((trials.first()?.seed, trials.last()?.seed)));
    let (first, last) = seeds.unwrap_or_default();
    let fraction = |known: bool| {
        let (wrong, runs) = wrong(courses, found, known);
        format!("{wrong} of {runs} runs ({:.1} %)", 100.0 * wrong as f64 / runs.max(1) as f64)
    };
    let note = format!(
        "Seeds {first} to {last}. Wrong: runs with a valid estimate off by more than {CONFIDENT} stated deviations, tolerances included; worst: the \
         greatest error of a valid estimate in these deviations, and both in per cent; valid: part of the time from {VALID_FROM_S} s on; changes: \
         of `valid` within a second, at most; ± at the end: rms of what is stated, and error in it. * something is false or too fast, so that the estimate \
         need not be valid; ** readings contradict each other, and any valid estimate is wrong; *** cannot be known, and does not count. Wrong in \
         all: noise known {}, estimated {}.",
        fraction(true),
        fraction(false),
    );
    Table::new("Hostile courses", note, head, courses.iter().zip(found).map(row))
}
