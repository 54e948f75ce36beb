//! The coil of a magnet: flux, current, force and field energy, all from one energy function.
//!
//! The same current drives the flux `φ` through the air gap and, if there is any, the leakage `L_leak i`:
//!
//! ```text
//! ψ = φ + L_leak i                                  flux linked with the coil
//! i = φ gap/(2λ) + i_s (φ/φ_s)⁷                     air gap, iron
//! W = φ² gap/(4λ) + i_s φ_s/8 (φ/φ_s)⁸ + L_leak i²/2
//! F = ∂W/∂gap = φ²/(4λ)      i = ∂W/∂ψ              towards the magnet
//! u = R i + dψ/dt
//! ```
//!
//! `φ_s` is the flux at which the iron needs as much current as the nominal gap, `i_s = φ_s s/(2λ)`; with `φ_s = 0` the iron
//! needs none. Then `i = 2λ/gap` of flux per ampere, `L = L_leak + 2λ/gap`, and the force is P(4), `λ i²/gap²`.

use serde::{Deserialize, Serialize};

use super::Checks;

/// What the importer gives to a coil.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Drive {
    /// The current, held over the step.
    #[default]
    Current,
    /// The voltage of the amplifier, held over the step.
    Voltage,
}

/// The fastest coil admitted: least time constant `L/R`, in s.
///
/// The integration resolves the time constant; faster coils would take more than ten thousand sub-steps per millisecond and
/// are better described by current drive.
pub const SHORTEST_TIME_CONSTANT_S: f64 = 1e-6;

/// The most Newton iterations for the flux in saturated iron; convergence is monotone, and quadratic at its end.
const MOST_ITERATIONS: usize = 60;

/// The coils, all three alike but for λ.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct CoilConfig {
    /// Whether current or voltage is given.
    pub drive: Drive,
    /// Resistance `R`, in Ω.
    pub resistance_ohm: f64,
    /// Leakage inductance `L_leak`, in H.
    pub leakage_h: f64,
    /// The amplifier gives voltages within ± this, in V.
    pub limit_v: f64,
    /// Flux `φ_s` of the saturation of the iron, in Wb; 0 for iron that does not saturate.
    pub saturation_wb: f64,
}

impl Default for CoilConfig {
    /// Current drive; 1 Ω and 100 V if it is made voltage drive.
    fn default() -> Self {
        Self { drive: Drive::Current, resistance_ohm: 1.0, leakage_h: 0.0, limit_v: 100.0, saturation_wb: 0.0 }
    }
}

impl CoilConfig {
    /// Notes what is wrong, by the names of the interface; `gap_m` and `lambda_nm2_a2` are those of the magnets.
    pub(crate) fn check(&self, gap_m: f64, lambda_nm2_a2: [f64; 3], checks: &mut Checks) {
        checks.not_negative("coil.R", self.resistance_ohm, "Ohm");
        checks.not_negative("coil.Lleak", self.leakage_h, "H");
        checks.positive("coil.uMax", self.limit_v, "V");
        checks.not_negative("coil.fluxSaturation", self.saturation_wb, "Wb");
        let least_h = lambda_nm2_a2.iter().map(|lambda| self.leakage_h + lambda / gap_m).fold(f64::INFINITY, f64::min);
        if self.drive == Drive::Voltage && self.resistance_ohm.is_finite() && least_h.is_finite() && least_h > 0.0 {
            checks.require(
                least_h >= SHORTEST_TIME_CONSTANT_S * self.resistance_ohm,
                "coil.R",
                format_args!("{} Ohm", self.resistance_ohm),
                format!(
                    "a time constant L/R of at least {SHORTEST_TIME_CONSTANT_S} s (L = {least_h} H at twice the nominal gap)"
                ),
            );
        }
    }

    /// The coil of one magnet, for its λ in N·m²/A² and the nominal gap in m.
    pub fn of(&self, lambda_nm2_a2: f64, nominal_gap_m: f64) -> Coil {
        let reluctance = 0.5 / lambda_nm2_a2;
        Coil {
            lambda_nm2_a2,
            leakage_h: self.leakage_h,
            saturation_wb: self.saturation_wb,
            iron_a: self.saturation_wb * nominal_gap_m * reluctance,
        }
    }
}

/// One coil.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coil {
    lambda_nm2_a2: f64,
    leakage_h: f64,
    saturation_wb: f64,
    /// `i_s`: current for the iron at the flux `φ_s`, in A.
    iron_a: f64,
}

/// A coil at an instant, with its partial derivatives by the flux linkage ψ and the gap.
///
/// `∂i/∂gap = ∂F/∂ψ`, as both are second derivatives of one energy.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CoilPoint {
    /// Flux linked with the coil ψ, in Wb.
    pub linkage_wb: f64,
    /// Current, in A.
    pub current_a: f64,
    /// Force towards the magnet, in N.
    pub force_n: f64,
    /// Energy of the field, in J.
    pub energy_j: f64,
    /// `∂i/∂ψ`, in 1/H: the inverse of the incremental inductance.
    pub current_by_linkage: f64,
    /// `∂F/∂ψ` and `∂i/∂gap`, in A/m.
    pub force_by_linkage: f64,
    /// `∂F/∂gap` at constant ψ, in N/m.
    pub force_by_gap: f64,
}

impl Coil {
    /// `L = L_leak + 2λ/gap`, in H, with iron that does not saturate.
    pub fn inductance_h(&self, gap_m: f64) -> f64 {
        self.leakage_h + 2.0 * self.lambda_nm2_a2 / gap_m
    }

    /// The coil with the flux linkage ψ in Wb at a gap in m, above 0.
    pub fn at_linkage(&self, linkage_wb: f64, gap_m: f64) -> CoilPoint {
        // Of all the flux through the air gap that the linkage allows, which is where Newton's method starts: the curve is
        // convex beyond the solution, so that the iterations come down to it and cannot overshoot.
        let mut flux = linkage_wb * (2.0 * self.lambda_nm2_a2 / gap_m) / self.inductance_h(gap_m);
        if self.saturation_wb > 0.0 && self.leakage_h > 0.0 {
            flux = solve(flux, |flux| {
                let (current, by_flux) = self.current(flux, gap_m);
                (flux + self.leakage_h * current - linkage_wb, 1.0 + self.leakage_h * by_flux)
            });
        }
        self.at_flux(flux, gap_m)
    }

    /// The coil with a current in A at a gap in m, above 0.
    pub fn at_current(&self, current_a: f64, gap_m: f64) -> CoilPoint {
        let mut flux = current_a * 2.0 * self.lambda_nm2_a2 / gap_m;
        if self.saturation_wb > 0.0 {
            // Beyond φ_s the iron alone bounds the flux more tightly; from there it is a few iterations.
            let bound = self.saturation_wb * libm::pow((current_a / self.iron_a).abs(), 1.0 / 7.0);
            // Not `clamp`, which panics where 0/0 has made the bound no number.
            flux = flux.min(bound).max(-bound);
            flux = solve(flux, |flux| {
                let (current, by_flux) = self.current(flux, gap_m);
                (current - current_a, by_flux)
            });
        }
        self.at_flux(flux, gap_m)
    }

    /// Current for a flux through the air gap, and its derivative.
    fn current(&self, flux: f64, gap_m: f64) -> (f64, f64) {
        let reluctance = gap_m / (2.0 * self.lambda_nm2_a2);
        if self.saturation_wb == 0.0 {
            return (flux * reluctance, reluctance);
        }
        let ratio = flux / self.saturation_wb;
        let sixth = ratio * ratio * ratio * ratio * ratio * ratio;
        (flux * reluctance + self.iron_a * sixth * ratio, reluctance + 7.0 * self.iron_a / self.saturation_wb * sixth)
    }

    fn at_flux(&self, flux: f64, gap_m: f64) -> CoilPoint {
        let (current_a, by_flux) = self.current(flux, gap_m);
        let per_gap = flux / (2.0 * self.lambda_nm2_a2);
        // dψ/dφ.
        let linkage_by_flux = 1.0 + self.leakage_h * by_flux;
        let iron_j = if self.saturation_wb == 0.0 {
            0.0
        } else {
            let ratio = flux / self.saturation_wb;
            let square = ratio * ratio;
            self.iron_a * self.saturation_wb / 8.0 * square * square * square * square
        };
        CoilPoint {
            linkage_wb: flux + self.leakage_h * current_a,
            current_a,
            force_n: 0.5 * flux * per_gap,
            energy_j: 0.5 * flux * per_gap * gap_m + iron_j + 0.5 * self.leakage_h * current_a * current_a,
            current_by_linkage: by_flux / linkage_by_flux,
            force_by_linkage: per_gap / linkage_by_flux,
            force_by_gap: -per_gap * per_gap * self.leakage_h / linkage_by_flux,
        }
    }
}

/// Newton's method for a function that rises and is convex away from 0, from beyond the solution.
fn solve(start: f64, f: impl Fn(f64) -> (f64, f64)) -> f64 {
    let mut x = start;
    for _ in 0..MOST_ITERATIONS {
        let (value, slope) = f(x);
        let next = x - value / slope;
        if next == x || (next - x).abs() <= 4.0 * f64::EPSILON * x.abs() {
            return next;
        }
        x = next;
    }
    x
}
