//! How often the estimate is off by how much: the same scenario with many seeds of the sensor noise.
//!
//! Beside the errors stands what no unbiased estimator can do better than on the same data, the bound of Cramér and Rao
//! ([`bound`]), and the standard deviation that the estimator itself states.

use std::f64::consts::TAU;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use nalgebra::{SMatrix, SVector};

use super::identify::{self, Samples};
use super::progress::Progress;
use super::recording::Recording;
use super::report::Table;
use super::scenario::{Scenario, Setting};
use super::simulate::{self, Refused};
use crate::model::estimator::{EstimatorConfig, Hold};
use crate::slave::variable::Value;

/// Runs of one scenario that differ in the seed of the sensor noise.
#[derive(Clone)]
pub struct Study {
    /// One line.
    pub title: String,
    /// The scenario; its plant has the noise.
    pub scenario: Scenario,
    /// When the estimates are looked at, in seconds.
    pub instants_s: Vec<f64>,
    /// How many runs; the seeds are 1, 2, 3 …
    pub runs: usize,
    /// Whether the estimator is given the commanded currents, which have no noise, in place of the measured ones.
    pub commanded: bool,
}

/// The figures of a study at one instant. Errors are relative to the true λ.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Figures {
    /// When, in seconds.
    pub instant_s: f64,
    /// Runs whose estimate was valid.
    pub valid: usize,
    /// Runs in all.
    pub runs: usize,
    /// Root mean square of the errors.
    pub rms: [f64; 3],
    /// Mean of the errors.
    pub bias: [f64; 3],
    /// Root mean square of error/standard deviation.
    pub normalised: [f64; 3],
    /// Greatest |error|/standard deviation.
    pub worst: f64,
    /// Mean of the standard deviations stated.
    pub stated: [f64; 3],
    /// The bound of Cramér and Rao for the standard deviation; 0 without noise.
    pub bound: [f64; 3],
    /// Root mean square of the error of the magnitude of the unbalance, relative, and of its phase, in rad.
    pub unbalance: [f64; 2],
}

/// What one run says at one instant.
#[derive(Clone, Copy, Debug, Default)]
struct Sample {
    valid: bool,
    error: [f64; 3],
    std: [f64; 3],
    unbalance: [f64; 2],
}

impl Study {
    /// Runs everything, on all processors.
    ///
    /// # Errors
    /// Every parameter that a slave refuses.
    pub fn run(&self) -> Result<Vec<Figures>, Refused> {
        let next = AtomicUsize::new(0);
        let samples = Mutex::new(vec![Vec::new(); self.runs]);
        let refused = Mutex::new(None);
        let bounds = Mutex::new(Vec::new());
        let progress = Progress::new("runs", self.runs as u64);
        let threads = std::thread::available_parallelism().map_or(1, usize::from).min(self.runs.max(1));
        let work = |progress: Option<&Progress>| {
            loop {
                let run = next.fetch_add(1, Ordering::Relaxed);
                if run >= self.runs {
                    break;
                }
                if let Some(progress) = progress {
                    progress.tell(run as u64);
                }
                match self.one(run) {
                    Ok((found, bound)) => {
                        samples.lock().expect("no thread has panicked")[run] = found;
                        if let Some(bound) = bound {
                            *bounds.lock().expect("no thread has panicked") = bound;
                        }
                    }
                    Err(error) => *refused.lock().expect("no thread has panicked") = Some(error),
                }
            }
        };
        std::thread::scope(|scope| {
            for _ in 1..threads {
                scope.spawn(|| work(None));
            }
            // The bar is drawn by this thread alone.
            work(Some(&progress));
        });
        if let Some(error) = refused.into_inner().expect("no thread has panicked") {
            return Err(error);
        }
        let samples = samples.into_inner().expect("no thread has panicked");
        let bounds = bounds.into_inner().expect("no thread has panicked");
        Ok((0..self.instants_s.len()).map(|at| self.figures(at, &samples, &bounds)).collect())
    }

    /// One run: what it says at the instants, and from the first run the bound.
    #[expect(clippy::type_complexity, reason = "a pair of lists")]
    fn one(&self, run: usize) -> Result<(Vec<Sample>, Option<Vec<[f64; 3]>>), Refused> {
        let mut scenario = self.scenario.clone();
        scenario.set("plant", "sensor.seed", Value::Integer(run as i32 + 1));
        scenario.duration_s = self.instants_s.iter().copied().fold(0.0, f64::max);
        let run_of = simulate::run(&scenario)?;
        let mut recording = run_of.recording;
        if self.commanded {
            command(&scenario, &mut recording);
        }
        let recording = &recording;
        let truth = truth(&scenario);
        let unbalance = [real(&scenario, "unbalance.magnitude"), real(&scenario, "unbalance.phase")];
        let at = |instant_s: f64| {
            let row = recording.time_s.iter().position(|time_s| *time_s >= instant_s - 1e-9)?;
            let read = |name: &str| recording.get(name).and_then(|values| values.get(row)).copied();
            let magnets = |name: &str| {
                let values = [1, 2, 3].map(|k| read(&format!("estimator.{name}[{k}]")));
                Some([values[0]?, values[1]?, values[2]?])
            };
            let (hat, std) = (magnets("lambdaHat")?, magnets("lambdaStd")?);
            let phase = read("estimator.unbalance.phase")? - unbalance[1];
            Some(Sample {
                valid: read("estimator.valid")? == 1.0,
                error: std::array::from_fn(|k| hat[k] / truth[k] - 1.0),
                std: std::array::from_fn(|k| std[k] / truth[k]),
                unbalance: [
                    if unbalance[0] > 0.0 { read("estimator.unbalance.magnitude")? / unbalance[0] - 1.0 } else { 0.0 },
                    if unbalance[0] > 0.0 { phase - TAU * (phase / TAU).round() } else { 0.0 },
                ],
            })
        };
        let found = self.instants_s.iter().map(|instant_s| at(*instant_s).unwrap_or_default()).collect();
        let bound = (run == 0).then(|| {
            self.instants_s
                .iter()
                .map(|instant_s| bound(&scenario, recording, *instant_s).unwrap_or_default())
                .collect()
        });
        Ok((found, bound))
    }

    fn figures(&self, at: usize, samples: &[Vec<Sample>], bounds: &[[f64; 3]]) -> Figures {
        let here: Vec<&Sample> = samples.iter().filter_map(|run| run.get(at)).filter(|sample| sample.valid).collect();
        let count = here.len().max(1) as f64;
        let mean = |value: &dyn Fn(&Sample) -> f64| here.iter().map(|sample| value(sample)).sum::<f64>() / count;
        let each = |value: &dyn Fn(&Sample, usize) -> f64| -> [f64; 3] {
            std::array::from_fn(|k| mean(&|sample| value(sample, k)))
        };
        Figures {
            instant_s: self.instants_s[at],
            valid: here.len(),
            runs: self.runs,
            rms: each(&|sample, k| sample.error[k] * sample.error[k]).map(f64::sqrt),
            bias: each(&|sample, k| sample.error[k]),
            normalised: each(&|sample, k| (sample.error[k] / sample.std[k]).powi(2)).map(f64::sqrt),
            worst: here
                .iter()
                .flat_map(|sample| (0..3).map(|k| (sample.error[k] / sample.std[k]).abs()))
                .fold(0.0, f64::max),
            stated: each(&|sample, k| sample.std[k]),
            bound: bounds.get(at).copied().unwrap_or_default(),
            unbalance: [0, 1].map(|n| mean(&|sample| sample.unbalance[n] * sample.unbalance[n]).sqrt()),
        }
    }
}

/// What is left of the noise of a current where it is commanded, in A: enough to weigh by.
const COMMAND_NOISE_A: f64 = 1e-4;

/// Replaces the estimates in a recording by those from the commanded currents, held over the interval after the sample.
fn command(scenario: &Scenario, recording: &mut Recording) {
    let config = EstimatorConfig {
        hold: Hold::HeldAfter,
        current_noise_a: COMMAND_NOISE_A,
        ..identify::config(|name| scenario.value("estimator", name).map_or(f64::NAN, Value::as_f64))
    };
    let read = |name: &str| recording.get(name).unwrap_or(&[]).to_vec();
    let samples = Samples {
        step_s: config.step_s,
        position_m: [read("plant.Ym"), read("plant.Zm")],
        current_a: [1, 2, 3].map(|k| read(&format!("controller.i[{k}]"))),
        theta_rad: read("plant.theta"),
        omega_rad_s: read("plant.omegam"),
        ..Samples::default()
    };
    let Ok(track) = identify::track(&samples, &config) else { return };
    let found = identify::recording(&samples, &[track]);
    for column in &mut recording.columns {
        if let Some(name) = column.name.strip_prefix("estimator.")
            && let Some(values) = found.get(&format!("unbalance.{name}"))
        {
            column.values = values.to_vec();
        }
    }
}

/// Sensor noise of the studies of the command: position in m, current in A.
pub const NOISE: [f64; 2] = [1e-7, 1e-2];

/// A study of the unbalanced rotor, or of another scenario, with this noise, which the estimator is told or not.
#[must_use]
pub fn study(title: &str, base: &Scenario, noise: [f64; 2], told: bool, runs: usize) -> Study {
    let mut scenario = base.clone();
    for (name, noise) in [("sensor.positionNoise", noise[0]), ("sensor.currentNoise", noise[1])] {
        scenario.set("plant", name, Value::Real(noise));
        scenario.set("estimator", name, Value::Real(if told { noise } else { 0.0 }));
    }
    scenario.set("estimator", "method", Value::Integer(4));
    // The loop alone: no estimator beside it, and no update while the estimates are looked at.
    scenario.elements.truncate(3);
    Study { title: title.into(), scenario, instants_s: vec![0.035, 0.1], runs, commanded: false }
}

/// The scenario at another speed, with the window given.
pub fn at_speed(scenario: &mut Scenario, rpm: f64, window_s: f64) {
    let omega = rpm * TAU / 60.0;
    let radius = scenario.value("controller", "reference.rZ").map_or(0.0, Value::as_f64);
    for (element, variable, value) in [
        ("plant", "omega", omega),
        ("plant", "vZ0", radius * omega),
        ("controller", "reference.omega", omega),
        ("estimator", "Tf", window_s),
        ("estimator", "epsilon", window_s),
    ] {
        scenario.set(element, variable, Value::Real(value));
    }
}

/// All studies of the command without arguments.
///
/// # Panics
/// Never: the scenarios come with the program.
#[must_use]
pub fn studies(runs: usize) -> Vec<Study> {
    let open = |name: &str| Scenario::open(std::path::Path::new(name)).expect("a scenario that comes with the program");
    let (unbalanced, mut other) = (open("unbalanced"), open("turned"));
    // 20 N at 63 Hz, the load of the other studies.
    other.set("plant", "unbalance.magnitude", Value::Real(20.0 / (126.0 * std::f64::consts::PI).powi(2)));
    other.set("plant", "unbalance.phase", Value::Real(0.7));
    other.set("plant", "pY", Value::Real(10.0));
    other.set("plant", "pZ", Value::Real(-20.0));
    let tenfold = [10.0 * NOISE[0], NOISE[1]];
    let mut commanded =
        study("Unbalance 20 N, 0.1 µm, commanded currents for the measured ones", &unbalanced, NOISE, true, runs);
    commanded.commanded = true;
    let mut studies = vec![
        study("Unbalance 20 N, load (10, −20) N, 0.1 µm and 10 mA, noise told", &unbalanced, NOISE, true, runs),
        study("The same, noise from the residual", &unbalanced, NOISE, false, runs),
        commanded,
        study("1 µm and 10 mA, noise told", &unbalanced, tenfold, true, runs),
        study("1 µm and 10 mA, noise from the residual", &unbalanced, tenfold, false, runs),
        study("0.03 µm and 3 mA, noise from the residual", &unbalanced, NOISE.map(|noise| 0.3 * noise), false, runs),
        study("Without noise", &unbalanced, [0.0; 2], false, 1),
        study("Another bearing at 63 Hz, unbalance 20 N, noise told", &other, NOISE, true, runs),
    ];
    for (rpm, window_s) in SPEEDS {
        let mut scenario = unbalanced.clone();
        at_speed(&mut scenario, rpm, window_s);
        let title = format!("{rpm} rpm, Tf = {:.1} ms, noise told", window_s * 1e3);
        let mut study = study(&title, &scenario, NOISE, true, runs);
        study.instants_s = vec![0.1, 0.2];
        studies.push(study);
    }
    studies
}

/// Speeds of the studies, in rpm, and the windows that `design` recommends for them, in seconds.
///
/// At 1000 rpm it recommends none: magnet 1 hardly varies, and its λ cannot be known within 5 %.
pub const SPEEDS: [(f64, f64); 5] = [(1000.0, 0.06), (2000.0, 0.03), (3000.0, 0.02), (4500.0, 0.0133), (6000.0, 0.01)];

/// The figures as a table.
pub fn table(study: &Study, figures: &[Figures]) -> Table {
    let mut rows = Vec::new();
    for figures in figures {
        let three = |values: [f64; 3], factor: f64, digits: usize| {
            values.map(|value| format!("{:.*}", digits, factor * value)).to_vec()
        };
        let at = format!("{} ms", (figures.instant_s * 1e3).round());
        let mut row = |name: &str, values: Vec<String>| {
            rows.push([vec![format!("{at}, {name}")], values].concat());
        };
        if figures.valid == 0 {
            row("no valid estimate; Cramér–Rao bound, %", three(figures.bound, 100.0, 3));
            continue;
        }
        row("rms error, %", three(figures.rms, 100.0, 3));
        row("bias, %", three(figures.bias, 100.0, 3));
        row("standard deviation stated, %", three(figures.stated, 100.0, 3));
        row("error/standard deviation, rms", three(figures.normalised, 1.0, 2));
        if figures.bound[0] > 0.0 {
            row("Cramér–Rao bound, %", three(figures.bound, 100.0, 3));
            row("rms error/bound", three(std::array::from_fn(|k| figures.rms[k] / figures.bound[k]), 1.0, 2));
        }
        row(
            "unbalance: rms error of U, %; of φ, rad; valid runs",
            vec![
                format!("{:.3}", 100.0 * figures.unbalance[0]),
                format!("{:.4}", figures.unbalance[1]),
                format!("{}/{}", figures.valid, figures.runs),
            ],
        );
    }
    Table {
        title: study.title.clone(),
        note: format!("{} runs, seeds 1 to {0}.", study.runs),
        head: ["", "λ1", "λ2", "λ3"].map(String::from).into(),
        rows,
    }
}

fn truth(scenario: &Scenario) -> [f64; 3] {
    std::array::from_fn(|k| real(scenario, &format!("lambda[{}]", k + 1)))
}

fn real(scenario: &Scenario, variable: &str) -> f64 {
    scenario.value("plant", variable).map_or(f64::NAN, Value::as_f64)
}

impl Scenario {
    /// Gives a variable a value at the start; nothing happens if there is no such element or variable.
    pub fn set(&mut self, element: &str, variable: &str, value: Value) {
        if let Some(element) = self.elements.iter_mut().find(|candidate| candidate.name == element) {
            let index = (element.kind.variables)().iter().position(|candidate| candidate.name == variable);
            element.settings.extend(index.map(|index| Setting { index, value }));
        }
    }
}

/// States of the bound: position and velocity of both axes, load of both axes, λ of three magnets, U cos φ, U sin φ.
const STATES: usize = 11;

/// The bound of Cramér and Rao for the standard deviation of an unbiased estimate of λ from the positions, currents and
/// angles of a recording up to an instant, relative to λ. `None` without noise or without the signals.
///
/// The motion is linear in everything unknown: initial position and velocity, constant load, λ, unbalance. Noise of the
/// currents acts as noise of the forces, `2 λ_k i_k/gap_k² n_k`. The bound is therefore the covariance that the Kalman filter
/// for these eleven states ends with when it starts knowing nothing; it does not depend on the noise itself.
pub fn bound(scenario: &Scenario, recording: &Recording, instant_s: f64) -> Option<[f64; 3]> {
    let (position_noise, current_noise) =
        (real(scenario, "sensor.positionNoise"), real(scenario, "sensor.currentNoise"));
    if position_noise.is_nan() || position_noise <= 0.0 {
        return None;
    }
    let (m, gap_m) = (real(scenario, "m"), real(scenario, "s"));
    let direction: [[f64; 2]; 3] = std::array::from_fn(|k| {
        let alpha = real(scenario, &format!("alpha[{}]", k + 1));
        [alpha.sin(), alpha.cos()]
    });
    let truth = truth(scenario);
    let signal = |name: &str| recording.get(&format!("plant.{name}"));
    let (y, z, theta) = (signal("Y")?, signal("Z")?, signal("theta")?);
    let currents = [signal("im[1]")?, signal("im[2]")?, signal("im[3]")?];
    let omega = signal("omegam")?;
    // Scales that make every unknown about one.
    let scale: [f64; STATES] = {
        let u0 = m * gap_m * 1e-2;
        let mut scale = [1e-4, 1e-4, 1e-2, 1e-2, 1e2, 1e2, truth[0], truth[1], truth[2], u0, u0];
        scale[4] = m;
        scale[5] = m;
        scale
    };
    let mut p = SMatrix::<f64, STATES, STATES>::identity() * 1e6;
    let measure = |p: &mut SMatrix<f64, STATES, STATES>| {
        for axis in 0..2 {
            let mut c = SVector::<f64, STATES>::zeros();
            c[axis] = scale[axis];
            let pc = *p * c;
            let s = c.dot(&pc) + position_noise * position_noise;
            *p -= pc * pc.transpose() / s;
        }
    };
    measure(&mut p);
    for row in 1..recording.time_s.len() {
        if recording.time_s[row] > instant_s + 1e-9 {
            break;
        }
        let ts = recording.time_s[row] - recording.time_s[row - 1];
        let mut a = SMatrix::<f64, STATES, STATES>::identity();
        let mut q = SMatrix::<f64, STATES, STATES>::zeros();
        let middle = 0.5 * (theta[row] + theta[row - 1]);
        let w2 = omega[row] * omega[row];
        let (sin, cos) = middle.sin_cos();
        for axis in 0..2 {
            let (x, v) = (axis, 2 + axis);
            a[(x, v)] = ts * scale[v] / scale[x];
            let turning = if axis == 0 { [w2 * cos, -w2 * sin] } else { [w2 * sin, w2 * cos] };
            let mut force = [0.0; STATES];
            force[4 + axis] = 1.0;
            force[9] = turning[0];
            force[10] = turning[1];
            for k in 0..3 {
                let gap = gap_m
                    - direction[k][0] * 0.5 * (y[row] + y[row - 1])
                    - direction[k][1] * 0.5 * (z[row] + z[row - 1]);
                let i = currents[k][row];
                force[6 + k] = direction[k][axis] * i * i / (gap * gap);
                let noise = 2.0 * truth[k] * i * current_noise / (gap * gap * m);
                let mut g = SVector::<f64, STATES>::zeros();
                if axis == 0 {
                    for (other, along) in direction[k].iter().enumerate() {
                        g[other] = 0.5 * ts * ts * along * noise / scale[other];
                        g[2 + other] = ts * along * noise / scale[2 + other];
                    }
                    q += g * g.transpose();
                }
            }
            for n in 4..STATES {
                a[(x, n)] += 0.5 * ts * ts * force[n] / m * scale[n] / scale[x];
                a[(v, n)] += ts * force[n] / m * scale[n] / scale[v];
            }
        }
        p = a * p * a.transpose() + q;
        p = (p + p.transpose()) * 0.5;
        measure(&mut p);
    }
    Some(std::array::from_fn(|k| p[(6 + k, 6 + k)].max(0.0).sqrt()))
}
