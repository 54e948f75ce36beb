//! The backup bearing: a ring of given clearance that the rotor touches when levitation is lost.
//!
//! With r the distance of the rotor from the centre and `δ = r − clearance`, the ring pushes inwards with
//!
//! ```text
//! N = k δ + d δ̇            while δ > 0 and N > 0, else 0
//! ```
//!
//! so that it never pulls, and drags with the friction `−μ N v/√(v² + v_0²)`, v the velocity of the rotor's surface against
//! the ring, `v_t + ω · radius`, and `v_0` [`SLIDING_M_S`]. The speed of the rotor is an input: friction does not brake it.
//!
//! The ring is a body without mass on a soft mount. A rotor that whirls in contact moves it along, by δ around the centre with
//! `v_t/r`, and the mount's damper holds against that with `−d δ v_t/r`. So a backward whirl, which friction drives, ends where
//! `μ k = d Ω` and does not grow for ever; far above the ring's natural frequency it is still what destroys bearings.

use serde::{Deserialize, Serialize};

use crate::bearing::scalar::Scalar;
use crate::invalid::Checks;

/// Velocity, in m/s, above which friction slides; below, it rises linearly, so that rest is a state like others.
pub const SLIDING_M_S: f64 = 0.01;

/// The ring.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TouchdownConfig<T = f64> {
    /// Distance that the rotor may go from the centre before it touches, in m. With one above the nominal gap the rotor
    /// may reach a magnet first, which is a fault.
    pub clearance_m: T,
    /// Stiffness k, in N/m.
    pub stiffness_n_m: T,
    /// Damping d, in N·s/m.
    pub damping_ns_m: T,
    /// Coefficient of friction μ.
    pub friction: T,
    /// Radius of the rotor where it touches, in m; only friction asks for it.
    pub radius_m: T,
}

impl Default for TouchdownConfig {
    /// Half the paper's gap; a ring that a rotor of 6.7 kg meets with a natural frequency of 435 Hz and 14 % of the critical
    /// damping; no friction.
    fn default() -> Self {
        Self { clearance_m: 2.5e-4, stiffness_n_m: 5e7, damping_ns_m: 5e3, friction: 0.0, radius_m: 0.025 }
    }
}

impl TouchdownConfig {
    /// Reports what is wrong, by the names of the interface.
    pub(crate) fn check(&self, checks: &mut Checks) {
        checks.positive("touchdown.clearance", self.clearance_m, "m");
        checks.positive("touchdown.stiffness", self.stiffness_n_m, "N/m");
        checks.not_negative("touchdown.damping", self.damping_ns_m, "N.s/m");
        checks.not_negative("touchdown.friction", self.friction, "");
        checks.positive("touchdown.radius", self.radius_m, "m");
    }

    /// Whether ring and rotor push each other, for a position in m and a velocity in m/s, (y, z).
    pub fn touches(&self, position_m: [f64; 2], velocity_m_s: [f64; 2]) -> bool {
        // Far inside, the common case, no root is needed.
        let [y, z] = position_m;
        y * y + z * z > self.clearance_m * self.clearance_m && self.push_n(position_m, velocity_m_s) > 0.0
    }

    /// The fastest rate of the contact, in 1/s, of a rotor of the given mass in kg that is pushed with `push_n` in N.
    pub fn rate(&self, m_kg: f64, push_n: f64) -> f64 {
        let spring = (self.stiffness_n_m / m_kg).sqrt();
        let damper = self.damping_ns_m / m_kg;
        spring.max(damper).max(self.friction * push_n.max(0.0) / (m_kg * SLIDING_M_S))
    }
}

impl<T: Scalar> TouchdownConfig<T> {
    /// The push N, in N, if the rotor touches; of no meaning unless [`touches`](TouchdownConfig::touches).
    pub fn push_n(&self, position_m: [T; 2], velocity_m_s: [T; 2]) -> T {
        let ([y, z], [v_y, v_z]) = (position_m, velocity_m_s);
        let r = y.norm(z);
        let approach = if r.value() > 0.0 { (y * v_y + z * v_z) / r } else { v_y.norm(v_z) };
        self.stiffness_n_m * (r - self.clearance_m) + self.damping_ns_m * approach
    }

    /// Force of the ring on a rotor that touches it, (y, z), in N, the rotor turning at `omega_rad_s`.
    ///
    /// The formula is continued smoothly to where they do not touch, which the integrator needs to locate the instant at
    /// which they part.
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
        std::array::from_fn(|a| -push * out[a] - (drag + mount) * along[a])
    }
}
