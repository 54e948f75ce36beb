//! The program and the FMUs that it packages.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The folder of the project.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// An empty folder for this test.
pub fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).expect("a folder");
    folder
}

/// The program, already built, run in a folder.
pub fn program(folder: &Path) -> Command {
    let path = root().join("target/release").join(format!("magnetic-bearing{}", std::env::consts::EXE_SUFFIX));
    let mut command = Command::new(path);
    command.current_dir(folder);
    command
}

/// Runs a command that must succeed.
pub fn run(command: &mut Command) {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
}

/// The FMUs for FMI 2.0 in a folder.
pub fn fmus(folder: &Path) -> Vec<PathBuf> {
    let mut fmus: Vec<_> = fs::read_dir(folder).expect("a folder").map(|file| file.expect("a file").path()).collect();
    fmus.retain(|path| path.to_str().is_some_and(|name| name.ends_with(".fmu") && !name.ends_with("_fmi3.fmu")));
    assert!(fmus.len() >= 15, "the FMUs of every machine: {fmus:?}");
    fmus
}
