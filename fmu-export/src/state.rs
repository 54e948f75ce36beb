//! The hidden state of a model, and whether snapshots can hold it.

use std::io::Read;
use std::ops::{Deref, DerefMut};

use serde::Serialize;
use serde::de::DeserializeOwned;

/// The hidden state of a model.
///
/// Any type with `Clone` and serde's `Serialize` and `Deserialize`; `()` if there is none. Snapshots hold it. Wrap a state that
/// cannot be copied or written, such as a solver of another library, in [`NotSaved`]: the FMU then declares that it has no
/// snapshots.
#[diagnostic::on_unimplemented(
    message = "`{Self}` cannot be saved as the state of a model",
    note = "expected `#[derive(Clone, Serialize, Deserialize)]`; arrays of more than 32 elements are `Array<T, N>`",
    note = "a state that cannot have these is `NotSaved<…>`: the FMU then has no snapshots"
)]
pub trait HiddenState: Sized + Send + Sync + 'static {
    /// Whether snapshots are possible.
    const SAVED: bool;
    /// A copy; `None` if it cannot be copied.
    fn copy(&self) -> Option<Self>;
    /// Appends the state to bytes; `None` if it cannot be written.
    fn write(&self, bytes: &mut Vec<u8>) -> Option<()>;
    /// Reads a state and the bytes after it.
    ///
    /// # Errors
    /// Why the bytes are not a state.
    fn read(bytes: &[u8]) -> Result<(Self, &[u8]), String>;
}

impl<T: Clone + Serialize + DeserializeOwned + Send + Sync + 'static> HiddenState for T {
    const SAVED: bool = true;

    fn copy(&self) -> Option<Self> {
        Some(self.clone())
    }

    fn write(&self, bytes: &mut Vec<u8>) -> Option<()> {
        write_to(bytes, self)
    }

    fn read(mut bytes: &[u8]) -> Result<(Self, &[u8]), String> {
        // A trait object, because inlined reading of hundreds of numbers would compile slowly.
        let (mut texts, reader): (_, &mut dyn Read) = (vec![0; bytes.len()], &mut bytes);
        let (state, _) = postcard::from_io((reader, &mut texts)).map_err(|error| error.to_string())?;
        Ok((state, bytes))
    }
}

/// Appends a value in postcard's format; `None` if its length is not known beforehand, or serialization fails.
pub(crate) fn write_to(bytes: &mut Vec<u8>, value: &impl Serialize) -> Option<()> {
    *bytes = postcard::to_extend(value, std::mem::take(bytes)).ok()?;
    Some(())
}

/// A state that snapshots cannot hold; its FMU declares that it has no snapshots.
///
/// ```
/// # use fmu_export::{HiddenState, NotSaved};
/// struct Solver;
/// assert!(!<NotSaved<Solver> as HiddenState>::SAVED);
/// ```
#[derive(Debug, Default, PartialEq, Eq)]
pub struct NotSaved<T>(pub T);

impl<T> Deref for NotSaved<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.0
    }
}

impl<T> DerefMut for NotSaved<T> {
    fn deref_mut(&mut self) -> &mut T {
        &mut self.0
    }
}

impl<T: Send + Sync + 'static> HiddenState for NotSaved<T> {
    const SAVED: bool = false;

    fn copy(&self) -> Option<Self> {
        None
    }

    fn write(&self, _: &mut Vec<u8>) -> Option<()> {
        None
    }

    fn read(_: &[u8]) -> Result<(Self, &[u8]), String> {
        Err("the model has no snapshots".into())
    }
}
