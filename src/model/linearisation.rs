//! Exact derivatives of the plant's equations, by arithmetic on truncated Taylor series.
//!
//! A [`Jet`] is a number together with its first Taylor coefficients along some line. Put through the equations of
//! [`plant`](super::plant), it carries their derivatives along: with two coefficients and a line through the space of
//! states, inputs and parameters, the directional derivative ([`along`]); with more of them and the line of time, the
//! derivatives of the outputs with respect to time ([`in_time`]). Nothing is ever divided by a small difference, so that
//! the results are exact to rounding.

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::plant::{Plant, PlantInput, PlantState};

/// The coefficients c of `Σ_j c_j τ^j`, j < N.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jet<const N: usize>(pub [f64; N]);

impl<const N: usize> Jet<N> {
    /// A number that does not change along the line.
    pub fn constant(value: f64) -> Self {
        Self(std::array::from_fn(|j| if j == 0 { value } else { 0.0 }))
    }

    /// The derivative of order `j` at the begin of the line: `j! c_j`.
    pub fn derivative(&self, j: usize) -> f64 {
        (1..=j).fold(self.0[j], |product, factor| product * factor as f64)
    }

    /// Sine and cosine, from `s' = x' c`, `c' = −x' s`.
    pub fn sin_cos(self) -> (Self, Self) {
        let (mut sine, mut cosine) = (Self::constant(0.0), Self::constant(0.0));
        (sine.0[0], cosine.0[0]) = (libm::sin(self.0[0]), libm::cos(self.0[0]));
        for j in 1..N {
            let slope = |other: &Self| -> f64 { (1..=j).map(|i| i as f64 * self.0[i] * other.0[j - i]).sum() };
            let (s, c) = (slope(&cosine) / j as f64, -slope(&sine) / j as f64);
            (sine.0[j], cosine.0[j]) = (s, c);
        }
        (sine, cosine)
    }
}

impl<const N: usize> Add for Jet<N> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(std::array::from_fn(|j| self.0[j] + other.0[j]))
    }
}

impl<const N: usize> Sub for Jet<N> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self(std::array::from_fn(|j| self.0[j] - other.0[j]))
    }
}

impl<const N: usize> Neg for Jet<N> {
    type Output = Self;
    fn neg(self) -> Self {
        Self(self.0.map(|c| -c))
    }
}

impl<const N: usize> Mul for Jet<N> {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Self(std::array::from_fn(|j| (0..=j).map(|i| self.0[i] * other.0[j - i]).sum()))
    }
}

impl<const N: usize> Div for Jet<N> {
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

/// All that the outputs of the plant follow from, in the units of [`PlantConfig`](super::plant::PlantConfig),
/// [`PlantState`] and [`PlantInput`]; `T` is a number or a [`Jet`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs, reason = "the names are those of the configuration, the state and the input")]
pub struct Point<T> {
    pub m_kg: T,
    pub gap_m: T,
    pub alpha_rad: [T; 3],
    pub lambda_nm2_a2: [T; 3],
    pub unbalance_kgm: T,
    pub unbalance_phase_rad: T,
    pub amplitude_n: [T; 2],
    pub harmonic_omega_rad_s: T,
    pub harmonic_phase_rad: [T; 2],
    pub position_m: [T; 2],
    pub velocity_m_s: [T; 2],
    pub theta_rad: T,
    pub current_a: [T; 3],
    pub perturbation_n: [T; 2],
    pub omega_rad_s: T,
    pub time_s: T,
}

impl Point<f64> {
    /// Where a plant stands at the time `t_s`, in s.
    pub fn of(plant: &Plant, state: &PlantState, input: &PlantInput, t_s: f64) -> Self {
        let config = plant.config();
        Self {
            m_kg: config.m_kg,
            gap_m: config.gap_m,
            alpha_rad: config.alpha_rad,
            lambda_nm2_a2: config.lambda_nm2_a2,
            unbalance_kgm: config.unbalance_kgm,
            unbalance_phase_rad: config.unbalance_phase_rad,
            amplitude_n: config.harmonic.amplitude_n,
            harmonic_omega_rad_s: config.harmonic.omega_rad_s,
            harmonic_phase_rad: config.harmonic.phase_rad,
            position_m: state.position_m,
            velocity_m_s: state.velocity_m_s,
            theta_rad: state.theta_rad,
            current_a: input.current_a,
            perturbation_n: input.perturbation_n,
            omega_rad_s: input.omega_rad_s,
            time_s: t_s,
        }
    }
}

impl<T: Copy> Point<T> {
    /// Number by number, what `join` makes of this point and another.
    pub fn with<U: Copy, V>(&self, other: &Point<U>, join: impl Fn(T, U) -> V) -> Point<V> {
        macro_rules! joined {
            ($($scalar:ident),*; $($list:ident),*) => {
                Point {
                    $($scalar: join(self.$scalar, other.$scalar),)*
                    $($list: std::array::from_fn(|k| join(self.$list[k], other.$list[k])),)*
                }
            };
        }
        joined!(
            m_kg, gap_m, unbalance_kgm, unbalance_phase_rad, harmonic_omega_rad_s, theta_rad, omega_rad_s, time_s;
            alpha_rad, lambda_nm2_a2, amplitude_n, harmonic_phase_rad, position_m, velocity_m_s, current_a,
            perturbation_n
        )
    }
}

/// What follows at a [`Point`], in the units of [`PlantOutput`](super::plant::PlantOutput).
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs, reason = "the names are those of the output")]
pub struct Response<T> {
    pub gap_m: [T; 3],
    pub force_n: [T; 3],
    pub resultant_n: [T; 2],
    pub perturbation_n: [T; 2],
    pub acceleration_m_s2: [T; 2],
}

/// The equations of the plant, those of [`Plant::outputs`], along a line.
pub fn response<const N: usize>(at: &Point<Jet<N>>) -> Response<Jet<N>> {
    let e = at.alpha_rad.map(Jet::sin_cos);
    let [y, z] = at.position_m;
    // gap_k = s − e_k · (Y, Z)
    let gap_m = e.map(|(sine, cosine)| at.gap_m - (sine * y + cosine * z));
    // F_k = λ_k i_k² / gap_k²                                                    P(4)
    let force_n = std::array::from_fn(|k| {
        let i_per_gap = at.current_a[k] / gap_m[k];
        at.lambda_nm2_a2[k] * i_per_gap * i_per_gap
    });
    let [f_1, f_2, f_3]: [Jet<N>; 3] = force_n;
    // (F_y, F_z) = Σ F_k e_k                                                     P(3)
    let resultant_n = [f_1 * e[0].0 + f_2 * e[1].0 + f_3 * e[2].0, f_1 * e[0].1 + f_2 * e[1].1 + f_3 * e[2].1];
    // p_a + amplitude_a sin(ω_p t + phase_a) + U ω² (cos, sin)(θ + φ)
    let unbalance_n = at.unbalance_kgm * at.omega_rad_s * at.omega_rad_s;
    let (sine, cosine) = (at.theta_rad + at.unbalance_phase_rad).sin_cos();
    let turning = [cosine, sine];
    let perturbation_n = std::array::from_fn(|a| {
        let (wave, _) = (at.harmonic_omega_rad_s * at.time_s + at.harmonic_phase_rad[a]).sin_cos();
        at.perturbation_n[a] + at.amplitude_n[a] * wave + unbalance_n * turning[a]
    });
    let acceleration_m_s2 = std::array::from_fn(|a| (resultant_n[a] + perturbation_n[a]) / at.m_kg);
    Response { gap_m, force_n, resultant_n, perturbation_n, acceleration_m_s2 }
}

/// The values at a point and their derivatives in a direction, which has the units of the point.
pub fn along(point: &Point<f64>, direction: &Point<f64>) -> Response<Jet<2>> {
    response(&point.with(direction, |value, slope| Jet([value, slope])))
}

/// The motion from a point on, and its outputs, as Taylor series in time. `slopes[j]` are the derivatives of order j + 1
/// of the inputs; with fewer of them than N − 1 the others are 0.
pub fn in_time<const N: usize>(point: &Point<f64>, slopes: &[PlantInput]) -> (Point<Jet<N>>, Response<Jet<N>>) {
    let mut motion = point.with(point, |value, _| Jet::<N>::constant(value));
    let mut factorial = 1.0;
    for (j, slope) in (1..N).zip(slopes) {
        factorial *= j as f64;
        for (series, slope) in motion.current_a.iter_mut().zip(slope.current_a) {
            series.0[j] = slope / factorial;
        }
        for (series, slope) in motion.perturbation_n.iter_mut().zip(slope.perturbation_n) {
            series.0[j] = slope / factorial;
        }
        motion.omega_rad_s.0[j] = slope.omega_rad_s / factorial;
    }
    if N > 1 {
        motion.time_s.0[1] = 1.0;
    }
    // Each round makes one more coefficient of the states right: x_j+1 = ẋ_j / (j + 1).
    for j in 0..N.saturating_sub(1) {
        let rate = response(&motion);
        let over = 1.0 / (j + 1) as f64;
        for a in 0..2 {
            motion.position_m[a].0[j + 1] = motion.velocity_m_s[a].0[j] * over;
            motion.velocity_m_s[a].0[j + 1] = rate.acceleration_m_s2[a].0[j] * over;
        }
        motion.theta_rad.0[j + 1] = motion.omega_rad_s.0[j] * over;
    }
    (motion, response(&motion))
}
