//! The sensitivity function: linearisation against simulation.

use magnetic_bearing::bearing::coil::{CoilConfig, Drive};
use magnetic_bearing::control::controller::ControllerConfig;
use magnetic_bearing::control::tracking::TrackingConfig;
use magnetic_bearing::plant::PlantConfig;
use magnetic_bearing::studies::sensitivity::{SampledLoop, zone};
use nalgebra::DMatrix;

/// Static load, (y, z), in N: one magnet, and always the same, pulls with the least force.
const LOAD_N: [f64; 2] = [10.0, -20.0];
const TRUE_LAMBDA: [f64; 3] = [1.8e-6, 2.0e-6, 2.2e-6];
const FIRST_GUESS: [f64; 3] = [4e-6; 3];

fn loop_of(drive: Drive, lambda: [f64; 3]) -> SampledLoop {
    let coil = CoilConfig { drive, ..CoilConfig::default() };
    let plant = PlantConfig { coil: coil.clone(), ..PlantConfig::default() };
    let controller =
        ControllerConfig { law: TrackingConfig { coil, ..TrackingConfig::default() }, ..ControllerConfig::default() };
    SampledLoop::new(&plant, &controller, lambda, LOAD_N).expect("settled")
}

/// The largest modulus of an eigenvalue by Gelfand's formula, `|A^n|^(1/n)` with n = 2^20.
///
/// The states of the loop have units as different as m and A; the Schur decomposition of nalgebra does not balance the matrix
/// and reports an eigenvalue of 2.08 for the loop with voltage drive, whose poles are all within the unit circle.
fn spectral_radius(a: &DMatrix<f64>) -> f64 {
    let (mut power, mut logarithm, mut n) = (a.clone(), 0.0, 1.0);
    for _ in 0..20 {
        let norm = power.norm();
        logarithm += norm.ln() / n;
        power /= norm;
        power = &power * &power;
        n *= 2.0;
    }
    logarithm.exp()
}

#[test]
fn injection_in_time_confirms_the_linearisation() {
    /// Difference of the two as complex numbers. The sine of 0.02 µm moves the gap by 4·10⁻⁵ of itself, which leaves a
    /// curvature of that order; ten times the amplitude brings the amplifiers to their limit at 2 kHz.
    const DIFFERENCE: f64 = 1e-4;
    const AMPLITUDE_M: f64 = 0.02e-6;
    for drive in [Drive::Current, Drive::Voltage] {
        for lambda in [FIRST_GUESS, TRUE_LAMBDA] {
            let sampled = loop_of(drive, lambda);
            let linear = sampled.linearise().expect("linearised");
            let radius = spectral_radius(linear.transition());
            assert!(radius < 1.0, "{drive:?} {lambda:?}: the loop settled, but its poles reach {radius}");
            let mut largest: f64 = 0.0;
            for axis in 0..2 {
                for periods in [2, 10, 30, 60, 100, 200, 400] {
                    let (omega, injected) = sampled.inject(axis, AMPLITUDE_M, periods, 2000).expect("runs");
                    let computed = linear.sensitivity(omega).expect("no pole")[axis][axis];
                    largest = largest.max((injected - computed).norm());
                }
            }
            println!("{drive:?} {lambda:?}: radius {radius:.4}, largest difference {largest:.2e}");
            assert!(largest < DIFFERENCE, "{drive:?} {lambda:?}: {largest:e} is above {DIFFERENCE:e}");
        }
    }
}

#[test]
fn slow_errors_are_followed_and_fast_ones_pass() {
    for drive in [Drive::Current, Drive::Voltage] {
        let linear = loop_of(drive, TRUE_LAMBDA).linearise().expect("linearised");
        // The observer of the perturbation integrates: the rotor follows a constant sensor error, so that
        // the reading does not move. With one integrator what is left at 1 rad/s is at most of the order of 1 rad/s over the
        // poles of the tracking, 1000 rad/s; measured 5e-5.
        let slow = linear.sensitivity(1.0).expect("no pole")[0][0].norm();
        assert!(slow < 1e-3, "{drive:?}: |S| = {slow:e} at 1 rad/s");
        let fast = linear.sensitivity(0.99 * std::f64::consts::PI / 1e-4).expect("no pole")[0][0].norm();
        assert!((fast - 1.0).abs() < 0.3, "{drive:?}: |S| = {fast} near half the sampling frequency");
    }
}

#[test]
fn zones_are_those_of_the_standard() {
    let zones = [2.99, 3.0, 3.99, 4.0, 4.99, 5.0, f64::INFINITY, f64::NAN].map(zone);
    assert_eq!(zones, ['A', 'B', 'B', 'C', 'C', 'D', 'D', 'D']);
}

#[test]
fn a_loop_that_does_not_settle_says_so() {
    let plant = PlantConfig::default();
    let controller = ControllerConfig::default();
    // Twenty times too large: the forces are a twentieth of those commanded, and the rotor falls.
    let error = SampledLoop::new(&plant, &controller, [4e-5; 3], LOAD_N).expect_err("no operating point");
    assert!(error.to_string().contains("does not settle"), "{error}");
}
