//! The parameters of a bench: one table of names, units and typical tolerances.
//!
//! Every parameter is the deviation of the bench from its data sheet, 0 where there is none:
//!
//! ```text
//! m_true = m (1 + m)      s_true = s (1 + s) + gap.iron      α_true = alpha + alpha[k]
//! i_true = (i_read − current.offset[k])/(1 + current.gain[k])
//! (Y, Z)_read = diag(1 + g_c + g_d, 1 + g_c − g_d) R(rotation) ((Y, Z)(t − delay) + run-out(θ)) + offset
//! ```
//!
//! with `R(φ) = [cos φ, −sin φ; sin φ, cos φ]`, g_c = `sensor.gain` and g_d = `sensor.gainDifference`. Positive `delay`: positions
//! are read late relative to the currents.

/// Number of bench parameters.
pub const BENCH: usize = 28;

/// One bench parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BenchParameter {
    /// Name, as for `--tolerance` and `--estimate`.
    pub name: &'static str,
    /// SI unit; `1` for a relative error.
    pub unit: &'static str,
    /// Standard deviation of a typical bench, in `unit`: the scale of the parameter, and its contribution to the budget where no
    /// tolerance is told. Gap 1 %, angles 0.5°, offsets 5 µm and gains 0.5 % are those of a careful assembly.
    pub typical: f64,
    /// Whether a typical bench has it at all: its contribution stands in the budget without being asked for.
    pub in_typical_bench: bool,
    /// Description, for tables.
    pub description: &'static str,
}

const fn row(
    name: &'static str,
    unit: &'static str,
    typical: f64,
    in_typical_bench: bool,
    description: &'static str,
) -> BenchParameter {
    BenchParameter { name, unit, typical, in_typical_bench, description }
}

/// 0.5° in rad.
const HALF_DEGREE: f64 = 0.008_726_646_259_971_648;

/// All bench parameters; the index is the parameter's number.
pub const PARAMETERS: [BenchParameter; BENCH] = [
    row("m", "1", 0.01, true, "mass of the rotor, relative"),
    row("s", "1", 0.01, true, "nominal gap, relative"),
    row("alpha[1]", "rad", HALF_DEGREE, true, "angle of magnet 1"),
    row("alpha[2]", "rad", HALF_DEGREE, true, "angle of magnet 2"),
    row("alpha[3]", "rad", HALF_DEGREE, true, "angle of magnet 3"),
    row("sensor.offset[y]", "m", 5e-6, true, "offset of the position sensor y"),
    row("sensor.offset[z]", "m", 5e-6, true, "offset of the position sensor z"),
    row("sensor.gain", "1", 0.005, true, "common gain of the position sensors"),
    row("sensor.gainDifference", "1", 0.005, true, "half the difference of the gains of the sensors y and z"),
    row("sensor.rotation", "rad", HALF_DEGREE, false, "rotation of the sensors about the shaft"),
    row("delay", "s", 2e-5, false, "positions later than currents"),
    row("runout1.forward.cos", "m", 1e-6, false, "run-out, once per turn, turning with the shaft"),
    row("runout1.forward.sin", "m", 1e-6, false, "run-out, once per turn, turning with the shaft"),
    row("runout1.backward.cos", "m", 1e-6, false, "run-out, once per turn, turning against the shaft"),
    row("runout1.backward.sin", "m", 1e-6, false, "run-out, once per turn, turning against the shaft"),
    row("runout2.y.cos", "m", 1e-6, false, "run-out in y, twice per turn"),
    row("runout2.y.sin", "m", 1e-6, false, "run-out in y, twice per turn"),
    row("runout2.z.cos", "m", 1e-6, false, "run-out in z, twice per turn"),
    row("runout2.z.sin", "m", 1e-6, false, "run-out in z, twice per turn"),
    row("current.offset[1]", "A", 0.005, false, "offset of the current sensor 1"),
    row("current.offset[2]", "A", 0.005, false, "offset of the current sensor 2"),
    row("current.offset[3]", "A", 0.005, false, "offset of the current sensor 3"),
    row("current.gain[1]", "1", 0.005, true, "gain of the current sensor 1"),
    row("current.gain[2]", "1", 0.005, true, "gain of the current sensor 2"),
    row("current.gain[3]", "1", 0.005, true, "gain of the current sensor 3"),
    row("gap.iron", "m", 5e-6, false, "length of the iron path as a gap"),
    row("force.backward.cos", "N", 1.0, false, "synchronous force against the rotation"),
    row("force.backward.sin", "N", 1.0, false, "synchronous force against the rotation"),
];

pub(super) const MASS: usize = 0;
pub(super) const GAP: usize = 1;
pub(super) const ALPHA: usize = 2;
pub(super) const OFFSET: usize = 5;
pub(super) const GAIN: usize = 7;
pub(super) const GAIN_DIFFERENCE: usize = 8;
pub(super) const ROTATION: usize = 9;
pub(in crate::studies::identify) const DELAY: usize = 10;
pub(super) const RUNOUT_1: usize = 11;
pub(super) const RUNOUT_2: usize = 15;
pub(super) const CURRENT_OFFSET: usize = 19;
pub(super) const CURRENT_GAIN: usize = 22;
pub(super) const IRON: usize = 25;
pub(super) const BACKWARD: usize = 26;

/// The number of the parameter of this name.
#[must_use]
pub fn by_name(name: &str) -> Option<usize> {
    PARAMETERS.iter().position(|parameter| parameter.name == name)
}

/// How well a bench parameter is known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Knowledge {
    /// It has exactly the told value.
    #[default]
    Exact,
    /// It has the told value with this standard deviation, above 0, in the parameter's unit; it is estimated with the rest.
    Tolerance(f64),
    /// Nothing is known; the told value is where the search starts.
    Free,
}

/// Stated value of one bench parameter.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Told {
    /// The value, in the parameter's unit.
    pub value: f64,
    /// How well it is known.
    pub knowledge: Knowledge,
}
