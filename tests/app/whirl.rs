//! Whirl of a shaft against figures of another program (Python, numpy; checked against ROSS by `scripts/whirl_peers.py`).

use magnetic_bearing::studies::whirl::Whirl;
use std::f64::consts::PI;

fn shaft(damping_ns_m: f64) -> Whirl {
    Whirl {
        m_kg: 12.0,
        inertia_kgm2: [0.16, 0.02],
        bearings_m: [-0.12, 0.15],
        stiffness_n_m: 2e6,
        damping_ns_m,
        unbalances: [[8e-5, 0.7, -0.08], [5e-5, -1.9, 0.10]],
    }
}

#[test]
fn frequencies_and_response_are_those_of_another_program() {
    // rpm; backward 1, 2 and forward 1, 2 in Hz without damping; µm and rad at A and B with damping.
    const RESPONSE: [(f64, [f64; 4], Option<[f64; 4]>); 4] = [
        (0.0, [109.635625, 90.039217, 90.039217, 109.635625], None),
        (3000.0, [106.863871, 89.731257, 90.276580, 112.568549], Some([4.042961, 0.552840, 1.795886, -1.628717])),
        (6000.0, [104.282581, 89.323290, 90.463459, 115.642412], Some([15.411339, -2.659019, 50.748982, -2.406197])),
        (12000.0, [99.866442, 88.030705, 90.736268, 122.160879], Some([16.941726, -2.354873, 15.347813, 1.258659])),
    ];
    for (rpm, frequencies, response) in RESPONSE {
        let [b1, b2, f1, f2] = shaft(0.0).frequencies_hz(rpm * PI / 30.0);
        for (found, expected) in [-b1, -b2, f1, f2].into_iter().zip(frequencies) {
            assert!((found / expected - 1.0).abs() < 1e-7, "{rpm} rpm: {found} Hz, expected {expected}");
        }
        let Some([a_um, a_rad, b_um, b_rad]) = response else { continue };
        let found = shaft(200.0).response_m(rpm * PI / 30.0).map(|u| [1e6 * u.norm(), u.arg()]);
        for (found, expected) in found.concat().into_iter().zip([a_um, a_rad, b_um, b_rad]) {
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
