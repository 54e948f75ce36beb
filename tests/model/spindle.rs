//! The spindle: whirl, unbalance response and precession in closed form, energy, and the planar rotor as its limit.

use crate::support::whirl::{DAMPING_NS_M, STIFFNESS_N_M, TABLE};
use std::f64::consts::PI;

use magnetic_bearing::bearing::coil::{CoilConfig, Drive};
use magnetic_bearing::bearing::scalar::Scalar;
use magnetic_bearing::bearing::shaft::Shaft;
use magnetic_bearing::bearing::spindle::{RadialBearing, Spindle, SpindleGeometry};
use magnetic_bearing::bearing::touchdown::TouchdownConfig;
use magnetic_bearing::plant::linearisation::{Point, Taylor};
use magnetic_bearing::plant::spindle::{
    SpindleConfig, SpindleInput, SpindleOutput, SpindlePlant, SpindleState, SpindleTouchdown,
};
use magnetic_bearing::plant::{Conditions, Motion, Plant, PlantConfig, PlantInput, SensorConfig, StepError};
use nalgebra::{Complex, ComplexField, SMatrix, SVector};

use crate::support::{Random, below};

const STEP_S: f64 = 1e-4;
const I: Complex<f64> = Complex { re: 0.0, im: 1.0 };

fn plant(config: SpindleConfig) -> SpindlePlant {
    Plant::new(config).expect("a plant")
}

/// A rotor on two linear bearings, without currents; `docs/spindle.md` names its parameters.
fn unbalanced() -> SpindleConfig {
    SpindleConfig {
        unbalance_kgm: [8e-5, 5e-5],
        unbalance_phase_rad: [0.7, -1.9],
        unbalance_position_m: [-0.08, 0.10],
        ..SpindleConfig::default()
    }
}

type Vector4 = SVector<Complex<f64>, 4>;
type Matrix4 = SMatrix<Complex<f64>, 4, 4>;

/// The rotor on isotropic springs and dampers at its bearings, in `(u, ψ, u', ψ')` with `u = y + i z`, `ψ = γ − i β`: the matrix
/// of its motion, and the acceleration by unbalance at the angle 0.
fn on_springs(config: &SpindleConfig, omega_rad_s: f64, stiffness_n_m: f64, damping_ns_m: f64) -> (Matrix4, Vector4) {
    let plant = plant(config.clone());
    let bearings = [config.geometry.a.position_m, config.geometry.b.position_m];
    let slope = |x: Vector4| {
        let [u, psi, du, dpsi] = [x[0], x[1], x[2], x[3]];
        let motion = Motion {
            position_m: [0.0, u.re, u.im, -psi.im, psi.re],
            velocity_m_s: [0.0, du.re, du.im, -dpsi.im, dpsi.re],
            linkage_wb: [0.0; 8],
        };
        let mut load = [0.0; 5];
        for xi in bearings {
            let force = -(u + psi * xi) * stiffness_n_m - (du + dpsi * xi) * damping_ns_m;
            load[1] += force.re;
            load[2] += force.im;
            load[3] -= xi * force.im;
            load[4] += xi * force.re;
        }
        let input = SpindleInput { perturbation_n: load, omega_rad_s, ..SpindleInput::default() };
        let Motion { position_m: v, velocity_m_s: a, .. } =
            plant.equations().derivative(&motion, &input, Conditions::default());
        let complex = |q: [f64; 5]| [Complex::new(q[1], q[2]), Complex::new(q[4], -q[3])];
        let ([v_u, v_psi], [a_u, a_psi]) = (complex(v), complex(a));
        Vector4::new(v_u, v_psi, a_u, a_psi)
    };
    let unbalance = slope(Vector4::zeros());
    let mut matrix = Matrix4::zeros();
    for column in 0..4 {
        // Small enough for the gaps, as the equations ask; they are linear without currents.
        let small = |unit: Complex<f64>| {
            let mut x = Vector4::zeros();
            x[column] = unit * 1e-5;
            (slope(x) - unbalance) * Complex::from(1e5)
        };
        let of_one = small(Complex::from(1.0));
        let turned = small(I) - of_one * I;
        below("anisotropy", turned.norm() / of_one.norm(), 1e-9);
        matrix.set_column(column, &of_one);
    }
    (matrix, unbalance)
}

/// Fails if a gyroscopic term has the other sign: forward and backward whirl are then exchanged.
#[test]
fn whirl_and_unbalance_response_are_those_of_the_table() {
    /// Of the table's digits, relative.
    const TOLERANCE: f64 = 1e-5;
    let config = unbalanced();
    for (rpm, frequencies, response) in TABLE {
        let omega = rpm * PI / 30.0;
        let (matrix, _) = on_springs(&config, omega, STIFFNESS_N_M, 0.0);
        // A complex Schur form is triangular.
        let (_, triangle) = matrix.schur().unpack();
        let mut found: Vec<f64> = triangle.diagonal().iter().map(|value| value.im / (2.0 * PI)).collect();
        found.sort_by(f64::total_cmp);
        for (found, wanted) in found.into_iter().zip(frequencies) {
            below(
                &format!("whirl at {rpm} rpm, {found} Hz against {wanted} Hz"),
                (found / wanted - 1.0).abs(),
                TOLERANCE,
            );
        }
        let Some(response) = response else { continue };
        let (matrix, unbalance) = on_springs(&config, omega, STIFFNESS_N_M, DAMPING_NS_M);
        let x = (Matrix4::identity() * (I * omega) - matrix).lu().solve(&unbalance).expect("a response");
        for (xi, [micrometres, angle]) in [-0.12, 0.15].into_iter().zip(response) {
            let at = (x[0] + x[1] * xi) * 1e6;
            below(&format!("|u| at {xi} m, {rpm} rpm: {at}"), (at.modulus() / micrometres - 1.0).abs(), TOLERANCE);
            below(&format!("phase at {xi} m, {rpm} rpm: {at}"), (at.argument() - angle).abs(), TOLERANCE);
        }
    }
}

/// Without forces the tilt turns forward at `J_p/J_t Ω`, and the angular momentum keeps its direction in space.
/// Fails if the gyroscopic moments are those of `2 J_p`.
#[test]
fn a_free_rotor_precesses() {
    for shaft in [
        Shaft { m_kg: 12.0, transverse_kgm2: 0.16, polar_kgm2: 0.02 },
        Shaft { m_kg: 12.0, transverse_kgm2: 0.05, polar_kgm2: 0.09 },
    ] {
        let omega = 1200.0;
        let geometry = SpindleGeometry { shaft, ..SpindleGeometry::default() };
        let rates = [1e-4, -2e-4, 3e-4, 4e-3, 1e-2];
        let plant = plant(SpindleConfig { geometry, velocity_m_s: rates, ..SpindleConfig::default() });
        let mut state = plant.start(0.0);
        let input = SpindleInput { omega_rad_s: omega, ..SpindleInput::default() };
        let momentum = |state: &SpindleState| {
            let [_, _, _, beta, gamma] = state.position_m;
            let [_, _, _, beta_rate, gamma_rate] = state.velocity_m_s;
            let (transverse, spin) = (shaft.transverse_kgm2, shaft.polar_kgm2 * omega);
            [transverse * beta_rate + spin * gamma, transverse * gamma_rate - spin * beta]
        };
        let start = momentum(&state);
        for k in 0..300 {
            plant.advance(&mut state, &input, f64::from(k) * STEP_S, STEP_S).expect("a step");
            let turned = Complex::new(rates[4], -rates[3])
                * (I * (shaft.polar_kgm2 / shaft.transverse_kgm2 * omega * state.time_s)).exp();
            let rate = Complex::new(state.velocity_m_s[4], -state.velocity_m_s[3]);
            // Sub-steps of 50 µs, a twentieth of a radian at the fastest.
            below("precession", (rate - turned).modulus() / turned.modulus(), 1e-4);
            for a in 0..2 {
                below("angular momentum", (momentum(&state)[a] - start[a]).abs() / start[1], 1e-12);
            }
        }
        for (position, rate) in state.position_m.into_iter().zip(rates).take(3) {
            below("the centre of gravity moves uniformly", (position - rate * state.time_s).abs(), 1e-15);
        }
    }
}

/// With constant currents the field is a potential, and gyroscopic moments do no work.
/// Fails if `G` is not skew, or if a moment does not belong to its force.
#[test]
fn energy_is_conserved() {
    let drift = |max_step_s: f64| {
        let config =
            SpindleConfig { velocity_m_s: [3e-3, 4e-3, -5e-3, 0.05, -0.03], max_step_s, ..SpindleConfig::default() };
        let plant = plant(config.clone());
        let current_a = [1.6, 1.5, -1.4, 1.3, 1.7, 1.2, 2.0, 1.8];
        let input = SpindleInput { current_a, omega_rad_s: 1200.0, ..SpindleInput::default() };
        let kinetic = |state: &SpindleState| {
            let inertia = [12.0, 12.0, 12.0, 0.16, 0.16];
            (0..5).map(|n| 0.5 * inertia[n] * state.velocity_m_s[n].powi(2)).sum::<f64>()
        };
        let energy = |state: &SpindleState| {
            let gaps = plant.outputs(state, &input, 0.0).gap_m;
            let field: f64 = (0..8).map(|k| config.lambda_nm2_a2[k] * current_a[k].powi(2) / gaps[k]).sum();
            kinetic(state) - field
        };
        let start = plant.start(0.0);
        let mut state = start.clone();
        for k in 0..80 {
            plant.advance(&mut state, &input, f64::from(k) * STEP_S, STEP_S).expect("a step");
        }
        let moved = (kinetic(&state) / kinetic(&start) - 1.0).abs();
        assert!(moved > 0.05, "the kinetic energy changed by only {moved}: the test shows nothing");
        (energy(&state) - energy(&start)).abs() / kinetic(&start)
    };
    below("energy drift, in parts of the kinetic energy at the start", drift(5e-5), 1e-8);
    below("of order four", drift(2.5e-5) / drift(5e-5), 1.0 / 12.0);
}

/// Two equal bearings in phase carry half a rotor each, with and without contact.
#[test]
fn the_planar_rotor_is_the_limit_of_equal_bearings_in_phase() {
    /// Sums of other order, and the growth of what they differ by in an unstable field over some milliseconds.
    const ROUNDING_M: f64 = 1e-14;
    for (drive, falls) in [(Drive::Current, false), (Drive::Voltage, false), (Drive::Current, true)] {
        let alpha_rad = [PI + 0.1, -PI / 3.0, PI / 3.0 - 0.05];
        let coil = CoilConfig { drive, leakage_h: 1e-3, ..CoilConfig::default() };
        let touchdown = TouchdownConfig { clearance_m: 1.2e-4, friction: 0.1, ..TouchdownConfig::default() };
        let planar = Plant::new(PlantConfig {
            alpha_rad,
            coil: coil.clone(),
            touchdown: touchdown.clone(),
            unbalance_kgm: 1e-4,
            unbalance_phase_rad: 0.4,
            velocity_m_s: [1e-3, 2e-3],
            gravity_m_s2: [0.5, if falls { -9.81 } else { -0.2 }],
            ..PlantConfig::default()
        })
        .expect("a plant");
        let bearing = |position_m| RadialBearing { position_m, sensor_position_m: position_m, gap_m: 5e-4, alpha_rad };
        let lambda = planar.config().lambda_nm2_a2;
        let spindle = plant(SpindleConfig {
            geometry: SpindleGeometry {
                shaft: Shaft { m_kg: 2.0 * 6.7, transverse_kgm2: 0.1, polar_kgm2: 0.05 },
                a: bearing(-0.1),
                b: bearing(0.1),
                ..SpindleGeometry::default()
            },
            lambda_nm2_a2: std::array::from_fn(|k| if k < 6 { lambda[k % 3] } else { 1e-6 }),
            unbalance_kgm: [1e-4; 2],
            unbalance_phase_rad: [0.4; 2],
            unbalance_position_m: [-0.15, 0.15],
            gravity_m_s2: [0.0, 0.5, if falls { -9.81 } else { -0.2 }],
            coil,
            touchdown: SpindleTouchdown { a: touchdown.clone(), b: touchdown, ..SpindleTouchdown::default() },
            position_m: [0.0, 30e-6, 0.0, 0.0, 0.0],
            velocity_m_s: [0.0, 1e-3, 2e-3, 0.0, 0.0],
            ..SpindleConfig::default()
        });
        let mut one = planar.start(0.0);
        let mut two = spindle.start(0.0);
        let (mut touched, mut worst) = (false, 0.0_f64);
        // Without control the rotor stays clear of the ring for some milliseconds.
        for k in 0..if falls { 200 } else { 40 } {
            let t = f64::from(k) * STEP_S;
            let i: [f64; 3] =
                std::array::from_fn(|n| if falls { 0.0 } else { 1.2 + 0.2 * (40.0 * t + n as f64).sin() });
            let u = i.map(|i| 1.1 * i);
            let load = [0.6, -0.4];
            let input = PlantInput { current_a: i, voltage_v: u, perturbation_n: load, omega_rad_s: 314.0 };
            let both = |of: [f64; 3]| std::array::from_fn(|k| if k < 6 { of[k % 3] } else { 0.0 });
            let inputs = SpindleInput {
                current_a: both(i),
                voltage_v: both(u),
                perturbation_n: [0.0, 2.0 * load[0], 2.0 * load[1], 0.0, 0.0],
                omega_rad_s: 314.0,
            };
            planar.advance(&mut one, &input, t, STEP_S).expect("a step");
            spindle.advance(&mut two, &inputs, t, STEP_S).expect("a step");
            touched |= one.contact;
            assert_eq!(two.contact, [one.contact, one.contact, false]);
            for a in 0..2 {
                worst = worst.max((two.position_m[1 + a] - one.position_m[a]).abs());
            }
            worst = worst.max(two.position_m[3].abs().max(two.position_m[4].abs()));
            assert_eq!(two.position_m[0], 0.0);
            for (current, wanted) in two.measured.current_a[..3].iter().zip(one.measured.current_a) {
                below("current, A", (current - wanted).abs(), 1e-10);
            }
        }
        assert_eq!(touched, falls, "contact");
        below(&format!("{drive:?}, falling: {falls}; difference, m and rad"), worst, ROUNDING_M);
    }
}

/// Against the formulas, written out: a point ξ of the axis is at `y + ξγ`, `z − ξβ`.
#[test]
fn gaps_readings_and_moments_are_those_of_the_points_of_the_axis() {
    let config = SpindleConfig::default();
    let plant = plant(config.clone());
    let [x, y, z, beta, gamma] = [2e-5, -3e-5, 4e-5, 1e-4, -2e-4];
    let alpha = [PI, -PI / 3.0, PI / 3.0];
    let gaps = plant.equations().gaps([x, y, z, beta, gamma]);
    for k in 0..6 {
        let (xi, alpha) = ([-0.12, 0.15][k / 3], alpha[k % 3]);
        let gap = 5e-4 - alpha.sin() * (y + xi * gamma) - alpha.cos() * (z - xi * beta);
        below("gap, m", (gaps[k] - gap).abs(), 1e-18);
    }
    below("axial gaps, m", (gaps[6] - (6e-4 - x)).abs() + (gaps[7] - (6e-4 + x)).abs(), 1e-18);
    let spindle = Spindle::new(config.geometry).expect("a spindle");
    let q = [x, y, z, beta, gamma];
    let readings = spindle.config().readings(q);
    let wanted = [y - 0.10 * gamma, z + 0.10 * beta, y + 0.13 * gamma, z - 0.13 * beta, x];
    let by_matrix = spindle.config().sensors::<5>().map(|row| (0..5).map(|n| row[n] * q[n]).sum::<f64>());
    for n in 0..5 {
        below("reading, m", (readings[n] - wanted[n]).abs(), 1e-19);
        below("H q, m", (by_matrix[n] - wanted[n]).abs(), 1e-19);
        below("H⁻¹ r", (spindle.coordinates(readings)[n] - q[n]).abs(), 1e-18);
    }
    // Magnet 1 of B alone pulls down, which turns the rotor about +y; magnet 2 of X pulls towards −x.
    let mut input = SpindleInput::default();
    (input.current_a[3], input.current_a[7]) = (2.0, 1.0);
    let output = plant.outputs(&plant.start(0.0), &input, 0.0);
    let [b_1, x_2] = [2.4e-6 * 4.0 / 25e-8, 2.6e-6 / 36e-8];
    for (found, wanted) in output.resultant_n.into_iter().zip([-x_2, 0.0, -b_1, 0.15 * b_1, 0.0]) {
        below("generalised force, N", (found - wanted).abs(), 1e-12);
    }
    let bearings = plant.equations().at_bearings(&plant.start(0.0).motion(), 0.0, [false; 3], output.force_n);
    below("force at B, N", (bearings.b.z_n + b_1).abs() + bearings.a.z_n.abs(), 1e-12);
    below("axial force, N", (bearings.axial_n + x_2).abs(), 1e-12);
}

/// Each sensor has its own gain, offset and noise, and reads at its own position.
#[test]
fn samples_are_taken_where_the_sensors_are() {
    let sensor = SensorConfig {
        position_offset_m: [1e-6, 2e-6, 3e-6, 4e-6, 5e-6],
        position_gain_error: [0.01, 0.02, 0.03, 0.04, 0.05],
        current_offset_a: std::array::from_fn(|k| 0.01 * k as f64),
        ..SensorConfig::default()
    };
    let config = SpindleConfig {
        position_m: [1e-5, 2e-5, -3e-5, 1e-4, 2e-4],
        velocity_m_s: [1e-3, 2e-3, -1e-3, 0.01, -0.02],
        sensor,
        ..SpindleConfig::default()
    };
    let plant = plant(config.clone());
    let mut state = plant.start(0.0);
    let current_a = std::array::from_fn(|k| 1.0 + 0.1 * k as f64);
    let input = SpindleInput { current_a, omega_rad_s: 300.0, ..SpindleInput::default() };
    plant.advance(&mut state, &input, 0.0, STEP_S).expect("a step");
    let readings = config.geometry.readings(state.position_m);
    for (n, (measured, reading)) in state.measured.position_m.into_iter().zip(readings).enumerate() {
        let wanted = (1.0 + 0.01 * (n + 1) as f64) * reading + 1e-6 * (n + 1) as f64;
        below("reading, m", (measured - wanted).abs(), 1e-18);
    }
    for k in 0..8 {
        below("current, A", (state.measured.current_a[k] - 1.0 - 0.11 * k as f64).abs(), 1e-15);
    }
    let noisy = |seed| {
        let sensor = SensorConfig { position_noise_m: 1e-7, seed, ..SensorConfig::default() };
        Plant::new(SpindleConfig { sensor, ..SpindleConfig::default() }).expect("a plant").start(0.0).measured
    };
    let [first, again, other] = [noisy(1), noisy(1), noisy(2)].map(|measured| measured.position_m);
    assert_eq!(first, again);
    for n in 0..5 {
        assert_ne!(first[n], other[n]);
        assert!((0..n).all(|m| first[m] != first[n]), "{first:?}");
    }
}

/// The weight of a horizontal shaft comes to rest in the rings, that of a vertical one on the axial stop.
#[test]
fn backup_bearings_carry_the_rotor() {
    for gravity_m_s2 in [[0.0, 0.0, -9.81], [9.81, 0.0, 0.0]] {
        let config = SpindleConfig { gravity_m_s2, ..SpindleConfig::default() };
        let plant = plant(config);
        let mut state = plant.start(0.0);
        let input = SpindleInput::default();
        for k in 0..20_000 {
            plant.advance(&mut state, &input, f64::from(k) * STEP_S, STEP_S).expect("a step");
        }
        let output = plant.outputs(&state, &input, state.time_s);
        let bearings = plant.equations().at_bearings(&state.motion(), 0.0, state.contact, output.force_n);
        if gravity_m_s2[0] == 0.0 {
            assert_eq!(state.contact, [true, true, false]);
            // The weight by the levers of the bearings, 0.12 and 0.15 m.
            below("A, N", (bearings.a.touchdown_z_n - 12.0 * 9.81 * 0.15 / 0.27).abs(), 1e-3);
            below("B, N", (bearings.b.touchdown_z_n - 12.0 * 9.81 * 0.12 / 0.27).abs(), 1e-3);
        } else {
            assert_eq!(state.contact, [false, false, true]);
            below("X, N", (bearings.axial_touchdown_n + 12.0 * 9.81).abs(), 1e-3);
            below("x, m", (state.position_m[0] - (3e-4 + 12.0 * 9.81 / 5e7)).abs(), 1e-9);
        }
        for n in 0..5 {
            below("rest, m/s", state.velocity_m_s[n].abs(), 1e-6);
        }
    }
}

/// Fails if the nearest magnet is that of another bearing.
#[test]
fn a_rotor_that_leaves_the_gap_is_told_by_bearing() {
    let none = TouchdownConfig { clearance_m: 1.0, ..TouchdownConfig::default() };
    let touchdown = SpindleTouchdown { a: none.clone(), b: none.clone(), x: none };
    let plant = plant(SpindleConfig { touchdown, ..SpindleConfig::default() });
    for (k, bearing, magnet) in [(1, "A", 2), (3, "B", 1), (7, "X", 2)] {
        let mut state = plant.start(0.0);
        let mut input = SpindleInput::default();
        input.current_a[k] = 5.0;
        match plant.advance(&mut state, &input, 0.0, 1.0) {
            Err(StepError::Contact { magnet: found, position, .. }) => {
                assert_eq!(found, format!("magnet {magnet} of bearing {bearing}"));
                assert_eq!(position.iter().map(|(_, value)| *value).collect::<Vec<_>>(), state.position_m);
            }
            other => panic!("{bearing} {magnet}: {other:?}"),
        }
    }
    let mut state = plant.start(0.0);
    for (name, change) in [
        ("B.i[2]", (|input| input.current_a[4] = f64::NAN) as fn(&mut SpindleInput)),
        ("X.u[1]", |input| input.voltage_v[6] = f64::INFINITY),
        ("MY", |input| input.perturbation_n[3] = f64::NAN),
    ] {
        let mut input = SpindleInput::default();
        change(&mut input);
        match plant.advance(&mut state, &input, 0.0, STEP_S) {
            Err(StepError::Input { name: found, .. }) => assert_eq!(found, name),
            other => panic!("{name}: {other:?}"),
        }
    }
}

#[test]
fn bad_parameters_are_refused_by_name() {
    type Change = fn(&mut SpindleConfig);
    let cases: &[(&str, Change)] = &[
        ("m", |c| c.geometry.shaft.m_kg = 0.0),
        ("Jt", |c| c.geometry.shaft.transverse_kgm2 = -0.1),
        ("Jp", |c| c.geometry.shaft.polar_kgm2 = -0.1),
        ("Jp", |c| c.geometry.shaft.polar_kgm2 = 0.33),
        ("shaft.end", |c| c.geometry.extent_m = [0.2, -0.2]),
        ("B.position", |c| c.geometry.b.position_m = c.geometry.a.position_m),
        ("A.position", |c| c.geometry.a.position_m = f64::NAN),
        ("A.position", |c| c.geometry.a.position_m = -0.3),
        ("B.sensorPosition", |c| c.geometry.b.sensor_position_m = 0.21),
        ("B.sensorPosition", |c| c.geometry.b.sensor_position_m = c.geometry.a.sensor_position_m),
        ("A.s", |c| c.geometry.a.gap_m = 0.0),
        ("X.s", |c| c.geometry.axial_gap_m = -1.0),
        ("B.alpha[3]", |c| c.geometry.b.alpha_rad[2] = c.geometry.b.alpha_rad[1]),
        ("A.alpha[1]", |c| c.geometry.a.alpha_rad[0] = 0.2),
        ("B.lambda[2]", |c| c.lambda_nm2_a2[4] = 0.0),
        ("unbalance[2].magnitude", |c| c.unbalance_kgm[1] = -1.0),
        ("unbalance[1].phase", |c| c.unbalance_phase_rad[0] = f64::NAN),
        ("unbalance[1].position", |c| c.unbalance_position_m[0] = 0.3),
        ("gravity.X", |c| c.gravity_m_s2[0] = f64::NAN),
        ("gamma0", |c| c.position_m[4] = 0.01),
        ("X0", |c| c.position_m[0] = -7e-4),
        ("betaRate0", |c| c.velocity_m_s[3] = f64::INFINITY),
        ("theta0", |c| c.theta_rad = f64::NAN),
        ("A.touchdown.stiffness", |c| c.touchdown.a.stiffness_n_m = 0.0),
        ("X.touchdown.clearance", |c| c.touchdown.x.clearance_m = 0.0),
        ("B.sensor.offsetZ", |c| c.sensor.position_offset_m[3] = f64::NAN),
        ("X.sensor.gainError", |c| c.sensor.position_gain_error[4] = -1.0),
        ("X.sensor.currentOffset[2]", |c| c.sensor.current_offset_a[7] = f64::NAN),
        ("sensor.Ts", |c| c.sensor.step_s = 0.0),
        ("solver.maxStep", |c| c.max_step_s = 0.0),
    ];
    for (name, change) in cases {
        let mut config = SpindleConfig::default();
        change(&mut config);
        let found = Plant::new(config).expect_err(name);
        let names: Vec<_> = found.iter().map(|finding| finding.name.as_ref()).collect();
        assert_eq!(names, [*name], "{found:?}");
    }
    let mut plant = plant(SpindleConfig::default());
    let before = plant.clone();
    let bad =
        SpindleConfig { lambda_nm2_a2: [-1.0; 8], unbalance_phase_rad: [f64::NAN, 0.0], ..SpindleConfig::default() };
    let found = plant.retune(&bad).expect_err("a refusal");
    assert_eq!(found.len(), 9, "{found:?}");
    assert_eq!(plant, before);
}

/// Positions, currents, everything on; within contact if asked for.
fn somewhere(plant: &SpindlePlant, random: &mut Random, contact: bool) -> (SpindleState, SpindleInput) {
    let mut next = || random.between(-1.0, 1.0);
    let mut state = plant.start(0.0);
    state.position_m = [5e-5, 5e-5, 5e-5, 2e-4, 2e-4].map(|size| size * next());
    if contact {
        (state.position_m[0], state.position_m[1]) = (3.1e-4, 2.7e-4);
        state.position_m[4] = 1e-5;
        state.contact = [true, false, true];
    }
    state.velocity_m_s = [0.01, 0.01, 0.01, 0.1, 0.1].map(|size| size * next());
    state.theta_rad = 3.0 * next();
    state.linkage_wb = std::array::from_fn(|_| 1e-2 * next());
    let input = SpindleInput {
        current_a: std::array::from_fn(|_| 2.0 * next()),
        voltage_v: std::array::from_fn(|_| 30.0 * next()),
        perturbation_n: std::array::from_fn(|_| next()),
        omega_rad_s: 600.0 + 20.0 * next(),
    };
    (state, input)
}

fn values(output: SpindleOutput) -> Vec<f64> {
    let of_magnets = [output.gap_m, output.current_a, output.linkage_wb, output.force_n, output.induced_v];
    let of_coordinates = [output.resultant_n, output.perturbation_n, output.contact_n, output.acceleration_m_s2];
    of_magnets.concat().into_iter().chain(of_coordinates.concat()).collect()
}

/// Fails if a number is left out where two points are combined, for instance the position of a bearing.
#[test]
fn directional_derivatives_are_limits_of_difference_quotients() {
    let mut random = Random::new(5);
    for drive in [Drive::Current, Drive::Voltage] {
        let coil = CoilConfig { drive, saturation_wb: 8e-3, leakage_h: 1e-3, ..CoilConfig::default() };
        let gravity_m_s2 = [1.0, 2.0, -9.81];
        let plant = plant(SpindleConfig { coil, gravity_m_s2, ..unbalanced() });
        for round in 0..20 {
            let (state, input) = somewhere(&plant, &mut random, round % 4 == 0);
            let point = Point::of(&plant, &state, &input, 0.3);
            let same = point.with(&point, |value, _: f64| Taylor::<1>::constant(value)).outputs();
            assert_eq!(values(same.map(|series| series.0[0])), values(plant.outputs(&state, &input, 0.3)));

            // Each number in units of its own size.
            let draws = std::cell::RefCell::new(Random::new(round));
            let direction =
                point.with(&point, |value: f64, _: f64| 0.3 * value * draws.borrow_mut().between(-1.0, 1.0));
            let exact = values(point.along(&direction).outputs().map(|series| series.derivative(1)));
            let h = 2e-4;
            let sides = [-2.0, -1.0, 1.0, 2.0].map(|side| {
                values(point.with(&direction, |value: f64, slope: f64| value + side * h * slope).outputs())
            });
            let now = values(point.outputs());
            for (at, exact) in exact.into_iter().enumerate() {
                let [a, b, c, d] = sides.each_ref().map(|side| side[at]);
                let quotient = (a - 8.0 * b + 8.0 * c - d) / (12.0 * h);
                // Rounding of the values over h, and the error of the quotient.
                let tolerance = 1e-6 * quotient.abs() + 1e-9 * now[at].abs().max(a.abs()) + 1e-12;
                assert!((exact - quotient).abs() <= tolerance, "{drive:?}, {round}, {at}: {exact:e} {quotient:e}");
            }
        }
    }
}

/// Fails if a derivative with respect to time forgets the gyroscopic moments.
#[test]
fn derivatives_in_time_are_those_of_the_motion() {
    let mut random = Random::new(6);
    let plant = plant(unbalanced());
    for _ in 0..10 {
        let (state, input) = somewhere(&plant, &mut random, false);
        let line = Point::of(&plant, &state, &input, 0.3).in_time::<6>(&[]);
        let tau = 1e-5;
        let sum = |series: Taylor<6>| series.0.iter().rev().fold(0.0, |sum, c| sum * tau + c);
        let moved = line.with(&line, |series, _: Taylor<6>| sum(series));
        let there = values(moved.outputs());
        let along = values(line.outputs().map(sum));
        for (at, (there, along)) in there.iter().zip(&along).enumerate() {
            assert!((there - along).abs() <= 1e-10 * there.abs().max(1e-3), "{at}: {there:e} {along:e}");
        }
    }
}
