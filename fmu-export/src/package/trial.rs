//! Tries a model before its archive is written: in this program, where errors have messages, and in the library.

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use super::{Extras, PackageError, at};
use crate::instance::Instance;
use crate::interface::guard::panic_message;
use crate::interface::load;
use crate::log::Silent;
use crate::model::{Capabilities, Invalid, Step};
use crate::variable::{Causality, Value};
use crate::{ModelType, Resources, Standard};

/// Number of steps made with a model.
const STEPS: u32 = 5;

/// A temporary folder with the files of a model.
struct Folder(PathBuf);

impl Folder {
    fn with(extras: &Extras) -> Result<Self, PackageError> {
        static COUNT: std::sync::atomic::AtomicUsize = std::sync::atomic::AtomicUsize::new(0);
        let number = COUNT.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let folder = std::env::temp_dir().join(format!("fmu-export-{}-{number}", std::process::id())).join("resources");
        fs::create_dir_all(&folder).map_err(at(&folder))?;
        for (path, content) in &extras.resources {
            let path = folder.join(path.as_ref());
            let parent = path.parent().unwrap_or(&folder);
            fs::create_dir_all(parent).map_err(at(parent))?;
            fs::write(&path, content).map_err(at(&path))?;
        }
        Ok(Self(folder))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(self.0.parent().unwrap_or(&self.0));
    }
}

/// Starts the model with its start values, reads all variables, and makes a few steps with it and with copies read from its snapshots.
pub(super) fn start(model: &ModelType, extras: &Extras) -> Result<(), PackageError> {
    let fail = |why: String| PackageError::Trial { name: model.info.name, why };
    let folder = Folder::with(extras)?;
    let tried = catch_unwind(AssertUnwindSafe(|| {
        let mut instance = model.instantiate_with(Resources::in_folder(&folder.0));
        let read = |instance: &mut Instance| -> Result<Vec<Value>, String> {
            let all = 0..model.variables().len();
            all.map(|index| instance.get(index)).collect::<Result<_, _>>().map_err(|error| error.to_string())
        };
        let before = read(&mut instance)?;
        instance.start().map_err(|findings| {
            format!("the model does not start with its start values: {}", Invalid::list(&findings))
        })?;
        for ((variable, value), before) in model.variables().iter().zip(read(&mut instance)?).zip(before) {
            if variable.has_start() && value != before {
                return Err(format!(
                    "{} = {value:?} after the start: expected {before:?}, the start value, which importers may have set",
                    variable.name
                ));
            }
            if let Value::Real(value) = value
                && variable.is_computed()
                && !value.is_finite()
            {
                return Err(format!(
                    "{} = {value} after the start: expected a finite number, which importers can read",
                    variable.name
                ));
            }
        }
        // Those that are promised exist.
        let Capabilities { directional_derivatives, output_derivative_order, snapshots, .. } = model.capabilities;
        let output = model.variables().iter().position(|of| of.causality == Causality::Output && of.is_continuous());
        if let Some(output) = output {
            if directional_derivatives {
                let derivatives = instance.differentiate(0, &|_| unreachable!("no directions"));
                derivatives.and_then(|of| of.of(output)).map_err(|error| error.to_string())?;
            }
            if output_derivative_order > 0 {
                instance.output_derivative(output, 1).map_err(|error| error.to_string())?;
            }
        }
        if !snapshots {
            return Ok(());
        }
        let not_saved = "the type of its state or values cannot be saved, for instance because of serde's attributes skip, flatten, \
                         tag or skip_serializing_if, or because a HashMap has no order (use a BTreeMap); wrap the state in NotSaved for an FMU \
                         without snapshots";
        let advance = |instance: &mut Instance, step: Step| -> Result<Vec<String>, String> {
            let stepped = format!("the result {:?}", instance.step(step, &mut Silent));
            let values = read(instance)?.into_iter().zip(model.variables());
            Ok(values.map(|(value, variable)| format!("{} = {value:?}", variable.name)).chain([stepped]).collect())
        };
        let mut copies = Vec::new();
        for n in 0..STEPS {
            let step = Step { time_s: f64::from(n) * model.info.step_s, length_s: model.info.step_s };
            let bytes = instance.write().ok_or(not_saved)?;
            let mut copy = model.instantiate_with(Resources::in_folder(&folder.0));
            copy.read(&bytes, true).map_err(|why| format!("{not_saved}: {why}"))?;
            if copy.write().is_none_or(|again| again != bytes) {
                return Err(format!("{not_saved}: what is read is not what was written"));
            }
            copies.push(copy);
            let wanted = advance(&mut instance, step)?;
            for copy in &mut copies {
                let found = advance(copy, step)?;
                if let Some((found, wanted)) = found.iter().zip(&wanted).find(|(found, wanted)| found != wanted) {
                    let end_s = step.end_s();
                    return Err(format!("{not_saved}: at {end_s} s a copy has {found}, the original {wanted}"));
                }
            }
            if wanted.last().is_some_and(|stepped| !stepped.ends_with("Ok(())")) {
                break;
            }
        }
        Ok(())
    }));
    tried
        .unwrap_or_else(|panic| {
            Err(format!("the model panics when it is started or makes a step: {}", panic_message(panic.as_ref())))
        })
        .map_err(fail)
}

/// Loads the library, makes an instance of the model, and initializes it.
pub(super) fn load(library: &Path, model: &ModelType, extras: &Extras) -> Result<(), PackageError> {
    let folder = Folder::with(extras)?;
    for standard in Standard::BUILT {
        let token = &model.description(*standard).token;
        load::initialize(library, *standard, token, &folder.0).map_err(|why| {
            let why = format!("{} cannot be used for FMI {}: {why}", library.display(), standard.version());
            PackageError::Trial { name: model.info.name, why }
        })?;
    }
    Ok(())
}
