//! Exact derivatives of the plant's equations, by arithmetic on truncated Taylor series.
//!
//! A [`Taylor`] is a number together with its first Taylor coefficients along some line. Put through the
//! [`Equations`] of the plant, it carries their derivatives along: with two coefficients and a line through the space of
//! states, inputs and parameters, the directional derivative ([`along`]); with more of them and the line of time, the
//! derivatives of the outputs with respect to time ([`in_time`]). No difference quotients are taken, so that
//! the results are exact to rounding.
//!
//! The arithmetic is our own because libraries of dual numbers call the platform's sine (and so give other bits on other
//! platforms) and stop at a fixed order.

use std::ops::{Add, Div, Mul, Neg, Sub};

use crate::bearing::coil::CoilConfig;
use crate::bearing::scalar::Scalar;
use crate::bearing::touchdown::TouchdownConfig;
use crate::plant::{Conditions, Equations, Harmonic, Motion, Plant, PlantConfig, PlantInput, PlantOutput, PlantState};

/// The coefficients c of `Σ_j c_j τ^j`, j < N.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Taylor<const N: usize>(pub [f64; N]);

impl<const N: usize> Taylor<N> {
    /// The derivative of order `j` at the begin of the line: `j! c_j`.
    pub fn derivative(&self, j: usize) -> f64 {
        (1..=j).fold(self.0[j], |product, factor| product * factor as f64)
    }
}

impl<const N: usize> Scalar for Taylor<N> {
    // The least p with 2^p ≥ N.
    const POLISHING: u32 = usize::BITS - N.saturating_sub(1).leading_zeros();

    fn constant(value: f64) -> Self {
        Self(std::array::from_fn(|j| if j == 0 { value } else { 0.0 }))
    }

    fn value(self) -> f64 {
        self.0[0]
    }

    fn is_zero(self) -> bool {
        self.0.iter().all(|c| *c == 0.0)
    }

    fn sine(self) -> Self {
        self.sine_cosine().0
    }

    // From s' = x' c, c' = −x' s.
    fn sine_cosine(self) -> (Self, Self) {
        let (sine, cosine) = libm::sincos(self.0[0]);
        let (mut sine, mut cosine) = (Self::constant(sine), Self::constant(cosine));
        for j in 1..N {
            let slope = |other: &Self| -> f64 { (1..=j).map(|i| i as f64 * self.0[i] * other.0[j - i]).sum() };
            let (s, c) = (slope(&cosine) / j as f64, -slope(&sine) / j as f64);
            (sine.0[j], cosine.0[j]) = (s, c);
        }
        (sine, cosine)
    }

    // From r² = x² + y²; r must be above 0 for derivatives to exist.
    fn norm(self, other: Self) -> Self {
        let square = self * self + other * other;
        let mut root = Self::constant(libm::hypot(self.0[0], other.0[0]));
        for j in 1..N {
            let known: f64 = (1..j).map(|i| root.0[i] * root.0[j - i]).sum();
            root.0[j] = (square.0[j] - known) / (2.0 * root.0[0]);
        }
        root
    }
}

impl<const N: usize> Add for Taylor<N> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(std::array::from_fn(|j| self.0[j] + other.0[j]))
    }
}

impl<const N: usize> Sub for Taylor<N> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self(std::array::from_fn(|j| self.0[j] - other.0[j]))
    }
}

impl<const N: usize> Neg for Taylor<N> {
    type Output = Self;
    fn neg(self) -> Self {
        Self(self.0.map(|c| -c))
    }
}

impl<const N: usize> Mul for Taylor<N> {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Self(std::array::from_fn(|j| (0..=j).map(|i| self.0[i] * other.0[j - i]).sum()))
    }
}

impl<const N: usize> Div for Taylor<N> {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let mut quotient = Self::constant(0.0);
        for j in 0..N {
            let known: f64 = (0..j).map(|i| quotient.0[i] * other.0[j - i]).sum();
            quotient.0[j] = (self.0[j] - known) / other.0[0];
        }
        quotient
    }
}

impl<const N: usize> Add<f64> for Taylor<N> {
    type Output = Self;
    fn add(mut self, other: f64) -> Self {
        self.0[0] += other;
        self
    }
}

impl<const N: usize> Mul<f64> for Taylor<N> {
    type Output = Self;
    fn mul(self, factor: f64) -> Self {
        Self(self.0.map(|c| c * factor))
    }
}

/// All that the outputs of the plant follow from.
#[derive(Clone, Debug, PartialEq)]
pub struct Point<T = f64> {
    /// Parameters.
    pub config: PlantConfig<T>,
    /// States of the equations of motion.
    pub motion: Motion<T>,
    /// Inputs.
    pub input: PlantInput<T>,
    /// Time, angle of the rotor, and what has no derivative.
    pub conditions: Conditions<T>,
}

impl Point {
    /// Where a plant stands at the time `t_s`, in s.
    pub fn of(plant: &Plant, state: &PlantState, input: &PlantInput, t_s: f64) -> Self {
        Self {
            config: plant.config().clone(),
            motion: state.motion(),
            input: input.clone(),
            conditions: state.conditions(t_s),
        }
    }
}

impl<T: Scalar> Point<T> {
    /// Number by number, what `join` makes of this point and another; what is no number is that of this point.
    pub fn with<U: Copy, V>(&self, other: &Point<U>, join: impl Fn(T, U) -> V) -> Point<V> {
        macro_rules! joined {
            ($type:ident { $($scalar:ident),*; $($list:ident),*; $($rest:ident: $value:expr),* } of $own:expr, $other:expr) => {
                $type {
                    $($scalar: join($own.$scalar, $other.$scalar),)*
                    $($list: std::array::from_fn(|k| join($own.$list[k], $other.$list[k])),)*
                    $($rest: $value,)*
                }
            };
        }
        let (own, off) = (&self.config, &other.config);
        Point {
            config: joined!(PlantConfig {
                m_kg, gap_m, unbalance_kgm, unbalance_phase_rad, theta_rad;
                alpha_rad, lambda_nm2_a2, gravity_m_s2, position_m, velocity_m_s;
                harmonic: joined!(Harmonic { omega_rad_s; amplitude_n, phase_rad; } of own.harmonic, off.harmonic),
                coil: joined!(CoilConfig {
                    resistance_ohm, leakage_h, limit_v, saturation_wb;; drive: own.coil.drive
                } of own.coil, off.coil),
                touchdown: joined!(TouchdownConfig {
                    clearance_m, stiffness_n_m, damping_ns_m, friction, radius_m;;
                } of own.touchdown, off.touchdown),
                sensor: own.sensor.clone(),
                max_step_s: own.max_step_s
            } of own, off),
            motion: std::array::from_fn(|k| join(self.motion[k], other.motion[k])),
            input: joined!(PlantInput { omega_rad_s; current_a, voltage_v, perturbation_n; } of self.input, other.input),
            conditions: joined!(Conditions {
                time_s, theta_rad;; contact: self.conditions.contact, open: self.conditions.open
            } of self.conditions, other.conditions),
        }
    }

    /// The outputs there.
    pub fn outputs(&self) -> PlantOutput<T> {
        Equations::new(self.config.clone()).outputs(&self.motion, &self.input, self.conditions)
    }
}

/// The outputs at a point and their derivatives in a direction, which has the units of the point.
pub fn along(point: &Point, direction: &Point) -> PlantOutput<Taylor<2>> {
    point.with(direction, |value, slope| Taylor([value, slope])).outputs()
}

/// The motion from a point on, and its outputs, as Taylor series in time. `slopes[j]` are the derivatives of order j + 1
/// of the inputs; with fewer of them than N − 1 the others are 0.
pub fn in_time<const N: usize>(point: &Point, slopes: &[PlantInput]) -> (Point<Taylor<N>>, PlantOutput<Taylor<N>>) {
    let mut line = point.with(point, |value, _| Taylor::<N>::constant(value));
    let equations = Equations::new(line.config.clone());
    let Point { motion, input, conditions, .. } = &mut line;
    let mut factorial = 1.0;
    for (j, slope) in (1..N).zip(slopes) {
        factorial *= j as f64;
        let series = input.current_a.iter_mut().chain(&mut input.voltage_v).chain(&mut input.perturbation_n);
        let values = slope.current_a.iter().chain(&slope.voltage_v).chain(&slope.perturbation_n);
        for (series, slope) in series.zip(values) {
            series.0[j] = slope / factorial;
        }
        input.omega_rad_s.0[j] = slope.omega_rad_s / factorial;
    }
    if N > 1 {
        conditions.time_s.0[1] = 1.0;
    }
    // Each round makes one more coefficient of the states right: x_j+1 = ẋ_j / (j + 1).
    for j in 0..N.saturating_sub(1) {
        let rate = equations.derivative(motion, input, *conditions);
        let over = 1.0 / (j + 1) as f64;
        for (state, rate) in motion.iter_mut().zip(rate) {
            state.0[j + 1] = rate.0[j] * over;
        }
        conditions.theta_rad.0[j + 1] = input.omega_rad_s.0[j] * over;
    }
    let outputs = equations.outputs(motion, input, *conditions);
    (line, outputs)
}
