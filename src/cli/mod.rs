//! Commands and their arguments.

mod identify;
mod print;

use std::error::Error;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use clap_complete::Shell;
use fmu_export::package::platforms::{self, Platform};

use crate::machine::{MACHINES, Machine};
use crate::output::{self, Format};
use crate::package;
use crate::report::frame;
use crate::report::{campbell, experiment};
use crate::simulation::{Pair, Recording, Scenario, ScenarioError, scenario, simulate, summary};
use crate::studies::design;
use crate::studies::identify::{Stated, quantity, tolerance};
use crate::studies::montecarlo::{self, hostile, hostile::Course};
use crate::studies::sensitivity;
use crate::studies::sweep::Sweep;
use crate::studies::whirl::{self, Whirl};

/// Default folders, relative to the working directory.
const FMU_FOLDER: &str = "target/fmu";
const REPORT_FOLDER: &str = "target/report";

/// Names of numbers, for messages, and their SI units.
const OF_POSITIONS: [&str; 2] = ["a standard deviation as in 0.1um", "m"];
const OF_CURRENTS: [&str; 2] = ["a standard deviation as in 10mA", "A"];
const TIME: [&str; 2] = ["a time as in 100us", "s"];
const SPEED: [&str; 2] = ["a speed in rpm", ""];

/// Number of speed steps in the table of `whirl`.
const SPEEDS: usize = 12;

/// The exit codes, for `--help`.
const EXIT_CODES: &str = "Exit codes:
    0  done
    1  a run ended early, a case failed, a peak of the sensitivity cannot be computed, or a file cannot be written
    2  arguments or input cannot be used: an unknown name, a value that is refused, a recording that cannot be read
    3  an identification is not valid
    4  identify --check: the other recording does not agree, or cannot be compared
  130  a sweep was interrupted";

/// On-line parameter estimation of a magnetic bearing, as co-simulation FMUs of FMI 2.0 and FMI 3.0.
///
/// Without a command: packages the FMUs and the SSPs into target/fmu, runs the paper's simulation, prints the estimates beside
/// the true values and the paper's, and writes target/report/index.html.
#[derive(Parser)]
#[command(version, max_term_width = 100, after_help = EXIT_CODES)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Subcommand)]
#[allow(clippy::large_enum_variant, reason = "a single instance, destructured at once")]
enum Command {
    /// Packages the FMUs of machines, each for FMI 2.0 and for FMI 3.0, and an SSP of each closed loop, from the library that was built
    /// together with this program.
    ///
    /// Binaries for other platforms can be added; `scripts/build-platforms` makes them all.
    Package {
        /// Machines, by default the first two of these.
        #[arg(value_name = "MACHINE", value_parser = MACHINES.map(|machine| machine.name), conflicts_with = "all", default_values = package::USUAL, hide_default_value = true)]
        machines: Vec<String>,
        /// Packages all machines.
        #[arg(long)]
        all: bool,
        /// A binary for a platform: linux64, win64, darwin64, aarch64-linux or aarch64-darwin (can be repeated). One for this
        /// platform replaces the library that was built together with this program.
        #[arg(long = "binary", value_name = "PLATFORM=FILE", value_parser = binary)]
        binaries: Vec<Binary>,
        /// Makes the elements `x[1]`, `x[2]`, … one array `x` in the FMUs for FMI 3.0; fewer tools read arrays.
        #[arg(long)]
        arrays: bool,
        /// Folder for the archives; it is created if missing.
        #[arg(long, value_name = "DIR", default_value = FMU_FOLDER)]
        out: PathBuf,
    },
    /// Runs a scenario and prints the estimates beside the true values.
    ///
    /// A scenario is a TOML file. Keys are names of variables in the tables [plant], [controller], [estimator], or [all] for
    /// every element with a variable of that name; `reference.rY = "30 µm"` and `reference.rY = 30e-6` mean the same. `simulate
    /// --print paper` prints one to start from. A `[[profile]]` varies inputs and tunable parameters over time; `contour =
    /// "hole.csv"` makes a closed curve of points the reference trajectory.
    Simulate(Simulation),
    /// Identifies the bearing from a recording of a test bench, a text table with one row per sample.
    ///
    /// Columns are named as in the interface (time, Ym, Zm, im[1], im[2], im[3], theta, omega), optionally prefixed by an
    /// element (plant.Ym), or assigned by --column. Units are in the header, `Ym [µm]`, in a row below it, or given by --unit.
    /// Times are numbers, Unix times or ISO 8601 stamps; the sample time is the slope of the straight line through them.
    ///
    /// The exit code is 2 if a recording cannot be used, 3 if the answer is not valid, and 4 if the recording of --check does not agree; the
    /// reasons go to the standard error.
    Identify(identify::Arguments),
    /// Compares excitations: how precisely λ is known after which time, with the reference trajectory alone and with F0
    /// modulated.
    Design {
        /// Bearing, reference trajectory and load: a file or a built-in scenario.
        #[arg(long, value_name = "SCENARIO", default_value = "unbalanced")]
        scenario: PathBuf,
        /// Speed of the rotor, in rpm, by default that of the scenario; 0 means a rotor at rest.
        #[arg(long, value_name = "RPM", value_parser = from_0(SPEED), allow_hyphen_values = true)]
        speed: Option<f64>,
        /// Sample time, as in 100us.
        #[arg(long, value_name = "TIME", value_parser = above_0(TIME), allow_hyphen_values = true)]
        sample_time: Option<f64>,
        /// Standard deviation of the position noise, as in 0.1um; by default that of the scenario, or 0.1 µm if it has none.
        #[arg(long, value_name = "LENGTH", value_parser = above_0(OF_POSITIONS), allow_hyphen_values = true)]
        position_noise: Option<f64>,
        /// Standard deviation of the current noise, as in 10mA; by default that of the scenario, or 10 mA if it has none.
        #[arg(long, value_name = "CURRENT", value_parser = above_0(OF_CURRENTS), allow_hyphen_values = true)]
        current_noise: Option<f64>,
        /// Time by which λ must be known, as in 0.1s.
        #[arg(long, value_name = "TIME", default_value_t = 0.1, value_parser = above_0(TIME), allow_hyphen_values = true)]
        at: f64,
    },
    /// Peak of the sensitivity function of each position sensor, with its zone of ISO 14839-3: with the first guess of λ and with the true
    /// λ.
    Sensitivity {
        /// A file, - for the standard input, or a built-in scenario.
        #[arg(value_name = "SCENARIO")]
        scenario: PathBuf,
        /// Changes a value of the scenario (can be repeated), as for `simulate`.
        #[arg(long = "set", value_name = "NAME=VALUE", value_parser = pair)]
        changes: Vec<Pair>,
    },
    /// Natural frequencies and unbalance response of a spindle over the speed (Campbell diagram), on bearings that are springs and
    /// dampers.
    Whirl {
        /// The spindle: a file or a built-in scenario.
        #[arg(value_name = "SCENARIO", default_value = "spindle")]
        scenario: PathBuf,
        /// Stiffness of each bearing, in N/m.
        #[arg(long, value_name = "N/m", default_value_t = 2e6, value_parser = above_0(["a stiffness in N/m", ""]), allow_hyphen_values = true)]
        stiffness: f64,
        /// Damping of each bearing, in N·s/m.
        #[arg(long, value_name = "N.s/m", default_value_t = 200.0, value_parser = from_0(["a damping in N·s/m", ""]), allow_hyphen_values = true)]
        damping: f64,
        /// Greatest speed, in rpm.
        #[arg(long, value_name = "RPM", default_value_t = 12_000.0, value_parser = above_0(SPEED), allow_hyphen_values = true)]
        to: f64,
        /// Writes a report page, index.html, into this folder.
        #[arg(long, value_name = "DIR")]
        report: Option<PathBuf>,
    },
    /// Repeats runs with many seeds and prints errors, stated standard deviations and the Cramér–Rao bound.
    ///
    /// Without a scenario: random bearings; the unbalanced rotor with several noise levels, controllers, speeds and drives;
    /// wrong parameters; a step of λ; long runs; hostile courses. With a scenario: that scenario with many seeds of the sensor
    /// noise.
    Montecarlo(MonteCarlo),
    /// Runs a scenario many times with varied values, on all processors; every case is a row of the design and a row of the
    /// result.
    ///
    /// A design is a CSV file whose columns are variables such as `plant.lambda[1]` or `plant.pZ [N]`, or a TOML file that
    /// describes how to draw them. An interrupted sweep resumes where it stopped. A case that fails gives a row with the
    /// reason; the exit code is then 1.
    Sweep {
        /// The design; - is the standard input, as CSV.
        #[arg(value_name = "DESIGN.csv|DESIGN.toml")]
        design: PathBuf,
        /// File for the rows; - is the standard output.
        #[arg(long, value_name = "ROWS.csv", required_unless_present = "expand")]
        out: Option<PathBuf>,
        /// The scenario to vary: a file or a built-in scenario; by default that of the design, or else `unbalanced`.
        #[arg(long, value_name = "SCENARIO")]
        scenario: Option<PathBuf>,
        /// Number of cases run at once; all processors by default.
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
        jobs: Option<u16>,
        /// Prints the design as CSV, with the values drawn, instead of running it.
        #[arg(long, conflicts_with_all = ["out", "jobs"])]
        expand: bool,
    },
    /// Prints the completion script of a shell.
    Completions {
        /// The shell.
        #[arg(value_name = "SHELL")]
        shell: Shell,
    },
    /// Writes the model descriptions and VARIABLES.md, which are checked in, from the tables of variables.
    Describe {
        /// Folder for the files.
        #[arg(long, value_name = "DIR", default_value = "modelDescription")]
        out: PathBuf,
    },
}

#[derive(clap::Args, Default)]
struct Simulation {
    /// A file, - for the standard input, or a built-in scenario: paper, experiment, unbalanced, turned, run-up, lift-off,
    /// coil-loss, circle, hole, standstill, spindle, balance, planar4, spindle4, axial, levitation.
    #[arg(value_name = "SCENARIO")]
    scenario: PathBuf,
    /// Changes a value of the scenario (can be repeated): `m=7` for every element that has the variable, `plant.m=7` for
    /// one, `reference.rY=30 µm`, `lambda=[1e-6, 2e-6, 3e-6]`, `duration=1 s`, `step=50 µs`.
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = pair)]
    changes: Vec<Pair>,
    /// Writes all outputs at every communication point as CSV, with names and units in the header; - is the standard
    /// output, and messages then go to the standard error.
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Writes the results as JSON; - as for --csv.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Writes a report page, index.html, into this folder.
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Prints the text of a built-in scenario instead of running it.
    #[arg(long, conflicts_with_all = ["csv", "json", "report", "changes"])]
    print: bool,
}

#[derive(clap::Args)]
struct MonteCarlo {
    /// A file or a built-in scenario, run with the default method.
    #[arg(value_name = "SCENARIO", conflicts_with = "only")]
    scenario: Option<PathBuf>,
    /// Number of runs of each study; of random bearings, number of bearings.
    #[arg(long, value_name = "N", default_value = "100", value_parser = count)]
    runs: usize,
    /// Seed of the first run; each further run takes the next one.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(..=i64::from(i32::MAX)))]
    seed: u32,
    /// Runs only studies with this text in their title.
    #[arg(long, value_name = "TEXT")]
    only: Option<String>,
    /// Standard deviation of the position noise, as in 0.1um; by default that of the scenario, or 0.1 µm if it has none.
    #[arg(long, value_name = "LENGTH", value_parser = from_0(OF_POSITIONS), allow_hyphen_values = true, requires = "scenario", conflicts_with = "only")]
    position_noise: Option<f64>,
    /// Standard deviation of the current noise, as in 10mA; by default that of the scenario, or 10 mA if it has none.
    #[arg(long, value_name = "CURRENT", value_parser = from_0(OF_CURRENTS), allow_hyphen_values = true, requires = "scenario", conflicts_with = "only")]
    current_noise: Option<f64>,
    /// The estimator estimates the noise instead of knowing it.
    #[arg(long, requires = "scenario", conflicts_with = "only")]
    estimate_noise: bool,
    /// Times at which the estimates are evaluated, as in 100ms,1s; hostile courses are judged at all times.
    #[arg(long, value_name = "TIME", value_delimiter = ',', value_parser = above_0(TIME), allow_hyphen_values = true)]
    at: Vec<f64>,
}

/// Prints a line to the standard output.
macro_rules! say {
    () => { $crate::output::tell(format_args!("")) };
    ($($what:tt)*) => { $crate::output::tell(format_args!($($what)*)) };
}
use say;

type Result<T, E = Box<dyn Error>> = std::result::Result<T, E>;

/// Runs the program; errors go to the standard error. `commit` is the one that the program was built from, if known.
pub fn main(commit: Option<&str>) -> ExitCode {
    let version = match commit {
        Some(commit) => format!("{} ({commit})", env!("CARGO_PKG_VERSION")),
        None => env!("CARGO_PKG_VERSION").to_owned(),
    };
    // clap needs a `'static` version.
    let matches = Arguments::command().version(&*version.leak()).get_matches();
    let arguments = Arguments::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    match run(arguments.command) {
        Ok(()) if output::has_failed() => ExitCode::FAILURE,
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            output::warn(format_args!("error: {error}"));
            let is_refused = error.is::<ScenarioError>()
                || error.is::<simulate::Refused>()
                || matches!(error.downcast_ref(), Some(simulate::Stopped::Refused(_)));
            match error.downcast_ref() {
                Some(Failure { code, .. }) => ExitCode::from(*code),
                None if is_refused => ExitCode::from(REFUSED),
                None => ExitCode::FAILURE,
            }
        }
    }
}

fn run(command: Option<Command>) -> Result<()> {
    match command {
        None => {
            package(&[], &package::USUAL, false, Path::new(FMU_FOLDER))?;
            say!();
            let report = Some(REPORT_FOLDER.into());
            simulate(&Simulation { scenario: "paper".into(), report, ..Simulation::default() })
        }
        Some(Command::Package { all: true, binaries, arrays, out, .. }) => {
            package(&binaries, &MACHINES.map(|machine| machine.name), arrays, &out)
        }
        Some(Command::Package { machines, binaries, arrays, out, .. }) => package(&binaries, &machines, arrays, &out),
        Some(Command::Simulate(arguments)) if arguments.print => {
            let name = arguments.scenario;
            let wanted = || refused(format!("{}: --print needs one of {}", name.display(), scenario::built_in_names()));
            say!("{}", scenario::built_in(&name).ok_or_else(wanted)?.trim_end());
            Ok(())
        }
        Some(Command::Simulate(arguments)) => simulate(&arguments),
        Some(Command::Identify(arguments)) => identify::run(&arguments),
        Some(Command::Design { scenario, speed, sample_time, position_noise, current_noise, at }) => {
            let scenario = open(&scenario, &[])?;
            let noise = montecarlo::noise(&scenario, [position_noise, current_noise]);
            // An axis has no speed, but is not kept in the centre.
            let rpm = speed.or(scenario.speed_rpm()).unwrap_or(3000.0);
            let conditions = design::Conditions { rpm, step_s: sample_time, noise, instant_s: at };
            let precisions = design::design(&scenario, &conditions)?;
            print::table(&design::table(&scenario, &conditions, &precisions));
            say!();
            print::paragraph(&design::advice(&scenario, &conditions, &precisions));
            Ok(())
        }
        Some(Command::Sensitivity { scenario, changes }) => {
            let scenario = open(&scenario, &changes)?;
            let (table, missing) = sensitivity::table(&scenario);
            print::table(&table);
            if missing.is_empty() { Ok(()) } else { Err(missing.join("\n  ").into()) }
        }
        Some(Command::Whirl { scenario: name, stiffness, damping, to, report }) => {
            let scenario = open(&name, &[])?;
            let whirl = Whirl::new(&scenario, stiffness, damping);
            let whirl = whirl.map_err(|why| refused(format!("{}: {why}", name.display())))?;
            let table = whirl::table(&whirl, to, SPEEDS).map_err(refused)?;
            print::table(&table);
            match report {
                Some(folder) => write_page(&folder, &campbell::page(&frame::command_line(), &whirl, to, &table)),
                None => Ok(()),
            }
        }
        Some(Command::Montecarlo(arguments)) => monte_carlo(&arguments),
        Some(Command::Sweep { design, out, scenario, jobs, expand: _ }) => {
            sweep(&design, scenario.as_deref(), out.as_deref(), jobs)
        }
        Some(Command::Completions { shell }) => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Arguments::command(), env!("CARGO_PKG_NAME"), &mut script);
            output::unless_closed(io::stdout().lock().write_all(&script)).map_err(named(Path::new("standard output")))
        }
        Some(Command::Describe { out }) => Ok(package::write_descriptions(&out)?),
    }
}

/// Exit codes for unusable arguments or input, for an identification that is not valid, and for one that another recording contradicts.
const REFUSED: u8 = 2;
const NOT_VALID: u8 = 3;
const DIFFERS: u8 = 4;

/// An error with its own exit code.
#[derive(Debug, thiserror::Error)]
#[error("{why}")]
struct Failure {
    code: u8,
    why: String,
}

/// An error for unusable arguments or input.
fn refused(why: impl ToString) -> Box<dyn Error> {
    Failure { code: REFUSED, why: why.to_string() }.into()
}

/// Prefixes an error with the name of the file.
fn named(path: &Path) -> impl FnOnce(io::Error) -> Box<dyn Error> {
    move |error| format!("{}: {error}", path.display()).into()
}

/// A library of the FMUs for a platform.
type Binary = (&'static Platform, PathBuf);

/// Reads the argument `PLATFORM=FILE`.
fn binary(argument: &str) -> Result<Binary, String> {
    let (name, path) = argument.split_once('=').ok_or("expected PLATFORM=FILE, as in win64=magnetic_bearing.dll")?;
    Ok((platforms::by_name(name)?, path.into()))
}

fn package(binaries: &[Binary], machines: &[impl AsRef<str>], arrays: bool, folder: &Path) -> Result<()> {
    let is_wanted = |machine: &&Machine| machines.iter().any(|name| name.as_ref() == machine.name);
    let machines: Vec<_> = MACHINES.iter().filter(is_wanted).collect();
    for written in package::package(&package::binaries(binaries)?, &machines, arrays, folder)? {
        let platforms = written.platforms.join(", ");
        say!("{} ({} kB) for {platforms}", written.path.display(), written.bytes.div_ceil(1000));
    }
    Ok(())
}

fn sweep(design: &Path, scenario: Option<&Path>, out: Option<&Path>, jobs: Option<u16>) -> Result<()> {
    let design = Sweep::open(design, scenario).map_err(refused)?;
    let Some(out) = out else {
        return output::unless_closed(design.write(io::stdout().lock())).map_err(Into::into);
    };
    if let Some(jobs) = jobs {
        rayon::ThreadPoolBuilder::new().num_threads(jobs.into()).build_global()?;
    }
    let outcome = if output::is_standard(out) {
        output::take_standard_output();
        match design.run_to(io::stdout().lock()) {
            // The reader has closed the pipe.
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => return Ok(()),
            outcome => outcome.map_err(named(out))?,
        }
    } else {
        explain_resuming(out)?;
        // As text: an unusable output file must not exit as an unusable argument.
        design.run(out).map_err(|error| error.to_string())?
    };
    let resumed = if outcome.before > 0 { format!(", {} of them from before", outcome.before) } else { String::new() };
    say!("{}: {} rows{resumed}", out.display(), design.count());
    match outcome.failed {
        0 => Ok(()),
        1 => Err(format!("1 of {} cases failed: its row says why", design.count()).into()),
        failed => Err(format!("{failed} of {} cases failed: their rows say why", design.count()).into()),
    }
}

/// When the sweep is interrupted, prints how to resume it.
fn explain_resuming(out: &Path) -> Result<()> {
    let file = out.display().to_string();
    let handler = move || {
        output::warn(format_args!(
            "\ninterrupted: {file} keeps the rows that are done; the same command computes the others"
        ));
        std::process::exit(130)
    };
    ctrlc::set_handler(handler).map_err(Into::into)
}

/// Destination of a result: option, path if given, and format.
type Destination<'a> = (&'static str, Option<&'a Path>, Format);

/// Checks before a long run that all destinations can be written. If a result goes to the standard output, messages go to the
/// standard error.
fn claim(destinations: &[Destination<'_>]) -> Result<()> {
    let given = destinations.iter().filter_map(|(option, path, format)| Some((*option, (*path)?, *format)));
    let (standard, files): (Vec<_>, Vec<_>) = given.partition(|(_, path, _)| output::is_standard(path));
    if standard.len() > 1 {
        let several = standard.iter().map(|(option, ..)| format!("{option} -")).collect::<Vec<_>>().join(" and ");
        return Err(refused(format!("{several}: only one of them can use the standard output")));
    }
    if !standard.is_empty() {
        output::take_standard_output();
    }
    for (at, (option, path, format)) in files.iter().copied().enumerate() {
        // Several results may go to one device.
        let is_device = path.exists() && !path.is_file();
        let absolute = |path: &Path| std::path::absolute(path).ok();
        let is_same = |(_, other, _): &&(&str, &Path, Format)| !is_device && absolute(path) == absolute(other);
        if let Some((other, ..)) = files[..at].iter().find(is_same) {
            return Err(refused(format!("{other} and {option} {}: expected different files", path.display())));
        }
        if path.is_dir() {
            return Err(format!("{option} {}: this is a folder, expected a file", path.display()).into());
        }
        // The folder of a report is created if missing; of its ancestors, the nearest that exists must be a folder.
        let is_required = |folder: &&Path| option != "--report" || folder.exists();
        let folder = path.ancestors().skip(1).filter(|folder| !folder.as_os_str().is_empty()).find(is_required);
        if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
            let (is_file, folder) = (folder.exists(), folder.display());
            let why =
                if is_file { format!("{folder} is not a folder") } else { format!("there is no folder {folder}") };
            return Err(format!("{option} {}: {why}", path.display()).into());
        }
        format.replaceable(path).map_err(named(path))?;
    }
    Ok(())
}

/// Opens a scenario that can be run, and checks its tolerances, which `identify` alone uses.
fn open(name: &Path, changes: &[Pair]) -> Result<Scenario> {
    let scenario = Scenario::open_with(name, changes)?;
    simulate::check(&scenario)?;
    if scenario.tolerance.is_empty() {
        return Ok(scenario);
    }
    let mut stated = Stated::of(scenario.machine, scenario.estimator());
    let finding = |(name, value): &Pair| {
        // A parameter that cannot be asked for lacks a load, which only `identify` is given.
        stated.ask(name).ok()?;
        Some(format!("[tolerance]: {}", tolerance(name, value, &stated).err()?))
    };
    let findings: Vec<_> = scenario.tolerance.iter().filter_map(finding).collect();
    let origin = name.display().to_string();
    if findings.is_empty() { Ok(scenario) } else { Err(ScenarioError { origin, findings }.into()) }
}

fn simulate(arguments: &Simulation) -> Result<()> {
    let Simulation { scenario: name, changes, csv, json, report, .. } = arguments;
    let page = report.as_ref().map(|folder| folder.join("index.html"));
    claim(&[
        ("--csv", csv.as_deref(), Format::Table),
        ("--json", json.as_deref(), Format::Json),
        ("--report", page.as_deref(), Format::Page),
    ])?;
    let scenario = open(name, changes)?;
    simulate::check_rates(&scenario)?;
    let run = simulate::run(&scenario)?;
    say!("{}", scenario.title);
    for message in &run.messages {
        say!("  {message}");
    }
    for table in experiment::tables(name, &scenario, &run) {
        say!();
        print::table(&table);
    }
    // Results are written even if the run ended early.
    if let Some(path) = csv {
        write_table(path, &run.recording)?;
    }
    if let Some(path) = json {
        write_json(path, &summary::json(&scenario, &run))?;
    }
    if let Some(folder) = report {
        write_page(folder, &experiment::page(name, &frame::command_line(), &scenario, &run))?;
    }
    match run.error {
        Some(error) => Err(format!("the run ended early: {error}").into()),
        None => Ok(()),
    }
}

/// Prints the path of a file that was written.
fn report_written(path: &Path) {
    if !output::is_standard(path) {
        say!("\n{}", path.display());
    }
}

/// Writes a file of this format, or to the standard output for `-`.
fn write(path: &Path, format: Format, content: &[u8]) -> Result<()> {
    format.write(path, content).map_err(named(path))?;
    report_written(path);
    Ok(())
}

fn write_json(path: &Path, document: &serde_json::Value) -> Result<()> {
    write(path, Format::Json, format!("{document:#}\n").as_bytes())
}

/// Writes a table to a file or, for `-`, to the standard output, whose reader may close it at any time.
fn write_table(path: &Path, recording: &Recording) -> Result<()> {
    let file = Format::Table.create(path).map_err(named(path))?;
    let written = recording.write_csv(file);
    if output::is_standard(path) { output::unless_closed(written) } else { written }.map_err(named(path))?;
    report_written(path);
    Ok(())
}

/// `name=value`.
fn pair(text: &str) -> Result<Pair, String> {
    let (name, value) = text.split_once('=').ok_or("expected NAME=VALUE")?;
    Ok((name.trim().into(), value.trim().into()))
}

/// Writes a report page into a folder, which is created if missing.
fn write_page(folder: &Path, page: &str) -> Result<()> {
    fs::create_dir_all(folder).map_err(named(folder))?;
    write(&folder.join("index.html"), Format::Page, page.as_bytes())
}

/// Parses a number above 0, with or without its unit.
fn above_0([what, si]: [&'static str; 2]) -> impl Fn(&str) -> Result<f64, String> + Clone {
    move |text| number(text, si).filter(|value| *value > 0.0).ok_or_else(|| format!("expected {what}, above 0"))
}

/// Parses a number, 0 or above, with or without its unit.
fn from_0([what, si]: [&'static str; 2]) -> impl Fn(&str) -> Result<f64, String> + Clone {
    move |text| number(text, si).filter(|value| *value >= 0.0).ok_or_else(|| format!("expected {what}, 0 or above"))
}

/// A number with or without a unit, in SI.
fn number(text: &str, si: &str) -> Option<f64> {
    quantity("", text, si).ok()
}

/// A number of runs.
fn count(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|runs: &usize| *runs > 0).ok_or_else(|| "expected a whole number above 0".into())
}

/// Runs the scenario with many seeds, or the studies whose titles contain the text.
fn monte_carlo(arguments: &MonteCarlo) -> Result<()> {
    let &MonteCarlo { runs, seed, position_noise, current_noise, estimate_noise, .. } = arguments;
    let run_and_print = |mut study: montecarlo::Study| -> Result<()> {
        study.first_seed = seed.into();
        // A study of correction masses has its own instant.
        if !arguments.at.is_empty() && study.scenario.balance_s.is_none() {
            study.instants_s.clone_from(&arguments.at);
        }
        let outcome = study.run()?;
        if outcome.trials.iter().all(|trial| trial.samples.is_empty()) {
            let first_s = study.instants_s[0];
            let why = format!("the rotor touches down before {first_s} s, the first instant of --at, in all runs");
            return Err(refused(format!("{}: {why}", study.title)));
        }
        print::table(&montecarlo::table(&study, &outcome));
        say!();
        Ok(())
    };
    if let Some(name) = &arguments.scenario {
        let scenario = open(name, &[])?;
        simulate::check_rates(&scenario)?;
        let noise = montecarlo::noise(&scenario, [position_noise, current_noise]);
        return run_and_print(montecarlo::study(&scenario.title, &scenario, noise, !estimate_noise, runs));
    }
    let studies = montecarlo::studies(runs);
    let mut courses = hostile::courses();
    let text = arguments.only.as_deref().unwrap_or_default();
    let titles: Vec<_> =
        studies.iter().map(|study| study.title.clone()).chain(courses.iter().map(Course::title)).collect();
    if !titles.iter().any(|title| title.contains(text)) {
        let message =
            format!("--only \"{text}\": no study has this in its title; the studies are\n  {}\n", titles.join("\n  "));
        Arguments::command().error(ErrorKind::InvalidValue, message).exit();
    }
    studies.into_iter().filter(|study| study.title.contains(text)).try_for_each(run_and_print)?;
    courses.retain(|course| course.title().contains(text));
    if !courses.is_empty() {
        print::table(&hostile::table(&courses, &hostile::run(&courses, runs, seed.into())?));
        say!();
    }
    Ok(())
}
