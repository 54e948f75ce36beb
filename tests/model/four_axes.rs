//! A shaft without an axial bearing, N = 4, in two radial bearings with three magnets each. No machine of the project has these sizes.

use crate::prelude::*;
use fmu_export::variable::Row;
use fmu_export::{Model, SampledModel};

fn names<D>(rows: Vec<Row<D>>) -> Vec<String> {
    rows.iter().map(|row| row.variable.name.to_string()).collect()
}

/// Fails if a variable of the axial bearing or the axial motion remains, or if another one is missing.
#[test]
fn variables_are_those_of_the_spindle_without_the_axial_ones() {
    let of_all = [
        (names(Plant::<5, 8, 3>::table()), names(Plant::<4, 6, 2>::table())),
        (names(Controller::<5, 8, 3, 3>::table()), names(Controller::<4, 6, 2, 2>::table())),
        (
            names(Estimator::<RotorConfig<f64, 3>, 5, 8, 2>::table()),
            names(Estimator::<RotorConfig<f64, 2>, 4, 6, 2>::table()),
        ),
    ];
    for (mut five, four) in of_all {
        five.retain(|name| !name.contains('X'));
        assert_eq!(five, four);
    }
}

/// From a first guess wrong by a factor of about two, with noise, unbalance, weight and load. The radial motion of a shaft with an axial
/// bearing is identical to the bit.
#[test]
fn all_six_force_constants_are_found_in_closed_loop() {
    let (mut config, mut beside) = (PlantConfigOf::<f64, 4, 6, 2>::default(), PlantConfigOf::<f64, 5, 8, 3>::default());
    (config.sensor.position_noise_m, config.sensor.current_noise_a) = (1e-7, 1e-2);
    (config.unbalance_kgm, config.unbalance_phase_rad) = ([8e-5, 5e-5], [0.7, -1.9]);
    (beside.unbalance_kgm, beside.unbalance_phase_rad) = (config.unbalance_kgm, config.unbalance_phase_rad);
    (config.gravity_m_s2, beside.gravity_m_s2) = ([0.3, -0.5, 0.0, 0.0], [0.0, 0.3, -0.5, 0.0, 0.0]);
    let (lambda, unbalance_kgm) = (config.lambda_nm2_a2, config.unbalance_kgm);
    let mut control = ControllerConfigOf::<4, 6, 2, 2>::default();
    (control.law.modulation, control.reference.paths[1].phase_rad) = (0.5, 1.2);
    control.reference.transition.ramp_s = 0.04;
    let (plant, beside) = (Plant::new(config).expect("a plant"), Plant::new(beside).expect("a plant"));
    let controller = Controller::new(control).expect("a controller");
    let estimator =
        Estimator::<_, 4, 6, 2>::new(EstimatorConfigOf::<RotorConfig<f64, 2>, 6>::default()).expect("an estimator");
    let (mut rotor, mut other, mut held) = (plant.start(0.0), beside.start(0.0), controller.start(0.0));
    let (mut estimate, omega_rad_s) = (estimator.start(), 314.0);
    let mut input = PlantInput { perturbation_n: [15.0, -20.0, 0.6, -0.9], omega_rad_s, ..Default::default() };
    let mut copy = PlantInput { perturbation_n: [0.0, 15.0, -20.0, 0.6, -0.9], omega_rad_s, ..Default::default() };
    for sample in 0..4000 {
        let mut measured = ControllerInput { position_m: rotor.measured.position_m, omega_rad_s, ..Default::default() };
        (measured.lambda_hat_nm2_a2, measured.lambda_valid) = (estimate.output().lambda_hat, estimate.output().valid);
        let command = controller.sample(&mut held, &measured).expect("a command");
        let (position_m, current_a) = (rotor.measured.position_m, rotor.measured.current_a);
        let mut seen = EstimatorInputOf { position_m, current_a, omega_rad_s, enable: true, ..Default::default() };
        seen.theta_rad = rotor.measured_theta_rad;
        estimator.sample(&mut estimate, &seen);
        plant.advance(&mut rotor, &InputTrajectory::held(&input), f64::from(sample) * STEP_S, STEP_S).expect("a step");
        beside.advance(&mut other, &InputTrajectory::held(&copy), f64::from(sample) * STEP_S, STEP_S).expect("a step");
        assert_eq!(rotor.motion.position_m, other.motion.position_m[1..], "sample {sample}");
        input.current_a = command.current_a;
        copy.current_a[..6].copy_from_slice(&input.current_a);
    }
    let found = estimate.output();
    assert!(found.valid, "{found:?}");
    for ((lambda, hat), std) in lambda.into_iter().zip(found.lambda_hat).zip(found.lambda_std) {
        below("error of λ in standard deviations", (hat - lambda).abs() / std, 4.0);
        below("standard deviation of λ, relative", std / lambda, 0.01);
    }
    for (found_kgm, kgm) in found.unbalance_kg_m.into_iter().zip(unbalance_kgm) {
        below("unbalance, kg·m", (found_kgm - kgm).abs(), 2e-6);
    }
}
