//! Whirl of a rigid shaft on springs and dampers at its bearings: natural frequencies over the speed (Campbell diagram) and the response to
//! unbalance.
//!
//! In the complex coordinates `u = y + i z` and `ψ = γ − i β` of [`shaft`](crate::bearing::shaft), with `B = [[1, ξ_A], [1, ξ_B]]`,
//!
//! ```text
//! diag(m, J_t) q̈ + (Bᵀ C B − i Ω diag(0, J_p)) q̇ + Bᵀ K B q = Ω² (ΣU e^{iφ}, ΣU ξ e^{iφ}) e^{iΩt}
//! ```
//!
//! A mode whirls forward, with the rotor, if the imaginary part of its eigenvalue is positive; backward if it is negative.

use std::f64::consts::{PI, TAU};

use nalgebra::{Complex, ComplexField, Matrix2, Matrix4, Schur, Vector2};

use crate::bearing::array;
use crate::invalid::Short;
use crate::machine::MACHINES;
use crate::simulation::Scenario;
use crate::table::Table;

type C = Complex<f64>;

/// Number of speed steps in the search for critical speeds.
const SEARCH: usize = 400;

/// Largest relative error of the product of the eigenvalues; with stiffness or damping so large that it is exceeded, rounding hides the motion.
const ROUNDING: f64 = 1e-3;

/// A shaft on springs and dampers.
#[derive(Clone, Debug, PartialEq)]
pub struct Whirl {
    /// Mass, in kg.
    pub m_kg: f64,
    /// Moments of inertia about an axis across the shaft and about its own, in kg·m².
    pub inertia_kgm2: [f64; 2],
    /// Positions of the bearings A and B along the shaft, from the centre of gravity, in m.
    pub bearings_m: [f64; 2],
    /// Stiffness of each bearing, in N/m.
    pub stiffness_n_m: f64,
    /// Damping of each bearing, in N·s/m.
    pub damping_ns_m: f64,
    /// Unbalances: mass times eccentricity in kg·m, angle in rad, position along the shaft in m.
    pub unbalances: [[f64; 3]; 2],
}

impl Whirl {
    /// The shaft of a scenario whose machine is a spindle, on bearings of this stiffness in N/m, above 0, and damping in N·s/m, 0 or above.
    ///
    /// # Errors
    /// A finding about the scenario.
    pub fn new(scenario: &Scenario, stiffness_n_m: f64, damping_ns_m: f64) -> Result<Self, String> {
        if !scenario.machine.tilts() {
            let those: Vec<_> = MACHINES.iter().filter(|machine| machine.tilts()).map(|machine| machine.name).collect();
            let (name, those) = (scenario.machine.name, those.join(", "));
            return Err(format!(
                "machine = {name} is refused: its rotor does not tilt; whirl needs a shaft in two radial bearings, with its moments of \
                 inertia, as in {those}"
            ));
        }
        let real = |name: &str| scenario.number("plant", name);
        Ok(Self {
            m_kg: real("m"),
            inertia_kgm2: [real("Jt"), real("Jp")],
            bearings_m: [real("A.position"), real("B.position")],
            stiffness_n_m,
            damping_ns_m,
            unbalances: [1, 2].map(|plane| {
                ["magnitude", "phase", "position"].map(|name| real(&format!("unbalance[{plane}].{name}")))
            }),
        })
    }

    /// Displacements of the bearings for a unit displacement u and a unit inclination ψ.
    fn bearings(&self) -> Matrix2<C> {
        let [a, b] = self.bearings_m;
        Matrix2::new(1.0, a, 1.0, b).map(C::from)
    }

    fn inertia(&self) -> Matrix2<C> {
        Matrix2::new(self.m_kg, 0.0, 0.0, self.inertia_kgm2[0]).map(C::from)
    }

    /// Stiffness, and damping with the gyroscopic moment, at a speed in rad/s.
    fn forces(&self, omega_rad_s: f64) -> [Matrix2<C>; 2] {
        let at_bearings = self.bearings().transpose() * self.bearings();
        let mut damping = at_bearings * C::from(self.damping_ns_m);
        damping[(1, 1)] -= C::new(0.0, omega_rad_s * self.inertia_kgm2[1]);
        [at_bearings * C::from(self.stiffness_n_m), damping]
    }

    /// Natural frequencies of the two modes in Hz at a speed in rad/s, each backward and forward; the slower mode comes first. At standstill
    /// both directions have the same frequency. NaN where rounding hides the motion.
    pub fn modes_hz(&self, omega_rad_s: f64) -> [[f64; 2]; 2] {
        let [stiffness, damping] = self.forces(omega_rad_s);
        let over = |matrix: Matrix2<C>| -> Matrix2<C> {
            Matrix2::from_fn(|row, column| -matrix[(row, column)] / self.inertia()[(row, row)])
        };
        // d/dt of (q, q̇).
        let mut motion = Matrix4::<C>::zeros();
        motion.fixed_view_mut::<2, 2>(0, 2).fill_with_identity();
        motion.fixed_view_mut::<2, 2>(2, 0).copy_from(&over(stiffness));
        motion.fixed_view_mut::<2, 2>(2, 2).copy_from(&over(damping));
        let (_, triangular) = Schur::new(motion).unpack();
        let rounding = (triangular.diagonal().product() / over(stiffness).determinant() - C::from(1.0)).modulus();
        if rounding.is_nan() || rounding > ROUNDING {
            return [[f64::NAN; 2]; 2];
        }
        let mut found: [f64; 4] = array::from_fn(|n| triangular[(n, n)].im / TAU);
        found.sort_by(f64::total_cmp);
        let [backward_2, backward_1, forward_1, forward_2] = found;
        [[-backward_1, forward_1], [-backward_2, forward_2]]
    }

    /// Displacements `y + i z` of the bearings A and B due to the unbalance, in m, in the rotating frame, at a speed in rad/s.
    pub fn response_m(&self, omega_rad_s: f64) -> [C; 2] {
        let [stiffness, damping] = self.forces(omega_rad_s);
        let square = omega_rad_s * omega_rad_s;
        let dynamic = stiffness - self.inertia() * C::from(square) + damping * C::new(0.0, omega_rad_s);
        let force = self.unbalances.iter().fold(Vector2::zeros(), |sum, [magnitude, phase, position]| {
            let (sin, cos) = libm::sincos(*phase);
            sum + Vector2::new(1.0, *position).map(C::from) * (C::new(cos, sin) * C::from(square * magnitude))
        });
        let found = dynamic.lu().solve(&force).unwrap_or_else(|| Vector2::from_element(C::new(f64::INFINITY, 0.0)));
        (self.bearings() * found).into()
    }

    /// The critical speeds up to `greatest_rpm`, at which a mode whirls forward as fast as the rotor turns, so that unbalance excites it: the
    /// number of the mode, from 1, and the speed in rpm.
    pub fn critical_rpm(&self, greatest_rpm: f64) -> Vec<(usize, f64)> {
        let mut found = Vec::new();
        for mode in 0..2 {
            let ahead = |rpm: f64| self.modes_hz(rpm * PI / 30.0)[mode][1] - rpm / 60.0;
            let at = |step: usize| greatest_rpm * step as f64 / SEARCH as f64;
            for step in 1..=SEARCH {
                let (mut low, mut high) = (at(step - 1), at(step));
                if ahead(low) <= 0.0 || ahead(high) > 0.0 {
                    continue;
                }
                for _ in 0..50 {
                    let middle = 0.5 * (low + high);
                    if ahead(middle) > 0.0 { low = middle } else { high = middle }
                }
                found.push((mode + 1, high));
            }
        }
        found
    }

    /// The critical speeds in a sentence.
    pub fn critical_in_words(&self, greatest_rpm: f64) -> String {
        let of = |(mode, rpm): (usize, f64)| {
            let [a, b] = self.response_m(rpm * PI / 30.0).map(|u| 1e6 * u.modulus());
            format!("{rpm:.0} rpm (mode {mode}, {a:.1} µm at A and {b:.1} µm at B)")
        };
        let found: Vec<_> = self.critical_rpm(greatest_rpm).into_iter().map(of).collect();
        match found.as_slice() {
            [] => format!("There is no critical speed up to {greatest_rpm:.0} rpm."),
            [one] => format!("Critical speed up to {greatest_rpm:.0} rpm: {one}."),
            _ => format!("Critical speeds up to {greatest_rpm:.0} rpm: {}.", found.join(", ")),
        }
    }
}

/// The diagram as a table, with a row for each step of the speed up to `greatest_rpm`.
///
/// # Errors
/// If frequencies or response cannot be computed.
pub fn table(whirl: &Whirl, greatest_rpm: f64, steps: usize) -> Result<Table, String> {
    let head = ["rpm", "1 backward", "1 forward", "2 backward", "2 forward", "A, µm", "A, rad", "B, µm", "B, rad"];
    let row = |step: usize| {
        let rpm = greatest_rpm * step as f64 / steps as f64;
        let omega = rpm * PI / 30.0;
        let frequencies = whirl.modes_hz(omega).concat();
        let response = whirl.response_m(omega).map(|u| [1e6 * u.modulus(), u.argument()]).concat();
        for (what, numbers) in [("natural frequencies", &frequencies), ("response to the unbalance", &response)] {
            if numbers.iter().any(|number| !number.is_finite()) {
                let [rpm, stiffness, damping] = [rpm, whirl.stiffness_n_m, whirl.damping_ns_m].map(Short);
                return Err(format!(
                    "the {what} at {rpm} rpm cannot be computed with a stiffness of {stiffness} N/m and a damping of {damping} N·s/m"
                ));
            }
        }
        let cells = [frequencies, response].concat().into_iter().map(|number| format!("{number:.4}"));
        Ok([format!("{rpm:.0}")].into_iter().chain(cells).collect())
    };
    let rows = (0..=steps).map(row).collect::<Result<Vec<_>, _>>()?;
    let (critical, Whirl { stiffness_n_m, damping_ns_m, .. }) = (whirl.critical_in_words(greatest_rpm), whirl);
    let note = format!(
        "{critical} Natural frequencies in Hz of the two modes, each whirling against the rotor and with it, and response to the unbalance: amplitude and angle at the bearings, each with {stiffness_n_m} N/m and {damping_ns_m} N·s/m."
    );
    Ok(Table::new("Whirl over the speed", note, head, rows))
}
