//! Writes `modelDescription.xml` from the table of variables of a model.

pub(crate) mod arrays;
mod fmi2;
mod fmi3;

use std::collections::{BTreeMap, BTreeSet, HashMap};

use sha2::{Digest, Sha256};

use crate::interface::logger::Category;
use crate::model::{Capabilities, Info};
use crate::unit::Unit;
use crate::variable::{Causality, Dependency, Enumeration, Type, Variability, Variable};
use crate::xml::{Element, Page, element, real, write_base_unit};
use arrays::Group;

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
    let attribute = identity(standard);
    let xml = xml.replacen(&format!(r#"{attribute}="""#), &format!(r#"{attribute}="{token}""#), 1);
    Description { token, xml }
}

/// The attribute of the GUID or token.
fn identity(standard: Standard) -> &'static str {
    match standard {
        Standard::Fmi2 => "guid",
        Standard::Fmi3 { .. } => "instantiationToken",
    }
}

pub(crate) fn causality(variable: &Variable) -> &'static str {
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

/// The root element, with an empty GUID or token.
fn root(info: &Info, standard: Standard) -> Element {
    let given = |text: &'static str| Some(text).filter(|text| !text.is_empty());
    element("fmiModelDescription")
        .with("fmiVersion", standard.version())
        .with("modelName", info.name)
        .with(identity(standard), "")
        .with("description", info.description)
        .with_some("author", given(info.author))
        .with_some("version", given(info.version))
        .with_some("license", given(info.license))
        .with_some("generationTool", given(info.tool))
        .with("variableNamingConvention", "structured")
}

/// Units, enumerations, log categories, and the typical run; `prefix` begins the names of statuses.
fn write_definitions(
    page: &mut Page,
    info: &Info,
    prefix: &str,
    units: Vec<&Unit>,
    variables: &[Variable],
    write_enumeration: fn(&mut Page, &Enumeration),
) {
    // The schema allows no empty lists.
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
    page.nest(element("LogCategories"), |page| {
        for category in Category::ALL {
            let name = category.name().to_string_lossy();
            page.empty(element("Category").with("name", name).with("description", category.description(prefix)));
        }
    });
    page.empty(
        element("DefaultExperiment")
            .with("startTime", "0")
            .with("stopTime", real(info.stop_s))
            .with("tolerance", real(info.tolerance))
            .with("stepSize", real(info.step_s)),
    );
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

fn write_items(page: &mut Page, enumeration: &Enumeration) {
    for ((name, description), value) in enumeration.items.iter().zip(1..) {
        let item = element("Item").with("name", *name).with("value", i32::to_string(&value));
        page.empty(item.with("description", *description));
    }
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

/// An element with the attributes of a variable that do not depend on its type.
fn described(tag: &'static str, group: &Group<'_>) -> Element {
    let variable = group.first();
    element(tag)
        .with("name", group.name)
        .with("valueReference", group.reference.to_string())
        .with("description", group.description())
        .with("causality", causality(variable))
        .with("variability", variability(variable))
        .with_some("initial", initial(variable))
}

/// Adds the attributes of the type, except the start value.
fn with_type(tag: Element, variable: &Variable) -> Element {
    match &variable.data_type {
        Type::Real { unit, display, nominal, min, max, .. } => tag
            .with("unit", unit.name)
            // FMI Library, used by several importers, refuses a display unit equal to the unit.
            .with_some("displayUnit", display.filter(|display| *display != unit.name))
            .with_some("min", min.map(real))
            .with_some("max", max.map(real))
            .with_some("nominal", (variable.causality != Causality::Independent).then(|| real(*nominal))),
        Type::Integer { min, max, .. } => {
            tag.with_some("min", min.map(|min| min.to_string())).with_some("max", max.map(|max| max.to_string()))
        }
        Type::Enumeration { items, .. } => tag.with("declaredType", items.name),
        Type::Boolean { .. } | Type::String { .. } => tag,
    }
}

/// The start value as a text.
pub(crate) fn start(variable: &Variable) -> String {
    match &variable.data_type {
        Type::Real { start, .. } => real(*start),
        Type::Integer { start, .. } | Type::Enumeration { start, .. } => start.to_string(),
        Type::Boolean { start } => start.to_string(),
        Type::String { start } => start.to_string(),
    }
}

/// The number by which other elements refer to a row or its array, by the name of the row; `first` is that of the first variable.
fn numbers<'v>(groups: &[Group<'v>], first: usize) -> HashMap<&'v str, usize> {
    let numbers = |group: &Group<'v>| {
        let number = group.reference + first;
        group.rows.iter().map(move |row| (row.name.as_ref(), number))
    };
    groups.iter().flat_map(numbers).collect()
}

/// Outputs, derivatives of states, and initial unknowns as elements of these names, with their dependencies. `attribute` holds the
/// number of the unknown.
fn unknowns(
    groups: &[Group<'_>],
    numbers: &HashMap<&str, usize>,
    [output, derivative, initial]: [&'static str; 3],
    attribute: &'static str,
) -> [Vec<Element>; 3] {
    let number = |name: &str| numbers.get(name).copied();
    let listed = |numbers: &mut dyn Iterator<Item = usize>| {
        numbers.map(|number| number.to_string()).collect::<Vec<_>>().join(" ")
    };
    let unknown =
        |tag, group: &Group<'_>| element(tag).with(attribute, numbers[group.first().name.as_ref()].to_string());
    let dependent = |tag, group: &Group<'_>| {
        let unknown = unknown(tag, group);
        // Without `dependencies` it depends on all inputs and states.
        let named: Option<Vec<_>> = group.rows.iter().map(|row| row.depends_on.as_ref()).collect();
        let Some(named) = named else { return unknown };
        let mut depends_on: BTreeMap<usize, Dependency> = BTreeMap::new();
        for (name, how) in named.into_iter().flatten() {
            let Some(number) = number(name) else { continue };
            // If elements depend in different ways, the array depends in any way.
            let known = depends_on.entry(number).or_insert(*how);
            if *known != *how {
                *known = Dependency::Any;
            }
        }
        let kinds: Vec<_> = depends_on.values().map(|how| kind_of(*how)).collect();
        unknown
            .with("dependencies", listed(&mut depends_on.into_keys()))
            .with_some("dependenciesKind", (!kinds.is_empty()).then(|| kinds.join(" ")))
    };
    let starting = |group: &Group<'_>| {
        // Without `dependencies` an unknown depends on all knowns: parameters and inputs.
        let from: Option<Vec<_>> = group.rows.iter().map(|row| row.starts_from.as_ref()).collect();
        let from = from.map(|names| {
            let known: BTreeSet<_> = names.into_iter().flatten().filter_map(|name| number(name)).collect();
            listed(&mut known.into_iter())
        });
        unknown(initial, group).with_some("dependencies", from)
    };
    let outputs = groups.iter().filter(|group| group.first().causality == Causality::Output);
    // In the order of the state vector.
    let state = |group: &Group<'_>| group.first().derivative_of.as_ref().and_then(|state| number(state));
    let mut derivatives: Vec<_> = groups.iter().filter(|group| state(group).is_some()).collect();
    derivatives.sort_by_key(|group| state(group));
    let initial_unknowns = groups.iter().filter(|group| is_initial_unknown(group.first()));
    [
        outputs.map(|group| dependent(output, group)).collect(),
        derivatives.into_iter().map(|group| dependent(derivative, group)).collect(),
        initial_unknowns.map(starting).collect(),
    ]
}

fn kind_of(how: Dependency) -> &'static str {
    match how {
        Dependency::Any => "dependent",
        Dependency::Constant => "constant",
        Dependency::Fixed => "fixed",
    }
}
