//! The packaged FMUs in a third-party importer, fmi-rs, which unpacks, validates, loads and runs them.
//!
//! The program packages the FMUs and simulates the scenario; both are read back from files. Nothing of this project is
//! linked in.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock};

use fmi_rs::fmi2::builder::FMU2Builder;
use fmi_rs::fmi2::types::{fmi2Status, fmi2True};
use fmi_rs::fmi2::{CS, FMU2};
use fmi_rs::model_description::fmi2::{Causality, ScalarVariable, VariableType};

use project::{fmus, folder, program, run};

mod project;

/// The FMUs of the planar machine.
const PLANAR: [&str; 3] = ["MagneticBearing", "FlatnessController", "AlgebraicEstimator"];

/// The folder with the archives of all machines, as the program packages them.
static ARCHIVES: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = folder("archives");
    run(program(&folder).args(["package", "--all", "--out", "."]));
    folder
});

/// An FMU, unpacked.
fn builder(path: &Path) -> FMU2Builder {
    FMU2Builder::new(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The FMUs of these models, unpacked.
fn packaged(models: &[&'static str]) -> HashMap<&'static str, FMU2Builder> {
    models.iter().map(|model| (*model, builder(&ARCHIVES.join(format!("{model}.fmu"))))).collect()
}

#[track_caller]
fn ok(what: &str, status: fmi2Status) {
    assert_eq!(status, fmi2Status::Ok, "{what}");
}

/// An instance of a packaged FMU.
struct Instance<'a> {
    fmu: Arc<FMU2<CS>>,
    /// By name, from the model description within the archive.
    variables: HashMap<&'a str, &'a ScalarVariable>,
}

impl<'a> Instance<'a> {
    fn new(name: &str, builder: &'a FMU2Builder) -> Self {
        let fmu = builder.instantiate_cs(name).unwrap_or_else(|error| panic!("{name}: {error}"));
        let variables = &builder.model_description.modelVariables;
        Self { fmu, variables: variables.iter().map(|variable| (variable.name.as_str(), variable)).collect() }
    }

    fn variable(&self, name: &str) -> &'a ScalarVariable {
        self.variables.get(name).unwrap_or_else(|| panic!("there is no {name}"))
    }

    /// Sets a variable of any type; Booleans are 0 and 1.
    fn set(&self, name: &str, value: f64) {
        let variable = self.variable(name);
        let reference = [variable.valueReference];
        ok(
            name,
            match variable.variableType {
                VariableType::Real { .. } => self.fmu.setReal(&reference, &[value]),
                VariableType::Boolean { .. } => self.fmu.setBoolean(&reference, &[value as i32]),
                _ => self.fmu.setInteger(&reference, &[value as i32]),
            },
        );
    }

    fn get(&self, name: &str) -> f64 {
        let variable = self.variable(name);
        let reference = [variable.valueReference];
        let (mut real, mut integer) = ([f64::NAN], [i32::MIN]);
        match variable.variableType {
            VariableType::Real { .. } => {
                ok(name, self.fmu.getReal(&reference, &mut real));
                return real[0];
            }
            VariableType::Boolean { .. } => ok(name, self.fmu.getBoolean(&reference, &mut integer)),
            _ => ok(name, self.fmu.getInteger(&reference, &mut integer)),
        }
        f64::from(integer[0])
    }

    fn start(&self) {
        ok("setupExperiment", self.fmu.setupExperiment(None, 0.0, None));
        ok("enterInitializationMode", self.fmu.enterInitializationMode());
        ok("exitInitializationMode", self.fmu.exitInitializationMode());
    }
}

#[test]
fn the_importer_s_validation_finds_nothing() {
    for path in fmus(&ARCHIVES) {
        let findings = builder(&path).model_description.validate().into_iter();
        let findings: Vec<_> = findings.map(|finding| finding.message).collect();
        assert!(findings.is_empty(), "{}: {findings:#?}", path.display());
    }
}

/// The closed loop of a system in the SSP: its started elements and their connections.
struct Loop<'a> {
    instances: HashMap<String, Instance<'a>>,
    /// Element and output, element and input.
    connections: Vec<[String; 4]>,
}

impl<'a> Loop<'a> {
    /// The system described by a file of the unpacked SSP, with or without enumeration parameters.
    fn new(folder: &Path, file: &str, builders: &'a HashMap<&'static str, FMU2Builder>, choices: bool) -> Self {
        let text = fs::read_to_string(folder.join(file)).expect("the structure");
        let structure = roxmltree::Document::parse(&text).expect("well-formed XML");
        let nodes = |tag: &'static str| structure.descendants().filter(move |node| node.tag_name().name() == tag);
        let instances: HashMap<_, _> = nodes("Component")
            .map(|component| {
                let name = component.attribute("name").expect("a name");
                let model = Path::new(component.attribute("source").expect("a source")).file_stem().expect("a file");
                (name.to_owned(), Instance::new(name, &builders[model.to_str().expect("a name")]))
            })
            .collect();
        let connections = nodes("Connection")
            .map(|connection| {
                ["startElement", "startConnector", "endElement", "endConnector"]
                    .map(|end| connection.attribute(end).expect("element to element").to_owned())
            })
            .collect();
        for binding in nodes("ParameterBinding") {
            let element = binding.ancestors().find(|node| node.tag_name().name() == "Component").expect("an element");
            let instance = &instances[element.attribute("name").expect("a name")];
            let source = binding.attribute("source").expect("a source");
            let text = fs::read_to_string(folder.join(source)).expect("a parameter set");
            let set = roxmltree::Document::parse(&text).expect("well-formed XML");
            for parameter in set.descendants().filter(|node| node.tag_name().name() == "Parameter") {
                let name = parameter.attribute("name").expect("a name");
                if !choices && matches!(instance.variable(name).variableType, VariableType::Enumeration { .. }) {
                    continue;
                }
                let value = parameter.first_element_child().and_then(|value| value.attribute("value"));
                let value = match value.expect("a value") {
                    "true" => 1.0,
                    "false" => 0.0,
                    number => number.parse().expect("a number"),
                };
                instance.set(name, value);
            }
        }
        for instance in instances.values() {
            instance.start();
        }
        Self { instances, connections }
    }

    /// Reads outputs, sets inputs, steps all.
    fn step(&self, time_s: f64, length_s: f64) {
        let read = |[from, output, ..]: &[String; 4]| self.instances[from].get(output);
        let values: Vec<f64> = self.connections.iter().map(read).collect();
        for ([.., to, input], value) in self.connections.iter().zip(values) {
            self.instances[to].set(input, value);
        }
        for instance in self.instances.values() {
            ok("doStep", instance.fmu.doStep(time_s, length_s, fmi2True));
        }
    }
}

/// The SSP of the planar machine, unpacked into a folder of that name.
fn unpacked(name: &str) -> PathBuf {
    let folder = folder(name);
    fmi_rs::zip::extract_zip_archive(ARCHIVES.join("MagneticBearing.ssp"), &folder).expect("the system");
    folder
}

const STEP_S: f64 = 1e-4;

/// Every output at every step equals that of the direct run.
///
/// Elements, connections and parameters are those of the SSP, which the program writes too.
/// Fails if an instance gets a parameter of another one.
#[test]
fn the_closed_loop_over_fmus_is_the_direct_run_bit_for_bit() {
    let builders = packaged(&PLANAR);
    let system = unpacked("loop-system");

    for (name, file) in [("paper", "PaperSimulation.ssd"), ("unbalanced", "SystemStructure.ssd")] {
        run(program(&system).args(["simulate", name, "--set", "duration=0.1s", "--csv", "direct.csv"]));
        let mut table = csv::Reader::from_path(system.join("direct.csv")).expect("the direct run");
        let head = table.headers().expect("a head").clone();
        let whole = Loop::new(&system, file, &builders, true);

        let mut rows = 0;
        for record in table.records() {
            let record = record.expect("a row");
            let time_s = rows as f64 * STEP_S;
            let mut compared = 0;
            for (path, cell) in head.iter().zip(&record) {
                // Names without their units.
                let Some((element, variable)) = path.split(" [").next().and_then(|path| path.split_once('.')) else {
                    continue;
                };
                // Estimators that run beside the loop are not part of the system.
                let Some(instance) = whole.instances.get(element) else { continue };
                let (fmu, direct): (f64, f64) = (instance.get(variable), cell.parse().expect("a number"));
                let is_same = fmu.to_bits() == direct.to_bits();
                assert!(is_same, "{name}: {path} at {time_s} s: FMU {fmu:e}, direct {direct:e}");
                compared += 1;
            }
            let outputs = whole.instances.values().flat_map(|instance| instance.variables.values());
            let outputs = outputs.filter(|variable| variable.causality == Causality::Output).count();
            assert_eq!(compared, outputs, "every output of every FMU");
            whole.step(time_s, STEP_S);
            rows += 1;
        }
        assert_eq!(rows, 1001, "0.1 s in steps of 100 µs, both ends included");
    }
}

/// Writes the final outputs of the loop that all tools run, for scripts/conformance.py to compare: 0.4 s, without the
/// enumerations that some tools cannot set. They go to `final.csv` in the temporary folder of this package's build.
#[test]
fn final_values_are_written_for_comparison() {
    const STEPS: u32 = 4000;
    let builders = packaged(&PLANAR);
    let whole = Loop::new(&unpacked("final-system"), "SystemStructure.ssd", &builders, false);
    for step in 0..STEPS {
        whole.step(f64::from(step) * STEP_S, STEP_S);
    }
    let mut lines = Vec::new();
    for (element, instance) in &whole.instances {
        for (name, variable) in &instance.variables {
            if variable.causality == Causality::Output {
                lines.push(format!("{element}.{name},{:e}\n", instance.get(name)));
            }
        }
    }
    lines.sort();
    assert!(lines.len() > 30, "outputs of three FMUs: {}", lines.len());
    fs::write(Path::new(env!("CARGO_TARGET_TMPDIR")).join("final.csv"), lines.concat()).expect("a file");
}

/// Messages pass through the importer's variadic logger.
#[test]
fn the_importer_logs_the_reason_of_a_refusal() {
    let log = folder("messages").join("log.txt");
    let builder = FMU2Builder { logFile: Some(log.clone()), ..builder(&ARCHIVES.join("MagneticBearing.fmu")) };
    let plant = Instance::new("plant", &builder);
    plant.set("m", -6.7);
    ok("setupExperiment", plant.fmu.setupExperiment(None, 0.0, None));
    ok("enterInitializationMode", plant.fmu.enterInitializationMode());
    assert_eq!(plant.fmu.exitInitializationMode(), fmi2Status::Error);
    drop(plant);
    let logged = fs::read_to_string(&log).expect("the log");
    for words in ["fmi2ExitInitializationMode", "m = -6.7 kg is refused", "above 0"] {
        assert!(logged.contains(words), "`{words}` is not said in: {logged}");
    }
}
