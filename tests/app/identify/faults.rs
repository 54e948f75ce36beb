//! Recordings with faults: excluded samples, findings, invalid answers.

use super::*;

/// A common mistake: a change to a good recording, and the expected proposal.
type Wrong = (fn(&mut Samples, &mut Question), &'static str);

const WRONG: &[Wrong] = &[
    (|samples, _| samples.position_m.swap(0, 1), "y and z are exchanged: exchange Ym and Zm (--column)"),
    (|samples, _| samples.position_m[0].iter_mut().for_each(|y| *y = -*y), "y is mirrored"),
    (|samples, _| samples.position_m[1].iter_mut().for_each(|z| *z = -*z), "z is mirrored"),
    (|samples, _| samples.current_a.rotate_left(1), "the magnets count from the third"),
    (|samples, _| samples.current_a.swap(0, 1), "magnets 1 and 2 are exchanged"),
    (|samples, _| samples.current_a[1].fill(5.0), "im[2] is 5 A throughout: "),
    (|samples, _| rotation(samples).for_each(|of| *of = -*of), "the angle counts against the rotation"),
    // Each row holds the command issued at its instant.
    (|samples, _| samples.current_a.iter_mut().for_each(|i| i.rotate_left(1)), "--hold heldAfter"),
    (|_, question| question.stated.hold = Hold::HeldAfter, "--hold heldBefore"),
    (|_, question| question.stated.parts[0].body.rotor.bearings[0].gap_m = 6e-4, "--estimate s"),
    (|_, question| question.stated.set_load("pZ", 40.0), "the loads differ: leave out the loads of --set"),
];

/// A gain that is off by as much as gaps are: both have about the same effect, so it is no part of the pairs below.
const GAIN: Wrong = (
    |samples, _| samples.position_m[0].iter_mut().for_each(|y| *y *= 1.05),
    "the gains of the position sensors differ: --estimate sensor.gain --estimate sensor.gainDifference",
);

/// Commands that act a row later than stated; no part of the pairs, which would differ from those of `--hold heldAfter` by a row only.
const EARLY: Wrong = (
    |samples, question| {
        samples.current_a.iter_mut().for_each(|i| i.rotate_left(2));
        question.stated.hold = Hold::HeldAfter;
    },
    "the currents come a sample early, or the positions late: shift the currents by one row, or --estimate delay",
);

/// A mistake that a usual one explains in part only, so that the verdict does not name that one.
const LATE: Wrong = (
    |samples, _| samples.position_m.iter_mut().for_each(|readings| readings.rotate_right(5)),
    "No usual mistake explains the data. They fit best if ",
);

fn rotation(samples: &mut Samples) -> impl Iterator<Item = &mut f64> {
    samples.theta_rad.iter_mut().chain(&mut samples.omega_rad_s)
}

#[test]
fn what_is_wrong_is_told_in_words() {
    let good = samples_of(&run(montecarlo::NOISE, 0.12).1);
    for (spoil, proposal) in WRONG.iter().chain([&GAIN, &EARLY, &LATE]) {
        let mut samples = good.clone();
        let mut question = question(&good, &[]);
        spoil(&mut samples, &mut question);
        let answer = identify::answer(&[samples], question);
        let first = answer.findings.first().cloned().unwrap_or_default();
        assert!(!answer.valid && first.contains(proposal), "{proposal}: {} {:?}", answer.verdict, answer.findings);
        assert!(*proposal != LATE.1 || !answer.verdict.contains("fit better"), "{}", answer.verdict);
        // The verdict names the same description, in place of advice that holds if the stated one is right.
        if let Some(best) = first.strip_prefix("The data fit better if ") {
            let best = best.split("; or if ").next().unwrap_or(best).trim_end_matches('.');
            assert!(answer.verdict.ends_with(&format!("; the data fit better if {best}.")), "{}", answer.verdict);
            assert!(!answer.verdict.contains("longer recording"), "{}", answer.verdict);
            // Parts that contradict a wrong description mean nothing.
            assert!(!answer.findings.join(" ").contains("; left out"), "{:?}", answer.findings);
        }
        let json = answer.statement().json;
        assert!(json["valid"] == false && json["lambdaHat"].is_null() && json["findings"].is_array(), "{json}");
    }
}

/// Two mistakes may cancel (axes exchanged and angle reversed is the bearing seen from behind, with its magnets rotated), but then λ is
/// correct. No other pair is valid.
#[test]
fn no_two_mistakes_end_valid() {
    let good = samples_of(&run(montecarlo::NOISE, 0.05).1);
    let pairs: Vec<[usize; 2]> =
        (0..WRONG.len()).flat_map(|one| (one + 1..WRONG.len()).map(move |other| [one, other])).collect();
    let wrong = in_order(pairs.len(), &|at| {
        let mut samples = good.clone();
        let mut question = question(&good, &[]);
        pairs[at].iter().for_each(|mistake| WRONG[*mistake].0(&mut samples, &mut question));
        let answer = identify::answer(&[samples], question);
        let right = answer.found.as_ref().is_some_and(|found| {
            let ratio = |k: usize| ((found.lambda[k].value - TRUTH[k]) / found.lambda[k].total_std).abs();
            (0..3).map(ratio).fold(0.0, f64::max) < CONFIDENT
        });
        (answer.valid && !right).then(|| format!("{:?}: {}", pairs[at].map(|mistake| WRONG[mistake].1), answer.verdict))
    });
    let wrong: Vec<String> = wrong.into_iter().flatten().collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Rotor, magnets and gap of another machine: not valid.
#[test]
fn a_recording_of_another_machine_is_not_valid() {
    let (base, recording) = run(montecarlo::NOISE, 0.1);
    let stated = question(&samples_of(&recording), &[]);
    for seed in [62_901, 62_902] {
        let mut scenario = montecarlo::cases::drawn(&base, seed, false);
        scenario.duration_s = 0.1;
        is_refused(&identify::answer(&[simulated(&scenario)], stated.clone()), "Not valid: ");
    }
}

#[test]
fn recordings_without_information_are_not_valid() {
    is_refused(&ask(&[samples_of(&run(montecarlo::NOISE, 0.02).1)], &[]), "too short");
    let (mut scenario, _) = run(montecarlo::NOISE, 0.01);
    montecarlo::cases::at_rest(&mut scenario);
    montecarlo::cases::unbalance(&mut scenario, 0.0, 0.0);
    scenario.duration_s = 0.5;
    is_refused(&ask(&[simulated(&scenario)], &[]), "at rest and nothing excites it");
    montecarlo::cases::modulation(&mut scenario, 0.5, 110.0);
    is_right("modulated", &ask(&[simulated(&scenario)], &[]));
}

/// Rows missing at random, singly and in bursts: the answer is correct within a small standard deviation.
#[test]
fn missing_rows_are_gaps() {
    type Missing = fn(usize, &[f64], &[f64]) -> bool;
    let cases: [(&str, [f64; 2], Missing); 5] = [
        ("3 % at random", montecarlo::NOISE, |row, single, _| single[row] < 0.03),
        ("20 % at random", montecarlo::NOISE, |row, single, _| single[row] < 0.2),
        ("half, in bursts", montecarlo::NOISE, |row, _, bursts| bursts[row / 40] < 0.5),
        ("four of every 24", montecarlo::NOISE, |row, _, _| row % 24 < 4),
        ("10 %, noisy", [0.5e-6, 15e-3], |row, single, _| single[row] < 0.1),
    ];
    for (name, noise, is_missing) in cases {
        let text = csv(&run(noise, 0.4).1);
        let mut random = crate::support::Random::new(7);
        let mut draw = || text.lines().skip(1).map(|_| random.between(0.0, 1.0)).collect::<Vec<f64>>();
        let (single, bursts) = (draw(), draw());
        let lines = text.lines().enumerate();
        let kept = lines.filter(|(line, _)| *line == 0 || !is_missing(line - 1, &single, &bursts));
        let samples = read(&kept.map(|(_, line)| format!("{line}\n")).collect::<String>());
        for lambda in is_right(name, &ask(&[samples], &[])).lambda {
            assert!(lambda.total_std < 0.02 * lambda.value, "{name}: {lambda:?}");
        }
    }
}

/// Sensor faults are excluded and named: λ stays correct.
#[test]
fn sensor_faults_are_excluded_and_named() {
    let text = csv(&run(montecarlo::NOISE, 0.4).1);
    type Fault = fn(usize, f64) -> f64;
    let cases: [(&str, &str, usize, Fault); 8] = [
        ("plant.Ym", "outliers", 0, |row, value| if row % 997 == 500 { value + 50e-6 } else { value }),
        ("plant.im[2]", "outliers", 0, |row, value| if row % 499 == 100 { 0.0 } else { value }),
        ("plant.Zm", "stuck at", 190, |row, value| if (1500..1700).contains(&row) { 1e-5 } else { value }),
        ("plant.im[3]", "stuck at", 290, |row, value| if (1500..1800).contains(&row) { 2.0 } else { value }),
        ("plant.im[1]", "clipped at", 0, |_, value| value.min(2.2)),
        ("plant.theta", "theta: stuck", 0, |row, value| if (1500..1730).contains(&row) { 1.0 } else { value }),
        ("plant.omegam", "omega: wrong", 0, |row, value| if (1500..1730).contains(&row) { 0.0 } else { value }),
        ("plant.im[1]", "clipped at", 0, |row, value| if row % 997 == 500 { 9.0 } else { value.min(2.2) }),
    ];
    for (name, words, gap, fault) in cases {
        let samples = spoilt(&text, &[name], |row, _, cell| fault(row, cell.parse().expect("a number")).to_string());
        assert_contains(&samples.notes.join(" "), &[words]);
        let rows = samples.len();
        let found = is_right(&format!("{name}, {words}"), &ask(&[samples], &[]));
        // Positions without the forces that cause them soon carry no information.
        let left_out = rows - found.conditions[0].parts[0].rows;
        assert!(left_out >= gap, "{name}, {words}: {left_out} rows are not used");
    }
}

/// The samples of a recording after a change of the cells in columns with these prefixes; `change` gets row, changed cell above, and cell.
pub fn spoilt(text: &str, columns: &[&str], change: impl Fn(usize, &str, &str) -> String) -> Samples {
    let (header, rows) = text.split_once('\n').expect("a header");
    let is_changed = header.split(',').map(|name| columns.iter().any(|start| name.starts_with(start)));
    let is_changed: Vec<bool> = is_changed.collect();
    let mut above = vec![String::new(); is_changed.len()];
    let mut spoilt = header.to_owned();
    for (row, line) in rows.lines().enumerate() {
        let cells = line.split(',').zip(&above).zip(&is_changed);
        let changed = cells.map(|((cell, above), is)| if *is { change(row, above, cell) } else { cell.into() });
        above = changed.collect();
        spoilt += &format!("\n{}", above.join(","));
    }
    read(&spoilt)
}

/// Rows that repeat the previous row or are 0 are excluded, few or many at a time, and not taken for a disturbance of the rotor.
#[test]
fn repeated_rows_are_excluded() {
    let text = csv(&run(montecarlo::NOISE, 0.4).1);
    for (zero, words) in [(None, "repeat the previous row"), (Some("0"), "all positions and currents are 0")] {
        let samples = spoilt(&text, &["plant.Ym", "plant.Zm", "plant.im"], |row, above, cell| {
            let line = row + 1;
            if line > 200 && line % 397 < 1 + line / 397 { zero.unwrap_or(above).into() } else { cell.into() }
        });
        assert_contains(&samples.notes.join(" "), &[words]);
        let answer = ask(&[samples], &[]);
        assert!(answer.valid && answer.findings.is_empty(), "{zero:?}: {} {:?}", answer.verdict, answer.findings);
    }
}

/// Quantisation of a position above its noise is named; its errors repeat with the readings, so that more rows add no information.
#[test]
fn quantised_positions_are_named() {
    const STEP_M: f64 = 2e-6;
    let text = csv(&run([5e-8, 1e-2], 0.4).1);
    let coarse = |cell: &str| STEP_M * (cell.parse::<f64>().expect("a number") / STEP_M).round();
    let samples = spoilt(&text, &["plant.Ym", "plant.Zm"], |_, _, cell| format!("{:e}", coarse(cell)));
    let answer = ask(&[samples], &[]);
    assert_contains(&answer.findings.join(" "), &["Ym is quantised in steps of 2 µm"]);
    let part = &is_right("quantised", &answer).conditions[0].parts[0];
    assert!(part.counting < part.rows / 2, "{part:?}");
}

/// The flat peak of a quantised current is not that of a sensor that is stuck.
#[test]
fn peaks_of_quantised_currents_are_not_stuck() {
    const STEP_A: f64 = 20e-3;
    let text = csv(&run(montecarlo::NOISE, 0.4).1);
    let current_a = |row: usize| match row {
        2000..2100 => 3.0 + 2.0 * STEP_A * (1.0 - (row as f64 - 2050.0).abs() / 50.0),
        _ => 3.0 + (row as f64 * TAU / 200.0).sin(),
    };
    let coarse = |row: usize| STEP_A * (current_a(row) / STEP_A).round();
    let samples = spoilt(&text, &["plant.im[1]"], |row, _, _| format!("{:.3}", coarse(row)));
    assert!(!samples.notes.join(" ").contains("stuck"), "{:?}", samples.notes);
}

/// An offset that drifts is not a change of λ at an instant, after which the rest would be valid.
#[test]
fn a_drift_is_reported() {
    let text = csv(&run(montecarlo::NOISE, 0.4).1);
    let drifting = |row: usize, cell: &str| cell.parse::<f64>().expect("a number") + 2.5e-9 * row as f64;
    let samples = spoilt(&text, &["plant.Ym"], |row, _, cell| drifting(row, cell).to_string());
    let answer = ask(&[samples], &[]);
    is_refused(&answer, "the force constants or the sensors drift, λ by");
    assert!(answer.findings.is_empty(), "{:?}", answer.findings);
}

/// Without angles the shaft may have another one at each start. They follow from the speed by the trapezoidal rule.
#[test]
fn angles_follow_from_the_speed() {
    let without = |text: &str| text.replace("plant.theta", "plant.unused");
    let (mut slower, recording) = run(montecarlo::NOISE, 0.3);
    let text = without(&csv(&recording));
    let speed = |row: usize| 0.1 * row as f64;
    let rising = spoilt(&text, &["plant.omegam"], |row, _, _| speed(row).to_string());
    for (row, theta_rad) in rising.theta_rad.iter().enumerate() {
        let exact_rad = 0.5 * speed(row) * row as f64 * rising.step_s;
        below(&format!("row {row}"), (theta_rad - exact_rad).abs(), 1e-9);
    }
    let first = read(&text);
    slower.set("plant", "omega", 250.0);
    let text = without(&csv(&run_to_end(&slower).recording));
    let later: Vec<&str> =
        text.lines().enumerate().filter(|(line, _)| !(1..38).contains(line)).map(|(_, of)| of).collect();
    let second = read(&later.join("\n"));
    let check = ask(std::slice::from_ref(&first), &[]).check(&first, &second).expect("a comparison");
    let [_, [_, ahead_m, own_m]] = check.errors;
    below("prediction error 20 ms ahead, in that of its own fit", ahead_m / own_m, 1.25);
    is_right("two starts", &ask(&[first, second], &[]));
}

/// Recordings with different λ are not of one bearing, those with different unbalances not of one rotor: the answer names the difference.
#[test]
fn recordings_that_differ_are_reported() {
    let (other, recording) = run(montecarlo::NOISE, 0.3);
    let first = samples_of(&recording);
    let unbalance = 1.1 * other.number("plant", "unbalance.magnitude");
    let differences = [("lambda[2]", 1.05 * TRUTH[1], "λ2"), ("unbalance.magnitude", unbalance, "the unbalance")];
    for (name, value, differs) in differences {
        let mut other = other.clone();
        other.set("plant", name, value);
        other.set("plant", "sensor.seed", 12);
        is_refused(&ask(&[first.clone(), simulated(&other)], &[]), &format!("the recordings differ: {differs}"));
    }
}

/// Without angle and speed the rotor is not assumed to be at rest; a speed that is off by 0.4 % is found.
#[test]
fn an_unknown_or_wrong_speed_is_reported() {
    let text = csv(&run(montecarlo::NOISE, 0.4).1);
    let blind = text.replace("plant.theta", "plant.unused").replace("plant.omegam", "plant.unusedToo");
    let read = |text: &str, omega_rad_s: Option<f64>| {
        Samples::read(text.as_bytes(), &Reading { omega_rad_s, ..Reading::default() }).expect("usable")
    };
    let at_speed = |omega_rad_s: Option<f64>| ask(&[read(&blind, omega_rad_s)], &[]);
    let answer = at_speed(None);
    is_refused(&answer, "neither angle nor speed");
    // No estimate assumes standstill.
    assert!(answer.found.is_none() && answer.findings.join(" ").contains("is not known"), "{:?}", answer.findings);
    is_right("3000 rpm", &at_speed(Some(100.0 * std::f64::consts::PI)));
    let slower = at_speed(Some(100.4 * std::f64::consts::PI));
    is_refused(&slower, "turns 0.46 % slower than the stated speed");
    assert!(!slower.findings.join(" ").contains("; left out"), "{:?}", slower.findings);
    is_refused(&at_speed(Some(99.75 * std::f64::consts::PI)), "turns 0.19 % faster than the stated speed");
    // A gap of 2.5 turns.
    let rows = blind.lines().enumerate().filter(|(line, _)| !(1500..2000).contains(line));
    let gap = rows.map(|(_, row)| row.to_owned() + "\n").collect::<String>();
    let samples = read(&gap, Some(100.4 * std::f64::consts::PI));
    is_refused(&ask(&[samples], &[]), "% slower than the stated speed");
    let notes = read(&text.replace("plant.theta", "Theta"), None).notes.join(" ");
    assert_contains(&notes, &["theta: no column of this name; the nearest name is Theta"]);
}
