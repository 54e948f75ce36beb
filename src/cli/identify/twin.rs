//! The files of the twin: the scenario, its parameters (SSV), its closed loop (SSP).

use std::path::{Path, PathBuf};

use fmu_export::package::platforms::Binaries;

use super::{Arguments, LIKELIHOOD, Result, named, print, refused, said_of};
use crate::output::Format;
use crate::package;
use crate::studies::identify::Twin;

/// Name of the parameter set with the estimate.
const IDENTIFIED: &str = "identified";

/// Files of the twin that are wanted.
pub(super) struct Files<'a> {
    arguments: &'a Arguments,
    /// For the closed loop.
    binaries: Option<Binaries>,
}

impl<'a> Files<'a> {
    /// The wanted files. The library of the FMUs is read now, so that a missing one is reported before the work.
    pub fn new(arguments: &'a Arguments) -> Result<Self> {
        let binaries = arguments.ssp.is_some().then(|| package::binaries(&[])).transpose()?;
        let (files, method) = (Self { arguments, binaries }, arguments.method());
        if !files.is_empty() && method != LIKELIHOOD {
            return Err(refused(format!("--save, --ssv and --ssp need --method {LIKELIHOOD}, not {method}")));
        }
        Ok(files)
    }

    /// Sentence to add to the verdict of an answer that is not valid.
    pub fn not_written(&self) -> &'static str {
        if self.is_empty() { "" } else { " The twin was not written." }
    }

    fn is_empty(&self) -> bool {
        let Arguments { save, ssv, ssp, .. } = self.arguments;
        [save, ssv, ssp].into_iter().all(Option::is_none)
    }

    /// Writes the files, if any.
    pub fn write(
        &self,
        columns: &[(String, String)],
        twin: impl FnOnce() -> std::result::Result<Twin, Vec<String>>,
    ) -> Result<()> {
        if self.is_empty() {
            return Ok(());
        }
        let twin = twin().map_err(|why| refused(format!("the twin cannot be run:\n  {}", why.join("\n  "))))?;
        let Twin { mut scenario, left_out } = twin;
        let name = |path: &PathBuf| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let names: Vec<String> = self.arguments.recordings.iter().map(name).collect();
        scenario.title = format!("Identified from {}", names.join(", "));
        scenario.columns = columns.to_vec();
        if !left_out.is_empty() {
            print::paragraph(&format!(
                "Not part of the twin, whose plant has no such parameter: {}.",
                left_out.join(", ")
            ));
        }
        let write = |path: &Path, format: Format, content: &[u8]| {
            format.write(path, content).map_err(named(path))?;
            said_of(path);
            Ok::<(), Box<dyn std::error::Error>>(())
        };
        if let Some(path) = &self.arguments.save {
            write(path, Format::Scenario, scenario.to_toml().as_bytes())?;
        }
        if let Some(path) = &self.arguments.ssv {
            write(path, Format::Parameters, package::parameter_set(&scenario, IDENTIFIED).as_bytes())?;
        }
        if let (Some(path), Some(binaries)) = (&self.arguments.ssp, &self.binaries) {
            write(path, Format::System, &package::system_archive(&scenario, IDENTIFIED, binaries)?)?;
        }
        Ok(())
    }
}
