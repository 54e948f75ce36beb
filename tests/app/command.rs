//! The built program: its files, its messages, and the exit codes that scripts rely on.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};
use std::time::Instant;

use crate::program::{ends, folder, program, refuses, run, said};
use crate::support::{MODELS, says};

/// Seconds. The main job should take five on two cores; beyond this limit a slow machine is no explanation.
const MAIN_JOB_S: f64 = 30.0;

#[test]
fn the_main_job_packages_runs_and_reports() {
    let folder = folder("command/main");
    let begin = Instant::now();
    let (code, out, err) = run(&folder, &[]);
    let lasted_s = begin.elapsed().as_secs_f64();
    assert_eq!(code, 0, "{err}");
    assert!(lasted_s < MAIN_JOB_S, "{lasted_s} s, the limit is {MAIN_JOB_S} s");

    let systems = ["MagneticBearing.ssp".into(), "MagneticSpindle.ssp".into()];
    for archive in MODELS[..6].iter().map(|model| format!("{model}.fmu")).chain(systems) {
        let path = format!("target/fmu/{archive}");
        says(&out, &[&path]);
        let bytes = fs::read(folder.join(&path)).expect("an archive");
        assert_eq!(&bytes[..4], b"PK\x03\x04", "{archive} is a zip archive");
        let kilobytes = bytes.len().div_ceil(1000);
        says(&out, &[&format!("{archive} ({kilobytes} kB)")]);
    }
    says(&out, &["truth", "paper, figure 2", "paperLiteral at 0.1 s", "paper at 0.1 s", "predictionError at 0.2 s"]);
    says(&out, &["before", "after", "µm", "N", "target/report/index.html"]);
    let page = fs::read_to_string(folder.join("target/report/index.html")).expect("the report");
    says(&page, &["<!DOCTYPE html>", "application/json", ">cargo run --release<", "</html>"]);
    assert_eq!(err, "", "nothing goes wrong, and nobody looks at a progress bar");
}

#[test]
fn a_scenario_is_printed_changed_and_run() {
    let folder = folder("command/simulate");
    let (text, _) = ends(0, &folder, &["simulate", "--print", "unbalanced"]);
    let file = folder.join("mine.toml");
    fs::write(&file, text.replace("duration = \"0.4 s\"", "duration = \"30 ms\"")).expect("a file");
    let (out, _) = ends(0, &folder, &["simulate", "mine.toml", "--csv", "out.csv", "--report", "page"]);
    says(&out, &["out.csv", "page/index.html"]);

    let csv = fs::read_to_string(folder.join("out.csv")).expect("the table");
    let mut lines = csv.lines();
    let head = lines.next().expect("a head");
    let names =
        ["time [s]", "plant.Y [m]", "controller.i[1] [A]", "estimator.lambdaHat[1] [N.m2/A2]", "predictionError.valid"];
    says(head, &names);
    let columns = head.split(',').count();
    let rows: Vec<Vec<f64>> = lines
        .map(|line| line.split(',').map(|cell| cell.parse().unwrap_or_else(|_| panic!("{cell} is a number"))).collect())
        .collect();
    assert_eq!(rows.len(), 301, "30 ms in steps of 100 µs, both ends included");
    assert!(rows.iter().all(|row| row.len() == columns && row.iter().all(|value| value.is_finite())));
    let page = fs::read_to_string(folder.join("page/index.html")).expect("the report");
    let command = "cargo run --release -- simulate mine.toml --csv out.csv --report page";
    says(&page, &["application/json", "A rotor with unbalance", command]);
}

#[test]
fn a_scenario_that_cannot_be_read_is_refused() {
    let folder = folder("command/bad");
    fs::write(
        folder.join("bad.toml"),
        "title = \"Bad\"\nduration = -1\nstep = 1e-4\n[plant]\nlamda = 1\nY0 = \"1 inch\"\n",
    )
    .expect("a file");
    refuses(
        &folder,
        &["simulate", "bad.toml", "--csv", "out.csv"],
        &["error: bad.toml:", "duration = -1", "lamda", "did you mean lambda?", "Y0", "1 inch"],
    );
    assert!(!folder.join("out.csv").exists(), "nothing was computed");

    refuses(&folder, &["simulate", "none.toml"], &["none.toml", "cannot be read", "paper,", "unbalanced", "turned"]);

    fs::write(folder.join("zero.toml"), "title = \"Zero\"\nduration = 1\nstep = 1e-4\n[all]\nm = 0\n").expect("a file");
    refuses(&folder, &["simulate", "zero.toml"], &["[plant] m = 0 kg", "[controller] m", "[estimator] m"]);

    refuses(&folder, &["simulate", "--print", "nothing"], &["nothing", "paper,", "unbalanced", "turned"]);
}

#[test]
fn a_run_that_ends_early_keeps_what_it_has() {
    let folder = folder("command/early");
    // A load that no current of the controller can balance.
    fs::write(
        folder.join("push.toml"),
        "title = \"A load\"\nduration = \"0.2 s\"\nstep = \"100 µs\"\n[plant]\npZ = \"-20000 N\"\n",
    )
    .expect("a file");
    says(
        &ends(1, &folder, &["simulate", "push.toml", "--csv", "out.csv", "--report", "page"]).1,
        &["the run ended early", "plant", "leaves the gap", "magnet", "t ="],
    );
    let table = fs::read_to_string(folder.join("out.csv")).expect("the table");
    let rows = table.lines().count();
    assert!(rows > 2 && rows < 2000, "{rows} lines");
    let mut cells = table.lines().skip(1).flat_map(|line| line.split(','));
    assert!(cells.all(|cell| cell.parse().is_ok_and(f64::is_finite)), "{table}");
    let page = fs::read_to_string(folder.join("page/index.html")).expect("the report");
    says(&page, &["leaves the gap", "</html>"]);
}

#[test]
fn what_cannot_be_written_is_named() {
    let folder = folder("command/unwritable");
    fs::write(folder.join("taken"), "a file").expect("a file");
    fs::write(folder.join("short.toml"), "title = \"Short\"\nduration = 1e-3\nstep = 1e-4\n").expect("a file");
    for arguments in
        [["simulate", "short.toml", "--csv", "taken/out.csv"], ["simulate", "short.toml", "--report", "taken/page"]]
    {
        says(&ends(1, &folder, &arguments).1, &["error: ", arguments[3]]);
    }
    says(&ends(1, &folder, &["package", "--out", "taken"]).1, &["error: ", "taken"]);
}

#[test]
fn descriptions_go_where_they_are_wanted() {
    let folder = folder("command/describe");
    ends(0, &folder, &["describe", "--out", "."]);
    for model in MODELS {
        let text = fs::read_to_string(folder.join(format!("{model}.xml"))).expect("a model description");
        says(&text, &["fmiVersion=\"2.0\"", &format!("modelName=\"{model}\"")]);
    }
}

#[test]
fn help_says_what_there_is() {
    let folder = folder("command/help");
    let (out, _) = ends(0, &folder, &["--help"]);
    says(&out, &["Without a command", "package", "simulate", "describe", "--version", "target/report/index.html"]);
    let (out, _) = ends(0, &folder, &["simulate", "--help"]);
    says(&out, &["[plant]", "[all]", "--csv", "--report", "--print", "paper"]);
    let (out, _) = ends(0, &folder, &["--version"]);
    let version =
        out.trim().strip_prefix(concat!("magnetic-bearing ", env!("CARGO_PKG_VERSION"))).expect("the version");
    // Sources without a repository have no commit.
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    if here.join(".git").exists() {
        let head = Command::new("git").current_dir(here).args(["rev-parse", "HEAD"]).output().expect("git");
        let head = String::from_utf8(head.stdout).expect("UTF-8");
        assert_eq!(version, format!(" ({})", &head[..12]));
    } else {
        assert_eq!(version, "");
    }
}

#[test]
fn arguments_that_make_no_sense_are_answered_with_2() {
    let folder = folder("command/arguments");
    for arguments in [
        &["--nonsense"][..],
        &["nonsense"],
        &["simulate"],
        &["simulate", "paper", "--csv"],
        &["simulate", "paper", "--print", "--csv", "x.csv"],
        &["package", "--nonsense"],
    ] {
        refuses(&folder, arguments, &["error: ", "--help"]);
    }
    refuses(&folder, &["package", "paper"], &["error: paper is no machine; known are planar, "]);
}

#[test]
fn montecarlo_refuses_what_it_cannot_run() {
    let folder = folder("command/montecarlo");
    for (arguments, wanted) in [
        (["--only", "nosuch"], ["--only \"nosuch\"", "no study has this in its title", "Drawn bearings, noise known"]),
        (["--runs", "0"], ["--runs", "'0'", "expected a whole number above 0"]),
        (["--runs", "many"], ["--runs", "'many'", "expected a whole number above 0"]),
    ] {
        refuses(&folder, &[["montecarlo"].as_slice(), &arguments].concat(), &wanted);
    }
}

/// A short run of the unbalanced rotor, as a table.
fn bench(folder: &Path) -> String {
    let (_, text, _) = run(folder, &["simulate", "--print", "unbalanced"]);
    fs::write(folder.join("bench.toml"), text.replace("duration = \"0.4 s\"", "duration = \"0.1 s\"")).expect("a file");
    ends(0, folder, &["simulate", "bench.toml", "--csv", "bench.csv"]);
    fs::read_to_string(folder.join("bench.csv")).expect("the table")
}

#[test]
fn recordings_that_cannot_be_used_are_answered_with_2() {
    let folder = folder("command/misread");
    let text = bench(&folder);
    let (code, out, err) = run(&folder, &["identify", "bench.csv"]);
    assert_eq!((code, err.as_str()), (0, ""), "{out}");
    // Wrong headers and the messages for them.
    type Case<'a> = (&'a [(&'a str, &'a str)], &'a [&'a str]);
    let cases: [Case; 4] = [
        (&[("time [s]", "time [ms]")], &["every 100 ns", "--unit time=s"]),
        (&[("plant.theta [rad]", "plant.theta [rev]")], &["--unit theta=rad"]),
        (
            &[
                ("plant.im[1] [A]", "plant.im[1] [mA]"),
                ("plant.im[2] [A]", "plant.im[2] [mA]"),
                ("plant.im[3] [A]", "plant.im[3] [mA]"),
            ],
            &["--unit im[1]=A", "--unit im[3]=A"],
        ),
        (&[("plant.Ym [m]", "plant.Ym [furlong]"), ("plant.Zm [m]", "plant.Zm [ell]")], &["furlong", "ell", "µm"]),
    ];
    for (changes, words) in cases {
        let mut changed = text.clone();
        for (from, to) in changes {
            assert!(changed.contains(from), "{from} stands in the header");
            changed = changed.replacen(from, to, 1);
        }
        fs::write(folder.join("changed.csv"), changed).expect("a file");
        for options in [&[][..], &["--json", "-"], &["--hold", "auto", "--method", "all"]] {
            let arguments = [&["identify", "changed.csv"], options].concat();
            let (code, out, err) = run(&folder, &arguments);
            assert_eq!(code, 2, "{changes:?} {options:?}: {err}");
            if options.contains(&"--json") {
                let refusal: serde_json::Value = serde_json::from_str(&out).expect("one document");
                assert!(refusal["valid"] == false && refusal["findings"].is_array(), "{refusal}");
            } else {
                assert_eq!(out, "");
            }
            says(&err, &["error: changed.csv: the recording cannot be used"]);
            says(&err, words);
        }
    }
    // A missing file is a different error.
    refuses(&folder, &["identify", "none.csv"], &["none.csv"]);
    for arguments in [
        &["identify", "bench.csv", "--rate", "10"][..],
        &["identify", "bench.csv", "--step", "1 kg"],
        &["identify", "bench.csv", "--rate", "10kHz", "--step", "100us"],
        &["identify", "bench.csv", "--rate", "9kHz"],
    ] {
        refuses(&folder, arguments, &[]);
    }
    refuses(&folder, &["identify", "bench.csv", "--method", "best"], &["--method best", "predictionError"]);
}

#[test]
fn json_on_the_standard_output_is_one_document_and_nothing_else() {
    let folder = folder("command/json");
    bench(&folder);
    let arguments = "identify bench.csv --rate 10kHz --hold auto --json - --csv out.csv --report page";
    let arguments: Vec<_> = arguments.split(' ').collect();
    let (out, err) = ends(0, &folder, &arguments);
    let document: serde_json::Value = serde_json::from_str(&out).unwrap_or_else(|error| panic!("{error}: {out}"));
    assert!(document.is_object(), "{out}");
    says(&err, &["1001 samples of 100 µs", "page/index.html"]);
}

/// Runs the program with a text on its standard input.
fn run_with_input(folder: &Path, arguments: &[&str], text: &str) -> Output {
    use std::io::Write;
    use std::process::Stdio;
    let mut command = program(folder, arguments);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("the program runs");
    child.stdin.take().expect("its input").write_all(text.as_bytes()).expect("it reads");
    child.wait_with_output().expect("it ends")
}

/// A scenario of 5 ms.
const SHORT: &str = "title = \"Short\"\nduration = 5e-3\nstep = 1e-4\n";

/// Fails if a line that could not be printed is forgotten, or reported again for every further line.
#[test]
#[cfg(target_os = "linux")]
fn a_full_standard_output_is_an_error() {
    let folder = folder("command/full");
    fs::write(folder.join("short.toml"), SHORT).expect("a file");
    for arguments in [&["simulate", "short.toml"][..], &["simulate", "--print", "paper"], &["completions", "bash"]] {
        let full = fs::OpenOptions::new().write(true).open("/dev/full").expect("the device");
        let (code, _, err) = said(&program(&folder, arguments).stdout(full).output().expect("the program runs"));
        assert_eq!(code, 1, "{arguments:?}");
        assert_eq!(err.lines().count(), 1, "{err}");
        says(&err, &["error: standard output", "No space left"]);
    }
    for arguments in
        [["simulate", "short.toml", "--csv", "/dev/full"], ["simulate", "short.toml", "--json", "/dev/full"]]
    {
        says(&ends(1, &folder, &arguments).1, &["error: /dev/full: No space left"]);
    }
    // Reading it would not end, either.
    fs::write(folder.join("design.csv"), "plant.m\n6.7\n").expect("a file");
    says(&ends(1, &folder, &["sweep", "design.csv", "--out", "/dev/full"]).1, &["/dev/full", "not a regular file"]);
}

#[test]
fn a_hyphen_is_the_standard_input_or_output() {
    let folder = folder("command/hyphen");
    fs::write(folder.join("short.toml"), SHORT).expect("a file");
    ends(0, &folder, &["simulate", "short.toml", "--csv", "out.csv", "--json", "out.json"]);
    let table = fs::read_to_string(folder.join("out.csv")).expect("a table");
    let document = fs::read_to_string(folder.join("out.json")).expect("a document");
    for (arguments, wanted) in [(["simulate", "-", "--csv", "-"], table), (["simulate", "-", "--json", "-"], document)]
    {
        let (code, out, err) = said(&run_with_input(&folder, &arguments, SHORT));
        assert_eq!(code, 0, "{err}");
        assert!(out == wanted, "{arguments:?}: the result and nothing else: {out}");
        says(&err, &["Short", "Estimated force constants"]);
    }
    refuses(&folder, &["simulate", "short.toml", "--csv", "-", "--json", "-"], &["--csv - and --json -"]);
    assert!(!folder.join("-").exists());

    fs::write(folder.join("design.csv"), "plant.m\n6.7\n6.8\n").expect("a file");
    let sweep = ["sweep", "design.csv", "--scenario", "short.toml", "--out"];
    ends(0, &folder, &[&sweep[..], &["rows.csv"]].concat());
    let arguments = ["sweep", "-", "--scenario", "short.toml", "--out", "-"];
    let (code, out, err) = said(&run_with_input(&folder, &arguments, "plant.m\n6.7\n6.8\n"));
    assert_eq!((code, out), (0, fs::read_to_string(folder.join("rows.csv")).expect("rows")), "{err}");
    says(&err, &["2 rows"]);
}

#[test]
fn values_are_changed_without_a_scenario_of_ones_own() {
    let folder = folder("command/set");
    fs::write(folder.join("short.toml"), format!("{SHORT}[controller]\nm = 6.0\nreference.rY = 1e-5\n"))
        .expect("a file");
    let set = |changes: &[&str]| {
        let changes = changes.iter().flat_map(|change| ["--set", change]);
        let arguments: Vec<_> = ["simulate", "short.toml", "--json", "-"].into_iter().chain(changes).collect();
        run(&folder, &arguments)
    };
    let document = |(code, out, err): (i32, String, String)| {
        assert_eq!(code, 0, "{err}");
        serde_json::from_str::<serde_json::Value>(&out).expect("a document")
    };
    let lambda = "lambda=[1e-6, 2e-6, 3e-6]";
    let found = document(set(&["m=7", lambda, "reference.rY=20 µm", "duration=3 ms", "plant.pZ=-20"]));
    assert!(found["duration"] == 3e-3 && found["end"] == 3e-3 && found["complete"] == true, "{found}");
    assert_eq!(found["lambda"], serde_json::json!([1e-6, 2e-6, 3e-6]));
    assert_eq!(found["changes"][0], "m=7");
    // The same as a scenario with these values.
    let text = "title = \"Short\"\nduration = 3e-3\nstep = 1e-4\n[all]\nm = 7\n[plant]\nlambda = [1e-6, 2e-6, 3e-6]\npZ = -20\n\
                [controller]\nreference.rY = 2e-5\n";
    let same = document(said(&run_with_input(&folder, &["simulate", "-", "--json", "-"], text)));
    assert_eq!(found["outputs"], same["outputs"]);

    let (code, out, err) = set(&["mass=7", "plant.m=heavy", "plant.lamda=1", "duration=0"]);
    assert_eq!((code, out.as_str()), (2, ""));
    says(&err, &["mass: there is no variable", "m = \"heavy\"", "did you mean lambda?", "duration = 0"]);
    refuses(&folder, &["simulate", "short.toml", "--set", "m"], &["NAME=VALUE"]);
}

#[test]
fn files_of_another_kind_are_not_overwritten() {
    let folder = folder("command/kinds");
    fs::write(folder.join("short.toml"), SHORT).expect("a file");
    fs::create_dir(folder.join("page")).expect("a folder");
    fs::create_dir(folder.join("fmu")).expect("a folder");
    for (file, arguments) in [
        ("mine.txt", &["simulate", "short.toml", "--csv", "mine.txt"][..]),
        ("mine.txt", &["simulate", "short.toml", "--json", "mine.txt"]),
        ("short.toml", &["simulate", "short.toml", "--csv", "short.toml"]),
        ("page/index.html", &["simulate", "short.toml", "--report", "page"]),
        ("fmu/MagneticBearing.ssp", &["package", "--out", "fmu"]),
        ("VARIABLES.md", &["describe", "--out", "."]),
    ] {
        let path = folder.join(file);
        let before = if file == "short.toml" { SHORT } else { "notes" };
        fs::write(&path, before).expect("a file");
        says(&ends(1, &folder, arguments).1, &[file, "it already exists"]);
        assert_eq!(fs::read_to_string(&path).expect("the file"), before, "{arguments:?}");
        if file != "short.toml" {
            fs::remove_file(&path).expect("a file");
        }
        assert_eq!(fs::read_dir(folder.join("fmu")).expect("a folder").count(), 0, "all archives or none");
    }
    // The program overwrites its own files.
    for _ in 0..2 {
        let arguments = ["simulate", "short.toml", "--csv", "a.csv", "--json", "a.json", "--report", "page"];
        ends(0, &folder, &arguments);
    }
    // The recording has the same format as the table of estimates.
    bench(&folder);
    refuses(&folder, &["identify", "bench.csv", "--csv", "./bench.csv"], &["this is the recording"]);
}

#[test]
fn failed_cases_are_counted() {
    let folder = folder("command/failed");
    fs::write(folder.join("short.toml"), SHORT).expect("a file");
    fs::write(folder.join("design.csv"), "plant.m\n6.7\n-1\n0\n").expect("a file");
    // Also when all rows were there before.
    for out in ["rows.csv", "rows.csv", "-"] {
        let arguments = ["sweep", "design.csv", "--scenario", "short.toml", "--out", out];
        says(&ends(1, &folder, &arguments).1, &["2 of 3 cases failed"]);
    }
}

#[test]
fn negative_numbers_are_values_and_refused_as_such() {
    let folder = folder("command/negative");
    fs::write(folder.join("empty.csv"), "").expect("a file");
    for arguments in [
        ["identify", "empty.csv", "--position-noise", "-1"],
        ["identify", "empty.csv", "--current-noise", "nan"],
        ["identify", "empty.csv", "--window", "-1"],
        ["montecarlo", "paper", "--position-noise", "-1e-7"],
        ["montecarlo", "paper", "--at", "-1"],
        ["design", "--scenario=paper", "--position-noise", "-1"],
        ["design", "--scenario=paper", "--sample-time", "-1"],
    ] {
        refuses(&folder, &arguments, &[&format!("invalid value '{}' for '{}", arguments[3], arguments[2]), "expected"]);
    }
    let (out, _) = ends(0, &folder, &["design", "--speed", "0", "--at", "0.01"]);
    assert!(!out.contains("inf") && !out.contains("NaN"), "{out}");
    says(&out, &["at 0 rpm"]);
}

#[test]
fn shells_complete_commands() {
    let folder = folder("command/shells");
    for shell in ["bash", "zsh", "fish", "powershell"] {
        let (out, _) = ends(0, &folder, &["completions", shell]);
        says(&out, &["magnetic-bearing", "simulate", "montecarlo"]);
    }
}

#[test]
fn the_sensitivity_of_a_loop_is_a_table() {
    let folder = folder("command/sensitivity");
    let (out, _) = ends(0, &folder, &["sensitivity", "axial"]);
    says(&out, &["Peak of the sensitivity function", "Zones of ISO 14839-3", "true λ"]);
    assert!(out.lines().any(|line| line.trim().starts_with("Xm") && line.ends_with('A')), "{out}");
    refuses(&folder, &["sensitivity", "axial", "--set", "plant.m=-1"], &["m = -1 kg is refused"]);
}

#[test]
fn what_does_not_know_a_machine_refuses_it_by_name() {
    let folder = folder("command/planar");
    for (scenario, machine) in [("unbalanced", "planar"), ("planar4", "planar4"), ("axial", "axial")] {
        let (_, err) = ends(2, &folder, &["whirl", scenario]);
        let refused = format!("machine = {machine} is refused: its rotor does not tilt");
        says(&err, &[&refused, "moments of inertia, as in spindle, spindle4"]);
    }
}
