//! Messages: their categories, and a logger that calls back.

use super::*;

/// Message categories of an estimator without currents that misses a sample, and of a wrong call.
fn logged_categories(logging: bool, switches: &[(bool, &[&str])]) -> Vec<String> {
    let fmu = Request { logging, ..Request::of(ESTIMATOR) }.instantiate(ESTIMATOR).expect("an instance");
    for (on, categories) in switches {
        fmu.set_logging(*on, categories).ok(&fmu);
    }
    for (name, value) in [("method", 2.0), ("Tf", 2e-3), ("epsilon", 2e-3)] {
        fmu.set(name, value).ok(&fmu);
    }
    fmu.start(0.0, None);
    for step in 0..100 {
        // A missing sample starts another window, which is an event. Without currents the matrix of the equations is
        // 0 once the window is full.
        let position = 1e-6 * f64::from(step % 3);
        for name in ["Ym", "Zm"] {
            fmu.set(name, if step == 50 { f64::NAN } else { position }).ok(&fmu);
        }
        fmu.step(f64::from(step) * TS, TS).ok(&fmu);
    }
    assert_eq!(fmu.step(0.0, -1.0), fmi2Status::fmi2Error);
    let messages = fmu.take_messages();
    for message in messages.iter().filter(|message| message.category == "logSingularLinearSystems") {
        assert_contains(&message.text, &["does not determine all unknowns"]);
    }
    let mut categories: Vec<_> = messages.into_iter().map(|message| message.category).collect();
    categories.sort();
    categories.dedup();
    categories
}

/// A controller uses new force constants from its first sample on. Fails if an event is reported as an error.
#[test]
fn an_event_is_reported_once() {
    let fmu = Request { logging: true, ..Request::of(CONTROLLER) }.instantiate(CONTROLLER).expect("an instance");
    fmu.set("update.time", 0.0).ok(&fmu);
    fmu.start(0.0, None);
    for (name, value) in [("lambdaHat[1]", 2e-6), ("lambdaHat[2]", 2e-6), ("lambdaHat[3]", 2e-6), ("lambdaValid", 1.0)]
    {
        fmu.set(name, value).ok(&fmu);
    }
    fmu.step(0.0, TS).ok(&fmu);
    let messages = fmu.take_messages();
    let [message] = &messages[..] else { panic!("expected one event: {messages:?}") };
    assert_eq!((message.status, message.category.as_str()), (fmi2Status::fmi2OK, "logEvents"));
    assert_contains(&message.text, &["force constants", "2e-6"]);
    assert_eq!(message.instance, "instance");
}

/// Every category of the model description, switched on alone and off alone. No message has the categories
/// `logStatusWarning` and `logStatusFatal`; switching them must not affect others.
/// Fails if two categories share a bit, if switching one on enables others, if errors cannot be switched off by
/// name, or if a singular matrix is reported as an event.
#[test]
fn every_category_is_switched_alone() {
    let used = ["logEvents", "logSingularLinearSystems", "logStatusError"];
    assert_eq!(logged_categories(true, &[]), used);
    let model = magnetic_bearing::fmu::find(PLANT).expect("a model of this project");
    let document = roxmltree::Document::parse(model.xml()).expect("well-formed XML");
    let declared: Vec<_> = document.descendants().filter(|node| node.has_tag_name("Category")).collect();
    assert_eq!(declared.len(), 6);
    for category in declared.iter().map(|node| node.attribute("name").expect("a name")) {
        let all = category == "logAll";
        // Errors are reported unless they are switched off by name.
        let on = logged_categories(false, &[(false, &["logStatusError"]), (true, &[category])]);
        let wanted: Vec<_> = used.into_iter().filter(|used| all || *used == category).collect();
        assert_eq!(on, wanted, "{category} alone");
        let off = logged_categories(true, &[(false, &[category])]);
        let wanted: Vec<_> =
            if all { vec!["logStatusError"] } else { used.into_iter().filter(|used| *used != category).collect() };
        assert_eq!(off, wanted, "all but {category}");
        let again = logged_categories(true, &[(false, &[category]), (true, &[category])]);
        assert_eq!(again, used, "{category} off and on");
    }
    // An empty list stands for all categories; a list of several switches each.
    let errors = ["logStatusError"];
    assert_eq!(logged_categories(false, &[]), errors, "off from the start");
    assert_eq!(logged_categories(false, &[(true, &[])]), used, "all on");
    assert_eq!(logged_categories(true, &[(false, &[])]), errors, "all off");
    let two = logged_categories(false, &[(true, &["logEvents", "logSingularLinearSystems"]), (false, &["logEvents"])]);
    assert_eq!(two, used[1..], "two on, one of them off");
}

/// Fails if a list with an unknown category switches the known ones, or if the message does not name the unknown one.
#[test]
fn a_list_with_an_unknown_category_switches_nothing() {
    let fmu = Request::of(PLANT).instantiate(PLANT).expect("an instance");
    fmu.set_logging(false, &[]).ok(&fmu);
    // Errors are reported even with logging off: otherwise the reason for the end of a simulation would be lost.
    assert_contains(&fmu.step(0.0, TS).error(&fmu), &["fmi2DoStep"]);
    let unknown = ["logNonsense", "logevents", "logEvents ", ""];
    for name in unknown {
        let said = fmu.set_logging(false, &["logStatusError", name]).error(&fmu);
        assert_contains(&said, &["fmi2SetDebugLogging: ", &format!("{name} is not a category")]);
    }
    assert_contains(&fmu.step(0.0, TS).error(&fmu), &["fmi2DoStep"]);
}

/// Data of a logger that calls back into its instance.
struct Caller {
    component: std::cell::Cell<fmi2Component>,
    answers: std::cell::RefCell<Vec<fmi2Status>>,
    frees: bool,
}

/// A logger that uses its instance: it reads, steps, resets, steps in another thread, and frees it.
unsafe extern "C" fn call_back(
    environment: fmi2ComponentEnvironment,
    _: fmi2String,
    _: fmi2Status,
    _: fmi2String,
    _: fmi2String,
    _: fmi2String,
) {
    // SAFETY: the environment is the address of the caller, which outlives the instance.
    let caller = unsafe { &*environment.cast::<Caller>() };
    let (c, mut value) = (caller.component.get(), 0.0);
    // SAFETY: the instance is live; the arrays have one element.
    unsafe {
        let answers = [
            call!(fmi2GetReal: fmi2GetRealTYPE(c, [0].as_ptr(), 1, &raw mut value)),
            call!(fmi2DoStep: fmi2DoStepTYPE(c, 0.0, TS, fmi2True)),
            call!(fmi2Reset: fmi2ResetTYPE(c)),
            call!(fmi2SetDebugLogging: fmi2SetDebugLoggingTYPE(c, fmi2False, 0, null())),
        ];
        caller.answers.borrow_mut().extend(answers);
        let address = c.expose_provenance();
        let another = move || {
            let c = std::ptr::with_exposed_provenance_mut(address);
            call!(fmi2DoStep: fmi2DoStepTYPE(c, 0.0, TS, fmi2True))
        };
        caller.answers.borrow_mut().push(thread::spawn(another).join().expect("no panic"));
        if caller.frees {
            call!(fmi2FreeInstance: fmi2FreeInstanceTYPE(c));
        }
    }
}

/// Loggers of importers call back, for instance to read the time, and so do other threads meanwhile. Fails if the entry guard admits a
/// second call: this process then ends in endless recursion, or the instance is freed during its call.
#[test]
fn a_logger_that_calls_back_is_refused() {
    for frees in [false, true] {
        let caller =
            Box::new(Caller { component: null_mut::<std::ffi::c_void>().into(), answers: Vec::new().into(), frees });
        let callbacks = fmi2CallbackFunctions {
            logger: crate::support::ffi::variadic(call_back),
            allocateMemory: None,
            freeMemory: None,
            stepFinished: None,
            componentEnvironment: (&raw const *caller).cast_mut().cast(),
        };
        let (name, guid) = (text("speaker"), text(&guid(PLANT)));
        let kind = fmi2Type::fmi2CoSimulation;
        // SAFETY: callbacks, texts and environment outlive the instance, which is freed once.
        unsafe {
            let c = call!(fmi2Instantiate: fmi2InstantiateTYPE(name.as_ptr(), kind, guid.as_ptr(), null(), &raw const callbacks, 0, 0));
            caller.component.set(c);
            let error = fmi2Status::fmi2Error;
            for _ in 0..2 {
                assert_eq!(call!(fmi2DoStep: fmi2DoStepTYPE(c, 0.0, TS, fmi2True)), error);
                assert_eq!(caller.answers.take(), [error; 5]);
            }
            // After the call the instance is unchanged.
            assert_eq!(call!(fmi2EnterInitializationMode: fmi2EnterInitializationModeTYPE(c)), fmi2Status::fmi2OK);
            assert_eq!(call!(fmi2ExitInitializationMode: fmi2ExitInitializationModeTYPE(c)), fmi2Status::fmi2OK);
            call!(fmi2FreeInstance: fmi2FreeInstanceTYPE(c));
        }
    }
}
