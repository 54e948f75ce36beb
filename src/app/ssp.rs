//! The closed loop as a system structure (SSP 1.0), which tools can run without a hand on it.
//!
//! `SystemStructure.ssd` is the rotor with unbalance, `PaperSimulation.ssd` the paper's simulation; the systems are the
//! same, and the parameters come from the scenarios of these names. There are no connectors at the root, every connection
//! leads from element to element, and the prefixes are the usual ones, because some tools accept nothing else. Parameters
//! are bound at the elements, one file each, because libcosim and ecos do not look for bindings at the system; all sets of
//! a variant have the name of its scenario, by which a user of ecos asks for them.
//!
//! libcosim and ecos pass over parameters of type Enumeration. So the structure that tools open by default is the one whose
//! enumerations have their start values: it computes the same everywhere. The paper's simulation needs `method = paper`.

use std::path::Path;

use super::package::Member;
use super::scenario::{Element, Scenario, Setting};
use crate::fmi2::description::TOLERANCE;
use crate::fmi2::xml::{Page, element, real, units, write_base_unit};
use crate::slave::variable::{Causality, Type, Value, Variable};

/// A variant of the system: its file, its name, and the scenario that its parameters come from. OMSimulator wants names that
/// differ.
const VARIANTS: [[&str; 3]; 2] =
    [["SystemStructure.ssd", "MagneticBearing", "unbalanced"], ["PaperSimulation.ssd", "PaperSimulation", "paper"]];

/// The members of the archive, given the FMUs with their file names.
pub(super) fn members(fmus: &[(String, Vec<u8>)]) -> Vec<Member> {
    let mut members = Vec::new();
    for [structure, variant, name] in VARIANTS {
        let scenario = Scenario::open(Path::new(name)).expect("a scenario that comes with the program is sound");
        members.push(Member::new(structure, system(&scenario, variant, name)));
        for part in with_settings(&scenario) {
            members.push(Member::new(parameter_file(name, part), parameter_set(&scenario, name, part)));
        }
    }
    members.extend(fmus.iter().map(|(name, fmu)| Member::new(format!("resources/{name}"), fmu.as_slice())));
    members
}

/// The elements of the loop; what runs beside it in a comparison is not part of the system.
fn in_loop(scenario: &Scenario) -> &[Element] {
    &scenario.elements[..3]
}

/// What the parameter set of an element says. A choice that is the start value is left out: libcosim and ecos would warn
/// that they pass over it.
fn settings(part: &Element) -> Vec<&Setting> {
    let variables = (part.kind.variables)();
    let is_chosen_anyway = |setting: &&Setting| {
        let variable = variables[setting.index];
        matches!(variable.kind, Type::Enumeration { .. }) && variable.start() == setting.value
    };
    part.settings.iter().filter(|setting| !is_chosen_anyway(setting)).collect()
}

/// The elements that have a parameter set: an empty one is not allowed.
fn with_settings(scenario: &Scenario) -> impl Iterator<Item = &Element> {
    in_loop(scenario).iter().filter(|part| !settings(part).is_empty())
}

/// Where the parameter set of an element is, within the archive.
fn parameter_file(scenario: &str, part: &Element) -> String {
    format!("resources/{scenario}-{}.ssv", part.name)
}

fn system(scenario: &Scenario, variant: &'static str, name: &str) -> String {
    let root = element("ssd:SystemStructureDescription")
        .with("version", "1.0")
        .with("name", variant)
        .with("description", scenario.title.as_str())
        .with("generationTool", concat!(env!("CARGO_PKG_NAME"), " ", env!("CARGO_PKG_VERSION")))
        .with("xmlns:ssd", "http://ssp-standard.org/SSP1/SystemStructureDescription")
        .with("xmlns:ssc", "http://ssp-standard.org/SSP1/SystemStructureCommon")
        .with("xmlns:ssv", "http://ssp-standard.org/SSP1/SystemStructureParameterValues")
        .with("xmlns:osp", "http://opensimulationplatform.com/SSP/OSPAnnotations")
        .with("xmlns:oms", "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd");
    Page::document(root, |page| {
        page.nest(element("ssd:System").with("name", "loop"), |page| {
            page.nest(element("ssd:Elements"), |page| {
                for part in in_loop(scenario) {
                    let tag = element("ssd:Component")
                        .with("name", part.name.as_str())
                        .with("type", "application/x-fmu-sharedlibrary")
                        .with("source", format!("resources/{}.fmu", part.kind.name));
                    page.nest(tag, |page| {
                        page.nest(element("ssd:Connectors"), |page| {
                            for variable in (part.kind.variables)() {
                                connector(page, variable);
                            }
                        });
                        if !settings(part).is_empty() {
                            page.nest(element("ssd:ParameterBindings"), |page| {
                                let source = parameter_file(name, part);
                                page.empty(element("ssd:ParameterBinding").with("source", source));
                            });
                        }
                    });
                }
            });
            page.nest(element("ssd:Connections"), |page| {
                let names: Vec<_> = in_loop(scenario).iter().map(|part| &part.name).collect();
                for connection in scenario.connections() {
                    if names.contains(&&connection.to[0]) {
                        page.empty(
                            element("ssd:Connection")
                                .with("startElement", connection.from[0].as_str())
                                .with("startConnector", connection.from[1].as_str())
                                .with("endElement", connection.to[0].as_str())
                                .with("endConnector", connection.to[1].as_str()),
                        );
                    }
                }
            });
            page.nest(element("ssd:Annotations"), |page| {
                // OMSimulator looks for the communication step here.
                page.nest(element("ssc:Annotation").with("type", "org.openmodelica"), |page| {
                    page.nest(element("oms:Annotations"), |page| {
                        page.nest(element("oms:SimulationInformation"), |page| {
                            page.empty(
                                element("oms:FixedStepMaster")
                                    .with("description", "oms-ma")
                                    .with("stepSize", real(scenario.step_s))
                                    .with("relativeTolerance", real(TOLERANCE)),
                            );
                        });
                    });
                });
            });
        });
        write_units(page, "ssd:Units", in_loop(scenario));
        let stop = real(scenario.duration_s);
        page.nest(element("ssd:DefaultExperiment").with("startTime", "0").with("stopTime", stop), |page| {
            page.nest(element("ssd:Annotations"), |page| {
                // SSP 1.0 has no place for the communication step; libcosim looks for it here.
                page.nest(element("ssc:Annotation").with("type", "com.opensimulationplatform"), |page| {
                    page.nest(element("osp:Algorithm"), |page| {
                        let step = real(scenario.step_s);
                        page.empty(element("osp:FixedStepAlgorithm").with("baseStepSize", step));
                    });
                });
            });
        });
    })
}

fn connector(page: &mut Page, variable: &Variable) {
    let kind = match variable.causality {
        Causality::Parameter => "parameter",
        Causality::Input => "input",
        Causality::Output => "output",
        Causality::Local => return,
    };
    let tag = element("ssd:Connector").with("name", variable.name.as_ref()).with("kind", kind);
    page.nest(tag, |page| {
        page.empty(match &variable.kind {
            Type::Real { unit, .. } => element("ssc:Real").with("unit", unit.name),
            // Tools that know FMI 2.0 choices as integers accept no other type here.
            Type::Integer { .. } | Type::Enumeration { .. } => element("ssc:Integer"),
            Type::Boolean { .. } => element("ssc:Boolean"),
        });
    });
}

fn parameter_set(scenario: &Scenario, name: &str, part: &Element) -> String {
    let root = element("ssv:ParameterSet")
        .with("version", "1.0")
        .with("name", name)
        .with("description", scenario.title.as_str())
        .with("xmlns:ssv", "http://ssp-standard.org/SSP1/SystemStructureParameterValues")
        .with("xmlns:ssc", "http://ssp-standard.org/SSP1/SystemStructureCommon");
    Page::document(root, |page| {
        page.nest(element("ssv:Parameters"), |page| {
            let variables = (part.kind.variables)();
            for setting in settings(part) {
                let variable = variables[setting.index];
                page.nest(element("ssv:Parameter").with("name", variable.name.as_ref()), |page| {
                    page.empty(match setting.value {
                        Value::Real(value) => {
                            element("ssv:Real").with("value", real(value)).with("unit", variable.unit_name())
                        }
                        Value::Integer(value) => element("ssv:Integer").with("value", value.to_string()),
                        Value::Boolean(value) => element("ssv:Boolean").with("value", value.to_string()),
                    });
                });
            }
        });
        write_units(page, "ssv:Units", std::slice::from_ref(part));
    })
}

/// The units that the connectors or parameters of these elements refer to.
fn write_units(page: &mut Page, name: &'static str, parts: &[Element]) {
    page.nest(element(name), |page| {
        for unit in units(parts.iter().flat_map(|part| (part.kind.variables)())) {
            page.nest(element("ssc:Unit").with("name", unit.name), |page| write_base_unit(page, "ssc:BaseUnit", unit));
        }
    });
}
