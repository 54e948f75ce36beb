//! The bindings are generated from the headers and have the standard's memory layout on every platform.
//!
//! `scripts/bindings --check` regenerates and compares them, and `scripts/check_header.py` compares the headers with the standard's; both
//! need libclang, these tests do not.

use crate::prelude::*;
use core::ffi::c_void;
use core::mem::{align_of, offset_of, size_of};

use fmu_export::fmi3::bindings::{fmi3Boolean, fmi3Clock, fmi3Status};

const BINDINGS3: &str = include_str!("../../fmu-export/src/fmi3/bindings.rs");

/// Fails if a header was changed without running `scripts/bindings`, if a function has no type, or if one is declared in addition to our
/// own definition.
#[test]
fn the_bindings_were_generated_from_these_headers() {
    let headers: [(&[u8], &str, usize); 2] = [
        (include_bytes!("../../fmu-export/src/fmi2/fmi2.h"), include_str!("../../fmu-export/src/fmi2/bindings.rs"), 34),
        (include_bytes!("../../fmu-export/src/fmi3/fmi3.h"), BINDINGS3, 75),
    ];
    for (header, bindings, functions) in headers {
        let recorded = bindings.lines().find_map(|line| line.strip_prefix("// SHA-256 of the header: "));
        let digest: String = Sha256::digest(header).iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(recorded, Some(&*digest), "the header was changed without running scripts/bindings");
        let types = bindings.lines().filter_map(|line| line.strip_prefix("pub type ")?.split_whitespace().next());
        assert_eq!(types.filter(|name| name.ends_with("TYPE")).count(), functions);
        assert!(!bindings.contains("extern \"C\" {"), "the library defines these functions itself");
    }
}

/// A Rust `bool` must be 0 or 1, and an importer may pass any byte.
#[test]
fn the_bindings_contain_no_rust_bool() {
    assert!(!BINDINGS3.contains("bool"), "a Boolean of the importer is a byte");
}

#[test]
fn the_sizes_are_those_of_the_platform_default() {
    let pointer = size_of::<*const c_void>();
    for (name, size, expected) in [
        ("fmi2Component", size_of::<fmi2Component>(), pointer),
        ("fmi2ComponentEnvironment", size_of::<fmi2ComponentEnvironment>(), pointer),
        ("fmi2FMUstate", size_of::<fmi2FMUstate>(), pointer),
        ("fmi2String", size_of::<fmi2String>(), pointer),
        ("fmi2ValueReference", size_of::<fmi2ValueReference>(), 4),
        ("fmi2Real", size_of::<fmi2Real>(), 8),
        ("fmi2Integer", size_of::<fmi2Integer>(), 4),
        ("fmi2Boolean", size_of::<fmi2Boolean>(), 4),
        ("fmi2Char", size_of::<fmi2Char>(), 1),
        ("fmi2Byte", size_of::<fmi2Byte>(), 1),
        ("fmi2Status", size_of::<fmi2Status>(), 4),
        ("fmi2Type", size_of::<fmi2Type>(), 4),
        ("fmi2StatusKind", size_of::<fmi2StatusKind>(), 4),
        ("fmi3Status", size_of::<fmi3Status>(), 4),
        ("fmi3Boolean", size_of::<fmi3Boolean>(), 1),
        ("fmi3Clock", size_of::<fmi3Clock>(), 1),
    ] {
        assert_eq!(size, expected, "bytes of {name}");
    }
}

#[test]
fn the_callbacks_are_consecutive_pointers() {
    let pointer = size_of::<*const c_void>();
    let places = [
        offset_of!(fmi2CallbackFunctions, logger),
        offset_of!(fmi2CallbackFunctions, allocateMemory),
        offset_of!(fmi2CallbackFunctions, freeMemory),
        offset_of!(fmi2CallbackFunctions, stepFinished),
        offset_of!(fmi2CallbackFunctions, componentEnvironment),
    ];
    assert_eq!(places, [0, 1, 2, 3, 4].map(|place| place * pointer));
    assert_eq!(size_of::<fmi2CallbackFunctions>(), 5 * pointer);
    assert_eq!(align_of::<fmi2CallbackFunctions>(), align_of::<*const c_void>());
}
