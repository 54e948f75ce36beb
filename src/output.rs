//! Destinations of results: the standard output, or files, which never overwrite a file of another format.

use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use fmu_export::package::ssp;

/// Whether the standard output is reserved for a result, so that messages go to the standard error.
static IS_TAKEN: AtomicBool = AtomicBool::new(false);
/// Whether printing a line has failed.
static HAS_FAILED: AtomicBool = AtomicBool::new(false);

/// Whether a name means the standard output, or input.
pub fn is_standard(path: &Path) -> bool {
    path == Path::new("-")
}

/// Reserves the standard output for a result.
pub fn take_standard_output() {
    IS_TAKEN.store(true, Ordering::Relaxed);
}

/// Prints a line. A reader of the standard output may close it at any time without stopping the work. Any other failure is
/// reported once and noted for [`has_failed`].
pub fn tell(line: std::fmt::Arguments<'_>) {
    if IS_TAKEN.load(Ordering::Relaxed) {
        warn(line);
    } else {
        note(writeln!(io::stdout().lock(), "{line}"));
    }
}

/// Prints a line to the standard error, whose reader may close it at any time as well: `eprintln!` would panic.
pub fn warn(line: std::fmt::Arguments<'_>) {
    let _ = writeln!(io::stderr().lock(), "{line}");
}

/// The outcome of writing to the standard output, whose reader may close it at any time: that is no error.
///
/// # Errors
/// Any other failure.
pub fn unless_closed(written: io::Result<()>) -> io::Result<()> {
    written.or_else(|error| if error.kind() == io::ErrorKind::BrokenPipe { Ok(()) } else { Err(error) })
}

fn note(written: io::Result<()>) {
    if let Err(error) = unless_closed(written)
        && !HAS_FAILED.swap(true, Ordering::Relaxed)
    {
        warn(format_args!("error: standard output: {error}"));
    }
}

/// Whether printing a line has failed; flushes the standard output first.
pub fn has_failed() -> bool {
    note(io::stdout().flush());
    HAS_FAILED.load(Ordering::Relaxed)
}

/// Format of a file, recognised by its first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// A table that begins with the time, as written by this program.
    Table,
    /// A document in JSON.
    Json,
    /// A page in HTML.
    Page,
    /// A zip archive.
    Archive,
    /// A description in XML.
    Xml,
    /// A text in Markdown.
    Markdown,
    /// A scenario that this program has written.
    Scenario,
    /// A closed loop (SSP) that this program has generated.
    System,
    /// A parameter set (SSV) that this program has generated.
    Parameters,
}

/// Beginning of a scenario that this program has written.
pub const SCENARIO: &str = concat!("# Written by ", env!("CARGO_PKG_NAME"));

impl Format {
    /// How such a file begins, and what it is in messages.
    const fn signature(self) -> (&'static str, &'static str) {
        match self {
            Self::Table => ("time [s]", "a table of this program"),
            Self::Json => ("{", "a document in JSON"),
            Self::Page => ("<!DOCTYPE html>", "a page in HTML"),
            Self::Archive => ("PK", "an archive"),
            Self::Xml => ("<?xml", "a description in XML"),
            Self::Markdown => ("# ", "a text in Markdown"),
            Self::Scenario => (SCENARIO, "a scenario that this program has written"),
            Self::System => ("PK", "an SSP that this program has generated"),
            Self::Parameters => ("<?xml", "an SSV that this program has generated"),
        }
    }

    /// Whether a file may be written at a path: there is none, it is empty or a device, or it has the same format.
    ///
    /// # Errors
    /// The file has another format and is not overwritten.
    pub fn replaceable(self, path: &Path) -> io::Result<()> {
        if !fs::metadata(path).is_ok_and(|metadata| metadata.is_file() && metadata.len() > 0) {
            return Ok(());
        }
        let (signature, words) = self.signature();
        let mut begin = Vec::new();
        File::open(path)?.take(signature.len() as u64).read_to_end(&mut begin)?;
        let needs_tool = matches!(self, Self::System | Self::Parameters);
        if begin == signature.as_bytes() && (!needs_tool || is_generated(&fs::read(path)?)) {
            return Ok(());
        }
        let words = format!("it already exists and is not {words}: remove it, or name another file");
        Err(io::Error::new(io::ErrorKind::AlreadyExists, words))
    }

    /// Opens a file for a result, or the standard output under the name `-`.
    ///
    /// # Errors
    /// As for [`Self::replaceable`], and whatever the system reports.
    pub fn create(self, path: &Path) -> io::Result<Box<dyn Write>> {
        if is_standard(path) {
            return Ok(Box::new(io::stdout().lock()));
        }
        self.replaceable(path)?;
        Ok(Box::new(File::create(path)?))
    }

    /// Writes a whole file, or to the standard output under the name `-`.
    ///
    /// # Errors
    /// As for [`Self::create`].
    pub fn write(self, path: &Path, content: &[u8]) -> io::Result<()> {
        let mut file = self.create(path)?;
        let written = file.write_all(content).and_then(|()| file.flush());
        if is_standard(path) { unless_closed(written) } else { written }
    }
}

/// Whether any version of this program generated a system structure or a parameter set.
fn is_generated(content: &[u8]) -> bool {
    let tool = ssp::generation_tool(content);
    tool.is_some_and(|tool| tool.split(' ').next() == Some(env!("CARGO_PKG_NAME")))
}
