//! `modelDescription.xml` of FMI 3.0.

use super::arrays::{Group, groups};
use super::{Standard, described, numbers, root, start, unknowns, with_type, write_definitions, write_items};
use crate::model::{Capabilities, Info};
use crate::unit::SECOND;
use crate::variable::{Causality, Enumeration, Type, Variable};
use crate::xml::{Page, element, units};

/// The text of the description, with an empty instantiation token.
pub(super) fn document(info: &Info, capabilities: Capabilities, variables: &[Variable], arrays: bool) -> String {
    let groups = groups(variables, arrays);
    // Other elements refer to a variable by its value reference.
    let references = numbers(&groups, 0);
    let mut units = units(variables);
    // The unit of the time.
    if units.iter().all(|unit| unit.name != SECOND.name) {
        units.push(&SECOND);
    }
    Page::document(root(info, Standard::Fmi3 { arrays }), |page| {
        page.empty(
            element("CoSimulation")
                .with("modelIdentifier", info.name)
                .with("needsExecutionTool", "false")
                .with("canBeInstantiatedOnlyOncePerProcess", "false")
                .with("canGetAndSetFMUState", capabilities.snapshots.to_string())
                .with("canSerializeFMUState", capabilities.snapshots.to_string())
                .with("providesDirectionalDerivatives", capabilities.directional_derivatives.to_string())
                .with("canHandleVariableCommunicationStepSize", "true")
                .with("maxOutputDerivativeOrder", capabilities.output_derivative_order.to_string())
                // If the model ends the simulation in it.
                .with("mightReturnEarlyFromDoStep", "true")
                .with("hasEventMode", "true"),
        );
        write_definitions(page, info, "fmi3", units, variables, write_enumeration);
        page.nest(element("ModelVariables"), |page| {
            for group in &groups {
                let state = group.first().derivative_of.as_ref().and_then(|state| references.get(state.as_ref()));
                write_variable(page, group, state.map(usize::to_string));
            }
            if variables.iter().any(|variable| variable.causality == Causality::Independent) {
                return;
            }
            page.empty(
                element("Float64")
                    .with("name", "time")
                    .with("valueReference", variables.len().to_string())
                    .with("description", "Time")
                    .with("causality", "independent")
                    .with("variability", "continuous")
                    .with("unit", SECOND.name),
            );
        });
        page.nest(element("ModelStructure"), |page| {
            let names = ["Output", "ContinuousStateDerivative", "InitialUnknown"];
            let lists = unknowns(&groups, &references, names, "valueReference");
            lists.into_iter().flatten().for_each(|unknown| page.empty(unknown));
        });
    })
}

fn write_enumeration(page: &mut Page, enumeration: &Enumeration) {
    let root = element("EnumerationType").with("name", enumeration.name).with("description", enumeration.description);
    page.nest(root, |page| write_items(page, enumeration));
}

fn write_variable(page: &mut Page, group: &Group<'_>, state: Option<String>) {
    let variable = group.first();
    let name = match &variable.data_type {
        Type::Real { .. } => "Float64",
        Type::Integer { .. } => "Int32",
        Type::Boolean { .. } => "Boolean",
        Type::String { .. } => "String",
        Type::Enumeration { .. } => "Enumeration",
    };
    // The start values of all elements; computed variables have none.
    let starts: Vec<_> = group.rows.iter().filter(|row| row.has_start()).map(start).collect();
    // Those of texts are elements.
    let (texts, numbers) =
        if name == "String" { (starts, None) } else { (Vec::new(), (!starts.is_empty()).then(|| starts.join(" "))) };
    let tag = with_type(described(name, group), variable).with_some("derivative", state).with_some("start", numbers);
    if !group.is_array && texts.is_empty() {
        return page.empty(tag);
    }
    page.nest(tag, |page| {
        if group.is_array {
            page.empty(element("Dimension").with("start", group.rows.len().to_string()));
        }
        for text in texts {
            page.empty(element("Start").with("value", text));
        }
    });
}
