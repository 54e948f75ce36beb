//! Writes the FMUs of a crate.

use std::path::{Path, PathBuf};

use super::platforms::{self, Platform};
use super::{Extras, PackageError, Written, binaries, check, fmu, library, platform, standards, trial, write};
use crate::{Fmus, ModelType, Standard};

/// Writes the FMUs of each model, `Name.fmu` for FMI 2.0 and `Name_fmi3.fmu` for FMI 3.0, into a folder, which is created if
/// missing, and prints what was written. The library is the one that cargo has built together with the running program, as
/// `cargo run --release` does with optimization.
///
/// The arguments of the program may name libraries for other platforms, as in `win64=low_pass.dll`; with `--arrays` the FMUs of
/// FMI 3.0 have arrays.
///
/// # Errors
/// A mistake in a model, and whatever file cannot be read or written.
pub fn package(fmus: &'static Fmus, folder: impl AsRef<Path>) -> Result<(), PackageError> {
    report(Packager::new(fmus).arguments(std::env::args().skip(1))?.write(folder)?);
    Ok(())
}

/// As [`package`], for an example that packages itself: cargo builds `library`, another example of the crate type `cdylib` with
/// the same source, because `cargo run --example` builds no libraries.
///
/// # Errors
/// [`PackageError::Build`], a mistake in a model, and whatever file cannot be read or written.
pub fn package_example(fmus: &'static Fmus, library: &str, folder: impl AsRef<Path>) -> Result<(), PackageError> {
    let library = library::example(library)?;
    report(Packager::new(fmus).arguments(std::env::args().skip(1))?.library(library).write(folder)?);
    Ok(())
}

fn report(written: Vec<Written>) {
    for archive in written {
        println!("wrote {archive}");
    }
    if cfg!(debug_assertions) {
        eprintln!(
            "the library is slow and large, for it was built without optimization: `cargo run --release` builds one with"
        );
    }
}

/// Writes the FMUs of a crate, with options.
///
/// ```ignore
/// Packager::new(&my_models::FMUS)
///     .binary("win64", "target/x86_64-pc-windows-gnu/release/my_models.dll")?
///     .extras(|model| Extras::default().resource("map.csv", include_str!("map.csv")))
///     .write("target/fmu")?;
/// ```
pub struct Packager {
    fmus: &'static Fmus,
    library: Option<PathBuf>,
    others: Vec<(&'static Platform, PathBuf)>,
    arrays: bool,
    standards: Option<Vec<Standard>>,
    extras: Box<dyn Fn(&ModelType) -> Extras>,
}

impl Packager {
    /// The models of a crate, with the library that cargo has built together with the running program.
    pub fn new(fmus: &'static Fmus) -> Self {
        let extras = Box::new(|_: &ModelType| Extras::default());
        Self { fmus, library: None, others: Vec::new(), arrays: false, standards: None, extras }
    }

    /// Uses another library for this platform.
    pub fn library(mut self, path: impl Into<PathBuf>) -> Self {
        self.library = Some(path.into());
        self
    }

    /// Adds a library for another platform; the names of platforms are those of [`platforms::PLATFORMS`].
    ///
    /// # Errors
    /// If there is no platform of that name.
    pub fn binary(mut self, platform: &str, path: impl Into<PathBuf>) -> Result<Self, PackageError> {
        self.others.push((platforms::by_name(platform).map_err(PackageError::NoPlatform)?, path.into()));
        Ok(self)
    }

    /// Arrays in the FMUs of FMI 3.0.
    pub fn arrays(mut self) -> Self {
        self.arrays = true;
        self
    }

    /// The standards of the FMUs to write; by default all that the crate is built with.
    pub fn standards(mut self, standards: impl IntoIterator<Item = Standard>) -> Self {
        self.standards = Some(standards.into_iter().collect());
        self
    }

    /// Picture, text, licences and resources of each model.
    pub fn extras(mut self, extras: impl Fn(&ModelType) -> Extras + 'static) -> Self {
        self.extras = Box::new(extras);
        self
    }

    /// Applies command-line arguments: `--arrays`, and `PLATFORM=FILE` for libraries for other platforms.
    ///
    /// # Errors
    /// The unknown argument.
    pub fn arguments(self, arguments: impl IntoIterator<Item = String>) -> Result<Self, PackageError> {
        arguments.into_iter().try_fold(self, |packager, argument| match argument.split_once('=') {
            None if argument == "--arrays" => Ok(packager.arrays()),
            Some((platform, file)) if !argument.starts_with('-') => packager.binary(platform, file),
            _ => Err(PackageError::Argument(argument)),
        })
    }

    /// Writes the archives into a folder, which is created if missing, after every model has been tried.
    ///
    /// # Errors
    /// A mistake in a model, and whatever file cannot be read or written.
    pub fn write(self, folder: impl AsRef<Path>) -> Result<Vec<Written>, PackageError> {
        let models = self.fmus.models();
        let models: Vec<_> = models.iter().map(|model| (model, (self.extras)(model))).collect();
        let standards = self.standards.clone().unwrap_or_else(|| standards(self.arrays));
        let mut files: Vec<String> = Vec::new();
        for (model, extras) in &models {
            for standard in &standards {
                let file = format!("{}.fmu", standard.file_stem(model.info.name));
                if files.iter().any(|other| other.eq_ignore_ascii_case(&file)) {
                    return Err(PackageError::SameFile(file));
                }
                files.push(file);
            }
            check(model, extras)?;
            trial::start(model, extras)?;
        }
        let given = |platform: &'static Platform| self.others.iter().find(|(other, _)| *other == platform);
        let given = platform().ok().and_then(given).map(|(_, path)| path);
        let own = match given.or(self.library.as_ref()) {
            Some(path) => path.clone(),
            None => library::built_library(self.fmus.library())?,
        };
        let binaries = binaries(&self.others, || Ok(own.clone()))?;
        if platform().is_ok() {
            for (model, extras) in &models {
                trial::load(&own, model, extras)?;
            }
        }
        let mut archives = Vec::new();
        for (model, extras) in &models {
            for standard in &standards {
                archives.push(fmu(model, *standard, &binaries, extras)?);
            }
        }
        write(files.into_iter().zip(archives).collect(), &binaries, folder.as_ref())
    }
}
