//! What the estimator says about its own error: over many seeds, in every scenario of a matrix, and when λ changes.

mod common;

use std::path::Path;

use common::{Bench, Said};
use magnetic_bearing::app::montecarlo::{self, NOISE};
use magnetic_bearing::app::scenario::Scenario;
use magnetic_bearing::slave::variable::Value;

/// While an estimate is valid its error is to stay below so many of its standard deviations.
const CONFIDENT: f64 = 5.0;

fn open(name: &str) -> Scenario {
    Scenario::open(Path::new(name)).expect("a scenario that comes with the program")
}

fn truth(scenario: &Scenario) -> [f64; 3] {
    [1, 2, 3].map(|k| scenario.value("plant", &format!("lambda[{k}]")).map_or(f64::NAN, Value::as_f64))
}

/// Greatest |error|/standard deviation while valid, and how often it was valid.
fn confidence(said: &[Said], truth: &[f64; 3]) -> (f64, usize) {
    let valid: Vec<&Said> = said.iter().filter(|said| said.valid).collect();
    let ratio = |said: &&Said| {
        (0..3).map(|k| ((said.hat[k] - truth[k]) / said.std[k]).abs()).fold(0.0, f64::max)
    };
    (valid.iter().map(ratio).fold(0.0, f64::max), valid.len())
}

/// What is set in the scenario, by element and variable.
type Settings = &'static [(&'static str, &'static str, f64)];

/// Scenarios: name, base, settings, whether an estimate is to be had in the end.
const MATRIX: [(&str, &str, Settings, Option<bool>); 13] = [
    ("as it is", "unbalanced", &[], Some(true)),
    ("heavy unbalance", "unbalanced", &[("plant", "unbalance.magnitude", 5e-4)], Some(true)),
    ("the paper's perturbation", "paper", &[], None),
    ("the paper's perturbation and unbalance", "paper", &[("plant", "unbalance.magnitude", 2e-4)], None),
    ("another bearing", "turned", &[("plant", "unbalance.magnitude", 1e-4)], Some(true)),
    ("window of 17.3 ms", "unbalanced", &[("estimator", "Tf", 0.0173), ("estimator", "epsilon", 0.0173)], Some(true)),
    ("window of 31.1 ms", "unbalanced", &[("estimator", "Tf", 0.0311), ("estimator", "epsilon", 0.0311)], Some(true)),
    ("window of 8 ms", "unbalanced", &[("estimator", "Tf", 0.008), ("estimator", "epsilon", 0.008)], None),
    (
        "circle",
        "unbalanced",
        &[("controller", "reference.rY", 5e-5), ("controller", "reference.rZ", 5e-5), ("plant", "Y0", 5e-5)],
        Some(false),
    ),
    (
        "rotor at rest",
        "unbalanced",
        &[
            ("plant", "omega", 0.0),
            ("plant", "Y0", 0.0),
            ("plant", "vZ0", 0.0),
            ("controller", "reference.omega", 0.0),
            ("controller", "reference.rY", 0.0),
            ("controller", "reference.rZ", 0.0),
        ],
        Some(false),
    ),
    ("wrong hold", "unbalanced", &[("estimator", "hold", 2.0)], None),
    ("wrong mass of the rotor's speed", "unbalanced", &[("plant", "perturbation.amplitudeY", 5.0)], None),
    ("slow perturbation", "unbalanced", &[("plant", "perturbation.amplitudeZ", 5.0), ("plant", "perturbation.omega", 30.0)], None),
];

#[test]
fn never_confident_and_wrong() {
    for method in [4, 3, 2] {
        for noise in [[0.0; 2], NOISE] {
            for told in [false, true] {
                if told && noise[0] == 0.0 {
                    continue;
                }
                for (name, base, settings, wanted) in MATRIX {
                    let mut scenario = montecarlo::study(name, &open(base), noise, told, 1).scenario;
                    for (element, variable, value) in settings {
                        let value = if *variable == "hold" { Value::Integer(*value as i32) } else { Value::Real(*value) };
                        scenario.set(element, variable, value);
                    }
                    scenario.set("estimator", "method", Value::Integer(method));
                    let said = Bench::new(&scenario).until(0.3, |_| ());
                    let (worst, valid) = confidence(&said, &truth(&scenario));
                    let last = said.last().expect("a run");
                    let errors: [f64; 3] = std::array::from_fn(|k| 100.0 * (last.hat[k] / truth(&scenario)[k] - 1.0));
                    let stds: [f64; 3] = std::array::from_fn(|k| 100.0 * last.std[k] / truth(&scenario)[k]);
                    println!("{}method {method} noise {noise:?} told {told} {name}: worst {worst:.1} valid {valid}/{} last {} {errors:.2?} ± {stds:.2?} cond {:.0} res {:.3}",
                        if worst > 5.0 { "XXX " } else { "" }, said.len(), last.valid, last.condition, last.residual);
                    let _ = wanted;
                    let bad: Vec<f64> = said.iter().filter(|s| s.valid && (0..3).any(|k| (s.hat[k] - truth(&scenario)[k]).abs() > CONFIDENT * s.std[k])).map(|s| s.time_s).collect();
                    if !bad.is_empty() { println!("method bad from {} to {} n {}", bad[0], bad[bad.len() - 1], bad.len()); }
                }
            }
        }
    }
}
