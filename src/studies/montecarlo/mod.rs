//! Error, stated standard deviation and Cramér–Rao bound over many runs: of bearings drawn at random, of one bearing with many
//! noise seeds, wrong parameters or a changing λ; and [`hostile`] courses.
//!
//! The Cramér–Rao bound ([`bound`]) is the least standard deviation of an unbiased estimate from the same data. Nothing here
//! depends on the method.

pub mod bound;
pub mod cases;
pub mod figures;
pub mod hostile;
pub mod offline;
pub mod spindle;

use std::f64::consts::TAU;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use crate::estimation::Method;
use crate::machine::Bearing;
use crate::simulation::{Scenario, Stopped, simulate};
use crate::studies::parallel::in_order_shown;
use crate::studies::statistics::{median, rms};
use crate::table::Table;
use crate::variables::Choice;
use cases::{Draw, TOLERANCES};
use figures::{CONFIDENT, Figures, IDENTIFIABLE, Trial, Worst, judge, touched, worst};
use offline::Offline;

/// Changes the study's scenario for a run, given its seed and the number of draws before that were rejected.
pub type Vary = Arc<dyn Fn(&mut Scenario, u64, u64) + Send + Sync>;

/// Whether the estimator knows the noise, and the words for it in titles.
const NOISE_KNOWN: [(bool, &str); 2] = [(true, "noise known"), (false, "noise estimated")];

/// Runs that are judged together.
#[derive(Clone)]
pub struct Study {
    /// One line.
    pub title: String,
    /// The scenario that the runs vary.
    pub scenario: Scenario,
    /// When the estimates are evaluated, in s; the runs end at the last.
    pub instants_s: Vec<f64>,
    /// Number of runs.
    pub runs: usize,
    /// Seed of the first run; the others follow consecutively.
    pub first_seed: u64,
    /// Changes from run to run, besides the seed of the sensors.
    pub vary: Vary,
    /// Whether the runs differ in more than noise, so that averages of relative errors mean little.
    pub mixed: bool,
    /// If set, maximum likelihood over each recording up to each instant is judged, not the estimator in the loop.
    pub offline: Option<Offline>,
}

/// Results of a study.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// At the instants.
    pub figures: Vec<Figures>,
    /// Every run, in the order of the seeds.
    pub trials: Vec<Trial>,
}

impl Outcome {
    /// Runs with a valid sample beyond [`CONFIDENT`] of its standard deviations.
    pub fn beyond(&self) -> usize {
        self.trials.iter().filter(|trial| trial.is_beyond()).count()
    }
}

/// Maximum number of draws of a bearing that touches down.
const ATTEMPTS: u64 = 20;

/// Noise seeds for each drawn bearing.
pub const SEEDS: u64 = 2;

impl Study {
    /// With the estimates evaluated at these instants, in s.
    fn at(self, instants_s: &[f64]) -> Self {
        Self { instants_s: instants_s.to_vec(), ..self }
    }

    /// With this change of the scenario of all runs.
    fn with(mut self, change: impl FnOnce(&mut Scenario)) -> Self {
        change(&mut self.scenario);
        self
    }

    /// With this variation from run to run.
    fn varied(self, vary: impl Fn(&mut Scenario, u64, u64) + Send + Sync + 'static) -> Self {
        Self { vary: Arc::new(vary), ..self }
    }

    /// Makes all runs, on all processors.
    ///
    /// # Errors
    /// All parameters that a model refuses; the reason why a run ended early.
    pub fn run(&self) -> Result<Outcome, Stopped> {
        let trials = in_order_shown("runs", self.runs, &|run| self.trial(self.first_seed + run as u64));
        let trials = trials.into_iter().collect::<Result<Vec<_>, _>>()?;
        let figures = self.instants_s.iter().enumerate().map(|(at, instant_s)| {
            let samples: Vec<_> = trials.iter().filter_map(|trial| trial.samples.get(at)).collect();
            Figures::new(*instant_s, &samples)
        });
        Ok(Outcome { figures: figures.collect(), trials })
    }

    /// The scenario of the run with this seed, in the draw numbered `attempt`.
    pub fn case(&self, seed: u64, attempt: u64) -> Scenario {
        let mut scenario = self.scenario.clone();
        (self.vary)(&mut scenario, seed, attempt);
        scenario.set("plant", "sensor.seed", seed as i32);
        // The unbalance left by correction masses shows after the last instant.
        if scenario.balance_s.is_none() {
            scenario.duration_s = self.instants_s.iter().copied().fold(0.0, f64::max);
        }
        scenario
    }

    /// One run. If the rotor touches down before the controller takes over an estimate, a drawn bearing is drawn again.
    fn trial(&self, seed: u64) -> Result<Trial, Stopped> {
        drawn_again(seed, |attempt| {
            let scenario = self.case(seed, attempt);
            let run = simulate::run_for(&scenario, figures::wanted)?;
            if let Some(error) = run.error {
                return Err(Stopped::Ended(format!("{}, seed {seed}: the run ended early: {error}", self.title)));
            }
            let trial = match &self.offline {
                None => judge(&scenario, &run.recording, &self.instants_s, touched(&run.recording)),
                Some(bench) => bench.judge(&scenario, &run.recording, &self.instants_s, seed),
            };
            // A bearing that is not drawn would touch down again.
            Ok((trial, if self.mixed { scenario.number("controller", "update.time") } else { f64::NEG_INFINITY }))
        })
    }
}

/// Draws the bearing of the run with this seed again if the rotor touches down too early to test the estimator; of a later contact, the run until then counts.
/// `run` makes the run of a draw, and returns the time in s until which contact is too early.
fn drawn_again(seed: u64, run: impl Fn(u64) -> Result<(Trial, f64), Stopped>) -> Result<Trial, Stopped> {
    let mut attempt = 0;
    loop {
        let (trial, early_s) = run(attempt)?;
        attempt += 1;
        if trial.touched_s.is_none_or(|touched_s| touched_s > early_s) || attempt == ATTEMPTS {
            return Ok(Trial { seed, ..trial });
        }
    }
}

/// Sensor noise of the studies: position in m, current in A.
pub const NOISE: [f64; 2] = [1e-7, 1e-2];

/// The same with ten times the position noise.
const TENFOLD: [f64; 2] = [10.0 * NOISE[0], NOISE[1]];

/// When the estimates are evaluated, in s.
pub const INSTANTS_S: [f64; 5] = [0.035, 0.1, 0.2, 0.4, 1.0];

/// Standard deviations of the sensor noise, m and A: as stated, or that of the scenario, or [`NOISE`] where it has none.
pub fn noise(scenario: &Scenario, [position, current]: [Option<f64>; 2]) -> [f64; 2] {
    let own = |name| Some(scenario.number("plant", name)).filter(|own| *own > 0.0);
    [
        position.or_else(|| own("sensor.positionNoise")).unwrap_or(NOISE[0]),
        current.or_else(|| own("sensor.currentNoise")).unwrap_or(NOISE[1]),
    ]
}

/// A study of one scenario with the default method over seeds of this noise, which the estimator knows or estimates.
pub fn study(title: &str, base: &Scenario, noise: [f64; 2], noise_known: bool, runs: usize) -> Study {
    let mut scenario = base.clone();
    scenario.remove_compared();
    scenario.set("estimator", "method", Method::default().number());
    cases::noise(&mut scenario, noise, noise_known);
    Study {
        title: title.into(),
        scenario,
        instants_s: vec![0.035, 0.1],
        runs,
        first_seed: 1,
        vary: Arc::new(|_, _, _| ()),
        mixed: false,
        offline: None,
    }
}

/// A study of drawn bearings, [`SEEDS`] runs of each; see [`cases::drawn`].
pub fn drawn(title: &str, noise_known: bool, bearings: usize) -> Study {
    let study = study(title, &nominal(), NOISE, noise_known, bearings * SEEDS as usize).at(&INSTANTS_S);
    // Seeds of different draws are far apart.
    let vary = move |scenario: &mut Scenario, seed: u64, attempt: u64| {
        *scenario = cases::drawn(scenario, seed / SEEDS + (attempt << 32), noise_known);
    };
    Study { mixed: true, ..study.varied(vary) }
}

/// The paper's bearing with an unbalance of 20 N and a load of (10, −20) N.
///
/// # Panics
/// Never: the scenario comes with the program.
pub fn nominal() -> Scenario {
    built_in("unbalanced")
}

fn built_in(name: &str) -> Scenario {
    Scenario::open(Path::new(name)).expect("a scenario that comes with the program")
}

/// Sets the speed; a rotor that starts on its reference trajectory still does.
pub fn at_speed(scenario: &mut Scenario, rpm: f64) {
    let (omega, before) = (rpm * TAU / 60.0, scenario.number("plant", "omega"));
    for rate in scenario.machine.at_start(|coordinate| coordinate.rate) {
        let value = scenario.number("plant", &rate);
        if value != 0.0 && before != 0.0 {
            scenario.set("plant", &rate, value * omega / before);
        }
    }
    cases::turning_at(scenario, omega);
}

/// Pairs over the range of noise that an estimator must be able to estimate: position in µm, current in mA.
const POSITION_UM: [f64; 14] = [0.02, 0.02, 0.02, 0.05, 0.1, 0.1, 0.1, 0.3, 1.0, 1.0, 1.0, 3.0, 5.0, 5.0];
const CURRENT_MA: [f64; 14] = [1.0, 10.0, 100.0, 3.0, 1.0, 10.0, 100.0, 30.0, 1.0, 10.0, 100.0, 30.0, 1.0, 100.0];

/// Instant of a step of λ, in s, and its relative size.
const STEP: (f64, f64) = (0.6, 0.05);

/// Length of the runs for false restarts, in s, and their number.
const LONG: (f64, usize) = (50.0, 20);

/// All studies of the command without arguments, each with this number of runs, or of drawn bearings.
pub fn studies(runs: usize) -> Vec<Study> {
    let nominal = nominal();
    let of = |title: &str, noise: [f64; 2], noise_known: bool| study(title, &nominal, noise, noise_known, runs);
    let mut studies = Vec::new();
    for (noise_known, words) in NOISE_KNOWN {
        studies.push(drawn(&format!("Drawn bearings, {words}"), noise_known, runs));
        let mut add = |title: &str, instants_s: &[f64], noise: [f64; 2], set: &dyn Fn(&mut Scenario)| {
            studies.push(of(&format!("{title}, {words}"), noise, noise_known).at(instants_s).with(set));
        };
        add("Unbalance 20 N, load (10, −20) N, 0.1 µm and 10 mA", &INSTANTS_S, NOISE, &|_| ());
        add("The same with voltage drive", &INSTANTS_S, NOISE, &cases::voltage_drive);
        for poles in [500.0, 1000.0, 2000.0] {
            let title = format!("1 µm and 10 mA, tracking poles at {poles} rad/s");
            add(&title, &INSTANTS_S, TENFOLD, &|scenario| {
                scenario.set("controller", "bandwidth.tracking", poles);
            });
        }
        add("1000 rpm on the paper's path", &[0.2, 0.4, 0.8, 1.6], NOISE, &|scenario| cases::turn(scenario, 1000.0));
        add("Run-up from 500 to 6000 rpm in 1 s and back", &[0.1, 0.2, 0.4, 1.0, 2.0], NOISE, &|scenario| {
            cases::speed(scenario, &[0.0, 1.0, 2.0], &[500.0, 6000.0, 500.0]);
        });
    }
    studies.push(study("Without noise", &nominal, [0.0; 2], false, 1).at(&INSTANTS_S));

    let title = "14 pairs of noise from 20 nm and 1 mA to 5 µm and 0.1 A, estimated";
    let pairs = study(title, &nominal, NOISE, false, runs.max(14)).at(&INSTANTS_S).varied(|scenario, seed, _| {
        let pair = seed as usize % POSITION_UM.len();
        cases::noise(scenario, [POSITION_UM[pair] * 1e-6, CURRENT_MA[pair] * 1e-3], false);
    });
    studies.push(Study { mixed: true, ..pairs });

    let each = TOLERANCES.iter().map(std::slice::from_ref);
    for tolerances in each.chain([TOLERANCES.as_slice()]) {
        let name = if let [one] = tolerances { one.name } else { "all at once" };
        let study = of(&format!("Tolerance {name}, noise known"), NOISE, true).at(&[0.1, 0.4]);
        studies.push(study.varied(move |scenario, seed, _| {
            let mut draw = Draw::new(seed);
            tolerances.iter().for_each(|tolerance| tolerance.draw(scenario, &mut draw));
        }));
    }
    for (title, fault) in cases::FAULTS {
        let study = of(&format!("One thing wrong: {title}"), NOISE, false).at(&INSTANTS_S[1..]);
        studies.push(study.with(fault));
    }
    for (noise_known, words) in NOISE_KNOWN {
        let title = format!("Step of λ by {} % at {} s, {words}", 100.0 * STEP.1, STEP.0);
        let step = of(&title, NOISE, noise_known).at(&[0.59, 0.64, 0.7, 1.0]);
        studies.push(step.varied(|scenario, seed, _| cases::step_of_lambda(scenario, seed, STEP.1, STEP.0)));
        let (length_s, count) = LONG;
        let title = format!("False restarts: {count} runs of {length_s} s, {words}");
        studies.push(study(&title, &nominal, NOISE, noise_known, count.min(runs)).at(&[1.0, 10.0, length_s]));
    }
    studies.extend(offline::studies(runs));
    studies.extend(spindle::studies(runs));
    studies
}

/// The bearings by name, each with its magnets in use: their names, and their indices among all magnets in use.
pub(crate) fn of_bearings(scenario: &Scenario) -> Vec<(&'static str, Vec<(String, usize)>)> {
    let used = scenario.used();
    let of = |(bearing, magnets): (&'static Bearing, Range<usize>)| {
        let own = (0..used.len()).filter(|at| magnets.contains(&used[*at]));
        (bearing.name(), own.map(|at| (format!("λ{}", used[at] + 1 - magnets.start), at)).collect())
    };
    scenario.machine.magnets_of_bearings().into_iter().map(of).collect()
}

/// A number with this many decimals, or a dash if it is not finite.
pub(super) fn or_dash(value: f64, digits: usize) -> String {
    if value.is_finite() { format!("{value:.digits$}") } else { "–".to_owned() }
}

/// The figures as a table, a column for each instant.
pub fn table(study: &Study, outcome: &Outcome) -> Table {
    let mut rows: Vec<Vec<String>> = Vec::new();
    let mut row = |name: &str, value: &dyn Fn(&Figures) -> String| {
        rows.push(std::iter::once(name.to_owned()).chain(outcome.figures.iter().map(value)).collect());
    };
    // Without noise, errors are too small for three decimals.
    let small = |value: f64| value != 0.0 && value.abs() < 1e-5;
    let percent = |values: &mut dyn Iterator<Item = f64>| {
        let one = |value: f64| if small(value) { format!("{:.0e}", 100.0 * value) } else { or_dash(100.0 * value, 3) };
        values.map(one).collect::<Vec<_>>().join(" ")
    };
    row("valid, runs", &|figures| format!("{}/{}", figures.valid, figures.runs));
    row(&format!("valid where the bound is below {} %", 100.0 * IDENTIFIABLE), &|figures| {
        format!("{}/{}", figures.identified, figures.identifiable)
    });
    row("rms error/bound", &|figures| or_dash(rms(&figures.over_bound), 2));
    row("rms error/standard deviation (noise)", &|figures| or_dash(rms(&figures.normalised), 2));
    row("rms error/standard deviation (total)", &|figures| or_dash(rms(&figures.over_total), 2));
    row("greatest error/standard deviation", &|figures| or_dash(figures.worst, 1));
    if !study.mixed {
        let bearings = of_bearings(&study.scenario);
        let mut rows_of = |what: &str, of: &dyn Fn(&Figures) -> &[f64]| {
            for (bearing, magnets) in &bearings {
                let names: Vec<_> =
                    [*bearing].into_iter().chain(magnets.iter().map(|(name, _)| name.as_str())).collect();
                row(&format!("{what} of {}, %", names.join(" ").trim_start()), &|figures| {
                    percent(&mut magnets.iter().filter_map(|(_, at)| of(figures).get(*at)).copied())
                });
            }
        };
        rows_of("rms error", &|figures| &figures.rms);
        rows_of("bias", &|figures| &figures.bias);
        rows_of("standard deviation stated (noise)", &|figures| &figures.stated);
        rows_of("Cramér–Rao bound", &|figures| &figures.bound);
        if bearings.len() > 1 {
            row("rms error of the worst magnet, %", &|figures| {
                percent(&mut figures.rms.iter().copied().reduce(f64::max).into_iter())
            });
        }
        // A rotor at rest shows no unbalance.
        if study.scenario.machine.planes > 0 && study.scenario.number("plant", "omega") != 0.0 {
            row("rms error of U, %; of φ, rad", &|figures| {
                let [magnitude, phase] = figures.unbalance;
                format!("{} {}", or_dash(100.0 * magnitude, 3), or_dash(phase, 4))
            });
        }
    }
    if outcome.figures.iter().any(|figures| !figures.verdicts.is_empty()) {
        row("why not valid", &|figures| {
            let all: Vec<_> = figures.verdicts.iter().map(|(verdict, count)| format!("{verdict} {count}")).collect();
            if all.is_empty() { "–".into() } else { all.join(", ") }
        });
    }
    let (seed, worst) = worst(&outcome.trials);
    let mut note = match (study.runs, study.first_seed) {
        (1, seed) => format!("1 run, seed {seed}. "),
        (runs, first) => format!("{runs} runs, seeds {first} to {}. ", first + runs as u64 - 1),
    };
    let Worst { ratio, time_s, error, std } = worst;
    let ([error, std], beyond) = ([error, std].map(|of| 100.0 * of), outcome.beyond());
    note += &match ratio {
        0.0 => "No sample is valid.".into(),
        _ => format!(
            "Over all valid samples the greatest error is {ratio:.1} standard deviations (seed {seed}, {time_s:.4} s: {error:.2} % by \
             {std:.2} %); {beyond} runs have one beyond {CONFIDENT}."
        ),
    };
    if study.offline.is_none() {
        let lost = outcome.trials.iter().map(|trial| trial.lost).sum::<usize>();
        note += &format!(" Valid estimates became invalid {lost} times.");
    }
    let left: Vec<f64> = outcome.trials.iter().filter_map(|trial| trial.left).collect();
    if !left.is_empty() {
        note += &format!(
            " Correction masses remove at least 95 % of the synchronous force of the magnets in {} runs; {:.1} % are left at worst.",
            left.iter().filter(|left| **left <= 0.05).count(),
            100.0 * left.iter().copied().fold(0.0, f64::max)
        );
    }
    let touched = outcome.trials.iter().filter(|trial| trial.touched_s.is_some()).count();
    if touched > 0 {
        note += &format!(" The rotor touched down in {touched} runs.");
    }
    let noticed: Vec<f64> = outcome.trials.iter().filter_map(|trial| trial.noticed_s).collect();
    if let Some(last) = noticed.iter().copied().reduce(f64::max) {
        let [median_ms, last_ms] = [median(&noticed), last].map(|of_s| 1e3 * of_s);
        note += &format!(
            " The change was noticed in {} runs, after {median_ms:.1} ms (median), {last_ms:.1} ms at most; the greatest error counts \
             from two revolutions after it.",
            noticed.len()
        );
    }
    let instants = study.instants_s.iter().map(|instant_s| format!("{:.0} ms", instant_s * 1e3));
    Table::new(&study.title, note, [String::new()].into_iter().chain(instants), rows)
}
