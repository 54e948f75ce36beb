//! Which models this binary serves, by GUID.

use std::sync::LazyLock;

use super::description;
use crate::slave::{Kind, catalogue};

/// A model with the GUID of its interface and its model description.
pub struct Entry {
    /// The model.
    pub kind: &'static Kind,
    /// GUID, with braces: a hash of the model description, so that model description and binary belong together.
    pub guid: String,
    /// The text of `modelDescription.xml`.
    pub description: String,
}

static ENTRIES: LazyLock<Vec<Entry>> = LazyLock::new(|| {
    let entry = |kind: &'static Kind| {
        // Miri, which is after accesses to memory, would take many minutes over texts.
        let (guid, description) =
            if cfg!(miri) { (format!("{{{}}}", kind.name), String::new()) } else { description::write(kind) };
        Entry { kind, guid, description }
    };
    catalogue().into_iter().map(entry).collect()
});

/// All models.
pub fn entries() -> &'static [Entry] {
    &ENTRIES
}

/// The model of that GUID.
pub(super) fn by_guid(guid: &str) -> Option<&'static Entry> {
    entries().iter().find(|entry| entry.guid == guid)
}

/// All GUIDs with their models, for messages.
pub(super) fn listed() -> String {
    let listed: Vec<_> = entries().iter().map(|entry| format!("{} ({})", entry.guid, entry.kind.name)).collect();
    listed.join(" or ")
}

/// Where the models are kept, to be dropped when the library is unloaded.
pub(super) fn shelf() -> &'static (dyn std::any::Any + Send + Sync) {
    &ENTRIES
}
