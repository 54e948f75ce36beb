//! Choosing the window: what a length costs in noise, delay and certainty.
//!
//! The standard deviations are those that the estimator itself states on a run of the scenario without noise while it is told
//! the noise: everything that the bearing, the path and the speed make of it is in them.

use std::f64::consts::TAU;

use super::identify;
use super::montecarlo;
use super::plot::{Axis, Colour, Line, Mark, Plot, Range, Unit};
use super::report::Table;
use super::scenario::Scenario;
use super::simulate::{self, Refused};
use crate::model::estimator::{Estimator, EstimatorConfig, EstimatorInput, Method};
use crate::model::kernel::Weights;
use crate::slave::variable::Value;

/// Windows that are compared, in revolutions.
const REVOLUTIONS: [f64; 9] = [0.25, 0.4, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 3.0];

/// Windows whose largest standard deviation exceeds the least by no more than this part are as good.
const AS_GOOD: f64 = 0.1;

/// What is asked.
#[derive(Clone, Debug)]
pub struct Question {
    /// Speed of the rotor, in revolutions per minute.
    pub rpm: f64,
    /// Sample time, in seconds; `None` takes that of the scenario.
    pub step_s: Option<f64>,
    /// Windows to compare, in seconds; none takes parts and multiples of a revolution.
    pub windows_s: Vec<f64>,
    /// Standard deviations of the noise, in m and A.
    pub noise: [f64; 2],
    /// When the standard deviations are compared, in seconds.
    pub instant_s: f64,
}

/// What one window promises.
#[derive(Clone, Debug, PartialEq)]
pub struct Promise {
    /// Length, in seconds.
    pub window_s: f64,
    /// Standard deviation of the acceleration that white position noise of one metre makes in the paper's first row and
    /// in the slowest sine, in m/s² per m.
    pub noise_gain: [f64; 2],
    /// Frequencies between which the rows see half of their peak power, in Hz.
    pub band_hz: [f64; 2],
    /// Age of the data in the middle of the window plus the mean age in the memory, in seconds.
    pub delay_s: f64,
    /// Standard deviations relative to λ at the instant; infinite if the estimate is not valid.
    pub std: [f64; 3],
}

/// Answers for every window, and which is recommended.
///
/// # Errors
/// Every parameter that a slave refuses.
pub fn design(scenario: &Scenario, question: &Question) -> Result<(Vec<Promise>, Option<usize>), Refused> {
    let mut scenario = montecarlo::study("", scenario, [0.0; 2], false, 1).scenario;
    let revolution_s = 60.0 / question.rpm;
    if let Some(step_s) = question.step_s {
        for (element, name) in [("plant", "sensor.Ts"), ("controller", "Ts"), ("estimator", "Ts")] {
            scenario.set(element, name, Value::Real(step_s));
        }
        scenario.step_s = step_s;
    }
    let step_s = scenario.step_s;
    montecarlo::at_speed(&mut scenario, question.rpm, (revolution_s / step_s).round() * step_s);
    scenario.duration_s = question.instant_s;
    let run = simulate::run(&scenario)?;
    let read = |name: &str| run.recording.get(&format!("plant.{name}")).unwrap_or(&[]);
    let (y, z, theta, omega) = (read("Ym"), read("Zm"), read("theta"), read("omegam"));
    let im = [1, 2, 3].map(|k| read(&format!("im[{k}]")));
    let told = identify::config(|name| scenario.value("estimator", name).map_or(f64::NAN, Value::as_f64));
    let lengths: Vec<f64> = if question.windows_s.is_empty() {
        REVOLUTIONS.iter().map(|part| part * revolution_s).collect()
    } else {
        question.windows_s.clone()
    };
    let mut promises: Vec<Promise> = Vec::new();
    for length in lengths {
        let intervals = (length / scenario.step_s).round().max(8.0);
        let window_s = intervals * scenario.step_s;
        let config = EstimatorConfig {
            window_s,
            epsilon_s: window_s,
            method: Method::Unbalance,
            position_noise_m: question.noise[0],
            current_noise_a: question.noise[1],
            ..told.clone()
        };
        let estimator =
            Estimator::new(config).map_err(|found| Refused(found.iter().map(ToString::to_string).collect()))?;
        let mut state = estimator.start();
        for j in 0..y.len() {
            estimator.sample(
                &mut state,
                &EstimatorInput {
                    position_m: [y[j], z[j]],
                    current_a: [im[0][j], im[1][j], im[2][j]],
                    theta_rad: theta[j],
                    omega_rad_s: omega[j],
                    enable: true,
                    contact: false,
                    reset: false,
                },
            );
        }
        let output = state.output();
        let sines = Weights::sines(intervals as usize, 12, question.noise[0], 0.0);
        let window2 = window_s * window_s;
        promises.push(Promise {
            window_s,
            noise_gain: [&Weights::paper(0, intervals as usize), &sines[0]].map(|row| {
                let size = row.node.iter().map(|w| w.abs()).sum::<f64>();
                row.noise_gain() / (window2 * size)
            }),
            band_hz: band(&estimator, scenario.step_s, question),
            delay_s: window_s / 2.0 + 2.0 * told.filter_zeta / told.filter_omega_rad_s,
            std: if output.valid {
                std::array::from_fn(|k| output.lambda_std[k] / output.lambda_hat[k])
            } else {
                [f64::INFINITY; 3]
            },
        });
    }
    let worst = |promise: &Promise| promise.std.iter().copied().fold(0.0, f64::max);
    let best = promises.iter().map(worst).fold(f64::INFINITY, f64::min);
    // Short windows lean on the compensation of the noise, long ones follow a change late: near a revolution is between.
    let from_revolution = |n: &usize| (promises[*n].window_s / revolution_s).ln().abs();
    let good = (0..promises.len()).filter(|n| worst(&promises[*n]) <= best * (1.0 + AS_GOOD));
    let recommended = good.min_by(|a, b| from_revolution(a).total_cmp(&from_revolution(b)));
    Ok((promises, recommended.filter(|_| best.is_finite())))
}

/// Where the power `Σ |G_u|²` of the test functions, weighted for the noise, is above half of its peak.
fn band(estimator: &Estimator, step_s: f64, question: &Question) -> [f64; 2] {
    let intervals = (estimator.config().window_s / step_s).round() as usize;
    let config = estimator.config();
    let lambda0 = config.lambda0_nm2_a2[0];
    let per_ampere = 2.0 * (lambda0 * config.m_kg * 9.81).sqrt() / config.gap_m;
    let force = config.window_s * config.window_s / config.m_kg * per_ampere * question.noise[1];
    let rows = Weights::sines(intervals, 12, question.noise[0].max(1e-12), force);
    let power = |hz: f64| {
        let turn = TAU * hz * step_s;
        rows.iter()
            .map(|row| {
                let (mut c, mut s) = (0.0, 0.0);
                for (j, w) in row.node.iter().enumerate() {
                    c += w * (turn * j as f64).cos();
                    s += w * (turn * j as f64).sin();
                }
                c * c + s * s
            })
            .sum::<f64>()
    };
    let points: Vec<(f64, f64)> =
        (1..400).map(|n| f64::from(n) * 0.02 / config.window_s).map(|hz| (hz, power(hz))).collect();
    let peak = points.iter().map(|(_, power)| *power).fold(0.0, f64::max);
    let above: Vec<f64> = points.iter().filter(|(_, power)| *power > 0.5 * peak).map(|(hz, _)| *hz).collect();
    [above.first().copied().unwrap_or(0.0), above.last().copied().unwrap_or(0.0)]
}

/// The answers as a table.
#[must_use]
pub fn table(question: &Question, promises: &[Promise], recommended: Option<usize>) -> Table {
    let rows = promises.iter().enumerate().map(|(n, promise)| {
        let std = promise.std.map(|std| if std.is_finite() { format!("{:.3}", 100.0 * std) } else { "–".into() });
        let [std1, std2, std3] = std;
        vec![
            format!("{:.1} ms", promise.window_s * 1e3),
            format!("{:.2}", promise.window_s * question.rpm / 60.0),
            format!("{:.1e}", promise.noise_gain[0]),
            format!("{:.1e}", promise.noise_gain[1]),
            format!("{:.0}–{:.0}", promise.band_hz[0], promise.band_hz[1]),
            format!("{:.0}", promise.delay_s * 1e3),
            std1,
            std2,
            std3,
            if recommended == Some(n) { "recommended" } else { "" }.into(),
        ]
    });
    Table {
        title: format!(
            "Windows at {} rpm, noise {:.3} µm and {:.1} mA, after {} ms",
            question.rpm,
            question.noise[0] * 1e6,
            question.noise[1] * 1e3,
            (question.instant_s * 1e3).round()
        ),
        note: "Of the windows whose largest standard deviation is within 10 % of the least, the one nearest to a revolution is recommended. – means that the \
               estimate is not valid."
            .into(),
        head: [
            "Tf", "revolutions", "gain, paper, 1/s²", "gain, sine, 1/s²", "band, Hz", "delay, ms", "std 1, %", "std 2, %",
            "std 3, %", "",
        ]
        .map(String::from)
        .into(),
        rows: rows.collect(),
    }
}

/// Windows of the plot, in revolutions: from a quarter to three.
const PLOTTED: std::ops::RangeInclusive<u32> = 5..=60;
const PLOTTED_PART: f64 = 0.05;

/// When the dashed line of the plot is looked at, in revolutions: a window of one revolution is full, and a little more.
const EARLY_REVOLUTIONS: f64 = 1.75;

/// Width of the plot and height of one of its parts, in pixels.
const PLOT_PX: (f64, f64) = (760.0, 250.0);

/// The choice as a plot, an SVG file: standard deviations, band and delay over the length of the window. The windows of the
/// question, if there are some, else enough of them for a smooth line.
///
/// # Errors
/// As for [`design`].
pub fn plot(scenario: &Scenario, question: &Question) -> Result<String, Refused> {
    let mut question = question.clone();
    if question.windows_s.is_empty() {
        question.windows_s = PLOTTED.map(|part| f64::from(part) * PLOTTED_PART * 60.0 / question.rpm).collect();
    }
    let (mut promises, recommended) = design(scenario, &question)?;
    // The same while there is little data.
    let early_s = EARLY_REVOLUTIONS * 60.0 / question.rpm;
    let soon = Question { instant_s: early_s, ..question.clone() };
    let (mut early, _) = design(scenario, &soon)?;
    early.sort_by(|a, b| a.window_s.total_cmp(&b.window_s));
    let recommended_s = recommended.map(|n| promises[n].window_s);
    promises.sort_by(|a, b| a.window_s.total_cmp(&b.window_s));
    let lengths: Vec<f64> = promises.iter().map(|promise| promise.window_s).collect();
    let line = |name: &str, colour, value: &dyn Fn(&Promise) -> f64| {
        let values = promises.iter().map(value).map(|value| if value.is_finite() { value } else { f64::NAN });
        Line::new(name, lengths.clone(), values.collect::<Vec<_>>(), colour)
    };
    let hertz = Unit { name: "Hz", factor: 1.0 };
    let title = format!(
        "Expected standard deviation of λ after {:.0} ms at {} rpm, noise {} µm and {} mA",
        question.instant_s * 1e3,
        question.rpm,
        (question.noise[0] * 1e9).round() / 1e3,
        (question.noise[1] * 1e6).round() / 1e3,
    );
    let [std, band, delay] = [
        (title.as_str(), "standard deviation", Unit::PERCENT, false),
        ("Band in which the rows see more than half of their peak power", "frequency", hertz, true),
        ("Mean age of the data", "delay", Unit::MILLISECOND, false),
    ]
    .map(|(title, quantity, unit, log)| {
        let x = Axis::new("window Tf", Unit::MILLISECOND);
        let y = Axis { log, ..Axis::new(quantity, unit) };
        let mut plot = Plot::new(title, x, y, PLOT_PX);
        plot.instants.extend(recommended_s.map(|at| Mark::new(at, "recommended", Colour::Grey)));
        plot
    });
    let magnets = ["λ₁", "λ₂", "λ₃"].into_iter().zip(Colour::MAGNETS).enumerate();
    let mut stds: Vec<Line> =
        magnets.map(|(k, (name, colour))| line(name, colour, &|promise| promise.std[k])).collect();
    let known: Vec<&Promise> = early.iter().filter(|promise| promise.std[2].is_finite()).collect();
    let soon: Vec<f64> = known.iter().map(|promise| promise.std[2]).collect();
    let windows: Vec<f64> = known.iter().map(|promise| promise.window_s).collect();
    stds.push(Line::new(&format!("λ₃ after {:.0} ms", early_s * 1e3), windows, soon, Colour::Green).dashed());
    let most = stds.iter().flat_map(|line| line.y.iter()).copied().filter(|std| std.is_finite()).fold(0.0, f64::max);
    let std = Plot { y: std.y.from_to(Some(Range::new(0.0, 1.1 * most.max(1e-4)))), ..std };
    let plots = [
        Plot { lines: stds, ..std },
        Plot {
            lines: vec![
                line("upper end", Colour::Blue, &|promise| promise.band_hz[1]),
                line("lower end", Colour::Vermillion, &|promise| promise.band_hz[0]),
            ],
            ..band
        },
        Plot {
            lines: vec![line("half a window and the mean age in the memory", Colour::Green, &|promise| {
                promise.delay_s
            })],
            ..delay
        },
    ];
    let (width, height) = PLOT_PX;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{0}\" viewBox=\"0 0 {width} {0}\" \
         font-family=\"system-ui,sans-serif\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n",
        height * plots.len() as f64
    );
    for (n, plot) in plots.iter().enumerate() {
        let place = format!("<svg y=\"{}\" width=\"{width}\" height=\"{height}\" ", height * n as f64);
        svg += &plot.draw().svg.replacen("<svg class=\"plot\" ", &place, 1);
        svg.push('\n');
    }
    svg += "</svg>\n";
    Ok(svg)
}

/// The plot that stands in the documentation.
///
/// # Panics
/// Never: the scenario comes with the program.
#[must_use]
pub fn figure() -> String {
    let scenario = Scenario::open(std::path::Path::new("unbalanced")).expect("a scenario that comes with the program");
    let question =
        Question { rpm: 3000.0, step_s: None, windows_s: Vec::new(), noise: montecarlo::NOISE, instant_s: 0.1 };
    plot(&scenario, &question).expect("a good scenario")
}
