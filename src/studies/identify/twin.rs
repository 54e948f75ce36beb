//! The twin of a bench: plant, controller and estimator with the identified values, as a scenario.
//!
//! It is based on a scenario of the bench, whose values are replaced by those identified. Controller and estimator take the estimate as their
//! first guess; the standard deviations become `tolerance.*` of the estimator.

use super::answer::Answer;
use super::likelihood::{DYNAMICS, Part};
use super::samples::Samples;
use super::tolerance::plain;
use super::{Stated, mean, rms};
use crate::machine::Bearing;
use crate::simulation::{Scenario, simulate};

/// Communication steps of the run: 0.4 s at 10 kHz.
const STEPS: f64 = 4000.0;
/// Parameters of the bench that no plant has.
const WITHOUT: [&str; 6] = ["sensor.rotation", "sensor.skew", "delay", "lag", "runout1", "runout2"];

/// A machine with the identified values.
#[derive(Clone)]
pub struct Twin {
    /// The machine.
    pub scenario: Scenario,
    /// Estimated parameters that the plant does not have, by name.
    pub left_out: Vec<&'static str>,
}

impl Stated {
    /// Parameters of the plant for a bench with the errors `of(name)` that turns from the angle θ₀ in rad at the speed ω in rad/s. The plant has
    /// no rotation, skew or run-out of the sensors, no delay of the positions alone, no lag of the currents, and for a shaft no backward forces.
    pub fn with(&self, [theta0_rad, omega_rad_s]: [f64; 2], of: impl Fn(&str) -> f64) -> Vec<(String, f64)> {
        // κ acts like an error of the mass.
        let heavier = (1.0 + of("m")) * (1.0 + of(DYNAMICS));
        let mut values = Vec::new();
        for Part { body, .. } in &self.parts {
            let is_axis = body.is_axis();
            for (name, stated) in body.numbers() {
                let error = of(&name);
                let value = match plain(&name) {
                    "m" if is_axis => continue,
                    "m" => stated * heavier,
                    "Jt" | "Jp" => stated * heavier * (1.0 + error),
                    "s" => stated * (1.0 + error) + of(&format!("{}gap.iron", name.trim_end_matches('s'))),
                    _ => stated + error,
                };
                values.push((name, value));
            }
            for Bearing { prefix, magnets, .. } in body.bearings {
                let of = |name: &str| of(&format!("{prefix}{name}"));
                let mut put = |name: &str, value: f64| values.push((format!("{prefix}{name}"), value));
                for k in 1..=*magnets {
                    put(&format!("sensor.currentOffset[{k}]"), of(&format!("current.offset[{k}]")));
                    put(&format!("sensor.currentGainError[{k}]"), of(&format!("current.gain[{k}]")));
                }
                let (gain, half) = (of("sensor.gain"), of("sensor.gainDifference"));
                if is_axis {
                    put("sensor.offset", of("sensor.offset"));
                    put("sensor.gainError", gain);
                } else {
                    for (axis, own, gain) in [("Y", "y", gain + half), ("Z", "z", gain - half)] {
                        put(&format!("sensor.offset{axis}"), of(&format!("sensor.offset[{own}]")));
                        put(&format!("sensor.gainError{axis}"), gain);
                    }
                }
            }
            if !is_axis && !body.is_shaft() {
                // B_c cos θ + B_s sin θ in y, −B_c sin θ + B_s cos θ in z, as sines of ωt.
                let (c, s) = (of("force.backward.cos"), of("force.backward.sin"));
                for (axis, cos, sin) in [("Y", c, s), ("Z", s, -c)] {
                    values.push((format!("perturbation.amplitude{axis}"), cos.hypot(sin)));
                    if cos != 0.0 || sin != 0.0 {
                        values.push((format!("perturbation.phase{axis}"), libm::atan2(cos, sin) + theta0_rad));
                        values.push(("perturbation.omega".to_owned(), omega_rad_s));
                    }
                }
            }
        }
        values
    }
}

impl Twin {
    /// The scenario of the bench before identified values replace its own. The sample time is rounded to four digits: recordings have their own
    /// clocks, and libcosim counts nanoseconds. If it is longer than by default, bandwidths of the controller that are not stated are reduced in
    /// proportion.
    pub(super) fn of(base: &Scenario, step_s: f64, verdict: &str) -> Self {
        let mut scenario = base.clone();
        scenario.title = "Identified from a recording".into();
        scenario.description = verdict.into();
        scenario.remove_compared();
        scenario.profiles.clear();
        scenario.balance_s = None;
        // The tolerances of the estimator replace those of the bench.
        scenario.tolerance.clear();
        scenario.changes.clear();
        let step_s = format!("{step_s:.3e}").parse().unwrap_or(step_s);
        (scenario.step_s, scenario.duration_s) = (step_s, STEPS * step_s);
        let mut twin = Self { scenario, left_out: Vec::new() };
        ["sensor.Ts", "Ts"].iter().for_each(|name| twin.scenario.set_everywhere(name, step_s));
        let plain = Scenario::plain(base.machine);
        let slower = plain.number("controller", "Ts") / step_s;
        if slower < 1.0 {
            for name in ["tracking", "observer", "current", "reference"].map(|of| format!("bandwidth.{of}")) {
                twin.put_unless_stated("controller", &name, slower * plain.number("controller", &name));
            }
        }
        twin
    }

    /// Sets a variable, unless the scenario states it.
    pub(super) fn put_unless_stated(&mut self, element: &str, name: &str, value: f64) {
        if !self.scenario.is_stated(element, name) {
            self.scenario.set(element, name, value);
        }
    }

    /// Sets a force constant of the plant, which is the first guess of the others.
    pub(super) fn put_lambda(&mut self, name: &str, value: f64) {
        self.scenario.set_everywhere(name, value);
        self.scenario.set_everywhere(&name.replace("lambda", "lambda0"), value);
    }

    /// Sets a tolerance of the estimator, if there is one.
    pub(super) fn put_tolerance(&mut self, name: &str, std: f64) {
        if std > 0.0 {
            self.scenario.set("estimator", &format!("tolerance.{name}"), std);
        }
    }

    /// Sets the sensor noise, in m and A, of the plant and that assumed by the estimator.
    pub(super) fn put_noise(&mut self, position_m: f64, current_a: f64) {
        self.scenario.set_everywhere("sensor.positionNoise", position_m);
        self.scenario.set_everywhere("sensor.currentNoise", current_a);
    }

    /// The twin, if all models accept its values.
    ///
    /// # Errors
    /// All values that a model refuses.
    pub(super) fn checked(self) -> Result<Self, Vec<String>> {
        simulate::check(&self.scenario).map_err(|refused| refused.0)?;
        Ok(self)
    }
}

impl Answer {
    /// The bearing with the stated and the identified values, those of the first recording if recordings differ. `base` is the
    /// scenario of the bench.
    ///
    /// # Errors
    /// The answer is not valid, or all values that a model refuses.
    pub fn twin(&self, base: &Scenario, samples: &Samples) -> Result<Twin, Vec<String>> {
        let found = self.found.as_ref().filter(|_| self.valid).ok_or_else(|| vec![self.verdict.clone()])?;
        let (stated, first) = (&self.question.stated, &found.conditions[0]);
        let bench = |name: &str| found.bench.iter().find(|of| of.parameter.name == name);
        let of = |name: &str| bench(name).map_or(0.0, |bench| bench.estimate.value);
        let std = |name: &str| match bench(name) {
            Some(bench) if bench.estimated => bench.estimate.total_std,
            // Not separable from the others: known as before.
            bench => bench.and_then(|bench| bench.parameter.knowledge.tolerance()).unwrap_or(0.0),
        };
        // The estimator assumes exact sensors: their errors add to its uncertainty.
        let error = |name: &str| of(name).hypot(std(name));
        let omega_rad_s = mean(&samples.omega_rad_s);
        let machine = base.machine;

        let mut twin = Twin::of(base, samples.step_s, &self.verdict);
        for (name, value) in stated.with([base.number("plant", "theta0"), omega_rad_s], of) {
            for element in ["plant", "controller", "estimator"] {
                if element != "plant" || value != 0.0 || base.is_stated(element, &name) {
                    twin.scenario.set(element, &name, value);
                }
            }
            if let Some(prefix) = name.strip_suffix('s').filter(|prefix| prefix.is_empty() || prefix.ends_with('.')) {
                twin.put_unless_stated("plant", &format!("{prefix}touchdown.clearance"), 0.5 * value);
            }
        }
        for (lambda, found) in machine.of_magnets("lambda").iter().zip(&found.lambda) {
            twin.put_lambda(lambda, found.value);
        }
        let of_planes = |name| machine.of_planes(name).into_iter();
        for ((magnitude, phase), found) in of_planes("magnitude").zip(of_planes("phase")).zip(&found.unbalance) {
            twin.scenario.set("plant", &magnitude, found.magnitude.value);
            twin.scenario.set("plant", &phase, found.phase.value);
        }
        for (name, load) in stated.loads().iter().zip(&first.load_n) {
            twin.scenario.set("plant", name, load.value);
        }
        twin.scenario.set("plant", "omega", omega_rad_s);
        twin.put_noise(first.parts[0].position_noise_m, first.parts[0].current_noise_a);
        // A tolerance of the estimator applies to all bearings and magnets.
        let of_all = |begin: &str, of: &dyn Fn(&str) -> f64| {
            let names = found.bench.iter().map(|of| of.parameter.name.as_str());
            rms(names.filter(|name| plain(name).starts_with(begin)).map(of))
        };
        let of_bearings = |of: &dyn Fn(&str) -> f64| rms(machine.bearings.iter().map(|bearing| of(bearing.prefix)));
        twin.put_tolerance("m", stated.value("m") * std("m").hypot(std(DYNAMICS)));
        let gap = |prefix: &str| {
            let [gap, iron] = ["s", "gap.iron"].map(|name| format!("{prefix}{name}"));
            (stated.value(&gap) * std(&gap)).hypot(std(&iron))
        };
        twin.put_tolerance("s", of_bearings(&gap));
        twin.put_tolerance("alpha", of_all("alpha", &std));
        let gain = |prefix: &str| {
            let [common, half] = ["sensor.gain", "sensor.gainDifference"].map(|name| error(&format!("{prefix}{name}")));
            common.hypot(half)
        };
        twin.put_tolerance("positionGain", of_bearings(&gain));
        twin.put_tolerance("positionOffset", of_all("sensor.offset", &error));
        twin.put_tolerance("currentGain", of_all("current.gain", &error));
        twin.put_tolerance("currentOffset", of_all("current.offset", &error));
        twin.put_tolerance("Jt", stated.value("Jt") * std("Jt"));
        twin.put_tolerance("Jp", stated.value("Jp") * std("Jp"));
        twin.put_tolerance("position", of_all("position", &std));
        twin.put_tolerance("sensorPosition", of_all("sensorPosition", &std));
        twin.put_tolerance("unbalancePosition", of_all("unbalance", &std));

        let estimated = || found.bench.iter().filter(|of| of.estimated).map(|of| plain(&of.parameter.name));
        let backward = (stated.parts.len() > 1).then_some("force.backward");
        let without = WITHOUT.into_iter().chain(backward);
        let left_out = without.filter(|name| estimated().any(|estimated| estimated.starts_with(name)));
        let along = bench("X.dynamics").map(|_| "X.dynamics");
        let slow_force = first.parts.iter().any(|part| part.slow_force_n > 0.0).then_some("force.slow");
        let exponent = first.parts.iter().any(|part| part.noise_exponent.is_some()).then_some("noise.exponent");
        twin.left_out = left_out.chain(along).chain(slow_force).chain(exponent).collect();
        twin.checked()
    }
}
