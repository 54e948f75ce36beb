//! The reference of a spindle: an ellipse in each radial bearing, run through at the speed of the rotor, and in an axial one a sine.
//!
//! ```text
//! Y* = r_Y cos(θ + φ)     Z* = r_Z sin(θ + φ)          at the magnets of A and of B, each with its own r_Y, r_Z, φ
//! X* = a sin(2π f t)                                   t from the first sample on
//! ```
//!
//! Equal phases give cylindrical motion, opposite ones conical motion. The coordinates are linear in the displacements in the
//! bearings, so that the radial ones are `c cos θ + s sin θ` with constant c and s. The start is that of the planar
//! [`reference`](crate::control::reference): the same growth and lift, for all coordinates.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use super::magnets_at_m;
use crate::bearing::shaft::{self, ACROSS};
use crate::bearing::spindle::SpindleOf;
use crate::control::reference::{Curve, Path, RefPoint, Transition, check_ellipse_reach};
use crate::invalid::{Checks, Invalid};
use crate::machine::Machine;
use crate::variables::Variables;
use crate::variables::unit::{HERTZ, METRE, RADIAN};

/// Path in a radial bearing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Variables)]
pub struct BearingPath {
    /// Semi-axis of the reference trajectory along y at the magnets of bearing {prefix}
    #[parameter(name = "reference.rY", unit = METRE, min = 0.0, nominal = 1e-5)]
    pub r_y_m: f64,
    /// Semi-axis of the reference trajectory along z at the magnets of bearing {prefix}
    #[parameter(name = "reference.rZ", unit = METRE, min = 0.0, nominal = 1e-5)]
    pub r_z_m: f64,
    /// Phase of the reference trajectory in bearing {prefix}
    #[parameter(name = "reference.phase", unit = RADIAN)]
    pub phase_rad: f64,
}

impl Default for BearingPath {
    /// The paper's ellipse.
    fn default() -> Self {
        Self { r_y_m: 30e-6, r_z_m: 70e-6, phase_rad: 0.0 }
    }
}

/// The reference of a spindle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Machine)]
#[serde(default)]
pub struct SpindlePathConfig {
    /// Path in bearing A.
    #[nested(prefix = "A.", context = ())]
    pub a: BearingPath,
    /// Path in bearing B.
    #[nested(prefix = "B.", context = ())]
    pub b: BearingPath,
    /// Amplitude of the axial reference, a sine
    #[parameter(name = "X.reference.amplitude", count = context.axial(), unit = METRE, min = 0.0, nominal = 1e-5)]
    pub axial_amplitude_m: f64,
    /// Frequency of the axial reference
    #[parameter(name = "X.reference.frequency", count = context.axial(), unit = HERTZ, min = 0.0, nominal = 100.0)]
    pub axial_hz: f64,
    /// Begin of the motion.
    #[nested(prefix = "reference.", context = ())]
    pub transition: Transition,
    /// Speed of the rotor, in rad/s; negative values run backwards.
    #[hidden]
    pub omega_rad_s: f64,
}

impl Default for SpindlePathConfig {
    /// The paper's ellipse in both bearings, in phase, at 3000 rpm, without axial motion.
    fn default() -> Self {
        Self {
            a: BearingPath::default(),
            b: BearingPath::default(),
            axial_amplitude_m: 0.0,
            axial_hz: 60.0,
            transition: Transition::default(),
            omega_rad_s: TAU * 50.0,
        }
    }
}

/// Ellipses in the radial bearings, and the axial sine.
#[derive(Clone, Debug, PartialEq)]
pub struct Ellipses<const N: usize> {
    config: SpindlePathConfig,
    /// c and s of the coordinates `c cos θ + s sin θ`, in m and rad.
    waves: [[f64; N]; 2],
}

/// The reference of a spindle.
pub type SpindlePath<const N: usize = 5> = Path<Ellipses<N>, N>;

impl<const N: usize> SpindlePath<N> {
    /// A reference sampled every `step_s` (finite, above 0), for a spindle.
    ///
    /// # Errors
    /// `A.reference.rY`, `A.reference.rZ` if they are below 0, or if the ellipse touches a magnet, B alike;
    /// `X.reference.amplitude` below 0 or beyond the gap, `X.reference.frequency` below 0 or beyond half the sample rate; the
    /// times below 0; all of these, `A.reference.phase` and `reference.omega` if they are not finite.
    pub fn new<const M: usize, const K: usize>(
        config: SpindlePathConfig,
        step_s: f64,
        spindle: &SpindleOf<N, M, K>,
    ) -> Result<Self, Vec<Invalid>> {
        let mut checks = Checks::default();
        let path = Self::checked(config, step_s, spindle, &mut checks);
        checks.finish()?;
        Ok(path)
    }

    /// Reports errors in `checks`; use the returned value only if there are none.
    pub(crate) fn checked<const M: usize, const K: usize>(
        config: SpindlePathConfig,
        step_s: f64,
        spindle: &SpindleOf<N, M, K>,
        checks: &mut Checks,
    ) -> Self {
        let paths = [&config.a, &config.b];
        for ((prefix, path), magnets) in ["A.", "B."].into_iter().zip(paths).zip(spindle.bearings()) {
            checks.of(prefix, |checks| {
                checks.not_negative("reference.rY", path.r_y_m, "m");
                checks.not_negative("reference.rZ", path.r_z_m, "m");
                checks.finite("reference.phase", path.phase_rad, "rad");
                check_ellipse_reach([path.r_y_m, path.r_z_m], 0.0, magnets, checks);
            });
        }
        if let Some(magnets) = spindle.axial() {
            let (amplitude_m, gap_m) = (config.axial_amplitude_m, magnets.gap_m());
            checks.not_negative("X.reference.amplitude", amplitude_m, "m");
            checks.require(
                // Values that were refused already are skipped.
                amplitude_m < gap_m || !(amplitude_m.is_finite() && gap_m > 0.0),
                "X.reference.amplitude",
                format_args!("{amplitude_m} m"),
                format!("an axial motion that does not touch a magnet (the gap is {gap_m} m)"),
            );
            let highest_hz = if step_s.is_finite() && step_s > 0.0 { 0.5 / step_s } else { f64::INFINITY };
            checks.require(
                config.axial_hz.is_finite() && (0.0..=highest_hz).contains(&config.axial_hz),
                "X.reference.frequency",
                format_args!("{} Hz", config.axial_hz),
                format!("a finite number, 0 or above, at most half the sample rate ({highest_hz} Hz)"),
            );
        }
        config.transition.check(checks);
        checks.finite("reference.omega", config.omega_rad_s, "rad/s");
        // r_Y cos(θ + φ) and r_Z sin(θ + φ), expanded.
        let phases = paths.map(|path| libm::sincos(path.phase_rad));
        let at_m = magnets_at_m(spindle);
        let wave = |of: fn(&BearingPath, f64, f64) -> [f64; 2]| {
            shaft::through(0.0, at_m, std::array::from_fn(|b| of(paths[b], phases[b].0, phases[b].1)))
        };
        let waves = [
            wave(|path, sin, cos| [path.r_y_m * cos, path.r_z_m * sin]),
            wave(|path, sin, cos| [-path.r_y_m * sin, path.r_z_m * cos]),
        ];
        Self::along(Ellipses { waves, config }, step_s)
    }
}

impl<const N: usize> Ellipses<N> {
    fn axial(&self, t_s: f64) -> RefPoint {
        let SpindlePathConfig { axial_amplitude_m: a, axial_hz: f, .. } = self.config;
        if a == 0.0 {
            return RefPoint::default();
        }
        let rate = TAU * f;
        let revolutions = f * t_s;
        let (sin, cos) = libm::sincos(TAU * (revolutions - libm::floor(revolutions)));
        RefPoint { position_m: a * sin, velocity_m_s: a * rate * cos, acceleration_m_s2: -a * rate * rate * sin }
    }
}

impl<const N: usize> Curve<N> for Ellipses<N> {
    fn transition(&self) -> Transition {
        self.config.transition
    }

    fn omega_rad_s(&self) -> f64 {
        self.config.omega_rad_s
    }

    fn at(&self, theta_rad: f64, omega_rad_s: f64, t_s: f64) -> [RefPoint; N] {
        let [c, s] = self.waves;
        let (sin, cos) = libm::sincos(theta_rad);
        let mut curve = std::array::from_fn(|a| {
            let position_m = c[a] * cos + s[a] * sin;
            RefPoint {
                position_m,
                velocity_m_s: omega_rad_s * (s[a] * cos - c[a] * sin),
                acceleration_m_s2: -omega_rad_s * omega_rad_s * position_m,
            }
        });
        if N > ACROSS {
            curve[0] = self.axial(t_s);
        }
        curve
    }
}
