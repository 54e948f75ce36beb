//! Errors of the readings: in the sensors, or only at the estimator.

use std::f64::consts::TAU;

use super::Draw;
use crate::simulation::Scenario;
use fmu_export::variable::Value;

/// The readings of one sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Readings {
    /// Time, in s.
    pub time_s: f64,
    /// Positions, in m.
    pub position_m: Vec<f64>,
    /// Currents, in A.
    pub current_a: Vec<f64>,
    /// Angle of the rotor, in rad.
    pub theta_rad: f64,
    /// Speed of the rotor, in rad/s.
    pub omega_rad_s: f64,
    /// Force constants for the controller in place of the estimates, in N·m²/A².
    pub lambda_nm2_a2: Option<Vec<f64>>,
    /// Whether the controller gets these readings too, because the sensors are at fault.
    pub at_sensor: bool,
}

/// Changes the readings of a run, sample by sample; those of the estimator alone unless it states otherwise.
pub type Change = Box<dyn FnMut(&mut Readings)>;

/// Creates the change of a run from its scenario and seed.
pub type Alter = Box<dyn Fn(&Scenario, u64) -> Change + Send + Sync>;

/// Indices of the readings among the values carried by the connections.
pub struct Wires {
    position: Vec<usize>,
    current: Vec<usize>,
    /// Angle and speed.
    rotation: [usize; 2],
    /// Positions and currents at the controller; λ there, and whether they are valid.
    to_controller: Vec<usize>,
    lambda: Vec<usize>,
    valid: usize,
}

impl Wires {
    /// The indices of a scenario.
    pub fn new(scenario: &Scenario) -> Self {
        let inputs: Vec<_> = scenario.connections().iter().map(|[_, input]| scenario.path(*input)).collect();
        let to = |element: &str, wanted: &dyn Fn(&str) -> bool| -> Vec<usize> {
            let is = |path: &str| path.split_once('.').is_some_and(|(to, name)| to == element && wanted(name));
            (0..inputs.len()).filter(|at| is(&inputs[*at])).collect()
        };
        let is_position = |name: &str| ["Xm", "Ym", "Zm"].iter().any(|end| name.ends_with(end));
        let is_current = |name: &str| name.contains("im[");
        let one = |element: &str, name: &str| to(element, &|candidate| candidate == name)[0];
        Self {
            position: to("estimator", &is_position),
            current: to("estimator", &is_current),
            rotation: ["theta", "omega"].map(|name| one("estimator", name)),
            to_controller: [to("controller", &is_position), to("controller", &is_current)].concat(),
            lambda: to("controller", &|name| name.contains("lambdaHat")),
            valid: one("controller", "lambdaValid"),
        }
    }

    /// Changes the readings among these values.
    pub fn alter(&self, time_s: f64, values: &mut [Value], change: &mut Change) {
        let all = |places: &[usize]| places.iter().map(|at| values[*at].clone().as_f64()).collect();
        let [theta_rad, omega_rad_s] = self.rotation.map(|at| values[at].clone().as_f64());
        let (position_m, current_a) = (all(&self.position), all(&self.current));
        let (lambda_nm2_a2, at_sensor) = (None, false);
        let mut readings = Readings { time_s, position_m, current_a, theta_rad, omega_rad_s, lambda_nm2_a2, at_sensor };
        change(&mut readings);
        let mut put = |places: &[usize], numbers: &[f64]| {
            places.iter().zip(numbers).for_each(|(at, number)| values[*at] = Value::Real(*number));
        };
        put(&self.position, &readings.position_m);
        put(&self.current, &readings.current_a);
        put(&self.rotation, &[readings.theta_rad, readings.omega_rad_s]);
        if readings.at_sensor {
            put(&self.to_controller, &[readings.position_m, readings.current_a].concat());
        }
        if let Some(lambda) = readings.lambda_nm2_a2 {
            put(&self.lambda, &lambda);
            values[self.valid] = Value::Boolean(true);
        }
    }
}

/// The controller gets the true λ with random errors of this relative standard deviation, not the estimates.
pub fn given_lambda(deviation: f64) -> Alter {
    Box::new(move |scenario, seed| {
        let mut draw = Draw::new(seed ^ 0x7a09);
        let truth = scenario.truth().into_iter();
        let lambda: Vec<f64> = truth.map(|lambda| lambda * (1.0 + deviation * draw.normal())).collect();
        Box::new(move |readings| readings.lambda_nm2_a2 = Some(lambda.clone()))
    })
}

/// White noise of the speed, relative, and of the angle, in rad.
pub fn noisy_angle(speed: f64, angle_rad: f64) -> Alter {
    Box::new(move |_, seed| {
        let mut draw = Draw::new(seed ^ 0xa9e1);
        Box::new(move |readings| {
            readings.omega_rad_s *= 1.0 + speed * draw.normal();
            readings.theta_rad += angle_rad * draw.normal();
        })
    })
}

/// An encoder with this number of counts per revolution; the speed is the difference of its angles.
pub fn encoder(counts: f64) -> Alter {
    Box::new(move |scenario, _| {
        let (step_s, mut last) = (scenario.step_s, None);
        Box::new(move |readings| {
            let angle = (readings.theta_rad * counts / TAU).floor() * TAU / counts;
            readings.omega_rad_s = last.map_or(readings.omega_rad_s, |last| (angle - last) / step_s);
            readings.theta_rad = angle;
            last = Some(angle);
        })
    })
}

/// An encoder whose disc is eccentric by this fraction of its radius.
pub fn eccentric(fraction: f64) -> Alter {
    Box::new(move |_, _| {
        Box::new(move |readings| {
            let (sin, cos) = libm::sincos(readings.theta_rad);
            readings.theta_rad += fraction * sin;
            readings.omega_rad_s *= 1.0 + fraction * cos;
        })
    })
}

/// The speed is changed by this function.
pub fn speed(change: fn(f64) -> f64) -> Alter {
    Box::new(move |_, _| Box::new(move |readings| readings.omega_rad_s = change(readings.omega_rad_s)))
}

/// Coloured noise of these readings: low-pass filtered white noise (first order), with this standard deviation in their unit and this
/// cut-off frequency in Hz.
pub fn coloured(std: f64, cut_off_hz: f64, of: fn(&mut Readings) -> &mut Vec<f64>) -> Alter {
    Box::new(move |scenario, seed| {
        let pole = libm::exp(-TAU * cut_off_hz * scenario.step_s);
        let (mut draw, mut states) = (Draw::new(seed ^ 0xc010), Vec::new());
        Box::new(move |readings| {
            readings.at_sensor = true;
            let values = of(readings);
            states.resize_with(values.len(), || draw.normal());
            for (value, state) in values.iter_mut().zip(&mut states) {
                *value += std * *state;
                *state = pole * *state + (1.0 - pole * pole).sqrt() * draw.normal();
            }
        })
    })
}

/// Currents are late by this fraction of a sample until an instant in s: interpolated between this sample and the last.
pub fn late_currents(samples: f64, until_s: f64) -> Alter {
    Box::new(move |_, _| {
        let mut last: Option<Vec<f64>> = None;
        Box::new(move |readings| {
            let now = readings.current_a.clone();
            if let (Some(last), true) = (last.take(), readings.time_s < until_s) {
                let mixed = now.iter().zip(&last).map(|(now, last)| (1.0 - samples) * now + samples * last);
                readings.current_a = mixed.collect();
            }
            last = Some(now);
        })
    })
}

/// Kind of missing sample.
#[derive(Clone, Copy)]
pub enum Missing {
    /// All readings are those of the last sample.
    Repeated,
    /// Positions and currents are NaN.
    NotANumber,
}

/// Missing samples; `when` decides from the number of the sample and random numbers.
pub fn missing(how: Missing, when: fn(u64, &mut Draw) -> bool) -> Alter {
    Box::new(move |_, seed| {
        let mut draw = Draw::new(seed ^ 0xd20f);
        let mut number = 0;
        let mut last: Option<Readings> = None;
        Box::new(move |readings| {
            number += 1;
            match (when(number, &mut draw), how, &last) {
                (true, Missing::Repeated, Some(last)) => readings.clone_from(last),
                (true, Missing::NotANumber, _) => {
                    readings.position_m.iter_mut().chain(&mut readings.current_a).for_each(|value| *value = f64::NAN);
                }
                _ => last = Some(readings.clone()),
            }
        })
    })
}

/// Outliers of the position sensors, with this standard deviation in m, in a fraction of the samples.
pub fn outliers(fraction: f64, std_m: f64) -> Alter {
    Box::new(move |_, seed| {
        let mut draw = Draw::new(seed ^ 0x5919);
        Box::new(move |readings| {
            readings.at_sensor = true;
            for position_m in &mut readings.position_m {
                if draw.chance(fraction) {
                    *position_m += std_m * draw.normal();
                }
            }
        })
    })
}

/// An error of the position sensors, in m, as a function of time in s and angle in rad.
pub fn added(error_m: impl Fn(f64, f64) -> [f64; 2] + Copy + Send + Sync + 'static) -> Alter {
    Box::new(move |_, _| {
        Box::new(move |readings| {
            readings.at_sensor = true;
            let error_m = error_m(readings.time_s, readings.theta_rad);
            readings.position_m.iter_mut().zip(error_m).for_each(|(position, error)| *position += error);
        })
    })
}
