//! The sensitivity function of the sampled loop of any machine, after ISO 14839-3: the gain from an error of a position sensor to its reading.
//!
//! One sensor at a time has an error; the rotor turns in the centre under a static load. The loop is simulated in time with a small error ±n
//! in one sample. Half the difference of the two responses, divided by n, is the impulse response h of the linearised loop; the curvature of
//! the forces cancels. With the readings `y`,
//!
//! ```text
//! h_k = (y_k(+n) − y_k(−n))/2n        S(ω) = Σ_k h_k e^{−jωkT_s}
//! ```
//!
//! Sensors have no other errors and no delay, the rotor has no unbalance, and the smallest forces are not modulated.

use std::f64::consts::{PI, TAU};

use nalgebra::{Complex, ComplexField};

use super::montecarlo::cases;
use crate::machine::Reading;
use crate::simulation::{Scenario, simulate};
use crate::table::Table;
use fmu_export::variable::{Type, Value};

/// Peaks of the sensitivity function that bound the zones A, B and C of ISO 14839-3; larger ones are in D.
pub const ZONES: [(f64, char); 3] = [(3.0, 'A'), (4.0, 'B'), (5.0, 'C')];

/// The zone of a peak.
pub fn zone(peak: f64) -> char {
    ZONES.iter().find(|(limit, _)| peak < *limit).map_or('D', |(_, zone)| *zone)
}

/// Settling time of the loop and decay time of a response, in s; the second pair is for slow loops.
const TIMES_S: [[f64; 2]; 2] = [[0.5, 0.25], [2.0, 1.0]];

/// The error of a sensor, in m, comparable to small motions of the loop.
const ERROR_M: f64 = 1e-9;

/// Largest motion before an error, and largest response at the end, relative to the error.
const DECAYED: f64 = 1e-6;

/// Largest reading after settling, in m.
const CENTRED_M: f64 = 1e-7;

/// Number of frequencies of a curve.
const FREQUENCIES: usize = 200;

/// The responses of a loop at its operating point.
#[derive(Clone, Debug)]
pub struct Sensitivity {
    step_s: f64,
    /// For each reading, its response to an error of its sensor in one sample.
    responses: Vec<Vec<f64>>,
}

impl Sensitivity {
    /// The responses of the loop of a scenario with these λ in the controller, at the initial speed and load.
    ///
    /// # Errors
    /// If the loop does not stay at the operating point, or a parameter is refused.
    pub fn new(scenario: &Scenario, lambda_nm2_a2: &[f64]) -> Result<Self, String> {
        let scenario = at_operating_point(scenario, lambda_nm2_a2)?;
        let [quick, slow] = TIMES_S;
        let responses = responses(&scenario, quick).or_else(|_| responses(&scenario, slow))?;
        Ok(Self { step_s: scenario.step_s, responses })
    }

    /// `S(ω)` of a reading, counted from 0; ω in rad/s, below half the sampling frequency.
    pub fn at(&self, reading: usize, omega_rad_s: f64) -> Complex<f64> {
        let turned = |(k, h): (usize, &f64)| {
            let (sin, cos) = libm::sincos(-omega_rad_s * self.step_s * k as f64);
            Complex::new(h * cos, h * sin)
        };
        self.responses[reading].iter().enumerate().map(turned).sum()
    }

    /// `[ω, |S|]` of a reading from 1 Hz to just below half the sampling frequency, at logarithmically spaced frequencies.
    pub fn curve(&self, reading: usize) -> Vec<[f64; 2]> {
        let ratio = 0.99 * PI / self.step_s / TAU;
        let at = |index: usize| TAU * libm::pow(ratio, index as f64 / (FREQUENCIES - 1) as f64);
        (0..FREQUENCIES).map(at).map(|omega| [omega, self.at(reading, omega).modulus()]).collect()
    }
}

/// The point of a curve with the largest value.
pub fn peak(curve: &[[f64; 2]]) -> Option<[f64; 2]> {
    curve.iter().copied().max_by(|one, other| one[1].total_cmp(&other[1]))
}

/// Plant and controller alone, with the rotor in the centre and all inputs constant.
fn at_operating_point(scenario: &Scenario, lambda_nm2_a2: &[f64]) -> Result<Scenario, String> {
    let (mut scenario, machine) = (scenario.clone(), scenario.machine);
    scenario.elements.truncate(2);
    scenario.profiles.clear();
    scenario.balance_s = None;
    cases::centred(&mut scenario);
    let step_s = scenario.number("controller", "Ts");
    let plant = scenario.plant().model_type.clone();
    let of_errors =
        |name: &str| ["sensor.", "perturbation.amplitude", "magnitude"].iter().any(|part| name.contains(part));
    for variable in plant.variables().iter().filter(|variable| variable.is_settable()) {
        if matches!(variable.data_type, Type::Real { .. }) && of_errors(&variable.name) {
            scenario.set("plant", &variable.name, 0.0);
        }
    }
    scenario.set("plant", "sensor.Ts", step_s);
    scenario.step_s = step_s;
    for (name, lambda) in machine.of_magnets("lambda0").iter().zip(lambda_nm2_a2) {
        scenario.set("controller", name, *lambda);
    }
    scenario.set("controller", "F0.modulation", 0.0);
    scenario.assign("controller.update.mode", "never")?;
    if scenario.value("controller", "reference.shape").is_some() {
        scenario.assign("controller.reference.shape", "ellipse")?;
    }
    Ok(scenario)
}

/// The response of each reading to an error of its sensor, one after the other, with these settling and decay times.
fn responses(scenario: &Scenario, [settling_s, decay_s]: [f64; 2]) -> Result<Vec<Vec<f64>>, String> {
    let unsettled = |why: String| format!("the loop does not settle: {why}");
    let readings = scenario.machine.readings;
    let inputs: Vec<_> = scenario.connections().into_iter().map(|[_, input]| scenario.path(input)).collect();
    let carried_at =
        |reading: &Reading| inputs.iter().position(|input| *input == format!("controller.{}", reading.name));
    let places: Vec<usize> = readings.iter().filter_map(carried_at).collect();
    let [settling, window] = [settling_s, decay_s].map(|time_s| (time_s / scenario.step_s).ceil() as usize);
    let mut scenario = scenario.clone();
    scenario.duration_s = (settling + 2 * places.len() * window) as f64 * scenario.step_s;
    // After settling, each reading in turn has an error +ERROR_M, and a window later −ERROR_M.
    let begins = |n: usize| [settling + 2 * n * window, settling + (2 * n + 1) * window];
    let mut read_m: Vec<Vec<f64>> = vec![Vec::new(); places.len()];
    let mut alter = |_: f64, carried: &mut [Value]| {
        for (n, (read_m, place)) in read_m.iter_mut().zip(&places).enumerate() {
            let mut reading_m = carried[*place].clone().as_f64();
            if let Some(pulse) = begins(n).iter().position(|begin| *begin == read_m.len()) {
                reading_m += [ERROR_M, -ERROR_M][pulse];
                carried[*place] = Value::Real(reading_m);
            }
            read_m.push(reading_m);
        }
    };
    let run = simulate::run_altered(&scenario, &|_| false, &mut alter).map_err(|refused| refused.0.join("; "))?;
    if let Some(error) = run.error {
        return Err(unsettled(error));
    }
    for (read_m, reading) in read_m.iter().zip(readings) {
        let (last_m, before_m) = (read_m[settling - 1], read_m[settling - 1 - settling / 10]);
        let is_settled = (last_m - before_m).abs() <= DECAYED * ERROR_M && last_m.abs() <= CENTRED_M;
        if !is_settled {
            return Err(unsettled(format!("after {settling_s} s {} reads {last_m} m", reading.name)));
        }
    }
    let response = |(n, (read_m, reading)): (usize, (&Vec<f64>, &Reading))| {
        let [up_m, down_m] = begins(n).map(|begin| &read_m[begin..begin + window]);
        let response: Vec<f64> = up_m.iter().zip(down_m).map(|(up, down)| (up - down) / (2.0 * ERROR_M)).collect();
        if response.iter().any(|h| !h.is_finite()) {
            return Err(format!("the response to an error of {} is not finite", reading.name));
        }
        let left = response[window - window / 10..].iter().fold(0.0, |left: f64, h| left.max(h.abs()));
        if left > DECAYED {
            let name = reading.name;
            return Err(unsettled(format!("{decay_s} s after an error of {name} it reads {left:.1e} times as much")));
        }
        Ok(response)
    };
    read_m.iter().zip(readings).enumerate().map(response).collect()
}

/// The peaks with the first guess of λ and with the true λ, a row for each sensor; and messages about missing functions.
pub fn table(scenario: &Scenario) -> (Table, Vec<String>) {
    let machine = scenario.machine;
    let lambda = |element: &str, name: &str| {
        machine.of_magnets(name).iter().map(|name| scenario.number(element, name)).collect::<Vec<_>>()
    };
    let found =
        [lambda("controller", "lambda0"), lambda("plant", "lambda")].map(|lambda| Sensitivity::new(scenario, &lambda));
    let rpm = scenario.number("plant", "omega") * 60.0 / TAU;
    let speed = if machine.planes > 0 { format!(" at {rpm:.0} rpm") } else { String::new() };
    let note = format!(
        "Gain from an error of one position sensor to its reading, with the rotor in the centre{speed} under its static load. Zones of \
         ISO 14839-3: A below 3, B below 4, C below 5, else D."
    );
    let missing = found.iter().zip(["the first guess of λ", "the true λ"]).filter_map(|(found, which)| {
        Some(format!("with {which} there is no sensitivity function: {}", found.as_ref().err()?))
    });
    let row = |(n, reading): (usize, &Reading)| {
        let cells = found.iter().flat_map(|found| match found.as_ref().ok().and_then(|found| peak(&found.curve(n))) {
            Some([omega, peak]) => [format!("{peak:.2}"), format!("{:.0}", omega / TAU), zone(peak).to_string()],
            None => ["–", "–", "–"].map(String::from),
        });
        [reading.name.to_owned()].into_iter().chain(cells).collect()
    };
    let head = ["", "first guess", "Hz", "zone", "true λ", "Hz", "zone"];
    let rows = machine.readings.iter().enumerate().map(row);
    (Table::new("Peak of the sensitivity function", note, head, rows), missing.collect())
}
