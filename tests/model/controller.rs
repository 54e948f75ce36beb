//! The controller: gains, closed loop with the plant, update of λ, refusals.

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

#[test]
fn currents_do_not_jump_when_lambda_changes() {
    // At sample 0.2 s the currents move by no more than they do on their own in two samples.
    let records = Loop::paper().run();
    let step = |k: usize| -> [f64; 3] {
        std::array::from_fn(|j| (records[k].output.current_a[j] - records[k - 1].output.current_a[j]).abs())
    };
    let update = records.iter().position(|r| r.output.lambda_used_nm2_a2 != [4e-6; 3]).expect("an update");
    assert_eq!(update, 2000);
    let usual = (1500..2000).flat_map(step).fold(0.0, f64::max);
    for moved in step(update) {
        below("step of a current at the update, A", moved, 2.0 * usual);
    }

    // Using λ from the start: no steps once the observer has settled.
    let mut case = Loop::paper();
    case.controller.law.update = UpdateMode::WhenValid;
    case.valid_s = 0.1;
    let records = case.run();
    let step = |k: usize| -> [f64; 3] {
        std::array::from_fn(|j| (records[k].output.current_a[j] - records[k - 1].output.current_a[j]).abs())
    };
    let before = (500..1000).flat_map(step).fold(0.0, f64::max);
    let during = (1000..2000).flat_map(step).fold(0.0, f64::max);
    below("step of a current while λ moves, A", during, 1.5 * before);
    let used = records.last().expect("records").output.lambda_used_nm2_a2;
    for (used, lambda) in used.into_iter().zip(case.lambda_hat) {
        below("λ in use against its estimate", (used / lambda - 1.0).abs(), 1e-9);
    }
}

/// Largest distance of the currents of two runs, in A, over the samples with t in `[from, to)`.
fn apart(with: &[Record], without: &[Record], [from, to]: [f64; 2], of: impl Fn(&Record) -> [f64; 3]) -> f64 {
    let pairs = with.iter().zip(without).filter(|(r, _)| (from..to).contains(&r.t_s));
    let distance = |(a, b): (&Record, &Record)| {
        let (a, b) = (of(a), of(b));
        (0..3).map(|k| (a[k] - b[k]).abs()).fold(0.0, f64::max)
    };
    pairs.map(distance).fold(0.0, f64::max)
}

/// An estimate that jumps by 5 % at 0.2 s to the true values, beside one that does not jump, and one that changes by up to
/// 0.1 % from sample to sample, beside one that is right.
///
/// Fails if the smallest force stays at `F_0` when λ changes, or if the perturbation does.
#[test]
fn estimates_taken_over_directly_make_no_bump() {
    // Magnets carry 1.7 to 4 A, of which a jump of 5 % would be 40 to 100 mA. Measured are 5 to 9 mA at once, 10 to 18 mA
    // within 0.5 ms, in which the currents begin to go where the better λ takes them.
    const AT_ONCE_A: f64 = 0.012;
    const SOON_A: f64 = 0.024;
    // Measured: 1.3 to 3.0 mA.
    const CHANGING_A: f64 = 0.004;
    let off = |[a, b, c]: [f64; 3]| [1.05 * a, 0.95 * b, 1.05 * c];
    for (name, case) in [("current", Loop::paper()), ("voltage", Loop::paper().with_voltage())] {
        for modulation in [0.0, 0.5, 1.0] {
            let mut case = case.clone();
            case.controller.law.update = UpdateMode::WhenValid;
            case.controller.law.modulation = modulation;
            let run = |lambda_at: fn([f64; 3], usize) -> [f64; 3]| Loop { lambda_at, ..case.clone() }.run();
            let jumps = run(|[a, b, c], k| if k < 2000 { [1.05 * a, 0.95 * b, 1.05 * c] } else { [a, b, c] });
            let stays = Loop { lambda_hat: off(case.lambda_hat), ..case.clone() }.run();
            let right = run(|lambda, _| lambda);
            let changing = run(|lambda, k| {
                let random = |j: usize| ((k * 7919 + j * 104_729) % 1009) as f64 / 504.5 - 1.0;
                std::array::from_fn(|j| lambda[j] * (1.0 + 1e-3 * random(j)))
            });
            let say = |what: &str| format!("{name} drive, modulation {modulation}: {what}");
            let asked = |r: &Record| r.output.current_a;
            assert_eq!(apart(&jumps, &stays, [0.0, 0.19995], asked), 0.0);
            assert!(apart(&jumps, &stays, [0.19995, 0.20005], asked) > 0.0, "the estimate is used at once");
            below(&say("currents asked for at the jump, A"), apart(&jumps, &stays, [0.2, 0.20005], asked), AT_ONCE_A);
            below(&say("currents asked for soon after, A"), apart(&jumps, &stays, [0.2, 0.20055], asked), SOON_A);
            let flowing = apart(&jumps, &stays, [0.2, 0.20055], |r| r.measured_a);
            below(&say("currents that flow soon after, A"), flowing, SOON_A);
            below(&say("currents in the end, A"), apart(&jumps, &right, [0.3, 0.4], asked), 1e-4);
            below(&say("currents with a changing λ, A"), apart(&changing, &right, [0.05, 0.4], asked), CHANGING_A);
            let error = |records: &[Record]| largest(records, 0.2, 0.4, |r| r.error_m[0].hypot(r.error_m[1]));
            let least = error(&jumps) <= error(&stays);
            assert!(least, "{}", say("the motion is disturbed more by the jump than by a wrong λ"));
        }
    }
}

/// Smallest force of the magnets, in N, by the currents asked for, of a rotor in the centre.
fn smallest_n(current_a: [f64; 3], lambda: [f64; 3]) -> f64 {
    let force = |k: usize| lambda[k] * (current_a[k] / 5e-4) * (current_a[k] / 5e-4);
    force(0).min(force(1)).min(force(2))
}

/// Fails if the phase is that of the sample instead of that of the force, or if the current loop lags.
#[test]
fn a_modulated_smallest_force_moves_nothing() {
    /// Radius, in m: held currents move nothing; along a polygon of forces, the force between two samples is no polygon.
    const RADIUS_M: f64 = 1e-9;
    /// Resultant against that without modulation, in N, of forces of 100 N.
    const RESULTANT_N: f64 = 3e-3;
    /// Part of the smallest force.
    const SMALLEST: f64 = 1e-6;
    for (name, case, ahead) in [("current", Loop::at_rest(), 1.5), ("voltage", Loop::at_rest().with_voltage(), 2.0)] {
        let lambda = case.plant.lambda_nm2_a2;
        let mut without = case.clone();
        without.controller.law.modulation = 0.0;
        let (with, without) = (case.run(), without.run());
        // The load is there before the first current flows; the observer takes it up within 20 ms.
        let radius = largest(&with, 0.05, 0.4, |r| r.error_m[0].hypot(r.error_m[1]));
        below(&format!("{name}: radius, m"), radius, RADIUS_M);
        for k in 500..with.len() - 2 {
            for axis in 0..2 {
                let force = |records: &[Record]| records[k].output.force_n[axis];
                below(&format!("{name}: resultant, N"), (force(&with) - force(&without)).abs(), RESULTANT_N);
            }
            let asked_a = with[k].output.current_a;
            let wanted_n = 20.0 * (1.0 + 0.5 * (TAU * 110.0 * (k as f64 + ahead) * 1e-4).sin());
            below(&format!("{name}: smallest force"), (smallest_n(asked_a, lambda) / wanted_n - 1.0).abs(), SMALLEST);
            for (asked, flowing) in asked_a.into_iter().zip(with[k + 2].measured_a) {
                below(&format!("{name}: current that flows against that asked for, A"), (flowing - asked).abs(), 1e-5);
            }
        }
    }
}

/// Guesses wrong by two, noise, and an update at 0.2 s: the rotor stays within 1 µm, up to a tenth.
///
/// Fails with voltage drive (3.2 µm) if the perturbation is handed the difference of the forces measured at the instant of the
/// update, which are noise in good part, instead of those asked for.
#[test]
fn a_modulated_smallest_force_hardly_moves_a_rotor_whose_constants_are_not_known() {
    /// Measured: 0.76 and 0.99 µm, both in the first 10 ms after the update.
    const RADIUS_M: f64 = 1.1e-6;
    for (name, case) in [("current", Loop::at_rest()), ("voltage", Loop::at_rest().with_voltage())] {
        for (modulation, seed) in (1..=20).flat_map(|seed| [(0.0, seed), (0.5, seed)]) {
            let mut case = case.clone();
            case.controller.law.modulation = modulation;
            case.controller.law.lambda0_nm2_a2 = [4e-6; 3];
            let noise = SensorConfig { position_noise_m: 1e-7, current_noise_a: 1e-2, seed, ..case.plant.sensor };
            case.plant.sensor = noise;
            let radius = largest(&case.run(), 0.05, 0.4, |r| r.error_m[0].hypot(r.error_m[1]));
            below(&format!("{name}, modulation {modulation}, seed {seed}: radius, m"), radius, RADIUS_M);
        }
    }
}

/// A controller at rest with a modulation, and its smallest force at each sample, over F_0 and less 1; `tune` may change the
/// modulation before a sample.
fn modulation(config: ControllerConfig, samples: u64, tune: impl Fn(&mut Controller, u64)) -> Vec<f64> {
    let mut config = ControllerConfig { law: TrackingConfig { modulation: 0.5, ..config.law }, ..config };
    (config.reference.r_y_m, config.reference.r_z_m) = (0.0, 0.0);
    let lambda = config.law.lambda0_nm2_a2;
    let mut controller = Controller::new(config).expect("controller");
    let mut state = controller.start(0.0);
    let input = ControllerInput { position_m: [0.0; 2], ..still() };
    let mut parts = Vec::new();
    for k in 0..samples {
        tune(&mut controller, k);
        let output = controller.sample(&mut state, &input).expect("sample");
        parts.push(smallest_n(output.current_a, lambda) / 20.0 - 1.0);
    }
    parts
}

/// Fails if the phase is summed up step by step.
#[test]
fn the_phase_of_the_modulation_does_not_drift() {
    // 110 Hz are 11 revolutions in 1000 samples of 0.1 ms: the phase of any sample is exact in whole numbers.
    let parts = modulation(ControllerConfig::default(), 1_000_000, |_, _| ());
    for (k, part) in parts.iter().enumerate().skip(999_000) {
        let phase = ((22 * k + 33) % 2000) as f64 / 2000.0;
        below("modulation against its sine", (part - 0.5 * (TAU * phase).sin()).abs(), 1e-8);
    }
}

#[test]
fn tuned_modulation_goes_on_without_a_jump_of_its_phase() {
    let tuned_hz = |k: u64| if (100..250).contains(&k) { 1700.0 } else { 110.0 };
    let parts = modulation(ControllerConfig::default(), 400, |controller, k| {
        controller.retune(0.5, [tuned_hz(k)]).expect("a sound frequency");
    });
    let mut phase = 1.5 * 110.0 * 1e-4;
    for (k, part) in parts.into_iter().enumerate() {
        if k > 0 {
            phase += tuned_hz(k as u64) * 1e-4;
        }
        below("modulation against its sine", (part - 0.5 * (TAU * phase).sin()).abs(), 1e-9);
    }
    // Switched off and on again, it is where it would have been.
    let pause = |controller: &mut Controller, k| {
        let part = if (100..250).contains(&k) { 0.0 } else { 0.5 };
        controller.retune(part, [110.0]).expect("a sound part");
    };
    let parts = modulation(ControllerConfig::default(), 400, pause);
    assert!(parts[100..250].iter().all(|part| part.abs() < 1e-12), "no modulation");
    below("after the pause", (parts[399] - 0.5 * (TAU * 110.0 * 400.5e-4).sin()).abs(), 1e-9);

    // A refusal changes nothing.
    let mut controller = Controller::new(ControllerConfig::default()).expect("controller");
    for (part, hz, name) in [
        (1.5, 110.0, "F0.modulation"),
        (f64::NAN, 110.0, "F0.modulation"),
        (0.5, 5001.0, "F0.modulationFrequency"),
        (0.5, f64::INFINITY, "F0.modulationFrequency"),
    ] {
        let findings = controller.retune(part, [hz]).expect_err("a refusal");
        assert!(findings.len() == 1 && findings[0].name == name, "{findings:?}");
        assert_eq!(controller.config(), &ControllerConfig::default());
    }
}

#[test]
fn a_change_of_lambda_moves_neither_the_rotor_nor_force_and_perturbation() {
    let settled = |update| {
        let controller = Controller::new(ControllerConfig {
            law: TrackingConfig { update, ..TrackingConfig::default() },
            ..ControllerConfig::default()
        })
        .expect("controller");
        let mut state = controller.start(0.0);
        let input = |lambda_valid| ControllerInput { lambda_valid, ..still() };
        let mut outputs = Vec::new();
        for k in 0..2001 {
            outputs.push(controller.sample(&mut state, &input(k == 2000)).expect("sample"));
        }
        outputs
    };
    let [with, without] = [UpdateMode::AtTime, UpdateMode::Never].map(settled);
    let (with, without) = (&with[2000], &without[2000]);
    assert_eq!(with.lambda_used_nm2_a2, [1.8e-6, 2.0e-6, 2.2e-6]);
    for a in 0..2 {
        // The feedback asks for the same total; the observer has moved what the model now explains.
        let total = |o: &ControllerOutput| o.force_n[a] + o.perturbation_n[a];
        below("total force, N", (total(with) - total(without)).abs(), 1e-9);
        assert!((with.perturbation_n[a] - without.perturbation_n[a]).abs() > 1.0, "the perturbation has moved");
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

/// λ in use after each of the samples whose estimates are given.
fn lambda_used(config: ControllerConfig, estimates: &[([f64; 3], bool)]) -> Vec<[f64; 3]> {
    let controller = Controller::new(config).expect("controller");
    let mut state = controller.start(0.0);
    let sample = |&(lambda_hat_nm2_a2, lambda_valid): &([f64; 3], bool)| {
        let input = ControllerInput { lambda_hat_nm2_a2, lambda_valid, ..still() };
        controller.sample(&mut state, &input).expect("sample").lambda_used_nm2_a2
    };
    estimates.iter().map(sample).collect()
}

#[test]
fn lambda_is_taken_over_once_at_its_time_and_only_if_it_is_of_use() {
    let first = [4e-6; 3];
    let good = [2e-6; 3];
    let other = [3e-6; 3];
    let at = |update_time_s| ControllerConfig {
        law: TrackingConfig { update_time_s, ..TrackingConfig::default() },
        ..ControllerConfig::default()
    };
    // Not before its time, once, and with a time that is short of a sample by its last bits.
    let used = lambda_used(at(2e-4 * (1.0 + 1e-12)), &[(other, true), (other, true), (good, true), (other, true)]);
    assert_eq!(used, [first, first, good, good]);
    // As soon as it is valid.
    let used = lambda_used(at(0.0), &[(good, false), (good, true), (other, true)]);
    assert_eq!(used, [first, good, good]);
    // Never an unusable one.
    for bad in [f64::NAN, f64::INFINITY, 0.0, -2e-6] {
        for update in [UpdateMode::AtTime, UpdateMode::WhenValid] {
            let config = ControllerConfig { law: TrackingConfig { update, ..at(0.0).law }, ..at(0.0) };
            let used = lambda_used(config, &[([2e-6, bad, 2e-6], true), ([2e-6, 2e-6, bad], true)]);
            assert_eq!(used, [first, first], "{bad} {update:?}");
        }
    }
    let used = lambda_used(
        ControllerConfig { law: TrackingConfig { update: UpdateMode::Never, ..at(0.0).law }, ..at(0.0) },
        &[(good, true); 3],
    );
    assert_eq!(used, [first; 3]);
    // Always while it is valid.
    let config = ControllerConfig { law: TrackingConfig { update: UpdateMode::WhenValid, ..at(0.0).law }, ..at(0.0) };
    let used = lambda_used(config, &[(good, true), (other, true), (good, false), (good, true)]);
    assert_eq!(used, [good, other, other, good]);
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
