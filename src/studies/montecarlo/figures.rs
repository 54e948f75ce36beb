//! Results of one run of a study, and the figures of many.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use super::{bound, real};
use crate::simulation::recording::Recording;
use crate::simulation::scenario::{Profile, Scenario};
use crate::simulation::synchronous::forces;
use fmu_export::variable::{Type, Value};

/// Beyond so many of its standard deviations no valid estimate may be wrong.
pub const CONFIDENT: f64 = 5.0;

/// Cases whose bound is below this for every λ are to have a valid estimate.
pub const IDENTIFIABLE: f64 = 0.04;

/// Results of one run at one instant; errors and standard deviations are relative to the true λ.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// Whether the estimate was valid.
    pub valid: bool,
    /// Error of each λ.
    pub error: Vec<f64>,
    /// Standard deviation stated, of noise alone.
    pub std: Vec<f64>,
    /// Standard deviation stated with all tolerances; the former where there is no such output.
    pub total: Vec<f64>,
    /// The bound; not finite without noise.
    pub bound: Vec<f64>,
    /// Relative error of the magnitude of the unbalance, and error of its phase in rad, root mean square over all planes; 0 without unbalance.
    pub unbalance: [f64; 2],
    /// Why the estimate was not valid, where there is such an output.
    pub verdict: Option<String>,
}

/// The valid sample that was off by most of its standard deviations.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Worst {
    /// |error|/standard deviation, tolerances included.
    pub ratio: f64,
    /// When, in s.
    pub time_s: f64,
    /// Error there, relative.
    pub error: f64,
    /// Standard deviation there, relative.
    pub std: f64,
}

/// Results of one run.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// The seed that the run can be repeated with.
    pub seed: u64,
    /// At the instants of the study.
    pub samples: Vec<Sample>,
    /// Over all samples.
    pub worst: Worst,
    /// How often an estimate that was valid ceased to be.
    pub lost: usize,
    /// From the change of λ to the first sample that is not valid or valid for the new λ within 4 standard deviations, in s.
    pub noticed_s: Option<f64>,
    /// When the rotor touched down, in s; nothing after it counts.
    pub touched_s: Option<f64>,
    /// Part of the synchronous force of the magnets that correction masses leave, where there are some.
    pub left: Option<f64>,
}

/// The true λ of a magnet over time.
pub struct Truth<'a> {
    start: f64,
    course: Option<&'a Profile>,
    step_s: f64,
}

impl<'a> Truth<'a> {
    /// That of a magnet as [`Scenario::magnets`] gives it.
    pub fn new(scenario: &'a Scenario, (bearing, k): &(String, String)) -> Self {
        let name = format!("{bearing}lambda{k}");
        let path = format!("plant.{name}");
        let of_magnet = |profile: &&Profile| profile.targets.iter().any(|target| scenario.path(*target) == path);
        Self {
            start: real(scenario, "plant", &name),
            course: scenario.profiles.iter().find(of_magnet),
            step_s: scenario.step_s,
        }
    }

    /// λ in the interval that ends at an instant, in N·m²/A².
    pub fn at(&self, time_s: f64) -> f64 {
        let now = self.course.and_then(|course| course.at(time_s - 0.5 * self.step_s));
        now.map_or(self.start, |value| value.as_f64())
    }

    /// When λ jumps, in s, if it does.
    pub fn jump_s(&self) -> Option<f64> {
        self.course.filter(|course| course.hold)?.time_s.first().copied()
    }
}

/// Whether a signal is needed to judge a run.
pub fn wanted(path: &str) -> bool {
    let Some(name) = path.strip_prefix("plant.") else { return path.starts_with("estimator.") };
    ["X", "Y", "Z", "beta", "gamma", "theta", "omegam"].contains(&name)
        || ["F[", "gap["].iter().any(|part| name.contains(part))
        || ["FY", "FZ"].iter().any(|end| name.ends_with(end))
        || is_contact(path)
}

/// Whether a signal says that the rotor touches a backup bearing.
pub fn is_contact(path: &str) -> bool {
    path.starts_with("plant.") && path.ends_with("contact")
}

/// The first row at which the rotor touches a backup bearing.
pub fn touched(recording: &Recording) -> Option<usize> {
    let contacts = recording.columns.iter().filter(|column| is_contact(&column.name));
    contacts.filter_map(|column| column.values.iter().position(|contact| *contact == 1.0)).min()
}

/// Judges a run; without noise, and once a λ has changed, there is no bound.
pub fn judge(scenario: &Scenario, recording: &Recording, instants_s: &[f64], seed: u64) -> Option<Trial> {
    let machine = scenario.machine;
    let get = |name: &str| recording.get(&format!("estimator.{name}"));
    let used: Vec<usize> = (0..machine.magnets()).filter(|k| scenario.uses(*k)).collect();
    let magnets = |name: &str| {
        let names = machine.of_magnets(name);
        used.iter().map(|k| get(&names[*k])).collect::<Option<Vec<_>>>()
    };
    let (hat, std, valid) = (magnets("lambdaHat")?, magnets("lambdaStd")?, get("valid")?);
    let total = magnets("lambdaStdTotal").unwrap_or_else(|| std.clone());
    let magnets = scenario.magnets();
    let truths: Vec<_> = used.iter().map(|k| Truth::new(scenario, &magnets[*k])).collect();
    let change_s = truths.iter().find_map(Truth::jump_s);
    let changing = change_s.is_some();
    // Two revolutions are granted to find a change.
    let granted_s = 2.0 * TAU / real(scenario, "plant", "omega").abs().max(1.0);
    let touched = touched(recording);
    let rows = touched.unwrap_or(recording.time_s.len());
    let relative = |row: usize| {
        let truth: Vec<f64> = truths.iter().map(|truth| truth.at(recording.time_s[row])).collect();
        let of = |columns: &[&[f64]]| -> Vec<f64> {
            columns.iter().zip(&truth).map(|(column, truth)| column[row] / truth).collect()
        };
        let error: Vec<f64> = of(&hat).iter().map(|ratio| ratio - 1.0).collect();
        (error, of(&std), of(&total))
    };
    let mut trial = Trial {
        seed,
        samples: Vec::new(),
        worst: Worst::default(),
        lost: 0,
        noticed_s: None,
        touched_s: touched.map(|row| recording.time_s[row]),
        left: scenario.balance_s.and_then(|balance_s| {
            let [before, after] = [balance_s, *recording.time_s.last()?].map(|end_s| forces(recording, end_s));
            let sum = |forces: [f64; 4]| forces.iter().map(|force| force * force).sum::<f64>();
            Some((sum(after?) / sum(before?)).sqrt())
        }),
    };
    for row in 0..rows {
        let time_s = recording.time_s[row];
        let after =
            change_s.filter(|change_s| time_s > change_s + 0.5 * scenario.step_s).map(|change_s| time_s - change_s);
        if row > 0 && valid[row - 1] == 1.0 && valid[row] != 1.0 {
            trial.lost += 1;
        }
        let mut most = Worst { ratio: 0.0, time_s, ..Worst::default() };
        if valid[row] == 1.0 {
            let (error, _, total) = relative(row);
            for k in 0..error.len() {
                // Two numbers that are both 0 agree.
                let ratio = if error[k] == 0.0 { 0.0 } else { (error[k] / total[k]).abs() };
                if ratio > most.ratio || ratio.is_nan() {
                    most = Worst {
                        ratio: if ratio.is_nan() { f64::INFINITY } else { ratio },
                        time_s,
                        error: error[k],
                        std: total[k],
                    };
                }
            }
        }
        if let Some(after_s) = after
            && trial.noticed_s.is_none()
            && most.ratio < 4.0
        {
            trial.noticed_s = Some(after_s);
        }
        if most.ratio > trial.worst.ratio && after.is_none_or(|after_s| after_s > granted_s) {
            trial.worst = most;
        }
    }
    let bounds = (!changing).then(|| bound::bound(scenario, recording, instants_s)).flatten();
    let planes: Vec<_> = machine.of_planes("magnitude").into_iter().zip(machine.of_planes("phase")).collect();
    for (at, instant_s) in instants_s.iter().enumerate() {
        let Some(row) = (0..rows).find(|row| recording.time_s[*row] >= instant_s - 0.5 * scenario.step_s) else {
            break;
        };
        let (error, std, total) = relative(row);
        let read = |name: &str| get(name).map_or(f64::NAN, |values| values[row]);
        let unbalances = planes.iter().map(|(magnitude, phase)| {
            let (size, turned) = (real(scenario, "plant", magnitude), read(phase) - real(scenario, "plant", phase));
            if size > 0.0 { [read(magnitude) / size - 1.0, turned - TAU * (turned / TAU).round()] } else { [0.0; 2] }
        });
        let unbalances: Vec<_> = unbalances.collect();
        let of_magnets = |all: &[f64]| used.iter().map(|k| all[*k]).collect();
        trial.samples.push(Sample {
            valid: valid[row] == 1.0,
            error,
            std,
            total,
            bound: bounds.as_ref().map_or_else(|| vec![f64::NAN; used.len()], |bounds| of_magnets(&bounds[at])),
            unbalance: [0, 1].map(|n| pooled(&unbalances.iter().map(|plane| plane[n]).collect::<Vec<_>>())),
            verdict: get("verdict").map(|values| verdict(scenario, values[row])),
        });
    }
    Some(trial)
}

/// The name of a value of the output `verdict`.
fn verdict(scenario: &Scenario, value: f64) -> String {
    let variables = scenario.estimator().model_type.variables();
    let kind = variables.iter().find(|variable| variable.name == "verdict").map(|variable| &variable.data_type);
    match kind {
        Some(Type::Enumeration { items, .. }) => items
            .items
            .get((value as usize).wrapping_sub(1))
            .map_or_else(|| value.to_string(), |(name, _)| (*name).to_owned()),
        _ => Value::Real(value).as_f64().to_string(),
    }
}

/// The figures of a study at one instant, over the runs whose estimate was valid: no numbers if there is none. Errors are
/// relative to the true λ.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Figures {
    /// When, in s.
    pub instant_s: f64,
    /// Runs that got there.
    pub runs: usize,
    /// Runs whose estimate was valid.
    pub valid: usize,
    /// Runs whose bound is below [`IDENTIFIABLE`] for every λ.
    pub identifiable: usize,
    /// Those of them whose estimate was valid.
    pub identified: usize,
    /// Root mean square of the errors.
    pub rms: Vec<f64>,
    /// Mean of the errors.
    pub bias: Vec<f64>,
    /// Root mean square of the standard deviations stated.
    pub stated: Vec<f64>,
    /// Root mean square of the bound of all runs, valid or not; not finite without noise.
    pub bound: Vec<f64>,
    /// Root mean square of error/bound.
    pub over_bound: Vec<f64>,
    /// Root mean square of error/standard deviation of noise alone.
    pub normalised: Vec<f64>,
    /// Root mean square of error/standard deviation with all tolerances.
    pub over_total: Vec<f64>,
    /// Greatest |error|/standard deviation with all tolerances.
    pub worst: f64,
    /// Root mean square of the error of the magnitude of the unbalance, relative, and of its phase, in rad.
    pub unbalance: [f64; 2],
    /// How often each verdict was given where the estimate was not valid.
    pub verdicts: BTreeMap<String, usize>,
}

/// Root mean square; 0 of nothing.
pub fn pooled(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

impl Figures {
    /// The figures of the samples of one instant.
    pub fn new(instant_s: f64, samples: &[&Sample]) -> Self {
        let valid: Vec<&&Sample> = samples.iter().filter(|sample| sample.valid).collect();
        let identifiable = |sample: &Sample| sample.bound.iter().all(|bound| *bound < IDENTIFIABLE);
        let mean = |value: &dyn Fn(&Sample) -> f64| {
            // Without a valid estimate there is no figure.
            if valid.is_empty() {
                f64::NAN
            } else {
                valid.iter().map(|sample| value(sample)).sum::<f64>() / valid.len() as f64
            }
        };
        let magnets = samples.first().map_or(0, |sample| sample.error.len());
        let rms = |value: &dyn Fn(&Sample, usize) -> f64| -> Vec<f64> {
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
            rms: rms(&|sample, k| sample.error[k]),
            bias: (0..magnets).map(|k| mean(&|sample| sample.error[k])).collect(),
            stated: rms(&|sample, k| sample.std[k]),
            bound: (0..magnets)
                .map(|k| pooled(&samples.iter().map(|sample| sample.bound[k]).collect::<Vec<_>>()))
                .collect(),
            over_bound: rms(&|sample, k| sample.error[k] / sample.bound[k]),
            normalised: rms(&|sample, k| sample.error[k] / sample.std[k]),
            over_total: rms(&|sample, k| sample.error[k] / sample.total[k]),
            worst: valid
                .iter()
                .flat_map(|sample| sample.error.iter().zip(&sample.total).map(|(error, total)| (error / total).abs()))
                .fold(f64::NAN, f64::max),
            unbalance: [0, 1].map(|n| mean(&|sample| sample.unbalance[n].powi(2)).sqrt()),
            verdicts,
        }
    }
}
