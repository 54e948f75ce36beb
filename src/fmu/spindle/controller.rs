//! `SpindleController`: reference, tracking law, perturbation observers, force allocation and current loop of a spindle.

use fmu_export::log::{Log, Topic};
use fmu_export::unit::{AMPERE, HERTZ, METRE, NEWTON, NEWTON_METRE, ONE, RADIAN, RADIAN_PER_SECOND, VOLT};
use fmu_export::variable::{Access, Row, Table, Value};
use fmu_export::{Info, Invalid, Resources, SampledModel, StepError, place};
use serde::{Deserialize, Serialize};

use super::common::{HasGeometry, MEASURED, OfMagnet, geometry, lambda0, of_magnets};
use crate::bearing::coil::Drive;
use crate::bearing::spindle::{BEARINGS, MAGNETS, READINGS, SpindleGeometry};
use crate::control::spindle::{
    SpindleController as Controller, SpindleControllerConfig, SpindleControllerInput, SpindleControllerOutput,
    SpindleControllerState,
};
use crate::control::tracking::UpdateMode;
use crate::fmu::common::{DRIVE, LAMBDA, coils, info, sample_time, sampled, together};
use crate::fmu::controller::{UPDATE_MODE, bandwidth, log_update, transition, update};

/// The values of all variables of the controller.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Values {
    config: SpindleControllerConfig,
    update_mode: i32,
    drive: i32,
    input: SpindleControllerInput,
    output: SpindleControllerOutput,
}

impl HasGeometry for Values {
    fn geometry(&self) -> &SpindleGeometry {
        &self.config.geometry
    }

    fn geometry_mut(&mut self) -> &mut SpindleGeometry {
        &mut self.config.geometry
    }
}

impl Values {
    /// The configuration, converted from the types of the interface.
    fn config(&self) -> (SpindleControllerConfig, Vec<Invalid>) {
        use UpdateMode::{AtTime, Never, WhenValid};
        let mut config = self.config.clone();
        config.path.omega_rad_s = self.input.omega_rad_s;
        let mut findings = Vec::new();
        let modes = [Never, AtTime, WhenValid];
        UPDATE_MODE.choose("update.mode", self.update_mode, modes, &mut config.law.update, &mut findings);
        let drives = [Drive::Current, Drive::Voltage];
        DRIVE.choose("drive", self.drive, drives, &mut config.law.coil.drive, &mut findings);
        (config, findings)
    }
}

/// The configuration of a controller with the given values by index, and start values elsewhere.
///
/// # Errors
/// Every value that is not an item of its enumeration.
pub fn configuration(settings: &[(usize, Value)]) -> Result<SpindleControllerConfig, Vec<Invalid>> {
    let (config, findings) = Table::new(table()).values(settings).config();
    together(findings, Ok(config))
}

/// Tracking errors and references, in the order of the readings.
const ERRORS: [&str; READINGS] = ["A.eY", "A.eZ", "B.eY", "B.eZ", "X.e"];
const REFERENCES: [&str; READINGS] =
    ["A.reference.Y", "A.reference.Z", "B.reference.Y", "B.reference.Z", "X.reference.X"];

fn table() -> Vec<Row<Values>> {
    let mut rows: Vec<Row<Values>> = Vec::new();

    rows.extend(geometry());
    rows.push(sample_time(place!(Values.config.law.step_s)));
    rows.extend(coils(
        place!(Values.drive),
        place!(Values.config.law.coil.resistance_ohm),
        place!(Values.config.law.coil.leakage_h),
        place!(Values.config.law.coil.limit_v),
    ));
    rows.extend(lambda0(place!(Values.config.law.lambda0_nm2_a2[k])));
    rows.extend(Row::named_reals(of_bearings("F0"), place!(Values.config.law.f0_n[k]), NEWTON, [15.0; 3]).map(|row| {
        row.fixed()
            .min(0.0)
            .nominal(10.0)
            .of_bearing("Smallest force commanded of each magnet of bearing {bearing}, without modulation")
    }));
    rows.push(
        Row::real("F0.modulation", place!(Values.config.law.modulation), ONE, 0.0)
            .tunable()
            .min(0.0)
            .max(1.0)
            .description("Amplitude of the modulation of the smallest forces, as a fraction of F0"),
    );
    let frequencies = place!(Values.config.law.modulation_hz[k]);
    rows.extend(Row::named_reals(of_bearings("F0.modulationFrequency"), frequencies, HERTZ, [110.0, 130.0, 90.0]).map(
        |row| {
            row.tunable()
                .min(0.0)
                .nominal(100.0)
                .of_bearing("Frequency of the modulation in bearing {bearing}, at most half the sample rate")
        },
    ));
    rows.extend(bandwidth(
        place!(Values.config.law.tracking_rad_s),
        place!(Values.config.law.observer_rad_s),
        place!(Values.config.law.current_rad_s),
        [1200.0, 4000.0, 5000.0],
    ));
    rows.extend(update(place!(Values.update_mode), place!(Values.config.law.update_time_s)));
    rows.extend(path(
        "A",
        place!(Values.config.path.a.r_y_m),
        place!(Values.config.path.a.r_z_m),
        place!(Values.config.path.a.phase_rad),
    ));
    rows.extend(path(
        "B",
        place!(Values.config.path.b.r_y_m),
        place!(Values.config.path.b.r_z_m),
        place!(Values.config.path.b.phase_rad),
    ));
    rows.push(
        Row::real("X.reference.amplitude", place!(Values.config.path.axial_amplitude_m), METRE, 0.0)
            .fixed()
            .min(0.0)
            .nominal(1e-5)
            .description("Amplitude of the axial reference, a sine"),
    );
    rows.push(
        Row::real("X.reference.frequency", place!(Values.config.path.axial_hz), HERTZ, 60.0)
            .fixed()
            .min(0.0)
            .nominal(100.0)
            .description("Frequency of the axial reference"),
    );
    rows.extend(transition(
        place!(Values.config.path.start_s),
        place!(Values.config.path.ramp_s),
        place!(Values.config.path.lift_s),
    ));
    rows.push(
        Row::real("reference.omega", place!(Values.input.omega_rad_s), RADIAN_PER_SECOND, 100.0 * std::f64::consts::PI)
            .tunable()
            .nominal(100.0)
            .description("Speed of the rotor: of the reference trajectory and of the gyroscopic moments"),
    );

    rows.extend(
        Row::named_reals(MEASURED, place!(Values.input.reading_m[k]), METRE, [0.0; READINGS])
            .map(|row| row.input().nominal(1e-5).at_bearing("Measured position of the rotor along {place}")),
    );
    let none = [0.0; MAGNETS];
    rows.extend(
        Row::named_reals(of_magnets("im"), place!(Values.input.current_a[k]), AMPERE, none)
            .map(|row| row.input().of_magnet("Measured current of {magnet}, with drive = voltage")),
    );
    rows.extend(
        Row::named_reals(of_magnets("lambdaHat"), place!(Values.input.lambda_hat_nm2_a2[k]), LAMBDA, none)
            .map(|row| row.input().nominal(1e-6).of_magnet("Estimated force constant of {magnet}")),
    );
    rows.push(
        Row::boolean("lambdaValid", place!(Values.input.lambda_valid), false)
            .input()
            .description("Whether lambdaHat of all magnets may be used"),
    );

    rows.extend(Row::named_reals(of_magnets("i"), place!(Values.output.current_a[k]), AMPERE, none).map(|row| {
        row.sampled_output().of_magnet("Current reference of {magnet}; with drive = voltage for the end of the sample")
    }));
    rows.extend(
        Row::named_reals(of_magnets("u"), place!(Values.output.voltage_v[k]), VOLT, none).map(|row| {
            row.sampled_output().nominal(10.0).of_magnet("Voltage command of {magnet}, with drive = voltage")
        }),
    );
    rows.extend(Row::named_reals(ERRORS, place!(Values.output.tracking_error_m[k]), METRE, [0.0; READINGS]).map(
        |row| {
            row.sampled_output()
                .nominal(1e-6)
                .at_bearing("Tracking error at the last sample, measured minus reference, along {place}")
        },
    ));
    rows.extend(
        Row::named_reals(["pXHat", "pYHat", "pZHat"], place!(Values.output.perturbation_n[k]), NEWTON, [0.0; 3])
            .map(|row| row.sampled_output().nominal(10.0).along_axis(0, "Observed perturbation force along {axis}")),
    );
    rows.extend(
        Row::named_reals(["MYHat", "MZHat"], place!(Values.output.perturbation_nm[k]), NEWTON_METRE, [0.0; 2])
            .map(|row| row.sampled_output().along_axis(1, "Observed perturbation moment about {axis}")),
    );
    let used = place!(Values.output.lambda_used_nm2_a2[k]);
    rows.extend(Row::named_reals(of_magnets("lambdaUsed"), used, LAMBDA, none).map(|row| {
        row.sampled_output().nominal(1e-6).of_magnet("Force constant of {magnet} that the controller uses")
    }));
    rows.extend(
        Row::named_reals(["FXdes", "FYdes", "FZdes"], place!(Values.output.force_n[k]), NEWTON, [0.0; 3])
            .map(|row| row.sampled_output().nominal(10.0).along_axis(0, "Force command along {axis}")),
    );
    rows.extend(
        Row::named_reals(["MYdes", "MZdes"], place!(Values.output.moment_nm[k]), NEWTON_METRE, [0.0; 2])
            .map(|row| row.sampled_output().along_axis(1, "Moment command about {axis}")),
    );
    let reference = place!(Values.output.reference_ahead_m[k]);
    rows.extend(
        Row::named_reals(REFERENCES, reference, METRE, [0.0; READINGS])
            .map(|row| row.sampled_output().nominal(1e-5).at_bearing("Reference at the next sample along {place}")),
    );
    rows.push(
        Row::boolean("saturated", place!(Values.output.saturated), false)
            .sampled_output()
            .description("Whether a predicted gap was below its limit, so that the currents are those for the limit"),
    );
    rows.push(
        Row::boolean("limited", place!(Values.output.limited), false)
            .sampled_output()
            .description("Whether a voltage command is at the limit, with drive = voltage"),
    );
    rows
}

/// Ellipse in a radial bearing.
fn path(
    bearing: &str,
    r_y: Access<Values, f64>,
    r_z: Access<Values, f64>,
    phase: Access<Values, f64>,
) -> impl Iterator<Item = Row<Values>> {
    [
        Row::real(format!("{bearing}.reference.rY"), r_y, METRE, 30e-6)
            .nominal(1e-5)
            .description(format!("Semi-axis of the reference trajectory along y at the magnets of bearing {bearing}")),
        Row::real(format!("{bearing}.reference.rZ"), r_z, METRE, 70e-6)
            .nominal(1e-5)
            .description(format!("Semi-axis of the reference trajectory along z at the magnets of bearing {bearing}")),
        Row::real(format!("{bearing}.reference.phase"), phase, RADIAN, 0.0)
            .description(format!("Phase of the reference trajectory in bearing {bearing}")),
    ]
    .into_iter()
    .map(Row::fixed)
}

/// Names of a variable of each bearing.
fn of_bearings(name: &str) -> [String; 3] {
    BEARINGS.map(|bearing| format!("{bearing}.{name}"))
}

/// Rows of bearings, of places in them, and of the axes of forces.
trait Described {
    /// Sets a description in which `{bearing}` stands for A, B or X, by the index of the row.
    fn of_bearing(self, description: &str) -> Self;
    /// Sets a description in which `{place}` stands for, say, `y at bearing A`, by the index of a reading.
    fn at_bearing(self, description: &str) -> Self;
    /// Sets a description in which `{axis}` stands for an axis, by the index of the row, from the first axis given.
    fn along_axis(self, first: usize, description: &str) -> Self;
}

impl Described for Row<Values> {
    fn of_bearing(self, description: &str) -> Self {
        let bearing = BEARINGS[self.index()];
        self.description(description.replace("{bearing}", bearing))
    }

    fn at_bearing(self, description: &str) -> Self {
        let places = ["y at bearing A", "z at bearing A", "y at bearing B", "z at bearing B", "x"];
        let place = places[self.index()];
        self.description(description.replace("{place}", place))
    }

    fn along_axis(self, first: usize, description: &str) -> Self {
        let axis = ["x", "y", "z"][first + self.index()];
        self.description(description.replace("{axis}", axis))
    }
}

/// The controller.
#[derive(Clone)]
pub struct SpindleController(Controller);

impl SampledModel for SpindleController {
    const INFO: Info = info(
        "SpindleController",
        "Flatness-based tracking controller with perturbation observers for a spindle in two radial bearings and an axial one",
    );
    type Values = Values;
    type State = SpindleControllerState;

    fn table() -> Vec<Row<Values>> {
        sampled(table())
    }

    fn new(values: &Values, _: &Resources) -> Result<Self, Vec<Invalid>> {
        let (config, findings) = values.config();
        together(findings, Controller::new(config)).map(Self)
    }

    fn period_s(&self) -> f64 {
        self.0.config().law.step_s
    }

    fn start(&self, values: &mut Values, start_s: f64) -> SpindleControllerState {
        values.output = self.0.output_at_start();
        self.0.start(start_s)
    }

    fn sample(
        &self,
        state: &mut SpindleControllerState,
        values: &mut Values,
        instant_s: f64,
        log: &mut dyn Log,
    ) -> Result<(), StepError> {
        let used = values.output.lambda_used_nm2_a2;
        values.output = self.0.sample(state, &values.input).map_err(StepError::of)?;
        let now = values.output.lambda_used_nm2_a2;
        if used != now && self.0.config().law.update == UpdateMode::AtTime && log.wants(Topic::Event) {
            log_update(log, instant_s, &used, &now);
        }
        Ok(())
    }

    fn retune(&mut self, _: &mut SpindleControllerState, values: &Values, _: &Resources) -> Result<(), Vec<Invalid>> {
        let law = &values.config.law;
        together(Vec::new(), self.0.retune(law.modulation, law.modulation_hz))
    }

    fn accepts(&self, state: &SpindleControllerState) -> Result<(), String> {
        self.0.accepts(state).then_some(()).ok_or_else(|| "the state is not one that this controller can have".into())
    }
}
