//! Choosing the excitation: how well λ can be known after which time, on the path alone and with the smallest force modulated.
//!
//! The standard deviations are the Cramér–Rao bound of a run of the scenario; the estimator comes within a tenth of it.

use crate::estimation::STD_LIMIT;
use crate::simulation::scenario::Scenario;
use crate::simulation::simulate::{self, Refused};
use crate::studies::montecarlo::bound::bound;
use crate::studies::montecarlo::{self, cases};
use crate::table::Table;
use fmu_export::variable::Value;

/// Instants that are compared, in s.
pub const INSTANTS_S: [f64; 6] = [0.05, 0.1, 0.2, 0.5, 1.0, 2.0];

/// Modulation that is compared: half of the smallest force at a frequency that is no harmonic of usual speeds.
pub const MODULATION: (f64, f64) = (0.5, 110.0);

/// Modulation is recommended if it makes the worst λ better by this factor at the instant asked for.
const WORTH: f64 = 1.25;

/// What is asked.
#[derive(Clone, Debug)]
pub struct Question {
    /// Speed of the rotor, in revolutions per minute; zero is a rotor at rest in the centre.
    pub rpm: f64,
    /// Sample time, in seconds; `None` takes that of the scenario.
    pub step_s: Option<f64>,
    /// Standard deviations of the noise, in m and A.
    pub noise: [f64; 2],
    /// When λ is to be known, in seconds.
    pub instant_s: f64,
}

/// What one excitation promises: standard deviations relative to λ at [`INSTANTS_S`] and at the instant asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Promise {
    /// Part of the smallest force that is modulated.
    pub modulation: f64,
    /// Instants, in s.
    pub instants_s: Vec<f64>,
    /// Relative standard deviations of the three λ at the instants.
    pub std: Vec<[f64; 3]>,
}

impl Promise {
    /// The worst λ at the instant asked for.
    #[must_use]
    pub fn worst(&self) -> f64 {
        self.std.last().map_or(f64::INFINITY, |std| std.iter().copied().fold(0.0, f64::max))
    }
}

/// Answers for the path alone and with modulation, in this order.
///
/// # Errors
/// Every parameter that a slave refuses, and what a question lacks.
pub fn design(scenario: &Scenario, question: &Question) -> Result<[Promise; 2], Refused> {
    let refuse = |name: &str, value: f64, wanted: &str| {
        Refused(vec![format!("{name} = {value} is refused: {wanted} is wanted")])
    };
    if !(question.rpm.is_finite() && question.rpm >= 0.0) {
        return Err(refuse("speed", question.rpm, "a speed in rpm, 0 or above,"));
    }
    if !(question.instant_s.is_finite() && question.instant_s > 0.0) {
        return Err(refuse("at", question.instant_s, "a time in s above 0"));
    }
    for (name, noise) in ["position-noise", "current-noise"].into_iter().zip(question.noise) {
        if !(noise.is_finite() && noise > 0.0) {
            return Err(refuse(name, noise, "a standard deviation above 0"));
        }
    }
    let mut scenario = montecarlo::study("", scenario, question.noise, true, 1).scenario;
    if let Some(step_s) = question.step_s {
        cases::sample_time(&mut scenario, step_s);
    }
    let window_s = scenario.closed_loop()?.estimator.window_s;
    montecarlo::at_speed(&mut scenario, question.rpm, window_s);
    if question.rpm == 0.0 {
        cases::at_rest(&mut scenario);
    }
    let mut instants_s = INSTANTS_S.to_vec();
    instants_s.push(question.instant_s);
    scenario.duration_s = instants_s.iter().copied().fold(0.0, f64::max);
    let promise = |modulation: f64| {
        let mut scenario = scenario.clone();
        scenario.set("controller", "F0.modulation", Value::Real(modulation));
        scenario.set("controller", "F0.modulationFrequency", Value::Real(MODULATION.1));
        let run = simulate::run(&scenario)?;
        if let Some(fault) = run.fault {
            return Err(Refused(vec![fault]));
        }
        let std = bound(&scenario, &run.recording, &instants_s).unwrap_or_default();
        Ok(Promise { modulation, instants_s: instants_s.clone(), std })
    };
    Ok([promise(0.0)?, promise(MODULATION.0)?])
}

/// Whether modulation is worth it.
#[must_use]
pub fn is_modulation_recommended([alone, modulated]: &[Promise; 2]) -> bool {
    alone.worst() > WORTH * modulated.worst()
}

/// What to do, in a sentence.
#[must_use]
pub fn advice(question: &Question, promises: &[Promise; 2]) -> String {
    let [alone, modulated] = promises;
    let recommended = is_modulation_recommended(promises);
    let best = if recommended { modulated } else { alone };
    let first = if recommended {
        format!(
            "F0.modulation = {} at F0.modulationFrequency = {} Hz is recommended: after {} s the worst λ is known to {:.2} % instead \
             of {:.2} %.",
            MODULATION.0,
            MODULATION.1,
            question.instant_s,
            100.0 * modulated.worst(),
            100.0 * alone.worst()
        )
    } else {
        format!(
            "The path excites enough: after {} s the worst λ is known to {:.2} %; modulation would make that {:.2} %.",
            question.instant_s,
            100.0 * alone.worst(),
            100.0 * modulated.worst()
        )
    };
    if best.worst() < STD_LIMIT {
        return first;
    }
    format!(
        "{first} The limit of a valid estimate is {:.0} %: more time, a larger path or less noise is needed.",
        100.0 * STD_LIMIT
    )
}

/// The answers as a table.
#[must_use]
pub fn table(question: &Question, promises: &[Promise; 2]) -> Table {
    let rows = (0..promises[0].std.len()).map(|at| {
        let std = |promise: &Promise| promise.std[at].map(|std| format!("{:.2}", 100.0 * std));
        let instant = format!("{} s", promises[0].instants_s[at]);
        std::iter::once(instant).chain(promises.iter().flat_map(std)).collect()
    });
    Table {
        title: format!(
            "Standard deviation of λ in %, at {} rpm with noise of {} µm and {} mA",
            question.rpm,
            (question.noise[0] * 1e9).round() / 1e3,
            (question.noise[1] * 1e6).round() / 1e3,
        ),
        note: format!(
            "Cramér–Rao bound on the path alone and with F0 modulated by {:.0} % at {} Hz; the last row is the instant asked for.",
            100.0 * MODULATION.0,
            MODULATION.1
        ),
        head: ["after", "λ1", "λ2", "λ3", "λ1 modulated", "λ2 modulated", "λ3 modulated"].map(String::from).into(),
        rows: rows.collect(),
    }
}
