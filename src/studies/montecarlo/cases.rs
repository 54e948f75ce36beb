//! Scenarios to study: bearings drawn at random, and settings of a given one.

use std::f64::consts::{PI, TAU};

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use crate::machine::Machine;
use crate::plant::noise::Noise;
use crate::simulation::Scenario;
use fmu_export::variable::Value;

/// Numbers drawn with a seed; the same on every platform.
pub struct Draw {
    uniform: Pcg64,
    normal: Noise,
}

impl Draw {
    /// Different seeds, even neighbouring ones, give independent numbers.
    pub fn new(seed: u64) -> Self {
        Self { uniform: Pcg64::seed_from_u64(seed ^ 0x5eed), normal: Noise::sequence(seed)() }
    }

    /// Uniform between two numbers.
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform.random::<f64>()
    }

    /// Uniform on a logarithmic scale between two numbers above 0.
    pub fn log_uniform(&mut self, low: f64, high: f64) -> f64 {
        libm::exp(self.uniform(libm::log(low), libm::log(high)))
    }

    /// True with this probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.uniform(0.0, 1.0) < probability
    }

    /// One of several, equally likely.
    pub fn one_of<T: Copy>(&mut self, items: &[T]) -> T {
        items[self.uniform.random_range(0..items.len())]
    }

    /// From the standard normal distribution.
    pub fn normal(&mut self) -> f64 {
        self.normal.standard_normal()
    }
}

/// 1 rpm in rad/s.
pub const RPM: f64 = TAU / 60.0;

/// Fraction of the drawn bearings that turn at 1000 rpm, not at 40 to 120 Hz.
const SLOW: f64 = 0.1;
/// Fraction of them whose reference trajectory has lobes.
const LOBED: f64 = 0.5;

/// A bearing with current drive, drawn from the ranges for which the estimator is made; it knows the noise or estimates it.
///
/// | | |
/// |---|---|
/// | mass, gap | 2–15 kg, 0.3–0.8 mm |
/// | magnets | 120° apart ± 0.3 rad each, in any orientation |
/// | λ | 1–6 × 10⁻⁶ N·m²/A², ratios to 2 |
/// | sample time | 50, 100 or 200 µs |
/// | speed | 40–120 Hz, one in ten at 1000 rpm |
/// | trajectory | half axes 0.04–0.18 gaps, every second with 2 to 4 lobes of up to 0.05 gaps |
/// | unbalance, load | 0–60 N, up to half the weight in any direction |
/// | noise | 0.05–2 µm and 5–50 mA, uniform on a logarithmic scale |
/// | controller | first guesses 0.7–1.6 times λ, F0 2–5 N per kg, tracking poles at 500–2000 rad/s, update at 0.2 s |
///
/// `base` provides all other values. The seed determines the bearing; the sensor noise has its own seed.
pub fn drawn(base: &Scenario, seed: u64, noise_known: bool) -> Scenario {
    let mut draw = Draw::new(seed);
    let mut scenario = base.clone();
    let (m, s) = (draw.log_uniform(2.0, 15.0), draw.uniform(3e-4, 8e-4));
    let orientation = draw.uniform(-PI, PI);
    let smallest = draw.log_uniform(1e-6, 3e-6);
    scenario.set_everywhere("m", m);
    scenario.set_everywhere("s", s);
    for k in 1..=3 {
        let alpha = orientation + (k - 1) as f64 * TAU / 3.0 + draw.uniform(-0.3, 0.3);
        scenario.set_everywhere(&format!("alpha[{k}]"), alpha);
        let lambda = smallest * draw.log_uniform(1.0, 2.0);
        let guess = lambda * draw.uniform(0.7, 1.6);
        scenario.set("plant", &format!("lambda[{k}]"), lambda);
        scenario.set_everywhere(&format!("lambda0[{k}]"), guess);
    }
    sample_time(&mut scenario, draw.one_of(&[5e-5, 1e-4, 2e-4]));
    let frequency_hz = draw.uniform(40.0, 120.0);
    let omega = TAU * if draw.chance(SLOW) { 1000.0 / 60.0 } else { frequency_hz };
    let radius = [draw.uniform(0.04, 0.18) * s, draw.uniform(0.04, 0.18) * s];
    let lobes = (draw.one_of(&[2, 3, 4]), draw.uniform(0.0, 0.05) * s);
    let lobes = if draw.chance(LOBED) { lobes } else { (3, 0.0) };
    trajectory(&mut scenario, radius, lobes, omega);
    let force_n = draw.uniform(0.0, 60.0);
    let phase = draw.uniform(-PI, PI);
    unbalance(&mut scenario, force_n / (omega * omega), phase);
    let (load_n, direction) = (draw.uniform(0.0, 0.5) * 9.81 * m, draw.uniform(-PI, PI));
    scenario.set("plant", "pY", load_n * libm::cos(direction));
    scenario.set("plant", "pZ", load_n * libm::sin(direction));
    scenario.set("plant", "theta0", draw.uniform(-PI, PI));
    // The rotor may use half of the gap.
    scenario.set("plant", "touchdown.clearance", 0.5 * s);
    scenario.set("controller", "F0", draw.uniform(2.0, 5.0) * m);
    scenario.set("controller", "bandwidth.tracking", draw.log_uniform(500.0, 2000.0));
    scenario.set("controller", "update.time", 0.2);
    noise(&mut scenario, [draw.log_uniform(5e-8, 2e-6), draw.log_uniform(5e-3, 5e-2)], noise_known);
    scenario
}

/// Sets the sensor noise, in m and A, which the estimator knows or estimates.
pub fn noise(scenario: &mut Scenario, noise: [f64; 2], known: bool) {
    for (name, noise) in [("sensor.positionNoise", noise[0]), ("sensor.currentNoise", noise[1])] {
        scenario.set("plant", name, noise);
        scenario.set("estimator", name, if known { noise } else { 0.0 });
    }
}

/// Sets the speed, in rad/s.
pub fn turning_at(scenario: &mut Scenario, omega: f64) {
    scenario.set("plant", "omega", omega);
    scenario.set("controller", "reference.omega", omega);
}

/// Keeps the rotor at rest in the centre.
pub fn at_rest(scenario: &mut Scenario) {
    centred(scenario);
    turning_at(scenario, 0.0);
}

/// Keeps the rotor in the centre from the start, turning at its speed.
pub fn centred(scenario: &mut Scenario) {
    let machine = scenario.machine;
    let start = [machine.at_start(|coordinate| coordinate.position), machine.at_start(|coordinate| coordinate.rate)];
    for name in start.concat() {
        scenario.set("plant", &name, 0.0);
    }
    let moving = ["rX", "rY", "rZ", "lobeAmplitude", "amplitude"].map(|what| format!("reference.{what}"));
    let controller = scenario.controller().model_type.clone();
    let names = controller.variables().iter().map(|variable| &variable.name);
    for name in names.filter(|name| moving.iter().any(|end| name.ends_with(end))) {
        scenario.set("controller", name, 0.0);
    }
}

/// Sets the sample time of all elements, in s.
pub fn sample_time(scenario: &mut Scenario, step_s: f64) {
    scenario.set("plant", "sensor.Ts", step_s);
    scenario.set_everywhere("Ts", step_s);
    scenario.step_s = step_s;
}

/// Sets the reference trajectory: half axes in m, number and amplitude in m of the lobes, speed in rad/s. The rotor starts on it.
pub fn trajectory(scenario: &mut Scenario, radius: [f64; 2], (lobes, amplitude): (i32, f64), omega: f64) {
    turning_at(scenario, omega);
    scenario.set("plant", "Y0", radius[0] + amplitude);
    scenario.set("plant", "Z0", 0.0);
    scenario.set("plant", "vY0", 0.0);
    scenario.set("plant", "vZ0", (radius[1] + amplitude) * omega);
    scenario.set("controller", "reference.rY", radius[0]);
    scenario.set("controller", "reference.rZ", radius[1]);
    scenario.set("controller", "reference.lobeAmplitude", amplitude);
    scenario.set("controller", "reference.lobes", lobes);
    scenario.set("controller", "reference.shape", if amplitude > 0.0 { 2 } else { 1 });
}

/// The paper's reference trajectory at another speed.
pub fn turn(scenario: &mut Scenario, rpm: f64) {
    trajectory(scenario, [30e-6, 70e-6], (3, 0.0), rpm * RPM);
}

/// Sets the unbalance, in kg·m and rad.
pub fn unbalance(scenario: &mut Scenario, magnitude: f64, phase: f64) {
    scenario.set("plant", "unbalance.magnitude", magnitude);
    scenario.set("plant", "unbalance.phase", phase);
}

/// Voltage drive: the currents are continuous, which the estimator knows.
pub fn voltage_drive(scenario: &mut Scenario) {
    scenario.set_everywhere("drive", 2);
    scenario.set("estimator", "hold", 3);
}

/// Modulates the smallest force by a fraction of F0 at a frequency in Hz.
pub fn modulation(scenario: &mut Scenario, fraction: f64, frequency_hz: f64) {
    scenario.set("controller", "F0.modulation", fraction);
    scenario.set("controller", "F0.modulationFrequency", frequency_hz);
}

/// Speed over time: values in rpm at instants in s, linear in between. The reference trajectory stays the same.
///
/// The plant has the unbalance force `U ω²` of a constant speed; the force `U (ω̇ sin(θ + φ), −ω̇ cos(θ + φ))` of a changing
/// speed is added to the load.
pub fn speed(scenario: &mut Scenario, time_s: &[f64], rpm: &[f64]) {
    let omega: Vec<f64> = rpm.iter().map(|rpm| rpm * RPM).collect();
    scenario.follow(&["plant.omega", "controller.reference.omega"], time_s, omega.iter().copied(), false);
    let profile = scenario.profiles[scenario.profiles.len() - 1].clone();
    let at = |time_s: f64| profile.at(time_s).map_or(f64::NAN, Value::as_f64);
    let step_s = scenario.step_s;
    let [magnitude, phase] = ["unbalance.magnitude", "unbalance.phase"].map(|name| scenario.number("plant", name));
    let mut theta = scenario.number("plant", "theta0");
    let steps = (time_s.last().copied().unwrap_or(0.0) / step_s).round() as usize;
    let instants: Vec<f64> = (0..=steps).map(|step| step as f64 * step_s).collect();
    let forces = instants.iter().map(|time_s| {
        let omega = at(*time_s);
        let tangential = magnitude * (at(time_s + step_s) - omega) / step_s;
        let angle = theta + 0.5 * omega * step_s + phase;
        theta += omega * step_s;
        [tangential * libm::sin(angle), -tangential * libm::cos(angle)]
    });
    add(scenario, &["pY", "pZ"], &instants, &forces.collect::<Vec<_>>());
    let first = omega.first().copied().unwrap_or(0.0);
    let radius = ["reference.rY", "reference.rZ"].map(|name| scenario.number("controller", name));
    trajectory(scenario, radius, (3, 0.0), first);
}

/// Changes λ of one of three magnets, chosen by the seed, by a fraction at an instant in s.
pub fn step_of_lambda(scenario: &mut Scenario, seed: u64, fraction: f64, at_s: f64) {
    let path = format!("lambda[{}]", 1 + seed % 3);
    let value = scenario.number("plant", &path) * (1.0 + fraction);
    scenario.follow(&[&format!("plant.{path}")], &[at_s], [value], true);
}

/// Tolerance of a parameter that the estimator takes as known.
pub struct Tolerance {
    /// Name of the tolerance.
    pub name: &'static str,
    /// The standard deviation studied, in the unit of the variable; for mass and gap relative to their value.
    pub std: f64,
    /// The element with the error: the estimator, or the plant, whose sensors have independent errors.
    element: &'static str,
    variables: fn(&Machine) -> Vec<String>,
}

impl Tolerance {
    const fn of(name: &'static str, std: f64, element: &'static str, variables: fn(&Machine) -> Vec<String>) -> Self {
        Self { name, std, element, variables }
    }

    /// Draws the error and states the tolerance to the estimator.
    pub fn draw(&self, scenario: &mut Scenario, draw: &mut Draw) {
        let std = self.std * if ["m", "s"].contains(&self.name) { scenario.number("plant", self.name) } else { 1.0 };
        for variable in (self.variables)(scenario.machine) {
            let value = scenario.number(self.element, &variable) + std * draw.normal();
            scenario.set(self.element, &variable, value);
        }
        scenario.set("estimator", &format!("tolerance.{}", self.name), std);
    }
}

/// The tolerances studied.
pub static TOLERANCES: [Tolerance; 7] = [
    Tolerance::of("m", 0.01, "estimator", |_| vec!["m".into()]),
    Tolerance::of("s", 0.01, "estimator", |_| vec!["s".into()]),
    Tolerance::of("alpha", PI / 180.0, "estimator", |machine| machine.of_magnets("alpha")),
    Tolerance::of("positionGain", 0.01, "plant", |machine| machine.of_readings("sensor.gainError")),
    Tolerance::of("positionOffset", 1e-5, "plant", |machine| machine.of_readings("sensor.offset")),
    Tolerance::of("currentGain", 0.01, "plant", |machine| machine.of_magnets("sensor.currentGainError")),
    Tolerance::of("currentOffset", 0.01, "plant", |machine| machine.of_magnets("sensor.currentOffset")),
];

/// A fault of a bench: its description, and its effect on a scenario. A change in the estimator makes a stated value wrong.
pub type Fault = (&'static str, fn(&mut Scenario));

/// Faults to study one at a time.
pub const FAULTS: [Fault; 11] = [
    ("gain of the position sensor y, +1 %", |to| raise(to, "plant", &["sensor.gainErrorY"], 0.01)),
    ("gain of both position sensors, +1 %", |to| raise(to, "plant", &["sensor.gainErrorY", "sensor.gainErrorZ"], 0.01)),
    ("gain of current sensor 1, +1 %", |to| raise(to, "plant", &["sensor.currentGainError[1]"], 0.01)),
    ("gap s stated 10 µm too large, 2 %", |to| raise(to, "estimator", &["s"], 1e-5)),
    ("mass stated 0.134 kg too large, 2 %", |to| raise(to, "estimator", &["m"], 0.134)),
    ("angle of magnet 2, 2°", |to| raise(to, "estimator", &["alpha[2]"], PI / 90.0)),
    ("offset of the position sensor y, 10 µm", |to| raise(to, "plant", &["sensor.offsetY"], 1e-5)),
    ("offset of the position sensor z, 10 µm", |to| raise(to, "plant", &["sensor.offsetZ"], 1e-5)),
    ("positions and currents 20 µs late", |to| raise(to, "plant", &["sensor.delay"], 2e-5)),
    ("force that turns backward, 1 N", |to| turning(to, -1.0, 1.0, 0.0, 1.0)),
    ("force that turns backward, 2 N", |to| turning(to, -1.0, 2.0, 0.0, 1.0)),
];

/// Raises variables of an element by the same value.
fn raise(scenario: &mut Scenario, element: &str, variables: &[&str], by: f64) {
    for variable in variables {
        scenario.set(element, variable, scenario.number(element, variable) + by);
    }
}

/// Adds a force in N that rotates at `order` times the speed of the rotor, backward if that is negative, from an angle in rad until an
/// instant in s.
pub fn turning(scenario: &mut Scenario, order: f64, force_n: f64, phase: f64, end_s: f64) {
    let omega = order * scenario.number("plant", "omega");
    push(scenario, &["pY", "pZ"], end_s, |time_s| {
        let (sin, cos) = libm::sincos(omega * time_s + phase);
        [force_n * cos, force_n * sin]
    });
}

/// Adds forces over time, in the units of these inputs of the plant, until an instant in s.
pub fn push<const N: usize>(scenario: &mut Scenario, inputs: &[&str; N], end_s: f64, force: impl Fn(f64) -> [f64; N]) {
    let step_s = scenario.step_s;
    let time_s: Vec<f64> = (0..(end_s / step_s).round() as usize).map(|step| step as f64 * step_s).collect();
    let forces: Vec<_> = time_s.iter().map(|time_s| force(time_s + 0.5 * step_s)).collect();
    add(scenario, inputs, &time_s, &forces);
}

/// Adds values to these inputs of the plant, each held from its instant in s to the next.
fn add<const N: usize>(scenario: &mut Scenario, inputs: &[&str; N], time_s: &[f64], more: &[[f64; N]]) {
    for (n, name) in inputs.iter().enumerate() {
        let constant = scenario.number("plant", name);
        scenario.follow(&[&format!("plant.{name}")], time_s, more.iter().map(|more| constant + more[n]), true);
    }
}
