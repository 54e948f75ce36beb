//! Easy mistakes in models: prevented by default, or refused.

use fmu_export::fmi2::bindings::{fmi2Boolean, fmi2Real, fmi2Status, fmi2StatusKind};
use fmu_export::log::{Silent, Topic};
use fmu_export::package::{PackageError, Packager};
use fmu_export::prelude::*;
use fmu_export::variable::Value;
use fmu_export::variable::Variable;
use fmu_export::{Array, Instance, ModelType, Standard};

mod support;

mod library {
    use super::*;

    /// Law of a controller
    #[derive(Clone, Copy, Default, PartialEq, Serialize, Deserialize, Choice)]
    pub enum Law {
        #[default]
        Proportional,
        Integral,
    }

    #[derive(Clone, Default, Serialize, Deserialize, Variables)]
    pub struct PidValues {
        #[parameter(start = 2.0, max = 100.0, tunable)]
        kp: f64,
        #[parameter(tunable)]
        law: Law,
        #[parameter(unit = unit::KILOGRAM_METRE2, start = 1.0, min = 0.0)]
        inertia: f64,
        #[input(unit = unit::METRE, min = -1.0, max = 1.0)]
        e: f64,
        #[output]
        u: f64,
        #[parameter(calculated, tunable)]
        doubled: f64,
    }

    /// Copies its gain at construction, and has no `retune`.
    #[derive(Clone)]
    pub struct Pid {
        kp: f64,
    }

    impl SampledModel for Pid {
        const INFO: Info = Info::new("Pid", "Controller");
        type Values = PidValues;
        type State = ();

        fn table() -> Vec<Row<PidValues>> {
            PidValues::rows()
        }

        fn new(values: &PidValues, _: &Resources) -> Result<Self, Vec<Invalid>> {
            Ok(Self { kp: values.kp })
        }

        fn period_s(&self) -> f64 {
            1e-4
        }

        fn start(&self, values: &mut PidValues, _: f64) {
            // Compiles only if the two traits of the prelude with this function are not ambiguous.
            let again = Pid::new(values, &Resources::default()).expect("good parameters");
            values.u = 0.0 * again.kp;
            self.refresh(&(), values, 0.0);
        }

        fn refresh(&self, _: &(), values: &mut PidValues, _: f64) {
            values.doubled = 2.0 * self.kp;
        }

        fn sample(&self, _: &mut (), values: &mut PidValues, _: f64, _: &mut dyn Log) -> Stepped {
            values.u = self.kp * values.e + 1000.0 * f64::from(values.law.number() - 1);
            Ok(())
        }
    }

    #[derive(Clone, Default, Serialize, Deserialize, Variables)]
    pub struct TankValues {
        #[hidden]
        never: u8,
        #[parameter(unit = unit::METRE2, start = 2.0)]
        area: f64,
        #[parameter(calculated, unit = unit::ONE)]
        doubled: f64,
        #[local(constant, start = 9.81)]
        g: f64,
        #[input(unit = unit::METRE3_PER_SECOND)]
        flow: f64,
        #[output(unit = unit::METRE, state, exact, start = 5.0)]
        level: f64,
        #[local(unit = unit::METRE_PER_SECOND, derivative_of = "level", depends_on = ["flow"])]
        rate: f64,
        #[output(unit = unit::METRE)]
        forgotten: f64,
        #[output(depends_on = ["level"])]
        starts: f64,
        #[local]
        cells: Array<f64, 40>,
    }

    /// Its start is not idempotent, its state cannot be saved, and it ends when it is empty.
    #[derive(Clone)]
    pub struct Tank;

    pub struct Handle;

    impl Model for Tank {
        const INFO: Info = Info::new("Tank", "A tank that runs empty");
        type Values = TankValues;
        type State = NotSaved<Handle>;

        fn table() -> Vec<Row<TankValues>> {
            let mut rows = TankValues::rows();
            rows.push(Row::time("time"));
            rows
        }

        fn new(_: &TankValues, _: &Resources) -> Result<Self, Vec<Invalid>> {
            Ok(Self)
        }

        fn start(&self, values: &mut TankValues, _: f64) -> NotSaved<Handle> {
            values.starts += 1.0;
            values.doubled = 2.0 * values.area;
            values.cells[39] = 39.0;
            NotSaved(Handle)
        }

        fn step(
            &self,
            _: &mut NotSaved<Handle>,
            values: &mut TankValues,
            step: Step,
            _: &InputTrajectory<TankValues>,
            _: &mut dyn Log,
        ) -> Stepped {
            let empty_s = step.time_s + values.level;
            values.level -= step.length_s.min(values.level);
            values.forgotten = values.flow / values.area;
            if values.level > 0.0 { Ok(()) } else { Err(StepError::terminate(empty_s, "it is empty")) }
        }
    }

    export_fmus!(Pid, Tank);
}

use library::FMUS;
use support::ffi::{Expect, Fmu};
use support::ffi3::Request3;

fn instance(name: &str) -> (std::sync::Arc<ModelType>, Instance) {
    let model = FMUS.find(name).expect("a model");
    let instance = model.instantiate();
    (model, instance)
}

fn index(model: &ModelType, name: &str) -> usize {
    model.variables().iter().position(|variable| variable.name == name).expect("a variable")
}

fn variable<'m>(model: &'m ModelType, name: &str) -> &'m Variable {
    &model.variables()[index(model, name)]
}

fn real(instance: &mut Instance, index: usize) -> f64 {
    instance.get(index).expect("a value").as_f64()
}

/// Fails if the model continues with the former value of a tunable parameter.
#[test]
fn tuning_reaches_the_model() {
    let (model, mut pid) = instance("Pid");
    let [kp, e, u] = ["kp", "e", "u"].map(|name| index(&model, name));
    pid.set(e, Value::Real(0.5)).expect("an input");
    pid.start().expect("good parameters");
    pid.step(Step { time_s: 0.0, length_s: 1e-4 }, &mut Silent).expect("a step");
    assert_eq!(real(&mut pid, u), 1.0);
    pid.set(kp, Value::Real(20.0)).expect("a tunable parameter");
    pid.step(Step { time_s: 1e-4, length_s: 1e-4 }, &mut Silent).expect("a step");
    assert_eq!(real(&mut pid, u), 10.0);
    // A copy continues like the original.
    let mut copy = model.instantiate();
    copy.read(&pid.write().expect("bytes"), true).expect("its own bytes");
    copy.step(Step { time_s: 2e-4, length_s: 1e-4 }, &mut Silent).expect("a step");
    assert_eq!(real(&mut copy, u), 10.0);
}

/// Fails if a program can make a step that no importer could.
#[test]
fn steps_that_do_not_follow_are_refused() {
    let (_, mut pid) = instance("Pid");
    pid.set_start(5.0);
    pid.start().expect("good parameters");
    pid.step(Step { time_s: 5.0, length_s: 1e-4 }, &mut Silent).expect("a step");
    let before = pid.write();
    for (time_s, length_s) in
        [(0.0, 1e-4), (5.0, 1e-4), (f64::NAN, 1e-4), (5.0001, f64::NAN), (5.0001, -1e-4), (5.0001, 101.0)]
    {
        let error = pid.step(Step { time_s, length_s }, &mut Silent).expect_err("no step");
        assert!(error.to_string().contains("is refused: expected"), "{error}");
    }
    assert_eq!(pid.write(), before);
    pid.step(Step { time_s: 5.0001, length_s: 1e-4 }, &mut Silent).expect("a step");
}

/// Fails if a number without an item, or a value outside the limits of its row, is accepted.
#[test]
fn limits_are_enforced_by_name() {
    let (model, mut pid) = instance("Pid");
    let [kp, law, inertia, e] = ["kp", "law", "inertia", "e"].map(|name| index(&model, name));
    let refused = |error: &dyn std::fmt::Display, wanted: &str| assert_eq!(error.to_string(), wanted);
    let error = pid.set(law, Value::Integer(99)).expect_err("no item");
    refused(&error, "law = 99 is refused: expected one of proportional (1), integral (2)");
    let error = pid.set(e, Value::Real(1.5)).expect_err("too large");
    refused(&error, "e = 1.5 m is refused: expected a value from -1 to 1 m");
    pid.set(inertia, Value::Real(-1.0)).expect("checked at the start");
    pid.set(kp, Value::Real(101.0)).expect("checked at the start");
    let found = Invalid::list(&pid.start().expect_err("two parameters"));
    let wanted = "kp = 101 is refused: expected a value of at most 100; \
                  inertia = -1 kg.m2 is refused: expected a value of at least 0 kg.m2";
    assert_eq!(found, wanted);
    pid.set(inertia, Value::Real(0.0)).expect("a value");
    pid.set(kp, Value::Real(100.0)).expect("a value");
    pid.start().expect("now it is good");
    let error = pid.set(kp, Value::Real(1000.0)).expect_err("tuned too far");
    refused(&error, "kp = 1000 is refused: expected a value of at most 100");
    assert_eq!(pid.get(kp), Ok(Value::Real(100.0)));
}

/// Fails if the trial start before the run changes the values of the run.
#[test]
fn reading_before_the_run_changes_nothing() {
    let (model, mut tank) = instance("Tank");
    let [starts, area] = ["starts", "area"].map(|name| index(&model, name));
    for _ in 0..3 {
        tank.set(area, Value::Real(3.0)).expect("a parameter");
        assert_eq!(real(&mut tank, starts), 1.0);
    }
    tank.start().expect("good parameters");
    assert_eq!(real(&mut tank, starts), 1.0);
}

/// Fails if a capability is declared that the model does not have.
#[test]
fn inputs_are_interpolated_only_if_the_model_supports_it() {
    let (model, mut tank) = instance("Tank");
    assert!(model.xml().contains("canInterpolateInputs=\"false\""));
    let flow = index(&model, "flow");
    let error = tank.set_input_derivatives(1, &|_| (flow, 1, 1.0)).expect_err("not followed");
    assert!(error.to_string().contains("flow: the model holds its inputs over a step"), "{error}");
    assert!(instance("Pid").0.xml().contains("canInterpolateInputs=\"true\""));
}

/// Fails if an input whose derivative took it beyond its limits makes a snapshot unreadable, if outputs of a sampled model are continuous, or
/// if what follows from a tuned parameter waits for the next sample.
#[test]
fn sampled_models_hold_outputs_and_follow_inputs() {
    let (model, mut pid) = instance("Pid");
    assert_eq!((variable(&model, "u").is_continuous(), &variable(&model, "u").depends_on), (false, &Some(Vec::new())));
    let [e, u, kp, doubled] = ["e", "u", "kp", "doubled"].map(|name| index(&model, name));
    pid.set(e, Value::Real(0.95)).expect("within its limits");
    pid.start().expect("good parameters");
    pid.set_input_derivatives(1, &|_| (e, 1, 1000.0)).expect("followed");
    pid.step(Step { time_s: 0.0, length_s: 2e-4 }, &mut Silent).expect("a step");
    let bytes = pid.write().expect("a snapshot");
    let mut read = model.instantiate();
    read.read(&bytes, true).expect("its own snapshot");
    assert!((real(&mut read, e) - 1.15).abs() < 1e-12 && real(&mut read, u) == real(&mut pid, u));
    pid.set(kp, Value::Real(3.0)).expect("tunable");
    assert_eq!(real(&mut pid, doubled), 6.0);
}

/// The elements of a part of the structure, by name, with their dependencies by name.
fn structure(model: &ModelType, part: &str) -> Vec<(String, Option<Vec<String>>)> {
    let document = roxmltree::Document::parse(model.xml()).expect("well-formed XML");
    let found = document.descendants().find(|node| node.has_tag_name(part)).expect("the part");
    let name = |index: &str| model.variables()[index.parse::<usize>().expect("an index") - 1].name.to_string();
    let unknowns = found.children().filter(|node| node.is_element());
    let named = unknowns.map(|unknown| {
        let known = unknown.attribute("dependencies").map(|known| known.split_whitespace().map(name).collect());
        (name(unknown.attribute("index").expect("an index")), known)
    });
    named.collect()
}

/// Fails if a forgotten dependency means independence, or if the dependencies at the start differ from the table.
#[test]
fn without_declared_dependencies_a_variable_depends_on_all() {
    let (tank, _) = instance("Tank");
    let some = |names: &[&str]| Some(names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>());
    let outputs = [("level", None), ("forgotten", None), ("starts", some(&["level"]))];
    assert_eq!(structure(&tank, "Outputs"), outputs.map(|(name, known)| (name.to_owned(), known)));
    // The state has a start value, so it is not an unknown.
    let unknowns = [
        ("doubled", None),
        ("rate", some(&["area", "flow"])),
        ("forgotten", None),
        ("starts", some(&["area", "level"])),
    ];
    assert_eq!(structure(&tank, "InitialUnknowns"), unknowns.map(|(name, known)| (name.to_owned(), known)));
    let (pid, _) = instance("Pid");
    assert_eq!(structure(&pid, "Outputs"), [("u".to_owned(), Some(Vec::new()))]);
    assert_eq!(structure(&pid, "InitialUnknowns"), [("u".to_owned(), None), ("doubled".to_owned(), None)]);
}

/// Fails if a settable start value, a constant, a calculated parameter, or the time is not declared as such, or not kept.
#[test]
fn every_kind_of_variable_is_supported() {
    let (model, mut tank) = instance("Tank");
    let [level, doubled, g, area, time, cell] =
        ["level", "doubled", "g", "area", "time", "cells[40]"].map(|name| index(&model, name));
    tank.set(level, Value::Real(7.0)).expect("a start value");
    tank.set(area, Value::Real(3.0)).expect("a parameter");
    tank.set_start(10.0);
    assert_eq!(real(&mut tank, level), 7.0);
    assert!(tank.set(g, Value::Real(1.0)).expect_err("a constant").to_string().contains("it is constant"));
    tank.start().expect("good parameters");
    assert_eq!([level, doubled, g, time, cell].map(|at| real(&mut tank, at)), [7.0, 6.0, 9.81, 10.0, 39.0]);
    assert!(tank.set(level, Value::Real(1.0)).is_err());
    let document = roxmltree::Document::parse(model.xml()).expect("well-formed XML");
    let attributes = |name: &str| {
        let node = document.descendants().find(|node| node.attribute("name") == Some(name)).expect("the variable");
        let start = node.first_element_child().expect("a type").attribute("start").map(str::to_owned);
        let of = |attribute| node.attribute(attribute).unwrap_or("-").to_owned();
        format!("{} {} {} {}", of("causality"), of("variability"), of("initial"), start.unwrap_or("-".into()))
    };
    assert_eq!(attributes("level"), "output continuous exact 5");
    assert_eq!(attributes("g"), "local constant exact 9.81");
    assert_eq!(attributes("doubled"), "calculatedParameter fixed calculated -");
    assert_eq!(attributes("time"), "independent continuous - -");
    assert!(variable(&model, "cells[40]").description.is_empty());
}

/// Fails if a display unit is declared without being requested.
#[test]
fn nothing_is_displayed_in_another_unit_by_default() {
    for name in ["Pid", "Tank"] {
        assert!(!instance(name).0.xml().contains("displayUnit="), "{name}");
    }
}

/// Fails if snapshots are declared or made of a state that cannot be copied.
#[test]
fn a_state_that_cannot_be_saved_is_declared() {
    let (model, mut tank) = instance("Tank");
    assert!(model.xml().contains("canGetAndSetFMUstate=\"false\" canSerializeFMUstate=\"false\""));
    tank.start().expect("good parameters");
    assert!(tank.duplicate().is_none() && tank.write().is_none());
    let fmu = Fmu::started("Tank", &[]);
    let mut state = std::ptr::null_mut();
    assert!(fmu.get_state(&mut state).error(&fmu).contains("this model has no snapshots"));
}

/// Fails if the request of a model to end the simulation is an error, or is not reported, or does not end it.
#[test]
fn a_model_may_end_the_simulation() {
    let fmu = Fmu::started("Tank", &[("level", 0.25)]);
    fmu.step(0.0, 0.1).ok(&fmu);
    assert_eq!(fmu.step(0.1, 0.2), fmi2Status::fmi2Discard);
    let (mut ended, mut time): (fmi2Boolean, fmi2Real) = (0, 0.0);
    // SAFETY: the instance is live, the places can be written.
    unsafe {
        call!(fmi2GetBooleanStatus: fmi2GetBooleanStatusTYPE(fmu.component(), fmi2StatusKind::fmi2Terminated, &raw mut ended)).ok(&fmu);
        call!(fmi2GetRealStatus: fmi2GetRealStatusTYPE(fmu.component(), fmi2StatusKind::fmi2LastSuccessfulTime, &raw mut time)).ok(&fmu);
    }
    assert_eq!((ended, time, fmu.get("time")), (1, 0.25, 0.25));
    let messages = fmu.take_messages();
    assert!(messages.iter().any(|message| message.text.contains("it is empty")), "{messages:?}");
    assert!(fmu.step(0.25, 0.1).error(&fmu).contains("the model has ended the simulation"));
}

/// Fails if the message on a result of the last step blames the present inputs.
#[test]
fn results_that_are_not_finite_are_refused() {
    let fmu = Fmu::started("Tank", &[("area", 0.0)]);
    fmu.step(0.0, 0.1).ok(&fmu);
    let status = fmu.try_get("forgotten").expect_err("0/0");
    let wanted = "fmi2GetReal: forgotten: the model computes NaN, and only finite numbers are returned";
    assert_eq!(status.error(&fmu), wanted);
}

/// Fails if an importer that allows it does not learn that a step ended early, or if another one does.
#[test]
fn a_step_in_which_the_model_ends_the_simulation_returns_early_if_allowed() {
    // One that ends with the step is not early.
    for (early_return, length, early) in [(false, 0.5, 0), (true, 0.5, 1), (true, 0.25, 0)] {
        let request = Request3 { early_return, ..Request3::of("Tank", false) };
        let fmu = request.instantiate("Tank", false).expect("an instance");
        fmu.ok(fmu.set("level", 0.375));
        fmu.start(0.0);
        assert_eq!(fmu.try_step(0.0, 0.125).1.flags, [0; 3]);
        let (status, done) = fmu.try_step(0.125, length);
        fmu.ok(status);
        assert_eq!((done.flags, done.time), ([0, 1, early], 0.375));
    }
}

/// Fails if a run cannot start at the time of day, or loses or doubles a sample there.
#[test]
fn runs_can_start_at_the_time_of_day() {
    for start_s in [1.8e9, 1e10] {
        let fmu = Fmu::new("Pid");
        fmu.set("e", 0.5).ok(&fmu);
        fmu.start(start_s, None);
        let step_s = if start_s > 2e9 { 1e-3 } else { 1e-4 };
        for step in 0..100 {
            fmu.step(start_s + f64::from(step) * step_s, step_s).ok(&fmu);
        }
        assert_eq!(fmu.get("u"), 1.0);
    }
    let fmu = Fmu::new("Pid");
    assert!(fmu.setup(1e11, None).error(&fmu).contains("startTime = 100000000000 is refused"));
}

/// Mistakes that a packager must find.
mod mistakes {
    use super::*;

    #[derive(Clone, Default, Serialize, Deserialize)]
    pub struct Values {
        list: Vec<f64>,
        x: f64,
        n: i32,
    }

    /// A model whose table is the mistake, or what it promises or starts with.
    macro_rules! mistaken {
        ($module:ident, $name:literal, $table:expr) => {
            mistaken!($module, $name, $table, Capabilities::NONE, |_| {});
        };
        ($module:ident, $name:literal, $table:expr, $capabilities:expr, $start:expr) => {
            pub mod $module {
                use super::*;

                #[derive(Clone)]
                pub struct Mistaken;

                impl Model for Mistaken {
                    const INFO: Info = Info::new($name, "A mistake");
                    const CAPABILITIES: Capabilities = $capabilities;
                    type Values = Values;
                    type State = ();

                    fn table() -> Vec<Row<Values>> {
                        $table
                    }

                    fn new(_: &Values, _: &Resources) -> Result<Self, Vec<Invalid>> {
                        Ok(Self)
                    }

                    fn start(&self, values: &mut Values, _: f64) {
                        let start: fn(&mut Values) = $start;
                        start(values);
                    }

                    fn step(
                        &self,
                        _: &mut (),
                        _: &mut Values,
                        _: Step,
                        _: &InputTrajectory<Values>,
                        _: &mut dyn Log,
                    ) -> Stepped {
                        Ok(())
                    }
                }
            }
        };
    }

    fn x(name: &'static str) -> Row<Values> {
        Row::real(name, place!(Values.x), unit::METRE, 0.0).input()
    }

    mistaken!(empty, "Empty", vec![Row::real("x", place!(Values.list[k]), unit::ONE, 0.0).fixed()]);
    mistaken!(shared, "Shared", vec![x("a"), x("b")]);
    mistaken!(named, "Named", vec![x("my variable"), Row::integer("2n", place!(Values.n), 0).input()]);
    mistaken!(display, "Display", vec![x("a").display_unit("furlong")]);
    mistaken!(bound, "Bound", vec![x("a").min(f64::NAN)]);
    mistaken!(
        derivative,
        "Derivative",
        vec![
            Row::real("v", place!(Values.x), unit::ONE, 0.0).derivative_of("n"),
            Row::integer("n", place!(Values.n), 0).output()
        ]
    );

    fn output() -> Vec<Row<Values>> {
        vec![Row::real("y", place!(Values.x), unit::ONE, 0.0).output()]
    }

    mistaken!(direction, "Direction", output(), Capabilities::NONE.directional_derivatives(), |_| {});
    mistaken!(rate, "Rate", output(), Capabilities::NONE.output_derivatives(1), |_| {});
    mistaken!(overwriting, "Overwriting", vec![x("u")], Capabilities::NONE, |values| values.x = 7.0);

    fn one_metre() -> unit::Unit {
        unit::Unit::new("m", &[("s", 1)], &[])
    }

    mistaken!(units, "Units", vec![x("a"), Row::real("b", place!(Values.x), one_metre(), 0.0).output()]);

    const ODD: unit::Unit =
        unit::Unit::new("f\u{7}", &[("furlong", 1), ("m", 1), ("m", 1)], &[unit::Display::new("d", 0.0)]);

    mistaken!(texts, "Texts", vec![x("'Größe'"), x("'a\\'b c'"), Row::real("b", place!(Values.x), ODD, 0.0).output()]);
    mistaken!(nothing, "Nothing", vec![]);

    static LAW: Enumeration = Enumeration::new("Law", "", &[("one", "")]);

    mistaken!(homonym, "Homonym", vec![x("Law"), Row::choice("n", place!(Values.n), &LAW, 1).fixed()]);
    // As an array, x would have one nominal value and its derivative one state.
    mistaken!(unlike, "Unlike", {
        let rows =
            |name| Row::elements(name, [0.0; 2], |name, start| Row::real(name, place!(Values.x), unit::ONE, start));
        let states = rows("x").zip([1.0, 2.0]).map(|(row, nominal)| row.local().state().nominal(nominal));
        states.chain(rows("dx").map(|row| row.local().derivative_of("x"))).collect()
    });

    #[derive(Clone, Default, Serialize, Deserialize)]
    pub struct Flat {
        #[serde(flatten)]
        inner: Inner,
    }

    #[derive(Clone, Default, Serialize, Deserialize)]
    struct Inner {
        count: u32,
    }

    /// A model whose period is a parameter and whose state serde can write only with field names.
    #[derive(Clone)]
    pub struct Flattened(f64);

    impl SampledModel for Flattened {
        const INFO: Info = Info::new("Flattened", "A mistake");
        type Values = Values;
        type State = Flat;

        fn table() -> Vec<Row<Values>> {
            vec![Row::real("period", place!(Values.x), unit::SECOND, 1.0).fixed()]
        }

        fn new(values: &Values, _: &Resources) -> Result<Self, Vec<Invalid>> {
            Ok(Self(values.x))
        }

        fn period_s(&self) -> f64 {
            self.0
        }

        fn start(&self, _: &mut Values, _: f64) -> Flat {
            Flat::default()
        }

        fn sample(&self, _: &mut Flat, _: &mut Values, instant_s: f64, _: &mut dyn Log) -> Stepped {
            if instant_s > 0.55 { Err(StepError::terminate(instant_s, "it is over")) } else { Ok(()) }
        }
    }

    #[derive(Clone, Default, Serialize, Deserialize)]
    pub struct Counted {
        #[serde(skip)]
        count: u32,
    }

    /// A model whose state is written without its only field.
    #[derive(Clone)]
    pub struct Skipping;

    impl SampledModel for Skipping {
        const INFO: Info = Info::new("Skipping", "A mistake").experiment(10.0, 1.0);
        type Values = Values;
        type State = Counted;

        fn table() -> Vec<Row<Values>> {
            vec![Row::integer("n", place!(Values.n), 0).output()]
        }

        fn new(_: &Values, _: &Resources) -> Result<Self, Vec<Invalid>> {
            Ok(Self)
        }

        fn period_s(&self) -> f64 {
            1.0
        }

        fn start(&self, _: &mut Values, _: f64) -> Counted {
            Counted::default()
        }

        fn sample(&self, state: &mut Counted, values: &mut Values, _: f64, _: &mut dyn Log) -> Stepped {
            state.count += 1;
            // The number of samples, two by two.
            values.n = (state.count / 2) as i32;
            Ok(())
        }
    }

    pub static SKIPPING: fmu_export::Fmus =
        fmu_export::Fmus::new("none", || vec![ModelType::of::<fmu_export::Sampled<Skipping>>()]);
    pub static FLATTENED: fmu_export::Fmus =
        fmu_export::Fmus::new("none", || vec![ModelType::of::<fmu_export::Sampled<Flattened>>()]);
    /// A library with a single model.
    macro_rules! alone {
        ($library:ident, $module:ident) => {
            pub static $library: fmu_export::Fmus =
                fmu_export::Fmus::new("none", || vec![ModelType::of::<$module::Mistaken>()]);
        };
    }
    alone!(EMPTY, empty);
    alone!(DIRECTION, direction);
    alone!(RATE, rate);
    alone!(OVERWRITING, overwriting);
    pub static TWICE: fmu_export::Fmus =
        fmu_export::Fmus::new("none", || vec![ModelType::of::<named::Mistaken>(), ModelType::of::<named::Mistaken>()]);
}

/// Fails if a mistake in a table is packed.
#[test]
fn mistakes_are_found_when_packing() {
    fn problems<M: Model>() -> String {
        ModelType::of::<M>().problems().join("; ")
    }
    let found = [
        (problems::<mistakes::shared::Mistaken>(), "a and b access the same field"),
        (problems::<mistakes::named::Mistaken>(), "the name `my variable` is not allowed"),
        (problems::<mistakes::named::Mistaken>(), "the name `2n` is not allowed"),
        (problems::<mistakes::display::Mistaken>(), "a has the display unit furlong: expected one of m, µm, mm"),
        (problems::<mistakes::bound::Mistaken>(), "the min of a is not a finite number"),
        (problems::<mistakes::derivative::Mistaken>(), "v refers to n, which is not a state"),
        (problems::<mistakes::units::Mistaken>(), "there are two units named m; b has the second"),
        (problems::<mistakes::texts::Mistaken>(), "the name `'Größe'` is not allowed"),
        (problems::<mistakes::texts::Mistaken>(), "contains the character \\u{7}, which XML cannot hold"),
        (problems::<mistakes::texts::Mistaken>(), "has the base unit furlong: expected one of kg"),
        (problems::<mistakes::texts::Mistaken>(), "has the base unit m twice"),
        (problems::<mistakes::texts::Mistaken>(), "the display unit d of f\u{7} has the factor 0"),
        (problems::<mistakes::nothing::Mistaken>(), "there is no variable"),
        (problems::<mistakes::homonym::Mistaken>(), "the enumeration Law has the name of a variable"),
    ];
    for (problems, wanted) in found {
        assert!(problems.contains(wanted), "`{wanted}` is not said in: {problems}");
    }
    for name in ["Pid", "Tank"] {
        assert_eq!(instance(name).0.problems(), [""; 0], "{name}");
    }
}

/// Fails if derivatives form an array but their states do not.
#[test]
fn states_and_derivatives_are_arrays_together() {
    let model = ModelType::of::<mistakes::unlike::Mistaken>();
    let xml = &model.description(Standard::Fmi3 { arrays: true }).xml;
    assert!(["x[1]", "x[2]", "dx[1]", "dx[2]"].iter().all(|name| xml.contains(&format!("name=\"{name}\""))), "{xml}");
}

/// Fails if adding up steps turns a termination into an error, if a period of 0 hangs, or if a state that is not written, or not as a whole, is packed.
#[test]
fn mistakes_in_sampled_models_are_refused() {
    let model = ModelType::of::<fmu_export::Sampled<mistakes::Flattened>>();
    let (mut instance, mut time_s) = (model.instantiate(), 0.0);
    instance.set(0, Value::Real(0.01)).expect("a parameter");
    instance.start().expect("a good period");
    let end = loop {
        let step = Step { time_s, length_s: 0.01 };
        if let Err(error) = instance.step(step, &mut Silent) {
            break error;
        }
        time_s += 0.01;
    };
    assert!(matches!(end, StepError::Terminated { .. }), "{end}");
    let mut still = model.instantiate();
    still.set(0, Value::Real(0.0)).expect("a parameter");
    let found = Invalid::list(&still.start().expect_err("no period"));
    assert!(found.contains("the sample period = 0 s is refused: expected a number above 0"), "{found}");
    let error = Packager::new(&mistakes::FLATTENED).write("none").expect_err("it cannot be saved");
    assert!(error.to_string().contains("cannot be saved"), "{error}");
    let error = Packager::new(&mistakes::SKIPPING).write("none").expect_err("a field is lost");
    assert!(error.to_string().contains("attributes skip"), "{error}");
    assert!(error.to_string().ends_with("at 2 s a copy has n = Integer(0), the original n = Integer(1)"), "{error}");
    let leaving = Packager::new(&FMUS).extras(|_| fmu_export::package::Extras::default().resource("../../a", "b"));
    let error = leaving.write("none").expect_err("outside");
    assert!(format!("{error:?}").contains("\"../../a\" is not allowed"), "{error:?}");
}

/// Fails if there is no warning that samples have the same or outdated inputs, or if every step repeats it.
#[test]
fn samples_with_the_inputs_of_another_instant_cause_a_warning() {
    struct Warnings(Vec<String>);
    impl Log for Warnings {
        fn wants(&self, topic: Topic) -> bool {
            topic == Topic::Warning
        }

        fn message(&mut self, _: Topic, message: std::fmt::Arguments<'_>) {
            self.0.push(message.to_string());
        }
    }
    let warnings = |length_s: f64| {
        let (_, mut pid) = instance("Pid");
        pid.start().expect("good parameters");
        let mut log = Warnings(Vec::new());
        for n in 0..9 {
            pid.step(Step { time_s: f64::from(n) * length_s, length_s }, &mut log).expect("a step");
        }
        log.0
    };
    assert_eq!(
        warnings(3e-4),
        ["a communication step of 0.0003 s holds 3 samples, one every 0.0001 s, of the same inputs"]
    );
    assert_eq!(
        warnings(3e-5),
        [
            "the sample at 0.0001 s has the inputs from 9e-5 s: communication steps of 3e-5 s do not divide the sample period of 0.0001 s"
        ]
    );
    assert_eq!((warnings(1e-4), warnings(2e-5)), (Vec::new(), Vec::new()));
}

/// Fails if an archive is written of a model that cannot be instantiated, or of two models with one name; that promises derivatives without
/// having them; or whose start replaces a start value.
#[test]
fn models_that_cannot_run_are_not_packed() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("mistakes");
    let error = Packager::new(&mistakes::EMPTY).write(&folder).expect_err("it panics");
    assert!(matches!(error, PackageError::Trial { name: "Empty", .. } | PackageError::Model { .. }), "{error}");
    assert!(error.to_string().contains("panics"), "{error}");
    for (library, words) in [
        (&mistakes::DIRECTION, "promises directional derivatives, but `differentiate` is not implemented"),
        (&mistakes::RATE, "promises derivatives of outputs, but `output_derivatives` is not implemented"),
        (&mistakes::OVERWRITING, "u = Real(7.0) after the start: expected Real(0.0), the start value"),
    ] {
        let error = Packager::new(library).write(&folder).expect_err("a mistake");
        assert!(error.to_string().contains(words), "{error}");
    }
    let error = PackageError::NoBinary("libmodels.so".into());
    assert!(error.to_string().contains("touch src/lib.rs"), "{error}");
    let error = Packager::new(&mistakes::TWICE).write(&folder).expect_err("two of one name");
    assert!(error.to_string().contains("Named"), "{error}");
    let error = Packager::new(&FMUS).arguments(["--fast".to_owned()]).err().expect("an unknown argument");
    assert!(error.to_string().contains("`--fast` is unknown"), "{error}");
    assert!(!folder.exists());
}
