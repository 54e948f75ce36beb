//! The archives: reproducible, complete, and valid for the tools that read them.

use crate::prelude::*;
use std::collections::{BTreeSet, HashMap, HashSet};
use std::io::{Cursor, Read};
use std::sync::{Arc, LazyLock};

use fmu_export::package::{Written, binaries_of, platform};
use fmu_export::variable::{Type, Value, Variable};
use fmu_export::{ModelType, Standard};
use magnetic_bearing::fmu::catalogue;
use magnetic_bearing::package;
use roxmltree::{Document, Node};
use zip::{CompressionMethod, ZipArchive};

/// The names of the archives of closed loops.
fn systems() -> impl Iterator<Item = String> {
    MACHINES.iter().map(|machine| format!("{}.ssp", machine.models[0].0))
}

/// Packages all machines into the named folder: names and contents of the archives.
fn packaged(name: &str) -> Vec<(String, Vec<u8>)> {
    let binaries = package::binaries(&[]).expect("the library is built with the tests");
    let folder = folder(&format!("package/{name}"));
    let written = package::package(&binaries, &MACHINES.each_ref(), false, &folder).expect("the archives");
    let read = |written: Written| {
        let bytes = fs::read(&written.path).expect("an archive");
        assert_eq!(bytes.len(), written.bytes);
        let name = written.path.file_name().and_then(|name| name.to_str()).expect("a name");
        (name.to_owned(), bytes)
    };
    written.into_iter().map(read).collect()
}

/// The archives of all machines; those of FMI 2.0 come first, in the order of the catalogue.
static ARCHIVES: LazyLock<Vec<(String, Vec<u8>)>> = LazyLock::new(|| packaged("once"));

/// The models, and their archives for FMI 2.0.
fn fmus() -> Vec<(Arc<ModelType>, &'static [u8])> {
    catalogue().iter().cloned().zip(ARCHIVES.iter().map(|(_, bytes)| bytes.as_slice())).collect()
}

/// The members of an archive by name.
pub fn members(bytes: &[u8]) -> BTreeMap<String, Vec<u8>> {
    let mut archive = ZipArchive::new(Cursor::new(bytes)).expect("a zip archive");
    let mut members = BTreeMap::new();
    for index in 0..archive.len() {
        let mut member = archive.by_index(index).expect("a member");
        let mut content = Vec::new();
        member.read_to_end(&mut content).expect("sound content, by its checksum");
        let name = member.name().expect("a name in UTF-8").into_owned();
        assert!(!members.contains_key(&name), "{name} twice");
        members.insert(name, content);
    }
    members
}

/// The members of the named archive.
fn archive(name: &str) -> BTreeMap<String, Vec<u8>> {
    members(bytes_of(name))
}

fn bytes_of(name: &str) -> &'static [u8] {
    ARCHIVES.iter().find(|(known, _)| known == name).map(|(_, bytes)| bytes.as_slice()).expect("the archive")
}

/// The text of a member.
fn text(members: &BTreeMap<String, Vec<u8>>, name: &str) -> String {
    String::from_utf8(members[name].clone()).unwrap_or_else(|_| panic!("{name} is UTF-8"))
}

/// Fails if a member contains the time.
#[test]
fn packaging_is_reproducible() {
    let of = |ending: &'static str| MODELS.iter().map(move |model| format!("{model}{ending}"));
    let wanted = of(".fmu").chain(of("_fmi3.fmu")).chain(systems());
    assert!(ARCHIVES.iter().map(|(name, _)| name.clone()).eq(wanted), "FMUs, then those of FMI 3.0, then systems");
    for ((name, one), (_, other)) in ARCHIVES.iter().zip(packaged("again")) {
        assert!(*one == other, "{name} differs");
    }
}

/// No member contains the time or the owner, and no text the folder of the project.
#[test]
fn archives_contain_no_traces_of_the_build() {
    for (_, bytes) in ARCHIVES.iter() {
        let mut archive = ZipArchive::new(Cursor::new(bytes)).expect("a zip archive");
        for index in 0..archive.len() {
            let member = archive.by_index(index).expect("a member");
            let name = member.name().expect("a name in UTF-8").into_owned();
            let time = member.last_modified().expect("a time");
            assert_eq!((time.year(), time.month(), time.day(), time.hour()), (1980, 1, 1, 0), "{name}");
            assert_eq!(member.unix_mode().map(|mode| mode & 0o777), Some(0o644), "{name}");
            assert!(!name.starts_with('/') && !name.contains("..") && !name.contains('\\'), "{name}");
            let wanted = if name.ends_with(".fmu") { CompressionMethod::Stored } else { CompressionMethod::Deflated };
            assert_eq!(member.compression(), wanted, "{name}");
        }
        let home = env!("CARGO_MANIFEST_DIR");
        let members = members(bytes);
        let texts = [".xml", ".html", ".ssd", ".ssv", ".txt"];
        for name in members.keys().filter(|name| texts.iter().any(|ending| name.ends_with(ending))) {
            assert!(!text(&members, name).contains(home), "{name} names {home}");
        }
    }
}

/// Fails if there is a member too many or too few, or the documentation omits a variable.
#[test]
fn an_fmu_contains_exactly_its_members() {
    let platform = platform().expect("a platform that FMI 2.0 knows");
    // The library as built, except for the folders of this machine in it.
    let library = binaries_of(&package::built_library().expect("the library")).expect("the library");
    let library = library.places(Standard::Fmi2)[0].content.to_vec();
    for (kind, bytes) in fmus() {
        let name = kind.info.name;
        // Streaming readers need the description first.
        let mut archive = ZipArchive::new(Cursor::new(bytes)).expect("a zip archive");
        assert_eq!(archive.by_index(0).expect("a member").name().expect("a name"), "modelDescription.xml");
        let mut members = members(bytes);
        let binary = members.remove(&format!("binaries/{}/{name}.{}", platform.name, platform.ending));
        assert!(binary.is_some_and(|binary| binary == library), "{name}: the binary is the library that was built");
        assert!(text(&members, "modelDescription.xml") == kind.xml(), "{name}: the model description");
        let identifier = format!("modelIdentifier=\"{name}\"");
        let wanted: [(&str, &[&str]); 6] = [
            ("documentation/index.html", &["<!DOCTYPE html>", name]),
            ("documentation/licenses/LICENSE-APACHE.txt", &["Apache License", "Version 2.0"]),
            ("documentation/licenses/LICENSE-MIT.txt", &["Permission is hereby granted"]),
            ("documentation/licenses/THIRD-PARTY.txt", &["nalgebra", "libm", "serde"]),
            ("model.png", &[]),
            ("modelDescription.xml", &[&identifier]),
        ];
        assert!(members.keys().eq(wanted.iter().map(|(file, _)| file)), "{name}: {:?}", members.keys());
        for (file, words) in wanted.iter().filter(|(_, words)| !words.is_empty()) {
            assert_contains(&text(&members, file), words);
        }
        let page = text(&members, "documentation/index.html");
        for variable in kind.variables() {
            let array = variable.name.split('[').next().expect("a name");
            assert!(page.contains(array), "{name}: {} is not in the documentation", variable.name);
        }
        for loading in ["src=\"http", "<script src", "@import", "<link rel=\"stylesheet\" href=\"http"] {
            assert!(!page.contains(loading), "{name}: the page loads something: {loading}");
        }
    }
}

/// Prefixes and namespaces that all tools accept.
const SPACES: [(&str, &str); 4] = [
    ("ssd", "http://ssp-standard.org/SSP1/SystemStructureDescription"),
    ("ssc", "http://ssp-standard.org/SSP1/SystemStructureCommon"),
    ("ssv", "http://ssp-standard.org/SSP1/SystemStructureParameterValues"),
    ("oms", "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"),
];

fn named<'a>(root: Node<'a, 'a>, name: &'static str) -> impl Iterator<Item = Node<'a, 'a>> {
    root.descendants().filter(move |node| node.is_element() && node.tag_name().name() == name)
}

/// Fails if an FMU in a system differs by a byte.
#[test]
fn systems_contain_the_fmus_unchanged() {
    for (name, structures, sets, fmus) in [
        (
            "MagneticBearing",
            "PaperSimulation.ssd SystemStructure.ssd",
            "paper-controller paper-estimator paper-plant unbalanced-plant",
            &MODELS[..3],
        ),
        ("MagneticSpindle", "SystemStructure.ssd", "spindle-controller spindle-estimator spindle-plant", &MODELS[3..6]),
        ("AxialBearing", "SystemStructure.ssd", "axial-controller axial-plant", &MODELS[12..]),
    ] {
        let system = archive(&format!("{name}.ssp"));
        let inside = fmus.iter().map(|fmu| format!("resources/{fmu}.fmu"));
        let sets = sets.split(' ').map(|set| format!("resources/{set}.ssv"));
        let wanted: BTreeSet<_> = structures.split(' ').map(String::from).chain(sets).chain(inside).collect();
        assert_eq!(system.keys().cloned().collect::<BTreeSet<_>>(), wanted);
        for fmu in fmus.iter().map(|fmu| format!("{fmu}.fmu")) {
            assert!(system[&format!("resources/{fmu}")] == bytes_of(&fmu), "{fmu}");
        }
    }
}

/// The name of a component of a system, and its model.
fn component<'a>(node: Node<'a, 'a>) -> (&'a str, Arc<ModelType>) {
    let model = node.attribute("source").and_then(|source| Path::new(source).file_stem()?.to_str());
    let kind = magnetic_bearing::fmu::find(model.expect("a file")).expect("a model");
    (node.attribute("name").expect("a name"), kind)
}

/// The named variable.
fn variable<'k>(kind: &'k ModelType, name: &str) -> &'k Variable {
    let found = kind.variables().iter().find(|variable| variable.name == name);
    found.unwrap_or_else(|| panic!("{}.{name} is no variable", kind.info.name))
}

/// Number of settings of an element in its parameter set: an enumeration at its start value may be omitted.
fn settings_in_set(part: &Element) -> usize {
    let variables = part.model_type.variables();
    let is_stated = |(index, value): &&(usize, Value)| {
        let variable = &variables[*index];
        !matches!(variable.data_type, Type::Enumeration { .. }) || variable.start() != *value
    };
    part.settings.iter().filter(is_stated).count()
}

/// All elements have one of these namespaces.
fn are_of(root: Node<'_, '_>, file: &str, prefixes: &[&str]) {
    for node in root.descendants().filter(Node::is_element) {
        let prefix = node.tag_name().namespace().and_then(|space| node.lookup_prefix(space));
        assert!(prefix.is_some_and(|prefix| prefixes.contains(&prefix)), "{file}: {:?}: {prefix:?}", node.tag_name());
    }
}

/// These units are declared.
fn has_units<'a>(root: Node<'a, 'a>, file: &str, mut units: impl Iterator<Item = &'a str>) {
    let declared: HashSet<_> = named(root, "Unit").filter_map(|unit| unit.attribute("name")).collect();
    let missing = units.find(|unit| !unit.is_empty() && !declared.contains(unit));
    assert_eq!(missing, None, "{file}: this unit is not declared");
}

/// Values of a parameter set by name.
pub fn parameters(text: &str) -> BTreeMap<String, f64> {
    let value = |text: &str| match text {
        "true" => 1.0,
        "false" => 0.0,
        number => number.parse().unwrap_or_else(|_| panic!("{number} is no number")),
    };
    let of = |node: Node<'_, '_>| {
        let given = node.first_element_child()?.attribute("value")?;
        Some((node.attribute("name")?.to_owned(), value(given)))
    };
    let document = Document::parse(text).expect("XML");
    named(document.root_element(), "Parameter").map(|node| of(node).expect("a name and a value")).collect()
}

/// A parameter set has the settings of an element in the scenario, each once.
fn has_settings(text: &str, file: &str, part: &Element, scenario: &Scenario, may_choose: bool) {
    let document = Document::parse(text).unwrap_or_else(|error| panic!("{file}: {error}"));
    let root = document.root_element();
    assert_contains(text, &["<ssv:ParameterSet ", "version=\"1.0\""]);
    are_of(root, file, &["ssv", "ssc"]);
    has_units(root, file, named(root, "Parameter").filter_map(|node| node.first_element_child()?.attribute("unit")));
    let values = parameters(text);
    for node in named(root, "Parameter") {
        let name = node.attribute("name").expect("a name");
        let of_table = variable(&part.model_type, name);
        assert!(of_table.is_settable(), "{file}: {name} can be set");
        assert!(may_choose || !matches!(of_table.data_type, Type::Enumeration { .. }), "{file}: {name}");
        let wanted = scenario.value(&part.name, name).expect("a value").as_f64();
        assert_eq!(values[name].to_bits(), wanted.to_bits(), "{file}: {name}");
        let unit = node.first_element_child().and_then(|value| value.attribute("unit")).unwrap_or_default();
        assert_eq!(unit, of_table.unit_name(), "{file}: {name}");
    }
    assert_eq!([values.len(), named(root, "Parameter").count()], [settings_in_set(part); 2], "{file}");
}

/// Fails if a connection ends at `i[9]`, if a value in a parameter set differs, or if the default structure takes its parameters from the
/// paper's scenario: libcosim and ecos ignore enumerations.
#[test]
fn systems_connect_existing_variables_and_name_existing_files() {
    let paper = ("MagneticBearing.ssp".to_owned(), "PaperSimulation.ssd", "paper");
    let sets = MACHINES.iter().map(|machine| if machine.name == "planar" { "unbalanced" } else { machine.name });
    let mut names = HashSet::new();
    for (system, file, set) in systems().zip(sets).map(|(name, set)| (name, "SystemStructure.ssd", set)).chain([paper])
    {
        let system = archive(&system);
        let text = text(&system, file);
        let document = Document::parse(&text).unwrap_or_else(|error| panic!("{file}: {error}"));
        let root = document.root_element();
        for (prefix, space) in SPACES {
            assert_eq!(root.lookup_namespace_uri(Some(prefix)), Some(space), "{file}");
        }
        assert_contains(&text, &["<ssd:SystemStructureDescription ", "version=\"1.0\""]);
        are_of(root, file, &["ssd", "ssc", "osp", "oms"]);
        // OMSimulator opens all structures of an archive, reads its step at the end of the system, and requires distinct names.
        assert!(names.insert(root.attribute("name").expect("a name").to_owned()), "{file}: its name is another's");
        let last = named(root, "System").next().and_then(|node| node.last_element_child()).expect("a last element");
        assert_eq!(last.tag_name().name(), "Annotations", "{file}");
        let annotation = last.first_element_child().expect("an annotation");
        assert_eq!(annotation.attribute("type"), Some("org.openmodelica"), "{file}");
        let master = named(annotation, "FixedStepMaster").next().expect("a master");
        assert_eq!((master.attribute("description"), master.attribute("stepSize")), (Some("oms-ma"), Some("1e-4")));
        for source in named(root, "Component").chain(named(root, "ParameterBinding")) {
            let source = source.attribute("source").expect("a source");
            assert!(system.contains_key(source), "{file}: {source} is not in the archive");
        }
        // One set for every element with settings, bound at the element: some tools look only there.
        let scenario = open(set, &[]);
        for node in named(root, "Component") {
            let (element, _) = component(node);
            let bound: Vec<_> = named(node, "ParameterBinding").filter_map(|node| node.attribute("source")).collect();
            let part = scenario.elements.iter().find(|part| part.name == element).expect("an element");
            let wanted = (settings_in_set(part) > 0).then(|| format!("resources/{set}-{element}.ssv"));
            assert_eq!(bound, wanted.iter().collect::<Vec<_>>(), "{file}: {element}");
            if let Some(of_set) = wanted {
                has_settings(&self::text(&system, &of_set), &of_set, part, &scenario, file != "SystemStructure.ssd");
            }
        }

        // Connectors by element and name: kind, type, unit. They match the variables, and there are none at the root.
        let mut connectors = HashMap::new();
        for node in named(root, "Component") {
            let (element, kind) = component(node);
            for connector in named(node, "Connector") {
                let name = connector.attribute("name").expect("a name");
                let of_type = connector.first_element_child().expect("a type");
                let unit = of_type.attribute("unit").unwrap_or_default();
                assert_eq!(unit, variable(&kind, name).unit_name(), "{file}: {element}.{name}");
                let entry = (connector.attribute("kind").expect("a kind"), of_type.tag_name().name(), unit);
                assert!(connectors.insert([element, name], entry).is_none(), "{file}: {element}.{name} twice");
            }
        }
        assert_eq!(named(root, "Connector").count(), connectors.len(), "{file}: connectors belong to components alone");
        has_units(root, file, connectors.values().map(|(_, _, unit)| *unit));

        // Connections join outputs to inputs of the same type and unit, and are those of the loop.
        let mut found = Vec::new();
        for connection in named(root, "Connection") {
            let end = |element, connector| {
                let path = [element, connector].map(|name| connection.attribute(name).expect("element to element"));
                (path, *connectors.get(&path).unwrap_or_else(|| panic!("{file}: {path:?} is no connector")))
            };
            let (from, (from_kind, from_type, from_unit)) = end("startElement", "startConnector");
            let (to, (to_kind, to_type, to_unit)) = end("endElement", "endConnector");
            assert_eq!((from_kind, to_kind), ("output", "input"), "{file}: {from:?} to {to:?}");
            assert_eq!((from_type, from_unit), (to_type, to_unit), "{file}: {from:?} to {to:?}");
            found.push([from, to].map(|path| path.join(".")));
        }
        let of_loop = scenario.connections().into_iter().filter(|[_, (to, _)]| *to < 3);
        let mut wanted: Vec<_> = of_loop.map(|connection| connection.map(|place| scenario.path(place))).collect();
        found.sort();
        wanted.sort();
        assert_eq!(found, wanted, "{file}: all connections of the loop, each once");
        let experiment = named(root, "DefaultExperiment").next().expect("a default experiment");
        assert_eq!((experiment.attribute("startTime"), experiment.attribute("stopTime")), (Some("0"), Some("0.4")));
    }
}

/// The bytes of an FMU do not depend on whether tests were built before: the dependencies of the tests enable no feature of a
/// crate in the library.
#[test]
fn tests_do_not_change_the_library() {
    let features = |edges: &str| {
        let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into()));
        cargo.current_dir(env!("CARGO_MANIFEST_DIR")).args(["tree", "--locked", "--offline", "--no-dedupe"]);
        let output = cargo.args(["--prefix", "none", "--edges", edges]).output().expect("cargo runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = String::from_utf8(output.stdout).expect("UTF-8");
        let lines = text.lines().filter(|line| line.contains(" feature "));
        lines.map(|line| line.trim_end_matches(" (*)").to_owned()).collect::<BTreeSet<_>>()
    };
    let library = features("normal,build,features");
    assert!(library.len() > 50, "only {} features were found", library.len());
    let crates: HashSet<&str> = library.iter().filter_map(|line| line.split(' ').next()).collect();
    let more: Vec<String> = features("normal,build,dev,features").difference(&library).cloned().collect();
    let more: Vec<_> = more.iter().filter(|line| crates.contains(line.split(' ').next().unwrap_or_default())).collect();
    assert!(more.is_empty(), "the tests switch on {more:?}");
}
