//! What the tests share: an importer that calls the C functions of `crate::library`.

#![allow(dead_code, reason = "every test program uses a part of this")]

pub mod abuse;
pub mod ffi;
pub mod random;
pub mod sequence;

pub(crate) use crate::library;
