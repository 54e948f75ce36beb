//! The files of the twin: the scenario, its parameters (SSV), its closed loop (SSP).

use std::path::PathBuf;

use fmu_export::package::platforms::Binaries;

use super::{Arguments, LIKELIHOOD, Pairs, Result, print, refused, write};
use crate::output::Format;
use crate::package;
use crate::studies::identify::Twin;

/// Name of the parameter set with the estimate.
const IDENTIFIED: &str = "identified";

impl Arguments {
    /// Whether any file of the twin is requested.
    pub(super) fn wants_twin(&self) -> bool {
        [&self.save, &self.ssv, &self.ssp].into_iter().any(Option::is_some)
    }

    /// The library of the FMUs for the closed loop, if requested; read first, so that a missing one is reported before the work.
    pub(super) fn binaries(&self) -> Result<Option<Binaries>> {
        let binaries = self.ssp.is_some().then(|| package::binaries(&[])).transpose()?;
        if self.wants_twin() && self.method != LIKELIHOOD {
            return Err(refused(format!("--save, --ssv and --ssp need --method {LIKELIHOOD}, not {}", self.method)));
        }
        Ok(binaries)
    }

    /// Writes the requested files of the twin; `columns` are those of the recordings.
    pub(super) fn write_twin(&self, twin: Twin, columns: Pairs, binaries: Option<&Binaries>) -> Result<()> {
        let Twin { mut scenario, left_out } = twin;
        let name = |path: &PathBuf| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let names: Vec<String> = self.recordings.iter().map(name).collect();
        scenario.title = format!("Identified from {}", names.join(", "));
        scenario.columns = columns;
        if !left_out.is_empty() {
            let names = left_out.join(", ");
            print::paragraph(&format!("Not part of the twin, whose plant has no such parameter: {names}."));
        }
        if let Some(path) = &self.save {
            write(path, Format::Scenario, scenario.to_toml().as_bytes())?;
        }
        if let Some(path) = &self.ssv {
            write(path, Format::Parameters, package::parameter_set(&scenario, IDENTIFIED).as_bytes())?;
        }
        if let (Some(path), Some(binaries)) = (&self.ssp, binaries) {
            write(path, Format::System, &package::system_archive(&scenario, IDENTIFIED, binaries)?)?;
        }
        Ok(())
    }
}
