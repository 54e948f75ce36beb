//! The Cramér–Rao bound against the inverse of the Fisher information of the joint likelihood, written out as one large least-squares
//! problem.

use std::f64::consts::TAU;

use magnetic_bearing::bearing::magnet::Geometry;
use magnetic_bearing::studies::montecarlo::bound::{Bearing, Bound, Interval};
use nalgebra::{DMatrix, Matrix4};

const SAMPLES: usize = 100;
const STEP_S: f64 = 2e-4;
const SPEED_RAD_S: f64 = 100.0 * TAU;
/// Speeds up by a fifth of the speed in a revolution, so that the terms with ω̇ matter.
const ACCELERATION_RAD_S2: f64 = 0.2 * 100.0 * SPEED_RAD_S;

fn bearing() -> Bearing {
    Bearing {
        // With these an error grows about twentyfold over the samples through the negative stiffness: enough to matter, and little enough for
        // the large problem to be well conditioned.
        m_kg: 9.0,
        geometry: Geometry::new(6e-4, [0.1, 2.0, 4.4]),
        lambda_nm2_a2: [1.5e-6, 2e-6, 2.6e-6],
        position_noise_m: 2e-7,
        current_noise_a: 2e-2,
    }
}

fn intervals() -> Vec<Interval> {
    let middle = |n: usize| (n as f64 + 0.5) * STEP_S;
    (0..SAMPLES - 1)
        .map(|n| {
            let t = middle(n);
            let theta_rad = SPEED_RAD_S * t + 0.5 * ACCELERATION_RAD_S2 * t * t;
            let current = |k: f64| 3.0 + 1.5 * (theta_rad + 2.0 * k).sin() + 0.5 * (3.0 * theta_rad + k).cos();
            Interval {
                length_s: STEP_S,
                position_m: [6e-5 * theta_rad.cos(), 4e-5 * theta_rad.sin()],
                current_a: [current(0.0), current(1.0), current(2.0)],
                theta_rad,
                omega_rad_s: SPEED_RAD_S + ACCELERATION_RAD_S2 * t,
                acceleration_rad_s2: ACCELERATION_RAD_S2,
            }
        })
        .collect()
}

fn filtered(bearing: Bearing) -> [f64; 3] {
    let mut bound = Bound::new(bearing);
    bound.measure();
    for interval in intervals() {
        bound.predict(&interval);
        bound.measure();
    }
    bound.lambda()
}

/// Unknowns of the large problem: initial motion, λ, unbalance, load, and the noise of each current in each interval.
const UNKNOWNS: usize = 4 + 7 + 3 * (SAMPLES - 1);

/// The bound from the sensitivities of all positions to all unknowns.
fn brute_force(bearing: &Bearing) -> [f64; 3] {
    let m = bearing.m_kg;
    // Units that keep the information matrix well conditioned.
    let unit = |n: usize| match n {
        0 | 1 => 1e-7,
        2 | 3 => 1e-3,
        4..=6 => 1e-8,
        7 | 8 => 1e-6,
        9 | 10 => 1.0,
        _ => bearing.current_noise_a,
    };
    let mut information = DMatrix::<f64>::zeros(UNKNOWNS, UNKNOWNS);
    for n in 11..UNKNOWNS {
        information[(n, n)] = 1.0;
    }
    let mut observe = |sensitivity: &DMatrix<f64>| {
        for axis in 0..2 {
            let row = DMatrix::from_fn(1, UNKNOWNS, |_, n| sensitivity[(axis, n)] * unit(n) / bearing.position_noise_m);
            information += row.transpose() * row;
        }
    };
    let mut sensitivity = DMatrix::<f64>::identity(4, UNKNOWNS);
    observe(&sensitivity);
    for (index, interval) in intervals().iter().enumerate() {
        let mut motion = Matrix4::<f64>::zeros();
        motion[(0, 2)] = 1.0;
        motion[(1, 3)] = 1.0;
        let mut force = DMatrix::<f64>::zeros(4, UNKNOWNS);
        for k in 0..3 {
            let e = bearing.geometry.directions[k];
            let gap = bearing.geometry.gap_m[0] - e[0] * interval.position_m[0] - e[1] * interval.position_m[1];
            let (i, lambda) = (interval.current_a[k], bearing.lambda_nm2_a2[k]);
            for a in 0..2 {
                for b in 0..2 {
                    motion[(2 + a, b)] += 2.0 * lambda * i * i / gap.powi(3) * e[a] * e[b] / m;
                }
                force[(2 + a, 4 + k)] = i * i / (gap * gap) * e[a] / m;
                force[(2 + a, 11 + 3 * index + k)] = 2.0 * lambda * i / (gap * gap) * e[a] / m;
            }
        }
        // U turns with the rotor: the force is that of the second derivative of −(cos θ, sin θ).
        let turned = |quarter: f64| {
            let (sin, cos) = (interval.theta_rad + quarter).sin_cos();
            let (w, dw) = (interval.omega_rad_s, interval.acceleration_rad_s2);
            [w * w * cos + dw * sin, w * w * sin - dw * cos]
        };
        for (n, quarter) in [(7, 0.0), (8, TAU / 4.0)] {
            for a in 0..2 {
                force[(2 + a, n)] = turned(quarter)[a] / m;
            }
        }
        force[(2, 9)] = 1.0 / m;
        force[(3, 10)] = 1.0 / m;
        // ẋ = A x + B over the interval by its Taylor series.
        let mut derivative = motion * &sensitivity + force;
        let mut factor = 1.0;
        for order in 1..12 {
            factor *= STEP_S / f64::from(order);
            sensitivity += &derivative * factor;
            derivative = motion * derivative;
        }
        observe(&sensitivity);
    }
    let covariance = information.cholesky().expect("everything can be identified").inverse();
    [0, 1, 2].map(|k| covariance[(4 + k, 4 + k)].sqrt() * unit(4 + k) / bearing.lambda_nm2_a2[k])
}

#[test]
fn the_filter_has_the_covariance_of_the_whole_likelihood() {
    /// The filter starts with a wide but finite prior, and its covariance is rounded in every step.
    const TOLERANCE: f64 = 2e-4;
    for current_noise_a in [0.0, 5e-3, 5e-2] {
        // A prior of zero width cannot be written as a least-squares problem.
        let bearing = Bearing { current_noise_a: f64::max(current_noise_a, 1e-9), ..bearing() };
        let (expected, found) = (brute_force(&bearing), filtered(bearing));
        println!("{current_noise_a} A: {found:.6?}, likelihood {expected:.6?}");
        for k in 0..3 {
            let miss = (found[k] / expected[k] - 1.0).abs();
            assert!(miss < TOLERANCE, "λ{}: {} for {}, tolerance {TOLERANCE}", k + 1, found[k], expected[k]);
        }
    }
}

/// The bound is linear in the noise: twice the noise, twice the bound.
#[test]
fn the_bound_is_proportional_to_the_noise() {
    let once = filtered(bearing());
    let twice = filtered(Bearing { position_noise_m: 4e-7, current_noise_a: 4e-2, ..bearing() });
    for k in 0..3 {
        assert!((twice[k] / once[k] - 2.0).abs() < 4e-3, "{twice:?} for {once:?}");
    }
}
