//! Effects on the process as a whole: the memory it holds when the library comes and goes, and its end.

#[path = "../support/mod.rs"]
mod support;

mod campaign;
#[cfg(target_os = "linux")]
mod unload;
