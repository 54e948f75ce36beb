//! The model descriptions are current, valid, and agree with the interface.
//!
//! Users rely on those in `modelDescription/`: names, references, units, start values, capabilities.

use crate::prelude::*;
use std::collections::{HashMap, HashSet};
use std::fs;

use fmu_export::{Standard, description};
use magnetic_bearing::fmu;
use magnetic_bearing::package;
use roxmltree::Document;

#[test]
fn the_checked_in_files_are_current() {
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

/// Names, dependencies, limits, start values, nominal values and display units, as checked when a model is packaged.
#[test]
fn no_table_has_a_mistake() {
    for entry in fmu::catalogue().iter() {
        assert_eq!(entry.problems(), [""; 0], "{}", entry.info.name);
    }
}

/// Fails if descriptions are missing, if a unit or a nominal value is not written, or if a display unit equals the unit.
#[test]
fn every_variable_is_described() {
    for entry in fmu::catalogue().iter() {
        let model = entry.info.name;
        for Variable { name, description, .. } in entry.variables() {
            let is_good = description.len() > 8 && !description.contains(['{', '}']) && !description.ends_with('.');
            assert!(is_good, "{model}.{name}: {description}");
        }
        let document = Document::parse(entry.xml()).expect("well-formed XML");
        for real in document.descendants().filter(|node| node.has_tag_name("Real")) {
            let [unit, display_unit, nominal] = ["unit", "displayUnit", "nominal"].map(|name| real.attribute(name));
            assert!(unit.is_some() && display_unit != unit && nominal.is_some(), "{model}: {:?}", real.parent());
        }
        assert!(entry.variables().len() > 30, "{model}");
    }
}

/// Some tools refuse connections between different units.
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

/// Fails if the GUID depends only on the name of the model or the names of the variables.
#[test]
fn the_guid_depends_on_the_whole_interface() {
    type Change = fn(&mut Vec<Variable>);
    let plant = fmu::find("MagneticBearing").expect("a model of the catalogue");
    let guid = |change: Change| {
        let mut variables = plant.variables().to_vec();
        change(&mut variables);
        description::write(&plant.info, plant.capabilities, &variables, Standard::Fmi2).token
    };
    let now = plant.guid();
    assert_eq!(guid(|_| ()), now, "without a change the GUID stays");
    let changes: [(&str, Change); 5] = [
        ("a name", |variables| variables.last_mut().expect("variables").name = "another".into()),
        ("a description", |variables| variables[0].description = "Another one".into()),
        ("a start", |variables| {
            let Type::Real { start, .. } = &mut variables[0].data_type else { panic!("m is Real") };
            *start = 6.8;
        }),
        ("the order", |variables| variables.swap(0, 1)),
        ("a variable less", |variables| _ = variables.pop()),
    ];
    for (what, change) in changes {
        assert_ne!(guid(change), now, "{what} was changed");
    }
    let models = fmu::catalogue();
    let guids: HashSet<_> = models.iter().map(|model| model.guid()).collect();
    assert_eq!(guids.len(), models.len(), "every model has a GUID of its own");
    for model in models.iter() {
        let document = Document::parse(model.xml()).expect("well-formed XML");
        assert_eq!(document.root_element().attribute("guid"), Some(model.guid()), "{}", model.info.name);
    }
}
