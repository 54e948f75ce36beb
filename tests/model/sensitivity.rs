//! The sensitivity function: against a sine in time, against Bode's integral, and at low and high frequencies.

use crate::prelude::*;
use std::path::Path;

use fmu_export::variable::Value;
use magnetic_bearing::machine::MACHINES;
use magnetic_bearing::simulation::{Place, Scenario, simulate};
use magnetic_bearing::studies::sensitivity::{Sensitivity, peak, table, zone};
use nalgebra::{Complex, ComplexField};

/// A centred rotor at rest, under a load large enough for the same magnets always to have the smallest force: where another one takes
/// over, the gain has a kink while λ is wrong.
fn open(machine: &str, changes: &[(&str, &str)]) -> Scenario {
    let (zeros, load): (&str, &[(&str, &str)]) = match machine {
        "planar" => (
            "reference.rY reference.rZ reference.lobeAmplitude unbalance.magnitude Y0 Z0 vY0 vZ0",
            &[("pY", "10"), ("pZ", "-20")],
        ),
        "spindle4" => (
            "A.reference.rY A.reference.rZ B.reference.rY B.reference.rZ X.reference.amplitude \
             unbalance[1].magnitude unbalance[2].magnitude",
            &[("pX", "30"), ("pY", "60"), ("pZ", "-80")],
        ),
        _ => ("reference.rX", &[]),
    };
    let common = "controller.F0.modulation plant.sensor.positionNoise plant.sensor.currentNoise";
    let zeros = zeros.split(' ').chain(common.split(' ')).map(|name| (name, "0"));
    let all = zeros.chain(load.iter().copied()).chain([("update.mode", "never"), ("duration", "0.4 s")]);
    let all = all.chain(changes.iter().copied()).map(|(name, value)| (name.to_owned(), value.to_owned()));
    let all: Vec<_> = all.collect();
    let built_in = if machine == "planar" { "unbalanced" } else { machine };
    Scenario::open_with(Path::new(built_in), &all).unwrap_or_else(|error| panic!("{error}"))
}

/// S at a frequency in rad/s from a sine added to a reading, over the second half of the run, after transients.
fn injected(scenario: &Scenario, reading: usize, omega_rad_s: f64) -> Complex<f64> {
    /// 4·10⁻⁵ of the gap, with nonlinear effects of that order; ten times the amplitude saturates the amplifiers at 2 kHz.
    const AMPLITUDE_M: f64 = 0.02e-6;
    let to = format!("controller.{}", scenario.machine.readings[reading].name);
    let is_it = |[_, input]: &[Place; 2]| scenario.path(*input) == to;
    let place = scenario.connections().iter().position(is_it).expect("the reading is used");
    let samples = (scenario.duration_s / scenario.step_s).round() as usize;
    let (mut sample, mut sum) = (0, Complex::new(0.0, 0.0));
    let mut alter = |time_s: f64, carried: &mut [Value]| {
        let phase = omega_rad_s * time_s;
        let read = carried[place].clone().as_f64() + AMPLITUDE_M * phase.sin();
        carried[place] = Value::Real(read);
        if sample >= samples / 2 {
            sum += Complex::new(phase.cos(), -phase.sin()) * read;
        }
        sample += 1;
    };
    let run = simulate::run_altered(scenario, &|_| false, &mut alter).expect("a good scenario");
    assert_eq!(run.error, None);
    // For a sin(ωt), this sum over N samples is −j a N/2.
    sum * Complex::new(0.0, 2.0 / ((samples / 2) as f64 * AMPLITUDE_M))
}

#[test]
fn a_sine_in_time_confirms_the_response() {
    /// Complex difference between the two.
    const DIFFERENCE: f64 = 1e-4;
    let voltage = [("drive", "voltage"), ("hold", "linear")];
    let cases = [
        ("planar", &[][..], &[0, 1][..]),
        ("planar", &voltage, &[0, 1]),
        ("spindle4", &[], &[1, 4]),
        ("axial", &[], &[0]),
    ];
    for (machine, drive, readings) in cases {
        let scenario = open(machine, drive);
        let names = scenario.machine.of_magnets("lambda0");
        let guess: Vec<f64> = names.iter().map(|name| scenario.number("controller", name)).collect();
        for (from, lambda) in [("guess", guess), ("truth", scenario.truth())] {
            let found = Sensitivity::new(&scenario, &lambda).unwrap_or_else(|error| panic!("{machine}: {error}"));
            let mut used = scenario.clone();
            for (name, lambda) in names.iter().zip(&lambda) {
                used.set("controller", name, *lambda);
            }
            for reading in readings {
                for periods in [4, 20, 120, 400] {
                    // Whole periods in half of the run.
                    let omega = TAU * f64::from(periods) / (0.5 * scenario.duration_s);
                    let difference = (injected(&used, *reading, omega) - found.at(*reading, omega)).modulus();
                    assert!(difference < DIFFERENCE, "{machine} {drive:?} {from}: {difference:e} at {omega} rad/s");
                }
            }
        }
    }
}

/// Bode: the mean of ln|S| over all frequencies of a sampled loop is the sum of the logarithms of its unstable open-loop poles. The rotor
/// has one, `exp(√(k/m) T_s)`, and the negative stiffness of two magnets with forces F_1 and F_2 is `k = 2 (F_1 + F_2)/s`.
#[test]
fn the_mean_of_the_logarithm_is_that_of_the_unstable_pole() {
    const FREQUENCIES: usize = 4000;
    for load in [-30.0, 60.0] {
        let scenario = open("axial", &[("pX", &load.to_string())]);
        let found = Sensitivity::new(&scenario, &scenario.truth()).expect("settled");
        let omega = |n: usize| PI / scenario.step_s * (n as f64 + 0.5) / FREQUENCIES as f64;
        let mean = (0..FREQUENCIES).map(|n| found.at(0, omega(n)).modulus().ln()).sum::<f64>() / FREQUENCIES as f64;
        let least = scenario.number("controller", "F0");
        let stiffness = 2.0 * (2.0 * least + f64::abs(load)) / scenario.number("plant", "s");
        let pole = (stiffness / scenario.number("plant", "m")).sqrt() * scenario.step_s;
        // The logarithm diverges at frequency 0; the sum over these frequencies is accurate to 1 %.
        assert!((mean / pole - 1.0).abs() < 0.02, "load {load} N: {mean} for {pole}");
    }
}

#[test]
fn slow_errors_are_followed_and_fast_ones_pass() {
    for drive in [&[][..], &[("drive", "voltage"), ("hold", "linear")]] {
        let scenario = open("planar", drive);
        let found = Sensitivity::new(&scenario, &scenario.truth()).expect("settled");
        // The perturbation observer integrates: the rotor follows a constant sensor error, and the reading does not
        // move. With one integrator |S| at 1 rad/s is at most of the order of 1 rad/s over the
        // tracking poles, 1000 rad/s; measured 5e-5.
        let slow = found.at(0, 1.0).modulus();
        assert!(slow < 1e-3, "{drive:?}: |S| = {slow:e} at 1 rad/s");
        let fast = found.at(0, 0.99 * PI / scenario.step_s).modulus();
        assert!((fast - 1.0).abs() < 0.3, "{drive:?}: |S| = {fast} near half the sampling frequency");
    }
}

#[test]
fn every_sensor_of_every_machine_has_a_peak_and_a_zone() {
    for machine in &MACHINES {
        let built_in = if machine.name == "planar" { "unbalanced" } else { machine.name };
        let scenario = Scenario::open(Path::new(built_in)).expect("a scenario that comes with the program");
        let found = Sensitivity::new(&scenario, &scenario.truth()).expect("settled");
        let (table, missing) = table(&scenario);
        assert!(missing.is_empty(), "{}: {missing:?}", machine.name);
        assert_eq!(table.rows.len(), machine.readings.len());
        for (n, (row, reading)) in table.rows.iter().zip(machine.readings).enumerate() {
            let [_, highest] = peak(&found.curve(n)).expect("a curve");
            assert_eq!((row[0].as_str(), row[4].clone()), (reading.name, format!("{highest:.2}")), "{}", machine.name);
            // An unstable rotor amplifies some errors; with the true λ the loop is well damped.
            assert!(highest > 1.0 && row[6] == zone(highest).to_string(), "{}: {row:?}", machine.name);
        }
    }
}

#[test]
fn zones_are_those_of_the_standard() {
    let zones = [2.99, 3.0, 3.99, 4.0, 4.99, 5.0, f64::INFINITY, f64::NAN].map(zone);
    assert_eq!(zones, ['A', 'B', 'B', 'C', 'C', 'D', 'D', 'D']);
}

#[test]
fn a_loop_that_does_not_settle_is_reported() {
    let scenario = open("planar", &[]);
    // Twenty times too large: the forces are a twentieth of those commanded, and the rotor falls.
    let error = Sensitivity::new(&scenario, &[4e-5; 3]).expect_err("no operating point");
    assert!(error.to_string().contains("does not settle"), "{error}");
}
