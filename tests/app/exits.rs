//! Pipes whose reader has gone, and interrupts.

use std::fs;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

use crate::program::{folder, program, said};
use crate::support::says;

/// A pipe that nobody reads.
fn closed() -> Stdio {
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    writer.into()
}

#[test]
fn a_closed_standard_error_is_no_panic() {
    let folder = folder("exits/closed-error");
    for (arguments, wanted) in [
        ("simulate none", 2),
        ("identify none.csv", 2),
        ("simulate unbalanced --set duration=10ms --csv -", 0),
        ("simulate unbalanced --set duration=10ms --csv none/x.csv", 1),
    ] {
        let mut program = program(&folder, &arguments.split(' ').collect::<Vec<_>>());
        let status = program.stdout(Stdio::null()).stderr(closed()).status().expect("it runs");
        assert_eq!(status.code(), Some(wanted), "{arguments}");
    }
}

#[test]
fn a_closed_standard_output_ends_the_work_quietly() {
    let folder = folder("exits/closed-output");
    fs::write(folder.join("design.csv"), "plant.m\n6.7\n6.8\n").expect("a file");
    for arguments in [
        "simulate unbalanced --set duration=50ms --csv -",
        "simulate unbalanced --set duration=50ms --json -",
        "completions bash",
        "sweep design.csv --expand",
        "sweep design.csv --out -",
    ] {
        let mut program = program(&folder, &arguments.split(' ').collect::<Vec<_>>());
        let output = program.stdout(closed()).stderr(Stdio::piped()).output().expect("it runs");
        let (code, _, errors) = said(&output);
        assert_eq!(code, 0, "{arguments:?}: {errors}");
        assert!(!errors.contains("error:"), "{arguments:?}: {errors}");
    }
}

/// An interrupted sweep keeps its rows and says so.
#[cfg(unix)]
#[test]
fn an_interrupted_sweep_says_how_to_go_on() {
    let folder = folder("exits/interrupted");
    let cases: String = (0..400).map(|case| format!("{}\n", 6.5 + 1e-3 * f64::from(case))).collect();
    fs::write(folder.join("design.csv"), format!("plant.m\n{cases}")).expect("a file");
    let arguments = ["sweep", "design.csv", "--out", "rows.csv", "--jobs", "1"];
    let mut sweep = program(&folder, &arguments).stderr(Stdio::piped()).stdout(Stdio::null()).spawn().expect("it runs");
    // The header is written before the first case.
    while !fs::metadata(folder.join("rows.csv")).is_ok_and(|file| file.len() > 0) {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let interrupt = Command::new("kill").args(["-s", "INT", &sweep.id().to_string()]).status();
    assert!(interrupt.is_ok_and(|status| status.success()));
    let status = sweep.wait().expect("it ends");
    let errors = BufReader::new(sweep.stderr.take().expect("a pipe")).lines().map_while(Result::ok).collect::<Vec<_>>();
    assert_eq!(status.code(), Some(130));
    says(&errors.join("\n"), &["interrupted", "rows.csv", "the same command"]);
}
