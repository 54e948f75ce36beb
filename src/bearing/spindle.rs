//! A spindle: a rigid shaft in two radial bearings A and B with M magnets each, three or four. With N = 5 coordinates it has an axial bearing
//! X with two magnets as well; with N = 4 something else holds it along its axis.
//!
//! Coordinates and signs are those of [`shaft`]. Magnets are counted A 1 to M, B 1 to M, X 1 to 2; X 1 pulls
//! towards +x. Positions along the shaft are in m from the centre of gravity. The sensors read `h · q`, in the order A.Ym,
//! A.Zm, B.Ym, B.Zm, Xm:
//!
//! ```text
//! A.Ym = y + ξ γ     A.Zm = z − ξ β        ξ of the sensors of A, not of its magnets; B likewise
//! Xm = x                                   if there is an axial bearing
//! ```

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use crate::bearing::magnet::{Geometry, MagnetsOf, alpha_rad};
use crate::bearing::scalar::Scalar;
use crate::bearing::shaft::{self, ACROSS, Shaft};
use crate::invalid::{Checks, Invalid};
use crate::machine::Machine;
use crate::variables::Variables;
use crate::variables::unit::{METRE, RADIAN};

/// The bearing of magnet k with M magnets in each radial bearing, and the magnet's place there; all counted from 0.
pub const fn bearing_of<const M: usize>(k: usize) -> (usize, usize) {
    (k / M, k % M)
}

/// The least distance along the shaft between two bearings, and between their sensors, in m.
///
/// At 1 mm a sensor noise of 0.1 µm is one of 0.1 mrad in the angles, as much as fits into a gap of 0.5 mm at the end of a shaft of
/// several metres: nothing could be controlled with it.
pub const SHORTEST_DISTANCE_M: f64 = 1e-3;

/// A radial bearing with M magnets.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(T = f64)]
#[serde(bound(
    serialize = "T: Serialize, [T; M]: Serialize",
    deserialize = "T: Deserialize<'de>, [T; M]: Deserialize<'de>"
))]
pub struct RadialBearing<T = f64, const M: usize = 3> {
    /// Position of the magnets of bearing {prefix} along the shaft, from the centre of gravity
    #[parameter(name = "position", unit = METRE, nominal = 0.1)]
    pub position_m: T,
    /// Position of the sensors of bearing {prefix} along the shaft, from the centre of gravity
    #[parameter(name = "sensorPosition", unit = METRE, nominal = 0.1)]
    pub sensor_position_m: T,
    /// Nominal air gap of bearing {prefix}
    #[parameter(name = "s", unit = METRE, min = 0.0, nominal = 1e-4, display_unit = "mm")]
    pub gap_m: T,
    /// Angle of magnet {k} of bearing {prefix}; its direction is (sin alpha, cos alpha) in the y-z plane
    #[parameter(name = "alpha", unit = RADIAN)]
    pub alpha_rad: [T; M],
}

impl<const M: usize> Default for RadialBearing<f64, M> {
    /// Without size and place.
    fn default() -> Self {
        Self { position_m: 0.0, sensor_position_m: 0.0, gap_m: 0.0, alpha_rad: [0.0; M] }
    }
}

/// Shaft and bearings of a spindle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(T = f64, context = Machine)]
#[serde(bound(
    serialize = "T: Serialize, [T; M]: Serialize",
    deserialize = "T: Deserialize<'de>, [T; M]: Deserialize<'de>"
))]
pub struct SpindleGeometryOf<T, const M: usize> {
    /// Inertia.
    #[nested(prefix = "", context = ())]
    pub shaft: Shaft<T>,
    /// Begin and end of the shaft, in m from the centre of gravity. Nothing can be mounted beyond; the motion does not depend on
    /// them.
    #[parameter(
        names = ["shaft.begin", "shaft.end"], unit = METRE, nominal = 0.1,
        description = ["Begin of the shaft, from the centre of gravity", "End of the shaft, from the centre of gravity"][index]
    )]
    pub extent_m: [T; 2],
    /// Bearing A.
    #[nested(prefix = "A.", context = ())]
    pub a: RadialBearing<T, M>,
    /// Bearing B.
    #[nested(prefix = "B.", context = ())]
    pub b: RadialBearing<T, M>,
    /// Nominal air gap of the axial magnets
    ///
    /// Not used without an axial bearing.
    #[parameter(name = "X.s", count = context.axial(), unit = METRE, min = 0.0, nominal = 1e-4, display_unit = "mm")]
    pub axial_gap_m: T,
}

/// That with three magnets in each radial bearing.
pub type SpindleGeometry<T = f64> = SpindleGeometryOf<T, 3>;

impl<const M: usize> Default for SpindleGeometryOf<f64, M> {
    /// The spindle of the examples: 12 kg, 0.27 m between the bearings.
    fn default() -> Self {
        let bearing = |position_m, sensor_position_m| RadialBearing {
            position_m,
            sensor_position_m,
            gap_m: 5e-4,
            alpha_rad: alpha_rad(),
        };
        Self {
            shaft: Shaft { m_kg: 12.0, transverse_kgm2: 0.16, polar_kgm2: 0.02 },
            extent_m: [-0.2, 0.2],
            a: bearing(-0.12, -0.10),
            b: bearing(0.15, 0.13),
            axial_gap_m: 6e-4,
        }
    }
}

impl<T: Scalar, const M: usize> SpindleGeometryOf<T, M> {
    /// Gaps and directions of the magnets.
    pub fn geometry<const N: usize, const K: usize>(&self) -> Geometry<T, N, K> {
        const { assert!(K == 2 * (M + N - ACROSS), "two radial bearings, and an axial one if N = 5") };
        let axial = shaft::axial();
        Geometry {
            gap_m: std::array::from_fn(|k| [self.a.gap_m, self.b.gap_m, self.axial_gap_m][bearing_of::<M>(k).0]),
            directions: std::array::from_fn(|k| match bearing_of::<M>(k) {
                (0, j) => shaft::radial(self.a.position_m, self.a.alpha_rad[j]),
                (1, j) => shaft::radial(self.b.position_m, self.b.alpha_rad[j]),
                (_, j) => axial[j],
            }),
        }
    }

    /// The same with another number of magnets in the radial bearings, those that both have at their angles.
    pub fn with_magnets<const W: usize>(&self) -> SpindleGeometryOf<T, W> {
        let bearing = |of: &RadialBearing<T, M>| RadialBearing {
            position_m: of.position_m,
            sensor_position_m: of.sensor_position_m,
            gap_m: of.gap_m,
            alpha_rad: std::array::from_fn(|k| of.alpha_rad.get(k).copied().unwrap_or(T::constant(0.0))),
        };
        SpindleGeometryOf {
            shaft: self.shaft,
            extent_m: self.extent_m,
            a: bearing(&self.a),
            b: bearing(&self.b),
            axial_gap_m: self.axial_gap_m,
        }
    }

    /// The radial bearings A and B.
    pub fn radial(&self) -> [&RadialBearing<T, M>; 2] {
        [&self.a, &self.b]
    }

    /// The readings `H q`, in m, at the coordinates q in m and rad.
    pub fn readings<const N: usize>(&self, q: [T; N]) -> [T; N] {
        in_bearings(self.radial().map(|bearing| shaft::displacement(bearing.sensor_position_m, q)), q[0])
    }

    /// The matrix H of the readings `H q`, one row per reading.
    pub fn sensors<const N: usize>(&self) -> [[T; N]; N] {
        // A displacement towards (1, 0) or (0, 1) at ξ, as of a magnet that would pull there.
        let [one, zero] = [1.0, 0.0].map(T::constant);
        let axes = [[one, zero], [zero, one]];
        let radial = self.radial().map(|of| axes.map(|axis| shaft::generalised(of.sensor_position_m, axis)));
        in_bearings(radial, shaft::axial()[0])
    }
}

/// Values of (y, z) in A, (y, z) in B, and of x if it is one of N coordinates.
#[inline]
pub(crate) fn in_bearings<V: Copy, const N: usize>([[a_y, a_z], [b_y, b_z]]: [[V; 2]; 2], x: V) -> [V; N] {
    std::array::from_fn(|n| [a_y, a_z, b_y, b_z, x][n])
}

impl<const M: usize> SpindleGeometryOf<f64, M> {
    /// Reports in `checks`, by the names of the interface: masses and moments of inertia that no body has, an empty shaft,
    /// positions beyond it, bearings or sensors at the same place, and of each bearing what [`Magnets::new`] refuses. Use the
    /// spindle only if nothing was reported.
    pub(crate) fn checked<const N: usize, const K: usize>(&self, checks: &mut Checks) -> SpindleOf<N, M, K> {
        let Shaft { m_kg, transverse_kgm2, polar_kgm2 } = self.shaft;
        checks.positive("m", m_kg, "kg");
        checks.positive("Jt", transverse_kgm2, "kg.m2");
        checks.not_negative("Jp", polar_kgm2, "kg.m2");
        checks.require(
            // Values that were refused already are skipped.
            polar_kgm2 <= 2.0 * transverse_kgm2 || !(polar_kgm2.is_finite() && transverse_kgm2 > 0.0),
            "Jp",
            format_args!("{polar_kgm2} kg.m2"),
            format!("at most 2 Jt = {} kg.m2, as of a disk: no body has more", 2.0 * transverse_kgm2),
        );
        let [begin_m, end_m] = self.extent_m;
        checks.finite("shaft.begin", begin_m, "m");
        checks.finite("shaft.end", end_m, "m");
        if begin_m.is_finite() && end_m.is_finite() {
            checks.require(
                begin_m < end_m,
                "shaft.end",
                format_args!("{end_m} m"),
                format!("a position beyond shaft.begin = {begin_m} m"),
            );
        }
        let bearings = [("A.", &self.a), ("B.", &self.b)].map(|(prefix, bearing)| {
            checks.of(prefix, |checks| {
                self.check_position("position", bearing.position_m, checks);
                self.check_position("sensorPosition", bearing.sensor_position_m, checks);
                MagnetsOf::checked(bearing.gap_m, bearing.alpha_rad, checks)
            })
        });
        let (a, b) = (&self.a, &self.b);
        check_apart("position", "bearings", [a.position_m, b.position_m], checks);
        check_apart("sensorPosition", "sensors", [a.sensor_position_m, b.sensor_position_m], checks);
        let axial = || checks.of("X.", |checks| MagnetsOf::checked(self.axial_gap_m, [0.0; 2], checks));
        let axial = (N > ACROSS).then(axial);
        SpindleOf { config: *self, geometry: self.geometry(), bearings, axial }
    }

    /// Refuses a position that is not on the shaft.
    pub(crate) fn check_position(&self, name: impl Into<Cow<'static, str>>, at_m: f64, checks: &mut Checks) {
        let [begin_m, end_m] = self.extent_m;
        checks.require(
            // Where the shaft itself has been refused, any finite position is accepted.
            at_m.is_finite() && !(begin_m < end_m && (at_m < begin_m || at_m > end_m)),
            name,
            format_args!("{at_m} m"),
            format!("a position on the shaft, from shaft.begin = {begin_m} m to shaft.end = {end_m} m"),
        );
    }
}

fn check_apart(name: &str, what: &str, [a_m, b_m]: [f64; 2], checks: &mut Checks) {
    checks.require(
        (a_m - b_m).abs() >= SHORTEST_DISTANCE_M || !(a_m.is_finite() && b_m.is_finite()),
        format!("B.{name}"),
        format_args!("{b_m} m"),
        format!("a position at least {SHORTEST_DISTANCE_M} m from A.{name} = {a_m} m, so that the {what} support or see a tilt"),
    );
}

/// A spindle with validated geometry.
#[derive(Clone, Debug, PartialEq)]
pub struct SpindleOf<const N: usize, const M: usize, const K: usize> {
    config: SpindleGeometryOf<f64, M>,
    geometry: Geometry<f64, N, K>,
    bearings: [MagnetsOf<2, M>; 2],
    axial: Option<MagnetsOf<1, 2>>,
}

/// That with three magnets in each radial bearing, and an axial one.
pub type Spindle = SpindleOf<5, 3, 8>;

impl<const N: usize, const M: usize, const K: usize> SpindleOf<N, M, K> {
    /// A spindle.
    ///
    /// # Errors
    /// Positions, gaps, angles and inertia that are refused, by their names in the interface.
    pub fn new(config: SpindleGeometryOf<f64, M>) -> Result<Self, Vec<Invalid>> {
        let mut checks = Checks::default();
        let spindle = config.checked(&mut checks);
        checks.finish()?;
        Ok(spindle)
    }

    /// The configuration.
    pub fn config(&self) -> &SpindleGeometryOf<f64, M> {
        &self.config
    }

    /// Gaps and directions of all magnets.
    pub fn geometry(&self) -> &Geometry<f64, N, K> {
        &self.geometry
    }

    /// The magnets of A and of B, each in its own plane: for the allocation of forces.
    pub fn bearings(&self) -> &[MagnetsOf<2, M>; 2] {
        &self.bearings
    }

    /// The axial magnets, if there are any: for the allocation of forces.
    pub fn axial(&self) -> Option<&MagnetsOf<1, 2>> {
        self.axial.as_ref()
    }

    /// `(m, m, m, J_t, J_t)`, in kg and kg·m².
    pub fn inertia(&self) -> [f64; N] {
        self.config.shaft.inertia()
    }

    /// The coordinates `H⁻¹ r`, in m and rad, for readings r in m.
    pub fn coordinates(&self, reading_m: [f64; N]) -> [f64; N] {
        let at_m = self.config.radial().map(|bearing| bearing.sensor_position_m);
        let radial_m = [0, 1].map(|b| [reading_m[2 * b], reading_m[2 * b + 1]]);
        shaft::through(reading_m[N - 1], at_m, radial_m)
    }
}
