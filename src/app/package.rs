//! Packages the FMUs and the SSP out of what was just built, and of what was built for other platforms.

use std::fs;
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

use super::output::Format;
use super::platforms::{self, Binaries, NotFor, Platform};
use super::{documentation, ssp};
use crate::fmi2::registry::{self, Entry};

/// What went wrong, with the path it went wrong with.
#[derive(Debug, thiserror::Error)]
pub enum PackageError {
    /// A file could not be read or written.
    #[error("{path}: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The binary to be packaged is not there.
    #[error("{0} is not there: build the library together with the program, as `cargo build --release` does")]
    NoBinary(PathBuf),
    /// A file is no binary for the platform it is meant for.
    #[error("{0} is {1}")]
    NotFor(PathBuf, NotFor),
    /// A library without the interface.
    #[error("{0} is no library of an FMU: it does not export {1}")]
    NoInterface(PathBuf, String),
    /// Two binaries are given for one platform.
    #[error("two binaries are given for the platform {0}: one is wanted")]
    Twice(&'static str),
    /// FMI 2.0 has no name for this platform.
    #[error("FMI 2.0 has no folder name for the platform {0}")]
    Platform(String),
    /// The archive could not be made.
    #[error("{0}: {1}")]
    Archive(String, zip::result::ZipError),
}

fn at(path: &Path) -> impl FnOnce(std::io::Error) -> PackageError {
    move |source| PackageError::File { path: path.into(), source }
}

/// A file within an archive.
pub struct Member {
    /// Path within the archive, with slashes.
    pub path: String,
    /// Content.
    pub content: Vec<u8>,
}

impl Member {
    pub(super) fn new(path: impl Into<String>, content: impl Into<Vec<u8>>) -> Self {
        Self { path: path.into(), content: content.into() }
    }
}

/// An archive that was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Written {
    /// Where it is.
    pub path: PathBuf,
    /// How many bytes it has.
    pub bytes: usize,
    /// Names of the platforms it serves.
    pub platforms: Vec<&'static str>,
}

/// Picture of a model, drawn for this project.
fn picture(name: &str) -> &'static [u8] {
    match name {
        "MagneticBearing" => include_bytes!("../../modelDescription/MagneticBearing.png"),
        "FlatnessController" => include_bytes!("../../modelDescription/FlatnessController.png"),
        "AlgebraicEstimator" => include_bytes!("../../modelDescription/AlgebraicEstimator.png"),
        other => unreachable!("{other} has no picture"),
    }
}

/// Licences that travel with every binary: this project's and those of the crates linked into it.
const LICENSES: [(&str, &str); 3] = [
    ("LICENSE-MIT.txt", include_str!("../../modelDescription/licenses/LICENSE-MIT.txt")),
    ("LICENSE-APACHE.txt", include_str!("../../modelDescription/licenses/LICENSE-APACHE.txt")),
    ("THIRD-PARTY.txt", include_str!("../../modelDescription/licenses/THIRD-PARTY.txt")),
];

/// The folder for binaries of the platform this program runs on, and the ending of their names.
///
/// # Errors
/// [`PackageError::Platform`] where the standard has no name.
pub fn platform() -> Result<(&'static str, &'static str), PackageError> {
    own().map(|platform| (platform.name, platform.ending))
}

fn own() -> Result<&'static Platform, PackageError> {
    use std::env::consts::{ARCH, OS};
    platforms::own().ok_or_else(|| PackageError::Platform(format!("{OS} on {ARCH}")))
}

/// The library that was built together with the program that is running.
///
/// # Errors
/// If there is none beside it.
pub fn built_library() -> Result<PathBuf, PackageError> {
    let program = std::env::current_exe().map_err(at(Path::new("the running program")))?;
    let file = format!("{}magnetic_bearing{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    let folder = program.parent().unwrap_or(Path::new(""));
    // Cargo compiles into `deps`, where test programs lie as well, and links the library up from there only when it is
    // asked for the library itself: beside a program that `cargo run` has built it is missing, or an old one.
    let beside = folder.join(&file);
    [folder.join("deps").join(&file), beside.clone()]
        .into_iter()
        .find(|candidate| candidate.is_file())
        .ok_or(PackageError::NoBinary(beside))
}

/// Reads binaries for the platforms they are given for, and adds the library that was built together with this program
/// unless one is given for this platform.
///
/// # Errors
/// Whatever file could not be read, or is not what it is said to be.
pub fn binaries(given: &[(&'static Platform, PathBuf)]) -> Result<Binaries, PackageError> {
    let mut binaries = Binaries::default();
    for (index, (platform, path)) in given.iter().enumerate() {
        if given[..index].iter().any(|(other, _)| other == platform) {
            return Err(PackageError::Twice(platform.name));
        }
        read(&mut binaries, platform, path)?;
    }
    match own() {
        Ok(platform) if !binaries.serve(platform) => read(&mut binaries, platform, &built_library()?)?,
        Err(unknown) if given.is_empty() => return Err(unknown),
        _ => {}
    }
    Ok(binaries)
}

fn read(binaries: &mut Binaries, platform: &'static Platform, path: &Path) -> Result<(), PackageError> {
    let content = fs::read(path).map_err(at(path))?;
    binaries.add(platform, &content).map_err(|why| PackageError::NotFor(path.into(), why))?;
    let missing = platforms::missing_functions(platform, &content);
    if missing.is_empty() { Ok(()) } else { Err(PackageError::NoInterface(path.into(), missing.join(", "))) }
}

/// The FMU of a model around its binaries.
///
/// # Errors
/// [`PackageError::Archive`].
pub fn fmu(entry: &Entry, binaries: &Binaries) -> Result<Vec<u8>, PackageError> {
    let name = entry.kind.name;
    let mut members =
        vec![Member::new("modelDescription.xml", entry.description.as_str()), Member::new("model.png", picture(name))];
    members.extend(binaries.places().into_iter().map(|place| {
        Member::new(format!("binaries/{}/{name}.{}", place.folder, place.ending), place.content.into_owned())
    }));
    members.push(Member::new("documentation/index.html", documentation::page(entry)));
    members.extend(LICENSES.map(|(file, text)| Member::new(format!("documentation/licenses/{file}"), text)));
    archive(name, &members)
}

/// Writes all FMUs and the SSP, with a library for this platform, into a folder, which is made if need be.
///
/// # Errors
/// Whatever file could not be read or written.
pub fn package(library: &Path, folder: &Path) -> Result<Vec<Written>, PackageError> {
    let mut binaries = Binaries::default();
    read(&mut binaries, own()?, library)?;
    package_for(&binaries, folder)
}

/// Writes all FMUs and the SSP into a folder, which is made if need be.
///
/// # Errors
/// Whatever file could not be written.
pub fn package_for(binaries: &Binaries, folder: &Path) -> Result<Vec<Written>, PackageError> {
    let mut archives = Vec::new();
    for entry in registry::entries() {
        archives.push((format!("{}.fmu", entry.kind.name), fmu(entry, binaries)?));
    }
    let system = archive("MagneticBearing.ssp", &ssp::members(&archives))?;
    archives.push(("MagneticBearing.ssp".into(), system));

    fs::create_dir_all(folder).map_err(at(folder))?;
    for (name, _) in &archives {
        let path = folder.join(name);
        Format::Archive.replaceable(&path).map_err(at(&path))?;
    }
    let mut written = Vec::new();
    for (name, content) in archives {
        let path = folder.join(name);
        fs::write(&path, &content).map_err(at(&path))?;
        let platforms = binaries.platforms().map(|platform| platform.name).collect();
        written.push(Written { path, bytes: content.len(), platforms });
    }
    Ok(written)
}

/// Writes the model descriptions into a folder, where they stand under review.
///
/// # Errors
/// Whatever file could not be written.
pub fn write_descriptions(folder: &Path) -> Result<(), PackageError> {
    for entry in registry::entries() {
        let path = folder.join(format!("{}.xml", entry.kind.name));
        Format::Xml.write(&path, entry.description.as_bytes()).map_err(at(&path))?;
    }
    Ok(())
}

/// A zip archive whose bytes depend on the members alone: no times, no owners, the order as given.
fn archive(name: &str, members: &[Member]) -> Result<Vec<u8>, PackageError> {
    let fail = |error| PackageError::Archive(name.into(), error);
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    for member in members {
        // An archive within an archive is compressed already.
        let compression =
            if member.path.ends_with(".fmu") { CompressionMethod::Stored } else { CompressionMethod::Deflated };
        let options = SimpleFileOptions::default()
            .compression_method(compression)
            .last_modified_time(DateTime::default())
            .unix_permissions(0o644);
        writer.start_file(&member.path, options).map_err(fail)?;
        writer.write_all(&member.content).map_err(|error| fail(error.into()))?;
    }
    Ok(writer.finish().map_err(fail)?.into_inner())
}
