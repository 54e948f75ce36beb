//! The packaged FMUs in an importer that nobody here wrote: fmi-rs, which unpacks, validates, loads and runs them.

mod support;

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fmi_rs::fmi2::builder::FMU2Builder;
use fmi_rs::fmi2::types::{fmi2Status, fmi2True};
use fmi_rs::fmi2::{CS, FMU2};
use magnetic_bearing::app::package;
use magnetic_bearing::app::scenario::{Element, Scenario};
use magnetic_bearing::app::simulate;
use magnetic_bearing::slave::variable::{Causality, Type, Value};
use support::says;

/// The FMUs, packaged into a folder of that name.
fn packaged(name: &str) -> HashMap<String, FMU2Builder> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("importer").join(name);
    let library = package::built_library().expect("the library is built with the tests");
    let written = package::package(&library, &folder).expect("the archives");
    let fmus = written.iter().filter(|written| written.path.extension().is_some_and(|ending| ending == "fmu"));
    fmus.map(|written| {
        let model = written.path.file_stem().and_then(|name| name.to_str()).expect("a name").to_owned();
        let builder = FMU2Builder::new(&written.path).unwrap_or_else(|error| panic!("{model}: {error}"));
        (model, builder)
    })
    .collect()
}

#[track_caller]
fn ok(what: &str, status: fmi2Status) {
    assert_eq!(status, fmi2Status::Ok, "{what}");
}

/// An instance of a packaged FMU, by the names of an element of a scenario.
struct Instance<'a> {
    element: &'a Element,
    fmu: Arc<FMU2<CS>>,
    /// Reference and type by name, from the model description within the archive.
    references: HashMap<String, u32>,
}

impl<'a> Instance<'a> {
    fn new(builder: &FMU2Builder, element: &'a Element) -> Self {
        let fmu = builder.instantiate_cs(&element.name).unwrap_or_else(|error| panic!("{}: {error}", element.name));
        let variables = &builder.model_description.modelVariables;
        let references = variables.iter().map(|variable| (variable.name.clone(), variable.valueReference)).collect();
        Self { element, fmu, references }
    }

    fn reference(&self, name: &str) -> [u32; 1] {
        [*self.references.get(name).unwrap_or_else(|| panic!("{} has no {name}", self.element.name))]
    }

    fn set(&self, name: &str, value: Value) {
        let reference = self.reference(name);
        ok(
            name,
            match value {
                Value::Real(value) => self.fmu.setReal(&reference, &[value]),
                Value::Integer(value) => self.fmu.setInteger(&reference, &[value]),
                Value::Boolean(value) => self.fmu.setBoolean(&reference, &[i32::from(value)]),
            },
        );
    }

    fn get(&self, name: &str, kind: &Type) -> Value {
        let reference = self.reference(name);
        match kind {
            Type::Real { .. } => {
                let mut value = [f64::NAN];
                ok(name, self.fmu.getReal(&reference, &mut value));
                Value::Real(value[0])
            }
            Type::Integer { .. } | Type::Enumeration { .. } => {
                let mut value = [i32::MIN];
                ok(name, self.fmu.getInteger(&reference, &mut value));
                Value::Integer(value[0])
            }
            Type::Boolean { .. } => {
                let mut value = [-1];
                ok(name, self.fmu.getBoolean(&reference, &mut value));
                assert!(matches!(value[0], 0 | 1), "{name} = {}", value[0]);
                Value::Boolean(value[0] == 1)
            }
        }
    }

    fn start(&self) {
        let name = &self.element.name;
        ok(name, self.fmu.setupExperiment(None, 0.0, None));
        ok(name, self.fmu.enterInitializationMode());
        ok(name, self.fmu.exitInitializationMode());
    }
}

#[test]
fn the_importer_s_validation_finds_nothing() {
    for (model, builder) in packaged("validation") {
        let findings: Vec<_> =
            builder.model_description.validate().into_iter().map(|finding| finding.message).collect();
        assert!(findings.is_empty(), "{model}: {findings:#?}");
    }
}

#[test]
fn version_and_platform_are_the_standard_s() {
    for (model, builder) in packaged("version") {
        let fmu =
            builder.instantiate_cs("a name with blanks/and.dots").unwrap_or_else(|error| panic!("{model}: {error}"));
        assert_eq!((fmu.getVersion().as_str(), fmu.getTypesPlatform().as_str()), ("2.0", "default"), "{model}");
    }
}

/// The importer sets what the scenario says, connects what it connects, and steps: every output is that of the direct run.
#[test]
fn the_closed_loop_over_fmus_is_the_direct_run_bit_for_bit() {
    let builders = packaged("loop");
    for name in ["paper", "unbalanced"] {
        let mut scenario = Scenario::open(Path::new(name)).expect("a scenario of the program");
        scenario.duration_s = 0.1;
        let direct = simulate::run(&scenario).expect("sound parameters").recording;

        let instances: HashMap<&str, Instance> = scenario
            .elements
            .iter()
            .map(|element| (element.name.as_str(), Instance::new(&builders[element.kind.name], element)))
            .collect();
        for instance in instances.values() {
            let variables = (instance.element.kind.variables)();
            for setting in &instance.element.settings {
                instance.set(&variables[setting.index].name, setting.value);
            }
            instance.start();
        }
        let kinds: HashMap<(&str, &str), &Type> = scenario
            .elements
            .iter()
            .flat_map(|element| {
                let outputs = (element.kind.variables)().into_iter();
                let outputs = outputs.filter(|variable| variable.causality == Causality::Output);
                outputs.map(|variable| ((element.name.as_str(), variable.name.as_ref()), &variable.kind))
            })
            .collect();
        let connections = scenario.connections();

        for (row, time_s) in direct.time_s.iter().enumerate() {
            let values: HashMap<(&str, &str), Value> =
                kinds.iter().map(|(path, kind)| (*path, instances[path.0].get(path.1, kind))).collect();
            assert_eq!(values.len(), direct.columns.len());
            for ((element, variable), value) in &values {
                let column = direct.get(&format!("{element}.{variable}")).expect("a column of the direct run");
                assert!(
                    value.as_f64().to_bits() == column[row].to_bits(),
                    "{name}: {element}.{variable} at {time_s} s: FMU {:e}, direct {:e}",
                    value.as_f64(),
                    column[row]
                );
            }
            if row + 1 == direct.time_s.len() {
                break;
            }
            for connection in &connections {
                let [from, output] = &connection.from;
                let [to, input] = &connection.to;
                instances[to.as_str()].set(input, values[&(from.as_str(), output.as_str())]);
            }
            for instance in instances.values() {
                ok("doStep", instance.fmu.doStep(*time_s, scenario.step_s, fmi2True));
            }
        }
        for instance in instances.values() {
            ok("terminate", instance.fmu.terminate());
        }
    }
}

/// Messages pass through the importer's variadic logger, with the category that the model description declares.
#[test]
fn the_importer_is_told_why() {
    let log = Path::new(env!("CARGO_TARGET_TMPDIR")).join("importer.log");
    let builder = packaged("messages").remove("MagneticBearing").expect("the plant");
    let builder = FMU2Builder { logFile: Some(PathBuf::from(&log)), ..builder };
    let reference = builder.model_description.variable_by_name("m").expect("the mass").valueReference;
    let fmu = builder.instantiate_cs("plant").expect("an instance");
    ok("m", fmu.setReal(&[reference], &[-6.7]));
    ok("setup", fmu.setupExperiment(None, 0.0, None));
    ok("enter", fmu.enterInitializationMode());
    assert_eq!(fmu.exitInitializationMode(), fmi2Status::Error);
    drop(fmu);
    let told = fs::read_to_string(&log).expect("the log");
    says(&told, &["fmi2ExitInitializationMode", "m = -6.7 kg is refused", "above 0"]);
}

/// Long campaigns load and free FMUs without end; each instance here loads its binary anew.
#[test]
fn binaries_can_be_loaded_and_freed_without_end() {
    const TIMES: usize = 200;
    for (model, builder) in packaged("campaign") {
        for time in 0..TIMES {
            let fmu = builder.instantiate_cs("again").unwrap_or_else(|error| panic!("{model}, time {time}: {error}"));
            ok("setup", fmu.setupExperiment(None, 0.0, None));
            ok("enter", fmu.enterInitializationMode());
            ok("exit", fmu.exitInitializationMode());
            ok("step", fmu.doStep(0.0, 1e-4, fmi2True));
        }
    }
}
