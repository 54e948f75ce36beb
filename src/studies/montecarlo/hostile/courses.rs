//! The list of hostile courses.

use std::f64::consts::{PI, TAU};

use super::Requirement::{self, NotValid, NotWrong, Nothing, Valid};
use super::altered::{self, Alter, Missing};
use super::cases::RPM;
use super::{Course, Draw, NOISE, cases};
use crate::bearing::array;
use crate::simulation::Scenario;

impl Course {
    fn new(
        name: &str,
        asked: Requirement,
        length_s: f64,
        set: impl Fn(&mut Scenario, u64) + Send + Sync + 'static,
    ) -> Self {
        Self {
            name: name.into(),
            asked,
            base: "unbalanced",
            noise: NOISE,
            length_s,
            set: Box::new(set),
            alter: None,
            only: None,
            rubs: false,
            drawn: false,
            noise_is_known: true,
        }
    }

    /// The nominal scenario with an error of the readings.
    fn misread(name: &str, asked: Requirement, alter: Alter) -> Self {
        Self { alter: Some(alter), ..Self::new(name, asked, 1.0, unchanged) }
    }
}

/// Leaves the scenario as it is.
fn unchanged(_: &mut Scenario, _: u64) {}

/// All courses, with the noise known and then estimated; of each, those of other machines last.
pub fn courses() -> Vec<Course> {
    let of_noise = |noise_is_known| {
        let all = [excitation, changes, forces, angles, readings, machines].into_iter().flat_map(|of| of());
        all.map(move |course| Course { noise_is_known, ..course })
    };
    let is_wanted = |course: &Course| course.only.is_none_or(|only| only == course.noise_is_known);
    [true, false].into_iter().flat_map(of_noise).filter(is_wanted).collect()
}

/// Low excitation, wrong first guesses, other speeds and sample times.
fn excitation() -> Vec<Course> {
    let late = |name: &str, set: fn(&mut Scenario)| {
        let set = move |scenario: &mut Scenario, _| {
            set(scenario);
            scenario.set("controller", "update.time", 0.5);
        };
        let name = format!("wrong by two, updated late, {name}");
        Course { alter: Some(altered::given_lambda(0.02)), ..Course::new(&name, Valid, 1.5, set) }
    };
    let guesses = [0.1, 0.2, 5.0, 10.0].into_iter().flat_map(|factor| {
        let at_rest = move |scenario: &mut Scenario, _| {
            cases::at_rest(scenario);
            guess(scenario, factor);
        };
        let turning = move |scenario: &mut Scenario, _| guess(scenario, factor);
        [
            Course::new(&format!("first guess × {factor}, at rest, modulated"), Valid, 1.0, at_rest),
            Course::new(&format!("first guess × {factor}, modulated"), Valid, 1.0, turning),
        ]
    });
    let sampled = |per_turn: u32, asked, step_s: f64| {
        Course::new(&format!("{per_turn} samples a turn"), asked, 1.0, move |scenario, _| {
            cases::sample_time(scenario, step_s);
            scenario.set("controller", "bandwidth.tracking", 0.2 / step_s);
            scenario.set("controller", "bandwidth.observer", 0.6 / step_s);
            cases::trajectory(scenario, [20e-6, 45e-6], (3, 0.0), 6000.0 * RPM);
            scale(scenario, "plant.unbalance.magnitude", 0.25);
        })
    };
    // The scenario of the documentation.
    let run_up = Course::new("scenario run-up, with voltage drive", Valid, 1.0, unchanged);
    let mut courses = vec![
        Course::new("nominal", Valid, 1.0, unchanged),
        Course { base: "run-up", noise: [1e-7, 5e-3], ..run_up },
        late("300 rpm", |scenario| cases::turn(scenario, 300.0)),
        late("600 rpm", |scenario| cases::turn(scenario, 600.0)),
        late("at rest", cases::at_rest),
        late("0 to 3000 rpm", |scenario| cases::speed(scenario, &[0.0, 0.3, 1.0], &[0.0, 0.0, 3000.0])),
    ];
    courses.extend(guesses);
    courses.extend([
        Course::new("1500 rpm", Valid, 1.0, |scenario, _| cases::turn(scenario, 1500.0)),
        Course::new("1000 rpm", NotWrong, 1.5, |scenario, _| cases::turn(scenario, 1000.0)),
        sampled(20, Valid, 5e-4),
        sampled(10, NotWrong, 1e-3),
    ]);
    courses
}

/// Changes of speed, load, λ and unbalance.
fn changes() -> Vec<Course> {
    let ramp = |rate: f64| {
        Course::new(&format!("load ramp {rate} N/s"), Valid, 2.0, move |scenario, seed| load_ramp(scenario, rate, seed))
    };
    let step = |time_ms: f64| {
        Course::new(&format!("load steps by 20 N within {time_ms} ms"), Valid, 2.0, move |scenario, _| {
            change(scenario, "pZ", [0.5, 0.5 + 1e-3 * time_ms], 1.0);
        })
    };
    let drawn = |scenario: &mut Scenario, seed: u64| {
        let noise_known = scenario.number("estimator", "sensor.positionNoise") > 0.0;
        *scenario = cases::drawn(scenario, seed, noise_known);
        load_ramp(scenario, 5.0, seed);
        drift(scenario, [0.0, 1.0], 0.01);
    };
    let drawn = Course::new("drawn bearing, load ramp 5 N/s, λ drifts 1 %/s", NotWrong, 1.0, drawn);
    // The currents rise with the speed, so that a changing load looks like a change of λ.
    let opposed = |scenario: &mut Scenario, _| {
        scale(scenario, "plant.unbalance.magnitude", 0.25);
        cases::speed(scenario, &[0.0, 0.3, 0.7, 1.0], &[1500.0, 1500.0, 8000.0, 8000.0]);
        for (name, part) in scenario.machine.of_magnets("lambda").iter().zip([0.01, 0.01, -0.01, -0.01]) {
            change(scenario, name, [0.0, 1.0], part);
        }
    };
    let opposed =
        Course::new("four magnets, 1500 to 8000 rpm in 0.4 s, λ drift apart by 2 %/s", NotWrong, 1.0, opposed);
    vec![
        Course::new("500 to 6000 rpm and back", Valid, 2.0, |scenario, _| {
            cases::speed(scenario, &[0.0, 1.0, 2.0], &[500.0, 6000.0, 500.0]);
        }),
        Course::new("3000 to −3000 rpm", NotWrong, 1.6, |scenario, _| {
            cases::speed(scenario, &[0.0, 0.3, 1.2, 1.6], &[3000.0, 3000.0, -3000.0, -3000.0]);
        }),
        Course::new("8000 to 300 rpm in 0.4 s, load ramp 1 N/s", NotWrong, 1.2, |scenario, seed| {
            cases::speed(scenario, &[0.0, 0.3, 0.7, 1.2], &[8000.0, 8000.0, 300.0, 300.0]);
            load_ramp(scenario, 1.0, seed);
        }),
        ramp(1.0),
        ramp(10.0),
        step(1.0),
        step(10.0),
        step(100.0),
        Course::new("λ drifts 2 %/s", Valid, 2.0, |scenario, _| drift(scenario, [0.0, 2.0], 0.04)),
        Course::new("λ + 3 % within 0.3 s", Valid, 1.5, |scenario, _| drift(scenario, [0.5, 0.8], 0.03)),
        Course::new("λ steps by 5 %", NotWrong, 1.5, |scenario, seed| {
            cases::step_of_lambda(scenario, seed, 0.05, 0.6)
        }),
        Course::new("unbalance grows 10 %/s", NotWrong, 2.0, |scenario, _| {
            change(scenario, "unbalance.magnitude", [0.0, 2.0], 0.2);
        }),
        Course { drawn: true, ..drawn },
        Course { base: "planar4", ..opposed },
    ]
}

/// Forces that rotate backward, beat, or rub.
fn forces() -> Vec<Course> {
    let backward = |force_n: f64| {
        Course::new(&format!("{force_n} N backward"), Valid, 1.0, move |scenario, seed| {
            cases::turning(scenario, -1.0, force_n, -Draw::new(seed).uniform(-PI, PI), scenario.duration_s);
        })
    };
    // The tolerance of such a force, 2 N, suits the paper's rotor.
    let heavy = Course::new("100 kg, 25 N backward", Valid, 1.0, |scenario, seed| {
        let factor = 100.0 / scenario.number("plant", "m");
        scenario.set_everywhere("m", 100.0);
        for path in ["plant.pY", "plant.pZ", "plant.unbalance.magnitude", "controller.F0"] {
            scale(scenario, path, factor);
        }
        for k in 1..=3 {
            scale(scenario, &format!("plant.lambda[{k}]"), factor);
            scale(scenario, &format!("controller.lambda0[{k}]"), factor);
            scale(scenario, &format!("estimator.lambda0[{k}]"), factor);
        }
        cases::turning(scenario, -1.0, 25.0, -Draw::new(seed).uniform(-PI, PI), scenario.duration_s);
    });
    let oscillating = |name: &str, [least_n, most_n]: [f64; 2], [least_hz, most_hz]: [f64; 2]| {
        Course::new(name, NotWrong, 1.0, move |scenario, seed| {
            let mut draw = Draw::new(seed);
            let amplitude_n = draw.log_uniform(least_n, most_n);
            scenario.set("plant", "perturbation.omega", TAU * draw.uniform(least_hz, most_hz));
            for (axis, part) in [("Y", 1.0), ("Z", 0.7)] {
                scenario.set("plant", &format!("perturbation.amplitude{axis}"), amplitude_n * part);
                scenario.set("plant", &format!("perturbation.phase{axis}"), draw.uniform(-PI, PI));
            }
        })
    };
    // Twelve oscillations within 6 Hz, with random frequencies and phases.
    let narrow_band = |middle_hz: f64| {
        Course::new(&format!("0.5 N within 6 Hz about {middle_hz} Hz"), NotWrong, 1.0, move |scenario, seed| {
            let mut draw = Draw::new(seed);
            let omega: [f64; 12] = array::from_fn(|_| TAU * (middle_hz + draw.uniform(-3.0, 3.0)));
            let phases = [0, 1].map(|_| array::from_fn::<_, 12, _>(|_| draw.uniform(-PI, PI)));
            cases::push(scenario, &["pY", "pZ"], scenario.duration_s, |time_s| {
                // The root mean square of the sum is 0.5 N.
                phases.map(|phases| {
                    let wave = |(w, phase): (&f64, f64)| 0.5 / 6f64.sqrt() * libm::cos(w * time_s + phase);
                    omega.iter().zip(phases).map(wave).sum()
                })
            });
        })
    };
    // Within few revolutions such a force looks like another load.
    let fast = Course::new("0.3 to 3 N at 50 Hz, 12 000 rpm", NotWrong, 0.5, |scenario, seed| {
        cases::sample_time(scenario, 5e-5);
        cases::modulation(scenario, 0.5, 110.0);
        scale(scenario, "plant.unbalance.magnitude", 0.05);
        scenario.set("plant", "omega", 12_000.0 * RPM);
        scenario.set("controller", "reference.omega", 3420.0 * RPM);
        scenario.set("plant", "perturbation.omega", TAU * 50.0);
        let amplitude_n = Draw::new(seed).log_uniform(0.3, 3.0);
        for axis in ["Y", "Z"] {
            scenario.set("plant", &format!("perturbation.amplitude{axis}"), amplitude_n);
        }
    });
    let paper = |name: &str| Course {
        base: "paper",
        ..Course::new(&format!("the paper's simulation, {name} noise"), Valid, 1.0, unchanged)
    };
    let rubbing = Course::new("light rubbing", NotWrong, 1.0, |scenario, seed| {
        let mut draw = Draw::new(seed);
        scenario.set("plant", "touchdown.clearance", draw.uniform(70e-6, 73e-6));
        scenario.set("plant", "touchdown.stiffness", draw.log_uniform(1e6, 5e7));
    });
    vec![
        backward(0.1),
        backward(0.3),
        backward(1.0),
        backward(2.0),
        heavy,
        Course { noise: [0.0; 2], only: Some(false), ..paper("without") },
        paper("with"),
        oscillating("0.3 N at 47 Hz", [0.3, 0.3], [47.0, 47.0]),
        oscillating("0.5 to 8 N at 95 to 130 Hz", [0.5, 8.0], [95.0, 130.0]),
        oscillating("0.5 to 8 N at 180 to 260 Hz", [0.5, 8.0], [180.0, 260.0]),
        narrow_band(140.0),
        narrow_band(230.0),
        fast,
        Course::new("1 N forward at twice the speed", NotWrong, 1.0, |scenario, seed| {
            cases::turning(scenario, 2.0, 1.0, Draw::new(seed).uniform(-PI, PI), scenario.duration_s);
        }),
        Course { rubs: true, ..rubbing },
    ]
}

/// Errors of the angle and speed readings.
fn angles() -> Vec<Course> {
    let circle = |name: &str, alter: Alter| {
        let set = |scenario: &mut Scenario, _| cases::trajectory(scenario, [50e-6; 2], (3, 0.0), 3000.0 * RPM);
        Course { alter: Some(alter), ..Course::new(&format!("circle, {name}"), NotWrong, 1.0, set) }
    };
    vec![
        circle("noise of the speed 1 %", altered::noisy_angle(0.01, 0.0)),
        circle("noise of the speed 3 %", altered::noisy_angle(0.03, 0.0)),
        circle("noise of the angle 3°", altered::noisy_angle(0.0, PI / 60.0)),
        circle("encoder of 64 counts, speed by differences", altered::encoder(64.0)),
        Course::misread("encoder of 64 counts, speed by differences", NotWrong, altered::encoder(64.0)),
        Course::misread("encoder of 32 counts, speed by differences", NotWrong, altered::encoder(32.0)),
        Course::misread("encoder eccentric by 1 %", NotWrong, altered::eccentric(0.01)),
        Course::misread("speed in rpm", NotValid, altered::speed(|omega| omega / RPM)),
        Course::misread("speed of the wrong sign", NotValid, altered::speed(|omega| -omega)),
        Course::misread("speed missing", NotValid, altered::speed(|_| 0.0)),
    ]
}

/// A circle with a radius of 30 µm that does not turn with the rotor.
fn path_of_43_hz(scenario: &mut Scenario, _: u64) {
    cases::trajectory(scenario, [30e-6; 2], (3, 0.0), TAU * 43.0);
    scenario.set("plant", "omega", 3000.0 * RPM);
}

/// Errors of the position and current readings that the estimator does not model.
fn readings() -> Vec<Course> {
    let misstated = |name: &str, variable: &'static str, factor: f64| Course {
        only: Some(true),
        ..Course::new(name, NotWrong, 1.0, move |scenario, _| scale(scenario, variable, factor))
    };
    let coloured = |name: &str, white: &'static str, alter: Alter| {
        let set = move |scenario: &mut Scenario, _| scenario.set("plant", white, 0.0);
        Course { alter: Some(alter), ..Course::new(name, NotWrong, 1.0, set) }
    };
    let currents = altered::coloured(NOISE[1], 100.0, |readings| &mut readings.current_a);
    let positions = altered::coloured(NOISE[0], 1000.0, |readings| &mut readings.position_m);
    let missing = |name: &str, asked, how, when| Course::misread(name, asked, altered::missing(how, when));
    let hundredth = |_, draw: &mut Draw| draw.chance(0.01);
    let three_of_fifty = |number, _: &mut Draw| number % 50 < 3;
    let run_out = altered::added(|_, theta| [libm::cos(theta), libm::sin(theta)].map(|part| 1e-6 * part));
    let hum = altered::added(|time_s, _| [0.5e-6 * libm::sin(TAU * 50.0 * time_s), 0.0]);
    vec![
        coloured("currents coloured at 100 Hz", "sensor.currentNoise", currents),
        coloured("positions coloured at 1000 Hz", "sensor.positionNoise", positions),
        misstated("current noise stated as a third", "estimator.sensor.currentNoise", 1.0 / 3.0),
        misstated("position noise stated 30 % too low", "estimator.sensor.positionNoise", 0.7),
        Course::misread("currents one sample late for 50 ms", NotWrong, altered::late_currents(1.0, 0.05)),
        Course::new("path of 43 Hz", Valid, 1.0, path_of_43_hz),
        Course {
            alter: Some(altered::late_currents(0.2, 1.0)),
            ..Course::new("path of 43 Hz, currents 20 µs late", NotWrong, 1.0, path_of_43_hz)
        },
        missing("1 % of the samples repeated", Valid, Missing::Repeated, hundredth),
        missing("1 % of the samples not a number", Valid, Missing::NotANumber, hundredth),
        missing("10 % of the samples not a number", Valid, Missing::NotANumber, |_, draw| draw.chance(0.1)),
        missing("20 % of the samples not a number", NotWrong, Missing::NotANumber, |_, draw| draw.chance(0.2)),
        missing("3 of 50 samples repeated", NotWrong, Missing::Repeated, three_of_fifty),
        missing("3 of 50 samples not a number", NotWrong, Missing::NotANumber, three_of_fifty),
        Course::misread("0.1 % of the positions off by 1 µm", Valid, altered::outliers(1e-3, 1e-6)),
        Course::misread("0.1 % of the positions off by 20 µm", NotWrong, altered::outliers(1e-3, 2e-5)),
        Course::new("positions in steps of 1 µm", NotWrong, 1.0, |scenario, _| {
            scenario.set("plant", "sensor.positionResolution", 1e-6);
        }),
        Course::new("positions in steps of 1 µm, at rest, modulated", NotWrong, 1.0, |scenario, _| {
            scenario.set("plant", "sensor.positionResolution", 1e-6);
            cases::at_rest(scenario);
            cases::modulation(scenario, 0.5, 110.0);
        }),
        Course::misread("1 µm of forward run-out", Nothing, run_out),
        Course::misread("hum of 0.5 µm in a position at the speed of the rotor", Nothing, hum),
    ]
}

/// A backward force of this size, N, in one bearing of a shaft.
fn backward_in_a(scenario: &mut Scenario, size_n: f64, seed: u64) {
    let (omega, phase) = (scenario.number("plant", "omega"), Draw::new(seed).uniform(-PI, PI));
    let at_m = scenario.number("plant", "A.position");
    cases::push(scenario, &["pY", "pZ", "MY", "MZ"], scenario.duration_s, |time_s| {
        let (sin, cos) = libm::sincos(omega * time_s + phase);
        let [y, z] = [size_n * cos, -size_n * sin];
        [y, z, -at_m * z, at_m * y]
    });
}

/// Some of these courses for the other machines.
fn machines() -> Vec<Course> {
    let on = |base: &'static str, name: &str, set: fn(&mut Scenario, u64)| Course {
        base,
        ..Course::new(&format!("{base}, {name}"), Valid, 1.0, set)
    };
    let spindle = |name: &str, set: fn(&mut Scenario, u64)| on("spindle", name, set);
    let late = spindle("wrong by two, updated late, at rest", |scenario, _| {
        cases::at_rest(scenario);
        scenario.set("controller", "F0.modulation", 0.0);
        scenario.set("controller", "update.time", 0.5);
    });
    let mut all = vec![
        spindle("nominal", unchanged),
        Course { alter: Some(altered::given_lambda(0.02)), length_s: 1.5, ..late },
        spindle("first guess × 0.2", |scenario, _| guess(scenario, 0.2)),
        spindle("0.5 N backward in bearing A", |scenario, seed| backward_in_a(scenario, 0.5, seed)),
        spindle("load ramp 1 N/s", |scenario, seed| load_ramp(scenario, 1.0, seed)),
        spindle("λ drifts 2 %/s", |scenario, _| drift(scenario, [0.0, 1.0], 0.02)),
        on("spindle4", "0.3 N backward in bearing A", |scenario, seed| backward_in_a(scenario, 0.3, seed)),
    ];
    for base in ["planar4", "axial"] {
        all.extend([
            on(base, "first guess × 0.2", |scenario, _| guess(scenario, 0.2)),
            on(base, "load ramp 10 N/s", |scenario, seed| load_ramp(scenario, 10.0, seed)),
            on(base, "λ drifts 2 %/s", |scenario, _| drift(scenario, [0.0, 1.0], 0.02)),
        ]);
    }
    all
}

fn scale(scenario: &mut Scenario, path: &str, factor: f64) {
    let (element, variable) = path.split_once('.').expect("a path");
    scenario.set(element, variable, scenario.number(element, variable) * factor);
}

/// Sets the first guesses to the true λ times a factor, clamped for the controller to 0.5 to 2, or it would not hold the rotor, and
/// modulates the smallest force.
fn guess(scenario: &mut Scenario, factor: f64) {
    for (name, lambda) in scenario.machine.of_magnets("lambda0").iter().zip(scenario.truth()) {
        for (element, factor) in [("controller", factor.clamp(0.5, 2.0)), ("estimator", factor)] {
            scenario.set(element, name, factor * lambda);
        }
    }
    scenario.set("controller", "F0.modulation", 0.5);
}

/// Lets a variable of the plant grow by a fraction between two instants in s.
fn change(scenario: &mut Scenario, variable: &str, time_s: [f64; 2], fraction: f64) {
    let value = scenario.number("plant", variable);
    scenario.follow(&[&format!("plant.{variable}")], &time_s, [value, value * (1.0 + fraction)], false);
}

/// Lets all λ grow by a fraction between two instants in s.
fn drift(scenario: &mut Scenario, time_s: [f64; 2], fraction: f64) {
    for name in scenario.machine.of_magnets("lambda") {
        change(scenario, &name, time_s, fraction);
    }
}

/// Ramps the load at a rate in N/s, in a random direction.
fn load_ramp(scenario: &mut Scenario, rate: f64, seed: u64) {
    let (sin, cos) = libm::sincos(Draw::new(seed).uniform(-PI, PI));
    match scenario.machine.radial() > 0 {
        true => cases::push(scenario, &["pY", "pZ"], scenario.duration_s, |time_s| {
            [cos, sin].map(|part| rate * time_s * part)
        }),
        false => cases::push(scenario, &["pX"], scenario.duration_s, |time_s| [rate.copysign(cos) * time_s]),
    }
}
