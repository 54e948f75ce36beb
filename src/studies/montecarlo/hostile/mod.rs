//! Hostile courses: what a bench really takes. An estimate that is called valid must be right on every one of them.
//!
//! Each course of [`courses`] runs with the noise known to the estimator and estimated by it, many times each, in closed loop. [`judge`] says of
//! a run how far valid estimates were off, in standard deviations that the estimator states, how much of the time they were valid,
//! and how often that changed.

pub mod altered;
mod courses;

use super::cases::Draw;
use super::figures::{CONFIDENT, Truth, Worst, is_contact, touched};
use super::{NOISE, cases, real, study};
use crate::simulation::recording::Recording;
use crate::simulation::scenario::Scenario;
use crate::simulation::simulate::{self, Refused};
use crate::table::Table;
use altered::{Alter, Wires};
use fmu_export::variable::Value;

pub use courses::courses;

/// From then on, in s, the share of the time is counted in which the estimate is valid.
pub const VALID_FROM_S: f64 = 0.3;

/// A jump of λ may be noticed within so many revolutions.
const GRANTED_REVOLUTIONS: f64 = 2.0;

/// How often a bearing drawn at random that touches down is drawn again.
const ATTEMPTS: u64 = 20;

/// Requirements on a course.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Asked {
    /// An estimate that is right, most of the time.
    Valid,
    /// No valid estimate that is wrong: something is false, or too fast to be known.
    NotWrong,
    /// No valid estimate: the readings contradict each other.
    NotValid,
    /// Nothing: the data are those of another bearing without the fault.
    Nothing,
}

/// Changes the scenario of a run; the number is its seed.
type Set = Box<dyn Fn(&mut Scenario, u64) + Send + Sync>;

/// A course: how the scenario of a run, and the readings on their way, differ from the usual.
pub struct Course {
    /// A few words; what is tried.
    pub name: String,
    /// The requirement.
    pub asked: Asked,
    /// The built-in scenario that it starts from.
    base: &'static str,
    /// Sensor noise, in m and A.
    noise: [f64; 2],
    /// How long a run lasts, in s.
    length_s: f64,
    set: Set,
    /// The error of the readings.
    alter: Option<Alter>,
    /// It makes no difference whether the noise is told; or it is what is told that is false.
    only: Option<bool>,
    /// The rotor is meant to touch its backup bearing.
    rubs: bool,
    /// The bearing is drawn at random; one that touches down early is drawn again.
    drawn: bool,
}

/// Runs of a course with the noise known or estimated.
pub struct Case<'a> {
    /// The course.
    pub course: &'a Course,
    /// Whether the noise is told.
    pub told: bool,
}

/// Results of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// The seed that the run can be repeated with.
    pub seed: u64,
    /// The valid sample that was off by most of its standard deviations, tolerances included.
    pub worst: Worst,
    /// Part of the time from [`VALID_FROM_S`] on in which the estimate was valid.
    pub valid: f64,
    /// The most changes of `valid` within one second.
    pub changes: usize,
    /// Standard deviations of all λ at the end, relative, and errors in these, if they are valid.
    pub at_end: Option<Vec<[f64; 2]>>,
    /// When the rotor touched down or left the gap, in s; nothing after it counts.
    pub ended_s: Option<f64>,
}

impl Trial {
    /// Whether a valid estimate was wrong by more than [`CONFIDENT`] standard deviations.
    pub fn is_beyond(&self) -> bool {
        self.worst.ratio > CONFIDENT
    }
}

impl Course {
    /// Whether a run says what must not be said.
    pub fn is_wrong(&self, trial: &Trial) -> bool {
        trial.is_beyond() || (self.asked == Asked::NotValid && trial.valid > 0.0)
    }
}

/// The word for the noise in titles.
fn noise(known: bool) -> &'static str {
    if known { "known" } else { "estimated" }
}

/// All courses, with the noise known and estimated.
pub fn cases(courses: &[Course]) -> Vec<Case<'_>> {
    let both = |told| courses.iter().map(move |course| Case { course, told });
    let wanted = |case: &Case| case.course.only.is_none_or(|only| only == case.told);
    both(true).chain(both(false)).filter(wanted).collect()
}

impl Case<'_> {
    /// The title of these runs among those of all studies.
    pub fn title(&self) -> String {
        format!("hostile: {}, noise {}", self.course.name, noise(self.told))
    }

    /// The scenario of the run with that seed, drawn for the n-th time.
    pub fn scenario(&self, seed: u64, attempt: u64) -> Scenario {
        let course = self.course;
        let base = Scenario::open(std::path::Path::new(course.base)).expect("a scenario that comes with the program");
        let mut scenario = study("", &base, course.noise, self.told, 1).scenario;
        scenario.duration_s = course.length_s;
        // Seeds of the n-th drawing are far from those of the others.
        (course.set)(&mut scenario, seed + (attempt << 32));
        scenario.set("plant", "sensor.seed", Value::Integer(seed as i32));
        scenario
    }

    fn trial(&self, seed: u64) -> Result<Trial, Refused> {
        let mut attempt = 0;
        loop {
            let scenario = self.scenario(seed, attempt);
            let wires = Wires::new(&scenario);
            let mut alter = self.course.alter.as_ref().map(|alter| alter(&scenario, seed));
            let wanted = |path: &str| {
                let quantities = ["lambdaHat", "lambdaStdTotal", "estimator.valid"];
                is_contact(path) || quantities.iter().any(|quantity| path.contains(quantity))
            };
            let altered = |time_s: f64, values: &mut [Value]| {
                if let Some(alter) = &mut alter {
                    wires.alter(time_s, values, alter);
                }
            };
            let run = simulate::run_altered(&scenario, wanted, altered, |_| ())?;
            let missing = || Refused(vec!["plant or estimator lacks an output that a study needs".into()]);
            let mut trial = judge(&scenario, &run.recording, seed, self.course.rubs).ok_or_else(missing)?;
            if run.error.is_some() {
                trial.ended_s = trial.ended_s.or(run.recording.time_s.last().copied());
            }
            attempt += 1;
            let early = trial.ended_s.is_some_and(|ended_s| ended_s < VALID_FROM_S);
            if !(self.course.drawn && early && attempt < ATTEMPTS) {
                return Ok(trial);
            }
        }
    }
}

/// Judges a run by its valid samples, until the rotor touches down unless that is part of the course.
pub fn judge(scenario: &Scenario, recording: &Recording, seed: u64, rubs: bool) -> Option<Trial> {
    let mut magnets = Vec::new();
    for magnet in scenario.magnets() {
        let of = |name: &str| recording.get(&format!("estimator.{}{name}{}", magnet.0, magnet.1));
        magnets.push((Truth::new(scenario, &magnet), of("lambdaHat")?, of("lambdaStdTotal")?));
    }
    let valid = recording.get("estimator.valid")?;
    let time_s = &recording.time_s;
    let touched = touched(recording).filter(|_| !rubs);
    let rows = touched.unwrap_or(time_s.len());
    let omega = real(scenario, "plant", "omega").abs().max(1.0);
    let granted_s = GRANTED_REVOLUTIONS * std::f64::consts::TAU / omega;
    let granted = |time_s: f64| {
        let jumps = magnets.iter().filter_map(|(truth, ..)| truth.jump_s());
        jumps.into_iter().any(|jump_s| (jump_s..jump_s + granted_s).contains(&time_s))
    };
    // Error and standard deviation, relative, and their ratio.
    let errors = |row: usize| {
        magnets.iter().map(move |(truth, hat, std)| {
            let truth = truth.at(time_s[row]);
            let (error, std) = (hat[row] / truth - 1.0, std[row] / truth);
            // Two numbers that are both 0 agree.
            let ratio = if error == 0.0 { 0.0 } else { error / std };
            (error, std, if ratio.is_nan() { f64::INFINITY } else { ratio })
        })
    };
    let mut worst = Worst::default();
    for row in (0..rows).filter(|row| valid[*row] == 1.0 && !granted(time_s[*row])) {
        for (error, std, ratio) in errors(row) {
            if ratio.abs() > worst.ratio {
                worst = Worst { ratio: ratio.abs(), time_s: time_s[row], error, std };
            }
        }
    }
    let counted = (0..rows).filter(|row| time_s[*row] >= VALID_FROM_S);
    let (all, good) = counted.fold((0, 0), |(all, good), row| (all + 1, good + usize::from(valid[row] == 1.0)));
    let changes: Vec<f64> = (1..rows).filter(|row| valid[*row] != valid[row - 1]).map(|row| time_s[row]).collect();
    let within_a_second = |(n, begin_s): (usize, &f64)| changes.partition_point(|at_s| *at_s < begin_s + 1.0) - n;
    Some(Trial {
        seed,
        worst,
        valid: if all > 0 { good as f64 / all as f64 } else { f64::NAN },
        changes: changes.iter().enumerate().map(within_a_second).max().unwrap_or(0),
        at_end: rows
            .checked_sub(1)
            .filter(|last| valid[*last] == 1.0)
            .map(|last| errors(last).map(|(_, std, ratio)| [std, ratio]).collect()),
        ended_s: touched.map(|row| time_s[row]),
    })
}

/// Runs every case with as many seeds, on all processors; the trials of each, in the order of the seeds.
///
/// # Errors
/// Every parameter that a model refuses; why a run ended early.
pub fn run(cases: &[Case], runs: usize, first_seed: u64) -> Result<Vec<Vec<Trial>>, Refused> {
    let all = super::runs(cases.len() * runs, |index| cases[index / runs].trial(first_seed + (index % runs) as u64));
    let mut all = all.into_iter();
    cases.iter().map(|_| all.by_ref().take(runs).collect()).collect()
}

/// Runs that say what must not be said, and all runs, where something can be asked.
pub fn wrong(cases: &[Case], found: &[Vec<Trial>], told: bool) -> (usize, usize) {
    let counted = cases.iter().zip(found).filter(|(case, _)| case.told == told && case.course.asked != Asked::Nothing);
    counted.fold((0, 0), |(wrong, runs), (case, trials)| {
        (wrong + trials.iter().filter(|trial| case.course.is_wrong(trial)).count(), runs + trials.len())
    })
}

/// A row for each case.
pub fn table(cases: &[Case], found: &[Vec<Trial>]) -> Table {
    let head =
        ["", "wrong", "worst", "error, %", "stated, %", "seed", "valid, %", "changes", "± at the end, %", "error/±"];
    let row = |(case, trials): (&Case, &Vec<Trial>)| {
        let worst = trials.iter().max_by(|one, other| one.worst.ratio.total_cmp(&other.worst.ratio));
        let (seed, worst) = worst.map_or((0, Worst::default()), |trial| (trial.seed, trial.worst));
        let valid: Vec<f64> = trials.iter().map(|trial| trial.valid).filter(|valid| !valid.is_nan()).collect();
        let at_end: Vec<_> = trials.iter().filter_map(|trial| trial.at_end.as_ref()).flatten().collect();
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let rms = |which: usize| mean(&at_end.iter().map(|end| end[which] * end[which]).collect::<Vec<_>>()).sqrt();
        let number = |value: f64, digits: usize| {
            if value.is_finite() { format!("{value:.digits$}") } else { "–".to_owned() }
        };
        let of_worst = |text: String| if worst.ratio > 0.0 { text } else { "–".into() };
        let mark = match case.course.asked {
            Asked::Valid => "",
            Asked::NotWrong => " *",
            Asked::NotValid => " **",
            Asked::Nothing => " ***",
        };
        let ended = trials.iter().filter(|trial| trial.ended_s.is_some()).count();
        let ended = if ended > 0 { format!(" ({ended} ended by contact)") } else { String::new() };
        vec![
            format!("{}, {}{mark}{ended}", case.course.name, noise(case.told)),
            format!("{}/{}", trials.iter().filter(|trial| case.course.is_wrong(trial)).count(), trials.len()),
            number(worst.ratio, 1),
            of_worst(number(100.0 * worst.error, 2)),
            of_worst(number(100.0 * worst.std, 2)),
            of_worst(format!("{seed} at {:.3} s", worst.time_s)),
            number(100.0 * mean(&valid), 0),
            trials.iter().map(|trial| trial.changes).max().unwrap_or(0).to_string(),
            number(100.0 * rms(0), 2),
            number(rms(1), 2),
        ]
    };
    let seeds = found.first().and_then(|trials| Some((trials.first()?.seed, trials.last()?.seed)));
    let (first, last) = seeds.unwrap_or_default();
    let share = |told: bool| {
        let (wrong, runs) = wrong(cases, found, told);
        format!("{wrong} of {runs} runs ({:.1} %)", 100.0 * wrong as f64 / runs.max(1) as f64)
    };
    let note = format!(
        "Seeds {first} to {last}. Wrong: runs with a valid estimate off by more than {CONFIDENT} stated deviations, tolerances included; worst: the \
         greatest error of a valid estimate in these deviations, and both in per cent; valid: part of the time from {VALID_FROM_S} s on; changes: \
         of `valid` within a second, at most; ± at the end: rms of what is stated, and error in it. * something is false or too fast, so that the estimate \
         need not be valid; ** readings contradict each other, and any valid estimate is wrong; *** cannot be known, and does not count. Wrong in \
         all: noise known {}, estimated {}.",
        share(true),
        share(false),
    );
    Table {
        title: "Hostile courses".into(),
        note,
        head: head.map(String::from).into(),
        rows: cases.iter().zip(found).map(row).collect(),
    }
}
