//! Exact derivatives of the plant against difference quotients of its own equations, at points all over its space.

use std::f64::consts::PI;

use magnetic_bearing::model::coil::{CoilConfig, Drive};
use magnetic_bearing::model::linearisation::{Jet, Modes, Point, Response, along, in_time, response};
use magnetic_bearing::model::plant::{Harmonic, Plant, PlantConfig, PlantInput, PlantState};
use magnetic_bearing::model::touchdown::TouchdownConfig;

/// A small generator, so that the points are the same everywhere: numbers in [-1, 1).
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// What a difference quotient of fourth order misses, in parts of the largest value of its kind.
const QUOTIENT: f64 = 1e-7;
/// What two ways of rounding the same equations differ by, in parts of the largest value of its kind.
const ROUNDING: f64 = 1e-13;

fn config(drive: Drive, saturation_wb: f64, leakage_h: f64) -> PlantConfig {
    PlantConfig {
        unbalance_kgm: 1e-4,
        unbalance_phase_rad: 0.4,
        harmonic: Harmonic { amplitude_n: [2.0, 1.0], phase_rad: [0.1, 0.2], ..Harmonic::default() },
        gravity_m_s2: [1.0, -9.81],
        coil: CoilConfig { drive, saturation_wb, leakage_h, limit_v: 20.0, ..CoilConfig::default() },
        touchdown: TouchdownConfig { friction: 0.2, ..TouchdownConfig::default() },
        ..PlantConfig::default()
    }
}

fn all_configs() -> Vec<PlantConfig> {
    let mut configs = Vec::new();
    for drive in [Drive::Current, Drive::Voltage] {
        for (saturation_wb, leakage_h) in [(0.0, 0.0), (0.0, 1e-3), (8e-3, 0.0), (8e-3, 2e-3)] {
            configs.push(config(drive, saturation_wb, leakage_h));
        }
    }
    configs
}

/// A state and an input; in contact with the backup bearing if asked for.
fn somewhere(plant: &Plant, numbers: &mut Numbers, contact: bool) -> (PlantState, PlantInput) {
    let mut state = plant.start(0.0);
    let (radius, angle) = (if contact { 2.6e-4 } else { 1e-4 * (1.0 + numbers.next()) }, PI * numbers.next());
    state.position_m = [radius * angle.cos(), radius * angle.sin()];
    state.velocity_m_s = [0.02 * numbers.next(), 0.02 * numbers.next()];
    state.theta_rad = 3.0 * numbers.next();
    state.linkage_wb = std::array::from_fn(|_| 1e-2 * numbers.next());
    state.contact = contact;
    let input = PlantInput {
        current_a: std::array::from_fn(|_| 2.0 * numbers.next()),
        voltage_v: std::array::from_fn(|_| 30.0 * numbers.next()),
        perturbation_n: std::array::from_fn(|_| numbers.next()),
        omega_rad_s: 300.0 + 20.0 * numbers.next(),
    };
    (state, input)
}

fn modes(plant: &Plant, state: &PlantState) -> Modes {
    Modes { drive: plant.config().coil.drive, open: state.open, contact: state.contact }
}

fn values<const N: usize>(response: &Response<Jet<N>>, order: usize) -> Vec<Vec<f64>> {
    let list = |jets: &[Jet<N>]| jets.iter().map(|jet| jet.0[order]).collect::<Vec<_>>();
    vec![
        list(&response.gap_m),
        list(&response.induced_v),
        list(&response.force_n),
        list(&response.resultant_n),
        list(&response.perturbation_n),
        list(&response.contact_n),
        list(&response.acceleration_m_s2),
    ]
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

/// Fails if the arithmetic of jets has an equation that is not that of the plant, for instance the sign of the drag.
#[test]
fn the_values_are_those_of_the_plant() {
    let mut numbers = Numbers(1);
    for config in all_configs() {
        let plant = Plant::new(config).expect("a plant");
        for round in 0..40 {
            let (mut state, input) = somewhere(&plant, &mut numbers, round % 4 == 0);
            state.open[1] = round % 8 == 1;
            let point = Point::of(plant.config(), &state, &input, 0.3);
            let got = response(&modes(&plant, &state), &point.with(&point, |value, _| Jet::<1>::constant(value)));
            let wanted = plant.outputs(&state, &input, 0.3);
            let wanted = [
                wanted.gap_m.to_vec(),
                wanted.induced_v.to_vec(),
                wanted.force_n.to_vec(),
                wanted.resultant_n.to_vec(),
                wanted.perturbation_n.to_vec(),
                wanted.contact_n.to_vec(),
                wanted.acceleration_m_s2.to_vec(),
            ];
            agree("values", &values(&got, 0), &wanted, ROUNDING * 100.0, &[1e-4, 1.0, 1.0, 1.0, 1.0, 100.0, 1.0]);
        }
    }
}

/// Fails if a derivative is left out anywhere, for instance that of the sine of `alpha`.
#[test]
fn directional_derivatives_are_limits_of_difference_quotients() {
    let mut numbers = Numbers(2);
    for config in all_configs() {
        let plant = Plant::new(config).expect("a plant");
        for round in 0..40 {
            let (state, input) = somewhere(&plant, &mut numbers, round % 4 == 0);
            let modes = modes(&plant, &state);
            let point = Point::of(plant.config(), &state, &input, 0.3);
            // Each number in units of its own size, the velocity of the rotor's surface in those of the friction.
            let direction = point.with(&point, |value: f64, _: f64| 0.3 * value);
            let weights: Vec<f64> = (0..60).map(|_| numbers.next()).collect();
            let at = std::cell::Cell::new(0);
            let direction = direction.with(&direction, |value: f64, _: f64| {
                at.set((at.get() + 1) % weights.len());
                value * weights[at.get()]
            });
            let got = values(&along(&modes, &point, &direction), 1);
            let shifted = |h: f64| {
                let moved = point.with(&direction, |value, slope| Jet::<1>::constant(value + h * slope));
                values(&response(&modes, &moved), 0)
            };
            let h = 2e-4;
            let sides = [-2.0, -1.0, 1.0, 2.0].map(|side| shifted(side * h));
            let quotient: Vec<Vec<f64>> = (0..got.len())
                .map(|row| {
                    (0..got[row].len())
                        .map(|column| {
                            let [a, b, c, d] = sides.each_ref().map(|side| side[row][column]);
                            (a - 8.0 * b + 8.0 * c - d) / (12.0 * h)
                        })
                        .collect()
                })
                .collect();
            // Friction bends within millimetres per second: the quotient is coarser there.
            let tolerance = if modes.contact { 1e-3 } else { QUOTIENT };
            agree("directional", &got, &quotient, tolerance, &[1e-5, 0.1, 0.1, 0.1, 0.1, 1.0, 0.1]);
        }
    }
}

/// Fails if a derivative with respect to time forgets a state or an input that moves.
#[test]
fn derivatives_in_time_are_those_of_the_motion() {
    let mut numbers = Numbers(3);
    for config in all_configs() {
        let plant = Plant::new(config).expect("a plant");
        for _ in 0..20 {
            let (mut state, input) = somewhere(&plant, &mut numbers, false);
            state.linkage_wb = state.linkage_wb.map(|psi| 0.3 * psi);
            let modes = modes(&plant, &state);
            let slopes = [1.0, 100.0].map(|size| PlantInput {
                current_a: std::array::from_fn(|_| size * numbers.next()),
                voltage_v: std::array::from_fn(|_| size * numbers.next()),
                perturbation_n: std::array::from_fn(|_| size * numbers.next()),
                omega_rad_s: size * numbers.next(),
            });
            let point = Point::of(plant.config(), &state, &input, 0.3);
            let (motion, rate) = in_time::<3>(&modes, &point, &slopes);
            // The Taylor polynomial of the motion must satisfy the equations of motion: positions and outputs at τ, from
            // five coefficients, against the sum of the first three.
            let (long, exact) = in_time::<7>(&modes, &point, &slopes);
            for a in 0..2 {
                assert_eq!(motion.position_m[a].0[2], long.position_m[a].0[2]);
                assert_eq!(motion.velocity_m_s[a].0[0], state.velocity_m_s[a]);
            }
            let tau = 1e-6;
            let moved = long.with(&long, |jet: Jet<7>, _: Jet<7>| {
                Jet::<1>::constant(jet.0.iter().rev().fold(0.0, |sum, c| sum * tau + c))
            });
            let there = values(&response(&modes, &moved), 0);
            let sum = |order: usize| values(&exact, order);
            let series: Vec<Vec<f64>> = (0..there.len())
                .map(|row| {
                    (0..there[row].len())
                        .map(|column| (0..7).rev().fold(0.0, |value, order| value * tau + sum(order)[row][column]))
                        .collect()
                })
                .collect();
            agree("series", &series, &there, 1e-11, &[1e-4, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]);
            agree("orders", &values(&rate, 2), &values(&exact, 2), 1e-12, &[1e-4, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]);
        }
    }
}
