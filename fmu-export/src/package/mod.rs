//! Writes FMUs: model description, binaries, documentation page, picture, licences.
//!
//! A crate of the types `rlib` and `cdylib` with [`export_fmus!`](crate::export_fmus) in `lib.rs` needs a program of three
//! lines, and `cargo run --release` packages what cargo has just built:
//!
//! ```ignore
//! fn main() -> Result<(), fmu_export::package::PackageError> {
//!     fmu_export::package::package(&my_models::FMUS, "target/fmu").map(drop)
//! }
//! ```
//!
//! [`Extras`] adds picture, text and licences; [`platforms`] holds binaries for several platforms; [`ssp`] writes a system of
//! several FMUs.

pub mod documentation;
pub mod platforms;
pub mod ssp;

use std::borrow::Cow;
use std::fs;
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};
use std::process::Command;

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

use crate::{Fmus, ModelType, Standard};
use platforms::{Binaries, NotFor, Platform};

/// An error, with the path concerned.
#[derive(Debug, thiserror::Error)]
pub enum PackageError {
    /// A file could not be read or written.
    #[error("{path}: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
    /// The table of a model has errors.
    #[error("{name}: {}", .problems.join("; "))]
    Model {
        /// The model.
        name: &'static str,
        /// The errors.
        problems: Vec<String>,
    },
    /// The binary to package does not exist.
    #[error("{0} does not exist: build the library together with the program, as `cargo build --release` does")]
    NoBinary(PathBuf),
    /// Cargo could not build the library.
    #[error("cargo could not build the library {0}")]
    Build(String),
    /// A file is not a binary for its platform.
    #[error("{0} is {1}")]
    NotFor(PathBuf, NotFor),
    /// A library without the interface.
    #[error("{0} is not the library of an FMU: it does not export {1}")]
    NoInterface(PathBuf, String),
    /// Two binaries are given for one platform.
    #[error("two binaries are given for the platform {0}: expected one")]
    Twice(&'static str),
    /// FMI 2.0 has no name for this platform.
    #[error("FMI 2.0 has no folder name for the platform {0}")]
    Platform(String),
    /// The archive could not be written.
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
    /// A file with that path and content.
    pub fn new(path: impl Into<String>, content: impl Into<Vec<u8>>) -> Self {
        Self { path: path.into(), content: content.into() }
    }
}

/// A written archive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Written {
    /// Path.
    pub path: PathBuf,
    /// Size in bytes.
    pub bytes: usize,
    /// Names of its platforms.
    pub platforms: Vec<&'static str>,
}

/// Optional content of an FMU besides model description, binaries and tables of variables.
#[derive(Clone, Debug)]
pub struct Extras {
    /// A picture of the model, as PNG.
    pub picture: Option<Cow<'static, [u8]>>,
    /// Paragraphs of HTML for the documentation page.
    pub text: Cow<'static, str>,
    /// Builds the documentation page from its title and its content in HTML; [`documentation::page`] by default.
    pub page: fn(&str, &str) -> String,
    /// Licences of the model and of the linked crates: file name and text.
    pub licenses: Vec<(Cow<'static, str>, Cow<'static, str>)>,
}

impl Default for Extras {
    fn default() -> Self {
        Self { picture: None, text: "".into(), page: documentation::page, licenses: Vec::new() }
    }
}

/// The standards of the FMUs to write: those that this crate is built with, by its features `fmi2` and `fmi3`; with `arrays`, the
/// FMUs of FMI 3.0 have arrays. [`package`] and [`package_example`] make arrays if the running program was called with
/// `--arrays`.
pub fn standards(arrays: bool) -> Vec<Standard> {
    let with_arrays = |standard: &Standard| match standard {
        Standard::Fmi3 { .. } => Standard::Fmi3 { arrays },
        other => *other,
    };
    Standard::BUILT.iter().map(with_arrays).collect()
}

fn called_with_arrays() -> bool {
    std::env::args_os().skip(1).any(|argument| argument == "--arrays")
}

/// Writes the FMUs of each model, `Name.fmu` for FMI 2.0 and `Name_fmi3.fmu` for FMI 3.0, into a folder, which is created if
/// missing, with the library that cargo has built together with the running program.
///
/// # Errors
/// Whatever file cannot be read or written.
pub fn package(fmus: &'static Fmus, folder: impl AsRef<Path>) -> Result<Vec<Written>, PackageError> {
    package_library(fmus, &standards(called_with_arrays()), &built_library(fmus.library())?, folder)
}

/// As [`package`], by given standards and with a given library.
///
/// # Errors
/// Whatever file cannot be read or written.
pub fn package_library(
    fmus: &'static Fmus,
    standards: &[Standard],
    library: &Path,
    folder: impl AsRef<Path>,
) -> Result<Vec<Written>, PackageError> {
    let binaries = binaries_of(library)?;
    let mut archives = Vec::new();
    for model in fmus.models().iter() {
        for standard in standards {
            let name = format!("{}.fmu", standard.file_stem(model.info.name));
            archives.push((name, fmu(model, *standard, &binaries, &Extras::default())?));
        }
    }
    write(archives, &binaries, folder.as_ref())
}

/// As [`package`], for an example that packages itself: cargo builds `library`, another example of the crate type `cdylib` with
/// the same source, because `cargo run --example` builds no libraries.
///
/// # Errors
/// [`PackageError::Build`], and whatever file cannot be read or written.
pub fn package_example(
    fmus: &'static Fmus,
    library: &str,
    folder: impl AsRef<Path>,
) -> Result<Vec<Written>, PackageError> {
    package_library(fmus, &standards(called_with_arrays()), &build_example(library)?, folder)
}

fn build_example(name: &str) -> Result<PathBuf, PackageError> {
    let program = std::env::current_exe().map_err(at(Path::new("the running program")))?;
    // The program is target/PROFILE/examples/NAME.
    let folders: Vec<&Path> = program.ancestors().skip(1).take(3).collect();
    let [examples, profile, target] = folders[..] else { return Err(PackageError::Build(name.into())) };
    let profile = match profile.file_name().map(|name| name.to_string_lossy()) {
        Some(name) if name != "debug" => name.into_owned(),
        _ => "dev".into(),
    };
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let manifest = std::env::var_os("CARGO_MANIFEST_DIR").map(PathBuf::from).unwrap_or_default().join("Cargo.toml");
    let mut command = Command::new(cargo);
    command.args(["build", "--quiet", "--example", name, "--profile", &profile]);
    command.arg("--manifest-path").arg(manifest).arg("--target-dir").arg(target);
    let built = command.status().is_ok_and(|status| status.success());
    let library = examples.join(file_name(name));
    if built && library.is_file() { Ok(library) } else { Err(PackageError::Build(name.into())) }
}

fn file_name(library: &str) -> String {
    format!("{}{library}{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX)
}

/// The library of that name that cargo has built together with the running program.
///
/// # Errors
/// If it is not beside the program.
pub fn built_library(name: &str) -> Result<PathBuf, PackageError> {
    let program = std::env::current_exe().map_err(at(Path::new("the running program")))?;
    let folder = program.parent().unwrap_or(Path::new(""));
    // Cargo compiles into `deps`, where test programs are as well, and links the library into the parent folder only when asked
    // for the library itself: beside a program built by `cargo run` it is missing or out of date.
    let beside = folder.join(file_name(name));
    [folder.join("deps").join(file_name(name)), beside.clone()]
        .into_iter()
        .find(|candidate| candidate.is_file())
        .ok_or(PackageError::NoBinary(beside))
}

/// The platform of this program.
///
/// # Errors
/// [`PackageError::Platform`] where the standard has no name.
pub fn platform() -> Result<&'static Platform, PackageError> {
    use std::env::consts::{ARCH, OS};
    platforms::own().ok_or_else(|| PackageError::Platform(format!("{OS} on {ARCH}")))
}

/// A library for this platform.
///
/// # Errors
/// If it cannot be read, or is not a library.
pub fn binaries_of(library: &Path) -> Result<Binaries, PackageError> {
    let mut binaries = Binaries::default();
    read_built(&mut binaries, platform()?, library)?;
    Ok(binaries)
}

/// Reads binaries for the given platforms, and adds `own`, the library for this platform, unless one is given.
///
/// # Errors
/// Whatever file cannot be read, or is not a library for its platform.
pub fn binaries(
    given: &[(&'static Platform, PathBuf)],
    own: impl FnOnce() -> Result<PathBuf, PackageError>,
) -> Result<Binaries, PackageError> {
    let mut binaries = Binaries::default();
    for (index, (platform, path)) in given.iter().enumerate() {
        if given[..index].iter().any(|(other, _)| other == platform) {
            return Err(PackageError::Twice(platform.name));
        }
        read(&mut binaries, platform, path)?;
    }
    match platform() {
        Ok(platform) if !binaries.serve(platform) => read_built(&mut binaries, platform, &own()?)?,
        Err(unknown) if given.is_empty() => return Err(unknown),
        _ => {}
    }
    Ok(binaries)
}

fn read(binaries: &mut Binaries, platform: &'static Platform, path: &Path) -> Result<(), PackageError> {
    add(binaries, platform, path, fs::read(path).map_err(at(path))?)
}

/// As [`read`], for a library that was built here. Others are packaged unchanged.
fn read_built(binaries: &mut Binaries, platform: &'static Platform, path: &Path) -> Result<(), PackageError> {
    let mut content = fs::read(path).map_err(at(path))?;
    remap(&mut content);
    add(binaries, platform, path, content)
}

fn add(
    binaries: &mut Binaries,
    platform: &'static Platform,
    path: &Path,
    content: Vec<u8>,
) -> Result<(), PackageError> {
    binaries.add(platform, &content).map_err(|why| PackageError::NotFor(path.into(), why))?;
    let missing = platforms::missing_functions(platform, &content);
    if missing.is_empty() { Ok(()) } else { Err(PackageError::NoInterface(path.into(), missing.join(", "))) }
}

/// Removes folders of this machine from a library: panic messages contain the paths of dependencies' sources. Each folder is
/// overwritten by `/crates` and slashes of the same total length, so that nothing moves. A library for macOS is not changed,
/// because it is signed; build it with the compiler's option `--remap-path-prefix`.
fn remap(library: &mut [u8]) {
    if platforms::is_signed(library) {
        return;
    }
    let home = std::env::var_os("CARGO_HOME").map(PathBuf::from);
    let home = home.or_else(|| std::env::home_dir().map(|home| home.join(".cargo")));
    let home = home.map(|home| home.display().to_string()).filter(|home| home.len() > 1);
    let separator = std::path::MAIN_SEPARATOR;
    let mut folders = vec![(env!("CARGO_MANIFEST_DIR").to_owned(), 0)];
    if let Some(home) = home {
        // These contain one more folder, named after the registry or the repository.
        folders.push((format!("{home}{separator}registry{separator}src{separator}"), 1));
        folders.push((format!("{home}{separator}git{separator}checkouts{separator}"), 1));
    }
    for (folder, below) in folders {
        let folder = folder.as_bytes();
        let mut at = 0;
        while let Some(found) = library[at..].windows(folder.len()).position(|window| window == folder) {
            let begin = at + found;
            at = begin + folder.len();
            for _ in 0..below {
                let name = library[at..].iter().take_while(|byte| **byte != separator as u8);
                at += name.take(256).count();
            }
            let (head, rest) = library[begin..at].split_at_mut(b"/crates".len().min(at - begin));
            head.copy_from_slice(&b"/crates"[..head.len()]);
            rest.fill(b'/');
        }
    }
}

/// The FMU of a model by a standard, with its binaries. Its bytes depend on the arguments only.
///
/// # Errors
/// [`PackageError::Model`], [`PackageError::Archive`].
pub fn fmu(
    model: &ModelType,
    standard: Standard,
    binaries: &Binaries,
    extras: &Extras,
) -> Result<Vec<u8>, PackageError> {
    let name = model.info.name;
    let problems = model.problems();
    if !problems.is_empty() {
        return Err(PackageError::Model { name, problems });
    }
    let mut members = vec![Member::new("modelDescription.xml", model.description(standard).xml.as_str())];
    // In FMI 3.0 the picture belongs to the icons of terminals.
    let picture = match standard {
        Standard::Fmi2 => "model.png",
        Standard::Fmi3 { .. } => "terminalsAndIcons/icon.png",
    };
    members.extend(extras.picture.as_deref().map(|content| Member::new(picture, content)));
    members.extend(binaries.places(standard).into_iter().map(|place| {
        Member::new(format!("binaries/{}/{name}.{}", place.folder, place.ending), place.content.into_owned())
    }));
    members.push(Member::new(
        "documentation/index.html",
        (extras.page)(name, &documentation::body(model, standard, extras)),
    ));
    let licenses = extras.licenses.iter();
    members.extend(licenses.map(|(file, text)| Member::new(format!("documentation/licenses/{file}"), text.as_bytes())));
    archive(name, &members)
}

/// Writes archives, by file name, into a folder, which is created if missing.
///
/// # Errors
/// Whatever file cannot be written.
pub fn write(
    archives: Vec<(String, Vec<u8>)>,
    binaries: &Binaries,
    folder: &Path,
) -> Result<Vec<Written>, PackageError> {
    fs::create_dir_all(folder).map_err(at(folder))?;
    let mut written = Vec::new();
    for (name, content) in archives {
        let path = folder.join(name);
        fs::write(&path, &content).map_err(at(&path))?;
        let platforms = binaries.platforms().map(|platform| platform.name).collect();
        written.push(Written { path, bytes: content.len(), platforms });
    }
    Ok(written)
}

/// A zip archive whose bytes depend on the members only: no times, no owners, in the given order.
///
/// # Errors
/// [`PackageError::Archive`] with the name given.
pub fn archive(name: &str, members: &[Member]) -> Result<Vec<u8>, PackageError> {
    let fail = |error| PackageError::Archive(name.into(), error);
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    for member in members {
        // Archives inside archives are already compressed.
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
