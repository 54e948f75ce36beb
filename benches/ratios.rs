//! The cost tables of docs/: each cost relative to a comparable one, measured in turn. `scripts/bench` runs it.

#[path = "support/interleave.rs"]
mod interleave;
mod support;

use std::ffi::CString;
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::ptr::{null, null_mut};
use std::time::Instant;

use fmu_export::fmi2::bindings::*;
use fmu_export::fmi3::bindings::*;
use fmu_export::{ModelType, Standard};
use interleave::{candidate, shown, table};
use libloading::{Library, Symbol};
use magnetic_bearing::bearing::RotorConfig;
use magnetic_bearing::control::controller::{Controller, ControllerConfigOf, ControllerInput};
use magnetic_bearing::estimation::paper::window::{Sample, WindowSums};
use magnetic_bearing::estimation::{
    Estimator, EstimatorConfig, EstimatorConfigOf, EstimatorInput, EstimatorInputOf, EstimatorState, Method, Tolerance,
};
use magnetic_bearing::package;
use magnetic_bearing::plant::{InputTrajectory, Plant, PlantConfigOf, PlantInput};
use magnetic_bearing::simulation::{Scenario, simulate};

const ROUNDS: usize = 101;

fn main() {
    // `cargo test --benches` must not time anything.
    if std::env::args().any(|argument| argument == "--test") {
        return;
    }
    let record = support::record();
    steps(&record);
    first_and_millionth(&record);
    interface(&record);
    closed_loop();
    worst(&record);
}

/// A function of the loaded library.
macro_rules! function {
    ($library:expr, $name:ident: $type:ty) => {
        // SAFETY: the function has the type that the bindings give it.
        unsafe { *$library.get::<$type>(concat!(stringify!($name), "\0").as_bytes()).expect("an exported function") }
            .expect("a function is no null pointer")
    };
}

/// Steps of a plant with constant currents, in A, and its outputs.
fn plant_steps<'a, const N: usize, const K: usize, const B: usize>(
    name: &str,
    config: PlantConfigOf<f64, N, K, B>,
    current_a: [f64; K],
) -> interleave::Candidate<'a> {
    let plant = Plant::new(config).expect("valid parameters");
    let mut state = plant.start(0.0);
    let start = state.clone();
    let input = PlantInput { current_a, omega_rad_s: 314.0, ..PlantInput::default() };
    candidate(name, 1000, move |times| {
        for step in 0..times {
            // Without a controller the rotor soon leaves the gap.
            if step % 20 == 0 {
                state = start.clone();
            }
            let t_s = f64::from(step % 20) * 1e-4;
            let _ = black_box(plant.advance(&mut state, &InputTrajectory::held(&input), t_s, 1e-4));
            black_box(plant.outputs(&state, &input, t_s + 1e-4));
        }
    })
}

/// Steps of a controller.
fn controller_steps<const N: usize, const K: usize, const B: usize, const G: usize>(
    name: &str,
    position_m: [f64; N],
) -> interleave::Candidate<'static> {
    let controller = Controller::new(ControllerConfigOf::<N, K, B, G>::default()).expect("valid parameters");
    let mut state = controller.start(0.0);
    let mut input = ControllerInput { position_m, omega_rad_s: 314.0, ..ControllerInput::default() };
    candidate(name, 1000, move |times| {
        for step in 0..times {
            input.position_m[1] = f64::from(step % 7) * 1e-6;
            let _ = black_box(controller.sample(&mut state, &input));
        }
    })
}

/// An estimator that has run until its estimate has settled.
fn settled(config: EstimatorConfig, record: &[EstimatorInput]) -> (Estimator, EstimatorState) {
    let warm_up = (config.window_s / config.step_s) as usize + 2000;
    let estimator = Estimator::new(config).expect("valid parameters");
    let mut state = estimator.start();
    for input in record.iter().cycle().take(warm_up) {
        estimator.sample(&mut state, input);
    }
    (estimator, state)
}

fn paper(intervals: usize) -> EstimatorConfig {
    let window_s = intervals as f64 * 1e-4;
    EstimatorConfig { method: Method::Paper, window_s, epsilon_s: window_s, ..EstimatorConfig::default() }
}

/// The default method: noise known, estimated, and with all tolerances.
fn prediction_error() -> [(&'static str, EstimatorConfig); 3] {
    let estimated = EstimatorConfig::default();
    let known = EstimatorConfig { position_noise_m: 1e-7, current_noise_a: 1e-2, ..estimated.clone() };
    let tolerance = Tolerance {
        m_kg: 0.02,
        gap_m: 2e-6,
        alpha_rad: 2e-3,
        position_gain: 2e-3,
        position_offset_m: 2e-6,
        current_gain: 2e-3,
        current_offset_a: 5e-3,
        backward_force_n: 2.0,
        ..Tolerance::default()
    };
    let tolerances = EstimatorConfig { tolerance, ..estimated.clone() };
    [("noise given", known), ("noise estimated", estimated), ("noise estimated, all tolerances", tolerances)]
}

type FirPush =
    unsafe extern "C" fn(*mut f64, usize, usize, *const f64, usize, *const f64, *const f64, *mut f64) -> usize;

/// Compiles the peer in C; `None` where there is no compiler.
fn peer() -> Option<Library> {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/fir.c");
    let target = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("libfir.so");
    let options = ["-O3", "-march=native", "-ffast-math", "-shared", "-fPIC", "-o"];
    let done = Command::new("cc").args(options).arg(&target).arg(&source).status();
    if !done.is_ok_and(|status| status.success()) {
        println!("no C compiler: the peer in C is left out");
        return None;
    }
    // SAFETY: the library was just compiled and runs no code when loaded.
    unsafe { Library::new(&target) }.ok()
}

/// Steps of the models; the peer computes the integrals of the paper's four kernels over two positions and three magnets, in C.
fn steps(record: &[EstimatorInput]) {
    let library = peer();
    // SAFETY: the type is that of the function in fir.c.
    let fir: Option<Symbol<FirPush>> =
        library.as_ref().map(|library| unsafe { library.get(b"fir_push\0") }.expect("fir.c has this function"));
    let mut candidates = Vec::new();
    let sizes = [200, 2000, 20_000];
    for intervals in sizes {
        let n = intervals + 1;
        let weights: Vec<f64> = (0..4 * n).map(|j| (j as f64 * 0.01).sin()).collect();
        let (mut ring, mut next, mut out) = (vec![0.0; 12 * n], 0, [0.0; 24]);
        let Some(fir) = fir.as_ref() else { continue };
        let times = (400_000 / n as u32).clamp(20, 2000);
        candidates.push(candidate(format!("C, sums of the paper, N = {intervals}"), times, move |times| {
            for j in 0..times {
                let x = f64::from(j % 200) * 0.031;
                let signals = [x, 1.0 - x, x, 2.0, 3.0 - x, 0.0];
                // SAFETY: the ring holds six signals of 2 n samples, the weights are four rows of n, `out` holds 24.
                next = unsafe {
                    fir(
                        ring.as_mut_ptr(),
                        n,
                        next,
                        signals.as_ptr(),
                        4,
                        weights.as_ptr(),
                        weights.as_ptr(),
                        out.as_mut_ptr(),
                    )
                };
                black_box(&out);
            }
        }));
    }
    let peers = candidates.len();
    let beside = |at: usize, c| if at < peers { interleave::Candidate::beside(c, at) } else { c };
    for (at, intervals) in sizes.into_iter().enumerate() {
        let sums = WindowSums::new(intervals, false);
        let mut window = sums.start();
        let sample = |j: u32| {
            let x = f64::from(j % 200) * 0.031;
            Sample { position: [x, 1.0 - x], squares: [[x, 2.0, 3.0 - x], [4.0 - x, x, 1.0]] }
        };
        // Sums exist only once the window is full.
        (0..=intervals as u32).for_each(|j| {
            black_box(sums.push(&mut window, &sample(j)));
        });
        let times = (400_000 / intervals as u32).clamp(20, 2000);
        let c = candidate(format!("Rust, sums of the paper, N = {intervals}"), times, move |times| {
            for j in 0..times {
                black_box(sums.push(&mut window, &sample(j)));
            }
        });
        candidates.push(beside(at, c));
    }
    // The sums of a window of 2000 samples: a revolution at 20 kHz and 600 rpm.
    let methods = prediction_error().map(|(name, config)| (format!("predictionError, {name}"), config, 1)).into_iter();
    let papers = sizes.into_iter().enumerate().map(|(at, n)| (format!("paper, N = {n}"), paper(n), at));
    for (name, config, peer) in methods.chain(papers) {
        let times = if name.starts_with("paper") { 200 } else { record.len() as u32 };
        let (estimator, mut state) = settled(config, record);
        let mut at = 0;
        let c = candidate(format!("estimator, {name}"), times, move |times| {
            for _ in 0..times {
                black_box(estimator.sample(&mut state, &record[at % record.len()]));
                at += 1;
            }
        });
        candidates.push(beside(peer, c));
    }
    candidates.push(plant_steps("plant, current drive", PlantConfigOf::<f64, 2, 3, 1>::default(), [2.0; 3]));
    candidates.push(plant_steps("spindle, current drive", PlantConfigOf::<f64, 5, 8, 3>::default(), [2.0; 8]));
    candidates.push(controller_steps::<2, 3, 1, 1>("controller", [30e-6, 0.0]));
    candidates.push(controller_steps::<5, 8, 3, 3>("controller of the spindle", [0.0; 5]));
    for (name, noise) in [("noise given", [1e-7, 1e-2]), ("noise estimated", [0.0; 2])] {
        let [position_noise_m, current_noise_a] = noise;
        let config = EstimatorConfigOf { position_noise_m, current_noise_a, ..EstimatorConfigOf::default() };
        let estimator = Estimator::<RotorConfig<f64, 3>, 5, 8, 2>::new(config).expect("valid parameters");
        let (mut state, record, mut at) = (estimator.start(), spindle_record(), 0);
        candidates.push(candidate(format!("estimator of the spindle, {name}"), 1000, move |times| {
            for _ in 0..times {
                let _ = black_box(estimator.sample(&mut state, &record[at]));
                // The record repeats: it holds whole revolutions and periods of the modulation.
                at = (at + 1) % record.len();
            }
        }));
    }
    table("one step of", ROUNDS, candidates);
}

/// Inputs of the spindle's estimator in the scenario `spindle` over 0.1 s of steady operation.
fn spindle_record() -> Vec<EstimatorInputOf<5, 8>> {
    let scenario = Scenario::open(Path::new("spindle")).expect("a scenario of the program");
    let run = simulate::run_for(&scenario, |name| name.starts_with("plant.")).expect("a run");
    let column = |name: String| run.recording.get(&format!("plant.{name}")).expect("an output of the plant").to_vec();
    let readings = ["A.Ym", "A.Zm", "B.Ym", "B.Zm", "Xm"].map(|name| column(name.into()));
    let currents: Vec<_> = scenario.machine.of_magnets("im").into_iter().map(column).collect();
    let theta = column("theta".into());
    let input = |at: usize| EstimatorInputOf {
        position_m: readings.each_ref().map(|column| column[at]),
        current_a: std::array::from_fn(|k| currents[k][at]),
        theta_rad: theta[at],
        omega_rad_s: 100.0 * std::f64::consts::PI,
        enable: true,
        ..EstimatorInputOf::default()
    };
    (3000..4000).map(input).collect()
}

unsafe extern "C" fn silent(_: fmi2ComponentEnvironment, _: fmi2String, _: fmi2Status, _: fmi2String, _: fmi2String) {}

/// Calls through the C interface of the library that goes into the FMUs.
fn interface(record: &[EstimatorInput]) {
    let path = package::built_library().expect("the library is built with the benchmark");
    // SAFETY: the library is this project's and runs no code when loaded.
    let library = unsafe { Library::new(path) }.expect("a library that can be loaded");
    let model = magnetic_bearing::fmu::find("AlgebraicEstimator").expect("a model");
    let index = |name: &str| {
        let variables = model.variables();
        variables.iter().position(|variable| variable.name == name).expect("a variable") as fmi2ValueReference
    };
    let instantiate = function!(library, fmi2Instantiate: fmi2InstantiateTYPE);
    let setup = function!(library, fmi2SetupExperiment: fmi2SetupExperimentTYPE);
    let enter = function!(library, fmi2EnterInitializationMode: fmi2EnterInitializationModeTYPE);
    let exit = function!(library, fmi2ExitInitializationMode: fmi2ExitInitializationModeTYPE);
    let do_step = function!(library, fmi2DoStep: fmi2DoStepTYPE);
    let set_real = function!(library, fmi2SetReal: fmi2SetRealTYPE);
    let get_real = function!(library, fmi2GetReal: fmi2GetRealTYPE);
    let set_boolean = function!(library, fmi2SetBoolean: fmi2SetBooleanTYPE);
    let free = function!(library, fmi2FreeInstance: fmi2FreeInstanceTYPE);
    let guid = CString::new(model.guid()).expect("a GUID");
    // SAFETY: null is a valid value for every callback.
    let mut callbacks: fmi2CallbackFunctions = unsafe { std::mem::zeroed() };
    // SAFETY: a logger takes further arguments, and this one reads none.
    callbacks.logger = unsafe { std::mem::transmute::<*const (), fmi2CallbackLogger>(silent as *const ()) };
    // SAFETY: all pointers live until the instance is freed.
    let component = unsafe {
        let component = instantiate(
            c"bench".as_ptr(),
            fmi2Type::fmi2CoSimulation,
            guid.as_ptr(),
            c"file:///".as_ptr(),
            &callbacks,
            fmi2False,
            fmi2False,
        );
        assert!(!component.is_null());
        setup(component, fmi2False, 0.0, 0.0, fmi2False, 0.0);
        enter(component);
        exit(component);
        component
    };
    let inputs = ["Ym", "Zm", "im[1]", "im[2]", "im[3]"].map(index);
    let outputs = ["lambdaHat[1]", "lambdaHat[2]", "lambdaHat[3]", "pYHat", "pZHat"].map(index);
    // A step that ignores its sample costs the model almost nothing; the remainder is the interface.
    // SAFETY: the arrays have one element.
    unsafe { set_boolean(component, &index("enable"), 1, &fmi2False) };
    let disabled = EstimatorInput { enable: false, ..record[0].clone() };
    let (estimator, mut state) = settled(EstimatorConfig::default(), record);
    let step = std::cell::Cell::new(0_u32);
    let mut values = [0.0; 5];
    let fmi3 = Fmi3::new(&library, &model);
    let mut candidates = vec![
        candidate("model's step, samples ignored", 2000, |times| {
            for _ in 0..times {
                black_box(estimator.sample(&mut state, black_box(&disabled)));
            }
        }),
        candidate("fmi2DoStep, samples ignored", 2000, |times| {
            for _ in 0..times {
                // SAFETY: the instance is a live one.
                let status = unsafe { do_step(component, f64::from(step.get()) * 1e-4, 1e-4, fmi2True) };
                assert_eq!(status, fmi2Status::fmi2OK);
                step.set(step.get() + 1);
            }
        })
        .beside(0),
        candidate("fmi2SetReal of 5", 2000, |times| {
            for _ in 0..times {
                // SAFETY: the arrays have five elements.
                black_box(unsafe { set_real(component, inputs.as_ptr(), 5, [1e-5, 1e-5, 2.0, 2.0, 2.0].as_ptr()) });
            }
        }),
        candidate("fmi2GetReal of 5", 2000, |times| {
            for _ in 0..times {
                // SAFETY: the arrays have five elements.
                black_box(unsafe { get_real(component, outputs.as_ptr(), 5, values.as_mut_ptr()) });
            }
        }),
    ];
    candidates.extend(fmi3.candidates());
    let medians = table("through the C interface", ROUNDS, candidates);
    println!("\nfmi2DoStep adds {} to the model's step.", shown(medians[1] - medians[0]));
    // SAFETY: the instance is not used again.
    unsafe { free(component) };
}

/// An instance of the same estimator through FMI 3.0, which ignores its samples.
struct Fmi3 {
    instance: fmi3Instance,
    do_step: <fmi3DoStepTYPE as IntoIterator>::Item,
    set: <fmi3SetFloat64TYPE as IntoIterator>::Item,
    get: <fmi3GetFloat64TYPE as IntoIterator>::Item,
    free: <fmi3FreeInstanceTYPE as IntoIterator>::Item,
    inputs: [u32; 5],
    outputs: [u32; 5],
}

impl Fmi3 {
    fn new(library: &Library, model: &ModelType) -> Self {
        let index = |name: &str| {
            model.variables().iter().position(|variable| variable.name == name).expect("a variable") as u32
        };
        let instantiate = function!(library, fmi3InstantiateCoSimulation: fmi3InstantiateCoSimulationTYPE);
        let enter = function!(library, fmi3EnterInitializationMode: fmi3EnterInitializationModeTYPE);
        let exit = function!(library, fmi3ExitInitializationMode: fmi3ExitInitializationModeTYPE);
        let set_boolean = function!(library, fmi3SetBoolean: fmi3SetBooleanTYPE);
        let token = model.description(Standard::Fmi3 { arrays: false }).token.as_str();
        let token = CString::new(token).expect("a token");
        let name = c"bench".as_ptr();
        // SAFETY: all pointers are null or live until the calls return; arrays have one element.
        let instance = unsafe {
            let instance = instantiate(name, token.as_ptr(), null(), 0, 0, 0, 0, null(), 0, null_mut(), None, None);
            assert!(!instance.is_null());
            enter(instance, 0, 0.0, 0.0, 0, 0.0);
            exit(instance);
            assert_eq!(set_boolean(instance, &index("enable"), 1, &0, 1), fmi3Status::fmi3OK);
            instance
        };
        Self {
            instance,
            do_step: function!(library, fmi3DoStep: fmi3DoStepTYPE),
            set: function!(library, fmi3SetFloat64: fmi3SetFloat64TYPE),
            get: function!(library, fmi3GetFloat64: fmi3GetFloat64TYPE),
            free: function!(library, fmi3FreeInstance: fmi3FreeInstanceTYPE),
            inputs: ["Ym", "Zm", "im[1]", "im[2]", "im[3]"].map(index),
            outputs: ["lambdaHat[1]", "lambdaHat[2]", "lambdaHat[3]", "pYHat", "pZHat"].map(index),
        }
    }

    fn candidates(&self) -> Vec<interleave::Candidate<'_>> {
        let (mut step, mut values) = (0_u32, [0.0; 5]);
        vec![
            candidate("fmi3DoStep, samples ignored", 2000, move |times| {
                let (mut event, mut end, mut early, mut time) = (0, 0, 0, 0.0);
                for _ in 0..times {
                    let begin = f64::from(step) * 1e-4;
                    // SAFETY: the instance is a live one, and all places can be written.
                    let status = unsafe {
                        (self.do_step)(self.instance, begin, 1e-4, 1, &mut event, &mut end, &mut early, &mut time)
                    };
                    assert_eq!(status, fmi3Status::fmi3OK);
                    step += 1;
                }
            })
            .beside(1),
            candidate("fmi3SetFloat64 of 5", 2000, move |times| {
                let values = [1e-5, 1e-5, 2.0, 2.0, 2.0];
                for _ in 0..times {
                    // SAFETY: the arrays have five elements.
                    black_box(unsafe { (self.set)(self.instance, self.inputs.as_ptr(), 5, values.as_ptr(), 5) });
                }
            })
            .beside(2),
            candidate("fmi3GetFloat64 of 5", 2000, move |times| {
                for _ in 0..times {
                    // SAFETY: the arrays have five elements.
                    black_box(unsafe { (self.get)(self.instance, self.outputs.as_ptr(), 5, values.as_mut_ptr(), 5) });
                }
            })
            .beside(3),
        ]
    }
}

impl Drop for Fmi3 {
    fn drop(&mut self) {
        // SAFETY: the instance is not used again.
        unsafe { (self.free)(self.instance) }
    }
}

/// One second of the closed loop.
fn closed_loop() {
    let loops = ["paper", "unbalanced"];
    let candidates = loops
        .iter()
        .map(|name| {
            let mut scenario = Scenario::open(Path::new(name)).expect("a built-in scenario");
            scenario.elements.truncate(3);
            scenario.duration_s = 1.0;
            candidate(format!("1 s of the closed loop, {name}, current drive"), 1, move |_| {
                black_box(simulate::run_for(&scenario, |_| false).expect("a scenario that runs"));
            })
        })
        .collect();
    for (median, name) in table("closed loop", 21, candidates).iter().zip(loops) {
        println!("\n{name}: {:.0} times real time.", 1e9 / median);
    }
}

/// A thousand steps at the start, after the noise is estimated, and a thousand around the millionth sample: the cost does not grow.
fn first_and_millionth(record: &[EstimatorInput]) {
    println!("\n| mean of 1000 steps | at sample 1000 | at sample 1 000 000 | ratio |\n|---|---:|---:|---:|");
    for (name, config) in prediction_error() {
        let estimator = Estimator::new(config).expect("valid parameters");
        // The median of several rounds, since one may be interrupted.
        let mut means = [Vec::new(), Vec::new()];
        for _ in 0..5 {
            let mut state = estimator.start();
            let mut inputs = record.iter().cycle();
            for (mean, before) in means.iter_mut().zip([1000, 998_000]) {
                inputs.by_ref().take(before).for_each(|input| {
                    black_box(estimator.sample(&mut state, input));
                });
                let since = Instant::now();
                inputs.by_ref().take(1000).for_each(|input| {
                    black_box(estimator.sample(&mut state, input));
                });
                mean.push(since.elapsed().as_nanos() as f64 / 1000.0);
            }
        }
        let [first, late] = means.map(|mut mean| {
            mean.sort_by(f64::total_cmp);
            mean[mean.len() / 2]
        });
        println!("| predictionError, {name} | {} | {} | {:.2} |", shown(first), shown(late), late / first);
    }
}

/// The longest of many steps, including the clock and interruptions by the system.
fn worst(record: &[EstimatorInput]) {
    println!("\n| longest of 10⁶ steps | median | 99.9 % | longest | longest repeatable |\n|---|---:|---:|---:|---:|");
    let methods = prediction_error().map(|(name, config)| (format!("predictionError, {name}"), config)).into_iter();
    let papers = [200, 2000, 20_000].map(|n| (format!("paper, N = {n}"), paper(n)));
    for (name, config) in methods.chain(papers) {
        // A window of two seconds takes as long as all others together, so it gets a tenth of the steps.
        let steps = if config.window_s > 1.0 { 100_000 } else { 1_000_000 };
        let (estimator, mut state) = settled(config, record);
        let mut spent: Vec<u32> = Vec::with_capacity(steps);
        for input in record.iter().cycle().take(steps) {
            let since = Instant::now();
            black_box(estimator.sample(&mut state, input));
            spent.push(since.elapsed().as_nanos() as u32);
        }
        // The cost of a step repeats with the samples of the record, interruptions do not: median over steps with the same sample.
        let repeatable = (0..record.len()).map(|at| {
            let mut same: Vec<u32> = spent.iter().skip(at).step_by(record.len()).copied().collect();
            same.sort_unstable();
            same[same.len() / 2]
        });
        let repeatable = shown(repeatable.max().map_or(f64::NAN, f64::from));
        spent.sort_unstable();
        let [median, high, longest] = [0.5, 0.999, 1.0].map(|part| {
            let at = ((steps as f64 * part) as usize).min(steps - 1);
            shown(f64::from(spent[at]))
        });
        println!("| estimator, {name} | {median} | {high} | {longest} | {repeatable} |");
    }
}
