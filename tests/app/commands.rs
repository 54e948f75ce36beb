//! Commands on all machines.

use std::fs;
use std::path::{Path, PathBuf};

use crate::support::says;
use magnetic_bearing::machine::{MACHINES, Machine};
use magnetic_bearing::simulation::scenario::Scenario;
use magnetic_bearing::studies::sweep::Sweep;

/// A short scenario of a machine, with these changes.
fn open(machine: &Machine, changes: &[(&str, &str)]) -> Scenario {
    let changes: Vec<_> = changes.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect();
    Scenario::open_with(Path::new(built_in(machine)), &changes).unwrap_or_else(|error| panic!("{error}"))
}

/// A built-in scenario of a machine.
fn built_in(machine: &Machine) -> &'static str {
    if machine.name == "planar" { "unbalanced" } else { machine.name }
}

/// A file for this test.
fn fresh(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_file(&path);
    path
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
                let told = open(machine, &[]).value("plant", &machine.of_magnets("lambda")[k]).expect("λ").as_f64();
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
