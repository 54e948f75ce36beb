//! The command `identify`: its arguments, and the steps from recordings to results.

mod axial;
mod machine;
mod twin;

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use clap::Args;
use clap::builder::PossibleValuesParser;
use fmu_export::variable::Value;
use serde_json::json;

use super::{
    DIFFERS, Failure, NOT_VALID, OF_CURRENTS, OF_POSITIONS, Result, SPEED, TIME, above_0, claim, from_0, number, pair,
    print, refused, say, write, write_json, write_page, write_table,
};
use crate::estimation::{Hold, Method};
use crate::machine::{AXIAL, MACHINES, Machine};
use crate::output::{self, Format};
use crate::report::frame;
use crate::report::identification::{self, Results};
use crate::simulation::scenario::OF_COLUMN;
use crate::simulation::{Element, Pair, Scenario, simulate};
use crate::studies::identify::likelihood::Knowledge;
use crate::studies::identify::{self, Answer, Check, Currents, Holds, Question, Reading, Rotation, Samples, Stated};
use crate::variables::Choice;

/// Points in plots and tables; the CSV file has all of them.
const SHOWN: usize = 4000;
/// The method for a whole recording.
const LIKELIHOOD: &str = "likelihood";
/// The on-line method of every machine.
const PREDICTION_ERROR: &str = "predictionError";
/// Value of `--method` for all on-line methods.
const ALL: &str = "all";
/// Names with their values.
type Pairs = Vec<Pair>;
/// Value of `--hold` that lets the data decide.
const AUTO: &str = "auto";
/// Name of the slow force among the parameters to estimate.
const SLOW_FORCE: &str = "force.slow";

#[derive(Args)]
pub struct Arguments {
    /// The recordings, or - for the standard input, in UTF-8, UTF-16 or Windows-1252, plain or compressed by gzip: columns separated by comma, semicolon
    /// or tab; with the latter two, decimal commas are understood. Several recordings show one bearing at other speeds,
    /// loads or reference trajectories: they share the parameters of the bearing and its bench.
    #[arg(value_name = "RECORDING", required = true)]
    recordings: Vec<PathBuf>,
    /// The currents in a separate table, with times from the same clock, at any rate.
    #[arg(long, value_name = "FILE.csv")]
    currents: Option<PathBuf>,
    /// Assigns a column: signal as in the interface = name in the header. Also as a table [columns] in the scenario.
    #[arg(long, value_name = "SIGNAL=COLUMN", value_parser = pair)]
    column: Vec<Pair>,
    /// Assigns a unit: signal as in the interface = unit. Known are s, ms, µs, ns; m, mm, µm (um), nm, mil; A, mA; rad, deg
    /// (°), rev; rad/s, rpm (1/min, U/min, min-1), Hz, deg/s; or the calibration of a sensor: 25um/V, 7.87V/mm, or 0.3um for each count.
    #[arg(long, value_name = "SIGNAL=UNIT", value_parser = pair)]
    unit: Vec<Pair>,
    /// Reading of a column that stands for 0, in the unit of the column: of a position sensor, that in the centre.
    #[arg(long, value_name = "SIGNAL=READING", value_parser = pair)]
    zero: Vec<Pair>,
    /// Sample rate, as in 10kHz, for recordings without times; if there are times, they must agree.
    #[arg(long, value_name = "RATE", value_parser = identify::rate_s, conflicts_with = "step")]
    rate: Option<f64>,
    /// Sample time, as in 100us, instead of --rate; seconds if there is no unit.
    #[arg(long, value_name = "TIME", value_parser = above_0(TIME))]
    step: Option<f64>,
    /// Scenario whose estimator has the parameters of the machine: a file or a built-in scenario; by default unbalanced, and for other
    /// machines than planar the built-in one with the name of the machine. A file needs no title, duration and step.
    #[arg(long, value_name = "SCENARIO")]
    scenario: Option<PathBuf>,
    /// The machine: planar (a rotor in a bearing with three magnets; the default), planar4 (with four), spindle or spindle4 (a shaft in two radial bearings
    /// with three or four magnets, and an axial one), or axial (one axis between one or two magnets). A scenario may name it as well.
    #[arg(long, value_name = "MACHINE", value_parser = MACHINES.map(|machine| machine.name))]
    machine: Option<String>,
    /// Machine axial: position at which the answer is linearised, as in Xm=10mm; the mean of the recording by default.
    #[arg(long, value_name = "Xm=VALUE", value_parser = pair)]
    at: Option<Pair>,
    /// Another recording of the same bench, judged with the estimate: whether its own agrees, and prediction errors of both, one sample and
    /// 20 ms ahead. If it does not agree, or cannot be compared, the exit code is 4.
    #[arg(long, value_name = "FILE")]
    check: Option<PathBuf>,
    /// Writes the twin of the bench as a scenario for simulate and identify: plant, controller and estimator with the estimate.
    #[arg(long, value_name = "FILE.toml")]
    save: Option<PathBuf>,
    /// Writes the parameters of the twin as a parameter set (SSV) for a system of these FMUs, with names such as plant.m.
    #[arg(long, value_name = "FILE.ssv")]
    ssv: Option<PathBuf>,
    /// Writes the twin as a system of FMUs (SSP) with a parameter set "identified": plant, controller and estimator, wired.
    #[arg(long, value_name = "FILE.ssp")]
    ssp: Option<PathBuf>,
    /// Changes a parameter of the bearing, as for simulate (can be repeated): s=5.1e-4, m=4.2kg, alpha[1]=178deg; or states a load that is known, as in
    /// pY=-65.7N.
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = pair)]
    changes: Vec<Pair>,
    /// likelihood (maximum likelihood over the whole recording; the default), or an on-line method to compare with: predictionError, of the machine planar
    /// paperLiteral and paper as well, or all.
    #[arg(long, value_name = "METHOD", value_parser = names::<Method>(&[LIKELIHOOD, ALL]), hide_possible_values = true, default_value = LIKELIHOOD, hide_default_value = true)]
    method: String,
    /// Standard deviation of a parameter of the bench, with its unit: s=2%, s=10um, m=0.05kg, alpha=1deg,
    /// sensor.offset=5um, sensor.gain=0.5%, current.gain=0.5%, delay=20us (can be repeated; also as a table [tolerance] in
    /// the scenario); of an axis also of its load: pX=5mN. The parameter is then estimated as well. NAME=typical is that of a typical bench, all=typical
    /// gives every parameter its own.
    #[arg(long = "tolerance", value_name = "NAME=VALUE", value_parser = pair)]
    tolerances: Vec<Pair>,
    /// A parameter of the bench of which nothing is known, to be estimated as well (can be repeated); or force.slow, a force that wanders, whatever the
    /// likelihood says (--set force.slow=0: never); or dynamics, the factor between statics and dynamics, with a load that is known (--set pY=…); or
    /// lag, the time constant with which the currents follow their commands; or noise.exponent, the power of the gap with which the noise of the positions grows.
    #[arg(long = "estimate", value_name = "NAME")]
    estimates: Vec<String>,
    /// Meaning of a current sample: heldBefore (measured), heldAfter (commanded), linear, or auto to find out from the data: heldBefore
    /// unless another one is more likely; of an axis, linear. A lag behind commands, and a delay of the positions of which nothing is stated, are found as well.
    #[arg(long, value_name = "HOLD", value_parser = names::<Hold>(&[AUTO]), hide_possible_values = true, default_value = AUTO)]
    hold: String,
    /// Length of the window, as in 20ms; one revolution by default.
    #[arg(long, value_name = "TIME", value_parser = above_0(TIME), allow_hyphen_values = true)]
    window: Option<f64>,
    /// Speed in rpm, for recordings without angle and speed.
    #[arg(long, value_name = "RPM", value_parser = rpm, allow_hyphen_values = true)]
    speed: Option<f64>,
    /// Standard deviation of the position noise, as in 0.1um; estimated from the data by default.
    #[arg(long, value_name = "LENGTH", value_parser = from_0(OF_POSITIONS), allow_hyphen_values = true)]
    position_noise: Option<f64>,
    /// Standard deviation of the current noise, as in 10mA; estimated from the data by default.
    #[arg(long, value_name = "CURRENT", value_parser = from_0(OF_CURRENTS), allow_hyphen_values = true)]
    current_noise: Option<f64>,
    /// Interpolates a recording without a uniform sample time to this one, as in 100us; seconds if there is no unit.
    #[arg(long, value_name = "TIME", value_parser = above_0(TIME), conflicts_with_all = ["rate", "step"])]
    resample: Option<f64>,
    /// Writes the estimates over time as CSV, of an axis the prediction errors and the slow force; - is the standard output, as for --json.
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Writes the result as JSON; - is the standard output, and messages then go to the standard error.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Writes a report page, index.html, into this folder.
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
}

/// Identifies the bearing, and prints and writes the results.
pub fn run(arguments: &Arguments) -> Result<()> {
    arguments.claim()?;
    let machine = arguments.machine();
    let binaries = arguments.binaries()?;
    let is_axial = *machine == AXIAL;
    let (results, scenario) = if is_axial { axial::identify(arguments) } else { arguments.identify(machine) }?;
    print_results(&results, &arguments.recordings);
    arguments.write(&results)?;
    if let Some(why) = &results.not_valid {
        let twin = if arguments.wants_twin() { " The twin was not written." } else { "" };
        return Err(Failure { code: NOT_VALID, why: format!("{why}{twin}") }.into());
    }
    if arguments.wants_twin() {
        let twin = results.twin(&scenario);
        let twin = twin.map_err(|why| refused(format!("the twin cannot be run:\n  {}", why.join("\n  "))))?;
        arguments.write_twin(twin, arguments.columns(&scenario), binaries.as_ref())?;
    }
    results.differs.map_or(Ok(()), |why| Err(Failure { code: DIFFERS, why }.into()))
}

impl Arguments {
    /// Identifies a bearing by maximum likelihood from all recordings, and on line from the first. Also returns the scenario.
    fn identify(&self, machine: &'static Machine) -> Result<(Results, Scenario)> {
        let method = self.method.as_str();
        let bearing = self.bearing(machine)?;
        let mut stated = self.stated(&bearing)?;
        // The data decide if none is stated.
        let wanted = self.hold();
        // Currents lag behind commands.
        let wanted = wanted.or(stated.currents().lag.then_some(Hold::HeldAfter));
        stated.hold = wanted.unwrap_or(stated.hold);
        if stated.currents() == (Currents { hold: Hold::Linear, lag: true }) {
            return Err(refused("lag: expected held currents, --hold heldAfter or heldBefore"));
        }
        let reading = self.reading(&bearing, None);
        let gap_m: Vec<f64> = machine.of_bearings("s").iter().map(|name| bearing.number("estimator", name)).collect();
        let (recordings, checked) = self.read_all(&reading, &gap_m)?;
        let samples = &recordings[0];
        let mut estimator = bearing.estimator().clone();
        self.complete(&mut estimator, samples);
        // A stated hold is compared with the others as well if the answer depends on it.
        let is_compared = if method == LIKELIHOOD { samples.rotation != Rotation::Unknown } else { wanted.is_none() };
        let holds = is_compared.then(|| Holds::of(samples, &stated));
        if let (None, Some(holds)) = (wanted, holds) {
            stated = stated.read_as(holds.most_likely());
        }
        let currents = stated.currents();
        estimator.set("hold", Value::Integer(currents.hold.number()));

        let every = if method == LIKELIHOOD && self.csv.is_none() { samples.len().div_ceil(SHOWN) } else { 1 };
        let on_line = || {
            let track = |method: Method| {
                estimator.set("method", Value::Integer(method.number()));
                identify::track(samples, &estimator, every)
            };
            // With maximum likelihood the default method shows drift.
            let shown = if method == LIKELIHOOD { PREDICTION_ERROR } else { method };
            let methods = Method::all().filter(|method| [method.name(), ALL].contains(&shown));
            methods.map(track).collect::<Result<Vec<_>, _>>()
        };
        let equally_likely =
            holds.filter(|_| wanted.is_none()).map_or_else(Vec::new, |holds| holds.equally_likely(currents));
        let question = Question { stated, holds, equally_likely, slow_force: self.slow_force() };
        let whole = || (method == LIKELIHOOD).then(|| identify::answer(&recordings, question));
        let (tracks, answer) = rayon::join(on_line, whole);
        let tracks = tracks.map_err(refused)?;
        let mut statement = answer.as_ref().map_or_else(|| identify::statement(samples, &tracks), Answer::statement);
        if answer.is_some() && samples.rotation != Rotation::Unknown {
            statement.tables.extend(tracks[0].progress());
        }
        statement.tables.splice(..0, holds.and_then(|holds| holds.table(currents)));
        let not_valid = (statement.valid == Some(false)).then(|| statement.verdict.clone());
        let (document, statements) = (statement.json.clone(), vec![statement]);
        let mut results = Results { recordings, tracks, statements, answer, document, not_valid, ..Results::default() };
        if let (Some(samples), Some(answer)) = (checked, &results.answer) {
            let check = answer.check(&results.recordings[0], &samples);
            self.add_check(&mut results, check);
        }
        Ok((results, bearing))
    }

    /// Adds the comparison with another recording.
    fn add_check(&self, results: &mut Results, check: Result<Check, String>) {
        let path = self.check.as_deref().unwrap_or(Path::new("")).display();
        let (agrees, verdict, json) = match check {
            Ok(check) => (check.agrees, format!("{path}: {}", check.verdict), check.json()),
            Err(why) => {
                let json = json!({"agrees": null, "verdict": why, "predictions": []});
                (false, format!("{path}: Not compared: {why}."), json)
            }
        };
        results.differs = (!agrees).then(|| verdict.clone());
        results.summary.push(verdict);
        results.document["check"] = json;
    }

    /// Checks that the results can be written without overwriting a recording.
    fn claim(&self) -> Result<()> {
        let page = self.report.as_ref().map(|folder| folder.join("index.html"));
        claim(&[
            ("--csv", self.csv.as_deref(), Format::Table),
            ("--json", self.json.as_deref(), Format::Json),
            ("--save", self.save.as_deref(), Format::Scenario),
            ("--ssv", self.ssv.as_deref(), Format::Parameters),
            ("--ssp", self.ssp.as_deref(), Format::System),
            ("--report", page.as_deref(), Format::Page),
        ])?;
        let same = |one: &Path, other: &Path| {
            one.canonicalize().is_ok_and(|one| other.canonicalize().is_ok_and(|other| one == other))
        };
        match &self.csv {
            Some(path) if self.recordings.iter().chain(&self.currents).any(|recording| same(path, recording)) => {
                Err(refused(format!("--csv {}: this is the recording", path.display())))
            }
            _ => Ok(()),
        }
    }

    /// The bearing, prior knowledge of its bench, known loads and effects to estimate: from the scenario, then from the arguments.
    fn stated(&self, bearing: &Scenario) -> Result<Stated> {
        simulate::check(bearing)?;
        let mut stated = Stated::of(bearing.machine, bearing.estimator());
        stated.noise = [self.position_noise, self.current_noise].map(Option::unwrap_or_default);
        let mut wrong = Vec::new();
        for (name, value) in self.loads(bearing.machine).0 {
            let load = identify::quantity(&name, &value, "N").map_err(|why| format!("--set {why}"));
            noted(load, &mut wrong).into_iter().for_each(|load| stated.set_load(&name, load));
        }
        let mut estimates = self.estimates.iter().filter(|name| *name != SLOW_FORCE).collect::<Vec<_>>();
        let tolerances = || bearing.tolerance.iter().chain(&self.tolerances);
        for name in tolerances().map(|(name, _)| name).chain(estimates.iter().copied()) {
            noted(stated.ask(name), &mut wrong);
        }
        estimates.retain(|name| !name.ends_with(identify::NOISE_EXPONENT));
        for (at, std) in identify::of_estimator(&stated, bearing.estimator()) {
            stated.know(at, Knowledge::Tolerance(std));
        }
        for (name, value) in tolerances() {
            for (at, std) in noted(identify::tolerance(name, value, &stated), &mut wrong).into_iter().flatten() {
                stated.know(at, Knowledge::Tolerance(std));
            }
        }
        for name in estimates {
            for at in noted(identify::named(&stated.parameters(), name), &mut wrong).into_iter().flatten() {
                stated.know(at, Knowledge::Free);
            }
        }
        report_errors(&wrong)?;
        Ok(stated)
    }

    /// Whether to estimate a slow force; if not stated, the likelihood decides.
    fn slow_force(&self) -> Option<bool> {
        let is_off = self.changes.iter().any(|(name, _)| name == SLOW_FORCE);
        let is_estimated = self.estimates.iter().any(|name| name == SLOW_FORCE);
        (is_off || is_estimated).then_some(is_estimated)
    }

    /// Columns of the recordings, as in a scenario; options override it.
    fn columns(&self, scenario: &Scenario) -> Pairs {
        let mut columns = scenario.columns.clone();
        for (end, options) in OF_COLUMN.iter().zip([&self.column, &self.unit, &self.zero]) {
            for (signal, value) in options {
                let name = format!("{signal}{end}");
                columns.retain(|(stated, _)| *stated != name);
                columns.push((name, value.clone()));
            }
        }
        columns
    }

    /// How to read recordings of a machine, with the currents of these magnets or else of all.
    fn reading(&self, scenario: &Scenario, magnets: Option<Vec<usize>>) -> Reading {
        let columns = self.columns(scenario);
        let stated = |end: &str| {
            let of = |(name, value): &Pair| Some((name.strip_suffix(end)?.to_owned(), value.clone()));
            columns.iter().filter_map(of).collect()
        };
        Reading {
            machine: scenario.machine,
            is_stated: self.machine.is_some() || self.scenario.is_some(),
            magnets,
            columns: stated(OF_COLUMN[0]),
            units: stated(OF_COLUMN[1]),
            zeros: stated(OF_COLUMN[2]),
            omega_rad_s: self.speed.map(|rpm| rpm * std::f64::consts::PI / 30.0),
            rate_s: self.rate.or(self.step),
            resample_s: self.resample,
        }
    }

    /// Reads all recordings, and the one to check. The errors of all are reported together.
    fn read_all(&self, reading: &Reading, gap_m: &[f64]) -> Result<(Vec<Samples>, Option<Samples>)> {
        let mut unusable = Vec::new();
        let mut read = |path| {
            let read = self.read(path, reading, gap_m);
            read.map_err(|findings| unusable.push((path, findings))).ok()
        };
        let all: Vec<_> = self.recordings.iter().filter_map(|path| Some((path.as_path(), read(path)?))).collect();
        let checked = self.check.as_deref().and_then(read);
        // Readings that occur twice would count twice.
        for (at, (path, samples)) in all.iter().enumerate() {
            if let Some((other, _)) = all[..at].iter().find(|(_, other)| other.has_readings_of(samples)) {
                let why = format!("this recording is given twice: its readings are those of {}", other.display());
                unusable.push((path, vec![why]));
            }
        }
        let all = all.into_iter().map(|(_, samples)| samples).collect();
        if unusable.is_empty() { Ok((all, checked)) } else { Err(self.refused(unusable)) }
    }

    /// Reads a recording of bearings with these gaps.
    ///
    /// # Errors
    /// All reasons why it cannot be used, signs of misread units among them.
    fn read(&self, path: &Path, reading: &Reading, gap_m: &[f64]) -> Result<Samples, Vec<String>> {
        let samples = match &self.currents {
            None => Samples::read(open(path)?, reading),
            Some(apart) => Samples::read_apart(open(path)?, open(apart)?, reading),
        };
        let samples = samples.map_err(|unusable| unusable.0)?;
        let findings = samples.implausible(gap_m);
        if findings.is_empty() { Ok(samples) } else { Err(findings) }
    }

    /// The error for unusable recordings; written as JSON as well if that goes to the standard output.
    fn refused(&self, unusable: Vec<(&Path, Vec<String>)>) -> Box<dyn std::error::Error> {
        if let Some(json) = self.json.as_deref().filter(|json| output::is_standard(json)) {
            let paths = unusable.iter().map(|(path, _)| path.display().to_string()).collect::<Vec<_>>().join(", ");
            let which = if unusable.len() > 1 { "recordings" } else { "recording" };
            let verdict = format!("{paths}: the {which} cannot be used");
            let findings: Vec<_> = unusable.iter().flat_map(|(_, findings)| findings).collect();
            let document = json!({"valid": false, "verdict": verdict, "findings": findings});
            if let Err(error) = write_json(json, &document) {
                return error;
            }
        }
        let words = |(path, findings): (&Path, _)| format!("{}: {}", path.display(), identify::Unusable(findings));
        refused(unusable.into_iter().map(words).collect::<Vec<_>>().join("\n"))
    }

    /// Writes the requested files.
    fn write(&self, results: &Results) -> Result<()> {
        if let Some(path) = &self.csv {
            let of_axis = results.axes.first().map(|axis| axis.recording());
            write_table(path, &of_axis.unwrap_or_else(|| identify::recording(&results.tracks)))?;
        }
        if let Some(path) = &self.json {
            let mut document = results.document.clone();
            document["notes"] = results.recordings.iter().flat_map(|samples| samples.notes.clone()).collect();
            write_json(path, &document)?;
        }
        if let Some(folder) = &self.report {
            let recording = self.recordings[0].file_name().unwrap_or_default().to_string_lossy();
            let title = format!("Identification from {recording}");
            write_page(folder, &identification::page(&title, &frame::command_line(), results))?;
        }
        Ok(())
    }

    /// The stated meaning of the currents, if any.
    fn hold(&self) -> Option<Hold> {
        Hold::all().find(|hold| hold.name() == self.hold)
    }

    /// Sets window and noise of the estimator.
    fn complete(&self, estimator: &mut Element, samples: &Samples) {
        let window_s = match self.window {
            Some(window_s) => (window_s / samples.step_s).round() * samples.step_s,
            None => identify::one_revolution(samples),
        };
        for (name, value) in [
            ("Tf", window_s),
            ("epsilon", window_s),
            ("sensor.positionNoise", self.position_noise.unwrap_or(0.0)),
            ("sensor.currentNoise", self.current_noise.unwrap_or(0.0)),
        ] {
            estimator.set(name, Value::Real(value));
        }
    }
}

/// Takes note of an error.
fn noted<T>(result: Result<T, String>, wrong: &mut Vec<String>) -> Option<T> {
    result.map_err(|why| wrong.push(why)).ok()
}

/// Fails with all errors, if there are any.
fn report_errors(wrong: &[String]) -> Result<()> {
    if wrong.is_empty() { Ok(()) } else { Err(refused(wrong.join("\n  "))) }
}

fn rpm(text: &str) -> Result<f64, String> {
    let [what, si] = SPEED;
    number(text, si).ok_or_else(|| format!("expected {what}, negative against the angle"))
}

/// The names of all items and further words, as the values of an option.
fn names<T: Choice>(more: &[&'static str]) -> PossibleValuesParser {
    T::all().map(T::name).chain(more.iter().copied()).collect::<Vec<_>>().into()
}

fn open(path: &Path) -> Result<Box<dyn io::Read>, Vec<String>> {
    if output::is_standard(path) {
        return Ok(Box::new(io::stdin().lock()));
    }
    let file = fs::File::open(path).map_err(|error| vec![format!("{}: {error}", path.display())])?;
    Ok(Box::new(file))
}

fn print_results(results: &Results, paths: &[PathBuf]) {
    let is_each = results.statements.len() > 1;
    for (path, samples) in paths.iter().zip(&results.recordings) {
        say!("{}", path.display());
        for note in &samples.notes {
            say!("  {note}");
        }
    }
    for (statement, path) in results.statements.iter().zip(paths) {
        if is_each {
            say!();
            say!("{}", path.display());
        }
        let words = [&statement.assumptions, &statement.verdict].into_iter().chain(&statement.findings);
        words.filter(|words| !words.is_empty()).for_each(|words| print::paragraph(words));
        for table in &statement.tables {
            say!();
            print::table(table);
        }
    }
    for words in &results.summary {
        say!();
        print::paragraph(words);
    }
}
