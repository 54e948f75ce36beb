//! Many runs of one scenario with varied values: every case is a row of the design and a row of the result.
//!
//! A design is a CSV table whose columns are variables of the loop, `plant.m` or `plant.m [g]`, and whose rows are cases; or a
//! TOML file that describes how to draw such a table ([`Sweep::open`]). Each row is written and synchronised to disk as soon as
//! its case and all before it are done. An interrupted sweep resumes where it stopped: existing rows are kept, an incomplete last row is
//! discarded.
//!
//! The row of a case that cannot be run, or ends early, states the reason.

use std::collections::{BTreeMap, HashSet};
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::mpsc;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::iter::{ParallelBridge, ParallelIterator};
use serde::Deserialize;
use sha2::{Digest, Sha256};

use crate::progress::Progress;
use crate::simulation::recording::with_unit;
use crate::simulation::scenario::{Element, Scenario, ScenarioError, built_in, leaves, text, text_of};
use crate::simulation::{Run, simulate};

/// Length of the interval at the end of a run over which tracking is judged, in s.
const TRACKING_S: f64 = 0.04;

/// Maximum number of cases of a design; all are held in memory.
const MAX_CASES: usize = 1_000_000;

/// The scenario to vary if none is named.
const DEFAULT_SCENARIO: &str = "unbalanced";

/// The reason why a sweep cannot begin or resume: a finding about a file.
fn refusal(origin: &Path, finding: impl ToString) -> ScenarioError {
    ScenarioError { origin: origin.display().to_string(), findings: vec![finding.to_string()] }
}

/// The outcome of a sweep.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// Rows from an earlier run of the sweep.
    pub before: usize,
    /// Rows of failed cases, including earlier ones.
    pub failed: usize,
}

/// The cases of a sweep.
#[derive(Clone)]
pub struct Sweep {
    /// The scenario to vary, without estimators beside the loop.
    scenario: Scenario,
    /// The text of the scenario.
    scenario_text: String,
    /// Results of each case.
    results: Vec<Indicator>,
    /// Headers of the columns, `element.variable` or `element.variable [unit]`.
    columns: Vec<String>,
    /// Rows with a cell per column; an empty cell keeps the scenario's value.
    cases: Vec<Vec<String>>,
}

/// A design in TOML.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    /// A built-in scenario, or a file relative to this one.
    scenario: Option<String>,
    cases: usize,
    seed: u64,
    sampling: Sampling,
    ranges: toml::Table,
}

#[derive(Clone, Copy, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "camelCase")]
enum Sampling {
    /// The range of each variable is divided into as many equal strata as there are cases; one value is drawn from each.
    LatinHypercube,
    /// Independent draws.
    MonteCarlo,
}

/// Distribution of a variable.
enum Range {
    Between(Between),
    OneOf(Vec<toml::Value>),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Between {
    from: f64,
    to: f64,
    /// Unit of both; by default the unit of the variable.
    unit: Option<String>,
    /// Whether the logarithm is uniformly distributed, not the value.
    #[serde(default)]
    log: bool,
}

impl Sweep {
    /// Reads a design: TOML from a file with this extension, else CSV; `-` is the standard input. `scenario` names the scenario
    /// to vary and takes precedence over the design.
    ///
    /// # Errors
    /// All findings about the design as a whole. Errors of a single case are found when it is run.
    pub fn open(path: &Path, scenario: Option<&Path>) -> Result<Self, ScenarioError> {
        let read = if path == Path::new("-") { io::read_to_string(io::stdin()) } else { fs::read_to_string(path) };
        let text = read.map_err(|error| refusal(path, error))?;
        let (named, design) = if path.extension().is_some_and(|ending| ending == "toml") {
            let document: Document = toml::from_str(&text).map_err(|error| refusal(path, error))?;
            let named = document.scenario.as_deref().map(|name| beside(path, name));
            (named, draw(&document).map_err(|finding| refusal(path, finding))?)
        } else {
            (None, table(&text).map_err(|finding| refusal(path, finding))?)
        };
        let name = scenario.map(PathBuf::from).or(named).unwrap_or_else(|| DEFAULT_SCENARIO.into());
        let scenario_text = text_of(&name)?;
        let mut scenario = Scenario::parse(&name.display().to_string(), &scenario_text)?;
        scenario.remove_compared();
        let Design { columns, bounds, cases } = design;
        let mut names = HashSet::new();
        let finding = |column| {
            let (name, _) = split(column);
            let twice = (!names.insert(name)).then(|| format!("{name} is in the design twice"));
            scenario.settable(name).err().or(twice)
        };
        let mut findings: Vec<String> = columns.iter().map(String::as_str).filter_map(finding).collect();
        if findings.is_empty() {
            // Without ranges each cell is checked when its case is run.
            let units = columns.iter().filter(|column| bounds.is_empty() && split(column).1.is_some());
            let wrong = |column: &String| scenario.clone().assign(split(column).0, &cell_with_unit(column, "1")).err();
            findings.extend(units.filter_map(wrong));
            let within =
                |(column, cell): &(String, String)| scenario.admits(split(column).0, &cell_with_unit(column, cell));
            findings.extend(bounds.iter().filter_map(|bound| within(bound).err()));
        }
        if cases.is_empty() {
            findings.push("the design has no cases".into());
        }
        if !findings.is_empty() {
            return Err(ScenarioError { findings, ..refusal(path, "") });
        }
        Ok(Self { results: results(&scenario), scenario, scenario_text, columns, cases })
    }

    /// Number of cases.
    pub fn count(&self) -> usize {
        self.cases.len()
    }

    /// Writes the design, with the values drawn, as CSV.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn write(&self, mut to: impl Write) -> io::Result<()> {
        to.write_all(&lines(std::iter::once(&self.columns).chain(&self.cases))?)?;
        to.flush()
    }

    /// The header of the result.
    fn header(&self) -> Vec<String> {
        let figures = self.results.iter().map(|result| result.name.clone()).collect();
        let begin = ["case", "seed", "status"].map(String::from).to_vec();
        [begin, figures, vec!["fingerprint".into()], self.columns.clone()].concat()
    }

    /// Identifies a case and its design.
    fn fingerprint(&self, case: usize) -> String {
        let mut hash = Sha256::new();
        hash.update(self.scenario_text.as_bytes());
        for text in self.columns.iter().zip(&self.cases[case]).flat_map(|(column, cell)| [column, cell]) {
            hash.update([0]);
            hash.update(text);
        }
        hash.finalize().iter().take(6).map(|byte| format!("{byte:02x}")).collect()
    }

    /// The scenario of a case.
    fn scenario(&self, case: usize) -> Result<Scenario, String> {
        let mut scenario = self.scenario.clone();
        for (column, cell) in self.columns.iter().zip(&self.cases[case]) {
            if !cell.trim().is_empty() {
                scenario.assign(split(column).0, &cell_with_unit(column, cell.trim()))?;
            }
        }
        Ok(scenario)
    }

    /// Runs a case and returns its row.
    fn row(&self, case: usize) -> Vec<String> {
        let scenario = self.scenario(case);
        let seed = scenario.as_ref().ok().and_then(|scenario| scenario.value("plant", "sensor.seed"));
        let seed = seed.map_or(String::new(), |seed| seed.as_f64().to_string());
        let wanted = |name: &str| self.results.iter().any(|result| result.source == name);
        let outcome = scenario.and_then(|scenario| {
            let run = || simulate::check_rates(&scenario).and_then(|()| simulate::run_for(&scenario, wanted));
            match catch_unwind(AssertUnwindSafe(run)) {
                Ok(Ok(run)) => Ok((scenario, run)),
                Ok(Err(refused)) => Err(refused.0.join("; ")),
                Err(_) => Err("a defect of this program, please report it".into()),
            }
        });
        let (status, figures) = match outcome {
            Ok((scenario, run)) => {
                let figures = self.results.iter().map(|result| result.of(&scenario, &run)).collect();
                (run.error.unwrap_or_else(|| "ok".into()), figures)
            }
            Err(why) => (why, vec![String::new(); self.results.len()]),
        };
        let begin = vec![(case + 1).to_string(), seed, status.replace('\n', " ")];
        [begin, figures, vec![self.fingerprint(case)], self.cases[case].clone()].concat()
    }

    /// Runs the cases that have no row in `path` yet.
    ///
    /// # Errors
    /// If the file cannot be read or written, is not a regular file, belongs to another design, or is in use by another sweep.
    pub fn run(&self, path: &Path) -> Result<Outcome, ScenarioError> {
        let fail = |error: io::Error| refusal(path, error);
        // Devices have no rows to resume from, and reading some never ends.
        if fs::metadata(path).is_ok_and(|metadata| !metadata.is_file()) {
            return Err(refusal(path, "it is not a regular file; name one, or - for the standard output"));
        }
        let mut file = OpenOptions::new().read(true).append(true).create(true).open(path).map_err(fail)?;
        if file.try_lock().is_err() {
            return Err(refusal(path, "another sweep is using it"));
        }
        let outcome = self.append(path, &mut file);
        // A process that another thread is starting holds a copy of the file, and thereby the lock, until it has replaced itself.
        file.unlock().map_err(fail)?;
        outcome
    }

    /// Appends the rows that are missing.
    fn append(&self, path: &Path, file: &mut File) -> Result<Outcome, ScenarioError> {
        let done = self.resume(path, file)?;
        let write = |rows: &[Vec<String>]| {
            file.write_all(&lines(rows)?)?;
            file.sync_data()
        };
        let outcome = self.work(done.before, write).map_err(|error| refusal(path, error))?;
        Ok(Outcome { failed: done.failed + outcome.failed, ..outcome })
    }

    /// Runs all cases.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn run_to(&self, mut to: impl Write) -> io::Result<Outcome> {
        to.write_all(&lines(&[self.header()])?)?;
        self.work(0, |rows| {
            to.write_all(&lines(rows)?)?;
            to.flush()
        })
    }

    /// Runs all cases but the first `before` in the thread pool and passes each row on as soon as all earlier ones are done.
    fn work(&self, before: usize, mut write: impl FnMut(&[Vec<String>]) -> io::Result<()>) -> io::Result<Outcome> {
        let progress = Progress::new("sweeping", (self.count() - before) as u64);
        let (sender, done) = mpsc::channel();
        rayon::in_place_scope(move |scope| {
            // If writing fails, the receiver is dropped, and no further case is started.
            let send = |sender: &mut mpsc::Sender<_>, case| sender.send((case, self.row(case)));
            scope.spawn(move |_| drop((before..self.count()).par_bridge().try_for_each_with(sender, send)));
            let (mut waiting, mut next, mut failed) = (BTreeMap::new(), before, 0);
            while let Ok(row) = done.recv() {
                // Rows that have arrived in the meantime are written with it.
                waiting.extend([row].into_iter().chain(done.try_iter()));
                let rows: Vec<Vec<String>> = (next..).map_while(|case| waiting.remove(&case)).collect();
                write(&rows)?;
                (next, failed) = (next + rows.len(), failed + failures(&rows));
                progress.tell((next - before) as u64);
            }
            Ok(Outcome { before, failed })
        })
    }

    /// Reads the rows of an earlier run, or writes the header if there are none.
    fn resume(&self, path: &Path, file: &mut File) -> Result<Outcome, ScenarioError> {
        let fail = |error: io::Error| refusal(path, error);
        let text = fs::read(path).map_err(fail)?;
        let foreign = |finding: String| refusal(path, format!("{finding}; name another file with --out"));
        let header = lines(&[self.header()]).map_err(fail)?;
        if !text.starts_with(&header) && !header.starts_with(&text) {
            return Err(foreign("it has other columns, or no rows of a sweep at all".into()));
        }
        // A row is complete only with its line break.
        let whole = text.iter().rposition(|byte| *byte == b'\n').map_or(0, |at| at + 1);
        file.set_len(whole as u64).map_err(fail)?;
        if whole == 0 {
            file.write_all(&header).map_err(fail)?;
            file.sync_all().map_err(fail)?;
        }
        let rows = csv::Reader::from_reader(&text[..whole]).into_deserialize().collect::<Result<Vec<Vec<String>>, _>>();
        let rows = rows.map_err(|error| refusal(path, error))?;
        let at = self.header().iter().position(|name| name == "fingerprint").unwrap_or_default();
        let is_other = |(case, row): &(usize, &Vec<String>)| {
            *case >= self.count() || row[0] != (case + 1).to_string() || row[at] != self.fingerprint(*case)
        };
        match rows.iter().enumerate().find(is_other) {
            Some((case, _)) => Err(foreign(format!("row {} in it is of another design or scenario", case + 1))),
            None => Ok(Outcome { before: rows.len(), failed: failures(&rows) }),
        }
    }
}

/// The number of cases that could not be run, or ended early.
fn failures(rows: &[Vec<String>]) -> usize {
    rows.iter().filter(|row| row[2] != "ok").count()
}

/// A result of a run.
#[derive(Clone)]
struct Indicator {
    /// Header of its column.
    name: String,
    /// The output from which it is computed, as `element.variable`.
    source: String,
    /// The magnet, counted from 0, that must be in use.
    magnet: Option<usize>,
    quantity: Quantity,
}

/// Number computed from an output.
#[derive(Clone)]
enum Quantity {
    /// The last value.
    Last,
    /// `λ̂/λ − 1`, with the name of λ.
    Error(String),
    /// The largest magnitude at the end of the run.
    Tracking,
}

/// The result columns of a machine, after case, seed and status.
fn results(scenario: &Scenario) -> Vec<Indicator> {
    let machine = scenario.machine;
    let unit = |element: &Element, name: &str| {
        element.index(name).map_or("", |index| element.model_type.variables()[index].unit_name())
    };
    let last = |name: String| {
        let (source, unit) = (format!("estimator.{name}"), unit(scenario.estimator(), &name));
        Indicator { name: with_unit(name, unit), source, magnet: None, quantity: Quantity::Last }
    };
    let of_magnet = |(k, name): (usize, String)| Indicator { magnet: Some(k), ..last(name) };
    let error = |((k, name), truth): ((usize, String), String)| {
        let source = format!("estimator.{}", truth.replace("lambda", "lambdaHat"));
        Indicator { name, source, magnet: Some(k), quantity: Quantity::Error(truth) }
    };
    let tracking = |(name, error): (String, String)| {
        let name = with_unit(name.replace("reference.", "tracking."), unit(scenario.controller(), &error));
        Indicator { name, source: format!("controller.{error}"), magnet: None, quantity: Quantity::Tracking }
    };
    let of_magnets = |name: &str| machine.of_magnets(name).into_iter().enumerate();
    let estimates = [machine.of_planes("magnitude"), machine.of_planes("phase"), machine.of_loads("p", "Hat")].concat();
    [last("valid".into())]
        .into_iter()
        .chain(of_magnets("lambdaHat").chain(of_magnets("lambdaStd")).map(of_magnet))
        .chain(of_magnets("error").zip(machine.of_magnets("lambda")).map(error))
        .chain(["condition", "residual"].map(String::from).into_iter().chain(estimates).map(last))
        .chain(machine.of_references().into_iter().zip(machine.of_readings("e")).map(tracking))
        .collect()
}

impl Indicator {
    /// The result as text that reads back exactly; empty if there is none.
    fn of(&self, scenario: &Scenario, run: &Run) -> String {
        let column = run.recording.get(&self.source).unwrap_or(&[]);
        let last = column.last().copied();
        let value = match &self.quantity {
            Quantity::Last => last,
            Quantity::Error(truth) => last.zip(scenario.real(truth)).map(|(hat, truth)| hat / truth - 1.0),
            Quantity::Tracking => {
                let points = (TRACKING_S / scenario.step_s).round() as usize;
                column.iter().rev().take(points).map(|error| error.abs()).reduce(f64::max)
            }
        };
        let is_used = self.magnet.is_none_or(|k| scenario.uses(k));
        value.filter(|_| is_used).map_or(String::new(), |value| format!("{value:e}"))
    }
}

/// A file relative to the folder of another, unless it is a built-in scenario.
fn beside(path: &Path, name: &str) -> PathBuf {
    let is_built_in = built_in(Path::new(name)).is_some();
    if is_built_in { name.into() } else { path.parent().unwrap_or(Path::new("")).join(name) }
}

/// `plant.m [g]` as the path and the unit.
fn split(column: &str) -> (&str, Option<&str>) {
    match column.trim().strip_suffix(']').and_then(|text| text.rsplit_once(" [")) {
        Some((path, unit)) => (path.trim(), Some(unit.trim())),
        None => (column.trim(), None),
    }
}

/// A cell with its unit, which is that of the column unless it has its own.
fn cell_with_unit(column: &str, cell: &str) -> String {
    match split(column).1 {
        Some(unit) if cell.parse::<f64>().is_ok() => format!("{cell} {unit}"),
        _ => cell.to_owned(),
    }
}

/// A design as a table.
struct Design {
    columns: Vec<String>,
    /// Columns and cells that bound those drawn.
    bounds: Vec<(String, String)>,
    cases: Vec<Vec<String>>,
}

/// The cells of a CSV table.
fn table(text: &str) -> Result<Design, csv::Error> {
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).trim(csv::Trim::All).from_reader(text.as_bytes());
    let columns = reader.headers()?.iter().map(String::from).collect();
    Ok(Design { columns, bounds: Vec::new(), cases: reader.deserialize().collect::<Result<_, _>>()? })
}

/// Draws the cases of a design.
fn draw(document: &Document) -> Result<Design, String> {
    if document.cases > MAX_CASES {
        return Err(format!("cases = {} is refused: expected at most {MAX_CASES}", document.cases));
    }
    let mut random = Pcg64::seed_from_u64(document.seed);
    let (mut columns, mut bounds) = (Vec::new(), Vec::new());
    let mut cases = vec![Vec::new(); document.cases];
    for (path, range) in leaves(&document.ranges, &|inner| inner.contains_key("from")) {
        let wanted = "expected { from = …, to = … }, with unit and log if they are wanted, a list, or a value";
        let refused = |_| format!("{path} = {range} is refused: {wanted}");
        let range = match range.clone() {
            toml::Value::Array(items) => Range::OneOf(items),
            table @ toml::Value::Table(_) => Range::Between(table.try_into().map_err(refused)?),
            value => Range::OneOf(vec![value]),
        };
        let (unit, ends) = match &range {
            Range::Between(Between { from, to, log, unit }) => {
                if !(from.is_finite() && to.is_finite() && from <= to) || (*log && *from <= 0.0) {
                    return Err(format!("{path}: expected finite ends, from below to, and above 0 if log = true"));
                }
                (unit.as_ref(), [from, to].map(|end| format!("{end:e}")).to_vec())
            }
            Range::OneOf(items) => (None, items.iter().map(text).collect()),
        };
        let mut strata: Vec<usize> = (0..document.cases).collect();
        // Fisher–Yates.
        for at in (1..strata.len()).rev() {
            strata.swap(at, random.random_range(0..=at));
        }
        for (case, stratum) in cases.iter_mut().zip(strata) {
            let uniform: f64 = random.random();
            let share = match document.sampling {
                Sampling::LatinHypercube => (stratum as f64 + uniform) / document.cases as f64,
                Sampling::MonteCarlo => uniform,
            };
            case.push(match &range {
                Range::Between(Between { from, to, log, .. }) => {
                    let value = if *log { from * libm::pow(to / from, share) } else { from + (to - from) * share };
                    format!("{value:e}")
                }
                Range::OneOf(items) => {
                    let item = items.get(((share * items.len() as f64) as usize).min(items.len().saturating_sub(1)));
                    text(item.ok_or_else(|| format!("{path}: the list is empty"))?)
                }
            });
        }
        let column = unit.map_or(path.clone(), |unit| format!("{path} [{unit}]"));
        bounds.extend(ends.into_iter().map(|end| (column.clone(), end)));
        columns.push(column);
    }
    // Every case gets its own noise.
    if !columns.iter().any(|column| split(column).0 == "plant.sensor.seed") {
        columns.push("plant.sensor.seed".into());
        for case in &mut cases {
            case.push(random.random_range(0..i32::MAX).to_string());
        }
    }
    Ok(Design { columns, bounds, cases })
}

/// Rows as lines of CSV.
fn lines<'r>(rows: impl IntoIterator<Item = &'r Vec<String>>) -> io::Result<Vec<u8>> {
    let mut writer = csv::WriterBuilder::new().flexible(true).from_writer(Vec::new());
    for row in rows {
        writer.write_record(row)?;
    }
    writer.into_inner().map_err(|error| error.into_error())
}
