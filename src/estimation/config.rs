//! Parameters, inputs and outputs of the estimator, and the checks of the parameters.

use std::fmt;

use libm::sin;
use serde::{Deserialize, Serialize};

use super::innovations::{Machine, Tolerances};
use crate::bearing::magnet::SMALLEST_SINE;
use crate::invalid::Checks;
use crate::invalid::Invalid;

/// The shortest window of the paper's methods, in sample times: the kernels need room for their three changes of sign.
pub const MIN_INTERVALS: f64 = 8.0;

/// Their longest window, in sample times: memory grows in proportion, and rounding of the kernels with the cube.
pub const MAX_INTERVALS: f64 = 1.0e5;

/// How far `T_f/T_s` may be from a whole number, relative.
pub(super) const WHOLE_NUMBER_TOLERANCE: f64 = 1.0e-6;

/// How λ is computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Method {
    /// P(20) to the letter, `F(n_i)/F(d)` with signed Cramer numerators and determinant of the z axis.
    ///
    /// `d` changes sign twice per revolution and nearly cancels in the mean, so this diverges; it is here to be
    /// compared with. Its values are shown as they are, valid or not, and no residual makes them invalid.
    PaperLiteral,
    /// P(20) with the signs aligned first, `F(n_i sign d)/F(|d|)`: what reproduces the paper.
    Paper,
    /// Prediction errors of both axes and instrumental variables; unbalance and noise identified as well.
    #[default]
    PredictionError,
}

/// What a current sample stands for; the choice decides several per cent in λ.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Hold {
    /// Sample j was held over `[t_{j−1}, t_j)`: the current measured just before it jumps.
    #[default]
    HeldBefore,
    /// Sample j is held over `[t_j, t_{j+1})`: the command issued at the sample.
    HeldAfter,
    /// Sample j is a point of a continuous current, straight between samples.
    Linear,
}

/// Standard deviations of what the estimator takes as known; 0 means exactly known.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tolerance {
    /// Of the mass m, kg.
    pub m_kg: f64,
    /// Of the nominal air gap s, m.
    pub gap_m: f64,
    /// Of the angle of each magnet, rad.
    pub alpha_rad: f64,
    /// Of the gain of each position sensor, relative.
    pub position_gain: f64,
    /// Of the offset of each position sensor, m.
    pub position_offset_m: f64,
    /// Of the gain of each current sensor, relative.
    pub current_gain: f64,
    /// Of the offset of each current sensor, A.
    pub current_offset_a: f64,
    /// Of each force of constant magnitude that turns against the rotor, N; it is estimated with the rest. 0: there is none.
    pub backward_force_n: f64,
}

impl Default for Tolerance {
    /// All is known exactly but a backward force.
    fn default() -> Self {
        let [m_kg, gap_m, alpha_rad, position_gain, position_offset_m, current_gain, current_offset_a] = [0.0; 7];
        let backward_force_n = 2.0;
        Self {
            m_kg,
            gap_m,
            alpha_rad,
            position_gain,
            position_offset_m,
            current_gain,
            current_offset_a,
            backward_force_n,
        }
    }
}

impl Tolerance {
    /// The columns of the filter for a machine of which parameters have these standard deviations, if any tolerance is not zero.
    pub(super) fn columns<const N: usize, const K: usize, const U: usize, const P: usize>(
        &self,
        std: [f64; P],
        machine: impl Fn([f64; P]) -> Machine<N, K, U>,
    ) -> Option<Tolerances<N, K, U>> {
        let [gain, offset_m, current_a] = [self.position_gain, self.position_offset_m, self.current_offset_a];
        let changed = |p: usize, by: f64| machine(std::array::from_fn(|q| if p == q { by } else { 0.0 }));
        std.iter().chain(&[gain, offset_m, current_a]).any(|std| *std > 0.0).then(|| Tolerances {
            variations: (0..P).map(|p| Machine::variation([changed(p, std[p]), changed(p, -std[p])])).collect(),
            gain,
            offset_m,
            current_a,
        })
    }

    /// Relative variance of λ by what scales it: a mass in kg, and the gains of the currents.
    pub(super) fn scale_variance(&self, m_kg: f64) -> f64 {
        let mass = self.m_kg / m_kg;
        mass * mass + 4.0 * self.current_gain * self.current_gain
    }

    /// Names in the interface, values and units.
    pub(super) fn listed(&self) -> [(&'static str, f64, &'static str); 8] {
        [
            ("tolerance.m", self.m_kg, "kg"),
            ("tolerance.s", self.gap_m, "m"),
            ("tolerance.alpha", self.alpha_rad, "rad"),
            ("tolerance.positionGain", self.position_gain, ""),
            ("tolerance.positionOffset", self.position_offset_m, "m"),
            ("tolerance.currentGain", self.current_gain, ""),
            ("tolerance.currentOffset", self.current_offset_a, "A"),
            ("tolerance.backwardForce", self.backward_force_n, "N"),
        ]
    }
}

/// Parameters of the estimator, before they are checked.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EstimatorConfig {
    /// Mass m of the rotor, kg.
    pub m_kg: f64,
    /// Nominal air gap s, m.
    pub gap_m: f64,
    /// Angles α_k of the magnets, rad; magnet k pulls along `(sin α_k, cos α_k)` in (y, z).
    pub alpha_rad: [f64; 3],
    /// Sample time T_s, s.
    pub step_s: f64,
    /// First guess λ_0, N·m²/A².
    pub lambda0_nm2_a2: [f64; 3],
    /// How λ is computed.
    pub method: Method,
    /// What a current sample stands for.
    pub hold: Hold,
    /// Whether the rotor may have an unbalance, which is then identified as well; [`Method::PredictionError`] alone.
    pub identify_unbalance: bool,
    /// Standard deviation σ_z of the noise of a position, m; 0 if it is to be found from the data.
    pub position_noise_m: f64,
    /// Standard deviation σ_i of the noise of a current, A; 0 if it is to be found from the data.
    pub current_noise_a: f64,
    /// How well the rest is known; [`Method::PredictionError`] alone.
    pub tolerance: Tolerance,
    /// Window length T_f of the paper's methods, s; a whole number of sample times.
    pub window_s: f64,
    /// ε of P: with the paper's methods the estimate is λ_0 until samples of this length of time have come in, s; at least T_f.
    pub epsilon_s: f64,
    /// ω_n of F(s) in P(20), rad/s.
    pub filter_omega_rad_s: f64,
    /// ζ of F(s) in P(20).
    pub filter_zeta: f64,
}

impl Default for EstimatorConfig {
    fn default() -> Self {
        use std::f64::consts::{FRAC_PI_3, PI};
        Self {
            m_kg: 6.7,
            gap_m: 5.0e-4,
            alpha_rad: [PI, -FRAC_PI_3, FRAC_PI_3],
            step_s: 1.0e-4,
            lambda0_nm2_a2: [4.0e-6; 3],
            method: Method::default(),
            hold: Hold::default(),
            identify_unbalance: true,
            position_noise_m: 0.0,
            current_noise_a: 0.0,
            tolerance: Tolerance::default(),
            window_s: 0.02,
            epsilon_s: 0.02,
            filter_omega_rad_s: 15.0,
            filter_zeta: 0.707,
        }
    }
}

/// One sample of the measurements, all of the same instant.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EstimatorInput {
    /// Position (Y, Z) of the rotor, m.
    pub position_m: [f64; 2],
    /// Currents of the magnets, A; [`Hold`] says what they stand for.
    pub current_a: [f64; 3],
    /// Angle θ of the rotor, rad, wrapped or not.
    pub theta_rad: f64,
    /// Speed of the rotor, rad/s.
    pub omega_rad_s: f64,
    /// While false, samples are ignored.
    pub enable: bool,
    /// Whether the rotor touches something beside the magnets: samples are of no use meanwhile.
    pub contact: bool,
    /// A rising edge starts afresh, with this sample as the first.
    pub reset: bool,
}

/// Why an estimate is valid or not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Verdict {
    /// The estimate can be relied on.
    Valid,
    /// Too few samples so far.
    #[default]
    Collecting,
    /// `enable` is false.
    Disabled,
    /// The sample is not finite, or the rotor is outside the gap of a magnet.
    BadSample,
    /// The rotor touches something.
    Contact,
    /// A position has read the same to the last bit for many samples, while others move.
    Stuck,
    /// The latest revolution contradicts those before: estimation has begun anew.
    Changed,
    /// The excitation does not tell the unknowns apart.
    Singular,
    /// A force constant came out zero or negative, which a magnet cannot have.
    NotPositive,
    /// The model does not explain the motion: the innovations are larger than the noise told, or turn with the rotor.
    Unexplained,
    /// The innovations are not white: the noise found does not describe the data.
    Coloured,
    /// The noise is not told, and beyond what can be found from the data.
    Noisy,
    /// The estimate contradicted itself several times within a few revolutions.
    Unsteady,
    /// A standard deviation is too large for the estimate to be of use.
    Uncertain,
    /// The state was made by an estimator with other parameters; it is left untouched.
    ForeignState,
    /// The measured speed is not that of the angle.
    Speed,
}

impl Verdict {
    /// All verdicts with their texts, in the order of their numbers in the interface, which count from 1.
    pub const ALL: [(Verdict, &str); 16] = [
        (Verdict::Valid, "valid"),
        (Verdict::Collecting, "not valid: too few samples so far"),
        (Verdict::Disabled, "not valid: enable is false"),
        (Verdict::BadSample, "not valid: a sample is not finite, or outside the gap"),
        (Verdict::Contact, "not valid: the rotor is in contact"),
        (Verdict::Stuck, "not valid: a position sensor reads the same all the time"),
        (Verdict::Changed, "not valid: the latest revolution contradicts those before; estimation begins anew"),
        (Verdict::Singular, "not valid: the excitation does not tell the unknowns apart"),
        (Verdict::NotPositive, "not valid: a force constant came out zero or negative"),
        (Verdict::Unexplained, "not valid: the model does not explain the motion"),
        (Verdict::Coloured, "not valid: the innovations are not white"),
        (Verdict::Noisy, "not valid: there is more noise than can be found from the data: tell it"),
        (Verdict::Unsteady, "not valid: the estimate has contradicted itself several times"),
        (Verdict::Uncertain, "not valid: the standard deviation is too large"),
        (Verdict::ForeignState, "not valid: the state was made by another estimator"),
        (Verdict::Speed, "not valid: omega is not the speed of theta in rad/s"),
    ];
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = Self::ALL.into_iter().find(|(verdict, _)| verdict == self).map_or("", |(_, text)| text);
        f.write_str(text)
    }
}

/// The estimates after a sample. All numbers are finite at all times.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EstimatorOutput {
    /// λ̂, N·m²/A²: λ_0 at first, then the last valid estimate ([`Method::PaperLiteral`]: the last finite one).
    pub lambda_hat: [f64; 3],
    /// λ from the last revolution alone, N·m²/A²; with the paper's methods `D⁻¹N` of the window, P(19). λ_0 at first, then the
    /// last finite value.
    pub lambda_raw: [f64; 3],
    /// Standard deviation of `lambda_hat` by noise, N·m²/A²; λ_0 before there is one. While the estimate is not valid it includes
    /// how far the present estimate is from `lambda_hat`.
    pub lambda_std: [f64; 3],
    /// The same by noise and tolerances.
    pub lambda_std_total: [f64; 3],
    /// Force per current `2 λ_k i_k/gap_k²`, N/A, mean over the last revolution.
    pub ki: [f64; 3],
    /// Negative stiffness `2 λ_k i_k²/gap_k³`, N/m, mean over the last revolution.
    pub ks: [f64; 3],
    /// Whether `lambda_hat` can be relied on; `verdict == Verdict::Valid`. False while disabled: the estimate held then
    /// is as old as the last sample.
    pub valid: bool,
    /// Why.
    pub verdict: Verdict,
    /// Condition number (1-norm) of the information matrix scaled to unit diagonal, dimensionless; with the paper's methods the square
    /// root of that of the filtered normal equations of both axes. [`CONDITION_CAP`](super::CONDITION_CAP) if singular and before the first estimate.
    pub condition: f64,
    /// Normalised innovation squared per degree of freedom, mean over about three revolutions, dimensionless: 1 where model and noise
    /// describe the data. With the paper's methods `√(F(|N − D Λ̂|²)/F(|N|²))`, the part of the motion left unexplained, 1 at first.
    pub residual: f64,
    /// det D of the z axis of the present window, rows and columns scaled as `paper` says, m³; 0 with [`Method::PredictionError`].
    pub determinant: f64,
    /// Static load (p_y, p_z), N; 0 at first, then that of the last valid estimate.
    pub load_n: [f64; 2],
    /// Magnitude U of the unbalance, kg·m; 0 unless it was identified.
    pub unbalance_kg_m: f64,
    /// Phase φ of the unbalance, rad in (−π, π]: the force on the rotor is `U ω² (cos(θ + φ), sin(θ + φ))`.
    pub unbalance_phase_rad: f64,
    /// Magnitude B of the force that turns against the rotor, N; 0 unless there is one.
    pub backward_force_n: f64,
    /// Its phase φ, rad in (−π, π]: the force on the rotor is `B (cos(θ + φ), −sin(θ + φ))`.
    pub backward_force_phase_rad: f64,
    /// Standard deviation of the noise of a position, m, as told or as found; 0 before it is found.
    pub position_noise_m: f64,
    /// Standard deviation of the noise of a current, A, as told or as found; 0 before it is found.
    pub current_noise_a: f64,
}

impl EstimatorOutput {
    pub(super) fn is_finite(&self) -> bool {
        let of_magnets = [self.lambda_hat, self.lambda_raw, self.lambda_std, self.lambda_std_total, self.ki, self.ks];
        let [p_y, p_z] = self.load_n;
        let Self { condition, residual, determinant, unbalance_kg_m, unbalance_phase_rad, .. } = *self;
        let others = [condition, residual, determinant, unbalance_kg_m, unbalance_phase_rad, p_y, p_z];
        let backward = [self.backward_force_n, self.backward_force_phase_rad];
        let noise = [self.position_noise_m, self.current_noise_a];
        of_magnets.as_flattened().iter().chain(&others).chain(&backward).chain(&noise).all(|x| x.is_finite())
    }
}

/// Checks every parameter, under its name in the interface.
pub(super) fn check(config: &EstimatorConfig) -> Result<(), Vec<Invalid>> {
    let mut checks = Checks::default();
    let paper = config.method != Method::PredictionError;
    for (name, value, unit) in [
        ("m", config.m_kg, "kg"),
        ("s", config.gap_m, "m"),
        ("Ts", config.step_s, "s"),
        ("lambda0[1]", config.lambda0_nm2_a2[0], "N.m2/A2"),
        ("lambda0[2]", config.lambda0_nm2_a2[1], "N.m2/A2"),
        ("lambda0[3]", config.lambda0_nm2_a2[2], "N.m2/A2"),
        ("Tf", config.window_s, "s"),
        ("epsilon", config.epsilon_s, "s"),
        ("filter.omega", config.filter_omega_rad_s, "rad/s"),
        ("filter.zeta", config.filter_zeta, "1"),
    ] {
        checks.positive(name, value, unit);
    }
    for (k, alpha) in config.alpha_rad.iter().enumerate() {
        checks.finite(format!("alpha[{}]", k + 1), *alpha, "rad");
        for (l, other) in config.alpha_rad.iter().enumerate().take(k) {
            let apart = !(alpha - other).is_finite() || sin(alpha - other).abs() >= SMALLEST_SINE;
            let wanted = format!("an angle off the line of magnet {}, whose force could not be told apart,", l + 1);
            checks.require(apart, format!("alpha[{}]", k + 1), format_args!("{alpha} rad"), wanted);
        }
    }
    checks.not_negative("sensor.positionNoise", config.position_noise_m, "m");
    checks.not_negative("sensor.currentNoise", config.current_noise_a, "A");
    for (name, value, unit) in config.tolerance.listed() {
        checks.not_negative(name, value, unit);
        let wanted = "0, or method = predictionError, for the paper's methods have no use for a tolerance,";
        let unused = value.is_nan() || value <= 0.0 || name == "tolerance.backwardForce";
        checks.require(!paper || unused, name, format_args!("{value} {unit}"), wanted);
    }
    let wanted = "true, or method = predictionError, for the paper's methods identify no unbalance,";
    checks.require(!paper || config.identify_unbalance, "identify.unbalance", config.identify_unbalance, wanted);
    let positive = |x: f64| x.is_finite() && x > 0.0;
    // The window that nobody uses is not held against a Ts.
    if paper && positive(config.step_s) && positive(config.window_s) {
        let (n, slack, value) =
            (config.window_s / config.step_s, WHOLE_NUMBER_TOLERANCE, format!("{} s", config.window_s));
        for (holds, wanted) in [
            (n >= MIN_INTERVALS * (1.0 - slack), "at least 8 Ts"),
            (n <= MAX_INTERVALS * (1.0 + slack), "at most 100000 Ts"),
            ((n - n.round()).abs() <= slack * n, "a whole number of Ts"),
        ] {
            checks.require(holds, "Tf", &value, wanted);
        }
        let enough = !positive(config.epsilon_s) || config.epsilon_s >= config.window_s * (1.0 - slack);
        let wanted = "at least Tf, for there is no estimate before the first window is full,";
        checks.require(enough, "epsilon", format_args!("{} s", config.epsilon_s), wanted);
    }
    checks.finish()
}
