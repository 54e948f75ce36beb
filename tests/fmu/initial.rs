//! Initialization as declared in model descriptions: which outputs depend on which inputs, and the limits of parameters.

use crate::prelude::*;
use fmu_export::Invalid;
use magnetic_bearing::fmu::find;

fn outputs(variables: &[Variable]) -> impl Iterator<Item = (usize, &Variable)> {
    variables.iter().enumerate().filter(|(_, variable)| variable.causality == Causality::Output)
}

/// Importers assume that an unknown without declared dependencies depends on all inputs, and report false algebraic loops.
/// Fails if an output declares none, or if an input with direct feedthrough is not among them.
#[test]
fn every_output_declares_its_dependencies_at_the_start() {
    for model in MODELS {
        let model_type = find(model).expect("a model");
        let variables = model_type.variables();
        let is_input = |name: &str| variables.iter().any(|of| of.name == name && of.causality == Causality::Input);
        for (_, output) in outputs(variables) {
            let at_start = output.starts_from.as_ref().unwrap_or_else(|| panic!("{model}.{}", output.name));
            let acting = output.depends_on.as_ref().unwrap_or_else(|| panic!("{model}.{}", output.name));
            for (name, _) in acting.iter().filter(|(name, _)| is_input(name)) {
                assert!(at_start.contains(name), "{model}.{}: {name}", output.name);
            }
        }
    }
}

/// Fails if an output follows an input at the start without declaring it.
#[test]
fn outputs_depend_at_the_start_only_on_declared_inputs() {
    for model in MODELS {
        let model_type = find(model).expect("a model");
        for (known, input) in model_type.variables().iter().enumerate() {
            if input.causality != Causality::Input {
                continue;
            }
            for drive in [1.0, 2.0] {
                let mut instances = [0, 1].map(|_| Named::new(model));
                for instance in &mut instances {
                    if model_type.variables().iter().any(|variable| variable.name == "drive") {
                        instance.set("drive", drive);
                    }
                }
                let number = instances[0].instance.get(known).expect("a value").as_f64();
                let changed = named::value(&input.data_type, if number == 0.0 { 1.0 } else { 0.0 });
                instances[1].instance.set(known, changed).expect("an input");
                for instance in &mut instances {
                    instance.start().expect("sound parameters");
                }
                for (index, output) in outputs(model_type.variables()) {
                    let [one, other] =
                        instances.each_mut().map(|instance| instance.instance.get(index).expect("a value"));
                    let declared = output.starts_from.as_ref().is_none_or(|names| names.contains(&input.name));
                    assert!(declared || one == other, "{model}.{} follows {} at the start", output.name, input.name);
                }
            }
        }
    }
}

/// Every parameter below its declared limit, or far below 0, at the limit, and not finite. Fails if a limit is declared but not enforced,
/// enforced but not declared, if a parameter accepts a non-finite value, or if another parameter is named.
#[test]
fn enforced_limits_are_declared() {
    for model in MODELS {
        let model_type = find(model).expect("a model");
        let rows = model_type.variables().iter().enumerate();
        for (index, variable) in rows.filter(|(_, variable)| variable.causality == Causality::Parameter) {
            let lowest = match variable.data_type {
                Type::Real { min, .. } => min,
                Type::Integer { min, .. } => min.map(f64::from),
                _ => continue,
            };
            let findings = |number: f64| {
                let mut instance = Named::new(model);
                instance.instance.set(index, named::value(&variable.data_type, number)).expect("a parameter");
                instance.start().err().unwrap_or_default()
            };
            // The limit in the finding on the parameter itself.
            let limit = |findings: &[Invalid]| {
                let limits = ["above 0", "above -1", "from 0 to", "at least"];
                let own =
                    findings.iter().filter(|finding| finding.name == variable.name).map(|finding| &finding.wanted);
                own.into_iter().find(|wanted| limits.iter().any(|words| wanted.contains(words))).cloned()
            };
            let below = findings(lowest.map_or(-1e9, |min| min - 1.0));
            let what = format!("{model}.{}: the least is {lowest:?}, and it is said: {below:?}", variable.name);
            assert_eq!(limit(&below).is_some(), lowest.is_some(), "{what}");
            if let (Some(lowest), Some(wanted)) = (lowest, limit(&below)) {
                assert!(below.iter().all(|finding| finding.name == variable.name), "{what}");
                let beyond = ["a value above", "time of at least"].iter().any(|words| wanted.contains(words));
                assert_eq!(limit(&findings(lowest)).is_some(), beyond, "{what}; at the limit");
            }
            let is_real = matches!(variable.data_type, Type::Real { .. });
            for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY].into_iter().filter(|_| is_real) {
                let found = findings(value);
                let is_named = |found: &Invalid| found.to_string().starts_with(&format!("{} = {value}", variable.name));
                assert!(found.iter().any(is_named), "{model}: {found:?}");
            }
        }
    }
}
