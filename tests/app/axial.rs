//! The machine `axial`: recordings of a real bench (tests/data/levitation), and an independent simulator of a levitated mass.

use crate::prelude::*;

use crate::support::runge_kutta;
use magnetic_bearing::studies::identify::axial::{self, Answer, Axis, PARAMETERS};

const RUNS: [&str; 5] = ["lqi", "lqr-tracking", "mpc", "pid-anti-windup", "pid-gain-scheduling"];
/// Static estimates of the prototype (README of the recordings): ki in N/A and ks in N/m at 10 mm.
const STATICS: [[f64; 2]; 5] = [[1.229, 94.6], [1.241, 96.7], [1.235, 95.5], [1.242, 96.8], [1.246, 97.2]];

fn file(run: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/data/levitation/levitation-stairs-{run}.csv.gz"))
}

fn index(name: &str) -> usize {
    PARAMETERS.iter().position(|(known, ..)| *known == name).expect("a parameter")
}

/// A mass below one magnet whose gap is estimated.
fn below_one_magnet(mass_kg: f64, load_n: f64) -> Axis {
    let mut axis = Axis { m_kg: mass_kg, used: vec![1], ..Axis::default() };
    axis.known[index("pX")] = Some(load_n);
    axis.estimated[index("s")] = true;
    axis
}

fn reading(used: &[usize], columns: &[(&str, &str)]) -> Reading {
    Reading { machine: &AXIAL, magnets: Some(used.to_vec()), columns: pairs(columns), ..Reading::default() }
}

fn recording(run: &str) -> Samples {
    let file = std::fs::File::open(file(run)).expect("a recording in tests/data");
    Samples::read(file, &reading(&[1], &[("Xm", "z"), ("im[2]", "i1")])).expect("a good recording")
}

/// docs/bench.md states these numbers. ki and ks are within 2 and 4 % of those from filtered least squares, an independent method; the five
/// answers scatter by their stated deviations; the dynamics are weaker than the law in all of them.
#[test]
fn recordings_of_a_real_bench() {
    let recordings = RUNS.map(recording);
    // The bench as its owner would describe it.
    let bench = Axis { at_m: Some(0.010), ..below_one_magnet(0.06054, 0.5939) };
    let answers =
        recordings.each_ref().map(|recording| axial::answer(&bench, recording).unwrap_or_else(|why| panic!("{why}")));
    for (((run, recording), answer), [ki, ks]) in RUNS.iter().zip(&recordings).zip(&answers).zip(STATICS) {
        let text = [recording.notes.clone(), answer.findings.clone()].concat().join(" ");
        assert!(answer.valid, "{run}: {}", answer.verdict);
        assert_contains(&text, &["start at rest", "repeat the previous row", "% weaker than the law", "slow force"]);
        assert_contains(&text, &["noise of the position grows"]);
        below("ki", (answer.operating[1].value / ki - 1.0).abs(), 0.02);
        below("ks", (answer.operating[2].value / ks - 1.0).abs(), 0.04);
        assert!((1.09..1.25).contains(&answer.dynamics.value), "{run}: κ = {}", answer.dynamics.value);
    }
    // The data tell the noise better than a statement; one that they contradict is refused.
    for (stated_m, valid) in [(1e-5, true), (1e-3, false)] {
        let mut bench = bench.clone();
        bench.known[index("noise.position")] = Some(stated_m);
        let answer = axial::answer(&bench, &recordings[2]).expect("an answer");
        assert!(
            answer.valid == valid && answer.verdict.contains("--position-noise is ") != valid,
            "{}",
            answer.verdict
        );
    }
    for (name, at, least) in [("ki", 1, 0.1), ("ks", 2, 0.4), ("ki/κ", 3, 0.4), ("ks/κ", 4, 0.1)] {
        let mean = answers.iter().map(|answer| answer.operating[at].value).sum::<f64>() / 5.0;
        let estimates = answers.iter().map(|answer| answer.operating[at]);
        let square = estimates.map(|estimate| ((estimate.value - mean) / estimate.total_std).powi(2));
        let rms = (square.sum::<f64>() / 4.0).sqrt();
        assert!((least..1.5).contains(&rms), "{name}: scatters by {rms} stated deviations");
    }
    assert_eq!(axial::agreement(&answers), None);
    let check = answers[0].check(&answers[4]);
    for [ahead_s, foreign_m, own_m] in check.errors {
        assert!(foreign_m < 1.25 * own_m && own_m < 40e-6, "{ahead_s} s ahead: {foreign_m} m, own {own_m} m");
    }
}

/// A mass levitated by one or two magnets: Runge–Kutta with twenty steps per sample, a controller on noisy readings, amplifiers with a lag.
struct Levitation {
    lambda: [f64; 2],
    gap_m: f64,
    load_n: f64,
    dynamics: f64,
    bias_a: f64,
    /// Lag of the amplifiers, s.
    lag_s: f64,
    /// Whether the controller differentiates its readings instead of using the true speed.
    differences: bool,
    /// The reference position, m, at a time, s.
    path_m: fn(f64) -> f64,
    seed: u64,
}

/// A smooth trajectory of ±2 mm.
fn smooth(time_s: f64) -> f64 {
    1.2e-3 * (0.7 * TAU * time_s).sin() + 0.8e-3 * (1.9 * TAU * time_s).sin()
}

/// A square wave of ±1.5 mm.
fn square(time_s: f64) -> f64 {
    1.5e-3 * (1.1 * TAU * time_s).sin().signum()
}

/// A slow trajectory of ±2 mm.
fn slow(time_s: f64) -> f64 {
    2e-3 * (0.4 * TAU * time_s).sin()
}

const MASS_KG: f64 = 0.1;
const STEP_S: f64 = 1e-3;

const ONE: Levitation = Levitation {
    lambda: [0.0, 1e-4],
    gap_m: 0.012,
    load_n: 0.981,
    dynamics: 1.0,
    bias_a: 0.0,
    lag_s: 3e-3,
    differences: false,
    path_m: smooth,
    seed: 1,
};
const TWO: Levitation = Levitation { lambda: [1e-4, 1.2e-4], load_n: 0.0, bias_a: 1.0, seed: 2, ..ONE };

impl Levitation {
    fn acceleration(&self, [x, _]: [f64; 2], i: [f64; 2]) -> f64 {
        let pull = [i[0] / (self.gap_m - x), i[1] / (self.gap_m + x)];
        let force = self.lambda[0] * pull[0] * pull[0] - self.lambda[1] * pull[1] * pull[1];
        (self.load_n + force) / (self.dynamics * MASS_KG)
    }

    /// Rows of time, position, both currents.
    fn record(&self, rows: usize) -> Vec<[f64; 4]> {
        let mut random = Random::new(self.seed);
        let mut normal = |std: f64| std * (0..12).map(|_| random.between(-0.5, 0.5)).sum::<f64>();
        let hold = |x: f64| (self.load_n / self.lambda[1]).sqrt() * (self.gap_m + x);
        let (mut state, mut i) = ([0.0, 0.0], if self.bias_a == 0.0 { [0.0, hold(0.0)] } else { [self.bias_a; 2] });
        let (mut out, mut filtered) = (Vec::new(), 0.0);
        for row in 0..rows {
            let reading = [state[0] + normal(10e-6), (i[0] + normal(5e-3)).max(0.0), i[1] + normal(5e-3)];
            out.push([row as f64 * STEP_S, reading[0], reading[1], reading[2]]);
            let error = reading[0] - (self.path_m)(STEP_S * row as f64);
            let change = 0.2 * (reading[0] - filtered);
            filtered += change;
            let pull = 500.0 * error + 8.0 * if self.differences { change / STEP_S } else { state[1] };
            let command = match self.bias_a {
                0.0 => [0.0, (hold(reading[0]) + 0.6 * pull / hold(0.0)).clamp(0.0, 5.0)],
                bias => [bias - 0.3 * pull, bias + 0.3 * pull].map(|i: f64| i.clamp(0.0, 5.0)),
            };
            for _ in 0..20 {
                let h = STEP_S / 20.0;
                for k in 0..2 {
                    i[k] += h / self.lag_s * (command[k] - i[k]);
                }
                state = runge_kutta(&state, 0.0, h, |_, s| [s[1], self.acceleration(*s, i)]);
            }
            assert!(state[0].abs() < 0.8 * self.gap_m, "the controller holds the mass: {state:?} in row {row}");
        }
        out
    }

    fn axis(&self) -> Axis {
        if self.lambda[0] == 0.0 {
            return Axis { at_m: Some(0.0), ..below_one_magnet(MASS_KG, self.load_n) };
        }
        let mut axis = Axis { m_kg: MASS_KG, used: vec![0, 1], at_m: Some(0.0), ..Axis::default() };
        axis.known[index("s")] = Some(self.gap_m);
        axis
    }

    fn answer(&self, rows: &[[f64; 4]]) -> (Answer, Vec<String>) {
        let mut text = String::from("time [s],Xm [m],im[1] [A],im[2] [A]\n");
        for row in rows {
            let cells = row.map(|value| if value.is_nan() { String::new() } else { value.to_string() });
            text += &format!("{}\n", cells.join(","));
        }
        let axis = self.axis();
        let recording = Samples::read(text.as_bytes(), &reading(&axis.used, &[])).expect("a good recording");
        (axial::answer(&axis, &recording).expect("an answer"), recording.notes)
    }

    /// The answer to these rows, which must be valid and correct, and the notes on the recording.
    fn right_answer(&self, what: &str, rows: &[[f64; 4]]) -> (Answer, Vec<String>) {
        let (answer, notes) = self.answer(rows);
        assert!(answer.valid, "{what}: {}", answer.verdict);
        for (k, lambda) in &answer.lambda {
            is_near(&format!("{what}: λ{}", k + 1), lambda, self.lambda[*k], 4.0);
        }
        is_near(&format!("{what}: κ"), &answer.dynamics, self.dynamics, 4.0);
        (answer, notes)
    }
}

/// With an exact law none of the effects of real benches is reported. A factor between statics and dynamics is found with its sign.
#[test]
fn a_simulation_shows_only_its_own_effects() {
    for (what, mass) in [("one magnet", ONE), ("two magnets", TWO), ("κ = 1.2", Levitation { dynamics: 1.2, ..ONE })] {
        let (answer, _) = mass.right_answer(what, &mass.record(8000));
        let findings = answer.findings.join(" ");
        assert_eq!(findings.contains("weaker than the law"), mass.dynamics > 1.0, "{what}: {findings}");
        for absent in ["stronger", "wanders", "start at rest"] {
            assert!(!findings.contains(absent), "{what}: {findings}");
        }
    }
}

/// A reference that jumps makes the currents jump; this is not mistaken for a slow force. On a slow trajectory the control currents are smaller than
/// their noise and are inferred from the positions that the controller reads; otherwise κ would be several deviations too large.
#[test]
fn jumps_and_currents_below_the_noise_do_not_mislead() {
    let jumping = Levitation { lag_s: 8e-3, path_m: square, dynamics: 1.1, seed: 11, ..ONE };
    let slowly = Levitation { lag_s: 2e-3, differences: true, path_m: slow, seed: 21, ..ONE };
    for (mass, rows) in [(&jumping, 10_000), (&slowly, 8000), (&Levitation { seed: 22, ..slowly }, 8000)] {
        mass.right_answer(&format!("seed {}", mass.seed), &mass.record(rows));
    }
}

#[test]
fn readings_in_another_unit_are_refused() {
    let mut samples = recording(RUNS[0]);
    let mut in_mm = samples.clone();
    in_mm.position_m[0].iter_mut().for_each(|x_m| *x_m *= 1e3);
    assert_contains(&in_mm.implausible(&[f64::INFINITY]).join("\n"), &["beyond any gap", "--unit Xm=mm"]);
    assert_eq!(samples.implausible(&[f64::INFINITY]), [""; 0]);
    samples.current_a[1].iter_mut().for_each(|current| *current *= 1e3);
    assert_contains(&samples.implausible(&[f64::INFINITY]).join("\n"), &["im[2]", "--unit im[2]=mA"]);
}

/// Exchanged columns, a reversed axis and a dead sensor are named.
#[test]
fn mistakes_are_named() {
    type Spoil = fn([f64; 4]) -> [f64; 4];
    let rows = TWO.record(3000);
    let cases: [(Spoil, &str); 3] = [
        (|[t, x, a, b]| [t, x, b, a], "or if the magnets are exchanged"),
        (|[t, x, a, b]| [t, -x, a, b], "x is mirrored"),
        (|[t, x, a, _]| [t, x, a, 1.0], "im[2] is 1 A throughout"),
    ];
    for (spoil, words) in cases {
        let (answer, _) = TWO.answer(&rows.iter().map(|row| spoil(*row)).collect::<Vec<_>>());
        let first = answer.findings.first().cloned().unwrap_or_default();
        assert!(!answer.valid && first.contains(words), "{words}: {} {:?}", answer.verdict, answer.findings);
        assert!(answer.verdict.contains(words) || words.contains("throughout"), "{words}: {}", answer.verdict);
    }
    let fast = Levitation { lag_s: 1e-4, ..TWO };
    let words = "Not valid: the data fit better if the currents are those before the sample";
    assert_contains(&fast.answer(&fast.record(3000)).0.verdict, &[words]);
}

/// Missing rows and sensor faults are excluded and named.
#[test]
fn faults_are_left_out_and_named() {
    let rows = ONE.record(8000);
    let held = rows[3000][1];
    let random = |at: usize| (at as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 11;
    let lost =
        |at: usize, row: [f64; 4]| if random(at) % 5 == 0 { [row[0], f64::NAN, f64::NAN, f64::NAN] } else { row };
    // A change of time, position and currents of a row.
    type Spoil<'a> = &'a dyn Fn(usize, [f64; 4]) -> [f64; 4];
    let cases: [(&str, Spoil<'_>, &str); 4] = [
        ("20 % missing", &lost, "lack a position or a current"),
        ("stuck", &|at, [t, x, a, b]| [t, if (3000..3400).contains(&at) { held } else { x }, a, b], "stuck at"),
        ("outliers", &|at, [t, x, a, b]| [t, if at % 997 == 500 { x + 2e-3 } else { x }, a, b], "outliers"),
        ("clipped", &|_, [t, x, a, b]| [t, x, a, b.min(1.6)], ""),
    ];
    for (what, spoil, note) in cases {
        let spoilt: Vec<_> = rows.iter().enumerate().map(|(at, row)| spoil(at, *row)).collect();
        let (_, notes) = ONE.right_answer(what, &spoilt);
        assert!(notes.join(" ").contains(note), "{what}: {notes:?}");
    }
    // Where the current repeats as well, the whole row is left out first; the position is stuck all the same.
    let coarse = |current: f64| 0.02 * (current / 0.02).round();
    let stuck = |(at, [t, x, a, b]): (usize, &[f64; 4])| {
        [*t, if (3000..3400).contains(&at) { held } else { *x }, *a, coarse(*b)]
    };
    let (_, notes) = ONE.answer(&rows.iter().enumerate().map(stuck).collect::<Vec<_>>());
    assert_contains(&notes.join(" "), &["Xm: stuck at", "from 3 s to 3.39"]);
}

/// A disagreement between the λ of two recordings is reported.
#[test]
fn recordings_that_differ_are_reported() {
    let other = Levitation { lambda: [0.0, 1.3e-4], seed: 5, ..ONE };
    let again = Levitation { seed: 6, ..ONE };
    let [one, two, again] = [&ONE, &other, &again].map(|mass| mass.answer(&mass.record(8000)).0);
    assert_contains(&axial::agreement([&one, &two]).expect("they differ"), &["The recordings differ", "by", "%"]);
    assert_eq!(axial::agreement([&one, &again]), None);
}

/// The documented command: its JSON, the scenario it saves, and its refusals.
#[test]
fn the_command() {
    let folder = folder("axial");
    std::fs::copy(file("mpc"), folder.join("mpc.csv.gz")).expect("a file");
    let bench = "--machine axial --set magnets.used=second --set m=60.54g";
    let load = "--set pX=0.5939N --column Xm=z --column im[2]=i1 --estimate s --at Xm=10mm";
    let arguments = format!("mpc.csv.gz {bench} {load} --save found.toml --report report --csv rows.csv");
    let json = identified(&folder, &words(&arguments));
    for name in ["current", "ki", "kiStdTotal", "ks", "ksStdTotal", "dynamics"] {
        assert!(json["operatingPoint"][name].is_f64(), "{name}: {json}");
    }
    assert_contains(&read(&folder, "rows.csv"), &["time [s],Xm [m],Xm.predictionError [m],force.slow [N]"]);
    // A gain of the current scales ki, and linear is the usual meaning of the currents.
    let more = "--tolerance current.gain=3% --tolerance sensor.offset=5um --hold linear";
    let wide = identified(&folder, &words(&format!("mpc.csv.gz {bench} {load} {more}")));
    let of = |json: &Json, name: &str| program::number(&json["operatingPoint"][name]);
    let widened = of(&json, "kiStdTotal").hypot(0.03 * of(&json, "ki"));
    below("± with a tolerance", (of(&wide, "kiStdTotal") / widened - 1.0).abs(), 0.02);
    let page = read(&folder, "report/index.html");
    assert_contains(&page, &["<figure id=\"recorded\">", "<figure id=\"slow\">", "ki/κ"]);
    // The saved answer agrees up to rounding.
    let again = identified(&folder, &words("mpc.csv.gz --scenario found.toml"));
    assert_contains(&again["verdict"].to_string(), &["nothing was identified"]);
    below("ki of the saved scenario", (of(&json, "ki") / of(&again, "ki") - 1.0).abs(), 1e-3);
    let far = identified(&folder, &words(&arguments.replace("Xm=10mm", "Xm=30mm")));
    assert_contains(&far["findings"].to_string(), &["x = 30 mm is outside the positions of the recording"]);
    assert!(!json["findings"].to_string().contains("outside"), "{json}");
    let beyond = format!("{bench} {load}").replace("Xm=10mm", "Xm=-1m");
    let pulls = format!("{bench} {load} --set pX=-1N");
    for (arguments, words) in [
        ("--machine axial", &["m is missing"][..]),
        ("--machine axial --set m=1kg --set lambda[3]=1", &["lambda[3] is no parameter of this machine; did you"]),
        ("--machine axial --set m=-1kg --speed 3", &["above 0", "no --speed"]),
        ("--machine axial --set m=1kg", &["Xm: no column"]),
        ("--at Xm=1mm", &["--at needs --machine axial"]),
        ("--machine axial --set m=1kg --estimate m --tolerance s=1%", &["m: it cannot be", "missing, --set s="]),
        (&beyond, &["--at Xm=-1000mm: the gap of magnet 2 would be", "positions from"]),
        (&pulls, &["pX = -1 N pulls where magnet 2 pulls as well"]),
    ] {
        refuses(&folder, &self::words(&format!("identify mpc.csv.gz {arguments}")), words);
    }
}
