//! The closed loop: two independent implementations agree bit for bit and reproduce the figures of the method.

use crate::prelude::*;
use magnetic_bearing::bearing::{RotorConfig, Used};
use magnetic_bearing::control::controller::{Controller, ControllerConfig, ControllerInput};
use magnetic_bearing::control::reference::{PathConfig, ReferenceConfig};
use magnetic_bearing::control::tracking::TrackingConfig;
use magnetic_bearing::estimation::{Estimator, EstimatorConfig, EstimatorInput, EstimatorState, Method};
use magnetic_bearing::plant::{Harmonic, InputTrajectory, Plant, PlantConfig, PlantInput, SensorConfig};

/// Values of an element of a scenario by name.
fn values<'s>(scenario: &'s Scenario, element: &'s str) -> impl Fn(&str) -> f64 {
    move |name| scenario.number(element, name)
}

fn rotor(of: &impl Fn(&str) -> f64) -> RotorConfig {
    let mut rotor = RotorConfig::of(&PLANAR);
    (rotor.shaft.m_kg, rotor.bearings[0].gap_m) = (of("m"), of("s"));
    rotor.bearings[0].alpha_rad[..3].copy_from_slice(&["alpha[1]", "alpha[2]", "alpha[3]"].map(of));
    rotor
}

/// The values that the scenarios set; the others are the defaults of the models.
fn plant_config(of: &impl Fn(&str) -> f64) -> PlantConfig {
    PlantConfig {
        rotor: rotor(of),
        lambda_nm2_a2: ["lambda[1]", "lambda[2]", "lambda[3]"].map(of),
        unbalance_kgm: [of("unbalance.magnitude"), 0.0],
        unbalance_phase_rad: [of("unbalance.phase"), 0.0],
        harmonic: Harmonic {
            amplitude_n: ["perturbation.amplitudeY", "perturbation.amplitudeZ"].map(of),
            omega_rad_s: of("perturbation.omega"),
            phase_rad: ["perturbation.phaseY", "perturbation.phaseZ"].map(of),
        },
        position_m: ["Y0", "Z0"].map(of),
        velocity_m_s: ["vY0", "vZ0"].map(of),
        sensor: SensorConfig {
            position_noise_m: of("sensor.positionNoise"),
            current_noise_a: of("sensor.currentNoise"),
            seed: of("sensor.seed") as i32,
            ..SensorConfig::default()
        },
        ..PlantConfig::default()
    }
}

fn controller_config(of: &impl Fn(&str) -> f64) -> ControllerConfig {
    let [r_y_m, r_z_m] = ["reference.rY", "reference.rZ"].map(of);
    ControllerConfig {
        used: Used::Both,
        law: TrackingConfig { modulation: of("F0.modulation"), ..TrackingConfig::default() },
        rotor: rotor(of),
        reference: ReferenceConfig {
            paths: [PathConfig { r_y_m, r_z_m, ..PathConfig::default() }],
            ..ReferenceConfig::of(&PLANAR)
        },
    }
}

fn estimator_config(of: &impl Fn(&str) -> f64) -> EstimatorConfig {
    EstimatorConfig {
        geometry: rotor(of),
        window_s: of("Tf"),
        epsilon_s: of("epsilon"),
        method: [Method::PaperLiteral, Method::Paper, Method::PredictionError][of("method") as usize - 1],
        ..EstimatorConfig::default()
    }
}

/// Compares signals of an element in one row with the recording, bit for bit; `?` stands for Y and Z, other names of several values get an index.
fn same(run: &Run, row: usize, element: &str, signals: &[(&str, &[f64])]) {
    for (name, values) in signals {
        for (k, value) in values.iter().enumerate() {
            let index = if values.len() > 1 && !name.contains('?') { format!("[{}]", k + 1) } else { String::new() };
            let name = format!("{element}.{}{index}", name.replace('?', ["Y", "Z", ""][k]));
            let recorded = column(run, &name)[row];
            let at_s = run.recording.time_s[row];
            let is_same = recorded.to_bits() == value.to_bits();
            assert!(is_same, "{name} at {at_s} s: instances {recorded:e}, models {value:e}");
        }
    }
}

fn same_estimate(run: &Run, row: usize, element: &str, state: &EstimatorState) {
    let output = state.output();
    let signals: &[(&str, &[f64])] = &[
        ("lambdaHat", &output.lambda_hat),
        ("lambdaRaw", &output.lambda_raw),
        ("lambdaStd", &output.lambda_std),
        ("lambdaStdTotal", &output.lambda_std_total),
        ("ki", &output.ki),
        ("ks", &output.ks),
        ("noise.position", &output.position_noise_m[..1]),
        ("noise.current", &output.current_noise_a[..1]),
        ("valid", &[f64::from(u8::from(output.valid))]),
        ("condition", &[output.condition]),
        ("residual", &[output.residual]),
        ("p?Hat", &output.load_n),
        ("unbalance.magnitude", &output.unbalance_kg_m[..1]),
        ("unbalance.phase", &output.unbalance_phase_rad[..1]),
    ];
    same(run, row, element, signals);
}

/// The models in a hand-written loop against the instances in the program's loop.
#[test]
fn models_and_instances_agree_bit_for_bit() {
    for name in ["paper", "unbalanced", "turned", "standstill"] {
        let (scenario, run) = scenario_and_run(name, &[]);
        let of = |element| values(&scenario, element);
        let plant = Plant::new(plant_config(&of("plant"))).expect("a plant");
        let controller = Controller::new(controller_config(&of("controller"))).expect("a controller");
        let beside = scenario.elements[2..].iter().map(|element| element.name.as_str());
        let estimators: Vec<_> =
            beside.map(|name| (name, Estimator::new(estimator_config(&of(name))).expect("an estimator"))).collect();

        let mut rotor = plant.start(0.0);
        let mut tracking = controller.start(0.0);
        let mut command = controller.output_at_start();
        let mut estimates: Vec<_> = estimators.iter().map(|(_, estimator)| estimator.start()).collect();
        let mut input = PlantInput {
            current_a: [0.0; 3],
            perturbation_n: ["pY", "pZ"].map(of("plant")),
            omega_rad_s: of("plant")("omega"),
            ..PlantInput::default()
        };
        let step_s = scenario.step_s;
        let steps = (scenario.duration_s / step_s).round() as usize;
        assert_eq!(run.recording.time_s.len(), steps + 1);
        for step in 0..=steps {
            let time_s = step as f64 * step_s;
            let at = plant.outputs(&rotor, &input, rotor.time_s);
            let of_plant: [(&str, &[f64]); 8] = [
                ("?", &rotor.motion.position_m),
                ("?m", &rotor.measured.position_m),
                ("im", &rotor.measured.current_a),
                ("theta", &[rotor.measured_theta_rad]),
                ("F", &at.force_n),
                ("F?", &at.resultant_n),
                ("gap", &at.gap_m),
                ("perturbation.?", &at.perturbation_n),
            ];
            let of_controller: [(&str, &[f64]); 5] = [
                ("i", &command.current_a),
                ("e?", &command.tracking_error_m),
                ("p?Hat", &command.perturbation_n),
                ("lambdaUsed", &command.lambda_used_nm2_a2),
                ("F?des", &command.force_n),
            ];
            same(&run, step, "plant", &of_plant);
            same(&run, step, "controller", &of_controller);
            for ((name, _), estimate) in estimators.iter().zip(&estimates) {
                same_estimate(&run, step, name, estimate);
            }

            // Each receives the present sample, the previous estimate and the previous command.
            let controller_input = ControllerInput {
                position_m: rotor.measured.position_m,
                lambda_hat_nm2_a2: estimates[0].output().lambda_hat,
                lambda_valid: estimates[0].output().valid,
                omega_rad_s: of("controller")("reference.omega"),
                ..ControllerInput::default()
            };
            let estimator_input = EstimatorInput {
                position_m: rotor.measured.position_m,
                current_a: rotor.measured.current_a,
                theta_rad: rotor.measured_theta_rad,
                omega_rad_s: input.omega_rad_s,
                enable: true,
                ..EstimatorInput::default()
            };
            input.current_a = command.current_a;
            plant.advance(&mut rotor, &InputTrajectory::held(&input), time_s, step_s).expect("the rotor in the gap");
            command = controller.sample(&mut tracking, &controller_input).expect("finite inputs");
            for ((_, estimator), estimate) in estimators.iter().zip(&mut estimates) {
                estimator.sample(estimate, &estimator_input);
            }
        }
    }
}

/// Limit in per cent for predictionError with the right hold and without noise: for any bearing, because none is hard-coded, and, from the
/// measurements of the method, with an unbalance of 20 N and a constant load.
const PREDICTION_ERROR_PERCENT: f64 = 0.005;

/// And with them the unbalance, which the paper's method attributes to the magnets.
#[test]
fn prediction_error_finds_the_force_constants() {
    for (name, instants_s) in [("turned", &[0.1, 0.2, 0.4][..]), ("unbalanced", &[0.1])] {
        let (scenario, run) = scenario_and_run(name, &[]);
        for at_s in instants_s {
            for error in lambda_errors(&scenario, &run, "predictionError", *at_s) {
                below(&format!("{name} at {at_s} s: error of λ, %"), 100.0 * error.abs(), PREDICTION_ERROR_PERCENT);
            }
        }
        if name == "unbalanced" {
            let errors = lambda_errors(&scenario, &run, "paper", 0.1);
            assert!(errors.iter().any(|error| error.abs() > 0.2), "the paper's method: {errors:?}");
            let names = ["unbalance.magnitude", "unbalance.phase"];
            let [magnitude, phase] = names.map(|name| column(&run, &format!("predictionError.{name}"))[row(&run, 0.1)]);
            let [true_magnitude, true_phase] = names.map(|name| scenario.number("plant", name));
            let error = 100.0 * (magnitude / true_magnitude - 1.0);
            below("error of the unbalance, in per cent", error.abs(), PREDICTION_ERROR_PERCENT);
            // The same relative error, tangential instead of radial.
            below("error of its phase", (phase - true_phase).abs(), PREDICTION_ERROR_PERCENT / 100.0);
        }
    }
}

/// Effect of the tracking error before the update on the estimates of the paper's method, in percentage points.
const TRACKING_POINTS: f64 = 0.7;

/// On the paper's scenario the paper's method has the error that the physics predicts.
///
/// A perturbation `p sin ωt` in phase with the reference `Z = r_Z sin ωt` looks like a force of the magnets. The magnets
/// exert `m Z̈ − p sin ωt = −(m ω² r_Z + p) sin ωt` and the motion shows `−m ω² r_Z sin ωt`, which scales all three
/// force constants by `m ω² r_Z/(m ω² r_Z + p)`: −4.14 % with p = 2 N. An error of 4 % is therefore out of reach for at
/// least one of them; the differences between the three come from the tracking error.
#[test]
fn the_papers_method_is_biased_by_a_perturbation_in_phase_with_the_motion() {
    let (scenario, run) = scenario_and_run("paper", &[]);
    let (plant, controller) = (values(&scenario, "plant"), values(&scenario, "controller"));
    let omega = controller("reference.omega");
    let force_n = plant("m") * omega * omega * controller("reference.rZ");
    let perturbation_n = plant("perturbation.amplitudeZ");
    let wanted = -100.0 * perturbation_n / (force_n + perturbation_n);
    for error in lambda_errors(&scenario, &run, "paper", 0.1).map(|error| 100.0 * error) {
        below(&format!("{error} % away from {wanted} %, in points"), (error - wanted).abs(), TRACKING_POINTS);
    }
}
