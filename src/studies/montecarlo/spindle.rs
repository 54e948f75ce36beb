//! A spindle over many seeds: first guesses that are wrong, any unbalance, and what correction masses leave.

use std::f64::consts::PI;
use std::path::Path;
use std::sync::Arc;

use super::cases::{self, Draw};
use super::{NOISE, Study, Vary, at_speed, real, study};
use crate::simulation::scenario::Scenario;
use fmu_export::variable::Value;

/// All studies of a spindle.
///
/// # Panics
/// Never: the scenarios come with the program.
#[must_use]
pub fn studies(runs: usize) -> Vec<Study> {
    let built_in = |name: &str| Scenario::open(Path::new(name)).expect("a scenario that comes with the program");
    let mut studies = Vec::new();
    for (told, says) in [(true, "noise known"), (false, "noise estimated")] {
        let mut add = |title: &str, set: &dyn Fn(&mut Scenario)| {
            let mut study = study(&format!("spindle: {title}, {says}"), &built_in("spindle"), NOISE, told, runs);
            set(&mut study.scenario);
            study.instants_s = vec![0.1, 0.2, 0.4];
            studies.push(Study { vary: vary(), ..study });
        };
        add("3000 rpm", &|_| ());
        add("3000 rpm, voltage drive", &cases::voltage_drive);
        for rpm in [1500.0, 6000.0] {
            add(&format!("{rpm} rpm"), &|scenario| at_speed(scenario, rpm));
        }
        add("at rest", &|scenario| {
            // The axial magnets are told apart by motion.
            let amplitude = Value::Real(real(scenario, "controller", "X.reference.amplitude"));
            cases::at_rest(scenario);
            scenario.set("controller", "X.reference.amplitude", amplitude);
        });
    }
    let scenario = built_in("balance");
    let instants_s = vec![scenario.balance_s.unwrap_or(scenario.duration_s)];
    let masses = study("spindle: correction masses", &scenario, NOISE, true, runs);
    studies.push(Study { scenario, instants_s, vary: vary(), ..masses });
    studies
}

/// The run of a seed: noise, unbalances from 30 to 100 g·mm at any angle, first guesses wrong by factors of 1.5 to 2.
fn vary() -> Vary {
    Arc::new(|scenario, seed, _| {
        let (mut scenario, mut draw) = (scenario.clone(), Draw::new(seed));
        scenario.set("plant", "sensor.seed", Value::Integer(seed as i32));
        for (bearing, k) in scenario.magnets() {
            let factor = draw.between(1.5, 2.0);
            let factor = if draw.chance(0.5) { factor } else { 1.0 / factor };
            let guess = real(&scenario, "plant", &format!("{bearing}lambda{k}")) * factor;
            for element in ["controller", "estimator"] {
                scenario.set(element, &format!("{bearing}lambda0{k}"), Value::Real(guess));
            }
        }
        for plane in [1, 2] {
            for (name, value) in [("magnitude", draw.between(3e-5, 1e-4)), ("phase", draw.between(-PI, PI))] {
                scenario.set("plant", &format!("unbalance[{plane}].{name}"), Value::Real(value));
            }
        }
        scenario
    })
}
