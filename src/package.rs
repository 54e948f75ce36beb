//! Packages FMUs and SSPs from the library just built and from those built for other platforms.

use std::path::{Path, PathBuf};

use fmu_export::Standard;
use fmu_export::package::platforms::{Binaries, Platform};
use fmu_export::package::ssp::{self, System};
use fmu_export::package::{self, Extras, Member, PackageError, Written, documentation};
use maud::PreEscaped;

use crate::fmu::{FMUS, catalogue, find};
use crate::machine::{Machine, PLANAR, SPINDLE};
use crate::output::Format;
use crate::report::frame;
use crate::simulation::{Element, Place, Scenario};

type Result<T> = std::result::Result<T, PackageError>;

/// The machines packaged by default.
pub const USUAL: [&str; 2] = [PLANAR.name, SPINDLE.name];

/// Picture and documentation text of a model, and the licences of every binary: this project's and those of the linked crates.
/// The controllers of all machines with one bearing share a picture, as do those of the spindles; likewise the estimators.
fn extras(name: &str) -> Extras {
    macro_rules! extras {
        ($($picture:literal: $($model:literal)+;)*) => {
            match name {
                $($($model => (
                    &include_bytes!(concat!("../modelDescription/", $picture, ".png"))[..],
                    include_str!(concat!("../modelDescription/", $model, ".html")),
                ),)+)*
                other => unreachable!("{other} is no model of this project"),
            }
        };
    }
    let (picture, text) = extras!(
        "MagneticBearing": "MagneticBearing";
        "MagneticBearing4": "MagneticBearing4";
        "AxialBearing": "AxialBearing";
        "FlatnessController": "FlatnessController" "FlatnessController4" "AxialController";
        "AlgebraicEstimator": "AlgebraicEstimator" "AlgebraicEstimator4" "AxialEstimator";
        "MagneticSpindle": "MagneticSpindle" "MagneticSpindle4";
        "SpindleController": "SpindleController" "SpindleController4";
        "SpindleEstimator": "SpindleEstimator" "SpindleEstimator4";
    );
    let licenses = [
        ("LICENSE-MIT.txt", include_str!("../modelDescription/licenses/LICENSE-MIT.txt")),
        ("LICENSE-APACHE.txt", include_str!("../modelDescription/licenses/LICENSE-APACHE.txt")),
        ("THIRD-PARTY.txt", include_str!("../modelDescription/licenses/THIRD-PARTY.txt")),
    ];
    let extras = Extras::default()
        .picture(picture)
        .text(text)
        .page(|title, body| frame::page(title, &PreEscaped(body.to_owned())));
    licenses.into_iter().fold(extras, |extras, (file, text)| extras.license(file, text))
}

/// The library built together with the running program.
///
/// # Errors
/// It is not beside the program.
pub fn built_library() -> Result<PathBuf> {
    package::built_library(FMUS.library())
}

/// Reads binaries for the given platforms, and adds [`built_library`] unless one is given for this platform.
///
/// # Errors
/// A file that cannot be read, or is not a library for its platform.
pub fn binaries(given: &[(&'static Platform, PathBuf)]) -> Result<Binaries> {
    package::binaries(given, built_library)
}

/// Writes the FMUs of machines, `Name.fmu` for FMI 2.0 and `Name_fmi3.fmu` for FMI 3.0, and their SSPs, which contain the FMUs for
/// FMI 2.0, into a folder, which is created if missing. With `arrays`, the FMUs for FMI 3.0 have arrays.
///
/// # Errors
/// A file that cannot be written.
pub fn package(binaries: &Binaries, machines: &[&Machine], arrays: bool, folder: &Path) -> Result<Vec<Written>> {
    let models = machines.iter().flat_map(|machine| machine.models);
    let models: Vec<_> = models.filter_map(|(name, _)| find(name)).collect();
    let mut archives = Vec::new();
    for standard in package::standards(arrays) {
        for model in &models {
            let name = model.info.name;
            let file = format!("{}.fmu", standard.file_stem(name));
            archives.push((file, package::fmu(model, standard, binaries, &extras(name))?));
        }
    }
    for machine in machines {
        let name = format!("{}.ssp", machine.models[0].0);
        let mut members: Vec<Member> = Vec::new();
        for system in systems(machine) {
            members.extend(system.members()?);
        }
        let fmus = machine.models.map(|(model, _)| format!("{model}.fmu"));
        let needed = archives.iter().filter(|(file, _)| fmus.contains(file));
        members.extend(needed.map(|(fmu, bytes)| Member::new(format!("resources/{fmu}"), bytes.as_slice())));
        let archive = package::archive(&name, &members)?;
        archives.push((name, archive));
    }
    for (name, _) in &archives {
        let path = folder.join(name);
        let format = if name.ends_with(".ssp") { Format::System } else { Format::Archive };
        format.replaceable(&path).map_err(|source| PackageError::File { path, source })?;
    }
    package::write(archives, binaries, folder)
}

/// Writes the model descriptions and the table of all variables into a folder; these files are checked in.
///
/// # Errors
/// A file that cannot be written.
pub fn write_descriptions(folder: &Path) -> Result<()> {
    let write = |format: Format, name: String, text: &str| {
        let path = folder.join(name);
        format.write(&path, text.as_bytes()).map_err(|source| PackageError::File { path, source })
    };
    for model in catalogue().iter() {
        for standard in package::standards(false) {
            let file = format!("{}.xml", standard.file_stem(model.info.name));
            write(Format::Xml, file, &model.description(standard).xml)?;
        }
    }
    write(Format::Markdown, "VARIABLES.md".into(), &variables())
}

/// The table of the variables of all FMUs, in Markdown.
pub fn variables() -> String {
    let head = "# Variables of the FMUs\n\nWritten by `cargo run --release -- describe` out of the tables in `src/fmu/`. The unit in \
                brackets is proposed for display.\n";
    head.to_owned() + &documentation::markdown(catalogue().iter().map(|model| &**model))
}

/// The system structures in the SSP of a machine, with the parameters of built-in scenarios.
///
/// libcosim and ecos ignore parameters of type Enumeration, so all enumerations of the default structure have their start values:
/// it gives the same results in all tools. The paper's simulation needs `method = paper`.
fn systems(machine: &Machine) -> Vec<System> {
    let system = |file: &str, name: &str, parameters: &str| {
        let scenario = Scenario::open(Path::new(parameters)).expect("a scenario that comes with the program is sound");
        system_of(&scenario, file, name, parameters)
    };
    let own = |parameters: &str| system(ssp::DEFAULT, machine.models[0].0, parameters);
    match machine.name {
        "planar" => vec![own("unbalanced"), system("PaperSimulation.ssd", "PaperSimulation", "paper")],
        name => vec![own(name)],
    }
}

/// The closed loop of a scenario, without the estimators run for comparison.
fn system_of(scenario: &Scenario, file: &str, name: &str, parameters: &str) -> System {
    let elements = scenario.in_loop().iter().map(|element| ssp::Element {
        name: element.name.clone(),
        model: element.model_type.clone(),
        settings: element.values(),
    });
    let elements: Vec<_> = elements.collect();
    let connections = scenario.connections().into_iter().filter(|[_, (to, _)]| *to < elements.len());
    let names = |(element, variable): Place| {
        let Element { name, model_type, .. } = &scenario.elements[element];
        [name.clone(), model_type.variables()[variable].name.to_string()]
    };
    let info = &scenario.plant().model_type.info;
    System {
        file: file.into(),
        name: name.into(),
        description: scenario.title.clone(),
        tool: info.tool.into(),
        parameters: parameters.into(),
        connections: connections.map(|connection| connection.map(names)).collect(),
        elements,
        step_s: scenario.step_s,
        stop_s: scenario.duration_s,
        tolerance: info.tolerance,
    }
}

/// The closed loop of a scenario as an SSP: the FMUs for FMI 2.0, connected, with a parameter set of this name.
///
/// # Errors
/// [`PackageError::Archive`], [`PackageError::Model`].
pub fn system_archive(scenario: &Scenario, parameters: &str, binaries: &Binaries) -> Result<Vec<u8>> {
    let system = system_of(scenario, ssp::DEFAULT, scenario.machine.models[0].0, parameters);
    let mut members = system.members()?;
    for element in &system.elements {
        let model = &element.model;
        let fmu = package::fmu(model, Standard::Fmi2, binaries, &extras(model.info.name))?;
        members.push(Member::new(format!("resources/{}.fmu", model.info.name), fmu));
    }
    package::archive(&system.name, &members)
}

/// The parameters of a scenario's closed loop as a parameter set (SSV) of this name.
pub fn parameter_set(scenario: &Scenario, parameters: &str) -> String {
    system_of(scenario, ssp::DEFAULT, scenario.machine.models[0].0, parameters).parameter_set()
}
