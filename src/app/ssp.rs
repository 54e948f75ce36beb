//! The closed loop as a system structure (SSP 1.0), which tools can run without a hand on it.
//!
//! `SystemStructure.ssd` is the paper's simulation, `UnbalancedRotor.ssd` the rotor with unbalance; the systems are the
//! same, and the parameters come from the scenarios of these names. There are no connectors at the root, every connection
//! leads from element to element, and the prefixes are the usual ones, because some tools accept nothing else.

use std::path::Path;

use super::package::Member;
use super::scenario::Scenario;
use crate::fmi2::xml::{Page, element, real, units, write_base_unit};
use crate::slave::variable::{Causality, Type, Value, Variable};

/// A variant of the system: its file, its parameter set, and the scenario that both come from.
const VARIANTS: [[&str; 3]; 2] =
    [["SystemStructure.ssd", "paper.ssv", "paper"], ["UnbalancedRotor.ssd", "unbalanced.ssv", "unbalanced"]];

/// The members of the archive, given the FMUs with their file names.
pub(super) fn members(fmus: &[(String, Vec<u8>)]) -> Vec<Member> {
    let mut members = Vec::new();
    for [structure, parameters, name] in VARIANTS {
        let scenario = Scenario::open(Path::new(name)).expect("a scenario that comes with the program is sound");
        members.push(Member::new(structure, system(&scenario, parameters)));
        members.push(Member::new(format!("resources/{parameters}"), parameter_set(&scenario, name)));
    }
    members.extend(fmus.iter().map(|(name, fmu)| Member::new(format!("resources/{name}"), fmu.as_slice())));
    members
}

/// The elements of the loop; what runs beside it in a comparison is not part of the system.
fn in_loop(scenario: &Scenario) -> &[super::scenario::Element] {
    &scenario.elements[..3]
}

fn system(scenario: &Scenario, parameters: &str) -> String {
    let root = element("ssd:SystemStructureDescription")
        .with("version", "1.0")
        .with("name", "MagneticBearing")
        .with("description", scenario.title.as_str())
        .with("generationTool", concat!(env!("CARGO_PKG_NAME"), " ", env!("CARGO_PKG_VERSION")))
        .with("xmlns:ssd", "http://ssp-standard.org/SSP1/SystemStructureDescription")
        .with("xmlns:ssc", "http://ssp-standard.org/SSP1/SystemStructureCommon")
        .with("xmlns:ssv", "http://ssp-standard.org/SSP1/SystemStructureParameterValues");
    Page::document(root, |page| {
        page.nest(element("ssd:System").with("name", "loop"), |page| {
            page.nest(element("ssd:ParameterBindings"), |page| {
                page.empty(element("ssd:ParameterBinding").with("source", format!("resources/{parameters}")));
            });
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
        write_units(page, "ssd:Units", scenario);
        let stop = real(scenario.duration_s);
        page.empty(element("ssd:DefaultExperiment").with("startTime", "0").with("stopTime", stop));
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

fn parameter_set(scenario: &Scenario, name: &str) -> String {
    let root = element("ssv:ParameterSet")
        .with("version", "1.0")
        .with("name", name)
        .with("description", scenario.title.as_str())
        .with("xmlns:ssv", "http://ssp-standard.org/SSP1/SystemStructureParameterValues")
        .with("xmlns:ssc", "http://ssp-standard.org/SSP1/SystemStructureCommon");
    Page::document(root, |page| {
        page.nest(element("ssv:Parameters"), |page| {
            for part in in_loop(scenario) {
                let variables = (part.kind.variables)();
                for setting in &part.settings {
                    let variable = variables[setting.index];
                    let path = format!("{}.{}", part.name, variable.name);
                    page.nest(element("ssv:Parameter").with("name", path), |page| {
                        page.empty(match setting.value {
                            Value::Real(value) => {
                                element("ssv:Real").with("value", real(value)).with("unit", variable.unit_name())
                            }
                            Value::Integer(value) => element("ssv:Integer").with("value", value.to_string()),
                            Value::Boolean(value) => element("ssv:Boolean").with("value", value.to_string()),
                        });
                    });
                }
            }
        });
        write_units(page, "ssv:Units", scenario);
    })
}

/// The units that connectors and parameters refer to.
fn write_units(page: &mut Page, name: &'static str, scenario: &Scenario) {
    page.nest(element(name), |page| {
        for unit in units(in_loop(scenario).iter().flat_map(|part| (part.kind.variables)())) {
            page.nest(element("ssc:Unit").with("name", unit.name), |page| write_base_unit(page, "ssc:BaseUnit", unit));
        }
    });
}
