//! The backup bearing: a ring that catches the rotor when levitation is lost.
//!
//! With the distance r of the rotor from the centre and `δ = r − clearance`, the ring pushes inwards with
//!
//! ```text
//! N = k δ + d δ̇            while δ > 0 and N > 0, else 0
//! ```
//!
//! so that it never pulls. Friction is `−μ N v/√(v² + v_0²)`, with the sliding velocity `v = v_t + ω · radius` of the rotor's
//! surface on the ring and `v_0` = [`SLIDING_M_S`]. The speed of the rotor is an input: friction does not slow it down.
//!
//! The ring is massless and softly mounted. A rotor that whirls in contact carries the ring around the centre, at the distance δ
//! and the rate `v_t/r`, and the damper of the mount opposes that with `−d δ v_t/r`. So a backward whirl, driven by friction,
//! settles where `μ k = d Ω` instead of growing without bound; far above the ring's natural frequency it still destroys bearings.

use serde::{Deserialize, Serialize};

use crate::bearing::{Scalar, array};
use crate::machine::Bearing;
use crate::variables::Variables;
use crate::variables::unit::{METRE, NEWTON_PER_METRE, NEWTON_SECOND_PER_METRE, ONE};

/// Sliding velocity, in m/s, below which friction rises linearly, so that standstill needs no special case.
pub const SLIDING_M_S: f64 = 0.01;

/// The ring. By default its clearance is half the paper's gap, and there is no friction; a rotor of 6.7 kg has a natural frequency of
/// 435 Hz and 14 % of critical damping.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(T = f64, context = Bearing, default)]
pub struct TouchdownConfig<T = f64> {
    /// Distance from the centre at which the rotor touches the backup bearing{at bearing}
    ///
    /// If it exceeds the nominal gap, the rotor may reach a magnet first, which ends the run.
    #[parameter(
        name = "touchdown.clearance", unit = METRE, above = 0.0, nominal = 1e-4, display_unit = "mm", value = 2.5e-4
    )]
    pub clearance_m: T,
    /// Stiffness of the backup bearing{at bearing}
    #[parameter(name = "touchdown.stiffness", unit = NEWTON_PER_METRE, above = 0.0, nominal = 1e7, value = 5e7)]
    pub stiffness_n_m: T,
    /// Damping of the backup bearing{at bearing}
    #[parameter(name = "touchdown.damping", unit = NEWTON_SECOND_PER_METRE, min = 0.0, nominal = 1e3, value = 5e3)]
    pub damping_ns_m: T,
    /// Coefficient of friction of the backup bearing{at bearing}
    #[parameter(name = "touchdown.friction", count = context.if_radial(), unit = ONE, min = 0.0, nominal = 0.1)]
    pub friction: T,
    /// Radius of the rotor at the backup bearing{at bearing}, used by friction
    #[parameter(
        name = "touchdown.radius", count = context.if_radial(), unit = METRE, above = 0.0, nominal = 1e-2,
        display_unit = "mm", value = 0.025
    )]
    pub radius_m: T,
}

impl TouchdownConfig {
    /// Whether rotor and ring are in contact, at a position in m and a velocity in m/s, (y, z).
    pub fn touches(&self, position_m: [f64; 2], velocity_m_s: [f64; 2]) -> bool {
        // Within the clearance, the common case, no root is needed.
        let [y, z] = position_m;
        y * y + z * z > self.clearance_m * self.clearance_m && self.push_n(position_m, velocity_m_s) > 0.0
    }

    /// The fastest rate of the contact, in 1/s, for the rotor mass `m_kg` in kg and the contact force `push_n` in N.
    pub fn rate(&self, m_kg: f64, push_n: f64) -> f64 {
        let spring = (self.stiffness_n_m / m_kg).sqrt();
        let damper = self.damping_ns_m / m_kg;
        spring.max(damper).max(self.friction * push_n.max(0.0) / (m_kg * SLIDING_M_S))
    }
}

impl<T: Scalar> TouchdownConfig<T> {
    /// The normal force N, in N; meaningless unless [`touches`](TouchdownConfig::touches).
    pub fn push_n(&self, position_m: [T; 2], velocity_m_s: [T; 2]) -> T {
        let ([y, z], [v_y, v_z]) = (position_m, velocity_m_s);
        let r = y.norm(z);
        let approach = if r.value() > 0.0 { (y * v_y + z * v_z) / r } else { v_y.norm(v_z) };
        self.stiffness_n_m * (r - self.clearance_m) + self.damping_ns_m * approach
    }

    /// Force of the ring on a rotor in contact, (y, z), in N, at the speed `omega_rad_s`.
    ///
    /// The formula continues smoothly beyond contact, so that the integrator can locate the instant of separation.
    pub fn force_n(&self, position_m: [T; 2], velocity_m_s: [T; 2], omega_rad_s: T) -> [T; 2] {
        let [y, z] = position_m;
        let r = y.norm(z);
        if r.value() == 0.0 {
            return [T::constant(0.0); 2];
        }
        let push = self.push_n(position_m, velocity_m_s);
        let out = [y / r, z / r];
        let along = [-out[1], out[0]];
        let around = velocity_m_s[0] * along[0] + velocity_m_s[1] * along[1];
        let mut drag = T::constant(0.0);
        if !self.friction.is_zero() {
            let v = around + omega_rad_s * self.radius_m;
            drag = self.friction * push * v / v.norm(T::constant(SLIDING_M_S));
        }
        let mount = self.damping_ns_m * (r - self.clearance_m) / r * around;
        array::from_fn(|a| -push * out[a] - (drag + mount) * along[a])
    }
}
