//! The model descriptions are current, valid, and agree with the interface.
//!
//! The contract below is written by hand: scripts and saved set-ups of users rely on these names, units and starts.

use std::collections::{HashMap, HashSet};
use std::f64::consts::{FRAC_PI_3, PI};
use std::fs;
use std::path::Path;
use std::sync::Arc;

use crate::support::is_plant;
use fmu_export::variable::{Type, Variable};
use fmu_export::{ModelType, Standard, description};
use magnetic_bearing::fmu;
use magnetic_bearing::package;
use roxmltree::{Document, Node};

/// A start value of the contract.
#[derive(Clone, Copy)]
enum Start {
    /// The same for every element.
    Real(f64),
    /// One for each of three elements.
    Reals([f64; 3]),
    Integer(i32),
    Boolean(bool),
    /// Of an enumeration.
    Item(&'static [&'static str], i32),
    /// Computed: there is none.
    None,
    /// As `None`, of type Boolean.
    NoneBoolean,
    /// As `None`, of an enumeration.
    NoneItem,
    /// The model may choose; it must have one.
    AnyReal,
    /// As `AnyReal`, of type Integer.
    AnyInteger,
}
use Start::{AnyInteger, AnyReal, Boolean, Integer, Item, NoneBoolean, NoneItem, Real, Reals};

/// Names, with `[]` for three elements; causality; variability; unit; start.
type Contract = (&'static str, &'static str, &'static str, &'static str, Start);

const OMEGA: f64 = 314.1592653589793;
const ANGLES: Start = Reals([PI, -FRAC_PI_3, FRAC_PI_3]);
const NO: Start = Start::None;
const DRIVE: Start = Item(&["current", "voltage"], 1);

const PLANT: &[Contract] = &[
    ("m", "parameter", "fixed", "kg", Real(6.7)),
    ("s", "parameter", "fixed", "m", Real(5e-4)),
    ("alpha[]", "parameter", "fixed", "rad", ANGLES),
    ("Y0", "parameter", "fixed", "m", Real(30e-6)),
    ("Z0", "parameter", "fixed", "m", Real(0.0)),
    ("vY0", "parameter", "fixed", "m/s", Real(0.0)),
    ("vZ0", "parameter", "fixed", "m/s", Real(0.021991148575128554)),
    ("theta0", "parameter", "fixed", "rad", Real(0.0)),
    ("drive", "parameter", "fixed", "", DRIVE),
    ("coil.R", "parameter", "fixed", "Ohm", Real(1.0)),
    ("coil.Lleak", "parameter", "fixed", "H", Real(0.0)),
    ("coil.uMax", "parameter", "fixed", "V", Real(100.0)),
    ("touchdown.clearance", "parameter", "fixed", "m", Real(2.5e-4)),
    ("touchdown.stiffness", "parameter", "fixed", "N/m", AnyReal),
    ("touchdown.damping", "parameter", "fixed", "N.s/m", AnyReal),
    ("sensor.positionNoise", "parameter", "fixed", "m", Real(0.0)),
    ("sensor.currentNoise", "parameter", "fixed", "A", Real(0.0)),
    ("sensor.Ts", "parameter", "fixed", "s", Real(1e-4)),
    ("sensor.seed", "parameter", "fixed", "", AnyInteger),
    ("solver.maxStep", "parameter", "fixed", "s", AnyReal),
    ("lambda[]", "parameter", "tunable", "N.m2/A2", Reals([1.8e-6, 2.0e-6, 2.2e-6])),
    ("unbalance.magnitude", "parameter", "tunable", "kg.m", Real(0.0)),
    ("unbalance.phase", "parameter", "tunable", "rad", Real(0.0)),
    ("i[]", "input", "continuous", "A", Real(0.0)),
    ("u[]", "input", "continuous", "V", Real(0.0)),
    ("pY", "input", "continuous", "N", Real(0.0)),
    ("pZ", "input", "continuous", "N", Real(0.0)),
    ("omega", "input", "continuous", "rad/s", Real(OMEGA)),
    ("Y", "output", "continuous", "m", NO),
    ("Z", "output", "continuous", "m", NO),
    ("Ym", "output", "discrete", "m", NO),
    ("Zm", "output", "discrete", "m", NO),
    ("im[]", "output", "discrete", "A", NO),
    ("theta", "output", "discrete", "rad", NO),
    ("F[]", "output", "continuous", "N", NO),
    ("FY", "output", "continuous", "N", NO),
    ("FZ", "output", "continuous", "N", NO),
    ("gap[]", "output", "continuous", "m", NO),
    ("touchdown.contact", "output", "discrete", "", NoneBoolean),
];

const CONTROLLER: &[Contract] = &[
    ("m", "parameter", "fixed", "kg", Real(6.7)),
    ("s", "parameter", "fixed", "m", Real(5e-4)),
    ("alpha[]", "parameter", "fixed", "rad", ANGLES),
    ("Ts", "parameter", "fixed", "s", Real(1e-4)),
    ("drive", "parameter", "fixed", "", DRIVE),
    ("coil.R", "parameter", "fixed", "Ohm", Real(1.0)),
    ("coil.Lleak", "parameter", "fixed", "H", Real(0.0)),
    ("coil.uMax", "parameter", "fixed", "V", Real(100.0)),
    ("bandwidth.current", "parameter", "fixed", "rad/s", Real(5000.0)),
    ("lambda0[]", "parameter", "fixed", "N.m2/A2", Real(4e-6)),
    ("F0", "parameter", "fixed", "N", Real(20.0)),
    ("F0.modulation", "parameter", "tunable", "1", Real(0.0)),
    ("F0.modulationFrequency", "parameter", "tunable", "Hz", Real(110.0)),
    ("bandwidth.tracking", "parameter", "fixed", "rad/s", Real(1000.0)),
    ("bandwidth.observer", "parameter", "fixed", "rad/s", Real(4000.0)),
    ("update.mode", "parameter", "fixed", "", Item(&["never", "atTime", "whenValid"], 2)),
    ("update.time", "parameter", "fixed", "s", Real(0.2)),
    ("reference.shape", "parameter", "fixed", "", Item(&["ellipse", "lobes", "external"], 1)),
    ("reference.rY", "parameter", "fixed", "m", Real(30e-6)),
    ("reference.rZ", "parameter", "fixed", "m", Real(70e-6)),
    ("reference.lobes", "parameter", "fixed", "", Integer(3)),
    ("reference.lobeAmplitude", "parameter", "fixed", "m", Real(0.0)),
    ("reference.omega", "parameter", "tunable", "rad/s", Real(OMEGA)),
    ("Ym", "input", "continuous", "m", Real(0.0)),
    ("Zm", "input", "continuous", "m", Real(0.0)),
    ("im[]", "input", "continuous", "A", Real(0.0)),
    ("lambdaHat[]", "input", "continuous", "N.m2/A2", Real(0.0)),
    ("lambdaValid", "input", "discrete", "", Boolean(false)),
    ("Yref", "input", "continuous", "m", Real(0.0)),
    ("Zref", "input", "continuous", "m", Real(0.0)),
    ("i[]", "output", "discrete", "A", NO),
    ("u[]", "output", "discrete", "V", NO),
    ("eY", "output", "discrete", "m", NO),
    ("eZ", "output", "discrete", "m", NO),
    ("pYHat", "output", "discrete", "N", NO),
    ("pZHat", "output", "discrete", "N", NO),
    ("lambdaUsed[]", "output", "discrete", "N.m2/A2", NO),
    ("FYdes", "output", "discrete", "N", NO),
    ("FZdes", "output", "discrete", "N", NO),
];

const ESTIMATOR: &[Contract] = &[
    ("m", "parameter", "fixed", "kg", Real(6.7)),
    ("s", "parameter", "fixed", "m", Real(5e-4)),
    ("alpha[]", "parameter", "fixed", "rad", ANGLES),
    ("Ts", "parameter", "fixed", "s", Real(1e-4)),
    ("Tf", "parameter", "fixed", "s", Real(0.02)),
    ("epsilon", "parameter", "fixed", "s", Real(0.02)),
    ("lambda0[]", "parameter", "fixed", "N.m2/A2", Real(4e-6)),
    ("method", "parameter", "fixed", "", Item(&["paperLiteral", "paper", "predictionError"], 3)),
    ("hold", "parameter", "fixed", "", Item(&["heldBefore", "heldAfter", "linear"], 1)),
    ("filter.omega", "parameter", "fixed", "rad/s", Real(15.0)),
    ("filter.zeta", "parameter", "fixed", "1", Real(0.707)),
    ("sensor.positionNoise", "parameter", "fixed", "m", Real(0.0)),
    ("sensor.currentNoise", "parameter", "fixed", "A", Real(0.0)),
    ("identify.unbalance", "parameter", "fixed", "", Boolean(true)),
    ("tolerance.m", "parameter", "fixed", "kg", Real(0.0)),
    ("tolerance.s", "parameter", "fixed", "m", Real(0.0)),
    ("tolerance.alpha", "parameter", "fixed", "rad", Real(0.0)),
    ("tolerance.positionGain", "parameter", "fixed", "1", Real(0.0)),
    ("tolerance.positionOffset", "parameter", "fixed", "m", Real(0.0)),
    ("tolerance.currentGain", "parameter", "fixed", "1", Real(0.0)),
    ("tolerance.currentOffset", "parameter", "fixed", "A", Real(0.0)),
    ("Ym", "input", "continuous", "m", Real(0.0)),
    ("Zm", "input", "continuous", "m", Real(0.0)),
    ("im[]", "input", "continuous", "A", Real(0.0)),
    ("theta", "input", "continuous", "rad", Real(0.0)),
    ("omega", "input", "continuous", "rad/s", AnyReal),
    ("enable", "input", "discrete", "", Boolean(true)),
    ("reset", "input", "discrete", "", Boolean(false)),
    ("lambdaHat[]", "output", "discrete", "N.m2/A2", NO),
    ("lambdaRaw[]", "output", "discrete", "N.m2/A2", NO),
    ("lambdaStd[]", "output", "discrete", "N.m2/A2", NO),
    ("lambdaStdTotal[]", "output", "discrete", "N.m2/A2", NO),
    ("ki[]", "output", "discrete", "N/A", NO),
    ("ks[]", "output", "discrete", "N/m", NO),
    ("noise.position", "output", "discrete", "m", NO),
    ("noise.current", "output", "discrete", "A", NO),
    ("verdict", "output", "discrete", "", NoneItem),
    ("valid", "output", "discrete", "", NoneBoolean),
    ("condition", "output", "discrete", "1", NO),
    ("residual", "output", "discrete", "1", NO),
    ("pYHat", "output", "discrete", "N", NO),
    ("pZHat", "output", "discrete", "N", NO),
    ("unbalance.magnitude", "output", "discrete", "kg.m", NO),
    ("unbalance.phase", "output", "discrete", "rad", NO),
];

const SPINDLE_CONTROLLER: &[Contract] = &[
    ("m", "parameter", "fixed", "kg", Real(12.0)),
    ("Jt", "parameter", "fixed", "kg.m2", Real(0.16)),
    ("Jp", "parameter", "fixed", "kg.m2", Real(0.02)),
    ("A.position", "parameter", "fixed", "m", Real(-0.12)),
    ("A.sensorPosition", "parameter", "fixed", "m", Real(-0.10)),
    ("B.position", "parameter", "fixed", "m", Real(0.15)),
    ("B.sensorPosition", "parameter", "fixed", "m", Real(0.13)),
    ("A.s", "parameter", "fixed", "m", Real(5e-4)),
    ("B.s", "parameter", "fixed", "m", Real(5e-4)),
    ("X.s", "parameter", "fixed", "m", Real(6e-4)),
    ("A.alpha[]", "parameter", "fixed", "rad", ANGLES),
    ("B.alpha[]", "parameter", "fixed", "rad", ANGLES),
    ("Ts", "parameter", "fixed", "s", Real(1e-4)),
    ("drive", "parameter", "fixed", "", DRIVE),
    ("coil.R", "parameter", "fixed", "Ohm", Real(1.0)),
    ("coil.Lleak", "parameter", "fixed", "H", Real(0.0)),
    ("coil.uMax", "parameter", "fixed", "V", Real(100.0)),
    ("A.lambda0[]", "parameter", "fixed", "N.m2/A2", Real(4e-6)),
    ("B.lambda0[]", "parameter", "fixed", "N.m2/A2", Real(4e-6)),
    ("X.lambda0[1]", "parameter", "fixed", "N.m2/A2", Real(4e-6)),
    ("X.lambda0[2]", "parameter", "fixed", "N.m2/A2", Real(4e-6)),
    ("A.F0", "parameter", "fixed", "N", Real(15.0)),
    ("B.F0", "parameter", "fixed", "N", Real(15.0)),
    ("X.F0", "parameter", "fixed", "N", Real(15.0)),
    ("F0.modulation", "parameter", "tunable", "1", Real(0.0)),
    ("A.F0.modulationFrequency", "parameter", "tunable", "Hz", Real(110.0)),
    ("B.F0.modulationFrequency", "parameter", "tunable", "Hz", Real(130.0)),
    ("X.F0.modulationFrequency", "parameter", "tunable", "Hz", Real(90.0)),
    ("bandwidth.tracking", "parameter", "fixed", "rad/s", Real(1200.0)),
    ("bandwidth.observer", "parameter", "fixed", "rad/s", Real(4000.0)),
    ("bandwidth.current", "parameter", "fixed", "rad/s", Real(5000.0)),
    ("update.mode", "parameter", "fixed", "", Item(&["never", "atTime", "whenValid"], 2)),
    ("update.time", "parameter", "fixed", "s", Real(0.2)),
    ("A.reference.rY", "parameter", "fixed", "m", Real(30e-6)),
    ("A.reference.rZ", "parameter", "fixed", "m", Real(70e-6)),
    ("A.reference.phase", "parameter", "fixed", "rad", Real(0.0)),
    ("B.reference.rY", "parameter", "fixed", "m", Real(30e-6)),
    ("B.reference.rZ", "parameter", "fixed", "m", Real(70e-6)),
    ("B.reference.phase", "parameter", "fixed", "rad", Real(0.0)),
    ("X.reference.amplitude", "parameter", "fixed", "m", Real(0.0)),
    ("X.reference.frequency", "parameter", "fixed", "Hz", Real(60.0)),
    ("reference.omega", "parameter", "tunable", "rad/s", Real(OMEGA)),
    ("A.Ym", "input", "continuous", "m", Real(0.0)),
    ("A.Zm", "input", "continuous", "m", Real(0.0)),
    ("B.Ym", "input", "continuous", "m", Real(0.0)),
    ("B.Zm", "input", "continuous", "m", Real(0.0)),
    ("Xm", "input", "continuous", "m", Real(0.0)),
    ("A.im[]", "input", "continuous", "A", Real(0.0)),
    ("X.im[2]", "input", "continuous", "A", Real(0.0)),
    ("B.lambdaHat[]", "input", "continuous", "N.m2/A2", Real(0.0)),
    ("X.lambdaHat[2]", "input", "continuous", "N.m2/A2", Real(0.0)),
    ("lambdaValid", "input", "discrete", "", Boolean(false)),
    ("A.i[]", "output", "discrete", "A", NO),
    ("B.i[]", "output", "discrete", "A", NO),
    ("X.i[1]", "output", "discrete", "A", NO),
    ("X.i[2]", "output", "discrete", "A", NO),
    ("A.u[]", "output", "discrete", "V", NO),
    ("X.u[2]", "output", "discrete", "V", NO),
    ("A.eY", "output", "discrete", "m", NO),
    ("A.eZ", "output", "discrete", "m", NO),
    ("B.eY", "output", "discrete", "m", NO),
    ("B.eZ", "output", "discrete", "m", NO),
    ("X.e", "output", "discrete", "m", NO),
    ("pXHat", "output", "discrete", "N", NO),
    ("pYHat", "output", "discrete", "N", NO),
    ("pZHat", "output", "discrete", "N", NO),
    ("MYHat", "output", "discrete", "N.m", NO),
    ("MZHat", "output", "discrete", "N.m", NO),
    ("A.lambdaUsed[]", "output", "discrete", "N.m2/A2", NO),
    ("FXdes", "output", "discrete", "N", NO),
    ("MZdes", "output", "discrete", "N.m", NO),
];

const CONTRACT: [(&str, &[Contract]); 4] = [
    ("MagneticBearing", PLANT),
    ("FlatnessController", CONTROLLER),
    ("AlgebraicEstimator", ESTIMATOR),
    ("SpindleController", SPINDLE_CONTROLLER),
];

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

/// The element with the type of a variable: Real, Integer, Boolean or Enumeration.
fn kind<'a>(variable: Node<'a, 'a>) -> Node<'a, 'a> {
    variable.first_element_child().expect("a variable has a type")
}

fn number(node: Node<'_, '_>, attribute: &str) -> Option<f64> {
    node.attribute(attribute).map(|text| text.parse().unwrap_or_else(|_| panic!("{attribute} = {text} is a number")))
}

/// Fails if a checked-in file differs.
#[test]
fn the_files_under_review_are_current() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("modelDescription");
    for entry in fmu::catalogue().iter() {
        let name = format!("{}.xml", entry.info.name);
        let file = fs::read_to_string(folder.join(&name)).unwrap_or_default();
        assert!(file == entry.xml(), "modelDescription/{name} is stale: run `cargo run -- describe`");
    }
    let file = fs::read_to_string(folder.join("VARIABLES.md")).unwrap_or_default();
    assert!(file == package::variables(), "modelDescription/VARIABLES.md is stale: run `cargo run -- describe`");
}

/// Fails if a start value differs by 1e-3.
#[test]
fn the_interface_keeps_its_promises() {
    let mut broken = Vec::new();
    for (model, promises) in CONTRACT {
        let model_type = model_type(model);
        let document = Document::parse(model_type.xml()).expect("well-formed XML");
        let variables: HashMap<_, _> = children(document.root_element(), "ModelVariables")
            .map(|variable| (variable.attribute("name").expect("a name"), variable))
            .collect();
        for promise in promises {
            let names: Vec<String> = match promise.0.strip_suffix("[]") {
                Some(array) => (1..=3).map(|k| format!("{array}[{k}]")).collect(),
                None => vec![promise.0.to_owned()],
            };
            for (k, name) in names.iter().enumerate() {
                match variables.get(name.as_str()) {
                    Some(variable) => broken.extend(
                        differences(document.root_element(), *variable, promise, k)
                            .into_iter()
                            .map(|difference| format!("{model}.{name}: {difference}")),
                    ),
                    None => broken.push(format!("{model}.{name} is not there")),
                }
            }
        }
    }
    assert!(broken.is_empty(), "\n{}", broken.join("\n"));
}

fn differences(root: Node<'_, '_>, variable: Node<'_, '_>, promise: &Contract, k: usize) -> Vec<String> {
    let (_, causality, variability, unit, start) = *promise;
    let kind = variable.first_element_child().expect("a variable has a type");
    let mut found = Vec::new();
    let mut compare = |what: &str, is: Option<&str>, wanted: Option<&str>| {
        if is != wanted {
            found.push(format!("{what} is {is:?}, expected {wanted:?}"));
        }
    };
    compare("causality", variable.attribute("causality"), Some(causality));
    compare("variability", variable.attribute("variability"), Some(variability));
    compare("unit", kind.attribute("unit"), Some(unit).filter(|unit| !unit.is_empty()));
    let of_type = match start {
        Start::Real(_) | Start::Reals(_) | Start::None | Start::AnyReal => "Real",
        Start::Integer(_) | Start::AnyInteger => "Integer",
        Start::Boolean(_) | Start::NoneBoolean => "Boolean",
        Start::Item(..) | Start::NoneItem => "Enumeration",
    };
    compare("type", Some(kind.tag_name().name()), Some(of_type));
    match start {
        Start::Real(_) | Start::Reals(_) => {
            let wanted = if let Start::Reals(values) = start { values[k] } else { real(start) };
            let is = number(kind, "start");
            if is.map(f64::to_bits) != Some(wanted.to_bits()) {
                found.push(format!("start is {is:?}, expected {wanted}"));
            }
        }
        Start::Integer(value) => compare("start", kind.attribute("start"), Some(&value.to_string())),
        Start::Boolean(value) => compare("start", kind.attribute("start"), Some(&value.to_string())),
        Start::Item(items, value) => {
            compare("start", kind.attribute("start"), Some(&value.to_string()));
            let name = kind.attribute("declaredType");
            let declared: Vec<(&str, &str)> = children_of_type(root, name.unwrap_or_default());
            let wanted: Vec<_> = items.iter().copied().zip(["1", "2", "3", "4"]).collect();
            // Further items may follow.
            if !declared.starts_with(&wanted) {
                found.push(format!("items are {declared:?}, expected {wanted:?}"));
            }
        }
        Start::None | Start::NoneBoolean | Start::NoneItem => compare("start", kind.attribute("start"), None),
        Start::AnyReal | Start::AnyInteger => {
            if number(kind, "start").is_none() {
                found.push("there is no start".into());
            }
        }
    }
    found
}

fn real(start: Start) -> f64 {
    if let Start::Real(value) = start { value } else { f64::NAN }
}

/// Names and values of the items of an enumeration.
fn children_of_type<'a>(root: Node<'a, '_>, name: &str) -> Vec<(&'a str, &'a str)> {
    let declared =
        root.descendants().find(|node| node.has_tag_name("SimpleType") && node.attribute("name") == Some(name));
    let items = declared.into_iter().flat_map(|node| node.descendants().filter(|node| node.has_tag_name("Item")));
    items.map(|item| (item.attribute("name").expect("a name"), item.attribute("value").expect("a value"))).collect()
}

/// Fails if two variables have one reference.
#[test]
fn names_and_references_are_unique() {
    each(|model, root| {
        let mut names = HashSet::new();
        let mut references = HashSet::new();
        for variable in
            root.children().filter(|node| node.has_tag_name("ModelVariables")).flat_map(|node| node.children())
        {
            let Some(name) = variable.attribute("name") else { continue };
            let reference = variable.attribute("valueReference").expect("a reference");
            assert!(names.insert(name.to_owned()), "{model}: the name {name} stands there twice");
            assert!(references.insert(reference.to_owned()), "{model}: the reference {reference} stands there twice");
        }
        assert!(names.len() > 30, "{model} has {} variables", names.len());
    });
}

/// Fails if descriptions are left out, and if the unit itself is named as the unit for display.
#[test]
fn every_variable_can_be_read_by_people() {
    for entry in fmu::catalogue().iter() {
        let model = entry.info.name;
        let document = Document::parse(entry.xml()).expect("well-formed XML");
        let root = document.root_element();
        let units: HashMap<_, Vec<_>> = children(root, "UnitDefinitions")
            .map(|unit| {
                let displays = unit.children().filter(|child| child.has_tag_name("DisplayUnit"));
                let displays = displays.map(|display| display.attribute("name").expect("a name").to_owned()).collect();
                (unit.attribute("name").expect("a name").to_owned(), displays)
            })
            .collect();
        for variable in children(root, "ModelVariables") {
            let name = variable.attribute("name").expect("a name");
            let description = variable.attribute("description").unwrap_or_default();
            assert!(description.len() > 8, "{model}.{name} has no description");
            assert!(!description.contains(['{', '}']), "{model}.{name}: {description}");
            assert!(!description.ends_with('.'), "{model}.{name}: {description}");
            let kind = kind(variable);
            let (min, max, start) = (number(kind, "min"), number(kind, "max"), number_or_none(kind));
            if kind.has_tag_name("Real") {
                let unit = kind.attribute("unit").unwrap_or_else(|| panic!("{model}.{name} has no unit"));
                let displays = units.get(unit).unwrap_or_else(|| panic!("{model}.{name}: {unit} is not declared"));
                let display = kind.attribute("displayUnit");
                assert!(
                    display.is_none_or(|display| display != unit && displays.iter().any(|known| known == display)),
                    "{model}.{name}: {display:?} is no unit for display of {unit}"
                );
                let nominal = number(kind, "nominal").unwrap_or_else(|| panic!("{model}.{name} has no nominal"));
                assert!(nominal > 0.0 && nominal.is_finite(), "{model}.{name}: nominal = {nominal}");
            }
            let low = min.unwrap_or(f64::NEG_INFINITY);
            let high = max.unwrap_or(f64::INFINITY);
            assert!(low <= high, "{model}.{name}: min = {low}, max = {high}");
            if let Some(start) = start {
                assert!((low..=high).contains(&start), "{model}.{name}: start = {start}, not in {low}..={high}");
            }
        }
    }
}

/// The start as a number; `None` for Booleans and for what is computed.
fn number_or_none(kind: Node<'_, '_>) -> Option<f64> {
    if kind.has_tag_name("Boolean") { None } else { number(kind, "start") }
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
                .map(|node| (node.attribute("name").expect("a name"), number(node, "factor").expect("a factor")))
                .collect();
            assert_eq!(declared, *displays, "{model}: units for display of {name}");
        }
    });
}

/// Fails if an output is left out, and if variables are counted from 0 instead of from 1.
#[test]
fn the_structure_lists_every_output_and_what_acts_on_it_at_once() {
    // Outputs that depend on an input at the same instant; samples never do.
    let through = |name: &str| ["F", "perturbation.", "A.F", "B.F", "X.F"].iter().any(|head| name.starts_with(head));
    for entry in fmu::catalogue().iter() {
        let model = entry.info.name;
        let document = Document::parse(entry.xml()).expect("well-formed XML");
        let root = document.root_element();
        let variables: Vec<_> = children(root, "ModelVariables").collect();
        let outputs: Vec<usize> = (1..)
            .zip(&variables)
            .filter(|(_, variable)| variable.attribute("causality") == Some("output"))
            .map(|(index, _)| index)
            .collect();
        let structure = child(root, "ModelStructure");
        let listed = |list| -> Vec<usize> {
            let unknowns = child(structure, list).children().filter(Node::is_element);
            unknowns
                .map(|unknown| unknown.attribute("index").and_then(|index| index.parse().ok()).expect("an index"))
                .collect()
        };
        assert_eq!(listed("Outputs"), outputs, "{model}");
        // States and their derivatives are initial unknowns as well.
        let initial = listed("InitialUnknowns");
        assert!(outputs.iter().all(|output| initial.contains(output)), "{model}: {initial:?}");
        assert!(initial.is_sorted_by(|one, next| one < next), "{model}: {initial:?}");
        for unknown in child(structure, "Outputs").children().filter(Node::is_element) {
            let index: usize = unknown.attribute("index").and_then(|index| index.parse().ok()).expect("an index");
            let name = variables[index - 1].attribute("name").expect("a name");
            let dependencies =
                unknown.attribute("dependencies").unwrap_or_else(|| panic!("{model}.{name}: nothing said"));
            let mut named: Vec<_> = dependencies
                .split_whitespace()
                .map(|index| {
                    variables[index.parse::<usize>().expect("an index") - 1].attribute("name").expect("a name")
                })
                .collect();
            let depends_on = &entry.variables()[index - 1].depends_on;
            let mut meant: Vec<_> = depends_on.iter().flatten().map(|(name, _)| name.as_ref()).collect();
            named.sort_unstable();
            meant.sort_unstable();
            assert_eq!(named, meant, "{model}.{name}");
            let acts = |index: &str| {
                let cause = variables[index.parse::<usize>().expect("an index") - 1];
                cause.attribute("causality") == Some("input")
            };
            let inputs = dependencies.split_whitespace().any(acts);
            let sampled = variables[index - 1].attribute("variability") == Some("discrete");
            if sampled && !name.ends_with("contact") {
                assert_eq!(dependencies, "", "{model}.{name} is a sample");
            }
            assert!(inputs || !(is_plant(model) && through(name)), "{model}.{name}: {dependencies:?}");
        }
    }
}

/// Fails if the version is `2.0.4`, and if steps are said to run asynchronously.
#[test]
fn attributes_say_what_is_offered() {
    each(|model, root| {
        assert_eq!(root.attribute("fmiVersion"), Some("2.0"));
        assert_eq!(root.attribute("modelName"), Some(model));
        assert_eq!(root.attribute("variableNamingConvention"), Some("structured"));
        let slave = root.children().find(|node| node.has_tag_name("CoSimulation")).expect("a co-simulation FMU");
        assert_eq!(slave.attribute("modelIdentifier"), Some(model));
        for (capability, wanted) in [
            ("needsExecutionTool", "false"),
            ("canHandleVariableCommunicationStepSize", "true"),
            ("canRunAsynchronuously", "false"),
            ("canBeInstantiatedOnlyOncePerProcess", "false"),
            ("canNotUseMemoryManagementFunctions", "true"),
        ] {
            assert_eq!(slave.attribute(capability), Some(wanted), "{model}: {capability}");
        }
        let categories: Vec<_> = root
            .descendants()
            .filter(|node| node.has_tag_name("Category"))
            .filter_map(|node| node.attribute("name"))
            .collect();
        // Those of the standard, table in section 2.2.4, that apply to these models.
        for category in ["logEvents", "logStatusWarning", "logStatusError", "logStatusFatal", "logAll"] {
            assert!(categories.contains(&category), "{model}: {category} is not among {categories:?}");
        }
    });
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
