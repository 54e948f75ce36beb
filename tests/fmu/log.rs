//! Messages of a model.

use fmu_export::log::Digits;

#[test]
fn rounding_errors_are_not_shown() {
    assert_eq!(Digits::<9>(0.036_000_000_000_000_004).to_string(), "0.036");
    assert_eq!(Digits::<9>(0.3).to_string(), "0.3");
    assert_eq!(Digits::<9>(0.0).to_string(), "0.0");
    assert_eq!(Digits::<6>(1.728_129_002_747_755e-6).to_string(), "1.72813e-6");
    assert_eq!(Digits::<6>(f64::NAN).to_string(), "NaN");
}
