//! `identify` for the machines planar4, spindle and spindle4.

use std::fs;
use std::path::Path;

use fmu_export::variable::Value;
use magnetic_bearing::machine::{Machine, PLANAR4, SPINDLE, SPINDLE4};
use magnetic_bearing::simulation::scenario::Scenario;
use magnetic_bearing::simulation::simulate;
use serde_json::Value as Json;

use crate::program::{self, ends, estimate, folder, number};
use crate::support::{below, says};

/// Errors above this many of their own standard deviations contradict them.
const MOST_STD: f64 = 5.0;

/// Simulates the built-in scenario of a machine and writes its recording as `simulate` does, with changes to the text.
fn record(folder: &Path, machine: &Machine, change: impl Fn(String) -> String) -> Scenario {
    record_with(folder, machine, &[], change)
}

/// The same with other values of the plant.
fn record_with(
    folder: &Path,
    machine: &Machine,
    values: &[(&str, f64)],
    change: impl Fn(String) -> String,
) -> Scenario {
    let mut scenario = Scenario::open(Path::new(machine.name)).expect("a scenario that comes with the program");
    values.iter().for_each(|(name, value)| scenario.set("plant", name, Value::Real(*value)));
    scenario.set("plant", "sensor.seed", Value::Integer(2718));
    let run = simulate::run(&scenario).expect("a good scenario");
    assert_eq!(run.error, None);
    let mut bytes = Vec::new();
    run.recording.write_csv(&mut bytes).expect("a vector takes everything");
    fs::write(folder.join("run.csv"), change(String::from_utf8(bytes).expect("text"))).expect("a file");
    scenario
}

/// Identifies the recording of the folder.
#[track_caller]
fn identified(folder: &Path, arguments: &[&str]) -> Json {
    program::identified(folder, &[&["run.csv"], arguments].concat())
}

/// The estimate is right.
#[track_caller]
fn is_right(what: &str, of: &Json, truth: f64) {
    let [value, std] = estimate(of);
    below(&format!("{what}, deviations"), (value - truth).abs() / std, MOST_STD);
}

/// The answer is valid, and all force constants, loads and unbalances are those of the plant.
fn agrees(document: &Json, scenario: &Scenario) {
    let machine = scenario.machine;
    assert_eq!(document["valid"], true, "{}", document["verdict"]);
    let truth = |name: &str| scenario.value("plant", name).unwrap_or_else(|| panic!("{name}")).as_f64();
    for (k, name) in machine.of_magnets("lambda").iter().enumerate() {
        assert_eq!(document["magnets"][k], **name);
        let [hat, std] = ["lambdaHat", "lambdaStdTotal"].map(|of| number(&document[of][k]));
        below(&format!("{} {name}, deviations", machine.name), (hat - truth(name)).abs() / std, MOST_STD);
        below(&format!("{} {name} ±", machine.name), std / hat, 0.05);
    }
    for name in machine.of_coordinates(|coordinate| coordinate.load) {
        is_right(&format!("{} {name}", machine.name), &document["recordings"][0][&name], truth(&name));
    }
    let planes = match &document["unbalance"] {
        Json::Array(planes) => planes.clone(),
        one => vec![one.clone()],
    };
    assert_eq!(planes.len(), machine.planes);
    for (name, plane) in machine.of_planes("magnitude").iter().zip(&planes) {
        let [magnitude, std] = ["magnitude", "magnitudeStdTotal"].map(|of| number(&plane[of]));
        below(&format!("{} {name}, deviations", machine.name), (magnitude - truth(name)).abs() / std, MOST_STD);
    }
}

/// A recording that `simulate` wrote is read without further options; a scenario with the machine does as well.
#[test]
fn every_machine_is_identified_from_its_recording() {
    for machine in [PLANAR4, SPINDLE, SPINDLE4] {
        let folder = folder(&format!("machines-identified/{}", machine.name));
        let scenario = record(&folder, &machine, |text| text);
        let arguments = ["--machine", machine.name, "--csv", "estimates.csv", "--report", "page"];
        let document = identified(&folder, &arguments);
        agrees(&document, &scenario);
        assert_eq!(document["told"]["hold"], "heldBefore");
        assert!(document["told"][&machine.of_bearings("s")[0]].as_f64().is_some_and(|gap_m| gap_m > 0.0));
        let estimates = fs::read_to_string(folder.join("estimates.csv")).expect("a table");
        for name in machine.of_magnets("lambdaHat") {
            says(&estimates, &[&format!("predictionError.{name} [N.m2/A2]")]);
        }
        let page = fs::read_to_string(folder.join("page/index.html")).expect("a page");
        says(&page, &["verdict good", "Force constants", "Budget", "Taken as known"]);
        let with_scenario = identified(&folder, &["--scenario", machine.name]);
        assert_eq!(document["lambdaHat"], with_scenario["lambdaHat"]);
    }
}

/// Names, units, gaps and commanded currents of a bench.
#[test]
fn a_spindle_is_recorded_with_all_imperfections() {
    let folder = folder("machines-identified/bench");
    let change = |text: String| {
        let (head, rows) = text.split_once('\n').expect("a header");
        let head = head.replace("plant.B.Zm [m]", "Weg").replace("controller.B.Zm", "none");
        let kept = rows.lines().enumerate().filter(|(row, _)| row % 37 != 5 && !(2000..2100).contains(row));
        let rows: Vec<&str> = kept.map(|(_, row)| row).collect();
        format!("{head}\n{}\n", rows.join("\n"))
    };
    let scenario = record(&folder, &SPINDLE, change);
    let bench = "machine = \"spindle\"\n[estimator]\n\"unbalance[1].position\" = -0.08\n\"unbalance[2].position\" = 0.1\n[columns]\n\
                 \"B.Zm\" = \"Weg\"\n[tolerance]\nm = \"50 g\"\n";
    fs::write(folder.join("bench.toml"), bench).expect("a file");
    let document = identified(&folder, &["--scenario", "bench.toml", "--unit", "B.Zm=m", "--tolerance", "s=5um"]);
    agrees(&document, &scenario);
    for (name, part) in [("m", 0.05 / 12.0), ("X.m", 0.05 / 12.0), ("A.s", 0.01), ("B.s", 0.01), ("X.s", 5.0 / 600.0)] {
        let [_, std] = estimate(&document["bench"][name]);
        assert!(std > 0.0 && std < 1.001 * part, "{name}: {std}, stated {part}");
    }
    says(&document["notes"].to_string(), &["gaps"]);

    let change = |text: String| {
        let text = text.replacen("plant.A.im[", "measured.A.[", 3);
        text.replacen("plant.B.im[", "measured.B.[", 3).replacen("plant.X.im[", "measured.X.[", 2)
    };
    let scenario = record(&folder, &SPINDLE, change);
    let columns = SPINDLE.of_magnets("im").into_iter().zip(SPINDLE.of_magnets("i"));
    let columns: Vec<String> = columns.map(|(im, i)| format!("{im}=controller.{i}")).collect();
    let mut arguments = vec!["--machine", "spindle"];
    columns.iter().for_each(|column| arguments.extend(["--column", column]));
    let document = identified(&folder, &arguments);
    agrees(&document, &scenario);
    assert_eq!(document["told"]["hold"], "heldAfter");
}

/// A shaft whose bench is off everywhere: the tolerances that are stated tell in all directions what is off, and by how much.
#[test]
fn what_is_off_on_the_bench_of_a_shaft_is_found() {
    let folder = folder("machines-identified/off");
    let off = [
        ("A.s", 5.0e-4 * 1.008, "A.s", 0.008),
        ("X.s", 6.0e-4 * 0.993, "X.s", -0.007),
        ("A.alpha[2]", -std::f64::consts::FRAC_PI_3 + 0.006, "A.alpha[2]", 0.006),
        ("B.position", 0.15 + 4e-4, "B.position", 4e-4),
        ("A.sensorPosition", -0.10 - 5e-4, "A.sensorPosition", -5e-4),
        ("Jt", 0.16 * 1.009, "Jt", 0.009),
        ("Jp", 0.02 * 0.99, "Jp", -0.01),
        ("A.sensor.offsetY", 6e-6, "A.sensor.offset[y]", 6e-6),
        ("B.sensor.offsetZ", -5e-6, "B.sensor.offset[z]", -5e-6),
        ("X.sensor.offset", 4e-6, "X.sensor.offset", 4e-6),
        ("B.sensor.gainErrorY", 0.005, "B.sensor.gainDifference", 0.0025),
        ("X.sensor.gainError", -0.004, "X.sensor.gain", -0.004),
        ("A.sensor.currentOffset[3]", 0.006, "A.current.offset[3]", 0.006),
        ("X.sensor.currentOffset[1]", -0.005, "X.current.offset[1]", -0.005),
    ];
    let values: Vec<(&str, f64)> = off.iter().map(|(name, value, ..)| (*name, *value)).collect();
    let scenario = record_with(&folder, &SPINDLE, &values, |text| text);
    let tolerances = "s=1% alpha=0.5deg position=0.5mm sensorPosition=0.5mm Jt=1% Jp=1% sensor.offset=5um sensor.gain=0.5% \
                      sensor.gainDifference=0.5% current.offset=5mA runout1=1um force.backward=1N delay=20us";
    let arguments = tolerances.split_whitespace().flat_map(|tolerance| ["--tolerance", tolerance]);
    let arguments: Vec<&str> = ["--machine", "spindle"].into_iter().chain(arguments).collect();
    let document = identified(&folder, &arguments);
    agrees(&document, &scenario);
    for (_, _, name, truth) in off {
        is_right(name, &document["bench"][name], truth);
    }
    // These the motion tells: they are known better than they were stated.
    for (name, stated) in [("A.sensor.offset[y]", 5e-6), ("X.sensor.offset", 5e-6), ("Jt", 0.01)] {
        below(name, estimate(&document["bench"][name])[1], stated);
    }
}

/// Magnets that are exchanged are looked for at each bearing of a shaft.
#[test]
fn exchanged_magnets_of_a_shaft_are_named() {
    let folder = folder("machines-identified/exchanged");
    record(&folder, &SPINDLE, |text| text.lines().take(800).map(|line| line.to_owned() + "\n").collect());
    let exchanged = ["--column", "B.im[1]=plant.B.im[2]", "--column", "B.im[2]=plant.B.im[1]"];
    let (out, _) = ends(3, &folder, &[&["identify", "run.csv", "--machine", "spindle"], &exchanged[..]].concat());
    says(&out.replace('\n', " "), &["magnets 1 and 2 are exchanged at B: exchange the currents"]);
}

/// Recordings of a shaft at two speeds share its bearings and have loads of their own.
#[test]
fn two_speeds_of_a_shaft_are_identified_together() {
    let folder = folder("machines-identified/speeds");
    let slow = [("omega", 200.0), ("pY", 20.0), ("MZ", 0.5)];
    let scenario = record_with(&folder, &SPINDLE4, &slow, |text| text);
    fs::rename(folder.join("run.csv"), folder.join("slow.csv")).expect("a file");
    let fast = record(&folder, &SPINDLE4, |text| text);
    let document = identified(&folder, &["slow.csv", "--machine", "spindle4", "--estimate", "force.slow"]);
    agrees(&document, &fast);
    let recordings = document["recordings"].as_array().expect("recordings");
    for (recording, scenario) in recordings.iter().zip([&fast, &scenario]) {
        for name in ["pX", "pY", "pZ", "MY", "MZ"] {
            is_right(name, &recording[name], scenario.value("plant", name).expect("a load").as_f64());
        }
    }
}

/// Everything that is wrong is said at once and by name.
#[test]
fn wrong_columns_and_options_are_named() {
    let folder = folder("machines-identified/refused");
    let change = |text: String| text.replace("plant.B.im[2]", "none").replace("plant.A.Ym [m]", "plant.A.Ym [furlong]");
    record(&folder, &SPINDLE, change);
    let refused = |arguments: &[&str], words: &[&str]| {
        let (_, errors) = ends(2, &folder, &[&["identify", "run.csv"], arguments].concat());
        says(&errors, words);
    };
    let spindle = ["--machine", "spindle"];
    refused(
        &spindle,
        &["A.Ym (column plant.A.Ym): the unit furlong is none of m, mm", "B.im[2]: no column of this name"],
    );
    refused(&[&spindle[..], &["--column", "Ym=plant.A.Ym"]].concat(), &["--column Ym: Ym is no signal", "A.Ym, A.Zm"]);

    record(&folder, &SPINDLE, |text| text);
    for machine in ["planar", "planar4", "spindle4", "axial"] {
        let mass = ["--set", "m=1"];
        refused(&[&["--machine", machine], &mass[..]].concat(), &["columns of the machine spindle: --machine spindle"]);
    }
    // All columns of the planar rotor are there as well.
    record(&folder, &PLANAR4, |text| text);
    let (out, _) = ends(3, &folder, &["identify", "run.csv"]);
    says(&out, &["There are also columns of the machine planar4: --machine planar4?"]);

    record(&folder, &SPINDLE, |text| text);
    let slow = ["--set", "force.slow=0"];
    refused(&["--set", "force.slow=1"], &["--set force.slow=1: 0 is wanted, or --estimate force.slow"]);
    refused(&[&slow[..], &["--estimate", "force.slow"]].concat(), &["force.slow is both set and estimated"]);
    let options = ["--window", "1", "--method", "paper"];
    let words = ["spindle has no --window", "no --method but likelihood and predictionError"];
    refused(&[&spindle[..], &options].concat(), &words);
    refused(&[&spindle[..], &["--hold", "none"]].concat(), &["--hold none: expected one of heldBefore"]);
    refused(&[&spindle[..], &["--set", "s=1mm"]].concat(), &["--set s: the estimator of the machine"]);
    refused(&[&spindle[..], &["--set", "A.s=-1mm", "--set", "Jp=-1"]].concat(), &["A.s = -0.001 m", "Jp = -1 kg.m2"]);
    refused(
        &[&spindle[..], &["--tolerance", "s=2%", "--tolerance", "foo=1"]].concat(),
        &["foo is no parameter of a bench; there are m, A.s, B.s"],
    );
    refused(&["--machine", "planar4", "--scenario", "spindle"], &["spindle describes the machine spindle"]);

    record(&folder, &SPINDLE, |text| text.replace("plant.theta", "none").replace("plant.omegam", "nothing"));
    let (_, errors) = ends(3, &folder, &["identify", "run.csv", "--machine", "spindle"]);
    says(&errors, &["neither angle nor speed was recorded: --speed RPM is wanted"]);
    let document = identified(&folder, &["--machine", "spindle", "--speed", "3000"]);
    assert_eq!(document["valid"], true, "{}", document["verdict"]);
}

/// A recording that does not tell gets no answer: the exit code, the words, and no twin.
#[test]
fn too_short_a_recording_is_not_valid() {
    let folder = folder("machines-identified/short");
    record(&folder, &SPINDLE4, |text| text.lines().take(150).map(|line| line.to_owned() + "\n").collect());
    let arguments = ["identify", "run.csv", "--machine", "spindle4", "--json", "-", "--save", "twin.toml"];
    let (out, errors) = ends(3, &folder, &arguments);
    says(&errors, &["Not valid: the recording is too short", "The twin was not written"]);
    let document: Json = serde_json::from_str(&out).expect("JSON");
    assert_eq!((&document["valid"], &document["lambdaHat"]), (&Json::Bool(false), &Json::Null));
    assert!(!folder.join("twin.toml").exists());
}

/// Rotors that are heavier than stated under loads that are known: κ in words, JSON, budget and twin. Without a load that is known it is refused.
#[test]
fn a_known_load_tells_the_dynamics() {
    let kappa = 1.08;
    for machine in [PLANAR4, SPINDLE] {
        let folder = folder(&format!("machines-identified/dynamics-{}", machine.name));
        let stated = Scenario::open(Path::new(machine.name)).expect("a scenario that comes with the program");
        let of = |name: &str| stated.value("plant", name).map(Value::as_f64);
        let inertia = ["m", "Jt", "Jp"].into_iter().filter_map(|name| Some((name, kappa * of(name)?)));
        let scenario = record_with(&folder, &machine, &inertia.collect::<Vec<_>>(), |text| text);
        let loads: Vec<String> =
            ["pY", "pZ"].map(|name| format!("{name}={}", of(name).expect("a load"))).into_iter().collect();
        let asked = ["--machine", machine.name, "--estimate", "dynamics"];
        let (_, error) = ends(2, &folder, &[&["identify", "run.csv"], &asked[..]].concat());
        says(&error, &["dynamics: ", "known load", "--set pY=… or --set pZ=…"]);

        let known = ["--set", &loads[0], "--set", &loads[1], "--estimate", "noise.exponent", "--save", "twin.toml"];
        let document = identified(&folder, &[&asked[..], &known].concat());
        let found = &document["bench"]["dynamics"];
        let [value, std] = estimate(found);
        is_right("κ", found, kappa - 1.0);
        below("κ ±", std, 0.01);
        says(
            &document["findings"].to_string(),
            &["% weaker than the law (κ = 1.0", "use ki/κ and ks/κ", "to the power of"],
        );
        assert!(
            document["budget"].as_array().is_some_and(|lines| lines.iter().any(|of| of["parameter"] == "dynamics"))
        );
        assert_eq!(number(&document["told"]["pY"]), number(&document["recordings"][0]["pY"]["value"]));
        let magnets = machine.of_magnets("lambda").into_iter().enumerate().filter(|(_, name)| !name.starts_with("X."));
        for (k, name) in magnets {
            let [hat, std] = ["lambdaHat", "lambdaStdTotal"].map(|of| number(&document[of][k]));
            let truth = scenario.value("plant", &name).expect("a force constant").as_f64();
            below(&format!("{} {name}, deviations", machine.name), (hat - truth).abs() / std, MOST_STD);
        }
        let noise = if machine.is_planar() { &document["noise"] } else { &document["noise"][0] };
        is_right("power of the gap", &noise["exponent"], 0.0);
        let twin = Scenario::open(&folder.join("twin.toml")).unwrap_or_else(|why| panic!("{why}"));
        let twin = twin.value("plant", "m").expect("a mass").as_f64();
        below("mass of the twin", (twin / (of("m").expect("a mass") * (1.0 + value)) - 1.0).abs(), 1e-9);
    }
}

/// ± of κ is honest: recordings of rotors that are 0.92 to 1.14 times as heavy as stated, whose loads are known.
#[test]
fn the_deviation_of_the_dynamics_is_honest() {
    let folder = folder("machines-identified/honest");
    let mut square = 0.0;
    for run in 0..12 {
        let kappa = 0.92 + 0.02 * f64::from(run);
        let mut scenario = Scenario::open(Path::new(PLANAR4.name)).expect("a scenario that comes with the program");
        let of = |name: &str| scenario.value("plant", name).expect("a value").as_f64();
        let (m_kg, loads) = (kappa * of("m"), ["pY", "pZ"].map(|name| format!("{name}={}", of(name))));
        scenario.set("plant", "m", Value::Real(m_kg));
        scenario.set("plant", "sensor.seed", Value::Integer(86_001 + run));
        let run = simulate::run(&scenario).expect("a good scenario");
        let mut bytes = Vec::new();
        run.recording.write_csv(&mut bytes).expect("a vector takes everything");
        fs::write(folder.join("run.csv"), bytes).expect("a file");
        let asked = ["--machine", "planar4", "--estimate", "dynamics", "--hold", "heldBefore"];
        let document = identified(&folder, &[&asked[..], &["--set", &loads[0], "--set", &loads[1]]].concat());
        let [value, std] = estimate(&document["bench"]["dynamics"]);
        below("κ ±", std, 0.003);
        square += ((1.0 + value - kappa) / std).powi(2) / 12.0;
    }
    assert!((0.7..1.3).contains(&square.sqrt()), "error/± {}", square.sqrt());
}
