//! Shared by the benchmarks: recorded inputs of an estimator in the closed loop.

#![allow(dead_code, reason = "every benchmark takes what it needs")]

use std::path::Path;

use magnetic_bearing::estimation::EstimatorInput;
use magnetic_bearing::simulation::{Scenario, simulate};

/// Samples in a record: ten revolutions.
pub const RECORD: usize = 2000;

/// Ten revolutions of the unbalanced rotor with noise on all sensors, as inputs of its estimator, to be repeated.
pub fn record() -> Vec<EstimatorInput> {
    let mut scenario = Scenario::open(Path::new("unbalanced")).expect("a built-in scenario");
    scenario.elements.truncate(3);
    for (path, value) in [("plant.sensor.positionNoise", "0.1 µm"), ("plant.sensor.currentNoise", "10 mA")] {
        scenario.assign(path, value).expect("a variable of the plant");
    }
    // The record begins after the update of λ at 0.2 s, so that its end continues into its beginning.
    scenario.duration_s = 1.0;
    let run = simulate::run(&scenario).expect("a scenario that runs");
    let column = |name: &str| run.recording.get(name).expect("an output of the plant");
    let [y, z, theta, omega] = ["plant.Ym", "plant.Zm", "plant.theta", "plant.omegam"].map(column);
    let current = ["plant.im[1]", "plant.im[2]", "plant.im[3]"].map(column);
    let last = y.len() - RECORD;
    (last..y.len())
        .map(|j| EstimatorInput {
            position_m: [y[j], z[j]],
            current_a: current.map(|current| current[j]),
            theta_rad: theta[j],
            omega_rad_s: omega[j],
            enable: true,
            ..EstimatorInput::default()
        })
        .collect()
}
