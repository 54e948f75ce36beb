//! The estimator of a spindle: two radial bearings, an axial one, two planes of unbalance.
//!
//! A radial magnet does not pull along the shaft, and an axial one not across it: the axial motion and the radial one with its tilts are two
//! machines, each with its own filter and sums. The coordinates of each are what its position sensors read, `r = H q`: in them the sensors
//! are independent and all numbers are lengths. With the acceleration `H M⁻¹ f` by a generalised force f, and directions `H⁻ᵀ d`, the
//! equations are those of the planar rotor.

use libm::sqrt;
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use super::config::stiffness_std;
use super::innovations::{Machine, Sample, Square, WhiteningFilter};
use super::prediction_error::{PredictionError, PredictionErrorState};
use super::readings::{Readings, Taken};
use super::{Hold, Tolerance, Verdict, models, polar};
use crate::bearing::magnet::Geometry;
use crate::bearing::shaft::{COORDINATES, generalised};
use crate::bearing::spindle::{MAGNETS, READINGS, SHORTEST_DISTANCE_M, Spindle, SpindleGeometry, bearing_of};
use crate::invalid::{Checks, Invalid};
use crate::machine::Machine as Names;
use crate::plant::spindle::of_planes;
use crate::variables::unit::{
    AMPERE, KILOGRAM_METRE2, METRE, NEWTON, NEWTON_METRE, NEWTON_PER_AMPERE, NEWTON_PER_METRE, ONE, RADIAN,
    RADIAN_PER_SECOND, SECOND,
};
use crate::variables::{KILOGRAM_METRE, LAMBDA, OMEGA_RAD_S, Variables, is_finite, numbers};

/// Planes of unbalance.
const PLANES: usize = 2;

/// Radial bearings, each with a backward force.
const RADIAL: usize = 2;

/// The first backward force and the first load among the radial unknowns, and their number.
const BACKWARD: usize = 6 + 2 * PLANES;
const LOADS: usize = BACKWARD + 2 * RADIAL;
const UNKNOWNS: usize = LOADS + 4;

/// Parameters of the radial machine with a tolerance: gap, six angles, J_t, J_p, positions of magnets, of sensors, of unbalance.
const PARAMETERS: usize = 15;

/// Readings, magnets, unknowns and tolerances of the two machines.
type Radial = PredictionError<4, 6, UNKNOWNS, { PARAMETERS + 2 * 4 + 6 }>;
type RadialState = PredictionErrorState<4, 6, UNKNOWNS, { PARAMETERS + 2 * 4 + 6 }>;
type Axial = PredictionError<1, 2, 3, 5>;
type AxialState = PredictionErrorState<1, 2, 3, 5>;

/// Standard deviations of what is known of a spindle alone; 0 means exactly known.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
pub struct ShaftTolerance {
    /// Standard deviation of Jt; 0 means exactly known
    #[parameter(name = "Jt", unit = KILOGRAM_METRE2, min = 0.0, nominal = 1e-3)]
    pub transverse_kgm2: f64,
    /// Standard deviation of Jp; 0 means exactly known
    #[parameter(name = "Jp", unit = KILOGRAM_METRE2, min = 0.0, nominal = 1e-3)]
    pub polar_kgm2: f64,
    /// Standard deviation of the positions of A and B along the shaft; 0 means exactly known
    #[parameter(name = "position", unit = METRE, min = 0.0, nominal = 1e-3)]
    pub position_m: f64,
    /// Standard deviation of the positions of their sensors along the shaft; 0 means exactly known
    #[parameter(name = "sensorPosition", unit = METRE, min = 0.0, nominal = 1e-3)]
    pub sensor_position_m: f64,
    /// Standard deviation of the positions of the planes of unbalance; 0 means exactly known
    #[parameter(name = "unbalancePosition", unit = METRE, min = 0.0, nominal = 1e-3)]
    pub unbalance_position_m: f64,
}

/// Parameters of the estimator, before they are checked.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Names)]
pub struct SpindleEstimatorConfig {
    /// Shaft and bearings.
    #[nested(prefix = "", context = ())]
    pub geometry: SpindleGeometry,
    /// Sample time; samples are taken at the start time plus whole multiples of it
    #[parameter(name = "Ts", unit = SECOND, min = 0.0, nominal = 1e-4, display_unit = "µs")]
    pub step_s: f64,
    /// First guess of the force constant of {magnet}
    #[parameter(names = context.of_magnets("lambda0"), unit = LAMBDA, min = 0.0, nominal = 1e-6)]
    pub lambda0_nm2_a2: [f64; MAGNETS],
    /// What a sample of a current stands for
    #[parameter]
    pub hold: Hold,
    /// Whether to identify an unbalance in two planes as well
    #[parameter(name = "identify.unbalance")]
    pub identify_unbalance: bool,
    /// Position of plane {k} of the unbalance along the shaft, from the centre of gravity
    #[parameter(names = of_planes("position"), unit = METRE, nominal = 0.1)]
    pub unbalance_position_m: [f64; PLANES],
    /// Standard deviation of the noise of {read}; 0 to estimate it from the data
    #[parameter(name = "sensor.positionNoise", unit = METRE, min = 0.0, nominal = 1e-7)]
    pub position_noise_m: f64,
    /// Standard deviation of the noise of im; 0 to estimate it from the data
    #[parameter(name = "sensor.currentNoise", unit = AMPERE, min = 0.0, nominal = 1e-2)]
    pub current_noise_a: f64,
    /// How well the rest is known: that of the mass is one of all inertia, that of the gap one of all gaps, each in proportion.
    #[nested(context = ())]
    pub tolerance: Tolerance,
    /// The same of the shaft.
    #[nested(prefix = "tolerance.", context = ())]
    pub shaft_tolerance: ShaftTolerance,
}

impl Default for SpindleEstimatorConfig {
    fn default() -> Self {
        Self {
            geometry: SpindleGeometry::default(),
            step_s: 1.0e-4,
            lambda0_nm2_a2: [4.0e-6; MAGNETS],
            hold: Hold::default(),
            identify_unbalance: true,
            unbalance_position_m: [-0.08, 0.10],
            position_noise_m: 0.0,
            current_noise_a: 0.0,
            tolerance: Tolerance::default(),
            shaft_tolerance: ShaftTolerance::default(),
        }
    }
}

/// One sample of the measurements, all of the same instant.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Names)]
pub struct SpindleEstimatorInput {
    /// Readings of position.
    #[input(
        names = context.measured(), unit = METRE, nominal = 1e-5,
        description = format!("Measured position along {}", PLACES[index])
    )]
    pub reading_m: [f64; READINGS],
    /// Measured current through {magnet}
    ///
    /// [`Hold`] says what it stands for.
    #[input(names = context.of_magnets("im"), unit = AMPERE)]
    pub current_a: [f64; MAGNETS],
    /// Rotor angle, wrapped or unwrapped; needed to identify an unbalance
    #[input(name = "theta", unit = RADIAN)]
    pub theta_rad: f64,
    /// Speed of the rotor
    #[input(name = "omega", unit = RADIAN_PER_SECOND, start = OMEGA_RAD_S, nominal = 100.0)]
    pub omega_rad_s: f64,
    /// Whether to use the samples
    #[input(start = true)]
    pub enable: bool,
    /// Whether the rotor touches a backup bearing, so that samples cannot be used
    #[input]
    pub contact: bool,
    /// A rising edge restarts the estimation
    ///
    /// With this sample as the first.
    #[input]
    pub reset: bool,
}

/// Where the positions are measured.
const PLACES: [&str; READINGS] = [
    "y at the sensors of A",
    "z at the sensors of A",
    "y at the sensors of B",
    "z at the sensors of B",
    "x at the sensors of X",
];

/// The estimates after a sample, as those of [`EstimatorOutput`](super::EstimatorOutput). All numbers are finite at all times.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Names)]
pub struct SpindleEstimatorOutput {
    /// Estimated force constant of {magnet}
    ///
    /// λ_0 at first, then the last valid estimate of the radial and of the axial magnets.
    #[output(names = context.of_magnets("lambdaHat"), discrete, unit = LAMBDA, nominal = 1e-6)]
    pub lambda_hat: [f64; MAGNETS],
    /// Force constant of {magnet} from the last revolution alone
    #[output(names = context.of_magnets("lambdaRaw"), discrete, unit = LAMBDA, nominal = 1e-6)]
    pub lambda_raw: [f64; MAGNETS],
    /// Standard deviation of the force constant of {magnet} due to noise alone
    #[output(names = context.of_magnets("lambdaStd"), discrete, unit = LAMBDA, min = 0.0, nominal = 1e-8)]
    pub lambda_std: [f64; MAGNETS],
    /// Standard deviation of the force constant of {magnet} due to noise and tolerances
    #[output(names = context.of_magnets("lambdaStdTotal"), discrete, unit = LAMBDA, min = 0.0, nominal = 1e-8)]
    pub lambda_std_total: [f64; MAGNETS],
    /// Force per current of {magnet}, mean over the last revolution
    #[output(names = context.of_magnets("ki"), discrete, unit = NEWTON_PER_AMPERE, nominal = 10.0)]
    pub ki: [f64; MAGNETS],
    /// Negative stiffness of {magnet}, mean over the last revolution
    #[output(names = context.of_magnets("ks"), discrete, unit = NEWTON_PER_METRE, nominal = 1e5)]
    pub ks: [f64; MAGNETS],
    /// Standard deviation of ki of {magnet} due to noise and tolerances
    #[output(names = context.of_magnets("kiStd"), discrete, unit = NEWTON_PER_AMPERE, nominal = 0.1)]
    pub ki_std: [f64; MAGNETS],
    /// Standard deviation of ks of {magnet} due to noise and tolerances
    #[output(names = context.of_magnets("ksStd"), discrete, unit = NEWTON_PER_METRE, nominal = 1e3)]
    pub ks_std: [f64; MAGNETS],
    /// Of the radial and of the axial positions, 0 before it is estimated.
    #[output(
        names = ["noise.position", "X.noise.position"], discrete, unit = METRE, min = 0.0, nominal = 1e-7,
        description = format!(
            "Standard deviation of the noise of {}, given or estimated", ["the radial positions", "Xm"][index]
        )
    )]
    pub position_noise_m: [f64; 2],
    /// Of the radial and of the axial currents, 0 before it is estimated.
    #[output(
        names = ["noise.current", "X.noise.current"], discrete, unit = AMPERE, min = 0.0, nominal = 1e-2,
        description = format!("Standard deviation of the noise of im of {}, given or estimated", ["A and B", "X"][index])
    )]
    pub current_noise_a: [f64; 2],
    /// Whether all estimates are valid; of those that are not, the last valid one is shown
    #[output(discrete)]
    pub valid: bool,
    /// Why the estimates are valid or not: of A and B, or, if they are valid, of X
    #[output(discrete)]
    pub verdict: Verdict,
    /// Why the estimate of the axial magnets is valid or not
    #[output(name = "X.verdict", discrete)]
    pub axial_verdict: Verdict,
    /// Condition number of the information matrix scaled to unit diagonal, the greater of the radial and of the axial one
    #[output(discrete, unit = ONE, min = 0.0, nominal = 10.0)]
    pub condition: f64,
    /// Normalised innovation squared, 1 if model and noise are correct, the greater of the radial and of the axial one
    #[output(discrete, unit = ONE, min = 0.0)]
    pub residual: f64,
    /// Static load and moments.
    #[output(
        names = ["pXHat", "pYHat", "pZHat", "MYHat", "MZHat"], discrete,
        unit = context.either(index, NEWTON, NEWTON_METRE), nominal = context.either(index, 10.0, 1.0),
        description = format!(
            "Static {} {}", context.either(index, "load along", "moment about"), ["x", "y", "z", "y", "z"][index]
        )
    )]
    pub load: [f64; COORDINATES],
    /// Identified unbalance in plane {k}, mass times eccentricity; 0 if none is identified
    #[output(names = of_planes("magnitude"), discrete, unit = KILOGRAM_METRE, min = 0.0, nominal = 1e-4)]
    pub unbalance_kg_m: [f64; PLANES],
    /// Identified angle of the unbalance in plane {k} from the mark on the rotor that theta refers to
    #[output(names = of_planes("phase"), discrete, unit = RADIAN)]
    pub unbalance_phase_rad: [f64; PLANES],
    /// Identified force at this bearing that turns against the rotor; 0 if there is none
    #[output(names = ["A.backwardForce.magnitude", "B.backwardForce.magnitude"], discrete, unit = NEWTON, min = 0.0)]
    pub backward_force_n: [f64; RADIAL],
    /// Identified phase phi of that force B (cos(theta + phi), -sin(theta + phi)) in the y-z plane
    #[output(names = ["A.backwardForce.phase", "B.backwardForce.phase"], discrete, unit = RADIAN)]
    pub backward_force_phase_rad: [f64; RADIAL],
}

/// All that changes with a sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SpindleEstimatorState {
    reset_was_high: bool,
    readings: Readings<READINGS, MAGNETS>,
    radial: Box<RadialState>,
    axial: Box<AxialState>,
    output: SpindleEstimatorOutput,
}

impl SpindleEstimatorState {
    /// The estimates after the last sample.
    #[must_use]
    pub fn output(&self) -> &SpindleEstimatorOutput {
        &self.output
    }
}

/// The estimator: a checked configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct SpindleEstimator {
    config: SpindleEstimatorConfig,
    spindle: Spindle,
    radial: Radial,
    axial: Axial,
}

impl SpindleEstimator {
    /// Checks the parameters.
    ///
    /// # Errors
    /// Every parameter that cannot be accepted, under its name in the interface: what [`Spindle::new`] refuses; a sample time or a first guess
    /// that is not positive; noise or a tolerance that is negative; planes of unbalance that are not on the shaft, or at the same place.
    pub fn new(config: SpindleEstimatorConfig) -> Result<Self, Vec<Invalid>> {
        let mut checks = Checks::default();
        let spindle = config.geometry.checked(&mut checks);
        checks.positive("Ts", config.step_s, "s");
        for (k, lambda0) in config.lambda0_nm2_a2.into_iter().enumerate() {
            let (bearing, magnet) = bearing_of(k);
            let name = format!("{}.lambda0[{}]", crate::bearing::spindle::BEARINGS[bearing], magnet + 1);
            checks.positive(name, lambda0, "N.m2/A2");
        }
        let [first_m, second_m] = config.unbalance_position_m;
        config.geometry.check_position("unbalance[1].position", first_m, &mut checks);
        config.geometry.check_position("unbalance[2].position", second_m, &mut checks);
        checks.require(
            (first_m - second_m).abs() >= SHORTEST_DISTANCE_M || !(first_m - second_m).is_finite(),
            "unbalance[2].position",
            format_args!("{second_m} m"),
            format!("a position at least {SHORTEST_DISTANCE_M} m from unbalance[1].position = {first_m} m"),
        );
        checks.not_negative("sensor.positionNoise", config.position_noise_m, "m");
        checks.not_negative("sensor.currentNoise", config.current_noise_a, "A");
        for (name, value, unit) in config.tolerance.listed() {
            checks.not_negative(name, value, unit);
        }
        config.shaft_tolerance.check(&config, &mut checks);
        checks.finish()?;
        let Some(radial) = radial(&config) else {
            return Err(vec![Invalid {
                name: "B.sensorPosition".into(),
                value: format!("{} m", config.geometry.b.sensor_position_m),
                wanted: "a position of the sensors that tells a tilt".into(),
            }]);
        };
        let axial = axial(&config);
        Ok(Self { config, spindle, radial, axial })
    }

    /// The configuration.
    #[must_use]
    pub fn config(&self) -> &SpindleEstimatorConfig {
        &self.config
    }

    /// A fresh state; stepping allocates nothing.
    #[must_use]
    pub fn start(&self) -> SpindleEstimatorState {
        let mut state = SpindleEstimatorState {
            reset_was_high: false,
            readings: Readings::start(),
            radial: Box::new(self.radial.start()),
            axial: Box::new(self.axial.start()),
            output: SpindleEstimatorOutput::default(),
        };
        self.report(&mut state, [Verdict::Collecting; 2]);
        state
    }

    /// Whether a state, for instance one read from a file, holds finite numbers alone.
    #[must_use]
    pub fn accepts(&self, state: &SpindleEstimatorState) -> bool {
        is_finite(state) && state.radial.has_shape() && state.axial.has_shape()
    }

    /// Takes in one sample; to be called once every T_s. As [`Estimator::sample`](super::Estimator::sample).
    pub fn sample(&self, state: &mut SpindleEstimatorState, input: &SpindleEstimatorInput) -> SpindleEstimatorOutput {
        if input.reset && !state.reset_was_high {
            *state = self.start();
        }
        state.reset_was_high = input.reset;
        let [radial, axial] = self.refused(state, input);
        let rotation = state.readings.rotation();
        let [a_y, a_z, b_y, b_z, x] = input.reading_m;
        let [a_1, a_2, a_3, b_1, b_2, b_3, x_1, x_2] = input.current_a;
        let verdicts = [
            self.radial.take(&mut state.radial, radial, || {
                Sample::new([a_y, a_z, b_y, b_z], [a_1, a_2, a_3, b_1, b_2, b_3], rotation)
            }),
            self.axial.take(&mut state.axial, axial, || Sample::new([x], [x_1, x_2], rotation)),
        ];
        self.report(state, verdicts);
        state.output.clone()
    }

    /// Why the radial and the axial part of a sample cannot be used, if so.
    fn refused(&self, state: &mut SpindleEstimatorState, input: &SpindleEstimatorInput) -> [Option<Verdict>; 2] {
        let coordinates = self.spindle.coordinates(input.reading_m);
        let in_gap = self.spindle.geometry().gaps(coordinates).iter().all(|gap_m| *gap_m > 0.0);
        let rotation = [input.theta_rad, input.omega_rad_s];
        match state.readings.take(input.reading_m, input.current_a, rotation, self.config.step_s, in_gap) {
            _ if !input.enable => [Some(Verdict::Disabled); 2],
            _ if input.contact => [Some(Verdict::Contact); 2],
            Taken::Usable { contradiction: true, .. } if self.config.identify_unbalance => [Some(Verdict::Speed); 2],
            Taken::Usable { stuck: [a_y, a_z, b_y, b_z, x], .. } => {
                [a_y || a_z || b_y || b_z, x].map(|stuck| stuck.then_some(Verdict::Stuck))
            }
            _ if state.readings.are_lost() => [Some(Verdict::BadSample); 2],
            Taken::Missing | Taken::Repeated => [state.radial.estimate.verdict, state.axial.estimate.verdict].map(Some),
        }
    }

    /// Writes both estimates into the output.
    fn report(&self, state: &mut SpindleEstimatorState, verdicts: [Verdict; 2]) {
        let (radial, axial, output) = (&state.radial.estimate, &state.axial.estimate, &mut state.output);
        let joined =
            |r: &SVector<f64, 6>, x: &SVector<f64, 2>| std::array::from_fn(|k| if k < 6 { r[k] } else { x[k - 6] });
        output.lambda_hat = joined(&radial.lambda(), &axial.lambda());
        output.lambda_raw = joined(&radial.lambda_raw, &axial.lambda_raw);
        let std = |n: usize| joined(&radial.variance[n].map(sqrt), &axial.variance[n].map(sqrt));
        (output.lambda_std, output.lambda_std_total) = (std(0), std(1));
        output.ki = joined(&radial.ki, &axial.ki);
        output.ks = joined(&radial.ks, &axial.ks);
        output.axial_verdict = verdicts[1];
        output.verdict = if verdicts[0] == Verdict::Valid { verdicts[1] } else { verdicts[0] };
        output.valid = output.verdict == Verdict::Valid;
        output.condition = radial.condition.max(axial.condition);
        output.residual = radial.residual.max(axial.residual);
        output.load = std::array::from_fn(|n| if n == 0 { axial.unknowns[2] } else { radial.unknowns[LOADS + n - 1] });
        if verdicts[0] == Verdict::Valid && self.config.identify_unbalance {
            for plane in 0..PLANES {
                let [along, across] = [radial.unknowns[6 + 2 * plane], radial.unknowns[7 + 2 * plane]];
                [output.unbalance_kg_m[plane], output.unbalance_phase_rad[plane]] = polar(along, across);
            }
        }
        if verdicts[0] == Verdict::Valid {
            for at in 0..RADIAL {
                let [against, beside] = [radial.unknowns[BACKWARD + 2 * at], radial.unknowns[BACKWARD + 1 + 2 * at]];
                [output.backward_force_n[at], output.backward_force_phase_rad[at]] = polar(against, -beside);
            }
        }
        output.position_noise_m = [radial.noise[0], axial.noise[0]];
        output.current_noise_a = [radial.noise[1], axial.noise[1]];
        output.ki_std = stiffness_std(output.ki, output.lambda_std_total, output.lambda_hat);
        output.ks_std = stiffness_std(output.ks, output.lambda_std_total, output.lambda_hat);
    }
}

impl ShaftTolerance {
    /// Names in the interface, values and units.
    fn listed(&self) -> Vec<(String, f64, &'static str)> {
        numbers("tolerance.", self, &())
    }

    fn check(&self, config: &SpindleEstimatorConfig, checks: &mut Checks) {
        let [begin_m, end_m] = config.geometry.extent_m;
        for (name, value, unit) in self.listed() {
            checks.not_negative(name.clone(), value, unit);
            let on_shaft = unit != "m" || value.is_nan() || value < end_m - begin_m || begin_m >= end_m;
            let wanted = format!("less than the length of the shaft, {} m,", end_m - begin_m);
            checks.require(on_shaft, name, format_args!("{value} m"), wanted);
        }
        let inertia = config.geometry.shaft.transverse_kgm2;
        let light = self.transverse_kgm2.is_nan() || self.transverse_kgm2 < inertia || inertia <= 0.0;
        let wanted = format!("less than Jt = {inertia} kg.m2,");
        checks.require(light, "tolerance.Jt", format_args!("{} kg.m2", self.transverse_kgm2), wanted);
        // The tilt is told by the distance of the sensors.
        let apart_m = (config.geometry.a.sensor_position_m - config.geometry.b.sensor_position_m).abs();
        let small =
            self.sensor_position_m.is_nan() || self.sensor_position_m < apart_m || apart_m < SHORTEST_DISTANCE_M;
        let wanted = format!("less than the distance of the sensors, {apart_m} m,");
        checks.require(small, "tolerance.sensorPosition", format_args!("{} m", self.sensor_position_m), wanted);
    }
}

/// The radial motion; `None` if the readings do not tell a tilt.
fn radial(config: &SpindleEstimatorConfig) -> Option<Radial> {
    radial_machine(&config.geometry, config.unbalance_position_m)?;
    let (t, shaft) = (&config.tolerance, &config.shaft_tolerance);
    let mut std = [0.0; PARAMETERS];
    std[0] = t.gap_m;
    std[1..7].fill(t.alpha_rad);
    std[7..9].copy_from_slice(&[shaft.transverse_kgm2, shaft.polar_kgm2]);
    std[9..11].fill(shaft.position_m);
    std[11..13].fill(shaft.sensor_position_m);
    std[13..15].fill(shaft.unbalance_position_m);
    let machine = |change: [f64; PARAMETERS]| {
        let (mut geometry, mut planes_m) = (config.geometry, config.unbalance_position_m);
        geometry.shaft.transverse_kgm2 += change[7];
        geometry.shaft.polar_kgm2 += change[8];
        for (at, bearing) in [&mut geometry.a, &mut geometry.b].into_iter().enumerate() {
            bearing.gap_m += change[0];
            bearing.alpha_rad.iter_mut().zip(&change[1 + 3 * at..]).for_each(|(alpha, by)| *alpha += by);
            bearing.position_m += change[9 + at];
            bearing.sensor_position_m += change[11 + at];
            planes_m[at] += change[13 + at];
        }
        // The check above and that of the tolerances hold for what is a tolerance away.
        radial_machine(&geometry, planes_m).unwrap_or_else(|| unreachable!("sensors at different places"))
    };
    let lambda0 = std::array::from_fn(|k| config.lambda0_nm2_a2[k]);
    Some(estimator(machine, std, lambda0, config))
}

/// The radial machine of a spindle with planes of unbalance; `None` if the readings do not tell a tilt.
fn radial_machine(spindle: &SpindleGeometry, planes_m: [f64; PLANES]) -> Option<Machine<4, 6, UNKNOWNS>> {
    let across = |[_, y, z, beta, gamma]: [f64; COORDINATES]| SVector::from([y, z, beta, gamma]);
    let [a_y, a_z, b_y, b_z, _] = spindle.sensors().map(across);
    let h = Square::<4>::from_columns(&[a_y, a_z, b_y, b_z]).transpose();
    let back = h.try_inverse()?;
    let inertia = across(spindle.shaft.inertia());
    let acceleration = |force: SVector<f64, 4>| -> SVector<f64, 4> { h * force.component_div(&inertia) };
    let geometry = spindle.geometry();
    let directions: [SVector<f64, 4>; 6] = std::array::from_fn(|k| across(geometry.directions[k]));
    let axes_at = |at_m: f64| [[1.0, 0.0], [0.0, 1.0]].map(|axis| across(generalised(at_m, axis)));
    let bearings_m = spindle.radial().map(|bearing| bearing.position_m);
    let turning = planes_m.into_iter().chain(bearings_m).flat_map(axes_at);
    let loads = Square::<4>::identity();
    let forces = directions.into_iter().chain(turning).chain(loads.column_iter().map(|x| x.into_owned()));
    let mut accelerations = SMatrix::<f64, UNKNOWNS, 4>::zeros();
    for (j, force) in forces.enumerate() {
        accelerations.set_row(j, &acceleration(force).transpose());
    }
    let columns: [SVector<f64, 4>; 4] = std::array::from_fn(|c| {
        let rates = back.column(c);
        let rates = [0.0, rates[0], rates[1], rates[2], rates[3]];
        acceleration(across(spindle.shaft.gyroscopic(1.0, rates)))
    });
    Some(Machine {
        geometry: Geometry {
            gap_m: std::array::from_fn(|k| geometry.gap_m[k]),
            directions: directions.map(|d| back.tr_mul(&d).into()),
        },
        accelerations,
        backward: BACKWARD,
        gyroscopic: Some(Square::from_columns(&columns)),
    })
}

/// The axial motion, without unbalance.
fn axial(config: &SpindleEstimatorConfig) -> Axial {
    let machine = |[gap_m]: [f64; 1]| Machine {
        geometry: Geometry { gap_m: [config.geometry.axial_gap_m + gap_m; 2], directions: [[1.0], [-1.0]] },
        accelerations: SMatrix::from([[1.0, -1.0, 1.0]]) / config.geometry.shaft.m_kg,
        backward: 2,
        gyroscopic: None,
    };
    let [_, _, _, _, _, _, towards, away] = config.lambda0_nm2_a2;
    estimator(machine, [config.tolerance.gap_m], [towards, away], config)
}

/// The estimator of a machine of which parameters have these standard deviations.
fn estimator<const N: usize, const K: usize, const U: usize, const T: usize, const P: usize>(
    machine: impl Fn([f64; P]) -> Machine<N, K, U>,
    std: [f64; P],
    lambda0: [f64; K],
    config: &SpindleEstimatorConfig,
) -> PredictionError<N, K, U, T> {
    let t = &config.tolerance;
    let central = machine([0.0; P]);
    let forces = central.backward..U - N;
    PredictionError {
        filter: WhiteningFilter {
            machine: central,
            step_s: config.step_s,
            hold: config.hold,
            identify_unbalance: config.identify_unbalance,
            identify_backward: t.backward_force_n > 0.0,
            tolerances: t.columns(std, machine),
        },
        lambda0,
        prior: models::prior(lambda0, forces, t.backward_force_n),
        known_noise: [config.position_noise_m, config.current_noise_a],
        scale_variance: t.scale_variance(config.geometry.shaft.m_kg),
    }
}
