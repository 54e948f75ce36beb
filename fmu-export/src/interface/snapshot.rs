//! Snapshots, to which `fmi2FMUstate` and `fmi3FMUState` point, and their common serialized form.
//!
//! ```text
//! 8 bytes   the letters FMU2SNAP
//! 2 bytes   version of this format
//! 1 + n     length and text of the model name
//! 1 + n     length and text of the GUID
//! 8 bytes   length of the content
//! n bytes   content: state in the sequence of calls, values, times and run, in postcard's format
//! 32 bytes  SHA-256 of all before
//! ```
//!
//! Numbers are little-endian. The GUID identifies the interface, the version the layout of the content. The content is read only
//! after these checks, and the model checks it again: a hash reveals damage, not intent.

use std::sync::Arc;

use sha2::{Digest, Sha256};

use super::component::Problem;
use super::sequence::State;
use crate::instance::{Instance, ModelType};
use crate::resources::Resources;

const MAGIC: &[u8; 8] = b"FMU2SNAP";
/// Increment this whenever the layout of the content changes, apart from the values and the state of the model.
const VERSION: u16 = 5;
const HASH_BYTES: usize = 32;

/// A snapshot held by the importer: an instance without its name, callbacks and log categories.
pub(crate) struct Snapshot {
    pub(crate) model: Arc<ModelType>,
    pub(crate) instance: Instance,
    pub(crate) stage: Stage,
}

/// Everything in an instance besides its values and its run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stage {
    pub(crate) state: State,
    pub(crate) stop_s: Option<f64>,
    /// Whether the last step failed.
    pub(crate) failed: bool,
}

impl Stage {
    pub(crate) const BEGIN: Self = Self { state: State::Instantiated, stop_s: None, failed: false };
}

/// A serialized [`Stage`]: its fields in order, with the state as a number.
type Head = (u8, Option<f64>, bool);

impl Snapshot {
    /// Serializes the snapshot. Equal snapshots give equal bytes.
    ///
    /// # Errors
    /// If the state of the model refuses to be written.
    pub(crate) fn write(&self) -> Result<Vec<u8>, Problem> {
        let Stage { state, stop_s, failed } = self.stage;
        let head: Head = (state as u8, stop_s, failed);
        let mut content = postcard::to_stdvec(&head).expect("numbers can be written, and memory grows as needed");
        let refused = || Problem::Call("the state of the model cannot be written: serde refuses it".into());
        content.extend(self.instance.write().ok_or_else(refused)?);

        let mut bytes = Vec::with_capacity(content.len() + 128);
        bytes.extend(MAGIC);
        bytes.extend(VERSION.to_le_bytes());
        for text in [self.model.info.name, self.model.guid()] {
            bytes.push(u8::try_from(text.len()).expect("names and GUIDs are short"));
            bytes.extend(text.as_bytes());
        }
        bytes.extend((content.len() as u64).to_le_bytes());
        bytes.extend(content);
        let hash = Sha256::digest(&bytes);
        bytes.extend(hash);
        Ok(bytes)
    }

    /// Reads bytes serialized by this process or another.
    ///
    /// # Errors
    /// Why the bytes are not a snapshot of this model.
    pub(crate) fn read(model: &Arc<ModelType>, resources: &Resources, bytes: &[u8]) -> Result<Self, String> {
        let content = content(model, bytes)?;
        let (head, rest): (Head, _) =
            postcard::take_from_bytes(content).map_err(|error| format!("the content is damaged: {error}"))?;
        let stage = stage(head)?;
        let mut instance = model.instantiate_with(resources.clone());
        instance
            .read(rest, matches!(stage.state, State::StepMode | State::EventMode))
            .map_err(|why| format!("the content is damaged: {why}"))?;
        let fits = match stage.state {
            State::Instantiated | State::InitializationMode => !instance.has_begun(),
            State::StepMode | State::EventMode => instance.has_begun(),
            State::Terminated | State::Error => true,
        };
        if !fits {
            return Err("the content is damaged: the run does not belong to the state".into());
        }
        Ok(Self { model: model.clone(), instance, stage })
    }
}

fn stage((number, stop_s, failed): Head) -> Result<Stage, String> {
    let state = State::ALL.into_iter().find(|state| *state as u8 == number);
    let state = state.ok_or_else(|| format!("the content is damaged: there is no state {number}"))?;
    if stop_s.is_some_and(f64::is_nan) {
        return Err("the content is damaged: the stop time is not a number".into());
    }
    Ok(Stage { state, stop_s, failed })
}

/// The content of a byte string with a valid frame.
fn content<'b>(model: &ModelType, bytes: &'b [u8]) -> Result<&'b [u8], String> {
    let whole = bytes;
    let mut rest = bytes;
    let mut take = |length: usize| -> Result<&'b [u8], String> {
        let (head, tail) = rest.split_at_checked(length).ok_or_else(|| {
            format!("the bytes end too early: there are {}, {} more are expected", whole.len(), length - rest.len())
        })?;
        rest = tail;
        Ok(head)
    };
    if take(MAGIC.len())? != MAGIC {
        return Err("the bytes are not a snapshot: they do not begin with FMU2SNAP".into());
    }
    let version = u16::from_le_bytes(take(2)?.try_into().expect("two bytes were taken"));
    if version != VERSION {
        return Err(format!("the bytes have version {version} of the format: expected version {VERSION}"));
    }
    for (what, wanted) in [("model", model.info.name), ("GUID", model.guid())] {
        let length = usize::from(take(1)?[0]);
        let found = take(length)?;
        if found != wanted.as_bytes() {
            let found = String::from_utf8_lossy(found);
            return Err(format!("the bytes belong to the {what} {}: expected {wanted}", found.escape_debug()));
        }
    }
    let length = u64::from_le_bytes(take(8)?.try_into().expect("eight bytes were taken"));
    let length = usize::try_from(length).unwrap_or(usize::MAX);
    let content = take(length)?;
    let hash = take(HASH_BYTES)?;
    if !rest.is_empty() {
        return Err(format!("{} bytes are left over at the end", rest.len()));
    }
    if hash != Sha256::digest(&whole[..whole.len() - HASH_BYTES]).as_slice() {
        return Err("the bytes were changed: their SHA-256 differs".into());
    }
    Ok(content)
}
