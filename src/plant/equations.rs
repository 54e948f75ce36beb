//! The equations of motion, generic over the rotor: inputs, right-hand side, outputs.

use serde::{Deserialize, Serialize};

use super::config::PlantConfigOf;
use crate::bearing::coil::{Coil, CoilPoint, Drive};
use crate::bearing::magnet::{Geometry, forces};
use crate::bearing::{Scalar, array, joined};
use crate::machine::Machine;
use crate::variables::unit::{
    AMPERE, METRE, METRE_PER_SECOND2, NEWTON, NEWTON_METRE, RADIAN_PER_SECOND, RADIAN_PER_SECOND2, VOLT, WEBER,
};
use crate::variables::{OMEGA_RAD_S, Saved, Variables};

/// State of the equations of motion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "[T; N]: Saved, [T; K]: Saved")]
pub struct Motion<T = f64, const N: usize = 2, const K: usize = 3> {
    /// Coordinates, in m, angles in rad.
    pub position_m: [T; N],
    /// Their rates, in m/s, angular rates in rad/s.
    pub velocity_m_s: [T; N],
    /// Flux linkages of the coils, in Wb. With current drive they are no states, since they follow from the currents, and stay 0.
    pub linkage_wb: [T; K],
}

impl<T: Copy, const N: usize, const K: usize> Motion<T, N, K> {
    /// Applies `f` to each state of two motions.
    #[inline]
    pub fn with<U: Copy, V: Copy>(&self, other: &Motion<U, N, K>, f: impl Fn(T, U) -> V) -> Motion<V, N, K> {
        joined!(self, other, f, Motion {; position_m, velocity_m_s, linkage_wb; })
    }
}

/// Inputs of the plant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(T = f64, context = Machine, default)]
#[serde(bound = "T: Saved, [T; N]: Saved, [T; K]: Saved")]
pub struct PlantInput<T = f64, const N: usize = 2, const K: usize = 3> {
    /// Current through {magnet}, held over the step, with drive = current
    ///
    /// Its sign has no effect on the force.
    #[input(names = context.of_magnets("i"), unit = AMPERE)]
    pub current_a: [T; K],
    /// Voltage command of the amplifier of {magnet}, with drive = voltage
    #[input(names = context.of_magnets("u"), unit = VOLT, nominal = 10.0)]
    pub voltage_v: [T; K],
    /// Perturbation {force} on the rotor {direction}, at the centre of gravity
    #[input(
        names = context.of_coordinates(|coordinate| coordinate.load),
        unit = context.either(index, NEWTON, NEWTON_METRE)
    )]
    pub perturbation_n: [T; N],
    /// Speed of the rotor, from y towards z
    #[input(name = "omega", unit = RADIAN_PER_SECOND, start = OMEGA_RAD_S, nominal = 100.0)]
    pub omega_rad_s: T,
}

impl<T: Copy, const N: usize, const K: usize> PlantInput<T, N, K> {
    /// Applies `f` to each of two sets of inputs.
    pub fn with<U: Copy, V: Copy>(&self, other: &PlantInput<U, N, K>, f: impl Fn(T, U) -> V) -> PlantInput<V, N, K> {
        joined!(self, other, f, PlantInput { omega_rad_s; current_a, voltage_v, perturbation_n; })
    }
}

/// Parameters of the equations of motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conditions<T = f64, const K: usize = 3, const B: usize = 1> {
    /// Absolute time, in s.
    pub time_s: T,
    /// Angle of the rotor, in rad.
    pub theta_rad: T,
    /// Whether the rotor touches the backup bearing at each bearing.
    pub contact: [bool; B],
    /// Coils with an open circuit.
    pub open: [bool; K],
}

impl<T: Scalar, const K: usize, const B: usize> Default for Conditions<T, K, B> {
    /// At time 0 and angle 0, without contact, all circuits closed.
    fn default() -> Self {
        let zero = T::constant(0.0);
        Self { time_s: zero, theta_rad: zero, contact: [false; B], open: [false; K] }
    }
}

/// State, inputs and conditions at an instant.
#[derive(Clone, Copy, Debug)]
pub struct Instant<'a, T = f64, const N: usize = 2, const K: usize = 3, const B: usize = 1> {
    /// State.
    pub motion: &'a Motion<T, N, K>,
    /// Inputs.
    pub input: &'a PlantInput<T, N, K>,
    /// Time, angle of the rotor, and discrete conditions.
    pub conditions: Conditions<T, K, B>,
}

/// The outputs of the plant at an instant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(T = f64, context = Machine, default)]
#[serde(bound = "[T; N]: Saved, [T; K]: Saved")]
pub struct PlantOutput<T = f64, const N: usize = 2, const K: usize = 3> {
    /// Force of {magnet} on the rotor
    #[output(names = context.of_magnets("F"), unit = NEWTON, nominal = 10.0)]
    pub force_n: [T; K],
    /// Force of all magnets on the rotor along {axis}
    ///
    /// Per coordinate, P(3); moments in N·m.
    #[output(names = context.of_resultant("F"), unit = NEWTON, nominal = 10.0)]
    pub resultant_n: [T; N],
    /// Air gap at {magnet}
    #[output(names = context.of_magnets("gap"), unit = METRE, nominal = 1e-4, display_unit = "mm")]
    pub gap_m: [T; K],
    /// All {force}s on the rotor {direction} except those of magnets and backup bearings
    #[output(
        names = context.of_coordinates(|coordinate| coordinate.perturbation),
        unit = context.either(index, NEWTON, NEWTON_METRE),
        nominal = context.either(index, 10.0, 1.0)
    )]
    pub perturbation_n: [T; N],
    /// Force of the backup bearing on the rotor along {axis}
    ///
    /// Per coordinate; moments in N·m.
    #[output(names = context.of_resultant("touchdown.F"), unit = NEWTON, nominal = 1000.0)]
    pub contact_n: [T; N],
    /// Flux linked with the coil of {magnet}; a state with drive = voltage
    #[local(names = context.of_magnets("psi"), unit = WEBER, state, nominal = 1e-2)]
    pub linkage_wb: [T; K],
    /// Current through the coil of {magnet}
    #[local(names = context.of_magnets("coil.i"), unit = AMPERE)]
    pub current_a: [T; K],
    /// Derivative of the flux of {magnet}, u - R i with drive = voltage; 0 with drive = current, where it is no state
    #[local(
        names = context.of_magnets("coil.uInduced"), unit = VOLT, nominal = 10.0,
        derivative_of = context.of_magnets("psi")[index].clone()
    )]
    pub induced_v: [T; K],
    /// Second derivative of {coordinate}
    #[local(
        names = context.of_coordinates(|coordinate| coordinate.acceleration),
        unit = context.either(index, METRE_PER_SECOND2, RADIAN_PER_SECOND2),
        derivative_of = context.coordinates[index].rate
    )]
    pub acceleration_m_s2: [T; N],
}

impl<T: Copy, const N: usize, const K: usize> PlantOutput<T, N, K> {
    /// Applies `f` to every number.
    pub fn map<U: Copy>(&self, f: impl Fn(T) -> U) -> PlantOutput<U, N, K> {
        joined!(self, self, |value, _| f(value), PlantOutput {
            ; gap_m, current_a, linkage_wb, force_n, resultant_n, perturbation_n, induced_v, contact_n, acceleration_m_s2;
        })
    }
}

/// The plant's equations for one set of parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Equations<T = f64, const N: usize = 2, const K: usize = 3, const B: usize = 1> {
    /// The parameters.
    pub(super) config: PlantConfigOf<T, N, K, B>,
    geometry: Geometry<T, N, K>,
}

impl<T: Scalar, const N: usize, const K: usize, const B: usize> Equations<T, N, K, B> {
    /// The equations for validated parameters, see [`Plant::new`](super::Plant::new).
    pub fn new(config: PlantConfigOf<T, N, K, B>) -> Self {
        let geometry = config.rotor.geometry();
        Self { config, geometry }
    }

    /// Gaps and directions of the magnets.
    pub fn geometry(&self) -> &Geometry<T, N, K> {
        &self.geometry
    }

    /// The coil of magnet k, counted from 0.
    #[inline]
    pub fn coil(&self, k: usize) -> Coil<T> {
        self.config.coil.of(self.config.lambda_nm2_a2[k], self.geometry.gap_m[k])
    }

    /// The coils at the gaps in m, computed from the flux linkages with voltage drive, otherwise from the input currents.
    #[inline]
    pub(super) fn coils(&self, at: &Instant<'_, T, N, K, B>, gap_m: [T; K]) -> [CoilPoint<T>; K] {
        let (open, input) = (at.conditions.open, at.input);
        if self.config.coil.drive == Drive::Current && self.config.coil.saturation_wb.value() == 0.0 {
            // P(4) literally, in the order of operations with the fewest roundings.
            let current_a = flowing(open, input.current_a);
            let force_n = forces(self.config.lambda_nm2_a2, current_a, gap_m);
            return array::from_fn(|k| {
                let inductance_h = self.coil(k).inductance_h(gap_m[k]);
                CoilPoint {
                    linkage_wb: inductance_h * current_a[k],
                    current_a: current_a[k],
                    force_n: force_n[k],
                    current_by_linkage: T::constant(0.0),
                }
            });
        }
        array::from_fn(|k| match self.config.coil.drive {
            _ if open[k] => CoilPoint::idle(),
            Drive::Current => self.coil(k).at_current(input.current_a[k], gap_m[k]),
            Drive::Voltage => self.coil(k).at_linkage(at.motion.linkage_wb[k], gap_m[k]),
        })
    }

    /// `dψ_k/dt = u_k − R i_k` in V, u_k limited by the amplifier; 0 with current drive or if the circuit is open.
    fn induced_v(&self, at: &Instant<'_, T, N, K, B>, coils: &[CoilPoint<T>; K]) -> [T; K] {
        let coil = &self.config.coil;
        array::from_fn(|k| {
            if coil.drive == Drive::Current || at.conditions.open[k] {
                return T::constant(0.0);
            }
            coil.limited(at.input.voltage_v[k]) - coil.resistance_ohm * coils[k].current_a
        })
    }

    /// `(F + p − Ω G q̇ + c)/M`, per coordinate, in m/s², for angles in rad/s²; the forces are F, p and c.
    #[inline]
    fn acceleration(&self, at: &Instant<'_, T, N, K, B>, [magnets_n, others_n, contact_n]: [[T; N]; 3]) -> [T; N] {
        let inertia: [T; N] = self.config.rotor.shaft.inertia();
        let gyroscopic = self.config.rotor.shaft.gyroscopic(at.input.omega_rad_s, at.motion.velocity_m_s);
        array::from_fn(|a| {
            let force_n = magnets_n[a] + others_n[a];
            let force_n = gyroscopic.map_or(force_n, |moment| force_n + moment[a]);
            // Without contact the sum keeps its bits, including the sign of a zero.
            let force_n = if contact_n[a].is_zero() { force_n } else { force_n + contact_n[a] };
            force_n / inertia[a]
        })
    }

    /// The right-hand side of the equations of motion, d/dt of [`Motion`].
    ///
    /// NaN outside the gap, where P(4) has no meaning. With current drive the derivatives of the fluxes are 0.
    pub fn derivative(&self, at: &Instant<'_, T, N, K, B>) -> Motion<T, N, K> {
        self.derivative_under(at, self.config.perturbation(at.input, at.conditions.time_s, at.conditions.theta_rad))
    }

    /// [`Equations::derivative`] for a given perturbation, in N.
    pub(super) fn derivative_under(&self, at: &Instant<'_, T, N, K, B>, perturbation_n: [T; N]) -> Motion<T, N, K> {
        let x = at.motion;
        let gap_m = self.geometry.gaps(x.position_m);
        if !gap_m.iter().all(|gap| gap.value() > 0.0) {
            let nan = T::constant(f64::NAN);
            return Motion { position_m: [nan; N], velocity_m_s: [nan; N], linkage_wb: [nan; K] };
        }
        let coils = self.coils(at, gap_m);
        let contact_n = self.config.contact_n(at);
        let resultant_n = self.geometry.resultant(array::map(coils, |coil| coil.force_n));
        Motion {
            position_m: x.velocity_m_s,
            velocity_m_s: self.acceleration(at, [resultant_n, perturbation_n, contact_n]),
            linkage_wb: self.induced_v(at, &coils),
        }
    }

    /// All outputs at an instant.
    pub fn outputs(&self, at: &Instant<'_, T, N, K, B>) -> PlantOutput<T, N, K> {
        let Instant { motion, input, conditions } = *at;
        let gap_m = self.geometry.gaps(motion.position_m);
        let coils = self.coils(at, gap_m);
        let force_n = array::map(coils, |coil| coil.force_n);
        let resultant_n = self.geometry.resultant(force_n);
        let perturbation_n = self.config.perturbation(input, conditions.time_s, conditions.theta_rad);
        let contact_n = self.config.contact_n(at);
        PlantOutput {
            gap_m,
            current_a: array::map(coils, |coil| coil.current_a),
            linkage_wb: array::map(coils, |coil| coil.linkage_wb),
            induced_v: self.induced_v(at, &coils),
            force_n,
            resultant_n,
            perturbation_n,
            contact_n,
            acceleration_m_s2: self.acceleration(at, [resultant_n, perturbation_n, contact_n]),
        }
    }
}

/// The currents in A, 0 where the circuit is open.
#[inline]
pub(super) fn flowing<T: Scalar, const K: usize>(open: [bool; K], current_a: [T; K]) -> [T; K] {
    array::from_fn(|k| if open[k] { T::constant(0.0) } else { current_a[k] })
}
