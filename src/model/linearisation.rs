//! Exact derivatives of the plant's equations, by arithmetic on truncated Taylor series.
//!
//! A [`Jet`] is a number together with its first Taylor coefficients along some line. Put through the equations of
//! [`plant`](super::plant), it carries their derivatives along: with two coefficients and a line through the space of
//! states, inputs and parameters, the directional derivative ([`along`]); with more of them and the line of time, the
//! derivatives of the outputs with respect to time ([`in_time`]). Nothing is ever divided by a small difference, so that
//! the results are exact to rounding.

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::coil::Drive;
use super::plant::{PlantConfig, PlantInput, PlantState};
use super::touchdown::SLIDING_M_S;

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

    /// The square root of a number above 0, from `r² = x`.
    pub fn sqrt(self) -> Self {
        let mut root = Self::constant(self.0[0].sqrt());
        for j in 1..N {
            let known: f64 = (1..j).map(|i| root.0[i] * root.0[j - i]).sum();
            root.0[j] = (self.0[j] - known) / (2.0 * root.0[0]);
        }
        root
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

/// All that the outputs of the plant follow from, in the units of [`PlantConfig`],
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
    pub gravity_m_s2: [T; 2],
    pub resistance_ohm: T,
    pub leakage_h: T,
    pub limit_v: T,
    pub saturation_wb: T,
    pub clearance_m: T,
    pub stiffness_n_m: T,
    pub damping_ns_m: T,
    pub friction: T,
    pub radius_m: T,
    pub position_m: [T; 2],
    pub velocity_m_s: [T; 2],
    pub theta_rad: T,
    pub linkage_wb: [T; 3],
    pub current_a: [T; 3],
    pub voltage_v: [T; 3],
    pub perturbation_n: [T; 2],
    pub omega_rad_s: T,
    pub time_s: T,
}

impl Point<f64> {
    /// Where a plant stands at the time `t_s`, in s.
    pub fn of(config: &PlantConfig, state: &PlantState, input: &PlantInput, t_s: f64) -> Self {
        let (coil, ring) = (&config.coil, &config.touchdown);
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
            gravity_m_s2: config.gravity_m_s2,
            resistance_ohm: coil.resistance_ohm,
            leakage_h: coil.leakage_h,
            limit_v: coil.limit_v,
            saturation_wb: coil.saturation_wb,
            clearance_m: ring.clearance_m,
            stiffness_n_m: ring.stiffness_n_m,
            damping_ns_m: ring.damping_ns_m,
            friction: ring.friction,
            radius_m: ring.radius_m,
            position_m: state.position_m,
            velocity_m_s: state.velocity_m_s,
            theta_rad: state.theta_rad,
            linkage_wb: state.linkage_wb,
            current_a: input.current_a,
            voltage_v: input.voltage_v,
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
            m_kg, gap_m, unbalance_kgm, unbalance_phase_rad, harmonic_omega_rad_s, resistance_ohm, leakage_h, limit_v,
            saturation_wb, clearance_m, stiffness_n_m, damping_ns_m, friction, radius_m, theta_rad, omega_rad_s, time_s;
            alpha_rad, lambda_nm2_a2, amplitude_n, harmonic_phase_rad, gravity_m_s2, position_m, velocity_m_s, linkage_wb,
            current_a, voltage_v, perturbation_n
        )
    }
}

/// What the equations depend on beside numbers; where it changes, there are no derivatives.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Modes {
    /// Whether current or voltage is given.
    pub drive: Drive,
    /// Coils whose circuit is open.
    pub open: [bool; 3],
    /// Whether rotor and backup bearing push each other.
    pub contact: bool,
}

/// What follows at a [`Point`], in the units of [`PlantOutput`](super::plant::PlantOutput).
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs, reason = "the names are those of the output")]
pub struct Response<T> {
    pub gap_m: [T; 3],
    pub induced_v: [T; 3],
    pub force_n: [T; 3],
    pub resultant_n: [T; 2],
    pub perturbation_n: [T; 2],
    pub contact_n: [T; 2],
    pub acceleration_m_s2: [T; 2],
}

/// The equations of the plant, those of [`Plant::outputs`](super::plant::Plant::outputs), along a line.
pub fn response<const N: usize>(modes: &Modes, at: &Point<Jet<N>>) -> Response<Jet<N>> {
    let e = at.alpha_rad.map(Jet::sin_cos);
    let [y, z] = at.position_m;
    // gap_k = s − e_k · (Y, Z)
    let gap_m = e.map(|(sine, cosine)| at.gap_m - (sine * y + cosine * z));
    let coils: [[Jet<N>; 2]; 3] = std::array::from_fn(|k| coil(modes, at, k, gap_m[k]));
    let force_n = coils.map(|[force_n, _]| force_n);
    let [f_1, f_2, f_3] = force_n;
    // (F_y, F_z) = Σ F_k e_k                                                     P(3)
    let resultant_n = [f_1 * e[0].0 + f_2 * e[1].0 + f_3 * e[2].0, f_1 * e[0].1 + f_2 * e[1].1 + f_3 * e[2].1];
    // dψ_k/dt = u_k − R i_k, u_k within the limit
    let induced_v = std::array::from_fn(|k| {
        if modes.drive == Drive::Current || modes.open[k] {
            return Jet::constant(0.0);
        }
        let (u, limit) = (at.voltage_v[k], at.limit_v);
        let within = if u.0[0] > limit.0[0] {
            limit
        } else if u.0[0] < -limit.0[0] {
            -limit
        } else {
            u
        };
        within - at.resistance_ohm * coils[k][1]
    });
    // p_a + amplitude_a sin(ω_p t + phase_a) + m g_a + U ω² (cos, sin)(θ + φ)
    let unbalance_n = at.unbalance_kgm * at.omega_rad_s * at.omega_rad_s;
    let (sine, cosine) = (at.theta_rad + at.unbalance_phase_rad).sin_cos();
    let turning = [cosine, sine];
    let perturbation_n = std::array::from_fn(|a| {
        let (wave, _) = (at.harmonic_omega_rad_s * at.time_s + at.harmonic_phase_rad[a]).sin_cos();
        at.perturbation_n[a] + at.amplitude_n[a] * wave + at.m_kg * at.gravity_m_s2[a] + unbalance_n * turning[a]
    });
    let contact_n = if modes.contact { contact(at) } else { [Jet::constant(0.0); 2] };
    let acceleration_m_s2 = std::array::from_fn(|a| (resultant_n[a] + perturbation_n[a] + contact_n[a]) / at.m_kg);
    Response { gap_m, induced_v, force_n, resultant_n, perturbation_n, contact_n, acceleration_m_s2 }
}

/// Force and current of a coil, `F = φ²/(4λ)`, `i = φ gap/(2λ) + i_s (φ/φ_s)⁷`.
fn coil<const N: usize>(modes: &Modes, at: &Point<Jet<N>>, k: usize, gap_m: Jet<N>) -> [Jet<N>; 2] {
    if modes.open[k] {
        return [Jet::constant(0.0); 2];
    }
    let two = Jet::constant(2.0);
    let lambda = at.lambda_nm2_a2[k];
    let reluctance = gap_m / (two * lambda);
    let saturates = at.saturation_wb.0[0] > 0.0;
    // i and ∂i/∂φ.
    let current = |flux: Jet<N>| {
        if !saturates {
            return [flux * reluctance, reluctance];
        }
        let ratio = flux / at.saturation_wb;
        let cube = ratio * ratio * ratio;
        let iron_a_wb = at.gap_m / (two * lambda);
        let sixth = cube * cube;
        [
            flux * reluctance + iron_a_wb * at.saturation_wb * sixth * ratio,
            reluctance + Jet::constant(7.0) * iron_a_wb * sixth,
        ]
    };
    let mut flux = match modes.drive {
        Drive::Current => at.current_a[k] / reluctance,
        Drive::Voltage => at.linkage_wb[k] / (Jet::constant(1.0) + at.leakage_h * reluctance),
    };
    if saturates {
        // Newton's method, at first for the number, then also for the other coefficients, of which every step doubles those
        // that are right. It starts beyond the solution, where the curve is convex.
        if modes.drive == Drive::Current {
            let bound = at.current_a[k].0[0] / (at.gap_m.0[0] / (2.0 * lambda.0[0]) * at.saturation_wb.0[0]);
            let bound = at.saturation_wb.0[0] * libm::pow(bound.abs(), 1.0 / 7.0);
            flux = Jet::constant(flux.0[0].min(bound).max(-bound));
        }
        for _ in 0..MOST_ITERATIONS {
            let [i, by_flux] = current(flux);
            let (miss, slope) = match modes.drive {
                Drive::Current => (i - at.current_a[k], by_flux),
                Drive::Voltage => {
                    (flux + at.leakage_h * i - at.linkage_wb[k], Jet::constant(1.0) + at.leakage_h * by_flux)
                }
            };
            flux = flux - miss / slope;
        }
    }
    let force_n = flux * flux / (Jet::constant(4.0) * lambda);
    match modes.drive {
        Drive::Current => [force_n, at.current_a[k]],
        Drive::Voltage => [force_n, current(flux)[0]],
    }
}

/// Newton steps for saturated iron; those of [`coil`](super::coil) come to their end before.
const MOST_ITERATIONS: usize = 60;

/// The push of the backup bearing, touchdown.rs.
fn contact<const N: usize>(at: &Point<Jet<N>>) -> [Jet<N>; 2] {
    let [y, z] = at.position_m;
    let [v_y, v_z] = at.velocity_m_s;
    let r = (y * y + z * z).sqrt();
    let (out_y, out_z) = (y / r, z / r);
    let push = at.stiffness_n_m * (r - at.clearance_m) + at.damping_ns_m * (out_y * v_y + out_z * v_z);
    let around = out_y * v_z - out_z * v_y;
    let v = around + at.omega_rad_s * at.radius_m;
    let drag = at.friction * push * v / (v * v + Jet::constant(SLIDING_M_S * SLIDING_M_S)).sqrt();
    let sideways = drag + at.damping_ns_m * (r - at.clearance_m) / r * around;
    [-(push * out_y) + sideways * out_z, -(push * out_z) - sideways * out_y]
}

/// The values at a point and their derivatives in a direction, which has the units of the point.
pub fn along(modes: &Modes, point: &Point<f64>, direction: &Point<f64>) -> Response<Jet<2>> {
    response(modes, &point.with(direction, |value, slope| Jet([value, slope])))
}

/// The motion from a point on, and its outputs, as Taylor series in time. `slopes[j]` are the derivatives of order j + 1
/// of the inputs; with fewer of them than N − 1 the others are 0.
pub fn in_time<const N: usize>(
    modes: &Modes,
    point: &Point<f64>,
    slopes: &[PlantInput],
) -> (Point<Jet<N>>, Response<Jet<N>>) {
    let mut motion = point.with(point, |value, _| Jet::<N>::constant(value));
    let mut factorial = 1.0;
    for (j, slope) in (1..N).zip(slopes) {
        factorial *= j as f64;
        let series = motion.current_a.iter_mut().chain(&mut motion.voltage_v).chain(&mut motion.perturbation_n);
        let values = slope.current_a.iter().chain(&slope.voltage_v).chain(&slope.perturbation_n);
        for (series, slope) in series.zip(values) {
            series.0[j] = slope / factorial;
        }
        motion.omega_rad_s.0[j] = slope.omega_rad_s / factorial;
    }
    if N > 1 {
        motion.time_s.0[1] = 1.0;
    }
    // Each round makes one more coefficient of the states right: x_j+1 = ẋ_j / (j + 1).
    for j in 0..N.saturating_sub(1) {
        let rate = response(modes, &motion);
        let over = 1.0 / (j + 1) as f64;
        for a in 0..2 {
            motion.position_m[a].0[j + 1] = motion.velocity_m_s[a].0[j] * over;
            motion.velocity_m_s[a].0[j + 1] = rate.acceleration_m_s2[a].0[j] * over;
        }
        for k in 0..3 {
            motion.linkage_wb[k].0[j + 1] = rate.induced_v[k].0[j] * over;
        }
        motion.theta_rad.0[j + 1] = motion.omega_rad_s.0[j] * over;
    }
    (motion, response(modes, &motion))
}
