//! A spindle over many seeds: errors of all force constants and of the unbalance, what is stated of them, and what correction masses leave.

use std::f64::consts::{PI, TAU};
use std::path::Path;

use super::cases::{self, Draw};
use super::figures::CONFIDENT;
use super::{NOISE, in_parallel, real};
use crate::simulation::scenario::Scenario;
use crate::simulation::simulate::{self, Refused, Run};
use crate::simulation::synchronous;
use crate::table::Table;
use fmu_export::variable::Value;

/// Runs of a spindle that are judged together.
#[derive(Clone)]
pub struct SpindleStudy {
    /// One line.
    pub title: String,
    /// The scenario that the runs vary.
    pub scenario: Scenario,
    /// When the estimates are looked at, in s.
    pub instants_s: Vec<f64>,
    /// How many runs.
    pub runs: usize,
}

/// A run at one of the instants.
struct Found {
    valid: bool,
    /// Relative errors of all λ, and the same in standard deviations.
    errors: Vec<f64>,
    normalised: Vec<f64>,
    /// Errors of both unbalances, relative and in rad.
    unbalance: [[f64; 2]; 2],
}

/// All studies of a spindle.
///
/// # Panics
/// Never: the scenarios come with the program.
#[must_use]
pub fn studies(runs: usize) -> Vec<SpindleStudy> {
    let built_in = |name: &str| Scenario::open(Path::new(name)).expect("a scenario that comes with the program");
    let mut studies = Vec::new();
    for (told, says) in [(true, "noise known"), (false, "noise estimated")] {
        let mut add = |title: &str, instants_s: &[f64], set: &dyn Fn(&mut Scenario)| {
            let mut scenario = built_in("spindle");
            cases::noise(&mut scenario, NOISE, told);
            scenario.duration_s = instants_s.iter().copied().fold(0.0, f64::max);
            set(&mut scenario);
            let title = format!("spindle: {title}, {says}");
            studies.push(SpindleStudy { title, scenario, instants_s: instants_s.to_vec(), runs });
        };
        let instants = [0.1, 0.2, 0.4];
        add("3000 rpm", &instants, &|_| ());
        add("3000 rpm, voltage drive", &instants, &cases::voltage_drive);
        add("1500 rpm", &instants, &|scenario| turn(scenario, 1500.0));
        add("6000 rpm", &instants, &|scenario| turn(scenario, 6000.0));
        add("at rest", &instants, &|scenario| {
            turn(scenario, 0.0);
            for radius in ["A.reference.rY", "A.reference.rZ", "B.reference.rY", "B.reference.rZ"] {
                scenario.set("controller", radius, Value::Real(0.0));
            }
        });
    }
    let scenario = built_in("balance");
    let instants_s = vec![scenario.balance_s.unwrap_or(scenario.duration_s)];
    studies.push(SpindleStudy { title: "spindle: correction masses".into(), scenario, instants_s, runs });
    studies
}

/// Sets the speed in rpm.
fn turn(scenario: &mut Scenario, rpm: f64) {
    for (element, name) in [("plant", "omega"), ("controller", "reference.omega")] {
        scenario.set(element, name, Value::Real(rpm * PI / 30.0));
    }
}

impl SpindleStudy {
    /// Looks at the estimates at other instants, in s; correction masses keep theirs.
    pub fn at(&mut self, instants_s: &[f64]) {
        if self.scenario.balance_s.is_none() {
            self.scenario.duration_s = instants_s.iter().copied().fold(0.0, f64::max);
            self.instants_s = instants_s.to_vec();
        }
    }

    /// The run of a seed: noise, unbalances from 30 to 100 g·mm at any angle, first guesses wrong by factors of 1.5 to 2.
    fn case(&self, seed: u64) -> Scenario {
        let (mut scenario, mut draw) = (self.scenario.clone(), Draw::new(seed));
        scenario.set("plant", "sensor.seed", Value::Integer(seed as i32));
        for (bearing, k) in scenario.magnets() {
            let factor = draw.between(1.5, 2.0);
            let factor = if draw.chance(0.5) { factor } else { 1.0 / factor };
            let guess = real(&scenario, "plant", &format!("{bearing}lambda{k}")) * factor;
            for element in ["controller", "estimator"] {
                scenario.set(element, &format!("{bearing}lambda0{k}"), Value::Real(guess));
            }
        }
        for plane in [1, 2] {
            for (name, value) in [("magnitude", draw.between(3e-5, 1e-4)), ("phase", draw.between(-PI, PI))] {
                scenario.set("plant", &format!("unbalance[{plane}].{name}"), Value::Real(value));
            }
        }
        scenario
    }

    /// Runs everything, on all processors, and makes a table with a column for each instant.
    ///
    /// # Errors
    /// Every parameter that a model refuses; why a run ended early.
    pub fn run(&self, first_seed: u64) -> Result<Table, Refused> {
        let found = in_parallel(self.runs, |run| self.trial(first_seed + run as u64));
        let trials = found.into_iter().collect::<Result<Vec<_>, _>>()?;
        let mut rows: Vec<Vec<String>> = Vec::new();
        let mut row = |name: &str, value: &dyn Fn(&[&Found]) -> String| {
            let at =
                |n| trials.iter().map(|trial| &trial.found[n]).filter(|found: &&Found| found.valid).collect::<Vec<_>>();
            let cells = (0..self.instants_s.len()).map(|n| value(&at(n)));
            rows.push([name.to_owned()].into_iter().chain(cells).collect());
        };
        row("valid, runs", &|valid| format!("{}/{}", valid.len(), self.runs));
        row("rms error of the worst magnet, %", &|valid| {
            let magnets = valid.first().map_or(0, |found| found.errors.len());
            let worst = (0..magnets).map(|k| rms(valid.iter().map(|found| found.errors[k]))).fold(0.0, f64::max);
            format!("{:.3}", 100.0 * worst)
        });
        row("rms error/standard deviation", &|valid| {
            format!("{:.2}", rms(valid.iter().flat_map(|found| found.normalised.iter().copied())))
        });
        let of_unbalance = |which: usize| {
            move |valid: &[&Found]| rms(valid.iter().flat_map(move |found| found.unbalance.map(|plane| plane[which])))
        };
        // A rotor at rest shows no unbalance.
        if real(&self.scenario, "plant", "omega") != 0.0 {
            row("rms error of the unbalance, %", &|valid| format!("{:.2}", 100.0 * of_unbalance(0)(valid)));
            row("the same of its angle, rad", &|valid| format!("{:.4}", of_unbalance(1)(valid)));
        }
        let worst = trials.iter().map(|trial| trial.worst).fold(0.0, f64::max);
        let beyond = trials.iter().filter(|trial| trial.worst > CONFIDENT).count();
        let mut note = format!(
            "{} runs, seeds {first_seed} to {}. Over all valid samples the greatest error is {worst:.1} standard deviations; {beyond} runs have \
             one beyond {CONFIDENT}.",
            self.runs,
            first_seed + self.runs as u64 - 1
        );
        let left: Vec<f64> = trials.iter().filter_map(|trial| trial.left).collect();
        if !left.is_empty() {
            note += &format!(
                " Correction masses remove at least 95 % of the synchronous force of the magnets in {} runs; {:.1} % are left at worst.",
                left.iter().filter(|left| **left <= 0.05).count(),
                100.0 * left.iter().copied().fold(0.0, f64::max)
            );
        }
        let instants = self.instants_s.iter().map(|instant_s| format!("{:.0} ms", 1e3 * instant_s));
        let head = [String::new()].into_iter().chain(instants).collect();
        Ok(Table { title: self.title.clone(), note, head, rows })
    }

    fn trial(&self, seed: u64) -> Result<Trial, Refused> {
        let scenario = self.case(seed);
        let wanted = |path: &str| {
            let quantities =
                ["lambdaHat", "lambdaStdTotal", "estimator.unbalance", "estimator.valid", "FY", "FZ", "theta"];
            quantities.iter().any(|quantity| path.contains(quantity))
        };
        let run = simulate::run_for(&scenario, wanted, |_| ())?;
        match &run.error {
            Some(error) => Err(Refused(vec![format!("{}, seed {seed}: {error}", self.title)])),
            None => Trial::new(&scenario, &run, &self.instants_s)
                .ok_or_else(|| Refused(vec!["plant or estimator lacks an output that a study needs".into()])),
        }
    }
}

/// A run.
struct Trial {
    found: Vec<Found>,
    /// The greatest error of a valid sample, in standard deviations.
    worst: f64,
    /// Part of the synchronous force that correction masses leave.
    left: Option<f64>,
}

impl Trial {
    fn new(scenario: &Scenario, run: &Run, instants_s: &[f64]) -> Option<Self> {
        let column = |name: String| run.recording.get(&name);
        let mut magnets = Vec::new();
        for (bearing, k) in scenario.magnets() {
            let of = |name: &str| column(format!("estimator.{bearing}{name}{k}"));
            let truth = real(scenario, "plant", &format!("{bearing}lambda{k}"));
            magnets.push((truth, of("lambdaHat")?, of("lambdaStdTotal")?));
        }
        let valid = column("estimator.valid".into())?;
        let normalised = |at: usize| magnets.iter().map(move |(truth, hat, std)| (hat[at] - truth) / std[at]);
        let found = |instant_s: &f64| {
            let at = run.recording.time_s.partition_point(|time_s| *time_s < instant_s - 1e-9);
            let mut unbalance = [[0.0; 2]; 2];
            for (plane, errors) in unbalance.iter_mut().enumerate() {
                let name = |what: &str| format!("unbalance[{}].{what}", plane + 1);
                let of = |what: &str| {
                    Some((column(format!("estimator.{}", name(what)))?[at], real(scenario, "plant", &name(what))))
                };
                let ((size, true_size), (phase, true_phase)) = (of("magnitude")?, of("phase")?);
                let off = phase - true_phase;
                *errors = [size / true_size - 1.0, off - TAU * (off / TAU).round()];
            }
            Some(Found {
                valid: valid[at] == 1.0,
                errors: magnets.iter().map(|(truth, hat, _)| hat[at] / truth - 1.0).collect(),
                normalised: normalised(at).collect(),
                unbalance,
            })
        };
        let samples = (0..valid.len()).filter(|at| valid[*at] == 1.0);
        let left = scenario.balance_s.and_then(|balance_s| {
            let before = synchronous::forces(&run.recording, balance_s)?;
            let after = synchronous::forces(&run.recording, *run.recording.time_s.last()?)?;
            Some(rms(after.into_iter()) / rms(before.into_iter()))
        });
        Some(Self {
            found: instants_s.iter().map(found).collect::<Option<_>>()?,
            worst: samples.flat_map(normalised).map(f64::abs).fold(0.0, f64::max),
            left,
        })
    }
}

/// Root mean square.
fn rms(values: impl Iterator<Item = f64> + Clone) -> f64 {
    (values.clone().map(|value| value * value).sum::<f64>() / values.count() as f64).sqrt()
}
