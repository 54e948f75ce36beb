//! Non-finite numbers are found in every shape of serde's data model.

use std::collections::BTreeMap;

use fmu_export::{Array, is_finite};
use serde::Serialize;

#[derive(Serialize)]
struct Unit;

#[derive(Serialize)]
struct Newtype(f64);

#[derive(Serialize)]
struct Pair(u8, f64);

#[derive(Serialize)]
struct Named {
    level: f64,
    #[serde(skip)]
    skipped: f64,
}

#[derive(Serialize)]
enum Any {
    Unit,
    Newtype(f64),
    Tuple(i64, f64),
    Struct { level: f64 },
}

/// Every shape of serde's data model that can hold a number.
fn shapes(x: f64) -> Vec<(&'static str, bool)> {
    vec![
        ("f64", is_finite(&x)),
        ("f32", is_finite(&(x as f32))),
        ("option", is_finite(&Some(x))),
        ("sequence", is_finite(&vec![1.0, x])),
        ("array", is_finite(&[x, 1.0])),
        ("long array", is_finite(&Array::<f64, 40>([x; 40]))),
        ("tuple", is_finite(&('c', 2_u8, x))),
        ("newtype", is_finite(&Newtype(x))),
        ("tuple structure", is_finite(&Pair(1, x))),
        ("structure", is_finite(&Named { level: x, skipped: 0.0 })),
        ("newtype variant", is_finite(&Any::Newtype(x))),
        ("tuple variant", is_finite(&Any::Tuple(1, x))),
        ("structure variant", is_finite(&Any::Struct { level: x })),
        ("value of a map", is_finite(&BTreeMap::from([("key", x)]))),
        ("key of a map", is_finite(&BTreeMap::from([(Ordered(x), 1)]))),
        ("box in a vector of options", is_finite(&vec![None, Some(Box::new(x))])),
    ]
}

#[derive(Serialize)]
struct Ordered(f64);

impl PartialEq for Ordered {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Ordered {}

impl PartialOrd for Ordered {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Ordered {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

#[test]
fn a_number_that_is_not_finite_is_found_in_every_shape() {
    for x in [0.0, -1e30, f64::MIN_POSITIVE] {
        for (shape, finite) in shapes(x) {
            assert!(finite, "{shape} of {x}");
        }
    }
    for x in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for (shape, finite) in shapes(x) {
            assert!(!finite, "{shape} of {x}");
        }
    }
}

#[test]
fn other_values_and_skipped_fields_are_finite() {
    assert!(is_finite(&(Unit, (), Any::Unit, None::<f64>, "NaN", String::from("inf"))));
    assert!(is_finite(&(true, 'c', -1_i8, 1_i16, 1_i32, 1_i64, 1_i128, 1_u8, 1_u16, 1_u32, 1_u64, 1_u128)));
    let named = Named { level: 1.0, skipped: f64::NAN };
    assert!(is_finite(&named) && named.skipped.is_nan());
}
