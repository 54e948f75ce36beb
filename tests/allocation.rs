//! A step allocates nothing and makes no system call, in any model.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::path::Path;

use fmu_export::Instance;
use fmu_export::Step;
use fmu_export::log::Silent;
use magnetic_bearing::simulation::{Scenario, simulate};
use support::named::Named;

mod support;

/// Steps of every instance; fewer without optimisation, to keep the test short.
const STEPS: u64 = if cfg!(debug_assertions) { 50_000 } else { 200_000 };

const STEP_S: f64 = 1e-4;

struct Counting;

thread_local! {
    static CALLS: Cell<u64> = const { Cell::new(0) };
    static BYTES: Cell<usize> = const { Cell::new(0) };
}

fn count(bytes: usize) {
    CALLS.with(|calls| calls.set(calls.get() + 1));
    BYTES.with(|all| all.set(all.get() + bytes));
}

// SAFETY: every request goes to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        // SAFETY: the caller's contract is that of the system's allocator.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(0);
        // SAFETY: the caller's contract is that of the system's allocator.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size);
        // SAFETY: the caller's contract is that of the system's allocator.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// The closed loop of a scenario, wired by index.
struct Loop {
    instances: Vec<Instance>,
    /// Element and variable, from and to.
    wires: Vec<[(usize, usize); 2]>,
    steps: u64,
}

impl Loop {
    fn new(scenario: &str, settings: &[(&str, &str)]) -> Self {
        let mut scenario = Scenario::open(Path::new(scenario)).expect("a built-in scenario");
        for (path, value) in settings {
            scenario.assign(path, value).expect("a variable of the loop");
        }
        let started = |element| simulate::start(element).expect("parameters that are in order");
        let instances = scenario.elements.iter().map(started).collect();
        Self { instances, wires: scenario.connections(), steps: 0 }
    }

    /// Does one step of every instance; returns whether all succeeded.
    fn step(&mut self) -> bool {
        let mut fine = true;
        for [(from, output), (to, input)] in &self.wires {
            let value = self.instances[*from].get(*output);
            fine &= value.is_ok_and(|value| self.instances[*to].set(*input, value).is_ok());
        }
        let step = Step { time_s: self.steps as f64 * STEP_S, length_s: STEP_S };
        for instance in &mut self.instances {
            fine &= instance.step(step, &mut Silent).is_ok();
        }
        self.steps += 1;
        fine
    }
}

/// The loop with every method, noise known and estimated, all tolerances, and estimates used by the controller.
fn loops() -> [(Loop, u64); 5] {
    let noise = [("plant.sensor.positionNoise", "0.1 µm"), ("plant.sensor.currentNoise", "10 mA")];
    let noisy = |scenario, more: &[_]| Loop::new(scenario, &[&noise[..], more].concat());
    let known = [
        ("estimator.sensor.positionNoise", "0.1 µm"),
        ("estimator.sensor.currentNoise", "10 mA"),
        ("estimator.tolerance.s", "1 µm"),
        ("estimator.tolerance.alpha", "0.1 deg"),
        ("estimator.hold", "linear"),
    ];
    // Every sample uses another estimate of λ.
    let update = ("controller.update.mode", "whenValid");
    // The data contradict the model, and the estimator keeps restarting.
    let changing = [("estimator.identify.unbalance", "false"), update];
    let voltage = [("plant.drive", "voltage"), ("controller.drive", "voltage"), ("estimator.hold", "linear"), update];
    [
        (Loop::new("paper", &[update]), STEPS / 4),
        (noisy("unbalanced", &[]), STEPS),
        (noisy("unbalanced", &known), STEPS / 4),
        (noisy("unbalanced", &changing), STEPS / 4),
        (noisy("spindle", &voltage), STEPS / 20),
    ]
}

#[test]
fn a_step_allocates_nothing() {
    for (mut closed, steps) in loops() {
        let before = CALLS.get();
        for _ in 0..steps {
            assert!(closed.step(), "step {} fails", closed.steps);
        }
        let calls = CALLS.get() - before;
        assert_eq!(calls, 0, "calls of the allocator in {steps} steps of {} instances", closed.instances.len());
    }
}

/// Without a controller it falls into its backup bearings: covers sensors, coils, contact and friction.
#[test]
fn a_step_of_a_spindle_allocates_nothing() {
    let settings = [
        ("gravity.X", 1.0),
        ("gravity.Z", -9.81),
        ("A.touchdown.friction", 0.05),
        ("unbalance[1].magnitude", 1e-5),
        ("A.u[1]", 0.5),
        ("sensor.positionNoise", 1e-7),
        ("sensor.delay", 1.5e-4),
        ("drive", 2.0),
    ];
    let mut spindle = Named::started("MagneticSpindle", &settings);
    let before = CALLS.get();
    for step in 0..STEPS / 10 {
        spindle.step(step as f64 * STEP_S, STEP_S);
    }
    assert_eq!(CALLS.get() - before, 0, "calls of the allocator");
    for name in ["A.contact", "B.contact", "X.contact"] {
        assert_eq!(spindle.get(name), 1.0, "{name}: the test shows nothing");
    }
}

/// An instance and its snapshots share large constant data, such as the kernels of the estimator.
/// Fails if a snapshot copies the estimator.
#[test]
fn a_snapshot_copies_only_the_state() {
    let mut estimator = Named::new("AlgebraicEstimator");
    // The paper's method has kernels as long as its window.
    for (name, value) in [("method", 2.0), ("Tf", 0.1), ("epsilon", 0.1)] {
        estimator.set(name, value);
    }
    let before = BYTES.get();
    estimator.start().expect("the start values are in order");
    let start = BYTES.get() - before;
    for step in 0..400 {
        estimator.step(f64::from(step) * STEP_S, STEP_S);
    }
    let before = BYTES.get();
    let mut snapshot = estimator.instance.duplicate().expect("a copy");
    let saved = BYTES.get() - before;
    let before = BYTES.get();
    assert!(snapshot.copy_from(&estimator.instance));
    let again = BYTES.get() - before;
    assert!(2 * saved < start && again <= saved, "{start} bytes for a start, {saved} for a snapshot, {again} into one");
}

#[test]
fn the_counter_counts() {
    let before = CALLS.get();
    drop(std::hint::black_box(vec![1_u8]));
    assert_eq!(CALLS.get() - before, 2);
}

/// The kernel kills the stepping process at its first system call: seccomp in strict mode allows only
/// reading, writing, and exit.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod confined {
    use super::{Loop, loops};

    unsafe extern "C" {
        fn fork() -> i32;
        fn waitpid(process: i32, status: *mut i32, options: i32) -> i32;
        fn prctl(option: i32, ...) -> i32;
        fn syscall(number: i64, ...) -> i64;
    }

    const PR_SET_SECCOMP: i32 = 22;
    const SECCOMP_MODE_STRICT: u64 = 1;
    const SYS_EXIT: i64 = 60;
    const SYS_GETPID: i64 = 39;
    const KILLED: i32 = 9;

    /// The status, from `waitpid`, of a process that does this many steps.
    fn confine(closed: &mut Loop, steps: u64, call: bool) -> i32 {
        // SAFETY: the child only steps, which the other test shows not to allocate, and ends without cleaning up;
        // all arguments have the types that the functions expect.
        unsafe {
            let child = fork();
            if child == 0 {
                let mut failed = i64::from(prctl(PR_SET_SECCOMP, SECCOMP_MODE_STRICT) != 0);
                for _ in 0..steps {
                    failed |= i64::from(!closed.step());
                }
                if call {
                    syscall(SYS_GETPID);
                }
                syscall(SYS_EXIT, failed);
            }
            let mut status = -1;
            assert_eq!(waitpid(child, &mut status, 0), child);
            status
        }
    }

    #[test]
    fn a_step_makes_no_system_call() {
        for (mut closed, steps) in loops() {
            assert_eq!(confine(&mut closed, steps, false), 0, "the status of the process after {steps} steps");
        }
    }

    #[test]
    fn a_system_call_is_detected() {
        let [(mut closed, _), ..] = loops();
        assert_eq!(confine(&mut closed, 1, true) & 0x7f, KILLED);
    }
}
