//! Reading recordings: times, rates, encodings, separators, units, headers, misread units.

use crate::prelude::*;
use std::io::Write;

use magnetic_bearing::studies::identify::{Unusable, quantity, rate_s};

/// A recording of an orbit with uniformly distributed noise of 0.1 µm and 10 mA.
struct Bench {
    rows: usize,
    omega_rad_s: f64,
    step_s: f64,
}

const BENCH: Bench = Bench { rows: 10_001, omega_rad_s: 100.0 * std::f64::consts::PI, step_s: 1e-4 };

impl Bench {
    /// Time, positions, currents, unwrapped angle and speed of every row, in SI units.
    fn values(&self) -> Vec<[f64; 8]> {
        let mut random = Random::new(12);
        let mut noise = |size: f64| random.between(-size, size) * 3.0_f64.sqrt();
        let row = |j: usize| {
            let time = j as f64 * self.step_s;
            let theta = 0.3 + self.omega_rad_s * time;
            let [y, z] = [30e-6 * theta.cos() + noise(1e-7), 70e-6 * theta.sin() + noise(1e-7)];
            let mut current = |k: f64| 1.5 + 0.4 * (theta + k).sin() + noise(1e-2);
            [time, y, z, current(0.0), current(2.0), current(4.0), theta, self.omega_rad_s]
        };
        (0..self.rows).map(row).collect()
    }

    /// A table with the given time stamps; rows without one are dropped.
    fn with_times(&self, header: &str, time: impl Fn(usize) -> Option<String>) -> String {
        let mut text = format!("{header},Ym [m],Zm [m],im[1] [A],im[2] [A],im[3] [A],theta [rad]\n");
        for (j, [_, y, z, a, b, c, theta, _]) in self.values().into_iter().enumerate() {
            if let Some(time) = time(j) {
                text += &format!("{time},{y:e},{z:e},{a:.4},{b:.4},{c:.4},{theta:.6}\n");
            }
        }
        text
    }
}

/// Compressed by gzip.
fn zipped(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).and_then(|()| encoder.finish()).expect("a vector takes everything")
}

/// Uniformly distributed over ±`size`.
fn jitter(seed: u64, rows: usize, size: f64) -> Vec<f64> {
    let mut random = Random::new(seed);
    (0..rows).map(|_| random.between(-size, size)).collect()
}

/// The stamp of a row; none if the row was lost.
type Stamp<'a> = &'a dyn Fn(usize) -> Option<String>;

/// A number with this many decimals.
fn text(decimals: usize, number: f64) -> Option<String> {
    Some(format!("{number:.decimals$}"))
}

/// The instant of a row, s.
fn at(row: usize) -> f64 {
    1e-4 * row as f64
}

#[test]
fn the_sample_time_is_the_slope_of_a_line_through_the_stamps() {
    let rows = BENCH.rows;
    let jittered = jitter(1, rows, 5e-6);
    let jittered = |j: usize| text(7, at(j) + jittered[j]);
    let mut lost = jitter(5, rows, 1.0);
    // The first and the last row are not lost.
    (lost[0], lost[rows - 1], lost[(rows - 1) / 7]) = (1.0, 1.0, 1.0);
    let late: Vec<f64> = jitter(2, rows, 1.0).iter().map(|u| 2e-6 * -(0.5 + 0.5 * u).max(1e-9).ln()).collect();
    let epoch = 1_763_735_894_u64;
    let seconds = |j: usize| format!("{epoch}.{:04}", j % 10_000 + j / 10_000 * 9999);
    let civil = |j: usize, places: usize| {
        let ns = 100_000 * j as u64;
        let fraction = format!("{:09}", ns % 1_000_000_000);
        format!("2026-11-21T14:38:{:02}.{}", 14 + ns / 1_000_000_000, &fraction[..places])
    };
    let missing = "rows are missing at";
    let holes = "103 rows are missing at 103";
    let hole = "3500 rows are missing at 1 place after line 501";
    let from = "counts from 2026-11-21T14:38:14.000000";
    let ms_9600 = |j: usize| j as f64 / 9.6;
    let stray = |j: usize| if j % 1000 == 7 { 99.0 } else { at(j) };
    // Description, header, stamps, sample time, samples, words among the notes.
    let cases: [(&str, &str, Stamp, f64, usize, &str); 26] = [
        ("exact", "time [s]", &|j| text(4, at(j)), 1e-4, rows, ""),
        ("5 µs of jitter", "time [s]", &jittered, 1e-4, rows, "scatter by 2.9 µs"),
        ("latency", "time [s]", &|j| text(7, at(j) + late[j]), 1e-4, rows, "scatter"),
        ("10 µs rounding", "time [s]", &|j| text(5, at(j) * 1.0417), 1.0417e-4, rows, ""),
        ("1 ms rounding", "time [s]", &|j| text(3, at(j) + 3e-5), 1e-4, rows, "rounded to 1 ms"),
        ("1 ms, 9600 Hz", "time [ms]", &|j| text(0, ms_9600(j)), 1.0 / 9600.0, rows, "rounded"),
        ("0.1 ms, 9600 Hz", "time [ms]", &|j| text(1, ms_9600(j)), 1.0 / 9600.0, rows, "rounded"),
        ("a clock of 1/64 s", "time [s]", &|j| text(6, (64.0 * at(j)).floor() / 64.0), 1e-4, rows, "rounded"),
        ("0.1 s rounding", "time [s]", &|j| text(1, at(j) + 0.037), 1e-4, rows, "at which they change"),
        ("epoch in s", "time [s]", &|j| Some(seconds(j)), 1e-4, 10_000, ""),
        ("epoch in ms", "time", &|j| Some(format!("{}.{}", epoch * 1000 + j as u64 / 10, j % 10)), 1e-4, rows, "in ms"),
        ("epoch in µs", "time [µs]", &|j| Some((epoch * 1_000_000 + 100 * j as u64).to_string()), 1e-4, rows, "Unix"),
        ("epoch in ns", "t", &|j| Some((epoch * 1_000_000_000 + 100_000 * j as u64).to_string()), 1e-4, rows, "Unix"),
        ("ISO", "time", &|j| Some(civil(j, 6)), 1e-4, rows, from),
        ("ISO, zone, 1 ms", "time", &|j| Some(civil(j, 3) + "+01:00"), 1e-4, rows, "rounded to 1 ms"),
        ("ISO, blank", "time", &|j| Some(civil(j, 4).replace('T', " ")), 1e-4, rows, ""),
        ("time of day", "time", &|j| Some(civil(j, 4)[11..].into()), 1e-4, rows, ""),
        ("dropped rows", "time [s]", &|j| text(4, at(j)).filter(|_| j % 97 != 50), 1e-4, rows, holes),
        ("dropped, jitter", "time [s]", &|j| jittered(j).filter(|_| j % 97 != 50), 1e-4, rows, holes),
        ("a long hole", "time [s]", &|j| jittered(j).filter(|_| !(500..4000).contains(&j)), 1e-4, rows, hole),
        ("3 % lost", "time [s]", &|j| text(4, at(j)).filter(|_| lost[j] > -0.94), 1e-4, rows, missing),
        ("40 % lost, jitter", "time [s]", &|j| jittered(j).filter(|_| lost[j] > -0.2), 1e-4, rows, missing),
        ("bursts", "time [s]", &|j| text(5, 1.0417 * at(j)).filter(|_| lost[j / 7] > -0.5), 1.0417e-4, rows, missing),
        ("outliers", "time [s]", &|j| text(4, stray(j)), 1e-4, rows, "in lines 9, 1009"),
        ("stuck", "time [s]", &|j| text(4, at(if j == 70 { 69 } else { j })), 1e-4, rows, "line 72 replaced"),
        ("from 12 s on", "time [s]", &|j| text(4, 12.0 + at(j)), 1e-4, rows, ""),
    ];
    for (name, header, stamp, step_s, count, words) in cases {
        let samples = Samples::read(BENCH.with_times(header, stamp).as_bytes(), &Reading::default());
        let samples = samples.unwrap_or_else(|error| panic!("{name}: {error}"));
        // Over the whole recording the error stays below a fraction of a sample.
        let error = (samples.step_s / step_s - 1.0).abs() * count as f64;
        assert!(error < 0.05, "{name}: {} s, off by {error:.3} samples at the end", samples.step_s);
        assert_eq!(samples.len(), count, "{name}: {:?}", samples.notes);
        assert!(samples.notes.iter().any(|note| note.contains(words)), "{name}: {words} in {:?}", samples.notes);
        assert_eq!(samples.implausible(&[5e-4]), [""; 0], "{name}");
    }
}

#[test]
fn stamps_that_contradict_a_constant_rate_are_refused_and_named() {
    let rows = BENCH.rows;
    let (wild, lost) = (jitter(3, rows, 4e-5), jitter(4, rows, 1.0));
    let back = "time does not rise by a sample in line 6003, first from 600 ms to 100 µs";
    let one_back = |j: usize| match j {
        0..80 => at(j),
        80 => at(40),
        _ => at(j - 1),
    };
    let slower = |j: usize| at(j) + 2e-6 * (j as f64 - 5000.0).max(0.0);
    let jump = "time jumps from 900 ms in line 9002 to 1000.9 s in line 9003";
    let soon = |j: usize| if j == 40 { Some("soon".into()) } else { text(4, at(j)) };
    let uneven = "and no rounding explains it";
    let of_unix = ["a Unix time in ms?", "--unit time=ms"];
    let cases: [(&str, Stamp, &[&str]); 10] = [
        ("twice", &|j| text(4, at(j - usize::from(j > 70))), &["in line 73, first from 7 ms to 7 ms"]),
        ("back", &|j| text(4, at(if j > 6000 { j - 6000 } else { j })), &[back]),
        ("one row back", &|j| text(4, one_back(j)), &["in line 82, first from"]),
        ("two paces", &|j| text(7, slower(j)), &["contradict", "100 µs in the first tenth, 102 µs in the last"]),
        ("wild", &|j| text(7, at(j) + wild[j]), &["contradict an even pace", "straight line"]),
        ("rounded and lost", &|j| text(3, at(j)).filter(|_| lost[j] < 0.8), &[uneven]),
        ("not rising", &|_| text(0, 1.0), &["time does not rise"]),
        ("a jump", &|j| text(4, at(j) + if j > 9000 { 1000.0 } else { 0.0 }), &[jump]),
        ("no stamp", &soon, &["line 42, time: \"soon\" is no time"]),
        ("ms are no s", &|j| Some(format!("{}", 1_763_735_894_000 + j / 10)), &of_unix),
    ];
    for (name, stamp, words) in cases {
        let text = BENCH.with_times("time [s]", stamp);
        for text in [text.replace('\n', "\r\n"), text] {
            let error = Samples::read(text.as_bytes(), &Reading::default()).expect_err(name).to_string();
            assert_contains(&error, words);
            assert!(!error.contains("--resample"), "{name}: {error}");
        }
    }
}

#[test]
fn a_rate_may_be_stated() {
    let read = |text: &str, rate: &str| {
        let rate_s = (!rate.is_empty()).then(|| rate_s(rate).expect("a rate"));
        Samples::read(text.as_bytes(), &Reading { rate_s, ..Reading::default() })
    };
    let refused = |text: &str, rate: &str| read(text, rate).expect_err("refused").to_string();
    let none = BENCH.with_times("Nr", |j| Some(j.to_string()));
    assert_contains(&refused(&none, ""), &["--rate"]);
    let samples = read(&none, "10kHz").expect("a usable recording");
    assert_eq!((samples.step_s, samples.len(), samples.start_s), (1e-4, BENCH.rows, 0.0));
    let counted = BENCH.with_times("time", |j| Some(j.to_string()));
    let implausible = read(&counted, "").expect("a usable recording").implausible(&[5e-4]).join("\n");
    assert_contains(&implausible, &["a sample every 1 s", "if these are numbers of samples, --rate=…"]);
    let samples = read(&counted, "10kHz").expect("a usable recording");
    assert_eq!((samples.step_s, samples.len()), (1e-4, BENCH.rows));
    let stamps = BENCH.with_times("time [s]", |j| text(7, 1.0001 * at(j)));
    assert_eq!(read(&stamps, "10 kHz").expect("clocks may differ").step_s, 1e-4);
    assert_contains(&refused(&stamps, "9600 Hz"), &["104.1667 µs apart, the time stamps 100.01 µs"]);
    // A single change of the stamps does not determine the rate.
    let coarse = BENCH.with_times("time [s]", |j| text(0, at(j)));
    assert_contains(&refused(&coarse, ""), &["rounded to 1 s in", "known to 50 % only; give --rate"]);
    assert_eq!(read(&coarse, "10kHz").expect("a usable recording").step_s, 1e-4);

    for (text, step_s) in
        [("10kHz", 1e-4), ("9600 Hz", 1.0 / 9600.0), ("1e4Hz", 1e-4), ("51.2 kHz", 1.0 / 51_200.0), ("1MHz", 1e-6)]
    {
        assert_eq!(rate_s(text), Ok(step_s), "{text}");
    }
    for (text, step_s) in
        [("100us", 1e-4), ("100 µs", 1e-4), ("0.1ms", 1e-4), ("1e-4", 1e-4), ("1e-4 s", 1e-4), ("50000ns", 5e-5)]
    {
        assert_eq!(quantity("--step", text, "s"), Ok(step_s), "{text}");
    }
    for text in ["10", "10 MHz 3", "kHz", "-1kHz", "0Hz", "infHz", "10mHz"] {
        assert!(rate_s(text).is_err(), "{text}");
    }
    for text in ["", "us", "1 kg", "inf"] {
        assert!(quantity("--step", text, "s").is_err(), "{text}");
    }
}

#[test]
fn encodings_separators_and_decimal_commas() {
    let plain = BENCH.values();
    let header = "Zeit [ms];Weg y [µm];Weg z [µm];im1 [A];im2 [A];im3 [A];Winkel [°]";
    let mut text = format!("# Prüfstand, Maß 7\nAbtastrate;10 kHz\n\n{header}\r\n");
    for [time, y, z, a, b, c, theta, _] in plain.iter().take(2000) {
        let cells = [time * 1e3, y * 1e6, z * 1e6, *a, *b, *c, theta.to_degrees() % 360.0];
        let cells = cells.map(|cell| format!("{cell:.4}").replace('.', ","));
        text += &format!("{}\r\n", cells.join(";"));
    }
    let columns = pairs(&[("time", "Zeit"), ("Ym", "Weg y"), ("Zm", "Weg z"), ("theta", "Winkel")]);
    let reading = Reading { columns, ..Reading::default() };
    let sixteen = |order: fn(u16) -> [u8; 2], mark: bool| -> Vec<u8> {
        let mark = mark.then_some(0xfeff);
        mark.into_iter().chain(text.encode_utf16()).flat_map(order).collect()
    };
    let below = "Zeit;Weg y;Weg z;im1;im2;im3;Winkel\nms;[µm];µm;(A);A;A;deg";
    for (name, bytes) in [
        ("UTF-8", text.clone().into_bytes()),
        ("UTF-8 with mark", [b"\xef\xbb\xbf", text.as_bytes()].concat()),
        ("UTF-16 LE with mark", sixteen(u16::to_le_bytes, true)),
        ("UTF-16 BE with mark", sixteen(u16::to_be_bytes, true)),
        ("UTF-16 LE", sixteen(u16::to_le_bytes, false)),
        ("UTF-16 BE", sixteen(u16::to_be_bytes, false)),
        ("Latin-1", text.chars().map(|c| u8::try_from(c).expect("Latin-1")).collect()),
        ("tabs", text.replace(';', "\t").into()),
        ("commas", text.replace(',', ".").replace(';', ",").into()),
        ("row of units", text.replace(header, below).into()),
        ("header in a remark", text.replace(header, &format!("# {header}")).into()),
        ("torn", text.as_bytes()[..text.len() - 25].to_vec()),
        ("gzip", zipped(text.as_bytes())),
        ("gzip, UTF-16 LE", zipped(&sixteen(u16::to_le_bytes, true))),
    ] {
        let samples = Samples::read(bytes.as_slice(), &reading).unwrap_or_else(|error| panic!("{name}: {error}"));
        let count = if name == "torn" { 1999 } else { 2000 };
        assert_eq!((samples.step_s, samples.len()), (1e-4, count), "{name}");
        let last = count - 1;
        assert!((samples.position_m[1][last] - plain[last][2]).abs() < 1e-10, "{name}");
        assert!((samples.theta_rad[last] - plain[last][6]).abs() < 1e-5, "{name}: {}", samples.theta_rad[last]);
        assert_eq!(samples.implausible(&[5e-4]), [""; 0], "{name}");
    }
    let whole = zipped(text.as_bytes());
    let error = Samples::read(&whole[..whole.len() / 2], &reading).expect_err("half a file").to_string();
    assert_contains(&error, &["the text cannot be read"]);
    // Decimal commas in a table that is separated by commas would shift the columns.
    let error = Samples::read(text.replace(';', ",").as_bytes(), &reading).expect_err("more cells than the header has");
    assert_contains(&error.to_string(), &["14 cells, the header has 7; decimal commas need another separator"]);
}

const NAMES: [&str; 8] = ["time", "Ym", "Zm", "im[1]", "im[2]", "im[3]", "theta", "omega"];
const SI: [&str; 8] = ["s", "m", "m", "A", "A", "A", "rad", "rad/s"];

/// A table of some of the signals, with values divided by their factors.
fn table(signals: &[usize], units: [&str; 8], factors: [f64; 8], values: &[[f64; 8]]) -> String {
    let line = |cell: &dyn Fn(usize) -> String| signals.iter().map(|at| cell(*at)).collect::<Vec<_>>().join(";") + "\n";
    let head = line(&|at| format!("{} [{}]", NAMES[at], units[at]));
    head + &values.iter().map(|row| line(&|at| format!("{:e}", row[at] / factors[at]))).collect::<String>()
}

/// The samples of these signals of the bench after a change of its values; NaN leaves a cell empty.
fn changed(rows: usize, signals: &[usize], change: impl FnOnce(&mut [[f64; 8]])) -> Result<Samples, Unusable> {
    let mut values = Bench { rows, ..BENCH }.values();
    change(&mut values);
    let text = table(signals, SI, [1.0; 8], &values).replace("NaN", "");
    Samples::read(text.as_bytes(), &Reading::default())
}

/// All signals, and those of a recording without the speed.
const ALL: [usize; 8] = [0, 1, 2, 3, 4, 5, 6, 7];
const WITHOUT_SPEED: &[usize] = &[0, 1, 2, 3, 4, 5, 6];

/// Every unit by every name, in the header or stated.
#[test]
fn units_have_many_names() {
    // Signal, and units by their size in SI.
    let cases: [(usize, &str); 7] = [
        (0, "1: s, sec, Second; 1e-3: ms; 1e-6: µs, us, μs; 1e-9: ns"),
        (1, "1: m; 1e-3: mm; 1e-6: µm, um, Micron, micrometer; 1e-9: nm; 25.4e-6: mil, Mil"),
        (1, "25e-6: 25um/V, 0.025 mm/V, 25 µm; -25e-9: -25nm/mV, -25nm; 1.2706480e-4: 7.87V/mm, 7.87 V / mm"),
        (3, "1e-2: 100mV/A; 1: A, Amps, Ampere; 1e-3: mA"),
        (6, "1: rad; 0.017453293: deg, °, Deg, º, Grad; 6.2831853: rev"),
        (7, "1: rad/s, rad / s, rad/sec; 6.2831853: Hz, rev/s, rps; 0.017453293: deg/s, °/s; 5: 5rad/s/V, 0.2V/rad/s"),
        (7, "0.10471976: rpm, RPM, 1/min, U/min, min-1, min^-1, min⁻¹, min−1, u/min, Upm"),
    ];
    let named = |(at, units): (usize, &'static str)| {
        let each = units.split("; ").filter_map(|of| of.split_once(": "));
        each.flat_map(move |(size, names)| names.split(", ").map(move |unit| (at, unit, size.parse().expect("a size"))))
    };
    let values = Bench { rows: 400, ..BENCH }.values();
    for ((at, unit, factor), stated) in cases.into_iter().flat_map(named).flat_map(|case| [(case, false), (case, true)])
    {
        let (mut header, mut factors) = (SI, [1.0; 8]);
        (header[at], factors[at]) = (if stated { "kg" } else { unit }, factor);
        let units = if stated { pairs(&[(NAMES[at], unit)]) } else { Vec::new() };
        let text = table(&ALL, header, factors, &values);
        let samples = Samples::read(text.as_bytes(), &Reading { units, ..Reading::default() });
        let samples = samples.unwrap_or_else(|error| panic!("{unit}: {error}"));
        let last = values.len() - 1;
        let read = match at {
            0 => samples.step_s * last as f64,
            1 => samples.position_m[0][last],
            3 => samples.current_a[0][last],
            6 => samples.theta_rad[last],
            _ => samples.omega_rad_s[last],
        };
        assert!((read / values[last][at] - 1.0).abs() < 1e-5, "{unit}: {read}, wanted {}", values[last][at]);
        assert_eq!(samples.implausible(&[5e-4]), [""; 0], "{unit}");
    }
    let bare = "time/ms,Ym in µm,Zm (mm),im[1] [mA],im[2] <A>,im[3] {A},theta [-]\n".to_owned();
    let rows: String =
        (0..40).map(|j| format!("{},{},{},{},1,1,0.{j:02}\n", 0.1 * f64::from(j), j % 7, 0.01, 1200)).collect();
    let samples = Samples::read((bare + &rows).as_bytes(), &Reading::default()).expect("a usable recording");
    assert_eq!((samples.step_s, samples.position_m[0][3], samples.current_a[0][3]), (1e-4, 3e-6, 1.2));
    assert_contains(&samples.notes.join("\n"), &["theta has no unit; it is taken to be in rad."]);
}

/// Probes in V and mV about their voltages in the centre, and a control current of two magnets about their bias.
#[test]
fn readings_of_sensors_are_calibrated() {
    let rows = (0..40).map(|j| format!("{:.4};{};{};{};1;0.{j:02}\n", at(j), -9.8 + 0.02 * at(j), 5e3, 0.1 + at(j)));
    let text = "t [s];probe y [V];probe z / mV;ic;i3 [A];theta [rad]\n".to_owned() + &rows.collect::<String>();
    let columns = [("Ym", "probe y"), ("Zm", "probe z"), ("im[1]", "ic"), ("im[2]", "ic"), ("im[3]", "i3")];
    let units = [("Ym", "-25um/V"), ("Zm", "8V/mm"), ("im[2]", "-1A")];
    let zeros = [("Ym", "-9.8"), ("Zm", "4.8e3"), ("im[1]", "-2"), ("im[2]", "2")];
    let read = |columns, units, zeros| {
        let [columns, units, zeros] = [columns, units, zeros].map(pairs);
        Samples::read(text.as_bytes(), &Reading { columns, units, zeros, ..Reading::default() })
    };
    let samples = read(&columns, &units, &zeros).expect("a usable recording");
    let row =
        [0, 1].map(|axis| samples.position_m[axis][30]).into_iter().chain((0..2).map(|k| samples.current_a[k][30]));
    for (value, wanted) in row.zip([-25e-6 * 6e-5, 25e-6, 2.103, 1.897]) {
        assert!((value - wanted).abs() < 1e-9 * wanted.abs().max(1e-3), "{value}, wanted {wanted}");
    }
    assert_contains(
        &samples.notes.join("\n"),
        &["Ym is (reading + 9.8) · -2.5e-5 m.", "im[2] is (reading − 2) · -1 A."],
    );
    let error = read(&columns, &[("Ym", "0V/mm")], &[("Zm", "V"), ("im[4]", "2")]).expect_err("no calibration");
    assert_contains(
        &error.to_string(),
        &[
            "the unit 0V/mm is none of m, mm, µm, nm, mil, nor a calibration, as in --unit Ym=25µm/V",
            "--zero Zm: expected a number",
            "--zero im[4]: im[4] is no signal",
            "im[1] and im[2]: both are column ic; expected one for each",
        ],
    );
}

#[test]
fn all_errors_of_a_header_are_reported_at_once() {
    let reading = Reading {
        columns: pairs(&[("theta", "Winkel"), ("Xm", "a")]),
        units: pairs(&[("im[2]", "kA")]),
        ..Reading::default()
    };
    let twice = Reading { columns: pairs(&[("Ym", "y"), ("Zm", "y")]), ..Reading::default() };
    for (text, reading, words) in [
        (
            "Zeit [min];a.Ym [m];b.Ym [m];Zm [furlong];im1 [A];im1 [A];i2 [V];Strom [A]\n1;2;3;4;5;6;7;8\n",
            &reading,
            &[
                "time (column Zeit): the unit min is none of s, ms, µs, ns",
                "Ym: several columns match this name: a.Ym, b.Ym; choose one: --column Ym=…",
                "Zm (column Zm): the unit furlong is none of m, mm, µm, nm, mil",
                "im[1]: several columns match this name: im1, im1; choose one: rename the others",
                "im[2] (column i2): the unit kA is none of A, mA",
                "im[3]: no column of this name, expected the current of magnet 3: --column im[3]=…",
                "--column theta=Winkel: there is no column Winkel",
                "--column Xm: Xm is no signal",
                "the header has the columns Zeit, a.Ym, b.Ym, Zm, im1, im1, i2, Strom",
            ][..],
        ),
        ("time,y,im1,im2,im3\n", &twice, &["Ym and Zm: both are column y"]),
        (
            "time;Ym;Z_m;im1;im_2;im3\n1;2;3;4;5;6\n",
            &Reading { units: pairs(&[("im[2]", "kA")]), ..Reading::default() },
            &[
                "Zm: no column of this name, expected the position along z: --column Zm=…; the nearest name is Z_m\n",
                "im[2]: no column of this name, expected the current of magnet 2: --column im[2]=…; the nearest name is im_2\n",
                "--unit im[2]=kA: expected one of A, mA",
            ],
        ),
        (
            "time [s];Ym [m];Zm [m];im1;im2;im3\ns;µm;m;A;A;A\n",
            &Reading::default(),
            &["Ym: the header says m, the row below it µm"],
        ),
    ] {
        assert_contains(&Samples::read(text.as_bytes(), reading).expect_err(text).to_string(), words);
    }
}

#[test]
fn sensors_that_are_not_connected_are_named() {
    let constant = |at: usize, value: f64| changed(400, &ALL, |rows| rows.iter_mut().for_each(|row| row[at] = value));
    for (at, value, words) in [
        (1, 12e-6, "Ym reads 12 µm throughout, while the currents vary: is the sensor connected?"),
        (2, 0.0, "Zm reads 0 µm throughout"),
        (4, 0.0, "im[2] is 0 throughout, which gives no information about magnet 2"),
    ] {
        let samples = constant(at, value).expect("a table of numbers");
        assert_contains(&samples.implausible(&[5e-4]).join("\n"), &[words]);
    }
    let unusable = constant(3, f64::NAN).expect_err("an empty column");
    assert_contains(&unusable.0.join("\n"), &["im[1]: the column contains no readings"]);
}

#[test]
fn what_a_logger_lost_is_left_out() {
    let good = Bench { rows: 2001, ..BENCH }.values();
    let half_turn = good.iter().position(|row| (row[6] - std::f64::consts::PI).abs() < 0.02).expect("a row");
    for (change, words) in [
        // Beyond its ends the angle is not known.
        (
            &(|rows: &mut [[f64; 8]]| rows[0][6] = f64::NAN) as &dyn Fn(&mut [[f64; 8]]),
            "1 row before the first or after the last",
        ),
        (&|rows| rows[1998..].iter_mut().for_each(|row| row[6] = f64::NAN), "3 rows before the first"),
        // A frame that was lost, with the angle and without.
        (&|rows| rows[700][1..].fill(0.0), "positions and currents are 0: line 702"),
        (&|rows| rows[700][1..6].fill(0.0), "positions and currents are 0: line 702"),
        // A glitch of the angle, also to the other side of the shaft.
        (&|rows| rows[800][6] = 0.0, "theta: an outlier at 80 ms"),
        (&|rows| rows[half_turn][6] = 0.0, "theta: an outlier at"),
        // An outlier on a slope.
        (&|rows| rows[900][1] += 2e-5, "Ym: an outlier at 90 ms"),
    ] {
        let samples = changed(good.len(), WITHOUT_SPEED, change).expect("a table of numbers");
        assert_contains(&samples.notes.join("\n"), &[words]);
        let first = (samples.start_s / samples.step_s).round() as usize;
        for (row, theta_rad) in samples.theta_rad.iter().enumerate() {
            assert!((theta_rad - good[first + row][6]).abs() < 1e-3, "{words}: {theta_rad} rad in row {row}");
        }
        for (row, position_m) in samples.position_m[0].iter().enumerate() {
            assert!((position_m - good[first + row][1]).abs() < 2e-6, "{words}: {position_m} m in row {row}");
        }
    }
}

#[test]
fn an_angle_missing_at_the_begin_is_left_out_without_times_too() {
    let mut values = Bench { rows: 401, ..BENCH }.values();
    values[..2].iter_mut().for_each(|row| row[6] = f64::NAN);
    let text = table(&WITHOUT_SPEED[1..], SI, [1.0; 8], &values).replace("NaN", "");
    let reading = Reading { rate_s: Some(1e-4), ..Reading::default() };
    let samples = Samples::read(text.as_bytes(), &reading).expect("a table of numbers");
    assert_contains(&samples.notes.join("\n"), &["2 rows before the first or after the last"]);
    assert_eq!((samples.len(), samples.start_s), (399, 2e-4));
    assert!(samples.theta_rad.iter().chain(&samples.omega_rad_s).all(|value| value.is_finite()));
}

#[test]
fn a_recorder_faster_than_the_controller_is_named() {
    let samples = changed(2001, WITHOUT_SPEED, |rows| {
        for at in 0..rows.len() {
            let held = rows[at / 3 * 3];
            rows[at][1..6].copy_from_slice(&held[1..6]);
        }
    });
    assert_contains(
        &samples.expect("a table of numbers").notes.join("\n"),
        &["repeat the previous row", "--resample 300µs"],
    );
}

#[test]
fn a_row_written_twice_is_excluded() {
    let text = BENCH.with_times("time [s]", |j| text(4, at(j)));
    let lines: Vec<&str> = text.lines().collect();
    let twice = [&lines[..500], &lines[499..]].concat().join("\n");
    let [once, twice] =
        [&text, &twice].map(|text| Samples::read(text.as_bytes(), &Reading::default()).expect("usable"));
    assert_contains(&twice.notes.join("\n"), &["repeat the previous row with its time: line 501"]);
    assert_eq!((once.position_m, once.start_s), (twice.position_m, twice.start_s));
}

/// A misread signal: index, true unit of its values, factor of that unit, and the unit in the header.
type Misread = (usize, &'static str, f64, &'static str);

const MISREAD: [Misread; 15] = [
    (0, "ms", 1e-3, "s"),
    (0, "µs", 1e-6, "s"),
    (0, "s", 1.0, "ms"),
    (0, "µs", 1e-6, "ms"),
    (1, "µm", 1e-6, "m"),
    (1, "µm", 1e-6, "mm"),
    (1, "m", 1.0, "µm"),
    (1, "mm", 1e-3, "µm"),
    (3, "mA", 1e-3, "A"),
    (3, "A", 1.0, "mA"),
    (6, "deg", std::f64::consts::PI / 180.0, "rad"),
    (6, "rev", std::f64::consts::TAU, "rad"),
    (6, "rad", 1.0, "deg"),
    (7, "rpm", std::f64::consts::PI / 30.0, "rad/s"),
    (7, "Hz", std::f64::consts::TAU, "rad/s"),
];

/// Findings on a recording with misread signals, with angle and speed or one of them.
fn suspected(bench: &Bench, misread: &[Misread], rotation: &[usize], wrapped: bool) -> Vec<String> {
    let (mut units, mut factors) = (SI, [1.0; 8]);
    for (signal, _, factor, unit) in misread {
        // All positions, or all currents.
        let end = [1, 3, 3, 6, 6, 6, 7, 8][*signal];
        for at in *signal..end {
            (units[at], factors[at]) = (unit, *factor);
        }
    }
    let mut values = bench.values();
    if wrapped {
        values.iter_mut().for_each(|row| row[6] %= std::f64::consts::TAU);
    }
    let signals = [&[0, 1, 2, 3, 4, 5], rotation].concat();
    let text = table(&signals, units, factors, &values);
    Samples::read(text.as_bytes(), &Reading::default()).expect("a table of numbers").implausible(&[5e-4])
}

/// A misread unit is detected at several sample times and speeds, with the angle, the speed or both.
#[test]
fn every_misread_unit_is_detected() {
    for (step_s, rpm, rows) in
        [(1e-4, 3000.0, 2000), (1e-4, 1000.0, 3000), (2e-5, 1000.0, 10_000), (5e-5, 7200.0, 2000), (1e-4, 6000.0, 2000)]
    {
        let bench = Bench { rows, omega_rad_s: rpm * std::f64::consts::PI / 30.0, step_s };
        for (rotation, wrapped) in [(&[6, 7][..], false), (&[6, 7], true), (&[6], false), (&[6], true), (&[7], false)] {
            let what = format!("{step_s} s, {rpm} rpm, {rotation:?}, wrapped {wrapped}");
            assert_eq!(suspected(&bench, &[], rotation, wrapped), [""; 0], "{what}");
            for misread in MISREAD.into_iter().filter(|(signal, ..)| *signal < 6 || rotation.contains(signal)) {
                let found = suspected(&bench, &[misread], rotation, wrapped);
                let (signal, unit, _, read_as) = misread;
                let proposal = format!("--unit {}={unit}", NAMES[signal]);
                let is_proposed = found.iter().any(|finding| finding.contains(&proposal));
                assert!(is_proposed, "{unit} read as {read_as}, {what}: {proposal} in {found:?}");
            }
        }
    }
}

/// A path whose speed is 0.42 of that of the rotor, which is four times as much as in rpm read as rad/s, is no misread speed.
#[test]
fn a_path_with_a_speed_of_its_own_is_no_misread_unit() {
    let samples = changed(6000, &[0, 1, 2, 3, 4, 5, 7], |rows| {
        for row in rows {
            let theta = row[6];
            row[1] = 0.3 * row[1] + 60e-6 * (0.42 * theta).cos();
            row[2] = 0.3 * row[2] + 60e-6 * (0.42 * theta).sin();
        }
    });
    assert_eq!(samples.expect("a table of numbers").implausible(&[5e-4]), [""; 0]);
}

/// Misread units do not hide each other.
#[test]
fn several_misread_units_are_detected() {
    let bench = Bench { rows: 1000, ..BENCH };
    for (n, one) in MISREAD.into_iter().enumerate() {
        for other in MISREAD[n + 1..].iter().filter(|other| other.0 != one.0) {
            let third =
                MISREAD[n + 1..].iter().filter(|third| third.0 > other.0).map(|third| vec![one, *other, *third]);
            for misread in [vec![one, *other]].into_iter().chain(third) {
                assert!(!suspected(&bench, &misread, &[6, 7], n % 2 == 0).is_empty(), "{misread:?}: nothing was found");
            }
        }
    }
}
