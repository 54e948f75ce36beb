//! The twin of a bench: `identify --save`, `--ssv`, `--ssp`.

use crate::prelude::*;
use std::io::{Cursor, Write};

use crate::package::{members, parameters};

/// The values of the twin, which must be the same in all three files.
fn same_in_all(folder: &Path) -> BTreeMap<String, f64> {
    let alone = parameters(&read(folder, "twin.ssv"));
    let archive = members(&fs::read(folder.join("twin.ssp")).expect("an archive"));
    let mut inside = BTreeMap::new();
    for element in ["plant", "controller", "estimator"] {
        let set = String::from_utf8_lossy(&archive[&format!("resources/identified-{element}.ssv")]);
        assert_contains(&set, &["name=\"identified\"", "generationTool=\"magnetic-bearing "]);
        inside.extend(parameters(&set).into_iter().map(|(name, value)| (format!("{element}.{name}"), value)));
    }
    assert_eq!(alone, inside);
    let scenario = Scenario::open(&folder.join("twin.toml")).unwrap_or_else(|why| panic!("{why}"));
    assert_contains(&scenario.title, &["Identified from ", ".csv"]);
    let mut stated = 0;
    for element in scenario.in_loop() {
        for (index, value) in element.values() {
            let name = format!("{}.{}", element.name, element.model_type.variables()[index].name);
            stated += usize::from(alone.contains_key(&name));
            // Enumerations at their start values are omitted.
            assert!(alone.get(&name).is_none_or(|alone| *alone == value.as_f64()), "{name}");
        }
    }
    assert_eq!(stated, alone.len());
    for model in scenario.machine.models {
        assert!(archive.contains_key(&format!("resources/{}.fmu", model.0)), "{}", model.0);
    }
    alone
}

/// The values agree up to the last digits, which are lost in reading JSON.
fn same(name: &str, value: f64, wanted: f64) {
    below(name, (value / wanted - 1.0).abs(), 1e-14);
}

const FILES: [&str; 6] = ["--save", "twin.toml", "--ssv", "twin.ssv", "--ssp", "twin.ssp"];

/// Identifies and writes a twin; the result as JSON.
fn twin_of(folder: &Path, arguments: &[&str]) -> Json {
    identified(folder, &[arguments, &FILES].concat())
}

/// The twin runs, and its recording, identified with these arguments, gives the same λ within this many deviations.
fn reproduces_lambda(folder: &Path, found: &Json, arguments: &[&str], deviations: f64) {
    exits(0, folder, &["simulate", "twin.toml", "--csv", "again.csv"]);
    let again = identified(folder, &[&["again.csv", "--scenario", "twin.toml"], arguments].concat());
    for k in 0..found["lambdaHat"].as_array().expect("force constants").len() {
        let [before, after, std] =
            [&found["lambdaHat"], &again["lambdaHat"], &again["lambdaStdTotal"]].map(|of| number(&of[k]));
        below("λ again, deviations", (after - before).abs() / std, deviations);
    }
}

#[test]
fn machines_of_four_magnets_have_a_twin() {
    for (machine, mass, m_kg) in [("planar4", "m=6.8", 6.8), ("spindle4", "estimator.m=12", 12.0)] {
        let folder = folder(&format!("twin/{machine}"));
        exits(0, &folder, &["simulate", machine, "--csv", "run.csv"]);
        let found = twin_of(&folder, &["run.csv", "--machine", machine, "--set", mass]);
        let values = same_in_all(&folder);
        for (k, name) in found["magnets"].as_array().expect("names").iter().enumerate() {
            let (name, lambda) = (name.as_str().expect("a name"), number(&found["lambdaHat"][k]));
            same(name, values[&format!("plant.{name}")], lambda);
            for element in ["controller", "estimator"] {
                same(name, values[&format!("{element}.{}", name.replace("lambda", "lambda0"))], lambda);
            }
        }
        let (plane, unbalance, noise) = match machine {
            "planar4" => ("unbalance", &found["unbalance"], &found["noise"]),
            _ => ("unbalance[2]", &found["unbalance"][1], &found["noise"][0]),
        };
        for (name, wanted) in [
            ("plant.pY".to_owned(), &found["recordings"][0]["pY"]["value"]),
            (format!("plant.{plane}.magnitude"), &unbalance["magnitude"]),
            (format!("plant.{plane}.phase"), &unbalance["phase"]),
            ("plant.sensor.positionNoise".to_owned(), &noise["position"]),
        ] {
            same(&name, values[&name], number(wanted));
        }
        assert_eq!(["plant.m", "controller.m", "estimator.m"].map(|name| values[name]), [m_kg; 3]);
        reproduces_lambda(&folder, &found, &[], 5.0);
    }
}

/// A bench with a sensor offset, at a different speed and sample time.
#[test]
fn a_planar_bench_has_a_twin() {
    let folder = folder("twin/planar");
    let bench = "title = \"Bench\"\nduration = \"0.4 s\"\nstep = \"80 µs\"\n[all]\nsensor.Ts = 80e-6\nTs = 80e-6\n[plant]\n\
                 sensor.positionNoise = 1e-7\nsensor.currentNoise = 0.01\nsensor.offsetY = 8e-6\nomega = 280.0\npY = 10.0\npZ = -20.0\n\
                 unbalance.magnitude = 2e-4\n[controller]\nreference.omega = 280.0\n[columns]\nYm = {name = \"Weg y\", unit = \"1m\", zero = 0}\n[tolerance]\n\
                 sensor.offset = \"5 µm\"\nalpha = \"0.2 deg\"\n";
    write(&folder, "bench.toml", bench);
    exits(0, &folder, &["simulate", "bench.toml", "--csv", "run.csv"]);
    let table = read(&folder, "run.csv");
    write(&folder, "run.csv", table.replace("plant.Ym", "Weg y").replace("controller.Ym", "none"));

    let arguments = ["run.csv", "--scenario", "bench.toml"];
    let found = twin_of(&folder, &arguments);
    let values = same_in_all(&folder);
    for k in 0..3 {
        let lambda = number(&found["lambdaHat"][k]);
        for name in ["plant.lambda", "controller.lambda0", "estimator.lambda0"] {
            same(name, values[&format!("{name}[{}]", k + 1)], lambda);
        }
    }
    for (name, wanted) in [
        ("plant.pY", &found["recordings"][0]["pY"]["value"]),
        ("plant.unbalance.magnitude", &found["unbalance"]["magnitude"]),
        ("plant.sensor.positionNoise", &found["noise"]["position"]),
        ("estimator.sensor.currentNoise", &found["noise"]["current"]),
        ("plant.sensor.offsetY", &found["bench"]["sensor.offset[y]"]["value"]),
    ] {
        same(name, values[name], number(wanted));
    }
    let alpha = number(&found["stated"]["alpha"][1]) + number(&found["bench"]["alpha[2]"]["value"]);
    same("alpha[2]", values["controller.alpha[2]"], alpha);
    // The estimator has no offset parameter: its tolerance covers the offset of the sensor and the uncertainty of that.
    let offsets = ["sensor.offset[y]", "sensor.offset[z]"].map(|name| {
        let [value, std] = estimate(&found["bench"][name]);
        value.powi(2) + std.powi(2)
    });
    let tolerance = (offsets.iter().sum::<f64>() / 2.0).sqrt();
    same("tolerance", values["estimator.tolerance.positionOffset"], tolerance);
    let steps = ["plant.sensor.Ts", "controller.Ts", "estimator.Ts"].map(|name| values[name]);
    assert_eq!(steps, [8e-5; 3]);
    below("speed", (values["plant.omega"] - 280.0).abs(), 1e-3);

    reproduces_lambda(&folder, &found, &["--column", "Ym=plant.Ym"], 4.0);
    // The twin may be overwritten.
    twin_of(&folder, &arguments);
}

/// Foreign files are not overwritten, which is reported before any input is read.
#[test]
fn foreign_files_are_not_overwritten() {
    let folder = folder("twin/foreign");
    let ours = "<?xml version=\"1.0\"?>\n<ssv:ParameterSet generationTool=\"magnetic-bearing 0.0.1\"/>\n";
    let theirs = ours.replace("magnetic-bearing", "Another tool for magnetic-bearing");
    let archive = |ssd: &str| {
        let mut writer = zip::ZipWriter::new(Cursor::new(Vec::new()));
        writer.start_file("SystemStructure.ssd", zip::write::SimpleFileOptions::default()).expect("a member");
        writer.write_all(ssd.as_bytes()).expect("memory");
        writer.finish().expect("an archive").into_inner()
    };
    let content = |name: &str| fs::read(folder.join(name)).unwrap_or_default();
    for (name, content) in [
        ("ours.ssv", ours.into()),
        ("theirs.ssv", theirs.clone().into()),
        ("ours.ssp", archive(ours)),
        ("theirs.ssp", archive(&theirs)),
        ("broken.ssp", "PK and no archive".into()),
        ("mine.toml", "title = \"mine\"\n".into()),
    ] {
        write(&folder, name, content);
    }
    for (option, name, code, words) in [
        ("--ssv", "theirs.ssv", 1, "theirs.ssv: it already exists and is not an SSV that this program has generated"),
        ("--ssv", "theirs.ssp", 1, "theirs.ssp: it already exists and is not an SSV that this program has generated"),
        ("--ssp", "theirs.ssp", 1, "theirs.ssp: it already exists and is not an SSP that this program has generated"),
        ("--ssp", "broken.ssp", 1, "broken.ssp: it already exists and is not an SSP that this program has generated"),
        ("--ssp", "ours.ssv", 1, "ours.ssv: it already exists and is not an SSP that this program has generated"),
        ("--save", "mine.toml", 1, "mine.toml: it already exists and is not a scenario that this program has written"),
        ("--ssp", "nowhere/twin.ssp", 1, "nowhere/twin.ssp: there is no folder nowhere"),
        ("--ssv", "nowhere/twin.ssv", 1, "nowhere/twin.ssv: there is no folder nowhere"),
        ("--save", "nowhere/twin.toml", 1, "nowhere/twin.toml: there is no folder nowhere"),
        // Files of this program may be replaced: the next error is the missing recording.
        ("--ssv", "ours.ssv", 2, "there-is-none.csv"),
        ("--ssp", "ours.ssp", 2, "there-is-none.csv"),
    ] {
        let before = content(name);
        assert_contains(&exits(code, &folder, &["identify", "there-is-none.csv", option, name]).1, &[words]);
        assert!(before == content(name), "{option} {name}");
    }
    let (_, errors) = exits(2, &folder, &["identify", "there-is-none.csv", "--ssp", "twin.ssp", "--method", "paper"]);
    assert_contains(&errors, &["--method likelihood"]);
}

/// A recording that is too short gets no answer and no twin; the exit code is 3, and verdict and JSON state it.
#[test]
fn an_answer_that_is_not_valid_has_no_twin() {
    for (scenario, machine, lines) in [("unbalanced", "planar", 200), ("spindle4", "spindle4", 150)] {
        let folder = folder(&format!("twin/not-valid-{machine}"));
        exits(0, &folder, &["simulate", scenario, "--set", "duration=0.05s", "--csv", "run.csv"]);
        let short: Vec<String> = read(&folder, "run.csv").lines().take(lines).map(str::to_owned).collect();
        write(&folder, "run.csv", short.join("\n"));
        let arguments = ["identify", "run.csv", "--machine", machine, "--json", "-"];
        let (out, errors) = exits(3, &folder, &[&arguments, &FILES[..]].concat());
        assert_contains(&errors, &["Not valid: the recording is too short", "The twin was not written"]);
        let document: Json = serde_json::from_str(&out).unwrap_or_else(|why| panic!("{why}: {out}"));
        assert!(document["valid"] == false && document["lambdaHat"].is_null(), "{machine}: {document}");
        for file in ["twin.toml", "twin.ssv", "twin.ssp"] {
            assert!(!folder.join(file).exists(), "{machine}: {file}");
        }
    }
}

/// A ball below one magnet: the mass includes κ, x counts from the operating point, and the twin levitates.
#[test]
fn an_axis_has_a_twin() {
    let folder = folder("twin/axial");
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/levitation");
    let path = |name: &str| data.join(name).display().to_string();
    let (recording, bench) = (path("levitation-stairs-mpc.csv.gz"), path("bench.toml"));
    let found = twin_of(&folder, &[&recording, "--scenario", &bench]);
    let values = same_in_all(&folder);
    let (point, gap) = (&found["operatingPoint"], &found["s"]);
    let lambda = |found: &Json| number(&found["magnets"]["lambda[2]"]["value"]);
    for element in ["plant", "controller", "estimator"] {
        same("m", values[&format!("{element}.m")], 0.06054 * number(&point["dynamics"]));
        same("s", values[&format!("{element}.s")], number(&gap["value"]) + 0.01);
    }
    same("lambda[2]", values["plant.lambda[2]"], lambda(&found));
    same("lambda0[2]", values["controller.lambda0[2]"], lambda(&found));
    same("tolerance.s", values["estimator.tolerance.s"], number(&gap["stdTotal"]));
    assert_eq!((values["plant.pX"], values["plant.coil.open[1]"], values["controller.F0"]), (0.5939, 1.0, 0.0));
    assert_eq!((values["controller.magnets.used"], values["estimator.magnets.used"]), (3.0, 3.0));
    assert_eq!((values["controller.Ts"], values["controller.bandwidth.tracking"]), (1e-3, 100.0));

    // ki at x = 0 of the twin is that of the operating point.
    exits(0, &folder, &["simulate", "twin.toml", "--csv", "again.csv"]);
    let ki = 2.0 * (values["plant.lambda[2]"] * values["plant.pX"]).sqrt() / values["plant.s"];
    below("ki", (ki / number(&point["ki"]) - 1.0).abs(), 1e-9);
    // The same file describes the bench to `identify`, columns included.
    let other = path("levitation-stairs-lqi.csv.gz");
    let again = identified(&folder, &[&other, "--scenario", "twin.toml"]);
    below("λ2 as saved", (lambda(&again) / lambda(&found) - 1.0).abs(), 1e-9);
}
