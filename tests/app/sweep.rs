//! Sweeps: a row per case, whatever happens.

use crate::prelude::*;

use magnetic_bearing::studies::sweep::{Outcome, Sweep};

fn opened(name: &str, scenario: Option<&str>) -> Sweep {
    let design = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/designs").join(name);
    Sweep::open(&design, scenario.map(Path::new)).expect("a valid design")
}

#[test]
fn a_failing_case_is_a_row_with_its_message() {
    let folder = folder("sweep/failing");
    opened("cases.csv", None).run(&folder.join("rows.csv")).expect("the sweep runs");
    let rows = rows(&read(&folder, "rows.csv"));
    assert_eq!(rows.len(), 6);
    for (n, (row, word)) in rows.iter().zip(["ok", "ok", "lambda[1]", "controller.update.mode", "", "ok"]).enumerate() {
        assert_eq!(row["case"], (n + 1).to_string());
        assert_contains(&row["status"], &[word]);
    }
    assert_ne!(rows[4]["status"], "ok", "a load of 100 kN pushes the rotor through the backup bearing into a magnet");
    assert_eq!(rows[3]["lambdaHat[1] [N.m2/A2]"], "");
    // Masses in grams and in kilograms, loads with and without their unit.
    assert_eq!(rows[5]["plant.m [g]"], "6.9 kg");
    below("error of the first case", cell(&rows[0], "error[1]").abs(), 0.01);
    assert_eq!(rows[1]["seed"], "2");
}

#[test]
fn a_case_with_slow_sensors_is_refused() {
    let rows = swept(&folder("sweep/slow"), "estimator.Ts [us]\n100\n50\n", "unbalanced");
    assert_eq!(rows[0]["status"], "ok");
    assert_contains(&rows[1]["status"], &["plant.sensor.Ts = 0.0001 s", "estimator would read samples several times"]);
}

#[test]
fn an_interrupted_sweep_resumes_without_repeating_or_losing_a_row() {
    let design = opened("cases.csv", None);
    let folder = folder("sweep/interrupted");
    design.run(&folder.join("whole.csv")).expect("the sweep runs");
    let text = read(&folder, "whole.csv");
    let lines: Vec<&str> = text.lines().collect();

    // Rows 1 and 2 were done, and row 3 is incomplete.
    let torn = folder.join("torn.csv");
    write(&folder, "torn.csv", [lines[0], lines[1], lines[2], &lines[3][..20]].join("\n"));
    let before = design.run(&torn).expect("the sweep resumes");
    assert_eq!(before, Outcome { before: 2, failed: 3 });
    assert_eq!(read(&folder, "torn.csv"), text, "the same rows in the same order");
    assert_eq!(design.run(&torn).expect("there is nothing left to do").before, 6);
    assert_eq!(read(&folder, "torn.csv"), text);

    // With an incomplete header the sweep starts again.
    write(&folder, "torn.csv", "case,se");
    assert_eq!(design.run(&torn).expect("the sweep begins").before, 0);
    assert_eq!(read(&folder, "torn.csv"), text);
}

#[test]
fn processes_that_other_threads_start_do_not_keep_a_sweep_locked() {
    let design = opened("cases.csv", None);
    let out = folder("sweep/locked").join("rows.csv");
    design.run(&out).expect("the sweep runs");
    let (send, stop) = std::sync::mpsc::channel::<()>();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            while stop.try_recv() == Err(std::sync::mpsc::TryRecvError::Empty) {
                Command::new("true").status().expect("a program that does nothing");
            }
        });
        for _ in 0..3000 {
            assert_eq!(design.run(&out).expect("nobody else uses it").before, 6);
        }
        drop(send);
    });
}

#[test]
fn rows_of_different_designs_or_scenarios_are_not_mixed() {
    let folder = folder("sweep/foreign");
    let out = folder.join("rows.csv");
    opened("cases.csv", None).run(&out).expect("the sweep runs");
    let before = read(&folder, "rows.csv");
    // Nor are rows added to a foreign file; its last line is not an incomplete row.
    for (design, scenario, content, words) in [
        ("cases.csv", Some("paper"), before.as_str(), "another design or scenario"),
        ("hypercube.toml", None, &before, "other columns"),
        ("cases.csv", None, "not mine", "no rows of a sweep"),
        ("cases.csv", None, "title = 1\nstep", "no rows of a sweep"),
    ] {
        write(&folder, "rows.csv", content);
        assert_contains(&opened(design, scenario).run(&out).expect_err(words).to_string(), &[words]);
        assert_eq!(read(&folder, "rows.csv"), content, "{words}");
    }
}

#[test]
fn a_latin_hypercube_has_one_case_in_every_stratum_of_every_range() {
    let mut text = Vec::new();
    opened("hypercube.toml", None).write(&mut text).expect("a list can be written to");
    let rows = rows(std::str::from_utf8(&text).expect("UTF-8"));
    assert_eq!(rows.len(), 50);
    let column = |name: &str| rows.iter().map(|row| cell(row, name)).collect::<Vec<f64>>();
    let covers = |name: &str, quantile: fn(f64) -> f64| {
        let mut strata: Vec<_> = column(name).iter().map(|value| (quantile(*value) * 50.0).floor() as usize).collect();
        strata.sort_unstable();
        assert!(strata.iter().copied().eq(0..50), "{name}: {strata:?}");
    };
    covers("plant.pZ [N]", |p| (p + 30.0) / 30.0);
    covers("plant.unbalance.magnitude [g.mm]", |u| (u / 50.0).ln() / 6.0_f64.ln());
    assert_eq!(rows.iter().filter(|row| row.values().any(|cell| cell == "whenValid")).count(), 25);
    let mut seeds = column("plant.sensor.seed");
    seeds.sort_by(f64::total_cmp);
    seeds.dedup();
    assert_eq!(seeds.len(), 50);
}

#[test]
fn errors_of_a_design_are_named() {
    let folder = folder("sweep/wrong");
    let many = ["did you mean lambda[1]?", "plant.Y is refused", "connected to plant.Ym", "bearing.m"];
    let misspelt = "plant.B.lamda[1]\n1\n";
    for (text, scenario, words) in [
        ("plant.lamda[1],plant.Y,estimator.Ym,bearing.m\n1,2,3,4\n", None, &many[..]),
        // The nearest variable is that of the machine.
        (misspelt, Some("spindle"), &["did you mean B.lambda[1]?"]),
        (misspelt, Some("axial"), &["did you mean lambda[1]?"]),
        ("plant.m [kg],plant.pY,plant.m [g]\n1,2,3\n", None, &["plant.m is in the design twice"]),
        ("plant.m\n", None, &["the design has no cases"]),
    ] {
        write(&folder, "wrong.csv", text);
        let error = Sweep::open(&folder.join("wrong.csv"), scenario.map(Path::new)).err();
        assert_contains(&error.expect("nothing is right in it").to_string(), words);
    }
    for (cases, range, words) in [
        ("1000000000000", "{ from = 1, to = 2 }", "cases = 1000000000000 is refused: expected at most"),
        ("3", "{ from = 1, to = 2, unti = \"g\" }", "expected { from = …, to = … }"),
        ("3", "{ from = 1 }", "expected { from = …, to = … }"),
        ("3", "{ from = 2, to = 1 }", "expected finite ends, from below to"),
        ("3", "{ from = -1, to = 2 }", "plant.m = -1 kg is refused: expected a value above 0 kg"),
        ("3", "{ from = 1, to = 2, unit = \"lb\" }", "plant.m = 1e0 lb is refused: the unit lb is not one of kg"),
        (
            "3",
            "1\ncontroller.update.mode = [\"never\", \"x\"]",
            "controller.update.mode = x is refused: expected one of",
        ),
    ] {
        let text = format!("cases = {cases}\nseed = 1\nsampling = \"monteCarlo\"\n[ranges]\nplant.m = {range}\n");
        write(&folder, "wrong.toml", text);
        assert_contains(&Sweep::open(&folder.join("wrong.toml"), None).err().expect(words).to_string(), &[words]);
    }
}
