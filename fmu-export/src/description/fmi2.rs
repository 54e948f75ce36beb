//! `modelDescription.xml` of FMI 2.0.

use std::collections::HashMap;

use super::{
    causality, default_experiment, enumerations, initial, is_initial_unknown, kind_of, root, variability,
    write_log_categories, write_unit,
};
use crate::model::{Capabilities, Info};
use crate::variable::{Causality, Enumeration, Type, Variable};
use crate::xml::{Page, element, real, units};

/// The text of the description, with an empty GUID.
pub(super) fn document(info: &Info, capabilities: Capabilities, variables: &[Variable]) -> String {
    // Other elements refer to a variable by its position, counted from 1.
    let places: HashMap<&str, usize> = variables.iter().map(|variable| variable.name.as_ref()).zip(1..).collect();
    Page::document(root(info, "2.0", "guid"), |page| {
        page.empty(
            element("CoSimulation")
                .with("modelIdentifier", info.name)
                .with("needsExecutionTool", "false")
                .with("canHandleVariableCommunicationStepSize", "true")
                .with("canInterpolateInputs", capabilities.interpolates_inputs.to_string())
                .with("maxOutputDerivativeOrder", capabilities.output_derivative_order.to_string())
                .with("canRunAsynchronuously", "false")
                .with("canBeInstantiatedOnlyOncePerProcess", "false")
                .with("canNotUseMemoryManagementFunctions", "true")
                .with("canGetAndSetFMUstate", capabilities.snapshots.to_string())
                .with("canSerializeFMUstate", capabilities.snapshots.to_string())
                .with("providesDirectionalDerivative", capabilities.directional_derivatives.to_string()),
        );
        // The schema allows no empty lists.
        let units = units(variables);
        if !units.is_empty() {
            page.nest(element("UnitDefinitions"), |page| units.into_iter().for_each(|unit| write_unit(page, unit)));
        }
        let enumerations = enumerations(variables);
        if !enumerations.is_empty() {
            page.nest(element("TypeDefinitions"), |page| {
                for enumeration in enumerations {
                    write_enumeration(page, enumeration);
                }
            });
        }
        write_log_categories(page, "fmi2");
        page.empty(default_experiment(info));
        page.nest(element("ModelVariables"), |page| {
            for (reference, variable) in variables.iter().enumerate() {
                let state = variable.derivative_of.as_ref().and_then(|state| places.get(state.as_ref()));
                let state = state.map(usize::to_string);
                write_variable(page, reference, variable, state);
            }
        });
        page.nest(element("ModelStructure"), |page| write_structure(page, variables, &places));
    })
}

fn write_enumeration(page: &mut Page, enumeration: &Enumeration) {
    let root = element("SimpleType").with("name", enumeration.name).with("description", enumeration.description);
    page.nest(root, |page| {
        page.nest(element("Enumeration"), |page| {
            for ((name, description), value) in enumeration.items.iter().zip(1..) {
                let item = element("Item").with("name", *name).with("value", i32::to_string(&value));
                page.empty(item.with("description", *description));
            }
        });
    });
}

fn write_variable(page: &mut Page, reference: usize, variable: &Variable, state: Option<String>) {
    let root = element("ScalarVariable")
        .with("name", variable.name.as_ref())
        .with("valueReference", reference.to_string())
        .with("description", variable.description.as_ref())
        .with("causality", causality(variable))
        .with("variability", variability(variable))
        .with_some("initial", initial(variable));
    // Computed variables have no start value.
    let settable = variable.has_start();
    page.nest(root, |page| {
        let kind = match &variable.data_type {
            Type::Real { start, unit, display, nominal, min, max } => element("Real")
                .with("unit", unit.name)
                // FMI Library, used by several importers, refuses a display unit equal to the unit.
                .with_some("displayUnit", display.filter(|display| *display != unit.name))
                .with_some("min", min.map(real))
                .with_some("max", max.map(real))
                .with_some("nominal", (variable.causality != Causality::Independent).then(|| real(*nominal)))
                .with_some("start", settable.then(|| real(*start)))
                .with_some("derivative", state),
            Type::Integer { start, min, max } => element("Integer")
                .with_some("min", min.map(|min| min.to_string()))
                .with_some("max", max.map(|max| max.to_string()))
                .with_some("start", settable.then(|| start.to_string())),
            Type::Boolean { start } => element("Boolean").with_some("start", settable.then(|| start.to_string())),
            Type::String { start } => element("String").with_some("start", settable.then(|| start.to_string())),
            Type::Enumeration { start, items } => element("Enumeration")
                .with("declaredType", items.name)
                .with_some("start", settable.then(|| start.to_string())),
        };
        page.empty(kind);
    });
}

/// Outputs and derivatives of states with their dependencies, and the initial unknowns.
fn write_structure(page: &mut Page, variables: &[Variable], places: &HashMap<&str, usize>) {
    let chosen = |choice: fn(&Variable) -> bool| (1..).zip(variables).filter(move |(_, variable)| choice(variable));
    let unknown = |index: usize| element("Unknown").with("index", index.to_string());
    let listed =
        |indices: &mut dyn Iterator<Item = usize>| indices.map(|index| index.to_string()).collect::<Vec<_>>().join(" ");
    let dependent = |(index, variable): (usize, &Variable)| {
        // Without `dependencies` it depends on all inputs and states.
        let Some(depends_on) = &variable.depends_on else { return unknown(index) };
        let known = depends_on.iter().filter_map(|(name, how)| Some((*places.get(name.as_ref())?, *how)));
        let mut depends_on: Vec<_> = known.collect();
        depends_on.sort_by_key(|(known, _)| *known);
        let kinds: Vec<_> = depends_on.iter().map(|(_, how)| kind_of(*how)).collect();
        let tag = unknown(index).with("dependencies", listed(&mut depends_on.iter().map(|(known, _)| *known)));
        tag.with_some("dependenciesKind", (!kinds.is_empty()).then(|| kinds.join(" ")))
    };
    let starting = |(index, variable): (usize, &Variable)| {
        // Without `dependencies` an unknown depends on all knowns: parameters and inputs.
        let from = variable.starts_from.as_ref().map(|names| {
            let mut known: Vec<_> = names.iter().filter_map(|name| places.get(name.as_ref()).copied()).collect();
            known.sort_unstable();
            listed(&mut known.into_iter())
        });
        unknown(index).with_some("dependencies", from)
    };
    let outputs = chosen(|variable| variable.causality == Causality::Output).map(dependent);
    // In the order of the state vector.
    let mut derivatives: Vec<_> = chosen(|variable| variable.derivative_of.is_some()).collect();
    derivatives.sort_by_key(|(_, variable)| places.get(variable.derivative_of.as_deref().unwrap_or_default()));
    let lists: [(&str, Vec<_>); 3] = [
        ("Outputs", outputs.collect()),
        ("Derivatives", derivatives.into_iter().map(dependent).collect()),
        ("InitialUnknowns", chosen(is_initial_unknown).map(starting).collect()),
    ];
    for (name, unknowns) in lists.into_iter().filter(|(_, unknowns)| !unknowns.is_empty()) {
        page.nest(element(name), |page| unknowns.into_iter().for_each(|unknown| page.empty(unknown)));
    }
}
