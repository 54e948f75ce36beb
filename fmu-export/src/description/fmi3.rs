//! `modelDescription.xml` of FMI 3.0.

use std::collections::{BTreeMap, HashMap};

use super::arrays::{Group, groups};
use super::{
    causality, default_experiment, enumerations, initial, is_initial_unknown, kind_of, root, variability,
    write_log_categories, write_unit,
};
use crate::model::{Capabilities, Info};
use crate::unit::SECOND;
use crate::variable::{Causality, Dependency, Enumeration, Type, Variable};
use crate::xml::{Element, Page, element, real, units};

/// Value references by the names of rows.
type References<'v> = HashMap<&'v str, usize>;

/// The text of the description, with an empty instantiation token.
pub(super) fn document(info: &Info, capabilities: Capabilities, variables: &[Variable], arrays: bool) -> String {
    let groups = groups(variables, arrays);
    // The value reference of a row, or of its array.
    let rows = groups.iter().flat_map(|group| group.rows.iter().map(|row| (row.name.as_ref(), group.reference)));
    let references: References<'_> = rows.collect();
    Page::document(root(info, "3.0", "instantiationToken"), |page| {
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
                .with("hasEventMode", "true"),
        );
        page.nest(element("UnitDefinitions"), |page| {
            let mut units = units(variables);
            // The unit of the time.
            if units.iter().all(|unit| unit.name != SECOND.name) {
                units.push(&SECOND);
            }
            for unit in units {
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
        write_log_categories(page, "fmi3");
        page.empty(default_experiment(info));
        page.nest(element("ModelVariables"), |page| {
            for group in &groups {
                let state = group.first().derivative_of.as_ref().and_then(|state| references.get(state.as_ref()));
                write_variable(page, group, state.copied());
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
        page.nest(element("ModelStructure"), |page| write_structure(page, &groups, &references));
    })
}

fn write_enumeration(page: &mut Page, enumeration: &Enumeration) {
    let root = element("EnumerationType").with("name", enumeration.name).with("description", enumeration.description);
    page.nest(root, |page| {
        for ((name, description), value) in enumeration.items.iter().zip(1..) {
            let item = element("Item").with("name", *name).with("value", i32::to_string(&value));
            page.empty(item.with("description", *description));
        }
    });
}

fn write_variable(page: &mut Page, group: &Group<'_>, state: Option<usize>) {
    let variable = group.first();
    let settable = variable.has_start();
    // The start values of all elements; computed variables have none.
    let starts = || {
        let starts = group.rows.iter().map(|row| match &row.data_type {
            Type::Real { start, .. } => real(*start),
            Type::Integer { start, .. } | Type::Enumeration { start, .. } => start.to_string(),
            Type::Boolean { start } => start.to_string(),
            Type::String { start } => start.to_string(),
        });
        starts.collect::<Vec<_>>()
    };
    let start = settable.then(|| starts().join(" "));
    let common = |name| {
        element(name)
            .with("name", group.name)
            .with("valueReference", group.reference.to_string())
            .with("description", group.description())
            .with("causality", causality(variable))
            .with("variability", variability(variable))
            .with_some("initial", initial(variable))
    };
    let tag = match &variable.data_type {
        Type::Real { unit, display, nominal, min, max, .. } => common("Float64")
            .with("unit", unit.name)
            .with_some("displayUnit", display.filter(|display| *display != unit.name))
            .with_some("min", min.map(real))
            .with_some("max", max.map(real))
            .with_some("nominal", (variable.causality != Causality::Independent).then(|| real(*nominal)))
            .with_some("derivative", state.map(|state| state.to_string()))
            .with_some("start", start),
        Type::Integer { min, max, .. } => common("Int32")
            .with_some("min", min.map(|min| min.to_string()))
            .with_some("max", max.map(|max| max.to_string()))
            .with_some("start", start),
        Type::Boolean { .. } => common("Boolean").with_some("start", start),
        // The start values of texts are elements.
        Type::String { .. } => common("String"),
        Type::Enumeration { items, .. } => {
            common("Enumeration").with("declaredType", items.name).with_some("start", start)
        }
    };
    let texts = if settable && matches!(variable.data_type, Type::String { .. }) { starts() } else { Vec::new() };
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

/// Outputs and derivatives of states with their dependencies, and the initial unknowns.
fn write_structure(page: &mut Page, groups: &[Group<'_>], references: &References<'_>) {
    let unknown = |name, group: &Group<'_>| element(name).with("valueReference", group.reference.to_string());
    let listed = |references: &[usize]| references.iter().map(usize::to_string).collect::<Vec<_>>().join(" ");
    let dependent = |tag: Element, group: &Group<'_>| {
        // Without `dependencies` it depends on all inputs and states.
        let named: Option<Vec<_>> = group.rows.iter().map(|row| row.depends_on.as_ref()).collect();
        let Some(named) = named else { return tag };
        let mut depends_on: BTreeMap<usize, Dependency> = BTreeMap::new();
        for (name, how) in named.into_iter().flatten() {
            let Some(reference) = references.get(name.as_ref()) else { continue };
            // If elements depend in different ways, the array depends in any way.
            let known = depends_on.entry(*reference).or_insert(*how);
            if *known != *how {
                *known = Dependency::Any;
            }
        }
        let references: Vec<_> = depends_on.keys().copied().collect();
        let kinds: Vec<_> = depends_on.values().map(|how| kind_of(*how)).collect();
        tag.with("dependencies", listed(&references))
            .with_some("dependenciesKind", (!kinds.is_empty()).then(|| kinds.join(" ")))
    };
    for group in groups.iter().filter(|group| group.first().causality == Causality::Output) {
        page.empty(dependent(unknown("Output", group), group));
    }
    // In the order of the state vector.
    for state in groups.iter().filter(|group| group.first().state) {
        let is_derivative = |group: &&Group<'_>| group.first().derivative_of.as_ref() == Some(&state.first().name);
        for group in groups.iter().filter(is_derivative) {
            page.empty(dependent(unknown("ContinuousStateDerivative", group), group));
        }
    }
    for group in groups.iter().filter(|group| is_initial_unknown(group.first())) {
        // Without `dependencies` an unknown depends on all knowns: parameters and inputs.
        let from: Option<Vec<_>> = group.rows.iter().map(|row| row.starts_from.as_ref()).collect();
        let from = from.map(|from| {
            let names = from.into_iter().flatten();
            let mut references: Vec<_> = names.filter_map(|name| references.get(name.as_ref()).copied()).collect();
            references.sort_unstable();
            references.dedup();
            listed(&references)
        });
        page.empty(unknown("InitialUnknown", group).with_some("dependencies", from));
    }
}
