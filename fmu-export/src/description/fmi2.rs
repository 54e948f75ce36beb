//! `modelDescription.xml` of FMI 2.0.

use super::arrays::{Group, groups};
use super::{Standard, described, numbers, root, start, unknowns, with_type, write_definitions, write_items};
use crate::model::{Capabilities, Info};
use crate::variable::{Enumeration, Type, Variable};
use crate::xml::{Page, element, units};

/// The text of the description, with an empty GUID.
pub(super) fn document(info: &Info, capabilities: Capabilities, variables: &[Variable]) -> String {
    let groups = groups(variables, false);
    // Other elements refer to a variable by its position, counted from 1.
    let numbers = numbers(&groups, 1);
    Page::document(root(info, Standard::Fmi2), |page| {
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
        write_definitions(page, info, "fmi2", units(variables), variables, write_enumeration);
        page.nest(element("ModelVariables"), |page| {
            for group in &groups {
                let state = group.first().derivative_of.as_ref().and_then(|state| numbers.get(state.as_ref()));
                write_variable(page, group, state.map(usize::to_string));
            }
        });
        page.nest(element("ModelStructure"), |page| {
            let lists = unknowns(&groups, &numbers, ["Unknown"; 3], "index");
            for (name, unknowns) in ["Outputs", "Derivatives", "InitialUnknowns"].into_iter().zip(lists) {
                if !unknowns.is_empty() {
                    page.nest(element(name), |page| unknowns.into_iter().for_each(|unknown| page.empty(unknown)));
                }
            }
        });
    })
}

fn write_enumeration(page: &mut Page, enumeration: &Enumeration) {
    let root = element("SimpleType").with("name", enumeration.name).with("description", enumeration.description);
    page.nest(root, |page| page.nest(element("Enumeration"), |page| write_items(page, enumeration)));
}

fn write_variable(page: &mut Page, group: &Group<'_>, state: Option<String>) {
    let variable = group.first();
    let name = match &variable.data_type {
        Type::Real { .. } => "Real",
        Type::Integer { .. } => "Integer",
        Type::Boolean { .. } => "Boolean",
        Type::String { .. } => "String",
        Type::Enumeration { .. } => "Enumeration",
    };
    // Computed variables have no start value.
    let start = variable.has_start().then(|| start(variable));
    page.nest(described("ScalarVariable", group), |page| {
        page.empty(with_type(element(name), variable).with_some("start", start).with_some("derivative", state));
    });
}
