//! The controller: gains, closed loop with the plant, update of λ, refusals.

mod modulation;
mod update;

use std::f64::consts::{PI, TAU};

use magnetic_bearing::bearing::coil::Drive;
use magnetic_bearing::control::controller::{
    Controller, ControllerConfig, ControllerError, ControllerInput, ControllerOutput, ControllerState, UpdateMode,
    ramp_gains, tracking_gains,
};
use magnetic_bearing::control::reference::{ReferenceConfig, Shape};
use magnetic_bearing::control::tracking::TrackingConfig;
use magnetic_bearing::plant::{Harmonic, Plant, PlantConfig, PlantInput, SensorConfig};

/// Relative error of gains and poles: a few roundings.
const ROUNDING: f64 = 1e-12;

/// One claim about a number; a miss prints the value and the limit.
fn below(what: &str, value: f64, limit: f64) {
    assert!(value <= limit, "{what}: {value:e} is above the limit {limit:e}");
}

fn between(what: &str, value: f64, low: f64, high: f64) {
    assert!((low..=high).contains(&value), "{what}: {value:e} is outside {low:e} to {high:e}");
}

/// The plant and the controller, one sample of delay between measurement and current.
#[derive(Clone)]
struct Loop {
    plant: PlantConfig,
    controller: ControllerConfig,
    /// Constant perturbation, (y, z), in N.
    load_n: [f64; 2],
    /// Estimate of λ given to the controller, valid from `valid_s` on.
    lambda_hat: [f64; 3],
    /// The estimate at a sample.
    lambda_at: fn([f64; 3], usize) -> [f64; 3],
    valid_s: f64,
    duration_s: f64,
}

/// Results of one sample of the loop.
struct Record {
    t_s: f64,
    output: ControllerOutput,
    /// True position minus reference, in m.
    error_m: [f64; 2],
    /// Currents that flowed until the sample, in A.
    measured_a: [f64; 3],
}

impl Loop {
    /// The paper's scenario with the load of method section 7: 10 N and 2 N at 50 Hz on both axes.
    fn paper() -> Self {
        let plant = PlantConfig {
            harmonic: Harmonic { amplitude_n: [2.0, 2.0], ..Harmonic::default() },
            ..PlantConfig::default()
        };
        Self {
            lambda_hat: plant.lambda_nm2_a2,
            plant,
            controller: ControllerConfig::default(),
            load_n: [10.0, 10.0],
            lambda_at: |lambda, _| lambda,
            valid_s: 0.0,
            duration_s: 0.4,
        }
    }

    /// Another rotor, other gaps, angles, magnets and speed.
    fn other_bearing() -> Self {
        let omega_rad_s = TAU * 63.0;
        let gap_m = 4e-4;
        let alpha_rad = [PI + 0.15, -PI / 3.0 + 0.15, PI / 3.0 + 0.15];
        let lambda = [3.1e-6, 2.7e-6, 2.4e-6];
        let mut case = Self::paper();
        case.plant.m_kg = 3.4;
        case.plant.gap_m = gap_m;
        case.plant.alpha_rad = alpha_rad;
        case.plant.lambda_nm2_a2 = lambda;
        case.plant.velocity_m_s = [0.0, 70e-6 * omega_rad_s];
        case.plant.harmonic.omega_rad_s = omega_rad_s;
        case.controller.m_kg = 3.4;
        case.controller.gap_m = gap_m;
        case.controller.alpha_rad = alpha_rad;
        case.controller.reference.omega_rad_s = omega_rad_s;
        case.lambda_hat = lambda;
        case
    }

    /// A rotor at rest in the centre under a load of 60 N, λ known, the smallest force modulated by half at 110 Hz.
    fn at_rest() -> Self {
        let mut case = Self::paper();
        case.plant.harmonic.amplitude_n = [0.0; 2];
        case.plant.position_m = [0.0; 2];
        case.plant.velocity_m_s = [0.0; 2];
        case.controller.law.lambda0_nm2_a2 = case.plant.lambda_nm2_a2;
        case.controller.law.modulation = 0.5;
        (case.controller.reference.r_y_m, case.controller.reference.r_z_m) = (0.0, 0.0);
        case.load_n = [0.0, -60.0];
        case
    }

    fn with_voltage(mut self) -> Self {
        self.plant.coil.drive = Drive::Voltage;
        self.controller.law.coil.drive = Drive::Voltage;
        self
    }

    fn at_step(mut self, step_s: f64) -> Self {
        self.plant.sensor.step_s = step_s;
        self.controller.law.step_s = step_s;
        self
    }

    fn run(&self) -> Vec<Record> {
        let plant = Plant::new(self.plant.clone()).expect("plant");
        let controller = Controller::new(self.controller.clone()).expect("controller");
        let step_s = self.controller.law.step_s;
        let mut x = plant.start(0.0);
        let mut c = controller.start(0.0);
        let mut commanded = ([0.0; 3], [0.0; 3]);
        let samples = (self.duration_s / step_s).round() as usize;
        let mut records = Vec::new();
        for k in 0..samples {
            let t_s = k as f64 * step_s;
            let input = ControllerInput {
                current_a: x.measured.current_a,
                position_m: x.measured.position_m,
                lambda_hat_nm2_a2: (self.lambda_at)(self.lambda_hat, k),
                lambda_valid: t_s >= self.valid_s,
                reference_m: [0.0; 2],
                omega_rad_s: self.controller.reference.omega_rad_s,
            };
            let output = controller.sample(&mut c, &input).expect("sample");
            assert!(!output.saturated, "saturated at t = {t_s}");
            records.push(Record {
                t_s,
                error_m: std::array::from_fn(|a| x.position_m[a] - output.reference_m[a]),
                measured_a: x.measured.current_a,
                output: output.clone(),
            });
            let (current_a, voltage_v) = std::mem::replace(&mut commanded, (output.current_a, output.voltage_v));
            let input = PlantInput { current_a, voltage_v, perturbation_n: self.load_n, omega_rad_s: TAU * 50.0 };
            plant.advance(&mut x, &input, t_s, step_s).expect("advance");
        }
        records
    }
}

/// Largest of `|of|` over the samples with t in `[from, to)`.
fn largest(records: &[Record], from: f64, to: f64, of: impl Fn(&Record) -> f64) -> f64 {
    records.iter().filter(|r| (from..to).contains(&r.t_s)).map(|r| of(r).abs()).fold(0.0, f64::max)
}

/// Largest minus smallest of `of` over the samples with t in `[from, to)`.
fn peak_to_peak(records: &[Record], from: f64, to: f64, of: impl Fn(&Record) -> f64) -> f64 {
    let values = records.iter().filter(|r| (from..to).contains(&r.t_s)).map(of);
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    high - low
}

/// Figures of a run before the update at 0.2 s and after it: in m and N, (y, z).
struct Figures {
    error_before_m: [f64; 2],
    error_after_m: [f64; 2],
    perturbation_before_n: [f64; 2],
    perturbation_after_n: [f64; 2],
}

fn figures(records: &[Record]) -> Figures {
    let error = |from, to| [0, 1].map(|a| largest(records, from, to, |r| r.error_m[a]));
    let swings = |from, to| [0, 1].map(|a| peak_to_peak(records, from, to, |r| r.output.perturbation_n[a]));
    Figures {
        error_before_m: error(0.1, 0.2),
        error_after_m: error(0.3, 0.4),
        perturbation_before_n: swings(0.1, 0.2),
        perturbation_after_n: swings(0.3, 0.4),
    }
}

#[test]
fn the_gains_have_their_poles_where_they_are_wanted() {
    for (bandwidth, step) in [(1000.0, 1e-4), (1000.0, 2e-4), (30.0, 1e-4), (5000.0, 1e-3)] {
        let [k_0, k_1] = tracking_gains(bandwidth, step);
        let rho = (-bandwidth * step).exp();
        // [e, T ė] under the acceleration −k_0 e − k_1 ė held over T.
        let (a, b) = (k_0 * step * step, k_1 * step);
        let (m_11, m_12, m_21, m_22) = (1.0 - a / 2.0, 1.0 - b / 2.0, -a, 1.0 - b);
        below("trace", (m_11 + m_22 - 2.0 * rho).abs(), ROUNDING);
        below("determinant", (m_11 * m_22 - m_12 * m_21 - rho * rho).abs(), ROUNDING);
    }
}

/// The figures of method section 7: 1.5 µm and 3.4 µm before the update, 0.2 µm after it, p̂_z from 107 N to
/// 4 N peak to peak. The limits leave 20 % for the load, which that section does not state.
#[test]
fn the_loop_reproduces_the_figures_of_the_method() {
    let f = figures(&Loop::paper().run());
    between("error in y before, m", f.error_before_m[0], 1.2e-6, 1.8e-6);
    between("error in z before, m", f.error_before_m[1], 2.7e-6, 4.1e-6);
    for a in 0..2 {
        below("error after, m", f.error_after_m[a], 0.2e-6);
        // The harmonic itself has 4 N peak to peak.
        between("peak-to-peak perturbation after, N", f.perturbation_after_n[a], 3.8, 4.2);
    }
    between("peak-to-peak p̂_z before, N", f.perturbation_before_n[1], 86.0, 128.0);

    let mut case = Loop::paper();
    case.plant.harmonic.amplitude_n = [0.0, 2.0];
    case.load_n = [10.0, -20.0];
    let f = figures(&case.run());
    between("error in z before, load down, m", f.error_before_m[1], 3.2e-6, 3.7e-6);
    between("peak-to-peak p̂_z before, load down, N", f.perturbation_before_n[1], 104.0, 110.0);
}

/// Other sample times, and a bearing that shares no number with the paper's.
#[test]
fn the_loop_holds_at_other_steps_and_for_another_bearing() {
    // Limits of the error before and after in µm, (y, z): measured values and a quarter more.
    let cases = [
        ("50 µs", Loop::paper().at_step(5e-5), [1.5, 4.5], [0.15, 0.15]),
        ("200 µs", Loop::paper().at_step(2e-4), [2.2, 6.6], [0.21, 0.19]),
        ("other", Loop::other_bearing(), [2.3, 3.3], [0.37, 0.36]),
        ("other, 50 µs", Loop::other_bearing().at_step(5e-5), [2.3, 3.3], [0.37, 0.36]),
    ];
    for (name, case, before_um, after_um) in cases {
        let f = figures(&case.run());
        for a in 0..2 {
            below(&format!("{name}: error before, m"), f.error_before_m[a], 1e-6 * before_um[a]);
            below(&format!("{name}: error after, m"), f.error_after_m[a], 1e-6 * after_um[a]);
            between(&format!("{name}: peak-to-peak perturbation after, N"), f.perturbation_after_n[a], 3.8, 4.2);
            let ratio = f.perturbation_before_n[a] / f.perturbation_after_n[a];
            between(&format!("{name}: peak-to-peak perturbation before over after"), ratio, 3.0, 100.0);
        }
    }
}

#[test]
fn with_true_lambda_only_the_hold_remains() {
    /// Error, in m, that a current held over 0.1 ms leaves on an orbit of 70 µm at 50 Hz.
    const HOLD_M: f64 = 4e-9;
    let mut case = Loop::paper();
    case.controller.law.lambda0_nm2_a2 = case.plant.lambda_nm2_a2;
    case.plant.harmonic.amplitude_n = [0.0; 2];
    let records = case.run();
    for a in 0..2 {
        below("error, m", largest(&records, 0.05, 0.4, |r| r.error_m[a]), HOLD_M);
        let off = largest(&records, 0.05, 0.4, |r| r.output.perturbation_n[a] - 10.0);
        below("perturbation against the load, N", off, 0.01);
    }
}

#[test]
fn lobes_are_followed() {
    let mut case = Loop::paper();
    case.controller.law.lambda0_nm2_a2 = case.plant.lambda_nm2_a2;
    case.plant.harmonic.amplitude_n = [0.0; 2];
    case.controller.reference =
        ReferenceConfig { shape: Shape::Lobes, lobe_amplitude_m: 5e-6, ..ReferenceConfig::default() };
    let records = case.run();
    for a in 0..2 {
        below("error, m", largest(&records, 0.05, 0.4, |r| r.error_m[a]), 30e-9);
    }
}

#[test]
fn sensor_noise_costs_little() {
    let mut case = Loop::paper();
    case.plant.sensor = SensorConfig { position_noise_m: 1e-7, seed: 5, ..SensorConfig::default() };
    let f = figures(&case.run());
    // 0.4 µm in method section 7.
    for a in 0..2 {
        below("error after with 0.1 µm of noise, m", f.error_after_m[a], 0.4e-6);
    }
}

/// A rotor at rest away from the reference, with an estimate of λ.
fn still() -> ControllerInput {
    ControllerInput {
        current_a: [0.0; 3],
        position_m: [20e-6, 10e-6],
        lambda_hat_nm2_a2: [1.8e-6, 2.0e-6, 2.2e-6],
        lambda_valid: false,
        reference_m: [0.0; 2],
        omega_rad_s: TAU * 50.0,
    }
}

#[test]
fn before_the_first_command_no_force_is_under_way() {
    // A rotor that falls freely under 67 N from t = 0: without current in the first interval, the observer must
    // see half of g·T² at sample 1 as perturbation, not as answer to its own force.
    let config = ControllerConfig {
        reference: ReferenceConfig { r_z_m: 0.0, r_y_m: 0.0, ..ReferenceConfig::default() },
        ..ControllerConfig::default()
    };
    let controller = Controller::new(config).expect("controller");
    let mut state = controller.start(0.0);
    let at = |z| ControllerInput { position_m: [0.0, z], ..still() };
    let first = controller.sample(&mut state, &at(0.0)).expect("sample");
    assert_eq!(first.perturbation_n, [0.0; 2]);
    assert_eq!(first.force_n, [0.0; 2]);
    assert_eq!(first.tracking_error_m, [0.0; 2]);
    // The preload alone: 20 N at every magnet.
    for current in first.current_a {
        below("current for 20 N, A", (current - 5e-4 * (20.0f64 / 4e-6).sqrt()).abs(), 1e-12);
    }
    // With no force expected, a rotor that has not moved shows no perturbation either.
    let second = controller.sample(&mut state, &at(0.0)).expect("sample");
    assert_eq!(second.perturbation_n, [0.0; 2]);
    let third = controller.sample(&mut state, &at(-10.0 / 2.0 * 1e-8)).expect("sample");
    assert!(third.perturbation_n[1] < 0.0 && third.force_n[1] > 0.0, "{third:?}");
}

#[test]
fn an_external_reference_is_followed() {
    /// Error, in m, from the lag of the acceleration found; measured 0.45 µm. The ellipse known from within costs 4 nm.
    const EXTERNAL_M: f64 = 0.6e-6;
    let config = ControllerConfig {
        law: TrackingConfig { lambda0_nm2_a2: PlantConfig::default().lambda_nm2_a2, ..TrackingConfig::default() },
        reference: ReferenceConfig { shape: Shape::External, bandwidth_rad_s: 4000.0, ..ReferenceConfig::default() },
        ..ControllerConfig::default()
    };
    let controller = Controller::new(config).expect("controller");
    let plant = Plant::new(PlantConfig::default()).expect("plant");
    let mut x = plant.start(0.0);
    let mut c = controller.start(0.0);
    let mut commanded_a = [0.0; 3];
    let mut worst = 0.0f64;
    for k in 0..3000 {
        let t_s = f64::from(k) * 1e-4;
        let angle = TAU * 50.0 * t_s;
        let reference_m = [30e-6 * angle.cos(), 70e-6 * angle.sin()];
        let input = ControllerInput { position_m: x.measured.position_m, reference_m, ..still() };
        let output = controller.sample(&mut c, &input).expect("sample");
        assert_eq!(output.reference_m, reference_m);
        if t_s > 0.1 {
            worst = worst.max(output.tracking_error_m[0].abs()).max(output.tracking_error_m[1].abs());
        }
        let held_a = std::mem::replace(&mut commanded_a, output.current_a);
        let input = PlantInput { current_a: held_a, ..PlantInput::default() };
        plant.advance(&mut x, &input, t_s, 1e-4).expect("advance");
    }
    below("error, m", worst, EXTERNAL_M);
}

#[test]
fn what_is_not_finite_is_refused_and_changes_nothing() {
    let controller = Controller::new(ControllerConfig::default()).expect("controller");
    let mut state = controller.start(0.0);
    controller.sample(&mut state, &still()).expect("sample");
    let before = state.clone();
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let cases = [
            ("Ym", ControllerInput { position_m: [bad, 0.0], ..still() }),
            ("Zm", ControllerInput { position_m: [0.0, bad], ..still() }),
            ("reference.omega", ControllerInput { omega_rad_s: bad, ..still() }),
        ];
        for (wanted, input) in cases {
            match controller.sample(&mut state, &input) {
                Err(ControllerError::Input { name, .. }) => assert_eq!(name, wanted),
                other => panic!("{wanted} = {bad}: {other:?}"),
            }
            assert_eq!(state, before);
        }
    }
    let huge = ControllerInput { position_m: [1e300, 1e308], ..still() };
    assert_eq!(controller.sample(&mut state, &huge), Err(ControllerError::Overflow { sample: 1 }));
    assert_eq!(state, before);
    // A reference that is not used may be NaN.
    controller.sample(&mut state, &ControllerInput { reference_m: [f64::NAN; 2], ..still() }).expect("sample");
    assert_eq!(state.clone(), state, "no NaN got into the state");

    let external = ReferenceConfig { shape: Shape::External, ..ReferenceConfig::default() };
    let controller =
        Controller::new(ControllerConfig { reference: external, ..ControllerConfig::default() }).expect("controller");
    let mut state = controller.start(0.0);
    let result = controller.sample(&mut state, &ControllerInput { reference_m: [0.0, f64::NAN], ..still() });
    assert!(matches!(result, Err(ControllerError::Input { ref name, .. }) if name == "Zref"), "{result:?}");
}

#[test]
fn a_rotor_beyond_the_magnets_saturates_and_says_so() {
    let controller = Controller::new(ControllerConfig::default()).expect("controller");
    let mut state = controller.start(0.0);
    let input = ControllerInput { position_m: [0.0, -6e-4], ..still() };
    let output = controller.sample(&mut state, &input).expect("sample");
    assert!(output.saturated);
    assert!(output.current_a.iter().all(|i| i.is_finite() && *i > 0.0), "{:?}", output.current_a);
}

#[test]
fn the_state_survives_being_written_and_read() {
    let config = ControllerConfig {
        law: TrackingConfig { modulation: 0.5, ..TrackingConfig::default() },
        ..ControllerConfig::default()
    };
    let mut controller = Controller::new(config).expect("controller");
    let mut state = controller.start(0.5);
    for k in 0..5 {
        // Another frequency, so that the phase has a base.
        controller.retune(0.5, [if k < 3 { 110.0 } else { 90.0 }]).expect("a sound frequency");
        controller.sample(&mut state, &still()).expect("sample");
    }
    assert!(controller.accepts(&state));
    let text = toml::to_string(&state).expect("written");
    let mut read: ControllerState = toml::from_str(&text).expect("read");
    assert_eq!(read, state);
    assert_eq!(controller.sample(&mut read, &still()), controller.sample(&mut state, &still()));
    let config = ControllerConfig {
        law: TrackingConfig { update: UpdateMode::WhenValid, ..TrackingConfig::default() },
        ..ControllerConfig::default()
    };
    let text = toml::to_string(&config).expect("written");
    assert_eq!(toml::from_str::<ControllerConfig>(&text).expect("read"), config);
}

#[test]
fn bad_parameters_are_refused_by_name_all_at_once() {
    let default = ControllerConfig::default;
    for bad in [f64::NAN, f64::INFINITY, 0.0, -1.0] {
        let config = ControllerConfig {
            law: TrackingConfig {
                step_s: bad,
                lambda0_nm2_a2: [4e-6, bad, bad],
                tracking_rad_s: bad,
                observer_rad_s: bad,
                ..TrackingConfig::default()
            },
            m_kg: bad,
            gap_m: bad,
            ..default()
        };
        let wanted = ["m", "s", "Ts", "lambda0[2]", "lambda0[3]", "bandwidth.tracking", "bandwidth.observer"];
        assert_eq!(names(config), wanted, "{bad}");
    }
    for bad in [f64::NAN, f64::INFINITY, -1.0] {
        assert_eq!(
            names(ControllerConfig { law: TrackingConfig { f0_n: [bad], ..TrackingConfig::default() }, ..default() }),
            ["F0"]
        );
    }
    for bad in [f64::NAN, f64::INFINITY, -0.1, 1.1] {
        assert_eq!(
            names(ControllerConfig {
                law: TrackingConfig { modulation: bad, ..TrackingConfig::default() },
                ..default()
            }),
            ["F0.modulation"],
            "{bad}"
        );
    }
    for bad in [f64::NAN, f64::INFINITY, 0.0, -110.0, 5000.1] {
        assert_eq!(
            names(ControllerConfig {
                law: TrackingConfig { modulation_hz: [bad], ..TrackingConfig::default() },
                ..default()
            }),
            ["F0.modulationFrequency"],
            "{bad}"
        );
    }
    for good in [1e-3, 5000.0] {
        assert!(
            Controller::new(ControllerConfig {
                law: TrackingConfig { modulation: 1.0, modulation_hz: [good], ..TrackingConfig::default() },
                ..default()
            })
            .is_ok()
        );
    }
    assert_eq!(
        names(ControllerConfig {
            law: TrackingConfig { update_time_s: f64::NAN, ..TrackingConfig::default() },
            ..default()
        }),
        ["update.time"]
    );
    assert_eq!(names(ControllerConfig { alpha_rad: [PI, 0.5, 0.5], ..default() }), ["alpha[3]"]);
    let reference = ReferenceConfig { r_y_m: -1.0, ..ReferenceConfig::default() };
    assert_eq!(names(ControllerConfig { reference, ..default() }), ["reference.rY"]);
    assert!(
        Controller::new(ControllerConfig {
            law: TrackingConfig { f0_n: [0.0], ..TrackingConfig::default() },
            ..default()
        })
        .is_ok(),
        "F0 = 0 is admitted"
    );
}

fn names(config: ControllerConfig) -> Vec<String> {
    let found = Controller::new(config).expect_err("a refusal");
    found.into_iter().map(|finding| finding.name.into_owned()).collect()
}

/// Both poles of the tracking at ρ, and one at 0, of the double integrator whose input is a polygon.
#[test]
fn the_gains_of_voltage_drive_place_the_poles() {
    let step_s = 1e-4;
    for bandwidth in [100.0, 1000.0, 5000.0] {
        let [k_0, k_1, k_2] = ramp_gains(bandwidth, step_s);
        let rho = (-bandwidth * step_s).exp();
        // The error falls as ρ^k along the eigenvector; with the third pole at 0 any start is there after three samples, up to
        // the part k ρ^k of the double pole: e_{k+2} = 2ρ e_{k+1} − ρ² e_k.
        let (mut x, mut v, mut a) = (1e-6, 1e-3, 2.0);
        let mut path = Vec::new();
        for _ in 0..12 {
            path.push(x);
            let next = -k_0 * x - k_1 * v - k_2 * a;
            let h = step_s;
            (x, v, a) = (x + h * v + h * h * (a / 3.0 + next / 6.0), v + 0.5 * h * (a + next), next);
        }
        let largest = path.iter().fold(0.0f64, |size, x| size.max(x.abs()));
        for three in path[1..].windows(3) {
            let rest = three[2] - 2.0 * rho * three[1] + rho * rho * three[0];
            below("recursion of the error", rest.abs() / largest, ROUNDING);
        }
    }
}
