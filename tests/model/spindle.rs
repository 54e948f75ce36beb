//! The spindle: whirl, unbalance response and precession in closed form, geometry and backup bearings.

use crate::prelude::*;
use crate::support::whirl::{DAMPING_NS_M, STIFFNESS_N_M, TABLE};

use magnetic_bearing::bearing::Shaft;
use nalgebra::{Complex, ComplexField, SMatrix, SVector};

type SpindlePlant = Plant<5, 8, 3>;
type SpindleState = PlantState<5, 8, 3>;
type SpindleInput = PlantInput<f64, 5, 8>;

const I: Complex<f64> = Complex { re: 0.0, im: 1.0 };

fn plant(config: SpindleConfig) -> SpindlePlant {
    Plant::new(config).expect("a plant")
}

/// A rotor on two linear bearings, without currents; parameters as in `docs/spindle.md`.
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

/// The rotor on isotropic springs and dampers at its bearings, in `(u, ψ, u', ψ')` with `u = y + i z`, `ψ = γ − i β`: the system
/// matrix, and the acceleration due to unbalance at angle 0.
fn on_springs(config: &SpindleConfig, omega_rad_s: f64, stiffness_n_m: f64, damping_ns_m: f64) -> (Matrix4, Vector4) {
    let plant = plant(config.clone());
    let bearings = [config.rotor.bearings[0].position_m, config.rotor.bearings[1].position_m];
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
        let Motion { position_m: v, velocity_m_s: a, .. } = plant.equations().derivative(&Instant {
            motion: &motion,
            input: &input,
            conditions: Conditions::default(),
        });
        let complex = |q: [f64; 5]| [Complex::new(q[1], q[2]), Complex::new(q[4], -q[3])];
        let ([v_u, v_psi], [a_u, a_psi]) = (complex(v), complex(a));
        Vector4::new(v_u, v_psi, a_u, a_psi)
    };
    let unbalance = slope(Vector4::zeros());
    let mut matrix = Matrix4::zeros();
    for column in 0..4 {
        // Small enough for the gaps; without currents the equations are linear.
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

/// Fails if a gyroscopic term has the wrong sign, which exchanges forward and backward whirl.
#[test]
fn whirl_and_unbalance_response_are_those_of_the_table() {
    /// Relative accuracy of the table's digits.
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
            below(&format!("whirl at {rpm} rpm, {found} Hz"), (found / wanted - 1.0).abs(), TOLERANCE);
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
        let rotor = RotorConfig { shaft, ..RotorConfig::of(&SPINDLE) };
        let rates = [1e-4, -2e-4, 3e-4, 4e-3, 1e-2];
        let plant = plant(SpindleConfig { rotor, velocity_m_s: rates, ..SpindleConfig::default() });
        let mut state = plant.start(0.0);
        let input = SpindleInput { omega_rad_s: omega, ..SpindleInput::default() };
        let momentum = |state: &SpindleState| {
            let [_, _, _, beta, gamma] = state.motion.position_m;
            let [_, _, _, beta_rate, gamma_rate] = state.motion.velocity_m_s;
            let (transverse, spin) = (shaft.transverse_kgm2, shaft.polar_kgm2 * omega);
            [transverse * beta_rate + spin * gamma, transverse * gamma_rate - spin * beta]
        };
        let start = momentum(&state);
        for k in 0..300 {
            plant.advance(&mut state, &InputTrajectory::held(&input), f64::from(k) * STEP_S, STEP_S).expect("a step");
            let turned = Complex::new(rates[4], -rates[3])
                * (I * (shaft.polar_kgm2 / shaft.transverse_kgm2 * omega * state.time_s)).exp();
            let rate = Complex::new(state.motion.velocity_m_s[4], -state.motion.velocity_m_s[3]);
            // Sub-steps of 50 µs, at most a twentieth of a radian.
            below("precession", (rate - turned).modulus() / turned.modulus(), 1e-4);
            for a in 0..2 {
                below("angular momentum", (momentum(&state)[a] - start[a]).abs() / start[1], 1e-12);
            }
        }
        for (position, rate) in state.motion.position_m.into_iter().zip(rates).take(3) {
            below("the centre of gravity moves uniformly", (position - rate * state.time_s).abs(), 1e-15);
        }
    }
}

/// Against the explicit formulas: a point ξ of the axis is at `y + ξγ`, `z − ξβ`.
#[test]
fn gaps_readings_and_moments_are_those_of_the_points_of_the_axis() {
    let config = SpindleConfig::default();
    let plant = plant(config.clone());
    let [x, y, z, beta, gamma] = [2e-5, -3e-5, 4e-5, 1e-4, -2e-4];
    let alpha = [PI, -PI / 3.0, PI / 3.0];
    let gaps = plant.equations().geometry().gaps([x, y, z, beta, gamma]);
    for k in 0..6 {
        let (xi, alpha) = ([-0.12, 0.15][k / 3], alpha[k % 3]);
        let gap = 5e-4 - alpha.sin() * (y + xi * gamma) - alpha.cos() * (z - xi * beta);
        below("gap, m", (gaps[k] - gap).abs(), 1e-18);
    }
    below("axial gaps, m", (gaps[6] - (6e-4 - x)).abs() + (gaps[7] - (6e-4 + x)).abs(), 1e-18);
    let spindle = Checks::all(|checks| Rotor::<5, 8, 3>::checked(config.rotor, checks)).expect("a spindle");
    let q = [x, y, z, beta, gamma];
    let readings = spindle.config().readings(q);
    let wanted = [y - 0.10 * gamma, z + 0.10 * beta, y + 0.13 * gamma, z - 0.13 * beta, x];
    for n in 0..5 {
        below("reading, m", (readings[n] - wanted[n]).abs(), 1e-19);
        below("H⁻¹ r", (spindle.coordinates(readings)[n] - q[n]).abs(), 1e-18);
    }
    // Magnet 1 of B pulls down, which turns the rotor about +y; magnet 2 of X pulls towards −x.
    let mut input = SpindleInput::default();
    (input.current_a[3], input.current_a[7]) = (2.0, 1.0);
    let start = plant.start(0.0);
    let output = plant.outputs(&start, &input, 0.0);
    let [b_1, x_2] = [2.4e-6 * 4.0 / 25e-8, 2.6e-6 / 36e-8];
    for (found, wanted) in output.resultant_n.into_iter().zip([-x_2, 0.0, -b_1, 0.15 * b_1, 0.0]) {
        below("generalised force, N", (found - wanted).abs(), 1e-12);
    }
    let [a, b, x] = plant.equations().at_bearings(&start.at(&input, 0.0), output.force_n);
    below("force at B, N", (b.z_n + b_1).abs() + a.z_n.abs(), 1e-12);
    below("axial force, N", (x.y_n + x_2).abs(), 1e-12);
}

/// A horizontal shaft comes to rest in the rings, a vertical one on the axial stop.
#[test]
fn backup_bearings_carry_the_rotor() {
    for gravity_m_s2 in [[0.0, 0.0, -9.81, 0.0, 0.0], [9.81, 0.0, 0.0, 0.0, 0.0]] {
        let config = SpindleConfig { gravity_m_s2, ..SpindleConfig::default() };
        let plant = plant(config);
        let mut state = plant.start(0.0);
        let input = SpindleInput::default();
        for k in 0..20_000 {
            plant.advance(&mut state, &InputTrajectory::held(&input), f64::from(k) * STEP_S, STEP_S).expect("a step");
        }
        let output = plant.outputs(&state, &input, state.time_s);
        let [a, b, x] = plant.equations().at_bearings(&state.at(&input, state.time_s), output.force_n);
        if gravity_m_s2[0] == 0.0 {
            assert_eq!(state.contact, [true, true, false]);
            // The weight shared by the lever arms of the bearings, 0.12 and 0.15 m.
            below("A, N", (a.touchdown_z_n - 12.0 * 9.81 * 0.15 / 0.27).abs(), 1e-3);
            below("B, N", (b.touchdown_z_n - 12.0 * 9.81 * 0.12 / 0.27).abs(), 1e-3);
        } else {
            assert_eq!(state.contact, [false, false, true]);
            below("X, N", (x.touchdown_y_n + 12.0 * 9.81).abs(), 1e-3);
            below("x, m", (state.motion.position_m[0] - (3e-4 + 12.0 * 9.81 / 5e7)).abs(), 1e-9);
        }
        for n in 0..5 {
            below("rest, m/s", state.motion.velocity_m_s[n].abs(), 1e-6);
        }
    }
}
