//! Studies of maximum likelihood over whole recordings: drawn bearings, and benches that differ from their data sheets.

use std::f64::consts::TAU;
use std::sync::LazyLock;

use super::bound;
use super::cases::{self, Draw};
use super::figures::{Sample, Trial, Worst, off, touched};
use super::{NOISE, NOISE_KNOWN, SEEDS, Study, TENFOLD, drawn, nominal, study};
use crate::machine::PLANAR;
use crate::simulation::{Recording, Scenario};
use crate::studies::identify::likelihood::{self, BenchParameter, Estimate, Knowledge, Unbalance};
use crate::studies::identify::{self, Question, Rotation, Samples, Stated};

/// Deviations of a bench from its data sheet, and the tolerances stated to maximum likelihood. Parameters are indices, values
/// have their units.
#[derive(Clone, Debug, Default)]
pub struct Offline {
    /// Stated tolerances. Every run draws its errors from them, unless they are `fixed`.
    pub tolerances: Vec<(usize, f64)>,
    /// Errors that all runs have in common.
    pub fixed: Option<Vec<f64>>,
}

/// Makes the errors of a bench independent of the bearing and the noise drawn with the same seed.
const BENCH_SEED: u64 = 0xbe5c_0000_0000;

impl Offline {
    /// The errors of the run with this seed.
    fn errors(&self, seed: u64) -> Vec<f64> {
        if let Some(errors) = &self.fixed {
            return errors.clone();
        }
        let mut draw = Draw::new(seed ^ BENCH_SEED);
        let mut errors = vec![0.0; PARAMETERS.len()];
        for (at, std) in &self.tolerances {
            errors[*at] = std * draw.normal();
        }
        errors
    }

    /// Identifies from the recording up to each instant and compares with the truth. There is no bound if bench parameters are estimated too.
    pub fn judge(&self, scenario: &Scenario, recording: &Recording, instants_s: &[f64], seed: u64) -> Trial {
        let whole = misread(recording, scenario.step_s, &self.errors(seed));
        let truth = scenario.truth();
        let unbalance = ["unbalance.magnitude", "unbalance.phase"].map(|name| scenario.number("plant", name));
        let touched = touched(recording);
        let mut stated = Stated::of(&PLANAR, scenario.estimator());
        self.tolerances.iter().for_each(|(at, std)| stated.know(*at, Knowledge::Tolerance(*std)));
        let bounds = self.tolerances.is_empty().then(|| bound::bound(scenario, recording, instants_s)).flatten();
        let mut trial = Trial { touched_s: touched.map(|row| recording.time_s[row]), ..Trial::default() };
        for (at, instant_s) in instants_s.iter().enumerate() {
            let rows = (instant_s / scenario.step_s).round() as usize + 1;
            if touched.is_some_and(|touched| touched < rows) {
                break;
            }
            let question =
                Question { stated: stated.clone(), holds: None, equally_likely: Vec::new(), slow_force: None };
            let answer = identify::answer(&[beginning(&whole, rows)], question);
            let found = answer.found.as_ref();
            let relative = |of: fn(&Estimate) -> f64| -> Vec<f64> {
                (0..3).map(|k| found.map_or(f64::NAN, |found| of(&found.lambda[k]) / truth[k])).collect()
            };
            let sample = Sample {
                valid: answer.valid,
                error: relative(|lambda| lambda.value).into_iter().map(|ratio| ratio - 1.0).collect(),
                std: relative(|lambda| lambda.noise_std),
                total: relative(|lambda| lambda.total_std),
                bound: bounds.as_ref().map_or_else(|| vec![f64::NAN; 3], |bounds| bounds[at].clone()),
                unbalance: found.map_or([f64::NAN; 2], |found| {
                    let Unbalance { magnitude, phase } = &found.unbalance[0];
                    off([magnitude.value, phase.value], unbalance)
                }),
                verdict: (!answer.valid).then(|| summary(&answer.verdict)),
            };
            let all = sample.error.iter().zip(&sample.total).filter(|_| answer.valid);
            trial.worst = all.map(|(error, std)| Worst::of(*instant_s, *error, *std)).fold(trial.worst, Worst::max);
            trial.samples.push(sample);
        }
        trial
    }
}

/// The bench parameters of the paper's bearing.
static PARAMETERS: LazyLock<Vec<BenchParameter>> =
    LazyLock::new(|| Stated::of(&PLANAR, nominal().estimator()).parameters());

/// The error of a bench parameter.
fn error_of(errors: &[f64], name: &str) -> f64 {
    likelihood::by_name(&PARAMETERS, name).map_or(0.0, |at| errors[at])
}

/// Makes plant and sensors differ from the parameters of controller and estimator. The plant models no rotation and run-out of sensors;
/// [`misread`] adds them.
fn differ(scenario: &mut Scenario, errors: &[f64]) {
    let of = |name: &str| error_of(errors, name);
    let base = nominal();
    let turning = ["theta0", "omega"].map(|name| base.number("plant", name));
    for (name, value) in Stated::of(&PLANAR, base.estimator()).with(turning, of) {
        scenario.set("plant", &name, value);
    }
    // A delay cannot be negative.
    scenario.set("plant", "sensor.delay", of("delay").abs());
}

/// The recording that the bench would make, including rotation, skew and run-out of its sensors.
fn misread(recording: &Recording, step_s: f64, errors: &[f64]) -> Samples {
    let column = |name: &str| recording[format!("plant.{name}")].to_vec();
    let of = |name: &str| error_of(errors, name);
    let mut samples = Samples {
        step_s,
        position_m: ["Ym", "Zm"].map(column).to_vec(),
        current_a: ["im[1]", "im[2]", "im[3]"].map(column).to_vec(),
        theta_rad: column("theta"),
        omega_rad_s: column("omegam"),
        rotation: Rotation::Both,
        ..Samples::default()
    };
    let (common, half) = (of("sensor.gain"), of("sensor.gainDifference"));
    let gain = [1.0 + common + half, 1.0 + common - half];
    let offset = [of("sensor.offset[y]"), of("sensor.offset[z]")];
    let (rotation, skew) = (of("sensor.rotation"), of("sensor.skew"));
    let [(sin_y, cos_y), (sin_z, cos_z)] = [rotation - skew, rotation + skew].map(libm::sincos);
    let once =
        ["forward.cos", "forward.sin", "backward.cos", "backward.sin"].map(|part| of(&format!("runout1.{part}")));
    let twice = ["y.cos", "y.sin", "z.cos", "z.sin"].map(|part| of(&format!("runout2.{part}")));
    if [rotation, skew] == [0.0; 2] && once.iter().chain(&twice).all(|part| *part == 0.0) {
        return samples;
    }
    for (row, theta) in samples.theta_rad.iter().enumerate() {
        let ((s, c), (s2, c2)) = (libm::sincos(*theta), libm::sincos(2.0 * theta));
        let read = [0, 1].map(|axis| (samples.position_m[axis][row] - offset[axis]) / gain[axis]);
        let y = read[0] + (once[0] + once[2]) * c + (once[3] - once[1]) * s + twice[0] * c2 + twice[1] * s2;
        let z = read[1] + (once[0] - once[2]) * s + (once[1] + once[3]) * c + twice[2] * c2 + twice[3] * s2;
        samples.position_m[0][row] = gain[0] * (cos_y * y - sin_y * z) + offset[0];
        samples.position_m[1][row] = gain[1] * (sin_z * y + cos_z * z) + offset[1];
    }
    samples
}

/// The first `rows` rows of a recording.
fn beginning(samples: &Samples, rows: usize) -> Samples {
    let mut samples = samples.clone();
    let columns = samples.position_m.iter_mut().chain(&mut samples.current_a);
    columns.chain([&mut samples.theta_rad, &mut samples.omega_rad_s]).for_each(|column| column.truncate(rows));
    samples
}

/// The first words of a verdict, without numbers.
fn summary(verdict: &str) -> String {
    let words = verdict.trim_start_matches("Not valid: ").split_whitespace();
    words.filter(|word| !word.contains(|c: char| c.is_ascii_digit())).take(5).collect::<Vec<_>>().join(" ")
}

/// When the controller takes over an estimate, in s: in the middle of recordings of 0.1, 1 and 5 s, or never.
const UPDATES_S: [f64; 4] = [0.05, 0.5, 2.5, 1e3];

/// Sensor noise, and the position noise in words.
const NOISES: [(&str, [f64; 2]); 2] = [("0.1 µm", NOISE), ("1 µm", TENFOLD)];

/// Lengths of the recordings, in s.
const LENGTHS_S: [f64; 3] = [0.1, 1.0, 5.0];

/// Bench errors, of one or several parameters at a time: names and tolerances as for `--tolerance`.
const ERRORS: [&[(&str, f64)]; 14] = [
    &[("m", 0.01)],
    &[("s", 0.02)],
    &[("gap.iron", 1e-5)],
    &[("alpha", 2.0 * TAU / 360.0)],
    &[("sensor.gain", 0.01)],
    &[("sensor.gainDifference", 0.01)],
    &[("sensor.offset", 1e-5)],
    &[("sensor.rotation", TAU / 360.0)],
    &[("sensor.skew", TAU / 720.0)],
    &[("delay", 2e-5)],
    &[("current.gain", 0.01)],
    &[("current.offset", 0.02)],
    &[("force.backward", 1.0)],
    &[("runout1", 1e-6), ("runout2", 1e-6)],
];

/// A bench with many errors at once: 1° of rotation, offsets of 10 and −5 µm, gains of ±0.5 %, 20 µm of iron, the phase lag of a sensor of
/// 10 kHz, and 2 N in y and 4.7 N in z from the other bearing of the shaft: 1.35 N rotate backward, the remainder acts like an unbalance.
const MIXED: [(&str, f64, f64); 8] = [
    ("sensor.rotation", TAU / 360.0, 0.02),
    ("sensor.offset[y]", 1e-5, 1e-5),
    ("sensor.offset[z]", -5e-6, 1e-5),
    ("sensor.gainDifference", 5e-3, 0.01),
    ("gap.iron", 2e-5, 2e-5),
    ("delay", 1.6e-5, 3e-5),
    ("force.backward.cos", -1.35, 5.0),
    ("force.backward.sin", 0.0, 5.0),
];

/// A study of the nominal bearing on a bench with errors, noise estimated.
fn bench(title: &str, offline: Offline, noise: [f64; 2], instants_s: &[f64], runs: usize) -> Study {
    let study = study(&format!("identify: {title}"), &nominal(), noise, false, runs).at(instants_s);
    let errors = offline.clone();
    let study = study.varied(move |scenario, seed, _| differ(scenario, &errors.errors(seed)));
    Study { offline: Some(offline), ..study }
}

/// The studies of maximum likelihood, each with this number of runs, or of drawn bearings.
pub fn studies(runs: usize) -> Vec<Study> {
    let mut studies = Vec::new();
    for (noise_known, words) in NOISE_KNOWN {
        let mut add = |study: Study| studies.push(Study { offline: Some(Offline::default()), ..study });
        let bearings = drawn(&format!("identify: drawn bearings, {words}"), noise_known, runs).at(&LENGTHS_S);
        let vary = bearings.vary.clone();
        add(bearings.varied(move |scenario, seed, attempt| {
            vary(scenario, seed, attempt);
            let update_s = UPDATES_S[(seed / SEEDS) as usize % UPDATES_S.len()];
            scenario.set("controller", "update.time", update_s);
        }));
        for (title, noise) in NOISES {
            let title = format!("identify: nominal bearing, {title} and 10 mA, {words}");
            add(study(&title, &nominal(), noise, noise_known, runs).at(&LENGTHS_S));
        }
        let title = format!("identify: 1000 rpm on the paper's path, {words}");
        let slow = study(&title, &nominal(), NOISE, noise_known, runs);
        add(slow.at(&[0.5, 1.0, 2.0]).with(|scenario| cases::turn(scenario, 1000.0)));
    }
    for errors in ERRORS {
        let names: Vec<&str> = errors.iter().map(|(name, _)| *name).collect();
        let indices = |name| identify::named(&PARAMETERS, name).unwrap_or_default().into_iter();
        let tolerances = errors.iter().flat_map(|(name, std)| indices(name).map(|at| (at, *std))).collect();
        let offline = Offline { tolerances, fixed: None };
        studies.push(bench(&format!("bench error {}", names.join(" and ")), offline, NOISE, &[1.0], runs));
    }
    let (mut errors, mut tolerances) = (vec![0.0; PARAMETERS.len()], Vec::new());
    for (name, error, std) in MIXED {
        let at = likelihood::by_name(&PARAMETERS, name).expect("a parameter of the bench");
        errors[at] = error;
        tolerances.push((at, std));
    }
    studies.push(bench("mixed bench", Offline { tolerances, fixed: Some(errors) }, NOISE, &[1.0], runs));
    let tolerances: Vec<_> = PARAMETERS.iter().map(|parameter| parameter.typical).enumerate().collect();
    let offline = Offline { tolerances, fixed: None };
    for (words, noise) in NOISES {
        studies.push(bench(&format!("all bench errors at once, {words}"), offline.clone(), noise, &[0.5, 2.0], runs));
    }
    studies
}
