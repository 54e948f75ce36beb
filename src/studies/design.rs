//! Choice of the excitation: precision of λ over time, with the reference trajectory alone and with the smallest force modulated.
//!
//! Standard deviations are the Cramér–Rao bound of a run of the scenario; the estimator is within 10 % of it.

use crate::estimation::STD_LIMIT;
use crate::simulation::{Refused, Scenario, Stopped, simulate};
use crate::studies::montecarlo::bound::bound;
use crate::studies::montecarlo::{self, cases};
use crate::table::Table;

/// Instants to compare, in s.
pub const INSTANTS_S: [f64; 6] = [0.05, 0.1, 0.2, 0.5, 1.0, 2.0];

/// Modulation to compare: half of the smallest force, at a frequency in Hz that is no harmonic of usual speeds. If groups of magnets have
/// separate smallest forces, each keeps the frequency of the scenario.
pub const MODULATION: (f64, f64) = (0.5, 110.0);

/// Modulation is recommended if it improves the worst λ by this factor at the requested instant.
const WORTH: f64 = 1.25;

/// Parameters of the comparison.
#[derive(Clone, Debug)]
pub struct Conditions {
    /// Speed of the rotor, in rpm; 0 is a rotor at rest in the centre.
    pub rpm: f64,
    /// Sample time, in s; `None` is the sample time of the scenario.
    pub step_s: Option<f64>,
    /// Standard deviations of the noise, above 0, in m and A.
    pub noise: [f64; 2],
    /// When λ must be known, in s.
    pub instant_s: f64,
}

/// Standard deviations with one excitation, relative to λ, of the magnets in use, at [`INSTANTS_S`] and at the requested instant.
pub type Precision = Vec<Vec<f64>>;

/// The largest standard deviation; NaN counts as infinite.
fn worst<'s>(std: impl IntoIterator<Item = &'s f64>) -> f64 {
    std.into_iter().map(|std| if std.is_nan() { f64::INFINITY } else { *std }).fold(0.0, f64::max)
}

/// The largest standard deviation at the requested instant.
pub fn worst_in_the_end(precision: &Precision) -> f64 {
    precision.last().map_or(f64::INFINITY, worst)
}

/// The instants to compare, in s.
fn instants_s(conditions: &Conditions) -> Vec<f64> {
    [&INSTANTS_S[..], &[conditions.instant_s]].concat()
}

/// Results with the reference trajectory alone and with modulation, in this order.
///
/// # Errors
/// All parameters that a model refuses; an instant before the first sample; the reason why a run ended early.
pub fn design(scenario: &Scenario, conditions: &Conditions) -> Result<[Precision; 2], Stopped> {
    let mut scenario = montecarlo::study("", scenario, conditions.noise, true, 1).scenario;
    if let Some(step_s) = conditions.step_s {
        cases::sample_time(&mut scenario, step_s);
    }
    if conditions.instant_s < scenario.step_s * (1.0 - 1e-9) {
        let (at_s, step_s) = (conditions.instant_s, scenario.step_s);
        return Err(Refused(vec![format!("--at {at_s} is refused: expected at least one sample, {step_s} s")]).into());
    }
    montecarlo::at_speed(&mut scenario, conditions.rpm);
    if conditions.rpm == 0.0 {
        cases::at_rest(&mut scenario);
    }
    let instants_s = instants_s(conditions);
    scenario.duration_s = instants_s.iter().copied().fold(0.0, f64::max);
    let precision = |modulation: f64| {
        let mut scenario = scenario.clone();
        cases::modulation(&mut scenario, modulation, MODULATION.1);
        let run = simulate::run(&scenario)?;
        if let Some(error) = run.error {
            return Err(Stopped::Ended(format!("the run ended early: {error}")));
        }
        let std = bound(&scenario, &run.recording, &instants_s).unwrap_or_default();
        let of_used = |std: Vec<f64>| scenario.used().into_iter().map(|k| std[k]).collect();
        Ok(std.into_iter().map(of_used).collect())
    };
    Ok([precision(0.0)?, precision(MODULATION.0)?])
}

/// Whether modulation is recommended.
pub fn is_modulation_recommended([alone, modulated]: &[Precision; 2]) -> bool {
    worst_in_the_end(alone) > WORTH * worst_in_the_end(modulated)
}

/// Parameters of the modulation and their frequencies in Hz.
fn frequencies(scenario: &Scenario) -> Vec<(String, f64)> {
    let mut modulated = scenario.clone();
    cases::modulation(&mut modulated, MODULATION.0, MODULATION.1);
    let names = scenario.machine.of_groups("F0.modulationFrequency").into_iter();
    names.map(|name| (name.clone(), modulated.number("controller", &name))).collect()
}

/// The recommendation in a sentence.
pub fn advice(scenario: &Scenario, conditions: &Conditions, precisions: &[Precision; 2]) -> String {
    let [alone, modulated] = precisions;
    let recommended = is_modulation_recommended(precisions);
    let best = if recommended { modulated } else { alone };
    let is_sufficient = worst_in_the_end(best) < STD_LIMIT;
    let percent = |precision: &Precision| montecarlo::or_dash(100.0 * worst_in_the_end(precision), 2);
    let (at_s, [alone, modulated]) = (conditions.instant_s, [alone, modulated].map(percent));
    let first = if recommended {
        let frequencies: Vec<_> =
            frequencies(scenario).iter().map(|(name, frequency)| format!("{name} = {frequency} Hz")).collect();
        let (fraction, frequencies) = (MODULATION.0, frequencies.join(", "));
        format!(
            "F0.modulation = {fraction} at {frequencies} is recommended: after {at_s} s the worst λ is known to {modulated} % instead of {alone} %."
        )
    } else {
        let why = if is_sufficient { "The reference trajectory excites enough" } else { "Modulation does not suffice" };
        format!("{why}: after {at_s} s the worst λ is known to {alone} %; modulation would make that {modulated} %.")
    };
    if is_sufficient {
        return first;
    }
    format!(
        "{first} The limit of a valid estimate is {:.0} %: more time, a larger reference trajectory or less noise is needed.",
        100.0 * STD_LIMIT
    )
}

/// The results as a table, with a column for each λ, or, if there are several bearings, for the worst λ of each.
pub fn table(scenario: &Scenario, conditions: &Conditions, precisions: &[Precision; 2]) -> Table {
    let bearings = montecarlo::of_bearings(scenario);
    let all = |magnets: &[(String, usize)]| magnets.iter().map(|(_, at)| *at).collect();
    let columns: Vec<(String, Vec<usize>)> = match &bearings[..] {
        [(_, magnets)] => magnets.iter().map(|(name, at)| (name.clone(), vec![*at])).collect(),
        _ => bearings.iter().map(|(bearing, magnets)| (bearing.to_string(), all(magnets))).collect(),
    };
    let head = |modulated: &str| columns.iter().map(move |(name, _)| format!("{name}{modulated}")).collect::<Vec<_>>();
    let rows = instants_s(conditions).into_iter().zip(0..precisions[0].len()).map(|(instant_s, at)| {
        let std = |precision: &Precision| {
            let worst = |magnets: &[usize]| worst(magnets.iter().map(|k| &precision[at][*k]));
            columns.iter().map(|(_, magnets)| montecarlo::or_dash(100.0 * worst(magnets), 2)).collect::<Vec<_>>()
        };
        std::iter::once(format!("{instant_s} s")).chain(precisions.iter().flat_map(std)).collect()
    });
    let frequencies: Vec<_> = frequencies(scenario).iter().map(|(_, frequency)| frequency.to_string()).collect();
    let &Conditions { rpm, noise: [position_m, current_a], .. } = conditions;
    let (noise_um, noise_ma) = ((position_m * 1e9).round() / 1e3, (current_a * 1e6).round() / 1e3);
    let title = format!("Standard deviation of λ in %, at {rpm} rpm with noise of {noise_um} µm and {noise_ma} mA");
    let of = if bearings.len() > 1 { " of the worst λ of each bearing" } else { "" };
    let (percent, frequencies) = (100.0 * MODULATION.0, frequencies.join(", "));
    let note = format!(
        "Cramér–Rao bound{of} with the reference trajectory alone and with F0 modulated by {percent:.0} % at {frequencies} Hz; the last row is the requested instant."
    );
    Table::new(title, note, [vec!["after".to_owned()], head(""), head(" modulated")].concat(), rows)
}
