//! The reference trajectory: derivatives, angle over time, and external references.

use std::f64::consts::{PI, TAU};

use magnetic_bearing::bearing::magnet::Magnets;
use magnetic_bearing::control::observer::{PerturbationObserver, Signal, SignalObserver, gains_of_three};
use magnetic_bearing::control::reference::Transition;
use magnetic_bearing::control::reference::{Contour, Reference, ReferenceConfig, Shape};

const STEP_S: f64 = 1e-4;
const OMEGA_RAD_S: f64 = TAU * 50.0;

/// Error of a central difference of sixth order relative to the derivative, at the step used here.
const DIFFERENCE: f64 = 1e-8;

/// Distance between two poles as the coefficients of their polynomial show it: a few roundings.
const COEFFICIENT: f64 = 1e-12;

fn below(what: &str, value: f64, limit: f64) {
    assert!(value <= limit, "{what}: {value:e} is above the limit {limit:e}");
}

fn magnets() -> Magnets {
    Magnets::new(5e-4, [PI, -PI / 3.0, PI / 3.0]).expect("geometry")
}

fn reference(config: ReferenceConfig) -> Reference {
    Reference::new(config, STEP_S, &magnets()).expect("reference")
}

fn lobes() -> ReferenceConfig {
    ReferenceConfig { shape: Shape::Lobes, lobes: 5, lobe_amplitude_m: 8e-6, ..ReferenceConfig::default() }
}

/// Sixth-order central difference of `f` at 0.
fn difference(h: f64, f: impl Fn(f64) -> f64) -> f64 {
    (45.0 * (f(h) - f(-h)) - 9.0 * (f(2.0 * h) - f(-2.0 * h)) + (f(3.0 * h) - f(-3.0 * h))) / (60.0 * h)
}

#[test]
fn the_path_is_the_one_described() {
    let [y, z] = reference(lobes()).curve().point(0.3, OMEGA_RAD_S);
    let r = 8e-6 * (5.0f64 * 0.3).cos();
    below("Y* in m", (y.position_m - (30e-6 + r) * 0.3f64.cos()).abs(), 1e-18);
    below("Z* in m", (z.position_m - (70e-6 + r) * 0.3f64.sin()).abs(), 1e-18);
    // An ellipse ignores the lobes.
    let [y, z] = reference(ReferenceConfig { shape: Shape::Ellipse, ..lobes() }).curve().point(0.3, OMEGA_RAD_S);
    below("Y* in m", (y.position_m - 30e-6 * 0.3f64.cos()).abs(), 1e-18);
    below("Z* in m", (z.position_m - 70e-6 * 0.3f64.sin()).abs(), 1e-18);
}

#[test]
fn derivatives_agree_with_differences() {
    for config in [ReferenceConfig::default(), lobes()] {
        let reference = reference(config);
        for i in 0..100 {
            let theta = 0.0631 * f64::from(i);
            for a in 0..2 {
                let at = |t: f64| reference.curve().point(theta + OMEGA_RAD_S * t, OMEGA_RAD_S)[a];
                // The scale of a derivative is that of the lobes' own.
                let scale = 1e-4 * 5.0 * OMEGA_RAD_S;
                let v = difference(2e-5, |t| at(t).position_m);
                below("velocity", (v - at(0.0).velocity_m_s).abs(), DIFFERENCE * scale);
                let acceleration = difference(2e-5, |t| at(t).velocity_m_s);
                let scale = scale * 5.0 * OMEGA_RAD_S;
                below("acceleration", (acceleration - at(0.0).acceleration_m_s2).abs(), DIFFERENCE * scale);
            }
        }
    }
}

#[test]
fn the_angle_does_not_drift_and_follows_a_change_of_speed() {
    /// Error of θ = ωt after a million samples: roundings of a number of 3·10⁴ rad.
    const ANGLE_RAD: f64 = 2e-11;
    let reference = reference(ReferenceConfig::default());
    let mut state = reference.start();
    let last = 1_000_000u32;
    for _ in 0..=last {
        reference.sample(&mut state, OMEGA_RAD_S, [0.0; 2], [0.0; 2]);
    }
    let theta = reference.theta_rad(&state);
    below("θ in rad", (theta - OMEGA_RAD_S * (f64::from(last) * STEP_S)).abs(), ANGLE_RAD);

    // A speed given at a sample holds from this sample on; the angle does not jump.
    reference.sample(&mut state, 2.0 * OMEGA_RAD_S, [0.0; 2], [0.0; 2]);
    let at_change = reference.theta_rad(&state);
    below("θ at the change", (at_change - theta - OMEGA_RAD_S * STEP_S).abs(), ANGLE_RAD);
    reference.sample(&mut state, 2.0 * OMEGA_RAD_S, [0.0; 2], [0.0; 2]);
    let after = reference.theta_rad(&state);
    below("θ after the change", (after - at_change - 2.0 * OMEGA_RAD_S * STEP_S).abs(), ANGLE_RAD);
    let [ahead, _] = reference.ahead(&state, STEP_S);
    let [point, _] = reference.curve().point(after + 2.0 * OMEGA_RAD_S * STEP_S, 2.0 * OMEGA_RAD_S);
    assert_eq!(ahead, point);
}

#[test]
fn a_cubic_from_outside_is_followed_without_lag() {
    /// Rounding of derivatives found by differencing positions of 50 µm every 0.1 ms, in m, m/s and m/s².
    const LIMITS: [f64; 3] = [1e-16, 1e-13, 1e-9];
    let reference = reference(ReferenceConfig { shape: Shape::External, ..ReferenceConfig::default() });
    let cubic = |t: f64| {
        let r = 50e-6 + t * (-2e-3 + t * (0.05 + 0.7 * t));
        [r, -2e-3 + t * (0.1 + 2.1 * t), 0.1 + 4.2 * t]
    };
    let mut state = reference.start();
    let mut t = 0.0;
    for k in 0..1000 {
        t = f64::from(k) * STEP_S;
        reference.sample(&mut state, OMEGA_RAD_S, [0.0; 2], [cubic(t)[0], -cubic(t)[0]]);
    }
    let [y, z] = reference.ahead(&state, 2.0 * STEP_S);
    let expected = cubic(t + 2.0 * STEP_S);
    for (j, (value, mirrored)) in
        [(y.position_m, z.position_m), (y.velocity_m_s, z.velocity_m_s), (y.acceleration_m_s2, z.acceleration_m_s2)]
            .into_iter()
            .enumerate()
    {
        below(&format!("derivative {j}"), (value - expected[j]).abs(), LIMITS[j]);
        assert_eq!(value, -mirrored);
    }
}

#[test]
fn a_reference_from_outside_starts_at_its_first_sample_at_rest() {
    let reference = reference(ReferenceConfig { shape: Shape::External, ..ReferenceConfig::default() });
    let mut state = reference.start();
    reference.sample(&mut state, OMEGA_RAD_S, [0.0; 2], [20e-6, -10e-6]);
    let [y, z] = reference.ahead(&state, 2.0 * STEP_S);
    assert_eq!([y.position_m, y.velocity_m_s, y.acceleration_m_s2], [20e-6, 0.0, 0.0]);
    assert_eq!([z.position_m, z.velocity_m_s, z.acceleration_m_s2], [-10e-6, 0.0, 0.0]);
}

/// Coefficients of det(zI − M), highest power first, by Faddeev and LeVerrier.
fn characteristic<const N: usize>(m: [[f64; N]; N]) -> Vec<f64> {
    let mut coefficients = vec![1.0];
    let mut b = [[0.0; N]; N];
    for k in 1..=N {
        // B ← M B + c I, with the coefficient found last.
        let last = coefficients[k - 1];
        let mut next: [[f64; N]; N] =
            std::array::from_fn(|i| std::array::from_fn(|j| (0..N).map(|l| m[i][l] * b[l][j]).sum()));
        for (i, row) in next.iter_mut().enumerate() {
            row[i] += last;
        }
        b = next;
        let trace: f64 = (0..N).map(|i| (0..N).map(|l| m[i][l] * b[l][i]).sum::<f64>()).sum();
        coefficients.push(-trace / k as f64);
    }
    coefficients
}

/// Coefficients of `(z − ρ)ᴺ`, highest power first.
fn all_at(rho: f64, n: usize) -> Vec<f64> {
    let mut coefficients = vec![1.0];
    for _ in 0..n {
        let shifted = coefficients.iter().map(|c| -rho * c);
        let mut next: Vec<f64> = coefficients.clone();
        next.push(0.0);
        for (c, s) in next[1..].iter_mut().zip(shifted) {
            *c += s;
        }
        coefficients = next;
    }
    coefficients
}

#[test]
fn the_observers_have_their_poles_where_they_are_wanted() {
    // A step of 1 s keeps the numbers near 1; the gains depend on the step by their units alone, see below.
    for bandwidth in [0.05, 0.4, 2.0] {
        let rho = (-bandwidth * 1.0f64).exp();
        // The error's map, column by column: predict a unit vector, then update against a measurement of 0. The columns
        // stand as rows here; the transpose has the same polynomial.
        let three = PerturbationObserver::new(bandwidth, 1.0);
        let m: [[f64; 3]; 3] = std::array::from_fn(|j| {
            let unit = std::array::from_fn(|i| f64::from(i == j));
            three.update(three.predict(unit, 0.0), 0.0)
        });
        for (c, wanted) in characteristic(m).into_iter().zip(all_at(rho, 3)) {
            below("coefficient, three", (c - wanted).abs(), COEFFICIENT);
        }
        let four = SignalObserver::new(bandwidth, 1.0);
        let m: [[f64; 4]; 4] = std::array::from_fn(|j| {
            let unit = Signal(std::array::from_fn(|i| f64::from(i == j)));
            four.update(unit, 0.0).0
        });
        for (c, wanted) in characteristic(m).into_iter().zip(all_at(rho, 4)) {
            below("coefficient, four", (c - wanted).abs(), COEFFICIENT);
        }
    }
    let [l_1, l_2, l_3] = gains_of_three(4000.0, 1e-4);
    let scaled = gains_of_three(0.4, 1.0);
    for (gain, wanted) in [l_1, l_2 * 1e-4, l_3 * 1e-8].into_iter().zip(scaled) {
        below("gain in units of the step", (gain / wanted - 1.0).abs(), COEFFICIENT);
    }
}

#[test]
fn an_observer_finds_a_constant_perturbation() {
    let observer = PerturbationObserver::new(4000.0, STEP_S);
    let (force, d) = (1.5, -4.0);
    let mut truth = [20e-6, 3e-3, d];
    let mut estimate = [20e-6, 0.0, 0.0];
    for _ in 0..200 {
        truth = observer.predict(truth, force);
        estimate = observer.update(observer.predict(estimate, force), truth[0]);
    }
    below("perturbation per mass in m/s²", (estimate[2] - d).abs(), 1e-6);
    below("velocity in m/s", (estimate[1] - truth[1]).abs(), 1e-10);
}

#[test]
fn bad_references_are_refused_by_name() {
    let default = ReferenceConfig::default;
    let cases: [(ReferenceConfig, &[&str]); 8] = [
        (ReferenceConfig { r_y_m: -1e-6, ..default() }, &["reference.rY"]),
        (
            ReferenceConfig { r_z_m: f64::NAN, omega_rad_s: f64::INFINITY, ..default() },
            &["reference.rZ", "reference.omega"],
        ),
        (ReferenceConfig { lobe_amplitude_m: f64::NAN, ..default() }, &["reference.lobeAmplitude"]),
        (ReferenceConfig { lobes: 1_000_000, ..default() }, &["reference.lobes"]),
        (ReferenceConfig { bandwidth_rad_s: 0.0, ..default() }, &["bandwidth.reference"]),
        (ReferenceConfig { r_y_m: 6e-4, ..default() }, &["reference.rY"]),
        (ReferenceConfig { r_z_m: 5e-4, ..default() }, &["reference.rZ"]),
        (ReferenceConfig { lobe_amplitude_m: -4.5e-4, ..lobes() }, &["reference.lobeAmplitude"]),
    ];
    for (config, names) in cases {
        let found = Reference::new(config.clone(), STEP_S, &magnets()).expect_err(&format!("{config:?}"));
        let found: Vec<_> = found.iter().map(|finding| finding.name.as_ref()).collect();
        assert_eq!(found, names, "{config:?}");
    }
}

/// A trajectory with lobes as a Fourier series: `cos 3θ cos θ = (cos 2θ + cos 4θ)/2`, `cos 3θ sin θ = (sin 4θ − sin 2θ)/2`.
#[test]
fn a_fourier_series_is_the_lobes_it_is_the_series_of() {
    let magnets = Magnets::new(5e-4, ReferenceMagnets::ALPHA).expect("magnets");
    let (r, a) = (50e-6, 20e-6);
    let mut contour = Contour::default();
    contour.cos_y_m[0] = r;
    contour.sin_z_m[0] = r;
    (contour.cos_y_m[1], contour.cos_y_m[3]) = (0.5 * a, 0.5 * a);
    (contour.sin_z_m[1], contour.sin_z_m[3]) = (-0.5 * a, 0.5 * a);
    let lobes =
        ReferenceConfig { shape: Shape::Lobes, r_y_m: r, r_z_m: r, lobe_amplitude_m: a, ..ReferenceConfig::default() };
    let series = ReferenceConfig { shape: Shape::Fourier, contour, ..ReferenceConfig::default() };
    let [lobes, series] = [lobes, series].map(|config| Reference::new(config, 1e-4, &magnets).expect("reference"));
    for k in 0..50 {
        let theta = 0.13 * f64::from(k);
        for (one, other) in lobes.curve().point(theta, 314.0).into_iter().zip(series.curve().point(theta, 314.0)) {
            // Roundings of sums of a few terms, relative to r, r ω, 10 r ω².
            assert!((one.position_m - other.position_m).abs() < 1e-18);
            assert!((one.velocity_m_s - other.velocity_m_s).abs() < 1e-15);
            assert!((one.acceleration_m_s2 - other.acceleration_m_s2).abs() < 1e-12);
        }
    }
}

/// A lift and a ramp: begin and end, and derivatives that are those of the positions.
#[test]
fn a_smooth_start_is_smooth() {
    let magnets = Magnets::new(5e-4, ReferenceMagnets::ALPHA).expect("magnets");
    let config = ReferenceConfig {
        transition: Transition { lift_s: 0.02, start_s: 0.01, ramp_s: 0.03 },
        ..ReferenceConfig::default()
    };
    let reference = Reference::new(config, 1e-4, &magnets).expect("reference");
    let plain = Reference::new(ReferenceConfig::default(), 1e-4, &magnets).expect("reference");
    let (mut state, mut other) = (reference.start(), plain.start());
    for k in 0..600 {
        reference.sample(&mut state, 314.0, [1e-5, -2.5e-4], [0.0; 2]);
        plain.sample(&mut other, 314.0, [0.0; 2], [0.0; 2]);
        let at = |ahead_s: f64| reference.ahead(&state, ahead_s);
        let h = 1e-6;
        for a in 0..2 {
            let (before, here, after) = (at(-h)[a], at(0.0)[a], at(h)[a]);
            if k > 0 {
                let slope = (after.position_m - before.position_m) / (2.0 * h);
                // Third derivatives of up to 2e3 m/s³ times h²/6, and rounding of 1e-19/h.
                assert!((slope - here.velocity_m_s).abs() < 1e-9, "{k}: {slope} {}", here.velocity_m_s);
                let slope = (after.velocity_m_s - before.velocity_m_s) / (2.0 * h);
                // At the seams the third derivative jumps, by up to 2e3 m/s³, over h.
                assert!((slope - here.acceleration_m_s2).abs() < 2e-3, "{k}: {slope} {}", here.acceleration_m_s2);
            }
            if k == 0 {
                assert_eq!((here.position_m, here.velocity_m_s), ([1e-5, -2.5e-4][a], 0.0));
            }
            if k > 400 {
                assert_eq!(here, plain.ahead(&other, 0.0)[a]);
            }
        }
    }
}

struct ReferenceMagnets;

impl ReferenceMagnets {
    const ALPHA: [f64; 3] = [std::f64::consts::PI, -std::f64::consts::FRAC_PI_3, std::f64::consts::FRAC_PI_3];
}

#[test]
fn bad_starts_and_contours_are_refused_by_name() {
    let magnets = Magnets::new(5e-4, ReferenceMagnets::ALPHA).expect("magnets");
    let names = |config: ReferenceConfig| -> Vec<String> {
        let found = Reference::new(config, 1e-4, &magnets).expect_err("a refusal");
        found.into_iter().map(|finding| finding.name.into_owned()).collect()
    };
    let bad = ReferenceConfig {
        transition: Transition { start_s: -1.0, ramp_s: f64::NAN, lift_s: -1.0 },
        ..ReferenceConfig::default()
    };
    assert_eq!(names(bad), ["reference.startTime", "reference.rampTime", "reference.liftTime"]);
    let mut contour = Contour::default();
    contour.sin_z_m[2] = 6e-4;
    assert_eq!(
        names(ReferenceConfig { shape: Shape::Fourier, contour, ..ReferenceConfig::default() }),
        ["reference.sinZ[3]"]
    );
    let mut contour = Contour::default();
    contour.cos_y_m[7] = f64::NAN;
    assert_eq!(names(ReferenceConfig { contour, ..ReferenceConfig::default() }), ["reference.cosY[8]"]);
}
