//! The controller of a spindle: tracking of a path in each radial bearing and, with an axial bearing, of an axial position.
//!
//! The control law is that of [`tracking`](crate::control::tracking). The readings give the coordinates, `q = H⁻¹ r`; the observers see forces
//! and two moments. The generalised force is shared by the two radial bearings, each of which allocates its part as a planar bearing does, and
//! the axial one.

mod path;

pub use path::{BearingPath, Ellipses, SpindlePath, SpindlePathConfig};

use serde::{Deserialize, Serialize};

use crate::bearing::magnet::{Geometry, MagnetsOf};
use crate::bearing::shaft::{self, ACROSS};
use crate::bearing::spindle::{SpindleGeometryOf, SpindleOf, bearing_of, in_bearings};
use crate::control::controller::{
    Controller, ControllerInputOf, ControllerOutputOf, ControllerParameters, ControllerState,
};
use crate::control::tracking::{Arrangement, Tracking, TrackingConfig};
use crate::invalid::Checks;
use crate::machine::Machine;
use crate::variables::Variables;

/// The controller of a spindle with three magnets in each radial bearing, and an axial one.
pub type SpindleController = Controller<SpindleControllerConfig, 5, 8, 3>;

/// Its state.
pub type SpindleControllerState = ControllerState<5, 8, 3>;

/// Its inputs.
pub type SpindleControllerInput = ControllerInputOf<5, 8>;

/// Its outputs.
pub type SpindleControllerOutput = ControllerOutputOf<5, 8>;

/// Configuration of the controller.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Machine)]
#[serde(
    default,
    bound(
        serialize = "[f64; M]: Serialize, [f64; K]: Serialize, [f64; G]: Serialize",
        deserialize = "[f64; M]: Deserialize<'de>, [f64; K]: Deserialize<'de>, [f64; G]: Deserialize<'de>"
    )
)]
pub struct SpindleControllerConfigOf<const N: usize, const M: usize, const K: usize, const G: usize> {
    /// Shaft and bearings as the controller knows them. With `J_p` = 0 it compensates no gyroscopic moments.
    #[nested(prefix = "")]
    pub geometry: SpindleGeometryOf<f64, M>,
    /// The control law; magnets and bearings in the order of [`spindle`](crate::bearing::spindle).
    #[nested(prefix = "")]
    pub law: TrackingConfig<K, G>,
    /// The reference.
    #[nested(prefix = "")]
    pub path: SpindlePathConfig,
}

/// That with three magnets in each radial bearing, and an axial one.
pub type SpindleControllerConfig = SpindleControllerConfigOf<5, 3, 8, 3>;

impl<const N: usize, const M: usize, const K: usize, const G: usize> Default for SpindleControllerConfigOf<N, M, K, G> {
    /// The spindle of the examples, a smallest force of 15 N, and modulation frequencies that are apart in all bearings.
    ///
    /// With tracking poles at 1200 rad/s an unbalance of 8 and 5·10⁻⁵ kg·m in two planes leaves a tracking error of 2.5 µm at
    /// 6000 rpm with current drive and 2.8 µm with voltage drive, with poles at 1000 rad/s 2.9 and 3.3 µm; observers with poles at 5000
    /// rad/s would make as much, but the axial amplifiers reach their limit more often (0.1 µm, 10 mA, seeds 1 to 5).
    fn default() -> Self {
        let law = TrackingConfig::default();
        let mut modulation_hz = law.modulation_hz;
        if N > ACROSS {
            modulation_hz[G - 1] = 90.0;
        }
        Self {
            geometry: SpindleGeometryOf::default(),
            law: TrackingConfig { f0_n: [15.0; G], modulation_hz, tracking_rad_s: 1200.0, ..law },
            path: SpindlePathConfig::default(),
        }
    }
}

impl<const N: usize, const M: usize, const K: usize, const G: usize> ControllerParameters<N, K, G>
    for SpindleControllerConfigOf<N, M, K, G>
{
    type Rotor = SpindleOf<N, M, K>;
    type Curve = Ellipses<N>;

    fn law(&self) -> &TrackingConfig<K, G> {
        &self.law
    }

    fn law_mut(&mut self) -> &mut TrackingConfig<K, G> {
        &mut self.law
    }

    fn omega_mut(&mut self) -> &mut f64 {
        &mut self.path.omega_rad_s
    }

    fn checked(&self, checks: &mut Checks) -> (Tracking<SpindleOf<N, M, K>, N, K, G>, SpindlePath<N>) {
        let spindle = self.geometry.checked(checks);
        let path = SpindlePath::checked(self.path.clone(), self.law.step_s, &spindle, checks);
        (Tracking::checked(self.law.clone(), spindle, checks), path)
    }
}

/// The parts of each bearing, in the order of the magnets.
fn joined<const M: usize, const K: usize>(radial: [[f64; M]; 2], axial: Option<[f64; 2]>) -> [f64; K] {
    let axial = axial.unwrap_or_default();
    std::array::from_fn(|k| match bearing_of::<M>(k) {
        (2, number) => axial[number],
        (bearing, number) => radial[bearing][number],
    })
}

impl<const N: usize, const M: usize, const K: usize, const G: usize> Arrangement<N, K, G> for SpindleOf<N, M, K> {
    const MACHINE: &'static Machine = Machine::of_shaft::<N, M>();

    fn geometry(&self) -> &Geometry<f64, N, K> {
        self.geometry()
    }

    fn inertia(&self) -> [f64; N] {
        self.inertia()
    }

    fn allocate(&self, force: [f64; N], smallest_n: [f64; G]) -> [f64; K] {
        let at = shaft::shared(magnets_at_m(self), force);
        let of = |b: usize| self.bearings()[b].allocate(at[b], &smallest_n[(M - 2) * b..(M - 2) * (b + 1)]);
        joined([of(0), of(1)], self.axial().map(|axial| axial.allocate([force[0]], &smallest_n[G - 1..])))
    }

    fn allocate_with_bias(&self, force: [f64; N], bias_a: [f64; G], per_square: [f64; K]) -> [f64; K] {
        let at = shaft::shared(magnets_at_m(self), force);
        let of = |b: usize| {
            let own = std::array::from_fn(|k| per_square[M * b + k]);
            self.bearings()[b].allocate_with_bias(at[b], &bias_a[(M - 2) * b..], own)
        };
        let along = |axial: &MagnetsOf<1, 2>| {
            axial.allocate_with_bias([force[0]], &bias_a[G - 1..], [per_square[K - 2], per_square[K - 1]])
        };
        joined([of(0), of(1)], self.axial().map(along))
    }

    fn is_paired(&self) -> bool {
        self.bearings().iter().all(|magnets| magnets.is_paired())
    }

    fn gyroscopic(&self, omega_rad_s: f64, rates: [f64; N]) -> [f64; N] {
        self.config().shaft.gyroscopic(omega_rad_s, rates)
    }

    fn coordinates(&self, reading_m: [f64; N]) -> [f64; N] {
        self.coordinates(reading_m)
    }

    fn at_magnets(&self, q: [f64; N]) -> [f64; N] {
        in_bearings(magnets_at_m(self).map(|at_m| shaft::displacement(at_m, q)), q[0])
    }
}

/// Positions of the radial magnets along the shaft, in m.
fn magnets_at_m<const N: usize, const M: usize, const K: usize>(spindle: &SpindleOf<N, M, K>) -> [f64; 2] {
    spindle.config().radial().map(|bearing| bearing.position_m)
}
