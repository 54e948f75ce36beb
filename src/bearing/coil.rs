//! The coil of a magnet: flux, current and force, all from one energy function.
//!
//! The current drives the flux `φ` through the air gap and the leakage flux `L_leak i`:
//!
//! ```text
//! ψ = φ + L_leak i                                  flux linked with the coil
//! i = φ gap/(2λ) + i_s (φ/φ_s)⁷                     air gap, iron
//! W = φ² gap/(4λ) + i_s φ_s/8 (φ/φ_s)⁸ + L_leak i²/2
//! F = ∂W/∂gap = φ²/(4λ)      i = ∂W/∂ψ              towards the magnet
//! u = R i + dψ/dt
//! ```
//!
//! `φ_s` is the flux at which the iron takes as much current as the nominal gap, `i_s = φ_s s/(2λ)`; `φ_s = 0` means ideal
//! iron. Then `φ = 2λ/gap · i`, `L = L_leak + 2λ/gap`, and the force is P(4), `λ i²/gap²`.

use serde::{Deserialize, Serialize};

use crate::bearing::Scalar;
use crate::invalid::{Checks, Short};
use crate::variables::unit::{HENRY, OHM, VOLT, WEBER};
use crate::variables::{Choice, Variables};

/// Drive of the coils
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Choice)]
pub enum Drive {
    /// Currents, held over the step
    #[default]
    Current,
    /// Amplifier voltages, held over the step
    Voltage,
}

/// Lower limit of the saturation flux, in Wb: there a step of 0.1 ms takes about 0.2 ms to compute at 5 A. The iron of any real magnet
/// carries a hundred times as much.
const LEAST_SATURATION_WB: f64 = 1.0e-4;

/// The shortest time constant `L/R` of a coil, in s.
///
/// The integration resolves the time constant: a faster coil would take more than ten thousand sub-steps per millisecond and is
/// better modelled by current drive.
pub const SHORTEST_TIME_CONSTANT_S: f64 = 1e-6;

/// Limit of the Newton iterations for the flux in saturated iron; convergence is monotone, and quadratic near the solution.
const MOST_ITERATIONS: usize = 60;

/// Whether the model includes saturation of the iron; the controller's does not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Saturates(pub bool);

/// The coils, equal except for λ.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(T = f64, context = Saturates, default)]
pub struct CoilConfig<T = f64> {
    /// Drive of the coils
    #[parameter]
    pub drive: Drive,
    /// Resistance of each coil, with drive = voltage
    #[parameter(name = "coil.R", unit = OHM, min = 0.0, value = 1.0)]
    pub resistance_ohm: T,
    /// Leakage inductance of each coil, in addition to the 2 lambda/gap of its magnet, with drive = voltage
    #[parameter(name = "coil.Lleak", unit = HENRY, min = 0.0, nominal = 1e-3)]
    pub leakage_h: T,
    /// Voltage limit of the amplifiers, both signs, with drive = voltage
    #[parameter(name = "coil.uMax", unit = VOLT, above = 0.0, nominal = 100.0, value = 100.0)]
    pub limit_v: T,
    /// Flux at which the iron takes as much current as the nominal gap; 0 for iron that does not saturate
    #[parameter(name = "coil.fluxSaturation", count = usize::from(context.0), unit = WEBER, min = 0.0, nominal = 1e-2)]
    pub saturation_wb: T,
}

impl CoilConfig {
    /// Reports parameters with which a step takes too long, by their names in the interface; `gap_m` and `lambda_nm2_a2` are those of
    /// the magnets.
    pub(crate) fn check<const K: usize>(&self, gap_m: [f64; K], lambda_nm2_a2: [f64; K], checks: &mut Checks) {
        // The lower the saturation flux, the stiffer the equations, and the shorter the steps of the integration.
        let saturation_wb = self.saturation_wb;
        let (quick, wanted) = (
            saturation_wb == 0.0 || saturation_wb >= LEAST_SATURATION_WB,
            format!("0, or at least {LEAST_SATURATION_WB} Wb: with less a step takes too long"),
        );
        checks.number(quick, "coil.fluxSaturation", (saturation_wb, "Wb"), wanted);
        let inductances = lambda_nm2_a2.iter().zip(gap_m).map(|(lambda, gap_m)| self.leakage_h + lambda / gap_m);
        let least_h = inductances.fold(f64::INFINITY, f64::min);
        let slow = least_h >= SHORTEST_TIME_CONSTANT_S * self.resistance_ohm;
        let (least, value) = (Short(least_h), format_args!("{} Ohm", self.resistance_ohm));
        let wanted = format!(
            "a time constant L/R of at least {SHORTEST_TIME_CONSTANT_S} s (L = {least} H at twice the nominal gap)"
        );
        checks.require(slow || self.drive == Drive::Current, "coil.R", value, wanted);
    }
}

impl<T: Scalar> CoilConfig<T> {
    /// The coil of a magnet with λ in N·m²/A² and the nominal gap in m.
    #[inline]
    pub fn of(&self, lambda_nm2_a2: T, nominal_gap_m: T) -> Coil<T> {
        let reluctance = T::constant(0.5) / lambda_nm2_a2;
        Coil {
            lambda_nm2_a2,
            leakage_h: self.leakage_h,
            saturation_wb: self.saturation_wb,
            iron_a: self.saturation_wb * nominal_gap_m * reluctance,
        }
    }

    /// The voltage, limited by the amplifier, in V.
    #[inline]
    pub fn limited(&self, voltage_v: T) -> T {
        let limit_v = self.limit_v;
        match voltage_v.value() {
            u if u > limit_v.value() => limit_v,
            u if u < -limit_v.value() => -limit_v,
            _ => voltage_v,
        }
    }
}

/// One coil.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coil<T = f64> {
    lambda_nm2_a2: T,
    leakage_h: T,
    saturation_wb: T,
    /// `i_s`: current taken by the iron at the flux `φ_s`, in A.
    iron_a: T,
}

/// Flux, current and force of a coil at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoilPoint<T = f64> {
    /// Flux linked with the coil ψ, in Wb.
    pub linkage_wb: T,
    /// Current, in A.
    pub current_a: T,
    /// Force towards the magnet, in N.
    pub force_n: T,
    /// `∂i/∂ψ`, in 1/H: the inverse of the incremental inductance.
    pub current_by_linkage: T,
}

impl<T: Scalar> CoilPoint<T> {
    /// A coil without current.
    pub fn idle() -> Self {
        let zero = T::constant(0.0);
        Self { linkage_wb: zero, current_a: zero, force_n: zero, current_by_linkage: zero }
    }
}

impl<T: Scalar> Coil<T> {
    /// `L = L_leak + 2λ/gap`, in H, without saturation.
    #[inline]
    pub fn inductance_h(&self, gap_m: T) -> T {
        self.leakage_h + self.lambda_nm2_a2 * 2.0 / gap_m
    }

    /// The coil at the flux linkage ψ in Wb and a gap above 0 in m.
    pub fn at_linkage(&self, linkage_wb: T, gap_m: T) -> CoilPoint<T> {
        // Start at the largest flux that the linkage allows: the curve is convex beyond the solution, so Newton's method descends
        // to it without overshoot.
        let mut flux = linkage_wb * (self.lambda_nm2_a2 * 2.0 / gap_m) / self.inductance_h(gap_m);
        if self.saturates() && !self.leakage_h.is_zero() {
            flux = solve(flux, |flux| {
                let (current, by_flux) = self.current(flux, gap_m);
                (flux + self.leakage_h * current - linkage_wb, self.leakage_h * by_flux + 1.0)
            });
        }
        self.at_flux(flux, gap_m)
    }

    /// The coil at a current in A and a gap above 0 in m.
    pub fn at_current(&self, current_a: T, gap_m: T) -> CoilPoint<T> {
        let mut flux = current_a * 2.0 * self.lambda_nm2_a2 / gap_m;
        if self.saturates() {
            // Beyond φ_s the iron alone bounds the flux more tightly, a few iterations from the solution.
            let ratio = (current_a.value() / self.iron_a.value()).abs();
            let bound = self.saturation_wb.value() * libm::pow(ratio, 1.0 / 7.0);
            // False for a bound of 0/0.
            if flux.value().abs() > bound {
                flux = T::constant(bound.copysign(flux.value()));
            }
            flux = solve(flux, |flux| {
                let (current, by_flux) = self.current(flux, gap_m);
                (current - current_a, by_flux)
            });
        }
        self.at_flux(flux, gap_m)
    }

    #[inline]
    fn saturates(&self) -> bool {
        self.saturation_wb.value() != 0.0
    }

    /// Current for a flux through the air gap, and its derivative.
    #[inline]
    fn current(&self, flux: T, gap_m: T) -> (T, T) {
        let reluctance = gap_m / (self.lambda_nm2_a2 * 2.0);
        if !self.saturates() {
            return (flux * reluctance, reluctance);
        }
        let ratio = flux / self.saturation_wb;
        let sixth = ratio * ratio * ratio * ratio * ratio * ratio;
        (flux * reluctance + self.iron_a * sixth * ratio, reluctance + self.iron_a * 7.0 / self.saturation_wb * sixth)
    }

    #[inline]
    fn at_flux(&self, flux: T, gap_m: T) -> CoilPoint<T> {
        let (current_a, by_flux) = self.current(flux, gap_m);
        let per_gap = flux / (self.lambda_nm2_a2 * 2.0);
        CoilPoint {
            linkage_wb: flux + self.leakage_h * current_a,
            current_a,
            force_n: flux * 0.5 * per_gap,
            // dψ/dφ = 1 + L_leak di/dφ.
            current_by_linkage: by_flux / (self.leakage_h * by_flux + 1.0),
        }
    }
}

/// Newton's method for an increasing function that is convex away from 0, started beyond the solution; `f` returns value and slope.
fn solve<T: Scalar>(start: T, f: impl Fn(T) -> (T, T)) -> T {
    let iterate = |x: T| {
        let (value, slope) = f(x);
        x - value / slope
    };
    let mut x = start;
    for _ in 0..MOST_ITERATIONS {
        let last = x.value();
        x = iterate(x);
        if x.value() == last || (x.value() - last).abs() <= 4.0 * f64::EPSILON * last.abs() {
            break;
        }
    }
    for _ in 0..T::POLISHING {
        x = iterate(x);
    }
    x
}
