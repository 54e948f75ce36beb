//! Whirl of a shaft against figures of another program.

use crate::support::whirl::{DAMPING_NS_M, STIFFNESS_N_M, TABLE, UNBALANCES};
use magnetic_bearing::studies::whirl::Whirl;
use std::f64::consts::PI;

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
fn frequencies_and_response_are_those_of_another_program() {
    for (rpm, frequencies, response) in TABLE {
        for (found, expected) in shaft(0.0).frequencies_hz(rpm * PI / 30.0).into_iter().zip(frequencies) {
            assert!((found / expected - 1.0).abs() < 1e-7, "{rpm} rpm: {found} Hz, expected {expected}");
        }
        let Some(response) = response else { continue };
        let found = shaft(DAMPING_NS_M).response_m(rpm * PI / 30.0).map(|u| [1e6 * u.norm(), u.arg()]);
        for (found, expected) in found.concat().into_iter().zip(response.concat()) {
            assert!(
                (found - expected).abs() < 1e-6 * expected.abs().max(1.0),
                "{rpm} rpm: {found}, expected {expected}"
            );
        }
    }
}

#[test]
fn without_speed_forward_and_backward_are_alike() {
    let [b1, b2, f1, f2] = shaft(100.0).frequencies_hz(0.0);
    assert!((b1 + f2).abs() < 1e-9 && (b2 + f1).abs() < 1e-9);
}
