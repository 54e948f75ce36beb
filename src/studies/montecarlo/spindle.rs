//! A spindle over many seeds: wrong first guesses, any unbalance, and the effect of correction masses.

use std::f64::consts::PI;

use super::cases::{self, Draw};
use super::{NOISE, NOISE_KNOWN, Study, at_speed, built_in, study};
use crate::simulation::Scenario;
use fmu_export::variable::Value;

/// All studies of a spindle.
///
/// # Panics
/// Never: the scenarios come with the program.
pub fn studies(runs: usize) -> Vec<Study> {
    let mut studies = Vec::new();
    for (noise_known, words) in NOISE_KNOWN {
        let mut add = |title: &str, set: &dyn Fn(&mut Scenario)| {
            let study = study(&format!("spindle: {title}, {words}"), &built_in("spindle"), NOISE, noise_known, runs);
            studies.push(study.at(&[0.1, 0.2, 0.4]).with(set).varied(vary));
        };
        add("3000 rpm", &|_| ());
        add("3000 rpm, voltage drive", &cases::voltage_drive);
        for rpm in [1500.0, 6000.0] {
            add(&format!("{rpm} rpm"), &|scenario| at_speed(scenario, rpm));
        }
        add("at rest", &|scenario| {
            // The axial magnets can be distinguished only in motion.
            let amplitude = Value::Real(scenario.number("controller", "X.reference.amplitude"));
            cases::at_rest(scenario);
            scenario.set("controller", "X.reference.amplitude", amplitude);
        });
    }
    let scenario = built_in("balance");
    let masses = study("spindle: correction masses", &scenario, NOISE, true, runs).varied(vary);
    let masses = masses.at(&[scenario.balance_s.unwrap_or(scenario.duration_s)]);
    studies.push(Study { scenario, ..masses });
    studies
}

/// Varies the run by its seed: unbalances from 30 to 100 g·mm at any angle, first guesses wrong by factors of 1.5 to 2.
fn vary(scenario: &mut Scenario, seed: u64, _: u64) {
    let mut draw = Draw::new(seed);
    for (first, lambda) in scenario.machine.of_magnets("lambda0").iter().zip(scenario.truth()) {
        let factor = draw.uniform(1.5, 2.0);
        let factor = if draw.chance(0.5) { factor } else { 1.0 / factor };
        scenario.set_everywhere(first, lambda * factor);
    }
    for plane in [1, 2] {
        scenario.set("plant", &format!("unbalance[{plane}].magnitude"), draw.uniform(3e-5, 1e-4));
        scenario.set("plant", &format!("unbalance[{plane}].phase"), draw.uniform(-PI, PI));
    }
}
