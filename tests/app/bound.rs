//! The Cramér–Rao bound against the inverse Fisher information of the joint likelihood, written out as one large least-squares
//! problem, for a rotor in one bearing and for a shaft that tilts.

use crate::prelude::*;

use magnetic_bearing::studies::montecarlo::bound::{Bound, Interval, Rotor};
use nalgebra::{DMatrix, DVector};

const SAMPLES: usize = 80;
const STEP_S: f64 = 2e-4;
const SPEED_RAD_S: f64 = 100.0 * TAU;
/// The speed grows by a fifth per revolution, so that the terms in ω̇ matter.
const ACCELERATION_RAD_S2: f64 = 0.2 * 100.0 * SPEED_RAD_S;

/// A planar rotor between three magnets.
fn planar() -> Rotor {
    Rotor {
        // Over the samples the negative stiffness amplifies an error about twentyfold: enough to matter, and little enough to keep the large
        // problem well conditioned.
        inertia: DVector::from_element(2, 9.0),
        gyroscopic: DMatrix::zeros(2, 2),
        directions: DMatrix::from_columns(&[0.1, 2.0, 4.4].map(|a: f64| DVector::from(vec![a.sin(), a.cos()]))),
        gap_m: vec![6e-4; 3],
        lambda_nm2_a2: vec![1.5e-6, 2e-6, 2.6e-6],
        planes: vec![[DVector::from(vec![1.0, 0.0]), DVector::from(vec![0.0, 1.0])]],
        readings: DMatrix::identity(2, 2),
        position_noise_m: 2e-7,
        current_noise_a: 2e-2,
    }
}

/// A shaft that tilts: magnets 0.1 m before and behind the centre of gravity, sensors beside them, coordinates Y, Z, β, γ.
fn tilting() -> Rotor {
    // A force at ξ has the moments (−ξ F_z, ξ F_y).
    let at = |position: f64, y: f64, z: f64| DVector::from(vec![y, z, -position * z, position * y]);
    let magnets = [-0.1, 0.1].into_iter().flat_map(|position| [0.1, 2.0, 4.4].map(|alpha: f64| (position, alpha)));
    let directions: Vec<_> = magnets.map(|(position, alpha)| at(position, alpha.sin(), alpha.cos())).collect();
    let readings =
        [-0.12, 0.09].map(|position| [at(position, 1.0, 0.0).transpose(), at(position, 0.0, 1.0).transpose()]);
    let mut gyroscopic = DMatrix::zeros(4, 4);
    (gyroscopic[(2, 3)], gyroscopic[(3, 2)]) = (-0.03, 0.03);
    Rotor {
        inertia: DVector::from(vec![18.0, 18.0, 0.2, 0.2]),
        gyroscopic,
        directions: DMatrix::from_columns(&directions),
        gap_m: vec![6e-4; 6],
        lambda_nm2_a2: vec![1.5e-6, 2e-6, 2.6e-6, 2.4e-6, 1.8e-6, 2.1e-6],
        planes: vec![[at(0.05, 1.0, 0.0), at(0.05, 0.0, 1.0)]],
        readings: DMatrix::from_rows(&readings.concat()),
        ..planar()
    }
}

fn intervals(rotor: &Rotor) -> impl Iterator<Item = Interval> {
    (0..SAMPLES - 1).map(|n| {
        let t = (n as f64 + 0.5) * STEP_S;
        let theta_rad = SPEED_RAD_S * t + 0.5 * ACCELERATION_RAD_S2 * t * t;
        let current =
            |k: usize| 3.0 + 1.5 * (theta_rad + 2.0 * k as f64).sin() + 0.5 * (3.0 * theta_rad + k as f64).cos();
        let moved = [6e-5 * theta_rad.cos(), 4e-5 * theta_rad.sin(), 1e-4 * theta_rad.sin(), 5e-5 * theta_rad.cos()];
        Interval {
            length_s: STEP_S,
            position_m: moved[..rotor.inertia.len()].to_vec(),
            current_a: (0..rotor.lambda_nm2_a2.len()).map(current).collect(),
            theta_rad,
            omega_rad_s: SPEED_RAD_S + ACCELERATION_RAD_S2 * t,
            acceleration_rad_s2: ACCELERATION_RAD_S2,
        }
    })
}

fn filtered(rotor: &Rotor) -> Vec<f64> {
    let mut bound = Bound::new(rotor.clone());
    bound.measure();
    for interval in intervals(rotor) {
        bound.predict(&interval);
        bound.measure();
    }
    bound.lambda()
}

/// The bound from the sensitivities of all positions to all unknowns: initial motion, λ, unbalance, load, and the noise of each current in
/// each interval.
fn brute_force(rotor: &Rotor) -> Vec<f64> {
    let (n, k) = (rotor.inertia.len(), rotor.lambda_nm2_a2.len());
    let (motion, loads) = (2 * n, 2 * n + k + 2);
    let noises = loads + n;
    let unknowns = noises + k * (SAMPLES - 1);
    // Units that keep the information matrix well conditioned.
    let unit = |at: usize| match at {
        _ if at < n => 1e-7,
        _ if at < motion => 1e-3,
        _ if at < motion + k => 1e-8,
        _ if at < loads => 1e-6,
        _ if at < noises => 1.0,
        _ => rotor.current_noise_a,
    };
    let mut information = DMatrix::<f64>::zeros(unknowns, unknowns);
    for at in noises..unknowns {
        information[(at, at)] = 1.0;
    }
    let mut observe = |sensitivity: &DMatrix<f64>| {
        let mut rows = &rotor.readings * sensitivity.rows(0, n) / rotor.position_noise_m;
        for (at, mut column) in rows.column_iter_mut().enumerate() {
            column *= unit(at);
        }
        information.gemm_tr(1.0, &rows, &rows, 1.0);
    };
    let mut sensitivity = DMatrix::<f64>::identity(motion, unknowns);
    observe(&sensitivity);
    for (index, interval) in intervals(rotor).enumerate() {
        let mut dynamics = DMatrix::<f64>::zeros(motion, motion);
        let mut force = DMatrix::<f64>::zeros(motion, unknowns);
        for a in 0..n {
            dynamics[(a, n + a)] = 1.0;
            let m = rotor.inertia[a];
            for b in 0..n {
                dynamics[(n + a, n + b)] = interval.omega_rad_s * rotor.gyroscopic[(a, b)] / m;
            }
            for magnet in 0..k {
                let d = |b: usize| rotor.directions[(b, magnet)];
                let gap = rotor.gap_m[magnet] - (0..n).map(|b| d(b) * interval.position_m[b]).sum::<f64>();
                let (i, lambda) = (interval.current_a[magnet], rotor.lambda_nm2_a2[magnet]);
                for b in 0..n {
                    dynamics[(n + a, b)] += 2.0 * lambda * i * i / gap.powi(3) * d(a) * d(b) / m;
                }
                force[(n + a, motion + magnet)] = i * i / (gap * gap) * d(a) / m;
                force[(n + a, noises + k * index + magnet)] = 2.0 * lambda * i / (gap * gap) * d(a) / m;
            }
            // U rotates with the rotor: its force is the second derivative of −(cos θ, sin θ).
            let [y, z] = &rotor.planes[0];
            for (at, quarter) in [(loads - 2, 0.0), (loads - 1, TAU / 4.0)] {
                let (sin, cos) = (interval.theta_rad + quarter).sin_cos();
                let (w, dw) = (interval.omega_rad_s, interval.acceleration_rad_s2);
                force[(n + a, at)] = ((w * w * cos + dw * sin) * y[a] + (w * w * sin - dw * cos) * z[a]) / m;
            }
            force[(n + a, loads + a)] = 1.0 / m;
        }
        // ẋ = A x + B over the interval by Taylor series.
        let mut derivative = &dynamics * &sensitivity + force;
        let mut factor = 1.0;
        for order in 1..12 {
            factor *= STEP_S / f64::from(order);
            sensitivity += &derivative * factor;
            derivative = &dynamics * derivative;
        }
        observe(&sensitivity);
    }
    let covariance = information.cholesky().expect("everything can be identified").inverse();
    let of = |at: usize| covariance[(motion + at, motion + at)].sqrt() * unit(motion + at) / rotor.lambda_nm2_a2[at];
    (0..k).map(of).collect()
}

#[test]
fn the_filter_has_the_covariance_of_the_joint_likelihood() {
    /// The filter starts with a wide but finite prior, and its covariance is rounded in every step.
    const TOLERANCE: f64 = 2e-4;
    // A prior of zero width cannot be written as a least-squares problem.
    for (rotor, noise) in [planar(), tilting()]
        .into_iter()
        .flat_map(|rotor| [[2e-7, 1e-9], [2e-7, 5e-3], [2e-7, 5e-2], [4e-7, 4e-2]].map(|noise| (rotor.clone(), noise)))
    {
        let [position_noise_m, current_noise_a] = noise;
        let rotor = Rotor { position_noise_m, current_noise_a, ..rotor };
        for (k, (found, expected)) in filtered(&rotor).iter().zip(brute_force(&rotor)).enumerate() {
            let miss = (found / expected - 1.0).abs();
            assert!(miss < TOLERANCE, "{noise:?}, λ{}: {found} for {expected}, tolerance {TOLERANCE}", k + 1);
        }
    }
}
