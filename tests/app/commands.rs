//! Commands on all machines.

use std::fs;
use std::path::Path;

use crate::program::{fresh, open};
use crate::support::says;
use magnetic_bearing::machine::{MACHINES, Machine};
use magnetic_bearing::simulation::scenario::{BUILT_IN, Scenario};
use magnetic_bearing::studies::design::{self, Conditions, design};
use magnetic_bearing::studies::montecarlo::figures::pooled;
use magnetic_bearing::studies::montecarlo::{self, NOISE};
use magnetic_bearing::studies::sweep::Sweep;

/// The scenario that is run of a machine.
fn built_in(machine: &Machine) -> &'static str {
    if machine.name == "planar" { "unbalanced" } else { machine.name }
}

#[test]
fn a_sweep_of_every_machine_tells_of_all_its_magnets() {
    for machine in &MACHINES {
        let name = machine.name;
        let (magnet, load) = (&machine.of_magnets("lambda")[1], machine.coordinates[0].load.0);
        let design = fresh(&format!("{name}-design.csv"));
        fs::write(&design, format!("plant.{magnet},plant.{load} [N]\n3e-6,5\n,-5\n-1,\n")).expect("a design");
        let sweep = Sweep::open(&design, Some(Path::new(built_in(machine)))).unwrap_or_else(|error| panic!("{error}"));
        let rows = fresh(&format!("{name}-rows.csv"));
        sweep.run(&rows).expect("rows");
        let mut reader = csv::Reader::from_path(&rows).expect("rows");
        let header = reader.headers().expect("a header").clone();
        let rows: Vec<_> = reader.records().map(|row| row.expect("a row")).collect();
        let cell = |row: usize, column: &str| {
            let at = header.iter().position(|known| known == column).unwrap_or_else(|| panic!("{name}: no {column}"));
            rows[row][at].to_owned()
        };
        let number = |row: usize, column: &str| {
            cell(row, column).parse::<f64>().unwrap_or_else(|error| panic!("{name}, {column}: {error}"))
        };
        for row in [0, 1] {
            assert_eq!((cell(row, "status").as_str(), number(row, "valid")), ("ok", 1.0), "{name}");
            for (k, error) in machine.of_magnets("error").iter().enumerate() {
                let of = |what: &str| number(row, &format!("{} [N.m2/A2]", machine.of_magnets(what)[k]));
                let truth = of("lambdaHat") / (1.0 + number(row, error));
                let told =
                    open(built_in(machine), &[]).value("plant", &machine.of_magnets("lambda")[k]).expect("λ").as_f64();
                let wanted = if k == 1 && row == 0 { 3e-6 } else { told };
                assert!((truth / wanted - 1.0).abs() < 1e-9, "{name}, magnet {k}: {truth}");
                let deviations = (of("lambdaHat") - truth) / of("lambdaStd");
                assert!(deviations.abs() < 6.0, "{name}, magnet {k}: {deviations} standard deviations");
            }
            // The load of the design is what the estimator sees.
            let load_hat = format!("{} [N]", machine.of_loads("p", "Hat")[0]);
            let wanted = if row == 0 { 5.0 } else { -5.0 };
            assert!((number(row, &load_hat) - wanted).abs() < 1.0, "{name}: {}", number(row, &load_hat));
            for reference in machine.of_references() {
                let error = number(row, &format!("{} [m]", reference.replace("reference.", "tracking.")));
                assert!(error > 0.0 && error < 3e-6, "{name}, {reference}: off by {error}");
            }
            for plane in machine.of_planes("magnitude") {
                assert!(number(row, &format!("{plane} [kg.m]")) > 0.0, "{name}: {plane}");
            }
        }
        says(&cell(2, "status"), &[magnet]);
    }
}

#[test]
fn a_sweep_names_the_nearest_variable_of_the_machine() {
    let design = fresh("misspelt.csv");
    fs::write(&design, "plant.B.lamda[1]\n1\n").expect("a design");
    let open = |scenario| Sweep::open(&design, Some(Path::new(scenario))).err().expect("no such variable").to_string();
    says(&open("spindle"), &["did you mean B.lambda[1]?"]);
    says(&open("axial"), &["did you mean lambda[1]?"]);
}

/// Errors of all λ in standard deviations, and the bound below them.
#[test]
fn many_seeds_of_every_machine_agree_with_what_is_stated() {
    for machine in &MACHINES {
        let name = machine.name;
        let study = montecarlo::study(name, &open(built_in(machine), &[]), NOISE, true, 6);
        let study = montecarlo::Study { instants_s: vec![0.1, 0.2], ..study };
        let outcome = study.run().expect("a good scenario");
        let figures = &outcome.figures[1];
        assert_eq!((figures.runs, figures.valid), (6, 6), "{name}: {:?}", figures.verdicts);
        assert_eq!(figures.rms.len(), machine.magnets(), "{name}");
        let (normalised, over_bound) = (pooled(&figures.normalised), pooled(&figures.over_bound));
        println!("{name}: error/std {normalised:.2}, error/bound {over_bound:.2}");
        for (k, (stated, bound)) in figures.stated.iter().zip(&figures.bound).enumerate() {
            // No unbiased estimate is better than the bound; the estimator states hardly more.
            let ratio = stated / bound;
            println!("{name}, magnet {k}: {:.3} % stated, {ratio:.3} of the bound", 100.0 * stated);
            assert!((0.9..1.5).contains(&ratio), "{name}, magnet {k}: {ratio}");
        }
        // Of 6 runs, in each of which the errors of all magnets are alike.
        assert!((0.3..2.0).contains(&normalised), "{name}: {normalised}");
        assert!(outcome.beyond() == 0, "{name}: {:?}", outcome.worst());
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
        // Spindles at rest alone, where the answer is known beforehand: their runs take long.
        let speeds = if machine.bearings.len() > 1 { &[0.0][..] } else { &[0.0, 3000.0] };
        for rpm in speeds.iter().copied() {
            let scenario = open(built_in(machine), &[]);
            let conditions = Conditions { rpm, step_s: Some(2e-4), noise: NOISE, instant_s: 0.3 };
            let precisions = design(&scenario, &conditions).unwrap_or_else(|error| panic!("{name}: {error}"));
            println!("{name}, {rpm} rpm: {:.5} alone, {:.5} modulated", precisions[0].worst(), precisions[1].worst());
            let [alone, modulated] = precisions.each_ref().map(|precision| precision.std.last().expect("an instant"));
            assert_eq!((alone.len(), modulated.len()), (machine.magnets(), machine.magnets()));
            let recommended = design::is_modulation_recommended(&precisions);
            // At rest constant forces do not tell force constants from loads.
            assert!(rpm > 0.0 || recommended, "{name}: {precisions:?}");
            let advice = design::advice(&scenario, &conditions, &precisions);
            assert_eq!(advice.contains("F0.modulation = 0.5 at"), recommended, "{name}: {advice}");
            let table = design::table(&scenario, &conditions, &precisions);
            assert!(table.rows.iter().all(|row| row.len() == table.head.len()), "{table:?}");
        }
    }
}

#[test]
fn names_of_another_machine_are_said_at_once() {
    let without = |name: &str| {
        let (_, text) = BUILT_IN.iter().find(|(built_in, _)| *built_in == name).expect("a built-in scenario");
        text.lines().filter(|line| !line.starts_with("machine")).collect::<Vec<_>>().join("\n")
    };
    let findings = |text: &str| Scenario::parse("test.toml", text).err().expect("names of another machine").findings;
    for (name, words) in [
        ("spindle", "these are names of the machine spindle or spindle4: add machine = \"spindle\""),
        ("axial", "these are names of the machine axial: add machine = \"axial\""),
    ] {
        let found = findings(&without(name));
        assert_eq!(found.len(), 1, "{found:?}");
        says(&found[0], &[words]);
    }
    let found = findings(
        "title = \"t\"\nduration = 1\nstep = 1e-4\n[controller]\nallocation = \"biasCurrent\"\nbias.current = 2\n",
    );
    assert_eq!(
        found,
        ["allocation, bias.current: these are names of the machine planar4 or axial: add machine = \"planar4\""]
    );
    let found = findings("title = \"t\"\nduration = 1\nstep = 1e-4\n[plant]\n'lambda[4]' = 1e-6\n");
    let wanted =
        "lambda[4]: there is no variable of this name; it is one of the machine planar4: add machine = \"planar4\"";
    assert_eq!(found, [wanted]);
    let found = findings(&format!("machine = \"axial\"\n{}", without("unbalanced")));
    assert_eq!(found.len(), 1, "{found:?}");
    says(
        &found[0],
        &["and ", " more: these are names of the machine planar", "say machine = \"planar", "instead of \"axial\""],
    );
    // A misspelt name is one of no machine.
    let found = findings(&without("unbalanced").replace("unbalance.phase", "unbalance.phaze"));
    assert_eq!(found.len(), 1, "{found:?}");
    says(&found[0], &["[plant] unbalance.phaze: there is no variable of this name; did you mean unbalance.phase?"]);
}
