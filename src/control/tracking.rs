//! The sampled control law: tracking with a perturbation observer, for N coordinates and K magnets in G groups.
//!
//! With the reference trajectory q* and the estimated perturbation p̂, the generalised force is
//!
//! ```text
//! Q = M (q̈* − k_1 (q̇ − q̇*) − k_0 (q − q*)) − p̂ + Ω G q̇
//! ```
//!
//! M is diagonal. A [`Rotor`] allocates the force to the magnets and gives the gyroscopic moments `−Ω G q̇`.
//! The last term compensates them, which decouples the coordinates at any speed.
//!
//! # Timing
//!
//! Sample k measures at `t_k = start + k · T_s`. Its currents act over `[t_{k+1}, t_{k+2})`, because co-simulation delays them
//! by one sample; the force commanded at sample k − 1 acts during `[t_k, t_{k+1})`. So the measurement corrects the observer at
//! `t_k`, the force in effect gives its prediction for `t_{k+1}`, and the feedback uses that prediction:
//!
//! - gains for the sampled double integrator with both poles at `ρ = exp(−ω_c T_s)`;
//! - feed-forward of the mean acceleration of the reference over `[t_{k+1}, t_{k+2})`, from its velocities at both ends;
//! - currents and gyroscopic moments for the gaps and rates predicted at the middle of `[t_{k+1}, t_{k+2})`, over which the currents
//!   are held.
//!
//! At the first sample the rotor is assumed to be on the reference trajectory: position as measured, velocity of the reference,
//! perturbation 0. From `t_0` to `t_1`, before the first command acts, the observer assumes that no current flows.
//!
//! # A change of λ
//!
//! With a new λ the present currents correspond to new forces. The difference of the resultants is added to the perturbation
//! estimate, so that the sum of force and perturbation does not change. The smallest force of each bearing starts from that of the
//! new forces and returns to `F_0` with the time constant [`PRELOAD_S`]. So the currents do not jump.
//!
//! Both use the forces commanded at the last sample. With current drive these are the forces in effect. With voltage drive the
//! forces in effect follow from currents measured at one instant: their noise and the errors of the current loop would enter
//! the perturbation estimate, and if the estimate of λ changed at every sample, nothing would keep the smallest force at `F_0`.
//!
//! Voltage drive is in `voltage.rs`, the modulation of the smallest force in `excitation.rs`.

pub(super) mod excitation;
mod voltage;

pub use voltage::ramp_gains;

use serde::{Deserialize, Serialize};

use self::excitation::Excitation;
use crate::bearing::coil::{CoilConfig, Drive, Saturates};
use crate::bearing::magnet::{self, Magnets, Used};
use crate::bearing::{Rotor, array};
use crate::control::controller::{Controller, ControllerInput, ControllerOutput};
use crate::control::observer::{Estimate, pole};
use crate::control::phase::Phase;
use crate::control::reference::RefPoint;
use crate::invalid::{Checks, NotFinite, are_finite};
use crate::machine::Machine;
use crate::plant::{INSTANT_TOLERANCE, check_step};
use crate::variables::unit::{AMPERE, HERTZ, NEWTON, ONE, RADIAN_PER_SECOND, SECOND};
use crate::variables::{Choice, LAMBDA, Saved, Variables};

/// Time constant, in s, with which the smallest force returns to `F_0` after a change of λ.
pub const PRELOAD_S: f64 = 0.01;

/// Modulation factor below which the preload is not computed from the smallest force.
///
/// At the minimum of a full modulation the smallest force is 0 whatever the preload. Forces of 100 N are rounded to 10⁻¹⁴ N;
/// divided by this factor, that is only 10⁻⁸ N of preload.
const LEAST_FACTOR: f64 = 1e-6;

/// Lower limit of a predicted gap, as a fraction of the nominal gap.
///
/// The currents are then computed for this gap, which keeps them finite, and the output `saturated` is true.
pub const SMALLEST_GAP: f64 = 0.01;

/// When the controller takes over the estimated force constants
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Choice)]
pub enum UpdateMode {
    /// The first guess is used throughout
    Never,
    /// Once, at the simulation time update.time or as soon after it as the estimate is valid
    #[default]
    AtTime,
    /// At every sample at which the estimate is valid
    WhenValid,
}

/// How a force is shared among the magnets of a bearing
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Choice)]
pub enum Allocation {
    /// The smaller force of each opposed pair is F0
    #[default]
    SmallestForce,
    /// The currents of each opposed pair are bias.current plus and minus the same current
    ///
    /// As long as both are above 0; for larger forces only one magnet pulls.
    BiasCurrent,
}

/// Configuration of the control law; by default the paper's first guess and poles for the planar rotor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Machine, default)]
#[serde(bound = "[f64; K]: Saved, [f64; G]: Saved")]
pub struct TrackingConfig<const K: usize, const G: usize> {
    /// Sample time; samples are taken at the start time plus whole multiples of it
    #[parameter(name = "Ts", unit = SECOND, above = 0.0, nominal = 1e-4, display_unit = "µs", value = 1e-4)]
    pub step_s: f64,
    /// The coils as modelled by the controller: drive, resistance, leakage, voltage limit, no saturation of the iron.
    #[nested(prefix = "", context = Saturates(false))]
    pub coil: CoilConfig,
    /// First guess of the force constant of {magnet}
    #[parameter(names = context.of_magnets("lambda0"), unit = LAMBDA, above = 0.0, nominal = 1e-6, value = [4e-6; K])]
    pub lambda0_nm2_a2: [f64; K],
    /// How a force is shared among the magnets of a bearing
    #[parameter(count = usize::from(context.is_paired()))]
    pub allocation: Allocation,
    /// Smallest force commanded of each magnet{of bearing}, without modulation
    ///
    /// One per bearing, like the bias current; further elements are unused.
    #[parameter(names = context.of_bearings("F0"), unit = NEWTON, min = 0.0, nominal = 10.0, value = [20.0; G])]
    pub f0_n: [f64; G],
    /// Mean of the currents of each opposed pair{of bearing} with allocation = biasCurrent, without modulation
    #[parameter(names = context.of_biases(), unit = AMPERE, min = 0.0, value = [2.0; G])]
    pub bias_a: [f64; G],
    /// Amplitude of the modulation of the smallest forces, as a fraction of F0
    #[parameter(name = "F0.modulation", tunable, unit = ONE, min = 0.0, max = 1.0)]
    pub modulation: f64,
    /// Frequency of the modulation{in group}, at most half the sample rate
    #[parameter(
        names = context.of_groups("F0.modulationFrequency"), tunable, unit = HERTZ, above = 0.0, nominal = 100.0,
        value = array::from_fn(|g| 110.0 + 20.0 * g as f64)
    )]
    pub modulation_hz: [f64; G],
    /// Poles of the tracking error
    #[parameter(
        name = "bandwidth.tracking", unit = RADIAN_PER_SECOND, above = 0.0, nominal = 1000.0, display_unit = "Hz",
        value = 1000.0
    )]
    pub tracking_rad_s: f64,
    /// Poles of the perturbation observer
    #[parameter(
        name = "bandwidth.observer", unit = RADIAN_PER_SECOND, above = 0.0, nominal = 1000.0, display_unit = "Hz",
        value = 4000.0
    )]
    pub observer_rad_s: f64,
    /// Pole of the current error with drive = voltage
    #[parameter(
        name = "bandwidth.current", unit = RADIAN_PER_SECOND, above = 0.0, nominal = 1000.0, display_unit = "Hz",
        value = 5000.0
    )]
    pub current_rad_s: f64,
    /// When the estimated force constants are taken over
    #[parameter(name = "update.mode")]
    pub update: UpdateMode,
    /// Time of the update with update.mode = atTime: absolute simulation time, not time since the start
    #[parameter(name = "update.time", unit = SECOND, display_unit = "ms", value = 0.2)]
    pub update_time_s: f64,
}

/// The reference of each coordinate at a sample and at the next two.
pub type Preview<const N: usize> = [[RefPoint; N]; 3];

/// State of the tracking law.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "[Estimate; N]: Saved, [f64; K]: Saved, [f64; G]: Saved, [Excitation; G]: Saved")]
pub struct TrackingState<const N: usize, const K: usize, const G: usize> {
    /// Number of samples taken.
    pub samples: u64,
    /// Start time, in s.
    pub(super) start_s: f64,
    /// Predictions of the observers for the next sample, one per coordinate.
    pub(super) expected: [Estimate; N],
    /// Modelled forces of the magnets from the next sample on, in N; with voltage drive those at the last sample.
    pub(super) in_effect_n: [f64; K],
    /// Forces of the magnets commanded at the last sample, in N.
    asked_n: [f64; K],
    /// Voltages from the next sample on, in V.
    pub(super) voltage_v: [f64; K],
    /// Currents commanded for the next sample, in A, with voltage drive.
    pub(super) planned_a: [f64; K],
    /// λ in use, in N·m²/A².
    pub(super) lambda_nm2_a2: [f64; K],
    /// Whether the estimate has been adopted, with [`UpdateMode::AtTime`].
    updated: bool,
    /// Smallest force commanded in each group, without modulation, in N.
    preload_n: [f64; G],
    /// Modulation of each group.
    excitation: [Excitation; G],
}

impl<const N: usize, const K: usize, const G: usize> TrackingState<N, K, G> {
    /// Whether the counts, for instance of a state read from a file, are consistent.
    pub(super) fn is_in_order(&self) -> bool {
        self.samples < u64::MAX && self.excitation.iter().all(|excitation| excitation.phase.is_in_order(self.samples))
    }
}

/// Why a sample was rejected. The state is unchanged, and there are no new currents.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ControllerError {
    /// An input is not finite.
    #[error(transparent)]
    Input(#[from] NotFinite),
    /// The inputs are finite, but so large that the results are not.
    #[error("sample {sample} leads to currents or estimates that are not finite")]
    Overflow {
        /// Number of the sample, from 0.
        sample: u64,
    },
}

/// `[k_0, k_1]`, in 1/s² and 1/s, that place both poles of the sampled double integrator at `ρ = exp(−ω T_s)`.
///
/// `k_0 = (1 − ρ)²/T_s²`, `k_1 = (1 − ρ)(3 + ρ)/(2 T_s)`.
pub fn tracking_gains(bandwidth_rad_s: f64, step_s: f64) -> [f64; 2] {
    let (rho, q) = pole(bandwidth_rad_s, step_s);
    [q * q / (step_s * step_s), q * (3.0 + rho) / (2.0 * step_s)]
}

impl<const K: usize, const G: usize> TrackingConfig<K, G> {
    /// Checks combinations of numbers that are within their limits; findings have the names of the interface.
    pub(super) fn check<const N: usize, const B: usize>(
        &self,
        rotor: &Rotor<N, K, B>,
        used: Used,
        checks: &mut Checks,
    ) {
        let machine = Rotor::<N, K, B>::MACHINE;
        check_step("Ts", self.step_s, checks);
        let smallest = self.allocation == Allocation::SmallestForce;
        let wanted = "smallestForce, for a magnet that is not used has no bias current";
        checks.require(smallest || used == Used::Both, "allocation", "biasCurrent", wanted);
        let are_paired = rotor.bearings().iter().all(Magnets::is_paired);
        let wanted = "smallestForce, for the magnets do not face each other in pairs";
        checks.require(smallest || are_paired, "allocation", "biasCurrent", wanted);
        excitation::check(self, machine, checks);
        self.coil.check(rotor.geometry().gap_m, self.lambda0_nm2_a2, checks);
    }
}

impl<const N: usize, const K: usize, const B: usize, const G: usize> Controller<N, K, B, G> {
    /// The gyroscopic moments `−Ω G q̇`, in N or N·m, at the speed Ω in rad/s and the rates q̇ in m/s or rad/s.
    #[inline]
    fn gyroscopic(&self, omega_rad_s: f64, rates: [f64; N]) -> [f64; N] {
        self.rotor.config().shaft.gyroscopic(omega_rad_s, rates).unwrap_or([0.0; N])
    }

    /// The state of the law before the first sample, which is due at `start_s`, in s.
    pub(super) fn law_at_start(&self, start_s: f64) -> TrackingState<N, K, G> {
        TrackingState {
            samples: 0,
            start_s,
            expected: [[0.0; 3]; N],
            in_effect_n: [0.0; K],
            asked_n: [0.0; K],
            voltage_v: [0.0; K],
            planned_a: [0.0; K],
            lambda_nm2_a2: self.config.law.lambda0_nm2_a2,
            updated: false,
            preload_n: self.f0_n,
            excitation: [Excitation { factor: 1.0, phase: Phase::default() }; G],
        }
    }

    /// The command for the sample that is due, at these coordinates; the numbers that it uses must be finite.
    ///
    /// # Errors
    /// [`ControllerError::Overflow`]; the state is then invalid.
    #[inline]
    pub(super) fn command(
        &self,
        state: &mut TrackingState<N, K, G>,
        coordinates: [f64; N],
        measured: &ControllerInput<N, K>,
        preview: &Preview<N>,
    ) -> Result<ControllerOutput<N, K>, ControllerError> {
        let mut estimate: [Estimate; N] = array::from_fn(|a| {
            if state.samples == 0 {
                [coordinates[a], preview[0][a][1], 0.0]
            } else {
                self.observer.update(state.expected[a], coordinates[a])
            }
        });
        let voltage = self.config.law.coil.drive == Drive::Voltage;
        let gap_m = self.limited(self.rotor.geometry().gaps(array::map(estimate, |[x, ..]| x)));
        if voltage {
            state.in_effect_n = magnet::forces(state.lambda_nm2_a2, measured.current_a, gap_m);
        }
        self.update_lambda(state, &mut estimate, measured);
        let level = array::from_fn(|g| {
            state.preload_n[g] += self.relax * (self.f0_n[g] - state.preload_n[g]);
            let factor = self.modulate(state, g);
            match self.config.law.allocation {
                Allocation::SmallestForce => state.preload_n[g] * factor,
                // The force of a magnet is proportional to the square of its current.
                Allocation::BiasCurrent => self.bias_a[g] * factor.sqrt(),
            }
        });

        let mut command = match voltage {
            true => self.voltages(state, &estimate, measured, gap_m, level, preview),
            false => self.currents(state, &estimate, measured, level, preview),
        };
        command.perturbation_n = array::from_fn(|a| self.inertia[a] * estimate[a][2]);
        let estimates = [state.expected.as_flattened(), &state.in_effect_n, &state.planned_a];
        let outputs = [&command.current_a[..], &command.voltage_v, &command.force_n, &command.perturbation_n];
        if !(are_finite(&estimates) && are_finite(&outputs)) {
            return Err(ControllerError::Overflow { sample: state.samples });
        }
        state.samples += 1;
        Ok(command)
    }

    /// The gaps in m, none below its limit.
    #[inline]
    fn limited(&self, gap_m: [f64; K]) -> [f64; K] {
        array::each(&gap_m, &self.rotor.geometry().gap_m, |gap_m, nominal_m| gap_m.max(SMALLEST_GAP * nominal_m))
    }

    /// The current command for an acceleration in m/s² or rad/s² with these gyroscopic moments, at these coordinates, and the gaps in m on
    /// which it is based. `level` is the smallest force of each group in N, or its bias current in A.
    #[inline]
    fn command_at(
        &self,
        state: &mut TrackingState<N, K, G>,
        acceleration: [f64; N],
        moment: [f64; N],
        level: [f64; G],
        coordinates: [f64; N],
    ) -> (ControllerOutput<N, K>, [f64; K]) {
        let (geometry, lambda) = (self.rotor.geometry(), state.lambda_nm2_a2);
        let force_n = array::from_fn(|a| {
            let [_, _, d] = state.expected[a];
            self.inertia[a] * (acceleration[a] - d) - moment[a]
        });
        let predicted_m = geometry.gaps(coordinates);
        let gap_m = self.limited(predicted_m);
        state.asked_n = match (self.config.law.allocation, self.config.used.only()) {
            (Allocation::SmallestForce, None) => self.rotor.allocate(force_n, &level, None),
            (Allocation::SmallestForce, Some(only)) => {
                let towards_n = force_n[0] * geometry.directions[only][0];
                array::from_fn(|k| if k == only { towards_n.max(level[0]) } else { 0.0 })
            }
            (Allocation::BiasCurrent, _) => {
                let per_square = array::from_fn(|k| lambda[k] / (gap_m[k] * gap_m[k]));
                self.rotor.allocate(force_n, &level, Some(&per_square))
            }
        };
        let current_a = magnet::currents(state.asked_n, gap_m, lambda);
        (ControllerOutput { current_a, force_n, saturated: gap_m != predicted_m, ..ControllerOutput::default() }, gap_m)
    }

    /// Currents to hold over the sample time that begins at the next sample.
    #[inline]
    fn currents(
        &self,
        state: &mut TrackingState<N, K, G>,
        estimate: &[Estimate; N],
        measured: &ControllerInput<N, K>,
        level: [f64; G],
        [_, begin, end]: &Preview<N>,
    ) -> ControllerOutput<N, K> {
        let m = self.inertia;
        let step_s = self.config.law.step_s;
        let geometry = self.rotor.geometry();
        let gyroscopic = |rates| self.gyroscopic(measured.omega_rad_s, rates);
        let in_effect = geometry.resultant(state.in_effect_n);
        // Rates at the middle of the interval; their change by the gyroscopic moments is of second order.
        let rate = |[_, v, d]: Estimate, acceleration: f64| v + 0.5 * step_s * (acceleration + d);
        let moment = gyroscopic(array::from_fn(|a| rate(estimate[a], in_effect[a] / m[a])));
        let [k_0, k_1] = self.gains;
        let mut acceleration = [0.0; N];
        for a in 0..N {
            let expected = self.observer.predict(estimate[a], (in_effect[a] + moment[a]) / m[a]);
            let [x, v, _] = expected;
            let ([x_0, v_0, _], [_, v_1, _]) = (begin[a], end[a]);
            acceleration[a] = (v_1 - v_0) / step_s - k_1 * (v - v_0) - k_0 * (x - x_0);
            state.expected[a] = expected;
        }
        let moment = gyroscopic(array::from_fn(|a| state.expected[a][1] + 0.5 * step_s * acceleration[a]));
        let middle = array::from_fn(|a| {
            let [_, _, d] = state.expected[a];
            self.observer.predict_by(state.expected[a], acceleration[a] - d, 0.5 * step_s)[0]
        });
        let (command, _) = self.command_at(state, acceleration, moment, level, middle);
        state.in_effect_n = state.asked_n;
        command
    }

    /// Adopts the estimated λ when it is due, and adds the difference in force to the perturbation estimate.
    fn update_lambda(
        &self,
        state: &mut TrackingState<N, K, G>,
        estimate: &mut [Estimate; N],
        measured: &ControllerInput<N, K>,
    ) {
        let hat = measured.lambda_hat_nm2_a2;
        let usable = measured.lambda_valid && hat.iter().all(|lambda| lambda.is_finite() && *lambda > 0.0);
        let before = state.lambda_nm2_a2;
        let TrackingConfig { step_s, update, update_time_s, .. } = self.config.law;
        let is_due = state.start_s + state.samples as f64 * step_s >= update_time_s - INSTANT_TOLERANCE * step_s;
        let after = match update {
            UpdateMode::AtTime if usable && !state.updated && is_due => {
                state.updated = true;
                hat
            }
            UpdateMode::WhenValid if usable => hat,
            _ => return,
        };
        state.lambda_nm2_a2 = after;
        if state.samples == 0 || after == before {
            // No current flows yet, or nothing changes.
            return;
        }
        let geometry = self.rotor.geometry();
        let old = geometry.resultant(state.asked_n);
        // Currents and gaps are unchanged, so the forces of P(4) scale with λ.
        for k in 0..K {
            state.in_effect_n[k] *= after[k] / before[k];
            state.asked_n[k] *= after[k] / before[k];
        }
        let new = geometry.resultant(state.asked_n);
        for a in 0..N {
            estimate[a][2] += (old[a] - new[a]) / self.inertia[a];
        }
        for g in 0..G {
            let factor = state.excitation[g].factor;
            if factor > LEAST_FACTOR {
                let forces = state.asked_n.into_iter().zip(self.group).filter(|(_, group)| *group == g);
                let smallest_n = forces.fold(f64::INFINITY, |smallest, (force_n, _)| smallest.min(force_n));
                state.preload_n[g] = smallest_n / factor;
            }
        }
    }
}
