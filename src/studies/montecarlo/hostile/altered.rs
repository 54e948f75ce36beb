//! Errors of readings between the sensors and their users.

use std::f64::consts::TAU;

use super::Draw;
use crate::simulation::scenario::Scenario;
use fmu_export::variable::Value;

/// The readings of one sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Readings {
    /// When, in s.
    pub time_s: f64,
    /// Positions, in m.
    pub position_m: Vec<f64>,
    /// Currents, in A.
    pub current_a: Vec<f64>,
    /// Angle of the rotor, in rad.
    pub theta_rad: f64,
    /// Its speed, in rad/s.
    pub omega_rad_s: f64,
    /// Force constants that the controller gets instead of the estimates, in N·m²/A².
    pub lambda_nm2_a2: Option<Vec<f64>>,
}

/// Changes the readings of a run, sample by sample.
pub struct Change {
    /// Changes the readings of the next sample.
    pub apply: Box<dyn FnMut(&mut Readings)>,
    /// The controller reads what was changed as well: it is the sensor that is at fault.
    of_sensor: bool,
}

/// Makes the change of a run from its scenario and its seed.
pub type Alter = Box<dyn Fn(&Scenario, u64) -> Change + Send + Sync>;

/// Where the readings are among the values that the connections carry.
pub struct Wires {
    position: Vec<usize>,
    current: Vec<usize>,
    /// Angle and speed.
    rotation: [usize; 2],
    /// Positions and currents, λ and whether they are valid, on their way to the controller.
    to_controller: Vec<usize>,
    lambda: Vec<usize>,
    valid: usize,
}

impl Wires {
    /// Those of a scenario.
    pub fn new(scenario: &Scenario) -> Self {
        let connections = scenario.connections();
        let to = |element: &str, wanted: &dyn Fn(&str) -> bool| -> Vec<usize> {
            let is = |[to, name]: &[String; 2]| to == element && wanted(name);
            (0..connections.len()).filter(|at| is(&connections[*at].to)).collect()
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
        let mut readings = Readings { time_s, position_m, current_a, theta_rad, omega_rad_s, lambda_nm2_a2: None };
        (change.apply)(&mut readings);
        let mut put = |places: &[usize], numbers: &[f64]| {
            places.iter().zip(numbers).for_each(|(at, number)| values[*at] = Value::Real(*number));
        };
        put(&self.position, &readings.position_m);
        put(&self.current, &readings.current_a);
        put(&self.rotation, &[readings.theta_rad, readings.omega_rad_s]);
        if change.of_sensor {
            put(&self.to_controller, &[readings.position_m, readings.current_a].concat());
        }
        if let Some(lambda) = readings.lambda_nm2_a2 {
            put(&self.lambda, &lambda);
            values[self.valid] = Value::Boolean(true);
        }
    }
}

/// The estimator gets other readings than the controller.
pub fn on_the_way(change: impl FnMut(&mut Readings) + 'static) -> Change {
    Change { apply: Box::new(change), of_sensor: false }
}

/// The sensors read something else.
pub fn in_the_sensor(change: impl FnMut(&mut Readings) + 'static) -> Change {
    Change { apply: Box::new(change), of_sensor: true }
}

/// The controller gets force constants from elsewhere, off by a relative deviation.
pub fn taught(deviation: f64) -> Alter {
    Box::new(move |scenario, seed| {
        let mut draw = Draw::new(seed ^ 0x7a09);
        let truth = scenario.truth().into_iter();
        let lambda: Vec<f64> = truth.map(|lambda| lambda * (1.0 + deviation * draw.normal())).collect();
        on_the_way(move |readings| readings.lambda_nm2_a2 = Some(lambda.clone()))
    })
}

/// White noise of the speed, relative, and of the angle, in rad.
pub fn noisy_angle(speed: f64, angle_rad: f64) -> Alter {
    Box::new(move |_, seed| {
        let mut draw = Draw::new(seed ^ 0xa9e1);
        on_the_way(move |readings| {
            readings.omega_rad_s *= 1.0 + speed * draw.normal();
            readings.theta_rad += angle_rad * draw.normal();
        })
    })
}

/// An encoder of so many counts per turn; the speed is the difference of its angles.
pub fn encoder(counts: f64) -> Alter {
    Box::new(move |scenario, _| {
        let (step_s, mut last) = (scenario.step_s, None);
        on_the_way(move |readings| {
            let angle = (readings.theta_rad * counts / TAU).floor() * TAU / counts;
            readings.omega_rad_s = last.map_or(readings.omega_rad_s, |last| (angle - last) / step_s);
            readings.theta_rad = angle;
            last = Some(angle);
        })
    })
}

/// An encoder whose disc sits beside the axis, by this part of its radius.
pub fn eccentric(part: f64) -> Alter {
    Box::new(move |_, _| {
        on_the_way(move |readings| {
            let (sin, cos) = libm::sincos(readings.theta_rad);
            readings.theta_rad += part * sin;
            readings.omega_rad_s *= 1.0 + part * cos;
        })
    })
}

/// The speed is something else.
pub fn speed(change: fn(f64) -> f64) -> Alter {
    Box::new(move |_, _| on_the_way(move |readings| readings.omega_rad_s = change(readings.omega_rad_s)))
}

/// Coloured noise of these readings: white noise after a low-pass of first order, with this standard deviation in their unit and this
/// cut-off frequency in Hz.
pub fn coloured(std: f64, cut_off_hz: f64, of: fn(&mut Readings) -> &mut Vec<f64>) -> Alter {
    Box::new(move |scenario, seed| {
        let kept = libm::exp(-TAU * cut_off_hz * scenario.step_s);
        let (mut draw, mut states) = (Draw::new(seed ^ 0xc010), Vec::new());
        in_the_sensor(move |readings| {
            let values = of(readings);
            states.resize_with(values.len(), || draw.normal());
            for (value, state) in values.iter_mut().zip(&mut states) {
                *value += std * *state;
                *state = kept * *state + (1.0 - kept * kept).sqrt() * draw.normal();
            }
        })
    })
}

/// Currents one sample late until an instant in s.
pub fn late_currents(until_s: f64) -> Alter {
    Box::new(move |_, _| {
        let mut last: Option<Vec<f64>> = None;
        on_the_way(move |readings| {
            let now = readings.current_a.clone();
            if let (Some(last), true) = (last.take(), readings.time_s < until_s) {
                readings.current_a = last;
            }
            last = Some(now);
        })
    })
}

/// How a sample is missing.
#[derive(Clone, Copy)]
pub enum Missing {
    /// All readings are those of the last sample.
    Repeated,
    /// Positions and currents are no numbers.
    NotANumber,
}

/// Samples are missing: `when` says of a sample, by its number and numbers drawn, whether it is.
pub fn missing(how: Missing, when: fn(u64, &mut Draw) -> bool) -> Alter {
    Box::new(move |_, seed| {
        let mut draw = Draw::new(seed ^ 0xd20f);
        let mut number = 0;
        let mut last: Option<Readings> = None;
        on_the_way(move |readings| {
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

/// Outliers: position sensors read something else, by a standard deviation in m, in a part of the samples.
pub fn outliers(part: f64, std_m: f64) -> Alter {
    Box::new(move |_, seed| {
        let mut draw = Draw::new(seed ^ 0x5919);
        in_the_sensor(move |readings| {
            for position_m in &mut readings.position_m {
                if draw.chance(part) {
                    *position_m += std_m * draw.normal();
                }
            }
        })
    })
}

/// The position sensors read more by this, in m, from time in s and angle in rad.
pub fn added(more_m: impl Fn(f64, f64) -> [f64; 2] + Copy + Send + Sync + 'static) -> Alter {
    Box::new(move |_, _| {
        in_the_sensor(move |readings| {
            let more_m = more_m(readings.time_s, readings.theta_rad);
            readings.position_m.iter_mut().zip(more_m).for_each(|(position, more)| *position += more);
        })
    })
}
