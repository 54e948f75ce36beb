//! Sensor errors, one at a time.

use crate::prelude::*;

/// Readings of positions, and true positions, at every sample.
fn readings(sensor: SensorConfig, step_s: f64, steps: usize) -> Vec<([f64; 2], [f64; 3], [f64; 2])> {
    let plant = Plant::new(PlantConfig { sensor, ..PlantConfig::default() }).expect("plant");
    let mut state = plant.start(0.0);
    let mut all = vec![(state.measured.position_m, state.measured.current_a, state.motion.position_m)];
    for k in 0..steps {
        let i = 1.0 + 0.01 * k as f64;
        let input = PlantInput { current_a: [i; 3], ..PlantInput::default() };
        let before = state.samples;
        plant.advance(&mut state, &InputTrajectory::held(&input), k as f64 * step_s, step_s).expect("advance");
        assert!(state.samples - before <= 1);
        if state.samples > before {
            all.push((state.measured.position_m, state.measured.current_a, state.motion.position_m));
        }
    }
    all
}

/// Each sensor has its own gain, offset, noise and position.
#[test]
fn gain_and_offset_of_every_sensor_are_applied() {
    fn holds<const N: usize, const K: usize, const B: usize>(position_m: [f64; N], velocity_m_s: [f64; N]) {
        let part = |of: f64, n: usize| of * (n + 1) as f64;
        let sensor = SensorConfig {
            position_gain_error: std::array::from_fn(|n| part(0.01, n)),
            position_offset_m: std::array::from_fn(|n| part(1e-6, n)),
            current_gain_error: std::array::from_fn(|k| part(-0.02, k)),
            current_offset_a: std::array::from_fn(|k| part(0.05, k)),
            ..SensorConfig::default()
        };
        let plant_of = |sensor| {
            let config = PlantConfigOf::<f64, N, K, B> { position_m, velocity_m_s, sensor, ..PlantConfigOf::default() };
            Plant::new(config).expect("plant")
        };
        let plant = plant_of(sensor);
        let mut state = plant.start(0.0);
        let current_a = std::array::from_fn(|k| 1.0 + 0.1 * k as f64);
        let input = PlantInput { current_a, omega_rad_s: 300.0, ..PlantInput::default() };
        for step in 0..5 {
            let t_s = f64::from(step) * STEP_S;
            plant.advance(&mut state, &InputTrajectory::held(&input), t_s, STEP_S).expect("advance");
            let readings = plant.config().rotor.readings(state.motion.position_m);
            for (n, reading) in readings.into_iter().enumerate() {
                let wanted = (1.0 + part(0.01, n)) * reading + part(1e-6, n);
                below(&format!("reading {n} of {N}, m"), (state.measured.position_m[n] - wanted).abs(), 1e-18);
            }
            for (k, current) in current_a.into_iter().enumerate() {
                let wanted = (1.0 + part(-0.02, k)) * current + part(0.05, k);
                below(&format!("current {k} of {K}, A"), (state.measured.current_a[k] - wanted).abs(), 1e-15);
            }
        }
        let noise = |seed| {
            let noisy = plant_of(SensorConfig { position_noise_m: 1e-7, seed, ..SensorConfig::default() }).start(0.0);
            let readings = plant.config().rotor.readings(position_m);
            std::array::from_fn::<f64, N, _>(|n| noisy.measured.position_m[n] - readings[n])
        };
        assert_eq!(noise(1), noise(1));
        let mut drawn = [noise(1), noise(2)].concat();
        drawn.sort_by(f64::total_cmp);
        drawn.dedup();
        assert_eq!(drawn.len(), 2 * N, "every sensor and every seed has its own noise");
    }
    holds::<2, 3, 1>([3e-5, 0.0], [0.0, 5e-3]);
    holds::<1, 2, 1>([2e-5], [1e-3]);
    holds::<5, 8, 3>([1e-5, 2e-5, -3e-5, 1e-4, 2e-4], [1e-3, 2e-3, -1e-3, 0.01, -0.02]);
}

#[test]
fn a_resolution_rounds() {
    let sensor = SensorConfig { position_resolution_m: 2e-7, current_resolution_a: 0.025, ..SensorConfig::default() };
    let mut rounded = false;
    for (position, current, truth) in readings(sensor, STEP_S, 20) {
        for a in 0..2 {
            let steps = position[a] / 2e-7;
            assert!((steps - steps.round()).abs() < 1e-9, "{steps}");
            assert!((position[a] - truth[a]).abs() <= 1.0001e-7);
            rounded |= position[a] != truth[a];
        }
        let steps = current[0] / 0.025;
        assert!((steps - steps.round()).abs() < 1e-9, "{steps}");
    }
    assert!(rounded);
}

#[test]
fn a_delay_shows_earlier_positions() {
    let exact = readings(SensorConfig::default(), STEP_S, 40);
    // 3e-4 / 1e-4 is less than 3.
    for (late, delay_s) in [(1, 1e-4), (3, 3e-4), (16, 1.6e-3)] {
        let sensor = SensorConfig { delay_s, ..SensorConfig::default() };
        let delayed = readings(sensor, STEP_S, 40);
        assert_eq!(delayed.len(), exact.len());
        for k in 0..delayed.len() {
            let (position, current, _) = exact[k.saturating_sub(late)];
            let worst = (0..2).map(|a| (delayed[k].0[a] - position[a]).abs()).fold(0.0, f64::max);
            assert!(worst < 1e-15, "delay of {late} samples, sample {k}: {worst} m");
            assert_eq!(delayed[k].1, current, "delay of {late} samples, sample {k}");
        }
    }
    // A fraction of a sample: the positions of a run with finer sampling.
    let fine = readings(SensorConfig { step_s: STEP_S / 4.0, ..SensorConfig::default() }, STEP_S / 4.0, 8);
    let sensor = SensorConfig { delay_s: 0.75 * STEP_S, ..SensorConfig::default() };
    let delayed = readings(sensor, STEP_S / 4.0, 8);
    assert!((delayed[1].0[1] - fine[1].0[1]).abs() < 1e-15);
    assert!((delayed[2].0[1] - fine[5].0[1]).abs() < 1e-15);
    assert!((delayed[2].0[1] - fine[8].0[1]).abs() > 1e-8, "the delay is seen");
}
