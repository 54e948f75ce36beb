//! Exit codes, pipes whose reader has gone, and arguments that would not fit.

use std::fs;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

use crate::program::{ends, folder, program, refuses, said};
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
    let runs: [(&[&str], i32); 4] = [
        (&["simulate", "none"], 2),
        (&["identify", "none.csv"], 2),
        (&["simulate", "unbalanced", "--set", "duration=10ms", "--csv", "-"], 0),
        (&["simulate", "unbalanced", "--set", "duration=10ms", "--csv", "none/x.csv"], 1),
    ];
    for (arguments, wanted) in runs {
        let status = program(&folder, arguments).stdout(Stdio::null()).stderr(closed()).status().expect("it runs");
        assert_eq!(status.code(), Some(wanted), "{arguments:?}");
    }
}

#[test]
fn a_closed_standard_output_ends_the_work_quietly() {
    let folder = folder("exits/closed-output");
    fs::write(folder.join("design.csv"), "plant.m\n6.7\n6.8\n").expect("a file");
    let runs: [&[&str]; 5] = [
        &["simulate", "unbalanced", "--set", "duration=50ms", "--csv", "-"],
        &["simulate", "unbalanced", "--set", "duration=50ms", "--json", "-"],
        &["completions", "bash"],
        &["sweep", "design.csv", "--expand"],
        &["sweep", "design.csv", "--out", "-"],
    ];
    for arguments in runs {
        let output = program(&folder, arguments).stdout(closed()).stderr(Stdio::piped()).output().expect("it runs");
        let (code, _, errors) = said(&output);
        assert_eq!(code, 0, "{arguments:?}: {errors}");
        assert!(!errors.contains("error:"), "{arguments:?}: {errors}");
    }
}

#[test]
fn exit_codes_tell_arguments_from_answers() {
    let folder = folder("exits/codes");
    ends(0, &folder, &["simulate", "unbalanced", "--set", "duration=0.1s", "--csv", "good.csv"]);
    for arguments in [
        &["simulate", "unbalanced", "--set", "m=-1"][..],
        &["simulate", "unbalanced", "--set", "mass=1"],
        &["identify", "good.csv", "--method", "none"],
        &["identify", "good.csv", "--hold", "none"],
        &["design", "--at", "-1"],
        &["sweep", "none.csv", "--out", "rows.csv"],
    ] {
        ends(2, &folder, arguments);
    }
    // Less than a revolution and a third.
    let short = fs::read_to_string(folder.join("good.csv")).expect("a table");
    let short: Vec<&str> = short.lines().take(200).collect();
    fs::write(folder.join("short.csv"), short.join("\n")).expect("a file");
    says(&ends(3, &folder, &["identify", "short.csv"]).1, &["Not valid", "too short"]);
    says(&ends(0, &folder, &["--help"]).0, &["Exit codes:", "3  an identification"]);
}

#[test]
fn a_bearing_is_given_to_identify_as_to_simulate() {
    let folder = folder("exits/set");
    ends(0, &folder, &["simulate", "unbalanced", "--set", "duration=0.1s", "--csv", "run.csv"]);
    let identified = |arguments: &[&str]| ends(0, &folder, &[&["identify", "run.csv"], arguments].concat()).0;
    let out = identified(&["--set", "s=5.1e-4", "--set", "m=6.8kg", "--set", "alpha[1]=179.5deg"]);
    says(&out, &["m = 6.8 kg, s = 0.51 mm, alpha = 179.5,"]);
    // A file with the parameters alone.
    fs::write(folder.join("bench.toml"), "[all]\nm = \"6.6 kg\"\n").expect("a file");
    says(&identified(&["--scenario", "bench.toml"]), &["m = 6.6 kg"]);
    for (change, option) in
        [("hold=linear", "--hold"), ("sensor.positionNoise=1e-6", "--position-noise"), ("lambda=1", "no variable")]
    {
        let name = change.split('=').next().unwrap_or_default();
        refuses(&folder, &["identify", "run.csv", "--set", change], &[name, option]);
    }
}

#[test]
fn a_run_that_does_not_fit_into_memory_is_refused() {
    let words = ["duration = 1e9 s", "1e13 samples", "GB of memory", "the limit is 8 GB"];
    refuses(&folder("exits/memory"), &["simulate", "unbalanced", "--set", "duration=1e9"], &words);
}

#[test]
fn messages_have_units_and_few_digits() {
    let folder = folder("exits/messages");
    refuses(&folder, &["whirl", "--to", "-5"], &["a speed in rpm"]);
    refuses(&folder, &["whirl", "--stiffness", "-5"], &["-5 N/m"]);
    // A load that no current can hold.
    let (_, errors) =
        ends(1, &folder, &["simulate", "unbalanced", "--set", "plant.pZ=-20000", "--set", "duration=0.1"]);
    let digits = |word: &str| {
        word.trim_start_matches(['-', '0', '.']).chars().take_while(|c| *c != 'e').filter(char::is_ascii_digit).count()
    };
    let long: Vec<&str> =
        errors.split([' ', ',']).filter(|word| word.parse::<f64>().is_ok() && digits(word) > 5).collect();
    assert!(errors.contains("leaves the gap") && long.is_empty(), "{long:?} in {errors}");
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
