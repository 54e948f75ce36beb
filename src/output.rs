//! Where results go: the standard output, or files, which never take the place of a file of another kind.

use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether the standard output belongs to a result, so that what is said otherwise goes to the standard error.
static IS_TAKEN: AtomicBool = AtomicBool::new(false);
/// Whether something could not be said.
static HAS_FAILED: AtomicBool = AtomicBool::new(false);

/// The name of the standard output, or input.
#[must_use]
pub fn is_standard(path: &Path) -> bool {
    path == Path::new("-")
}

/// Keeps the standard output for a result.
pub fn take_standard_output() {
    IS_TAKEN.store(true, Ordering::Relaxed);
}

/// Prints a line. Whoever reads the standard output may stop reading when there is enough; the work goes on all the same. Any
/// other failure is told once and kept for [`has_failed`].
pub fn tell(line: std::fmt::Arguments<'_>) {
    if IS_TAKEN.load(Ordering::Relaxed) {
        eprintln!("{line}");
    } else {
        note(writeln!(io::stdout().lock(), "{line}"));
    }
}

fn note(written: io::Result<()>) {
    if let Err(error) = written
        && error.kind() != io::ErrorKind::BrokenPipe
        && !HAS_FAILED.swap(true, Ordering::Relaxed)
    {
        eprintln!("error: standard output: {error}");
    }
}

/// Whether some line could not be printed; the last ones are written only here.
pub fn has_failed() -> bool {
    note(io::stdout().flush());
    HAS_FAILED.load(Ordering::Relaxed)
}

/// What a file holds, by its first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// A table that begins with the time, as this program writes it.
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
}

impl Format {
    const fn signature(self) -> &'static str {
        match self {
            Self::Table => "time [s]",
            Self::Json => "{",
            Self::Page => "<!DOCTYPE html>",
            Self::Archive => "PK",
            Self::Xml => "<?xml",
            Self::Markdown => "# ",
        }
    }

    const fn words(self) -> &'static str {
        match self {
            Self::Table => "a table of this program",
            Self::Json => "a document in JSON",
            Self::Page => "a page in HTML",
            Self::Archive => "an archive",
            Self::Xml => "a description in XML",
            Self::Markdown => "a text in Markdown",
        }
    }

    /// Whether a file may be written at that path: there is none, it is empty or a device, or it holds the same format.
    ///
    /// # Errors
    /// What it holds is something else, which is not overwritten.
    pub fn replaceable(self, path: &Path) -> io::Result<()> {
        if !fs::metadata(path).is_ok_and(|metadata| metadata.is_file() && metadata.len() > 0) {
            return Ok(());
        }
        let signature = self.signature().as_bytes();
        let mut begin = Vec::new();
        File::open(path)?.take(signature.len() as u64).read_to_end(&mut begin)?;
        if begin == signature {
            return Ok(());
        }
        let words = format!("it is there already and is not {}: remove it, or name another file", self.words());
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
        match written {
            // Whoever reads it has enough.
            Err(error) if is_standard(path) && error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
            written => written,
        }
    }
}
