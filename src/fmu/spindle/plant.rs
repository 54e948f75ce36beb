//! `MagneticSpindle`: a rigid rotor in two radial magnetic bearings and an axial one, with coils, two-plane unbalance, loads, backup
//! bearings and sensors.

use fmu_export::unit::{
    AMPERE, METRE, METRE_PER_SECOND, METRE_PER_SECOND2, NEWTON, NEWTON_METRE, ONE, RADIAN, RADIAN_PER_SECOND,
    RADIAN_PER_SECOND2, Unit, VOLT, WEBER,
};
use fmu_export::variable::Dependency::{Constant, Fixed};
use fmu_export::variable::{Row, Value};
use fmu_export::{Info, Invalid, place};

use super::common::{HasGeometry, MEASURED, OfMagnet, geometry, of_coordinates, of_magnets};
use crate::bearing::coil::CoilConfig;
use crate::bearing::scalar::Scalar;
use crate::bearing::shaft::COORDINATES;
use crate::bearing::spindle::{BEARINGS, MAGNETS, SpindleGeometry, bearing_of};
use crate::fmu::common::{KILOGRAM_METRE, LAMBDA, coils, info};
use crate::fmu::plants::{
    self, ModelledRotor, OMEGA_RAD_S, PlantModel, encoder, friction, rotation, sampling, saturation, sensor_errors,
    touchdown,
};
use crate::invalid;
use crate::plant::spindle::{AtBearings, SpindleConfig, SpindleInput, SpindlePlant};
use crate::plant::{Equations, Motion, SensorConfig};

/// The plant.
pub type MagneticSpindle = PlantModel<SpindleConfig, COORDINATES, MAGNETS>;

/// The values of all variables of the plant.
type Values = plants::Values<SpindleConfig, COORDINATES, MAGNETS>;

impl HasGeometry for Values {
    fn geometry(&self) -> &SpindleGeometry {
        &self.config.geometry
    }

    fn geometry_mut(&mut self) -> &mut SpindleGeometry {
        &mut self.config.geometry
    }
}

/// Configuration and inputs of a plant with the given values by index, and start values elsewhere.
///
/// # Errors
/// Every value that is not an item of its enumeration.
pub fn configuration(settings: &[(usize, Value)]) -> Result<(SpindleConfig, SpindleInput), Vec<Invalid>> {
    plants::configuration(settings)
}

impl ModelledRotor<COORDINATES, MAGNETS> for SpindleConfig {
    const INFO: Info = info(
        "MagneticSpindle",
        "Rigid rotor in two radial magnetic bearings and an axial one, with two-plane unbalance, loads and sensors",
    );
    type Details = AtBearings;

    fn table() -> Vec<Row<Values>> {
        table()
    }

    fn sensor_mut(&mut self) -> &mut SensorConfig<COORDINATES, MAGNETS> {
        &mut self.sensor
    }

    fn coil_mut(&mut self) -> &mut CoilConfig {
        &mut self.coil
    }

    fn start_mut(&mut self) -> (&mut [f64; COORDINATES], &mut [f64; COORDINATES], &mut f64) {
        (&mut self.position_m, &mut self.velocity_m_s, &mut self.theta_rad)
    }

    fn retune(plant: &mut SpindlePlant, to: &Self) -> Result<(), Vec<invalid::Invalid>> {
        plant.retune(to.lambda_nm2_a2, to.unbalance_kgm, to.unbalance_phase_rad)
    }

    fn details<U: Scalar>(
        equations: &Equations<SpindleConfig<U>, COORDINATES, MAGNETS>,
        motion: &Motion<U, COORDINATES, MAGNETS>,
        omega_rad_s: U,
        contact: [bool; 3],
        force_n: [U; MAGNETS],
        of: impl Fn(U) -> f64,
    ) -> AtBearings {
        equations.at_bearings(motion, omega_rad_s, contact, force_n).map(of)
    }
}

/// The coordinates: name, unit, description, typical size.
const COORDINATE: [(&str, Unit, &str, f64); COORDINATES] = [
    ("X", METRE, "Position of the centre of gravity along the shaft", 1e-5),
    ("Y", METRE, "Position of the centre of gravity along y", 1e-5),
    ("Z", METRE, "Position of the centre of gravity along z", 1e-5),
    ("beta", RADIAN, "Tilt of the rotor about y", 1e-4),
    ("gamma", RADIAN, "Tilt of the rotor about z", 1e-4),
];

/// Names of coordinates, in their order, of their rates and of their accelerations.
const NAMES: [&str; COORDINATES] = ["X", "Y", "Z", "beta", "gamma"];
const RATES: [&str; COORDINATES] = ["vX", "vY", "vZ", "betaRate", "gammaRate"];
const ACCELERATIONS: [&str; COORDINATES] = ["aX", "aY", "aZ", "betaAcceleration", "gammaAcceleration"];

/// Names of the fluxes, in the order of the magnets.
const FLUXES: [&str; MAGNETS] =
    ["A.psi[1]", "A.psi[2]", "A.psi[3]", "B.psi[1]", "B.psi[2]", "B.psi[3]", "X.psi[1]", "X.psi[2]"];

/// The coordinates that move the rotor at the bearing of magnet k.
fn moving(k: usize) -> &'static [&'static str] {
    if bearing_of(k).0 == 2 { &NAMES[..1] } else { &NAMES[1..] }
}

/// The coordinates, by index, that the displacement along y or z depends on: y and γ, z and β.
const SIDEWAYS: [[usize; 2]; 2] = [[1, 4], [2, 3]];

fn table() -> Vec<Row<Values>> {
    let mut rows: Vec<Row<Values>> = Vec::new();

    rows.extend(geometry());
    rows.extend(coils(
        place!(Values.drive),
        place!(Values.config.coil.resistance_ohm),
        place!(Values.config.coil.leakage_h),
        place!(Values.config.coil.limit_v),
    ));
    rows.push(saturation(place!(Values.config.coil.saturation_wb)));
    rows.extend(start());
    rows.extend(backup());
    rows.extend(sensors());
    rows.extend(tunable());
    rows.extend(inputs());
    rows.extend(outputs());
    rows.extend(locals());
    rows
}

/// Initial motion and gravity.
fn start() -> Vec<Row<Values>> {
    let mut rows = Vec::new();
    let names = ["X0", "Y0", "Z0", "beta0", "gamma0"];
    rows.extend(of_coordinates(names, place!(Values.config.position_m[k]), [METRE, RADIAN]).map(|(n, row)| {
        let (_, _, what, nominal) = COORDINATE[n];
        row.fixed().nominal(nominal).description(format!("{what} at the start"))
    }));
    let names = ["vX0", "vY0", "vZ0", "betaRate0", "gammaRate0"];
    let units = [METRE_PER_SECOND, RADIAN_PER_SECOND];
    rows.extend(of_coordinates(names, place!(Values.config.velocity_m_s[k]), units).map(|(n, row)| {
        row.fixed()
            .nominal(if n < 3 { 1e-2 } else { 0.1 })
            .description(format!("Derivative of {} at the start", NAMES[n]))
    }));
    rows.push(
        Row::real("theta0", place!(Values.config.theta_rad), RADIAN, 0.0).fixed().description("Initial rotor angle"),
    );
    let names = ["gravity.X", "gravity.Y", "gravity.Z"];
    rows.extend(Row::named_reals(names, place!(Values.config.gravity_m_s2[k]), METRE_PER_SECOND2, [0.0; 3]).map(
        |row| {
            let axis = ["x, the shaft", "y", "z"][row.index()];
            row.fixed().nominal(10.0).description(format!("Acceleration of gravity along {axis}"))
        },
    ));
    rows
}

/// The backup bearings.
fn backup() -> Vec<Row<Values>> {
    let mut rows = Vec::new();
    let rings = [
        (
            "A.",
            "backup bearing at A",
            [
                place!(Values.config.touchdown.a.clearance_m),
                place!(Values.config.touchdown.a.stiffness_n_m),
                place!(Values.config.touchdown.a.damping_ns_m),
            ],
            [place!(Values.config.touchdown.a.friction), place!(Values.config.touchdown.a.radius_m)],
        ),
        (
            "B.",
            "backup bearing at B",
            [
                place!(Values.config.touchdown.b.clearance_m),
                place!(Values.config.touchdown.b.stiffness_n_m),
                place!(Values.config.touchdown.b.damping_ns_m),
            ],
            [place!(Values.config.touchdown.b.friction), place!(Values.config.touchdown.b.radius_m)],
        ),
    ];
    for (prefix, what, places, of_friction) in rings {
        rows.extend(touchdown(prefix, (what, "centre"), 2.5e-4, places));
        rows.extend(friction(prefix, what, of_friction));
    }
    rows.extend(touchdown(
        "X.",
        ("axial stop", "middle"),
        3e-4,
        [
            place!(Values.config.touchdown.x.clearance_m),
            place!(Values.config.touchdown.x.stiffness_n_m),
            place!(Values.config.touchdown.x.damping_ns_m),
        ],
    ));
    rows
}

/// Names of a variable of each reading, `A.nameY` to `X.name`.
fn of_readings(name: &str) -> [String; COORDINATES] {
    [("A", "Y"), ("A", "Z"), ("B", "Y"), ("B", "Z"), ("X", "")].map(|(bearing, axis)| format!("{bearing}.{name}{axis}"))
}

/// The sensors, and the step of the integration.
fn sensors() -> Vec<Row<Values>> {
    let mut rows = Vec::new();
    rows.extend(sensor_errors(
        "the measured positions",
        [place!(Values.config.sensor.position_noise_m), place!(Values.config.sensor.current_noise_a)],
        [place!(Values.config.sensor.position_resolution_m), place!(Values.config.sensor.current_resolution_a)],
    ));
    let offset = place!(Values.config.sensor.position_offset_m[k]);
    rows.extend(Row::named_reals(of_readings("sensor.offset"), offset, METRE, [0.0; COORDINATES]).map(|row| {
        let what = format!("Offset of {}: its reading with the rotor in the centre", MEASURED[row.index()]);
        row.fixed().nominal(1e-6).description(what)
    }));
    let gain = place!(Values.config.sensor.position_gain_error[k]);
    rows.extend(Row::named_reals(of_readings("sensor.gainError"), gain, ONE, [0.0; COORDINATES]).map(|row| {
        let what = format!("Relative gain error of {}", MEASURED[row.index()]);
        row.fixed().nominal(0.01).min(-1.0).description(what)
    }));
    let offset = place!(Values.config.sensor.current_offset_a[k]);
    rows.extend(Row::named_reals(of_magnets("sensor.currentOffset"), offset, AMPERE, [0.0; MAGNETS]).map(|row| {
        row.fixed().nominal(1e-2).of_magnet("Offset of the current sensor of {magnet}: its reading without current")
    }));
    let gain = place!(Values.config.sensor.current_gain_error[k]);
    rows.extend(Row::named_reals(of_magnets("sensor.currentGainError"), gain, ONE, [0.0; MAGNETS]).map(|row| {
        row.fixed().nominal(0.01).min(-1.0).of_magnet("Relative gain error of the current sensor of {magnet}")
    }));
    rows.extend(sampling(
        "the measured positions",
        [place!(Values.config.sensor.delay_s), place!(Values.config.sensor.step_s), place!(Values.config.max_step_s)],
        place!(Values.seed),
    ));
    rows
}

/// What may change during a run; the planes of the unbalance, which may not, stand beside it.
fn tunable() -> Vec<Row<Values>> {
    let mut rows = Vec::new();
    let lambda = [1.8e-6, 2.0e-6, 2.2e-6, 2.4e-6, 2.1e-6, 1.9e-6, 3.0e-6, 2.6e-6];
    rows.extend(
        Row::named_reals(of_magnets("lambda"), place!(Values.config.lambda_nm2_a2[k]), LAMBDA, lambda)
            .map(|row| row.tunable().min(0.0).nominal(1e-6).of_magnet("Force constant of {magnet}")),
    );
    let of_planes = |name: &str| [1, 2].map(|plane| format!("unbalance[{plane}].{name}"));
    let magnitude = place!(Values.config.unbalance_kgm[k]);
    rows.extend(Row::named_reals(of_planes("magnitude"), magnitude, KILOGRAM_METRE, [0.0; 2]).map(|row| {
        row.tunable().min(0.0).nominal(1e-4).description("Unbalance of the rotor in plane {k}, mass times eccentricity")
    }));
    let phase = place!(Values.config.unbalance_phase_rad[k]);
    rows.extend(Row::named_reals(of_planes("phase"), phase, RADIAN, [0.0; 2]).map(|row| {
        row.tunable().description("Angle of the unbalance in plane {k} from the mark on the rotor that theta refers to")
    }));
    let position = place!(Values.config.unbalance_position_m[k]);
    rows.extend(Row::named_reals(of_planes("position"), position, METRE, [-0.08, 0.10]).map(|row| {
        row.fixed().nominal(0.1).description("Position of plane {k} along the shaft, from the centre of gravity")
    }));
    rows.extend(
        Row::named_booleans(of_magnets("coil.open"), place!(Values.open[k]), [false; MAGNETS]).map(|row| {
            row.tunable().of_magnet("Whether the circuit of {magnet} is open, so that it carries no current")
        }),
    );
    rows
}

fn inputs() -> Vec<Row<Values>> {
    let mut rows = Vec::new();
    rows.extend(
        Row::named_reals(of_magnets("i"), place!(Values.input.current_a[k]), AMPERE, [0.0; MAGNETS])
            .map(|row| row.input().of_magnet("Current through {magnet}, held over the step, with drive = current")),
    );
    rows.extend(Row::named_reals(of_magnets("u"), place!(Values.input.voltage_v[k]), VOLT, [0.0; MAGNETS]).map(
        |row| row.input().nominal(10.0).of_magnet("Voltage command of the amplifier of {magnet}, with drive = voltage"),
    ));
    let load = place!(Values.input.perturbation_n[k]);
    rows.extend(of_coordinates(LOADS, load, [NEWTON, NEWTON_METRE]).map(|(n, row)| {
        row.input().description(
            [
                "Load on the rotor along the shaft",
                "Load on the rotor along y at the centre of gravity",
                "Load on the rotor along z at the centre of gravity",
                "Load moment on the rotor about y",
                "Load moment on the rotor about z",
            ][n],
        )
    }));
    rows.push(
        Row::real("omega", place!(Values.input.omega_rad_s), RADIAN_PER_SECOND, OMEGA_RAD_S)
            .input()
            .nominal(100.0)
            .description("Speed of the rotor, from y towards z"),
    );
    rows
}

/// The loads, in the order of the coordinates.
const LOADS: [&str; COORDINATES] = ["pX", "pY", "pZ", "MY", "MZ"];

fn outputs() -> Vec<Row<Values>> {
    let mut rows = Vec::new();
    rows.extend(of_coordinates(NAMES, place!(Values.position_m[k]), [METRE, RADIAN]).map(|(n, row)| {
        let (name, _, what, nominal) = COORDINATE[n];
        row.output()
            .nominal(nominal)
            .description(what)
            .state()
            .depends(Constant, [name])
            .starts_from([format!("{name}0")])
    }));
    let displaced = [
        place!(Values.details.a.y_m),
        place!(Values.details.a.z_m),
        place!(Values.details.b.y_m),
        place!(Values.details.b.z_m),
    ];
    let forces = [
        place!(Values.details.a.y_n),
        place!(Values.details.a.z_n),
        place!(Values.details.b.y_n),
        place!(Values.details.b.z_n),
    ];
    let pushes = [
        place!(Values.details.a.touchdown_y_n),
        place!(Values.details.a.touchdown_z_n),
        place!(Values.details.b.touchdown_y_n),
        place!(Values.details.b.touchdown_z_n),
    ];
    for (b, bearing) in ["A", "B"].into_iter().enumerate() {
        for (a, axis) in ["Y", "Z"].into_iter().enumerate() {
            let along = ["y", "z"][a];
            let magnets = of_magnets("i").into_iter().chain(of_magnets("psi")).filter(|name| name.starts_with(bearing));
            rows.push(
                Row::real(format!("{bearing}.{axis}"), displaced[2 * b + a], METRE, 0.0)
                    .output()
                    .nominal(1e-5)
                    .description(format!("Position of the shaft along {along} at the magnets of bearing {bearing}"))
                    .depends(Fixed, SIDEWAYS[a].map(|n| NAMES[n])),
            );
            rows.push(
                Row::real(format!("{bearing}.F{axis}"), forces[2 * b + a], NEWTON, 0.0)
                    .output()
                    .nominal(10.0)
                    .description(format!("Force of the magnets of bearing {bearing} along {along}"))
                    .depends_on(magnets)
                    .depends_on(moving(0).iter().copied()),
            );
            rows.push(
                Row::real(format!("{bearing}.touchdown.F{axis}"), pushes[2 * b + a], NEWTON, 0.0)
                    .output()
                    .nominal(1000.0)
                    .description(format!("Force of the backup bearing at {bearing} on the rotor along {along}"))
                    .depends_on(["omega"])
                    .depends_on(NAMES[1..].iter().chain(&RATES[1..]).copied()),
            );
        }
    }
    rows.push(
        Row::real("X.FX", place!(Values.details.axial_n), NEWTON, 0.0)
            .output()
            .nominal(10.0)
            .description("Force of the axial magnets along the shaft")
            .depends_on(["X.i[1]", "X.i[2]", "X.psi[1]", "X.psi[2]", "X"]),
    );
    rows.push(
        Row::real("X.touchdown.FX", place!(Values.details.axial_touchdown_n), NEWTON, 0.0)
            .output()
            .nominal(1000.0)
            .description("Force of the axial stop on the rotor along the shaft")
            .depends_on(["X", "vX"]),
    );
    rows.extend(
        Row::named_booleans(["A.contact", "B.contact", "X.contact"], place!(Values.contact[k]), [false; 3]).map(
            |row| {
                let b = row.index();
                let what = ["the backup bearing at A", "the backup bearing at B", "the axial stop"][b];
                let row = row.output().description(format!("Whether the rotor touches {what}"));
                let (coordinates, rates) = if b == 2 { (&NAMES[..1], &RATES[..1]) } else { (&NAMES[1..], &RATES[1..]) };
                row.depends_on(coordinates.iter().chain(rates).copied())
            },
        ),
    );
    let measured = place!(Values.measured_position_m[k]);
    rows.extend(Row::named_reals(MEASURED, measured, METRE, [0.0; COORDINATES]).map(|row| {
        let what = [
            "along y at the sensors of bearing A",
            "along z at the sensors of bearing A",
            "along y at the sensors of bearing B",
            "along z at the sensors of bearing B",
            "along the shaft",
        ][row.index()];
        row.sampled_output()
            .nominal(1e-5)
            .description(format!("Position {what} as read by the sensor at the last sample"))
            .starts_from_parameters()
    }));
    let measured = place!(Values.measured_current_a[k]);
    rows.extend(Row::named_reals(of_magnets("im"), measured, AMPERE, [0.0; MAGNETS]).map(|row| {
        row.sampled_output().starts_from_parameters().of_magnet(
            "Current through {magnet} as read by the sensor at the last sample; with drive = current the one held until then",
        )
    }));
    rows.extend(encoder(place!(Values.measured_theta_rad), place!(Values.measured_omega_rad_s)));
    let force = place!(Values.output.force_n[k]);
    rows.extend(Row::named_reals(of_magnets("F"), force, NEWTON, [0.0; MAGNETS]).enumerate().map(|(k, row)| {
        row.output()
            .nominal(10.0)
            .of_magnet("Force of {magnet} on the rotor")
            .depends_on(["i", "psi"].map(|name| of_magnets(name)[k].clone()))
            .depends_on(moving(k).iter().copied())
    }));
    let gap = place!(Values.output.gap_m[k]);
    rows.extend(Row::named_reals(of_magnets("gap"), gap, METRE, [0.0; MAGNETS]).enumerate().map(|(k, row)| {
        row.output()
            .nominal(1e-4)
            .display_unit("mm")
            .of_magnet("Air gap at {magnet}")
            .depends(Fixed, moving(k).iter().copied())
    }));
    let names = ["perturbation.X", "perturbation.Y", "perturbation.Z", "perturbation.MY", "perturbation.MZ"];
    let forces = place!(Values.output.perturbation_n[k]);
    rows.extend(of_coordinates(names, forces, [NEWTON, NEWTON_METRE]).map(|(n, row)| {
        let what = [
            "forces on the rotor along the shaft",
            "forces on the rotor along y",
            "forces on the rotor along z",
            "moments on the rotor about y",
            "moments on the rotor about z",
        ][n];
        let row = row
            .output()
            .nominal(if n < 3 { 10.0 } else { 1.0 })
            .description(format!("All {what} except those of magnets and backup bearings"))
            .depends(Constant, [LOADS[n]]);
        if n == 0 { row } else { row.depends_on(["omega", "rotor.theta"]) }
    }));
    rows
}

fn locals() -> Vec<Row<Values>> {
    let mut rows = Vec::new();
    rows.extend(Row::named_reals(FLUXES, place!(Values.output.linkage_wb[k]), WEBER, [0.0; MAGNETS]).map(|row| {
        let own_current = of_magnets("i")[row.index()].clone();
        row.local()
            .state()
            .starts_from_parameters()
            .starts_from([own_current])
            .nominal(1e-2)
            .of_magnet("Flux linked with the coil of {magnet}; a state with drive = voltage")
    }));
    rows.extend(
        Row::named_reals(of_magnets("coil.i"), place!(Values.output.current_a[k]), AMPERE, [0.0; MAGNETS])
            .map(|row| row.local().of_magnet("Current through the coil of {magnet}")),
    );
    let induced = place!(Values.output.induced_v[k]);
    rows.extend(Row::named_reals(of_magnets("coil.uInduced"), induced, VOLT, [0.0; MAGNETS]).enumerate().map(
        |(k, row)| {
            row.local()
                .nominal(10.0)
                .description(format!(
                    "Derivative of {}, u - R i with drive = voltage; 0 with drive = current, where it is no state",
                    FLUXES[k]
                ))
                .derivative_of(FLUXES[k])
                .depends_on(["u", "psi"].map(|name| of_magnets(name)[k].clone()))
                .depends_on(moving(k).iter().copied())
        },
    ));
    let units = [METRE_PER_SECOND, RADIAN_PER_SECOND];
    rows.extend(of_coordinates(RATES, place!(Values.velocity_m_s[k]), units).map(|(n, row)| {
        row.local()
            .nominal(if n < 3 { 1e-2 } else { 0.1 })
            .description(format!("Derivative of {}", NAMES[n]))
            .state()
            .derivative_of(NAMES[n])
            .depends(Constant, [RATES[n]])
            .starts_from([format!("{}0", RATES[n])])
    }));
    let units = [METRE_PER_SECOND2, RADIAN_PER_SECOND2];
    rows.extend(of_coordinates(ACCELERATIONS, place!(Values.output.acceleration_m_s2[k]), units).map(|(n, row)| {
        let row = row.local().description(format!("Derivative of {}", RATES[n])).derivative_of(RATES[n]);
        let row = row.depends(Fixed, [LOADS[n]]);
        let drives = ["i", "psi"].into_iter().flat_map(of_magnets);
        if n == 0 {
            let own = drives.filter(|name| name.starts_with(BEARINGS[2]));
            return row.depends_on(own).depends_on(["X", "vX"]);
        }
        let radial = drives.filter(|name| !name.starts_with(BEARINGS[2]));
        row.depends_on(radial)
            .depends_on(["omega", "rotor.theta"])
            .depends_on(NAMES[1..].iter().chain(&RATES[1..]).copied())
    }));
    rows.extend(rotation(place!(Values.theta_rad), place!(Values.omega_rad_s)));
    rows
}
