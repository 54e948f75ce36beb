//! A system of several FMUs as a system structure (SSP 1.0) that tools can run unchanged.
//!
//! Some tools accept only structures without connectors at the root, with connections from element to element, and with the usual
//! prefixes. Parameters are bound at the elements, one file each, because libcosim and ecos ignore bindings at the system; all
//! have the name of the parameter set, by which users of ecos select them. libcosim and ecos ignore enumeration parameters.

use std::io::{Cursor, Read};
use std::sync::Arc;

use quick_xml::events::Event;
use zip::ZipArchive;

use super::{Member, PackageError};
use crate::ModelType;
use crate::description::causality;
use crate::variable::{Causality, Type, Value, Variable};
use crate::xml::{Page, element, real, units, write_base_unit};

/// Name of the default system structure of an archive.
pub const DEFAULT: &str = "SystemStructure.ssd";

/// One FMU of a system.
pub struct Element {
    /// Name, unique in the system.
    pub name: String,
    /// Its model, whose FMU is in `resources` under its name.
    pub model: Arc<ModelType>,
    /// Values of parameters and inputs that differ from the start values, by index.
    pub settings: Vec<(usize, Value)>,
}

impl Element {
    /// The content of the parameter set. Enumerations at their start value are omitted, because libcosim and ecos would warn that
    /// they ignore them.
    fn parameters(&self) -> Vec<(&Variable, &Value)> {
        let settings = self.settings.iter().map(|(index, value)| (&self.model.variables()[*index], value));
        let is_redundant = |variable: &Variable, value: &Value| {
            matches!(variable.data_type, Type::Enumeration { .. }) && variable.start() == *value
        };
        settings.filter(|(variable, value)| !is_redundant(variable, value)).collect()
    }

    /// Why its variable with that index cannot have that value at the start.
    fn refusal(&self, index: usize, value: &Value) -> Option<String> {
        let Some(variable) = self.model.variables().get(index) else {
            return Some(format!("{} has no variable with index {index}", self.name));
        };
        let name = format!("{}.{}", self.name, variable.name);
        if !(variable.is_settable() || variable.exact) {
            return Some(format!("{name} cannot be set: expected a parameter, an input, or a settable start value"));
        }
        if !variable.takes(value) {
            return Some(format!("{name} is not of type {}", value.type_name()));
        }
        variable.accepts(value).err().map(|finding| format!("{}.{finding}", self.name))
    }
}

/// A system structure: FMUs, connections, and a set of parameters.
pub struct System {
    /// Name of the file within the archive, [`DEFAULT`] for the first of an archive.
    pub file: String,
    /// Name of the system, unique in the archive: OMSimulator requires distinct names.
    pub name: String,
    /// Description, in a sentence.
    pub description: String,
    /// Name and version of the tool that made it.
    pub tool: String,
    /// Name of the set of parameters.
    pub parameters: String,
    /// The FMUs.
    pub elements: Vec<Element>,
    /// Output and input of each connection, as element and variable.
    pub connections: Vec<[[String; 2]; 2]>,
    /// Communication step, in seconds.
    pub step_s: f64,
    /// End of the run, in seconds.
    pub stop_s: f64,
    /// Relative tolerance, for tools that need one.
    pub tolerance: f64,
}

impl System {
    /// Checks times, names, settings and connections: the files are of use only if this succeeds.
    ///
    /// # Errors
    /// [`PackageError::System`] with everything that importers would reject or misread.
    pub fn check(&self) -> Result<(), PackageError> {
        let mut problems = Vec::new();
        for (what, value) in [("step_s", self.step_s), ("stop_s", self.stop_s), ("tolerance", self.tolerance)] {
            if !(value.is_finite() && value > 0.0) {
                problems.push(format!("{what} = {value} is refused: expected a number above 0"));
            }
        }
        for (at, part) in self.elements.iter().enumerate() {
            if self.elements[..at].iter().any(|other| other.name == part.name) {
                problems.push(format!("there are two elements named {}", part.name));
            }
            problems.extend(part.settings.iter().filter_map(|(index, value)| part.refusal(*index, value)));
        }
        for (at, [from, to]) in self.connections.iter().enumerate() {
            match (self.find(from, "output"), self.find(to, "input")) {
                (Ok(output), Ok(input)) if !input.takes(&output.start()) => {
                    problems.push(format!(
                        "{} and {}, which are connected, have different types",
                        from.join("."),
                        to.join(".")
                    ));
                }
                (output, input) => problems.extend(output.err().into_iter().chain(input.err())),
            }
            if self.connections[..at].iter().any(|[_, other]| other == to) {
                problems.push(format!("{} has two connections", to.join(".")));
            }
        }
        if problems.is_empty() { Ok(()) } else { Err(PackageError::System { name: self.name.clone(), problems }) }
    }

    /// A connected variable, or why there is none.
    fn find(&self, [element, name]: &[String; 2], wanted: &str) -> Result<&Variable, String> {
        let part = self.elements.iter().find(|part| part.name == *element);
        let part = part.ok_or_else(|| format!("{element}, which is connected, is not an element"))?;
        let mut variables = part.model.variables().iter();
        let found = variables.find(|variable| variable.name == *name && causality(variable) == wanted);
        found.ok_or_else(|| format!("{element}.{name}, which is connected, is not an {wanted}"))
    }

    /// The files of the system within an archive, without the FMUs.
    ///
    /// # Errors
    /// As for [`check`](Self::check).
    pub fn members(&self) -> Result<Vec<Member>, PackageError> {
        self.check()?;
        let mut members = vec![Member::new(&self.file, self.structure())];
        // An empty parameter set is not allowed.
        for part in self.elements.iter().filter(|part| !part.parameters().is_empty()) {
            let parameters = self.parameter_set_of(std::slice::from_ref(part), |_, name| name.to_owned());
            members.push(Member::new(self.parameter_file(part), parameters));
        }
        Ok(members)
    }

    /// Path of an element's parameter set within the archive.
    fn parameter_file(&self, part: &Element) -> String {
        format!("resources/{}-{}.ssv", self.parameters, part.name)
    }

    fn structure(&self) -> String {
        let root = element("ssd:SystemStructureDescription")
            .with("version", "1.0")
            .with("name", &self.name)
            .with("description", &self.description)
            .with("generationTool", &self.tool)
            .with("xmlns:ssd", "http://ssp-standard.org/SSP1/SystemStructureDescription")
            .with("xmlns:ssc", "http://ssp-standard.org/SSP1/SystemStructureCommon")
            .with("xmlns:ssv", "http://ssp-standard.org/SSP1/SystemStructureParameterValues")
            .with("xmlns:osp", "http://opensimulationplatform.com/SSP/OSPAnnotations")
            .with("xmlns:oms", "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd");
        Page::document(root, |page| {
            page.nest(element("ssd:System").with("name", "loop"), |page| {
                page.nest(element("ssd:Elements"), |page| {
                    for part in &self.elements {
                        self.write_element(page, part);
                    }
                });
                page.nest(element("ssd:Connections"), |page| {
                    for [from, to] in &self.connections {
                        page.empty(
                            element("ssd:Connection")
                                .with("startElement", &from[0])
                                .with("startConnector", &from[1])
                                .with("endElement", &to[0])
                                .with("endConnector", &to[1]),
                        );
                    }
                });
                page.nest(element("ssd:Annotations"), |page| {
                    // OMSimulator reads the communication step here.
                    page.nest(element("ssc:Annotation").with("type", "org.openmodelica"), |page| {
                        page.nest(element("oms:Annotations"), |page| {
                            page.nest(element("oms:SimulationInformation"), |page| {
                                page.empty(
                                    element("oms:FixedStepMaster")
                                        .with("description", "oms-ma")
                                        .with("stepSize", real(self.step_s))
                                        .with("relativeTolerance", real(self.tolerance)),
                                );
                            });
                        });
                    });
                });
            });
            write_units(page, "ssd:Units", &self.elements);
            let stop = real(self.stop_s);
            page.nest(element("ssd:DefaultExperiment").with("startTime", "0").with("stopTime", stop), |page| {
                page.nest(element("ssd:Annotations"), |page| {
                    // SSP 1.0 does not define the communication step; libcosim reads it here.
                    page.nest(element("ssc:Annotation").with("type", "com.opensimulationplatform"), |page| {
                        page.nest(element("osp:Algorithm"), |page| {
                            let step = real(self.step_s);
                            page.empty(element("osp:FixedStepAlgorithm").with("baseStepSize", step));
                        });
                    });
                });
            });
        })
    }

    fn write_element(&self, page: &mut Page, part: &Element) {
        let tag = element("ssd:Component")
            .with("name", &part.name)
            .with("type", "application/x-fmu-sharedlibrary")
            .with("source", format!("resources/{}.fmu", part.model.info.name));
        page.nest(tag, |page| {
            page.nest(element("ssd:Connectors"), |page| {
                for variable in part.model.variables() {
                    write_connector(page, variable);
                }
            });
            if !part.parameters().is_empty() {
                page.nest(element("ssd:ParameterBindings"), |page| {
                    page.empty(element("ssd:ParameterBinding").with("source", self.parameter_file(part)));
                });
            }
        });
    }

    /// The parameters of all elements as one parameter set (SSV), to be bound to the system: names follow those of the
    /// elements, as in `plant.m`.
    pub fn parameter_set(&self) -> String {
        self.parameter_set_of(&self.elements, |part, name| format!("{}.{name}", part.name))
    }

    /// The parameter set of these elements, with names as given.
    fn parameter_set_of(&self, parts: &[Element], named: impl Fn(&Element, &str) -> String) -> String {
        let root = element("ssv:ParameterSet")
            .with("version", "1.0")
            .with("name", &self.parameters)
            .with("description", &self.description)
            .with("generationTool", &self.tool)
            .with("xmlns:ssv", "http://ssp-standard.org/SSP1/SystemStructureParameterValues")
            .with("xmlns:ssc", "http://ssp-standard.org/SSP1/SystemStructureCommon");
        Page::document(root, |page| {
            page.nest(element("ssv:Parameters"), |page| {
                let parameters = |part| Element::parameters(part).into_iter().map(move |parameter| (part, parameter));
                for (part, (variable, value)) in parts.iter().flat_map(parameters) {
                    page.nest(element("ssv:Parameter").with("name", named(part, &variable.name)), |page| {
                        page.empty(match value {
                            Value::Real(value) => {
                                element("ssv:Real").with("value", real(*value)).with("unit", variable.unit_name())
                            }
                            Value::Integer(value) => element("ssv:Integer").with("value", value.to_string()),
                            Value::Boolean(value) => element("ssv:Boolean").with("value", value.to_string()),
                            Value::String(value) => element("ssv:String").with("value", value),
                        });
                    });
                }
            });
            write_units(page, "ssv:Units", parts);
        })
    }
}

/// The attribute `generationTool` of a system structure or a parameter set (SSP, SSD, SSV); none for any other content.
pub fn generation_tool(content: &[u8]) -> Option<String> {
    let mut text = String::new();
    match ZipArchive::new(Cursor::new(content)) {
        Ok(mut archive) => archive.by_name(DEFAULT).ok()?.read_to_string(&mut text).ok()?,
        Err(_) => (&*content).read_to_string(&mut text).ok()?,
    };
    let mut reader = quick_xml::Reader::from_str(&text);
    loop {
        match reader.read_event().ok()? {
            Event::Start(root) | Event::Empty(root) => {
                let attribute = root.try_get_attribute("generationTool").ok()??;
                return Some(attribute.normalized_value(quick_xml::XmlVersion::Implicit1_0).ok()?.into_owned());
            }
            Event::Eof => return None,
            _ => {}
        }
    }
}

fn write_connector(page: &mut Page, variable: &Variable) {
    if matches!(variable.causality, Causality::Local | Causality::Independent) {
        return;
    }
    let tag = element("ssd:Connector").with("name", variable.name.as_ref()).with("kind", causality(variable));
    page.nest(tag, |page| {
        page.empty(match &variable.data_type {
            Type::Real { unit, .. } => element("ssc:Real").with("unit", unit.name),
            // Tools that treat FMI 2.0 enumerations as integers accept no other type here.
            Type::Integer { .. } | Type::Enumeration { .. } => element("ssc:Integer"),
            Type::Boolean { .. } => element("ssc:Boolean"),
            Type::String { .. } => element("ssc:String"),
        });
    });
}

/// The units used by the connectors or parameters of these elements.
fn write_units(page: &mut Page, name: &'static str, parts: &[Element]) {
    page.nest(element(name), |page| {
        for unit in units(parts.iter().flat_map(|part| part.model.variables())) {
            page.nest(element("ssc:Unit").with("name", unit.name), |page| write_base_unit(page, "ssc:BaseUnit", unit));
        }
    });
}
