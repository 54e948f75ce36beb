//! A rigid rotor in its bearings.
//!
//! In one bearing it moves laterally or axially. In two radial bearings A and B the shaft tilts, and there may be an axial bearing X.
//! Coordinates and signs are those of [`shaft`]. Magnets are counted bearing by bearing; magnet 1 of X pulls towards +x. Positions along
//! the shaft are in m from the centre of gravity. The sensors of a single bearing read the coordinates, those of a shaft `h · q`, in the
//! order A.Ym, A.Zm, B.Ym, B.Zm, Xm:
//!
//! ```text
//! A.Ym = y + ξ γ     A.Zm = z − ξ β        ξ of A's sensors, not of its magnets; B likewise
//! Xm = x                                   if there is an axial bearing
//! ```

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use crate::bearing::magnet::{Geometry, MOST_MAGNETS, Magnets, angles_rad};
use crate::bearing::{Scalar, Shaft, array, shaft};
use crate::invalid::Checks;
use crate::machine::{Bearing, Machine};
use crate::variables::unit::{METRE, RADIAN};
use crate::variables::{Saved, Variables};

/// Minimum distance along the shaft between two bearings, and between their sensors, in m.
///
/// At 1 mm, sensor noise of 0.1 µm becomes 0.1 mrad of noise in the angles, which uses up a gap of 0.5 mm at the end of a shaft of
/// several metres: control would be impossible.
pub const SHORTEST_DISTANCE_M: f64 = 1e-3;

/// A bearing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
#[variables(T = f64, context = Bearing)]
pub struct BearingConfig<T = f64> {
    /// Position of the magnets of bearing {prefix} along the shaft, from the centre of gravity
    #[parameter(name = "position", count = context.if_placed(), unit = METRE, nominal = 0.1)]
    pub position_m: T,
    /// Position of the sensors of bearing {prefix} along the shaft, from the centre of gravity
    #[parameter(name = "sensorPosition", count = context.if_placed(), unit = METRE, nominal = 0.1)]
    pub sensor_position_m: T,
    /// Nominal air gap{of bearing}
    #[parameter(name = "s", unit = METRE, above = 0.0, nominal = 1e-4, display_unit = "mm")]
    pub gap_m: T,
    /// Angle of magnet {k}{of bearing}; its direction is (sin alpha, cos alpha) in the y-z plane
    ///
    /// For a radial bearing; elements beyond its number of magnets are unused.
    #[parameter(name = "alpha", count = context.magnets * context.if_radial(), unit = RADIAN)]
    pub alpha_rad: [T; MOST_MAGNETS],
}

/// Rotor and bearings of a machine.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(T = f64, context = Machine)]
#[serde(bound = "T: Saved, [BearingConfig<T>; B]: Saved")]
pub struct RotorConfig<T = f64, const B: usize = 1> {
    /// Inertia.
    #[nested(prefix = "")]
    pub shaft: Shaft<T>,
    /// Begin and end of a shaft that tilts, in m from the centre of gravity: limits for what is mounted, without effect on the motion.
    #[parameter(
        names = ["shaft.begin", "shaft.end"].into_iter().take(context.if_tilting(2)).collect::<Vec<_>>(), unit = METRE,
        nominal = 0.1,
        description = ["Begin of the shaft, from the centre of gravity", "End of the shaft, from the centre of gravity"][index]
    )]
    pub extent_m: [T; 2],
    /// The bearings, in the order of the machine.
    #[nested(prefixes = context.of_bearings(""), context = context.bearings[index])]
    pub bearings: [BearingConfig<T>; B],
}

impl<const B: usize> RotorConfig<f64, B> {
    /// The paper's bearing, one of the same size, or the spindle of the examples: 12 kg, 0.27 m between the bearings.
    pub fn of(machine: &Machine) -> Self {
        let tilts = machine.tilts();
        let bearing = |b: usize| {
            let of = &machine.bearings[b];
            let [position_m, sensor_position_m] = match of.if_placed() {
                1 => [[-0.12, -0.10], [0.15, 0.13]][b],
                _ => [0.0; 2],
            };
            let gap_m = if tilts && !of.is_radial { 6e-4 } else { 5e-4 };
            BearingConfig { position_m, sensor_position_m, gap_m, alpha_rad: angles_rad(of.magnets) }
        };
        let [m_kg, transverse_kgm2, polar_kgm2] = if tilts { [12.0, 0.16, 0.02] } else { [6.7, 0.0, 0.0] };
        Self {
            shaft: Shaft { m_kg, transverse_kgm2, polar_kgm2 },
            extent_m: if tilts { [-0.2, 0.2] } else { [0.0; 2] },
            bearings: array::from_fn(bearing),
        }
    }
}

impl<T: Scalar, const B: usize> RotorConfig<T, B> {
    /// Gaps and directions of the magnets; those of an axial bearing only with the axial coordinate.
    pub fn geometry<const N: usize, const K: usize>(&self) -> Geometry<T, N, K> {
        let places = Machine::of::<N, K>();
        let bearing = |k: usize| places.magnet(k).map_or((0, 0), |(bearing, number)| (bearing, number - 1));
        Geometry {
            gap_m: array::from_fn(|k| self.bearings[bearing(k).0].gap_m),
            directions: array::from_fn(|k| {
                let (b, number) = bearing(k);
                let BearingConfig { position_m, alpha_rad, .. } = self.bearings[b];
                if !places.bearings[b].is_radial {
                    return shaft::along(T::constant(if number == 0 { 1.0 } else { -1.0 }));
                }
                let (sin, cos) = alpha_rad[number].sine_cosine();
                shaft::generalised(position_m, [sin, cos])
            }),
        }
    }

    /// The readings `H q`, in m, at the coordinates q in m and rad.
    #[inline]
    pub fn readings<const N: usize>(&self, q: [T; N]) -> [T; N] {
        in_bearings(array::map(self.bearings, |bearing| bearing.sensor_position_m), q)
    }

    /// The displacements at the magnets, in m, in the order of the readings.
    #[inline]
    pub fn at_magnets<const N: usize>(&self, q: [T; N]) -> [T; N] {
        in_bearings(array::map(self.bearings, |bearing| bearing.position_m), q)
    }
}

/// Displacements (y, z) at positions of A and of B, and x if it is a coordinate, in m; for a single bearing the coordinates themselves.
#[inline]
fn in_bearings<T: Scalar, const N: usize, const B: usize>(at_m: [T; B], q: [T; N]) -> [T; N] {
    if N < shaft::ACROSS {
        return q;
    }
    let [a, b] = array::from_fn(|b| shaft::displacement(at_m[b], q));
    array::from_fn(|n| [a[0], a[1], b[0], b[1], q[0]][n])
}

impl<const B: usize> RotorConfig<f64, B> {
    /// Rejects a position that is not on the shaft.
    pub(crate) fn check_position(&self, name: impl Into<Cow<'static, str>>, at_m: f64, checks: &mut Checks) {
        let [begin_m, end_m] = self.extent_m;
        let wanted = format!("a position on the shaft, from shaft.begin = {begin_m} m to shaft.end = {end_m} m");
        // If the shaft itself is invalid, any position is accepted.
        checks.number(!(begin_m < end_m && (at_m < begin_m || at_m > end_m)), name, (at_m, "m"), wanted);
    }

    /// Rejects physically impossible shafts, and bearings or sensors too close together to support or detect a tilt.
    fn check_shaft(&self, checks: &mut Checks) {
        let Shaft { transverse_kgm2, polar_kgm2, .. } = self.shaft;
        let wanted = format!("at most 2 Jt = {} kg.m2, as of a disk: no body has more", 2.0 * transverse_kgm2);
        checks.number(polar_kgm2 <= 2.0 * transverse_kgm2, "Jp", (polar_kgm2, "kg.m2"), wanted);
        let [begin_m, end_m] = self.extent_m;
        let wanted = format!("a position beyond shaft.begin = {begin_m} m");
        checks.number(begin_m < end_m, "shaft.end", (end_m, "m"), wanted);
        let [a, b, ..] = &self.bearings[..] else { return };
        for (prefix, bearing) in ["A.", "B."].into_iter().zip([a, b]) {
            self.check_position(format!("{prefix}position"), bearing.position_m, checks);
            self.check_position(format!("{prefix}sensorPosition"), bearing.sensor_position_m, checks);
        }
        check_apart("position", "bearings", [a.position_m, b.position_m], checks);
        check_apart("sensorPosition", "sensors", [a.sensor_position_m, b.sensor_position_m], checks);
    }
}

fn check_apart(name: &str, what: &str, [a_m, b_m]: [f64; 2], checks: &mut Checks) {
    let wanted = format!(
        "a position at least {SHORTEST_DISTANCE_M} m from A.{name} = {a_m} m, so that the {what} support or see a tilt"
    );
    checks.number((a_m - b_m).abs() >= SHORTEST_DISTANCE_M, format!("B.{name}"), (b_m, "m"), wanted);
}

/// A rotor with N coordinates between the K magnets of its B bearings, validated.
#[derive(Clone, Debug, PartialEq)]
pub struct Rotor<const N: usize = 2, const K: usize = 3, const B: usize = 1> {
    config: RotorConfig<f64, B>,
    geometry: Geometry<f64, N, K>,
    bearings: [Magnets; B],
}

impl<const N: usize, const K: usize, const B: usize> Rotor<N, K, B> {
    /// The machine.
    pub const MACHINE: &'static Machine = {
        let machine = Machine::of::<N, K>();
        assert!(machine.bearings.len() == B && machine.magnets() == K, "the bearings and magnets of the machine");
        machine
    };

    /// A rotor, for numbers within their limits; valid only if `checks` finds nothing.
    ///
    /// It finds physically impossible masses and moments of inertia, an empty shaft, positions beyond it, bearings or sensors too close
    /// together, and the findings of [`Magnets::checked`] for each bearing, by their names in the interface.
    pub fn checked(config: RotorConfig<f64, B>, checks: &mut Checks) -> Self {
        if Self::MACHINE.tilts() {
            config.check_shaft(checks);
        }
        let bearings = std::array::from_fn(|b| {
            let (of, BearingConfig { gap_m, alpha_rad, .. }) = (&Self::MACHINE.bearings[b], &config.bearings[b]);
            checks.of(of.prefix, |checks| Magnets::checked(*gap_m, &alpha_rad[..of.if_radial() * of.magnets], checks))
        });
        Self { config, geometry: config.geometry(), bearings }
    }

    /// The configuration.
    pub fn config(&self) -> &RotorConfig<f64, B> {
        &self.config
    }

    /// Gaps and directions of all magnets.
    pub fn geometry(&self) -> &Geometry<f64, N, K> {
        &self.geometry
    }

    /// The magnets of each bearing.
    pub fn bearings(&self) -> &[Magnets; B] {
        &self.bearings
    }

    /// The coordinates `H⁻¹ r`, in m and rad, for readings r in m.
    #[inline]
    pub fn coordinates(&self, reading_m: [f64; N]) -> [f64; N] {
        self.through(reading_m, |bearing| bearing.sensor_position_m)
    }

    /// The coordinates for displacements, in m and in the order of the readings, at the position `at_m` of each radial bearing.
    #[inline]
    pub(crate) fn through(&self, displacement_m: [f64; N], at_m: impl Fn(&BearingConfig) -> f64) -> [f64; N] {
        if N < shaft::ACROSS {
            return displacement_m;
        }
        let radial_m = array::from_fn(|b| [displacement_m[2 * b], displacement_m[2 * b + 1]]);
        shaft::through(displacement_m[N - 1], array::from_fn(|b| at_m(&self.config.bearings[b])), radial_m)
    }

    /// The force at each bearing for a generalised force, in N: (F_y, F_z), or (F_x, 0) in an axial one.
    #[inline]
    fn shared(&self, force: [f64; N]) -> [[f64; 2]; B] {
        let mut shared = [[force[0], 0.0]; B];
        if N >= shaft::ACROSS {
            let at_m = array::from_fn(|b| self.config.bearings[b].position_m);
            [shared[0], shared[1]] = shaft::shared(at_m, force);
        } else if N == 2 {
            shared[0][1] = force[1];
        }
        shared
    }

    /// The forces of the magnets, in N, for the generalised force Q, in N or N·m, and for each group the smallest force in N, or the bias
    /// current in A if `per_square`, `λ_k/gap_k²` in N/A², is given.
    #[inline(always)]
    pub fn allocate(&self, force: [f64; N], level: &[f64], per_square: Option<&[f64; K]>) -> [f64; K] {
        let mut forces_n = [0.0; K];
        for (b, at_n) in self.shared(force).into_iter().enumerate() {
            let (magnets, level) = (Self::MACHINE.magnets_of(b), &level[Self::MACHINE.groups_of(b)]);
            let (bearing, own_n) = (&self.bearings[b], &mut forces_n[magnets.clone()]);
            match per_square {
                None => bearing.allocate(at_n, level, own_n),
                Some(per_square) => bearing.allocate_with_bias(at_n, level, &per_square[magnets], own_n),
            }
        }
        forces_n
    }
}
