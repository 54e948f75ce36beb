//! `FlatnessController`: reference, tracking law, perturbation observer, force allocation and current loop.

use std::fmt;

use fmu_export::log::{Digits, Log, Topic};
use fmu_export::unit::{AMPERE, HERTZ, METRE, NEWTON, ONE, RADIAN_PER_SECOND, SECOND, VOLT};
use fmu_export::variable::{Access, Enumeration, Row, Table, Value};
use fmu_export::{Info, Invalid, Resources, SampledModel, StepError, place};
use serde::{Deserialize, Serialize};

use super::common::{Axes, DRIVE, LAMBDA, coils, geometry, info, lambda0, sample_time, sampled, together};
use crate::bearing::coil::Drive;
use crate::control::controller::{
    Controller, ControllerConfig, ControllerInput, ControllerOutput, ControllerState, UpdateMode,
};
use crate::control::reference::{HARMONICS, MOST_LOBES, Shape};

/// When the estimated force constants are taken over.
pub static UPDATE_MODE: Enumeration = Enumeration::new(
    "UpdateMode",
    "When the controller takes over the estimated force constants",
    &[
        ("never", "The first guess is used throughout"),
        ("atTime", "Once, at the simulation time update.time or as soon after it as the estimate is valid"),
        ("whenValid", "At every sample at which the estimate is valid"),
    ],
);

/// Shape of the reference trajectory.
pub static SHAPE: Enumeration = Enumeration::new(
    "ReferenceShape",
    "Shape of the reference trajectory",
    &[
        ("ellipse", "Ellipse with the semi-axes rY and rZ"),
        ("lobes", "Ellipse with lobes"),
        ("external", "The inputs Yref and Zref"),
        ("fourier", "A Fourier series with centre, cosY, sinY, cosZ, sinZ"),
    ],
);

/// The values of all variables of the controller.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Values {
    config: ControllerConfig,
    update_mode: i32,
    shape: i32,
    drive: i32,
    lobes: i32,
    input: ControllerInput,
    output: ControllerOutput,
}

impl Values {
    /// The configuration, converted from the types of the interface.
    fn config(&self) -> (ControllerConfig, Vec<Invalid>) {
        use UpdateMode::{AtTime, Never, WhenValid};
        let mut config = self.config.clone();
        config.reference.omega_rad_s = self.input.omega_rad_s;
        let mut findings = Vec::new();
        let modes = [Never, AtTime, WhenValid];
        UPDATE_MODE.choose("update.mode", self.update_mode, modes, &mut config.update, &mut findings);
        let shapes = [Shape::Ellipse, Shape::Lobes, Shape::External, Shape::Fourier];
        SHAPE.choose("reference.shape", self.shape, shapes, &mut config.reference.shape, &mut findings);
        let drives = [Drive::Current, Drive::Voltage];
        DRIVE.choose("drive", self.drive, drives, &mut config.coil.drive, &mut findings);
        match u32::try_from(self.lobes) {
            Ok(lobes) => config.reference.lobes = lobes,
            Err(_) => findings.push(Invalid::new("reference.lobes", self.lobes, "a whole number, 0 or above")),
        }
        (config, findings)
    }
}

/// The configuration of a controller with the given values by index, and start values elsewhere.
///
/// # Errors
/// Every value that is not an item of its enumeration.
pub fn configuration(settings: &[(usize, Value)]) -> Result<ControllerConfig, Vec<Invalid>> {
    let (config, findings) = Table::new(table()).values(settings).config();
    together(findings, Ok(config))
}

fn table() -> Vec<Row<Values>> {
    let mut rows: Vec<Row<Values>> = Vec::new();

    rows.extend(geometry(place!(Values.config.m_kg), place!(Values.config.gap_m), place!(Values.config.alpha_rad[k])));
    rows.push(sample_time(place!(Values.config.step_s)));
    rows.extend(coils(
        place!(Values.drive),
        place!(Values.config.coil.resistance_ohm),
        place!(Values.config.coil.leakage_h),
        place!(Values.config.coil.limit_v),
    ));
    rows.extend(lambda0(place!(Values.config.lambda0_nm2_a2[k])));
    rows.push(
        Row::real("F0", place!(Values.config.f0_n), NEWTON, 20.0)
            .fixed()
            .min(0.0)
            .nominal(10.0)
            .description("Smallest force commanded of each magnet, without modulation"),
    );
    rows.push(
        Row::real("F0.modulation", place!(Values.config.modulation), ONE, 0.0)
            .tunable()
            .min(0.0)
            .max(1.0)
            .description("Amplitude of the modulation of the smallest force, as a fraction of F0"),
    );
    rows.push(
        Row::real("F0.modulationFrequency", place!(Values.config.modulation_hz), HERTZ, 110.0)
            .tunable()
            .min(0.0)
            .nominal(100.0)
            .description("Frequency of the modulation, at most half the sample rate"),
    );
    rows.extend(bandwidth(
        place!(Values.config.tracking_rad_s),
        place!(Values.config.observer_rad_s),
        place!(Values.config.current_rad_s),
        [1000.0, 4000.0, 5000.0],
    ));
    rows.extend(update(place!(Values.update_mode), place!(Values.config.update_time_s)));
    rows.push(
        Row::choice("reference.shape", place!(Values.shape), &SHAPE, 1)
            .fixed()
            .description("Shape of the reference trajectory"),
    );
    rows.push(
        Row::real("reference.rY", place!(Values.config.reference.r_y_m), METRE, 30e-6)
            .fixed()
            .nominal(1e-5)
            .description("Semi-axis of the reference trajectory along y"),
    );
    rows.push(
        Row::real("reference.rZ", place!(Values.config.reference.r_z_m), METRE, 70e-6)
            .fixed()
            .nominal(1e-5)
            .description("Semi-axis of the reference trajectory along z"),
    );
    rows.push(
        Row::integer("reference.lobes", place!(Values.lobes), 3)
            .fixed()
            .min(0.0)
            .max(f64::from(MOST_LOBES))
            .description("Number of lobes with shape = lobes"),
    );
    rows.push(
        Row::real("reference.lobeAmplitude", place!(Values.config.reference.lobe_amplitude_m), METRE, 0.0)
            .fixed()
            .nominal(1e-5)
            .description("Amplitude of the lobes with shape = lobes"),
    );
    rows.extend(contour());
    rows.extend(transition(
        place!(Values.config.reference.start_s),
        place!(Values.config.reference.ramp_s),
        place!(Values.config.reference.lift_s),
    ));
    rows.push(
        Row::real("bandwidth.reference", place!(Values.config.reference.bandwidth_rad_s), RADIAN_PER_SECOND, 4000.0)
            .fixed()
            .min(0.0)
            .nominal(1000.0)
            .display_unit("Hz")
            .description("Poles of the observer that differentiates an external reference"),
    );
    rows.push(
        Row::real("reference.omega", place!(Values.input.omega_rad_s), RADIAN_PER_SECOND, 100.0 * std::f64::consts::PI)
            .tunable()
            .nominal(100.0)
            .description("Angular velocity on the reference trajectory"),
    );

    rows.extend(
        Row::named_reals(["Ym", "Zm"], place!(Values.input.position_m[k]), METRE, [0.0; 2])
            .map(|row| row.input().nominal(1e-5).along("Measured position of the rotor along {axis}")),
    );
    rows.extend(
        Row::reals("im", place!(Values.input.current_a[k]), AMPERE, [0.0; 3])
            .map(|row| row.input().description("Measured current of magnet {k}, with drive = voltage")),
    );
    rows.extend(
        Row::reals("lambdaHat", place!(Values.input.lambda_hat_nm2_a2[k]), LAMBDA, [0.0; 3])
            .map(|row| row.input().nominal(1e-6).description("Estimated force constant of magnet {k}")),
    );
    rows.push(
        Row::boolean("lambdaValid", place!(Values.input.lambda_valid), false)
            .input()
            .description("Whether lambdaHat may be used"),
    );
    rows.extend(
        Row::named_reals(["Yref", "Zref"], place!(Values.input.reference_m[k]), METRE, [0.0; 2])
            .map(|row| row.input().nominal(1e-5).along("Reference along {axis} with reference.shape = external")),
    );

    rows.extend(Row::reals("i", place!(Values.output.current_a[k]), AMPERE, [0.0; 3]).map(|row| {
        row.sampled_output()
            .description("Current reference of magnet {k}; with drive = voltage for the end of the sample")
    }));
    rows.extend(Row::reals("u", place!(Values.output.voltage_v[k]), VOLT, [0.0; 3]).map(|row| {
        row.sampled_output().nominal(10.0).description("Voltage command of amplifier {k}, with drive = voltage")
    }));
    rows.extend(Row::named_reals(["eY", "eZ"], place!(Values.output.tracking_error_m[k]), METRE, [0.0; 2]).map(
        |row| {
            row.sampled_output()
                .nominal(1e-6)
                .along("Tracking error at the last sample, measured minus reference, along {axis}")
        },
    ));
    rows.extend(
        Row::named_reals(["pYHat", "pZHat"], place!(Values.output.perturbation_n[k]), NEWTON, [0.0; 2])
            .map(|row| row.sampled_output().nominal(10.0).along("Observed perturbation force along {axis}")),
    );
    rows.extend(Row::reals("lambdaUsed", place!(Values.output.lambda_used_nm2_a2[k]), LAMBDA, [0.0; 3]).map(|row| {
        row.sampled_output().nominal(1e-6).description("Force constant of magnet {k} that the controller uses")
    }));
    rows.extend(
        Row::named_reals(["FYdes", "FZdes"], place!(Values.output.force_n[k]), NEWTON, [0.0; 2])
            .map(|row| row.sampled_output().nominal(10.0).along("Force command along {axis}")),
    );
    rows.extend(
        Row::named_reals(["reference.Y", "reference.Z"], place!(Values.output.reference_ahead_m[k]), METRE, [0.0; 2])
            .map(|row| row.sampled_output().nominal(1e-5).along("Reference at the next sample along {axis}")),
    );
    rows.push(
        Row::boolean("saturated", place!(Values.output.saturated), false)
            .sampled_output()
            .description("Whether the predicted gap was below its limit, so that the currents are those for the limit"),
    );
    rows.push(
        Row::boolean("limited", place!(Values.output.limited), false)
            .sampled_output()
            .description("Whether a voltage command is at the limit, with drive = voltage"),
    );
    rows
}

/// Poles of tracking error, perturbation observer and current loop.
pub(super) fn bandwidth<D>(
    tracking: Access<D, f64>,
    observer: Access<D, f64>,
    current: Access<D, f64>,
    starts: [f64; 3],
) -> impl Iterator<Item = Row<D>> {
    [
        Row::real("bandwidth.tracking", tracking, RADIAN_PER_SECOND, starts[0])
            .description("Poles of the tracking error"),
        Row::real("bandwidth.observer", observer, RADIAN_PER_SECOND, starts[1])
            .description("Poles of the perturbation observer"),
        Row::real("bandwidth.current", current, RADIAN_PER_SECOND, starts[2])
            .description("Pole of the current error with drive = voltage"),
    ]
    .into_iter()
    .map(|row| row.fixed().min(0.0).nominal(1000.0).display_unit("Hz"))
}

/// When the estimated force constants are taken over.
pub(super) fn update<D>(mode: Access<D, i32>, time: Access<D, f64>) -> impl Iterator<Item = Row<D>> {
    [
        Row::choice("update.mode", mode, &UPDATE_MODE, 2)
            .fixed()
            .description("When the estimated force constants are taken over"),
        Row::real("update.time", time, SECOND, 0.2).fixed().display_unit("ms").description(
            "Time of the update with update.mode = atTime: absolute simulation time, not time since the start",
        ),
    ]
    .into_iter()
}

/// How the rotor is brought onto the reference trajectory.
pub(super) fn transition<D>(
    start: Access<D, f64>,
    ramp: Access<D, f64>,
    lift: Access<D, f64>,
) -> impl Iterator<Item = Row<D>> {
    [
        Row::real("reference.startTime", start, SECOND, 0.0).description(
            "Time after the first sample at which the reference trajectory begins to grow out of the centre",
        ),
        Row::real("reference.rampTime", ramp, SECOND, 0.0)
            .description("Time in which the reference trajectory grows to its full size; 0 for a step"),
        Row::real("reference.liftTime", lift, SECOND, 0.0).description(
            "Time in which the rotor is brought from its first measured position to the centre; 0 for none",
        ),
    ]
    .into_iter()
    .map(|row| row.fixed().min(0.0).nominal(0.1).display_unit("ms"))
}

/// Logs that force constants have been replaced.
pub(super) fn log_update<const K: usize>(log: &mut dyn Log, instant_s: f64, used: &[f64; K], now: &[f64; K]) {
    let (at_s, used, now) = (Digits::<9>(instant_s), List(used), List(now));
    log.message(
        Topic::Event,
        format_args!("at {at_s} s the force constants {used} N.m2/A2 are replaced by {now} N.m2/A2"),
    );
}

/// Numbers with six digits, for messages.
struct List<'a>(&'a [f64]);

impl fmt::Display for List<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (k, value) in self.0.iter().enumerate() {
            write!(f, "{}{}", if k == 0 { "(" } else { ", " }, Digits::<6>(*value))?;
        }
        write!(f, ")")
    }
}

/// The reference trajectory as a Fourier series.
fn contour() -> Vec<Row<Values>> {
    let mut rows = Vec::new();
    rows.extend(
        Row::named_reals(
            ["reference.centreY", "reference.centreZ"],
            place!(Values.config.reference.contour.centre_m[k]),
            METRE,
            [0.0; 2],
        )
        .map(|row| row.along("Mean of the reference trajectory along {axis} with shape = fourier")),
    );
    let cos_y = place!(Values.config.reference.contour.cos_y_m[k]);
    let sin_y = place!(Values.config.reference.contour.sin_y_m[k]);
    let cos_z = place!(Values.config.reference.contour.cos_z_m[k]);
    let sin_z = place!(Values.config.reference.contour.sin_z_m[k]);
    let none = [0.0; HARMONICS];
    rows.extend(
        Row::reals("reference.cosY", cos_y, METRE, none).map(|row| {
            row.description("Cosine of harmonic {k} of the reference trajectory along y with shape = fourier")
        }),
    );
    rows.extend(
        Row::reals("reference.sinY", sin_y, METRE, none).map(|row| {
            row.description("Sine of harmonic {k} of the reference trajectory along y with shape = fourier")
        }),
    );
    rows.extend(
        Row::reals("reference.cosZ", cos_z, METRE, none).map(|row| {
            row.description("Cosine of harmonic {k} of the reference trajectory along z with shape = fourier")
        }),
    );
    rows.extend(
        Row::reals("reference.sinZ", sin_z, METRE, none).map(|row| {
            row.description("Sine of harmonic {k} of the reference trajectory along z with shape = fourier")
        }),
    );
    rows.into_iter().map(|row| row.fixed().nominal(1e-5)).collect()
}

/// The controller.
#[derive(Clone)]
pub struct FlatnessController(Controller);

impl SampledModel for FlatnessController {
    const INFO: Info = info(
        "FlatnessController",
        "Flatness-based tracking controller with perturbation observer for a three-phase magnetic bearing",
    );
    type Values = Values;
    type State = ControllerState;

    fn table() -> Vec<Row<Values>> {
        sampled(table())
    }

    fn new(values: &Values, _: &Resources) -> Result<Self, Vec<Invalid>> {
        let (config, findings) = values.config();
        together(findings, Controller::new(config)).map(Self)
    }

    fn period_s(&self) -> f64 {
        self.0.config().step_s
    }

    fn start(&self, values: &mut Values, start_s: f64) -> ControllerState {
        values.output = self.0.output_at_start();
        self.0.start(start_s)
    }

    fn sample(
        &self,
        state: &mut ControllerState,
        values: &mut Values,
        instant_s: f64,
        log: &mut dyn Log,
    ) -> Result<(), StepError> {
        let used = values.output.lambda_used_nm2_a2;
        values.output = self.0.sample(state, &values.input).map_err(StepError::of)?;
        let now = values.output.lambda_used_nm2_a2;
        if used != now && self.0.config().update == UpdateMode::AtTime && log.wants(Topic::Event) {
            log_update(log, instant_s, &used, &now);
        }
        Ok(())
    }

    fn retune(&mut self, _: &mut ControllerState, values: &Values, _: &Resources) -> Result<(), Vec<Invalid>> {
        together(Vec::new(), self.0.retune(values.config.modulation, values.config.modulation_hz))
    }

    fn accepts(&self, state: &ControllerState) -> Result<(), String> {
        self.0.accepts(state).then_some(()).ok_or_else(|| "the state is not one that this controller can have".into())
    }
}
