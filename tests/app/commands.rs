//! Commands on all machines.

use crate::prelude::*;
use magnetic_bearing::studies::design::{self, Conditions, design};
use magnetic_bearing::studies::montecarlo::figures;

/// The built-in scenario of a machine.
fn built_in(machine: &Machine) -> &'static str {
    if machine.name == "planar" { "unbalanced" } else { machine.name }
}

#[test]
fn a_sweep_of_every_machine_covers_all_magnets() {
    for machine in &MACHINES {
        let name = machine.name;
        let scenario = open(built_in(machine), &[]);
        let (magnets, load) = (machine.of_magnets("lambda"), machine.coordinates[0].load);
        let design = format!("plant.{},plant.{load} [N]\n3e-6,5\n,-5\n-1,\n", magnets[1]);
        let rows = swept(&folder(&format!("sweep/{name}")), &design, built_in(machine));
        for (row, load_n, changed) in [(&rows[0], 5.0, Some(3e-6)), (&rows[1], -5.0, None)] {
            assert_eq!((row["status"].as_str(), cell(row, "valid")), ("ok", 1.0), "{name}");
            for (k, magnet) in magnets.iter().enumerate() {
                let of = |what: &str| cell(row, &format!("{} [N.m2/A2]", machine.of_magnets(what)[k]));
                let truth = of("lambdaHat") / (1.0 + cell(row, &machine.of_magnets("error")[k]));
                let wanted = changed.filter(|_| k == 1).unwrap_or_else(|| scenario.number("plant", magnet));
                assert!((truth / wanted - 1.0).abs() < 1e-9, "{name}, magnet {k}: {truth}");
                let deviations = (of("lambdaHat") - truth) / of("lambdaStd");
                assert!(deviations.abs() < 6.0, "{name}, magnet {k}: {deviations} standard deviations");
            }
            // The estimator finds the load of the design.
            let load_hat = cell(row, &format!("{} [N]", machine.of_loads("p", "Hat")[0]));
            assert!((load_hat - load_n).abs() < 1.0, "{name}: {load_hat}");
            for reference in machine.of_references() {
                let error = cell(row, &format!("{} [m]", reference.replace("reference.", "tracking.")));
                assert!(error > 0.0 && error < 3e-6, "{name}, {reference}: off by {error}");
            }
            for plane in machine.of_planes("magnitude") {
                assert!(cell(row, &format!("{plane} [kg.m]")) > 0.0, "{name}: {plane}");
            }
        }
        assert_contains(&rows[2]["status"], &[&magnets[1]]);
    }
}

/// Errors of all λ in stated standard deviations, and these over the Cramér–Rao bound.
#[test]
fn runs_of_every_machine_agree_with_the_stated_deviations() {
    for machine in &MACHINES {
        let name = machine.name;
        let study = montecarlo::study(name, &open(built_in(machine), &[]), NOISE, true, 6);
        let study = montecarlo::Study { instants_s: vec![0.1, 0.2], ..study };
        let outcome = study.run().expect("a good scenario");
        let figures = &outcome.figures[1];
        assert_eq!((figures.runs, figures.valid), (6, 6), "{name}: {:?}", figures.verdicts);
        assert_eq!(figures.rms.len(), machine.magnets(), "{name}");
        for (k, (stated, bound)) in figures.stated.iter().zip(&figures.bound).enumerate() {
            // No unbiased estimate beats the bound; the stated deviation is hardly larger.
            between(&format!("{name}, magnet {k}: stated/bound"), stated / bound, 0.9, 1.5);
        }
        // Six runs only, and the errors of the magnets within a run are correlated.
        between(&format!("{name}: error/std"), rms(figures.normalised.iter().copied()), 0.3, 2.0);
        assert!(outcome.beyond() == 0, "{name}: {:?}", figures::worst(&outcome.trials));
        let table = montecarlo::table(&study, &outcome);
        let rows: Vec<&str> = table.rows.iter().map(|row| row[0].as_str()).collect();
        let own: Vec<_> = rows.iter().filter(|row| row.starts_with("rms error of") && row.contains('λ')).collect();
        assert_eq!(own.len(), machine.bearings.len(), "{name}: {rows:?}");
        assert!(table.rows.iter().all(|row| row.len() == table.head.len()), "{table:?}");
    }
}

#[test]
fn the_excitation_of_every_machine_can_be_designed() {
    for machine in &MACHINES {
        let name = machine.name;
        // Runs of spindles take long: only at rest, where the answer is known beforehand.
        let speeds = if machine.bearings.len() > 1 { &[0.0][..] } else { &[0.0, 3000.0] };
        for rpm in speeds.iter().copied() {
            let scenario = open(built_in(machine), &[]);
            let conditions = Conditions { rpm, step_s: Some(2e-4), noise: NOISE, instant_s: 0.3 };
            let precisions = design(&scenario, &conditions).unwrap_or_else(|error| panic!("{name}: {error}"));

            let [alone, modulated] = precisions.each_ref().map(|precision| precision.last().expect("an instant"));
            assert_eq!((alone.len(), modulated.len()), (machine.magnets(), machine.magnets()));
            let recommended = design::is_modulation_recommended(&precisions);
            // At rest, constant forces do not separate force constants from loads.
            assert!(rpm > 0.0 || recommended, "{name}: {precisions:?}");
            let advice = design::advice(&scenario, &conditions, &precisions);
            assert_eq!(advice.contains("F0.modulation = 0.5 at"), recommended, "{name}: {advice}");
            let table = design::table(&scenario, &conditions, &precisions);
            assert!(table.rows.iter().all(|row| row.len() == table.head.len()), "{table:?}");
        }
    }
}

#[test]
fn names_of_another_machine_are_one_finding() {
    let without = |name: &str| {
        let (_, text) = BUILT_IN.iter().find(|(built_in, _)| *built_in == name).expect("a built-in scenario");
        text.lines().filter(|line| !line.starts_with("machine")).collect::<Vec<_>>().join("\n")
    };
    let head = "title = \"t\"\nduration = 1\nstep = 1e-4\n";
    for (text, words) in [
        (without("spindle"), &["these are names of the machine spindle or spindle4: add machine = \"spindle\""][..]),
        (without("axial"), &["these are names of the machine axial: add machine = \"axial\""]),
        (
            format!("{head}[controller]\nallocation = \"biasCurrent\"\nbias.current = 2\n"),
            &["allocation, bias.current: ", "planar4 or axial: add machine = \"planar4\""],
        ),
        (
            format!("{head}[plant]\n'lambda[4]' = 1e-6\n"),
            &["lambda[4]: there is no variable", "one of the machine planar4: add machine"],
        ),
        (
            format!("machine = \"axial\"\n{}", without("unbalanced")),
            &[" more: these are names of the machine planar", "say machine = \"planar"],
        ),
        // A misspelt name belongs to no machine.
        (
            without("unbalanced").replace("unbalance.phase", "unbalance.phaze"),
            &["unbalance.phaze: ", "did you mean unbalance.phase?"],
        ),
    ] {
        let findings = Scenario::parse("test.toml", &text).err().expect("names of another machine").findings;
        assert_eq!(findings.len(), 1, "{findings:?}");
        assert_contains(&findings[0], words);
    }
}
