//! Digital twin of an axis: `AxialBearing`, `AxialController`, `AxialEstimator` with the identified values.
//!
//! ```text
//! m κ ẍ = p + λ₁ i₁²/(s − x)² − λ₂ i₂²/(s + x)²
//! ```
//!
//! The factor κ between statics and dynamics is a factor of the mass. If one magnet is used, x of the twin counts from the operating point, and s is the gap
//! there: the FMUs have their rotor in the middle of the gap. The FMUs lack the other effects of a bench, slow forces and noise that grows with the gap.

use super::answer::Answer;
use super::{
    BENCH_ERRORS, CURRENT_NOISE, DELAY, EXPONENT, GAP, LOAD, PARAMETERS, POSITION_NOISE, SENSOR_GAIN, SENSOR_OFFSET,
    SLOW, UNKNOWNS, values,
};
use crate::bearing::Used;
use crate::simulation::Scenario;
use crate::studies::identify::Twin;
use crate::variables::Choice;

/// Effects of a bench that the FMUs lack.
const NOT_MODELLED: [usize; 3] = [EXPONENT, SLOW, DELAY];

/// Errors of sensors by the beginning of their names, names in the plant, and tolerances of the estimator.
const SENSORS: [[&str; 3]; 4] = [
    ["sensor.offset", "sensor.offsetX", "positionOffset"],
    ["sensor.gain", "sensor.gainErrorX", "positionGain"],
    ["current.offset", "sensor.currentOffset", "currentOffset"],
    ["current.gain", "sensor.currentGainError", "currentGain"],
];

/// The value of `magnets.used` for these magnets.
fn used(magnets: &[usize]) -> Used {
    Used::all().find(|used| used.magnets() == magnets).unwrap_or_default()
}

impl Answer {
    /// The machine with stated and identified values. `base` is the scenario of the bench.
    ///
    /// # Errors
    /// The verdict if the result is not valid, or all values that a model rejects.
    pub fn twin(&self, base: &Scenario) -> Result<Twin, Vec<String>> {
        if !self.valid {
            return Err(vec![self.verdict.clone()]);
        }
        let (axis, point) = (&self.found.axis, &self.found.fit.point);
        let law = axis.law(point);
        let mut twin = Twin::of(base, self.found.readings.step_s, &self.verdict);
        let gap_m = if let [_] = axis.used.as_slice() { law.reference_m } else { point[GAP] };
        twin.scenario.set_everywhere("m", self.dynamics.value * law.m_kg);
        twin.scenario.set_everywhere("s", gap_m);
        twin.put_unless_stated("plant", "touchdown.clearance", 0.5 * gap_m);
        for (k, lambda) in &self.lambda {
            twin.put_lambda(&format!("lambda[{}]", k + 1), lambda.value);
        }
        let used = used(&axis.used);
        if let Some(k) = used.only() {
            // Tools that ignore enumerations assume both magnets are used: without a minimum force the other one then has no effect.
            twin.scenario.set_everywhere("magnets.used", used.number());
            twin.scenario.set("plant", &format!("coil.open[{}]", 2 - k), true);
            twin.put_unless_stated("controller", "F0", 0.0);
        }
        twin.scenario.set("plant", "pX", point[LOAD]);
        twin.put_noise(libm::exp(point[POSITION_NOISE]), libm::exp(point[CURRENT_NOISE]));
        // Only unknowns that were searched have a noise_std.
        for (name, of, scale) in [("m", &self.dynamics, axis.m_kg), ("s", &self.gap, 1.0)] {
            if of.noise_std > 0.0 {
                twin.put_tolerance(name, scale * of.total_std);
            }
        }
        for at in BENCH_ERRORS {
            let name = PARAMETERS[at].0;
            let Some([begin, in_plant, tolerance]) = SENSORS.iter().find(|[begin, ..]| name.starts_with(begin)) else {
                continue;
            };
            // Where x counts from the operating point, an error of the gain shifts the readings.
            let is_shifted = at == SENSOR_OFFSET && axis.used.len() == 1;
            let error = point[at] + if is_shifted { point[SENSOR_GAIN] * self.at_m } else { 0.0 };
            if error != 0.0 {
                twin.scenario.set("plant", &name.replace(begin, in_plant), error);
            }
            let std = self.bench.iter().find(|(of, _)| *of == at).map_or(0.0, |(_, of)| of.total_std);
            twin.put_tolerance(tolerance, error.hypot(std));
        }
        twin.scenario.identify = self.bench();
        let is_present = |at: &usize| point[*at] != 0.0 && point[*at] != f64::NEG_INFINITY;
        twin.left_out = NOT_MODELLED.into_iter().filter(is_present).map(|at| PARAMETERS[at].0).collect();
        twin.checked()
    }

    /// The bench as read by `identify`, with the estimate as known values.
    fn bench(&self) -> toml::Table {
        let (axis, point) = (&self.found.axis, &self.found.fit.point);
        let value = values(point);
        let is_there = |at: &usize| match *at {
            0..GAP => axis.used.contains(at),
            at if BENCH_ERRORS.contains(&at) => point[at] != 0.0,
            at => point[at] != f64::NEG_INFINITY,
        };
        let known = (0..UNKNOWNS).filter(is_there).map(|at| (PARAMETERS[at].0.to_owned(), value[at].into()));
        let mut bench: toml::Table = known.collect();
        bench.insert("m".into(), axis.law(point).m_kg.into());
        bench.insert("magnets.used".into(), used(&axis.used).name().into());
        bench.insert("at".into(), self.at_m.into());
        bench
    }
}
