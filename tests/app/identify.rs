//! Answers from recordings with the imperfections of test benches, and what is said of those that give none.

mod faults;

use crate::bench::Bench;
use crate::program::{self, csv, folder, identified, number, open, pairs, run_to_end, refuses};
use crate::support::{between, library, says};
use fmu_export::variable::Value;
use magnetic_bearing::estimation::{EstimatorConfig, Hold};
use magnetic_bearing::machine::PLANAR;
use magnetic_bearing::report::identification::{self, Results};
use magnetic_bearing::simulation::recording::Recording;
use magnetic_bearing::simulation::scenario::{Element, Scenario};

use magnetic_bearing::studies::identify::likelihood::Body;
use magnetic_bearing::studies::identify::{
    self, Currents, Holds, Question, Reading, Samples, Stated, Track, likelihood,
};
use magnetic_bearing::studies::montecarlo;
use magnetic_bearing::studies::parallel::in_order;
use magnetic_bearing::variables::Choice;

const TRUTH: [f64; 3] = [1.8e-6, 2.0e-6, 2.2e-6];

/// While an estimate is valid its error is to stay below so many of its standard deviations.
const CONFIDENT: f64 = 5.0;

/// A run of the unbalanced rotor.
fn run(noise: [f64; 2], duration_s: f64) -> (Scenario, Recording) {
    let mut scenario = montecarlo::study("", &open("unbalanced", &[]), noise, false, 1).scenario;
    scenario.set("plant", "sensor.seed", Value::Integer(11));
    scenario.duration_s = duration_s;
    let recording = run_to_end(&scenario).recording;
    (scenario, recording)
}

fn config(samples: &Samples) -> EstimatorConfig {
    let window_s = identify::one_revolution(samples);
    EstimatorConfig { step_s: samples.step_s, window_s, epsilon_s: window_s, ..EstimatorConfig::default() }
}

/// The samples of a table that needs no arguments.
#[track_caller]
fn read(text: &str) -> Samples {
    Samples::read(text.as_bytes(), &Reading::default()).expect("a usable recording")
}

/// The samples of a run.
fn samples_of(recording: &Recording) -> Samples {
    read(&csv(recording))
}

/// The samples of a run of a scenario.
fn simulated(scenario: &Scenario) -> Samples {
    samples_of(&run_to_end(scenario).recording)
}

/// The estimator of the planar rotor with what these tests change of its configuration.
fn estimator(config: &EstimatorConfig) -> Element {
    let model_type = library::find(PLANAR.models[2].0).expect("a model of this project");
    let mut element = Element { name: "estimator".into(), model_type, settings: Vec::new() };
    let of = &config.tolerance;
    for (name, value) in [
        ("Ts", config.step_s),
        ("Tf", config.window_s),
        ("epsilon", config.epsilon_s),
        ("tolerance.s", of.gap_m),
        ("tolerance.alpha", of.alpha_rad),
        ("tolerance.positionGain", of.position_gain),
    ] {
        element.set(name, value);
    }
    element.set("hold", config.hold.number());
    element
}

fn stated(config: &EstimatorConfig) -> Stated {
    Stated::of(&PLANAR, &estimator(config))
}

fn track(samples: &Samples, config: &EstimatorConfig) -> Track {
    identify::track(samples, &estimator(config), 1).expect("a good configuration")
}

/// λ̂ and its standard deviation after a sample.
fn estimate(track: &Track, row: usize) -> [[f64; 3]; 2] {
    ["lambdaHat", "lambdaStd"].map(|name| [1, 2, 3].map(|k| track.of(&format!("{name}[{k}]"))[row]))
}

/// The estimate after a sample is within its standard deviations.
#[track_caller]
fn is_within(track: &Track, row: usize) {
    let [hat, std] = estimate(track, row);
    for (k, truth) in TRUTH.into_iter().enumerate() {
        let ratio = (hat[k] - truth).abs() / std[k];
        assert!(ratio < CONFIDENT, "lambda[{}]: {ratio:.1} standard deviations, limit {CONFIDENT}", k + 1);
    }
}

/// The answer is valid, and λ are right within four of their deviations. Returns the estimates.
#[track_caller]
fn is_right(what: &str, answer: &identify::Answer) -> likelihood::Identification {
    assert!(answer.valid, "{what}: {} {:?}", answer.verdict, answer.findings);
    let found = answer.found.clone().expect("estimates");
    for (lambda, truth) in found.lambda.iter().zip(TRUTH) {
        let ratio = (lambda.value - truth) / lambda.total_std;
        assert!(ratio.abs() < 4.0, "{what}: {lambda:?}: {ratio:.1} standard deviations");
    }
    found
}

/// The answer is not valid, and says so in these words.
#[track_caller]
fn is_refused(answer: &identify::Answer, words: &str) {
    assert!(!answer.valid && answer.verdict.contains(words), "{words}: {} {:?}", answer.verdict, answer.findings);
}

/// The estimator of the loop and the one over the recording of its run are the same.
#[test]
fn a_recording_says_what_the_loop_said() {
    let (_, recording) = run(montecarlo::NOISE, 0.15);
    let samples = samples_of(&recording);
    assert_eq!(samples.len(), recording.time_s.len());
    let track = track(&samples, &config(&samples));
    let in_loop = recording.get("estimator.lambdaHat[2]").expect("an estimator");
    // The loop's estimator sees a sample one communication step later.
    for (offline, online) in track.of("lambdaHat[2]").iter().zip(&in_loop[1..]) {
        let off = (offline / online - 1.0).abs();
        assert!(off < 1e-9, "{offline} offline, {online} in the loop");
    }
}

#[test]
fn the_hold_is_found() {
    let text = csv(&run(montecarlo::NOISE, 0.1).1);
    let measured = read(&text);
    let stated = stated(&config(&measured));
    let residuals = Holds::of(&measured, &stated).0.map(|(_, less)| less);
    assert!(residuals[0] < residuals[1] && residuals[0] < residuals[2], "held before: {residuals:?}");
    let columns = pairs(&[("im[1]", "controller.i[1]"), ("im[2]", "controller.i[2]"), ("im[3]", "controller.i[3]")]);
    let issued = Samples::read(text.as_bytes(), &Reading { columns, ..Reading::default() }).expect("a good recording");
    let holds = Holds::of(&issued, &stated);
    let residuals = holds.0.map(|(_, less)| less);
    assert!(residuals[1] < residuals[0] && residuals[1] < residuals[2], "held after: {residuals:?}");
    // Commands that are stated to be measured are no answer, whatever else fits.
    let stated = Question { holds: Some(holds), ..question(&issued, &[]) };
    is_refused(&identify::answer(std::slice::from_ref(&issued), stated), "--hold heldAfter");
    // Commands have no noise: the error is a good deal smaller.
    let track = track(&issued, &EstimatorConfig { hold: Hold::HeldAfter, ..config(&issued) });
    let last = track.last_valid().unwrap_or_else(|| panic!("{}", track.verdict()));
    is_within(&track, last);
    let errors = [0, 1, 2].map(|k| estimate(&track, last)[0][k] / TRUTH[k] - 1.0);
    assert!(errors.iter().all(|error| error.abs() < 4e-3), "{errors:?}");
}

/// A lag that is worth as little as this on the stretch moved λ by 20 of its deviations over the whole recording.
#[test]
fn a_lag_counts_where_it_explains_more_than_chance() {
    let of = |hold, lag| Currents { hold, lag };
    let readings = |plain: f64, lagging: f64| {
        let of_each =
            [(Hold::HeldAfter, false, plain), (Hold::HeldBefore, true, 12.0), (Hold::HeldAfter, true, lagging)];
        let [after, before, late] = of_each.map(|(hold, lag, less)| (of(hold, lag), less));
        Holds([(of(Hold::HeldBefore, false), 26.7), after, (of(Hold::Linear, false), 11.6), before, late])
    };
    assert_eq!(readings(2.7, 0.0).most_likely(), of(Hold::HeldAfter, true));
    assert_eq!(readings(0.5, 0.0).most_likely(), of(Hold::HeldAfter, false));
    assert_eq!(readings(0.0, 0.3).most_likely(), of(Hold::HeldAfter, false));
}

/// Where the lag that suits best is negative, as by chance in half of the recordings of currents without one, a lag explains nothing.
#[test]
fn no_current_leads_what_it_follows() {
    let (mut scenario, _) = run(montecarlo::NOISE, 0.1);
    let leading = (101..107).filter(|seed| {
        scenario.set("plant", "sensor.seed", Value::Integer(*seed));
        let samples = simulated(&scenario);
        let [(plain, without), .., (lagging, with), _] = Holds::of(&samples, &stated(&config(&samples))).0;
        assert!(lagging.lag && lagging.hold == plain.hold);
        with == without
    });
    between("recordings in which a lag is negative", leading.count() as f64, 1.0, 5.0);
}

/// Fails if ± does not hold by how much λ differs with a reading of the currents that is as likely, or holds what a delay makes of it.
#[test]
fn readings_that_are_as_likely_are_in_the_deviation() {
    let samples = read(&csv(&run(montecarlo::NOISE, 0.1).1));
    let asked = question(&samples, &[]);
    let open = Question { as_likely: vec![Hold::Linear], ..asked.clone() };
    let [alone, both] = [asked, open].map(|question| identify::answer(std::slice::from_ref(&samples), question));
    let [alone, both] = [is_right("alone", &alone), is_right("with another reading", &both)];
    for (alone, both) in alone.lambda.iter().zip(&both.lambda) {
        between("± with another reading over ± alone", both.total_std / alone.total_std, 1.02, 2.0);
    }
}

/// The recording that the documents offer to try needs no arguments.
#[test]
fn the_recording_to_try_is_read_as_it_stands() {
    is_right("docs/recording.csv", &ask(&[read(include_str!("../../docs/recording.csv"))], &[]));
}

/// The recording in tests/data: semicolons, decimal commas, German names, ms, µm and mA, remarks before the header, a clock
/// with jitter, positions and currents missing here and there, the angle in wrapped degrees, no speed.
#[test]
fn a_recording_with_all_imperfections() {
    let text = include_str!("../data/bench.csv");
    let [y, z, angle] = [("Ym", "Weg y"), ("Zm", "Weg z"), ("theta", "Winkel")];
    let currents = [("im[1]", "Strom 1"), ("im[2]", "Strom 2"), ("im[3]", "Strom 3")];
    let columns = pairs(&[("time", "Zeit"), y, z, angle, currents[0], currents[1], currents[2]]);
    let reading = Reading { columns, units: pairs(&[("theta", "deg")]), ..Reading::default() };
    let samples = Samples::read(text.as_bytes(), &reading).expect("a usable recording");
    assert!((samples.step_s - 1e-4).abs() < 1e-9, "{} s", samples.step_s);
    says(&samples.notes.join(" "), &["gaps"]);
    let track = track(&samples, &EstimatorConfig { hold: Hold::HeldBefore, ..config(&samples) });
    (0..samples.len()).filter(|row| track.of("valid")[*row] == 1.0).for_each(|row| is_within(&track, row));
    assert!(track.last_valid().is_some(), "{}", track.verdict());
}

#[test]
fn what_cannot_be_used_is_said() {
    let header = "time,Ym,Zm,im[1],im[2],im[3]\n";
    let with_times = |time_s: fn(f64) -> f64| {
        let rows = (0..50).map(|j| format!("{},1e-5,1e-5,1,1,1\n", time_s(f64::from(j))));
        header.to_owned() + &rows.collect::<String>()
    };
    let back = "in lines 3, 4, 5, 6, 7 and 20 more, first from 25 s to 24 s";
    // A comma parts the columns here, and so is no decimal one.
    for (text, words) in [
        ("", "no header"),
        ("time,Ym\n0,0\n", "--column Zm="),
        (&format!("{header}0,here,0,1,1,1\n"), "is no number"),
        (&format!("{header}0,1x,0,1,1,1\n"), "is no number"),
        (&with_times(|j| (j - 25.0).abs()), back),
    ] {
        says(&Samples::read(text.as_bytes(), &Reading::default()).expect_err(words).to_string(), &[words]);
    }
    // A pace that is not even is no obstacle if a rate is told.
    let uneven = with_times(|j| 1e-4 * (j + 0.4 * j.sin()));
    let of = |resample_s| Samples::read(uneven.as_bytes(), &Reading { resample_s, ..Reading::default() });
    assert!(of(None).is_err() && of(Some(1e-4)).is_ok());
}

#[test]
fn results_can_be_read_back() {
    let (_, recording) = run(montecarlo::NOISE, 0.1);
    let samples = samples_of(&recording);
    let tracks = vec![track(&samples, &config(&samples))];
    let said = vec![identify::said(&samples, &tracks)];
    let json = &said[0].json;
    let hat = json["methods"][0]["estimate"]["lambdaHat"][2].as_f64().expect("a number");
    assert!((hat / TRUTH[2] - 1.0).abs() < 0.02, "{json}");
    assert_eq!(identify::recording(&tracks).columns.len(), 13);
    let results = Results { recordings: vec![samples], tracks, said, ..Results::default() };
    let page = identification::page("A <title>", "command", &results);
    assert!(page.contains("A &lt;title&gt;") && page.matches("application/json").count() == 5);
}

fn question(samples: &Samples, tolerances: &[(&str, &str)]) -> Question {
    let mut stated = stated(&config(samples));
    for (name, value) in tolerances {
        for (at, std) in identify::tolerance(name, value, &stated).expect("a good tolerance") {
            stated.know(at, likelihood::Knowledge::Tolerance(std));
        }
    }
    Question { stated, holds: None, as_likely: Vec::new(), slow_force: None }
}

fn ask(samples: &[Samples], tolerances: &[(&str, &str)]) -> identify::Answer {
    identify::answer(samples, question(&samples[0], tolerances))
}

/// A level of noise that is not stated is found beside one that is.
#[test]
fn one_level_of_noise_may_be_stated() {
    let samples = samples_of(&run([2e-6, 3e-2], 0.8).1);
    for stated in [[2e-6, 0.0], [0.0, 3e-2]] {
        let mut question = question(&samples, &[]);
        question.stated.noise = stated;
        let answer = identify::answer(std::slice::from_ref(&samples), question);
        let noise_m = is_right(&format!("{stated:?}"), &answer).conditions[0].parts[0].position_noise_m;
        between(&format!("{stated:?}: position noise"), noise_m, 0.9 * 2e-6, 1.1 * 2e-6);
    }
}

#[test]
fn the_answer_is_that_of_the_whole_recording() {
    let samples = samples_of(&run(montecarlo::NOISE, 0.4).1);
    let alone = ask(std::slice::from_ref(&samples), &[]);
    let wide = ask(std::slice::from_ref(&samples), &[("s", "2%"), ("alpha", "1deg")]);
    let twice = ask(&[samples.clone(), samples.clone()], &[]);
    for (answer, note) in
        [(&alone, "mind the budget"), (&wide, "the stated tolerances of the bench"), (&twice, "budget")]
    {
        assert!(answer.verdict.contains(note) && answer.findings.is_empty(), "{}", answer.verdict);
        let found = is_right(note, answer);
        let (recordings, said, answer) = (vec![samples.clone()], vec![answer.said()], Some(answer.clone()));
        let page = identification::page("", "", &Results { recordings, said, answer, ..Results::default() });
        for id in ["constants", "positions", "residuals", "budget", "currents"] {
            assert!(page.contains(&format!("<figure id=\"{id}\">")), "no figure {id}");
        }
        // Prediction errors are noise: of the sample, and of what the samples before leave unknown.
        let errors = &found.conditions[0].prediction_errors_m;
        let square = errors.iter().flatten().map(|error| error * error).sum::<f64>() / (2.0 * errors[0].len() as f64);
        assert!((1.0..2.0).contains(&(square.sqrt() / montecarlo::NOISE[0])), "{} m rms", square.sqrt());
        assert!(page.contains("m = 6.7 kg, s = 0.5 mm"));
    }
    let std = |answer: &identify::Answer| answer.found.as_ref().map_or(f64::NAN, |found| found.lambda[0].total_std);
    assert!(std(&wide) > 3.0 * std(&alone) && std(&twice) < 0.8 * std(&alone));
    // A typical bench is known to per cents only, whatever the noise.
    assert!(alone.typical().expect("estimates").iter().all(|std| (0.02..0.1).contains(std)));
    let json = wide.said().json;
    for key in ["lambdaHat", "lambdaStd", "lambdaStdTotal", "unbalance", "bench", "budget", "noise", "verdict"] {
        assert!(!json[key].is_null(), "{key}: {json}");
    }
    assert!(json["bench"]["s"]["stdTotal"].as_f64().is_some_and(|std| std < 0.02), "{json}");
}

#[test]
fn tolerances_have_units() {
    let of = |name: &str, value: &str| identify::tolerance(name, value, &stated(&EstimatorConfig::default()));
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
        ("gap", "1%", "gap is not a parameter of a bench; did you mean gap.iron?"),
        ("sensor", "1%", "sensor is not a parameter"),
        ("alpha", "1 furlong", "in rad, mrad, deg"),
        ("alpha", "-1deg", "a number above 0"),
        ("s", "150%", "less than 100 %"),
        ("m", "wide", "in %, ppm, kg, g"),
    ] {
        let why = of(name, value).expect_err("refused");
        assert!(why.contains(words), "{why}");
    }
}

/// A table `[tolerance]` of the scenario says the same as `--tolerance`, which goes before it.
#[test]
fn a_scenario_tells_tolerances() {
    let folder = folder("identify/tolerance");
    program::write(&folder, "good.csv", csv(&run(montecarlo::NOISE, 0.2).1));
    let tell = |table: &str| program::write(&folder, "mine.toml", format!("[tolerance]\n{table}"));
    // The data that the budget says are told of these parameters, unless there are none.
    let is_told = |more: &[&str], wanted: &[(&str, Option<f64>)]| {
        let json = identified(&folder, &[&["--scenario", "mine.toml", "good.csv"], more].concat());
        for (name, wanted) in wanted {
            let mut lines = json["budget"].as_array().expect("a budget").iter();
            let line = lines.find(|line| line["parameter"] == *name && line["told"] == true);
            let found = line.map(|line| number(&line["tolerance"]));
            let ratio = found.unwrap_or(f64::NAN) / wanted.unwrap_or(f64::NAN);
            assert!((found, *wanted) == (None, None) || (ratio - 1.0).abs() < 1e-9, "{name}: {found:?}, {wanted:?}");
        }
    };
    tell("s = \"10 µm\"\nalpha = \"0.5 deg\"\nsensor.offset = 5e-6\n");
    let alpha_rad = 0.5_f64.to_radians();
    is_told(&[], &[("s", Some(0.02)), ("alpha[3]", Some(alpha_rad)), ("sensor.offset[z]", Some(5e-6)), ("m", None)]);
    is_told(&["--tolerance", "s=1%"], &[("s", Some(0.01))]);
    for (table, words) in
        [("gap = \"1 %\"\n", "gap is not a parameter of a bench"), ("s = \"wide\"\n", "a number above 0 is wanted")]
    {
        tell(table);
        refuses(&folder, &["identify", "--scenario", "mine.toml", "good.csv"], &[words]);
    }
}

/// Tolerances of the on-line estimator hold here as well.
#[test]
fn tolerances_of_the_estimator_are_those_of_the_bench() {
    use magnetic_bearing::estimation::Tolerance;
    let tolerance = Tolerance { gap_m: 1e-5, position_gain: 0.01, alpha_rad: 0.02, ..Tolerance::default() };
    let config = EstimatorConfig { tolerance, ..EstimatorConfig::default() };
    let found = identify::of_estimator(&stated(&config), &estimator(&config));
    let of = |name: &str| {
        let at = likelihood::by_name(&stated(&config).parameters(), name).expect("a parameter");
        found.iter().find(|(of, _)| *of == at).map(|(_, std)| *std)
    };
    assert_eq!(found.len(), 6, "{found:?}");
    assert!(of("s").is_some_and(|std| (std - 0.02).abs() < 1e-12) && of("alpha[3]") == Some(0.02) && of("m").is_none());
    // Each of two independent gains has the variance of mean and half difference together.
    let [mean, half] = ["sensor.gain", "sensor.gainDifference"].map(|name| of(name).expect("a tolerance"));
    assert!((mean.hypot(half) - 0.01).abs() < 1e-12);
}

/// Currents in a table of their own: held ones at four times the rate, and points of a continuous current at another rate.
#[test]
fn currents_may_have_a_table_of_their_own() {
    let (_, recording) = run(montecarlo::NOISE, 0.15);
    let whole = csv(&recording);
    let with =
        |currents: String, reading: &Reading| Samples::read_apart(whole.as_bytes(), currents.as_bytes(), reading);
    let held = [1, 2, 3].map(|k| recording.get(&format!("plant.im[{k}]")).expect("a column"));
    let mut currents = String::from("Time [ms];Coil A [mA];Coil B [mA];Coil C [mA]\n");
    for n in 0..4 * (recording.time_s.len() - 1) {
        // Held before: the sample at the end of an interval and those within it are the same.
        let [a, b, c] = held.map(|column| 1e3 * column[n.div_ceil(4)]);
        currents += &format!("{:.4};{a:.9};{b:.9};{c:.9}\n", 0.025 * n as f64).replace('.', ",");
    }
    let columns = pairs(&[("im[1]", "Coil A"), ("im[2]", "Coil B"), ("im[3]", "Coil C")]);
    let apart = with(currents, &Reading { columns, ..Reading::default() }).expect("usable recordings");
    says(&apart.notes.join(" "), &["of their own"]);
    let [one, other] = [&read(&whole), &apart].map(|samples| {
        let track = track(samples, &config(samples));
        estimate(&track, track.last_valid().expect("an estimate"))[0]
    });
    for (one, other) in one.iter().zip(&other) {
        // The table begins and ends with an interval less, and has nine digits.
        assert!((one / other - 1.0).abs() < 1e-3, "{one} in one table, {other} in two");
    }

    let sine = |time_s: f64, k: usize| 1.5 + 0.5 * (100.0 * std::f64::consts::PI * time_s + k as f64).sin();
    let mut currents = String::from("time,im[1],im[2],im[3]\n");
    for n in (0..1000).filter(|n| !(400..450).contains(n)) {
        let time_s = 1e-5 + f64::from(n) / 7000.0;
        let [a, b, c] = [0, 1, 2].map(|k| sine(time_s, k));
        currents += &format!("{time_s:.9},{a:.9},{b:.9},{c:.9}\n");
    }
    let apart = with(currents, &Reading::default()).expect("usable recordings");
    for (k, values) in apart.currents(Hold::Linear).iter().enumerate() {
        for (j, value) in values.iter().enumerate().filter(|(_, value)| !value.is_nan()) {
            let time_s = apart.start_s + j as f64 * apart.step_s;
            // A chord of a seventh of a millisecond is off by at most 0.13 mA here.
            assert!((value - sine(time_s, k)).abs() < 2e-4, "{value} A at {time_s} s, wanted {}", sine(time_s, k));
        }
        // The hole of 7.1 ms, and the end after 142.9 ms.
        let missing = values.iter().filter(|value| value.is_nan()).count();
        assert!((100..160).contains(&missing), "{missing} samples without a current");
    }
    let refused = with("time,im[1]\n0,1\n".into(), &Reading::default()).expect_err("two are missing").to_string();
    says(&refused, &["im[2]"]);
}

/// A recording of a bench.
fn recorded(bench: &Bench) -> Samples {
    let recorded = bench.record();
    let mut text = "time [s],Ym [m],Zm [m],im[1] [A],im[2] [A],im[3] [A],theta [rad],omega [rad/s]\n".to_owned();
    for (row, ([y, z], [a, b, c])) in recorded.position.iter().zip(&recorded.current).enumerate() {
        let (time_s, theta, omega) = (row as f64 * bench.step, recorded.theta[row], recorded.omega[row]);
        text += &format!("{time_s},{y:e},{z:e},{a:e},{b:e},{c:e},{theta:e},{omega:e}\n");
    }
    read(&text)
}

/// A rotor of this mass between magnets with this gap.
fn disc(m_kg: f64, gap_m: f64) -> Body {
    Body::Disc { m_kg, gap_m, alpha_rad: Bench::default().alpha.to_vec() }
}

/// The question to it, with its geometry as it is.
fn question_to(bench: &Bench, samples: &Samples) -> Question {
    let mut question = question(samples, &[]);
    question.stated.parts[0].body = disc(bench.m, bench.s);
    question
}

/// A slow force is taken if the likelihood asks for it, unless it is stated that there is none (`--set force.slow=0`).
#[test]
fn a_slow_force_may_be_ruled_out() {
    let bench = Bench { seconds: 2.0, slow_force: 0.1, seed: 51, ..Bench::default() };
    let samples = recorded(&bench);
    let level = |slow_force: Option<bool>| {
        let question = Question { slow_force, ..question_to(&bench, &samples) };
        let answer = identify::answer(std::slice::from_ref(&samples), question);
        let is_told = answer.findings.iter().any(|finding| finding.contains("A slow force"));
        let level = answer.found.expect("estimates").conditions[0].parts[0].slow_force_n;
        assert_eq!(is_told, level > 0.0, "{:?}", answer.findings);
        level
    };
    assert!(level(None) > 0.0 && level(Some(true)) > 0.0);
    assert_eq!(level(Some(false)), 0.0);
}

/// A parameter that would move λ may be a consequence of another one, which the residuals ask for more.
#[test]
fn the_verdict_begins_with_what_the_residuals_ask_for_most() {
    let bench = Bench { seconds: 1.0, runout2: [2e-7, 0.0, 0.0, 0.0], seed: 61, ..Bench::default() };
    let samples = recorded(&bench);
    let answer = identify::answer(std::slice::from_ref(&samples), question_to(&bench, &samples));
    let wanted = "Not valid: the residuals ask most for runout2.y.cos, then for ";
    assert!(answer.verdict.starts_with(wanted), "{}", answer.verdict);
}

/// The parameter that the residuals ask for most may move λ by far more than a step from the stated value shows: here by 7.5 deviations.
#[test]
fn the_parameter_that_the_residuals_ask_for_most_is_tried() {
    let lambda = [2.35e-6, 1.65e-6, 2.07e-6];
    let bench = Bench {
        seconds: 0.6,
        lag: 2e-5,
        position_noise: 1e-6,
        current_noise: 0.0,
        seed: 81,
        lambda,
        ..Bench::default()
    };
    let samples = recorded(&bench);
    let mut question = question_to(&bench, &samples);
    question.stated.hold = Hold::HeldAfter;
    is_refused(
        &identify::answer(std::slice::from_ref(&samples), question),
        "ask most for delay (positions later than currents), and with it λ2 differs by",
    );
}

/// Amplifiers with a lag behind what is recorded, half a sample time and one and a half: the answer says how long it is, whether commands are recorded when they take effect
/// or a sample time later; whatever a sample is taken for, no wrong answer is valid.
#[test]
fn a_lag_of_the_amplifiers_is_found() {
    for (seed, lag, late) in [(72, 4e-5, true), (74, 1.5e-4, false)] {
        let bench = Bench { seconds: 0.4, lag, current_noise: 0.0, seed, ..Bench::default() };
        let mut samples = recorded(&bench);
        if !late {
            samples.current_a.iter_mut().for_each(|current| current.rotate_left(1));
        }
        let mut question = question_to(&bench, &samples);
        let holds = Holds::of(&samples, &question.stated);
        question.holds = Some(holds);
        for hold in Hold::all().filter(|_| lag < 1e-4) {
            question.stated.hold = hold;
            let answer = identify::answer(std::slice::from_ref(&samples), question.clone());
            if answer.valid {
                is_right(hold.name(), &answer);
            }
        }
        let stated = question.stated.read_as(holds.most_likely());
        let question = Question { stated, ..question };
        let answer = identify::answer(std::slice::from_ref(&samples), question);
        let found = is_right("the most likely reading", &answer);
        let estimate = found.bench.iter().find(|bench| bench.parameter.name == "lag").map(|bench| bench.estimate);
        let off = estimate.map(|estimate| (estimate.value - lag) / estimate.total_std);
        assert!(off.is_some_and(|off| off.abs() < 4.0), "lag {lag}: {estimate:?} {off:?}");
        assert!(answer.findings.iter().any(|finding| finding.contains("with a lag of")), "{:?}", answer.findings);
    }
}
