//! The parameters of a bench: one table of names, units and typical tolerances.
//!
//! Every parameter is a deviation of the bench from its data sheet, 0 if there is none:
//!
//! ```text
//! m_true = m (1 + m)      s_true = s (1 + s) + gap.iron      α_true = alpha + alpha[k]      m_true κ q̈ = forces, κ = 1 + dynamics
//! i_true = (i_read − current.offset[k])/(1 + current.gain[k]), or lag · di_true/dt = that − i_true
//! (Y, Z)_read = diag(1 + g_c + g_d, 1 + g_c − g_d) R ((Y, Z)(t − delay) + run-out(θ)) + offset
//! ```
//!
//! with `R = [cos φ_Y, −sin φ_Y; sin φ_Z, cos φ_Z]`, φ_Y = `sensor.rotation` − `sensor.skew`, φ_Z = `sensor.rotation` + `sensor.skew`,
//! g_c = `sensor.gain` and g_d = `sensor.gainDifference`. Positive `delay`: positions are read late relative to the currents. Each bearing of a shaft
//! has its own parameters, with its prefix; `Jt` and `Jp` are relative to the stated values scaled with the mass, and the axial motion has its own
//! parameters.

use std::f64::consts::PI;

use self::Scope::{Axial, Bearing, Machine, OnShaft, Radial, Shaft};
use super::PartSettings;
use super::body::Body;
use crate::bearing::array;
use crate::machine as names;

/// One bench parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct BenchParameter {
    /// Name, as for `--tolerance` and `--estimate`.
    pub name: String,
    /// SI unit; `1` for a relative error.
    pub unit: &'static str,
    /// Standard deviation on a typical bench, in `unit`: the scale of the parameter, and the basis of its contribution to the budget if no
    /// tolerance is stated. Gap 1 %, angles 0.5°, offsets 5 µm and 5 mA, and gains 0.5 % are those of a careful assembly.
    pub typical: f64,
    /// Description, for tables.
    pub description: String,
    /// How well it is known.
    pub knowledge: Knowledge,
}

impl BenchParameter {
    /// Whether it has a tolerance, or is free.
    #[must_use]
    pub fn is_uncertain(&self) -> bool {
        self.knowledge != Knowledge::Exact
    }
}

/// 0.5° in rad.
const HALF_DEGREE: f64 = PI / 360.0;

/// Scope of a parameter: there is one for each of these.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Scope {
    /// The moving body; κ and the lag only on request.
    Machine,
    /// The shaft, if it tilts.
    Shaft,
    /// Each bearing.
    Bearing,
    /// Each radial bearing.
    Radial,
    /// Each of several bearings on a shaft.
    OnShaft,
    /// An axial bearing.
    Axial,
}

/// Scope, name, unit, typical tolerance and description; `{}` in a name stands for the number of each magnet.
type Row = (Scope, &'static str, &'static str, f64, &'static str);

/// All parameters, in the order of their indices.
const PARAMETERS: [Row; 33] = [
    (Machine, "m", "1", 0.01, "mass of the rotor, relative"),
    (Bearing, "s", "1", 0.01, "nominal gap, relative"),
    (Radial, "alpha[{}]", "rad", HALF_DEGREE, "angle of magnet {}"),
    (Radial, "sensor.offset[y]", "m", 5e-6, "offset of the position sensor y"),
    (Radial, "sensor.offset[z]", "m", 5e-6, "offset of the position sensor z"),
    (Axial, "sensor.offset", "m", 5e-6, "offset of the position sensor"),
    (Radial, "sensor.gain", "1", 0.005, "common gain of the position sensors"),
    (Radial, GAIN_DIFFERENCE, "1", 0.005, "half the difference of the gains of the sensors y and z"),
    (Axial, "sensor.gain", "1", 0.005, "gain of the position sensor"),
    (Radial, "sensor.rotation", "rad", HALF_DEGREE, "rotation of the sensors about the shaft"),
    (Radial, "sensor.skew", "rad", HALF_DEGREE, "half of what the sensors y and z lack to 90° between them"),
    (Machine, DELAY, "s", 2e-5, "positions later than currents"),
    (Radial, "runout1.forward.cos", "m", 1e-6, "run-out, once per turn, turning with the shaft"),
    (Radial, "runout1.forward.sin", "m", 1e-6, "run-out, once per turn, turning with the shaft"),
    (Radial, "runout1.backward.cos", "m", 1e-6, "run-out, once per turn, turning against the shaft"),
    (Radial, "runout1.backward.sin", "m", 1e-6, "run-out, once per turn, turning against the shaft"),
    (Radial, "runout2.y.cos", "m", 1e-6, "run-out in y, twice per turn"),
    (Radial, "runout2.y.sin", "m", 1e-6, "run-out in y, twice per turn"),
    (Radial, "runout2.z.cos", "m", 1e-6, "run-out in z, twice per turn"),
    (Radial, "runout2.z.sin", "m", 1e-6, "run-out in z, twice per turn"),
    (Bearing, "current.offset[{}]", "A", 0.005, "offset of the current sensor {}"),
    (Bearing, "current.gain[{}]", "1", 0.005, "gain of the current sensor {}"),
    (Bearing, IRON, "m", 5e-6, "length of the iron path as a gap"),
    (Radial, "force.backward.cos", "N", 1.0, "synchronous force against the rotation"),
    (Radial, "force.backward.sin", "N", 1.0, "synchronous force against the rotation"),
    (Shaft, "Jt", "1", 0.01, "transverse moment of inertia, relative to that of the mass"),
    (Shaft, "Jp", "1", 0.01, "polar moment of inertia, relative to that of the mass"),
    (OnShaft, "position", "m", 5e-4, "position of the magnets along the shaft"),
    (OnShaft, "sensorPosition", "m", 5e-4, "position of the sensors along the shaft"),
    (Shaft, "unbalance[1].position", "m", 5e-4, "position of plane 1 of the unbalance"),
    (Shaft, "unbalance[2].position", "m", 5e-4, "position of plane 2 of the unbalance"),
    (Machine, DYNAMICS, "1", 0.05, "κ − 1, by how much more force accelerations take than the statics say"),
    (Machine, LAG, "s", 2e-5, "time constant with which the currents follow their commands"),
];

/// Name of half the difference between the gains of a pair of position sensors.
pub(super) const GAIN_DIFFERENCE: &str = "sensor.gainDifference";

/// Name of the length of the iron path.
pub(super) const IRON: &str = "gap.iron";

/// Name of the delay of the positions.
pub(in crate::studies::identify) const DELAY: &str = "delay";

/// Name of the factor between statics and dynamics.
pub(in crate::studies::identify) const DYNAMICS: &str = "dynamics";

/// Name of the time constant of the amplifiers.
pub(in crate::studies::identify) const LAG: &str = "lag";

/// Bench parameters of a body by index, including κ and the lag of the currents if requested. Those of a bearing have its prefix.
#[must_use]
pub fn parameters(body: &Body, settings: &PartSettings) -> Vec<BenchParameter> {
    let (is_radial, is_shaft, magnets) = (!body.is_axis(), body.is_shaft(), body.bearings[0].magnets);
    let applies = |(scope, name, ..): &Row| match scope {
        Machine => (*name != DYNAMICS || settings.dynamics) && (*name != LAG || settings.lag),
        Shaft | OnShaft => is_shaft,
        Bearing => true,
        Radial => is_radial,
        Axial => !is_radial,
    };
    let of = |(scope, name, unit, typical, description): Row| {
        let prefixes = match scope {
            // The axial motion has a mass and a delay of its own.
            Machine | Shaft => vec![body.prefix()],
            _ => body.bearings.iter().map(|bearing| bearing.prefix).collect(),
        };
        let count = if name.contains("{}") { magnets } else { 1 };
        let instances = prefixes.into_iter().flat_map(move |prefix| (1..=count).map(move |number| (prefix, number)));
        instances.map(move |(prefix, number)| {
            let numbered = |text: &str| text.replace("{}", &number.to_string());
            BenchParameter {
                name: format!("{prefix}{}", numbered(name)),
                unit,
                typical,
                description: numbered(description),
                knowledge: Knowledge::Exact,
            }
        })
    };
    PARAMETERS.into_iter().filter(applies).flat_map(of).collect()
}

/// Index of the parameter with this name.
#[must_use]
pub fn by_name(parameters: &[BenchParameter], name: &str) -> Option<usize> {
    parameters.iter().position(|parameter| parameter.name == name)
}

/// Indices of the parameters in the equations.
#[derive(Clone, Debug)]
pub(super) struct Places {
    /// By pair of position sensors.
    pub pairs: Vec<Sensors>,
    /// Offset and gain of the sensor of an axis.
    pub single: Option<[usize; 2]>,
    pub mass: usize,
    pub delay: usize,
    /// If requested.
    pub dynamics: Option<usize>,
    pub lag: Option<usize>,
    /// Of a shaft: moments of inertia across and along it, and positions of the planes of unbalance.
    pub shaft: [Option<usize>; 4],
    /// By bearing: relative gap, iron path, positions of the magnets and of the sensors, angles of the magnets.
    pub bearings: Vec<[Option<usize>; 8]>,
    /// Of the first magnet; the others follow.
    pub current_offset: usize,
    pub current_gain: usize,
    /// cos and sin of the first bearing; those of the others follow.
    pub backward: [usize; 2],
}

/// Indices of the parameters of a pair of position sensors.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sensors {
    /// y, z.
    pub offset: [usize; 2],
    pub gain: usize,
    pub gain_difference: usize,
    pub rotation: usize,
    pub skew: usize,
    /// Once per turn: cos and sin, forward, then backward; twice per turn: cos and sin of y, then of z.
    pub runout: [usize; 8],
}

impl Places {
    pub fn of(body: &Body, parameters: &[BenchParameter]) -> Self {
        let find = |prefix: &str, name: &str| by_name(parameters, &format!("{prefix}{name}"));
        let place = |prefix: &str, name: &str| {
            find(prefix, name).unwrap_or_else(|| unreachable!("{prefix}{name} is in the table"))
        };
        let is_axis = body.is_axis();
        let first = |name: &str| place(body.bearings[0].prefix, name);
        let pair = |bearing: &names::Bearing| {
            let at = |name: &str| place(bearing.prefix, name);
            let once = ["forward.cos", "forward.sin", "backward.cos", "backward.sin"].map(|of| format!("runout1.{of}"));
            let twice = ["y.cos", "y.sin", "z.cos", "z.sin"].map(|of| format!("runout2.{of}"));
            let runout = [once, twice];
            Sensors {
                offset: ["sensor.offset[y]", "sensor.offset[z]"].map(at),
                gain: at("sensor.gain"),
                gain_difference: at(GAIN_DIFFERENCE),
                rotation: at("sensor.rotation"),
                skew: at("sensor.skew"),
                runout: array::from_fn(|part| at(&runout[part / 4][part % 4])),
            }
        };
        let of_bearing = ["s", IRON, "position", "sensorPosition", "alpha[1]", "alpha[2]", "alpha[3]", "alpha[4]"];
        Self {
            pairs: body.bearings.iter().filter(|_| !is_axis).map(pair).collect(),
            single: is_axis.then(|| ["sensor.offset", "sensor.gain"].map(first)),
            mass: place(body.prefix(), "m"),
            delay: place(body.prefix(), DELAY),
            dynamics: find(body.prefix(), DYNAMICS),
            lag: find(body.prefix(), LAG),
            shaft: ["Jt", "Jp", "unbalance[1].position", "unbalance[2].position"].map(|name| find("", name)),
            bearings: body.bearings.iter().map(|bearing| of_bearing.map(|name| find(bearing.prefix, name))).collect(),
            current_offset: first("current.offset[1]"),
            current_gain: first("current.gain[1]"),
            backward: if is_axis { [0; 2] } else { ["force.backward.cos", "force.backward.sin"].map(first) },
        }
    }
}

/// How well a bench parameter is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Knowledge {
    /// 0: the bench is as stated.
    Exact,
    /// 0 with this standard deviation, above 0, in the parameter's unit; it is estimated with the others. If only the mass has
    /// one, it is estimated only with a known load: otherwise the data do not determine it.
    Tolerance(f64),
    /// Unknown; the search starts at 0.
    Free,
}

impl Knowledge {
    /// The standard deviation of a tolerance.
    pub(in crate::studies::identify) fn tolerance(self) -> Option<f64> {
        if let Self::Tolerance(std) = self { Some(std) } else { None }
    }
}
