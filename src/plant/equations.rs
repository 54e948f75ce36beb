//! The equations of motion, generic over the scalar: parameters, inputs, right-hand side, outputs.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

use crate::bearing::coil::{Coil, CoilConfig, CoilPoint, Drive};
use crate::bearing::magnet::{Geometry, forces};
use crate::bearing::scalar::Scalar;
use crate::bearing::touchdown::TouchdownConfig;
use crate::plant::sensor::SensorConfig;

/// `[Y, Z, Ẏ, Ż, ψ_1, ψ_2, ψ_3]`, in m, m/s and Wb: the states of the equations of motion.
///
/// With current drive the fluxes follow the currents and are no states: they stay 0.
pub type Motion<T = f64> = [T; 7];

/// A harmonic perturbation force, per axis `amplitude sin(omega t + phase)`, t the absolute time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Harmonic<T = f64> {
    /// Amplitude, (y, z), in N.
    pub amplitude_n: [T; 2],
    /// Angular frequency, common to both axes, in rad/s.
    pub omega_rad_s: T,
    /// Phase at t = 0, (y, z), in rad.
    pub phase_rad: [T; 2],
}

impl Default for Harmonic {
    /// None, at 50 Hz.
    fn default() -> Self {
        Self { amplitude_n: [0.0; 2], omega_rad_s: 2.0 * PI * 50.0, phase_rad: [0.0; 2] }
    }
}

/// The bearing and the rotor's start.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlantConfig<T = f64> {
    /// Mass of the rotor `m`, in kg.
    pub m_kg: T,
    /// Nominal gap `s`, in m.
    pub gap_m: T,
    /// Angles `α_k` of the magnets as in P(3), in rad.
    pub alpha_rad: [T; 3],
    /// `λ_k` of P(4), in N·m²/A²; may be retuned.
    pub lambda_nm2_a2: [T; 3],
    /// Unbalance `U`, mass × eccentricity, in kg·m; may be retuned.
    pub unbalance_kgm: T,
    /// Angle `φ` of the unbalance on the rotor, from y towards z, in rad; may be retuned.
    pub unbalance_phase_rad: T,
    /// Harmonic perturbation; may be retuned.
    pub harmonic: Harmonic<T>,
    /// Acceleration of gravity, (y, z), in m/s².
    pub gravity_m_s2: [T; 2],
    /// The coils.
    pub coil: CoilConfig<T>,
    /// The backup bearing.
    pub touchdown: TouchdownConfig<T>,
    /// Position (Y, Z) at the start, in m.
    pub position_m: [T; 2],
    /// Velocity at the start, (y, z), in m/s.
    pub velocity_m_s: [T; 2],
    /// Angle of the rotor at the start, in rad.
    pub theta_rad: T,
    /// The sensors.
    pub sensor: SensorConfig,
    /// Longest sub-step of the integration, in s.
    pub max_step_s: f64,
}

impl Default for PlantConfig {
    /// The paper's bearing, the rotor on the paper's ellipse.
    fn default() -> Self {
        Self {
            m_kg: 6.7,
            gap_m: 5e-4,
            alpha_rad: [PI, -PI / 3.0, PI / 3.0],
            lambda_nm2_a2: [1.8e-6, 2.0e-6, 2.2e-6],
            unbalance_kgm: 0.0,
            unbalance_phase_rad: 0.0,
            harmonic: Harmonic::default(),
            gravity_m_s2: [0.0; 2],
            coil: CoilConfig::default(),
            touchdown: TouchdownConfig::default(),
            position_m: [30e-6, 0.0],
            velocity_m_s: [0.0, 0.021991148575128554],
            theta_rad: 0.0,
            sensor: SensorConfig::default(),
            max_step_s: 5e-5,
        }
    }
}

/// What acts on the plant.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PlantInput<T = f64> {
    /// Currents of the magnets, in A; the sign has no effect on the force. Of no effect with voltage drive.
    pub current_a: [T; 3],
    /// Voltages asked of the amplifiers, in V. Of no effect with current drive.
    pub voltage_v: [T; 3],
    /// Perturbation force on the rotor, (y, z), in N.
    pub perturbation_n: [T; 2],
    /// Angular velocity of the rotor, from y towards z, in rad/s.
    pub omega_rad_s: T,
}

/// What the equations of motion depend on beside state and input.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Conditions<T = f64> {
    /// Absolute time, in s.
    pub time_s: T,
    /// Angle of the rotor, in rad.
    pub theta_rad: T,
    /// Whether rotor and backup bearing push each other.
    pub contact: bool,
    /// Coils whose circuit is open.
    pub open: [bool; 3],
}

/// The outputs of the plant at an instant.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PlantOutput<T = f64> {
    /// Gap of each magnet, in m.
    pub gap_m: [T; 3],
    /// Current of each coil, in A.
    pub current_a: [T; 3],
    /// Flux linkage of each coil, in Wb.
    pub linkage_wb: [T; 3],
    /// Energy of the field of each coil, in J.
    pub energy_j: [T; 3],
    /// Force of each magnet, in N, P(4).
    pub force_n: [T; 3],
    /// Resultant of the magnets, (F_y, F_z), in N, P(3).
    pub resultant_n: [T; 2],
    /// All forces but those of magnets and backup bearing, (y, z), in N.
    pub perturbation_n: [T; 2],
    /// Derivative of the flux linkage of each coil, `u − R i` with voltage drive, in V; 0 without, where it is no state.
    pub induced_v: [T; 3],
    /// Push of the backup bearing, (y, z), in N.
    pub contact_n: [T; 2],
    /// Acceleration of the rotor, (y, z), in m/s².
    pub acceleration_m_s2: [T; 2],
}

impl<T> PlantOutput<T> {
    /// The outputs with every number replaced by what `f` makes of it.
    pub fn map<U>(self, f: impl Fn(T) -> U) -> PlantOutput<U> {
        PlantOutput {
            gap_m: self.gap_m.map(&f),
            current_a: self.current_a.map(&f),
            linkage_wb: self.linkage_wb.map(&f),
            energy_j: self.energy_j.map(&f),
            force_n: self.force_n.map(&f),
            resultant_n: self.resultant_n.map(&f),
            perturbation_n: self.perturbation_n.map(&f),
            induced_v: self.induced_v.map(&f),
            contact_n: self.contact_n.map(&f),
            acceleration_m_s2: self.acceleration_m_s2.map(&f),
        }
    }
}

/// The plant's equations with one set of parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Equations<T = f64> {
    /// The parameters.
    pub(super) config: PlantConfig<T>,
    geometry: Geometry<T>,
}

impl<T: Scalar> Equations<T> {
    /// The equations with parameters that are in order, see [`Plant::new`](super::Plant::new).
    pub fn new(config: PlantConfig<T>) -> Self {
        let geometry = Geometry::new(config.gap_m, config.alpha_rad);
        Self { config, geometry }
    }

    /// Gaps of the magnets with the rotor at a position, in m.
    #[inline]
    pub fn gaps(&self, position_m: [T; 2]) -> [T; 3] {
        self.geometry.gaps(position_m)
    }

    /// The coil of magnet k, counted from 0.
    #[inline]
    pub fn coil(&self, k: usize) -> Coil<T> {
        self.config.coil.of(self.config.lambda_nm2_a2[k], self.config.gap_m)
    }

    /// Whether the forces are those of P(4) with the currents of the input.
    #[inline]
    pub(super) fn is_plain(&self) -> bool {
        self.config.coil.drive == Drive::Current && self.config.coil.saturation_wb.value() == 0.0
    }

    /// The coils at the given gaps, in m; `linkage_wb` counts with voltage drive, the currents of the input without.
    pub(super) fn coils(
        &self,
        open: [bool; 3],
        linkage_wb: [T; 3],
        input: &PlantInput<T>,
        gap_m: [T; 3],
    ) -> [CoilPoint<T>; 3] {
        if self.is_plain() {
            // P(4) as it stands, in the order of operations that gives the fewest roundings.
            let current_a = flowing(open, input.current_a);
            let force_n = forces(self.config.lambda_nm2_a2, current_a, gap_m);
            return std::array::from_fn(|k| {
                let inductance_h = self.coil(k).inductance_h(gap_m[k]);
                CoilPoint {
                    linkage_wb: inductance_h * current_a[k],
                    current_a: current_a[k],
                    force_n: force_n[k],
                    energy_j: inductance_h * 0.5 * current_a[k] * current_a[k],
                    current_by_linkage: T::constant(0.0),
                }
            });
        }
        std::array::from_fn(|k| match self.config.coil.drive {
            _ if open[k] => CoilPoint::idle(),
            Drive::Current => self.coil(k).at_current(input.current_a[k], gap_m[k]),
            Drive::Voltage => self.coil(k).at_linkage(linkage_wb[k], gap_m[k]),
        })
    }

    /// The forces of the magnets alone, in N, as in [`Equations::coils`].
    pub(super) fn forces(&self, open: [bool; 3], linkage_wb: [T; 3], input: &PlantInput<T>, gap_m: [T; 3]) -> [T; 3] {
        if self.is_plain() {
            return forces(self.config.lambda_nm2_a2, flowing(open, input.current_a), gap_m);
        }
        self.coils(open, linkage_wb, input, gap_m).map(|coil| coil.force_n)
    }

    /// `dψ_k/dt = u_k − R i_k` with voltage drive, u_k within the limit of the amplifier; 0 without, or if the circuit is
    /// open; in V.
    fn induced_v(&self, open: [bool; 3], coils: &[CoilPoint<T>; 3], input: &PlantInput<T>) -> [T; 3] {
        let coil = &self.config.coil;
        std::array::from_fn(|k| {
            if coil.drive == Drive::Current || open[k] {
                return T::constant(0.0);
            }
            coil.limited(input.voltage_v[k]) - coil.resistance_ohm * coils[k].current_a
        })
    }

    /// All forces but those of magnets and backup bearing, (y, z), in N.
    pub(super) fn perturbation(&self, input: &PlantInput<T>, time_s: T, theta_rad: T) -> [T; 2] {
        let Harmonic { amplitude_n, omega_rad_s, phase_rad } = &self.config.harmonic;
        let mut p = input.perturbation_n;
        for a in 0..2 {
            // Without amplitude nothing is added, so that the common case costs no sine.
            if !amplitude_n[a].is_zero() {
                p[a] = p[a] + amplitude_n[a] * (*omega_rad_s * time_s + phase_rad[a]).sine();
            }
        }
        for (p_a, gravity) in p.iter_mut().zip(self.config.gravity_m_s2) {
            if !gravity.is_zero() {
                *p_a = *p_a + self.config.m_kg * gravity;
            }
        }
        if !self.config.unbalance_kgm.is_zero() {
            let force = self.config.unbalance_kgm * input.omega_rad_s * input.omega_rad_s;
            let (sin, cos) = (theta_rad + self.config.unbalance_phase_rad).sine_cosine();
            p = [p[0] + force * cos, p[1] + force * sin];
        }
        p
    }

    /// Push of the backup bearing, (y, z), in N; 0 without contact.
    fn contact_n(&self, x: &Motion<T>, input: &PlantInput<T>, contact: bool) -> [T; 2] {
        match contact {
            true => self.config.touchdown.force_n([x[0], x[1]], [x[2], x[3]], input.omega_rad_s),
            false => [T::constant(0.0); 2],
        }
    }

    /// `(F + p + c)/m`, (y, z), in m/s².
    #[inline]
    fn acceleration(&self, resultant_n: [T; 2], perturbation_n: [T; 2], contact_n: [T; 2]) -> [T; 2] {
        std::array::from_fn(|a| {
            let force_n = resultant_n[a] + perturbation_n[a];
            // Without contact the sum keeps its bits, the sign of a zero included.
            let force_n = if contact_n[a].is_zero() { force_n } else { force_n + contact_n[a] };
            force_n / self.config.m_kg
        })
    }

    /// The right-hand side of the equations of motion, d/dt of [`Motion`]: a function of state, input and conditions.
    ///
    /// Not a number outside the gap, where P(4) has no meaning. With current drive the fluxes have no derivative: 0.
    pub fn derivative(&self, x: &Motion<T>, input: &PlantInput<T>, conditions: Conditions<T>) -> Motion<T> {
        let perturbation_n = self.perturbation(input, conditions.time_s, conditions.theta_rad);
        self.derivative_under(x, input, conditions, perturbation_n)
    }

    /// [`Equations::derivative`] with the perturbation known, in N.
    pub(super) fn derivative_under(
        &self,
        x: &Motion<T>,
        input: &PlantInput<T>,
        conditions: Conditions<T>,
        perturbation_n: [T; 2],
    ) -> Motion<T> {
        let gap_m = self.gaps([x[0], x[1]]);
        if !gap_m.iter().all(|gap| gap.value() > 0.0) {
            return [T::constant(f64::NAN); 7];
        }
        let linkage_wb = [x[4], x[5], x[6]];
        let (force_n, induced_v) = if self.is_plain() {
            (self.forces(conditions.open, linkage_wb, input, gap_m), [T::constant(0.0); 3])
        } else {
            let coils = self.coils(conditions.open, linkage_wb, input, gap_m);
            (coils.map(|coil| coil.force_n), self.induced_v(conditions.open, &coils, input))
        };
        let contact_n = self.contact_n(x, input, conditions.contact);
        let [a_y, a_z] = self.acceleration(self.geometry.resultant(force_n), perturbation_n, contact_n);
        let [u_1, u_2, u_3] = induced_v;
        [x[2], x[3], a_y, a_z, u_1, u_2, u_3]
    }

    /// All outputs, for state, input and conditions of one instant.
    pub fn outputs(&self, x: &Motion<T>, input: &PlantInput<T>, conditions: Conditions<T>) -> PlantOutput<T> {
        let gap_m = self.gaps([x[0], x[1]]);
        let coils = self.coils(conditions.open, [x[4], x[5], x[6]], input, gap_m);
        let force_n = coils.map(|coil| coil.force_n);
        let resultant_n = self.geometry.resultant(force_n);
        let perturbation_n = self.perturbation(input, conditions.time_s, conditions.theta_rad);
        let contact_n = self.contact_n(x, input, conditions.contact);
        PlantOutput {
            gap_m,
            current_a: coils.map(|coil| coil.current_a),
            linkage_wb: coils.map(|coil| coil.linkage_wb),
            energy_j: coils.map(|coil| coil.energy_j),
            induced_v: self.induced_v(conditions.open, &coils, input),
            force_n,
            resultant_n,
            perturbation_n,
            contact_n,
            acceleration_m_s2: self.acceleration(resultant_n, perturbation_n, contact_n),
        }
    }
}

/// The currents, 0 where the circuit is open, in A.
#[inline]
pub(super) fn flowing<T: Scalar>(open: [bool; 3], current_a: [T; 3]) -> [T; 3] {
    std::array::from_fn(|k| if open[k] { T::constant(0.0) } else { current_a[k] })
}
