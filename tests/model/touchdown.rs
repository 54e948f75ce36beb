//! The backup bearing: no force without contact, only pushes, and a rotor that stays inside.

use crate::prelude::*;
use magnetic_bearing::bearing::touchdown::TouchdownConfig;

const CLEARANCE_M: f64 = 2.5e-4;

/// A rotor without currents that falls under gravity along z.
fn falling(touchdown: TouchdownConfig) -> PlantConfig {
    PlantConfig {
        gravity_m_s2: [0.0, -9.81],
        position_m: [0.0; 2],
        velocity_m_s: [0.0; 2],
        touchdown: [touchdown],
        sensor: SensorConfig { step_s: 1.0, ..SensorConfig::default() },
        ..PlantConfig::default()
    }
}

/// The states after each step, without currents.
fn run(config: &PlantConfig, omega_rad_s: f64, duration_s: f64, steps: i32) -> Vec<PlantState> {
    let plant = Plant::new(config.clone()).expect("plant");
    let mut state = plant.start(0.0);
    let h = duration_s / f64::from(steps);
    let input = PlantInput { omega_rad_s, ..PlantInput::default() };
    let step = |k: i32| {
        plant.advance(&mut state, &InputTrajectory::held(&input), f64::from(k) * h, h).expect("advance");
        state.clone()
    };
    (0..steps).map(step).collect()
}

/// Free fall, half an oscillation on the spring, and the rebound.
#[test]
fn a_bounce_without_damping_follows_the_closed_form() {
    /// Error of the position, in m: the spring deflects by 26 µm in steps of a tenth of a radian with relative errors of about 1e-7,
    /// over three bounces; measured 4.1e-11.
    const POSITION_M: f64 = 1e-10;
    let ring = TouchdownConfig { damping_ns_m: 0.0, ..TouchdownConfig::default() };
    let config = falling(ring.clone());
    let (g, omega) = (9.81, (ring.stiffness_n_m / config.rotor.shaft.m_kg).sqrt());
    let fall_s = (2.0 * CLEARANCE_M / g).sqrt();
    let v = g * fall_s;
    // On the spring: δ = g/ω² (1 − cos) + v/ω sin, back at 0 with −v.
    let contact_s = 2.0 / omega * (std::f64::consts::PI - (v * omega / g).atan());
    let wanted = |t: f64| {
        let period = 2.0 * fall_s + contact_s;
        let t = t % period;
        let height = |t: f64| -0.5 * g * t * t;
        if t < fall_s {
            height(t)
        } else if t < fall_s + contact_s {
            let x = omega * (t - fall_s);
            -CLEARANCE_M - (g / omega / omega * (1.0 - x.cos()) + v / omega * x.sin())
        } else {
            height(period - t)
        }
    };
    let steps = 400;
    let duration_s = 0.05;
    let mut largest: f64 = 0.0;
    let mut touched = 0;
    for (k, state) in run(&config, 0.0, duration_s, steps).iter().enumerate() {
        let t = duration_s * (k + 1) as f64 / f64::from(steps);
        largest = largest.max((state.motion.position_m[1] - wanted(t)).abs());
        touched += usize::from(state.contact[0]);
    }
    assert!(touched > 3, "touched at {touched} instants only: the test shows nothing");
    below("position, m", largest, POSITION_M);
}

#[test]
fn the_rotor_comes_to_rest_at_its_static_deflection() {
    let config = falling(TouchdownConfig::default());
    let states = run(&config, 0.0, 2.0, 2000);
    let last = &states[states.len() - 1];
    let depth = config.rotor.shaft.m_kg * 9.81 / config.touchdown[0].stiffness_n_m;
    below("depth, m", (last.motion.position_m[1] + CLEARANCE_M + depth).abs(), 1e-9);
    assert!(last.contact[0]);
    // Energy only decreases: no bounce is higher than the one before.
    let heights: Vec<_> = states.iter().map(|state| (state.motion.position_m[1], state.contact[0])).collect();
    let is_top = |w: &&[(f64, bool)]| !w[1].1 && w[1].0 >= w[0].0.max(w[2].0);
    let tops: Vec<f64> = heights.windows(3).filter(is_top).map(|w| w[1].0).collect();
    assert!(tops.len() > 2 && tops.windows(2).all(|pair| pair[1] <= pair[0] + 1e-9), "{tops:?}");
}

#[test]
fn before_contact_the_ring_changes_no_bit() {
    let none = TouchdownConfig { clearance_m: 1.0, ..TouchdownConfig::default() };
    let hard = TouchdownConfig { stiffness_n_m: 1e9, friction: 0.3, ..TouchdownConfig::default() };
    // 7 ms of free fall: 240 µm.
    let [with, without] = [hard, none].map(|ring| run(&falling(ring), 0.0, 0.007, 70));
    for (a, b) in with.iter().zip(&without) {
        assert_eq!((&a.motion, a.contact), (&b.motion, [false]));
    }
    assert!(with[69].motion.position_m[1] < -0.9 * CLEARANCE_M, "{:?}", with[69].motion.position_m);
}

#[test]
fn it_never_pulls_and_damps() {
    let ring = TouchdownConfig::default();
    // In contact but leaving fast: the damping force would exceed that of the spring.
    assert!(!ring.touches([0.0, -CLEARANCE_M - 1e-6], [0.0, 0.5]));
    assert!(ring.touches([0.0, -CLEARANCE_M - 1e-6], [0.0, 0.0]));
    assert!(!ring.touches([0.0, -CLEARANCE_M + 1e-9], [0.0, -0.5]), "not yet there");
    let [y, z] = ring.force_n([0.0, -CLEARANCE_M - 1e-6], [0.0, -0.01], 0.0);
    assert_eq!(y, 0.0);
    below("push, N", (z - (ring.stiffness_n_m * 1e-6 + ring.damping_ns_m * 0.01)).abs(), 1e-6);
}

/// Friction drags a rotor that turns from y towards z backwards at the contact: at the bottom, towards −y.
#[test]
fn friction_drags_against_the_surface() {
    let ring = TouchdownConfig { friction: 0.2, ..TouchdownConfig::default() };
    let at = [0.0, -CLEARANCE_M - 1e-5];
    let [y, z] = ring.force_n(at, [0.0; 2], 300.0);
    below("friction over push", (y.abs() / z - 0.2).abs(), 1e-5);
    // At the bottom the surface moves towards +y.
    assert!(y < 0.0, "{y}");
    let [back, _] = ring.force_n(at, [0.0; 2], -300.0);
    assert_eq!(back, -y);
    let [rest, _] = ring.force_n(at, [0.0; 2], 0.0);
    assert_eq!(rest, 0.0);
}

/// Friction drives a turning rotor into backward whirl around the ring; the damper of the ring's mount stops it.
///
/// Fails if the damper acts along the radius only: the whirl then grows until the rotor reaches a magnet.
#[test]
fn a_rotor_thrown_at_the_ring_stays_inside_whatever_the_ring() {
    // Stiffness, damping and friction of the ring, the rotor's speed in rad/s, and the samples.
    for (stiffness_n_m, damping_ns_m, friction, omega_rad_s, samples) in [
        (5e7, 5e3, 0.0, 0.0, 1000),
        (1e9, 0.0, 0.0, 0.0, 1000),
        (2e8, 1e5, 0.05, 0.0, 1000),
        (5e7, 5e3, 0.05, 0.0, 1000),
        (1e9, 1e6, 0.1, 0.0, 1000),
        (5e7, 5e3, 0.05, 314.0, 5000),
        (5e7, 5e3, 0.1, 314.0, 5000),
        (5e7, 5e3, 0.15, 314.0, 5000),
    ] {
        let ring = TouchdownConfig { stiffness_n_m, damping_ns_m, friction, ..TouchdownConfig::default() };
        let config = PlantConfig { velocity_m_s: [0.3, -0.4], ..falling(ring.clone()) };
        let states = run(&config, omega_rad_s, 1e-4 * f64::from(samples), samples);
        assert!(states.iter().any(|state| state.contact[0]), "{ring:?}");
        let largest =
            states.iter().map(|state| state.motion.position_m[0].hypot(state.motion.position_m[1])).fold(0.0, f64::max);
        below(&format!("{ring:?}, {omega_rad_s} rad/s: distance from the centre, m"), largest, 4.6e-4);
    }
}
