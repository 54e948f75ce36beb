//! Derivatives through the C interface: directional, of inputs over a step, and of outputs in time.

use crate::prelude::*;
use std::f64::consts::PI;

use crate::support::ffi3::Fmu3;

const RUNNING: [(&str, f64); 8] = [
    ("i[1]", 1.5),
    ("i[2]", 1.4),
    ("i[3]", 1.3),
    ("u[1]", 3.0),
    ("u[2]", 2.0),
    ("u[3]", 4.0),
    ("unbalance.magnitude", 1e-4),
    ("perturbation.amplitudeY", 2.0),
];
/// Current and voltage.
const DRIVES: [f64; 2] = [1.0, 2.0];
const SPINDLE: &str = "MagneticSpindle";
const SPINDLE_RUNNING: [(&str, f64); 14] = [
    ("A.i[1]", 1.5),
    ("A.i[2]", 1.4),
    ("A.i[3]", 1.3),
    ("B.i[1]", 1.2),
    ("B.i[3]", 1.1),
    ("X.i[1]", 1.0),
    ("X.i[2]", 1.1),
    ("A.u[1]", 3.0),
    ("B.u[2]", 2.0),
    ("X.u[1]", 4.0),
    ("unbalance[1].magnitude", 8e-5),
    ("unbalance[2].magnitude", 5e-5),
    ("unbalance[2].phase", -1.9),
    ("beta0", 1e-4),
];
const UNKNOWNS: &str = "F[1] F[2] F[3] FY FZ gap[1] gap[2] gap[3] perturbation.Y perturbation.Z aY aZ Y rotor.omega \
                        coil.uInduced[1] coil.uInduced[3]";
const SPINDLE_UNKNOWNS: &str = "A.F[2] A.FY B.FZ X.FX B.gap[1] A.Y B.Z B.Ym Xm betaAcceleration aZ perturbation.MZ";

/// The names of a list separated by spaces.
fn words(names: &'static str) -> Vec<&'static str> {
    names.split_whitespace().collect()
}

fn references(fmu: &Fmu, names: &[&str]) -> Vec<fmi2ValueReference> {
    names.iter().map(|name| fmu.reference(name)).collect()
}

/// The derivative of unknowns with respect to one known.
fn column(fmu: &Fmu, unknowns: &[&str], known: &str) -> Vec<f64> {
    let found = fmu.directional_derivative(&references(fmu, unknowns), &[fmu.reference(known)], &[1.0]);
    found.unwrap_or_else(|_| panic!("{known}: {:?}", fmu.take_messages()))
}

/// Compares derivatives with `(f(x + h) − f(x − h)) / 2h`, obtained by setting the knowns; the tolerance allows for h² and rounding.
#[track_caller]
fn agree(fmu: &Fmu, unknowns: &[&str], knowns: &[&str], h: impl Fn(f64) -> f64) {
    for known in knowns {
        let exact = column(fmu, unknowns, known);
        let value = fmu.get(known);
        let h = h(value);
        let [low, high] = [value - h, value + h].map(|value| {
            fmu.set(known, value).ok(fmu);
            unknowns.iter().map(|name| fmu.get(name)).collect::<Vec<_>>()
        });
        fmu.set(known, value).ok(fmu);
        for (at, name) in unknowns.iter().enumerate() {
            let quotient = (high[at] - low[at]) / (2.0 * h);
            let scale = (low[at].abs().max(high[at].abs()) / h * 1e-9).max(1e-4 * quotient.abs()).max(1e-9);
            assert!((exact[at] - quotient).abs() <= scale, "d {name}/d {known}: {:e} against {quotient:e}", exact[at]);
        }
    }
}

/// In initialization all Real parameters are knowns; first samples and bearing forces of a spindle depend on them too. In a run inputs are.
/// Fails if `Y0` does not move the position on which the forces depend, if the displacement at a bearing does not follow the tilt, or if the
/// reference of an input is off by one.
#[test]
fn derivatives_agree_with_difference_quotients() {
    const PLANAR_INPUTS: &str = "i[1] i[2] i[3] u[1] u[3] pY pZ omega";
    const SPINDLE_INPUTS: &str = "A.i[2] B.i[1] X.i[2] A.u[1] B.u[2] X.u[1] pX MY MZ omega";
    const PLANAR_KNOWNS: &str = "m s Y0 Z0 theta0 coil.R alpha[2] lambda[3] unbalance.phase gravity.Z";
    const SPINDLE_KNOWNS: &str = "Y0 beta0 gamma0 vX0 betaRate0 gammaRate0 X0 theta0 Jt Jp A.position B.position \
        B.sensorPosition B.sensor.offsetY B.sensor.gainErrorY sensor.positionNoise unbalance[2].position A.alpha[2] \
        A.lambda[2] X.s A.i[2] B.u[2] MY pZ omega";
    for drive in DRIVES {
        for (model, settings, more, unknowns, [knowns, inputs]) in [
            (PLANT, &RUNNING[..], ("coil.fluxSaturation", 0.01), UNKNOWNS, [PLANAR_KNOWNS, PLANAR_INPUTS]),
            (
                SPINDLE,
                &SPINDLE_RUNNING,
                ("sensor.positionNoise", 1e-7),
                SPINDLE_UNKNOWNS,
                [SPINDLE_KNOWNS, SPINDLE_INPUTS],
            ),
        ] {
            let fmu = Fmu::new(model);
            for (name, value) in settings.iter().chain(&[("drive", drive), more]) {
                fmu.set(name, *value).ok(&fmu);
            }
            fmu.enter_initialization().ok(&fmu);
            let h = |value: f64| 1e-5 * if value == 0.0 { 1e-4 } else { value.abs() };
            agree(&fmu, &words(unknowns), &words(knowns), h);
            fmu.exit_initialization().ok(&fmu);
            for step in 0..20 {
                fmu.step(f64::from(step) * 1e-4, 1e-4).ok(&fmu);
            }
            agree(&fmu, &words(unknowns), &words(inputs), |value| 1e-4 * value.abs().max(1.0));
        }
    }
}

/// Without a declared dependency the derivative must be 0. Fails if `F[1]` is declared to depend on nothing.
#[test]
fn declared_dependencies_agree_with_the_derivatives() {
    let (planar, spindle) = (("touchdown.friction", 0.2), ("A.touchdown.friction", 0.2));
    let models = [(PLANT, &RUNNING[..], planar), (SPINDLE, &SPINDLE_RUNNING, spindle)];
    for ((model, settings, friction), drive) in models.into_iter().flat_map(|model| DRIVES.map(|drive| (model, drive)))
    {
        let more = [friction, ("drive", drive), ("coil.Lleak", 1e-3)];
        let fmu = Fmu::started(model, &[settings, &more].concat());
        for step in 0..10 {
            fmu.step(f64::from(step) * 1e-4, 1e-4).ok(&fmu);
        }
        let rows = (0_u32..).zip(fmu.variables());
        let reals = rows.filter(|(_, variable)| matches!(variable.data_type, Type::Real { .. }));
        for (known_at, known) in reals.clone().filter(|(_, known)| known.causality == Causality::Input || known.state) {
            for (unknown_at, unknown) in reals.clone() {
                if unknown.causality != Causality::Output && unknown.derivative_of.is_none() {
                    continue;
                }
                let found = fmu.directional_derivative(&[unknown_at], &[known_at], &[1.0]);
                let derivative = found.expect("a derivative")[0];
                let declared = unknown.depends_on.iter().flatten().any(|(name, _)| *name == known.name);
                assert!(declared || derivative == 0.0, "{} follows {}: {derivative}", unknown.name, known.name);
            }
        }
    }
}

/// Fails if a repeated known counts once, or if every variable is accepted as a known.
#[test]
fn directional_derivatives_are_linear_and_refuse_invalid_knowns() {
    let fmu = Fmu::started(PLANT, &RUNNING);
    let knowns = references(&fmu, &["i[1]", "Y", "omega"]);
    let names = words(UNKNOWNS);
    let unknowns = references(&fmu, &names);
    let all = fmu.directional_derivative(&unknowns, &knowns, &[0.5, 1e-5, -2.0]).expect("a derivative");
    let single = ["i[1]", "Y", "omega"].map(|known| column(&fmu, &names, known));
    for at in 0..all.len() {
        let sum = 0.5 * single[0][at] + 1e-5 * single[1][at] - 2.0 * single[2][at];
        assert!((all[at] - sum).abs() <= 1e-12 * sum.abs().max(1e-9), "{}", names[at]);
    }
    let twice = references(&fmu, &["i[1]", "i[1]"]);
    let halves = fmu.directional_derivative(&unknowns, &twice, &[0.25, 0.75]).expect("a derivative");
    assert_eq!(halves, single[0], "a known that is given twice counts twice");
    assert_eq!(fmu.directional_derivative(&[], &[], &[]), Ok(Vec::new()));

    let refused = |unknown: &str, known: &str| {
        let found = fmu.directional_derivative(&[fmu.reference(unknown)], &[fmu.reference(known)], &[1.0]);
        found.expect_err("an error").error(&fmu)
    };
    assert!(refused("F[1]", "m").contains("a state or an input"));
    assert!(refused("F[1]", "drive").contains("a state or an input"));
    assert!(refused("m", "i[1]").contains("an output or the derivative"));
    assert!(refused("touchdown.contact", "i[1]").contains("of type Real"));
    let found = fmu.directional_derivative(&[fmu.reference("F[1]")], &[fmu.reference("i[1]")], &[f64::NAN]);
    assert!(found.expect_err("an error").error(&fmu).contains("NaN is refused"));
    // Sampled outputs are constant.
    assert_eq!(fmu.directional_derivative(&references(&fmu, &["Ym", "im[1]"]), &knowns, &[1.0; 3]), Ok(vec![0.0; 2]));
    for model in ["FlatnessController", "AlgebraicEstimator"] {
        let fmu = Fmu::started(model, &[]);
        let found = fmu.directional_derivative(&[], &[], &[]);
        assert!(found.expect_err("an error").error(&fmu).contains("not offered"), "{model}");
    }
}

/// One step with the derivatives of a polynomial against many small steps with its values.
/// Fails if the Runge–Kutta stages use the input at the start of the step.
#[test]
fn the_plant_follows_polynomials_within_a_step() {
    for drive in DRIVES {
        let polynomial = |t: f64| 1.3 + 40.0 * t - 0.5 * 3e4 * t * t + 2e6 / 6.0 * t * t * t;
        let speed = |t: f64| 100.0 * PI + 2000.0 * t;
        let driven = if drive == 1.0 { "i[2]" } else { "u[2]" };
        let mut settings = RUNNING.to_vec();
        // Without friction and contact only the method differs.
        settings.extend([("drive", drive), ("solver.maxStep", 1e-6), ("sensor.Ts", 1e-3)]);
        let whole = Fmu::started(PLANT, &settings);
        let pieces = Fmu::started(PLANT, &settings);
        let inputs = references(&whole, &[driven, driven, driven, "omega"]);
        let length = 2e-3;
        whole.set(driven, polynomial(0.0)).ok(&whole);
        whole.set_input_derivatives(&inputs, &[1, 2, 3, 1], &[40.0, -3e4, 2e6, 2000.0]).ok(&whole);
        whole.step(0.0, length).ok(&whole);
        let n = 20_000;
        for piece in 0..n {
            let t = length * f64::from(piece) / f64::from(n);
            let middle = t + 0.5 * length / f64::from(n);
            pieces.set(driven, polynomial(middle)).ok(&pieces);
            pieces.set("omega", speed(middle)).ok(&pieces);
            pieces.step(t, length / f64::from(n)).ok(&pieces);
        }
        for (name, tolerance) in [("Y", 1e-12), ("Z", 1e-12), ("vZ", 1e-8), ("rotor.theta", 1e-9)] {
            let (got, wanted) = (whole.get(name), pieces.get(name));
            assert!((got - wanted).abs() <= tolerance, "{name}: {got:e} against {wanted:e}");
        }
        // The input has the final value of the polynomial, and so has the current sample at that instant.
        assert!((whole.get(driven) - polynomial(length)).abs() <= 1e-12);
        assert!((whole.get("omega") - speed(length)).abs() <= 1e-9);
        if drive == 1.0 {
            assert!((whole.get("im[2]") - polynomial(length)).abs() <= 1e-12);
        }
        // The derivatives were valid for that step only.
        whole.step(length, 1e-4).ok(&whole);
        assert!((whole.get(driven) - polynomial(length)).abs() <= 1e-12);
    }
}

/// Fails if a derivative of 0 changes the arithmetic.
#[test]
fn derivatives_of_zero_change_no_bit() {
    for model in MODELS {
        let settings = match model {
            PLANT => &RUNNING[..],
            SPINDLE => &SPINDLE_RUNNING[..],
            _ => &[],
        };
        let [plain, sloped] = [0, 1].map(|_| Fmu::started(model, settings));
        let inputs = inputs(&plain);
        for step in 0..30 {
            let zeros = vec![0.0; inputs.len()];
            sloped.set_input_derivatives(&inputs, &vec![1; inputs.len()], &zeros).ok(&sloped);
            for fmu in [&plain, &sloped] {
                fmu.step(f64::from(step) * 7e-5, 7e-5).ok(fmu);
            }
            assert_eq!(plain.all_bits(), sloped.all_bits(), "{model}, step {step}");
        }
    }
}

/// A sample within a step sees the input extrapolated to its instant: a controller stepped at 2.5 times its
/// sample time with derivatives returns the same as when stepped from sample to sample with values.
/// Fails if sampled models use the value at the start of the step.
#[test]
fn samples_within_a_step_see_the_extrapolated_input() {
    let model = "FlatnessController";
    let position = |t: f64| 3e-5 - 1e-2 * t;
    let [coarse, fine] = [0, 1].map(|_| Fmu::started(model, &[]));
    for step in 0..8 {
        let t = f64::from(step) * 2.5e-4;
        coarse.set("Ym", position(t)).ok(&coarse);
        coarse.set_input_derivatives(&[coarse.reference("Ym")], &[1], &[-1e-2]).ok(&coarse);
        coarse.step(t, 2.5e-4).ok(&coarse);
    }
    for sample in 0..20 {
        let t = f64::from(sample) * 1e-4;
        fine.set("Ym", position(t)).ok(&fine);
        fine.step(t, 1e-4).ok(&fine);
    }
    for name in ["i[1]", "i[2]", "i[3]", "pYHat"] {
        let (got, wanted) = (coarse.get(name), fine.get(name));
        assert!((got - wanted).abs() <= 1e-6 * wanted.abs().max(1e-3), "{name}: {got} against {wanted}");
    }
    assert!((coarse.get("Ym") - position(2e-3)).abs() < 1e-15);
}

/// Fails if derivatives before the refused one are accepted.
#[test]
fn derivatives_of_inputs_are_accepted_together_or_not_at_all() {
    let fmu = Fmu::started(PLANT, &RUNNING);
    let two = references(&fmu, &["i[1]", "m"]);
    let text = fmu.set_input_derivatives(&two, &[1, 1], &[10.0, 0.0]).error(&fmu);
    assert!(text.contains("m: expected a continuous input"), "{text}");
    for order in [0, -1, 5, i32::MAX] {
        let text = fmu.set_input_derivatives(&two[..1], &[order], &[1.0]).error(&fmu);
        assert!(text.contains("an order from 1 to 4"), "{text}");
    }
    let text = fmu.set_input_derivatives(&two[..1], &[1], &[f64::INFINITY]).error(&fmu);
    assert!(text.contains("inf is refused"), "{text}");
    fmu.step(0.0, 1e-4).ok(&fmu);
    assert_eq!(fmu.get("i[1]"), 1.5, "nothing of what was refused has an effect");
}

/// Time derivatives of outputs against difference quotients of the motion.
/// Fails if the velocity is missing in the rate of a force.
#[test]
fn output_derivatives_are_those_of_the_motion() {
    let names = ["Y", "Z", "F[1]", "F[2]", "F[3]", "FY", "FZ", "gap[1]", "gap[2]", "perturbation.Y", "perturbation.Z"];
    for drive in DRIVES {
        let settings = [&RUNNING[..], &[("drive", drive)]].concat();
        let fmu = Fmu::started(PLANT, &settings);
        let outputs = references(&fmu, &names);
        let driven = references(&fmu, &["i[1]", "u[1]", "i[1]", "u[1]"]);
        let slopes = |fmu: &Fmu| fmu.set_input_derivatives(&driven, &[1, 1, 2, 2], &[200.0, 200.0, 1e4, 1e4]).ok(fmu);
        slopes(&fmu);
        fmu.step(0.0, 1e-3).ok(&fmu);
        let [first, second] =
            [1, 2].map(|order| fmu.output_derivatives(&outputs, &vec![order; outputs.len()]).expect("derivatives"));
        // The same motion before and after the instant, along the same polynomial.
        let at = |t: f64| {
            let other = Fmu::started(PLANT, &settings);
            slopes(&other);
            other.step(0.0, t).ok(&other);
            other.get_reals(&outputs).expect("outputs")
        };
        let h = 2e-5;
        let [a, b, c, d, e] = [-2.0, -1.0, 0.0, 1.0, 2.0].map(|side| at(1e-3 + side * h));
        for (k, name) in names.iter().enumerate() {
            let slope = (a[k] - 8.0 * b[k] + 8.0 * d[k] - e[k]) / (12.0 * h);
            let bend = (-a[k] + 16.0 * b[k] - 30.0 * c[k] + 16.0 * d[k] - e[k]) / (12.0 * h * h);
            let scale = c[k].abs().max(1e-6);
            assert!((first[k] - slope).abs() <= 1e-4 * slope.abs() + 1e-4 * scale, "{name}: {:e} {slope:e}", first[k]);
            assert!((second[k] - bend).abs() <= 1e-3 * bend.abs() + 1.0 * scale, "{name}: {:e} {bend:e}", second[k]);
        }
        assert_eq!(first[0], fmu.get("vY"));
        assert!((second[1] - fmu.get("aZ")).abs() <= 1e-12, "{} {}", second[1], fmu.get("aZ"));
        // From then on the inputs are held.
        fmu.set("i[1]", 1.5).ok(&fmu);
        fmu.set("u[1]", 3.0).ok(&fmu);
        if drive == 1.0 {
            let force = fmu.output_derivatives(&[fmu.reference("F[1]")], &[1]).expect("a derivative")[0];
            let (i, gap) = (1.5, fmu.get("gap[1]"));
            let rate = fmu.output_derivatives(&[fmu.reference("gap[1]")], &[1]).expect("a derivative")[0];
            let wanted = -2.0 * 1.8e-6 * i * i / (gap * gap * gap) * rate;
            assert!((force - wanted).abs() <= 1e-9 * wanted.abs(), "{force} {wanted}");
        }
        assert_eq!(fmu.output_derivatives(&references(&fmu, &["Ym", "theta"]), &[1, 2]), Ok(vec![0.0; 2]));
        let text = fmu.output_derivatives(&outputs[..1], &[3]).expect_err("an error").error(&fmu);
        assert!(text.contains("Y: a derivative of order 3 is refused: expected an order from 1 to 2"), "{text}");
    }
}

/// Fails if a derivative is that of another variable.
#[test]
fn derivatives_are_those_of_fmi_3_bit_for_bit() {
    for name in MODELS.into_iter().filter(|name| is_plant(name)) {
        let (old, new) = (Fmu::started(name, &[]), Fmu3::started(name, &[]));
        let knowns = inputs(&old);
        // Without currents there are no forces.
        for known in &knowns {
            let value = old.get(&old.variables()[*known as usize].name) + 1.0 + 1e-3 * f64::from(*known);
            old.set_reals(&[*known], &[value]).ok(&old);
            new.ok(new.set_floats(&[*known], &[value]));
        }
        for step in 0..10 {
            old.step(f64::from(step) * 1e-4, 1e-4).ok(&old);
            new.ok(new.step(f64::from(step) * 1e-4, 1e-4));
        }
        let outputs = (0_u32..).zip(old.variables());
        let outputs = outputs.filter(|(_, of)| of.causality == Causality::Output && of.is_continuous());
        let unknowns: Vec<_> = outputs.map(|(reference, _)| reference).collect();
        let seed: Vec<_> = (1..=knowns.len()).map(|k| 0.1 * k as f64).collect();
        let wanted = old.directional_derivative(&unknowns, &knowns, &seed).expect("derivatives");
        assert!(wanted.iter().any(|value| *value != 0.0));
        assert_eq!(new.directional_derivative(&unknowns, &knowns, &seed, unknowns.len()), Ok(wanted), "{name}");
        for order in [1, 2] {
            let orders = vec![order; unknowns.len()];
            let wanted = old.output_derivatives(&unknowns, &orders).expect("derivatives");
            assert!(wanted.iter().any(|value| *value != 0.0));
            assert_eq!(new.output_derivatives(&unknowns, &orders, unknowns.len()), Ok(wanted), "{name}");
        }
    }
}
