//! A model with every type of variable, arrays and texts, through the C interface.

mod library {
    use fmu_export::prelude::*;

    static MODE: Enumeration = Enumeration::new(
        "Mode",
        "How the sum is taken",
        &[("all", "Of all elements"), ("first", "Of the first alone")],
    );

    #[derive(Clone, Default, Serialize, Deserialize)]
    struct Values {
        gain: [f64; 2],
        count: [i32; 2],
        on: [bool; 2],
        label: [String; 2],
        mode: i32,
        title: String,
        sum: f64,
        says: String,
    }

    /// Sums its parameters at samples, and describes the sum.
    #[derive(Clone)]
    struct Types;

    impl SampledModel for Types {
        const INFO: Info = Info::new("Types", "Every type of variable").author("Nobody").version("2");
        type Values = Values;
        type State = u32;

        fn table() -> Vec<Row<Values>> {
            let mut rows = Vec::new();
            let gain = |name, start| Row::real(name, place!(Values.gain[k]), unit::ONE, start).tunable();
            rows.extend(Row::elements("gain", [1.0, 2.0], gain));
            let count = |name, start| Row::integer(name, place!(Values.count[k]), start).tunable();
            rows.extend(Row::elements("count", [3, 4], count));
            let on = |name, start| Row::boolean(name, place!(Values.on[k]), start).input();
            rows.extend(Row::elements("on", [true, false], on));
            let label = |name, start: &'static str| Row::string(name, place!(Values.label[k]), start).fixed();
            rows.extend(Row::elements("label", ["one", "two"], label));
            rows.push(Row::choice("mode", place!(Values.mode), &MODE, 1).fixed());
            rows.push(Row::string("title", place!(Values.title), "the <sum> & more").input());
            rows.push(Row::real("sum", place!(Values.sum), unit::ONE, 0.0).sampled_output());
            rows.push(Row::string("says", place!(Values.says), "").sampled_output());
            rows.into_iter().map(|row| row.description("Element {k} of what it is")).collect()
        }

        fn new(_: &Values, _: &Resources) -> Result<Self, Vec<Invalid>> {
            Ok(Self)
        }

        fn period_s(&self) -> f64 {
            0.1
        }

        fn start(&self, values: &mut Values, _: f64) -> u32 {
            values.says = "nothing yet".into();
            0
        }

        fn sample(&self, samples: &mut u32, values: &mut Values, _: f64, _: &mut dyn Log) -> Stepped {
            *samples += 1;
            let elements = if values.mode == 1 { 2 } else { 1 };
            let term = |k: usize| f64::from(u8::from(values.on[k])) * values.gain[k] * f64::from(values.count[k]);
            values.sum = (0..elements).map(term).sum();
            values.says = format!("{} {}: {} of {}", values.title, samples, values.sum, values.label.join(" and "));
            Ok(())
        }
    }

    export_fmus!(Types);
}
mod support;

use std::ffi::CStr;
use std::ptr::{null, null_mut};

use fmu_export::fmi2::bindings::*;
use fmu_export::variable::{Dependency, Type};
use fmu_export::{Standard, check};
use support::abuse::Abuse;
use support::abuse3::Abuse3;
use support::ffi::{Expect, Fmu, text};
use support::ffi3::Fmu3;
use support::random::Random;

fn get(fmu: &Fmu, name: &str, value: &mut fmi2String) -> fmi2Status {
    let reference = [fmu.reference(name)];
    // SAFETY: the instance is live; both arrays have one element.
    unsafe { call!(fmi2GetString: fmi2GetStringTYPE(fmu.component(), reference.as_ptr(), 1, value)) }
}

fn read(fmu: &Fmu, name: &str) -> String {
    let mut value = null();
    get(fmu, name, &mut value).ok(fmu);
    // SAFETY: the text is valid until the next call on the instance.
    unsafe { CStr::from_ptr(value) }.to_str().expect("UTF-8").to_owned()
}

fn write(fmu: &Fmu, name: &str, value: &CStr) -> fmi2Status {
    let (reference, value) = ([fmu.reference(name)], [value.as_ptr()]);
    // SAFETY: the instance is live; both arrays have one element.
    unsafe { call!(fmi2SetString: fmi2SetStringTYPE(fmu.component(), reference.as_ptr(), 1, value.as_ptr())) }
}

/// Fails if a text is not copied, or if elements of an array are exchanged.
#[test]
fn texts_and_arrays_are_read_and_written() {
    let fmu = Fmu::new("Types");
    write(&fmu, "label[2]", &text("zwei")).ok(&fmu);
    write(&fmu, "title", &text("Σ")).ok(&fmu);
    fmu.set("on[2]", 1.0).ok(&fmu);
    fmu.start(0.0, None);
    assert_eq!(read(&fmu, "says"), "nothing yet");
    fmu.step(0.0, 0.05).ok(&fmu);
    assert_eq!((read(&fmu, "says").as_str(), fmu.get("sum")), ("Σ 1: 11 of one and zwei", 11.0));
    fmu.set("gain[2]", 10.0).ok(&fmu);
    fmu.set("count[2]", -1.0).ok(&fmu);
    fmu.step(0.05, 0.1).ok(&fmu);
    assert_eq!((read(&fmu, "says").as_str(), fmu.get("sum")), ("Σ 2: -7 of one and zwei", -7.0));
    assert!(write(&fmu, "label[1]", &text("late")).error(&fmu).contains("label[1] cannot be set: it is fixed"));
    assert!(fmu.set("gain[1]", f64::NAN).error(&fmu).contains("gain[1] = NaN is refused: expected a finite number"));
}

/// Fails if invalid UTF-8, a null pointer, or another type is accepted as a text, or if a Real is read as one.
#[test]
fn invalid_texts_are_refused() {
    let fmu = Fmu::started("Types", &[]);
    assert!(write(&fmu, "title", c"\xff").error(&fmu).contains("title: the string is refused: expected UTF-8"));
    assert!(write(&fmu, "gain[1]", c"1").error(&fmu).contains("gain[1]"));
    let got = get(&fmu, "gain[1]", &mut null()).error(&fmu);
    assert!(got.contains("fmi2GetString") && got.contains("gain[1] is not of type String but Real"), "{got}");
    let (reference, value) = ([fmu.reference("title")], [null()]);
    // SAFETY: the instance is live; both arrays have one element; null is the test.
    let status =
        unsafe { call!(fmi2SetString: fmi2SetStringTYPE(fmu.component(), reference.as_ptr(), 1, value.as_ptr())) };
    assert!(status.error(&fmu).contains("title: a null pointer is refused"));
    assert_eq!(read(&fmu, "title"), "the <sum> & more");
}

/// Fails if a snapshot lacks a text, the state, or the clock.
#[test]
fn snapshots_hold_texts() {
    let fmu = Fmu::started("Types", &[]);
    fmu.step(0.0, 0.25).ok(&fmu);
    let (says, mut state, mut back) = (read(&fmu, "says"), null_mut(), null_mut());
    fmu.get_state(&mut state).ok(&fmu);
    let bytes = fmu.serialize(state).expect("bytes");
    let other = Fmu::new("Types");
    other.deserialize(&bytes, &mut back).ok(&other);
    other.set_state(back).ok(&other);
    assert_eq!(read(&other, "says"), says);
    other.step(0.25, 0.1).ok(&other);
    assert_eq!(read(&other, "says"), "the <sum> & more 4: 3 of one and two");
    fmu.free_state(&mut state).ok(&fmu);
    fmu.free_state(&mut back).ok(&fmu);
}

/// Fails if start values are not escaped, or if author and version are not those of the model.
#[test]
fn the_model_description_has_every_type() {
    let model = library::FMUS.find("Types").expect("the model");
    let document = roxmltree::Document::parse(model.xml()).expect("well-formed XML");
    let root = document.root_element();
    assert_eq!((root.attribute("author"), root.attribute("version")), (Some("Nobody"), Some("2")));
    assert_eq!(root.attribute("license"), None);
    let start = |name: &str| {
        let found = document.descendants().find(|node| node.attribute("name") == Some(name)).expect("the variable");
        let kind = found.first_element_child().expect("a type");
        (kind.tag_name().name().to_owned(), kind.attribute("start").map(str::to_owned))
    };
    let is = |name: &str, of_type: &str, value: &str| assert_eq!(start(name), (of_type.into(), Some(value.into())));
    is("title", "String", "the <sum> & more");
    is("label[2]", "String", "two");
    is("gain[2]", "Real", "2");
    is("count[1]", "Integer", "3");
    is("on[2]", "Boolean", "false");
    is("mode", "Enumeration", "1");
    assert_eq!(start("says"), ("String".into(), None));
}

/// Fails if a table with a mistake is packed.
#[test]
fn mistakes_in_a_table_are_named() {
    let model = library::FMUS.find("Types").expect("the model");
    assert!(model.problems().is_empty());
    let mut variables = model.variables().to_vec();
    variables[0].name = "gain[2]".into();
    variables[1].depends_on.get_or_insert_default().push(("gian[1]".into(), Dependency::Any));
    if let Type::Enumeration { start, .. } = &mut variables[8].data_type {
        *start = 3;
    }
    let mut info = model.info;
    info.name = "my model";
    let found = check::problems(&info, &variables).join("; ");
    let wanted = [
        "the name `my model` cannot",
        "gain[2] occurs twice",
        "gain[2] refers to gian[1], which is not a variable",
        "the start value of mode is outside its limits",
    ];
    for what in wanted {
        assert!(found.contains(what), "`{what}` is not said in: {found}");
    }
}

/// The texts of a String variable, through FMI 3.0.
fn texts(fmu: &Fmu3, name: &str, count: usize) -> Vec<String> {
    let (reference, mut values) = ([fmu.reference(name)], vec![null(); count]);
    let (c, place) = (fmu.instance(), values.as_mut_ptr());
    // SAFETY: the instance is live; both arrays are as long as stated.
    fmu.ok(unsafe { call3!(fmi3GetString: fmi3GetStringTYPE(c, reference.as_ptr(), 1, place, count)) });
    // SAFETY: the texts are valid until the next call on the instance.
    let text = |text: &*const _| unsafe { CStr::from_ptr(*text) }.to_str().expect("UTF-8").to_owned();
    values.iter().map(text).collect()
}

/// Fails if the values of arrays are not consecutive, or if a reference denotes only one value.
#[test]
fn arrays_of_fmi_3_have_one_reference_each() {
    let fmu = Fmu3::new("Types", true);
    let c = fmu.instance();
    let at = |name: &str| fmu.reference(name);
    fmu.ok(fmu.set_floats(&[at("gain[1]")], &[3.0, 10.0]));
    let counts = [at("count[1]")];
    // SAFETY: the instance is live; all arrays are as long as stated.
    unsafe {
        fmu.ok(call3!(fmi3SetInt32: fmi3SetInt32TYPE(c, counts.as_ptr(), 1, [5, -1].as_ptr(), 2)));
        let (on, label) = ([at("on[1]")], [at("label[1]")]);
        fmu.ok(call3!(fmi3SetBoolean: fmi3SetBooleanTYPE(c, on.as_ptr(), 1, [1, 1].as_ptr(), 2)));
        let two = [c"uno".as_ptr(), c"due".as_ptr()];
        fmu.ok(call3!(fmi3SetString: fmi3SetStringTYPE(c, label.as_ptr(), 1, two.as_ptr(), 2)));
    }
    fmu.start(0.0);
    fmu.ok(fmu.step(0.0, 0.05));
    assert_eq!(texts(&fmu, "says", 1), ["the <sum> & more 1: 5 of uno and due"]);
    assert_eq!(texts(&fmu, "label[1]", 2), ["uno", "due"]);
    // A scalar, an array, and the time.
    let found = fmu.get_floats(&[at("sum"), at("gain[1]"), at("time")], 4);
    assert_eq!(found, Ok(vec![5.0, 3.0, 10.0, 0.05]));

    let wrong = fmu.get_floats(&[at("gain[1]")], 1).expect_err("two values");
    assert!(fmu.error(wrong).contains("nValues = 1 is refused: the value references stand for 2 values"));
    let within = fmu.get_floats(&[at("gain[2]")], 1).expect_err("an element");
    assert!(fmu.error(within).contains("lies within an array, as gain[2]"));
    let status = fmu.set_floats(&[at("time")], &[1.0]);
    assert!(fmu.error(status).contains("time cannot be set"));
}

/// Fails if an enumeration is read as Int32, if a byte other than 0 and 1 is accepted as a Boolean, or if an unused type
/// is not refused by name.
#[test]
fn types_of_fmi_3_are_distinguished() {
    let fmu = Fmu3::new("Types", false);
    fmu.ok(fmu.set("mode", 2.0));
    fmu.start(0.0);
    let (c, mode, on) = (fmu.instance(), [fmu.reference("mode")], [fmu.reference("on[1]")]);
    let gain = [fmu.reference("gain[1]")];
    assert_eq!(fmu.get("mode"), 2.0);
    // SAFETY: the instance is live; all arrays have one element.
    unsafe {
        let status = call3!(fmi3GetInt32: fmi3GetInt32TYPE(c, mode.as_ptr(), 1, [0].as_mut_ptr(), 1));
        assert!(fmu.error(status).contains("mode is not of type Int32 but Enumeration (Int64)"));
        let status = call3!(fmi3SetInt64: fmi3SetInt64TYPE(c, mode.as_ptr(), 1, [1 << 32].as_ptr(), 1));
        assert!(fmu.error(status).contains("mode: 4294967296 is refused"));
        let status = call3!(fmi3SetBoolean: fmi3SetBooleanTYPE(c, on.as_ptr(), 1, [2].as_ptr(), 1));
        assert!(fmu.error(status).contains("on[1]: 2 is refused: expected fmi3False (0) or fmi3True (1)"));
        let status = call3!(fmi3GetFloat32: fmi3GetFloat32TYPE(c, gain.as_ptr(), 1, [0.0].as_mut_ptr(), 1));
        assert!(fmu.error(status).contains("gain[1] is not of type Float32 but Float64"));
        let status = call3!(fmi3SetBinary: fmi3SetBinaryTYPE(c, gain.as_ptr(), 1, null(), null(), 0));
        assert!(fmu.error(status).contains("gain[1] is not of type Binary but Float64"));
        // An empty list of an unused type is accepted.
        fmu.ok(call3!(fmi3GetUInt16: fmi3GetUInt16TYPE(c, null(), 0, null_mut(), 0)));
    }
}

/// Fails if elements are not joined, if a start value is lost, or if the description is that of one element.
#[test]
fn the_model_description_of_fmi_3_has_scalars_or_arrays() {
    let model = library::FMUS.find("Types").expect("the model");
    let [scalars, arrays] = Standard::OF_FMI3.map(|standard| model.description(standard));
    assert_ne!(scalars.token, arrays.token);
    assert_ne!(scalars.token, model.guid());
    let document = roxmltree::Document::parse(&arrays.xml).expect("well-formed XML");
    let named = |name: &str| document.descendants().find(|node| node.attribute("name") == Some(name));
    let is = |name: &str, of_type: &str, reference: &str, start: Option<&str>| {
        let node = named(name).unwrap_or_else(|| panic!("there is no {name}"));
        let found = (node.tag_name().name(), node.attribute("valueReference"), node.attribute("start"));
        assert_eq!(found, (of_type, Some(reference), start));
    };
    is("gain", "Float64", "0", Some("1 2"));
    is("count", "Int32", "2", Some("3 4"));
    is("on", "Boolean", "4", Some("true false"));
    is("label", "String", "6", None);
    is("mode", "Enumeration", "8", Some("1"));
    is("time", "Float64", "12", None);
    let label = named("label").expect("it");
    let children: Vec<_> = label.children().filter(|node| node.is_element()).collect();
    let values: Vec<_> = children.iter().map(|node| node.attribute("start").or(node.attribute("value"))).collect();
    assert_eq!(values, [Some("2"), Some("one"), Some("two")]);
    assert_eq!(named("gain").and_then(|node| node.attribute("description")), Some("Element k of what it is"));
    assert!(named("gain[1]").is_none());
    let document = roxmltree::Document::parse(&scalars.xml).expect("well-formed XML");
    let names = document.descendants().filter(|node| node.attribute("causality").is_some());
    let names: Vec<_> = names.filter_map(|node| node.attribute("name")).collect();
    let wanted = model.variables().iter().map(|variable| variable.name.as_ref()).chain(["time"]);
    assert_eq!(names, wanted.collect::<Vec<_>>());
}

/// Random calls with random arguments; see `support/abuse3.rs`.
#[test]
fn random_calls_of_fmi_3_never_break_an_instance() {
    for seed in 1..=50 {
        let mut abuse = Abuse3::new(Random::new(seed));
        while abuse.calls < 2000 {
            abuse.step().expect("random bytes do not end");
        }
    }
}

/// Random calls with random arguments; see `support/abuse.rs`.
#[test]
fn random_calls_never_break_an_instance() {
    for seed in 1..=50 {
        let mut abuse = Abuse::new(Random::new(seed));
        while abuse.calls < 2000 {
            abuse.step().expect("random bytes do not end");
        }
    }
}
