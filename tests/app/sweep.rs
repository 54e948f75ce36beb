//! Sweeps: a row per case, whatever happens.

use std::fs;
use std::path::{Path, PathBuf};

use crate::program::fresh;
use magnetic_bearing::studies::sweep::{Outcome, Sweep};

fn design(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/designs").join(name)
}

fn cell<'r>(rows: &'r [csv::StringRecord], header: &csv::StringRecord, row: usize, column: &str) -> &'r str {
    let at = header.iter().position(|name| name == column).unwrap_or_else(|| panic!("no column {column}"));
    &rows[row][at]
}

#[test]
fn a_failing_case_is_a_row_with_its_message() {
    let design = Sweep::open(&design("cases.csv"), None).expect("a valid design");
    let out = fresh("failing.csv");
    design.run(&out).expect("the sweep runs");
    let mut reader = csv::Reader::from_path(&out).expect("rows");
    let header = reader.headers().expect("a header").clone();
    let rows: Vec<_> = reader.records().map(|row| row.expect("a row")).collect();
    let at = |row, column| cell(&rows, &header, row, column);
    assert_eq!(rows.len(), 6);
    for (row, words) in ["ok", "ok", "lambda[1]", "controller.update.mode", "", "ok"].iter().enumerate() {
        assert_eq!(at(row, "case"), (row + 1).to_string());
        assert!(at(row, "status").contains(words), "case {}: {}", row + 1, at(row, "status"));
    }
    assert_ne!(at(4, "status"), "ok", "a load of 100 kN pushes the rotor through the backup bearing into a magnet");
    assert_eq!(at(3, "lambdaHat[1] [N.m2/A2]"), "");
    // Masses in grams and in kilograms, loads with and without their unit.
    assert_eq!(at(5, "plant.m [g]"), "6.9 kg");
    let error: f64 = at(0, "error[1]").parse().expect("a number");
    assert!(error.abs() < 0.01, "the first case is off by {error}");
    assert_eq!(at(1, "seed"), "2");
}

#[test]
fn an_interrupted_sweep_goes_on_without_repeating_or_losing_a_row() {
    let design = Sweep::open(&design("cases.csv"), None).expect("a valid design");
    let whole = fresh("whole.csv");
    design.run(&whole).expect("the sweep runs");
    let text = fs::read_to_string(&whole).expect("rows");
    let lines: Vec<&str> = text.lines().collect();

    // Rows 5 and 2 were done, in that order, and row 6 is incomplete.
    let torn = fresh("torn.csv");
    let left = format!("{}\n{}\n{}\n{}", lines[0], lines[5], lines[2], &lines[6][..20]);
    fs::write(&torn, left).expect("a file can be written");
    let before = design.run(&torn).expect("the sweep resumes");
    assert_eq!(before, Outcome { before: 2, failed: 3 });
    assert_eq!(fs::read_to_string(&torn).expect("rows"), text, "the same rows in the same order");
    assert_eq!(design.run(&torn).expect("there is nothing left to do").before, 6);
    assert_eq!(fs::read_to_string(&torn).expect("rows"), text);

    // With an incomplete header the sweep starts again.
    fs::write(&torn, "case,se").expect("a file can be written");
    assert_eq!(design.run(&torn).expect("the sweep begins").before, 0);
    assert_eq!(fs::read_to_string(&torn).expect("rows"), text);
}

#[test]
fn rows_of_another_design_or_scenario_are_not_mixed_in() {
    let one = Sweep::open(&design("cases.csv"), None).expect("a valid design");
    let out = fresh("foreign.csv");
    one.run(&out).expect("the sweep runs");
    let before = fs::read_to_string(&out).expect("rows");
    let other = Sweep::open(&design("cases.csv"), Some(Path::new("paper"))).expect("a valid design");
    let error = other.run(&out).expect_err("another scenario").to_string();
    assert!(error.contains("another design or scenario"), "{error}");
    let other = Sweep::open(&design("hypercube.toml"), None).expect("a valid design");
    let error = other.run(&out).expect_err("another design").to_string();
    assert!(error.contains("other columns"), "{error}");
    assert_eq!(fs::read_to_string(&out).expect("rows"), before);
    // Nor is any other file, whose last line is not an incomplete row.
    for foreign in ["not mine", "title = 1\nstep"] {
        fs::write(&out, foreign).expect("a file can be written");
        let error = one.run(&out).expect_err("a file of another kind").to_string();
        assert!(error.contains("no rows of a sweep"), "{error}");
        assert_eq!(fs::read_to_string(&out).expect("the file"), foreign);
    }
}

#[test]
fn a_latin_hypercube_has_one_case_in_every_part_of_every_range() {
    let design = Sweep::open(&design("hypercube.toml"), None).expect("a valid design");
    let mut text = Vec::new();
    design.write(&mut text).expect("a list can be written to");
    let mut reader = csv::Reader::from_reader(text.as_slice());
    let header = reader.headers().expect("a header").clone();
    let rows: Vec<_> = reader.records().map(|row| row.expect("a row")).collect();
    assert_eq!(rows.len(), 50);
    let column = |name: &str| -> Vec<f64> {
        (0..rows.len()).map(|row| cell(&rows, &header, row, name).parse().expect("a number")).collect()
    };
    let parts = |share: Vec<f64>| {
        let mut parts: Vec<usize> = share.iter().map(|share| (share * 50.0).floor() as usize).collect();
        parts.sort_unstable();
        assert_eq!(parts, (0..50).collect::<Vec<_>>());
    };
    parts(column("plant.pZ [N]").iter().map(|p| (p + 30.0) / 30.0).collect());
    parts(column("plant.unbalance.magnitude [g.mm]").iter().map(|u| (u / 50.0).ln() / 6.0_f64.ln()).collect());
    let often = rows.iter().filter(|row| row.iter().any(|cell| cell == "whenValid")).count();
    assert_eq!(often, 25);
    let mut seeds = column("plant.sensor.seed");
    seeds.sort_by(f64::total_cmp);
    seeds.dedup();
    assert_eq!(seeds.len(), 50);
}

#[test]
fn what_is_wrong_with_a_design_is_said_by_name() {
    let wrong = fresh("wrong.csv");
    fs::write(&wrong, "plant.lamda[1],plant.Y,estimator.Ym,bearing.m\n1,2,3,4\n").expect("a file can be written");
    let error = Sweep::open(&wrong, None).err().expect("nothing is right in it").to_string();
    for words in ["did you mean lambda[1]?", "plant.Y is refused", "connected to plant.Ym", "bearing.m"] {
        assert!(error.contains(words), "{words} is missing in {error}");
    }
}
