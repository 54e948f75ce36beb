//! Writes FMUs: model description, binaries, documentation page, picture, licences.
//!
//! A crate of the types `rlib` and `cdylib` with [`export_fmus!`](crate::export_fmus) in `lib.rs` needs a program of three
//! lines, and `cargo run --release` packages the library just built:
//!
//! ```ignore
//! fn main() -> Result<(), fmu_export::package::PackageError> {
//!     fmu_export::package::package(&my_models::FMUS, "target/fmu")
//! }
//! ```
//!
//! Before anything is written, the library is loaded, and every model is instantiated and initialized with its start values.
//!
//! [`Packager`] has more options: [`Extras`] adds picture, text, licences and resources, [`platforms`] holds binaries for
//! several platforms. [`ssp`] writes a system of several FMUs.

mod library;
mod packager;
mod trial;

pub mod documentation;
pub mod platforms;
pub mod ssp;

use std::borrow::Cow;
use std::fmt;
use std::fs;
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};

pub use library::built_library;
pub use packager::{Packager, package, package_example};

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipArchive, ZipWriter};

use crate::{ModelType, Standard};
use platforms::{Binaries, Binary, NotFor, Platform};

/// An error, with the path concerned. `Debug` gives the same sentence, because a `main` that returns an error prints it.
#[derive(thiserror::Error)]
#[non_exhaustive]
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
    /// A system of FMUs has errors.
    #[error("{name}: {}", .problems.join("; "))]
    System {
        /// The system.
        name: String,
        /// The errors.
        problems: Vec<String>,
    },
    /// The file names of two FMUs differ only in case, which some systems ignore.
    #[error("two models are to be written to {0}: give one of them another name")]
    SameFile(String),
    /// The path of a resource or a licence leaves its folder.
    #[error("the path {0:?} is not allowed for a file in an FMU: expected one below its folder, as in tables/map.csv")]
    Outside(String),
    /// A model cannot be started.
    #[error("{name}: {why}")]
    Trial {
        /// The model.
        name: &'static str,
        /// Why not.
        why: String,
    },
    /// A command-line argument that the packager does not know.
    #[error("the argument `{0}` is unknown: expected --arrays, or PLATFORM=FILE as in win64=low_pass.dll")]
    Argument(String),
    /// A platform that the packager does not know.
    #[error("{0}")]
    NoPlatform(String),
    /// The binary to package does not exist, or is from an earlier build.
    #[error(
        "{0} was not built with this program: in Cargo.toml the library needs `crate-type = [\"rlib\", \"cdylib\"]` below `[lib]`, and it is built \
         together with the program, as by `cargo run --release`; if cargo takes a library from before a change of the crate type for current, change \
         the date of src/lib.rs, as by `touch src/lib.rs`"
    )]
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

impl fmt::Debug for PackageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

fn at(path: &Path) -> impl FnOnce(std::io::Error) -> PackageError {
    move |source| PackageError::File { path: path.into(), source }
}

/// A file within an archive.
pub struct Member {
    path: String,
    content: Content,
}

enum Content {
    Plain(Vec<u8>),
    /// The only file of this archive.
    Compressed(Vec<u8>),
}

impl Member {
    /// A file with that path, with slashes, and content.
    pub fn new(path: impl Into<String>, content: impl Into<Vec<u8>>) -> Self {
        Self { path: path.into(), content: Content::Plain(content.into()) }
    }

    fn binary(path: String, binary: &Binary) -> Result<Self, PackageError> {
        Ok(Self { path, content: Content::Compressed(binary.compressed()?.to_vec()) })
    }
}

/// A written archive.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Written {
    /// Path.
    pub path: PathBuf,
    /// Size in bytes.
    pub bytes: usize,
    /// Names of its platforms.
    pub platforms: Vec<&'static str>,
}

impl fmt::Display for Written {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kilobytes = self.bytes.div_ceil(1000);
        write!(f, "{} ({kilobytes} kB, {})", self.path.display(), self.platforms.join(", "))
    }
}

/// Optional content of an FMU besides model description, binaries and tables of variables.
///
/// ```
/// # use fmu_export::package::Extras;
/// let extras = Extras::default().text("<p>Measured in 2026.</p>").resource("map.csv", "0,1\n1,3\n");
/// ```
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Extras {
    /// A picture of the model, as PNG.
    pub picture: Option<Cow<'static, [u8]>>,
    /// Paragraphs of HTML for the documentation page.
    pub text: Cow<'static, str>,
    /// Builds the documentation page from its title and its content in HTML; [`documentation::page`] by default.
    pub page: fn(&str, &str) -> String,
    /// Licences of the model and of the linked crates: file name and text.
    pub licenses: Vec<(Cow<'static, str>, Cow<'static, str>)>,
    /// Files for the folder `resources`: path below it and content.
    pub resources: Vec<(Cow<'static, str>, Cow<'static, [u8]>)>,
}

impl Extras {
    /// Sets the picture of the model, as PNG.
    pub fn picture(mut self, png: impl Into<Cow<'static, [u8]>>) -> Self {
        self.picture = Some(png.into());
        self
    }

    /// Sets the paragraphs of HTML for the documentation page.
    pub fn text(mut self, html: impl Into<Cow<'static, str>>) -> Self {
        self.text = html.into();
        self
    }

    /// Sets the function that builds the documentation page from its title and its content in HTML.
    pub fn page(mut self, page: fn(&str, &str) -> String) -> Self {
        self.page = page;
        self
    }

    /// Adds a licence of the model or of a linked crate.
    pub fn license(mut self, file: impl Into<Cow<'static, str>>, text: impl Into<Cow<'static, str>>) -> Self {
        self.licenses.push((file.into(), text.into()));
        self
    }

    /// Adds a file to the folder `resources`, which the model reads by [`Resources`](crate::Resources).
    pub fn resource(mut self, path: impl Into<Cow<'static, str>>, content: impl Into<Vec<u8>>) -> Self {
        self.resources.push((path.into(), Cow::Owned(content.into())));
        self
    }
}

impl Default for Extras {
    fn default() -> Self {
        Self { picture: None, text: "".into(), page: documentation::page, licenses: Vec::new(), resources: Vec::new() }
    }
}

/// The standards of the FMUs to write: those that this crate is built with, by its features `fmi2` and `fmi3`; with `arrays`, the
/// FMUs of FMI 3.0 have arrays.
pub fn standards(arrays: bool) -> Vec<Standard> {
    let with_arrays = |standard: &Standard| match standard {
        Standard::Fmi3 { .. } => Standard::Fmi3 { arrays },
        other => *other,
    };
    Standard::BUILT.iter().map(with_arrays).collect()
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
        add(&mut binaries, platform, path, fs::read(path).map_err(at(path))?)?;
    }
    match platform() {
        Ok(platform) if !binaries.serve(platform) => read_built(&mut binaries, platform, &own()?)?,
        Err(unknown) if given.is_empty() => return Err(unknown),
        _ => {}
    }
    Ok(binaries)
}

/// Adds a library that was built here. Others are packaged unchanged.
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

/// Removes paths of this machine, which panic messages of dependencies contain, from a library. Each folder is overwritten by
/// `/crates` and slashes of the same total length. A library for macOS is not changed, because it is signed; build it with the
/// compiler's option `--remap-path-prefix`.
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

/// Checks the table of a model, and that all its files stay in their folders.
fn check(model: &ModelType, extras: &Extras) -> Result<(), PackageError> {
    let problems = model.problems();
    if !problems.is_empty() {
        return Err(PackageError::Model { name: model.info.name, problems });
    }
    let is_name = |part: &str| !matches!(part, "" | "." | "..") && !part.contains(['\\', ':']);
    let mut paths = extras.licenses.iter().map(|(path, _)| path).chain(extras.resources.iter().map(|(path, _)| path));
    let outside = paths.find(|path| !path.split('/').all(is_name));
    outside.map_or(Ok(()), |path| Err(PackageError::Outside(path.to_string())))
}

/// The FMU of a model by a standard, with its binaries. Its bytes depend only on the arguments.
///
/// # Errors
/// [`PackageError::Model`], [`PackageError::Archive`].
pub fn fmu(
    model: &ModelType,
    standard: Standard,
    binaries: &Binaries,
    extras: &Extras,
) -> Result<Vec<u8>, PackageError> {
    check(model, extras)?;
    let name = model.info.name;
    let mut members = vec![Member::new("modelDescription.xml", model.description(standard).xml.as_str())];
    // In FMI 3.0 the picture belongs to the icons of terminals.
    let picture = match standard {
        Standard::Fmi2 => "model.png",
        Standard::Fmi3 { .. } => "terminalsAndIcons/icon.png",
    };
    members.extend(extras.picture.as_deref().map(|content| Member::new(picture, content)));
    for place in binaries.places(standard) {
        members.push(Member::binary(format!("binaries/{}/{name}.{}", place.folder, place.ending), place.content)?);
    }
    members.push(Member::new(
        "documentation/index.html",
        (extras.page)(name, &documentation::body(model, standard, extras)),
    ));
    let licenses = extras.licenses.iter();
    members.extend(licenses.map(|(file, text)| Member::new(format!("documentation/licenses/{file}"), text.as_bytes())));
    let resources = extras.resources.iter();
    members.extend(resources.map(|(path, content)| Member::new(format!("resources/{path}"), content.as_ref())));
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

/// A zip archive whose bytes depend only on the members: no times, no owners, in the given order.
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
        match &member.content {
            Content::Plain(content) => {
                writer.start_file(&member.path, options).map_err(fail)?;
                writer.write_all(content).map_err(|error| fail(error.into()))?;
            }
            Content::Compressed(archive) => {
                let mut archive = ZipArchive::new(Cursor::new(archive)).map_err(fail)?;
                let binary = archive.by_index_raw(0).map_err(fail)?;
                writer.raw_copy_file_rename(binary, &member.path).map_err(fail)?;
            }
        }
    }
    Ok(writer.finish().map_err(fail)?.into_inner())
}
