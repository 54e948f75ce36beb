//! The models through FMI 3.0: the same run as through FMI 2.0, to the last bit.

use fmu_export::variable::{Causality, Type};
use fmu_export::{ModelType, Standard};
use magnetic_bearing::fmu;

use crate::support::MODELS;
use crate::support::Random;
use crate::support::ffi::{Expect, Fmu};
use crate::support::ffi3::{Fmu3, Request3};
use crate::support::is_plant;

const TS: f64 = 1e-4;
const STEPS: u32 = 300;

/// The continuous inputs of a model, and values for them near their start.
fn inputs(model: &ModelType, random: &mut Random) -> Vec<(u32, f64)> {
    let rows = (0..).zip(model.variables());
    let inputs = rows.filter_map(|(reference, variable)| match variable.data_type {
        Type::Real { start, nominal, .. } if variable.causality == Causality::Input => {
            Some((reference, start + 1e-3 * nominal * random.between(-1.0, 1.0)))
        }
        _ => None,
    });
    inputs.collect()
}

/// The Real variables that the description for FMI 3.0 lists, but for the time: each reference with the number of its elements.
fn reals(model: &ModelType, arrays: bool) -> Vec<(u32, usize)> {
    let document = &model.description(Standard::Fmi3 { arrays }).xml;
    let document = roxmltree::Document::parse(document).expect("well-formed XML");
    let floats = document.descendants().filter(|node| node.tag_name().name() == "Float64");
    let reals = floats.filter(|variable| variable.attribute("name") != Some("time")).map(|variable| {
        let reference = variable.attribute("valueReference").and_then(|text| text.parse().ok()).expect("a number");
        let size = variable.first_element_child().and_then(|dimension| dimension.attribute("start"));
        (reference, size.map_or(1, |size| size.parse().expect("a number")))
    });
    reals.collect()
}

/// Every array is read in one piece.
fn read(fmu: &Fmu3, reals: &[(u32, usize)]) -> Vec<u64> {
    let read = |(reference, size): &(u32, usize)| {
        let values = fmu.get_floats(&[*reference], *size);
        values.unwrap_or_else(|_| panic!("{reference}: {:?}", fmu.take_messages()))
    };
    reals.iter().flat_map(read).map(f64::to_bits).collect()
}

/// With and without arrays and event mode. Fails if one of the interfaces leaves an input out, or sets it later.
#[test]
fn the_run_is_that_of_fmi_2_bit_for_bit() {
    for name in MODELS {
        let model = fmu::find(name).expect("a model");
        let old = Fmu::started(name, &[]);
        let new: Vec<_> = [(false, false), (false, true), (true, true)]
            .map(|(arrays, event_mode)| {
                let request = Request3 { logging: true, event_mode, ..Request3::of(name, arrays) };
                let fmu = request.instantiate(name, arrays).expect("an instance");
                fmu.start(0.0);
                if event_mode {
                    fmu.ok(fmu.update_discrete_states());
                    fmu.ok(fmu.enter_step_mode());
                }
                (fmu, event_mode, reals(&model, arrays))
            })
            .into();
        let mut random = Random::new(7);
        let mut compared = 0;
        for step in 0..STEPS {
            let time = f64::from(step) * TS;
            let settings = inputs(&model, &mut random);
            for (reference, value) in &settings {
                old.set_reals(&[*reference], &[*value]).ok(&old);
            }
            old.step(time, TS).ok(&old);
            let floats = model.variables().iter().filter(|variable| matches!(variable.data_type, Type::Real { .. }));
            let wanted: Vec<_> = floats.map(|variable| old.get(&variable.name).to_bits()).collect();
            for (fmu, event_mode, reals) in &new {
                if *event_mode {
                    fmu.ok(fmu.enter_event_mode());
                }
                for (first, size) in reals {
                    let elements = settings.iter().filter(|(at, _)| (*first..*first + *size as u32).contains(at));
                    let values: Vec<_> = elements.map(|(_, value)| *value).collect();
                    if !values.is_empty() {
                        fmu.ok(fmu.set_floats(&[*first], &values));
                    }
                }
                if *event_mode {
                    fmu.ok(fmu.update_discrete_states());
                    fmu.ok(fmu.enter_step_mode());
                }
                fmu.ok(fmu.step(time, TS));
                assert!(read(fmu, reals) == wanted, "{name} at {time} s");
                compared += wanted.len();
            }
        }
        assert!(compared > 20_000, "{name}: {compared} values compared");
        // Of all types, by name.
        assert_eq!(new[0].0.all_bits(), old.all_bits(), "{name}");
    }
}

/// Fails if a derivative is that of another variable.
#[test]
fn derivatives_are_those_of_fmi_2_bit_for_bit() {
    for name in MODELS.into_iter().filter(|name| is_plant(name)) {
        let (old, new) = (Fmu::started(name, &[]), Fmu3::started(name, &[]));
        for step in 0..50 {
            old.step(f64::from(step) * TS, TS).ok(&old);
            new.ok(new.step(f64::from(step) * TS, TS));
        }
        // Without currents there are no forces.
        for (reference, value) in inputs(&fmu::find(name).expect("a model"), &mut Random::new(3)) {
            old.set_reals(&[reference], &[value + 1.0]).ok(&old);
            new.ok(new.set_floats(&[reference], &[value + 1.0]));
        }
        old.step(50.0 * TS, TS).ok(&old);
        new.ok(new.step(50.0 * TS, TS));
        let of = |causality| {
            let rows = (0_u32..).zip(old.variables());
            let chosen = rows.filter(move |(_, variable)| variable.causality == causality && variable.is_continuous());
            chosen.map(|(reference, _)| reference).collect::<Vec<_>>()
        };
        let (knowns, unknowns) = (of(Causality::Input), of(Causality::Output));
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
