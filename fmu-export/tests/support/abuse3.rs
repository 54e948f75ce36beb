//! An importer of FMI 3.0 that makes random calls: in any order, with any arguments that C allows, on several instances with and
//! without arrays. See `abuse.rs` for FMI 2.0.

use std::ptr::{null, null_mut};

use fmu_export::fmi3::bindings::*;
use fmu_export::variable::Value;

use super::abuse::Source;
use super::ffi::text;
use super::ffi3::{Fmu3, Request3, no_state};
use super::library::FMUS;
use crate::call3;

const MOST_SNAPSHOTS: usize = 12;

/// The importer with its instances, snapshots and serialized bytes.
pub struct Abuse3<S> {
    source: S,
    models: Vec<&'static str>,
    instances: Vec<(usize, Fmu3)>,
    snapshots: Vec<(usize, fmi3FMUState)>,
    written: Vec<Vec<u8>>,
    /// The end of the last step that each instance reported.
    times: Vec<f64>,
    /// Number of calls.
    pub calls: u64,
    /// Calls that returned fmi3OK.
    pub served: u64,
    /// Calls that returned fmi3Error.
    pub refused: u64,
    /// Instances made and instances refused.
    pub instantiations: [u64; 2],
    /// Completed steps.
    pub steps: u64,
}

impl<S> Drop for Abuse3<S> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            return;
        }
        for (model, mut state) in self.snapshots.drain(..) {
            assert_eq!(Fmu3::new(self.models[model], false).free_state(&mut state), fmi3Status::fmi3OK);
        }
    }
}

impl<S: Source> Abuse3<S> {
    /// With two fresh instances of each model, one of them with arrays and event mode.
    pub fn new(source: S) -> Self {
        let models: Vec<&str> = FMUS.models().iter().map(|model| model.info.name).collect();
        let instance = |at: usize| {
            let (model, arrays) = (models[at % models.len()], at < models.len());
            let request = Request3 { logging: true, event_mode: arrays, ..Request3::of(model, arrays) };
            (at % models.len(), request.instantiate(model, arrays).expect("an instance"))
        };
        let instances: Vec<_> = (0..2 * models.len()).map(instance).collect();
        Self {
            source,
            instantiations: [instances.len() as u64, 0],
            times: vec![0.0; instances.len()],
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

    /// A value reference; sometimes one of `time`, of an element within an array, or of no variable.
    fn reference(&mut self, at: usize) -> Option<u32> {
        let count = self.instances[at].1.variables().len();
        Some(match self.source.below(64)? {
            0 => u32::MAX,
            1 => count as u32 + 1,
            2 => count as u32,
            _ => self.source.below(count)? as u32,
        })
    }

    fn usual(&self, at: usize, reference: u32) -> f64 {
        let variable = self.instances[at].1.variables().get(reference as usize);
        match variable.map(|variable| variable.start()) {
            Some(Value::Real(start)) => start,
            _ => 1.0,
        }
    }

    /// Checks the result of a call on a live instance: every error has one message, a success none.
    fn answered(&mut self, at: usize, status: fmi3Status) -> bool {
        self.calls += 1;
        let messages = self.instances[at].1.take_messages();
        let errors = messages.iter().filter(|message| message.status == fmi3Status::fmi3Error).count();
        for message in &messages {
            assert!(!message.text.contains("a defect of this FMU"), "{message:?}");
        }
        match status {
            fmi3Status::fmi3OK => assert_eq!(errors, 0, "{messages:?}"),
            fmi3Status::fmi3Error => assert_eq!(errors, 1, "{messages:?}"),
            other => panic!("{other:?} is no answer of these FMUs: {messages:?}"),
        }
        self.served += u64::from(status == fmi3Status::fmi3OK);
        self.refused += u64::from(status == fmi3Status::fmi3Error);
        status == fmi3Status::fmi3OK
    }

    /// Value references and values, usually of the matching number.
    fn list(&mut self, at: usize) -> Option<(Vec<u32>, Vec<f64>)> {
        let count = self.source.below(5)?;
        let (mut references, mut values) = (Vec::new(), Vec::new());
        for _ in 0..count {
            let reference = self.reference(at)?;
            references.push(reference);
            let usual = self.usual(at, reference);
            // Often the length of an array.
            let elements = if self.instances[at].1.arrays() { self.source.below(9)?.max(1) } else { 1 };
            for _ in 0..elements {
                values.push(self.source.real(usual)?);
            }
        }
        if self.source.below(32)? == 0 {
            values.push(0.0);
        }
        Some((references, values))
    }

    /// Makes one call. `None` at the end of the bytes.
    pub fn step(&mut self) -> Option<()> {
        let at = self.source.below(self.instances.len())?;
        let c = self.instances[at].1.instance();
        let status = match self.source.below(48)? {
            0..=11 => return self.advance(at),
            12..=14 => return self.begin(at),
            15..=19 => {
                let (references, mut values) = self.list(at)?;
                let ((first, count), some) = (self.source.pointer(&references)?, self.source.below(16)? != 0);
                let place = if some { values.as_mut_ptr() } else { null_mut() };
                // SAFETY: the instance is live; the arrays are as long as stated, or null, or impossible.
                let status =
                    unsafe { call3!(fmi3GetFloat64: fmi3GetFloat64TYPE(c, first, count, place, values.len())) };
                let finite = values.iter().all(|value| value.is_finite());
                assert!(status != fmi3Status::fmi3OK || count == 0 || finite, "{references:?} {values:?}");
                status
            }
            20..=24 => {
                let (references, values) = self.list(at)?;
                let (first, count) = self.source.pointer(&references)?;
                let place = if self.source.below(32)? == 0 { null() } else { values.as_ptr() };
                // SAFETY: as above.
                unsafe { call3!(fmi3SetFloat64: fmi3SetFloat64TYPE(c, first, count, place, values.len())) }
            }
            25..=27 => self.other_types(at)?,
            28 => {
                let count = self.source.below(2)?;
                let (reference, mut values) = ([self.reference(at)?], [null()]);
                let (first, texts) = (reference.as_ptr(), [c"a text".as_ptr()]);
                // SAFETY: as above.
                unsafe {
                    match self.source.below(3)? {
                        0 => call3!(fmi3GetString: fmi3GetStringTYPE(c, first, count, values.as_mut_ptr(), count)),
                        1 => call3!(fmi3SetString: fmi3SetStringTYPE(c, first, count, values.as_ptr(), count)),
                        _ => call3!(fmi3SetString: fmi3SetStringTYPE(c, first, count, texts.as_ptr(), count)),
                    }
                }
            }
            29 => {
                let (start, stop) = (self.source.real(0.0)?, self.source.real(1.0)?);
                let stop = (self.source.below(2)? == 0).then_some(stop);
                self.instances[at].1.enter_initialization(start, stop)
            }
            30 => self.instances[at].1.exit_initialization(),
            31 => self.instances[at].1.enter_event_mode(),
            32 => self.instances[at].1.update_discrete_states(),
            33 => self.instances[at].1.enter_step_mode(),
            34 => match self.source.below(3)? {
                0 => self.instances[at].1.terminate(),
                1 => self.instances[at].1.reset(),
                _ => {
                    let (time, length) = (self.source.real(0.0)?, self.source.real(1e-4)?);
                    self.instances[at].1.step(time, length)
                }
            },
            35 | 36 => return self.save(at),
            37 | 38 => return self.restore(at),
            39 | 40 => {
                let ((unknowns, mut results), (knowns, seed)) = (self.list(at)?, self.list(at)?);
                let ((first, count), (known, known_count)) =
                    (self.source.pointer(&unknowns)?, self.source.pointer(&knowns)?);
                let (place, n) = (results.as_mut_ptr(), results.len());
                // SAFETY: the instance is live; the arrays are as long as stated, or null, or impossible.
                let status = unsafe {
                    call3!(fmi3GetDirectionalDerivative: fmi3GetDirectionalDerivativeTYPE(
                        c, first, count, known, known_count, seed.as_ptr(), seed.len(), place, n,
                    ))
                };
                let finite = results.iter().all(|value| value.is_finite());
                assert!(status != fmi3Status::fmi3OK || count == 0 || finite);
                status
            }
            41 => {
                let (references, mut values) = self.list(at)?;
                let orders: Vec<i32> = references.iter().map(|reference| (*reference % 4) as i32).collect();
                let ((first, count), place) = (self.source.pointer(&references)?, values.as_mut_ptr());
                // SAFETY: as above.
                unsafe {
                    call3!(fmi3GetOutputDerivatives: fmi3GetOutputDerivativesTYPE(
                        c, first, count, orders.as_ptr(), place, values.len()
                    ))
                }
            }
            42..=44 => self.refused_functions(at)?,
            45 => return self.log(at),
            46 => return self.replace(at),
            _ => return self.null(),
        };
        self.answered(at, status);
        Some(())
    }

    /// Reads and writes of other types.
    fn other_types(&mut self, at: usize) -> Option<fmi3Status> {
        let c = self.instances[at].1.instance();
        let reference = [self.reference(at)?];
        let (first, choice) = (reference.as_ptr(), self.source.below(12)?);
        let whole = [self.source.below(6)? as i64 - 1, i64::MAX, i64::MIN, 1 << 32, 0][self.source.below(9)? / 2];
        let (mut small, mut large, mut flag) = ([whole as i32; 9], [whole; 9], [whole as u8; 9]);
        let n = if self.source.below(8)? == 0 { self.source.below(9)? } else { 1 };
        // SAFETY: the instance is live; all arrays have room for nine values.
        let status = unsafe {
            match choice {
                0 | 1 => call3!(fmi3SetInt32: fmi3SetInt32TYPE(c, first, 1, small.as_ptr(), n)),
                2 => call3!(fmi3GetInt32: fmi3GetInt32TYPE(c, first, 1, small.as_mut_ptr(), n)),
                3 | 4 => call3!(fmi3SetInt64: fmi3SetInt64TYPE(c, first, 1, large.as_ptr(), n)),
                5 => call3!(fmi3GetInt64: fmi3GetInt64TYPE(c, first, 1, large.as_mut_ptr(), n)),
                6 | 7 => call3!(fmi3SetBoolean: fmi3SetBooleanTYPE(c, first, 1, flag.as_ptr(), n)),
                8 => {
                    flag = [7; 9];
                    let status = call3!(fmi3GetBoolean: fmi3GetBooleanTYPE(c, first, 1, flag.as_mut_ptr(), n));
                    assert!(status != fmi3Status::fmi3OK || flag[..n].iter().all(|flag| *flag < 2), "{flag:?}");
                    status
                }
                9 => call3!(fmi3GetFloat32: fmi3GetFloat32TYPE(c, first, 1, [0.0_f32; 9].as_mut_ptr(), n)),
                10 => call3!(fmi3SetUInt64: fmi3SetUInt64TYPE(c, first, 1, [1_u64; 9].as_ptr(), n)),
                _ => call3!(fmi3GetClock: fmi3GetClockTYPE(c, first, 1, flag.as_mut_ptr())),
            }
        };
        Some(status)
    }

    /// Functions that are refused whatever their arguments.
    fn refused_functions(&mut self, at: usize) -> Option<fmi3Status> {
        let c = self.instances[at].1.instance();
        let (time, choice, mut count) = (self.source.real(0.0)?, self.source.below(10)?, 7);
        // SAFETY: the instance is live; pointers are null, or can be written.
        let status = unsafe {
            match choice {
                0 => call3!(fmi3SetTime: fmi3SetTimeTYPE(c, time)),
                1 => call3!(fmi3EnterConfigurationMode: fmi3EnterConfigurationModeTYPE(c)),
                2 => call3!(fmi3EnterContinuousTimeMode: fmi3EnterContinuousTimeModeTYPE(c)),
                3 => call3!(fmi3GetContinuousStates: fmi3GetContinuousStatesTYPE(c, null_mut(), 4)),
                4 => call3!(fmi3ActivateModelPartition: fmi3ActivateModelPartitionTYPE(c, 0, time)),
                5 => call3!(fmi3EvaluateDiscreteStates: fmi3EvaluateDiscreteStatesTYPE(c)),
                6 => call3!(fmi3GetIntervalDecimal: fmi3GetIntervalDecimalTYPE(c, null(), 1, null_mut(), null_mut())),
                7 => call3!(fmi3GetAdjointDerivative: fmi3GetAdjointDerivativeTYPE(
                    c, null(), 1, null(), 1, null(), 1, null_mut(), 1
                )),
                8 => call3!(fmi3GetNumberOfVariableDependencies: fmi3GetNumberOfVariableDependenciesTYPE(
                    c, 0, &raw mut count
                )),
                // With null pointers for the results.
                _ => call3!(fmi3DoStep: fmi3DoStepTYPE(
                    c, self.times[at], 1e-4, 1, null_mut(), null_mut(), null_mut(), null_mut()
                )),
            }
        };
        assert_eq!((status, count), (fmi3Status::fmi3Error, 7));
        Some(status)
    }

    /// A step after the last one, usually of a sensible length.
    fn advance(&mut self, at: usize) -> Option<()> {
        let length = self.source.step_length()?;
        let mut time = f64::NAN;
        let (c, last) = (self.instances[at].1.instance(), self.instances[at].1.variables().len() as u32);
        // SAFETY: the instance is live; the place can be written. The reference is that of `time`.
        let status = unsafe { call3!(fmi3GetFloat64: fmi3GetFloat64TYPE(c, [last].as_ptr(), 1, &raw mut time, 1)) };
        if self.answered(at, status) {
            self.times[at] = time;
        }
        let (status, done) = self.instances[at].1.try_step(self.times[at], length);
        if self.answered(at, status) {
            assert_eq!((done.flags, done.time), ([0; 3], self.times[at] + length));
            self.times[at] = done.time;
            self.steps += 1;
        }
        Some(())
    }

    /// Brings an instance to its first step.
    fn begin(&mut self, at: usize) -> Option<()> {
        if self.source.below(4)? == 0 {
            let status = self.instances[at].1.reset();
            self.answered(at, status);
        }
        let start = [0.0, 0.0, 1.0, -5.0, 1e6][self.source.below(5)?];
        let calls: [&dyn Fn(&Fmu3) -> fmi3Status; 4] = [
            &|fmu| fmu.enter_initialization(start, None),
            &Fmu3::exit_initialization,
            &Fmu3::update_discrete_states,
            &Fmu3::enter_step_mode,
        ];
        for call in calls {
            let status = call(&self.instances[at].1);
            self.answered(at, status);
        }
        Some(())
    }

    fn save(&mut self, at: usize) -> Option<()> {
        let model = self.instances[at].0;
        if self.snapshots.len() < MOST_SNAPSHOTS && self.source.below(2)? == 0 {
            let mut state = no_state();
            let status = self.instances[at].1.get_state(&mut state);
            if self.answered(at, status) {
                assert!(!state.is_null());
                self.snapshots.push((model, state));
            }
            return Some(());
        }
        if self.snapshots.is_empty() {
            return Some(());
        }
        let chosen = self.source.below(self.snapshots.len())?;
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
        let choice = self.source.below(8)?;
        if choice == 7 || self.snapshots.is_empty() {
            let status = self.instances[at].1.set_state(no_state());
            assert!(!self.answered(at, status));
            return Some(());
        }
        let chosen = self.source.below(self.snapshots.len())?;
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
                let mut state = no_state();
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

    fn log(&mut self, at: usize) -> Option<()> {
        const NAMES: [&std::ffi::CStr; 6] =
            [c"logAll", c"logEvents", c"logSingularLinearSystems", c"logStatusError", c"", c"nothing of the kind"];
        let (name, on) = (NAMES[self.source.below(6)?], self.source.below(2)? == 0);
        let status = self.instances[at].1.set_logging(on, name);
        self.answered(at, status);
        // Switches errors on again, because the next one is counted.
        let status = self.instances[at].1.set_logging(true, c"logStatusError");
        self.answered(at, status);
        Some(())
    }

    /// Frees an instance and makes another, of any model, which may be refused.
    fn replace(&mut self, at: usize) -> Option<()> {
        let (model, arrays) = (self.source.below(self.models.len())?, self.source.below(2)? == 0);
        let name = self.models[model];
        let event_mode = self.source.below(2)? == 0;
        let mut request = Request3 { logging: true, event_mode, ..Request3::of(name, arrays) };
        match self.source.below(16)? {
            0 => request.name = None,
            1 => request.name = Some(text("")),
            2 => request.token = None,
            3 => request.token = Some(text("{00000000-0000-0000-0000-000000000000}")),
            4 => request.resources = Some(text("%%%:///no/such place")),
            5 => request.resources = None,
            6 => request.name = Some(text("/a path/with.dots and blanks\u{b5}")),
            7 => request.logging = false,
            // The token of FMI 2.0.
            8 => request.token = Some(text(FMUS.find(name).expect("it").guid())),
            _ => {}
        }
        let made = request.instantiate(name, arrays);
        self.instantiations[usize::from(made.is_err())] += 1;
        self.calls += 1;
        if let Ok(fmu) = made {
            // The assignment frees the former instance.
            self.calls += 1;
            self.instances[at] = (model, fmu);
            self.times[at] = 0.0;
        }
        Some(())
    }

    /// Calls on a null instance.
    fn null(&mut self) -> Option<()> {
        let c = null_mut();
        // SAFETY: null is refused before other arguments are used.
        let status = unsafe {
            match self.source.below(7)? {
                0 => call3!(fmi3SetTime: fmi3SetTimeTYPE(c, 0.0)),
                1 => call3!(fmi3GetFloat64: fmi3GetFloat64TYPE(c, null(), 1, null_mut(), 1)),
                2 => call3!(fmi3Reset: fmi3ResetTYPE(c)),
                3 => call3!(fmi3GetFMUState: fmi3GetFMUStateTYPE(c, null_mut())),
                4 => call3!(fmi3Terminate: fmi3TerminateTYPE(c)),
                5 => {
                    let other = call3!(fmi3InstantiateModelExchange: fmi3InstantiateModelExchangeTYPE(
                        null(), null(), null(), 0, 0, null_mut(), None
                    ));
                    assert!(other.is_null());
                    fmi3Status::fmi3Error
                }
                _ => {
                    call3!(fmi3FreeInstance: fmi3FreeInstanceTYPE(c));
                    fmi3Status::fmi3Error
                }
            }
        };
        self.calls += 1;
        self.refused += 1;
        assert_eq!(status, fmi3Status::fmi3Error);
        Some(())
    }
}
