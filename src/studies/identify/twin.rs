//! The twin of a bench: plant, controller and estimator with the values that were identified, as a scenario.
//!
//! A scenario of the bench is the base; what was identified replaces its values. Controller and estimator take the estimate as their first
//! guess. What the estimator cannot know better, its `tolerance.*`, follows from ±.

use fmu_export::variable::Value;

use super::answer::Answer;
use super::likelihood::{Knowledge, PARAMETERS, by_name};
use super::read::Samples;
use super::track::Track;
use crate::simulation::scenario::Scenario;
use crate::simulation::simulate;

/// Communication steps of the run: 0.4 s at 10 kHz.
const STEPS: f64 = 4000.0;
/// Parameters of the bench that no plant has.
const WITHOUT: [&str; 4] = ["sensor.rotation", "delay", "runout1", "runout2"];

/// A machine with the values that were identified.
#[derive(Clone)]
pub struct Twin {
    /// The machine.
    pub scenario: Scenario,
    /// Estimated parameters that the plant does not have, by name.
    pub left_out: Vec<&'static str>,
}

/// The planar rotor as stated, without errors of the bench.
#[derive(Clone, Copy, Debug)]
pub struct Stated {
    /// Mass, kg.
    pub m_kg: f64,
    /// Nominal gap, m.
    pub gap_m: f64,
    /// Angles of the magnets, rad.
    pub alpha_rad: [f64; 3],
    /// Angle at the start, rad.
    pub theta0_rad: f64,
    /// Speed, rad/s.
    pub omega_rad_s: f64,
}

impl Stated {
    /// Parameters of the plant, by name, of a bench with these errors, by their names in [`PARAMETERS`]. The plant has no rotation and no run-out of the
    /// sensors, and no delay of the positions alone.
    pub fn with(&self, of: impl Fn(&str) -> f64) -> Vec<(String, f64)> {
        let mut values = vec![
            ("m".to_owned(), self.m_kg * (1.0 + of("m"))),
            ("s".to_owned(), self.gap_m * (1.0 + of("s")) + of("gap.iron")),
        ];
        for k in 1..=3 {
            let alpha = format!("alpha[{k}]");
            let alpha_rad = self.alpha_rad[k - 1] + of(&alpha);
            values.push((alpha, alpha_rad));
            values.push((format!("sensor.currentOffset[{k}]"), of(&format!("current.offset[{k}]"))));
            values.push((format!("sensor.currentGainError[{k}]"), of(&format!("current.gain[{k}]"))));
        }
        let (common, half) = (of("sensor.gain"), of("sensor.gainDifference"));
        for (axis, own, gain) in [("Y", "y", common + half), ("Z", "z", common - half)] {
            values.push((format!("sensor.offset{axis}"), of(&format!("sensor.offset[{own}]"))));
            values.push((format!("sensor.gainError{axis}"), gain));
        }
        // B_c cos θ + B_s sin θ in y, −B_c sin θ + B_s cos θ in z, as sines of ωt.
        let (c, s) = (of("force.backward.cos"), of("force.backward.sin"));
        for (axis, cos, sin) in [("Y", c, s), ("Z", s, -c)] {
            values.push((format!("perturbation.amplitude{axis}"), cos.hypot(sin)));
            if cos != 0.0 || sin != 0.0 {
                values.push((format!("perturbation.phase{axis}"), libm::atan2(cos, sin) + self.theta0_rad));
                values.push(("perturbation.omega".to_owned(), self.omega_rad_s));
            }
        }
        values
    }
}

/// Values by element and variable, gathered before they are set.
#[derive(Default)]
pub(super) struct Values(Vec<(&'static str, String, Value)>);

impl Values {
    /// A value of a variable of an element.
    pub fn put(&mut self, element: &'static str, name: &str, value: f64) {
        self.put_value(element, name, Value::Real(value));
    }

    /// A value of any type.
    pub fn put_value(&mut self, element: &'static str, name: &str, value: Value) {
        self.0.push((element, name.into(), value));
    }

    /// A value, unless the scenario states one.
    pub fn put_unless_stated(&mut self, base: &Scenario, element: &'static str, name: &str, value: f64) {
        if !base.is_stated(element, name) {
            self.put(element, name, value);
        }
    }

    /// A tolerance of the estimator, unless it is 0.
    pub fn put_tolerance(&mut self, name: &str, std: f64) {
        if std > 0.0 {
            self.put("estimator", &format!("tolerance.{name}"), std);
        }
    }

    /// Noise of the sensors, m and A, as the plant makes it and the estimator expects it.
    pub fn put_noise(&mut self, position_m: f64, current_a: f64) {
        for element in ["plant", "estimator"] {
            self.put(element, "sensor.positionNoise", position_m);
            self.put(element, "sensor.currentNoise", current_a);
        }
    }

    /// The sample time, rounded to four digits and returned: recordings have clocks of their own, and libcosim counts nanoseconds.
    /// Where it is longer than that of the start values, the bandwidths of the controller are lower in proportion, unless the scenario
    /// states them.
    pub fn put_sample_time(&mut self, base: &Scenario, step_s: f64) -> f64 {
        let step_s = format!("{step_s:.3e}").parse().unwrap_or(step_s);
        let plain = Scenario::plain(base.machine);
        let slower = start(&plain, "controller", "Ts") / step_s;
        for (element, name) in [("plant", "sensor.Ts"), ("controller", "Ts"), ("estimator", "Ts")] {
            self.put(element, name, step_s);
        }
        if slower < 1.0 {
            for name in ["tracking", "observer", "current", "reference"].map(|of| format!("bandwidth.{of}")) {
                self.put_unless_stated(base, "controller", &name, slower * start(&plain, "controller", &name));
            }
        }
        step_s
    }

    /// The twin with these values.
    ///
    /// # Errors
    /// All values that a model refuses.
    pub fn twin(self, base: &Scenario, step_s: f64, verdict: &str) -> Result<Twin, Vec<String>> {
        let mut scenario = base.clone();
        scenario.title = "Identified from a recording".into();
        scenario.description = verdict.into();
        (scenario.step_s, scenario.duration_s) = (step_s, STEPS * step_s);
        scenario.remove_observers();
        scenario.profiles.clear();
        scenario.balance_s = None;
        // The tolerances of the estimator say how well the bench is known now.
        scenario.tolerance.clear();
        scenario.changes.clear();
        for (element, name, value) in self.0 {
            scenario.set(element, &name, value);
        }
        match simulate::refused(&scenario) {
            refused if refused.is_empty() => Ok(Twin { scenario, left_out: Vec::new() }),
            refused => Err(refused),
        }
    }
}

impl Answer {
    /// The bearing with the stated and the identified values, those of the first recording where recordings differ. `base` is the
    /// scenario of the bench.
    ///
    /// # Errors
    /// The answer is not valid, or all values that a model refuses.
    pub fn twin(&self, base: &Scenario, samples: &Samples) -> Result<Twin, Vec<String>> {
        let found = self.found.as_ref().filter(|_| self.valid).ok_or_else(|| vec![self.verdict.clone()])?;
        let (config, first) = (&self.question.config, &found.conditions[0]);
        let bench = |name: &str| by_name(name).map(|at| &found.bench[at]);
        let of = |name: &str| bench(name).map_or(0.0, |bench| bench.estimate.value);
        let std = |name: &str| match bench(name) {
            Some(bench) if bench.estimated => bench.estimate.total_std,
            // Not separated from the rest: known as before.
            Some(bench) => match bench.told.knowledge {
                Knowledge::Tolerance(std) => std,
                _ => 0.0,
            },
            None => 0.0,
        };
        // The estimator takes sensors for exact, so that their errors are part of what it does not know.
        let error = |name: &str| of(name).hypot(std(name));
        let stated = Stated {
            m_kg: config.m_kg,
            gap_m: config.gap_m,
            alpha_rad: config.alpha_rad,
            theta0_rad: start(base, "plant", "theta0"),
            omega_rad_s: mean(&samples.omega_rad_s),
        };

        let mut values = Values::default();
        let step_s = values.put_sample_time(base, samples.step_s);
        for (name, value) in stated.with(of) {
            if value != 0.0 || base.is_stated("plant", &name) {
                values.put("plant", &name, value);
            }
            // Sensors and forces are the plant's alone.
            if matches!(name.split('[').next(), Some("m" | "s" | "alpha")) {
                values.put("controller", &name, value);
                values.put("estimator", &name, value);
            }
            if name == "s" {
                values.put_unless_stated(base, "plant", "touchdown.clearance", 0.5 * value);
            }
        }
        for (k, lambda) in found.lambda.iter().enumerate() {
            values.put("plant", &format!("lambda[{}]", k + 1), lambda.value);
            values.put("controller", &format!("lambda0[{}]", k + 1), lambda.value);
            values.put("estimator", &format!("lambda0[{}]", k + 1), lambda.value);
        }
        values.put("plant", "unbalance.magnitude", found.unbalance_magnitude.value);
        values.put("plant", "unbalance.phase", found.unbalance_phase.value);
        values.put("plant", "pY", first.load_n[0].value);
        values.put("plant", "pZ", first.load_n[1].value);
        values.put("plant", "omega", stated.omega_rad_s);
        values.put_noise(first.position_noise_m, first.current_noise_a);
        let magnets = |name: &str| [1, 2, 3].map(|k| format!("{name}[{k}]"));
        values.put_tolerance("m", config.m_kg * std("m"));
        values.put_tolerance("s", (config.gap_m * std("s")).hypot(std("gap.iron")));
        values.put_tolerance("alpha", rms(magnets("alpha").map(|name| std(&name))));
        values.put_tolerance("positionGain", error("sensor.gain").hypot(error("sensor.gainDifference")));
        values.put_tolerance("positionOffset", rms(["sensor.offset[y]", "sensor.offset[z]"].map(error)));
        values.put_tolerance("currentGain", rms(magnets("current.gain").map(|name| error(&name))));
        values.put_tolerance("currentOffset", rms(magnets("current.offset").map(|name| error(&name))));

        let twin = values.twin(base, step_s, &self.verdict)?;
        let estimated = || found.bench.iter().zip(&PARAMETERS).filter(|(of, _)| of.estimated).map(|(_, of)| of.name);
        let left_out = WITHOUT.into_iter().filter(|name| estimated().any(|estimated| estimated.starts_with(name)));
        let slow_force = (first.slow_force_n > 0.0).then_some("force.slow");
        Ok(Twin { left_out: left_out.chain(slow_force).collect(), ..twin })
    }
}

impl Track {
    /// The machine with the stated and the identified values. `base` is the scenario of the machine. What the estimator knows of the bench, the
    /// plant has and the controller knows as well.
    ///
    /// # Errors
    /// The estimate is not valid at the end, or all values that a model refuses.
    pub fn twin(&self, base: &Scenario, samples: &Samples) -> Result<Twin, Vec<String>> {
        let last = self.last_valid().filter(|_| self.is_valid_at_end()).ok_or_else(|| vec![self.verdict_at_end()])?;
        let of = |name: &str| self.of(name)[last];
        let mut values = Values::default();
        let stated = self.estimator.model_type.variables().iter().map(|variable| variable.name.to_string());
        for name in stated.filter(|name| base.is_stated("estimator", name)) {
            for element in ["plant", "controller"] {
                values.put_value(element, &name, base.value("estimator", &name).expect("a variable"));
            }
        }
        let step_s = values.put_sample_time(base, samples.step_s);
        let of_magnets = |name| self.machine.of_magnets(name).into_iter();
        for ((hat, lambda), lambda0) in of_magnets("lambdaHat").zip(of_magnets("lambda")).zip(of_magnets("lambda0")) {
            values.put("plant", &lambda, of(&hat));
            values.put("controller", &lambda0, of(&hat));
            values.put("estimator", &lambda0, of(&hat));
        }
        let loads = self.machine.of_coordinates(|coordinate| coordinate.load);
        for (name, hat) in loads.iter().zip(self.machine.of_loads("p", "Hat")) {
            values.put("plant", name, of(&hat));
        }
        for name in [self.machine.of_planes("magnitude"), self.machine.of_planes("phase")].concat() {
            values.put("plant", &name, of(&name));
        }
        values.put("plant", "omega", mean(&samples.omega_rad_s));
        values.put_noise(of("noise.position"), of("noise.current"));
        values.twin(base, step_s, &self.verdict())
    }
}

/// The mean of the values that are known.
fn mean(values: &[f64]) -> f64 {
    let known: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    known.iter().sum::<f64>() / known.len().max(1) as f64
}

fn start(scenario: &Scenario, element: &str, variable: &str) -> f64 {
    scenario.value(element, variable).map_or(f64::NAN, Value::as_f64)
}

fn rms<const N: usize>(values: [f64; N]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / N as f64).sqrt()
}
