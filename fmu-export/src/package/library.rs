//! The library to package, built by cargo with the running program.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::{PackageError, at};

/// The variable by which the system finds libraries; cargo adds the folder into which it compiles.
const LIBRARY_PATH: &str = if cfg!(windows) {
    "PATH"
} else if cfg!(target_os = "macos") {
    "DYLD_FALLBACK_LIBRARY_PATH"
} else {
    "LD_LIBRARY_PATH"
};

/// The library of that name that cargo has built together with the running program.
///
/// # Errors
/// If it is not beside the program.
pub fn built_library(name: &str) -> Result<PathBuf, PackageError> {
    let program = std::env::current_exe().map_err(at(Path::new("the running program")))?;
    let folder = program.parent().unwrap_or(Path::new(""));
    let deps = compiled(folder);
    let built = if deps.is_dir() || cargo().is_some() { deps } else { folder.to_owned() }.join(file_name(name));
    if built.is_file() && !is_outdated(&built, name) { Ok(built) } else { Err(PackageError::NoBinary(built)) }
}

/// The folder into which cargo has compiled the program in `folder`.
///
/// Cargo compiles into `deps`, where test programs are too, and links the library into the folder of the program only when building the library
/// itself: beside a program built by `cargo run` it is missing or stale. `build.build-dir` may place `deps` elsewhere.
fn compiled(folder: &Path) -> PathBuf {
    if folder.ends_with("deps") {
        return folder.to_owned();
    }
    let listed = std::env::var_os(LIBRARY_PATH);
    let listed: Vec<PathBuf> = listed.iter().flat_map(std::env::split_paths).collect();
    // If another cargo has set the variable, the folder of the program is not in it.
    let deps = listed.iter().find(|path| path.ends_with("deps")).filter(|_| listed.iter().any(|path| path == folder));
    deps.cloned().unwrap_or_else(|| folder.join("deps"))
}

/// Whether cargo has since built the package without the crate type `cdylib`: only then it names the file for Rust with a hash.
fn is_outdated(library: &Path, name: &str) -> bool {
    let built = |path: &Path| path.metadata().and_then(|metadata| metadata.modified()).ok();
    let folder = library.parent().and_then(|folder| folder.read_dir().ok());
    folder.into_iter().flatten().flatten().any(|entry| {
        let file = entry.file_name().to_string_lossy().into_owned();
        file.starts_with(&format!("lib{name}-")) && file.ends_with(".rlib") && built(&entry.path()) > built(library)
    })
}

/// An example of the crate type `cdylib`, built by cargo with optimization, unless the running program has another profile.
pub(super) fn example(name: &str) -> Result<PathBuf, PackageError> {
    let program = std::env::current_exe().map_err(at(Path::new("the running program")))?;
    // The program is target/PROFILE/examples/NAME.
    let folders: Vec<&Path> = program.ancestors().skip(1).take(3).collect();
    let [_, profile, target] = folders[..] else { return Err(PackageError::Build(name.into())) };
    let profile = match profile.file_name().map(|name| name.to_string_lossy()) {
        Some(name) if name != "debug" => name.into_owned(),
        _ => "release".into(),
    };
    let Some((cargo, manifest)) = cargo() else { return Err(PackageError::Build(name.into())) };
    let mut command = Command::new(cargo);
    command.args(["build", "--quiet", "--example", name, "--profile", &profile, "--manifest-path"]).arg(manifest);
    command.arg("--target-dir").arg(target);
    let built = command.status().is_ok_and(|status| status.success());
    let library = target.join(profile).join("examples").join(file_name(name));
    if built && library.is_file() { Ok(library) } else { Err(PackageError::Build(name.into())) }
}

/// Cargo and the manifest, if cargo runs the program.
fn cargo() -> Option<(PathBuf, PathBuf)> {
    let manifest = PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR")?).join("Cargo.toml");
    Some((std::env::var_os("CARGO")?.into(), manifest))
}

fn file_name(library: &str) -> String {
    format!("{}{library}{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX)
}
