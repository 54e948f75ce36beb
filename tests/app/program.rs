//! Helpers: the built program, the folders in which tests run it, its scenarios and their runs.

use crate::prelude::*;
use std::process::Output;

use magnetic_bearing::studies::identify::likelihood::Estimate;
use magnetic_bearing::studies::sweep::Sweep;

/// An empty folder for a test; tests run in parallel, so each uses a name of its own.
pub fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).expect("a folder");
    folder
}

/// Writes a file in a folder.
#[track_caller]
pub fn write(folder: &Path, name: &str, content: impl AsRef<[u8]>) {
    fs::write(folder.join(name), content).unwrap_or_else(|why| panic!("{name}: {why}"));
}

/// The text of a file in a folder.
#[track_caller]
pub fn read(folder: &Path, name: &str) -> String {
    fs::read_to_string(folder.join(name)).unwrap_or_else(|why| panic!("{name}: {why}"))
}

/// A recording as `simulate` writes it.
pub fn csv(recording: &Recording) -> String {
    let mut bytes = Vec::new();
    recording.write_csv(&mut bytes).expect("a vector takes everything");
    String::from_utf8(bytes).expect("text")
}

/// The rows of a table: cells by column name.
pub fn rows(text: &str) -> Vec<BTreeMap<String, String>> {
    csv::Reader::from_reader(text.as_bytes()).deserialize().map(|row| row.expect("a row")).collect()
}

/// The rows of a sweep of a design over a scenario.
pub fn swept(folder: &Path, design: &str, scenario: &str) -> Vec<BTreeMap<String, String>> {
    write(folder, "design.csv", design);
    let sweep = Sweep::open(&folder.join("design.csv"), Some(Path::new(scenario))).expect("a design");
    sweep.run(&folder.join("rows.csv")).expect("rows");
    rows(&read(folder, "rows.csv"))
}

/// A number in a row.
#[track_caller]
pub fn cell(row: &BTreeMap<String, String>, column: &str) -> f64 {
    let text = row.get(column).unwrap_or_else(|| panic!("there is no column {column}"));
    text.parse().unwrap_or_else(|_| panic!("{column}: {text} is no number"))
}

/// The words of a command line.
pub fn words(line: &str) -> Vec<&str> {
    line.split_whitespace().collect()
}

/// The program with arguments, to be run in a folder.
pub fn program(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_magnetic-bearing"));
    command.current_dir(folder).args(arguments);
    command
}

/// Runs the program; exit code, standard output and standard error.
pub fn run(folder: &Path, arguments: &[&str]) -> (i32, String, String) {
    decoded(&program(folder, arguments).output().expect("the program runs"))
}

/// Exit code, standard output and standard error.
pub fn decoded(output: &Output) -> (i32, String, String) {
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).expect("UTF-8");
    (output.status.code().expect("an exit code"), text(&output.stdout), text(&output.stderr))
}

/// Runs the program, which must exit with this code; standard output and standard error.
#[track_caller]
pub fn exits(code: i32, folder: &Path, arguments: &[&str]) -> (String, String) {
    let (found, out, err) = run(folder, arguments);
    assert_eq!(found, code, "{arguments:?}: {err}");
    (out, err)
}

/// Runs `identify` with these arguments; the result as JSON.
#[track_caller]
pub fn identified(folder: &Path, arguments: &[&str]) -> Json {
    let (out, _) = exits(0, folder, &[&["identify"], arguments, &["--json", "-"]].concat());
    serde_json::from_str(&out).unwrap_or_else(|why| panic!("{why}: {out}"))
}

/// A number in a result.
#[track_caller]
pub fn number(of: &Json) -> f64 {
    of.as_f64().unwrap_or_else(|| panic!("{of} is no number"))
}

/// An estimate and its total standard deviation.
#[track_caller]
pub fn estimate(of: &Json) -> [f64; 2] {
    ["value", "stdTotal"].map(|name| number(&of[name]))
}

/// The error of an estimate is below this many of its deviations.
#[track_caller]
pub fn is_near(what: &str, estimate: &Estimate, truth: f64, deviations: f64) {
    let error = (estimate.value - truth) / estimate.total_std;
    assert!(error.abs() < deviations, "{what}: {error} standard deviations of {estimate:?}");
}

/// Runs the program, which must refuse the arguments with these words and print nothing on standard output.
#[track_caller]
pub fn refuses(folder: &Path, arguments: &[&str], words: &[&str]) {
    let (out, err) = exits(2, folder, arguments);
    assert_eq!(out, "", "{arguments:?}");
    assert_contains(&err, words);
}

/// Pairs of names, or of a name and a value, as owned strings.
pub fn pairs(pairs: &[(&str, &str)]) -> Vec<(String, String)> {
    pairs.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect()
}

/// A built-in scenario with these changes.
pub fn open(name: &str, changes: &[(&str, &str)]) -> Scenario {
    Scenario::open_with(Path::new(name), &pairs(changes)).unwrap_or_else(|error| panic!("{error}"))
}

/// The run of a scenario to its end.
pub fn run_to_end(scenario: &Scenario) -> Run {
    let run = simulate::run(scenario).expect("sound parameters");
    assert_eq!(run.error, None, "{}", scenario.title);
    run
}

/// A built-in scenario with these changes, and its run to the end.
pub fn scenario_and_run(name: &str, changes: &[(&str, &str)]) -> (Scenario, Run) {
    let scenario = open(name, changes);
    let run = run_to_end(&scenario);
    (scenario, run)
}

/// A signal of a run.
pub fn column<'r>(run: &'r Run, name: &str) -> &'r [f64] {
    run.recording.get(name).unwrap_or_else(|| panic!("there is no {name}"))
}

/// The first row at or after an instant in s.
pub fn row(run: &Run, at_s: f64) -> usize {
    run.recording.time_s.iter().position(|time_s| *time_s >= at_s - 1e-9).expect("the run got there")
}

/// Relative errors of an element's λ̂ at an instant in s, for a rotor between three magnets.
pub fn lambda_errors(scenario: &Scenario, run: &Run, element: &str, at_s: f64) -> [f64; 3] {
    let (truth, row) = (scenario.truth(), row(run, at_s));
    [0, 1, 2].map(|k| column(run, &format!("{element}.lambdaHat[{}]", k + 1))[row] / truth[k] - 1.0)
}

/// The values of a signal over an interval in s.
pub fn values_within(run: &Run, name: &str, from_s: f64, to_s: f64) -> Vec<f64> {
    let pairs = run.recording.time_s.iter().zip(column(run, name));
    pairs.filter(|(time_s, _)| (from_s..=to_s).contains(*time_s)).map(|(_, value)| *value).collect()
}

/// Largest radial tracking error in a bearing over an interval in s, in m.
pub fn error_m(run: &Run, bearing: &str, from_s: f64, to_s: f64) -> f64 {
    let [y, z] = ["Y", "Z"].map(|axis| {
        let reference = values_within(run, &format!("controller.{bearing}reference.{axis}"), from_s, to_s);
        let position = values_within(run, &format!("plant.{bearing}{axis}"), from_s, to_s);
        position.into_iter().zip(reference).map(|(position, reference)| position - reference)
    });
    y.zip(z).map(|(y, z)| y.hypot(z)).fold(0.0, f64::max)
}
