//! Choosing the excitation: how precisely λ is known after which time, with the reference trajectory alone and with the
//! smallest force modulated.
//!
//! The standard deviations are the Cramér–Rao bound of a run of the scenario; the estimator is within 10 % of it.

use crate::estimation::STD_LIMIT;
use crate::simulation::scenario::Scenario;
use crate::simulation::simulate::{self, Refused};
use crate::studies::montecarlo::bound::bound;
use crate::studies::montecarlo::{self, cases};
use crate::table::Table;
use fmu_export::variable::Value;

/// Instants to compare, in s.
pub const INSTANTS_S: [f64; 6] = [0.05, 0.1, 0.2, 0.5, 1.0, 2.0];

/// Modulation to compare: half of the smallest force at a frequency that is no harmonic of usual speeds.
pub const MODULATION: (f64, f64) = (0.5, 110.0);

/// Modulation is recommended if it improves the worst λ by this factor at the requested instant.
const WORTH: f64 = 1.25;

/// Parameters of the comparison.
#[derive(Clone, Debug)]
pub struct Conditions {
    /// Speed of the rotor, in revolutions per minute; 0 is a rotor at rest in the centre.
    pub rpm: f64,
    /// Sample time, in seconds; `None` takes that of the scenario.
    pub step_s: Option<f64>,
    /// Standard deviations of the noise, in m and A.
    pub noise: [f64; 2],
    /// When λ must be known, in seconds.
    pub instant_s: f64,
}

/// Standard deviations of one excitation, relative to λ, at [`INSTANTS_S`] and at the requested instant.
#[derive(Clone, Debug, PartialEq)]
pub struct Precision {
    /// Fraction of the smallest force that is modulated.
    pub modulation: f64,
    /// Instants, in s.
    pub instants_s: Vec<f64>,
    /// Relative standard deviations of the three λ at the instants.
    pub std: Vec<[f64; 3]>,
}

impl Precision {
    /// The worst λ at the requested instant.
    #[must_use]
    pub fn worst(&self) -> f64 {
        self.std.last().map_or(f64::INFINITY, |std| std.iter().copied().fold(0.0, f64::max))
    }
}

/// Results with the reference trajectory alone and with modulation, in this order.
///
/// # Errors
/// Every parameter that a model refuses, and every invalid condition.
pub fn design(scenario: &Scenario, conditions: &Conditions) -> Result<[Precision; 2], Refused> {
    let refuse =
        |name: &str, value: f64, wanted: &str| Refused(vec![format!("--{name} {value} is refused: expected {wanted}")]);
    if !(conditions.rpm.is_finite() && conditions.rpm >= 0.0) {
        return Err(refuse("speed", conditions.rpm, "a speed in rpm, 0 or above"));
    }
    if !(conditions.instant_s.is_finite() && conditions.instant_s > 0.0) {
        return Err(refuse("at", conditions.instant_s, "a time in s above 0"));
    }
    for (name, noise) in ["position-noise", "current-noise"].into_iter().zip(conditions.noise) {
        if !(noise.is_finite() && noise > 0.0) {
            return Err(refuse(name, noise, "a standard deviation above 0"));
        }
    }
    let mut scenario = montecarlo::study("", scenario, conditions.noise, true, 1).scenario;
    if let Some(step_s) = conditions.step_s {
        cases::sample_time(&mut scenario, step_s);
    }
    let window_s = scenario.closed_loop()?.estimator.window_s;
    montecarlo::at_speed(&mut scenario, conditions.rpm, window_s);
    if conditions.rpm == 0.0 {
        cases::at_rest(&mut scenario);
    }
    let mut instants_s = INSTANTS_S.to_vec();
    instants_s.push(conditions.instant_s);
    scenario.duration_s = instants_s.iter().copied().fold(0.0, f64::max);
    let precision = |modulation: f64| {
        let mut scenario = scenario.clone();
        scenario.set("controller", "F0.modulation", Value::Real(modulation));
        scenario.set("controller", "F0.modulationFrequency", Value::Real(MODULATION.1));
        let run = simulate::run(&scenario)?;
        if let Some(error) = run.error {
            return Err(Refused(vec![error]));
        }
        let std = bound(&scenario, &run.recording, &instants_s).unwrap_or_default();
        Ok(Precision { modulation, instants_s: instants_s.clone(), std })
    };
    Ok([precision(0.0)?, precision(MODULATION.0)?])
}

/// Whether modulation is recommended.
#[must_use]
pub fn is_modulation_recommended([alone, modulated]: &[Precision; 2]) -> bool {
    alone.worst() > WORTH * modulated.worst()
}

/// The recommendation in a sentence.
#[must_use]
pub fn advice(conditions: &Conditions, precisions: &[Precision; 2]) -> String {
    let [alone, modulated] = precisions;
    let recommended = is_modulation_recommended(precisions);
    let best = if recommended { modulated } else { alone };
    let first = if recommended {
        format!(
            "F0.modulation = {} at F0.modulationFrequency = {} Hz is recommended: after {} s the worst λ is known to {:.2} % instead \
             of {:.2} %.",
            MODULATION.0,
            MODULATION.1,
            conditions.instant_s,
            100.0 * modulated.worst(),
            100.0 * alone.worst()
        )
    } else {
        format!(
            "The reference trajectory excites enough: after {} s the worst λ is known to {:.2} %; modulation would make that {:.2} %.",
            conditions.instant_s,
            100.0 * alone.worst(),
            100.0 * modulated.worst()
        )
    };
    if best.worst() < STD_LIMIT {
        return first;
    }
    format!(
        "{first} The limit of a valid estimate is {:.0} %: more time, a larger reference trajectory or less noise is needed.",
        100.0 * STD_LIMIT
    )
}

/// The results as a table.
#[must_use]
pub fn table(conditions: &Conditions, precisions: &[Precision; 2]) -> Table {
    let rows = (0..precisions[0].std.len()).map(|at| {
        let std = |precision: &Precision| precision.std[at].map(|std| format!("{:.2}", 100.0 * std));
        let instant = format!("{} s", precisions[0].instants_s[at]);
        std::iter::once(instant).chain(precisions.iter().flat_map(std)).collect()
    });
    Table {
        title: format!(
            "Standard deviation of λ in %, at {} rpm with noise of {} µm and {} mA",
            conditions.rpm,
            (conditions.noise[0] * 1e9).round() / 1e3,
            (conditions.noise[1] * 1e6).round() / 1e3,
        ),
        note: format!(
            "Cramér–Rao bound with the reference trajectory alone and with F0 modulated by {:.0} % at {} Hz; the last row is the requested instant.",
            100.0 * MODULATION.0,
            MODULATION.1
        ),
        head: ["after", "λ1", "λ2", "λ3", "λ1 modulated", "λ2 modulated", "λ3 modulated"].map(String::from).into(),
        rows: rows.collect(),
    }
}
