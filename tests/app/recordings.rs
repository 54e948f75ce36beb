//! Reading recordings: times, rates, encodings, separators, units, headers, and units that were misread.

use std::io::Write;

use magnetic_bearing::studies::identify::{Reading, Samples, duration_s, rate_s};

use crate::support::Random;

/// Speed of the rotor in the recordings below, in rad/s.
const OMEGA: f64 = 100.0 * std::f64::consts::PI;

/// A recording of an orbit at 10 kHz, whose time cells are told. 0.1 µm and 10 mA of noise, equally distributed.
struct Bench {
    rows: usize,
    omega_rad_s: f64,
    step_s: f64,
}

const BENCH: Bench = Bench { rows: 10_001, omega_rad_s: OMEGA, step_s: 1e-4 };

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

    /// A table with the given times; rows without one are dropped.
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

/// Equally distributed over ±`size`.
fn jitter(seed: u64, rows: usize, size: f64) -> Vec<f64> {
    let mut random = Random::new(seed);
    (0..rows).map(|_| random.between(-size, size)).collect()
}

/// The stamp of a row; none if the row was lost.
type Stamp<'a> = &'a dyn Fn(usize) -> Option<String>;

/// A number with so many decimals.
fn text(decimals: usize, number: f64) -> Option<String> {
    Some(format!("{number:.decimals$}"))
}

/// The instant of a row, s.
fn at(row: usize) -> f64 {
    1e-4 * row as f64
}

#[test]
fn the_pace_is_a_straight_line_through_the_stamps() {
    let rows = BENCH.rows;
    let jittered = jitter(1, rows, 5e-6);
    let jittered = |j: usize| text(7, at(j) + jittered[j]);
    let mut lost = jitter(5, rows, 1.0);
    // The first and the last row are there.
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
    let hole = "3500 rows are missing at 1 places, the first after line 501";
    let from = "counts from 2026-11-21T14:38:14.000000";
    let ms_9600 = |j: usize| j as f64 / 9.6;
    // Description, header, stamps, sample time, samples, words among the notes.
    let cases: [(&str, &str, Stamp, f64, usize, &str); 25] = [
        ("exact", "time [s]", &|j| text(4, at(j)), 1e-4, rows, ""),
        ("5 µs of jitter", "time [s]", &jittered, 1e-4, rows, "scatter by 2.9 µs"),
        ("latency", "time [s]", &|j| text(7, at(j) + late[j]), 1e-4, rows, "scatter"),
        ("10 µs rounding", "time [s]", &|j| text(5, at(j) * 1.0417), 1.0417e-4, rows, ""),
        ("1 ms rounding", "time [s]", &|j| text(3, at(j) + 3e-5), 1e-4, rows, "rounded to 1 ms"),
        ("1 ms, 9600 Hz", "time [ms]", &|j| text(0, ms_9600(j)), 1.0 / 9600.0, rows, "rounded"),
        ("0.1 ms, 9600 Hz", "time [ms]", &|j| text(1, ms_9600(j)), 1.0 / 9600.0, rows, "rounded"),
        ("a clock of 1/64 s", "time [s]", &|j| text(6, (64.0 * at(j)).floor() / 64.0), 1e-4, rows, "rounded"),
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
        (
            "outliers",
            "time [s]",
            &|j| text(4, if j % 1000 == 7 { 99.0 } else { at(j) }),
            1e-4,
            rows,
            "in lines 9, 1009",
        ),
        ("stuck", "time [s]", &|j| text(4, at(if j == 70 { 69 } else { j })), 1e-4, rows, "line 72 replaced"),
        ("from 12 s on", "time [s]", &|j| text(4, 12.0 + at(j)), 1e-4, rows, ""),
    ];
    for (name, header, stamp, step_s, count, words) in cases {
        let samples = Samples::read(&BENCH.with_times(header, stamp), &Reading::default());
        let samples = samples.unwrap_or_else(|error| panic!("{name}: {error}"));
        println!("{name}: {:?}", samples.notes);
        // The pace is known to a part of a sample over the whole recording.
        let off = (samples.step_s / step_s - 1.0).abs() * count as f64;
        assert!(off < 0.05, "{name}: {} s, off by {off:.3} samples at the end", samples.step_s);
        assert_eq!(samples.len(), count, "{name}: {:?}", samples.notes);
        assert!(samples.notes.iter().any(|note| note.contains(words)), "{name}: {words} in {:?}", samples.notes);
        assert_eq!(samples.implausible(&[5e-4]), [""; 0], "{name}");
    }
}

#[test]
fn stamps_that_contradict_an_even_pace_are_refused_and_named() {
    let rows = BENCH.rows;
    let (wild, lost) = (jitter(3, rows, 4e-5), jitter(4, rows, 1.0));
    let back = "time goes back at 1 places, the first in line 6003, from 600 ms to 100 µs";
    let one_back = |j: usize| match j {
        0..80 => at(j),
        80 => at(40),
        _ => at(j - 1),
    };
    let slower = |j: usize| at(j) + 2e-6 * (j as f64 - 5000.0).max(0.0);
    let jump = "time jumps from 900 ms in line 9002 to 1000.9 s in line 9003";
    let soon = |j: usize| if j == 40 { Some("soon".into()) } else { text(4, at(j)) };
    let cases: [(&str, Stamp, &[&str]); 9] = [
        ("twice", &|j| text(4, at(j - usize::from(j > 70))), &["line 73: the stamp of the row before", "7 ms"]),
        ("back", &|j| text(4, at(if j > 6000 { j - 6000 } else { j })), &[back]),
        ("one row back", &|j| text(4, one_back(j)), &["line 82: time goes back"]),
        ("two paces", &|j| text(7, slower(j)), &["contradict", "100 µs in the first tenth, 102 µs in the last"]),
        ("wild", &|j| text(7, at(j) + wild[j]), &["contradict an even pace", "straight line"]),
        (
            "rounded and lost",
            &|j| text(3, at(j)).filter(|_| lost[j] < 0.8),
            &["no even pace explains them as rounding"],
        ),
        ("not rising", &|_| text(0, 1.0), &["time does not rise"]),
        ("a jump", &|j| text(4, at(j) + if j > 9000 { 1000.0 } else { 0.0 }), &[jump]),
        ("no stamp", &soon, &["line 42, time: \"soon\" is no time"]),
    ];
    for (name, stamp, words) in cases {
        let text = BENCH.with_times("time [s]", stamp);
        let error = Samples::read(&text, &Reading::default()).expect_err(name).to_string();
        println!("{name}: {error}");
        for word in words {
            assert!(error.contains(word), "{name}: {word} in {error}");
        }
        assert!(!error.contains("--resample"), "{name}: {error}");
    }
    let text = BENCH.with_times("time [s]", |j| Some(format!("{}", 1_763_735_894_000 + j / 10)));
    let error = Samples::read(&text, &Reading::default()).expect_err("ms are no s").to_string();
    assert!(error.contains("a Unix time in ms?") && error.contains("--unit time=ms"), "{error}");
}

#[test]
fn a_rate_may_be_told() {
    let rate = |text: &str| Reading { rate_s: Some(rate_s(text).expect("a rate")), ..Reading::default() };
    let none = BENCH.with_times("Nr", |j| Some(j.to_string()));
    let error = Samples::read(&none, &Reading::default()).expect_err("no time").to_string();
    assert!(error.contains("--rate"), "{error}");
    let samples = Samples::read(&none, &rate("10kHz")).expect("a usable recording");
    assert_eq!((samples.step_s, samples.len(), samples.start_s), (1e-4, BENCH.rows, 0.0));
    let stamps = BENCH.with_times("time [s]", |j| Some(format!("{:.7}", 1.0001e-4 * j as f64)));
    assert_eq!(Samples::read(&stamps, &rate("10 kHz")).expect("clocks may differ").step_s, 1e-4);
    let error = Samples::read(&stamps, &rate("9600 Hz")).expect_err("another rate").to_string();
    assert!(error.contains("104.1667 µs apart, the time stamps 100.01 µs"), "{error}");

    let rates =
        [("10kHz", 1e-4), ("9600 Hz", 1.0 / 9600.0), ("1e4Hz", 1e-4), ("51.2 kHz", 1.0 / 51_200.0), ("1MHz", 1e-6)];
    assert!(rates.iter().all(|(text, step_s)| rate_s(text) == Ok(*step_s)));
    let steps =
        [("100us", 1e-4), ("100 µs", 1e-4), ("0.1ms", 1e-4), ("1e-4", 1e-4), ("1e-4 s", 1e-4), ("50000ns", 5e-5)];
    for (text, step_s) in steps {
        assert_eq!(duration_s(text), Ok(step_s), "{text}");
    }
    for text in ["10", "10 MHz 3", "kHz", "-1kHz", "0Hz", "infHz", "10mHz"] {
        assert!(rate_s(text).is_err(), "{text}");
    }
    for text in ["", "us", "-1us", "0", "1 kg", "inf"] {
        assert!(duration_s(text).is_err(), "{text}");
    }
}

#[test]
fn encodings_separators_and_decimal_commas() {
    let plain = BENCH.values();
    let header = "Zeit [ms];Weg y [µm];Weg z [µm];im1 [A];im2 [A];im3 [A];Winkel [°]";
    let mut text = String::from("# Prüfstand, Maß 7\nAbtastrate;10 kHz\n\n");
    text += header;
    text += "\r\n";
    for [time, y, z, a, b, c, theta, _] in plain.iter().take(2000) {
        let cells = [time * 1e3, y * 1e6, z * 1e6, *a, *b, *c, theta.to_degrees() % 360.0];
        let cells = cells.map(|cell| format!("{cell:.4}").replace('.', ","));
        text += &format!("{}\r\n", cells.join(";"));
    }
    let columns = [("time", "Zeit"), ("Ym", "Weg y"), ("Zm", "Weg z"), ("theta", "Winkel")];
    let columns: Vec<_> = columns.map(|(signal, column)| (signal.to_owned(), column.to_owned())).to_vec();
    let reading = Reading { columns, ..Reading::default() };
    let sixteen = |order: fn(u16) -> [u8; 2], mark: bool| -> Vec<u8> {
        let mark = mark.then_some(0xfeff);
        mark.into_iter().chain(text.encode_utf16()).flat_map(order).collect()
    };
    let latin = text.chars().map(|c| u8::try_from(u32::from(c)).expect("Latin-1")).collect::<Vec<u8>>();
    let tabs = text.replace(';', "\t");
    let points = text.replace(',', ".").replace(';', ",");
    let row = text.replace(
        header,
        "Zeit;Weg y;Weg z;im1;im2;im3;Winkel\nms;[µm];µm;(A);A;A;Grad".replace("Grad", "deg").as_str(),
    );
    let cases: Vec<(&str, Vec<u8>)> = vec![
        ("UTF-8", text.clone().into_bytes()),
        ("UTF-8 with mark", [b"\xef\xbb\xbf", text.as_bytes()].concat()),
        ("UTF-16 LE with mark", sixteen(u16::to_le_bytes, true)),
        ("UTF-16 BE with mark", sixteen(u16::to_be_bytes, true)),
        ("UTF-16 LE", sixteen(u16::to_le_bytes, false)),
        ("UTF-16 BE", sixteen(u16::to_be_bytes, false)),
        ("Latin-1", latin),
        ("tabs", tabs.into_bytes()),
        ("commas", points.into_bytes()),
        ("row of units", row.into_bytes()),
        ("torn", text.as_bytes()[..text.len() - 25].to_vec()),
        ("gzip", zipped(text.as_bytes())),
        ("gzip, UTF-16 LE", zipped(&sixteen(u16::to_le_bytes, true))),
    ];
    for (name, bytes) in cases {
        let samples = Samples::read_from(bytes.as_slice(), &reading).unwrap_or_else(|error| panic!("{name}: {error}"));
        println!("{name}: {:?}", samples.notes);
        let count = if name == "torn" { 1999 } else { 2000 };
        assert_eq!((samples.step_s, samples.len()), (1e-4, count), "{name}");
        let last = count - 1;
        assert!((samples.position_m[1][last] - plain[last][2]).abs() < 1e-10, "{name}");
        assert!((samples.theta_rad[last] - plain[last][6]).abs() < 1e-5, "{name}: {}", samples.theta_rad[last]);
        assert_eq!(samples.implausible(&[5e-4]), [""; 0], "{name}");
    }
    let whole = zipped(text.as_bytes());
    let error = Samples::read_from(&whole[..whole.len() / 2], &reading).expect_err("half a file").to_string();
    assert!(error.contains("the text cannot be read"), "{error}");
    // Decimal commas in a table that is separated by commas would shift the columns.
    let shifted = text.replace(';', ",");
    let error = Samples::read(&shifted, &reading).expect_err("more cells than the header has").to_string();
    assert!(error.contains("14 cells, the header has 7; decimal commas need another separator"), "{error}");
}

/// Every unit by every name, in the header, in capitals, told.
#[test]
fn units_go_by_many_names() {
    use std::f64::consts::{PI, TAU};
    let cases: [(usize, f64, &[&str]); 18] = [
        (0, 1.0, &["s", "sec"]),
        (0, 1e-3, &["ms"]),
        (0, 1e-6, &["µs", "us", "μs"]),
        (0, 1e-9, &["ns"]),
        (1, 1.0, &["m"]),
        (1, 1e-3, &["mm"]),
        (1, 1e-6, &["µm", "um", "Micron"]),
        (1, 1e-9, &["nm"]),
        (1, 25.4e-6, &["mil", "Mil"]),
        (3, 1.0, &["A", "Ampere"]),
        (3, 1e-3, &["mA"]),
        (6, 1.0, &["rad"]),
        (6, PI / 180.0, &["deg", "°", "Deg", "º"]),
        (6, TAU, &["rev"]),
        (7, 1.0, &["rad/s", "rad / s"]),
        (7, PI / 30.0, &["rpm", "RPM", "1/min", "U/min", "min-1", "min^-1", "min⁻¹", "min−1", "u/min"]),
        (7, TAU, &["Hz", "rev/s", "rps"]),
        (7, PI / 180.0, &["deg/s", "°/s"]),
    ];
    let cases = cases.into_iter().flat_map(|(at, factor, names)| names.iter().map(move |unit| (at, *unit, factor)));
    const NAMES: [&str; 8] = ["time", "Ym", "Zm", "im[1]", "im[2]", "im[3]", "theta", "omega"];
    const SI: [&str; 8] = ["s", "m", "m", "A", "A", "A", "rad", "rad/s"];
    let bench = Bench { rows: 400, ..BENCH };
    let values = bench.values();
    for (at, unit, factor) in cases {
        for told in [false, true] {
            let head = (0..8).map(|n| match n == at {
                true if told => format!("{} [kg]", NAMES[n]),
                true => format!("{} [{unit}]", NAMES[n]),
                false => format!("{} [{}]", NAMES[n], SI[n]),
            });
            let mut text = head.collect::<Vec<_>>().join(";") + "\n";
            for row in &values {
                let cells = (0..8).map(|n| format!("{:.12}", row[n] / if n == at { factor } else { 1.0 }));
                text += &(cells.collect::<Vec<_>>().join(";") + "\n");
            }
            let units = if told { vec![(NAMES[at].to_owned(), unit.to_owned())] } else { Vec::new() };
            let samples = Samples::read(&text, &Reading { units, ..Reading::default() });
            let samples = samples.unwrap_or_else(|error| panic!("{unit}: {error}"));
            let last = values.len() - 1;
            let read = [
                samples.step_s * last as f64,
                samples.position_m[0][last],
                0.0,
                samples.current_a[0][last],
                0.0,
                0.0,
                samples.theta_rad[last],
                samples.omega_rad_s[last],
            ][at];
            assert!((read / values[last][at] - 1.0).abs() < 1e-5, "{unit}: {read}, wanted {}", values[last][at]);
            assert_eq!(samples.implausible(&[5e-4]), [""; 0], "{unit}");
        }
    }
    let bare = "time/ms,Ym in µm,Zm (mm),im[1] [mA],im[2] <A>,im[3] {A},theta [-]\n".to_owned();
    let rows: String =
        (0..40).map(|j| format!("{},{},{},{},1,1,0.{j:02}\n", 0.1 * f64::from(j), j % 7, 0.01, 1200)).collect();
    let samples = Samples::read(&(bare + &rows), &Reading::default()).expect("a usable recording");
    assert_eq!((samples.step_s, samples.position_m[0][3], samples.current_a[0][3]), (1e-4, 3e-6, 1.2));
    assert!(
        samples.notes.iter().any(|note| note == "theta has no unit; it is taken to be in rad."),
        "{:?}",
        samples.notes
    );
}

#[test]
fn all_that_is_wrong_with_a_header_is_said_at_once() {
    let header = "Zeit [min];a.Ym [m];b.Ym [m];Zm [furlong];im1 [A];im1 [A];i2 [V];Strom [A]\n1;2;3;4;5;6;7;8\n";
    let reading = Reading {
        columns: vec![("theta".into(), "Winkel".into()), ("Xm".into(), "a".into())],
        units: vec![("im[2]".into(), "kA".into())],
        ..Reading::default()
    };
    let error = Samples::read(header, &reading).expect_err("many problems").to_string();
    for words in [
        "time (column Zeit): the unit min is none of s, ms, µs, ns",
        "Ym: several columns go by this name: a.Ym, b.Ym; one is wanted: --column Ym=…",
        "Zm (column Zm): the unit furlong is none of m, mm, µm, nm, mil",
        "im[1]: several columns go by this name: im1, im1",
        "im[2] (column i2): the unit kA is none of A, mA",
        "im[3]: no column of this name; the current of magnet 3 is wanted: --column im[3]=…",
        "--column theta=Winkel: there is no column Winkel",
        "--column Xm: Xm is no signal",
        "the header has the columns Zeit, a.Ym, b.Ym, Zm, im1, im1, i2, Strom",
    ] {
        assert!(error.contains(words), "{words} in {error}");
    }
    let one = "time,y,im1,im2,im3\n";
    let columns = vec![("Ym".into(), "y".into()), ("Zm".into(), "y".into())];
    let error =
        Samples::read(one, &Reading { columns, ..Reading::default() }).expect_err("one column twice").to_string();
    assert!(error.contains("Ym and Zm: both are column y"), "{error}");
    let two = "time [s];Ym [m];Zm [m];im1;im2;im3\ns;µm;m;A;A;A\n";
    let error = Samples::read(two, &Reading::default()).expect_err("two units").to_string();
    assert!(error.contains("column Ym: the header says m, the row below it µm"), "{error}");
}

/// How a signal is read: with the unit it has, or with another one.
struct Misread {
    signal: usize,
    /// Its values are in this unit, ...
    is: (&'static str, f64),
    /// ... and the header says this.
    said: &'static str,
}

const MISREAD: [Misread; 15] = [
    Misread { signal: 0, is: ("ms", 1e-3), said: "s" },
    Misread { signal: 0, is: ("µs", 1e-6), said: "s" },
    Misread { signal: 0, is: ("s", 1.0), said: "ms" },
    Misread { signal: 0, is: ("µs", 1e-6), said: "ms" },
    Misread { signal: 1, is: ("µm", 1e-6), said: "m" },
    Misread { signal: 1, is: ("µm", 1e-6), said: "mm" },
    Misread { signal: 1, is: ("m", 1.0), said: "µm" },
    Misread { signal: 1, is: ("mm", 1e-3), said: "µm" },
    Misread { signal: 3, is: ("mA", 1e-3), said: "A" },
    Misread { signal: 3, is: ("A", 1.0), said: "mA" },
    Misread { signal: 6, is: ("deg", std::f64::consts::PI / 180.0), said: "rad" },
    Misread { signal: 6, is: ("rev", std::f64::consts::TAU), said: "rad" },
    Misread { signal: 6, is: ("rad", 1.0), said: "deg" },
    Misread { signal: 7, is: ("rpm", std::f64::consts::PI / 30.0), said: "rad/s" },
    Misread { signal: 7, is: ("Hz", std::f64::consts::TAU), said: "rad/s" },
];

/// Findings on a recording of which some signals are misread, with angle and speed or one of them.
fn suspected(bench: &Bench, misread: &[&Misread], rotation: &[usize], wrapped: bool) -> Vec<String> {
    let names = ["time", "Ym", "Zm", "im[1]", "im[2]", "im[3]", "theta", "omega"];
    let mut units = ["s", "m", "m", "A", "A", "A", "rad", "rad/s"];
    let mut factors = [1.0; 8];
    for Misread { signal, is, said } in misread {
        let all = match signal {
            1 => 1..3,
            3 => 3..6,
            one => *one..*one + 1,
        };
        for at in all {
            (units[at], factors[at]) = (said, is.1);
        }
    }
    let signals: Vec<usize> = (0..6).chain(rotation.iter().copied()).collect();
    let head: Vec<_> = signals.iter().map(|at| format!("{} [{}]", names[*at], units[*at])).collect();
    let mut text = head.join(",") + "\n";
    for mut row in bench.values() {
        if wrapped {
            row[6] %= std::f64::consts::TAU;
        }
        let cells: Vec<_> = signals.iter().map(|at| format!("{:e}", row[*at] / factors[*at])).collect();
        text += &(cells.join(",") + "\n");
    }
    let samples = Samples::read(&text, &Reading::default()).expect("a table of numbers");
    samples.implausible(&[5e-4])
}

/// Sample times, speeds and ways to know the angle under which a misread unit must be seen.
#[test]
fn no_misread_unit_goes_unnoticed() {
    for (step_s, rpm, rows) in
        [(1e-4, 3000.0, 2000), (1e-4, 1000.0, 3000), (2e-5, 1000.0, 10_000), (5e-5, 7200.0, 2000), (1e-4, 6000.0, 2000)]
    {
        let bench = Bench { rows, omega_rad_s: rpm * std::f64::consts::PI / 30.0, step_s };
        for (rotation, wrapped) in [(&[6, 7][..], false), (&[6, 7], true), (&[6], false), (&[6], true), (&[7], false)] {
            let what = format!("{step_s} s, {rpm} rpm, {rotation:?}, wrapped {wrapped}");
            assert_eq!(suspected(&bench, &[], rotation, wrapped), [""; 0], "{what}");
            for misread in MISREAD.iter().filter(|misread| misread.signal < 6 || rotation.contains(&misread.signal)) {
                let found = suspected(&bench, &[misread], rotation, wrapped);
                let (is, said) = (misread.is.0, misread.said);
                if rpm == 3000.0 {
                    println!("{is} read as {said}, {what}: {found:?}");
                }
                assert!(!found.is_empty(), "{is} read as {said}: nothing was found; {what}");
                // The right proposal is among them.
                let name = ["time", "Ym", "", "im[1]", "", "", "theta", "omega"][misread.signal];
                let proposal = format!("--unit {name}={is}");
                assert!(found.iter().any(|finding| finding.contains(&proposal)), "{proposal} in {found:?}; {what}");
            }
        }
    }
}

/// Misreadings cannot hide each other.
#[test]
fn misread_units_together_are_seen() {
    let bench = Bench { rows: 1000, ..BENCH };
    for (n, one) in MISREAD.iter().enumerate() {
        for other in MISREAD[n + 1..].iter().filter(|other| other.signal != one.signal) {
            let mut three: Vec<Vec<&Misread>> = vec![vec![one, other]];
            three.extend(
                MISREAD[n + 1..]
                    .iter()
                    .filter(|third| third.signal > other.signal)
                    .map(|third| vec![one, other, third]),
            );
            for misread in three {
                let found = suspected(&bench, &misread, &[6, 7], n % 2 == 0);
                let what: Vec<_> = misread.iter().map(|misread| (misread.is.0, misread.said)).collect();
                assert!(!found.is_empty(), "{what:?}: nothing was found");
            }
        }
    }
}
