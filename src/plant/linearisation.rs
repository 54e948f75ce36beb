//! Exact derivatives of the plant's equations, by arithmetic on truncated Taylor series.
//!
//! A [`Taylor`] holds the first Taylor coefficients of a number along a line. Evaluated with it, the [`Equations`] of the plant
//! give derivatives as well: with two coefficients and a line through the space of states, inputs and parameters, the directional
//! derivative ([`Point::along`]); with more coefficients along time, the time derivatives of the outputs ([`Point::in_time`]).
//! The results are exact to rounding, without difference quotients.
//!
//! Libraries of dual numbers are not used: they call the platform's sine, whose bits differ between platforms, and stop at a fixed
//! order.

use std::ops::{Add, Div, Mul, Neg, Sub};

use crate::bearing::{Scalar, array, joined};
use crate::plant::{
    AtBearing, Conditions, Equations, Instant, Motion, Plant, PlantConfigOf, PlantInput, PlantOutput, PlantState,
};

/// The coefficients c of `Σ_j c_j τ^j`, j < N.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Taylor<const N: usize>(pub [f64; N]);

impl<const N: usize> Taylor<N> {
    /// The derivative of order `j` at the beginning of the line: `j! c_j`.
    pub fn derivative(&self, j: usize) -> f64 {
        (1..=j).fold(self.0[j], |product, factor| product * factor as f64)
    }
}

impl<const N: usize> Scalar for Taylor<N> {
    // The smallest p with 2^p ≥ N.
    const POLISHING: u32 = usize::BITS - N.saturating_sub(1).leading_zeros();

    fn constant(value: f64) -> Self {
        Self(array::from_fn(|j| if j == 0 { value } else { 0.0 }))
    }

    fn value(self) -> f64 {
        self.0[0]
    }

    fn is_zero(self) -> bool {
        self.0.iter().all(|c| *c == 0.0)
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

    // From r² = x² + y²; the derivatives exist only for r above 0.
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

macro_rules! operators {
    ($($operator:ident $name:ident |$own:ident $(, $other:ident: $type:ty)?| $result:expr;)*) => {$(
        impl<const N: usize> $operator$(<$type>)? for Taylor<N> {
            type Output = Self;
            fn $name(self $(, $other: $type)?) -> Self {
                let $own = self;
                $result
            }
        }
    )*};
}
operators! {
    Add add |x, y: Self| Self(array::from_fn(|j| x.0[j] + y.0[j]));
    Add add |x, y: f64| Self(array::from_fn(|j| if j == 0 { x.0[j] + y } else { x.0[j] }));
    Sub sub |x, y: Self| Self(array::from_fn(|j| x.0[j] - y.0[j]));
    Neg neg |x| Self(array::map(x.0, |c| -c));
    Mul mul |x, y: Self| Self(array::from_fn(|j| (0..=j).map(|i| x.0[i] * y.0[j - i]).sum()));
    Mul mul |x, factor: f64| Self(array::map(x.0, |c| c * factor));
    // From x = q y.
    Div div |x, y: Self| {
        let mut quotient = Self::constant(0.0);
        for j in 0..N {
            let known: f64 = (0..j).map(|i| quotient.0[i] * y.0[j - i]).sum();
            quotient.0[j] = (x.0[j] - known) / y.0[0];
        }
        quotient
    };
}

/// All quantities on which the outputs of the plant depend.
#[derive(Clone, Debug, PartialEq)]
pub struct Point<T = f64, const N: usize = 2, const K: usize = 3, const B: usize = 1> {
    /// Parameters.
    pub config: PlantConfigOf<T, N, K, B>,
    /// State of the equations of motion.
    pub motion: Motion<T, N, K>,
    /// Inputs.
    pub input: PlantInput<T, N, K>,
    /// Time, angle of the rotor, and discrete conditions.
    pub conditions: Conditions<T, K, B>,
}

impl<const N: usize, const K: usize, const B: usize> Point<f64, N, K, B> {
    /// The point of a plant at the time `t_s`, in s.
    pub fn of(plant: &Plant<N, K, B>, state: &PlantState<N, K, B>, input: &PlantInput<f64, N, K>, t_s: f64) -> Self {
        Self {
            config: plant.config().clone(),
            motion: state.motion,
            input: input.clone(),
            conditions: state.conditions(t_s),
        }
    }

    /// The line from this point in a direction, in the same units: its outputs are values and derivatives along the line.
    pub fn along<const ORDERS: usize>(&self, direction: &Self) -> Point<Taylor<ORDERS>, N, K, B> {
        self.with(direction, |value, slope| {
            let mut series = Taylor::constant(value);
            series.0[1] = slope;
            series
        })
    }

    /// The motion from this point on as Taylor series in time. `slopes[j]` are the derivatives of order j + 1 of the inputs; missing
    /// ones are 0.
    pub fn in_time<const ORDERS: usize>(&self, slopes: &[PlantInput<f64, N, K>]) -> Point<Taylor<ORDERS>, N, K, B> {
        let mut line = self.with(self, |value, _: f64| Taylor::<ORDERS>::constant(value));
        let equations = Equations::new(line.config.clone());
        let Point { motion, input, conditions, .. } = &mut line;
        let mut factorial = 1.0;
        for (j, slope) in (1..ORDERS).zip(slopes) {
            factorial *= j as f64;
            *input = input.with(slope, |mut series, slope| {
                series.0[j] = slope / factorial;
                series
            });
        }
        if ORDERS > 1 {
            conditions.time_s.0[1] = 1.0;
        }
        // Each iteration yields one more coefficient of the states: x_j+1 = ẋ_j / (j + 1).
        for j in 0..ORDERS.saturating_sub(1) {
            let rate = equations.derivative(&Instant { motion, input, conditions: *conditions });
            let over = 1.0 / (j + 1) as f64;
            *motion = motion.with(&rate, |mut state, rate| {
                state.0[j + 1] = rate.0[j] * over;
                state
            });
            conditions.theta_rad.0[j + 1] = input.omega_rad_s.0[j] * over;
        }
        line
    }
}

impl<T: Scalar, const N: usize, const K: usize, const B: usize> Point<T, N, K, B> {
    /// Combines two points, number by number; discrete values come from `self`.
    pub fn with<U: Scalar, V: Scalar>(&self, other: &Point<U, N, K, B>, join: impl Fn(T, U) -> V) -> Point<V, N, K, B> {
        let (own, others) = (&self.conditions, &other.conditions);
        Point {
            config: self.config.with(&other.config, &join),
            motion: self.motion.with(&other.motion, &join),
            input: self.input.with(&other.input, &join),
            conditions: joined!(own, others, &join, Conditions { time_s, theta_rad;; contact: own.contact, open: own.open }),
        }
    }

    /// The outputs at this point, and those at the bearings.
    pub fn outputs(&self) -> (PlantOutput<T, N, K>, [AtBearing<T>; B]) {
        let (Self { motion, input, conditions, .. }, equations) = (self, Equations::new(self.config.clone()));
        let at = Instant { motion, input, conditions: *conditions };
        let output = equations.outputs(&at);
        let at_bearings = equations.at_bearings(&at, output.force_n);
        (output, at_bearings)
    }
}
