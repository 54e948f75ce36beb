//! Writes `modelDescription.xml` from the table of variables of a model.

pub(crate) mod arrays;
mod fmi2;
mod fmi3;

use sha2::{Digest, Sha256};

use crate::interface::logger::Category;
use crate::model::{Capabilities, Info};
use crate::unit::Unit;
use crate::variable::{Causality, Dependency, Enumeration, Type, Variability, Variable};
use crate::xml::{Element, Page, element, real, write_base_unit};

/// A version of the standard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Standard {
    /// FMI 2.0.
    Fmi2,
    /// FMI 3.0.
    Fmi3 {
        /// Whether `x[1]`, `x[2]`, … are one array `x`. Otherwise they are separate variables, as in FMI 2.0, which more tools
        /// accept.
        arrays: bool,
    },
}

impl Standard {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Fmi2, Self::Fmi3 { arrays: false }, Self::Fmi3 { arrays: true }];
    /// Those of FMI 3.0.
    pub const OF_FMI3: [Self; 2] = [Self::Fmi3 { arrays: false }, Self::Fmi3 { arrays: true }];
    /// Those that this crate is built with, by its features `fmi2` and `fmi3`; without arrays.
    pub const BUILT: &[Self] = &[
        #[cfg(feature = "fmi2")]
        Self::Fmi2,
        #[cfg(feature = "fmi3")]
        Self::Fmi3 { arrays: false },
    ];

    /// Name of the FMU of a model, without the ending: `Name` for FMI 2.0, `Name_fmi3` for FMI 3.0.
    pub fn file_stem(self, model: &str) -> String {
        match self {
            Self::Fmi2 => model.to_owned(),
            Self::Fmi3 { .. } => format!("{model}_fmi3"),
        }
    }

    /// Number of the version.
    pub fn version(self) -> &'static str {
        match self {
            Self::Fmi2 => "2.0",
            Self::Fmi3 { .. } => "3.0",
        }
    }
}

/// A model description.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Description {
    /// GUID, with braces: the first half of the SHA-256 of the description with an empty GUID, so that it changes with the
    /// interface and a binary matches its description only. In FMI 3.0 it is the instantiation token.
    pub token: String,
    /// The text of `modelDescription.xml`.
    pub xml: String,
}

/// The model description by a standard.
pub fn write(info: &Info, capabilities: Capabilities, variables: &[Variable], standard: Standard) -> Description {
    let xml = match standard {
        Standard::Fmi2 => fmi2::document(info, capabilities, variables),
        Standard::Fmi3 { arrays } => fmi3::document(info, capabilities, variables, arrays),
    };
    let digest = Sha256::digest(xml.as_bytes());
    let digits: String = digest[..16].iter().map(|byte| format!("{byte:02x}")).collect();
    let token =
        format!("{{{}-{}-{}-{}-{}}}", &digits[..8], &digits[8..12], &digits[12..16], &digits[16..20], &digits[20..]);
    // In attributes, quotation marks are written as `&quot;`.
    let attribute = match standard {
        Standard::Fmi2 => "guid",
        Standard::Fmi3 { .. } => "instantiationToken",
    };
    let xml = xml.replacen(&format!(r#"{attribute}="""#), &format!(r#"{attribute}="{token}""#), 1);
    Description { token, xml }
}

fn causality(variable: &Variable) -> &'static str {
    match variable.causality {
        Causality::Parameter => "parameter",
        Causality::Input => "input",
        Causality::Output => "output",
        Causality::Local => "local",
        Causality::CalculatedParameter => "calculatedParameter",
        Causality::Independent => "independent",
    }
}

fn variability(variable: &Variable) -> &'static str {
    match variable.variability {
        Variability::Constant => "constant",
        Variability::Fixed => "fixed",
        Variability::Tunable => "tunable",
        Variability::Discrete => "discrete",
        Variability::Continuous => "continuous",
    }
}

fn initial(variable: &Variable) -> Option<&'static str> {
    match variable.causality {
        Causality::Input | Causality::Independent => None,
        _ if variable.has_start() => Some("exact"),
        _ => Some("calculated"),
    }
}

/// Whether the model structure lists it as an initial unknown.
fn is_initial_unknown(variable: &Variable) -> bool {
    let listed = matches!(variable.causality, Causality::Output | Causality::CalculatedParameter);
    variable.is_computed() && (listed || variable.state || variable.derivative_of.is_some())
}

/// The root element; `identity` is the attribute of the GUID or token, initially empty.
fn root(info: &Info, version: &str, identity: &'static str) -> Element {
    let given = |text: &'static str| Some(text).filter(|text| !text.is_empty());
    element("fmiModelDescription")
        .with("fmiVersion", version)
        .with("modelName", info.name)
        .with(identity, "")
        .with("description", info.description)
        .with_some("author", given(info.author))
        .with_some("version", given(info.version))
        .with_some("license", given(info.license))
        .with_some("generationTool", given(info.tool))
        .with("variableNamingConvention", "structured")
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

/// `prefix` begins the names of statuses.
fn write_log_categories(page: &mut Page, prefix: &str) {
    page.nest(element("LogCategories"), |page| {
        for category in Category::ALL {
            let name = category.name().to_string_lossy();
            page.empty(element("Category").with("name", name).with("description", category.description(prefix)));
        }
    });
}

fn default_experiment(info: &Info) -> Element {
    element("DefaultExperiment")
        .with("startTime", "0")
        .with("stopTime", real(info.stop_s))
        .with("tolerance", real(info.tolerance))
        .with("stepSize", real(info.step_s))
}

fn enumerations(variables: &[Variable]) -> Vec<&'static Enumeration> {
    let mut enumerations: Vec<&'static Enumeration> = Vec::new();
    for variable in variables {
        if let Type::Enumeration { items, .. } = variable.data_type
            && enumerations.iter().all(|known| known.name != items.name)
        {
            enumerations.push(items);
        }
    }
    enumerations
}

fn kind_of(how: Dependency) -> &'static str {
    match how {
        Dependency::Any => "dependent",
        Dependency::Constant => "constant",
        Dependency::Fixed => "fixed",
    }
}
