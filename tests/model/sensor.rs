//! Sensor errors: each alone, and none at all.

use magnetic_bearing::plant::{Plant, PlantConfig, PlantInput, SensorConfig};

const STEP_S: f64 = 1e-4;

/// Readings of positions, and true positions, at every sample.
fn readings(sensor: SensorConfig, step_s: f64, steps: usize) -> Vec<([f64; 2], [f64; 3], [f64; 2])> {
    let plant = Plant::new(PlantConfig { sensor, ..PlantConfig::default() }).expect("plant");
    let mut state = plant.start(0.0);
    let mut all = vec![(state.measured.position_m, state.measured.current_a, state.position_m)];
    for k in 0..steps {
        let i = 1.0 + 0.01 * k as f64;
        let input = PlantInput { current_a: [i; 3], ..PlantInput::default() };
        let before = state.samples;
        plant.advance(&mut state, &input, k as f64 * step_s, step_s).expect("advance");
        assert!(state.samples - before <= 1);
        if state.samples > before {
            all.push((state.measured.position_m, state.measured.current_a, state.position_m));
        }
    }
    all
}

#[test]
fn gain_offset_and_resolution_are_what_they_say() {
    let sensor = SensorConfig {
        position_gain_error: [0.01, -0.02],
        position_offset_m: [1e-6, -2e-6],
        current_gain_error: [0.1, 0.0, 0.0],
        current_offset_a: [0.0, 0.05, 0.0],
        ..SensorConfig::default()
    };
    for (position, current, truth) in &readings(sensor, STEP_S, 20)[1..] {
        assert!((position[0] - (1.01 * truth[0] + 1e-6)).abs() < 1e-18);
        assert!((position[1] - (0.98 * truth[1] - 2e-6)).abs() < 1e-18);
        assert!((current[0] / current[2] - 1.1).abs() < 1e-12);
        assert!((current[1] - current[2] - 0.05).abs() < 1e-12);
    }
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
fn a_delay_shows_what_was_there_before() {
    let exact = readings(SensorConfig::default(), STEP_S, 40);
    for late in [1, 3, 16] {
        let sensor = SensorConfig { delay_s: late as f64 * STEP_S, ..SensorConfig::default() };
        let delayed = readings(sensor, STEP_S, 40);
        assert_eq!(delayed.len(), exact.len());
        for k in 0..delayed.len() {
            let (position, current, _) = exact[k.saturating_sub(late)];
            let worst = (0..2).map(|a| (delayed[k].0[a] - position[a]).abs()).fold(0.0, f64::max);
            assert!(worst < 1e-15, "delay of {late} samples, sample {k}: {worst} m");
            assert_eq!(delayed[k].1, current, "delay of {late} samples, sample {k}");
        }
    }
    // A fraction of a sample: the positions that finer sampling finds there.
    let fine = readings(SensorConfig { step_s: STEP_S / 4.0, ..SensorConfig::default() }, STEP_S / 4.0, 8);
    let sensor = SensorConfig { delay_s: 0.75 * STEP_S, ..SensorConfig::default() };
    // The same current over both samples of the fine run.
    let plant = Plant::new(PlantConfig { sensor, ..PlantConfig::default() }).expect("plant");
    let mut state = plant.start(0.0);
    for k in 0..8 {
        let input = PlantInput { current_a: [1.0 + 0.01 * f64::from(k); 3], ..PlantInput::default() };
        plant.advance(&mut state, &input, f64::from(k) * STEP_S / 4.0, STEP_S / 4.0).expect("advance");
        if k == 3 {
            assert!((state.measured.position_m[1] - fine[1].0[1]).abs() < 1e-15);
        }
    }
    assert!((state.measured.position_m[1] - fine[5].0[1]).abs() < 1e-15);
    assert!((state.measured.position_m[1] - fine[8].0[1]).abs() > 1e-8, "the delay is seen");
}
