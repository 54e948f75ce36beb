//! Whirl of a shaft against an independent program.

use crate::prelude::*;
use crate::support::whirl::{DAMPING_NS_M, STIFFNESS_N_M, TABLE, UNBALANCES};
use magnetic_bearing::studies::whirl::Whirl;
use nalgebra::ComplexField;

fn shaft(damping_ns_m: f64) -> Whirl {
    Whirl {
        m_kg: 12.0,
        inertia_kgm2: [0.16, 0.02],
        bearings_m: [-0.12, 0.15],
        stiffness_n_m: STIFFNESS_N_M,
        damping_ns_m,
        unbalances: UNBALANCES,
    }
}

#[test]
fn frequencies_and_response_agree_with_another_program() {
    for (rpm, frequencies, response) in TABLE {
        let [[backward_1, forward_1], [backward_2, forward_2]] = shaft(0.0).modes_hz(rpm * PI / 30.0);
        for (found, expected) in [-backward_2, -backward_1, forward_1, forward_2].into_iter().zip(frequencies) {
            assert!((found / expected - 1.0).abs() < 1e-7, "{rpm} rpm: {found} Hz, expected {expected}");
        }
        let Some(response) = response else { continue };
        let found = shaft(DAMPING_NS_M).response_m(rpm * PI / 30.0).map(|u| [1e6 * u.modulus(), u.argument()]);
        for (found, expected) in found.concat().into_iter().zip(response.concat()) {
            let limit = 1e-6 * expected.abs().max(1.0);
            assert!((found - expected).abs() < limit, "{rpm} rpm: {found}, expected {expected}");
        }
    }
}

/// At a critical speed a mode whirls forward as fast as the rotor turns, and the undamped response is unbounded.
#[test]
fn critical_speeds_are_where_a_forward_whirl_is_synchronous() {
    let whirl = shaft(0.0);
    let found = whirl.critical_rpm(12_000.0);
    assert_eq!(found.iter().map(|(mode, _)| *mode).collect::<Vec<_>>(), [1, 2]);
    for (mode, rpm) in found {
        let forward = whirl.modes_hz(rpm * PI / 30.0)[mode - 1][1];
        assert!((60.0 * forward / rpm - 1.0).abs() < 1e-9, "mode {mode}: {rpm} rpm, {forward} Hz");
        let amplitude = |rpm: f64| whirl.response_m(rpm * PI / 30.0)[0].modulus();
        assert!(amplitude(rpm) > 1e3 * amplitude(1.1 * rpm), "mode {mode}");
    }
    assert!(whirl.critical_rpm(3000.0).is_empty());
    let at_rest = whirl.modes_hz(0.0);
    let alike = |modes: [[f64; 2]; 2]| modes.iter().all(|[backward, forward]| (backward - forward).abs() < 1e-9);
    assert!(alike(at_rest), "{at_rest:?}");
    assert!(at_rest[0][0] < at_rest[1][0]);
    // Also with damping.
    assert!(alike(shaft(100.0).modes_hz(0.0)));
}
