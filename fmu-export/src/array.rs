//! Arrays of any length with `Default` and serde's traits, which Rust's own arrays have up to 32 elements only.

use std::fmt;
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};

use serde::de::{Error, SeqAccess, Visitor};
use serde::ser::SerializeTuple;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// `[T; N]` with `Default` and serde's traits for every length, including lengths that are generic parameters.
///
/// ```
/// use fmu_export::Array;
/// let mut cells: Array<f64, 40> = Array::default();
/// cells[39] = 293.15;
/// assert_eq!(cells.iter().sum::<f64>(), 293.15);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Array<T, const N: usize>(pub [T; N]);

impl<T: Default, const N: usize> Default for Array<T, N> {
    fn default() -> Self {
        Self(std::array::from_fn(|_| T::default()))
    }
}

impl<T, const N: usize> From<[T; N]> for Array<T, N> {
    fn from(elements: [T; N]) -> Self {
        Self(elements)
    }
}

impl<T, const N: usize> Deref for Array<T, N> {
    type Target = [T; N];

    fn deref(&self) -> &[T; N] {
        &self.0
    }
}

impl<T, const N: usize> DerefMut for Array<T, N> {
    fn deref_mut(&mut self) -> &mut [T; N] {
        &mut self.0
    }
}

impl<T: Serialize, const N: usize> Serialize for Array<T, N> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serialize(&self.0, serializer)
    }
}

impl<'de, T: Deserialize<'de>, const N: usize> Deserialize<'de> for Array<T, N> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserialize(deserializer).map(Self)
    }
}

/// Writes an array of any length; with [`deserialize`] for `#[serde(with = "fmu_export::array")]` on a field `[T; N]`.
///
/// # Errors
/// Those of the serializer.
pub fn serialize<S: Serializer, T: Serialize, const N: usize>(
    array: &[T; N],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    let mut tuple = serializer.serialize_tuple(N)?;
    for element in array {
        tuple.serialize_element(element)?;
    }
    tuple.end()
}

/// Reads an array of any length.
///
/// # Errors
/// Those of the deserializer, and if there are too few elements.
pub fn deserialize<'de, D: Deserializer<'de>, T: Deserialize<'de>, const N: usize>(
    deserializer: D,
) -> Result<[T; N], D::Error> {
    struct Elements<T, const N: usize>(PhantomData<T>);

    impl<'de, T: Deserialize<'de>, const N: usize> Visitor<'de> for Elements<T, N> {
        type Value = [T; N];

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            write!(f, "an array of {N} elements")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut elements: A) -> Result<[T; N], A::Error> {
            let mut read = Vec::with_capacity(N);
            while read.len() < N {
                let element = elements.next_element()?.ok_or_else(|| A::Error::invalid_length(read.len(), &self))?;
                read.push(element);
            }
            // On the heap, because threads of importers have small stacks.
            let read: Box<[T; N]> = read.try_into().unwrap_or_else(|_| unreachable!("there are as many elements"));
            Ok(*read)
        }
    }

    deserializer.deserialize_tuple(N, Elements(PhantomData))
}
