//! Four magnets in opposed pairs: force allocation, and the linear law of the textbook (Schweitzer and Maslen, section 4.2).

use crate::prelude::*;
use magnetic_bearing::bearing::magnet::{currents, forces};

const GAP_M: f64 = 5e-4;
/// Rounding of forces of some 100 N, in N.
const ROUNDING_N: f64 = 1e-11;

/// Fails if the bias is applied to one magnet of a pair only, or if unequal gaps or force constants are not compensated.
#[test]
fn currents_about_a_bias_give_the_force_at_any_place() {
    let rotor = Checks::all(|checks| Rotor::<2, 4, 1>::checked(RotorConfig::of(&PLANAR4), checks))
        .expect("magnets in opposed pairs");
    let (geometry, mut random) = (rotor.geometry(), Random::new(7));
    let mut alone = 0;
    for _ in 0..1000 {
        let lambda: [f64; 4] = std::array::from_fn(|_| random.between(1e-6, 4e-6));
        let gap_m = geometry.gaps(std::array::from_fn(|_| random.between(-2e-4, 2e-4)));
        let wanted: [f64; 2] = std::array::from_fn(|_| random.between(-200.0, 200.0));
        let bias_a: [f64; 2] = std::array::from_fn(|_| random.between(0.5, 3.0));
        let per_square: [f64; 4] = std::array::from_fn(|k| lambda[k] / (gap_m[k] * gap_m[k]));
        let current_a = currents(rotor.allocate(wanted, &bias_a, Some(&per_square)), gap_m, lambda);
        for (wanted, found) in wanted.into_iter().zip(geometry.resultant(forces(lambda, current_a, gap_m))) {
            below("resultant, N", (wanted - found).abs(), ROUNDING_N);
        }
        for (pair, bias_a) in bias_a.into_iter().enumerate() {
            let [one, other] = [current_a[pair], current_a[pair + 2]];
            if one > 0.0 && other > 0.0 {
                below("mean current of a pair, A", (0.5 * (one + other) - bias_a).abs(), 1e-7);
            } else {
                alone += 1;
                let is_at_its_end = one.max(other) >= 2.0 * bias_a * (1.0 - 1e-9);
                assert!(is_at_its_end, "{one} A and {other} A about {bias_a} A");
            }
        }
    }
    assert!((100..1900).contains(&alone), "{alone} pairs of 2000 at their ends");
}

/// `k_i = 4 λ i_0/s²` and `k_s = 4 λ i_0²/s³` of a pair, from the plant's exact derivatives. Fails if its magnets are not opposed.
#[test]
fn stiffness_and_gain_of_a_pair_are_those_of_the_textbook() {
    let (lambda, bias_a) = (2.2e-6, 1.5);
    let mut config = PlantConfigOf::<f64, 1, 2, 1> { lambda_nm2_a2: [lambda; 2], ..PlantConfigOf::default() };
    config.position_m = [0.0];
    let m_kg = config.rotor.shaft.m_kg;
    let plant = Plant::new(config).expect("a plant");
    let state = plant.start(0.0);
    let input = PlantInput { current_a: [bias_a; 2], ..PlantInput::default() };
    let point = Point::of(&plant, &state, &input, 0.0);
    let slope = |direction: &dyn Fn(&mut Point<f64, 1, 2, 1>)| {
        let mut towards = point.with(&point, |_, _: f64| 0.0);
        direction(&mut towards);
        let Taylor([_, slope]) = point.along(&towards).outputs().0.acceleration_m_s2[0];
        m_kg * slope
    };
    let k_i = slope(&|towards| towards.input.current_a = [1.0, -1.0]);
    let k_s = slope(&|towards| towards.motion.position_m = [1.0]);
    below("k_i, relative", (k_i / (4.0 * lambda * bias_a / GAP_M.powi(2)) - 1.0).abs(), 1e-12);
    below("k_s, relative", (k_s / (4.0 * lambda * bias_a * bias_a / GAP_M.powi(3)) - 1.0).abs(), 1e-12);
}
