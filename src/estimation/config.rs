//! Parameters, inputs and outputs of the estimator, and the checks of the parameters.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::bearing::{RotorConfig, Used, array};
use crate::machine::Machine as Names;
use crate::plant::PLANES;
use crate::variables::unit::{
    AMPERE, KILOGRAM, KILOGRAM_METRE2, METRE, NEWTON, NEWTON_METRE, NEWTON_PER_AMPERE, NEWTON_PER_METRE, ONE, RADIAN,
    RADIAN_PER_SECOND, SECOND,
};
use crate::variables::{Choice, KILOGRAM_METRE, LAMBDA, OMEGA_RAD_S, Saved, Variables};

/// How the force constants are computed
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Choice)]
#[choice(name = "EstimationMethod")]
pub enum Method {
    /// Filtered signed determinants, equation (20) to the letter; diverges
    ///
    /// P(20) to the letter, `F(n_i)/F(d)` with signed Cramer numerators and determinant of the z axis. `d` changes sign twice per revolution and nearly
    /// cancels in the mean, so this diverges; it serves as a reference. Its values are shown as they are, valid or not, and no residual makes them invalid.
    PaperLiteral,
    /// Equation (20) with the sign of the determinant aligned; z axis only
    ///
    /// `F(n_i sign d)/F(|d|)`, which reproduces the paper.
    Paper,
    /// Prediction errors and instrumental variables; unbalance and noise identified as well
    #[default]
    PredictionError,
}

/// Meaning of a sample of a current
///
/// The choice decides several per cent in λ.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Choice)]
#[choice(name = "CurrentHold")]
pub enum Hold {
    /// The current held over the interval that ends at the sample
    ///
    /// Sample j was held over `[t_{j−1}, t_j)`: the current measured just before it jumps.
    #[default]
    HeldBefore,
    /// The current held over the interval that begins at the sample
    ///
    /// Sample j is held over `[t_j, t_{j+1})`: the command issued at the sample.
    HeldAfter,
    /// A point of a continuous current
    ///
    /// Linear between samples.
    Linear,
}

/// Standard deviations of the parameters that the estimator assumes to be known; 0 means exactly known, the default for all but the backward force.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Names, default)]
pub struct Tolerance {
    /// Standard deviation of m; 0 means exactly known
    #[parameter(name = "m", unit = KILOGRAM, min = 0.0, nominal = 0.1)]
    pub m_kg: f64,
    /// Standard deviation of s; 0 means exactly known
    #[parameter(name = "s", unit = METRE, min = 0.0, nominal = 1e-5)]
    pub gap_m: f64,
    /// Standard deviation of each alpha; 0 means exactly known
    #[parameter(name = "alpha", count = context.radial().min(1), unit = RADIAN, min = 0.0, nominal = 1e-2)]
    pub alpha_rad: f64,
    /// Relative standard deviation of the gains of the measured positions; 0 means exact
    #[parameter(name = "positionGain", unit = ONE, min = 0.0, nominal = 1e-2)]
    pub position_gain: f64,
    /// Standard deviation of the offsets of the measured positions; 0 means none
    #[parameter(name = "positionOffset", unit = METRE, min = 0.0, nominal = 1e-5)]
    pub position_offset_m: f64,
    /// Relative standard deviation of the gain of each im; 0 means exact
    #[parameter(name = "currentGain", unit = ONE, min = 0.0, nominal = 1e-2)]
    pub current_gain: f64,
    /// Standard deviation of the offset of each im; 0 means none
    #[parameter(name = "currentOffset", unit = AMPERE, min = 0.0, nominal = 1e-2)]
    pub current_offset_a: f64,
    /// Standard deviation of a force of constant magnitude that turns against the rotor, estimated with the rest; 0 means there is none
    #[parameter(name = "backwardForce", count = context.radial().min(1), unit = NEWTON, min = 0.0, value = 2.0)]
    pub backward_force_n: f64,
    /// Standard deviation of Jt; 0 means exactly known
    #[parameter(name = "Jt", count = context.if_tilting(1), unit = KILOGRAM_METRE2, min = 0.0, nominal = 1e-3)]
    pub transverse_kgm2: f64,
    /// Standard deviation of Jp; 0 means exactly known
    #[parameter(name = "Jp", count = context.if_tilting(1), unit = KILOGRAM_METRE2, min = 0.0, nominal = 1e-3)]
    pub polar_kgm2: f64,
    /// Standard deviation of the positions of A and B along the shaft; 0 means exactly known
    #[parameter(name = "position", count = context.if_tilting(1), unit = METRE, min = 0.0, nominal = 1e-3)]
    pub position_m: f64,
    /// Standard deviation of the positions of their sensors along the shaft; 0 means exactly known
    #[parameter(name = "sensorPosition", count = context.if_tilting(1), unit = METRE, min = 0.0, nominal = 1e-3)]
    pub sensor_position_m: f64,
    /// Standard deviation of the positions of the planes of unbalance; 0 means exactly known
    #[parameter(name = "unbalancePosition", count = context.if_tilting(1), unit = METRE, min = 0.0, nominal = 1e-3)]
    pub unbalance_position_m: f64,
}

/// Rotor and bearings among the parameters of an estimator.
pub trait Bearings: Variables<Context = Names> + Clone + 'static {
    /// The example machine with K magnets.
    fn example<const K: usize>() -> Self;
}

impl<const B: usize> Bearings for RotorConfig<f64, B> {
    fn example<const K: usize>() -> Self {
        Self::of(Names::with::<B, K>())
    }
}

/// Unchecked parameters of the estimator of a machine with K magnets.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Names, default)]
#[serde(bound = "G: Saved, [f64; K]: Saved")]
pub struct EstimatorConfigOf<G: Bearings, const K: usize> {
    /// Rotor and bearings.
    #[nested(prefix = "", value = G::example::<K>())]
    pub geometry: G,
    /// Which magnets are used
    #[parameter(name = "magnets.used", count = usize::from(!context.tilts() && !context.is_planar()))]
    pub used: Used,
    /// Sample time; samples are taken at the start time plus whole multiples of it
    #[parameter(name = "Ts", unit = SECOND, above = 0.0, nominal = 1e-4, display_unit = "µs", value = 1e-4)]
    pub step_s: f64,
    /// First guess of the force constant of {magnet}
    #[parameter(names = context.of_magnets("lambda0"), unit = LAMBDA, above = 0.0, nominal = 1e-6, value = [4e-6; K])]
    pub lambda0_nm2_a2: [f64; K],
    /// How the force constants are computed
    #[parameter(count = context.of_paper())]
    pub method: Method,
    /// Meaning of a sample of a current
    #[parameter]
    pub hold: Hold,
    /// Whether to identify the unbalance as well
    ///
    /// Only [`Method::PredictionError`].
    #[parameter(name = "identify.unbalance", count = context.planes.min(1), value = true)]
    pub identify_unbalance: bool,
    /// Position of plane {k} of the unbalance along the shaft, from the centre of gravity
    ///
    /// Used if the shaft tilts.
    #[parameter(
        names = context.of_planes("position").into_iter().take(context.if_tilting(PLANES)), unit = METRE, nominal = 0.1,
        value = [-0.08, 0.10]
    )]
    pub unbalance_position_m: [f64; PLANES],
    /// Standard deviation of the noise of the measured positions; 0 to estimate it from the data
    #[parameter(name = "sensor.positionNoise", unit = METRE, min = 0.0, nominal = 1e-7)]
    pub position_noise_m: f64,
    /// Standard deviation of the noise of im; 0 to estimate it from the data
    #[parameter(name = "sensor.currentNoise", unit = AMPERE, min = 0.0, nominal = 1e-2)]
    pub current_noise_a: f64,
    /// Uncertainty of the other parameters; only [`Method::PredictionError`]. The tolerance of the mass applies to the whole inertia in proportion, that of
    /// the gap changes all gaps of a part of the motion by the same length.
    #[nested]
    pub tolerance: Tolerance,
    /// Length of the window of the paper's methods, a whole multiple of Ts; one revolution is a good choice
    #[parameter(name = "Tf", count = context.of_paper(), unit = SECOND, above = 0.0, nominal = 1e-2, value = 0.02)]
    pub window_s: f64,
    /// Time during which the paper's methods return the first guess, counted in usable samples since the start or the last reset
    ///
    /// ε of P; at least T_f.
    #[parameter(name = "epsilon", count = context.of_paper(), unit = SECOND, above = 0.0, nominal = 1e-2, value = 0.02)]
    pub epsilon_s: f64,
    /// Natural frequency of the low-pass filter of the paper's methods
    ///
    /// ω_n of F(s) in P(20).
    #[parameter(name = "filter.omega", count = context.of_paper(), unit = RADIAN_PER_SECOND, above = 0.0, nominal = 10.0, display_unit = "Hz", value = 15.0)]
    pub filter_omega_rad_s: f64,
    /// Damping ratio of the low-pass filter of the paper's methods
    ///
    /// ζ of F(s) in P(20).
    #[parameter(name = "filter.zeta", count = context.of_paper(), unit = ONE, above = 0.0, value = 0.707)]
    pub filter_zeta: f64,
}

/// For the planar rotor of the paper.
pub type EstimatorConfig = EstimatorConfigOf<RotorConfig, 3>;

/// One sample of the measurements, all of the same instant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Names, default)]
#[serde(bound = "[f64; N]: Saved, [f64; K]: Saved")]
pub struct EstimatorInputOf<const N: usize, const K: usize> {
    /// Measured position of the rotor along {axis}
    #[input(names = context.measured(), unit = METRE, nominal = 1e-5)]
    pub position_m: [f64; N],
    /// Measured current through {magnet}
    ///
    /// [`Hold`] states its meaning.
    #[input(names = context.of_magnets("im"), unit = AMPERE)]
    pub current_a: [f64; K],
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

/// For the planar rotor of the paper.
pub type EstimatorInput = EstimatorInputOf<2, 3>;

/// Why an estimate is valid or not
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Choice)]
pub enum Verdict {
    /// All tests pass
    Valid,
    /// Not enough samples yet
    #[default]
    Collecting,
    /// The input enable is false
    Disabled,
    /// Samples are missing, repeated, not finite, or outside the gap
    ///
    /// More such samples in a row than a gap may have, or gaps so often that no sample between them counts.
    BadSample,
    /// The rotor is in contact
    Contact,
    /// A position sensor is stuck
    ///
    /// It repeats its reading to the last bit over many samples, while others move.
    Stuck,
    /// The latest samples contradict the earlier ones, which are discarded
    Changed,
    /// The excitation does not determine all unknowns
    Singular,
    /// An estimated force constant is zero or negative
    NotPositive,
    /// The model does not explain the motion
    ///
    /// The innovations are larger than the noise, or contain harmonics of the rotor speed.
    Unexplained,
    /// The innovations are not white
    Coloured,
    /// There is too much noise to be estimated from the data: set sensor.positionNoise and sensor.currentNoise
    Noisy,
    /// The estimate has changed several times
    ///
    /// Not used; its number is reserved.
    Unsteady,
    /// The standard deviation is too large
    Uncertain,
    /// The state belongs to an estimator with other parameters
    ///
    /// It is not changed.
    ForeignState,
    /// The input omega is not the speed of theta in rad/s
    Speed,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if *self == Verdict::Valid {
            return f.write_str("valid");
        }
        let why = self.description();
        write!(f, "not valid: {}{}", char::from(why.as_bytes()[0].to_ascii_lowercase()), &why[1..])
    }
}

/// The estimates after a sample. All numbers are always finite.
///
/// A shaft that tilts has two planes of unbalance and two backward forces, P = 2. With an axial bearing its motion has two independent parts, radial and
/// axial, with an estimate each.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Names, default)]
#[serde(bound = "[f64; N]: Saved, [f64; K]: Saved, [f64; P]: Saved")]
pub struct EstimatorOutputOf<const N: usize, const K: usize, const P: usize> {
    /// Estimated force constant of {magnet}
    ///
    /// λ_0 at first, then the last valid estimate ([`Method::PaperLiteral`]: the last finite one).
    #[output(names = context.of_magnets("lambdaHat"), discrete, unit = LAMBDA, nominal = 1e-6)]
    pub lambda_hat: [f64; K],
    /// Force constant of {magnet} from the last revolution alone
    ///
    /// With the paper's methods `D⁻¹N` of the window, P(19). λ_0 at first, then the last finite value.
    #[output(names = context.of_magnets("lambdaRaw"), discrete, unit = LAMBDA, nominal = 1e-6)]
    pub lambda_raw: [f64; K],
    /// Standard deviation of the force constant of {magnet} due to noise alone
    ///
    /// λ_0 before there is one. While the estimate is not valid it includes the distance of the present estimate from `lambda_hat`.
    #[output(names = context.of_magnets("lambdaStd"), discrete, unit = LAMBDA, min = 0.0, nominal = 1e-8)]
    pub lambda_std: [f64; K],
    /// Standard deviation of the force constant of {magnet} due to noise and tolerances
    #[output(names = context.of_magnets("lambdaStdTotal"), discrete, unit = LAMBDA, min = 0.0, nominal = 1e-8)]
    pub lambda_std_total: [f64; K],
    /// Force per current of {magnet}, mean over the last revolution
    ///
    /// `2 λ_k i_k/gap_k²`.
    #[output(names = context.of_magnets("ki"), discrete, unit = NEWTON_PER_AMPERE, nominal = 10.0)]
    pub ki: [f64; K],
    /// Negative stiffness of {magnet}, mean over the last revolution
    ///
    /// `2 λ_k i_k²/gap_k³`.
    #[output(names = context.of_magnets("ks"), discrete, unit = NEWTON_PER_METRE, nominal = 1e5)]
    pub ks: [f64; K],
    /// Standard deviation of ki of {magnet} due to noise and tolerances
    #[output(names = context.of_magnets("kiStd"), discrete, unit = NEWTON_PER_AMPERE, nominal = 0.1)]
    pub ki_std: [f64; K],
    /// Standard deviation of ks of {magnet} due to noise and tolerances
    #[output(names = context.of_magnets("ksStd"), discrete, unit = NEWTON_PER_METRE, nominal = 1e3)]
    pub ks_std: [f64; K],
    /// Standard deviation of the noise of the measured positions{of part}, given or estimated
    ///
    /// For each part; 0 before it is estimated.
    #[output(names = context.of_parts("noise.position"), discrete, unit = METRE, min = 0.0, nominal = 1e-7)]
    pub position_noise_m: [f64; P],
    /// Standard deviation of the noise of im{of part}, given or estimated
    ///
    /// For each part; 0 before it is estimated.
    #[output(names = context.of_parts("noise.current"), discrete, unit = AMPERE, min = 0.0, nominal = 1e-2)]
    pub current_noise_a: [f64; P],
    /// Whether all estimates are valid; lambdaHat is the last valid one of each
    ///
    /// `verdict == Verdict::Valid`. False while disabled: the estimate is then as old as the last sample.
    #[output(discrete)]
    pub valid: bool,
    /// Why the estimate is valid or not; of several, the first that is not valid
    #[output(discrete)]
    pub verdict: Verdict,
    /// Why the estimate of the axial magnets is valid or not
    #[output(name = "X.verdict", count = context.parts() - 1, discrete)]
    pub axial_verdict: Verdict,
    /// Condition number of the information matrix scaled to unit diagonal{, the greater}
    ///
    /// In the 1-norm; with the paper's methods the square root of that of the filtered normal equations of both axes.
    /// [`CONDITION_CAP`](super::CONDITION_CAP) if singular and before the first estimate.
    #[output(discrete, unit = ONE, min = 0.0, nominal = 10.0)]
    pub condition: f64,
    /// Normalised innovation squared, 1 if model and noise are correct{, the greater}{unexplained}
    ///
    /// Per degree of freedom, mean over about three revolutions. With the paper's methods `√(F(|N − D Λ̂|²)/F(|N|²))`, 1 at first.
    #[output(discrete, unit = ONE, min = 0.0)]
    pub residual: f64,
    /// Static {force} on the rotor {direction}
    ///
    /// The load: 0 at first, then that of the last valid estimate.
    #[output(
        names = context.of_loads("p", "Hat"), discrete, unit = context.either(index, NEWTON, NEWTON_METRE),
        nominal = context.either(index, 10.0, 1.0)
    )]
    pub load_n: [f64; N],
    /// Identified unbalance{in plane}, mass times eccentricity; 0 if none is identified
    #[output(names = context.of_planes("magnitude"), discrete, unit = KILOGRAM_METRE, min = 0.0, nominal = 1e-4)]
    pub unbalance_kg_m: [f64; P],
    /// Identified angle of the unbalance{in plane} from the mark on the rotor that theta refers to
    ///
    /// φ in (−π, π]: the force on the rotor is `U ω² (cos(θ + φ), sin(θ + φ))`.
    #[output(names = context.of_planes("phase"), discrete, unit = RADIAN)]
    pub unbalance_phase_rad: [f64; P],
    /// Identified force{in bearing} that turns against the rotor; 0 if there is none
    #[output(names = context.of_radial("backwardForce.magnitude"), discrete, unit = NEWTON, min = 0.0)]
    pub backward_force_n: [f64; P],
    /// Identified phase phi of that force B (cos(theta + phi), -sin(theta + phi)) in the y-z plane
    ///
    /// In (−π, π].
    #[output(names = context.of_radial("backwardForce.phase"), discrete, unit = RADIAN)]
    pub backward_force_phase_rad: [f64; P],
    /// det D of the z axis of the present window, rows and columns scaled as described in `paper`, m³; 0 with [`Method::PredictionError`].
    #[hidden]
    pub determinant: f64,
}

/// For the planar rotor of the paper.
pub type EstimatorOutput = EstimatorOutputOf<2, 3, 1>;

/// Standard deviations of ki or ks, with the relative uncertainty of λ; 0 before the first sample.
pub(super) fn stiffness_std<const K: usize>(stiffness: [f64; K], lambda_std: [f64; K], lambda: [f64; K]) -> [f64; K] {
    array::from_fn(|k| if lambda[k] > 0.0 { (stiffness[k] * lambda_std[k] / lambda[k]).abs() } else { 0.0 })
}
