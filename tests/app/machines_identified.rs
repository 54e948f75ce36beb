//! `identify` for the machines planar4, spindle and spindle4, whose answer is that of their on-line estimator.

use std::fs;
use std::path::Path;

use fmu_export::variable::Value;
use magnetic_bearing::machine::{Machine, PLANAR4, SPINDLE, SPINDLE4};
use magnetic_bearing::simulation::scenario::Scenario;
use magnetic_bearing::simulation::simulate;
use serde_json::Value as Json;

use crate::program::{folder, run};
use crate::support::{below, says};

/// Errors above this many of their own standard deviations contradict them.
const MOST_STD: f64 = 5.0;

/// Simulates the built-in scenario of a machine and writes its recording as `simulate` does, with changes to the text.
fn record(folder: &Path, machine: &Machine, change: impl Fn(String) -> String) -> Scenario {
    let mut scenario = Scenario::open(Path::new(machine.name)).expect("a scenario that comes with the program");
    scenario.set("plant", "sensor.seed", Value::Integer(2718));
    let run = simulate::run(&scenario).expect("a good scenario");
    assert_eq!(run.error, None);
    let mut bytes = Vec::new();
    run.recording.write_csv(&mut bytes).expect("a vector takes everything");
    fs::write(folder.join("run.csv"), change(String::from_utf8(bytes).expect("text"))).expect("a file");
    scenario
}

/// Identifies with these arguments; the result as JSON.
fn identified(folder: &Path, arguments: &[&str]) -> Json {
    let (code, out, errors) = run(folder, &[&["identify", "run.csv"], arguments, &["--json", "-"]].concat());
    assert_eq!(code, 0, "{errors}");
    serde_json::from_str(&out).unwrap_or_else(|why| panic!("{why}: {out}"))
}

/// The answer is valid, and all force constants, loads and unbalances are those of the plant.
fn agrees(document: &Json, scenario: &Scenario) {
    let machine = scenario.machine;
    assert_eq!(document["valid"], true, "{}", document["verdict"]);
    let truth = |name: &str| scenario.value("plant", name).unwrap_or_else(|| panic!("{name}")).as_f64();
    for (k, name) in machine.of_magnets("lambda").iter().enumerate() {
        assert_eq!(document["magnets"][k], **name);
        let [hat, std] = ["lambdaHat", "lambdaStdTotal"].map(|of| document[of][k].as_f64().expect("a number"));
        below(&format!("{} {name}, deviations", machine.name), (hat - truth(name)).abs() / std, MOST_STD);
        below(&format!("{} {name} ±", machine.name), std / hat, 0.05);
    }
    let near = |name: &str, hat: &str, limit: f64| {
        let off = document[hat].as_f64().unwrap_or(f64::NAN) - truth(name);
        below(&format!("{} {name}", machine.name), off.abs(), limit);
    };
    let loads = machine.of_coordinates(|coordinate| coordinate.load);
    for (n, (name, hat)) in loads.iter().zip(machine.of_loads("p", "Hat")).enumerate() {
        near(name, &hat, machine.either(n, 0.5, 0.05));
    }
    for name in machine.of_planes("magnitude") {
        near(&name, &name, 5e-6);
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
        says(document["told"].as_str().expect("a text"), &["m = ", "mm", "currents heldBefore"]);
        let estimates = fs::read_to_string(folder.join("estimates.csv")).expect("a table");
        for name in machine.of_magnets("lambdaHat") {
            says(&estimates, &[&format!("predictionError.{name} [N.m2/A2]")]);
        }
        let page = fs::read_to_string(folder.join("page/index.html")).expect("a page");
        says(&page, &["verdict good", "Force constants over time", "Taken as known"]);
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
    says(document["told"].as_str().expect("a text"), &["tolerance.m = 0.05 kg", "tolerance.s = 0.005 mm"]);
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
    says(document["told"].as_str().expect("a text"), &["currents heldAfter"]);
}

/// Everything that is wrong is said at once and by name.
#[test]
fn wrong_columns_and_options_are_named() {
    let folder = folder("machines-identified/refused");
    let change = |text: String| text.replace("plant.B.im[2]", "none").replace("plant.A.Ym [m]", "plant.A.Ym [furlong]");
    record(&folder, &SPINDLE, change);
    let refused = |arguments: &[&str], words: &[&str]| {
        let (code, _, errors) = run(&folder, &[&["identify", "run.csv"], arguments].concat());
        assert_eq!(code, 2, "{arguments:?}: {errors}");
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
    let (code, out, errors) = run(&folder, &["identify", "run.csv"]);
    assert_eq!(code, 3, "{errors}");
    says(&out, &["There are also columns of the machine planar4: --machine planar4?"]);

    record(&folder, &SPINDLE, |text| text);
    let slow = ["--set", "force.slow=0"];
    refused(&[&spindle[..], &slow].concat(), &["--set force.slow=0: only planar and axial have it"]);
    refused(&["--set", "force.slow=1"], &["--set force.slow=1: 0 is wanted, or --estimate force.slow"]);
    refused(&[&slow[..], &["--estimate", "force.slow"]].concat(), &["force.slow is both set and estimated"]);
    let options = ["--window", "1", "--estimate", "s", "--method", "paper"];
    let words = ["spindle has no --window", "no --estimate", "no --method but"];
    refused(&[&spindle[..], &options].concat(), &words);
    refused(&[&spindle[..], &["--hold", "none"]].concat(), &["--hold none: expected one of heldBefore"]);
    refused(&[&spindle[..], &["--set", "s=1mm"]].concat(), &["--set s: the estimator of the machine"]);
    refused(&[&spindle[..], &["--set", "A.s=-1mm", "--set", "Jp=-1"]].concat(), &["A.s = -0.001 m", "Jp = -1 kg.m2"]);
    refused(
        &[&spindle[..], &["--tolerance", "s=2%", "--tolerance", "foo=1"]].concat(),
        &["tolerance.s = 2% is refused", "tolerance.foo: there is no variable"],
    );
    refused(&["--machine", "planar4", "--scenario", "spindle"], &["spindle describes the machine spindle"]);

    record(&folder, &SPINDLE, |text| text.replace("plant.theta", "none").replace("plant.omegam", "nothing"));
    refused(&spindle, &["neither angle nor speed", "--speed RPM"]);
    let document = identified(&folder, &["--machine", "spindle", "--speed", "3000"]);
    assert_eq!(document["valid"], true, "{}", document["verdict"]);
}

/// A recording that does not tell gets no answer: the exit code, the words, and no twin.
#[test]
fn too_short_a_recording_is_not_valid() {
    let folder = folder("machines-identified/short");
    record(&folder, &SPINDLE4, |text| text.lines().take(150).map(|line| line.to_owned() + "\n").collect());
    let arguments = ["identify", "run.csv", "--machine", "spindle4", "--json", "-", "--save", "twin.toml"];
    let (code, out, errors) = run(&folder, &arguments);
    assert_eq!(code, 3, "{errors}");
    says(&errors, &["Not valid: too few samples so far", "The twin was not written"]);
    let document: Json = serde_json::from_str(&out).expect("JSON");
    assert_eq!((&document["valid"], &document["lambdaHat"]), (&Json::Bool(false), &Json::Null));
    assert!(!folder.join("twin.toml").exists());
}
