//! `modelDescription.xml` of FMI 2.0.

use super::{causality, enumerations, initial, is_initial_unknown, kind_of, variability};
use crate::interface::logger::Category;
use crate::model::{Capabilities, Info};
use crate::unit::Unit;
use crate::variable::{Causality, Enumeration, Type, Variable};
use crate::xml::{Page, element, real, units, write_base_unit};

/// The text of the description, with that GUID.
pub(super) fn document(info: &Info, capabilities: Capabilities, variables: &[Variable], guid: &str) -> String {
    let given = |text: &'static str| Some(text).filter(|text| !text.is_empty());
    let root = element("fmiModelDescription")
        .with("fmiVersion", "2.0")
        .with("modelName", info.name)
        .with("guid", guid)
        .with("description", info.description)
        .with_some("author", given(info.author))
        .with_some("version", given(info.version))
        .with_some("license", given(info.license))
        .with_some("generationTool", given(info.tool))
        .with("variableNamingConvention", "structured");
    Page::document(root, |page| {
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
        page.nest(element("UnitDefinitions"), |page| {
            for unit in units(variables) {
                write_unit(page, unit);
            }
        });
        let enumerations = enumerations(variables);
        if !enumerations.is_empty() {
            page.nest(element("TypeDefinitions"), |page| {
                for enumeration in enumerations {
                    write_enumeration(page, enumeration);
                }
            });
        }
        page.nest(element("LogCategories"), |page| {
            for category in Category::ALL {
                let name = category.name().to_string_lossy();
                page.empty(element("Category").with("name", name).with("description", category.description("fmi2")));
            }
        });
        page.empty(
            element("DefaultExperiment")
                .with("startTime", "0")
                .with("stopTime", real(info.stop_s))
                .with("tolerance", real(info.tolerance))
                .with("stepSize", real(info.step_s)),
        );
        page.nest(element("ModelVariables"), |page| {
            for (reference, variable) in variables.iter().enumerate() {
                let state = variable.derivative_of.as_ref().and_then(|state| index_of(variables, state));
                write_variable(page, reference, variable, state);
            }
        });
        page.nest(element("ModelStructure"), |page| write_structure(page, variables));
    })
}

fn write_unit(page: &mut Page, unit: &Unit) {
    page.nest(element("Unit").with("name", unit.name), |page| {
        write_base_unit(page, "BaseUnit", unit);
        for display in unit.displays {
            let tag = element("DisplayUnit").with("name", display.name).with("factor", real(display.factor));
            page.empty(tag.with_some("offset", (display.offset != 0.0).then(|| real(display.offset))));
        }
    });
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

/// The index of a variable, counted from 1, as other elements refer to it.
fn index_of(variables: &[Variable], name: &str) -> Option<String> {
    variables.iter().position(|variable| variable.name == name).map(|index| (index + 1).to_string())
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
fn write_structure(page: &mut Page, variables: &[Variable]) {
    let chosen = |choice: fn(&Variable) -> bool| (1..).zip(variables).filter(move |(_, variable)| choice(variable));
    let unknown = |index: i32| element("Unknown").with("index", index.to_string());
    let indices = |names: &mut dyn Iterator<Item = &str>| {
        let mut indices: Vec<usize> = names
            .filter_map(|name| variables.iter().position(|variable| variable.name == name))
            .map(|at| at + 1)
            .collect();
        indices.sort_unstable();
        indices.iter().map(usize::to_string).collect::<Vec<_>>().join(" ")
    };
    let dependent = |page: &mut Page, index: i32, variable: &Variable| {
        let there = |name: &str| variables.iter().any(|variable| variable.name == name);
        // Without `dependencies` it depends on all inputs and states.
        let Some(depends_on) = &variable.depends_on else { return page.empty(unknown(index)) };
        let mut depends_on: Vec<_> = depends_on.iter().filter(|(name, _)| there(name)).collect();
        depends_on.sort_by_key(|(name, _)| variables.iter().position(|variable| variable.name == *name));
        let kinds: Vec<_> = depends_on.iter().map(|(_, how)| kind_of(*how)).collect();
        let tag = unknown(index).with("dependencies", indices(&mut depends_on.iter().map(|(name, _)| name.as_ref())));
        page.empty(tag.with_some("dependenciesKind", (!kinds.is_empty()).then(|| kinds.join(" "))));
    };
    page.nest(element("Outputs"), |page| {
        for (index, output) in chosen(|variable| variable.causality == Causality::Output) {
            dependent(page, index, output);
        }
    });
    if variables.iter().any(|variable| variable.derivative_of.is_some()) {
        page.nest(element("Derivatives"), |page| {
            // In the order of the state vector.
            for state in variables.iter().filter(|variable| variable.state) {
                for (index, derivative) in chosen(|variable| variable.derivative_of.is_some()) {
                    if derivative.derivative_of.as_ref() == Some(&state.name) {
                        dependent(page, index, derivative);
                    }
                }
            }
        });
    }
    page.nest(element("InitialUnknowns"), |page| {
        for (index, variable) in chosen(is_initial_unknown) {
            // Without `dependencies` an unknown depends on all knowns: parameters and inputs.
            let from = variable.starts_from.as_ref();
            let from = from.map(|names| indices(&mut names.iter().map(|name| name.as_ref())));
            page.empty(unknown(index).with_some("dependencies", from));
        }
    });
}
