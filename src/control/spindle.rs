//! The controller of a spindle: tracking of a path in each radial bearing and of an axial position.
//!
//! The control law is that of [`tracking`](crate::control::tracking), with five coordinates and three bearings.
//! The readings give the coordinates, `q = H⁻¹ r`; the observers see three forces and two moments. The generalised force is
//! shared by the two radial bearings, each of which allocates its part as a planar bearing does, and the axial one:

mod path;

pub use path::{BearingPath, SpindlePath, SpindlePathConfig, SpindlePathState};

use serde::{Deserialize, Serialize};

use crate::bearing::magnet::Geometry;
use crate::bearing::shaft::{self, COORDINATES};
use crate::bearing::spindle::{MAGNETS, READINGS, SpindleGeometryOf, SpindleOf, bearing_of};
use crate::control::controller::{Controller, ControllerInputOf, ControllerOutputOf, ControllerParameters, StateOf};
use crate::control::tracking::{Arrangement, Tracking, TrackingConfig};
use crate::invalid::Checks;
use crate::machine::Machine;
use crate::variables::Variables;

/// The controller of a spindle with three magnets in each radial bearing.
pub type SpindleController = Controller<SpindleControllerConfig, COORDINATES, MAGNETS, 3>;

/// Its state.
pub type SpindleControllerState = StateOf<SpindleControllerConfig, COORDINATES, MAGNETS, 3>;

/// Its inputs.
pub type SpindleControllerInput = ControllerInputOf<READINGS, MAGNETS>;

/// Its outputs.
pub type SpindleControllerOutput = ControllerOutputOf<READINGS, MAGNETS>;

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
pub struct SpindleControllerConfigOf<const M: usize, const K: usize, const G: usize> {
    /// Shaft and bearings as the controller knows them. With `J_p` = 0 it compensates no gyroscopic moments.
    #[nested(prefix = "", context = ())]
    pub geometry: SpindleGeometryOf<f64, M>,
    /// The control law; magnets and bearings in the order of [`spindle`](crate::bearing::spindle).
    #[nested(prefix = "")]
    pub law: TrackingConfig<K, G>,
    /// The reference.
    #[nested(prefix = "", context = ())]
    pub path: SpindlePathConfig,
}

/// That with three magnets in each radial bearing.
pub type SpindleControllerConfig = SpindleControllerConfigOf<3, MAGNETS, 3>;

impl<const M: usize, const K: usize, const G: usize> Default for SpindleControllerConfigOf<M, K, G> {
    /// The spindle of the examples, a smallest force of 15 N, and modulation frequencies that are apart in all bearings.
    ///
    /// With tracking poles at 1200 rad/s an unbalance of 8 and 5·10⁻⁵ kg·m in two planes leaves a tracking error of 2.5 µm at
    /// 6000 rpm with current drive and 2.8 µm with voltage drive, with poles at 1000 rad/s 2.9 and 3.3 µm; observers with poles at 5000
    /// rad/s would make as much, but the axial amplifiers reach their limit more often (0.1 µm, 10 mA, seeds 1 to 5).
    fn default() -> Self {
        let law = TrackingConfig::default();
        let mut modulation_hz = law.modulation_hz;
        modulation_hz[G - 1] = 90.0;
        Self {
            geometry: SpindleGeometryOf::default(),
            law: TrackingConfig { f0_n: [15.0; G], modulation_hz, tracking_rad_s: 1200.0, ..law },
            path: SpindlePathConfig::default(),
        }
    }
}

impl<const M: usize, const K: usize, const G: usize> ControllerParameters<COORDINATES, K, G>
    for SpindleControllerConfigOf<M, K, G>
{
    type Rotor = SpindleOf<M, K>;
    type Path = SpindlePath;

    fn law(&self) -> &TrackingConfig<K, G> {
        &self.law
    }

    fn law_mut(&mut self) -> &mut TrackingConfig<K, G> {
        &mut self.law
    }

    fn omega_mut(&mut self) -> &mut f64 {
        &mut self.path.omega_rad_s
    }

    fn checked(&self, checks: &mut Checks) -> (Tracking<SpindleOf<M, K>, COORDINATES, K, G>, SpindlePath) {
        let spindle = self.geometry.checked(checks);
        let path = SpindlePath::checked(self.path.clone(), self.law.step_s, &spindle, checks);
        (Tracking::checked(self.law.clone(), spindle, checks), path)
    }
}

/// The parts of each bearing, in the order of the magnets.
fn joined<const M: usize, const K: usize>(radial: [[f64; M]; 2], axial: [f64; 2]) -> [f64; K] {
    std::array::from_fn(|k| match bearing_of::<M>(k) {
        (2, number) => axial[number],
        (bearing, number) => radial[bearing][number],
    })
}

impl<const M: usize, const K: usize, const G: usize> Arrangement<COORDINATES, K, G> for SpindleOf<M, K> {
    const MACHINE: &'static Machine = Machine::of_shaft(M);

    fn geometry(&self) -> &Geometry<f64, COORDINATES, K> {
        self.geometry()
    }

    fn inertia(&self) -> [f64; COORDINATES] {
        self.inertia()
    }

    fn allocate(&self, force: [f64; COORDINATES], smallest_n: [f64; G]) -> [f64; K] {
        let at = shaft::shared(magnets_at_m(self), force);
        let of = |b: usize| self.bearings()[b].allocate(at[b], &smallest_n[(M - 2) * b..(M - 2) * (b + 1)]);
        joined([of(0), of(1)], self.axial().allocate([force[0]], &smallest_n[G - 1..]))
    }

    fn allocate_with_bias(&self, force: [f64; COORDINATES], bias_a: [f64; G], per_square: [f64; K]) -> [f64; K] {
        let at = shaft::shared(magnets_at_m(self), force);
        let of = |b: usize| {
            let own = std::array::from_fn(|k| per_square[M * b + k]);
            self.bearings()[b].allocate_with_bias(at[b], &bias_a[(M - 2) * b..], own)
        };
        let own = [per_square[2 * M], per_square[2 * M + 1]];
        joined([of(0), of(1)], self.axial().allocate_with_bias([force[0]], &bias_a[G - 1..], own))
    }

    fn is_paired(&self) -> bool {
        self.bearings().iter().all(|magnets| magnets.is_paired())
    }

    fn gyroscopic(&self, omega_rad_s: f64, rates: [f64; COORDINATES]) -> [f64; COORDINATES] {
        self.config().shaft.gyroscopic(omega_rad_s, rates)
    }

    fn coordinates(&self, reading_m: [f64; READINGS]) -> [f64; COORDINATES] {
        self.coordinates(reading_m)
    }

    /// (y, z) in A, (y, z) in B, x.
    fn at_magnets(&self, q: [f64; COORDINATES]) -> [f64; READINGS] {
        let [[a_y, a_z], [b_y, b_z]] = magnets_at_m(self).map(|at_m| shaft::displacement(at_m, q));
        [a_y, a_z, b_y, b_z, q[0]]
    }
}

/// Positions of the radial magnets along the shaft, in m.
fn magnets_at_m<const M: usize, const K: usize>(spindle: &SpindleOf<M, K>) -> [f64; 2] {
    [spindle.config().a.position_m, spindle.config().b.position_m]
}
