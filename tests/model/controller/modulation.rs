//! Modulation of the smallest force.

use super::*;

/// Smallest magnet force of each bearing, in N, from the commanded currents, for a centred rotor.
fn smallest_n<const N: usize, const K: usize, const B: usize>(
    rotor: &RotorConfig<f64, B>,
    current_a: [f64; K],
    lambda: [f64; K],
) -> [f64; B] {
    let mut smallest_n = [f64::INFINITY; B];
    let cases = smallest_n.iter_mut().zip(&rotor.bearings).zip(Rotor::<N, K, B>::MACHINE.magnets_of_bearings());
    for ((least, bearing), (_, magnets)) in cases {
        let force = |k: usize| lambda[k] * (current_a[k] / bearing.gap_m) * (current_a[k] / bearing.gap_m);
        *least = magnets.map(force).fold(f64::INFINITY, f64::min);
    }
    smallest_n
}

/// A rotor at rest, each bearing with its own frequency. Fails if the phase is that of the sample instead of that of the force, or if the
/// current loop lags.
#[test]
fn a_modulated_smallest_force_moves_nothing() {
    /// Motion, in m. Held currents cause none; with voltage drive the forces between two samples are not exactly linear.
    const RADIUS_M: f64 = 1e-9;
    /// Change of the resultant by modulation, in N, of forces of 100 N.
    const RESULTANT_N: f64 = 3e-3;
    fn holds<const N: usize, const K: usize, const B: usize, const G: usize>(case: &Loop<N, K, B, G>, limit: f64) {
        for ((name, case), ahead) in case.drives().into_iter().zip([1.5, 2.0]) {
            let TrackingConfig { f0_n, modulation_hz, .. } = case.controller.law;
            let mut without = case.clone();
            without.controller.law.modulation = 0.0;
            let (with, without) = (case.run(), without.run());
            // The load acts before the first current flows; the observer compensates it within 20 ms.
            tracked(name, &with, 0.05, 0.4, RADIUS_M);
            for k in 500..with.len() - 2 {
                for axis in 0..N {
                    let force = |records: &[Record<N, K>]| records[k].output.force_n[axis];
                    below(&format!("{name}: resultant, N"), (force(&with) - force(&without)).abs(), RESULTANT_N);
                }
                let commanded_a = with[k].output.current_a;
                let smallest = smallest_n::<N, K, B>(&case.plant.rotor, commanded_a, case.plant.lambda_nm2_a2);
                for b in 0..B {
                    let sine = (TAU * modulation_hz[b] * (k as f64 + ahead) * 1e-4).sin();
                    let wanted_n = f0_n[b] * (1.0 + 0.5 * sine);
                    below(&format!("{name}: smallest force of {b}"), (smallest[b] / wanted_n - 1.0).abs(), limit);
                }
                for (commanded, flowing) in commanded_a.into_iter().zip(with[k + 2].measured_a) {
                    let what = format!("{name}: flowing current against that asked for, A");
                    below(&what, (flowing - commanded).abs(), 1e-5);
                }
            }
        }
    }
    holds(&Loop::at_rest(), 1e-6);
    let mut spindle = Loop { load_n: [8.0, 15.0, -20.0, 0.6, -0.9], ..Loop::ideal(0.0) };
    spindle.controller.reference.paths = [PathConfig::default(); 3];
    holds(&spindle, 1e-4);
}

/// Guesses wrong by a factor of two, noise, and an update at 0.2 s: the rotor stays within 1.1 µm.
///
/// Fails with voltage drive (3.2 µm) if the perturbation absorbs the difference of the measured, noisy forces at the update
/// instead of the commanded ones.
#[test]
fn a_modulated_smallest_force_hardly_moves_a_rotor_with_unknown_constants() {
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

/// The smallest force at each sample, over F_0 and less 1, of a controller of a rotor at rest; `tune` may change the
/// modulation before a sample.
fn modulation(config: ControllerConfig, samples: u64, tune: impl Fn(&mut Controller, u64)) -> Vec<f64> {
    let mut config = ControllerConfig { law: TrackingConfig { modulation: 0.5, ..config.law }, ..config };
    config.reference.paths = [PathConfig::default()];
    let lambda = config.law.lambda0_nm2_a2;
    let mut controller = Controller::new(config).expect("controller");
    let mut state = controller.start(0.0);
    let input = ControllerInput { position_m: [0.0; 2], ..still() };
    let mut parts = Vec::new();
    for k in 0..samples {
        tune(&mut controller, k);
        let output = controller.sample(&mut state, &input).expect("sample");
        let [smallest] = smallest_n::<2, 3, 1>(&RotorConfig::of(&PLANAR), output.current_a, lambda);
        parts.push(smallest / 20.0 - 1.0);
    }
    parts
}

/// Fails if the phase is accumulated step by step.
#[test]
fn the_phase_of_the_modulation_does_not_drift() {
    // 110 Hz are 11 periods in 1000 samples of 0.1 ms: integers give the phase of any sample exactly.
    let parts = modulation(ControllerConfig::default(), 1_000_000, |_, _| ());
    for (k, part) in parts.iter().enumerate().skip(999_000) {
        let phase = ((22 * k + 33) % 2000) as f64 / 2000.0;
        below("modulation against its sine", (part - 0.5 * (TAU * phase).sin()).abs(), 1e-8);
    }
}

#[test]
fn tuning_the_modulation_does_not_make_its_phase_jump() {
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
    // The phase advances while the modulation is off.
    let pause = |controller: &mut Controller, k| {
        let part = if (100..250).contains(&k) { 0.0 } else { 0.5 };
        controller.retune(part, [110.0]).expect("a sound part");
    };
    let parts = modulation(ControllerConfig::default(), 400, pause);
    assert!(parts[100..250].iter().all(|part| part.abs() < 1e-12), "no modulation");
    below("after the pause", (parts[399] - 0.5 * (TAU * 110.0 * 400.5e-4).sin()).abs(), 1e-9);
}
