//! The spindle: a rigid shaft with M magnets and a backup ring at each of two radial bearings, and N coordinates: (x, y, z, β, γ) with two axial
//! magnets and an axial stop, or (y, z, β, γ).
//!
//! ```text
//! M q̈ + Ω G q̇ = Σ_k F_k d_k + p + c
//! p = (p_x, p_y, p_z, M_β, M_γ) + m g + Σ_j U_j ω² (cos(θ + φ_j), sin(θ + φ_j)) at ξ_j
//! ```
//!
//! Coordinates, signs and G are those of [`shaft`](crate::bearing::shaft). A change of speed adds nothing to the tilt: the torque
//! that drives the rotor acts along its own axis, and its share across the axis at rest is just `J_p Ω̇ (γ, −β)`.

use serde::{Deserialize, Serialize};

use super::equations::{Equations, Motion, PlantInput, PlantOutput};
use super::rotor::{PlantParameters, Rotor, check_lambda_and_unbalance, check_start};
use super::sensor::SensorConfig;
use super::{Plant, PlantState, check_step};
use crate::bearing::coil::{CoilConfig, Saturates};
use crate::bearing::magnet::Geometry;
use crate::bearing::scalar::Scalar;
use crate::bearing::shaft::{ACROSS, Shaft, across, displacement, generalised};
use crate::bearing::spindle::{RadialBearing, SpindleGeometryOf, SpindleOf, bearing_of};
use crate::bearing::touchdown::{Called, TouchdownConfig};
use crate::invalid::Checks;
use crate::machine::Machine;
use crate::variables::unit::{METRE, METRE_PER_SECOND, METRE_PER_SECOND2, NEWTON, RADIAN, RADIAN_PER_SECOND, SECOND};
use crate::variables::{KILOGRAM_METRE, LAMBDA, Variables};

/// Number of planes with an unbalance.
pub const PLANES: usize = 2;

/// A plant with a spindle in two radial bearings with three magnets each, and an axial one.
pub type SpindlePlant = Plant<SpindleConfig, 5, 8>;

/// Its state. Positions are (x, y, z, β, γ), samples A.Ym, A.Zm, B.Ym, B.Zm, Xm.
pub type SpindleState = PlantState<5, 8, Contact>;

/// Its inputs; the perturbation is (p_x, p_y, p_z, M_β, M_γ), in N and N·m.
pub type SpindleInput<T = f64> = PlantInput<T, 5, 8>;

/// Its outputs.
pub type SpindleOutput<T = f64> = PlantOutput<T, 5, 8>;

/// Whether the shaft touches the backup bearings at A and at B, and the axial stop; without one, never.
pub type Contact = [bool; 3];

/// The backup bearings of a spindle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(T = f64, context = Machine)]
pub struct SpindleTouchdown<T = f64> {
    /// Ring around the shaft at the magnets of A.
    #[nested(prefix = "A.", context = Called { what: "backup bearing at A", from: "centre", is_ring: true })]
    pub a: TouchdownConfig<T>,
    /// Ring around the shaft at the magnets of B.
    #[nested(prefix = "B.", context = Called { what: "backup bearing at B", from: "centre", is_ring: true })]
    pub b: TouchdownConfig<T>,
    /// Axial stops on both sides; without friction, its coefficient and radius are not used. None of it without an axial bearing.
    #[nested(prefix = "X.", count = context.axial(), context = Called { what: "axial stop", from: "middle", is_ring: false })]
    pub x: TouchdownConfig<T>,
}

impl Default for SpindleTouchdown {
    /// Half the gap, as for the planar rotor.
    fn default() -> Self {
        let ring = TouchdownConfig::default();
        Self { a: ring.clone(), b: ring.clone(), x: TouchdownConfig { clearance_m: 3e-4, ..ring } }
    }
}

impl<T: Scalar> SpindleTouchdown<T> {
    fn rings(&self) -> [&TouchdownConfig<T>; 2] {
        [&self.a, &self.b]
    }

    /// The axial stop as a ring that is touched along one axis only.
    fn stop(&self) -> TouchdownConfig<T> {
        TouchdownConfig { friction: T::constant(0.0), ..self.x.clone() }
    }
}

/// The spindle and its initial conditions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(T = f64, context = Machine)]
#[serde(bound(
    serialize = "T: Serialize, [T; N]: Serialize, [T; M]: Serialize, [T; K]: Serialize, [f64; N]: Serialize, [f64; K]: Serialize",
    deserialize = "T: Deserialize<'de>, [T; N]: Deserialize<'de>, [T; M]: Deserialize<'de>, [T; K]: Deserialize<'de>, \
                   [f64; N]: Deserialize<'de>, [f64; K]: Deserialize<'de>"
))]
pub struct SpindleConfigOf<T, const N: usize, const M: usize, const K: usize> {
    /// Shaft and bearings.
    #[nested(prefix = "")]
    pub geometry: SpindleGeometryOf<T, M>,
    /// The coils.
    #[nested(prefix = "", context = Saturates(true))]
    pub coil: CoilConfig<T>,
    /// Initial coordinates, in m and rad.
    #[parameter(
        names = context.at_start(|coordinate| coordinate.position), unit = context.either(index, METRE, RADIAN),
        nominal = context.either(index, 1e-5, 1e-4),
        description = format!("{} at the start", context.coordinates[index].position.1)
    )]
    pub position_m: [T; N],
    /// Their initial rates, in m/s and rad/s.
    #[parameter(
        names = context.at_start(|coordinate| coordinate.rate),
        unit = context.either(index, METRE_PER_SECOND, RADIAN_PER_SECOND),
        nominal = context.either(index, 1e-2, 0.1),
        description = format!("{} at the start", context.coordinates[index].rate.1)
    )]
    pub velocity_m_s: [T; N],
    /// Initial rotor angle
    #[parameter(name = "theta0", unit = RADIAN)]
    pub theta_rad: T,
    /// Acceleration of gravity along those coordinates that are lengths, in m/s².
    #[parameter(
        names = context.of_lengths("gravity."), count = context.of_lengths("").len(), unit = METRE_PER_SECOND2, nominal = 10.0,
        description = format!("Acceleration of gravity {}", context.direction(index).replace('x', "x, the shaft"))
    )]
    pub gravity_m_s2: [T; 3],
    /// The backup bearings.
    #[nested(prefix = "")]
    pub touchdown: SpindleTouchdown<T>,
    /// The sensors.
    #[nested(prefix = "")]
    pub sensor: SensorConfig<N, K>,
    /// Upper bound of the integration step
    #[parameter(name = "solver.maxStep", unit = SECOND, min = 0.0, nominal = 1e-5, display_unit = "µs")]
    pub max_step_s: f64,
    /// Force constant of {magnet}
    #[parameter(names = context.of_magnets("lambda"), tunable, unit = LAMBDA, min = 0.0, nominal = 1e-6)]
    pub lambda_nm2_a2: [T; K],
    /// Unbalance of the rotor in plane {k}, mass times eccentricity
    #[parameter(names = context.of_planes("magnitude"), tunable, unit = KILOGRAM_METRE, min = 0.0, nominal = 1e-4)]
    pub unbalance_kgm: [T; PLANES],
    /// Angle of the unbalance in plane {k} from the mark on the rotor that theta refers to
    #[parameter(names = context.of_planes("phase"), tunable, unit = RADIAN)]
    pub unbalance_phase_rad: [T; PLANES],
    /// Position of plane {k} along the shaft, from the centre of gravity
    #[parameter(names = context.of_planes("position"), unit = METRE, nominal = 0.1)]
    pub unbalance_position_m: [T; PLANES],
}

/// That with three magnets in each radial bearing, and an axial one.
pub type SpindleConfig<T = f64> = SpindleConfigOf<T, 5, 3, 8>;

impl<const N: usize, const M: usize, const K: usize> Default for SpindleConfigOf<f64, N, M, K> {
    /// The spindle of the examples at rest in the centre, balanced.
    fn default() -> Self {
        Self {
            geometry: SpindleGeometryOf::default(),
            lambda_nm2_a2: std::array::from_fn(|k| {
                let radial = [[1.8e-6, 2.0e-6, 2.2e-6, 2.3e-6], [2.4e-6, 2.1e-6, 1.9e-6, 2.0e-6]];
                match bearing_of::<M>(k) {
                    (2, k) => [3.0e-6, 2.6e-6][k],
                    (bearing, k) => radial[bearing][k],
                }
            }),
            unbalance_kgm: [0.0; PLANES],
            unbalance_phase_rad: [0.0; PLANES],
            unbalance_position_m: [-0.08, 0.10],
            gravity_m_s2: [0.0; 3],
            coil: CoilConfig::default(),
            touchdown: SpindleTouchdown::default(),
            position_m: [0.0; N],
            velocity_m_s: [0.0; N],
            theta_rad: 0.0,
            sensor: SensorConfig::default(),
            max_step_s: 5e-5,
        }
    }
}

impl<T: Scalar, const N: usize, const M: usize, const K: usize> SpindleConfigOf<T, N, M, K> {
    /// Displacement (y, z) of the shaft at the magnets of A and of B, for coordinates or for their rates.
    fn at_magnets(&self, q: [T; N]) -> [[T; 2]; 2] {
        self.geometry.radial().map(|bearing| displacement(bearing.position_m, q))
    }

    /// Forces of the backup bearings that are touched: (y, z) at A and at B, and x, in N.
    fn touchdown_n(&self, motion: &Motion<T, N, K>, omega_rad_s: T, contact: Contact) -> ([[T; 2]; 2], T) {
        let zero = T::constant(0.0);
        let [at, speed] = [motion.position_m, motion.velocity_m_s].map(|q| self.at_magnets(q));
        let rings = self.touchdown.rings();
        let radial = std::array::from_fn(|b| match contact[b] {
            true => rings[b].force_n(at[b], speed[b], omega_rad_s),
            false => [zero; 2],
        });
        let axial = match contact[2] {
            true => {
                self.touchdown.stop().force_n([motion.position_m[0], zero], [motion.velocity_m_s[0], zero], zero)[0]
            }
            false => zero,
        };
        (radial, axial)
    }
}

impl<T: Scalar, const N: usize, const M: usize, const K: usize> Rotor<N, K> for SpindleConfigOf<T, N, M, K> {
    type Number = T;
    type With<U: Scalar> = SpindleConfigOf<U, N, M, K>;
    type Contact = Contact;

    fn with<U: Scalar, V: Scalar>(
        &self,
        other: &SpindleConfigOf<U, N, M, K>,
        join: &impl Fn(T, U) -> V,
    ) -> SpindleConfigOf<V, N, M, K> {
        let (own, off) = (&self.geometry, &other.geometry);
        let bearing = |own: &RadialBearing<T, M>, off: &RadialBearing<U, M>| joined!(own, off, join, RadialBearing { position_m, sensor_position_m, gap_m; alpha_rad; });
        let geometry = joined!(own, off, join, SpindleGeometryOf {
            axial_gap_m; extent_m;
            shaft: joined!(&self.geometry.shaft, &other.geometry.shaft, join, Shaft {
                m_kg, transverse_kgm2, polar_kgm2;;
            }),
            a: bearing(&self.geometry.a, &other.geometry.a),
            b: bearing(&self.geometry.b, &other.geometry.b)
        });
        let (rings, others) = (&self.touchdown, &other.touchdown);
        joined!(self, other, join, SpindleConfigOf {
            theta_rad;
            lambda_nm2_a2, unbalance_kgm, unbalance_phase_rad, unbalance_position_m, gravity_m_s2, position_m, velocity_m_s;
            geometry: geometry,
            coil: self.coil.with(&other.coil, join),
            touchdown: SpindleTouchdown {
                a: rings.a.with(&others.a, join),
                b: rings.b.with(&others.b, join),
                x: rings.x.with(&others.x, join),
            },
            sensor: self.sensor.clone(),
            max_step_s: self.max_step_s
        })
    }

    fn geometry(&self) -> Geometry<T, N, K> {
        self.geometry.geometry()
    }

    #[inline]
    fn inertia(&self) -> [T; N] {
        self.geometry.shaft.inertia()
    }

    #[inline]
    fn lambda_nm2_a2(&self) -> &[T; K] {
        &self.lambda_nm2_a2
    }

    #[inline]
    fn coil(&self) -> &CoilConfig<T> {
        &self.coil
    }

    fn readings_m(&self, position_m: [T; N]) -> [T; N] {
        self.geometry.readings(position_m)
    }

    fn perturbation(&self, input: &PlantInput<T, N, K>, _: T, theta_rad: T) -> [T; N] {
        let mut p = input.perturbation_n;
        for (p_a, gravity) in p.iter_mut().zip(self.gravity_m_s2).take(N - 2) {
            *p_a = *p_a + self.geometry.shaft.m_kg * gravity;
        }
        for j in 0..PLANES {
            // Skipped in a balanced plane, so that the common case needs no sine.
            if self.unbalance_kgm[j].is_zero() {
                continue;
            }
            let force = self.unbalance_kgm[j] * input.omega_rad_s * input.omega_rad_s;
            let (sin, cos) = (theta_rad + self.unbalance_phase_rad[j]).sine_cosine();
            let turning: [T; N] = generalised(self.unbalance_position_m[j], [force * cos, force * sin]);
            p = std::array::from_fn(|a| p[a] + turning[a]);
        }
        p
    }

    #[inline]
    fn gyroscopic(&self, omega_rad_s: T, rates: [T; N]) -> Option<[T; N]> {
        Some(self.geometry.shaft.gyroscopic(omega_rad_s, rates))
    }

    fn contact_n(&self, motion: &Motion<T, N, K>, omega_rad_s: T, contact: Contact) -> [T; N] {
        let mut sum = [T::constant(0.0); N];
        if contact == [false; 3] {
            return sum;
        }
        let (radial, axial) = self.touchdown_n(motion, omega_rad_s, contact);
        if N > ACROSS {
            sum[0] = axial;
        }
        for (bearing, force) in self.geometry.radial().into_iter().zip(radial) {
            let part: [T; N] = generalised(bearing.position_m, force);
            sum = std::array::from_fn(|a| sum[a] + part[a]);
        }
        sum
    }
}

impl<const N: usize, const M: usize, const K: usize> PlantParameters<N, K> for SpindleConfigOf<f64, N, M, K> {
    const MACHINE: &'static Machine = Machine::of_shaft::<N, M>();

    fn check(&self, checks: &mut Checks) {
        let spindle: SpindleOf<N, M, K> = self.geometry.checked(checks);
        let machine = Self::MACHINE;
        self.check_tunable(checks);
        for (name, at_m) in machine.of_planes("position").into_iter().zip(self.unbalance_position_m) {
            self.geometry.check_position(name, at_m, checks);
        }
        check_start(self, checks);
        for (name, value) in machine.of_lengths("gravity.").into_iter().zip(self.gravity_m_s2) {
            checks.finite(name, value, "m/s2");
        }
        self.coil.check(spindle.geometry().gap_m, self.lambda_nm2_a2, checks);
        checks.of("A.", |checks| self.touchdown.a.check(checks));
        checks.of("B.", |checks| self.touchdown.b.check(checks));
        if N > ACROSS {
            checks.of("X.", |checks| self.touchdown.x.check(checks));
        }
        self.sensor.check(machine, checks);
        check_step("solver.maxStep", self.max_step_s, checks);
    }

    fn check_tunable(&self, checks: &mut Checks) {
        let Self { lambda_nm2_a2, unbalance_kgm, unbalance_phase_rad, .. } = self;
        check_lambda_and_unbalance(Self::MACHINE, lambda_nm2_a2, unbalance_kgm, unbalance_phase_rad, checks);
    }

    fn retuned(&self, to: &Self) -> Self {
        let Self { lambda_nm2_a2, unbalance_kgm, unbalance_phase_rad, .. } = *to;
        Self { lambda_nm2_a2, unbalance_kgm, unbalance_phase_rad, ..self.clone() }
    }

    fn start(&self) -> ([f64; N], [f64; N]) {
        (self.position_m, self.velocity_m_s)
    }

    fn start_angle_rad(&self) -> f64 {
        self.theta_rad
    }

    fn sensor(&self) -> &SensorConfig<N, K> {
        &self.sensor
    }

    fn max_step_s(&self) -> f64 {
        self.max_step_s
    }

    fn touches(&self, position_m: &[f64; N], velocity_m_s: &[f64; N]) -> Contact {
        let [at, speed] = [position_m, velocity_m_s].map(|q| self.at_magnets(*q));
        let [a, b] = self.touchdown.rings();
        [
            a.touches(at[0], speed[0]),
            b.touches(at[1], speed[1]),
            N > ACROSS && self.touchdown.x.touches([position_m[0], 0.0], [velocity_m_s[0], 0.0]),
        ]
    }

    fn rate(&self, motion: &Motion<f64, N, K>, contact: Contact, force_n: [f64; K], gap_m: [f64; K]) -> f64 {
        let Shaft { m_kg, transverse_kgm2, .. } = self.geometry.shaft;
        let radial = self.geometry.radial();
        // 1/m at the centre of gravity, more beside it: how much a force at ξ moves the shaft there.
        let mobility = radial.map(|bearing| 1.0 / m_kg + bearing.position_m * bearing.position_m / transverse_kgm2);
        let mobility = [mobility[0], mobility[1], 1.0 / m_kg];
        let speed = self.at_magnets(motion.velocity_m_s).map(|[v_y, v_z]| (v_y * v_y + v_z * v_z).sqrt());
        let speed = [speed[0], speed[1], motion.velocity_m_s[0].abs()];
        // The trace of M⁻¹ K, which is above its largest eigenvalue.
        let mut field: f64 = 0.0;
        let mut rate: f64 = 0.0;
        for k in 0..K {
            let (bearing, _) = bearing_of::<M>(k);
            field += 2.0 * force_n[k] / gap_m[k] * mobility[bearing];
            rate = rate.max(speed[bearing] / gap_m[k]);
        }
        rate = rate.max(field.sqrt());
        if contact == [false; 3] {
            return rate;
        }
        let [at, moving] = [motion.position_m, motion.velocity_m_s].map(|q| self.at_magnets(q));
        let rings = self.touchdown.rings();
        for b in 0..2 {
            if contact[b] {
                rate = rate.max(rings[b].rate(1.0 / mobility[b], rings[b].push_n(at[b], moving[b])));
            }
        }
        if contact[2] {
            rate = rate.max(self.touchdown.stop().rate(m_kg, 0.0));
        }
        rate
    }
}

/// Outputs of a spindle at a radial bearing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
#[variables(T = f64)]
pub struct AtRadialBearing<T = f64> {
    /// Position of the shaft along y at the magnets of bearing {prefix}
    #[output(name = "Y", unit = METRE, nominal = 1e-5)]
    pub y_m: T,
    /// Force of the magnets of bearing {prefix} along y
    #[output(name = "FY", unit = NEWTON, nominal = 10.0)]
    pub y_n: T,
    /// Force of the backup bearing at {prefix} on the rotor along y
    #[output(name = "touchdown.FY", unit = NEWTON, nominal = 1000.0)]
    pub touchdown_y_n: T,
    /// Position of the shaft along z at the magnets of bearing {prefix}
    #[output(name = "Z", unit = METRE, nominal = 1e-5)]
    pub z_m: T,
    /// Force of the magnets of bearing {prefix} along z
    #[output(name = "FZ", unit = NEWTON, nominal = 10.0)]
    pub z_n: T,
    /// Force of the backup bearing at {prefix} on the rotor along z
    #[output(name = "touchdown.FZ", unit = NEWTON, nominal = 1000.0)]
    pub touchdown_z_n: T,
}

/// Outputs of a spindle at its bearings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
#[variables(T = f64, context = Machine)]
pub struct AtBearings<T = f64> {
    /// At A.
    #[nested(prefix = "A.", context = ())]
    pub a: AtRadialBearing<T>,
    /// At B.
    #[nested(prefix = "B.", context = ())]
    pub b: AtRadialBearing<T>,
    /// Force of the axial magnets along the shaft
    #[output(name = "X.FX", count = context.axial(), unit = NEWTON, nominal = 10.0)]
    pub axial_n: T,
    /// Force of the axial stop on the rotor along the shaft
    #[output(name = "X.touchdown.FX", count = context.axial(), unit = NEWTON, nominal = 1000.0)]
    pub axial_touchdown_n: T,
    /// Whether the rotor touches the backup bearings at A and B, and the axial stop.
    #[output(
        names = context.of_bearings("contact"), count = context.bearings.len(),
        description = format!(
            "Whether the rotor touches the {}", ["backup bearing at A", "backup bearing at B", "axial stop"][index]
        )
    )]
    pub contact: Contact,
}

impl<T: Copy> AtBearings<T> {
    /// Applies `f` to every number.
    pub fn map<U>(self, f: impl Fn(T) -> U) -> AtBearings<U> {
        let radial = |at: AtRadialBearing<T>| AtRadialBearing {
            y_m: f(at.y_m),
            z_m: f(at.z_m),
            y_n: f(at.y_n),
            z_n: f(at.z_n),
            touchdown_y_n: f(at.touchdown_y_n),
            touchdown_z_n: f(at.touchdown_z_n),
        };
        AtBearings {
            a: radial(self.a),
            b: radial(self.b),
            axial_n: f(self.axial_n),
            axial_touchdown_n: f(self.axial_touchdown_n),
            contact: self.contact,
        }
    }
}

impl<T: Scalar, const N: usize, const M: usize, const K: usize> Equations<SpindleConfigOf<T, N, M, K>, N, K> {
    /// The outputs at the bearings for these forces of the magnets in N.
    pub fn at_bearings(
        &self,
        motion: &Motion<T, N, K>,
        omega_rad_s: T,
        contact: Contact,
        force_n: [T; K],
    ) -> AtBearings<T> {
        let (touchdown_n, axial_touchdown_n) = self.config.touchdown_n(motion, omega_rad_s, contact);
        let displacement_m = self.config.at_magnets(motion.position_m);
        let directions = &self.geometry().directions;
        let radial = |b: usize| {
            // The direction of a radial magnet in the plane is (y, z) of its d.
            let along = |a: usize| {
                (M * b..M * (b + 1)).fold(T::constant(0.0), |sum, k| sum + force_n[k] * across(directions[k])[a])
            };
            let ([y_m, z_m], [touchdown_y_n, touchdown_z_n]) = (displacement_m[b], touchdown_n[b]);
            AtRadialBearing { y_m, z_m, y_n: along(0), z_n: along(1), touchdown_y_n, touchdown_z_n }
        };
        AtBearings {
            a: radial(0),
            b: radial(1),
            axial_n: if N > ACROSS { force_n[K - 2] - force_n[K - 1] } else { T::constant(0.0) },
            axial_touchdown_n,
            contact,
        }
    }
}
