//! Whether all numbers of a state are finite: a check for external states.

use std::fmt::{self, Display};

use serde::ser::{self, Serialize, Serializer};

/// Whether all floating-point numbers that serde's `Serialize` finds in a value are finite; skipped fields do not count.
/// Allocates nothing and stops at the first number that is not.
///
/// [`Model::accepts`](crate::Model::accepts) can refuse a damaged snapshot with it.
///
/// ```
/// # use fmu_export::is_finite;
/// assert!(is_finite(&(1.0, [2_i32, 3], Some("text"))));
/// assert!(!is_finite(&vec![Some(1.0_f32), Some(f32::NAN)]));
/// ```
pub fn is_finite(value: &impl Serialize) -> bool {
    value.serialize(Finite).is_ok()
}

/// Serializes to nothing; numbers that are not finite are errors.
#[derive(Clone, Copy)]
struct Finite;

/// A number that is not finite, or a value that cannot be serialized.
#[derive(Debug)]
struct NotFinite;

impl Display for NotFinite {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a number is not finite")
    }
}

impl std::error::Error for NotFinite {}

impl ser::Error for NotFinite {
    fn custom<T: Display>(_: T) -> Self {
        Self
    }
}

type Checked = Result<(), NotFinite>;

/// Methods for values without floating-point numbers, and for compound values.
macro_rules! methods {
    ($result:ty: $($method:ident($($of:ty),*);)*) => {
        $(fn $method(self, $(_: $of),*) -> $result { Ok(self.into()) })*
    };
}

impl From<Finite> for () {
    fn from(_: Finite) {}
}

impl Serializer for Finite {
    type Ok = ();
    type Error = NotFinite;
    type SerializeSeq = Self;
    type SerializeTuple = Self;
    type SerializeTupleStruct = Self;
    type SerializeTupleVariant = Self;
    type SerializeMap = Self;
    type SerializeStruct = Self;
    type SerializeStructVariant = Self;

    fn serialize_f32(self, number: f32) -> Checked {
        if number.is_finite() { Ok(()) } else { Err(NotFinite) }
    }

    fn serialize_f64(self, number: f64) -> Checked {
        if number.is_finite() { Ok(()) } else { Err(NotFinite) }
    }

    fn serialize_some<T: Serialize + ?Sized>(self, value: &T) -> Checked {
        value.serialize(self)
    }

    fn serialize_newtype_struct<T: Serialize + ?Sized>(self, _: &'static str, value: &T) -> Checked {
        value.serialize(self)
    }

    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        _: &'static str,
        _: u32,
        _: &'static str,
        value: &T,
    ) -> Checked {
        value.serialize(self)
    }

    methods! { Checked:
        serialize_bool(bool);
        serialize_i8(i8);
        serialize_i16(i16);
        serialize_i32(i32);
        serialize_i64(i64);
        serialize_i128(i128);
        serialize_u8(u8);
        serialize_u16(u16);
        serialize_u32(u32);
        serialize_u64(u64);
        serialize_u128(u128);
        serialize_char(char);
        serialize_str(&str);
        serialize_bytes(&[u8]);
        serialize_none();
        serialize_unit();
        serialize_unit_struct(&'static str);
        serialize_unit_variant(&'static str, u32, &'static str);
    }

    methods! { Result<Self, NotFinite>:
        serialize_seq(Option<usize>);
        serialize_tuple(usize);
        serialize_tuple_struct(&'static str, usize);
        serialize_tuple_variant(&'static str, u32, &'static str, usize);
        serialize_map(Option<usize>);
        serialize_struct(&'static str, usize);
        serialize_struct_variant(&'static str, u32, &'static str, usize);
    }

    // As for snapshots.
    fn is_human_readable(&self) -> bool {
        false
    }

    // A `Display` is a text.
    fn collect_str<T: Display + ?Sized>(self, _: &T) -> Checked {
        Ok(())
    }
}

/// Compound values.
macro_rules! parts {
    ($($trait:ident: $($method:ident($($name:ty)?),)+;)*) => {$(
        impl ser::$trait for Finite {
            type Ok = ();
            type Error = NotFinite;

            $(fn $method<T: Serialize + ?Sized>(&mut self, $(_: $name,)? part: &T) -> Checked {
                part.serialize(*self)
            })+

            fn end(self) -> Checked {
                Ok(())
            }
        }
    )*};
}

parts! {
    SerializeSeq: serialize_element(),;
    SerializeTuple: serialize_element(),;
    SerializeTupleStruct: serialize_field(),;
    SerializeTupleVariant: serialize_field(),;
    SerializeMap: serialize_key(), serialize_value(),;
    SerializeStruct: serialize_field(&'static str),;
    SerializeStructVariant: serialize_field(&'static str),;
}
