//! The packager: its archives, and the paths that it removes from libraries.

use std::fs;
use std::path::Path;
use std::process::Command;

#[path = "../examples/pi_controller.rs"]
#[allow(dead_code, reason = "`main` belongs to the program")]
mod pi_controller;

use fmu_export::Standard;
use fmu_export::package::{self, PackageError, Packager};

/// Fails if a mistake in a system of FMUs is not found, or not named.
#[test]
fn mistakes_in_systems_are_found() {
    use fmu_export::package::ssp::{DEFAULT, Element, System};
    use fmu_export::variable::Value;
    let element = |name: &str, settings| Element {
        name: name.into(),
        model: pi_controller::FMUS.find("PiController").expect("the model"),
        settings,
    };
    let connections =
        |names: &[[[&str; 2]; 2]]| names.iter().map(|pair| pair.map(|end| end.map(str::to_owned))).collect();
    let system = |elements, names| System {
        file: DEFAULT.into(),
        name: "cascade".into(),
        description: "Two controllers".into(),
        tool: String::new(),
        parameters: "own".into(),
        elements,
        connections: connections(names),
        step_s: 0.01,
        stop_s: 1.0,
        tolerance: 1e-4,
    };
    let sound =
        system(vec![element("a", vec![(2, Value::Real(3.0))]), element("b", vec![])], &[[["a", "u"], ["b", "r"]]]);
    sound.members().expect("a sound system");
    let settings = vec![
        (0, Value::Real(0.0)),
        (2, Value::Real(f64::NAN)),
        (3, Value::Boolean(true)),
        (6, Value::Real(0.0)),
        (99, Value::Real(0.0)),
    ];
    let wrong = [
        [["a", "u"], ["a", "y"]],
        [["a", "u"], ["a", "y"]],
        [["a", "limited"], ["a", "r"]],
        [["a", "r"], ["c", "r"]],
        [["a", "u"], ["a", "nothing"]],
    ];
    let mistaken =
        System { step_s: 0.0, stop_s: f64::NAN, ..system(vec![element("a", settings), element("a", vec![])], &wrong) };
    let error = mistaken.members().err().expect("mistakes").to_string();
    let wanted = [
        "cascade: step_s = 0 is refused: expected a number above 0",
        "stop_s = NaN is refused: expected a number above 0",
        "a.Ts = 0 s is refused: expected a value of at least 0.000001 s",
        "a.kp = NaN is refused: expected a finite number",
        "a.ki is not of type Boolean",
        "a.u cannot be set: expected a parameter, an input, or a settable start value",
        "a has no variable with index 99",
        "there are two elements named a",
        "a.y has two connections",
        "a.limited and a.r, which are connected, have different types",
        "a.r, which is connected, is not an output",
        "c, which is connected, is not an element",
        "a.nothing, which is connected, is not an input",
    ];
    assert_eq!(error.split("; ").collect::<Vec<_>>(), wanted);
}

/// The model can be used without C.
#[test]
fn the_controller_limits_its_output() {
    use fmu_export::{Step, log::Silent, variable::Value};
    let model = pi_controller::FMUS.find("PiController").expect("the model");
    let index = |name: &str| model.variables().iter().position(|variable| variable.name == name).expect("a variable");
    let mut controller = model.instantiate();
    controller.set(index("r"), Value::Real(0.1)).expect("an input");
    controller.start().expect("good parameters");
    let step = |at: f64| Step { time_s: at, length_s: 0.01 };
    controller.step(step(0.0), &mut Silent).expect("a step");
    // kp e + ki Ts e
    assert_eq!(controller.get(index("u")), Ok(Value::Real(2.0 * 0.1 + 5.0 * 0.01 * 0.1)));
    controller.set(index("r"), Value::Real(10.0)).expect("an input");
    controller.step(step(0.01), &mut Silent).expect("a step");
    assert_eq!(controller.get(index("u")), Ok(Value::Real(1.0)));
    assert_eq!(controller.get(index("limited")), Ok(Value::Boolean(true)));
    controller.set(index("Ts"), Value::Real(1.0)).expect_err("fixed");
}

/// Fails if a file that is not a library is packed.
#[test]
fn other_files_than_libraries_are_refused() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let file = folder.join("text.so");
    fs::write(&file, "this is a text").expect("a file");
    let error = Packager::new(&pi_controller::FMUS).library(&file).write(folder).expect_err("a text");
    assert!(matches!(error, PackageError::NotFor(..)), "{error}");
    let error = Packager::new(&pi_controller::FMUS).write(folder).expect_err("this test has no library");
    assert!(error.to_string().contains("crate-type"), "{error}");
}

/// Fails if panic messages contain the folder of the registry.
#[test]
fn a_packaged_library_names_no_folder_of_this_machine() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let Some(platform) = package::platforms::own() else { return };
    let library = folder.join("library").with_extension(platform.ending);
    let source = folder.join("library.rs");
    let home = std::env::var("CARGO_HOME").unwrap_or_else(|_| format!("{}/.cargo", std::env::var("HOME").unwrap()));
    let text = format!("{home}/registry/src/index.crates.io-1/thing-1.0.0/src/lib.rs");
    // A library with empty functions of the names that the packager requires.
    let names = ["fmi2GetVersion", "fmi2Instantiate", "fmi2SetupExperiment", "fmi2DoStep", "fmi2FreeInstance"];
    let of_fmi3 = ["fmi3GetVersion", "fmi3InstantiateCoSimulation", "fmi3GetFloat64", "fmi3DoStep", "fmi3FreeInstance"];
    let define = |name| format!("#[unsafe(no_mangle)] pub extern \"C\" fn {name}() {{}}\n");
    let functions = names.into_iter().chain(of_fmi3).map(define).collect::<String>();
    let code = format!("{functions}#[unsafe(no_mangle)] pub static TEXT: &str = {text:?};");
    fs::write(&source, code).expect("a file");
    let mut rustc = Command::new(std::env::var("RUSTC").unwrap_or_else(|_| "rustc".into()));
    rustc.args(["--edition=2024", "--crate-type=cdylib", "-o"]).arg(&library).arg(&source);
    assert!(rustc.status().expect("a compiler").success());
    let holds = |bytes: &[u8], text: &str| bytes.windows(text.len()).any(|window| window == text.as_bytes());
    assert!(holds(&fs::read(&library).expect("a library"), &text));
    let binaries = package::binaries_of(&library).expect("a library for this platform");
    let packed = &binaries.places(Standard::Fmi2)[0].content;
    if platform.name.contains("darwin") {
        return;
    }
    assert!(!holds(packed, &home));
    assert!(holds(packed, "/thing-1.0.0/src/lib.rs"));
}
