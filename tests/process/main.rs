//! Effects on the whole process: memory while the library is loaded and unloaded, and process exit.

#[path = "../support/mod.rs"]
mod support;

mod campaign;
#[cfg(target_os = "linux")]
mod unload;
