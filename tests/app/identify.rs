//! Recordings with the imperfections of test benches: names, units, separators, gaps, other rates, no angle.

use std::path::Path;

use fmu_export::variable::Value;
use magnetic_bearing::estimation::{EstimatorConfig, Hold};
use magnetic_bearing::report::identification;
use magnetic_bearing::simulation::recording::Recording;
use magnetic_bearing::simulation::scenario::Scenario;
use magnetic_bearing::simulation::simulate;
use magnetic_bearing::studies::identify::{self, Question, Reading, Samples, duration_s, likelihood, rate_s};
use magnetic_bearing::studies::montecarlo;

use crate::support::Random;

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
    let residuals = identify::residuals_of_holds(&measured, &config(&measured));
    println!("{residuals:?}");
    assert!(residuals[0] < residuals[1] && residuals[0] < residuals[2], "held before: {residuals:?}");
    let columns = [1, 2, 3].map(|k| (format!("im[{k}]"), format!("controller.i[{k}]"))).to_vec();
    let issued = Samples::read(&text, &Reading { columns, ..Reading::default() }).expect("a good recording");
    let residuals = identify::residuals_of_holds(&issued, &config(&issued));
    assert!(residuals[1] < residuals[0] && residuals[1] < residuals[2], "held after: {residuals:?}");
    // Commands have no noise: the error is a good deal smaller.
    let errors = errors(&issued, &EstimatorConfig { hold: Hold::HeldAfter, ..config(&issued) });
    assert!(largest(errors) < 4e-3, "{errors:?}, limit 0.4 %");
}

/// The recording in tests/data: semicolons, decimal commas, German names, ms, µm and mA, remarks before the header, a clock
/// with jitter, positions and currents missing here and there, the angle in wrapped degrees, no speed.
#[test]
fn a_recording_with_all_imperfections() {
    let text = include_str!("../data/bench.csv");
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
    // Without angle and speed there is no unbalance to be identified: the estimate does not pretend, or the speed is told.
    let blind = spoilt(&|_, name| name.starts_with("plant.theta") || name.starts_with("plant.omegam"));
    let blind = blind.replace("plant.theta", "plant.unused").replace("plant.omegam", "plant.unusedToo");
    let samples = Samples::read(&blind, &Reading::default()).expect("a usable recording");
    let track = identify::track(&samples, &config(&samples)).expect("a good configuration");
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
    assert!(refused(header, &plain).contains("furlong is none of m, mm, µm"));
    let header = "time,Ym,Zm,im[1],im[2],im[3]\n";
    let rows =
        |time: &dyn Fn(usize) -> f64| (0..50).map(|j| format!("{},1e-5,1e-5,1,1,1\n", time(j))).collect::<String>();
    let words = refused(&format!("{header}0,here,0,1,1,1\n"), &plain);
    assert!(words.contains("is no number"), "{words}");
    let back = refused(&format!("{header}{}", rows(&|j| (j as f64 - 25.0).abs())), &plain);
    assert!(back.contains("time goes back at 25 places, the first in line 3, from 25 s to 24 s"), "{back}");
    let uneven = format!("{header}{}", rows(&|j| 1e-4 * (j as f64 + 0.4 * (j as f64).sin())));
    // Nothing is proposed that does not fit.
    let words = refused(&uneven, &plain);
    assert!(words.contains("contradict an even pace") && !words.contains("--resample"), "{words}");
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
    let page = identification::page("A <title>", "command", &samples, &tracks, None, None);
    assert!(page.contains("A &lt;title&gt;") && page.matches("application/json").count() == 4);
}

fn question(samples: &Samples, tolerances: &[(&str, &str)]) -> Question {
    let config = config(samples);
    let mut bench = [likelihood::Told::default(); likelihood::BENCH];
    for (name, value) in tolerances {
        for (at, std) in identify::tolerance(name, value, config.m_kg, config.gap_m).expect("a good tolerance") {
            bench[at].knowledge = likelihood::Knowledge::Tolerance(std);
        }
    }
    Question { config, bench, threads: 1 }
}

fn ask(samples: &[Samples], tolerances: &[(&str, &str)]) -> identify::Answer {
    identify::answer(samples, question(&samples[0], tolerances)).expect("a good question")
}

fn samples_of(recording: &Recording) -> Samples {
    Samples::read(&csv(recording), &Reading::default()).expect("a good recording")
}

#[test]
fn the_answer_is_that_of_the_whole_recording() {
    let samples = samples_of(&run(montecarlo::NOISE, 0.4).1);
    let alone = ask(std::slice::from_ref(&samples), &[]);
    let wide = ask(std::slice::from_ref(&samples), &[("s", "2%"), ("alpha", "1deg")]);
    let twice = ask(&[samples.clone(), samples.clone()], &[]);
    for (answer, note) in [(&alone, "mind the budget"), (&wide, "what was told of the bench"), (&twice, "budget")] {
        assert!(answer.valid && answer.verdict.contains(note), "{} {:?}", answer.verdict, answer.findings);
        assert!(answer.findings.is_empty(), "{:?}", answer.findings);
        let found = answer.found.as_ref().expect("estimates");
        for (lambda, truth) in found.lambda.iter().zip(TRUTH) {
            let ratio = (lambda.value - truth) / lambda.total_std;
            assert!(ratio.abs() < 4.0, "{lambda:?}: {ratio:.1} standard deviations");
        }
        let page = identification::page("", "", &samples, &[], None, Some(answer));
        assert!(page.contains("Maximum likelihood") && page.contains("Budget"));
        assert!(answer.told().contains("m = 6.7 kg, s = 0.5 mm"), "{}", answer.told());
    }
    let std = |answer: &identify::Answer| answer.found.as_ref().map_or(f64::NAN, |found| found.lambda[0].total_std);
    assert!(std(&wide) > 3.0 * std(&alone) && std(&twice) < 0.8 * std(&alone));
    // A typical bench is known to per cents only, whatever the noise.
    assert!(alone.typical().expect("estimates").iter().all(|std| (0.02..0.1).contains(std)));
    let json = wide.json();
    for key in ["lambdaHat", "lambdaStd", "lambdaStdTotal", "unbalance", "bench", "budget", "noise", "verdict"] {
        assert!(!json[key].is_null(), "{key}: {json}");
    }
    assert!(json["bench"]["s"]["stdTotal"].as_f64().is_some_and(|std| std < 0.02), "{json}");
}

#[test]
fn tolerances_have_units() {
    let of = |name: &str, value: &str| identify::tolerance(name, value, 6.7, 5e-4);
    for (name, value, count, std) in [
        ("s", "2%", 1, 0.02),
        ("s", "10 µm", 1, 0.02),
        ("m", "0.067kg", 1, 0.01),
        ("alpha", "1deg", 3, 1.0_f64.to_radians()),
        ("alpha[2]", "0.01", 1, 0.01),
        ("sensor.offset", "5um", 2, 5e-6),
        ("current.offset", "10mA", 3, 0.01),
        ("delay", "20us", 1, 2e-5),
    ] {
        let found = of(name, value).unwrap_or_else(|why| panic!("{why}"));
        assert_eq!(found.len(), count, "{name}");
        assert!(found.iter().all(|(_, got)| (got / std - 1.0).abs() < 1e-9), "{name}={value}: {found:?}");
    }
    for (name, value, words) in [
        ("gap", "1%", "gap is no parameter of a bench; there are m, s, alpha[1]"),
        ("sensor", "1%", "sensor is no parameter"),
        ("alpha", "1 furlong", "in rad, mrad, deg, °"),
        ("alpha", "-1deg", "a number above 0"),
        ("s", "150%", "less than 100 %"),
        ("m", "wide", "in %, ppm, kg, g"),
    ] {
        let why = of(name, value).expect_err("refused");
        assert!(why.contains(words), "{why}");
    }
}

/// What people get wrong: what is done to a good recording, and what is proposed.
type Wrong = (fn(&mut Samples, &mut Question), &'static str);

const WRONG: &[Wrong] = &[
    (|samples, _| samples.position_m.swap(0, 1), "y and z are exchanged: exchange Ym and Zm"),
    (|samples, _| samples.position_m[0].iter_mut().for_each(|y| *y = -*y), "y is mirrored"),
    (|samples, _| samples.position_m[1].iter_mut().for_each(|z| *z = -*z), "z is mirrored"),
    (|samples, _| samples.current_a.rotate_left(1), "the magnets count from the third"),
    (|samples, _| samples.current_a.swap(0, 1), "magnets 1 and 2 are exchanged"),
    (
        |samples, _| {
            samples.theta_rad.iter_mut().for_each(|theta| *theta = -*theta);
            samples.omega_rad_s.iter_mut().for_each(|omega| *omega = -*omega);
        },
        "the angle counts against the rotation",
    ),
    // Each row has the command that is issued at it.
    (|samples, _| samples.current_a.iter_mut().for_each(|i| i.rotate_left(1)), "--hold heldAfter"),
    (|_, question| question.config.hold = Hold::HeldAfter, "--hold heldBefore"),
    (|_, question| question.config.gap_m = 6e-4, "--estimate s"),
];

#[test]
fn what_is_wrong_is_told_in_words() {
    let good = samples_of(&run(montecarlo::NOISE, 0.3).1);
    for (spoil, proposal) in WRONG {
        let mut samples = good.clone();
        let mut question = question(&good, &[]);
        spoil(&mut samples, &mut question);
        let answer = identify::answer(&[samples], question).expect("a good question");
        let first = answer.findings.first().cloned().unwrap_or_default();
        println!("{}\n  {first}", answer.verdict);
        assert!(!answer.valid && first.contains(proposal), "{proposal}: {} {:?}", answer.verdict, answer.findings);
        let json = answer.json();
        assert!(json["valid"] == false && json["lambdaHat"].is_null() && json["findings"].is_array(), "{json}");
    }
}

/// Two mistakes at once may undo each other (axes exchanged and the angle reversed is a bearing seen from behind, with its magnets turned), but
/// then λ is right. Otherwise no pair of them is valid.
#[test]
fn no_two_mistakes_end_valid() {
    let good = samples_of(&run(montecarlo::NOISE, 0.05).1);
    let pairs: Vec<[usize; 2]> =
        (0..WRONG.len()).flat_map(|one| (one + 1..WRONG.len()).map(move |other| [one, other])).collect();
    let wrong = montecarlo::in_parallel(pairs.len(), |at| {
        let mut samples = good.clone();
        let mut question = question(&good, &[]);
        pairs[at].iter().for_each(|mistake| WRONG[*mistake].0(&mut samples, &mut question));
        let answer = identify::answer(&[samples], question).expect("a good question");
        let off = |found: &likelihood::Identification| {
            (0..3).map(|k| ((found.lambda[k].value - TRUTH[k]) / found.lambda[k].total_std).abs()).fold(0.0, f64::max)
        };
        let right = answer.found.as_ref().is_some_and(|found| off(found) < CONFIDENT);
        (answer.valid && !right).then(|| format!("{:?}: {}", pairs[at].map(|mistake| WRONG[mistake].1), answer.verdict))
    });
    let wrong: Vec<String> = wrong.into_iter().flatten().collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// The exit code is 2 and the verdict in words; standard output is one JSON document.
#[test]
fn the_command_refuses_in_json_and_by_its_exit_code() {
    let folder = std::env::temp_dir().join(format!("identify-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let command = |name: &str, text: &str, more: &[&str]| {
        let path = folder.join(name);
        std::fs::write(&path, text).expect("a file");
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_magnetic-bearing"))
            .arg("identify")
            .arg(&path)
            .args(["--json", "-"])
            .args(more)
            .output()
            .expect("it runs");
        let out = String::from_utf8(output.stdout).expect("text");
        let json: serde_json::Value = serde_json::from_str(&out).unwrap_or_else(|why| panic!("{why}: {out}"));
        (output.status.code(), json)
    };
    let good = csv(&run(montecarlo::NOISE, 0.2).1);
    let short: String = good.lines().take(200).map(|line| format!("{line}\n")).collect();
    let (code, json) = command("short.csv", &short, &[]);
    assert!(code == Some(2) && json["verdict"].as_str().is_some_and(|words| words.contains("too short")), "{json}");
    let (code, json) = command("good.csv", &good, &[]);
    assert!(code == Some(0) && json["valid"] == true && json["lambdaHat"][0].is_f64(), "{json}");
    let swapped =
        good.replacen("plant.Ym", "other", 1).replacen("plant.Zm", "plant.Ym", 1).replacen("other", "plant.Zm", 1);
    let (code, json) = command("swapped.csv", &swapped, &[]);
    let proposal = json["findings"][0].as_str().unwrap_or_default();
    assert!(code == Some(2) && proposal.contains("exchange Ym and Zm (--column)"), "{json}");
    std::fs::remove_dir_all(&folder).expect("the folder");
}

/// A table `[tolerance]` of the scenario says the same as `--tolerance`, which goes before it.
#[test]
fn a_scenario_tells_tolerances() {
    let folder = std::env::temp_dir().join(format!("identify-tolerance-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let (recording, scenario) = (folder.join("good.csv"), folder.join("mine.toml"));
    std::fs::write(&recording, csv(&run(montecarlo::NOISE, 0.2).1)).expect("a file");
    let command = |table: &str, more: &[&str]| {
        let text = format!("title = \"Mine\"\nduration = \"1 s\"\nstep = \"100 µs\"\n\n{table}");
        std::fs::write(&scenario, text).expect("a file");
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_magnetic-bearing"));
        command.args(["identify", "--json", "-", "--scenario"]).arg(&scenario).arg(&recording).args(more);
        let output = command.output().expect("it runs");
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("text");
        (text(output.stdout), text(output.stderr))
    };
    let told = |json: &str, name: &str| {
        let json: serde_json::Value = serde_json::from_str(json).unwrap_or_else(|why| panic!("{why}: {json}"));
        let budget = json["budget"].as_array().expect("a budget").clone();
        let line = budget.iter().find(|line| line["parameter"] == name && line["told"] == true);
        line.map(|line| line["tolerance"].as_f64().expect("a number"))
    };
    let table = "[tolerance]\ns = \"10 µm\"\nalpha = \"0.5 deg\"\nsensor.offset = 5e-6\n";
    let (json, _) = command(table, &[]);
    let close = |found: Option<f64>, wanted: f64| found.is_some_and(|found| (found / wanted - 1.0).abs() < 1e-9);
    assert!(close(told(&json, "s"), 0.02) && close(told(&json, "alpha[3]"), 0.5_f64.to_radians()), "{json}");
    assert!(close(told(&json, "sensor.offset[z]"), 5e-6) && told(&json, "m").is_none(), "{json}");
    let (json, _) = command(table, &["--tolerance", "s=1%"]);
    assert!(close(told(&json, "s"), 0.01), "{json}");
    for (table, words) in [
        ("[tolerance]\ngap = \"1 %\"\n", "gap is no parameter of a bench"),
        ("[tolerance]\ns = \"wide\"\n", "a number above 0 is wanted"),
    ] {
        let (_, error) = command(table, &[]);
        assert!(error.contains(words), "{words}: {error}");
    }
    std::fs::remove_dir_all(&folder).expect("the folder");
}

/// Rotor, magnets and gap of another machine: nothing is valid, and the verdict says why.
#[test]
fn a_recording_of_another_machine_is_not_valid() {
    let (base, told) = run(montecarlo::NOISE, 0.1);
    let told = samples_of(&told);
    for seed in [62_901, 62_902] {
        let mut scenario = montecarlo::cases::drawn(&base, seed, false);
        scenario.duration_s = 0.1;
        let samples = samples_of(&simulate::run(&scenario).expect("a good scenario").recording);
        let mut question = question(&told, &[]);
        question.config.step_s = samples.step_s;
        let answer = identify::answer(&[samples], question).expect("a good question");
        println!("seed {seed}: {} {:?}", answer.verdict, answer.findings);
        assert!(!answer.valid && answer.verdict.starts_with("Not valid: "), "seed {seed}: {}", answer.verdict);
    }
}

/// What the on-line estimator is told of its bench holds here as well.
#[test]
fn tolerances_of_the_estimator_are_those_of_the_bench() {
    use magnetic_bearing::estimation::Tolerance;
    let told = Tolerance { gap_m: 1e-5, position_gain: 0.01, alpha_rad: 0.02, ..Tolerance::default() };
    let found = identify::of_estimator(&told, 6.7, 5e-4);
    let of = |name: &str| {
        let at = likelihood::by_name(name).expect("a parameter");
        found.iter().find(|(of, _)| *of == at).map(|(_, std)| *std)
    };
    assert_eq!(found.len(), 6, "{found:?}");
    assert!(of("s").is_some_and(|std| (std - 0.02).abs() < 1e-12) && of("alpha[3]") == Some(0.02) && of("m").is_none());
    // Each of two independent gains has the variance of mean and half difference together.
    let [mean, half] = ["sensor.gain", "sensor.gainDifference"].map(|name| of(name).expect("a tolerance"));
    assert!((mean.hypot(half) - 0.01).abs() < 1e-12);
}

#[test]
fn what_says_nothing_is_not_valid() {
    let short = samples_of(&run(montecarlo::NOISE, 0.02).1);
    let answer = ask(&[short], &[]);
    assert!(!answer.valid && answer.verdict.contains("too short"), "{}", answer.verdict);
    let (mut scenario, _) = run(montecarlo::NOISE, 0.01);
    montecarlo::cases::at_rest(&mut scenario);
    montecarlo::cases::unbalance(&mut scenario, 0.0, 0.0);
    scenario.duration_s = 0.5;
    let of = |scenario: &Scenario| samples_of(&simulate::run(scenario).expect("a good scenario").recording);
    let answer = ask(&[of(&scenario)], &[]);
    println!("{} {:?}", answer.verdict, answer.found.map(|found| found.lambda));
    assert!(!answer.valid && answer.verdict.contains("at rest and nothing excites it"), "{}", answer.verdict);
    montecarlo::cases::modulation(&mut scenario, 0.5, 110.0);
    let answer = ask(&[of(&scenario)], &[]);
    assert!(answer.valid, "{} {:?}", answer.verdict, answer.findings);
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

/// Speed of the rotor in the recordings below, in rad/s.
const OMEGA: f64 = 100.0 * std::f64::consts::PI;

/// A recording of an orbit at 10 kHz, whose time cells are told. 0.1 µm and 10 mA of noise, equally distributed.
struct Bench {
    rows: usize,
    omega_rad_s: f64,
    step_s: f64,
}

const BENCH: Bench = Bench { rows: 10_001, omega_rad_s: OMEGA, step_s: 1e-4 };

impl Bench {
    /// Time, positions, currents, unwrapped angle and speed of every row, in SI units.
    fn values(&self) -> Vec<[f64; 8]> {
        let mut random = Random::new(12);
        let mut noise = |size: f64| random.between(-size, size) * 3.0_f64.sqrt();
        let row = |j: usize| {
            let time = j as f64 * self.step_s;
            let theta = 0.3 + self.omega_rad_s * time;
            let [y, z] = [30e-6 * theta.cos() + noise(1e-7), 70e-6 * theta.sin() + noise(1e-7)];
            let mut current = |k: f64| 1.5 + 0.4 * (theta + k).sin() + noise(1e-2);
            [time, y, z, current(0.0), current(2.0), current(4.0), theta, self.omega_rad_s]
        };
        (0..self.rows).map(row).collect()
    }

    /// A table with the given times; rows without one are dropped.
    fn with_times(&self, header: &str, time: impl Fn(usize) -> Option<String>) -> String {
        let mut text = format!("{header},Ym [m],Zm [m],im[1] [A],im[2] [A],im[3] [A],theta [rad]\n");
        for (j, [_, y, z, a, b, c, theta, _]) in self.values().into_iter().enumerate() {
            if let Some(time) = time(j) {
                text += &format!("{time},{y:e},{z:e},{a:.4},{b:.4},{c:.4},{theta:.6}\n");
            }
        }
        text
    }
}

/// Equally distributed over ±`size`.
fn jitter(seed: u64, rows: usize, size: f64) -> Vec<f64> {
    let mut random = Random::new(seed);
    (0..rows).map(|_| random.between(-size, size)).collect()
}

#[test]
fn the_pace_is_a_straight_line_through_the_stamps() {
    let rows = BENCH.rows;
    let jittered = jitter(1, rows, 5e-6);
    let late: Vec<f64> = jitter(2, rows, 1.0).iter().map(|u| 2e-6 * -(0.5 + 0.5 * u).max(1e-9).ln()).collect();
    let at = |j: usize| 1e-4 * j as f64;
    let some = |text: String| Some(text);
    let epoch = 1_763_735_894_u64;
    type Stamp<'a> = Box<dyn Fn(usize) -> Option<String> + 'a>;
    let civil = |j: usize, places: usize| {
        let ns = 100_000 * j as u64;
        let fraction = format!("{:09}", ns % 1_000_000_000);
        format!("2026-11-21T14:38:{:02}.{}", 14 + ns / 1_000_000_000, &fraction[..places])
    };
    // What it is, header, stamps, sample time, samples, words among the notes.
    let cases: Vec<(&str, &str, Stamp, f64, usize, &str)> = vec![
        ("exact", "time [s]", Box::new(|j| some(format!("{:.4}", at(j)))), 1e-4, rows, ""),
        (
            "5 µs of jitter",
            "time [s]",
            Box::new(|j| some(format!("{:.7}", at(j) + jittered[j]))),
            1e-4,
            rows,
            "scatter by 2.9 µs",
        ),
        ("latency", "time [s]", Box::new(|j| some(format!("{:.7}", at(j) + late[j]))), 1e-4, rows, "scatter"),
        ("10 µs rounding", "time [s]", Box::new(|j| some(format!("{:.5}", at(j) * 1.0417))), 1.0417e-4, rows, ""),
        (
            "1 ms rounding",
            "time [s]",
            Box::new(|j| some(format!("{:.3}", at(j) + 3e-5))),
            1e-4,
            rows,
            "rounded to 1 ms",
        ),
        (
            "1 ms, 9600 Hz",
            "time [ms]",
            Box::new(|j| some(format!("{:.0}", j as f64 / 9.6))),
            1.0 / 9600.0,
            rows,
            "rounded",
        ),
        (
            "0.1 ms, 9600 Hz",
            "time [ms]",
            Box::new(|j| some(format!("{:.1}", j as f64 / 9.6))),
            1.0 / 9600.0,
            rows,
            "rounded",
        ),
        (
            "a clock of 1/64 s",
            "time [s]",
            Box::new(|j| some(format!("{}", (64.0 * at(j)).floor() / 64.0))),
            1e-4,
            rows,
            "rounded",
        ),
        (
            "epoch in s",
            "time [s]",
            Box::new(|j| some(format!("{epoch}.{:04}", j % 10_000 + j / 10_000 * 9999))),
            1e-4,
            10_000,
            "",
        ),
        (
            "epoch in ms",
            "time",
            Box::new(|j| some(format!("{}.{}", epoch * 1000 + j as u64 / 10, j % 10))),
            1e-4,
            rows,
            "Unix times in ms",
        ),
        (
            "epoch in µs",
            "time [µs]",
            Box::new(|j| some(format!("{}", epoch * 1_000_000 + 100 * j as u64))),
            1e-4,
            rows,
            "Unix",
        ),
        (
            "epoch in ns",
            "t",
            Box::new(|j| some(format!("{}", epoch * 1_000_000_000 + 100_000 * j as u64))),
            1e-4,
            rows,
            "Unix",
        ),
        ("ISO", "time", Box::new(|j| some(civil(j, 6))), 1e-4, rows, "counts from 2026-11-21T14:38:14.000000"),
        ("ISO, zone, 1 ms", "time", Box::new(|j| some(civil(j, 3) + "+01:00")), 1e-4, rows, "rounded to 1 ms"),
        ("ISO, blank", "time", Box::new(|j| some(civil(j, 4).replace('T', " "))), 1e-4, rows, ""),
        ("time of day", "time", Box::new(|j| some(civil(j, 4)[11..].into())), 1e-4, rows, ""),
        (
            "dropped rows",
            "time [s]",
            Box::new(|j| (j % 97 != 50).then(|| format!("{:.4}", at(j)))),
            1e-4,
            rows,
            "103 rows are missing at 103",
        ),
        (
            "dropped, jitter",
            "time [s]",
            Box::new(|j| (j % 97 != 50).then(|| format!("{:.7}", at(j) + jittered[j]))),
            1e-4,
            rows,
            "103 rows are missing at 103",
        ),
        (
            "a long hole",
            "time [s]",
            Box::new(|j| (!(500..4000).contains(&j)).then(|| format!("{:.7}", at(j) + jittered[j]))),
            1e-4,
            rows,
            "3500 rows are missing at 1 places, the first after line 501",
        ),
        (
            "outliers",
            "time [s]",
            Box::new(|j| some(if j % 1000 == 7 { "99".into() } else { format!("{:.4}", at(j)) })),
            1e-4,
            rows,
            "in lines 9, 1009",
        ),
        (
            "a stuck stamp",
            "time [s]",
            Box::new(|j| some(format!("{:.4}", at(if j == 70 { 69 } else { j })))),
            1e-4,
            rows,
            "line 72 replaced",
        ),
        ("from 12 s on", "time [s]", Box::new(|j| some(format!("{:.4}", 12.0 + at(j)))), 1e-4, rows, ""),
    ];
    for (name, header, stamp, step_s, count, words) in cases {
        let samples = Samples::read(&BENCH.with_times(header, stamp), &Reading::default());
        let samples = samples.unwrap_or_else(|error| panic!("{name}: {error}"));
        println!("{name}: {:?}", samples.notes);
        // The pace is known to a part of a sample over the whole recording.
        let off = (samples.step_s / step_s - 1.0).abs() * count as f64;
        assert!(off < 0.05, "{name}: {} s, off by {off:.3} samples at the end", samples.step_s);
        assert_eq!(samples.len(), count, "{name}: {:?}", samples.notes);
        assert!(samples.notes.iter().any(|note| note.contains(words)), "{name}: {words} in {:?}", samples.notes);
        assert_eq!(samples.implausible(5e-4), [], "{name}");
    }
}

#[test]
fn stamps_that_contradict_an_even_pace_are_refused_and_named() {
    let rows = BENCH.rows;
    let at = |j: usize| 1e-4 * j as f64;
    let wild = jitter(3, rows, 4e-5);
    let lost = jitter(4, rows, 1.0);
    type Stamp<'a> = Box<dyn Fn(usize) -> Option<String> + 'a>;
    let cases: Vec<(&str, Stamp, &[&str])> = vec![
        (
            "twice",
            Box::new(|j| Some(format!("{:.4}", at(if j > 70 { j - 1 } else { j })))),
            &["line 73: the stamp of the row before", "7 ms"],
        ),
        (
            "back",
            Box::new(|j| Some(format!("{:.4}", at(if j > 6000 { j - 6000 } else { j })))),
            &["time goes back at 1 places, the first in line 6003, from 600 ms to 100 µs"],
        ),
        (
            "one row back",
            Box::new(|j| {
                Some(format!(
                    "{:.4}",
                    match j {
                        0..80 => at(j),
                        80 => at(40),
                        _ => at(j - 1),
                    }
                ))
            }),
            &["line 82: time goes back"],
        ),
        (
            "two paces",
            Box::new(|j| Some(format!("{:.7}", at(j) + 2e-6 * (j as f64 - 5000.0).max(0.0)))),
            &["contradict an even pace", "100 µs in the first tenth, 102 µs in the last"],
        ),
        ("wild", Box::new(|j| Some(format!("{:.7}", at(j) + wild[j]))), &["contradict an even pace", "straight line"]),
        (
            "rounded and lost",
            Box::new(|j| (lost[j] < 0.8).then(|| format!("{:.3}", at(j)))),
            &["no even pace explains them as rounding"],
        ),
        ("not rising", Box::new(|_| Some("1".into())), &["time does not rise"]),
        (
            "a jump",
            Box::new(|j| Some(format!("{:.4}", at(j) + if j > 9000 { 1000.0 } else { 0.0 }))),
            &["time jumps from 900 ms in line 9002 to 1000.9 s in line 9003"],
        ),
        (
            "no stamp",
            Box::new(|j| Some(if j == 40 { "soon".into() } else { format!("{:.4}", at(j)) })),
            &["line 42, time: \"soon\" is no time"],
        ),
    ];
    for (name, stamp, words) in cases {
        let text = BENCH.with_times("time [s]", stamp);
        let error = Samples::read(&text, &Reading::default()).expect_err(name).to_string();
        println!("{name}: {error}");
        for word in words {
            assert!(error.contains(word), "{name}: {word} in {error}");
        }
        assert!(!error.contains("--resample"), "{name}: {error}");
    }
    let text = BENCH.with_times("time [s]", |j| Some(format!("{}", 1_763_735_894_000 + j / 10)));
    let error = Samples::read(&text, &Reading::default()).expect_err("ms are no s").to_string();
    assert!(error.contains("a Unix time in ms?") && error.contains("--unit time=ms"), "{error}");
}

#[test]
fn a_rate_may_be_told() {
    let rate = |text: &str| Reading { rate_s: Some(rate_s(text).expect("a rate")), ..Reading::default() };
    let none = BENCH.with_times("Nr", |j| Some(j.to_string()));
    let error = Samples::read(&none, &Reading::default()).expect_err("no time").to_string();
    assert!(error.contains("--rate"), "{error}");
    let samples = Samples::read(&none, &rate("10kHz")).expect("a usable recording");
    assert_eq!((samples.step_s, samples.len(), samples.start_s), (1e-4, BENCH.rows, 0.0));
    let stamps = BENCH.with_times("time [s]", |j| Some(format!("{:.7}", 1.0001e-4 * j as f64)));
    assert_eq!(Samples::read(&stamps, &rate("10 kHz")).expect("clocks may differ").step_s, 1e-4);
    let error = Samples::read(&stamps, &rate("9600 Hz")).expect_err("another rate").to_string();
    assert!(error.contains("104.1667 µs apart, the time stamps 100.01 µs"), "{error}");

    let rates =
        [("10kHz", 1e-4), ("9600 Hz", 1.0 / 9600.0), ("1e4Hz", 1e-4), ("51.2 kHz", 1.0 / 51_200.0), ("1MHz", 1e-6)];
    assert!(rates.iter().all(|(text, step_s)| rate_s(text) == Ok(*step_s)));
    let steps =
        [("100us", 1e-4), ("100 µs", 1e-4), ("0.1ms", 1e-4), ("1e-4", 1e-4), ("1e-4 s", 1e-4), ("50000ns", 5e-5)];
    for (text, step_s) in steps {
        assert_eq!(duration_s(text), Ok(step_s), "{text}");
    }
    for text in ["10", "10 MHz 3", "kHz", "-1kHz", "0Hz", "infHz", "10mHz"] {
        assert!(rate_s(text).is_err(), "{text}");
    }
    for text in ["", "us", "-1us", "0", "1 kg", "inf"] {
        assert!(duration_s(text).is_err(), "{text}");
    }
}

#[test]
fn encodings_separators_and_decimal_commas() {
    let plain = BENCH.values();
    let header = "Zeit [ms];Weg y [µm];Weg z [µm];im1 [A];im2 [A];im3 [A];Winkel [°]";
    let mut text = String::from("# Prüfstand, Maß 7\nAbtastrate;10 kHz\n\n");
    text += header;
    text += "\r\n";
    for [time, y, z, a, b, c, theta, _] in plain.iter().take(2000) {
        let cells = [time * 1e3, y * 1e6, z * 1e6, *a, *b, *c, theta.to_degrees() % 360.0];
        let cells = cells.map(|cell| format!("{cell:.4}").replace('.', ","));
        text += &format!("{}\r\n", cells.join(";"));
    }
    let columns = [("time", "Zeit"), ("Ym", "Weg y"), ("Zm", "Weg z"), ("theta", "Winkel")];
    let columns: Vec<_> = columns.map(|(signal, column)| (signal.to_owned(), column.to_owned())).to_vec();
    let reading = Reading { columns, ..Reading::default() };
    let sixteen = |order: fn(u16) -> [u8; 2], mark: bool| -> Vec<u8> {
        let mark = mark.then_some(0xfeff);
        mark.into_iter().chain(text.encode_utf16()).flat_map(order).collect()
    };
    let latin = text.chars().map(|c| u8::try_from(u32::from(c)).expect("Latin-1")).collect::<Vec<u8>>();
    let tabs = text.replace(';', "\t");
    let points = text.replace(',', ".").replace(';', ",");
    let row = text.replace(
        header,
        "Zeit;Weg y;Weg z;im1;im2;im3;Winkel\nms;[µm];µm;(A);A;A;Grad".replace("Grad", "deg").as_str(),
    );
    let cases: Vec<(&str, Vec<u8>)> = vec![
        ("UTF-8", text.clone().into_bytes()),
        ("UTF-8 with mark", [b"\xef\xbb\xbf", text.as_bytes()].concat()),
        ("UTF-16 LE with mark", sixteen(u16::to_le_bytes, true)),
        ("UTF-16 BE with mark", sixteen(u16::to_be_bytes, true)),
        ("UTF-16 LE", sixteen(u16::to_le_bytes, false)),
        ("UTF-16 BE", sixteen(u16::to_be_bytes, false)),
        ("Latin-1", latin),
        ("tabs", tabs.into_bytes()),
        ("commas", points.into_bytes()),
        ("row of units", row.into_bytes()),
        ("torn", text.as_bytes()[..text.len() - 25].to_vec()),
    ];
    for (name, bytes) in cases {
        let samples = Samples::read_from(bytes.as_slice(), &reading).unwrap_or_else(|error| panic!("{name}: {error}"));
        println!("{name}: {:?}", samples.notes);
        let count = if name == "torn" { 1999 } else { 2000 };
        assert_eq!((samples.step_s, samples.len()), (1e-4, count), "{name}");
        let last = count - 1;
        assert!((samples.position_m[1][last] - plain[last][2]).abs() < 1e-10, "{name}");
        assert!((samples.theta_rad[last] - plain[last][6]).abs() < 1e-5, "{name}: {}", samples.theta_rad[last]);
        assert_eq!(samples.implausible(5e-4), [], "{name}");
    }
    // Decimal commas in a table that is separated by commas would shift the columns.
    let shifted = text.replace(';', ",");
    let error = Samples::read(&shifted, &reading).expect_err("more cells than the header has").to_string();
    assert!(error.contains("14 cells, the header has 7; decimal commas need another separator"), "{error}");
}

/// Every unit by every name, in the header, in capitals, told.
#[test]
fn units_go_by_many_names() {
    use std::f64::consts::{PI, TAU};
    let cases: [(usize, &str, f64); 40] = [
        (0, "s", 1.0),
        (0, "ms", 1e-3),
        (0, "µs", 1e-6),
        (0, "us", 1e-6),
        (0, "μs", 1e-6),
        (0, "ns", 1e-9),
        (1, "m", 1.0),
        (1, "mm", 1e-3),
        (1, "µm", 1e-6),
        (1, "um", 1e-6),
        (1, "nm", 1e-9),
        (1, "mil", 25.4e-6),
        (1, "Mil", 25.4e-6),
        (3, "A", 1.0),
        (3, "mA", 1e-3),
        (6, "rad", 1.0),
        (6, "deg", PI / 180.0),
        (6, "°", PI / 180.0),
        (6, "Deg", PI / 180.0),
        (6, "rev", TAU),
        (7, "rad/s", 1.0),
        (7, "rpm", PI / 30.0),
        (7, "RPM", PI / 30.0),
        (7, "1/min", PI / 30.0),
        (7, "U/min", PI / 30.0),
        (7, "min-1", PI / 30.0),
        (7, "min^-1", PI / 30.0),
        (7, "min⁻¹", PI / 30.0),
        (7, "min−1", PI / 30.0),
        (7, "u/min", PI / 30.0),
        (7, "Hz", TAU),
        (7, "rev/s", TAU),
        (7, "deg/s", PI / 180.0),
        (7, "°/s", PI / 180.0),
        (7, "rad / s", 1.0),
        (6, "º", PI / 180.0),
        (1, "Micron", 1e-6),
        (0, "sec", 1.0),
        (3, "Ampere", 1.0),
        (7, "rps", TAU),
    ];
    const NAMES: [&str; 8] = ["time", "Ym", "Zm", "im[1]", "im[2]", "im[3]", "theta", "omega"];
    const SI: [&str; 8] = ["s", "m", "m", "A", "A", "A", "rad", "rad/s"];
    let bench = Bench { rows: 400, ..BENCH };
    let values = bench.values();
    for (at, unit, factor) in cases {
        for told in [false, true] {
            let head = (0..8).map(|n| match n == at {
                true if told => format!("{} [kg]", NAMES[n]),
                true => format!("{} [{unit}]", NAMES[n]),
                false => format!("{} [{}]", NAMES[n], SI[n]),
            });
            let mut text = head.collect::<Vec<_>>().join(";") + "\n";
            for row in &values {
                let cells = (0..8).map(|n| format!("{:.12}", row[n] / if n == at { factor } else { 1.0 }));
                text += &(cells.collect::<Vec<_>>().join(";") + "\n");
            }
            let units = if told { vec![(NAMES[at].to_owned(), unit.to_owned())] } else { Vec::new() };
            let samples = Samples::read(&text, &Reading { units, ..Reading::default() });
            let samples = samples.unwrap_or_else(|error| panic!("{unit}: {error}"));
            let last = values.len() - 1;
            let read = [
                samples.step_s * last as f64,
                samples.position_m[0][last],
                0.0,
                samples.current_a[0][last],
                0.0,
                0.0,
                samples.theta_rad[last],
                samples.omega_rad_s[last],
            ][at];
            assert!((read / values[last][at] - 1.0).abs() < 1e-5, "{unit}: {read}, wanted {}", values[last][at]);
            assert_eq!(samples.implausible(5e-4), [], "{unit}");
        }
    }
    let bare = "time/ms,Ym in µm,Zm (mm),im[1] [mA],im[2] <A>,im[3] {A},theta [-]\n".to_owned();
    let rows: String =
        (0..40).map(|j| format!("{},{},{},{},1,1,0.{j:02}\n", 0.1 * f64::from(j), j % 7, 0.01, 1200)).collect();
    let samples = Samples::read(&(bare + &rows), &Reading::default()).expect("a usable recording");
    assert_eq!((samples.step_s, samples.position_m[0][3], samples.current_a[0][3]), (1e-4, 3e-6, 1.2));
    assert!(
        samples.notes.iter().any(|note| note == "theta has no unit; it is taken to be in rad."),
        "{:?}",
        samples.notes
    );
}

#[test]
fn all_that_is_wrong_with_a_header_is_said_at_once() {
    let header = "Zeit [min];a.Ym [m];b.Ym [m];Zm [furlong];im1 [A];im1 [A];i2 [V];Strom [A]\n1;2;3;4;5;6;7;8\n";
    let reading = Reading {
        columns: vec![("theta".into(), "Winkel".into()), ("Xm".into(), "a".into())],
        units: vec![("im[2]".into(), "kA".into())],
        ..Reading::default()
    };
    let error = Samples::read(header, &reading).expect_err("many problems").to_string();
    for words in [
        "time (column Zeit): the unit min is none of s, ms, µs, ns",
        "Ym: several columns go by this name: a.Ym, b.Ym; one is wanted: --column Ym=…",
        "Zm (column Zm): the unit furlong is none of m, mm, µm, nm, mil",
        "im[1]: several columns go by this name: im1, im1",
        "im[2] (column i2): the unit kA is none of A, mA",
        "im[3]: no column of this name; the current of magnet 3 is wanted: --column im[3]=…",
        "--column theta=Winkel: there is no column Winkel",
        "--column Xm: Xm is no signal",
        "the header has the columns Zeit, a.Ym, b.Ym, Zm, im1, im1, i2, Strom",
    ] {
        assert!(error.contains(words), "{words} in {error}");
    }
    let one = "time,y,im1,im2,im3\n";
    let columns = vec![("Ym".into(), "y".into()), ("Zm".into(), "y".into())];
    let error =
        Samples::read(one, &Reading { columns, ..Reading::default() }).expect_err("one column twice").to_string();
    assert!(error.contains("Ym and Zm: both are column y"), "{error}");
    let two = "time [s];Ym [m];Zm [m];im1;im2;im3\ns;µm;m;A;A;A\n";
    let error = Samples::read(two, &Reading::default()).expect_err("two units").to_string();
    assert!(error.contains("column Ym: the header says m, the row below it µm"), "{error}");
}

/// How a signal is read: with the unit it has, or with another one.
struct Misread {
    signal: usize,
    /// Its values are in this unit, ...
    is: (&'static str, f64),
    /// ... and the header says this.
    said: &'static str,
}

const MISREAD: [Misread; 15] = [
    Misread { signal: 0, is: ("ms", 1e-3), said: "s" },
    Misread { signal: 0, is: ("µs", 1e-6), said: "s" },
    Misread { signal: 0, is: ("s", 1.0), said: "ms" },
    Misread { signal: 0, is: ("µs", 1e-6), said: "ms" },
    Misread { signal: 1, is: ("µm", 1e-6), said: "m" },
    Misread { signal: 1, is: ("µm", 1e-6), said: "mm" },
    Misread { signal: 1, is: ("m", 1.0), said: "µm" },
    Misread { signal: 1, is: ("mm", 1e-3), said: "µm" },
    Misread { signal: 3, is: ("mA", 1e-3), said: "A" },
    Misread { signal: 3, is: ("A", 1.0), said: "mA" },
    Misread { signal: 6, is: ("deg", std::f64::consts::PI / 180.0), said: "rad" },
    Misread { signal: 6, is: ("rev", std::f64::consts::TAU), said: "rad" },
    Misread { signal: 6, is: ("rad", 1.0), said: "deg" },
    Misread { signal: 7, is: ("rpm", std::f64::consts::PI / 30.0), said: "rad/s" },
    Misread { signal: 7, is: ("Hz", std::f64::consts::TAU), said: "rad/s" },
];

/// Findings on a recording of which some signals are misread, with angle and speed or one of them.
fn suspected(bench: &Bench, misread: &[&Misread], rotation: &[usize], wrapped: bool) -> Vec<String> {
    let names = ["time", "Ym", "Zm", "im[1]", "im[2]", "im[3]", "theta", "omega"];
    let mut units = ["s", "m", "m", "A", "A", "A", "rad", "rad/s"];
    let mut factors = [1.0; 8];
    for Misread { signal, is, said } in misread {
        let all = match signal {
            1 => 1..3,
            3 => 3..6,
            one => *one..*one + 1,
        };
        for at in all {
            (units[at], factors[at]) = (said, is.1);
        }
    }
    let signals: Vec<usize> = (0..6).chain(rotation.iter().copied()).collect();
    let head: Vec<_> = signals.iter().map(|at| format!("{} [{}]", names[*at], units[*at])).collect();
    let mut text = head.join(",") + "\n";
    for mut row in bench.values() {
        if wrapped {
            row[6] %= std::f64::consts::TAU;
        }
        let cells: Vec<_> = signals.iter().map(|at| format!("{:e}", row[*at] / factors[*at])).collect();
        text += &(cells.join(",") + "\n");
    }
    let samples = Samples::read(&text, &Reading::default()).expect("a table of numbers");
    samples.implausible(5e-4).iter().map(ToString::to_string).collect()
}

/// Sample times, speeds and ways to know the angle under which a misread unit must be seen.
#[test]
fn no_misread_unit_goes_unnoticed() {
    for (step_s, rpm, rows) in
        [(1e-4, 3000.0, 2000), (1e-4, 1000.0, 3000), (2e-5, 1000.0, 10_000), (5e-5, 7200.0, 2000), (1e-4, 6000.0, 2000)]
    {
        let bench = Bench { rows, omega_rad_s: rpm * std::f64::consts::PI / 30.0, step_s };
        for (rotation, wrapped) in [(&[6, 7][..], false), (&[6, 7], true), (&[6], false), (&[6], true), (&[7], false)] {
            let what = format!("{step_s} s, {rpm} rpm, {rotation:?}, wrapped {wrapped}");
            assert_eq!(suspected(&bench, &[], rotation, wrapped), [""; 0], "{what}");
            for misread in MISREAD.iter().filter(|misread| misread.signal < 6 || rotation.contains(&misread.signal)) {
                let found = suspected(&bench, &[misread], rotation, wrapped);
                let (is, said) = (misread.is.0, misread.said);
                if rpm == 3000.0 {
                    println!("{is} read as {said}, {what}: {found:?}");
                }
                assert!(!found.is_empty(), "{is} read as {said}: nothing was found; {what}");
                // What is right stands among the proposals.
                let name = ["time", "Ym", "", "im[1]", "", "", "theta", "omega"][misread.signal];
                let proposal = format!("--unit {name}={is}");
                assert!(found.iter().any(|finding| finding.contains(&proposal)), "{proposal} in {found:?}; {what}");
            }
        }
    }
}

/// Misreadings cannot hide each other.
#[test]
fn misread_units_together_are_seen() {
    let bench = Bench { rows: 1000, ..BENCH };
    for (n, one) in MISREAD.iter().enumerate() {
        for other in MISREAD[n + 1..].iter().filter(|other| other.signal != one.signal) {
            let mut three: Vec<Vec<&Misread>> = vec![vec![one, other]];
            three.extend(
                MISREAD[n + 1..]
                    .iter()
                    .filter(|third| third.signal > other.signal)
                    .map(|third| vec![one, other, third]),
            );
            for misread in three {
                let found = suspected(&bench, &misread, &[6, 7], n % 2 == 0);
                let what: Vec<_> = misread.iter().map(|misread| (misread.is.0, misread.said)).collect();
                assert!(!found.is_empty(), "{what:?}: nothing was found");
            }
        }
    }
}
