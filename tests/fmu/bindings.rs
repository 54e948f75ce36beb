//! The bindings are generated from the headers.
//!
//! `scripts/bindings --check` regenerates and compares them, and `scripts/check_header.py` compares the headers with the standard's; both
//! need libclang, these tests do not.

use crate::prelude::*;

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
