//! A shaft without an axial bearing, N = 4: two radial bearings with three magnets each. No machine of the project has these sizes.

use crate::support::below;
use fmu_export::variable::Row;
use fmu_export::{Model, SampledModel};
use magnetic_bearing::control::controller::{Controller, ControllerInputOf};
use magnetic_bearing::control::spindle::SpindleControllerConfigOf;
use magnetic_bearing::estimation::spindle::SpindleEstimatorConfigOf;
use magnetic_bearing::estimation::{Estimator, EstimatorInputOf};
use magnetic_bearing::fmu::{controller, estimator, spindle};
use magnetic_bearing::plant::spindle::{SpindleConfig, SpindleConfigOf};
use magnetic_bearing::plant::{Plant, PlantInput, SensorConfig};

const OMEGA_RAD_S: f64 = 100.0 * std::f64::consts::PI;
const STEP_S: f64 = 1e-4;

fn names<D>(rows: Vec<Row<D>>) -> Vec<String> {
    rows.iter().map(|row| row.variable.name.to_string()).collect()
}

/// Fails if a variable of the axial bearing or of the axial motion is left, or another one is not there.
#[test]
fn variables_are_those_with_an_axial_bearing_but_for_the_axial_ones() {
    let of_all = [
        (names(spindle::Plant::<5, 3, 8>::table()), names(spindle::Plant::<4, 3, 6>::table())),
        (names(controller::Spindle::<5, 3, 8, 3>::table()), names(controller::Spindle::<4, 3, 6, 2>::table())),
        (names(estimator::Spindle::<5, 3, 8>::table()), names(estimator::Spindle::<4, 3, 6>::table())),
    ];
    for (mut five, four) in of_all {
        five.retain(|name| !name.contains('X'));
        assert_eq!(five, four);
    }
}

/// From a first guess wrong by a factor of about two, with noise, unbalance and load. Fails if the parts of the motion, the shares of a force or
/// the places of magnets and readings are those of five axes; beside it a shaft with an axial bearing moves across itself as this one.
#[test]
fn all_six_force_constants_are_found_in_closed_loop() {
    let sensor = SensorConfig { position_noise_m: 1e-7, current_noise_a: 1e-2, seed: 1, ..SensorConfig::default() };
    let (unbalance_kgm, unbalance_phase_rad) = ([8e-5, 5e-5], [0.7, -1.9]);
    let gravity_m_s2 = [0.3, -0.5, 0.0];
    let config = SpindleConfigOf::<f64, 4, 3, 6> {
        unbalance_kgm,
        unbalance_phase_rad,
        gravity_m_s2,
        sensor,
        ..Default::default()
    };
    let with_axial =
        SpindleConfig { unbalance_kgm, unbalance_phase_rad, gravity_m_s2: [0.0, 0.3, -0.5], ..Default::default() };
    let truth = config.lambda_nm2_a2;
    let mut law = SpindleControllerConfigOf::<4, 3, 6, 2>::default();
    (law.law.modulation, law.path.b.phase_rad, law.path.transition.ramp_s) = (0.5, 1.2, 0.04);
    let plant = Plant::new(config).expect("a plant");
    let twin = Plant::new(with_axial).expect("a plant");
    let controller = Controller::new(law).expect("a controller");
    let estimator = Estimator::new(SpindleEstimatorConfigOf::<4, 3, 6>::default()).expect("an estimator");
    let (mut rotor, mut other) = (plant.start(0.0), twin.start(0.0));
    let (mut held, mut estimate) = (controller.start(0.0), estimator.start());
    let mut input =
        PlantInput { perturbation_n: [15.0, -20.0, 0.6, -0.9], omega_rad_s: OMEGA_RAD_S, ..Default::default() };
    let mut used = [0.0; 6];
    for sample in 0..4000 {
        let (position_m, current_a) = (rotor.measured.position_m, rotor.measured.current_a);
        let (theta_rad, omega_rad_s, enable) = (rotor.measured.theta_rad, OMEGA_RAD_S, true);
        let known = estimate.output().clone();
        let (lambda_hat_nm2_a2, lambda_valid) = (known.lambda_hat, known.valid);
        let measured = ControllerInputOf {
            omega_rad_s,
            position_m,
            current_a,
            lambda_hat_nm2_a2,
            lambda_valid,
            ..Default::default()
        };
        let command = controller.sample(&mut held, &measured).expect("a command");
        estimator.sample(
            &mut estimate,
            &EstimatorInputOf { position_m, current_a, theta_rad, omega_rad_s, enable, ..Default::default() },
        );
        let across = |x: f64, [y, z, beta, gamma]: [f64; 4]| [x, y, z, beta, gamma];
        let beside = PlantInput {
            current_a: std::array::from_fn(|k| input.current_a.get(k).copied().unwrap_or_default()),
            perturbation_n: across(0.0, input.perturbation_n),
            ..PlantInput { omega_rad_s, ..Default::default() }
        };
        plant.advance(&mut rotor, &input, f64::from(sample) * STEP_S, STEP_S).expect("a step");
        twin.advance(&mut other, &beside, f64::from(sample) * STEP_S, STEP_S).expect("a step");
        assert_eq!(across(other.position_m[0], rotor.position_m), other.position_m, "sample {sample}");
        (input.current_a, used) = (command.current_a, command.lambda_used_nm2_a2);
    }
    let found = estimate.output();
    assert!(found.valid && used != [4e-6; 6], "{found:?}");
    for k in 0..6 {
        below("error of λ in standard deviations", (found.lambda_hat[k] - truth[k]).abs() / found.lambda_std[k], 4.0);
        below("standard deviation of λ, relative", found.lambda_std[k] / truth[k], 0.01);
    }
    for plane in 0..2 {
        below("unbalance, kg·m", (found.unbalance_kg_m[plane] - unbalance_kgm[plane]).abs(), 2e-6);
    }
}
