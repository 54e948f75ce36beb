//! Hostile courses: no valid estimate is wrong, whatever a bench does, and the study detects one that is.
//!
//! `cargo run --release -- montecarlo --only hostile` prints them as a table, with any number of seeds.

use crate::prelude::*;

use crate::montecarlo::recorded;
use magnetic_bearing::studies::montecarlo::hostile::altered::{self, Alter, Missing, Readings};
use magnetic_bearing::studies::montecarlo::hostile::{self, Requirement, Trial, VALID_FROM_S};

/// Seeds not used for tuning.
const FIRST_SEED: u64 = 98_001;
const RUNS: usize = 2;

/// Fraction of runs that may have a valid estimate off by more than five of its deviations.
const MOST_WRONG: f64 = 0.01;

/// Fraction of the time in which identifiable estimates must be valid, on average over the runs of a course.
const LEAST_VALID: f64 = 0.6;

/// Number of changes of `valid` allowed within a second, including the first.
const MOST_CHANGES: usize = 5;

#[test]
fn no_valid_estimate_is_wrong_on_hostile_courses() {
    let courses = hostile::courses();
    let found = hostile::run(&courses, RUNS, FIRST_SEED).expect("good scenarios");
    let mut misses = Vec::new();
    for known in [true, false] {
        let (wrong, runs) = hostile::wrong(&courses, &found, known);
        if wrong as f64 > MOST_WRONG * runs as f64 {
            misses.push(format!("noise known {known}: {wrong} of {runs} runs are wrong, limit {MOST_WRONG}"));
        }
    }
    for (course, trials) in courses.iter().zip(&found).filter(|(course, _)| course.asked != Requirement::Nothing) {
        let valid = trials.iter().map(|trial| trial.valid).sum::<f64>() / trials.len() as f64;
        if course.asked == Requirement::Valid && (valid.is_nan() || valid < LEAST_VALID) {
            misses.push(format!("{}: valid {:.0} % of the time, limit {LEAST_VALID}", course.title(), 100.0 * valid));
        }
        // Models in which only the loads are random walks retain λ; without them the estimate is valid little more than half of the time.
        let retains = trials.iter().all(|trial| trial.valid > 0.95 && !trial.is_beyond());
        if course.name == "load ramp 10 N/s" && !retains {
            misses.push(format!("{}: {trials:?}", course.title()));
        }
        let changes = trials.iter().map(|trial| trial.changes).max().unwrap_or(0);
        if changes > MOST_CHANGES {
            misses.push(format!("{}: {changes} changes within a second, limit {MOST_CHANGES}", course.title()));
        }
    }
    assert!(misses.is_empty(), "{}", misses.join("\n"));
}

/// The verdict on a recording of 1 s whose λ are 0.1 % off, with deviations of 0.2 %, and valid from the second sample on, after a
/// change of its signals.
fn judged(scenario: &Scenario, change: impl Fn(&str, &mut [f64])) -> Trial {
    let mut rows = vec![(true, 0.001, 0.002); 10_001];
    rows[0].0 = false;
    let mut recording = recorded(&rows);
    for column in &mut recording.columns {
        change(&column.name, &mut column.values);
    }
    hostile::judge(scenario, &recording, false)
}

#[test]
fn a_deviation_that_is_too_small_is_detected() {
    let scenario = nominal();
    let good = judged(&scenario, |_, _| ());
    assert!(!good.is_beyond() && good.valid == 1.0 && good.changes == 1, "{good:?}");
    assert!((good.worst.ratio - 0.5).abs() < 1e-9, "{good:?}");
    let small = judged(&scenario, |name, values| {
        if name == "estimator.lambdaStdTotal[2]" {
            values.iter_mut().for_each(|std| *std /= 11.0);
        }
    });
    assert!(small.is_beyond() && (small.worst.ratio - 5.5).abs() < 1e-9, "{small:?}");
    // One sample is enough, but not while the estimate is invalid, or after contact.
    let [is_invalid, touches] = [("estimator.valid", 7000, 0.0), ("plant.touchdown.contact", 6000, 1.0)];
    let [once, invalid, touched] = [None, Some(is_invalid), Some(touches)].map(|change| {
        judged(&scenario, |name, values| match change {
            Some((signal, row, value)) if name == signal => values[row] = value,
            _ if name == "estimator.lambdaHat[3]" => values[7000] *= 1.05,
            _ => (),
        })
    });
    assert!(once.is_beyond() && (once.worst.time_s - 0.7).abs() < 1e-9, "{once:?}");
    assert!((once.worst.error - 0.05105).abs() < 1e-9 && (once.worst.std - 0.002).abs() < 1e-9, "{once:?}");
    assert!(!invalid.is_beyond() && invalid.changes == 3, "{invalid:?}");
    assert!(!touched.is_beyond() && touched.touched_s.is_some_and(|at_s| (at_s - 0.6).abs() < 1e-9), "{touched:?}");
}

#[test]
fn validity_and_its_changes_are_counted() {
    let trial = judged(&nominal(), |name, values| {
        if name == "estimator.valid" {
            // Valid in every second sample of the last 50 ms.
            (0..values.len()).for_each(|row| values[row] = f64::from(u8::from(row >= 9500 && row % 2 == 0)));
        }
    });
    assert!((trial.valid - 0.025 / (1.0 - VALID_FROM_S)).abs() < 1e-3, "{trial:?}");
    assert_eq!(trial.changes, 501);
}

/// A drifting λ is compared at the same instant.
#[test]
fn an_estimate_that_follows_a_drift_is_right() {
    let courses = hostile::courses();
    let course = courses.iter().find(|course| course.name == "λ drifts 2 %/s").expect("a course");
    let scenario = course.scenario(FIRST_SEED, 0);
    let drift = |row: usize| 1.0 + 0.02 * row as f64 * 1e-4;
    let follows = judged(&scenario, |name, values| {
        if name.starts_with("estimator.lambdaHat") {
            (0..values.len()).for_each(|row| values[row] *= drift(row));
        }
    });
    // As without drift, except for half a sample and a constant deviation while λ grows by 2 %.
    assert!((follows.worst.ratio - 0.51).abs() < 0.005, "{follows:?}");
    assert!(judged(&scenario, |_, _| ()).is_beyond(), "an estimate that does not follow");
}

/// Readings of a rotor at 3000 rpm, sample by sample, after a change.
fn readings(alter: &Alter, samples: usize) -> Vec<Readings> {
    let scenario = nominal();
    let mut change = alter(&scenario, 1);
    let sample = |n: usize| {
        let time_s = n as f64 * scenario.step_s;
        let mut readings = Readings {
            time_s,
            position_m: vec![n as f64; 2],
            current_a: vec![n as f64; 3],
            theta_rad: 50.0 * TAU * time_s,
            omega_rad_s: 50.0 * TAU,
            lambda_nm2_a2: None,
            at_sensor: false,
        };
        change(&mut readings);
        readings
    };
    (0..samples).map(sample).collect()
}

#[test]
fn alterations_of_readings() {
    const SAMPLES: usize = 100_000;
    let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / SAMPLES as f64;

    // Noise of the currents: its standard deviation, and the correlation of a low-pass of 100 Hz over 1 ms.
    let noise: Vec<f64> = readings(&altered::coloured(NOISE[1], 100.0, |readings| &mut readings.current_a), SAMPLES)
        .iter()
        .enumerate()
        .map(|(n, readings)| readings.current_a[1] - n as f64)
        .collect();
    let square = mean(&mut noise.iter().map(|noise| noise * noise));
    let product = mean(&mut noise.windows(11).map(|window| window[0] * window[10]));
    assert!((square.sqrt() / NOISE[1] - 1.0).abs() < 0.05, "{}", square.sqrt());
    assert!((product / square - (-TAU * 0.1f64).exp()).abs() < 0.05, "{}", product / square);

    // An encoder: the mean speed is right, each reading is 0 or one count per sample.
    let encoder = readings(&altered::encoder(64.0), SAMPLES);
    let speed = mean(&mut encoder.iter().map(|readings| readings.omega_rad_s));
    assert!((speed / (50.0 * TAU) - 1.0).abs() < 1e-3, "{speed}");
    assert!(encoder[1..].iter().all(|readings| {
        let counts = readings.omega_rad_s * 1e-4 * 64.0 / TAU;
        counts.abs() < 1e-6 || (counts - 1.0).abs() < 1e-6
    }));

    // Missing samples.
    let gaps: fn(u64, &mut _) -> bool = |number, _| number % 50 < 3;
    let repeated = readings(&altered::missing(Missing::Repeated, gaps), SAMPLES);
    let same = repeated.windows(2).filter(|pair| pair[0] == pair[1]).count();
    assert!((same as f64 / SAMPLES as f64 - 0.06).abs() < 0.001, "{same}");
    let no_numbers = readings(&altered::missing(Missing::NotANumber, gaps), SAMPLES);
    // The first sample has no predecessor to repeat.
    assert_eq!(no_numbers.iter().filter(|readings| readings.current_a[0].is_nan()).count(), same + 1);

    // Late currents: those of the previous sample, up to the instant.
    let late = readings(&altered::late_currents(1.0, 0.05), 600);
    assert_eq!([late[499].current_a[0], late[500].current_a[0], late[499].position_m[0]], [498.0, 500.0, 499.0]);
}
