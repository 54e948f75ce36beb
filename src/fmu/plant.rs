//! `MagneticBearing`: the rotor, its three magnets and their coils, unbalance, perturbation forces, backup bearing and
//! sensors.

use fmu_export::unit::{
    AMPERE, METRE, METRE_PER_SECOND, METRE_PER_SECOND2, NEWTON, ONE, RADIAN, RADIAN_PER_SECOND, VOLT, WEBER,
};
use fmu_export::variable::Dependency::{Constant, Fixed};
use fmu_export::variable::{Row, Value, element};
use fmu_export::{Info, Invalid, place};

use super::common::{Axes, KILOGRAM_METRE, LAMBDA, coils, geometry, info, of_magnets};
use super::plants::{
    self, ModelledRotor, OMEGA_RAD_S, PlantModel, encoder, friction, rotation, sampling, saturation, sensor_errors,
    touchdown,
};
use crate::bearing::coil::CoilConfig;
use crate::bearing::scalar::Scalar;
use crate::invalid;
use crate::plant::{Equations, Motion, Plant, PlantConfig, PlantInput, SensorConfig};

/// Velocity r_Z ω at the start of the paper's reference ellipse, rounded as in the interface.
const START_VELOCITY_M_S: f64 = 0.021991148575128554;

/// The plant.
pub type MagneticBearing = PlantModel<PlantConfig, 2, 3>;

/// The values of all variables of the plant.
type Values = plants::Values<PlantConfig, 2, 3>;

/// Configuration and inputs of a plant with the given values by index, and start values elsewhere.
///
/// # Errors
/// Every value that is not an item of its enumeration.
pub fn configuration(settings: &[(usize, Value)]) -> Result<(PlantConfig, PlantInput), Vec<Invalid>> {
    plants::configuration(settings)
}

impl ModelledRotor<2, 3> for PlantConfig {
    const INFO: Info = info(
        "MagneticBearing",
        "Rotor in a three-phase radial magnetic bearing, with unbalance, perturbation forces and sensors",
    );
    type Details = ();

    fn table() -> Vec<Row<Values>> {
        table()
    }

    fn sensor_mut(&mut self) -> &mut SensorConfig {
        &mut self.sensor
    }

    fn coil_mut(&mut self) -> &mut CoilConfig {
        &mut self.coil
    }

    fn start_mut(&mut self) -> (&mut [f64; 2], &mut [f64; 2], &mut f64) {
        (&mut self.position_m, &mut self.velocity_m_s, &mut self.theta_rad)
    }

    fn retune(plant: &mut Plant, to: &Self) -> Result<(), Vec<invalid::Invalid>> {
        plant.retune(to.lambda_nm2_a2, to.unbalance_kgm, to.unbalance_phase_rad, to.harmonic.clone())
    }

    fn details<U: Scalar>(
        _: &Equations<PlantConfig<U>>,
        _: &Motion<U>,
        _: U,
        _: bool,
        _: [U; 3],
        _: impl Fn(U) -> f64,
    ) {
    }
}

fn table() -> Vec<Row<Values>> {
    let mut rows: Vec<Row<Values>> = Vec::new();

    rows.extend(geometry(place!(Values.config.m_kg), place!(Values.config.gap_m), place!(Values.config.alpha_rad[k])));
    rows.extend(
        Row::named_reals(["Y0", "Z0"], place!(Values.config.position_m[k]), METRE, [30e-6, 0.0])
            .map(|row| row.fixed().nominal(1e-5).along("Initial position of the rotor along {axis}")),
    );
    rows.extend(
        Row::named_reals(
            ["vY0", "vZ0"],
            place!(Values.config.velocity_m_s[k]),
            METRE_PER_SECOND,
            [0.0, START_VELOCITY_M_S],
        )
        .map(|row| row.fixed().nominal(1e-2).along("Initial velocity of the rotor along {axis}")),
    );
    rows.extend(coils(
        place!(Values.drive),
        place!(Values.config.coil.resistance_ohm),
        place!(Values.config.coil.leakage_h),
        place!(Values.config.coil.limit_v),
    ));
    rows.push(saturation(place!(Values.config.coil.saturation_wb)));
    rows.extend(
        Row::named_reals(
            ["gravity.Y", "gravity.Z"],
            place!(Values.config.gravity_m_s2[k]),
            METRE_PER_SECOND2,
            [0.0; 2],
        )
        .map(|row| row.fixed().nominal(10.0).along("Acceleration of gravity along {axis}")),
    );
    let ring = "backup bearing";
    rows.extend(touchdown(
        "",
        (ring, "centre"),
        2.5e-4,
        [
            place!(Values.config.touchdown.clearance_m),
            place!(Values.config.touchdown.stiffness_n_m),
            place!(Values.config.touchdown.damping_ns_m),
        ],
    ));
    rows.extend(friction(
        "",
        ring,
        [place!(Values.config.touchdown.friction), place!(Values.config.touchdown.radius_m)],
    ));
    rows.push(
        Row::real("theta0", place!(Values.config.theta_rad), RADIAN, 0.0).fixed().description("Initial rotor angle"),
    );

    rows.extend(sensor_errors(
        "Ym and Zm",
        [place!(Values.config.sensor.position_noise_m), place!(Values.config.sensor.current_noise_a)],
        [place!(Values.config.sensor.position_resolution_m), place!(Values.config.sensor.current_resolution_a)],
    ));
    rows.extend(
        Row::named_reals(
            ["sensor.offsetY", "sensor.offsetZ"],
            place!(Values.config.sensor.position_offset_m[k]),
            METRE,
            [0.0; 2],
        )
        .map(|row| {
            row.fixed()
                .nominal(1e-6)
                .along("Offset of the position sensor along {axis}: its reading with the rotor in the centre")
        }),
    );
    rows.extend(
        Row::named_reals(
            ["sensor.gainErrorY", "sensor.gainErrorZ"],
            place!(Values.config.sensor.position_gain_error[k]),
            ONE,
            [0.0; 2],
        )
        .map(|row| {
            row.fixed().nominal(0.01).min(-1.0).along("Relative gain error of the position sensor along {axis}")
        }),
    );
    rows.extend(
        Row::reals("sensor.currentOffset", place!(Values.config.sensor.current_offset_a[k]), AMPERE, [0.0; 3]).map(
            |row| {
                row.fixed()
                    .nominal(1e-2)
                    .description("Offset of the current sensor of magnet {k}: its reading without current")
            },
        ),
    );
    rows.extend(
        Row::reals("sensor.currentGainError", place!(Values.config.sensor.current_gain_error[k]), ONE, [0.0; 3]).map(
            |row| {
                row.fixed()
                    .nominal(0.01)
                    .min(-1.0)
                    .description("Relative gain error of the current sensor of magnet {k}")
            },
        ),
    );
    rows.extend(sampling(
        "Ym, Zm",
        [place!(Values.config.sensor.delay_s), place!(Values.config.sensor.step_s), place!(Values.config.max_step_s)],
        place!(Values.seed),
    ));

    rows.extend(
        Row::reals("lambda", place!(Values.config.lambda_nm2_a2[k]), LAMBDA, [1.8e-6, 2.0e-6, 2.2e-6])
            .map(|row| row.tunable().min(0.0).nominal(1e-6).description("Force constant of magnet {k}")),
    );
    rows.push(
        Row::real("unbalance.magnitude", place!(Values.config.unbalance_kgm), KILOGRAM_METRE, 0.0)
            .tunable()
            .min(0.0)
            .nominal(1e-4)
            .description("Unbalance of the rotor, mass times eccentricity"),
    );
    rows.push(
        Row::real("unbalance.phase", place!(Values.config.unbalance_phase_rad), RADIAN, 0.0)
            .tunable()
            .description("Angle of the unbalance from the mark on the rotor that theta refers to"),
    );
    rows.extend(
        Row::named_reals(
            ["perturbation.amplitudeY", "perturbation.amplitudeZ"],
            place!(Values.config.harmonic.amplitude_n[k]),
            NEWTON,
            [0.0; 2],
        )
        .map(|row| row.tunable().along("Amplitude of a harmonic perturbation force along {axis}")),
    );
    rows.push(
        Row::real("perturbation.omega", place!(Values.config.harmonic.omega_rad_s), RADIAN_PER_SECOND, OMEGA_RAD_S)
            .tunable()
            .min(0.0)
            .nominal(100.0)
            .display_unit("Hz")
            .description("Angular frequency of the harmonic perturbation force"),
    );
    rows.extend(
        Row::named_reals(
            ["perturbation.phaseY", "perturbation.phaseZ"],
            place!(Values.config.harmonic.phase_rad[k]),
            RADIAN,
            [0.0; 2],
        )
        .map(|row| {
            row.tunable().along("Phase at time 0 of the harmonic perturbation force along {axis}, which is a sine")
        }),
    );

    rows.extend(Row::booleans("coil.open", place!(Values.open[k]), [false; 3]).map(|row| {
        row.tunable().description("Whether the circuit of magnet {k} is open, so that it carries no current")
    }));

    rows.extend(
        Row::reals("i", place!(Values.input.current_a[k]), AMPERE, [0.0; 3])
            .map(|row| row.input().description("Current through magnet {k}, held over the step, with drive = current")),
    );
    rows.extend(
        Row::reals("u", place!(Values.input.voltage_v[k]), VOLT, [0.0; 3])
            .map(|row| row.input().nominal(10.0).description("Voltage command of amplifier {k}, with drive = voltage")),
    );
    rows.extend(
        Row::named_reals(["pY", "pZ"], place!(Values.input.perturbation_n[k]), NEWTON, [0.0; 2])
            .map(|row| row.input().along("Perturbation force on the rotor along {axis}")),
    );
    rows.push(
        Row::real("omega", place!(Values.input.omega_rad_s), RADIAN_PER_SECOND, OMEGA_RAD_S)
            .input()
            .nominal(100.0)
            .description("Speed of the rotor"),
    );

    rows.extend(Row::named_reals(AXES, place!(Values.position_m[k]), METRE, [0.0; 2]).zip(AXES).map(|(row, axis)| {
        row.output()
            .nominal(1e-5)
            .along("Position of the rotor along {axis}")
            .state()
            .depends(Constant, [axis])
            .starts_from([format!("{axis}0")])
    }));
    rows.extend(Row::named_reals(["Ym", "Zm"], place!(Values.measured_position_m[k]), METRE, [0.0; 2]).zip(AXES).map(
        |(row, axis)| {
            row.sampled_output()
                .nominal(1e-5)
                .along("Position along {axis} as read by the sensor at the last sample")
                .starts_from(["0", "sensor.offset", "sensor.gainError"].map(|name| match name {
                    "0" => format!("{axis}0"),
                    name => format!("{name}{axis}"),
                }))
                .starts_from(["sensor.positionNoise", "sensor.positionResolution", "sensor.seed"])
        },
    ));
    rows.extend(Row::reals("im", place!(Values.measured_current_a[k]), AMPERE, [0.0; 3]).enumerate().map(|(k, row)| {
        row.sampled_output()
            .description("Current through magnet {k} as read by the sensor at the last sample; with drive = current the one held until then")
            .starts_from(["sensor.currentNoise", "sensor.currentResolution", "sensor.seed"])
            .starts_from([element("sensor.currentOffset", k)])
    }));
    rows.extend(encoder(place!(Values.measured_theta_rad), place!(Values.measured_omega_rad_s)));
    rows.extend(Row::reals("F", place!(Values.output.force_n[k]), NEWTON, [0.0; 3]).enumerate().map(|(k, row)| {
        let own = ["lambda", "alpha", "i", "coil.open"].map(|name| element(name, k));
        row.output()
            .nominal(10.0)
            .description("Force of magnet {k} on the rotor")
            .depends_on([element("i", k), element("psi", k)])
            .depends_on(AXES)
            .starts_from(["s", "Y0", "Z0", "drive", "coil.fluxSaturation"])
            .starts_from(own)
    }));
    rows.extend(Row::named_reals(["FY", "FZ"], place!(Values.output.resultant_n[k]), NEWTON, [0.0; 2]).map(|row| {
        row.output()
            .nominal(10.0)
            .along("Force of all magnets on the rotor along {axis}")
            .depends_on(["i", "psi"].into_iter().flat_map(of_magnets))
            .depends_on(AXES)
            .starts_from(["s", "Y0", "Z0", "drive", "coil.fluxSaturation"])
            .starts_from(["alpha", "lambda", "i", "coil.open"].into_iter().flat_map(of_magnets))
    }));
    rows.extend(Row::reals("gap", place!(Values.output.gap_m[k]), METRE, [0.0; 3]).enumerate().map(|(k, row)| {
        row.output()
            .nominal(1e-4)
            .display_unit("mm")
            .description("Air gap at magnet {k}")
            .depends(Fixed, AXES)
            .starts_from(["s", "Y0", "Z0"])
            .starts_from([element("alpha", k)])
    }));
    rows.extend(
        Row::named_reals(
            ["perturbation.Y", "perturbation.Z"],
            place!(Values.output.perturbation_n[k]),
            NEWTON,
            [0.0; 2],
        )
        .enumerate()
        .map(|(axis, row)| {
            row.output()
                .nominal(10.0)
                .along("All forces on the rotor except those of magnets and backup bearing, along {axis}")
                .depends(Constant, [["pY", "pZ"][axis]])
                .depends_on(["omega", "rotor.theta"])
                .starts_from(acting_on(axis))
                .starts_from(["m", ["gravity.Y", "gravity.Z"][axis]])
        }),
    );
    rows.push(
        Row::boolean("touchdown.contact", place!(Values.contact), false)
            .output()
            .description("Whether the rotor touches the backup bearing")
            .depends_on(MOTION)
            .starts_from(TOUCHING),
    );
    rows.extend(
        Row::named_reals(["touchdown.FY", "touchdown.FZ"], place!(Values.output.contact_n[k]), NEWTON, [0.0; 2]).map(
            |row| {
                row.output()
                    .nominal(1000.0)
                    .along("Force of the backup bearing on the rotor along {axis}")
                    .depends_on(["omega"])
                    .depends_on(MOTION)
                    .starts_from(["omega", "touchdown.friction", "touchdown.radius"])
                    .starts_from(TOUCHING)
            },
        ),
    );
    rows.extend(Row::reals("psi", place!(Values.output.linkage_wb[k]), WEBER, [0.0; 3]).map(|row| {
        row.local().state().nominal(1e-2).description("Flux linked with coil {k}; a state with drive = voltage")
    }));
    rows.extend(
        Row::reals("coil.i", place!(Values.output.current_a[k]), AMPERE, [0.0; 3])
            .map(|row| row.local().description("Current through coil {k}")),
    );
    rows.extend(Row::reals("coil.uInduced", place!(Values.output.induced_v[k]), VOLT, [0.0; 3]).enumerate().map(
        |(k, row)| {
            row.local()
            .nominal(10.0)
            .description("Derivative of psi[{k}], u - R i with drive = voltage; 0 with drive = current, where psi is no state")
            .derivative_of(["psi[1]", "psi[2]", "psi[3]"][k])
            .depends_on(["u", "psi"].map(|name| element(name, k)))
            .depends_on(AXES)
        },
    ));
    rows.extend(
        Row::named_reals(["vY", "vZ"], place!(Values.velocity_m_s[k]), METRE_PER_SECOND, [0.0; 2]).zip(AXES).map(
            |(row, axis)| {
                let row = row.local().nominal(1e-2).along("Velocity of the rotor along {axis}").state();
                let own = row.variable.name.clone();
                row.derivative_of(axis).depends(Constant, [own.clone()]).starts_from([format!("{own}0")])
            },
        ),
    );
    rows.extend(
        Row::named_reals(["aY", "aZ"], place!(Values.output.acceleration_m_s2[k]), METRE_PER_SECOND2, [0.0; 2])
            .enumerate()
            .map(|(axis, row)| {
                row.local()
                    .along("Acceleration of the rotor along {axis}")
                    .derivative_of(["vY", "vZ"][axis])
                    .depends_on(["i", "psi"].into_iter().flat_map(of_magnets))
                    .depends(Fixed, [["pY", "pZ"][axis]])
                    .depends_on(["omega", "rotor.theta"])
                    .depends_on(MOTION)
            }),
    );
    rows.extend(rotation(place!(Values.theta_rad), place!(Values.omega_rad_s)));
    rows
}

/// The axes, by the names of the positions.
const AXES: [&str; 2] = ["Y", "Z"];

/// What the perturbation along an axis depends on at the start.
fn acting_on(axis: usize) -> [&'static str; 8] {
    let [p, amplitude, phase] = [
        ["pY", "perturbation.amplitudeY", "perturbation.phaseY"],
        ["pZ", "perturbation.amplitudeZ", "perturbation.phaseZ"],
    ][axis];
    [p, amplitude, phase, "perturbation.omega", "unbalance.magnitude", "unbalance.phase", "omega", "theta0"]
}

/// Position and velocity of the rotor.
const MOTION: [&str; 4] = ["Y", "Z", "vY", "vZ"];

/// What contact with the backup bearing depends on at the start.
const TOUCHING: [&str; 7] =
    ["Y0", "Z0", "vY0", "vZ0", "touchdown.clearance", "touchdown.stiffness", "touchdown.damping"];
