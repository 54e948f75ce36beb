//! The controller of a rotor in one bearing: its magnets, and which of them are used.

use serde::{Deserialize, Serialize};

use crate::bearing::magnet::{Geometry, MagnetsOf, alpha_rad};
use crate::control::controller::ControllerParameters;
use crate::control::reference::{Reference, ReferenceConfig};
use crate::control::tracking::{Allocation, Arrangement, Tracking, TrackingConfig};
use crate::invalid::Checks;
use crate::machine::Machine;
use crate::variables::Variables;
use crate::variables::unit::{KILOGRAM, METRE, RADIAN};

pub use crate::bearing::magnet::Used;

/// Configuration of the controller.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Machine)]
#[serde(
    default,
    bound(
        serialize = "[f64; K]: Serialize, [f64; G]: Serialize",
        deserialize = "[f64; K]: Deserialize<'de>, [f64; G]: Deserialize<'de>"
    )
)]
pub struct ControllerConfigOf<const N: usize, const K: usize, const G: usize> {
    /// Mass of the rotor
    #[parameter(name = "m", unit = KILOGRAM, min = 0.0)]
    pub m_kg: f64,
    /// Nominal air gap
    #[parameter(name = "s", unit = METRE, min = 0.0, nominal = 1e-4, display_unit = "mm")]
    pub gap_m: f64,
    /// Angle of magnet {k}; its direction is (sin alpha, cos alpha) in the y-z plane
    #[parameter(name = "alpha", count = context.angles(), unit = RADIAN)]
    pub alpha_rad: [f64; K],
    /// Which magnets are used
    #[parameter(name = "magnets.used", count = usize::from(!context.is_planar()))]
    pub used: Used,
    /// The control law.
    #[nested(prefix = "")]
    pub law: TrackingConfig<K, G>,
    /// The reference trajectory.
    #[nested(prefix = "")]
    pub reference: ReferenceConfig,
}

/// That for the planar rotor of the paper.
pub type ControllerConfig = ControllerConfigOf<2, 3, 1>;

impl<const N: usize, const K: usize, const G: usize> Default for ControllerConfigOf<N, K, G> {
    /// The paper's bearing, or one of the same size, and its first guess; along the axis the rotor rests in the middle.
    fn default() -> Self {
        let at_rest = ReferenceConfig { r_y_m: 0.0, r_z_m: 0.0, ..ReferenceConfig::default() };
        Self {
            m_kg: 6.7,
            gap_m: 5e-4,
            alpha_rad: alpha_rad(),
            used: Used::Both,
            law: TrackingConfig::default(),
            reference: if N == 1 { at_rest } else { ReferenceConfig::default() },
        }
    }
}

impl<const N: usize, const K: usize, const G: usize> ControllerParameters<N, K, G> for ControllerConfigOf<N, K, G> {
    type Rotor = OneBearing<N, K>;
    type Curve = ReferenceConfig;

    fn law(&self) -> &TrackingConfig<K, G> {
        &self.law
    }

    fn law_mut(&mut self) -> &mut TrackingConfig<K, G> {
        &mut self.law
    }

    fn omega_mut(&mut self) -> &mut f64 {
        &mut self.reference.omega_rad_s
    }

    fn checked(&self, checks: &mut Checks) -> (Tracking<OneBearing<N, K>, N, K, G>, Reference<N>) {
        checks.positive("m", self.m_kg, "kg");
        let magnets = MagnetsOf::checked(self.gap_m, self.alpha_rad, checks);
        let rotor = OneBearing { m_kg: self.m_kg, magnets: magnets.clone(), used: self.used };
        checks.require(
            self.used == Used::Both || self.law.allocation == Allocation::SmallestForce,
            "allocation",
            "biasCurrent",
            "smallestForce, for a magnet that is not used has no bias current",
        );
        let law = Tracking::checked(self.law.clone(), rotor, checks);
        (law, Reference::checked(self.reference.clone(), self.law.step_s, &magnets, checks))
    }
}

/// A rotor in one bearing.
#[derive(Clone, Debug, PartialEq)]
pub struct OneBearing<const N: usize, const K: usize> {
    m_kg: f64,
    magnets: MagnetsOf<N, K>,
    used: Used,
}

impl<const N: usize, const K: usize, const G: usize> Arrangement<N, K, G> for OneBearing<N, K> {
    const MACHINE: &'static Machine = Machine::of_one_bearing(N, K);

    fn geometry(&self) -> &Geometry<f64, N, K> {
        self.magnets.geometry()
    }

    fn inertia(&self) -> [f64; N] {
        [self.m_kg; N]
    }

    fn allocate(&self, force_n: [f64; N], smallest_n: [f64; G]) -> [f64; K] {
        let Some(only) = self.used.only() else { return self.magnets.allocate(force_n, &smallest_n) };
        let towards_n = force_n[0] * self.magnets.directions()[only][0];
        std::array::from_fn(|k| if k == only { towards_n.max(smallest_n[0]) } else { 0.0 })
    }

    fn allocate_with_bias(&self, force_n: [f64; N], bias_a: [f64; G], per_square: [f64; K]) -> [f64; K] {
        self.magnets.allocate_with_bias(force_n, &bias_a, per_square)
    }

    fn is_paired(&self) -> bool {
        self.magnets.is_paired()
    }
}
