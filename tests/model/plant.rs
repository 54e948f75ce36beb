//! The plant: integration against known solutions, sensors, errors and refusals.

use crate::prelude::*;

use magnetic_bearing::plant::integration::substeps;
use magnetic_bearing::plant::sensor::Sample;

const OMEGA_RAD_S: f64 = TAU * 50.0;

fn plant(config: PlantConfig) -> Plant {
    Plant::new(config).expect("plant")
}

/// Currents that hold the rotor near the centre for some milliseconds.
fn held() -> PlantInput {
    PlantInput {
        current_a: [1.5, 1.4, 1.3],
        perturbation_n: [0.5, -0.3],
        omega_rad_s: OMEGA_RAD_S,
        ..PlantInput::default()
    }
}

fn all_on() -> PlantConfig {
    PlantConfig {
        unbalance_kgm: [1e-4, 0.0],
        unbalance_phase_rad: [0.4, 0.0],
        harmonic: Harmonic { amplitude_n: [2.0, 1.0], phase_rad: [0.1, 0.2], ..Harmonic::default() },
        velocity_m_s: [0.0, 0.005],
        ..PlantConfig::default()
    }
}

#[test]
fn substeps_tolerate_the_rounding_of_the_division() {
    assert_eq!(substeps(1e-4, 5e-5), 2);
    assert_eq!(substeps(3.0 * 0.1, 0.1), 3);
    assert_eq!(substeps(1.01e-4, 5e-5), 3);
    assert_eq!(substeps(1e-16, 5e-5), 1);
    assert_eq!(substeps(0.0, 5e-5), 1);
    assert_eq!(substeps(f64::NAN, 5e-5), 1);
}

/// Unbalance alone, no current: `m Ẅ = U ω² e^{j(ωt+φ)}`, so `W = −(U/m) e^{j(ωt+φ)}` from a matching start.
#[test]
fn a_free_rotor_with_unbalance_follows_the_closed_form() {
    let (m_kg, phase) = (6.7, 0.4);
    let radius = 20e-6;
    let on_circle = |t: f64| {
        let angle = OMEGA_RAD_S * t + phase;
        [-radius * angle.cos(), -radius * angle.sin()]
    };
    let error = |sub_steps: f64| {
        let duration = 0.02;
        let config = PlantConfig {
            unbalance_kgm: [m_kg * radius, 0.0],
            unbalance_phase_rad: [phase, 0.0],
            position_m: on_circle(0.0),
            velocity_m_s: [OMEGA_RAD_S * radius * phase.sin(), -OMEGA_RAD_S * radius * phase.cos()],
            sensor: SensorConfig { step_s: 1.0, ..SensorConfig::default() },
            max_step_s: duration / sub_steps,
            ..PlantConfig::default()
        };
        let plant = plant(config);
        let mut state = plant.start(0.0);
        let input = PlantInput { omega_rad_s: OMEGA_RAD_S, ..PlantInput::default() };
        // Three quarters of a revolution: over a whole one errors would cancel.
        plant.advance(&mut state, &InputTrajectory::held(&input), 0.0, 0.75 * duration).expect("advance");
        let wanted = on_circle(0.75 * duration);
        (state.motion.position_m[0] - wanted[0]).hypot(state.motion.position_m[1] - wanted[1])
    };
    for n in [16.0, 32.0, 64.0] {
        between("order", (error(n) / error(2.0 * n)).log2(), 3.8, 4.2);
    }
    // The sub-step of 50 µs, in m.
    below("error at the default sub-step, m", error(400.0), 1e-13);
}

/// With constant currents the force has a potential, and gyroscopic moments do no work: kinetic energy less `Σ λ i²/gap` is conserved.
/// Returns its drift relative to the initial kinetic energy.
fn drift<const N: usize, const K: usize, const B: usize>(
    config: PlantConfigOf<f64, N, K, B>,
    current_a: [f64; K],
    steps: i32,
) -> f64 {
    let plant = Plant::new(config.clone()).expect("plant");
    let input = PlantInput { current_a, omega_rad_s: 1200.0, ..PlantInput::default() };
    let inertia: [f64; N] = config.rotor.shaft.inertia();
    let kinetic = |state: &PlantState<N, K, B>| -> f64 {
        inertia.iter().zip(state.motion.velocity_m_s).map(|(inertia, rate)| 0.5 * inertia * rate * rate).sum()
    };
    let energy = |state: &PlantState<N, K, B>| {
        let gaps = plant.outputs(state, &input, 0.0).gap_m;
        kinetic(state) - (0..K).map(|k| config.lambda_nm2_a2[k] * current_a[k].powi(2) / gaps[k]).sum::<f64>()
    };
    let start = plant.start(0.0);
    let mut state = start.clone();
    for k in 0..steps {
        plant.advance(&mut state, &InputTrajectory::held(&input), f64::from(k) * STEP_S, STEP_S).expect("advance");
    }
    let moved = (kinetic(&state) / kinetic(&start) - 1.0).abs();
    assert!(moved > 0.05, "the kinetic energy changed by only {moved}: the test shows nothing");
    (energy(&state) - energy(&start)).abs() / kinetic(&start)
}

/// Fails if `G` is not skew-symmetric, or if a moment does not match its force.
#[test]
fn energy_is_conserved() {
    let planar = |max_step_s| {
        let config = PlantConfig { velocity_m_s: [4e-3, -7e-3], max_step_s, ..PlantConfig::default() };
        drift(config, [1.6, 1.5, -1.4], 120)
    };
    let spindle = |max_step_s| {
        let velocity_m_s = [3e-3, 4e-3, -5e-3, 0.05, -0.03];
        let config = SpindleConfig { velocity_m_s, max_step_s, ..SpindleConfig::default() };
        drift(config, [1.6, 1.5, -1.4, 1.3, 1.7, 1.2, 2.0, 1.8], 80)
    };
    // Measured 2.7e-10 after 12 ms, in which the gap of magnet 1 falls from 0.50 mm to 0.37 mm; it grows without bound towards contact.
    below("drift of the planar rotor", planar(5e-5), 4e-10);
    below("drift of the spindle", spindle(5e-5), 1e-8);
    between("order, planar", (planar(5e-5) / planar(2.5e-5)).log2(), 3.8, 4.2);
    below("of order four, spindle", spindle(2.5e-5) / spindle(5e-5), 1.0 / 12.0);
}

#[test]
fn outputs_are_the_equations_of_motion() {
    let config = all_on();
    let plant = plant(config.clone());
    let mut state = plant.start(0.0);
    plant.advance(&mut state, &InputTrajectory::held(&held()), 0.0, 3.3 * STEP_S).expect("advance");
    let t = 3.3 * STEP_S;
    let out = plant.outputs(&state, &held(), t);
    let u = config.unbalance_kgm[0] * OMEGA_RAD_S * OMEGA_RAD_S;
    let angle = OMEGA_RAD_S * t + 0.4;
    let p = [
        0.5 + 2.0 * (OMEGA_RAD_S * t + 0.1).sin() + u * angle.cos(),
        -0.3 + 1.0 * (OMEGA_RAD_S * t + 0.2).sin() + u * angle.sin(),
    ];
    for (a, p_a) in p.into_iter().enumerate() {
        below("perturbation, N", (out.perturbation_n[a] - p_a).abs(), 1e-12);
        let sum = out.resultant_n[a] + out.perturbation_n[a];
        below("acceleration, m/s²", (out.acceleration_m_s2[a] - sum / 6.7).abs(), 1e-12);
    }
    for k in 0..3 {
        let force = config.lambda_nm2_a2[k] * held().current_a[k].powi(2) / out.gap_m[k].powi(2);
        below("force, N", (out.force_n[k] - force).abs(), 1e-12);
    }
    // The acceleration is that of the motion: a short step moves the velocity by it.
    let mut later = state.clone();
    let h = 1e-7;
    plant.advance(&mut later, &InputTrajectory::held(&held()), state.time_s, h).expect("advance");
    for a in 0..2 {
        let slope = (later.motion.velocity_m_s[a] - state.motion.velocity_m_s[a]) / h;
        below("acceleration against the motion, m/s²", (slope - out.acceleration_m_s2[a]).abs(), 1e-3);
    }
}

#[test]
fn a_sample_of_the_current_is_the_one_held_before() {
    let plant = plant(PlantConfig::default());
    let mut state = plant.start(2.0);
    let first = state.measured;
    assert_eq!(first, Sample { position_m: [30e-6, 0.0], current_a: [0.0; 3] });
    assert_eq!(state.measured_theta_rad, 0.0);
    let at = |i| PlantInput { current_a: [i; 3], ..held() };
    plant.advance(&mut state, &InputTrajectory::held(&at(1.0)), 2.0, 0.5 * STEP_S).expect("advance");
    assert_eq!(state.measured, first, "half a step reads nothing");
    let t_s = state.time_s;
    plant.advance(&mut state, &InputTrajectory::held(&at(1.5)), t_s, 0.5 * STEP_S).expect("advance");
    assert_eq!(state.measured.current_a, [1.5; 3]);
    assert_eq!(state.measured.position_m, state.motion.position_m);
    assert_eq!(state.samples, 2);
    below("θ in rad", (state.measured_theta_rad - OMEGA_RAD_S * STEP_S).abs(), 1e-12);
}

/// The samples taken during these steps from `start_s`.
fn samples_of(config: PlantConfig, start_s: f64, steps: impl Iterator<Item = (f64, f64)>) -> Vec<Sample> {
    let plant = plant(config);
    let mut state = plant.start(start_s);
    let mut samples = vec![state.measured];
    for (t_s, h_s) in steps {
        let before = state.samples;
        plant.advance(&mut state, &InputTrajectory::held(&held()), t_s, h_s).expect("advance");
        // Of the samples within a long step only the last is visible.
        for _ in before..state.samples {
            samples.push(state.measured);
        }
    }
    samples
}

fn worst_position(a: &[Sample], b: &[Sample]) -> f64 {
    assert_eq!(a.len(), b.len(), "number of samples");
    let distance = |(a, b): (&Sample, &Sample)| {
        (a.position_m[0] - b.position_m[0]).abs().max((a.position_m[1] - b.position_m[1]).abs())
    };
    a.iter().zip(b).map(distance).fold(0.0, f64::max)
}

#[test]
fn samples_are_identical_however_time_is_counted() {
    let noisy = SensorConfig { position_noise_m: 1e-7, current_noise_a: 0.01, seed: 9, ..SensorConfig::default() };
    for start_s in [0.0, 0.3] {
        let config = PlantConfig { sensor: noisy.clone(), ..all_on() };
        let number = 84;
        let instant = |k: i32| start_s + f64::from(k) * STEP_S;
        let plain = samples_of(config.clone(), start_s, (0..number).map(|k| (instant(k), STEP_S)));
        assert_eq!(plain.len(), number as usize + 1);

        let sums = std::iter::successors(Some(start_s), |now| Some(now + STEP_S)).map(|now| (now, STEP_S));
        let sums = sums.take(number as usize).collect();
        let differences = (0..number).map(|k| (instant(k), instant(k + 1) - instant(k))).collect();
        // In the last bits of time and length.
        let jitter = |k: i32| if k == 0 { 0.0 } else { f64::from(k * 7919 % 13 - 6) * 1e-17 };
        let length = |k: i32| STEP_S * (1.0 + f64::from(k * 31 % 7 - 3) * 1e-15);
        let jittered = (0..number).map(|k| (instant(k) + jitter(k), length(k))).collect();
        let cases: [(&str, Vec<_>); 3] =
            [("time added up", sums), ("differences of instants", differences), ("jitter", jittered)];
        for (what, steps) in cases {
            assert_eq!(samples_of(config.clone(), start_s, steps.into_iter()), plain, "{what}, from {start_s} s");
        }

        // Seven samples per step: the last of each seven agrees.
        let long = samples_of(config, start_s, (0..number / 7).map(|k| (instant(7 * k), 7.0 * STEP_S)));
        assert_eq!(long.len(), plain.len());
        for k in (0..long.len()).step_by(7) {
            assert_eq!(long[k], plain[k], "seven at once, sample {k}");
        }
    }
}

#[test]
fn no_step_loses_or_doubles_a_sample() {
    /// Difference in position, in m, between divisions of the same time: integration error and rounding.
    const DIVISION_M: f64 = 1e-15;
    let number = 60;
    let plain = samples_of(all_on(), 0.0, (0..number).map(|k| (f64::from(k) * STEP_S, STEP_S)));

    // Steps of a third, of 0.7 and of 1.3 sample times; tiny steps before, at and after the instants.
    let walk = |lengths: Vec<f64>| {
        let mut steps = Vec::new();
        let mut t = 0.0;
        let end = f64::from(number) * STEP_S;
        for h in lengths.iter().cycle() {
            if t > end - 1e-9 {
                return steps;
            }
            let h = h.min(end - t);
            steps.push((t, h));
            t += h;
        }
        steps
    };
    for lengths in [
        vec![STEP_S / 3.0],
        vec![0.7 * STEP_S],
        vec![0.25 * STEP_S, 0.75 * STEP_S],
        vec![STEP_S, 1e-16],
        vec![1e-16, 1e-16, STEP_S, 0.0],
        vec![STEP_S - 2e-7, 1e-16, 2e-7, 1e-16],
        vec![STEP_S - 1e-8, 1e-16, 1e-8],
    ] {
        let walked = samples_of(all_on(), 0.0, walk(lengths.clone()).into_iter());
        // A sample taken up to a thousandth of a sample time early shows the rotor at that time.
        let early = if lengths[0] == STEP_S - 1e-8 { 1e-8 * 0.02 } else { 0.0 };
        below(&format!("steps of {lengths:?} s, position in m"), worst_position(&walked, &plain), DIVISION_M + early);
    }
    // More than one sample time per step: compare the last sample.
    let walked = samples_of(all_on(), 0.0, walk(vec![1.3 * STEP_S, 3.9 * STEP_S]).into_iter());
    assert_eq!(walked.len(), plain.len());
    let last = |samples: &[Sample]| samples[samples.len() - 1..].to_vec();
    below("steps of 1.3 sample times, position in m", worst_position(&last(&walked), &last(&plain)), DIVISION_M);

    let plant = plant(all_on());
    let mut state = plant.start(0.0);
    let before = state.clone();
    plant.advance(&mut state, &InputTrajectory::held(&held()), 0.0, 0.0).expect("advance");
    assert_eq!(state, before, "a step of 0 changes nothing");
}

#[test]
fn noise_is_normal_seeded_and_separate_for_each_channel() {
    let number = 100_000;
    let draws = |seed| {
        let mut channels = Noise::sequence(seed);
        let (mut a, mut b) = (channels(), channels());
        let draw = |_| (a.standard_normal(), b.standard_normal());
        (0..number).map(draw).collect::<Vec<_>>()
    };
    let drawn = draws(3);
    let mean = |f: &dyn Fn(&(f64, f64)) -> f64| drawn.iter().map(f).sum::<f64>() / f64::from(number);
    // Four standard deviations of each mean over 1e5 draws: √1, √2, √15, √96, √1 over √1e5.
    let sigma = 4.0 / f64::from(number).sqrt();
    below("mean", mean(&|d| d.0).abs(), sigma);
    below("variance", (mean(&|d| d.0 * d.0) - 1.0).abs(), 2f64.sqrt() * sigma);
    below("skewness", mean(&|d| d.0.powi(3)).abs(), 15f64.sqrt() * sigma);
    below("fourth moment", (mean(&|d| d.0.powi(4)) - 3.0).abs(), 96f64.sqrt() * sigma);
    below("correlation of channels", mean(&|d| d.0 * d.1).abs(), sigma);
    let next = drawn.windows(2).map(|w| w[0].0 * w[1].0).sum::<f64>() / f64::from(number);
    below("correlation of draws", next.abs(), sigma);
    assert_eq!(draws(3), drawn, "the same seed");
    let other = draws(4);
    let crossed = drawn.iter().zip(&other).map(|(a, b)| a.0 * b.0).sum::<f64>() / f64::from(number);
    below("correlation of seeds", crossed.abs(), sigma);
    // Recorded first numbers: every platform must give the same bits.
    let mut first = Noise::sequence(0)();
    assert_eq!([first.standard_normal(), first.standard_normal()], FIRST_OF_SEED_0);
}

const FIRST_OF_SEED_0: [f64; 2] = [0.04634510911442592, 0.686492426953744];

#[test]
fn noise_off_is_exact_and_one_channel_leaves_the_others_alone() {
    let steps = || (0..50).map(|k| (f64::from(k) * STEP_S, STEP_S));
    let with = |position_noise_m, current_noise_a, seed| {
        let sensor = SensorConfig { position_noise_m, current_noise_a, seed, ..SensorConfig::default() };
        samples_of(PlantConfig { sensor, ..all_on() }, 0.0, steps())
    };
    let exact = with(0.0, 0.0, 1);
    assert_eq!(exact, with(0.0, 0.0, 2));
    for sample in &exact[1..] {
        assert_eq!(sample.current_a, held().current_a);
    }
    let positions = with(1e-7, 0.0, 1);
    let both = with(1e-7, 0.01, 1);
    for (a, b) in positions.iter().zip(&both) {
        assert_eq!(a.position_m, b.position_m);
        assert_ne!(a.current_a, b.current_a);
    }
    assert_ne!(both[0].current_a, [0.0; 3], "sample 0 has noise as well");
    assert_ne!(positions, with(1e-7, 0.0, 2));
}

/// Fails if the nearest magnet is that of another bearing.
#[test]
fn a_rotor_that_leaves_the_gap_is_an_error_and_the_state_stays_finite() {
    fn holds<const N: usize, const K: usize, const B: usize>(push: [f64; N]) {
        let mut config =
            PlantConfigOf::<f64, N, K, B> { position_m: [0.0; N], velocity_m_s: [0.0; N], ..Default::default() };
        // No backup bearing catches it.
        config.touchdown.iter_mut().for_each(|ring| ring.clearance_m = 1.0);
        let plant = Plant::new(config).expect("plant");
        let machine = Rotor::<N, K, B>::MACHINE;
        let names: Vec<_> = machine.coordinates.iter().map(|coordinate| coordinate.position).collect();
        let magnets = machine.magnets_of_bearings().into_iter().flat_map(|(bearing, magnets)| {
            let of = if B == 1 { String::new() } else { format!(" of bearing {}", bearing.name()) };
            (1..=magnets.len()).map(move |magnet| format!("magnet {magnet}{of}"))
        });
        let wanted: Vec<_> = magnets.collect();
        // Pulled by each magnet alone; pushed into the first so hard that the rotor leaves the gap within the first sub-step.
        let pull = |k: usize| {
            let current_a = std::array::from_fn(|j| if j == k { 5.0 } else { 0.0 });
            PlantInput { current_a, ..PlantInput::default() }
        };
        let push = PlantInput { perturbation_n: push, ..PlantInput::default() };
        for (wanted, input) in wanted.iter().zip((0..K).map(pull)).chain([(&wanted[0], push)]) {
            let mut state = plant.start(0.0);
            match plant.advance(&mut state, &InputTrajectory::held(&input), 0.0, 1.0) {
                Err(StepError::Contact { magnet, time_s, position }) => {
                    assert_eq!(magnet, *wanted);
                    assert_eq!(time_s, state.time_s);
                    assert_eq!(position, names.iter().copied().zip(state.motion.position_m).collect::<Vec<_>>());
                    between("time of contact, s", time_s, 0.0, 0.02);
                }
                other => panic!("{wanted}: {other:?}"),
            }
            assert!(state.motion.position_m.iter().chain(&state.motion.velocity_m_s).all(|value| value.is_finite()));
            let gaps = plant.outputs(&state, &input, state.time_s).gap_m;
            assert!(gaps.iter().all(|gap| *gap > 0.0), "{gaps:?}");
            // It can continue with other currents until the rotor reaches the magnet.
            if B == 1 {
                let t_s = state.time_s;
                plant.advance(&mut state, &InputTrajectory::held(&PlantInput::default()), t_s, 1e-12).expect("advance");
            }
        }
    }
    holds::<2, 3, 1>([0.0, -1e12]);
    holds::<1, 2, 1>([1e12]);
    holds::<5, 8, 3>([0.0, 0.0, -1e12, -1.2e11, 0.0]);
}

/// All inputs of every machine by name, and times.
#[test]
fn invalid_inputs_and_times_are_refused_and_change_nothing() {
    fn holds<const N: usize, const K: usize, const B: usize>() {
        let plant = Plant::<N, K, B>::new(PlantConfigOf::default()).expect("plant");
        let mut state = plant.start(0.0);
        plant.advance(&mut state, &InputTrajectory::held(&PlantInput::default()), 0.0, STEP_S).expect("advance");
        let before = state.clone();
        let mut refused = |wanted: &str, bad: f64, spoil: &dyn Fn(&mut PlantInput<f64, N, K>)| {
            let mut input = PlantInput::default();
            spoil(&mut input);
            match plant.advance(&mut state, &InputTrajectory::held(&input), STEP_S, STEP_S) {
                Err(StepError::Input(NotFinite { name, .. })) => assert_eq!(name, wanted),
                other => panic!("{wanted} = {bad}: {other:?}"),
            }
        };
        let machine = Rotor::<N, K, B>::MACHINE;
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            for (k, (i, u)) in machine.of_magnets("i").iter().zip(machine.of_magnets("u")).enumerate() {
                refused(i, bad, &|input| input.current_a[k] = bad);
                refused(&u, bad, &|input| input.voltage_v[k] = bad);
            }
            for (n, coordinate) in machine.coordinates.iter().enumerate() {
                refused(coordinate.load, bad, &|input| input.perturbation_n[n] = bad);
            }
            refused("omega", bad, &|input| input.omega_rad_s = bad);
        }
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -STEP_S] {
            for (t_s, h_s) in [(bad, STEP_S), (STEP_S, bad), (2.0 * STEP_S, STEP_S), (0.0, STEP_S)] {
                let result = plant.advance(&mut state, &InputTrajectory::held(&PlantInput::default()), t_s, h_s);
                assert!(matches!(result, Err(StepError::Time { .. })), "{result:?}");
            }
        }
        assert_eq!(state, before);
    }
    holds::<2, 3, 1>();
    holds::<2, 4, 1>();
    holds::<1, 2, 1>();
    holds::<5, 8, 3>();
    holds::<5, 10, 3>();
}
