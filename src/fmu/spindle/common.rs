//! Rows shared by the models of a spindle.

use std::f64::consts::{FRAC_PI_3, PI};

use fmu_export::unit::{KILOGRAM, KILOGRAM_METRE2, METRE, RADIAN, Unit};
use fmu_export::variable::{Access, Row, element};

use crate::bearing::shaft::COORDINATES;
use crate::bearing::spindle::{BEARINGS, MAGNETS, READINGS, SpindleGeometry, bearing_of};
use crate::variables::LAMBDA;

/// Measured positions, in the order of the equations.
pub(in crate::fmu) const MEASURED: [&str; READINGS] = ["A.Ym", "A.Zm", "B.Ym", "B.Zm", "Xm"];

/// Values that contain the geometry of a spindle.
pub(in crate::fmu) trait HasGeometry {
    /// The geometry.
    fn geometry(&self) -> &SpindleGeometry;
    /// The geometry, to be changed.
    fn geometry_mut(&mut self) -> &mut SpindleGeometry;
}

/// [`Access`] to a field of the geometry, as `place!` for other fields.
macro_rules! of_geometry {
    ($($field:ident).+) => {
        Access {
            get: |values, _| HasGeometry::geometry(values).$($field).+,
            set: |values, _, value| HasGeometry::geometry_mut(values).$($field).+ = value,
        }
    };
    ($($field:ident).+ [k]) => {
        Access {
            get: |values, k| HasGeometry::geometry(values).$($field).+[k],
            set: |values, k, value| HasGeometry::geometry_mut(values).$($field).+[k] = value,
        }
    };
}

/// Inertia, positions, gaps and angles, with the values of [`SpindleGeometry::default`].
pub(in crate::fmu) fn geometry<D: HasGeometry>() -> impl Iterator<Item = Row<D>> {
    let mut rows = vec![
        Row::real("m", of_geometry!(shaft.m_kg), KILOGRAM, 12.0).min(0.0).description("Mass of the rotor"),
        Row::real("Jt", of_geometry!(shaft.transverse_kgm2), KILOGRAM_METRE2, 0.16)
            .min(0.0)
            .nominal(0.1)
            .description("Moment of inertia of the rotor about an axis across the shaft through the centre of gravity"),
        Row::real("Jp", of_geometry!(shaft.polar_kgm2), KILOGRAM_METRE2, 0.02)
            .min(0.0)
            .nominal(0.1)
            .description("Moment of inertia of the rotor about its axis, at most 2 Jt"),
    ];
    rows.extend(Row::named_reals(["shaft.begin", "shaft.end"], of_geometry!(extent_m[k]), METRE, [-0.2, 0.2]).map(
        |row| {
            let which = ["Begin", "End"][row.index()];
            row.nominal(0.1).description(format!("{which} of the shaft, from the centre of gravity"))
        },
    ));
    let bearings = [
        (
            "A",
            [of_geometry!(a.position_m), of_geometry!(a.sensor_position_m), of_geometry!(a.gap_m)],
            of_geometry!(a.alpha_rad[k]),
            [-0.12, -0.10],
        ),
        (
            "B",
            [of_geometry!(b.position_m), of_geometry!(b.sensor_position_m), of_geometry!(b.gap_m)],
            of_geometry!(b.alpha_rad[k]),
            [0.15, 0.13],
        ),
    ];
    for (name, [position, sensor, gap], alpha, [position_m, sensor_m]) in bearings {
        rows.push(Row::real(format!("{name}.position"), position, METRE, position_m).nominal(0.1).description(
            format!("Position of the magnets of bearing {name} along the shaft, from the centre of gravity"),
        ));
        rows.push(Row::real(format!("{name}.sensorPosition"), sensor, METRE, sensor_m).nominal(0.1).description(
            format!("Position of the sensors of bearing {name} along the shaft, from the centre of gravity"),
        ));
        rows.push(
            Row::real(format!("{name}.s"), gap, METRE, 5e-4)
                .min(0.0)
                .nominal(1e-4)
                .display_unit("mm")
                .description(format!("Nominal air gap of bearing {name}")),
        );
        let starts = [PI, -FRAC_PI_3, FRAC_PI_3];
        rows.extend(Row::reals(&format!("{name}.alpha"), alpha, RADIAN, starts).map(|row| {
            row.description(format!(
                "Angle of magnet {{k}} of bearing {name}; its direction is (sin alpha, cos alpha) in the y-z plane"
            ))
        }));
    }
    rows.push(
        Row::real("X.s", of_geometry!(axial_gap_m), METRE, 6e-4)
            .min(0.0)
            .nominal(1e-4)
            .display_unit("mm")
            .description("Nominal air gap of the axial magnets"),
    );
    rows.into_iter().map(Row::fixed)
}

/// The names of a variable of each magnet, `A.name[1]` to `X.name[2]`; the index of a row with such a name is that of the magnet
/// in the equations.
pub(in crate::fmu) fn of_magnets(name: &str) -> [String; MAGNETS] {
    std::array::from_fn(|k| {
        let (bearing, magnet) = bearing_of(k);
        element(&format!("{}.{name}", BEARINGS[bearing]), magnet)
    })
}

/// Rows of magnets.
pub(in crate::fmu) trait OfMagnet {
    /// Sets a description in which `{magnet}` stands for, say, `magnet 2 of bearing A`, by the index of the row.
    fn of_magnet(self, description: &str) -> Self;
}

impl<D> OfMagnet for Row<D> {
    fn of_magnet(self, description: &str) -> Self {
        let (bearing, magnet) = bearing_of(self.index());
        let magnet = format!("magnet {} of bearing {}", magnet + 1, BEARINGS[bearing]);
        self.description(description.replace("{magnet}", &magnet))
    }
}

/// First guess of the force constants.
pub(in crate::fmu) fn lambda0<D>(lambda0: Access<D, f64>) -> impl Iterator<Item = Row<D>> {
    Row::named_reals(of_magnets("lambda0"), lambda0, LAMBDA, [4e-6; MAGNETS])
        .map(|row| row.fixed().min(0.0).nominal(1e-6).of_magnet("First guess of the force constant of {magnet}"))
}

/// The rows of all coordinates: a value, a rate or an acceleration.
pub(in crate::fmu) fn of_coordinates<D>(
    names: [&'static str; COORDINATES],
    place: Access<D, f64>,
    units: [Unit; 2],
) -> impl Iterator<Item = (usize, Row<D>)> {
    let rows = Row::named_reals(names, place, units[0], [0.0; COORDINATES]).zip(Row::named_reals(
        names,
        place,
        units[1],
        [0.0; COORDINATES],
    ));
    rows.enumerate().map(|(n, (length, angle))| (n, if n < 3 { length } else { angle }))
}
