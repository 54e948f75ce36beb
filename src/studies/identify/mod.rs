//! Identification from recordings of a test bench: maximum likelihood over all rows, and the on-line estimators beside it.

pub mod axial;
pub mod likelihood;

mod agreement;
mod answer;
mod currents;
mod diagnosis;
mod faults;
mod plausible;
mod read;
mod samples;
mod signals;
mod tolerance;
mod track;
mod twin;
mod units;

use std::f64::consts::TAU;

use fmu_export::variable::Value;
use serde_json::{Value as Json, json};

pub use self::agreement::Check;
pub use self::answer::{Answer, Question, answer};
pub use self::currents::{Currents, Holds};
pub use self::tolerance::{ALL, named, of_estimator, quantity, tolerance};
pub use self::track::{Track, recording, statement, track};
pub use self::twin::Twin;

use self::likelihood::{BenchParameter, Body, DELAY, DYNAMICS, Knowledge, LAG, Part};
pub use self::read::{Reading, Unusable};
pub use self::samples::{Rotation, Samples};
use self::tolerance::plain;
use self::track::chosen;
pub use self::units::rate_s;
use self::units::{significant, time};
use crate::bearing::{BearingConfig, RotorConfig, Shaft, array};
use crate::estimation::Hold;
use crate::machine::{Bearing, Machine};
use crate::simulation::Element;
use crate::studies::statistics::{mean, rms};
use crate::table::Table;
use crate::variables::Choice;

/// Name of the power of the gap with which the position noise grows.
pub const NOISE_EXPONENT: &str = "noise.exponent";

/// A machine and its sensors as stated.
#[derive(Clone, Debug)]
pub struct Stated {
    /// The machine.
    pub machine: &'static Machine,
    /// The parts of its motion, with prior knowledge of their bench.
    pub parts: Vec<Part>,
    /// Meaning of a current sample.
    pub hold: Hold,
    /// Standard deviations of the noise of positions, m, and currents, A; 0 to estimate them.
    pub noise: [f64; 2],
}

impl Stated {
    /// The machine as stated by the variables of its estimator.
    pub fn of(machine: &'static Machine, estimator: &Element) -> Self {
        let value = |name: &str| estimator.value(name).map(Value::as_f64);
        let real = |name: &str| value(name).unwrap_or(f64::NAN);
        let bearing = |Bearing { prefix, .. }: &Bearing| {
            let of = |name: &str| real(&format!("{prefix}{name}"));
            let angles: Vec<f64> = (1..).map_while(|k| value(&format!("{prefix}alpha[{k}]"))).collect();
            BearingConfig {
                position_m: of("position"),
                sensor_position_m: of("sensorPosition"),
                gap_m: of("s"),
                alpha_rad: array::from_fn(|k| angles.get(k).copied().unwrap_or(0.0)),
            }
        };
        let shaft = Shaft { m_kg: real("m"), transverse_kgm2: real("Jt"), polar_kgm2: real("Jp") };
        let noise = ["sensor.positionNoise", "sensor.currentNoise"].map(|name| value(name).unwrap_or(0.0));
        let (mut positions, mut magnets) = (0, 0);
        let part = |of: &'static [Bearing]| {
            let bearings = array::from_fn(|b| of.get(b).map(bearing).unwrap_or_default());
            let rotor = RotorConfig { shaft, extent_m: [0.0; 2], bearings };
            let planes_m = [1, 2].map(|plane| real(&format!("unbalance[{plane}].position")));
            let part = Part::new(Body { bearings: of, rotor, planes_m }, positions, magnets);
            positions += part.body.coordinates();
            magnets += part.body.magnets();
            part
        };
        // Radial and axial magnets move different parts.
        let parts = machine.bearings.chunk_by(|a, b| a.is_radial == b.is_radial).map(part).collect();
        Self { machine, parts, hold: chosen(estimator, "hold"), noise }
    }

    /// The parameters of its bench.
    pub fn parameters(&self) -> Vec<BenchParameter> {
        self.bench().cloned().collect()
    }

    fn bench(&self) -> impl Iterator<Item = &BenchParameter> {
        self.parts.iter().flat_map(|part| &part.parameters)
    }

    /// States how well the bench parameter with this number is known.
    pub fn know(&mut self, at: usize, knowledge: Knowledge) {
        let parameter = self.parts.iter_mut().flat_map(|part| &mut part.parameters).nth(at);
        parameter.into_iter().for_each(|parameter| parameter.knowledge = knowledge);
    }

    fn numbers_of_bodies(&self) -> impl Iterator<Item = (String, f64)> {
        self.parts.iter().flat_map(|part| part.body.numbers())
    }

    /// Stated numbers and known loads; the angles of a bearing share one name.
    fn numbers(&self) -> Vec<(String, Vec<f64>)> {
        let mut all: Vec<(String, Vec<f64>)> = Vec::new();
        for (name, value) in self.numbers_of_bodies().chain(self.known_loads()) {
            let name = name.split_once('[').filter(|(group, _)| group.ends_with("alpha")).map_or(&*name, |of| of.0);
            match all.iter_mut().find(|(known, _)| known == name) {
                // A shaft and its axis have the same mass.
                Some((_, values)) => values.extend(name.ends_with("alpha").then_some(value)),
                None => all.push((name.into(), vec![value])),
            }
        }
        all
    }

    /// The same in words.
    fn descriptions(&self) -> Vec<String> {
        let words = |(name, values): (String, Vec<f64>)| {
            let (factor, digits, unit) = match plain(&name) {
                "m" => (1.0, 6, "kg"),
                "s" => (1e3, 6, "mm"),
                "alpha" => (180.0 / std::f64::consts::PI, 5, "°"),
                "Jt" | "Jp" => (1.0, 6, "kg·m²"),
                _ if name.starts_with('M') => (1.0, 6, "N·m"),
                _ if name.starts_with('p') => (1.0, 6, "N"),
                _ => return None,
            };
            let values: Vec<String> = values.iter().map(|value| significant(factor * value, digits)).collect();
            Some(format!("{name} = {} {unit}", values.join(", ")))
        };
        self.numbers().into_iter().filter_map(words).collect()
    }

    /// The same as JSON, in SI units.
    fn json(&self) -> Json {
        let mut known = json!({"hold": self.hold.name()});
        for (name, values) in self.numbers() {
            known[name.as_str()] = if name.ends_with("alpha") { values.into() } else { values[0].into() };
        }
        known
    }

    /// The stated value that a relative bench parameter refers to: for `X.m`, the mass.
    fn value(&self, name: &str) -> f64 {
        let of = |name: &str| self.numbers_of_bodies().find(|(of, _)| of == name).map(|(_, value)| value);
        of(name).or_else(|| of(name.trim_start_matches("X."))).unwrap_or(f64::NAN)
    }

    /// The meaning of its currents.
    pub fn currents(&self) -> Currents {
        Currents { hold: self.hold, lag: self.parts.iter().any(|part| part.settings.lag) }
    }

    /// The same with this meaning of the currents. An added lag is free; an exact delay of the positions then gets a typical tolerance.
    pub fn read_as(mut self, currents: Currents) -> Self {
        let of = |part: Part| {
            let is_new = currents.lag && !part.settings.lag;
            let mut part = part.with(|settings| settings.lag = currents.lag);
            for parameter in part.parameters.iter_mut().filter(|_| is_new) {
                match plain(&parameter.name) {
                    LAG => parameter.knowledge = Knowledge::Free,
                    DELAY if !parameter.is_uncertain() => parameter.knowledge = Knowledge::Tolerance(parameter.typical),
                    _ => {}
                }
            }
            part
        };
        self.parts = self.parts.into_iter().map(of).collect();
        Self { hold: currents.hold, ..self }
    }

    /// Names of the loads in the order of the parts: across the shaft, then along it.
    fn loads(&self) -> Vec<String> {
        let mut names = self.machine.of_coordinates(|coordinate| coordinate.load);
        names.rotate_left(self.parts.len() - 1);
        names
    }

    /// The known loads with their names.
    fn known_loads(&self) -> impl Iterator<Item = (String, f64)> {
        let of = |part: &Part, n: usize| part.settings.load_n.get(n).copied().flatten();
        let values = self.parts.iter().flat_map(move |part| (0..part.body.coordinates()).map(move |n| of(part, n)));
        self.loads().into_iter().zip(values).filter_map(|(name, load_n)| Some((name, load_n?)))
    }

    /// States a load, in N or N·m, if there is one of this name.
    pub fn set_load(&mut self, name: &str, load_n: f64) {
        let Some(at) = self.loads().iter().position(|load| load == name) else { return };
        let first = self.parts[0].body.coordinates();
        let (part, at) = if at < first { (0, at) } else { (1, at - first) };
        let Part { body, settings, .. } = &mut self.parts[part];
        settings.load_n.resize(body.coordinates(), None);
        settings.load_n[at] = Some(load_n);
    }

    /// Adds an effect of real benches, if this is the name of one: κ, the lag of the currents, or the power of the gap in the noise. Without
    /// a prefix, all parts of a shaft that can identify it are meant. κ and the lag become bench parameters, whose knowledge is yet to be stated.
    ///
    /// # Errors
    /// The known load that the effect needs.
    pub fn ask(&mut self, name: &str) -> Result<(), String> {
        let is_dynamics = plain(name) == DYNAMICS;
        if ![DYNAMICS, LAG, NOISE_EXPONENT].contains(&plain(name)) {
            return Ok(());
        }
        let (loads, mut asked, mut wanted) = (self.loads(), false, Vec::new());
        let mut loads = loads.iter();
        for part in &mut self.parts {
            let own: Vec<_> = loads.by_ref().take(part.body.coordinates()).collect();
            if name != plain(name) && name != format!("{}{}", part.body.prefix(), plain(name)) {
                continue;
            }
            let is_identifiable = !is_dynamics || part.settings.is_loaded();
            *part = part.clone().with(|settings| {
                *match plain(name) {
                    DYNAMICS => &mut settings.dynamics,
                    LAG => &mut settings.lag,
                    _ => &mut settings.exponent,
                } |= is_identifiable;
            });
            asked |= is_identifiable;
            wanted.extend(own.into_iter().filter(|load| load.starts_with('p')).map(|load| format!("--set {load}=…")));
        }
        if asked {
            return Ok(());
        }
        let wanted = wanted.join(" or ");
        Err(format!(
            "{name}: it cannot be separated from the force constants without a known load that is not 0: {wanted}"
        ))
    }
}

/// The results of one recording, or of several together, in words, tables and JSON.
#[derive(Clone, Debug)]
pub struct Statement {
    /// Whether the estimates are valid; `None` for on-line methods, which are only compared.
    pub valid: Option<bool>,
    /// The reason.
    pub verdict: String,
    /// Further findings, in sentences.
    pub findings: Vec<String>,
    /// Parameters taken as known.
    pub assumptions: String,
    /// Estimates.
    pub tables: Vec<Table>,
    /// All of it as JSON, in SI units.
    pub json: Json,
}

/// The window of one revolution, in s, rounded to whole samples, at least 8, and at most 0.2 s; the paper's if the speed is not known.
pub fn one_revolution(samples: &Samples) -> f64 {
    let speed_rad_s = mean(&samples.omega_rad_s).abs();
    let window_s = if speed_rad_s > 0.0 { TAU / speed_rad_s } else { 0.02 };
    (window_s.min(0.2) / samples.step_s).round().max(8.0) * samples.step_s
}

/// Acceleration of gravity, m/s².
const GRAVITY_M_S2: f64 = 9.81;
