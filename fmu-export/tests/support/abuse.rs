//! An importer that makes random calls: in any order, with any arguments that C allows, on several instances.
//!
//! Bytes choose the calls: random ones in a test, those of a fuzzer in its target. Foreign pointers and arrays
//! shorter than stated are excluded, because they cannot be detected.

use std::ptr::{null, null_mut};

use fmu_export::fmi2::bindings::*;
use fmu_export::variable::Value;

use super::ffi::{Fmu, Request, text};
use super::library::FMUS;
use crate::call;

/// A source of bytes; `None` is the end.
pub trait Source {
    /// The next byte.
    fn byte(&mut self) -> Option<u8>;

    /// A number below a limit.
    fn below(&mut self, limit: usize) -> Option<usize> {
        let low = usize::from(self.byte()?);
        if limit <= 256 {
            return Some(low % limit);
        }
        Some((low + 256 * usize::from(self.byte()?)) % limit)
    }

    /// A number: usually close to `usual`, otherwise an odd one.
    fn real(&mut self, usual: f64) -> Option<f64> {
        const ODD: [f64; 20] = [
            0.0,
            -0.0,
            1.0,
            -1.0,
            1e-9,
            1e-4,
            3e-5,
            1e3,
            -1e3,
            1e9,
            1e155,
            1e300,
            f64::MAX,
            f64::MIN,
            f64::MIN_POSITIVE,
            5e-324,
            f64::NAN,
            f64::INFINITY,
            f64::NEG_INFINITY,
            std::f64::consts::PI,
        ];
        let choice = self.below(40)?;
        if let Some(odd) = ODD.get(choice) {
            return Some(*odd);
        }
        let part = f64::from(self.byte()?) / 256.0;
        Some(if usual == 0.0 { 1e-4 * (part - 0.5) } else { usual * (0.9 + 0.2 * part) })
    }

    /// Pointer and length to pass for a list: sometimes null, or an impossible length.
    fn pointer<T>(&mut self, list: &[T]) -> Option<(*const T, usize)> {
        Some(match self.below(64)? {
            0 => (null(), list.len()),
            1 => (null(), usize::MAX),
            2 => (list.as_ptr(), usize::MAX),
            3 => (list.as_ptr(), 0),
            _ => (list.as_ptr(), list.len()),
        })
    }

    /// Length of a step in seconds, usually a sensible one.
    fn step_length(&mut self) -> Option<f64> {
        Some(match self.below(16)? {
            0 => 1.1e-16,
            1 => 0.0,
            2 => self.real(1e-3)?.clamp(-1.0, 5e-3),
            3 => 1e-4 * f64::from(self.byte()?),
            4..=6 => 1e-4 * f64::from(self.byte()?) / 256.0,
            _ => 1e-4,
        })
    }

    /// A copy with up to two changed bytes, sometimes truncated.
    fn damaged(&mut self, bytes: &[u8]) -> Option<Vec<u8>> {
        let mut bytes = bytes.to_vec();
        for _ in 0..self.below(3)? {
            let place = self.below(bytes.len().min(65_536))?;
            bytes[place] = self.byte()?;
        }
        if self.below(8)? == 0 {
            let length = self.below(bytes.len().min(65_536))?;
            bytes.truncate(length);
        }
        Some(bytes)
    }
}

/// Bytes of a fuzzer.
pub struct Given<'b>(pub &'b [u8]);

impl Source for Given<'_> {
    fn byte(&mut self) -> Option<u8> {
        let (first, rest) = self.0.split_first()?;
        self.0 = rest;
        Some(*first)
    }
}

const MOST_SNAPSHOTS: usize = 12;

/// The importer with its instances, snapshots and serialized bytes.
pub struct Abuse<S> {
    source: S,
    models: Vec<&'static str>,
    instances: Vec<(usize, Fmu)>,
    snapshots: Vec<(usize, fmi2FMUstate)>,
    written: Vec<Vec<u8>>,
    /// Number of calls.
    pub calls: u64,
    /// Calls that returned fmi2OK.
    pub served: u64,
    /// Calls that returned fmi2Error.
    pub refused: u64,
    /// Instances made and instances refused.
    pub instantiations: [u64; 2],
    /// Completed steps.
    pub steps: u64,
}

impl<S> Drop for Abuse<S> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            return;
        }
        for (model, mut state) in self.snapshots.drain(..) {
            assert_eq!(Fmu::new(self.models[model]).free_state(&mut state), fmi2Status::fmi2OK);
        }
    }
}

impl<S: Source> Abuse<S> {
    /// With two fresh instances of each model.
    pub fn new(source: S) -> Self {
        let models: Vec<&str> = FMUS.models().iter().map(|model| model.info.name).collect();
        let instances: Vec<_> =
            (0..2 * models.len()).map(|at| (at % models.len(), Fmu::new(models[at % models.len()]))).collect();
        Self {
            source,
            instantiations: [instances.len() as u64, 0],
            models,
            instances,
            snapshots: Vec::new(),
            written: Vec::new(),
            calls: 0,
            served: 0,
            refused: 0,
            steps: 0,
        }
    }

    fn below(&mut self, limit: usize) -> Option<usize> {
        self.source.below(limit)
    }

    fn real(&mut self, usual: f64) -> Option<f64> {
        self.source.real(usual)
    }

    /// A value reference; sometimes one of no variable.
    fn reference(&mut self, at: usize) -> Option<fmi2ValueReference> {
        let count = self.instances[at].1.variables().len();
        Some(match self.below(64)? {
            0 => fmi2ValueReference::MAX,
            1 => count as fmi2ValueReference,
            _ => self.below(count)? as fmi2ValueReference,
        })
    }

    fn usual(&self, at: usize, reference: fmi2ValueReference) -> f64 {
        let variable = self.instances[at].1.variables().get(reference as usize);
        match variable.map(|variable| variable.start()) {
            Some(Value::Real(start)) => start,
            _ => 1.0,
        }
    }

    /// Checks the result of a call on a live instance: every error has one message, a success none.
    fn answered(&mut self, at: usize, status: fmi2Status) -> bool {
        self.calls += 1;
        let messages = self.instances[at].1.take_messages();
        let errors = messages.iter().filter(|message| message.status == fmi2Status::fmi2Error).count();
        for message in &messages {
            assert!(!message.text.contains("a defect of this FMU"), "{message:?}");
        }
        match status {
            fmi2Status::fmi2OK => assert_eq!(errors, 0, "{messages:?}"),
            fmi2Status::fmi2Error => assert_eq!(errors, 1, "{messages:?}"),
            other => panic!("{other:?} is no answer of these FMUs: {messages:?}"),
        }
        self.served += u64::from(status == fmi2Status::fmi2OK);
        self.refused += u64::from(status == fmi2Status::fmi2Error);
        status == fmi2Status::fmi2OK
    }

    /// Makes one call. `None` at the end of the bytes.
    #[allow(clippy::too_many_lines, reason = "one arm per function")]
    pub fn step(&mut self) -> Option<()> {
        let at = self.below(self.instances.len())?;
        let c = self.instances[at].1.component();
        let ok = match self.below(48)? {
            0..=11 => return self.advance(at),
            12..=14 => return self.begin(at),
            15..=19 => {
                let (references, mut values) = self.list(at)?;
                let ((first, count), some) = (self.source.pointer(&references)?, self.below(16)? != 0);
                let place = if some { values.as_mut_ptr() } else { null_mut() };
                // SAFETY: the instance is live; the arrays are as long as stated, or null, or impossible.
                let status = unsafe { call!(fmi2GetReal: fmi2GetRealTYPE(c, first, count, place)) };
                let ok = self.answered(at, status);
                assert!(!ok || values.iter().take(count).all(|value| value.is_finite()), "{references:?} {values:?}");
                ok
            }
            20..=24 => {
                let (references, values) = self.list(at)?;
                let (first, count) = self.source.pointer(&references)?;
                let place = if self.below(32)? == 0 { null() } else { values.as_ptr() };
                // SAFETY: as above.
                let status = unsafe { call!(fmi2SetReal: fmi2SetRealTYPE(c, first, count, place)) };
                self.answered(at, status)
            }
            25 | 26 => {
                let integers = [self.below(6)? as i32 - 1, i32::MAX, i32::MIN, 0];
                let value = [integers[self.below(6)?.saturating_sub(2)]];
                let reference = [self.reference(at)?];
                // SAFETY: as above.
                let status = unsafe {
                    match self.below(4)? {
                        0 => call!(fmi2SetBoolean: fmi2SetBooleanTYPE(c, reference.as_ptr(), 1, value.as_ptr())),
                        _ => call!(fmi2SetInteger: fmi2SetIntegerTYPE(c, reference.as_ptr(), 1, value.as_ptr())),
                    }
                };
                self.answered(at, status)
            }
            27 => {
                let (reference, mut value) = ([self.reference(at)?], [-7]);
                let (choice, place) = (self.below(2)?, value.as_mut_ptr());
                // SAFETY: as above.
                let status = unsafe {
                    match choice {
                        0 => call!(fmi2GetBoolean: fmi2GetBooleanTYPE(c, reference.as_ptr(), 1, place)),
                        _ => call!(fmi2GetInteger: fmi2GetIntegerTYPE(c, reference.as_ptr(), 1, place)),
                    }
                };
                let ok = self.answered(at, status);
                assert!(!(ok && choice == 0) || (0..=1).contains(&value[0]));
                ok
            }
            28 => {
                let count = self.below(2)?;
                let mut values = [null()];
                // SAFETY: as above.
                let status = unsafe {
                    match self.below(2)? {
                        0 => call!(fmi2GetString: fmi2GetStringTYPE(c, [0].as_ptr(), count, values.as_mut_ptr())),
                        _ => call!(fmi2SetString: fmi2SetStringTYPE(c, [0].as_ptr(), count, values.as_ptr())),
                    }
                };
                self.answered(at, status)
            }
            29 => {
                let times = [self.real(0.0)?, self.real(1.0)?, self.real(1e-6)?];
                let flags = [self.below(3)? as i32 - 1, self.below(3)? as i32 - 1];
                // SAFETY: the instance is live.
                let status = unsafe {
                    call!(fmi2SetupExperiment: fmi2SetupExperimentTYPE(c, flags[0], times[2], times[0], flags[1], times[1]))
                };
                self.answered(at, status)
            }
            30 => {
                let status = self.instances[at].1.enter_initialization();
                self.answered(at, status)
            }
            31 => {
                let status = self.instances[at].1.exit_initialization();
                self.answered(at, status)
            }
            32 => {
                let status = self.instances[at].1.terminate();
                self.answered(at, status)
            }
            33 => {
                let status = self.instances[at].1.reset();
                self.answered(at, status)
            }
            34 => {
                let (time, length) = (self.real(0.0)?, self.real(1e-4)?);
                let status = self.instances[at].1.step(time, length);
                self.answered(at, status)
            }
            35 | 36 => return self.save(at),
            37 | 38 => return self.restore(at),
            39 | 40 => {
                let (unknowns, mut derivatives) = self.list(at)?;
                let (knowns, direction) = self.list(at)?;
                let ((first, count), (known, known_count)) =
                    (self.source.pointer(&unknowns)?, self.source.pointer(&knowns)?);
                let place = derivatives.as_mut_ptr();
                // SAFETY: the instance is live; the arrays are as long as stated, or null, or impossible.
                let status = unsafe {
                    call!(fmi2GetDirectionalDerivative: fmi2GetDirectionalDerivativeTYPE(
                        c, first, count, known, known_count, direction.as_ptr(), place,
                    ))
                };
                let ok = self.answered(at, status);
                assert!(!ok || derivatives.iter().take(count).all(|value| value.is_finite()));
                ok
            }
            41 | 42 => {
                let (references, values) = self.list(at)?;
                let mut orders = Vec::new();
                for _ in &references {
                    orders.push([1, 1, 1, 2, 3, 4, 0, -1, i32::MAX, 5][self.below(10)?]);
                }
                let ((first, count), order) = (self.source.pointer(&references)?, orders.as_ptr());
                // SAFETY: as above.
                let status = unsafe {
                    call!(fmi2SetRealInputDerivatives: fmi2SetRealInputDerivativesTYPE(c, first, count, order, values.as_ptr()))
                };
                self.answered(at, status)
            }
            43 => {
                let (references, mut values) = self.list(at)?;
                let orders: Vec<i32> = references.iter().map(|reference| (*reference % 4) as i32).collect();
                let ((first, count), place) = (self.source.pointer(&references)?, values.as_mut_ptr());
                // SAFETY: as above.
                let status = unsafe {
                    call!(fmi2GetRealOutputDerivatives: fmi2GetRealOutputDerivativesTYPE(c, first, count, orders.as_ptr(), place))
                };
                let ok = self.answered(at, status);
                assert!(!ok || values.iter().take(count).all(|value| value.is_finite()));
                ok
            }
            44 => return self.ask(at),
            45 => return self.log(at),
            46 => return self.replace(at),
            _ => return self.null(),
        };
        let _ = ok;
        Some(())
    }

    fn list(&mut self, at: usize) -> Option<(Vec<fmi2ValueReference>, Vec<f64>)> {
        let count = self.below(5)?;
        let mut references = Vec::with_capacity(count);
        let mut values = Vec::with_capacity(count);
        for _ in 0..count {
            let reference = self.reference(at)?;
            references.push(reference);
            values.push(self.real(self.usual(at, reference))?);
        }
        Some((references, values))
    }

    /// A step after the last one, usually of a sensible length.
    fn advance(&mut self, at: usize) -> Option<()> {
        let mut time = 0.0;
        let c = self.instances[at].1.component();
        // SAFETY: the instance is live, and the place can be written.
        let status = unsafe {
            call!(fmi2GetRealStatus: fmi2GetRealStatusTYPE(c, fmi2StatusKind::fmi2LastSuccessfulTime, &raw mut time))
        };
        self.answered(at, status);
        let length = self.source.step_length()?;
        let status = self.instances[at].1.step(time, length);
        self.steps += u64::from(self.answered(at, status));
        Some(())
    }

    /// Brings an instance to its first step.
    fn begin(&mut self, at: usize) -> Option<()> {
        if self.below(4)? == 0 {
            let status = self.instances[at].1.reset();
            self.answered(at, status);
        }
        let start = [0.0, 0.0, 1.0, -5.0, 1e6][self.below(5)?];
        let calls: [&dyn Fn(&Fmu) -> fmi2Status; 3] =
            [&|fmu| fmu.setup(start, None), &Fmu::enter_initialization, &Fmu::exit_initialization];
        for call in calls {
            let status = call(&self.instances[at].1);
            self.answered(at, status);
        }
        Some(())
    }

    fn save(&mut self, at: usize) -> Option<()> {
        let (model, fmu) = &self.instances[at];
        let (model, c) = (*model, fmu.component());
        if self.snapshots.len() < MOST_SNAPSHOTS && self.below(2)? == 0 {
            let mut state = null_mut();
            let status = self.instances[at].1.get_state(&mut state);
            if self.answered(at, status) {
                assert!(!state.is_null());
                self.snapshots.push((model, state));
            }
            return Some(());
        }
        if self.snapshots.is_empty() {
            // SAFETY: the instance is live; null is refused.
            let status = unsafe { call!(fmi2GetFMUstate: fmi2GetFMUstateTYPE(c, null_mut())) };
            self.answered(at, status);
            return Some(());
        }
        let chosen = self.below(self.snapshots.len())?;
        let (kind, mut state) = self.snapshots[chosen];
        let address = state;
        let status = self.instances[at].1.get_state(&mut state);
        let ok = self.answered(at, status);
        assert_eq!(ok, kind == model, "a snapshot of another model is no place for this one's");
        assert_eq!(state, address);
        Some(())
    }

    fn restore(&mut self, at: usize) -> Option<()> {
        let model = self.instances[at].0;
        let choice = self.below(8)?;
        if choice == 7 || self.snapshots.is_empty() {
            let status = self.instances[at].1.set_state(null_mut());
            assert!(!self.answered(at, status));
            return Some(());
        }
        let chosen = self.below(self.snapshots.len())?;
        let (kind, mut state) = self.snapshots[chosen];
        match choice {
            0..=2 => {
                let status = self.instances[at].1.set_state(state);
                let ok = self.answered(at, status);
                assert_eq!(ok, kind == model);
            }
            3 => {
                let status = self.instances[at].1.free_state(&mut state);
                assert!(self.answered(at, status) && state.is_null());
                self.snapshots.swap_remove(chosen);
            }
            4 => {
                if let Ok(bytes) = self.instances[at].1.serialize(state) {
                    self.calls += 2;
                    self.written.truncate(3);
                    self.written.insert(0, bytes);
                }
            }
            _ => {
                let Some(bytes) = self.written.first() else { return Some(()) };
                let bytes = self.source.damaged(bytes)?;
                let mut state = null_mut();
                let status = self.instances[at].1.deserialize(&bytes, &mut state);
                if self.answered(at, status) {
                    self.snapshots.push((model, state));
                    if self.snapshots.len() > MOST_SNAPSHOTS {
                        let (_, mut oldest) = self.snapshots.remove(0);
                        let status = self.instances[at].1.free_state(&mut oldest);
                        self.answered(at, status);
                    }
                }
            }
        }
        Some(())
    }

    fn ask(&mut self, at: usize) -> Option<()> {
        let c = self.instances[at].1.component();
        let kind = fmi2StatusKind(self.below(6)? as u32);
        let (mut status, mut real, mut whole, mut words) = (fmi2Status::fmi2OK, 0.0, 0, null());
        let choice = self.below(7)?;
        // SAFETY: the instance is live; the places can be written, or are null.
        let answer = unsafe {
            match choice {
                0 => call!(fmi2GetStatus: fmi2GetStatusTYPE(c, kind, &raw mut status)),
                1 => call!(fmi2GetRealStatus: fmi2GetRealStatusTYPE(c, kind, &raw mut real)),
                2 => call!(fmi2GetIntegerStatus: fmi2GetIntegerStatusTYPE(c, kind, &raw mut whole)),
                3 => call!(fmi2GetBooleanStatus: fmi2GetBooleanStatusTYPE(c, kind, &raw mut whole)),
                4 => call!(fmi2GetStringStatus: fmi2GetStringStatusTYPE(c, kind, &raw mut words)),
                5 => call!(fmi2GetStatus: fmi2GetStatusTYPE(c, kind, null_mut())),
                _ => call!(fmi2CancelStep: fmi2CancelStepTYPE(c)),
            }
        };
        self.answered(at, answer);
        Some(())
    }

    fn log(&mut self, at: usize) -> Option<()> {
        const NAMES: [&std::ffi::CStr; 6] =
            [c"logAll", c"logEvents", c"logSingularLinearSystems", c"logStatusError", c"", c"nothing of the kind"];
        let c = self.instances[at].1.component();
        let names = [NAMES[self.below(6)?].as_ptr(), if self.below(8)? == 0 { null() } else { NAMES[1].as_ptr() }];
        let (on, (first, count)) = (self.below(2)? as i32, self.source.pointer(&names)?);
        // SAFETY: the instance is live; the texts end with a zero byte; the array is as long as stated, null, or impossible.
        let status = unsafe { call!(fmi2SetDebugLogging: fmi2SetDebugLoggingTYPE(c, on, count, first)) };
        self.answered(at, status);
        // Switches errors on again, because the next one is counted.
        let status = self.instances[at].1.set_logging(true, &["logStatusError"]);
        self.answered(at, status);
        Some(())
    }

    /// Frees an instance and makes another, of any model, which may be refused.
    fn replace(&mut self, at: usize) -> Option<()> {
        let model = self.below(self.models.len())?;
        let mut request = Request { logging: true, ..Request::of(self.models[model]) };
        match self.below(16)? {
            0 => request.name = None,
            1 => request.name = Some(text("")),
            2 => request.guid = None,
            3 => request.guid = Some(text("{00000000-0000-0000-0000-000000000000}")),
            4 => request.kind = fmi2Type::fmi2ModelExchange,
            5 => request.callbacks = false,
            6 => request.resources = Some(text("%%%:///no/such place")),
            7 => request.resources = None,
            8 => request.name = Some(text("/a path/with.dots and blanks\u{b5}")),
            9 => request.logging = false,
            _ => {}
        }
        let made = request.instantiate(self.models[model]);
        self.instantiations[usize::from(made.is_err())] += 1;
        self.calls += 1;
        if let Ok(fmu) = made {
            // The assignment frees the former instance.
            self.calls += 1;
            self.instances[at] = (model, fmu);
        }
        Some(())
    }

    /// Calls on a null instance.
    fn null(&mut self) -> Option<()> {
        let c = null_mut();
        // SAFETY: null is refused before other arguments are used.
        let status = unsafe {
            match self.below(6)? {
                0 => call!(fmi2DoStep: fmi2DoStepTYPE(c, 0.0, 1e-4, fmi2True)),
                1 => call!(fmi2GetReal: fmi2GetRealTYPE(c, null(), 1, null_mut())),
                2 => call!(fmi2Reset: fmi2ResetTYPE(c)),
                3 => call!(fmi2GetFMUstate: fmi2GetFMUstateTYPE(c, null_mut())),
                4 => call!(fmi2Terminate: fmi2TerminateTYPE(c)),
                _ => {
                    call!(fmi2FreeInstance: fmi2FreeInstanceTYPE(c));
                    fmi2Status::fmi2Error
                }
            }
        };
        self.calls += 1;
        self.refused += 1;
        assert_eq!(status, fmi2Status::fmi2Error);
        Some(())
    }
}
