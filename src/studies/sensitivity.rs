//! The sensitivity function of the sampled loop, after ISO 14839-3: the gain from an error of a position sensor to its reading.
//!
//! With n added to the measured position, `S = y_m/n` of the closed loop, with the rotor at rest in the centre under a static
//! load. It is computed in two independent ways: [`SampledLoop::linearise`] takes one sample of plant and controller as a map
//! of their states, differentiates it, `z_{k+1} = A z_k + B n_k`, `y_k = C z_k + n_k`, and evaluates
//!
//! ```text
//! S(ω) = 1 + C (e^{jωT_s} − A)⁻¹ B
//! ```
//!
//! [`SampledLoop::inject`] runs plant and controller in time with a sine as n and compares amplitude and phase.
//!
//! This is analysis, not stepping: it allocates. Sensors have no errors and no delay.

use nalgebra::{Complex, DMatrix};

use crate::bearing::coil::Drive;
use crate::control::controller::{
    Controller, ControllerConfig, ControllerInput, ControllerState, UNKNOWNS, UpdateMode,
};
use crate::control::reference::Shape;
use crate::invalid::Invalid;
use crate::plant::sensor::SensorConfig;
use crate::plant::{Harmonic, Plant, PlantConfig, PlantInput, PlantState};

/// Peaks of the sensitivity function that bound the zones A, B and C of ISO 14839-3; larger ones are in D.
pub const ZONES: [(f64, char); 3] = [(3.0, 'A'), (4.0, 'B'), (5.0, 'C')];

/// The zone of a peak.
pub fn zone(peak: f64) -> char {
    ZONES.iter().find(|(limit, _)| peak < *limit).map_or('D', |(_, zone)| *zone)
}

/// Time for the loop to settle, in s.
const SETTLING_S: f64 = 0.5;

/// Largest distance from the centre after settling, in m.
const CENTRED_M: f64 = 1e-7;

/// Number of plant states, `[Y, Z, Ẏ, Ż, ψ_1, ψ_2, ψ_3]`; the commands in effect follow.
const PLANT: usize = 7;
const COMMANDS: usize = 3;
const STATES: usize = PLANT + COMMANDS + UNKNOWNS;

/// Why a sensitivity could not be computed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoSensitivity {
    /// A configuration is refused.
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    Refused(Vec<Invalid>),
    /// The loop does not stay at the operating point.
    #[error("the loop does not settle: {0}")]
    Unsettled(String),
}

/// Plant and controller in their loop at an operating point.
#[derive(Clone, Debug)]
pub struct SampledLoop {
    plant: Plant,
    controller: Controller,
    load_n: [f64; 2],
    settled: State,
}

#[derive(Clone, Debug)]
struct State {
    plant: PlantState,
    /// Currents or voltages held until the next sample.
    command: [f64; COMMANDS],
    controller: ControllerState,
}

impl SampledLoop {
    /// The loop of a plant and a controller with the given λ, settled in the centre under a static load (y, z) in N.
    ///
    /// # Errors
    /// [`NoSensitivity`].
    pub fn new(
        plant: &PlantConfig,
        controller: &ControllerConfig,
        lambda_nm2_a2: [f64; 3],
        load_n: [f64; 2],
    ) -> Result<Self, NoSensitivity> {
        let step_s = controller.law.step_s;
        let plant = PlantConfig {
            unbalance_kgm: 0.0,
            harmonic: Harmonic::default(),
            position_m: [0.0; 2],
            velocity_m_s: [0.0; 2],
            sensor: SensorConfig { step_s, ..SensorConfig::default() },
            ..plant.clone()
        };
        let mut controller = controller.clone();
        (controller.law.lambda0_nm2_a2, controller.law.update) = (lambda_nm2_a2, UpdateMode::Never);
        controller.reference.shape = Shape::Ellipse;
        // With modulation there is no operating point.
        controller.law.modulation = 0.0;
        (controller.reference.r_y_m, controller.reference.r_z_m) = (0.0, 0.0);
        let plant = Plant::new(plant).map_err(NoSensitivity::Refused)?;
        let controller = Controller::new(controller).map_err(NoSensitivity::Refused)?;
        let settled = State { plant: plant.start(0.0), command: [0.0; COMMANDS], controller: controller.start(0.0) };
        let mut this = Self { plant, controller, load_n, settled };
        let mut state = this.settled.clone();
        for _ in 0..this.samples(SETTLING_S) {
            this.step(&mut state, [0.0; 2])?;
        }
        let [y, z] = state.plant.position_m;
        if state.plant.contact || libm::hypot(y, z) > CENTRED_M {
            return Err(NoSensitivity::Unsettled(format!("after {SETTLING_S} s the rotor is at Y = {y} m, Z = {z} m")));
        }
        this.settled = state;
        Ok(this)
    }

    fn samples(&self, duration_s: f64) -> usize {
        (duration_s / self.step_s()).ceil() as usize
    }

    fn step_s(&self) -> f64 {
        self.controller.config().law.step_s
    }

    /// One sample with an error n of the position sensors, in m; returns their readings.
    fn step(&self, state: &mut State, error_m: [f64; 2]) -> Result<[f64; 2], NoSensitivity> {
        let unsettled = |error: &dyn std::fmt::Display| NoSensitivity::Unsettled(error.to_string());
        let voltage = self.plant.config().coil.drive == Drive::Voltage;
        let mut input = PlantInput { perturbation_n: self.load_n, ..PlantInput::default() };
        if voltage {
            input.voltage_v = state.command;
        } else {
            input.current_a = state.command;
        }
        // The loop is time-invariant, and a constant time keeps rounding out of the differences.
        let mut plant = state.plant.clone();
        let now_s = plant.time_s;
        let current_a = self.plant.outputs(&plant, &input, now_s).current_a;
        let position_m = std::array::from_fn(|a| plant.position_m[a] + error_m[a]);
        let reading = ControllerInput { position_m, current_a, ..ControllerInput::default() };
        let output = self.controller.sample(&mut state.controller, &reading).map_err(|error| unsettled(&error))?;
        self.plant.advance(&mut plant, &input, now_s, self.step_s()).map_err(|error| unsettled(&error))?;
        state.plant = plant;
        state.command = if voltage { output.voltage_v } else { output.current_a };
        Ok(position_m)
    }

    fn vector(state: &State) -> [f64; STATES] {
        let mut z = [0.0; STATES];
        let plant = &state.plant;
        z[..2].copy_from_slice(&plant.position_m);
        z[2..4].copy_from_slice(&plant.velocity_m_s);
        z[4..PLANT].copy_from_slice(&plant.linkage_wb);
        z[PLANT..PLANT + COMMANDS].copy_from_slice(&state.command);
        z[PLANT + COMMANDS..].copy_from_slice(&state.controller.unknowns());
        z
    }

    fn state(&self, z: &[f64; STATES]) -> State {
        let mut state = self.settled.clone();
        let plant = &mut state.plant;
        plant.position_m.copy_from_slice(&z[..2]);
        plant.velocity_m_s.copy_from_slice(&z[2..4]);
        plant.linkage_wb.copy_from_slice(&z[4..PLANT]);
        state.command.copy_from_slice(&z[PLANT..PLANT + COMMANDS]);
        state.controller.set_unknowns(std::array::from_fn(|index| z[PLANT + COMMANDS + index]));
        state
    }

    /// The loop linearised at the operating point, by central differences of one sample.
    ///
    /// # Errors
    /// [`NoSensitivity::Unsettled`].
    pub fn linearise(&self) -> Result<Linear, NoSensitivity> {
        let voltage = self.plant.config().coil.drive == Drive::Voltage;
        // Increments of the size of small motions of the loop: position, velocity, flux, current or voltage.
        let [m, m_s, wb, command] = [1e-9, 1e-6, 1e-7, if voltage { 1e-3 } else { 1e-5 }];
        let mut increments = [0.0; STATES];
        increments[..2].fill(m);
        increments[2..4].fill(m_s);
        increments[4..PLANT].fill(wb);
        increments[PLANT..PLANT + COMMANDS].fill(command);
        increments[PLANT + COMMANDS..].copy_from_slice(&ControllerState::INCREMENTS);
        let at = Self::vector(&self.settled);
        let image = |z: &[f64; STATES], error_m: [f64; 2]| -> Result<[f64; STATES], NoSensitivity> {
            let mut state = self.state(z);
            self.step(&mut state, error_m)?;
            Ok(Self::vector(&state))
        };
        let mut a = DMatrix::zeros(STATES, STATES);
        // With current drive, fluxes and voltages are not states: they are constant and have no effect.
        let idle = |index: usize| !voltage && ((4..PLANT).contains(&index) || index >= STATES - 2 * COMMANDS);
        for (column, increment) in increments.into_iter().enumerate().filter(|(column, _)| !idle(*column)) {
            let (mut above, mut below) = (at, at);
            above[column] += increment;
            below[column] -= increment;
            let (above, below) = (image(&above, [0.0; 2])?, image(&below, [0.0; 2])?);
            for row in (0..STATES).filter(|row| !idle(*row)) {
                a[(row, column)] = (above[row] - below[row]) / (2.0 * increment);
            }
        }
        let mut b = DMatrix::zeros(STATES, 2);
        for column in 0..2 {
            let error = |size: f64| std::array::from_fn(|axis| if axis == column { size } else { 0.0 });
            let (above, below) = (image(&at, error(m))?, image(&at, error(-m))?);
            for row in 0..STATES {
                b[(row, column)] = (above[row] - below[row]) / (2.0 * m);
            }
        }
        Ok(Linear { a, b, step_s: self.step_s() })
    }

    /// `S` of one axis (0 for y, 1 for z) by injection of `periods` of a sine with the given amplitude in m over `samples`
    /// samples, after as many for transients to decay. Returns the angular frequency in rad/s, and S.
    ///
    /// # Errors
    /// [`NoSensitivity::Unsettled`].
    pub fn inject(
        &self,
        axis: usize,
        amplitude_m: f64,
        periods: usize,
        samples: usize,
    ) -> Result<(f64, Complex<f64>), NoSensitivity> {
        let mut state = self.settled.clone();
        let mut sum = Complex::new(0.0, 0.0);
        for sample in 0..2 * samples {
            let turns = (sample * periods % samples) as f64 / samples as f64;
            let phase = std::f64::consts::TAU * turns;
            let mut error_m = [0.0; 2];
            error_m[axis] = amplitude_m * libm::sin(phase);
            let read = self.step(&mut state, error_m)?;
            if sample >= samples {
                sum += Complex::from_polar(read[axis], -phase);
            }
        }
        // For a sin(ωt), this sum is −j a N/2.
        let gain = sum * Complex::new(0.0, 2.0 / (samples as f64 * amplitude_m));
        Ok((std::f64::consts::TAU * periods as f64 / (samples as f64 * self.step_s()), gain))
    }
}

/// A sampled loop as a linear map.
#[derive(Clone, Debug)]
pub struct Linear {
    a: DMatrix<f64>,
    b: DMatrix<f64>,
    step_s: f64,
}

impl Linear {
    /// A of `z_{k+1} = A z_k + B n_k`.
    pub fn transition(&self) -> &DMatrix<f64> {
        &self.a
    }

    /// `S(ω)` as a matrix: columns by the axis of the error, rows by the axis of the reading; ω in rad/s, below half the
    /// sampling frequency. `None` at a pole.
    pub fn sensitivity(&self, omega_rad_s: f64) -> Option<[[Complex<f64>; 2]; 2]> {
        let z = Complex::from_polar(1.0, omega_rad_s * self.step_s);
        let system = DMatrix::from_fn(STATES, STATES, |row, column| {
            let a = Complex::new(self.a[(row, column)], 0.0);
            if row == column { z - a } else { -a }
        });
        let x = system.lu().solve(&self.b.map(|value| Complex::new(value, 0.0)))?;
        let one = |row, column| if row == column { Complex::new(1.0, 0.0) } else { Complex::new(0.0, 0.0) };
        Some(std::array::from_fn(|row| std::array::from_fn(|column| one(row, column) + x[(row, column)])))
    }

    /// `[ω, |S_yy|, |S_zz|]` at `count` frequencies, logarithmically spaced from `from_rad_s` to just below half the sampling
    /// frequency.
    pub fn sweep(&self, from_rad_s: f64, count: usize) -> Vec<[f64; 3]> {
        let ratio = 0.99 * std::f64::consts::PI / self.step_s / from_rad_s;
        let at = |index: usize| from_rad_s * libm::pow(ratio, index as f64 / (count.max(2) - 1) as f64);
        let one = |omega| self.sensitivity(omega).map(|s| [omega, s[0][0].norm(), s[1][1].norm()]);
        (0..count).filter_map(|index| one(at(index))).collect()
    }
}
