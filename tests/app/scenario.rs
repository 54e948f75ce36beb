//! Scenario files: accepted notations, and refusals that name the key, the value, and the expectation.

use crate::prelude::*;

use fmu_export::variable::Value;

/// The scenario with the given top-level lines and tables.
fn parse(head: &str, tables: &str) -> Result<Scenario, String> {
    let mut text = String::from("title = \"A test\"\n");
    for (key, line) in [("duration", "duration = \"10 ms\"\n"), ("step", "step = 1e-4\n")] {
        text += if head.contains(key) { "" } else { line };
    }
    text += &format!("{head}\n{tables}");
    Scenario::parse("test.toml", &text).map_err(|error| error.to_string())
}

/// The message for a scenario that cannot be read or started.
#[track_caller]
fn refusal(head: &str, tables: &str) -> String {
    match parse(head, tables).map(|scenario| simulate::run(&scenario)) {
        Err(error) => {
            assert_contains(&error, &["test.toml"]);
            error
        }
        Ok(run) => run.err().unwrap_or_else(|| panic!("nothing was refused of:\n{head}\n{tables}")).to_string(),
    }
}

#[test]
fn the_built_in_scenarios_are_sound() {
    for (name, text) in BUILT_IN {
        let opened = Scenario::open(Path::new(name)).unwrap_or_else(|error| panic!("{error}"));
        let parsed = Scenario::parse(name, text).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(opened.title, parsed.title);
        assert!(!opened.title.is_empty() && !opened.description.is_empty(), "{name} says what it is");
        let names: Vec<_> = opened.elements[..3].iter().map(|element| element.name.as_str()).collect();
        assert_eq!(names, ["plant", "controller", "estimator"]);
        assert!(opened.duration_s > 0.0 && opened.step_s <= opened.duration_s, "{name}");
    }
}

#[test]
fn values_in_every_notation() {
    let tables = "[all]\nm = 7\nlambda0 = [1e-6, 2e-6, 3e-6]\n[plant]\nY0 = \"20 µm\"\nZ0 = \"0.02 mm\"\nlambda = [1e-6, \"2 N.mm2/A2\", 3e-6]\nomega = \"3000 rpm\"\n\
         unbalance.phase = \"90°\"\nsensor.seed = -4\n'alpha[1]' = 3.0\n\
         [controller]\nupdate.mode = \"whenValid\"\n[controller.reference]\nrY = \"20 um\"\nlobes = 5\n\
         [estimator]\nm = 6.0\nenable = false\nTf = \"20 ms\"\n";
    let scenario = parse("", tables).expect("sound");
    for (element, name, wanted) in [
        ("plant", "m", 7.0),
        ("plant", "Y0", 2e-5),
        ("plant", "Z0", 2e-5),
        ("plant", "lambda[1]", 1e-6),
        ("plant", "lambda[2]", 2e-6),
        ("plant", "lambda[3]", 3e-6),
        ("plant", "omega", 314.1592653589793),
        ("plant", "unbalance.phase", std::f64::consts::FRAC_PI_2),
        ("plant", "alpha[1]", 3.0),
        ("controller", "reference.rY", 2e-5),
        ("estimator", "Tf", 0.02),
    ] {
        /// Relative; a conversion of units is one rounded division.
        const ROUNDING: f64 = 2.0 * f64::EPSILON;
        let found = scenario.number(element, name);
        assert!((found / wanted - 1.0).abs() <= ROUNDING, "{element}.{name} is {found}, expected {wanted}");
    }
    for (element, name, wanted) in [
        ("plant", "sensor.seed", Some(Value::Integer(-4))),
        ("controller", "update.mode", Some(Value::Integer(3))),
        ("controller", "reference.lobes", Some(Value::Integer(5))),
        ("estimator", "enable", Some(Value::Boolean(false))),
        // Values not given are the defaults.
        ("controller", "F0", Some(Value::Real(20.0))),
        ("plant", "nothing", None),
        // The common table applies to every element with such a variable; the element's own table takes precedence.
        ("controller", "m", Some(Value::Real(7.0))),
        ("estimator", "m", Some(Value::Real(6.0))),
        ("controller", "lambda0[2]", Some(Value::Real(2e-6))),
        ("estimator", "lambda0[3]", Some(Value::Real(3e-6))),
    ] {
        assert_eq!(scenario.value(element, name), wanted, "{element}.{name}");
    }
}

#[test]
fn estimators_beside_the_loop_differ_only_in_their_method() {
    let scenario = parse("compare = [\"paper\", \"predictionError\"]", "[estimator]\nTf = \"10 ms\"\n").expect("sound");
    let names: Vec<_> = scenario.elements.iter().map(|element| element.name.as_str()).collect();
    assert_eq!(names, ["plant", "controller", "estimator", "paper", "predictionError"]);
    for (element, method) in [("estimator", 3), ("paper", 2), ("predictionError", 3)] {
        assert_eq!(scenario.value(element, "method"), Some(Value::Integer(method)), "{element}");
        assert_eq!(scenario.value(element, "Tf"), Some(Value::Real(0.01)), "{element}");
    }
    let connections = scenario.connections();
    let to_paper = connections.iter().filter(|[_, (to, _)]| names[*to] == "paper").count();
    assert_eq!(to_paper, 7, "positions, currents, angle and speed reach it");
    assert!(connections.iter().all(|[(from, _), _]| names[*from] != "paper"), "its outputs are free");
}

#[test]
fn errors_are_refused_by_name() {
    // Head, tables, and words in the refusal.
    const CASES: &[(&str, &str, &[&str])] = &[
        // Unknown names, with a suggestion if one is similar.
        ("", "[plant]\nlamda = [1e-6, 1e-6, 1e-6]", &["[plant]", "lamda", "did you mean lambda?"]),
        ("", "[controller]\nreference.ry = 1e-5", &["[controller]", "reference.ry", "did you mean reference.rY?"]),
        ("", "[controller]\nupdate.tim = 0.1", &["update.tim", "did you mean update.time?"]),
        ("", "[plant]\nxyzzy = 1", &["[plant]", "xyzzy: there is no variable of this name; the nearest are "]),
        ("", "[plant]\nTs = 1e-4", &["[plant]", "Ts", "no variable of this name"]),
        ("", "[all]\nmass = 6.7", &["[all]", "mass", "no variable of this name"]),
        // Unknown tables and keys of the head.
        ("", "[plnt]\nm = 6.7", &["plnt in line 5", "did you mean plant?"]),
        // Units.
        ("", "[plant]\nY0 = \"30 furlong\"", &["[plant]", "Y0", "30 furlong", "m, µm, mm"]),
        ("", "[plant]\nm = \"7 m\"", &["m = \"7 m\"", "not one of kg, g"]),
        ("", "[controller]\nreference.omega = \"50 kHz\"", &["reference.omega", "kHz", "rad/s, rpm, Hz"]),
        ("", "[plant]\nm = \"7,5 kg\"", &["m = \"7,5 kg\"", "expected a point instead of the decimal comma"]),
        ("", "[plant]\nY0 = \"thirty µm\"", &["Y0", "thirty is not a number"]),
        ("", "[plant]\nY0 = \"\"", &["Y0 = \"\"", "expected a number in m"]),
        // Types.
        ("", "[plant]\nm = true", &["m = true", "a number in kg"]),
        ("", "[plant]\nm = [1.0]", &["m = [1.0]", "a number in kg"]),
        ("", "[plant]\nsensor.seed = 1.5", &["sensor.seed = 1.5", "a whole number"]),
        ("", "[plant]\nsensor.seed = 4000000000", &["sensor.seed = 4000000000", "32 bits"]),
        ("", "[estimator]\nenable = 1", &["enable = 1", "true or false"]),
        ("", "[estimator]\nmethod = 3", &["method = 3", "the name of one of", "predictionError (3)"]),
        ("", "[estimator]\nmethod = \"best\"", &["method = \"best\"", "paperLiteral (1)", "predictionError (3)"]),
        ("", "[controller]\nupdate.mode = \"Never\"", &["update.mode", "never (1), atTime (2), whenValid (3)"]),
        // Lists.
        ("", "[plant]\nlambda = [1e-6, 2e-6]", &["lambda = [0.000001, 0.000002]", "a list of 3"]),
        ("", "[plant]\nlambda = 2e-6", &["lambda = ", "a list of 3"]),
        ("", "[plant]\nlambda = [1e-6, \"two\", 2e-6]", &["lambda[2]", "two is not a number"]),
        ("", "[plant]\nlambda = [1e-6, 2e-6, 3e-6]\n'lambda[1]' = 2e-6", &["[plant] lambda[1] is given twice"]),
        // The bench.
        ("", "[columns]\nbar = \"x\"", &["[columns] bar: there is no signal of this name; known are Ym, Zm, im[1]"]),
        ("", "[columns]\nYm = {nam = \"x\"}", &["[columns] Ym.nam: there is no signal of this name"]),
        // Variables that cannot be set.
        ("", "[plant]\ni = [1.0, 1.0, 1.0]", &["i[1] = 1.0", "connected to controller.i[1]"]),
        ("", "[controller]\nYm = 0.0", &["Ym = 0.0", "connected to plant.Ym"]),
        ("", "[estimator]\nomega = 300.0", &["omega = 300.0", "connected to plant.omegam"]),
        ("", "[plant]\nY = 1e-5", &["Y = ", "it is computed"]),
        ("", "[estimator]\nlambdaHat = [1e-6, 1e-6, 1e-6]", &["lambdaHat[1]", "it is computed"]),
        // Times.
        ("duration = nan", "", &["duration = nan", "above 0"]),
        ("duration = inf", "", &["duration = inf", "above 0"]),
        ("duration = \"1 hour\"", "", &["duration = \"1 hour\"", "s, ms, µs"]),
        ("duration = true", "", &["duration = true", "a number in s"]),
        ("step = 0.0", "", &["step = 0.0", "above 0"]),
        ("step = -1e-4", "", &["step = ", "above 0"]),
        ("step = nan", "", &["step = nan", "above 0"]),
        ("duration = 1e-3\nstep = 2e-3", "", &["step = 0.002", "at most the duration"]),
        // Machines, and names that they lack.
        ("machine = \"pump\"", "", &["machine = \"pump\"", "planar, spindle, planar4, spindle4, axial"]),
        ("machine = \"planer4\"", "", &["did you mean planar4?"]),
        ("machine = \"planar4\"", "[estimator]\nmethod = 0.1", &["method", "there is no variable of this name"]),
        ("contour = \"nowhere.csv\"", "", &["nowhere.csv"]),
        // Correction masses.
        ("balance = \"99 s\"", "", &["balance = \"99 s\"", "before the end, 0.01 s"]),
        ("machine = \"axial\"\nbalance = 1e-3", "", &["balance = 0.001", "the machine axial has no unbalance"]),
        // Comparisons.
        ("compare = [\"best\"]", "", &["compare = \"best\"", "one of paperLiteral (1)"]),
        ("compare = [\"paper\", \"paper\"]", "", &["compare = \"paper\"", "twice"]),
        // Values that a model refuses; `fmu::instances` has more.
        ("", "[plant]\nm = nan", &["[plant]", "m = NaN kg", "a finite number"]),
        ("", "[estimator]\nmethod = \"paper\"\nTf = \"0.7 ms\"", &["[estimator]", "Tf = ", "8"]),
        ("", "[estimator]\nmethod = \"paper\"\nTf = 0.02005", &["[estimator]", "Tf = 0.02005 s", "whole number of Ts"]),
        ("", "[all]\nalpha = [0.0, 0.0, 1.0]", &["[plant, controller] alpha", "[estimator] alpha"]),
        ("", "[estimator]\ntolerance.alpha = \"-1 deg\"", &["tolerance.alpha = -0.017", "at least 0 rad"]),
        ("", OF_PAPER_TOLERANCE, &["[estimator]", "tolerance.s = 0.000001 m", "method = predictionError"]),
        ("machine = \"planar4\"", NONE_OPPOSITE, &["allocation = biasCurrent is refused", "face each other"]),
        ("machine = \"axial\"", ONE_OF_TWO, &["allocation = biasCurrent is refused"]),
        ("machine = \"planar4\"", "[all]\nalpha = [0.0, 0.5, 1.0, 1.5]", &["alpha[", "all round the rotor"]),
        ("machine = \"axial\"", "[controller]\nreference.rX = 6e-4", &["reference.rX", "does not touch magnet 1"]),
        ("machine = \"axial\"", "[controller]\nbias.current = \"-1 A\"", &["bias.current = -1 A is refused"]),
    ];
    const OF_PAPER_TOLERANCE: &str = "[estimator]\nmethod = \"paper\"\ntolerance.s = \"1 µm\"";
    const NONE_OPPOSITE: &str =
        "[controller]\nallocation = \"biasCurrent\"\n[all]\nalpha = [0.8054, 2.35619449, 3.92699082, 5.49778714]";
    const ONE_OF_TWO: &str = "[controller]\nallocation = \"biasCurrent\"\n[all]\nmagnets.used = \"first\"";
    for (head, tables, words) in CASES {
        assert_contains(&refusal(head, tables), words);
    }
}

#[test]
fn errors_of_a_profile_are_refused_by_name() {
    // Variables, instants, values, and words in the refusal.
    for (of, time, value, words) in [
        ("'plant.omgea'", "0", "1", &["[plant] omgea: there is no variable of this name; did you mean omega?"][..]),
        ("'plant.u[1]'", "0", "1", &["connected to controller.u[1]"]),
        ("'plant.m'", "0", "1", &["fixed"]),
        ("'plant.omega'", "0, 0", "1, 2", &["increasing"]),
        ("'plant.omega'", "0, 1", "1", &["as many values as times"]),
        ("'plant.omega'", "0", "'1 kg'", &["unit kg"]),
        ("'plant.omega'", "0", "inf", &["inf is refused: expected a finite number"]),
        ("'plant.lambda[1]'", "0, 1", "1e-6, -1e-6", &["number 1: lambda[1] = -0.000001 N.m2/A2", "a value above 0"]),
        ("1", "0", "1", &["[[profile]] number 1: expected of = [names]", "expected a string"]),
        ("'plant.omega', 'plant.omega'", "0", "1", &["plant.omega follows a profile already"]),
        (
            "'plant.omega', 'plant.pY'",
            "0",
            "'3000 rpm'",
            &["3000 rpm", "not the same for plant.pY as for plant.omega", "of its own"],
        ),
    ] {
        let profile = format!("[[profile]]\nof = [{of}]\ntime = [{time}]\nvalue = [{value}]");
        assert_contains(&refusal("", &profile), words);
    }
}

#[test]
fn all_findings_are_reported_at_once() {
    let message = refusal(
        "duration = 0\nstep = -1\ncompare = [\"best\"]",
        "[all]\nmass = 1\nalpha = 3\n[plant]\nm = true\nlamda = 1\ni = [1.0, 1.0, 1.0]\n[controller]\nupdate.mode = \"now\"\n\
         [estimator]\nTf = \"2 m\"\n",
    );
    let words =
        ["duration", "step", "best", "mass", "alpha", "m = true", "lamda", "i[1]", "i[2]", "i[3]", "update.mode", "Tf"];
    assert_contains(&message, &words);
    assert_eq!(message.lines().count(), 1 + words.len(), "one line for the file, one for each finding: {message}");

    // An unknown top-level key, or one of the wrong type, hides no other finding.
    let message =
        refusal("durration = 1\nduration = 0\ncompare = 3\nprofile = 1", "[plant]\nlamda = 1\n[plan]\nm = 1\n");
    assert_contains(&message, &["durration", "did you mean duration?", "duration = 0", "compare is refused"]);
    assert_contains(&message, &["profile is", "lamda", "plan in line"]);
    assert_eq!(message.lines().count(), 7, "one line for the file, one for each finding: {message}");

    let of_models =
        "[plant]\nm = 0\ns = 0\n[controller]\nTs = 0.0\nF0 = nan\n[estimator]\nmethod = \"paper\"\nTf = 1e-4\n";
    let message = refusal("", of_models);
    assert_contains(&message, &["[plant] m", "[plant] s", "[controller] Ts", "[controller] F0", "[estimator] Tf"]);
}

#[test]
fn syntax_errors_name_the_line_and_missing_keys_are_named() {
    for (text, words) in [
        ("title = \"A test\"\nduration = 0.1\nstep = \n", "line 3"),
        ("title = \"A test\"\n[plant\nm = 1\n", "line 2"),
        ("title = \"A test\"\nduration = 0.1\nstep = 1e-4\n[plant]\nm = 1\nm = 2\n", "line 6"),
        ("title = \"A test\"\ntitle = \"Another\"\n", "line 2"),
        ("", "title"),
        ("title = \"A test\"\nstep = 1e-4\n", "duration"),
    ] {
        let error = Scenario::parse("broken.toml", text).err().unwrap_or_else(|| panic!("accepted: {text}"));
        assert_contains(&error.to_string(), &["broken.toml", words]);
    }
}
