//! Exact derivatives of the plant against difference quotients of the same equations, at random points of its state space.

use crate::prelude::*;

/// Error of a fourth-order difference quotient, relative to the largest value of its kind.
const QUOTIENT: f64 = 1e-7;

/// All effects on, with every drive and coil model.
fn all_configs<const N: usize, const K: usize, const B: usize>() -> Vec<PlantConfigOf<f64, N, K, B>> {
    let mut configs = Vec::new();
    for drive in [Drive::Current, Drive::Voltage] {
        for (saturation_wb, leakage_h) in [(0.0, 0.0), (0.0, 1e-3), (8e-3, 0.0), (8e-3, 2e-3)] {
            let coil = CoilConfig { drive, saturation_wb, leakage_h, limit_v: 20.0, ..CoilConfig::default() };
            let mut config = PlantConfigOf { coil, ..PlantConfigOf::default() };
            (config.unbalance_kgm, config.unbalance_phase_rad) = ([8e-5, 5e-5], [0.4, -1.9]);
            (config.harmonic.amplitude_n, config.harmonic.phase_rad) = ([2.0; N], [0.1; N]);
            config.gravity_m_s2 = std::array::from_fn(|n| [1.0, -9.81, 2.0, 0.0, 0.0][n]);
            config.touchdown.iter_mut().for_each(|ring| ring.friction = 0.2);
            configs.push(config);
        }
    }
    configs
}

/// A random state and input; with `contact` the rotor touches the first backup bearing.
fn random_point<const N: usize, const K: usize, const B: usize>(
    plant: &Plant<N, K, B>,
    numbers: &mut Random,
    contact: bool,
) -> (PlantState<N, K, B>, PlantInput<f64, N, K>) {
    let mut state = plant.start(0.0);
    let size = |n: usize, length: f64, angle: f64| if n < 3 { length } else { angle };
    let angle = PI * numbers.between(-1.0, 1.0);
    let radius = if contact { 2.6e-4 } else { 1e-4 * (1.0 + numbers.between(-1.0, 1.0)) };
    state.motion.position_m = std::array::from_fn(|n| size(n, 5e-5, 2e-5) * numbers.between(-1.0, 1.0));
    if N > 1 {
        let first = usize::from(N == 5);
        (state.motion.position_m[first], state.motion.position_m[first + 1]) =
            (radius * angle.cos(), radius * angle.sin());
    }
    state.motion.velocity_m_s = std::array::from_fn(|n| size(n, 0.02, 0.1) * numbers.between(-1.0, 1.0));
    state.theta_rad = 3.0 * numbers.between(-1.0, 1.0);
    state.motion.linkage_wb = std::array::from_fn(|_| 1e-2 * numbers.between(-1.0, 1.0));
    state.contact[0] = contact;
    let input = PlantInput {
        current_a: std::array::from_fn(|_| 2.0 * numbers.between(-1.0, 1.0)),
        voltage_v: std::array::from_fn(|_| 30.0 * numbers.between(-1.0, 1.0)),
        perturbation_n: std::array::from_fn(|_| numbers.between(-1.0, 1.0)),
        omega_rad_s: 300.0 + 20.0 * numbers.between(-1.0, 1.0),
    };
    (state, input)
}

/// Smallest scale of each kind of output, in its unit, in the order of [`values`]. It serves derivatives too, since each number is
/// varied by a fraction of itself.
const FLOOR: [f64; 9] = [1e-5, 0.1, 1e-3, 0.1, 0.1, 0.1, 0.1, 1.0, 0.1];

fn values<const N: usize, const K: usize>(output: PlantOutput<f64, N, K>) -> Vec<Vec<f64>> {
    vec![
        output.gap_m.to_vec(),
        output.current_a.to_vec(),
        output.linkage_wb.to_vec(),
        output.force_n.to_vec(),
        output.resultant_n.to_vec(),
        output.perturbation_n.to_vec(),
        output.induced_v.to_vec(),
        output.contact_n.to_vec(),
        output.acceleration_m_s2.to_vec(),
    ]
}

/// The coefficients of one order.
fn of_order<const O: usize, const N: usize, const K: usize>(
    output: &PlantOutput<Taylor<O>, N, K>,
    order: usize,
) -> Vec<Vec<f64>> {
    values(output.clone().map(|series| series.0[order]))
}

/// Combines values element by element.
fn combined<const S: usize>(of: &[Vec<Vec<f64>>; S], value: impl Fn([f64; S]) -> f64) -> Vec<Vec<f64>> {
    let at = |row: usize, column: usize| value(of.each_ref().map(|of| of[row][column]));
    (0..of[0].len()).map(|row| (0..of[0][row].len()).map(|column| at(row, column)).collect()).collect()
}

#[track_caller]
fn agree(what: &str, got: &[Vec<f64>], wanted: &[Vec<f64>], tolerance: f64, floor: &[f64]) {
    for (row, (got, wanted)) in got.iter().zip(wanted).enumerate() {
        let scale = wanted.iter().chain(got).fold(floor[row], |scale: f64, value| scale.max(value.abs()));
        for (got, wanted) in got.iter().zip(wanted) {
            let miss = (got - wanted).abs();
            assert!(miss <= tolerance * scale, "{what}, row {row}: {got:e} against {wanted:e}, scale {scale:e}");
        }
    }
}

/// Fails if series arithmetic differs in an operation or a branch from that of numbers, or if any derivative is missing, for instance
/// that of the sine of `alpha`.
#[test]
fn values_are_those_of_the_plant_and_directional_derivatives_limits_of_difference_quotients() {
    fn holds<const N: usize, const K: usize, const B: usize>() {
        // With this seed no difference crosses the limit of an amplifier.
        let mut numbers = Random::new(5);
        for config in all_configs::<N, K, B>() {
            let plant = Plant::new(config).expect("a plant");
            for round in 0..40 {
                let (mut state, input) = random_point(&plant, &mut numbers, round % 4 == 0);
                state.open[1] = round % 8 == 1;
                let point = Point::of(&plant, &state, &input, 0.3);
                // A direction relative to the size of each number.
                let direction = point.with(&point, |value: f64, _: f64| 0.3 * value);
                let weights: Vec<f64> = (0..60).map(|_| numbers.between(-1.0, 1.0)).collect();
                let at = std::cell::Cell::new(0);
                let direction = direction.with(&direction, |value: f64, _: f64| {
                    at.set((at.get() + 1) % weights.len());
                    value * weights[at.get()]
                });
                let constant = point.with(&point, |value, _: f64| Taylor::<1>::constant(value));
                assert_eq!(of_order(&constant.outputs().0, 0), values(plant.outputs(&state, &input, 0.3)));
                let got = of_order(&point.along::<2>(&direction).outputs().0, 1);
                let shifted =
                    |h: f64| values(point.with(&direction, |value, slope: f64| value + h * slope).outputs().0);
                let h = 2e-4;
                let sides = [-2.0, -1.0, 1.0, 2.0].map(|side| shifted(side * h));
                let quotient = combined(&sides, |[a, b, c, d]| (a - 8.0 * b + 8.0 * c - d) / (12.0 * h));
                // The friction curve bends within millimetres per second, so the quotient is less accurate.
                let tolerance = if state.contact[0] { 1e-3 } else { QUOTIENT };
                agree("directional", &got, &quotient, tolerance, &FLOOR);
            }
        }
    }
    holds::<2, 3, 1>();
    holds::<1, 2, 1>();
    holds::<5, 8, 3>();
}

/// Fails if a time derivative ignores a state or an input that changes.
#[test]
fn derivatives_in_time_are_those_of_the_motion() {
    fn holds<const N: usize, const K: usize, const B: usize>() {
        let mut numbers = Random::new(3);
        for config in all_configs::<N, K, B>() {
            let plant = Plant::new(config).expect("a plant");
            for _ in 0..20 {
                let (mut state, input) = random_point(&plant, &mut numbers, false);
                state.motion.linkage_wb = state.motion.linkage_wb.map(|psi| 0.3 * psi);
                let slopes = [1.0, 100.0].map(|size| PlantInput {
                    current_a: std::array::from_fn(|_| size * numbers.between(-1.0, 1.0)),
                    voltage_v: std::array::from_fn(|_| size * numbers.between(-1.0, 1.0)),
                    perturbation_n: std::array::from_fn(|_| size * numbers.between(-1.0, 1.0)),
                    omega_rad_s: size * numbers.between(-1.0, 1.0),
                });
                let point = Point::of(&plant, &state, &input, 0.3);
                let short = point.in_time::<3>(&slopes);
                // The Taylor polynomial of the motion must satisfy the equations of motion: the outputs at τ against their series.
                let long = point.in_time::<7>(&slopes);
                let (rate, exact) = (short.outputs().0, long.outputs().0);
                let pull_n = exact.force_n.iter().fold(0.0, |most: f64, force| most.max(force.0[0]));
                for (a, inertia) in plant.config().rotor.shaft.inertia::<N>().into_iter().enumerate() {
                    assert_eq!(short.motion.velocity_m_s[a].0[0], state.motion.velocity_m_s[a]);
                    let [short, long] = [short.motion.position_m[a].0[2], long.motion.position_m[a].0[2]];
                    // Newton's iterations for the flux may differ by a rounding error; forces of opposed magnets nearly cancel.
                    let size = if N == 2 { long.abs() } else { long.abs().max(pull_n / inertia) };
                    assert!((short - long).abs() <= 1e-14 * size, "{short:e} against {long:e}");
                }
                let tau = 1e-6;
                let moved =
                    long.with(&long, |series, _: Taylor<7>| series.0.iter().rev().fold(0.0, |sum, c| sum * tau + c));
                let there = values(moved.outputs().0);
                let orders: [_; 7] = std::array::from_fn(|order| of_order(&exact, order));
                let series = combined(&orders, |orders| orders.into_iter().rev().fold(0.0, |sum, c| sum * tau + c));
                agree("series", &series, &there, 1e-11, &FLOOR);
                agree("orders", &of_order(&rate, 2), &of_order(&exact, 2), 1e-12, &FLOOR);
            }
        }
    }
    holds::<2, 3, 1>();
    holds::<1, 2, 1>();
    holds::<5, 8, 3>();
}
