//! The built program: its files, its messages, its exit codes, and closed pipes.

use crate::prelude::*;
use std::io::{self, Write};
use std::process::Stdio;

#[test]
fn the_main_job_packages_runs_and_reports() {
    let folder = folder("command/main");
    let (out, err) = exits(0, &folder, &[]);

    let systems = ["MagneticBearing.ssp".into(), "MagneticSpindle.ssp".into()];
    for archive in MODELS[..6].iter().map(|model| format!("{model}.fmu")).chain(systems) {
        let path = format!("target/fmu/{archive}");
        let bytes = fs::read(folder.join(&path)).expect("an archive");
        assert_eq!(&bytes[..4], b"PK\x03\x04", "{archive} is a zip archive");
        assert_contains(&out, &[&format!("{path} ({} kB)", bytes.len().div_ceil(1000))]);
    }
    let rows = ["truth", "paper, figure 2", "paperLiteral at 0.1 s", "paper at 0.1 s", "predictionError at 0.2 s"];
    assert_contains(&out, &rows);
    assert_contains(&out, &["before", "after", "µm", "N", "target/report/index.html"]);
    let page = read(&folder, "target/report/index.html");
    assert_contains(&page, &["<!DOCTYPE html>", "application/json", ">cargo run --release<", "</html>"]);
    assert_eq!(err, "", "nothing goes wrong, and nobody looks at a progress bar");
}

/// The numbers of a table in a folder, all of which must be finite.
fn numbers(folder: &Path, name: &str) -> Vec<BTreeMap<String, f64>> {
    let of = |row: &BTreeMap<String, String>| row.keys().map(|name| (name.clone(), cell(row, name))).collect();
    let rows: Vec<BTreeMap<String, f64>> = rows(&read(folder, name)).iter().map(of).collect();
    assert!(rows.iter().flat_map(BTreeMap::values).all(|value| value.is_finite()), "{rows:?}");
    rows
}

#[test]
fn a_scenario_is_printed_changed_and_run() {
    let folder = folder("command/simulate");
    let (text, _) = exits(0, &folder, &["simulate", "--print", "unbalanced"]);
    write(&folder, "mine.toml", text.replace("duration = \"0.4 s\"", "duration = \"30 ms\""));
    let (out, _) = exits(0, &folder, &["simulate", "mine.toml", "--csv", "out.csv", "--report", "page"]);
    assert_contains(&out, &["out.csv", "page/index.html"]);
    let rows = numbers(&folder, "out.csv");
    assert_eq!(rows.len(), 301, "30 ms in steps of 100 µs, both ends included");
    for name in
        ["time [s]", "plant.Y [m]", "controller.i[1] [A]", "estimator.lambdaHat[1] [N.m2/A2]", "predictionError.valid"]
    {
        assert!(rows[0].contains_key(name), "{name}: {:?}", rows[0]);
    }
    let text = read(&folder, "out.csv");
    let valid: Vec<_> = self::rows(&text).iter().map(|row| row["predictionError.valid"].clone()).collect();
    assert!(valid.iter().all(|cell| ["0", "1"].contains(&cell.as_str())), "{valid:?}");
    let command = "cargo run --release -- simulate mine.toml --csv out.csv --report page";
    assert_contains(&read(&folder, "page/index.html"), &["application/json", "A rotor with unbalance", command]);
}

#[test]
fn a_run_that_ends_early_keeps_what_it_has() {
    let folder = folder("command/early");
    // A load that no current of the controller can balance.
    let load = ["--set", "plant.pZ=-20000", "--set", "duration=0.2", "--csv", "out.csv", "--report", "page"];
    let (_, err) = exits(1, &folder, &[&["simulate", "unbalanced"], &load[..]].concat());
    assert_contains(&err, &["the run ended early", "plant", "leaves the gap", "magnet", "t ="]);
    let digits = |word: &str| {
        word.trim_start_matches(['-', '0', '.']).chars().take_while(|c| *c != 'e').filter(char::is_ascii_digit).count()
    };
    let printed = err.split([' ', ',']).filter(|word| word.parse::<f64>().is_ok());
    let long: Vec<&str> = printed.filter(|word| digits(word) > 5).collect();
    assert!(long.is_empty(), "messages have few digits: {long:?} in {err}");
    let rows = numbers(&folder, "out.csv").len();
    assert!(rows > 1 && rows < 1999, "{rows} rows");
    assert_contains(&read(&folder, "page/index.html"), &["leaves the gap", "</html>"]);
    // The runs of studies report it as well.
    for arguments in ["design --speed 1e9", "montecarlo paper --position-noise 1 --runs 1"] {
        assert_contains(&exits(1, &folder, &words(arguments)).1, &["the run ended early", "leaves the gap"]);
    }
}

#[test]
fn files_that_cannot_be_written_are_named() {
    let folder = folder("command/unwritable");
    write(&folder, "taken", "a file");
    write(&folder, "short.toml", SHORT);
    for arguments in [
        &["simulate", "short.toml", "--csv", "taken/out.csv"][..],
        &["simulate", "short.toml", "--report", "taken/page"],
        &["simulate", "short.toml", "--report", "taken"],
        &["simulate", "short.toml", "--csv", "."],
        &["package", "--out", "taken"],
    ] {
        assert_contains(&exits(1, &folder, arguments).1, &["error: ", arguments[arguments.len() - 1]]);
    }
}

/// Each piece costs a system call.
#[test]
fn tables_are_written_in_large_pieces() {
    struct Pieces(usize);
    impl Write for Pieces {
        fn write(&mut self, piece: &[u8]) -> io::Result<usize> {
            self.0 += 1;
            Ok(piece.len())
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }
    let (mut pieces, recording) = (Pieces(0), scenario_and_run("paper", &[("duration", "20 ms")]).1.recording);
    recording.write_csv(&mut pieces).expect("a count takes everything");
    assert!(pieces.0 < recording.time_s.len(), "{} pieces for {} rows", pieces.0, recording.time_s.len());
}

#[test]
fn descriptions_are_written_to_the_folder() {
    let folder = folder("command/describe");
    exits(0, &folder, &["describe", "--out", "."]);
    for model in MODELS {
        let name = format!("modelName=\"{model}\"");
        assert_contains(&read(&folder, &format!("{model}.xml")), &["fmiVersion=\"2.0\"", &name]);
    }
}

#[test]
fn help_completions_and_version() {
    let folder = folder("command/help");
    let (out, _) = exits(0, &folder, &["--help"]);
    assert_contains(&out, &["Without a command", "package", "simulate", "describe", "--version"]);
    assert_contains(&out, &["target/report/index.html", "Exit codes:", "3  an identification"]);
    let (out, _) = exits(0, &folder, &["simulate", "--help"]);
    assert_contains(&out, &["[plant]", "[all]", "--csv", "--report", "--print", "paper"]);
    for shell in ["bash", "zsh", "fish", "powershell"] {
        let (out, _) = exits(0, &folder, &["completions", shell]);
        assert_contains(&out, &["magnetic-bearing", "simulate", "montecarlo"]);
    }
    // Sources without a repository have no commit.
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let head = || Command::new("git").current_dir(here).args(["rev-parse", "HEAD"]).output().expect("git").stdout;
    let commit = here.join(".git").exists().then(|| format!(" ({})", &String::from_utf8_lossy(&head())[..12]));
    let (out, _) = exits(0, &folder, &["--version"]);
    assert_eq!(out.trim(), format!("magnetic-bearing {}{}", env!("CARGO_PKG_VERSION"), commit.unwrap_or_default()));
}

#[test]
fn invalid_arguments_exit_with_2() {
    let folder = folder("command/arguments");
    bench(&folder);
    write(&folder, "slow.toml", "title = \"Slow\"\nduration = 0.1\nstep = 50e-6\n\n[all]\nTs = 50e-6\n");
    write(&folder, "bench.toml", format!("{SHORT}[tolerance]\nfoo = 3\n"));
    write(&folder, "design.csv", "plant.pZ [lbf]\n1\n");
    let bad = "title = \"Bad\"\nduration = -1\nstep = 1e-4\n[plant]\nlamda = 1\nY0 = \"1 inch\"\n";
    write(&folder, "bad.toml", bad);
    write(&folder, "zero.toml", format!("{SHORT}[all]\nm = 0\n"));
    for arguments in "--nonsense; nonsense; simulate; simulate paper --csv; package --nonsense".split("; ") {
        refuses(&folder, &words(arguments), &["error: ", "--help"]);
    }
    for (arguments, words) in [
        ("simulate paper --print --csv x.csv", &["error: ", "--help"][..]),
        ("simulate unbalanced --set m=-1", &["m = -1 kg is refused"]),
        ("simulate unbalanced --set m", &["NAME=VALUE"]),
        (
            "simulate unbalanced --set Ts=50us",
            &[
                "step = 0.0001 s: expected at most Ts = 0.00005 s, or controller, estimator",
                "plant.sensor.Ts = 0.0001 s",
            ],
        ),
        ("simulate unbalanced --set alpha[5]=1", &["alpha has no such element"]),
        ("simulate unbalanced --csv - --json -", &["--csv - and --json -"]),
        ("simulate unbalanced --set duration=1e9", &["duration = 1e9 s", "1e13 samples", "the limit is 8 GB"]),
        ("package paper", &["invalid value 'paper' for '[MACHINE]", "possible values: planar, "]),
        ("montecarlo --only mixed --current-noise 5", &["--current-noise", "cannot be used with"]),
        ("simulate paper --csv a --json ./a", &["--csv and --json ./a: expected different files"]),
        ("simulate paper --set step=1e-12", &["the limit is 8 GB, which is a duration of", "e-6 s"]),
        ("package spindel", &["invalid value 'spindel'", "a similar value exists: 'spindle'"]),
        ("montecarlo --only nosuch", &["--only \"nosuch\"", "no study has this", "Drawn bearings, noise known"]),
        ("montecarlo slow.toml --runs 1", &["plant.sensor.Ts = 0.0001 s: expected at most Ts = 0.00005 s"]),
        ("montecarlo lift-off --runs 1", &["the rotor touches down before 0.035 s", "--at", "in all runs"]),
        ("montecarlo --runs 0", &["--runs", "'0'", "expected a whole number above 0"]),
        ("montecarlo --runs many", &["--runs", "'many'", "expected a whole number above 0"]),
        ("identify none.csv", &["none.csv"]),
        ("identify bench.csv --csv ./bench.csv", &["this is the recording"]),
        ("identify bench.csv ./bench.csv", &["this recording is given twice"]),
        ("identify bench.csv --speed nan", &["a speed in rpm"]),
        ("identify bench.csv --set m=", &["--set m=: expected a value"]),
        ("identify bench.csv --rate 10", &["a rate"]),
        ("identify bench.csv --step 1kg", &["'1kg'", "a time as in 100us, above 0"]),
        ("identify bench.csv --step=-1us", &["'-1us'", "a time as in 100us, above 0"]),
        ("identify bench.csv --step 0", &["'0'", "a time as in 100us, above 0"]),
        ("identify bench.csv --position-noise 1A", &["'1A'", "a standard deviation as in 0.1um, 0 or above"]),
        ("identify bench.csv --current-noise=-5mA", &["'-5mA'", "a standard deviation as in 10mA, 0 or above"]),
        ("identify bench.csv --tolerance s=2mm", &["this is 400 %, expected less than 100 %"]),
        ("identify bench.csv --rate 10kHz --step 100us", &["--rate"]),
        ("identify bench.csv --rate 9kHz", &["the time stamps 100 µs"]),
        ("identify bench.csv --method best", &["'best' for '--method", "predictionError"]),
        ("identify bench.csv --hold none", &["'none' for '--hold"]),
        ("identify bench.csv --set hold=linear", &["hold", "--hold"]),
        ("identify bench.csv --set sensor.positionNoise=1e-6", &["sensor.positionNoise", "--position-noise"]),
        ("identify bench.csv --set lambda=1", &["lambda", "no variable"]),
        ("montecarlo paper --seed 4294967295", &["--seed", "2147483647"]),
        ("sweep none.csv --out rows.csv", &["none.csv"]),
        ("sweep bench.csv --out rows.csv --jobs 0", &["--jobs", "1..=1024"]),
        ("sweep bench.csv --out rows.csv --jobs 20000", &["--jobs", "1..=1024"]),
        ("sensitivity axial --set plant.m=-1", &["m = -1 kg is refused"]),
        (
            "simulate paper --set foo=3",
            &["[--set] foo: there is no variable of this name; the nearest are F0.modulationFrequency, "],
        ),
        ("simulate paper --set machine=spindle", &["[--set] machine: it is a key of the file"]),
        ("simulate paper --set Plant.m=7", &["did you mean plant.m?"]),
        ("simulate bench.toml", &["[tolerance]: foo is not a parameter of a bench"]),
        (
            "simulate bad.toml --csv out.csv",
            &["error: bad.toml:", "duration = -1", "lamda", "did you mean lambda?", "Y0", "1 inch"],
        ),
        ("simulate zero.toml --csv out.csv", &["[plant, controller, estimator] m = 0 kg"]),
        ("simulate none.toml --csv out.csv", &["none.toml", "cannot be read", "paper,", "unbalanced", "turned"]),
        ("simulate --print nothing", &["nothing", "paper,", "unbalanced", "turned"]),
        ("sweep design.csv --scenario nosuch --out rows.csv", &["nosuch:", "expected a file, or one of paper, "]),
        ("sweep design.csv --out rows.csv", &["plant.pZ = 1 lbf is refused: the unit lbf is not one of N"]),
        (
            "simulate planar4 --set method=paper",
            &["[--set] method: there is no variable", "it is one of the machine planar"],
        ),
        (
            "simulate axial --set plant.unbalance.phase=1",
            &["[--set] plant.unbalance.phase", "the machine planar or planar4"],
        ),
        (
            "identify bench.csv --set foo=3",
            &["--set foo: ", "no variable of this name; the nearest are filter.omega, "],
        ),
        ("design --at 1e-5", &["--at 0.00001 is refused: expected at least one sample, 0.0001 s"]),
        ("whirl --to -5", &["a speed in rpm"]),
        ("whirl --stiffness -5", &["-5", "a stiffness in N/m, above 0"]),
        ("whirl --damping=-1", &["a damping in N·s/m, 0 or above"]),
        ("whirl --stiffness 1e300", &["the natural frequencies at 0 rpm cannot be computed", "1e300 N/m"]),
        ("whirl --to 1e300", &["the natural frequencies at", "cannot be computed"]),
        ("whirl axial", &["machine = axial is refused: its rotor does not tilt", "inertia, as in spindle, spindle4"]),
    ] {
        refuses(&folder, &self::words(arguments), words);
    }
    assert!(!folder.join("out.csv").exists(), "nothing was computed");
    // A negative number is a value, not an option.
    let values = "identify bench.csv --position-noise -1; identify bench.csv --current-noise nan; \
                  identify bench.csv --window -1; montecarlo paper --position-noise -1e-7; montecarlo paper --at -1; \
                  design --scenario=paper --position-noise -1; design --position-noise 0; design --current-noise inf; \
                  design --speed -1; design --speed nan; design --at 0; design --scenario=paper --sample-time -1";
    for arguments in values.split("; ") {
        let [.., option, value] = words(arguments)[..] else { panic!("{arguments}") };
        let invalid = format!("invalid value '{value}' for '{option}");
        refuses(&folder, &words(arguments), &[&invalid, "expected"]);
    }
}

/// A short run of the unbalanced rotor, as a table.
fn bench(folder: &Path) -> String {
    exits(0, folder, &["simulate", "unbalanced", "--set", "duration=0.1s", "--csv", "bench.csv"]);
    read(folder, "bench.csv")
}

#[test]
fn unusable_recordings_exit_with_2() {
    let folder = folder("command/misread");
    let text = bench(&folder);
    let (out, err) = exits(0, &folder, &["identify", "bench.csv"]);
    assert_eq!(err, "", "{out}");
    // Wrong headers and their messages.
    let in_ma = [1, 2, 3].map(|k| (format!("plant.im[{k}] [A]"), format!("plant.im[{k}] [mA]")));
    let in_ma = in_ma.each_ref().map(|(from, to)| (from.as_str(), to.as_str()));
    for (changes, words) in [
        (&[("time [s]", "time [ms]")][..], &["every 100 ns", "--unit time=s"][..]),
        (&[("plant.theta [rad]", "plant.theta [rev]")], &["--unit theta=rad"]),
        (&in_ma, &["--unit im[1]=A", "--unit im[3]=A"]),
        (&[("plant.Ym [m]", "plant.Ym [furlong]"), ("plant.Zm [m]", "plant.Zm [ell]")], &["furlong", "ell", "µm"]),
    ] {
        let mut changed = text.clone();
        for (from, to) in changes {
            assert!(changed.contains(from), "{from} stands in the header");
            changed = changed.replacen(from, to, 1);
        }
        write(&folder, "changed.csv", changed);
        let words = [&["error: changed.csv: the recording cannot be used"], words].concat();
        for options in [&[][..], &["--hold", "auto", "--method", "all"]] {
            refuses(&folder, &[&["identify", "changed.csv"], options].concat(), &words);
        }
        let (out, err) = exits(2, &folder, &["identify", "changed.csv", "--json", "-"]);
        assert_contains(&err, &words);
        let refusal: serde_json::Value = serde_json::from_str(&out).expect("one document");
        assert!(refusal["valid"] == false && refusal["findings"].is_array(), "{refusal}");
    }
}

/// The errors of all files are reported, and none hides those of another.
#[test]
fn the_errors_of_all_recordings_are_reported_at_once() {
    let folder = folder("command/several");
    let text = bench(&folder);
    write(&folder, "a.csv", text.replacen("plant.Ym [m]", "plant.Ym [furlong]", 1));
    write(&folder, "b.csv", text.replacen("plant.im[2]", "plant.coil", 1));
    write(&folder, "c.csv", text.replacen("time [s]", "time [ms]", 1));
    let arguments = words("identify a.csv bench.csv none.csv b.csv --check c.csv");
    let wanted = ["a.csv: ", "furlong", "none.csv: ", "b.csv: ", "im[2]: no column", "c.csv: ", "--unit time=s"];
    refuses(&folder, &arguments, &wanted);
    let (out, _) = exits(2, &folder, &[&arguments[..], &["--json", "-"]].concat());
    let refusal: serde_json::Value = serde_json::from_str(&out).expect("one document");
    assert_contains(&refusal["findings"].to_string(), &["furlong", "im[2]: no column", "--unit time=s"]);
    let twice = ["./bench.csv: the recording cannot be used", "its readings are those of bench.csv"];
    refuses(&folder, &words("identify a.csv bench.csv ./bench.csv"), &twice);
}

/// A file that is being read keeps its content: it is replaced, not rewritten. Links and permissions stay.
#[cfg(unix)]
#[test]
fn results_replace_files_at_once() {
    use std::os::unix::fs::{PermissionsExt as _, symlink};
    let folder = folder("command/replaced");
    write(&folder, "short.toml", SHORT);
    write(&folder, "a.json", "{}");
    fs::set_permissions(folder.join("a.json"), fs::Permissions::from_mode(0o604)).expect("permissions");
    symlink("a.json", folder.join("link.json")).expect("a link");
    let reader = fs::File::open(folder.join("a.json")).expect("a file");
    exits(0, &folder, &["simulate", "short.toml", "--json", "link.json"]);
    assert_eq!(io::read_to_string(reader).expect("text"), "{}");
    assert!(read(&folder, "a.json").len() > 10 && folder.join("link.json").is_symlink());
    let mode = fs::metadata(folder.join("a.json")).expect("a file").permissions().mode();
    assert_eq!(mode & 0o777, 0o604);
    assert_eq!(fs::read_dir(&folder).expect("a folder").count(), 3, "nothing is left beside them");
    write(&folder, "-", "{}");
    assert!(exits(0, &folder, &["simulate", "short.toml", "--json", "-"]).0.len() > 10);
    assert_eq!(read(&folder, "-"), "{}", "`-` is the standard output");
}

#[test]
fn json_on_standard_output_is_a_single_document() {
    let folder = folder("command/json");
    bench(&folder);
    let arguments = "identify bench.csv --rate 10kHz --hold auto --speed 3000 --json - --csv out.csv --report page";
    let (out, err) = exits(0, &folder, &words(arguments));
    let document: serde_json::Value = serde_json::from_str(&out).unwrap_or_else(|error| panic!("{error}: {out}"));
    assert_contains(&document["notes"].to_string(), &["--speed is not used"]);
    assert_contains(&err, &["1001 samples of 100 µs", "page/index.html"]);
}

#[test]
fn a_bearing_is_given_to_identify_as_to_simulate() {
    let folder = folder("command/bearing");
    bench(&folder);
    // A file with parameters only.
    write(&folder, "mine.toml", "[all]\nm = \"6.6 kg\"\n");
    // A simulation without noise contradicts a wrong gap, not a wrong mass.
    for (code, arguments, words) in [
        (3, "--set s=5.1e-4 --set m=6.8kg --set alpha[1]=179.5deg", "m = 6.8 kg, s = 0.51 mm, alpha = 179.5,"),
        (0, "--scenario mine.toml", "m = 6.6 kg"),
    ] {
        assert_contains(&exits(code, &folder, &self::words(&format!("identify bench.csv {arguments}"))).0, &[words]);
    }
}

/// Runs the program, which must succeed, with a text on its standard input; standard output and standard error.
fn run_with_input(folder: &Path, arguments: &[&str], text: &str) -> (String, String) {
    let mut command = program(folder, arguments);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("the program runs");
    child.stdin.take().expect("its input").write_all(text.as_bytes()).expect("it reads");
    let (code, out, err) = decoded(&child.wait_with_output().expect("it ends"));
    assert_eq!(code, 0, "{arguments:?}: {err}");
    (out, err)
}

/// A scenario of 5 ms.
const SHORT: &str = "title = \"Short\"\nduration = 5e-3\nstep = 1e-4\n";

/// Fails if a line that cannot be printed is ignored, or reported again for every further line.
#[test]
#[cfg(target_os = "linux")]
fn a_full_standard_output_is_an_error() {
    let folder = folder("command/full");
    write(&folder, "short.toml", SHORT);
    for arguments in [&["simulate", "short.toml"][..], &["simulate", "--print", "paper"], &["completions", "bash"]] {
        let full = fs::OpenOptions::new().write(true).open("/dev/full").expect("the device");
        let (code, _, err) = decoded(&program(&folder, arguments).stdout(full).output().expect("the program runs"));
        assert_eq!((code, err.lines().count()), (1, 1), "{arguments:?}: {err}");
        assert_contains(&err, &["error: standard output", "No space left"]);
    }
    for option in ["--csv", "--json"] {
        let (_, err) = exits(1, &folder, &["simulate", "short.toml", option, "/dev/full"]);
        assert_contains(&err, &["error: /dev/full: No space left"]);
    }
    // Reading this device would never end.
    write(&folder, "design.csv", "plant.m\n6.7\n");
    let (_, err) = exits(1, &folder, &["sweep", "design.csv", "--out", "/dev/full"]);
    assert_contains(&err, &["/dev/full", "not a regular file"]);
}

#[test]
fn a_hyphen_is_the_standard_input_or_output() {
    let folder = folder("command/hyphen");
    write(&folder, "short.toml", SHORT);
    let design = "plant.m\n6.7\n6.8\n";
    write(&folder, "design.csv", design);
    exits(0, &folder, &["simulate", "short.toml", "--csv", "out.csv", "--json", "out.json"]);
    exits(0, &folder, &["sweep", "design.csv", "--scenario", "short.toml", "--out", "rows.csv"]);
    for (arguments, input, result, words) in [
        (&["simulate", "-", "--csv", "-"][..], SHORT, "out.csv", &["Short", "Estimated force constants"][..]),
        (&["simulate", "-", "--json", "-"], SHORT, "out.json", &["Short", "Estimated force constants"]),
        (&["sweep", "-", "--scenario", "short.toml", "--out", "-"], design, "rows.csv", &["2 rows"]),
    ] {
        let (out, err) = run_with_input(&folder, arguments, input);
        assert!(out == read(&folder, result), "{arguments:?}: the result and nothing else: {out}");
        assert_contains(&err, words);
        assert!(!folder.join("-").exists(), "{arguments:?}");
    }
}

#[test]
fn set_changes_values_of_a_scenario() {
    let folder = folder("command/set");
    write(&folder, "short.toml", format!("{SHORT}[controller]\nm = 6.0\nreference.rY = 1e-5\n"));
    let set = |code: i32, changes: &[&str]| {
        let changes = changes.iter().flat_map(|change| ["--set", change]);
        let arguments: Vec<_> = ["simulate", "short.toml", "--json", "-"].into_iter().chain(changes).collect();
        exits(code, &folder, &arguments)
    };
    let document = |(out, _): (String, String)| serde_json::from_str::<serde_json::Value>(&out).expect("a document");
    let lambda = "lambda=[1e-6, 2e-6, 3e-6]";
    let found = document(set(0, &["m=7", lambda, "reference.rY=20 µm", "duration=3 ms", "plant.pZ=-20"]));
    assert!(found["duration"] == 3e-3 && found["end"] == 3e-3 && found["complete"] == true, "{found}");
    assert_eq!(found["lambda"], serde_json::json!([1e-6, 2e-6, 3e-6]));
    assert_eq!(found["changes"][0], "m=7");
    // A scenario with these values gives the same.
    let text = "title = \"Short\"\nduration = 3e-3\nstep = 1e-4\n[all]\nm = 7\n[plant]\nlambda = [1e-6, 2e-6, 3e-6]\npZ = -20\n\
                [controller]\nreference.rY = 2e-5\n";
    let same = document(run_with_input(&folder, &["simulate", "-", "--json", "-"], text));
    assert_eq!(found["outputs"], same["outputs"]);

    let (out, err) = set(2, &["mass=7", "plant.m=heavy", "plant.lamda=1", "duration=0"]);
    assert_eq!(out, "");
    assert_contains(&err, &["mass: there is no variable", "m = \"heavy\"", "did you mean lambda?", "duration = 0"]);
}

#[test]
fn foreign_files_are_not_overwritten() {
    let folder = folder("command/kinds");
    write(&folder, "short.toml", SHORT);
    for name in ["page", "fmu"] {
        fs::create_dir(folder.join(name)).expect("a folder");
    }
    for (file, arguments) in [
        ("mine.txt", "simulate short.toml --csv mine.txt"),
        ("mine.txt", "simulate short.toml --json mine.txt"),
        ("short.toml", "simulate short.toml --csv short.toml"),
        ("page/index.html", "simulate short.toml --report page"),
        ("fmu/MagneticBearing.ssp", "package --out fmu"),
        ("VARIABLES.md", "describe --out ."),
    ] {
        let before = if file == "short.toml" { SHORT } else { "notes" };
        write(&folder, file, before);
        let (_, err) = exits(1, &folder, &words(arguments));
        assert_contains(&err, &[file, "it already exists"]);
        assert_eq!(read(&folder, file), before, "{arguments}");
        if file != "short.toml" {
            fs::remove_file(folder.join(file)).expect("a file");
        }
        assert_eq!(fs::read_dir(folder.join("fmu")).expect("a folder").count(), 0, "all archives or none");
    }
    // The program overwrites its own files.
    for _ in 0..2 {
        let arguments = ["simulate", "short.toml", "--csv", "a.csv", "--json", "a.json", "--report", "page"];
        exits(0, &folder, &arguments);
    }
}

#[test]
fn failed_cases_are_counted() {
    let folder = folder("command/failed");
    write(&folder, "short.toml", SHORT);
    write(&folder, "design.csv", "plant.m\n6.7\n-1\n0\n");
    // The second run finds all rows done.
    for out in ["rows.csv", "rows.csv", "-"] {
        let arguments = ["sweep", "design.csv", "--scenario", "short.toml", "--out", out];
        assert_contains(&exits(1, &folder, &arguments).1, &["2 of 3 cases failed"]);
    }
}

#[test]
fn the_sensitivity_of_a_loop_is_a_table() {
    let folder = folder("command/sensitivity");
    let has_row = |out: &str| out.lines().any(|line| line.trim().starts_with("Xm") && line.ends_with('A'));
    let (out, _) = exits(0, &folder, &["sensitivity", "axial"]);
    assert_contains(&out, &["Peak of the sensitivity function", "Zones of ISO 14839-3", "true λ"]);
    assert!(has_row(&out), "{out}");
    // A result that cannot be computed is an error; the others are printed.
    let (out, err) = exits(1, &folder, &["sensitivity", "axial", "--set", "lambda0=[1e-300, 1e-300]"]);
    assert!(has_row(&out), "{out}");
    let reason = "error: with the first guess of λ there is no sensitivity function: the loop does not settle";
    assert_contains(&err, &[reason]);
    assert!(!err.contains("true λ"), "{err}");
}

/// A pipe whose reader has gone.
fn closed() -> Stdio {
    let (reader, writer) = io::pipe().expect("a pipe");
    drop(reader);
    writer.into()
}

#[test]
fn a_closed_standard_output_ends_the_program_quietly_and_a_closed_standard_error_does_not_panic() {
    let folder = folder("command/closed");
    write(&folder, "design.csv", "plant.m\n6.7\n6.8\n");
    for (arguments, output, errors, wanted) in [
        ("simulate none", Stdio::null(), closed(), 2),
        ("identify none.csv", Stdio::null(), closed(), 2),
        ("simulate unbalanced --set duration=10ms --csv -", Stdio::null(), closed(), 0),
        ("simulate unbalanced --set duration=10ms --csv none/x.csv", Stdio::null(), closed(), 1),
        ("simulate unbalanced --set duration=50ms --csv -", closed(), Stdio::piped(), 0),
        ("simulate unbalanced --set duration=50ms --json -", closed(), Stdio::piped(), 0),
        ("completions bash", closed(), Stdio::piped(), 0),
        ("sweep design.csv --expand", closed(), Stdio::piped(), 0),
        ("sweep design.csv --out -", closed(), Stdio::piped(), 0),
    ] {
        let mut program = program(&folder, &words(arguments));
        let (code, _, err) = decoded(&program.stdout(output).stderr(errors).output().expect("it runs"));
        assert_eq!(code, wanted, "{arguments}: {err}");
        assert!(!err.contains("error:"), "{arguments}: {err}");
    }
}

/// An interrupted sweep keeps its rows.
#[cfg(unix)]
#[test]
fn an_interrupted_sweep_says_how_to_continue() {
    let folder = folder("command/interrupted");
    let cases: String = (0..400).map(|case| format!("{}\n", 6.5 + 1e-3 * f64::from(case))).collect();
    write(&folder, "design.csv", format!("plant.m\n{cases}"));
    let arguments = words("sweep design.csv --out rows.csv --jobs 1");
    let sweep = program(&folder, &arguments).stderr(Stdio::piped()).stdout(Stdio::null()).spawn().expect("it runs");
    // The header is written before the first case.
    while !fs::metadata(folder.join("rows.csv")).is_ok_and(|file| file.len() > 0) {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let interrupt = Command::new("kill").args(["-s", "INT", &sweep.id().to_string()]).status();
    assert!(interrupt.is_ok_and(|status| status.success()));
    let (code, _, errors) = decoded(&sweep.wait_with_output().expect("it ends"));
    assert_eq!(code, 130, "{errors}");
    assert_contains(&errors, &["interrupted", "rows.csv", "the same command"]);
}
