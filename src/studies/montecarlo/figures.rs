//! Results of one run of a study, and figures over many runs.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use super::bound;
use crate::estimation::Verdict;
use crate::simulation::synchronous::forces;
use crate::simulation::{Profile, Recording, Scenario};
use crate::studies::statistics::{mean, rms};
use crate::variables::Choice;
use fmu_export::variable::Value;

/// Largest permitted error of a valid estimate, in stated standard deviations.
pub const CONFIDENT: f64 = 5.0;

/// Start of the time, in s, over which the fraction with a valid estimate is counted.
pub const VALID_FROM_S: f64 = 0.3;

/// Revolutions allowed for the detection of a step of λ.
const DETECTION_REVOLUTIONS: f64 = 2.0;

/// Runs whose bound is below this for every λ should have a valid estimate.
pub const IDENTIFIABLE: f64 = 0.04;

/// Results of one run at one instant; errors and standard deviations are relative to the true λ.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// Whether the estimate was valid.
    pub valid: bool,
    /// Error of each λ.
    pub error: Vec<f64>,
    /// Stated standard deviation, from noise alone.
    pub std: Vec<f64>,
    /// Stated standard deviation, with all tolerances.
    pub total: Vec<f64>,
    /// Cramér–Rao bound; not finite without noise.
    pub bound: Vec<f64>,
    /// Relative error of the unbalance magnitude and error of its phase in rad, rms over all planes; 0 without unbalance.
    pub unbalance: [f64; 2],
    /// Reason why the estimate was not valid, if there is such an output.
    pub verdict: Option<String>,
}

/// The valid sample with the largest error in stated standard deviations.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Worst {
    /// |error|/standard deviation, tolerances included.
    pub ratio: f64,
    /// Time, in s.
    pub time_s: f64,
    /// Relative error.
    pub error: f64,
    /// Relative standard deviation.
    pub std: f64,
}

impl Worst {
    /// An estimate with this relative error and standard deviation.
    pub(super) fn of(time_s: f64, error: f64, std: f64) -> Self {
        // Zero error agrees with any standard deviation, even with 0.
        let ratio = if error == 0.0 { 0.0 } else { (error / std).abs() };
        Self { ratio: if ratio.is_nan() { f64::INFINITY } else { ratio }, time_s, error, std }
    }

    /// The worse of two.
    pub(super) fn max(self, other: Self) -> Self {
        if other.ratio > self.ratio { other } else { self }
    }
}

/// Results of one run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trial {
    /// The seed, to repeat the run.
    pub seed: u64,
    /// At the instants of the study.
    pub samples: Vec<Sample>,
    /// The worst of all samples.
    pub worst: Worst,
    /// How often a valid estimate became invalid.
    pub lost: usize,
    /// Fraction of the time from [`VALID_FROM_S`] on with a valid estimate.
    pub valid: f64,
    /// Largest number of changes of `valid` within one second.
    pub changes: usize,
    /// Time in s from the step of λ to the first sample that is invalid, or valid and within 4 standard deviations of the new λ.
    pub noticed_s: Option<f64>,
    /// When the rotor touched down or left the gap, in s; nothing later counts.
    pub touched_s: Option<f64>,
    /// Fraction of the synchronous force of the magnets left by correction masses, if any.
    pub left: Option<f64>,
}

impl Trial {
    /// Whether a valid estimate was wrong by more than [`CONFIDENT`] standard deviations.
    pub fn is_beyond(&self) -> bool {
        self.worst.ratio > CONFIDENT
    }
}

/// The seed of the run with the worst valid sample, and that sample.
pub fn worst(trials: &[Trial]) -> (u64, Worst) {
    let worst = trials.iter().max_by(|one, other| one.worst.ratio.total_cmp(&other.worst.ratio));
    worst.map_or((0, Worst::default()), |trial| (trial.seed, trial.worst))
}

/// The estimate of one λ, row by row, relative to the true one.
struct Estimate {
    /// Its error.
    error: Vec<f64>,
    /// Stated standard deviation, from noise alone; `total` if it is not recorded.
    std: Vec<f64>,
    /// Stated standard deviation, with all tolerances.
    total: Vec<f64>,
}

/// The profile of a true λ by its name, if it changes.
fn profile_of<'a>(scenario: &'a Scenario, lambda: &str) -> Option<&'a Profile> {
    let place = scenario.settable(&format!("plant.{lambda}")).ok()?;
    scenario.profiles.iter().find(|profile| profile.targets.contains(&place))
}

/// The estimates for the magnets in use.
fn estimates(scenario: &Scenario, recording: &Recording) -> Vec<Estimate> {
    let names = ["lambda", "lambdaHat", "lambdaStd", "lambdaStdTotal"].map(|name| scenario.machine.of_magnets(name));
    let of_magnet = |k: usize| {
        let [truth, hat, std, total] = names.each_ref().map(|names| names[k].as_str());
        let (start, profile) = (scenario.number("plant", truth), profile_of(scenario, truth));
        // The value during the interval that ends at the row.
        let at = |time_s: &f64| profile.and_then(|profile| profile.at(time_s - 0.5 * scenario.step_s));
        let truth: Vec<f64> = recording.time_s.iter().map(|time_s| at(time_s).map_or(start, Value::as_f64)).collect();
        let path = |name: &str| format!("estimator.{name}");
        let relative = |of: &[f64]| of.iter().zip(&truth).map(|(value, truth)| value / truth).collect::<Vec<_>>();
        let total = &recording[path(total)];
        Estimate {
            error: relative(&recording[path(hat)]).into_iter().map(|hat| hat - 1.0).collect(),
            std: relative(recording.get(&path(std)).unwrap_or(total)),
            total: relative(total),
        }
    };
    scenario.used().into_iter().map(of_magnet).collect()
}

/// Whether a signal is needed to judge a run.
pub fn wanted(path: &str) -> bool {
    let Some(name) = path.strip_prefix("plant.") else { return path.starts_with("estimator.") };
    ["X", "Y", "Z", "Ym", "Zm", "beta", "gamma", "theta", "omegam"].contains(&name)
        || ["F[", "gap[", "im["].iter().any(|part| name.contains(part))
        || ["FY", "FZ"].iter().any(|end| name.ends_with(end))
        || is_contact(path)
}

/// Whether a signal states contact with a backup bearing.
pub fn is_contact(path: &str) -> bool {
    path.starts_with("plant.") && path.ends_with("contact")
}

/// The first row at which the rotor touches a backup bearing.
pub fn touched(recording: &Recording) -> Option<usize> {
    let contacts = recording.columns.iter().filter(|column| is_contact(&column.name));
    contacts.filter_map(|column| column.values.iter().position(|contact| *contact == 1.0)).min()
}

/// Judges a run at instants in s, up to the row at which the rotor touches down, if it does. There is no bound without noise, or if a λ steps.
pub fn judge(scenario: &Scenario, recording: &Recording, at_s: &[f64], touched: Option<usize>) -> Trial {
    let machine = scenario.machine;
    let get = |name: &str| recording.get(&format!("estimator.{name}"));
    let (used, estimates, valid) = (scenario.used(), estimates(scenario, recording), &recording["estimator.valid"]);
    let lambda = machine.of_magnets("lambda");
    let jump = used.iter().filter_map(|k| profile_of(scenario, &lambda[*k])).find(|profile| profile.hold);
    let jump_s = jump.map(|profile| profile.time_s[0]);
    let detection_s = DETECTION_REVOLUTIONS * TAU / scenario.number("plant", "omega").abs().max(1.0);
    let time_s = &recording.time_s;
    let rows = touched.unwrap_or(time_s.len());
    let counted = (0..rows).filter(|row| time_s[*row] >= VALID_FROM_S);
    let changes: Vec<f64> = (1..rows).filter(|row| valid[*row] != valid[row - 1]).map(|row| time_s[row]).collect();
    let within_a_second = |(n, begin_s): (usize, &f64)| changes.partition_point(|at_s| *at_s < begin_s + 1.0) - n;
    let mut trial = Trial {
        valid: mean(counted.map(|row| valid[row])),
        changes: changes.iter().enumerate().map(within_a_second).max().unwrap_or(0),
        touched_s: touched.map(|row| time_s[row]),
        left: scenario.balance_s.and_then(|balance_s| {
            let [before, after] = [balance_s, *time_s.last()?].map(|end_s| forces(recording, end_s));
            let sum = |forces: [f64; 4]| forces.iter().map(|force| force * force).sum::<f64>();
            Some((sum(after?) / sum(before?)).sqrt())
        }),
        ..Trial::default()
    };
    for row in 0..rows {
        let after_s = jump_s.map(|jump_s| time_s[row] - jump_s).filter(|after_s| *after_s > 0.5 * scenario.step_s);
        trial.lost += usize::from(row > 0 && valid[row - 1] == 1.0 && valid[row] != 1.0);
        let all = estimates.iter().filter(|_| valid[row] == 1.0);
        let all = all.map(|estimate| Worst::of(time_s[row], estimate.error[row], estimate.total[row]));
        let worst = all.fold(Worst::default(), Worst::max);
        if worst.ratio < 4.0 {
            trial.noticed_s = trial.noticed_s.or(after_s);
        }
        if after_s.is_none_or(|after_s| after_s > detection_s) {
            trial.worst = trial.worst.max(worst);
        }
    }
    let bounds = jump_s.is_none().then(|| bound::bound(scenario, recording, at_s)).flatten();
    let planes: Vec<_> = machine.of_planes("magnitude").into_iter().zip(machine.of_planes("phase")).collect();
    for (at, instant_s) in at_s.iter().enumerate() {
        let Some(row) = (0..rows).find(|row| time_s[*row] >= instant_s - 0.5 * scenario.step_s) else { break };
        let of = |part: fn(&Estimate) -> &[f64]| estimates.iter().map(|estimate| part(estimate)[row]).collect();
        let read = |name: &str| get(name).map_or(f64::NAN, |values| values[row]);
        let unbalances = planes.iter().map(|(magnitude, phase)| {
            let truth = [magnitude, phase].map(|name| scenario.number("plant", name));
            if truth[0] > 0.0 { off([read(magnitude), read(phase)], truth) } else { [0.0; 2] }
        });
        let unbalances: Vec<_> = unbalances.collect();
        let of_magnets = |all: &[f64]| used.iter().map(|k| all[*k]).collect();
        trial.samples.push(Sample {
            valid: valid[row] == 1.0,
            error: of(|estimate| &estimate.error),
            std: of(|estimate| &estimate.std),
            total: of(|estimate| &estimate.total),
            bound: bounds.as_ref().map_or_else(|| vec![f64::NAN; used.len()], |bounds| of_magnets(&bounds[at])),
            unbalance: [0, 1].map(|n| rms(unbalances.iter().map(|plane| plane[n]))),
            verdict: get("verdict").and_then(|values| Some(Verdict::of_number(values[row] as i32)?.name().into())),
        });
    }
    trial
}

/// Errors of an unbalance, `[magnitude, phase]`: relative, and in rad within half a turn.
pub(super) fn off([size, phase]: [f64; 2], [true_size, true_phase]: [f64; 2]) -> [f64; 2] {
    let turned = phase - true_phase;
    [size / true_size - 1.0, turned - TAU * (turned / TAU).round()]
}

/// The figures of a study at one instant, over the runs with a valid estimate; NaN if there are none. Errors are relative to
/// the true λ.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Figures {
    /// The instant, in s.
    pub instant_s: f64,
    /// Runs that reached it.
    pub runs: usize,
    /// Runs with a valid estimate.
    pub valid: usize,
    /// Runs whose bound is below [`IDENTIFIABLE`] for every λ.
    pub identifiable: usize,
    /// Those of them with a valid estimate.
    pub identified: usize,
    /// Root mean square of the errors.
    pub rms: Vec<f64>,
    /// Mean of the errors.
    pub bias: Vec<f64>,
    /// Root mean square of the stated standard deviations.
    pub stated: Vec<f64>,
    /// Root mean square of the bound of all runs, valid or not; not finite without noise.
    pub bound: Vec<f64>,
    /// Root mean square of error/bound.
    pub over_bound: Vec<f64>,
    /// Root mean square of error/standard deviation from noise alone.
    pub normalised: Vec<f64>,
    /// Root mean square of error/standard deviation with all tolerances.
    pub over_total: Vec<f64>,
    /// Greatest |error|/standard deviation with all tolerances.
    pub worst: f64,
    /// Root mean square of the relative error of the unbalance magnitude, and of the error of its phase, in rad.
    pub unbalance: [f64; 2],
    /// How often each verdict was given for an invalid estimate.
    pub verdicts: BTreeMap<String, usize>,
}

impl Figures {
    /// The figures of the samples of one instant.
    pub fn new(instant_s: f64, samples: &[&Sample]) -> Self {
        let valid: Vec<&&Sample> = samples.iter().filter(|sample| sample.valid).collect();
        let identifiable = |sample: &Sample| sample.bound.iter().all(|bound| *bound < IDENTIFIABLE);
        // NaN without a valid estimate.
        let mean =
            |value: &dyn Fn(&Sample) -> f64| valid.iter().map(|sample| value(sample)).sum::<f64>() / valid.len() as f64;
        let magnets = samples.first().map_or(0, |sample| sample.error.len());
        let rms_of = |value: &dyn Fn(&Sample, usize) -> f64| -> Vec<f64> {
            (0..magnets).map(|k| mean(&|sample| value(sample, k).powi(2)).sqrt()).collect()
        };
        let mut verdicts = BTreeMap::new();
        for verdict in samples.iter().filter(|sample| !sample.valid).filter_map(|sample| sample.verdict.clone()) {
            *verdicts.entry(verdict).or_default() += 1;
        }
        Self {
            instant_s,
            runs: samples.len(),
            valid: valid.len(),
            identifiable: samples.iter().filter(|sample| identifiable(sample)).count(),
            identified: valid.iter().filter(|sample| identifiable(sample)).count(),
            rms: rms_of(&|sample, k| sample.error[k]),
            bias: (0..magnets).map(|k| mean(&|sample| sample.error[k])).collect(),
            stated: rms_of(&|sample, k| sample.std[k]),
            bound: (0..magnets).map(|k| rms(samples.iter().map(|sample| sample.bound[k]))).collect(),
            over_bound: rms_of(&|sample, k| sample.error[k] / sample.bound[k]),
            normalised: rms_of(&|sample, k| sample.error[k] / sample.std[k]),
            over_total: rms_of(&|sample, k| sample.error[k] / sample.total[k]),
            worst: (0..magnets)
                .flat_map(|k| valid.iter().map(move |of| (of.error[k] / of.total[k]).abs()))
                .fold(f64::NAN, f64::max),
            unbalance: [0, 1].map(|n| mean(&|sample| sample.unbalance[n].powi(2)).sqrt()),
            verdicts,
        }
    }
}
