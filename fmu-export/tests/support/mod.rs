//! The importer shared by all tests; it calls the C functions of `crate::library`.

#![allow(dead_code, reason = "every test program uses a part of this")]

pub mod abuse;
pub mod abuse3;
pub mod ffi;
pub mod ffi3;
pub mod random;
pub mod sequence;
pub mod sequence3;

pub(crate) use crate::library;
