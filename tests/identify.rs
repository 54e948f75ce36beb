//! Recordings with the imperfections of test benches: names, units, separators, gaps, other rates, no angle.

mod common;

use std::path::Path;

use magnetic_bearing::app::identify::{self, Reading, Samples};
use magnetic_bearing::app::recording::Recording;
use magnetic_bearing::app::scenario::Scenario;
use magnetic_bearing::app::{montecarlo, simulate};
use magnetic_bearing::model::estimator::{EstimatorConfig, Hold, Method};
use magnetic_bearing::slave::variable::Value;

const TRUTH: [f64; 3] = [1.8e-6, 2.0e-6, 2.2e-6];

/// While an estimate is valid its error is to stay below so many of its standard deviations.
const CONFIDENT: f64 = 5.0;

/// A run of the unbalanced rotor.
fn run(noise: [f64; 2], duration_s: f64) -> (Scenario, Recording) {
    let base = Scenario::open(Path::new("unbalanced")).expect("a scenario that comes with the program");
    let mut scenario = montecarlo::study("", &base, noise, false, 1).scenario;
    scenario.set("plant", "sensor.seed", Value::Integer(11));
    scenario.duration_s = duration_s;
    let recording = simulate::run(&scenario).expect("a good scenario").recording;
    (scenario, recording)
}

fn csv(recording: &Recording) -> String {
    let mut bytes = Vec::new();
    recording.write_csv(&mut bytes).expect("a vector takes everything");
    String::from_utf8(bytes).expect("text")
}

fn config(samples: &Samples) -> EstimatorConfig {
    let window_s = identify::one_revolution(samples);
    EstimatorConfig { step_s: samples.step_s, window_s, epsilon_s: window_s, ..EstimatorConfig::default() }
}

/// Errors of the last valid estimate, relative; it must be within its standard deviations.
fn errors(samples: &Samples, config: &EstimatorConfig) -> [f64; 3] {
    let track = identify::track(samples, config).expect("a good configuration");
    let last = track.last_valid().unwrap_or_else(|| panic!("{}", track.verdict()));
    let errors = [0, 1, 2].map(|k| last.lambda_hat[k] / TRUTH[k] - 1.0);
    println!("{errors:.5?} ± {:.5?}; {}", [0, 1, 2].map(|k| last.lambda_std[k] / TRUTH[k]), track.verdict());
    for (k, truth) in TRUTH.into_iter().enumerate() {
        let ratio = (last.lambda_hat[k] - truth).abs() / last.lambda_std[k];
        assert!(ratio < CONFIDENT, "lambda[{}]: {ratio:.1} standard deviations, limit {CONFIDENT}", k + 1);
    }
    errors
}

fn largest(errors: [f64; 3]) -> f64 {
    errors.iter().fold(0.0, |largest, error| largest.max(error.abs()))
}

/// The estimator of the loop and the one over the recording of its run are the same.
#[test]
fn a_recording_says_what_the_loop_said() {
    let (_, recording) = run(montecarlo::NOISE, 0.15);
    let samples = Samples::read(&csv(&recording), &Reading::default()).expect("a good recording");
    assert_eq!(samples.len(), recording.time_s.len());
    let track = identify::track(&samples, &config(&samples)).expect("a good configuration");
    let in_loop = recording.get("estimator.lambdaHat[2]").expect("an estimator");
    // The loop's estimator sees a sample one communication step later.
    for (offline, online) in track.outputs.iter().zip(&in_loop[1..]) {
        let off = (offline.lambda_hat[1] / online - 1.0).abs();
        assert!(off < 1e-9, "{} offline, {online} in the loop", offline.lambda_hat[1]);
    }
}

#[test]
fn the_hold_is_found() {
    let (_, recording) = run(montecarlo::NOISE, 0.1);
    let text = csv(&recording);
    let measured = Samples::read(&text, &Reading::default()).expect("a good recording");
    let residuals = identify::residuals_of_holds(&measured, &config(&measured)).expect("a good configuration");
    println!("{residuals:?}");
    assert!(residuals[0] < residuals[1] && residuals[0] < residuals[2], "held before: {residuals:?}");
    let columns = [1, 2, 3].map(|k| (format!("im[{k}]"), format!("controller.i[{k}]"))).to_vec();
    let issued = Samples::read(&text, &Reading { columns, ..Reading::default() }).expect("a good recording");
    let residuals = identify::residuals_of_holds(&issued, &config(&issued)).expect("a good configuration");
    assert!(residuals[1] < residuals[0] && residuals[1] < residuals[2], "held after: {residuals:?}");
    // Commands have no noise: the error is a good deal smaller.
    let errors = errors(&issued, &EstimatorConfig { hold: Hold::HeldAfter, ..config(&issued) });
    assert!(largest(errors) < 4e-3, "{errors:?}, limit 0.4 %");
}

/// The recording in tests/data: semicolons, decimal commas, German names, ms, µm and mA, remarks before the header, a clock
/// with jitter, positions and currents missing here and there, the angle in wrapped degrees, no speed.
#[test]
fn a_recording_with_all_imperfections() {
    let text = include_str!("data/bench.csv");
    let columns = [("time", "Zeit"), ("Ym", "Weg y"), ("Zm", "Weg z"), ("theta", "Winkel")];
    let mut columns: Vec<_> = columns.map(|(signal, column)| (signal.to_owned(), column.to_owned())).to_vec();
    columns.extend([1, 2, 3].map(|k| (format!("im[{k}]"), format!("Strom {k}"))));
    let reading = Reading { columns, units: vec![("theta".into(), "deg".into())], ..Reading::default() };
    let samples = Samples::read(text, &reading).expect("a usable recording");
    println!("{:#?}", samples.notes);
    assert!((samples.step_s - 1e-4).abs() < 1e-9, "{} s", samples.step_s);
    assert!(samples.notes.iter().any(|note| note.contains("cubics")), "{:?}", samples.notes);
    let config = EstimatorConfig { hold: Hold::HeldBefore, ..config(&samples) };
    let track = identify::track(&samples, &config).expect("a good configuration");
    println!("{}", track.verdict());
    for output in track.outputs.iter().filter(|output| output.valid) {
        for (k, truth) in TRUTH.into_iter().enumerate() {
            let ratio = (output.lambda_hat[k] - truth).abs() / output.lambda_std[k];
            assert!(ratio < CONFIDENT, "lambda[{}]: {ratio:.1} standard deviations, limit {CONFIDENT}", k + 1);
        }
    }
    assert!(track.last_valid().is_some(), "{}", track.verdict());
}

#[test]
fn missing_samples_and_other_rates() {
    let (_, recording) = run(montecarlo::NOISE, 0.2);
    let spoilt = |spoil: &dyn Fn(usize, &str) -> bool| {
        let text = csv(&recording);
        let mut lines = text.lines();
        let header: Vec<&str> = lines.next().expect("a header").split(',').collect();
        let rows = lines.enumerate().map(|(row, line)| {
            let cells = line.split(',').zip(&header);
            cells.map(|(cell, name)| if spoil(row, name) { "" } else { cell }).collect::<Vec<_>>().join(",")
        });
        std::iter::once(header.join(",")).chain(rows).collect::<Vec<_>>().join("\n")
    };
    let dropped = spoilt(&|row, name| row % 97 == 50 && name.starts_with("plant.Ym"));
    let samples = Samples::read(&dropped, &Reading::default()).expect("a usable recording");
    let errors_of = errors(&samples, &config(&samples));
    assert!(largest(errors_of) < 0.01, "{errors_of:?}, limit 1 %");
    // A hole of a hundred samples interrupts, and is left behind.
    let hole = spoilt(&|row, name| (600..700).contains(&row) && name.starts_with("plant."));
    let samples = Samples::read(&hole, &Reading::default()).expect("a usable recording");
    assert!(largest(errors(&samples, &config(&samples))) < 0.01);
    // Without angle and speed: least squares, or a speed that is told.
    let blind = spoilt(&|_, name| name.starts_with("plant.theta") || name.starts_with("plant.omegam"));
    let blind = blind.replace("plant.theta", "plant.unused").replace("plant.omegam", "plant.unusedToo");
    let samples = Samples::read(&blind, &Reading::default()).expect("a usable recording");
    assert!(identify::track(&samples, &config(&samples)).is_err());
    let least = EstimatorConfig { method: Method::LeastSquares, ..config(&samples) };
    let track = identify::track(&samples, &least).expect("a good configuration");
    assert!(track.last_valid().is_none(), "unbalance without an angle: {}", track.verdict());
    let told = Reading { omega_rad_s: Some(100.0 * std::f64::consts::PI), ..Reading::default() };
    let samples = Samples::read(&blind, &told).expect("a usable recording");
    assert!(largest(errors(&samples, &config(&samples))) < 0.01);
}

#[test]
fn what_cannot_be_used_is_said() {
    let refused = |text: &str, reading: &Reading| Samples::read(text, reading).expect_err("refused").to_string();
    let plain = Reading::default();
    assert!(refused("", &plain).contains("no header"));
    assert!(refused("time,Ym\n0,0\n", &plain).contains("--column Zm="));
    let header = "time [s],Ym [furlong],Zm [m],im[1],im[2],im[3]\n";
    assert!(refused(header, &plain).contains("furlong is none of m, µm, mm"));
    let header = "time,Ym,Zm,im[1],im[2],im[3]\n";
    let rows =
        |time: &dyn Fn(usize) -> f64| (0..50).map(|j| format!("{},1e-5,1e-5,1,1,1\n", time(j))).collect::<String>();
    let words = refused(&format!("{header}0,here,0,1,1,1\n"), &plain);
    assert!(words.contains("is no number"), "{words}");
    let back = refused(&format!("{header}{}", rows(&|j| (j as f64 - 25.0).abs())), &plain);
    assert!(back.contains("does not rise"), "{back}");
    let uneven = format!("{header}{}", rows(&|j| 1e-4 * (j as f64 + 0.4 * (j as f64).sin())));
    assert!(refused(&uneven, &plain).contains("--resample"));
    let told = Reading { resample_s: Some(1e-4), ..Reading::default() };
    assert!(Samples::read(&uneven, &told).is_ok());
    let typo = Reading { columns: vec![("Xm".into(), "a".into())], ..Reading::default() };
    assert!(refused(&format!("{header}{}", rows(&|j| j as f64)), &typo).contains("Xm is no signal"));
    // A comma parts the columns here, and so is no decimal one.
    assert!(refused("time,Ym,Zm,im[1],im[2],im[3]\n0,1x,0,0,0,0\n", &plain).contains("is no number"));
}

#[test]
fn results_can_be_read_back() {
    let (_, recording) = run(montecarlo::NOISE, 0.1);
    let samples = Samples::read(&csv(&recording), &Reading::default()).expect("a good recording");
    let tracks = vec![identify::track(&samples, &config(&samples)).expect("a good configuration")];
    let json = identify::json(&samples, &tracks);
    let hat = json["methods"][0]["estimate"]["lambdaHat"][2].as_f64().expect("a number");
    assert!((hat / TRUTH[2] - 1.0).abs() < 0.02, "{json}");
    assert_eq!(identify::recording(&samples, &tracks).columns.len(), 13);
    let page = identify::page("A <title>", "command", &samples, &tracks, None);
    assert!(page.contains("A &lt;title&gt;") && page.matches("<svg").count() == 4);
}

/// Currents in a table of their own: held ones at four times the rate, and points of a continuous current at another rate.
#[test]
fn currents_may_have_a_table_of_their_own() {
    let (_, recording) = run(montecarlo::NOISE, 0.15);
    let whole = csv(&recording);
    let together = Samples::read(&whole, &Reading::default()).expect("a good recording");
    let column = |name: &str| recording.get(name).expect("a column");
    let mut currents = String::from("Time [ms];Coil A [mA];Coil B [mA];Coil C [mA]\n");
    for n in 0..4 * (recording.time_s.len() - 1) {
        // Held before: the sample at the end of an interval and those within it are the same.
        let at = n.div_ceil(4);
        let cells = [1, 2, 3].map(|k| format!("{:.9}", 1e3 * column(&format!("plant.im[{k}]"))[at]).replace('.', ","));
        currents += &format!("{};{}\n", format!("{:.4}", 0.025 * n as f64).replace('.', ","), cells.join(";"));
    }
    let columns = [1, 2, 3].map(|k| (format!("im[{k}]"), format!("Coil {}", ["A", "B", "C"][k - 1]))).to_vec();
    let reading = Reading { columns, ..Reading::default() };
    let apart = Samples::read_apart(&whole, &currents, &reading).expect("usable recordings");
    assert!(apart.notes.iter().any(|note| note.contains("of their own")), "{:?}", apart.notes);
    let [one, other] = [&together, &apart].map(|samples| {
        let track = identify::track(samples, &config(samples)).expect("a good configuration");
        track.last_valid().expect("an estimate").lambda_hat
    });
    for (one, other) in one.iter().zip(other) {
        // The table begins and ends with an interval less, and has nine digits.
        assert!((one / other - 1.0).abs() < 1e-3, "{one} in one table, {other} in two");
    }

    let sine = |time_s: f64, k: usize| 1.5 + 0.5 * (100.0 * std::f64::consts::PI * time_s + k as f64).sin();
    let mut currents = String::from("time,im[1],im[2],im[3]\n");
    for n in (0..1000).filter(|n| !(400..450).contains(n)) {
        let time_s = 1e-5 + f64::from(n) / 7000.0;
        let cells = [0, 1, 2].map(|k| format!("{:.9}", sine(time_s, k)));
        currents += &format!("{time_s:.9},{}\n", cells.join(","));
    }
    let apart = Samples::read_apart(&whole, &currents, &Reading::default()).expect("usable recordings");
    for (k, values) in apart.currents(identify::Currents::Linear).iter().enumerate() {
        let mut missing = 0;
        for (j, value) in values.iter().enumerate() {
            let time_s = apart.start_s + j as f64 * apart.step_s;
            if value.is_nan() {
                missing += 1;
            } else {
                // A chord of a seventh of a millisecond is off by at most 0.13 mA here.
                assert!((value - sine(time_s, k)).abs() < 2e-4, "{value} A at {time_s} s, wanted {}", sine(time_s, k));
            }
        }
        // The hole of 7.1 ms, and the end after 142.9 ms.
        assert!((100..160).contains(&missing), "{missing} samples without a current");
    }
    let refused = Samples::read_apart(&whole, "time,im[1]\n0,1\n", &Reading::default()).expect_err("two are missing");
    assert!(refused.to_string().contains("im[2]"), "{refused}");
}
