//! Identification from a recording of a test bench, with the estimator that runs on line.

pub mod axial;
pub mod likelihood;

mod answer;
mod diagnosis;
mod faults;
mod read;
mod tolerance;
mod twin;

use std::f64::consts::TAU;

use serde_json::{Value as Json, json};

pub use self::answer::{Answer, Question, answer};
pub use self::tolerance::{named, of_estimator, quantity, tolerance};
pub use self::twin::{Stated, Twin};

pub use self::read::{Axial, Finding, Reading, Rotation, Samples, Unusable, duration_s, rate_s};
use crate::estimation::{
    Estimator, EstimatorConfig, EstimatorInput, EstimatorOutput, Hold, Method, STD_LIMIT, Tolerance, Verdict,
};
use crate::invalid::Invalid;
use crate::simulation::recording::{Column, Recording};
use crate::table::Table;

/// The methods by the names of the interface.
pub const METHODS: [(&str, Method); 3] =
    [("paperLiteral", Method::PaperLiteral), ("paper", Method::Paper), ("predictionError", Method::PredictionError)];

/// Meanings of samples of currents, by the names of the interface.
pub const HOLDS: [(&str, Hold); 3] =
    [("heldBefore", Hold::HeldBefore), ("heldAfter", Hold::HeldAfter), ("linear", Hold::Linear)];

/// One method over a whole recording.
#[derive(Clone, Debug)]
pub struct Track {
    /// Name of the method.
    pub name: &'static str,
    /// The configuration of the estimator.
    pub config: EstimatorConfig,
    /// Its outputs at every sample, or at every so many.
    pub outputs: Vec<EstimatorOutput>,
    /// Samples from one output to the next.
    pub every: usize,
}

/// Why no identification was made.
#[derive(Clone, Debug, thiserror::Error)]
pub enum Failed {
    /// The estimator refuses its parameters.
    #[error("the estimator cannot be started: {}", .0.iter().map(Invalid::to_string).collect::<Vec<_>>().join("; "))]
    Refused(Vec<Invalid>),
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

/// Runs one method over a recording.
///
/// # Errors
/// An obstacle to running the method.
pub fn track(samples: &Samples, config: &EstimatorConfig) -> Result<Track, Failed> {
    track_every(samples, config, 1)
}

/// The same with the output of every n-th sample alone: those of a long recording take more memory than the recording.
///
/// # Errors
/// An obstacle to running the method.
pub fn track_every(samples: &Samples, config: &EstimatorConfig, every: usize) -> Result<Track, Failed> {
    let every = every.max(1);
    let mut config = config.clone();
    // Without the angle of the rotor there is no telling where an unbalance points.
    if config.method == Method::PredictionError {
        config.identify_unbalance &= !samples.theta_rad.is_empty();
    } else {
        config.identify_unbalance = true;
        config.tolerance = Tolerance::default();
    }
    let estimator = Estimator::new(config.clone()).map_err(Failed::Refused)?;
    let mut state = estimator.start();
    let currents = samples.currents(config.hold);
    let outputs = (0..samples.len()).filter_map(|j| {
        let input = EstimatorInput {
            position_m: [samples.position_m[0][j], samples.position_m[1][j]],
            current_a: [currents[0][j], currents[1][j], currents[2][j]],
            theta_rad: samples.theta_rad.get(j).copied().unwrap_or(0.0),
            omega_rad_s: samples.omega_rad_s.get(j).copied().unwrap_or(TAU / config.window_s),
            enable: true,
            contact: false,
            reset: false,
        };
        let output = estimator.sample(&mut state, &input);
        (j % every == 0).then_some(output)
    });
    let name = METHODS.iter().find(|(_, method)| *method == config.method).map_or("", |(name, _)| name);
    let outputs = outputs.collect();
    Ok(Track { name, config, outputs, every })
}

/// How much less likely a stretch of the recording is with each of the three readings of a current sample, in the order of [`HOLDS`]:
/// differences of log-likelihoods, 0 for the best.
#[must_use]
pub fn residuals_of_holds(samples: &Samples, config: &EstimatorConfig) -> [f64; 3] {
    diagnosis::holds(&HOLDS.map(|(_, hold)| diagnosis::Take {
        columns: answer::columns(samples, hold),
        options: likelihood::Options::new(config.m_kg, config.gap_m, config.alpha_rad),
        hold,
        config: config.clone(),
    }))
}

/// The reading of the currents by [`residuals_of_holds`]: that of measured currents, unless another one is clearly more likely.
#[must_use]
pub fn most_likely_hold(residuals: &[f64; 3]) -> Hold {
    let best = (0..HOLDS.len()).min_by(|a, b| residuals[*a].total_cmp(&residuals[*b])).unwrap_or(0);
    HOLDS[if residuals[0] < diagnosis::VERY_STRONG { 0 } else { best }].1
}

impl Track {
    /// The last valid estimate.
    #[must_use]
    pub fn last_valid(&self) -> Option<&EstimatorOutput> {
        self.outputs.iter().rev().find(|output| output.valid)
    }

    /// Use of the recording, in a sentence or two.
    #[must_use]
    pub fn verdict(&self) -> String {
        let valid = self.outputs.iter().filter(|output| output.valid).count();
        let share = 100.0 * valid as f64 / self.outputs.len().max(1) as f64;
        let mut reasons: Vec<(Verdict, usize)> = Vec::new();
        for output in self.outputs.iter().filter(|output| !output.valid) {
            match reasons.iter_mut().find(|(reason, _)| *reason == output.verdict) {
                Some((_, count)) => *count += 1,
                None => reasons.push((output.verdict, 1)),
            }
        }
        reasons.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        let others: Vec<String> =
            reasons.iter().take(3).map(|(reason, count)| format!("{count} samples {reason}")).collect();
        let why = if others.is_empty() { String::new() } else { format!(" Otherwise: {}.", others.join("; ")) };
        match self.last_valid() {
            None => format!("The recording does not identify the force constants.{why}"),
            Some(last) => {
                let worst = (0..3).map(|k| last.lambda_std_total[k] / last.lambda_hat[k]).fold(0.0, f64::max);
                let word =
                    if worst < 0.2 * STD_LIMIT { "The excitation is sufficient" } else { "The excitation is weak" };
                format!(
                    "{word}: largest standard deviation {:.2} % of its force constant, valid during {share:.0} % of the \
                     recording.{why}",
                    100.0 * worst,
                )
            }
        }
    }
}

/// Estimates in numbers, one row per method.
#[must_use]
pub fn table(tracks: &[Track]) -> Table {
    let head = [
        "",
        "λ1",
        "λ2",
        "λ3",
        "± 1",
        "± 2",
        "± 3",
        "U, g·mm",
        "φ, rad",
        "pY, N",
        "pZ, N",
        "residual",
        "condition",
        "valid",
    ];
    let row = |track: &Track| {
        let Some(last) = track.last_valid() else {
            let mut row = vec![track.name.to_owned()];
            row.extend(std::iter::repeat_n("–".to_owned(), head.len() - 2));
            row.push("never".into());
            return row;
        };
        let numbers = last.lambda_hat.iter().map(|l| format!("{:.4}", l * 1e6));
        let stds = last.lambda_std.iter().map(|l| format!("{:.4}", l * 1e6));
        let (u, phi) = if track.config.method == Method::PredictionError {
            (format!("{:.2}", last.unbalance_kg_m[0] * 1e6), format!("{:.4}", last.unbalance_phase_rad[0]))
        } else {
            ("–".into(), "–".into())
        };
        let at_end = track.outputs.last().is_some_and(|output| output.valid);
        std::iter::once(track.name.to_owned())
            .chain(numbers)
            .chain(stds)
            .chain([u, phi, format!("{:.2}", last.load_n[0]), format!("{:.2}", last.load_n[1])])
            .chain([format!("{:.4}", last.residual), format!("{:.1}", last.condition)])
            .chain([if at_end { "yes" } else { "not at the end" }.to_owned()])
            .collect()
    };
    Table {
        title: "Force constants, 10⁻⁶ N·m²/A², with their standard deviations".into(),
        note: "The last valid estimates.".into(),
        head: head.map(String::from).into(),
        rows: tracks.iter().map(row).collect(),
    }
}

/// Outputs of the on-line estimator after each quarter of the recording.
#[must_use]
pub fn progress(samples: &Samples, track: &Track) -> Table {
    let count = track.outputs.len();
    let rows = [(1, "1/4"), (2, "1/2"), (3, "3/4"), (4, "end")].into_iter().filter_map(|(quarter, name)| {
        let at = (quarter * count / 4).checked_sub(1)?;
        let output = &track.outputs[at];
        let time_s = samples.start_s + (at * track.every) as f64 * samples.step_s;
        let mut row = vec![name.to_owned(), format!("{time_s:.4}")];
        if output.valid {
            let value = |k: usize| format!("{:.4} ± {:.4}", 1e6 * output.lambda_hat[k], 1e6 * output.lambda_std[k]);
            row.extend((0..3).map(value));
            row.push("yes".into());
        } else {
            row.extend(std::iter::repeat_n("–".to_owned(), 3));
            row.push(output.verdict.to_string());
        }
        Some(row)
    });
    Table {
        title: "On-line estimator over time, 10⁻⁶ N·m²/A²".into(),
        note: "± of noise alone. Values that drift from line to line are a bearing that changes.".into(),
        head: ["", "time, s", "λ1", "λ2", "λ3", "valid"].map(String::from).into(),
        rows: rows.collect(),
    }
}

/// The estimates over time, with columns named `method.variable`.
#[must_use]
pub fn recording(samples: &Samples, tracks: &[Track]) -> Recording {
    let every = tracks.first().map_or(1, |track| track.every);
    let time_s = (0..samples.len()).step_by(every).map(|j| samples.start_s + j as f64 * samples.step_s).collect();
    let mut columns = Vec::new();
    for track in tracks {
        let mut add = |name: &str, unit: &str, value: &dyn Fn(&EstimatorOutput) -> f64| {
            columns.push(Column {
                name: format!("{}.{name}", track.name),
                unit: unit.into(),
                values: track.outputs.iter().map(value).collect(),
            });
        };
        for k in 0..3 {
            add(&format!("lambdaHat[{}]", k + 1), "N.m2/A2", &|output| output.lambda_hat[k]);
        }
        for k in 0..3 {
            add(&format!("lambdaStd[{}]", k + 1), "N.m2/A2", &|output| output.lambda_std[k]);
        }
        add("valid", "", &|output| f64::from(u8::from(output.valid)));
        add("condition", "", &|output| output.condition);
        add("residual", "", &|output| output.residual);
        add("pYHat", "N", &|output| output.load_n[0]);
        add("pZHat", "N", &|output| output.load_n[1]);
        add("unbalance.magnitude", "kg.m", &|output| output.unbalance_kg_m[0]);
        add("unbalance.phase", "rad", &|output| output.unbalance_phase_rad[0]);
    }
    Recording { time_s, columns }
}

/// The result as JSON: the data, the stated values, and the last valid estimate of every method in SI units.
#[must_use]
pub fn json(samples: &Samples, tracks: &[Track]) -> Json {
    let method = |track: &Track| {
        let hold = HOLDS.iter().find(|(_, hold)| *hold == track.config.hold).map_or("", |(name, _)| name);
        let estimate = track.last_valid().map(|last| {
            json!({
                "lambdaHat": last.lambda_hat, "lambdaStd": last.lambda_std, "condition": last.condition,
                "residual": last.residual, "pYHat": last.load_n[0], "pZHat": last.load_n[1],
                "unbalance.magnitude": last.unbalance_kg_m[0], "unbalance.phase": last.unbalance_phase_rad[0],
                "noise.position": last.position_noise_m[0], "noise.current": last.current_noise_a[0],
                "lambdaStdTotal": last.lambda_std_total, "ki": last.ki, "ks": last.ks,
            })
        });
        json!({
            "method": track.name, "hold": hold, "Tf": track.config.window_s, "estimate": estimate,
            "validAtEnd": track.outputs.last().is_some_and(|output| output.valid), "verdict": track.verdict(),
        })
    };
    json!({
        "samples": samples.len(), "start": samples.start_s, "Ts": samples.step_s, "notes": samples.notes,
        "methods": tracks.iter().map(method).collect::<Vec<_>>(),
    })
}

/// The residuals of the three readings of a current as a table.
#[must_use]
pub fn table_of_holds(residuals: &[f64; 3], chosen: Hold) -> Table {
    let rows = HOLDS.iter().zip(residuals).map(|((name, hold), residual)| {
        let mark = if *hold == chosen { "chosen" } else { "" };
        vec![(*name).to_owned(), format!("{residual:.1}"), mark.to_owned()]
    });
    Table {
        title: "What a current sample stands for".into(),
        note: "How much less likely the same data are with each reading (differences of log-likelihoods).".into(),
        head: ["", "less likely by", ""].map(String::from).into(),
        rows: rows.collect(),
    }
}
