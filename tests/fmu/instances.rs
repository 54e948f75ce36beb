//! Instances and their tables: access, variability, outputs, and refused values.

use crate::prelude::*;
use magnetic_bearing::fmu::catalogue;

/// Sets random inputs, weak enough for the rotor to stay in the gap for a while.
fn excite(instance: &mut Named, random: &mut Random) {
    for index in 0..instance.variables.len() {
        let variable = instance.variables[index];
        let value = match variable.data_type {
            Type::Real { start, nominal, .. } => Value::Real(start + 1e-3 * nominal * random.between(-1.0, 1.0)),
            _ => Value::Boolean(variable.name != "reset"),
        };
        if variable.causality == Causality::Input {
            instance.instance.set(index, value).unwrap_or_else(|error| panic!("{}: {error}", variable.name));
        }
    }
}

#[test]
fn every_row_has_its_start_value_and_its_own_storage() {
    for model in MODELS {
        let mut instance = Named::new(model);
        let rows = instance.variables.clone().into_iter().enumerate();
        let settable: Vec<_> = rows.filter(|(_, variable)| variable.is_settable()).collect();
        // A different value for every row reveals rows that share storage.
        let given = |index: usize, data_type: &Type| match data_type {
            Type::Real { .. } => Value::Real(1e-7 * (index + 1) as f64),
            Type::Integer { .. } => Value::Integer(index as i32 + 1000),
            Type::Enumeration { items, .. } => Value::Integer((index % items.items.len()) as i32 + 1),
            Type::Boolean { start } => Value::Boolean(!start),
            _ => unreachable!("no model of this project has a text"),
        };
        for (index, variable) in &settable {
            assert_eq!(instance.instance.get(*index), Ok(variable.start()), "{model}.{}", variable.name);
            let value = given(*index, &variable.data_type);
            instance.instance.set(*index, value).expect("before the run parameters and inputs can be set");
        }
        // Outputs are computed from a trial start, which must not change the values that were set.
        let _ = instance.bits();
        for (index, variable) in &settable {
            let value = given(*index, &variable.data_type);
            assert_eq!(instance.instance.get(*index), Ok(value), "{model}.{}", variable.name);
        }
    }
}

#[test]
fn computed_variables_cannot_be_set_nor_fixed_parameters_during_a_run() {
    for (model, running) in MODELS.into_iter().flat_map(|model| [(model, false), (model, true)]) {
        let mut instance = if running { Named::started(model, &[]) } else { Named::new(model) };
        for index in 0..instance.variables.len() {
            let variable = instance.variables[index];
            let may = match variable.causality {
                Causality::Input => true,
                Causality::Parameter => !running || variable.variability == Variability::Tunable,
                _ => false,
            };
            let before = instance.instance.get(index).expect("an index");
            match instance.instance.set(index, before) {
                Ok(()) => assert!(may, "{model}.{} was set", variable.name),
                Err(error) => {
                    assert!(!may, "{model}.{}: {error}", variable.name);
                    let reason =
                        if variable.is_settable() { "it is fixed once the run has begun" } else { "it is computed" };
                    assert_contains(&error.to_string(), &[variable.name.as_ref(), "cannot be set", reason]);
                }
            }
        }
    }
}

#[test]
fn a_refused_change_changes_nothing() {
    for (model, refusals) in [
        (
            "MagneticBearing",
            &[
                ("m", 1.0, "fixed"),
                ("Y", 1.0, "computed"),
                ("lambda[2]", -1e-6, "-0.000001 N.m2/A2 is refused: expected a value above 0 N.m2/A2"),
                ("unbalance.magnitude", f64::NAN, "is refused"),
                ("unbalance.phase", f64::INFINITY, "is refused"),
            ][..],
        ),
        (
            "FlatnessController",
            &[
                ("F0.modulation", -0.1, "is refused"),
                ("F0.modulation", 1.1, "is refused"),
                ("F0.modulation", f64::NAN, "is refused"),
                ("F0.modulationFrequency", -110.0, "is refused"),
                ("F0.modulationFrequency", 5001.0, "is refused"),
                ("F0.modulationFrequency", f64::INFINITY, "is refused"),
            ],
        ),
    ] {
        let [mut changed, mut beside] = [(); 2].map(|()| Named::started(model, &[]));
        for instance in [&mut changed, &mut beside] {
            excite(instance, &mut Random::new(2));
            instance.step(0.0, TS);
        }
        for (name, value, reason) in refusals {
            let error = changed.try_set(name, *value).expect_err(name).to_string();
            assert_contains(&error, &[name, reason]);
            assert_eq!(changed.bits(), beside.bits(), "{model}.{name} = {value}");
        }
        changed.step(TS, TS);
        beside.step(TS, TS);
        assert_eq!(changed.bits(), beside.bits(), "{model}: what was refused has no effect");
    }
}

#[test]
fn tunable_parameters_act() {
    let mut bearing = Named::started("MagneticBearing", &[("i[1]", 1.5), ("i[2]", 1.5), ("i[3]", 1.5)]);
    bearing.step(0.0, TS);
    let [before, ..] = bearing.three("F");
    bearing.set("lambda[1]", 3.6e-6);
    assert_eq!(bearing.three("F")[0], 2.0 * before, "twice λ is twice the force, at once");

    let omega = bearing.get("omega");
    bearing.set("unbalance.magnitude", 1e-4);
    bearing.set("unbalance.phase", 0.3);
    let force = 1e-4 * omega * omega;
    // Tuned parameters act on the motion too.
    let velocity = bearing.get("vY");
    bearing.step(TS, TS);
    let acceleration = (bearing.get("vY") - velocity) / TS;
    assert!((acceleration - force / 6.7).abs() < 0.5 * force / 6.7, "{acceleration} m/s2");

    let mut slow = Named::started("FlatnessController", &[]);
    let mut fast = Named::started("FlatnessController", &[]);
    fast.set("reference.omega", 400.0);
    slow.step(0.0, 10.0 * TS);
    fast.step(0.0, 10.0 * TS);
    assert!(fast.get("reference.Z") > 1.2 * slow.get("reference.Z"), "the reference goes faster");
}

#[test]
fn the_modulation_is_tuned_while_running() {
    let [mut with, mut without] = [(); 2].map(|()| Named::started("FlatnessController", &[]));
    with.step(0.0, TS);
    without.step(0.0, TS);
    let mut copy = Named { instance: with.instance.duplicate().expect("a copy"), ..Named::new("FlatnessController") };
    with.set("F0.modulation", 0.5);
    for instance in [&mut with, &mut without, &mut copy] {
        instance.step(TS, TS);
    }
    assert!(with.three("i") != without.three("i"), "tuned, it acts");
    assert_eq!(copy.three("i"), without.three("i"), "a copy keeps what it had");
}

#[test]
fn before_the_run_outputs_follow_the_parameters() {
    let mut bearing = Named::new("MagneticBearing");
    assert_eq!(bearing.get("Y"), 30e-6);
    bearing.set("Y0", -1e-5);
    bearing.set("Z0", 2e-5);
    bearing.set("vZ0", 0.5);
    bearing.set("theta0", 1.25);
    bearing.set("omega", 100.0);
    bearing.set("i[1]", 2.0);
    for (name, wanted) in
        [("Y", -1e-5), ("Z", 2e-5), ("Ym", -1e-5), ("Zm", 2e-5), ("vZ", 0.5), ("theta", 1.25), ("omegam", 100.0)]
    {
        assert_eq!(bearing.get(name), wanted, "{name}");
    }
    // Magnet 1 pulls towards −z (α = π): its gap is s + Z, and F = λ i²/gap².
    /// Relative: sin π and cos π are rounded.
    const ROUNDING: f64 = 1e-14;
    let gap = 5e-4 + 2e-5;
    below("gap[1]", (bearing.get("gap[1]") / gap - 1.0).abs(), ROUNDING);
    below("F[1]", (bearing.get("F[1]") / (1.8e-6 * 4.0 / (gap * gap)) - 1.0).abs(), ROUNDING);
    // No current flows before the start, so the sensor reads 0, whatever the input.
    assert_eq!(bearing.get("im[1]"), 0.0);
    // An invalid parameter is reported at the start; until then the last valid outputs remain.
    bearing.set("m", 0.0);
    assert_eq!(bearing.get("Y"), -1e-5);
    assert!(bearing.start().is_err());
    bearing.set("m", 6.7);
    bearing.start().expect("now it is sound");

    let mut controller = Named::new("FlatnessController");
    controller.set("lambda0[2]", 5e-6);
    controller.set("reference.rY", 1e-5);
    assert_eq!(controller.three("lambdaUsed"), [4e-6, 5e-6, 4e-6]);
    assert_eq!(controller.get("reference.Y"), 1e-5);
    assert_eq!(controller.three("i"), [0.0; 3], "no sample was taken yet");

    let mut estimator = Named::new("AlgebraicEstimator");
    estimator.set("lambda0[3]", 5e-6);
    assert_eq!(estimator.three("lambdaHat"), [4e-6, 4e-6, 5e-6]);
    assert_eq!(estimator.get("valid"), 0.0);
}

#[test]
fn outputs_follow_an_input_at_once_only_where_declared() {
    for model in MODELS {
        let mut instance = Named::started(model, &[]);
        let mut random = Random::new(11);
        for step in 0..20 {
            excite(&mut instance, &mut random);
            instance.step(f64::from(step) * TS, TS);
        }
        let before = instance.bits();
        excite(&mut instance, &mut random);
        let after = instance.bits();
        for (index, variable) in instance.variables.iter().enumerate() {
            if variable.is_settable() || variable.causality == Causality::Local {
                continue;
            }
            let is_sample = !variable.is_continuous() && !variable.name.ends_with("contact");
            assert!(!is_sample || variable.depends_on == Some(Vec::new()), "{model}.{} is a sample", variable.name);
            let follows = before[index] != after[index];
            let input = |name: &str| {
                let found = instance.variables.iter().find(|candidate| candidate.name == name);
                found.is_some_and(|candidate| candidate.causality == Causality::Input)
            };
            let may = variable.depends_on.iter().flatten().any(|(name, _)| input(name));
            assert!(may || !follows, "{model}.{} follows an input", variable.name);
            let force = ["F", "perturbation.", "A.F", "B.F", "X.F"].iter().any(|head| variable.name.starts_with(head));
            assert!(follows || !(is_plant(model) && force), "{model}.{} stands still", variable.name);
        }
    }
}

#[test]
fn refused_parameters_are_all_named_at_once() {
    // Model, parameter, value, and words of the message. Another test covers the declared limits.
    const BAD: &[(&str, &str, f64, &[&str])] = &[
        ("MagneticBearing", "Y0", 6e-4, &["0.0006 m", "inside the gap"]),
        ("MagneticBearing", "Z0", -5e-4, &["-0.0005 m", "inside the gap"]),
        // A step would take seconds.
        ("MagneticBearing", "coil.fluxSaturation", 1e-9, &["0.000000001 Wb", "0, or at least"]),
        ("MagneticBearing", "solver.maxStep", 1e-300, &["time of at least"]),
        ("MagneticBearing", "sensor.delay", 1.7e-3, &["16 sample times"]),
        ("FlatnessController", "F0.modulation", 1.5, &["1.5", "from 0 to 1"]),
        ("FlatnessController", "F0.modulationFrequency", 6e3, &["6000 Hz", "half the sample rate (5000 Hz)"]),
        ("FlatnessController", "reference.rZ", 6e-4, &[]),
        ("SpindleController", "A.F0.modulationFrequency", 5000.1, &["at most half the sample rate"]),
        ("SpindleController", "X.F0.modulationFrequency", 6000.0, &["6000 Hz", "at most half the sample rate"]),
        ("SpindleController", "X.reference.frequency", 5000.1, &["at most half the sample rate"]),
        ("SpindleController", "A.reference.rZ", 6e-4, &["does not touch magnet 1"]),
        ("SpindleController", "B.reference.rZ", 6e-4, &["does not touch magnet 1"]),
        ("SpindleController", "X.reference.amplitude", 6e-4, &["the gap is 0.0006 m"]),
        ("SpindleController", "Jp", 0.4, &["0.4 kg.m2", "at most 2 Jt"]),
        ("SpindleController", "B.sensorPosition", -0.1, &["-0.1 m", "at least"]),
        ("MagneticSpindle", "shaft.end", -0.3, &["beyond shaft.begin"]),
        ("MagneticSpindle", "A.position", -0.3, &["on the shaft"]),
        ("MagneticSpindle", "B.position", -0.12, &["-0.12 m", "from A.position"]),
        ("MagneticSpindle", "A.sensorPosition", -0.25, &["-0.25 m", "on the shaft"]),
        ("MagneticSpindle", "B.sensorPosition", -0.10, &["from A.sensorPosition"]),
        ("MagneticSpindle", "Jp", 0.5, &["0.5 kg.m2", "at most 2 Jt = 0.32 kg.m2"]),
        ("MagneticSpindle", "A.alpha[1]", 0.0, &["0 rad", "all round"]),
        ("MagneticSpindle", "X0", 7e-4, &["0.0007 m", "X.gap[1]"]),
        ("MagneticSpindle", "beta0", 0.01, &["0.01 rad", "inside the gap"]),
        ("MagneticSpindle", "unbalance[2].position", 1.0, &["1 m", "on the shaft"]),
        ("SpindleEstimator", "unbalance[1].position", 3.0, &["3 m", "on the shaft"]),
        ("SpindleEstimator", "unbalance[2].position", -0.08, &["-0.08 m", "unbalance[1].position"]),
        ("FlatnessController", "update.mode", 4.0, &["4", "never (1), atTime (2), whenValid (3)"]),
        ("FlatnessController", "update.mode", i32::MIN as f64, &["never (1)"]),
        ("FlatnessController", "reference.shape", 0.0, &["0", "ellipse (1), lobes (2), external (3)"]),
        ("SpindleController", "update.mode", 4.0, &["never (1), atTime (2), whenValid (3)"]),
        ("AlgebraicEstimator", "method", 4.0, &["4", "paperLiteral (1)", "predictionError (3)"]),
        ("AlgebraicEstimator", "hold", 0.0, &["0", "heldBefore (1)"]),
    ];
    for (model, name, value, words) in BAD {
        let mut instance = Named::new(model);
        let is_choice = matches!(instance.variables[instance.index(name)].data_type, Type::Enumeration { .. });
        let message = if is_choice {
            // Items that do not exist are refused at once.
            instance.try_set(name, *value).expect_err(name).to_string()
        } else {
            instance.set(name, *value);
            let findings = instance.start().expect_err(name);
            assert!(findings.iter().all(|finding| finding.name == *name), "{model}.{name} = {value}: {findings:?}");
            findings[0].to_string()
        };
        assert_contains(&message, words);
        assert_contains(&message, &[name, "is refused", "expected"]);
    }
    // With three magnets: of more, two may be close together, and axial magnets have no angles.
    for model in &MODELS[..6] {
        let mut instance = Named::new(model);
        let angle = if model.contains("Spindle") { "B.alpha[2]" } else { "alpha[2]" };
        instance.set(angle, std::f64::consts::PI);
        let findings = instance.start().expect_err("two magnets with one angle");
        assert!(findings.iter().any(|finding| finding.name.contains("alpha")), "{model}: {findings:?}");
    }
}

#[test]
fn the_catalogue_is_complete() {
    let names: Vec<_> = catalogue().iter().map(|model| model.info.name).collect();
    assert_eq!(names, MODELS);
    for model in catalogue().iter() {
        let info = &model.info;
        assert!(info.stop_s > 0.0 && info.step_s > 0.0 && info.description.len() > 20, "{}", info.name);
    }
    assert!(magnetic_bearing::fmu::find("magneticbearing").is_none());
}
