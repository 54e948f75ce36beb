//! The model descriptions are current, valid, and agree with the interface.
//!
//! Those under review in `modelDescription/` are what users rely on: names, references, units, start values, capabilities.

use std::collections::{HashMap, HashSet};
use std::fs;
use std::path::Path;
use std::sync::Arc;

use crate::support::is_plant;
use fmu_export::variable::{Causality, Type, Variable};
use fmu_export::{ModelType, Standard, description};
use magnetic_bearing::fmu;
use magnetic_bearing::package;
use roxmltree::{Document, Node};

fn model_type(name: &str) -> Arc<ModelType> {
    fmu::find(name).expect("a model of the catalogue")
}

fn child<'a>(node: Node<'a, 'a>, name: &str) -> Node<'a, 'a> {
    node.children().find(|child| child.has_tag_name(name)).unwrap_or_else(|| panic!("{name} is there"))
}

fn children<'a>(node: Node<'a, 'a>, name: &'static str) -> impl Iterator<Item = Node<'a, 'a>> {
    child(node, name).children().filter(Node::is_element)
}

/// Looks at every model description.
fn each(look: impl Fn(&str, Node<'_, '_>)) {
    for entry in fmu::catalogue().iter() {
        let document = Document::parse(entry.xml()).expect("well-formed XML");
        look(entry.info.name, document.root_element());
    }
}

/// Fails if a checked-in file differs.
#[test]
fn the_files_under_review_are_current() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("modelDescription");
    let models = fmu::catalogue();
    let standards = [(Standard::Fmi2, ".xml"), (Standard::Fmi3 { arrays: false }, "_fmi3.xml")];
    for (entry, (standard, end)) in models.iter().flat_map(|entry| standards.map(|standard| (entry, standard))) {
        let name = format!("{}{end}", entry.info.name);
        let file = fs::read_to_string(folder.join(&name)).unwrap_or_default();
        let is_current = file == entry.description(standard).xml;
        assert!(is_current, "modelDescription/{name} is stale: run `cargo run -- describe`");
    }
    let file = fs::read_to_string(folder.join("VARIABLES.md")).unwrap_or_default();
    assert!(file == package::variables(), "modelDescription/VARIABLES.md is stale: run `cargo run -- describe`");
}

/// Names and dependencies, limits and start values, nominal values and units for display, as they are checked when a model is packaged.
#[test]
fn no_table_has_a_mistake() {
    for entry in fmu::catalogue().iter() {
        assert_eq!(entry.problems(), [""; 0], "{}", entry.info.name);
    }
}

/// Fails if descriptions are left out, and if the unit itself is named as the unit for display.
#[test]
fn every_variable_can_be_read_by_people() {
    each(|model, root| {
        let units: HashSet<_> = children(root, "UnitDefinitions").map(|unit| unit.attribute("name")).collect();
        let mut number = 0;
        for variable in children(root, "ModelVariables") {
            let name = variable.attribute("name").expect("a name");
            let description = variable.attribute("description").unwrap_or_default();
            assert!(description.len() > 8, "{model}.{name} has no description");
            assert!(!description.contains(['{', '}']), "{model}.{name}: {description}");
            assert!(!description.ends_with('.'), "{model}.{name}: {description}");
            let kind = variable.first_element_child().expect("a variable has a type");
            if kind.has_tag_name("Real") {
                let unit = kind.attribute("unit");
                assert!(unit.is_some() && units.contains(&unit), "{model}.{name}: the unit {unit:?} is not declared");
                assert_ne!(kind.attribute("displayUnit"), unit, "{model}.{name}");
                assert!(kind.attribute("nominal").is_some(), "{model}.{name} has no nominal");
            }
            number += 1;
        }
        assert!(number > 30, "{model} has {number} variables");
    });
}

/// Fails if a unit is declared twice.
#[test]
fn units_are_declared_once_and_by_their_base_units() {
    // Name, exponents as they are written, and what displays show for 1.
    // The first unit for display is the one that is proposed, which may be the unit itself.
    type Declared = (&'static str, &'static [(&'static str, &'static str)], &'static [(&'static str, f64)]);
    const UNITS: &[Declared] = &[
        ("1", &[], &[]),
        ("kg", &[("kg", "1")], &[("kg", 1.0), ("g", 1e3)]),
        ("m", &[("m", "1")], &[("µm", 1e6), ("mm", 1e3)]),
        ("m/s", &[("m", "1"), ("s", "-1")], &[("mm/s", 1e3)]),
        ("m/s2", &[("m", "1"), ("s", "-2")], &[]),
        ("V", &[("kg", "1"), ("m", "2"), ("s", "-3"), ("A", "-1")], &[]),
        ("Ohm", &[("kg", "1"), ("m", "2"), ("s", "-3"), ("A", "-2")], &[]),
        ("H", &[("kg", "1"), ("m", "2"), ("s", "-2"), ("A", "-2")], &[("mH", 1e3)]),
        ("Wb", &[("kg", "1"), ("m", "2"), ("s", "-2"), ("A", "-1")], &[("mWb", 1e3)]),
        ("N/A", &[("kg", "1"), ("m", "1"), ("s", "-2"), ("A", "-1")], &[]),
        ("N/m", &[("kg", "1"), ("s", "-2")], &[("N/µm", 1e-6)]),
        ("N.s/m", &[("kg", "1"), ("s", "-1")], &[]),
        ("s", &[("s", "1")], &[("ms", 1e3), ("µs", 1e6)]),
        ("Hz", &[("s", "-1")], &[("kHz", 1e-3)]),
        ("rad", &[("rad", "1")], &[("deg", 57.29577951308232)]),
        ("rad/s", &[("rad", "1"), ("s", "-1")], &[("rpm", 9.549296585513721), ("Hz", 0.15915494309189535)]),
        ("A", &[("A", "1")], &[("A", 1.0), ("mA", 1e3)]),
        ("N", &[("kg", "1"), ("m", "1"), ("s", "-2")], &[]),
        ("N.m2/A2", &[("kg", "1"), ("m", "3"), ("s", "-2"), ("A", "-2")], &[("N.mm2/A2", 1e6)]),
        ("kg.m", &[("kg", "1"), ("m", "1")], &[("g.mm", 1e6)]),
        ("kg.m2", &[("kg", "1"), ("m", "2")], &[]),
        ("N.m", &[("kg", "1"), ("m", "2"), ("s", "-2")], &[]),
        ("rad/s2", &[("rad", "1"), ("s", "-2")], &[]),
    ];
    each(|model, root| {
        let mut seen = HashSet::new();
        for unit in root.descendants().filter(|node| node.has_tag_name("Unit")) {
            let name = unit.attribute("name").expect("a name");
            assert!(seen.insert(name.to_owned()), "{model}: the unit {name} is declared twice");
            let (_, base, displays) =
                UNITS.iter().find(|known| known.0 == name).unwrap_or_else(|| panic!("{model}: the unit {name} is new"));
            let of = |tag: &'static str| unit.children().filter(move |node| node.has_tag_name(tag));
            let declared: Vec<_> = of("BaseUnit").flat_map(|node| node.attributes()).collect();
            let declared: Vec<_> = declared.iter().map(|attribute| (attribute.name(), attribute.value())).collect();
            assert_eq!(declared, *base, "{model}: base units of {name}");
            let declared: Vec<_> = of("DisplayUnit")
                .map(|node| {
                    (
                        node.attribute("name").expect("a name"),
                        node.attribute("factor").and_then(|factor| factor.parse().ok()).expect("a factor"),
                    )
                })
                .collect();
            assert_eq!(declared, *displays, "{model}: units for display of {name}");
        }
    });
}

/// Fails if a dependency is not given, if a sample is said to follow something, and if a force is said to follow no input.
#[test]
fn what_acts_on_an_output_at_once_is_said_of_every_output() {
    for entry in fmu::catalogue().iter() {
        let model = entry.info.name;
        for output in entry.variables().iter().filter(|variable| variable.causality == Causality::Output) {
            let name = &output.name;
            let acting = output.depends_on.as_ref().unwrap_or_else(|| panic!("{model}.{name}: nothing said"));
            if !output.is_continuous() && !name.ends_with("contact") {
                assert!(acting.is_empty(), "{model}.{name} is a sample: {acting:?}");
            }
            if is_plant(model) && ["F", "perturbation.", "A.F", "B.F", "X.F"].iter().any(|head| name.starts_with(head))
            {
                let acts = |known: &Variable| acting.iter().any(|(name, _)| *name == known.name);
                let mut inputs = entry.variables().iter().filter(|known| known.causality == Causality::Input);
                assert!(inputs.any(acts), "{model}.{name}: {acting:?}");
            }
        }
    }
}

/// The same quantity has the same unit at both ends of what is usually connected: some tools refuse anything else.
#[test]
fn equal_names_have_equal_units() {
    let mut units: HashMap<String, (&str, String)> = HashMap::new();
    for entry in fmu::catalogue().iter() {
        for variable in entry.variables() {
            if let Type::Real { unit, .. } = &variable.data_type {
                let (other, known) =
                    units.entry(variable.name.to_string()).or_insert((entry.info.name, unit.name.to_owned()));
                assert_eq!(known, unit.name, "{} in {other} and in {}", variable.name, entry.info.name);
            }
        }
    }
}

/// The GUID that the plant would have with something changed about its variables.
fn guid(change: impl Fn(&mut Vec<Variable>)) -> String {
    let plant = model_type("MagneticBearing");
    let mut variables = plant.variables().to_vec();
    change(&mut variables);
    description::write(&plant.info, plant.capabilities, &variables, Standard::Fmi2).token
}

fn named<'a>(variables: &'a mut [Variable], name: &str) -> &'a mut Variable {
    variables.iter_mut().find(|variable| variable.name == name).expect("a variable of the plant")
}

/// Fails if the GUID follows from the name of the model, or from those of the variables alone.
#[test]
fn the_guid_follows_the_interface() {
    let now = model_type("MagneticBearing").guid().to_owned();
    assert_eq!(guid(|_| {}), now, "without a change the GUID stays");
    type Change = fn(&mut Vec<Variable>);
    let changes: [(&str, Change); 5] = [
        // A variable that no other names as what it depends on.
        ("a name", |variables| named(variables, "solver.maxStep").name = "solver.step".into()),
        ("a description", |variables| named(variables, "m").description = "Another one".into()),
        ("a start", |variables| {
            let Type::Real { start, .. } = &mut variables[0].data_type else { panic!("m is Real") };
            *start = 6.8;
        }),
        ("the order", |variables| variables.swap(0, 1)),
        ("a variable less", |variables| variables.retain(|variable| variable.name != "solver.maxStep")),
    ];
    for (what, change) in changes {
        assert_ne!(guid(change), now, "{what} was changed");
    }
    let models = fmu::catalogue();
    let guids: HashSet<_> = models.iter().map(|model| model.guid()).collect();
    assert_eq!(guids.len(), models.len(), "every model has a GUID of its own");
    each(|model, root| assert_eq!(root.attribute("guid"), Some(model_type(model).guid()), "{model}"));
}
