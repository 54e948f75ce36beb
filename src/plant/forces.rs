//! Forces on the rotor besides those of its magnets: loads, gravity, unbalance, backup bearings; and the fastest rate of the motion.

use serde::{Deserialize, Serialize};

use super::PlantState;
use super::config::{Harmonic, PlantConfigOf};
use super::equations::{Equations, Instant, Motion, PlantInput};
use crate::bearing::{Rotor, Scalar, Shaft, array, joined, shaft};
use crate::machine::{Bearing, Machine};
use crate::variables::Variables;
use crate::variables::unit::{METRE, NEWTON};

impl<T: Scalar, const N: usize, const K: usize, const B: usize> PlantConfigOf<T, N, K, B> {
    const MACHINE: &'static Machine = Rotor::<N, K, B>::MACHINE;

    /// All forces except those of magnets and backup bearings, at a time in s and an angle in rad.
    pub fn perturbation(&self, input: &PlantInput<T, N, K>, time_s: T, theta_rad: T) -> [T; N] {
        let mut p = input.perturbation_n;
        if !Self::MACHINE.tilts() {
            let Harmonic { amplitude_n, omega_rad_s, phase_rad } = &self.harmonic;
            for ((p_a, amplitude), phase) in p.iter_mut().zip(amplitude_n).zip(phase_rad) {
                // Skipped at amplitude 0, so that the common case needs no sine.
                if !amplitude.is_zero() {
                    *p_a = *p_a + *amplitude * (*omega_rad_s * time_s + *phase).sine_cosine().0;
                }
            }
        }
        let lengths = if Self::MACHINE.tilts() { N - 2 } else { N };
        for (p_a, gravity) in p.iter_mut().zip(self.gravity_m_s2).take(lengths) {
            if !gravity.is_zero() {
                *p_a = *p_a + self.rotor.shaft.m_kg * gravity;
            }
        }
        for j in 0..Self::MACHINE.planes {
            // Skipped if the plane is balanced, for the same reason.
            if self.unbalance_kgm[j].is_zero() {
                continue;
            }
            let force = self.unbalance_kgm[j] * input.omega_rad_s * input.omega_rad_s;
            let (sin, cos) = (theta_rad + self.unbalance_phase_rad[j]).sine_cosine();
            let turning: [T; N] = shaft::generalised(self.unbalance_position_m[j], [force * cos, force * sin]);
            p = array::from_fn(|a| p[a] + turning[a]);
        }
        p
    }

    /// Displacement of the rotor at the magnets of bearing b, for coordinates or their rates: (y, z), or (x, 0) in an axial one.
    #[inline]
    fn at_magnets(&self, b: usize, q: [T; N]) -> [T; 2] {
        match Self::MACHINE.bearings[b].is_radial {
            true => shaft::displacement(self.rotor.bearings[b].position_m, q),
            false => [q[0], T::constant(0.0)],
        }
    }

    /// Force of the backup bearing at bearing b, in N, along the same axes.
    fn touchdown_n(&self, b: usize, at: &Instant<'_, T, N, K, B>) -> [T; 2] {
        if !at.conditions.contact[b] {
            return [T::constant(0.0); 2];
        }
        let Motion { position_m, velocity_m_s, .. } = *at.motion;
        let [position_m, velocity_m_s] = array::map([position_m, velocity_m_s], |q| self.at_magnets(b, q));
        self.touchdown[b].force_n(position_m, velocity_m_s, at.input.omega_rad_s)
    }

    /// Generalised force of the backup bearings in contact.
    pub(super) fn contact_n(&self, at: &Instant<'_, T, N, K, B>) -> [T; N] {
        let mut sum = [T::constant(0.0); N];
        for b in (0..B).filter(|b| at.conditions.contact[*b]) {
            let [y, z] = self.touchdown_n(b, at);
            let part: [T; N] = match Self::MACHINE.bearings[b].is_radial {
                true => shaft::generalised(self.rotor.bearings[b].position_m, [y, z]),
                false => shaft::along(y),
            };
            sum = array::from_fn(|a| sum[a] + part[a]);
        }
        sum
    }
}

impl<const N: usize, const K: usize, const B: usize> PlantConfigOf<f64, N, K, B> {
    /// Whether the rotor touches each backup bearing.
    #[inline]
    pub(super) fn touches(&self, position_m: &[f64; N], velocity_m_s: &[f64; N]) -> [bool; B] {
        let touches = |b: usize| {
            let [at, speed] = array::map([position_m, velocity_m_s], |q| self.at_magnets(b, *q));
            self.touchdown[b].touches(at, speed)
        };
        array::from_fn(touches)
    }

    /// The fastest rate of motion and contact, in 1/s, for magnet forces in N and gaps in m.
    #[inline]
    pub(super) fn rate(&self, state: &PlantState<N, K, B>, force_n: [f64; K], gap_m: [f64; K]) -> f64 {
        let Shaft { m_kg, transverse_kgm2, .. } = self.rotor.shaft;
        // The trace of M⁻¹ K, an upper bound of its largest eigenvalue.
        let mut field: f64 = 0.0;
        let mut rate: f64 = 0.0;
        for (b, touched) in state.contact.into_iter().enumerate() {
            // Acceleration of the shaft at ξ per force at ξ: 1/m at the centre of gravity, more elsewhere.
            let at_m = self.rotor.bearings[b].position_m;
            let mobility = match Self::MACHINE.tilts() && Self::MACHINE.bearings[b].is_radial {
                true => 1.0 / m_kg + at_m * at_m / transverse_kgm2,
                false => 1.0 / m_kg,
            };
            let mut least_m = f64::INFINITY;
            for k in Self::MACHINE.magnets_of(b) {
                field += 2.0 * force_n[k] / gap_m[k] * mobility;
                least_m = least_m.min(gap_m[k]);
            }
            let moving = self.at_magnets(b, state.motion.velocity_m_s);
            rate = rate.max((moving[0] * moving[0] + moving[1] * moving[1]).sqrt() / least_m);
            if touched {
                let push_n = self.touchdown[b].push_n(self.at_magnets(b, state.motion.position_m), moving);
                rate = rate.max(self.touchdown[b].rate(1.0 / mobility, push_n));
            }
        }
        rate.max(field.sqrt())
    }
}

/// Outputs at one of several bearings; in an axial bearing y stands for x.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
#[variables(T = f64, context = Bearing)]
pub struct AtBearing<T = f64> {
    /// Position of the shaft along y at the magnets of bearing {prefix}
    #[output(name = "Y", count = context.if_radial(), unit = METRE, nominal = 1e-5)]
    pub y_m: T,
    /// Force of the magnets of bearing {prefix} along {first axis}
    #[output(name = format!("F{}", context.first_axis().to_uppercase()), unit = NEWTON, nominal = 10.0)]
    pub y_n: T,
    /// Force of the backup bearing at {prefix} on the rotor along {first axis}
    #[output(name = format!("touchdown.F{}", context.first_axis().to_uppercase()), unit = NEWTON, nominal = 1000.0)]
    pub touchdown_y_n: T,
    /// Position of the shaft along z at the magnets of bearing {prefix}
    #[output(name = "Z", count = context.if_radial(), unit = METRE, nominal = 1e-5)]
    pub z_m: T,
    /// Force of the magnets of bearing {prefix} along z
    #[output(name = "FZ", count = context.if_radial(), unit = NEWTON, nominal = 10.0)]
    pub z_n: T,
    /// Force of the backup bearing at {prefix} on the rotor along z
    #[output(name = "touchdown.FZ", count = context.if_radial(), unit = NEWTON, nominal = 1000.0)]
    pub touchdown_z_n: T,
}

impl<T: Copy> AtBearing<T> {
    /// Applies `f` to every number.
    pub fn map<U>(self, f: impl Fn(T) -> U) -> AtBearing<U> {
        joined!(self, self, |value, _| f(value), AtBearing { y_m, z_m, y_n, z_n, touchdown_y_n, touchdown_z_n;; })
    }
}

impl<T: Scalar, const N: usize, const K: usize, const B: usize> Equations<T, N, K, B> {
    /// The outputs at the bearings, for magnet forces in N.
    pub fn at_bearings(&self, at: &Instant<'_, T, N, K, B>, force_n: [T; K]) -> [AtBearing<T>; B] {
        let machine = Rotor::<N, K, B>::MACHINE;
        array::from_fn(|b| {
            let first = if machine.bearings[b].is_radial { usize::from(shaft::has_x::<N>()) } else { 0 };
            // The direction of a radial magnet in the plane is the (y, z) part of its d.
            let along = |a: usize| {
                let direction = |k: usize| self.geometry().directions[k][(first + a).min(N - 1)];
                machine.magnets_of(b).fold(T::constant(0.0), |sum, k| sum + force_n[k] * direction(k))
            };
            let [y_m, z_m] = self.config.at_magnets(b, at.motion.position_m);
            let [touchdown_y_n, touchdown_z_n] = self.config.touchdown_n(b, at);
            AtBearing { y_m, z_m, y_n: along(0), z_n: along(1), touchdown_y_n, touchdown_z_n }
        })
    }
}
