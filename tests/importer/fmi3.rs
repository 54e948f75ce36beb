//! The FMUs of FMI 3.0 in fmi-rs: valid, and bit for bit equal to the FMUs of FMI 2.0, with and without arrays.
//!
//! The program and the examples package them. Nothing of this project is linked in.

use std::collections::HashMap;
use std::path::PathBuf;
use std::process::Command;
use std::sync::Mutex;

use fmi_rs::fmi2::builder::FMU2Builder;
use fmi_rs::fmi2::types::{fmi2Status, fmi2True};
use fmi_rs::fmi3::builder::FMU3Builder;
use fmi_rs::fmi3::types::fmi3Status;
use fmi_rs::model_description::DefaultExperiment;
use fmi_rs::model_description::fmi2::{Causality, Variability, VariableType};
use fmi_rs::model_description::fmi3::{self, Dimension};

use project::{fmus, folder, program, root, run};

mod project;

/// Examples of fmu-export.
const EXAMPLES: [&str; 5] = ["van_der_pol", "pi_controller", "bouncing_ball", "thermostat", "heated_rod"];
const STEPS: u32 = 200;
/// Serializes validation: fmi-rs checks names with a scanner that keeps its buffers in global variables, so that two threads crash it.
static VALIDATION: Mutex<()> = Mutex::new(());

/// Packages all FMUs of the project and of the examples, with or without arrays; returns the paths for FMI 2.0 and FMI 3.0.
fn packaged(arrays: bool) -> Vec<[PathBuf; 2]> {
    let folder = folder(if arrays { "arrays" } else { "scalars" });
    let switch: &[&str] = if arrays { &["--arrays"] } else { &[] };
    run(program(&folder).args(["package", "--all", "--out", "target/fmu"]).args(switch));
    for example in EXAMPLES {
        let mut cargo = Command::new("cargo");
        cargo.current_dir(&folder).args(["run", "--release", "--locked", "--quiet", "--manifest-path"]);
        cargo.arg(root().join("Cargo.toml")).args(["--package", "fmu-export", "--example", example, "--"]);
        run(cargo.args(switch));
    }
    let both = |two: PathBuf| {
        let three = format!("{}_fmi3.fmu", two.with_extension("").display());
        [two, three.into()]
    };
    fmus(&folder.join("target/fmu")).into_iter().map(both).collect()
}

/// The value of an input at a step: near its start, different for each.
fn excitation(start: f64, nominal: f64, reference: u32, step: u32) -> f64 {
    start + 1e-3 * nominal * (f64::from(step * (reference + 1) % 17) - 8.0)
}

/// The step of the default experiment, in seconds.
fn step_s(experiment: Option<&DefaultExperiment>) -> f64 {
    let text = experiment.and_then(|experiment| experiment.stepSize.as_ref()).expect("a step");
    text.parse().expect("a number")
}

/// Continuous inputs, with start and nominal value, by reference.
type Inputs = Vec<(u32, f64, f64)>;

/// The values of all Real variables at every step of a run in FMI 2.0, by reference.
fn run_of_fmi2(builder: &FMU2Builder) -> (Inputs, Vec<HashMap<u32, u64>>) {
    let variables = &builder.model_description.modelVariables;
    let reals: Vec<_> =
        variables.iter().filter(|variable| matches!(variable.variableType, VariableType::Real { .. })).collect();
    let inputs = reals.iter().filter(|v| v.causality == Causality::Input && v.variability == Variability::Continuous);
    let inputs: Inputs = inputs
        .map(|variable| {
            let VariableType::Real { start, nominal, .. } = &variable.variableType else { unreachable!() };
            let number = |text: &Option<String>| text.as_ref().map(|text| text.parse().expect("a number"));
            (variable.valueReference, number(start).unwrap_or(0.0), number(nominal).unwrap_or(1.0))
        })
        .collect();
    let length = step_s(builder.model_description.defaultExperiment.as_ref());
    let fmu = builder.instantiate_cs("two").expect("an instance");
    assert_eq!(fmu.setupExperiment(None, 0.0, None), fmi2Status::Ok);
    assert_eq!(fmu.enterInitializationMode(), fmi2Status::Ok);
    assert_eq!(fmu.exitInitializationMode(), fmi2Status::Ok);
    let references: Vec<u32> = reals.iter().map(|variable| variable.valueReference).collect();
    let mut rows = Vec::new();
    for step in 0..STEPS {
        for (reference, start, nominal) in &inputs {
            let value = excitation(*start, *nominal, *reference, step);
            assert_eq!(fmu.setReal(&[*reference], &[value]), fmi2Status::Ok);
        }
        assert_eq!(fmu.doStep(f64::from(step) * length, length, fmi2True), fmi2Status::Ok);
        let mut values = vec![0.0; references.len()];
        assert_eq!(fmu.getReal(&references, &mut values), fmi2Status::Ok);
        rows.push(references.iter().copied().zip(values.into_iter().map(f64::to_bits)).collect());
    }
    (inputs, rows)
}

/// The same in FMI 3.0, with the references of the elements.
fn run_of_fmi3(builder: &FMU3Builder, inputs: &Inputs) -> Vec<HashMap<u32, u64>> {
    let variables = &builder.model_description.modelVariables;
    let is_float =
        |variable: &&fmi3::ModelVariable| matches!(variable.variableType, fmi3::VariableType::Float64 { .. });
    let floats = variables.iter().filter(is_float).filter(|variable| variable.name != "time");
    let floats: Vec<(u32, u32)> = floats
        .map(|variable| match variable.dimensions[..] {
            [] => (variable.valueReference, 1),
            [Dimension::Fixed { start }] => (variable.valueReference, start as u32),
            ref other => panic!("{}: {other:?}", variable.name),
        })
        .collect();
    let length = step_s(builder.model_description.defaultExperiment.as_ref());
    let fmu = builder.instantiate_cs("three").expect("an instance");
    assert_eq!(fmu.getVersion(), "3.0");
    assert_eq!(fmu.enterInitializationMode(None, 0.0, None), fmi3Status::Ok);
    assert_eq!(fmu.exitInitializationMode(), fmi3Status::Ok);
    let mut rows = Vec::new();
    for step in 0..STEPS {
        // The builder requests event mode, so inputs are set in it.
        if step > 0 {
            assert_eq!(fmu.enterEventMode(), fmi3Status::Ok);
        }
        for (first, size) in &floats {
            let elements = *first..*first + *size;
            let values: Vec<_> = inputs
                .iter()
                .filter(|(reference, ..)| elements.contains(reference))
                .map(|(reference, start, nominal)| excitation(*start, *nominal, *reference, step))
                .collect();
            if !values.is_empty() {
                assert_eq!(fmu.setFloat64(&[*first], &values), fmi3Status::Ok);
            }
        }
        let (mut need, mut end, mut nominals, mut states, mut next) = (true, true, true, true, Some(0.0));
        let (mut time, mut event, mut early) = (0.0, true, true);
        let status = fmu.updateDiscreteStates(&mut need, &mut end, &mut nominals, &mut states, &mut next);
        assert_eq!((status, need, end, nominals, states, next), (fmi3Status::Ok, false, false, false, false, None));
        assert_eq!(fmu.enterStepMode(), fmi3Status::Ok);
        let begin = f64::from(step) * length;
        let status = fmu.doStep(begin, length, true, &mut event, &mut end, &mut early, &mut time);
        assert_eq!((status, event, end, early), (fmi3Status::Ok, false, false, false));
        assert_eq!(time, begin + length);
        let references: Vec<u32> = floats.iter().map(|(reference, _)| *reference).collect();
        let elements: Vec<u32> = floats.iter().flat_map(|(first, size)| *first..*first + *size).collect();
        let mut values = vec![0.0; elements.len()];
        assert_eq!(fmu.getFloat64(&references, &mut values), fmi3Status::Ok);
        rows.push(elements.into_iter().zip(values.into_iter().map(f64::to_bits)).collect());
    }
    rows
}

fn compare(arrays: bool) {
    for [two, three] in packaged(arrays) {
        let name = three.display();
        let old = FMU2Builder::new(&two).unwrap_or_else(|error| panic!("{}: {error}", two.display()));
        let new = FMU3Builder::new(&three).unwrap_or_else(|error| panic!("{name}: {error}"));
        let validation = VALIDATION.lock().expect("no other test failed while it validated");
        let findings: Vec<_> = new.model_description.validate().into_iter().map(|finding| finding.message).collect();
        drop(validation);
        assert!(findings.is_empty(), "{name}: {findings:#?}");
        let has_arrays = new.model_description.modelVariables.iter().any(|variable| !variable.dimensions.is_empty());
        assert!(arrays || !has_arrays, "{name}");
        let (inputs, wanted) = run_of_fmi2(&old);
        let found = run_of_fmi3(&new, &inputs);
        for (step, (found, wanted)) in found.iter().zip(&wanted).enumerate() {
            assert!(found == wanted, "{name}: step {step} differs");
        }
        assert_eq!(found.len(), STEPS as usize);
    }
}

#[test]
fn runs_are_those_of_fmi_2_bit_for_bit() {
    compare(false);
}

#[test]
fn runs_with_arrays_are_those_of_fmi_2_bit_for_bit() {
    compare(true);
}
