//! `FlatnessController`: reference, tracking law, perturbation observer, force allocation and current loop.

use std::sync::{Arc, LazyLock};

use serde::{Deserialize, Serialize};

use super::bearing::{DRIVE, coils, geometry, lambda0, sample_time, together};
use super::clock::Clock;
use super::course::Course;
use super::instance::{Fault, Kind, Slave, Step, all, instantiate, variables};
use super::log::{Digits, Log, Topic};
use super::unit::{AMPERE, HERTZ, LAMBDA, METRE, NEWTON, ONE, RADIAN_PER_SECOND, SECOND, VOLT};
use super::variable::{Enumeration, Row, Value, place, with};
use crate::model::Invalid;
use crate::model::coil::Drive;
use crate::model::controller::{
    Controller, ControllerConfig, ControllerInput, ControllerOutput, ControllerState, UpdateMode,
};
use crate::model::reference::{HARMONICS, Shape};

/// The controller as a sort of slave.
pub static KIND: Kind = Kind {
    name: "FlatnessController",
    description: "Flatness-based tracking controller with perturbation observer for a three-phase magnetic bearing",
    stop_s: 0.4,
    step_s: 1e-4,
    capabilities: Tracking::CAPABILITIES,
    shelf: &TABLE,
    variables: variables::<Tracking>,
    instantiate: instantiate::<Tracking>,
};

/// When the estimated force constants are taken over.
pub static UPDATE_MODE: Enumeration = Enumeration {
    name: "UpdateMode",
    description: "When the controller takes over the estimated force constants",
    items: &[
        ("never", "The first guess is kept"),
        ("atTime", "Once, at the simulation time update.time or as soon after it as the estimate is valid"),
        ("whenValid", "Always while the estimate is valid"),
    ],
    renamed: &[],
};

/// Shape of the path.
pub static SHAPE: Enumeration = Enumeration {
    name: "ReferenceShape",
    description: "Shape of the path that the rotor is to follow",
    items: &[
        ("ellipse", "Ellipse with the half axes rY and rZ"),
        ("lobes", "Ellipse with lobes"),
        ("external", "The inputs Yref and Zref"),
        ("fourier", "A Fourier series with centre, cosY, sinY, cosZ, sinZ"),
    ],
    renamed: &[],
};

static TABLE: LazyLock<Vec<Row<Values>>> = LazyLock::new(table);

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
    /// Brings into the configuration what the interface has in another form.
    fn complete(&mut self) -> Vec<Invalid> {
        use UpdateMode::{AtTime, Never, WhenValid};
        let mut findings = Vec::new();
        let modes = [Never, AtTime, WhenValid];
        UPDATE_MODE.choose("update.mode", self.update_mode, modes, &mut self.config.update, &mut findings);
        let shapes = [Shape::Ellipse, Shape::Lobes, Shape::External, Shape::Fourier];
        SHAPE.choose("reference.shape", self.shape, shapes, &mut self.config.reference.shape, &mut findings);
        let drives = [Drive::Current, Drive::Voltage];
        DRIVE.choose("drive", self.drive, drives, &mut self.config.coil.drive, &mut findings);
        match u32::try_from(self.lobes) {
            Ok(lobes) => self.config.reference.lobes = lobes,
            Err(_) => findings.push(Invalid {
                name: "reference.lobes".into(),
                value: self.lobes.to_string(),
                wanted: "a whole number, 0 or above".into(),
            }),
        }
        findings
    }
}

/// The configuration of a controller whose variables, by index, have the values given and else their start values.
///
/// # Errors
/// Every choice that cannot be accepted.
pub fn configuration(settings: &[(usize, Value)]) -> Result<ControllerConfig, Vec<Invalid>> {
    let mut values: Values = with(&TABLE, settings);
    values.config.reference.omega_rad_s = values.input.omega_rad_s;
    together(values.complete(), Ok(values.config))
}

fn table() -> Vec<Row<Values>> {
    let mut rows: Vec<Row<Values>> = Vec::new();

    rows.extend(geometry(place!(config.m_kg), place!(config.gap_m), place!(config.alpha_rad[k])));
    rows.push(sample_time(place!(config.step_s)));
    rows.extend(coils(
        place!(drive),
        place!(config.coil.resistance_ohm),
        place!(config.coil.leakage_h),
        place!(config.coil.limit_v),
    ));
    rows.extend(lambda0(place!(config.lambda0_nm2_a2[k])));
    rows.push(
        Row::real("F0", place!(config.f0_n), NEWTON, 20.0)
            .fixed()
            .min(0.0)
            .nominal(10.0)
            .says("Least force that each magnet is asked for, without modulation"),
    );
    rows.push(
        Row::real("F0.modulation", place!(config.modulation), ONE, 0.0)
            .tunable()
            .min(0.0)
            .max(1.0)
            .says("Amplitude of the modulation of the least force, as a part of F0"),
    );
    rows.push(
        Row::real("F0.modulationFrequency", place!(config.modulation_hz), HERTZ, 110.0)
            .tunable()
            .min(0.0)
            .nominal(100.0)
            .says("Frequency of that modulation, at most half the sample rate"),
    );
    rows.push(
        Row::real("bandwidth.tracking", place!(config.tracking_rad_s), RADIAN_PER_SECOND, 1000.0)
            .fixed()
            .min(0.0)
            .nominal(1000.0)
            .shown_in("Hz")
            .says("Poles of the tracking error"),
    );
    rows.push(
        Row::real("bandwidth.observer", place!(config.observer_rad_s), RADIAN_PER_SECOND, 4000.0)
            .fixed()
            .min(0.0)
            .nominal(1000.0)
            .shown_in("Hz")
            .says("Poles of the perturbation observer"),
    );
    rows.push(
        Row::real("bandwidth.current", place!(config.current_rad_s), RADIAN_PER_SECOND, 5000.0)
            .fixed()
            .min(0.0)
            .nominal(1000.0)
            .shown_in("Hz")
            .says("Pole of the currents' errors with drive = voltage"),
    );
    rows.push(
        Row::choice("update.mode", place!(update_mode), &UPDATE_MODE, 2)
            .fixed()
            .says("When the estimated force constants are taken over"),
    );
    rows.push(
        Row::real("update.time", place!(config.update_time_s), SECOND, 0.2)
            .fixed()
            .shown_in("ms")
            .says("Time of the update with update.mode = atTime: absolute simulation time, not time since the start"),
    );
    rows.push(
        Row::choice("reference.shape", place!(shape), &SHAPE, 1)
            .fixed()
            .says("Shape of the path that the rotor is to follow"),
    );
    rows.push(
        Row::real("reference.rY", place!(config.reference.r_y_m), METRE, 30e-6)
            .fixed()
            .nominal(1e-5)
            .says("Half axis of the path along y"),
    );
    rows.push(
        Row::real("reference.rZ", place!(config.reference.r_z_m), METRE, 70e-6)
            .fixed()
            .nominal(1e-5)
            .says("Half axis of the path along z"),
    );
    rows.push(
        Row::integer("reference.lobes", place!(lobes), 3).fixed().min(0.0).says("Number of lobes with shape = lobes"),
    );
    rows.push(
        Row::real("reference.lobeAmplitude", place!(config.reference.lobe_amplitude_m), METRE, 0.0)
            .fixed()
            .nominal(1e-5)
            .says("Amplitude of the lobes with shape = lobes"),
    );
    rows.extend(contour());
    rows.extend(
        [
            Row::real("reference.startTime", place!(config.reference.start_s), SECOND, 0.0)
                .says("When the path begins to grow out of the centre, from the first sample on"),
            Row::real("reference.rampTime", place!(config.reference.ramp_s), SECOND, 0.0)
                .says("How long the path takes to grow; 0 for the whole path at once"),
            Row::real("reference.liftTime", place!(config.reference.lift_s), SECOND, 0.0)
                .says("How long the rotor is taken from where it is first measured to the centre; 0 for not at all"),
        ]
        .map(|row| row.fixed().min(0.0).nominal(0.1).shown_in("ms")),
    );
    rows.push(
        Row::real("bandwidth.reference", place!(config.reference.bandwidth_rad_s), RADIAN_PER_SECOND, 4000.0)
            .fixed()
            .min(0.0)
            .nominal(1000.0)
            .shown_in("Hz")
            .says("Poles of the filter that takes derivatives of an external reference"),
    );
    rows.push(
        Row::real("reference.omega", place!(input.omega_rad_s), RADIAN_PER_SECOND, 100.0 * std::f64::consts::PI)
            .tunable()
            .nominal(100.0)
            .says("Angular velocity on the path"),
    );

    rows.extend(
        Row::named_reals(["Ym", "Zm"], place!(input.position_m[k]), METRE, [0.0; 2])
            .map(|row| row.input().nominal(1e-5).says("Measured position of the rotor along {axis}")),
    );
    rows.extend(
        Row::reals("im", place!(input.current_a[k]), AMPERE, [0.0; 3])
            .map(|row| row.input().says("Measured current of magnet {k}, with drive = voltage")),
    );
    rows.extend(
        Row::reals("lambdaHat", place!(input.lambda_hat_nm2_a2[k]), LAMBDA, [0.0; 3])
            .map(|row| row.input().nominal(1e-6).says("Estimated force constant of magnet {k}")),
    );
    rows.push(
        Row::boolean("lambdaValid", place!(input.lambda_valid), false).input().says("Whether lambdaHat may be used"),
    );
    rows.extend(
        Row::named_reals(["Yref", "Zref"], place!(input.reference_m[k]), METRE, [0.0; 2])
            .map(|row| row.input().nominal(1e-5).says("Path along {axis} with reference.shape = external")),
    );

    rows.extend(Row::reals("i", place!(output.current_a[k]), AMPERE, [0.0; 3]).map(|row| {
        row.sampled_output().says("Current that magnet {k} is to carry, with drive = voltage at the end of the sample")
    }));
    rows.extend(
        Row::reals("u", place!(output.voltage_v[k]), VOLT, [0.0; 3])
            .map(|row| row.sampled_output().nominal(10.0).says("Voltage asked of amplifier {k}, with drive = voltage")),
    );
    rows.extend(Row::named_reals(["eY", "eZ"], place!(output.tracking_error_m[k]), METRE, [0.0; 2]).map(|row| {
        row.sampled_output()
            .nominal(1e-6)
            .says("Tracking error at the last sample, measured less reference, along {axis}")
    }));
    rows.extend(
        Row::named_reals(["pYHat", "pZHat"], place!(output.perturbation_n[k]), NEWTON, [0.0; 2])
            .map(|row| row.sampled_output().nominal(10.0).says("Observed perturbation force along {axis}")),
    );
    rows.extend(
        Row::reals("lambdaUsed", place!(output.lambda_used_nm2_a2[k]), LAMBDA, [0.0; 3]).map(|row| {
            row.sampled_output().nominal(1e-6).says("Force constant of magnet {k} that the controller uses")
        }),
    );
    rows.extend(
        Row::named_reals(["FYdes", "FZdes"], place!(output.force_n[k]), NEWTON, [0.0; 2])
            .map(|row| row.sampled_output().nominal(10.0).says("Force asked of the magnets along {axis}")),
    );
    rows.extend(
        Row::named_reals(["reference.Y", "reference.Z"], place!(output.reference_ahead_m[k]), METRE, [0.0; 2])
            .map(|row| row.sampled_output().nominal(1e-5).says("Reference at the next sample, along {axis}")),
    );
    rows.push(
        Row::boolean("saturated", place!(output.saturated), false)
            .sampled_output()
            .says("Whether the gap predicted for the currents was too small to be believed"),
    );
    rows.push(
        Row::boolean("limited", place!(output.limited), false)
            .sampled_output()
            .says("Whether an amplifier is asked for its limit, with drive = voltage"),
    );
    rows
}

/// The path as a Fourier series.
fn contour() -> Vec<Row<Values>> {
    let mut rows = Vec::new();
    rows.extend(
        Row::named_reals(
            ["reference.centreY", "reference.centreZ"],
            place!(config.reference.contour.centre_m[k]),
            METRE,
            [0.0; 2],
        )
        .map(|row| row.says("Mean of the path along {axis} with shape = fourier")),
    );
    let cos_y = place!(config.reference.contour.cos_y_m[k]);
    let sin_y = place!(config.reference.contour.sin_y_m[k]);
    let cos_z = place!(config.reference.contour.cos_z_m[k]);
    let sin_z = place!(config.reference.contour.sin_z_m[k]);
    let none = [0.0; HARMONICS];
    rows.extend(
        Row::reals("reference.cosY", cos_y, METRE, none)
            .map(|row| row.says("Cosine of harmonic {k} of the path along y with shape = fourier")),
    );
    rows.extend(
        Row::reals("reference.sinY", sin_y, METRE, none)
            .map(|row| row.says("Sine of harmonic {k} of the path along y with shape = fourier")),
    );
    rows.extend(
        Row::reals("reference.cosZ", cos_z, METRE, none)
            .map(|row| row.says("Cosine of harmonic {k} of the path along z with shape = fourier")),
    );
    rows.extend(
        Row::reals("reference.sinZ", sin_z, METRE, none)
            .map(|row| row.says("Sine of harmonic {k} of the path along z with shape = fourier")),
    );
    rows.into_iter().map(|row| row.fixed().nominal(1e-5)).collect()
}

/// A run of the controller.
#[derive(Clone)]
pub struct Tracking {
    controller: Arc<Controller>,
    state: ControllerState,
    clock: Clock,
}

/// The controller that the values describe.
fn controller(values: &mut Values) -> Result<Arc<Controller>, Vec<Invalid>> {
    together(values.complete(), Controller::new(values.config.clone())).map(Arc::new)
}

impl Slave for Tracking {
    type Values = Values;
    type State = (ControllerState, Clock);

    fn table() -> &'static [Row<Values>] {
        &TABLE
    }

    fn start(values: &mut Values, start_s: f64) -> Result<Self, Vec<Invalid>> {
        values.config.reference.omega_rad_s = values.input.omega_rad_s;
        let controller = controller(values)?;
        let state = controller.start(start_s);
        values.output = controller.output_at_start();
        Ok(Self { clock: Clock::new(start_s, values.config.step_s), controller, state })
    }

    fn state(&self) -> (ControllerState, Clock) {
        (self.state.clone(), self.clock)
    }

    fn resume(
        values: &mut Values,
        (state, clock): (ControllerState, Clock),
        time_s: Option<f64>,
    ) -> Result<Self, String> {
        let controller = controller(values).map_err(|findings| all(&findings))?;
        if !controller.accepts(&state) {
            return Err("the numbers of the state are not such as occur".into());
        }
        if time_s.is_some_and(|time_s| !clock.suits(values.config.step_s, time_s)) {
            return Err("the samples taken do not belong to the time".into());
        }
        Ok(Self { controller, state, clock })
    }

    fn grain_s(&self) -> f64 {
        self.controller.config().step_s
    }

    fn retune(&mut self, values: &Values) -> Result<(), Vec<Invalid>> {
        let (modulation, modulation_hz) = (values.config.modulation, values.config.modulation_hz);
        let config = self.controller.config();
        if (config.modulation, config.modulation_hz) == (modulation, modulation_hz) {
            return Ok(());
        }
        // Snapshots of the run keep the modulation that they have.
        Arc::make_mut(&mut self.controller).retune(modulation, modulation_hz)
    }

    fn step(
        &mut self,
        values: &mut Values,
        step: Step,
        inputs: &Course<Values>,
        log: &mut dyn Log,
    ) -> Result<(), Fault> {
        while let Some(instant_s) = self.clock.next_before(step.end_s()) {
            inputs.put(values, instant_s);
            let used = values.output.lambda_used_nm2_a2;
            values.output = self.controller.sample(&mut self.state, &values.input).map_err(Fault::of)?;
            let now = values.output.lambda_used_nm2_a2;
            if used != now && values.config.update == UpdateMode::AtTime && log.wants(Topic::Event) {
                let [a, b, c] = used.map(Digits::<6>);
                let [x, y, z] = now.map(Digits::<6>);
                let at_s = Digits::<9>(instant_s);
                log.say(
                    Topic::Event,
                    format_args!(
                        "at {at_s} s the force constants ({a}, {b}, {c}) N.m2/A2 are replaced by ({x}, {y}, {z}) N.m2/A2"
                    ),
                );
            }
        }
        Ok(())
    }
}
