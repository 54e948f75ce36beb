//! The closed loop as a system structure (SSP 1.0), which tools can run without a hand on it.
//!
//! `SystemStructure.ssd` is the paper's simulation, `UnbalancedRotor.ssd` the rotor with unbalance; the systems are the
//! same, and the parameters come from the scenarios of these names. There are no connectors at the root, every connection
//! leads from element to element, and the prefixes are the usual ones, because some tools accept nothing else. Parameters
//! are bound at the elements, one file each, because libcosim and ecos do not look for bindings at the system; all sets of
//! a variant have the name of its scenario, by which a user of ecos asks for them.

use std::path::Path;

use super::package::Member;
use super::scenario::{Element, Scenario};
use crate::fmi2::xml::{Page, element, real, units, write_base_unit};
use crate::slave::variable::{Causality, Type, Value, Variable};

/// A variant of the system: its file, and the scenario that its parameters come from.
const VARIANTS: [[&str; 2]; 2] = [["SystemStructure.ssd", "paper"], ["UnbalancedRotor.ssd", "unbalanced"]];

/// The members of the archive, given the FMUs with their file names.
pub(super) fn members(fmus: &[(String, Vec<u8>)]) -> Vec<Member> {
    let mut members = Vec::new();
    for [structure, name] in VARIANTS {
        let scenario = Scenario::open(Path::new(name)).expect("a scenario that comes with the program is sound");
        members.push(Member::new(structure, system(&scenario, name)));
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

/// The elements that have a parameter set: an empty one is not allowed.
fn with_settings(scenario: &Scenario) -> impl Iterator<Item = &Element> {
    in_loop(scenario).iter().filter(|part| !part.settings.is_empty())
}

/// Where the parameter set of an element is, within the archive.
fn parameter_file(scenario: &str, part: &Element) -> String {
    format!("resources/{scenario}-{}.ssv", part.name)
}

fn system(scenario: &Scenario, name: &str) -> String {
    let root = element("ssd:SystemStructureDescription")
        .with("version", "1.0")
        .with("name", "MagneticBearing")
        .with("description", scenario.title.as_str())
        .with("generationTool", concat!(env!("CARGO_PKG_NAME"), " ", env!("CARGO_PKG_VERSION")))
        .with("xmlns:ssd", "http://ssp-standard.org/SSP1/SystemStructureDescription")
        .with("xmlns:ssc", "http://ssp-standard.org/SSP1/SystemStructureCommon")
        .with("xmlns:ssv", "http://ssp-standard.org/SSP1/SystemStructureParameterValues")
        .with("xmlns:osp", "http://opensimulationplatform.com/SSP/OSPAnnotations");
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
                        if !part.settings.is_empty() {
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
            for setting in &part.settings {
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
