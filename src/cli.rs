//! Commands and their arguments.

use std::error::Error;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use clap_complete::Shell;
use fmu_export::package::platforms::{self, Platform};

use crate::estimation::EstimatorConfig;
use crate::fmu::estimator::METHOD;
use crate::output::{self, Format, tell};
use crate::package;
use crate::report::frame;
use crate::report::{experiment, identification};
use crate::simulation::recording::Recording;
use crate::simulation::scenario::{BUILT_IN, Scenario};
use crate::simulation::simulate::{self, Run};
use crate::simulation::summary;
use crate::studies::design;
use crate::studies::identify;
use crate::studies::montecarlo;
use crate::studies::sweep::Sweep;

/// Default folders, relative to the one in which the program is run.
const FMU_FOLDER: &str = "target/fmu";
const REPORT_FOLDER: &str = "target/report";

/// On-line parameter estimation of a magnetic bearing, as FMI 2.0 co-simulation FMUs.
///
/// Without a command: packages the FMUs and the SSP into target/fmu, runs the paper's simulation, prints the estimates beside
/// the true values and the paper's, and writes target/report/index.html.
#[derive(Parser)]
#[command(version, max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Subcommand)]
#[allow(clippy::large_enum_variant, reason = "there is one of it, and it is taken apart at once")]
enum Command {
    /// Packages the three FMUs and the SSP from the library that was built together with this program.
    ///
    /// Binaries for other platforms can be added; `scripts/build-platforms` makes them all.
    Package {
        /// A binary for a platform: linux64, win64, darwin64, aarch64-linux or aarch64-darwin (can be repeated). One for this
        /// platform replaces the library that was built together with this program.
        #[arg(long = "binary", value_name = "PLATFORM=FILE", value_parser = binary)]
        binaries: Vec<(&'static Platform, PathBuf)>,
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
    Simulate {
        /// A file, - for the standard input, or a built-in scenario: paper, experiment, unbalanced, turned, run-up, lift-off,
        /// coil-loss, circle, hole, standstill.
        #[arg(value_name = "SCENARIO")]
        scenario: PathBuf,
        /// Changes a value of the scenario (can be repeated): `m=7` for every element that has the variable, `plant.m=7` for
        /// one, `reference.rY=30 µm`, `lambda=[1e-6, 2e-6, 3e-6]`, `duration=1 s`, `step=50 µs`.
        #[arg(long = "set", value_name = "NAME=VALUE", value_parser = pair)]
        changes: Vec<(String, String)>,
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
    },
    /// Identifies the bearing from a recording of a test bench, a text table with one row per sample.
    ///
    /// Columns are named as in the interface (time, Ym, Zm, im[1], im[2], im[3], theta, omega), optionally prefixed by an
    /// element (plant.Ym), or assigned by --column. Units are in the header, `Ym [µm]`, in a row below it, or given by --unit.
    /// Times are numbers, Unix times or ISO 8601 stamps; the sample time is the slope of the straight line through them.
    ///
    /// The exit code is 2 if the recording cannot be used; the reasons go to the standard error.
    Identify {
        /// The recordings, or - for the standard input, in UTF-8, UTF-16 or Windows-1252: columns separated by comma, semicolon
        /// or tab; with the latter two, decimal commas are understood. Several recordings show one bearing at other speeds,
        /// loads or reference trajectories: they share the parameters of the bearing and its bench.
        #[arg(value_name = "RECORDING", required = true)]
        recordings: Vec<PathBuf>,
        /// The currents in a separate table, with times from the same clock, at any rate.
        #[arg(long, value_name = "FILE.csv")]
        currents: Option<PathBuf>,
        /// Assigns a column: signal as in the interface = name in the header.
        #[arg(long, value_name = "SIGNAL=COLUMN", value_parser = pair)]
        column: Vec<(String, String)>,
        /// Assigns a unit: signal as in the interface = unit. Known are s, ms, µs, ns; m, mm, µm (um), nm, mil; A, mA; rad, deg
        /// (°), rev; rad/s, rpm (1/min, U/min, min-1), Hz, deg/s.
        #[arg(long, value_name = "SIGNAL=UNIT", value_parser = pair)]
        unit: Vec<(String, String)>,
        /// Sample rate, as in 10kHz, for recordings without times; if there are times, they must agree.
        #[arg(long, value_name = "RATE", value_parser = identify::rate_s, conflicts_with = "step")]
        rate: Option<f64>,
        /// Sample time, as in 100us, instead of --rate; seconds if there is no unit.
        #[arg(long, value_name = "TIME", value_parser = identify::duration_s)]
        step: Option<f64>,
        /// Scenario whose estimator has the parameters of the bearing: a file or a built-in scenario.
        #[arg(long, value_name = "SCENARIO", default_value = "unbalanced")]
        scenario: PathBuf,
        /// likelihood (maximum likelihood over the whole recording), an on-line method (paperLiteral, paper, predictionError),
        /// or all.
        #[arg(long, value_name = "METHOD", default_value = "likelihood")]
        method: String,
        /// Standard deviation of a parameter of the bench, with its unit: s=2%, s=10um, m=0.05kg, alpha=1deg,
        /// sensor.offset=5um, sensor.gain=0.5%, current.gain=0.5%, delay=20us (can be repeated; also as a table [tolerance] in
        /// the scenario). The parameter is then estimated as well.
        #[arg(long = "tolerance", value_name = "NAME=VALUE", value_parser = pair)]
        tolerances: Vec<(String, String)>,
        /// A parameter of the bench of which nothing is known, to be estimated as well (can be repeated).
        #[arg(long = "estimate", value_name = "NAME")]
        estimates: Vec<String>,
        /// What a current sample stands for: heldBefore, heldAfter, linear, or auto to find out from the data.
        #[arg(long, value_name = "HOLD", default_value = "heldBefore")]
        hold: String,
        /// Length of the window, in s; one revolution by default.
        #[arg(long, value_name = "SECONDS", value_parser = duration, allow_hyphen_values = true)]
        window: Option<f64>,
        /// Speed in rpm, for recordings without angle and speed.
        #[arg(long, value_name = "RPM", allow_hyphen_values = true)]
        speed: Option<f64>,
        /// Standard deviation of the position noise, in m; estimated from the data by default.
        #[arg(long, value_name = "METRES", value_parser = deviation, allow_hyphen_values = true)]
        position_noise: Option<f64>,
        /// Standard deviation of the current noise, in A; estimated from the data by default.
        #[arg(long, value_name = "AMPERES", value_parser = deviation, allow_hyphen_values = true)]
        current_noise: Option<f64>,
        /// Interpolates a recording without a uniform sample time to this one, as in 100us; seconds if there is no unit.
        #[arg(long, value_name = "TIME", value_parser = identify::duration_s, conflicts_with_all = ["rate", "step"])]
        resample: Option<f64>,
        /// Writes the estimates over time as CSV; - is the standard output, as for --json.
        #[arg(long, value_name = "FILE")]
        csv: Option<PathBuf>,
        /// Writes the result as JSON; - is the standard output, and messages then go to the standard error.
        #[arg(long, value_name = "FILE")]
        json: Option<PathBuf>,
        /// Writes a report page, index.html, into this folder.
        #[arg(long, value_name = "DIR")]
        report: Option<PathBuf>,
    },
    /// Compares excitations: how precisely λ is known after which time, with the reference trajectory alone and with F0
    /// modulated.
    Design {
        /// Bearing, reference trajectory and load: a file or a built-in scenario.
        #[arg(long, value_name = "SCENARIO", default_value = "unbalanced")]
        scenario: PathBuf,
        /// Speed of the rotor, in rpm; 0 means a rotor at rest.
        #[arg(long, value_name = "RPM", default_value_t = 3000.0, allow_hyphen_values = true)]
        speed: f64,
        /// Sample time, in s.
        #[arg(long, value_name = "SECONDS", value_parser = duration, allow_hyphen_values = true)]
        sample_time: Option<f64>,
        /// Standard deviation of the position noise, in m.
        #[arg(long, value_name = "METRES", default_value_t = montecarlo::NOISE[0], value_parser = deviation, allow_hyphen_values = true)]
        position_noise: f64,
        /// Standard deviation of the current noise, in A.
        #[arg(long, value_name = "AMPERES", default_value_t = montecarlo::NOISE[1], value_parser = deviation, allow_hyphen_values = true)]
        current_noise: f64,
        /// Time by which λ must be known, in s.
        #[arg(long, value_name = "SECONDS", default_value_t = 0.1, allow_hyphen_values = true)]
        at: f64,
    },
    /// Repeats runs with many seeds and prints errors, stated standard deviations and the Cramér–Rao bound.
    ///
    /// Without a scenario: random bearings; the unbalanced rotor with several noise levels, controllers, speeds and drives;
    /// wrong parameters; a step of λ; long runs. With a scenario: that scenario with many seeds of the sensor noise.
    Montecarlo {
        /// A file or a built-in scenario, run with the default method.
        #[arg(value_name = "SCENARIO", conflicts_with = "only")]
        scenario: Option<PathBuf>,
        /// Number of runs of each study; of random bearings, number of bearings.
        #[arg(long, value_name = "N", default_value = "100", value_parser = count)]
        runs: usize,
        /// Seed of the first run; each further run takes the next one.
        #[arg(long, value_name = "N", default_value_t = 1)]
        seed: u32,
        /// Runs only studies with this text in their title.
        #[arg(long, value_name = "TEXT")]
        only: Option<String>,
        /// Standard deviation of the position noise, in m.
        #[arg(long, value_name = "METRES", default_value_t = montecarlo::NOISE[0], value_parser = deviation, allow_hyphen_values = true, requires = "scenario")]
        position_noise: f64,
        /// Standard deviation of the current noise, in A.
        #[arg(long, value_name = "AMPERES", default_value_t = montecarlo::NOISE[1], value_parser = deviation, allow_hyphen_values = true, requires = "scenario")]
        current_noise: f64,
        /// The estimator estimates the noise instead of being told.
        #[arg(long, requires = "scenario")]
        untold: bool,
        /// Times at which the estimates are evaluated, in seconds.
        #[arg(long, value_name = "SECONDS", value_delimiter = ',', value_parser = duration, allow_hyphen_values = true)]
        at: Vec<f64>,
    },
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
        #[arg(long, value_name = "N")]
        jobs: Option<usize>,
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

/// Prints a line to the standard output.
macro_rules! say {
    () => { tell(format_args!("")) };
    ($($what:tt)*) => { tell(format_args!($($what)*)) };
}

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// Runs the program. The exit code is 1 after an error, reported on the standard error, and 2 if the arguments are invalid or a
/// recording cannot be used. `commit` is the commit that the program was built from, if known.
pub fn main(commit: Option<&str>) -> ExitCode {
    let version = match commit {
        Some(commit) => format!("{} ({commit})", env!("CARGO_PKG_VERSION")),
        None => env!("CARGO_PKG_VERSION").to_owned(),
    };
    // clap wants a version that lives as long as the program.
    let matches = Arguments::command().version(&*version.leak()).get_matches();
    let arguments = Arguments::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    let outcome = match arguments.command {
        None => everything(),
        Some(Command::Package { binaries, out }) => package(&binaries, &out),
        Some(Command::Simulate { scenario, print: true, .. }) => print(&scenario),
        Some(Command::Simulate { scenario, changes, csv, json, report, print: false }) => {
            let out = Out { csv: csv.as_deref(), json: json.as_deref(), report: report.as_deref() };
            simulate(&scenario, &changes, &out)
        }
        Some(Command::Montecarlo { scenario, runs, seed, only, position_noise, current_noise, untold, at }) => {
            let studies = match &scenario {
                None => Ok(montecarlo::studies(runs)),
                Some(name) => Scenario::open(name).map_err(Into::into).map(|scenario| {
                    let title = scenario.title.clone();
                    vec![montecarlo::study(&title, &scenario, [position_noise, current_noise], !untold, runs)]
                }),
            };
            studies.and_then(|studies| monte_carlo(studies, only.as_deref(), seed, &at))
        }
        Some(Command::Sweep { design, out, scenario, jobs, expand: _ }) => {
            sweep(&design, scenario.as_deref(), out.as_deref(), jobs)
        }
        Some(Command::Describe { out }) => describe(&out),
        Some(Command::Completions { shell }) => completions(shell),
        Some(command @ Command::Identify { .. }) => identify(command),
        Some(Command::Design { scenario, speed, sample_time, position_noise, current_noise, at }) => {
            let noise = [position_noise, current_noise];
            let conditions = design::Conditions { rpm: speed, step_s: sample_time, noise, instant_s: at };
            choose_excitation(&scenario, &conditions)
        }
    };
    match outcome {
        Ok(()) if output::has_failed() => ExitCode::FAILURE,
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            if error.is::<Refused>() { ExitCode::from(2) } else { ExitCode::FAILURE }
        }
    }
}

/// Input that cannot be used; the exit code is 2.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
struct Refused(String);

/// An error that names the file.
fn named(path: &Path) -> impl FnOnce(io::Error) -> Box<dyn Error> {
    move |error| format!("{}: {error}", path.display()).into()
}

fn everything() -> Result<()> {
    package(&[], Path::new(FMU_FOLDER))?;
    say!();
    simulate(Path::new("paper"), &[], &Out { report: Some(Path::new(REPORT_FOLDER)), ..Out::default() })
}

/// Reads the argument `PLATFORM=FILE`.
fn binary(argument: &str) -> std::result::Result<(&'static Platform, PathBuf), String> {
    let (name, path) = argument.split_once('=').ok_or("expected PLATFORM=FILE, as in win64=magnetic_bearing.dll")?;
    Ok((platforms::by_name(name)?, path.into()))
}

fn package(binaries: &[(&'static Platform, PathBuf)], folder: &Path) -> Result<()> {
    for written in package::package_for(&package::binaries(binaries)?, folder)? {
        let platforms = written.platforms.join(", ");
        say!("{} ({} kB) for {platforms}", written.path.display(), written.bytes.div_ceil(1000));
    }
    Ok(())
}

fn describe(folder: &Path) -> Result<()> {
    package::write_descriptions(folder).map_err(Into::into)
}

fn completions(shell: Shell) -> Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Arguments::command(), env!("CARGO_PKG_NAME"), &mut script);
    io::stdout().lock().write_all(&script).map_err(named(Path::new("standard output")))
}

fn sweep(design: &Path, scenario: Option<&Path>, out: Option<&Path>, jobs: Option<usize>) -> Result<()> {
    let design = Sweep::open(design, scenario)?;
    let Some(out) = out else {
        return design.write(io::stdout().lock()).map_err(Into::into);
    };
    let jobs = jobs.or_else(|| std::thread::available_parallelism().ok().map(Into::into)).unwrap_or(1);
    let outcome = if output::is_standard(out) {
        output::take_standard_output();
        design.run_to(io::stdout().lock(), jobs).map_err(named(out))?
    } else {
        design.run(out, jobs)?
    };
    let there = if outcome.before > 0 { format!(", {} of them from before", outcome.before) } else { String::new() };
    say!("{}: {} rows{there}", out.display(), design.len());
    match outcome.failed {
        0 => Ok(()),
        1 => Err(format!("1 of {} cases failed: its row says why", design.len()).into()),
        failed => Err(format!("{failed} of {} cases failed: their rows say why", design.len()).into()),
    }
}

fn print(name: &Path) -> Result<()> {
    let Some((_, text)) = BUILT_IN.iter().find(|(built_in, _)| name == Path::new(built_in)) else {
        let names: Vec<_> = BUILT_IN.iter().map(|(name, _)| *name).collect();
        return Err(format!("{}: --print needs one of {}", name.display(), names.join(", ")).into());
    };
    say!("{}", text.trim_end());
    Ok(())
}

/// Destinations of the results.
#[derive(Default)]
struct Out<'a> {
    csv: Option<&'a Path>,
    json: Option<&'a Path>,
    report: Option<&'a Path>,
}

fn simulate(name: &Path, changes: &[(String, String)], out: &Out<'_>) -> Result<()> {
    let standard = [out.csv, out.json].into_iter().flatten().filter(|path| output::is_standard(path)).count();
    if standard > 1 {
        return Err(Refused("--csv - and --json -: only one of them can use the standard output".into()).into());
    }
    if standard > 0 {
        output::take_standard_output();
    }
    let page = out.report.map(|folder| folder.join("index.html"));
    // Check that the files can be written before a long run.
    for (path, format) in [(out.csv, Format::Table), (out.json, Format::Json), (page.as_deref(), Format::Page)] {
        if let Some(path) = path {
            format.replaceable(path).map_err(named(path))?;
        }
    }
    let scenario = Scenario::open_with(name, changes)?;
    let run = simulate::run(&scenario)?;
    print_run(name, &scenario, &run);
    // Results are written even if the run ended early.
    if let Some(path) = out.csv {
        write_table(path, &run.recording)?;
        said_of(path);
    }
    if let Some(path) = out.json {
        let document = format!("{:#}\n", summary::json(&scenario, &run));
        Format::Json.write(path, document.as_bytes()).map_err(named(path))?;
        said_of(path);
    }
    if let (Some(folder), Some(path)) = (out.report, page) {
        fs::create_dir_all(folder).map_err(named(folder))?;
        let page = experiment::page(name, &frame::command_line(), &scenario, &run);
        Format::Page.write(&path, page.as_bytes()).map_err(named(&path))?;
        said_of(&path);
    }
    match run.error {
        Some(error) => Err(format!("the run ended early: {error}").into()),
        None => Ok(()),
    }
}

/// Reports a file that was written.
fn said_of(path: &Path) {
    if !output::is_standard(path) {
        say!("\n{}", path.display());
    }
}

/// Writes a table to a file, or to the standard output under the name `-`, whose reader may close it at any time.
fn write_table(path: &Path, recording: &Recording) -> Result<()> {
    let file = Format::Table.create(path).map_err(named(path))?;
    match recording.write_csv(io::BufWriter::new(file)) {
        Err(error) if output::is_standard(path) && error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        written => written.map_err(named(path)),
    }
}

/// `name=value`.
fn pair(text: &str) -> std::result::Result<(String, String), String> {
    let (name, value) = text.split_once('=').ok_or("expected NAME=VALUE")?;
    Ok((name.trim().into(), value.trim().into()))
}

fn choose_excitation(name: &Path, conditions: &design::Conditions) -> Result<()> {
    let scenario = Scenario::open(name)?;
    let precisions = design::design(&scenario, conditions)?;
    let table = design::table(conditions, &precisions);
    say!("{}", table.title);
    for line in wrapped(&table.note) {
        say!("  {line}");
    }
    print_table(&table.head, &table.rows);
    say!();
    for line in wrapped(&design::advice(conditions, &precisions)) {
        say!("{line}");
    }
    Ok(())
}

fn identify(command: Command) -> Result<()> {
    let Command::Identify {
        recordings,
        tolerances,
        estimates,
        currents,
        column,
        unit,
        rate,
        step,
        scenario,
        method,
        hold,
        window,
        speed,
        position_noise,
        current_noise,
        resample,
        csv,
        json,
        report,
    } = command
    else {
        unreachable!("called for this command alone");
    };
    let reading = identify::Reading {
        columns: column,
        units: unit,
        omega_rad_s: speed.map(|rpm| rpm * std::f64::consts::PI / 30.0),
        rate_s: rate.or(step),
        resample_s: resample,
    };
    let open = |path: &Path| -> Result<Box<dyn io::Read>> {
        if output::is_standard(path) {
            return Ok(Box::new(io::stdin().lock()));
        }
        Ok(Box::new(fs::File::open(path).map_err(named(path))?))
    };
    let to_standard_output = json.as_deref().is_some_and(output::is_standard);
    if csv.as_deref().is_some_and(output::is_standard) {
        if to_standard_output {
            return Err(Refused("--csv - and --json -: only one of them can use the standard output".into()).into());
        }
        output::take_standard_output();
    }
    if let Some(path) = &csv {
        let is_same =
            |other: &PathBuf| path.canonicalize().ok().is_some_and(|path| other.canonicalize().ok() == Some(path));
        if recordings.iter().chain(&currents).any(is_same) {
            return Err(Refused(format!("--csv {}: this is the recording", path.display())).into());
        }
    }
    let refused = |path: &Path, findings: Vec<String>| -> Box<dyn Error> {
        if to_standard_output {
            let verdict = format!("{}: the recording cannot be used", path.display());
            say!("{:#}", serde_json::json!({"valid": false, "verdict": verdict, "findings": findings}));
        }
        Refused(format!("{}: {}", path.display(), identify::Unusable(findings))).into()
    };
    let bearing = Scenario::open(&scenario)?;
    let mut config =
        identify::config(|name| bearing.value("estimator", name).map_or(f64::NAN, fmu_export::variable::Value::as_f64));
    let mut bench = [identify::likelihood::Told::default(); identify::likelihood::BENCH];
    for (at, std) in identify::of_estimator(&config.tolerance, config.m_kg, config.gap_m) {
        bench[at].knowledge = identify::likelihood::Knowledge::Tolerance(std);
    }
    for (name, value) in bearing.tolerance.iter().chain(&tolerances) {
        for (at, std) in identify::tolerance(name, value, config.m_kg, config.gap_m).map_err(Refused)? {
            bench[at].knowledge = identify::likelihood::Knowledge::Tolerance(std);
        }
    }
    for name in &estimates {
        for at in identify::named(name).map_err(Refused)? {
            bench[at].knowledge = identify::likelihood::Knowledge::Free;
        }
    }
    let likely = method == "likelihood";
    if currents.is_some() && recordings.len() > 1 {
        return Err(Refused("--currents needs a single recording".into()).into());
    }
    if !likely && recordings.len() > 1 {
        return Err(Refused(format!("--method {method} needs a single recording")).into());
    }
    let mut all = Vec::new();
    for path in &recordings {
        let samples = match &currents {
            None => identify::Samples::read_from(open(path)?, &reading),
            Some(apart) => identify::Samples::read_apart_from(open(path)?, open(apart)?, &reading),
        };
        let samples = samples.map_err(|unusable| refused(path, unusable.0))?;
        let implausible = samples.implausible(config.gap_m);
        if !implausible.is_empty() {
            return Err(refused(path, implausible.iter().map(ToString::to_string).collect()));
        }
        all.push(samples);
    }
    let recording = &recordings[0];
    let samples = &all[0];
    config.step_s = samples.step_s;
    config.window_s = match window {
        Some(window_s) => (window_s / samples.step_s).round() * samples.step_s,
        None => identify::one_revolution(samples),
    };
    config.epsilon_s = config.window_s;
    config.position_noise_m = position_noise.unwrap_or(0.0);
    config.current_noise_a = current_noise.unwrap_or(0.0);
    let one =
        |names: &[&str], what: &str, given: &str| format!("--{what} {given}: expected one of {}", names.join(", "));
    let wanted = if likely { "predictionError" } else { method.as_str() };
    let methods: Vec<_> =
        identify::METHODS.into_iter().filter(|(name, _)| wanted == *name || wanted == "all").collect();
    if methods.is_empty() {
        let names = [&["likelihood"], identify::METHODS.map(|(name, _)| name).as_slice(), &["all"]].concat();
        return Err(match METHOD.renamed.iter().find(|(former, _)| *former == method) {
            Some((former, name)) => format!("--method {former}: expected {name}, which replaces it"),
            None => one(&names, "method", &method),
        }
        .into());
    }
    let mut holds = None;
    if hold == "auto" {
        let residuals = identify::residuals_of_holds(samples, &config);
        let least = (0..3).min_by(|a, b| residuals[*a].total_cmp(&residuals[*b])).unwrap_or(0);
        config.hold = identify::HOLDS[least].1;
        holds = Some(identify::table_of_holds(&residuals, config.hold));
    } else {
        let found = identify::HOLDS.into_iter().find(|(name, _)| *name == hold);
        let names = [identify::HOLDS.map(|(name, _)| name).as_slice(), &["auto"]].concat();
        config.hold = found.ok_or_else(|| one(&names, "hold", &hold))?.1;
    }
    // Plots and tables need no more points than this; the CSV file has all of them.
    const SHOWN: usize = 4000;
    let every = if likely && csv.is_none() { samples.len().div_ceil(SHOWN) } else { 1 };
    let mut tracks = Vec::new();
    for (_, method) in methods {
        tracks.push(identify::track_every(samples, &EstimatorConfig { method, ..config.clone() }, every)?);
    }
    let threads = std::thread::available_parallelism().map_or(1, Into::into);
    let question = identify::Question { config, bench, threads };
    let answer = if likely { Some(identify::answer(&all, question)?) } else { None };
    if to_standard_output {
        for note in all.iter().flat_map(|samples| &samples.notes) {
            eprintln!("{note}");
        }
    } else {
        for (path, samples) in recordings.iter().zip(&all) {
            say!("{}", path.display());
            for note in &samples.notes {
                say!("  {note}");
            }
        }
        if let Some(answer) = &answer {
            for line in std::iter::once(answer.told()).chain([answer.verdict.clone()]).chain(answer.findings.clone()) {
                for line in wrapped(&line) {
                    say!("{line}");
                }
            }
        }
        let mut tables: Vec<_> = holds.iter().cloned().collect();
        match &answer {
            Some(answer) => {
                tables.extend(answer.tables());
                tables.push(identify::progress(samples, &tracks[0]));
            }
            None => tables.push(identify::table(&tracks)),
        }
        for table in tables {
            say!("\n{}", table.title);
            for line in wrapped(&table.note) {
                say!("  {line}");
            }
            print_table(&table.head, &table.rows);
        }
        if answer.is_none() {
            say!();
            for track in &tracks {
                say!("{}: {}", track.name, track.verdict());
            }
        }
    }
    if let Some(path) = csv {
        write_table(&path, &identify::recording(samples, &tracks))?;
    }
    if let Some(path) = json {
        let document = answer.as_ref().map_or_else(|| identify::json(samples, &tracks), identify::Answer::json);
        let text = format!("{document:#}\n");
        if to_standard_output {
            say!("{}", text.trim_end());
        } else {
            Format::Json.write(&path, text.as_bytes()).map_err(named(&path))?;
        }
    }
    if let Some(folder) = report {
        fs::create_dir_all(&folder).map_err(named(&folder))?;
        let path = folder.join("index.html");
        let title = format!("Identification from {}", recording.file_name().unwrap_or_default().to_string_lossy());
        let page =
            identification::page(&title, &frame::command_line(), samples, &tracks, holds.as_ref(), answer.as_ref());
        Format::Page.write(&path, page.as_bytes()).map_err(named(&path))?;
        if to_standard_output {
            eprintln!("{}", path.display());
        } else {
            say!("\n{}", path.display());
        }
    }
    match answer {
        Some(answer) if !answer.valid => Err(Refused(answer.verdict).into()),
        _ => Ok(()),
    }
}

/// A standard deviation.
fn deviation(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value >= 0.0 => Ok(value),
        _ => Err("expected a standard deviation, 0 or above".into()),
    }
}

/// A time in seconds.
fn duration(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err("expected a time in s above 0".into()),
    }
}

/// A number of runs.
fn count(text: &str) -> std::result::Result<usize, String> {
    match text.parse() {
        Ok(runs) if runs > 0 => Ok(runs),
        _ => Err("expected a whole number above 0".into()),
    }
}

fn monte_carlo(studies: Vec<montecarlo::Study>, only: Option<&str>, seed: u32, at: &[f64]) -> Result<()> {
    let titles: Vec<_> = studies.iter().map(|study| study.title.clone()).collect();
    let wanted = |study: &montecarlo::Study| only.is_none_or(|text| study.title.contains(text));
    let chosen: Vec<_> = studies.into_iter().filter(wanted).collect();
    if chosen.is_empty() {
        let text = only.unwrap_or_default();
        let message =
            format!("--only \"{text}\": no study has this in its title; the studies are\n  {}\n", titles.join("\n  "));
        Arguments::command().error(ErrorKind::InvalidValue, message).exit();
    }
    for mut study in chosen {
        study.first_seed = seed.into();
        if !at.is_empty() {
            study.instants_s = at.to_vec();
        }
        let table = montecarlo::table(&study, &study.run()?);
        say!("{}", table.title);
        for line in wrapped(&table.note) {
            say!("  {line}");
        }
        print_table(&table.head, &table.rows);
        say!();
    }
    Ok(())
}

fn print_run(name: &Path, scenario: &Scenario, run: &Run) {
    say!("{}", scenario.title);
    for message in &run.messages {
        say!("  {message}");
    }
    for table in experiment::tables(name, scenario, run) {
        say!("\n{}", table.title);
        for line in wrapped(&table.note) {
            say!("  {line}");
        }
        print_table(&table.head, &table.rows);
    }
}

/// Breaks a text into lines that fit a terminal.
fn wrapped(text: &str) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.chars().count() + word.chars().count() < 100 => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.into()),
        }
    }
    lines
}

/// Prints a table whose first column is text and whose others are numbers.
fn print_table(head: &[String], rows: &[Vec<String>]) {
    let all = || std::iter::once(head).chain(rows.iter().map(Vec::as_slice));
    let width = |column: usize| all().filter_map(|row| row.get(column)).map(|cell| cell.chars().count()).max();
    let widths: Vec<usize> = (0..head.len()).map(|column| width(column).unwrap_or(0)).collect();
    for row in all() {
        let mut line = String::from(" ");
        for (column, (cell, width)) in row.iter().zip(&widths).enumerate() {
            let pad = " ".repeat(width - cell.chars().count().min(*width));
            line += &if column == 0 { format!(" {cell}{pad}") } else { format!("  {pad}{cell}") };
        }
        say!("{}", line.trim_end());
    }
}
