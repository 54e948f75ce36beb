//! The reference trajectory: derivatives, angle over time, and external references.

use crate::prelude::*;

use magnetic_bearing::bearing::shaft::displacement;
use magnetic_bearing::control::observer::{PerturbationObserver, SignalObserver, gains_of_three};

const OMEGA_RAD_S: f64 = TAU * 50.0;

fn rotor() -> Rotor {
    Checks::all(|checks| Rotor::checked(RotorConfig::of(&PLANAR), checks)).expect("geometry")
}

fn checked<const N: usize, const K: usize, const B: usize>(
    config: ReferenceConfig<B>,
    rotor: &Rotor<N, K, B>,
) -> Result<Reference<N, B>, Vec<Invalid>> {
    Checks::described(&config, Rotor::<N, K, B>::MACHINE, |checks| {
        Reference::checked(config.clone(), STEP_S, rotor, checks)
    })
}

fn reference(config: ReferenceConfig) -> Reference {
    checked(config, &rotor()).expect("reference")
}

fn default() -> ReferenceConfig {
    ReferenceConfig::of(&PLANAR)
}

fn ellipse(r_y_m: f64, r_z_m: f64) -> ReferenceConfig {
    ReferenceConfig { paths: [PathConfig { r_y_m, r_z_m, ..PathConfig::default() }], ..default() }
}

fn lobes() -> ReferenceConfig {
    ReferenceConfig { shape: Shape::Lobes, lobes: 5, lobe_amplitude_m: 8e-6, ..default() }
}

/// Names of the refused parameters.
fn refused(config: ReferenceConfig) -> Vec<String> {
    let found = checked(config.clone(), &rotor()).expect_err(&format!("{config:?}"));
    found.into_iter().map(|finding| finding.name.into_owned()).collect()
}

#[test]
fn the_path_is_the_one_described() {
    let [y, z] = lobes().point(0.3, OMEGA_RAD_S);
    let r = 8e-6 * (5.0f64 * 0.3).cos();
    below("Y* in m", (y[0] - (30e-6 + r) * 0.3f64.cos()).abs(), 1e-18);
    below("Z* in m", (z[0] - (70e-6 + r) * 0.3f64.sin()).abs(), 1e-18);
    // An ellipse ignores the lobes.
    let [y, z] = ReferenceConfig { shape: Shape::Ellipse, ..lobes() }.point(0.3, OMEGA_RAD_S);
    below("Y* in m", (y[0] - 30e-6 * 0.3f64.cos()).abs(), 1e-18);
    below("Z* in m", (z[0] - 70e-6 * 0.3f64.sin()).abs(), 1e-18);
}

#[test]
fn the_angle_does_not_drift_and_follows_a_change_of_speed() {
    /// Error of θ = ωt after a million samples: roundings of a number of 3·10⁴ rad.
    const ANGLE_RAD: f64 = 2e-11;
    let reference = reference(default());
    let mut state = reference.start();
    let last = 1_000_000u32;
    for _ in 0..=last {
        reference.sample(&mut state, OMEGA_RAD_S, [0.0; 2], [0.0; 2]);
    }
    let theta = reference.theta_rad(&state);
    below("θ in rad", (theta - OMEGA_RAD_S * (f64::from(last) * STEP_S)).abs(), ANGLE_RAD);

    // A new speed applies from its sample on; the angle does not jump.
    reference.sample(&mut state, 2.0 * OMEGA_RAD_S, [0.0; 2], [0.0; 2]);
    let at_change = reference.theta_rad(&state);
    below("θ at the change", (at_change - theta - OMEGA_RAD_S * STEP_S).abs(), ANGLE_RAD);
    reference.sample(&mut state, 2.0 * OMEGA_RAD_S, [0.0; 2], [0.0; 2]);
    let after = reference.theta_rad(&state);
    below("θ after the change", (after - at_change - 2.0 * OMEGA_RAD_S * STEP_S).abs(), ANGLE_RAD);
    let [ahead, _] = reference.ahead(&state, STEP_S);
    let [point, _] = default().point(after + 2.0 * OMEGA_RAD_S * STEP_S, 2.0 * OMEGA_RAD_S);
    assert_eq!(ahead, point);
}

/// From its first sample on, at which it is at rest.
#[test]
fn an_external_cubic_is_followed_without_lag() {
    /// Rounding of derivatives obtained by differencing positions of 50 µm every 0.1 ms, in m, m/s and m/s².
    const LIMITS: [f64; 3] = [1e-16, 1e-13, 1e-9];
    let reference = reference(ReferenceConfig { shape: Shape::External, ..default() });
    let cubic = |t: f64| {
        let r = 50e-6 + t * (-2e-3 + t * (0.05 + 0.7 * t));
        [r, -2e-3 + t * (0.1 + 2.1 * t), 0.1 + 4.2 * t]
    };
    let mut state = reference.start();
    let mut t = 0.0;
    for k in 0..1000 {
        t = f64::from(k) * STEP_S;
        reference.sample(&mut state, OMEGA_RAD_S, [0.0; 2], [cubic(t)[0], -cubic(t)[0]]);
        if k == 0 {
            assert_eq!(reference.ahead(&state, 2.0 * STEP_S), [[50e-6, 0.0, 0.0], [-50e-6, 0.0, 0.0]]);
        }
    }
    let [y, z] = reference.ahead(&state, 2.0 * STEP_S);
    let expected = cubic(t + 2.0 * STEP_S);
    for (j, (value, mirrored)) in [(y[0], z[0]), (y[1], z[1]), (y[2], z[2])].into_iter().enumerate() {
        below(&format!("derivative {j}"), (value - expected[j]).abs(), LIMITS[j]);
        assert_eq!(value, -mirrored);
    }
}

#[test]
fn the_gains_place_the_poles_of_the_observers() {
    // A step of 1 s keeps the numbers near 1; the step enters the gains only through their units, see below.
    for bandwidth in [0.05f64, 0.4, 2.0] {
        let rho = (-bandwidth).exp();
        // The map of the error: predict, then update against a measurement of 0.
        let three = PerturbationObserver::new(bandwidth, 1.0);
        poles_are_at(&format!("observer of three, {bandwidth}"), [rho; 3], |error| {
            three.update(three.predict(error, 0.0), 0.0)
        });
        let four = SignalObserver::new(bandwidth, 1.0);
        poles_are_at(&format!("observer of four, {bandwidth}"), [rho; 4], |error| four.update(error, 0.0));
    }
    let [l_1, l_2, l_3] = gains_of_three(4000.0, 1e-4);
    let scaled = gains_of_three(0.4, 1.0);
    for (gain, wanted) in [l_1, l_2 * 1e-4, l_3 * 1e-8].into_iter().zip(scaled) {
        below("gain in units of the step", (gain / wanted - 1.0).abs(), 1e-12);
    }
}

/// A trajectory with lobes as a Fourier series: `cos 3θ cos θ = (cos 2θ + cos 4θ)/2`, `cos 3θ sin θ = (sin 4θ − sin 2θ)/2`.
#[test]
fn a_fourier_series_reproduces_the_lobes() {
    let (r, a) = (50e-6, 20e-6);
    let mut contour = Contour::default();
    contour.cos_y_m[0] = r;
    contour.sin_z_m[0] = r;
    (contour.cos_y_m[1], contour.cos_y_m[3]) = (0.5 * a, 0.5 * a);
    (contour.sin_z_m[1], contour.sin_z_m[3]) = (-0.5 * a, 0.5 * a);
    let lobes = ReferenceConfig { shape: Shape::Lobes, lobe_amplitude_m: a, ..ellipse(r, r) };
    let series = ReferenceConfig { shape: Shape::Fourier, contour, ..default() };
    for k in 0..50 {
        let theta = 0.13 * f64::from(k);
        for (one, other) in lobes.point(theta, 314.0).into_iter().zip(series.point(theta, 314.0)) {
            // Rounding of sums of a few terms, relative to r, r ω, 10 r ω².
            assert!((one[0] - other[0]).abs() < 1e-18);
            assert!((one[1] - other[1]).abs() < 1e-15);
            assert!((one[2] - other[2]).abs() < 1e-12);
        }
    }
}

/// Velocity and acceleration are the derivatives of the position.
fn assert_derivatives<const N: usize, const B: usize>(
    reference: &Reference<N, B>,
    state: &ReferenceState<N>,
    ahead_s: f64,
    [velocity_limit, acceleration_limit]: [f64; 2],
) {
    let h = 1e-6;
    let [before, here, after] = [-h, 0.0, h].map(|beside_s| reference.ahead(state, ahead_s + beside_s));
    for a in 0..N {
        let velocity = (after[a][0] - before[a][0]) / (2.0 * h);
        below(&format!("velocity {a} of {N}"), (velocity - here[a][1]).abs(), velocity_limit);
        let acceleration = (after[a][1] - before[a][1]) / (2.0 * h);
        let off = (acceleration - here[a][2]).abs();
        below(&format!("acceleration {a} of {N}"), off, acceleration_limit);
    }
}

/// A lift and a ramp, then more than a revolution of the trajectory: start, end, and consistent derivatives.
#[test]
fn a_smooth_start_is_smooth() {
    for plain in [default(), lobes()] {
        let transition = Transition { lift_s: 0.02, start_s: 0.01, ramp_s: 0.03 };
        let (reference, plain) = (reference(ReferenceConfig { transition, ..plain.clone() }), reference(plain));
        let (mut state, mut other) = (reference.start(), plain.start());
        let first = [1e-5, -2.5e-4];
        for k in 0..650 {
            reference.sample(&mut state, OMEGA_RAD_S, first, [0.0; 2]);
            plain.sample(&mut other, OMEGA_RAD_S, [0.0; 2], [0.0; 2]);
            let here = reference.ahead(&state, 0.0);
            if k == 0 {
                assert_eq!(here.map(|point| (point[0], point[1])), first.map(|first_m| (first_m, 0.0)));
            } else {
                // Third derivatives of up to 4e4 m/s³ times h²/6, and rounding of 1e-19/h; at the seams they jump.
                assert_derivatives(&reference, &state, 0.0, [1e-8, 2e-3]);
            }
            if k > 400 {
                assert_eq!(here, plain.ahead(&other, 0.0));
            }
        }
    }
}

#[test]
fn trajectories_that_touch_a_magnet_are_refused_by_name() {
    let mut contour = Contour::default();
    contour.sin_z_m[2] = 6e-4;
    let mut open = Contour::default();
    open.cos_y_m[7] = f64::NAN;
    for (config, name) in [
        (ellipse(6e-4, 70e-6), "reference.rY"),
        (ellipse(30e-6, 5e-4), "reference.rZ"),
        (ReferenceConfig { lobe_amplitude_m: -4.5e-4, ..lobes() }, "reference.lobeAmplitude"),
        (ReferenceConfig { shape: Shape::Fourier, contour, ..default() }, "reference.sinZ[3]"),
        (ReferenceConfig { contour: open, ..default() }, "reference.cosY[8]"),
    ] {
        assert_eq!(refused(config), [name]);
    }
}

/// The reference of a spindle.
fn of_spindle(change: impl Fn(&mut ReferenceConfig<3>)) -> Reference<5, 3> {
    let mut config = ReferenceConfig::of(&SPINDLE);
    change(&mut config);
    let rotor = Checks::all(|checks| Rotor::<5, 8, 3>::checked(RotorConfig::of(&SPINDLE), checks));
    checked(config, &rotor.expect("a spindle")).expect("reference")
}

/// Velocity and acceleration are the derivatives of the position, also while the reference grows.
#[test]
fn the_reference_of_a_spindle_is_consistent_with_its_derivatives() {
    for ramp_s in [0.0, 0.05] {
        let reference = of_spindle(|config| {
            config.transition = Transition { ramp_s, lift_s: ramp_s, ..Transition::default() };
            config.paths[1] = PathConfig { r_y_m: 60e-6, r_z_m: 25e-6, phase_rad: 1.2, ..PathConfig::default() };
            config.paths[2].amplitude_m = 20e-6;
        });
        let mut state = reference.start();
        for _ in 0..200 {
            reference.sample(&mut state, OMEGA_RAD_S, [1e-4, -1e-4, 5e-5, 1e-4, -2e-4], [0.0; 5]);
        }
        assert_derivatives(&reference, &state, 3e-5, [2e-9, 1e-3]);
    }
}

/// From rest on the backup bearings, without jumps, to the ellipses at the magnets and the axial sine.
#[test]
fn a_lift_of_a_spindle_begins_where_the_rotor_is() {
    let reference = of_spindle(|config| {
        config.transition = Transition { ramp_s: 0.05, lift_s: 0.05, start_s: 0.05 };
        (config.paths[1].phase_rad, config.paths[2].amplitude_m) = (1.2, 20e-6);
    });
    let mut state = reference.start();
    let first = [1e-4, -1e-4, 5e-5, 1e-4, -2e-4];
    reference.sample(&mut state, OMEGA_RAD_S, first, [0.0; 5]);
    for (point, first) in reference.ahead(&state, 0.0).into_iter().zip(first) {
        below("first position", (point[0] - first).abs(), 1e-20);
        below("first velocity", point[1].abs() + point[2].abs(), 1e-20);
    }
    for _ in 1..2000 {
        reference.sample(&mut state, OMEGA_RAD_S, [0.0; 5], [0.0; 5]);
    }
    let t_s = 0.1999;
    let end = reference.ahead(&state, 0.0).map(|point| point[0]);
    for (at_m, phase) in [(-0.12, 0.0), (0.15, 1.2)] {
        let angle: f64 = OMEGA_RAD_S * t_s + phase;
        let [y, z] = displacement(at_m, end);
        below("y", (y - 30e-6 * angle.cos()).abs(), 1e-15);
        below("z", (z - 70e-6 * angle.sin()).abs(), 1e-15);
    }
    below("x", (end[0] - 20e-6 * (TAU * 60.0 * t_s).sin()).abs(), 1e-15);
}
