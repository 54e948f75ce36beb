//! Files in the folder `resources` of an FMU.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::model::Invalid;

/// The unpacked folder `resources` of an FMU. `package::Extras` puts files there.
///
/// ```
/// # use fmu_export::Resources;
/// let folder = Resources::from_uri("file:///my%20models/pump/resources");
/// assert!(folder.path("map.csv").expect("a folder is given").ends_with("resources/map.csv"));
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Resources(Result<Arc<Path>, Arc<str>>);

impl Default for Resources {
    fn default() -> Self {
        Self(Err("the instance was made without a folder `resources`".into()))
    }
}

impl Resources {
    /// A folder.
    pub fn in_folder(folder: impl AsRef<Path>) -> Self {
        Self(Ok(folder.as_ref().into()))
    }

    /// A folder as a URI, as in FMI 2.0, for instance `file:///home/me/pump/resources`. Importers write one to four slashes.
    pub fn from_uri(uri: &str) -> Self {
        let after_scheme = uri.split_at_checked(5).filter(|(scheme, _)| scheme.eq_ignore_ascii_case("file:"));
        let Some(path) = after_scheme.and_then(|(_, path)| without_escapes(path)) else {
            return Self(Err(format!("the importer gave the folder `resources` as `{uri}`").into()));
        };
        // Two slashes precede a host name, which is empty or `localhost`; four are an empty host and a path with two.
        let path = path.strip_prefix("//localhost/").unwrap_or(path.trim_start_matches('/'));
        let has_drive = path.as_bytes().get(1) == Some(&b':');
        Self::in_folder(if has_drive { path.to_owned() } else { format!("/{path}") })
    }

    /// The path of a file.
    ///
    /// # Errors
    /// If the importer gave no folder.
    pub fn path(&self, name: &str) -> Result<PathBuf, Invalid> {
        match &self.0 {
            Ok(folder) => Ok(folder.join(name)),
            Err(why) => Err(Invalid::new(format!("resources/{name}"), why, "a file in a folder that can be read")),
        }
    }

    /// The content of a file.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn read(&self, name: &str) -> Result<Vec<u8>, Invalid> {
        let path = self.path(name)?;
        fs::read(&path).map_err(|error| {
            Invalid::new(
                format!("resources/{name}"),
                format!("{} ({error})", path.display()),
                "a file that can be read",
            )
        })
    }

    /// The content of a file in UTF-8.
    ///
    /// # Errors
    /// If it cannot be read, or is no text.
    pub fn read_text(&self, name: &str) -> Result<String, Invalid> {
        String::from_utf8(self.read(name)?)
            .map_err(|error| Invalid::new(format!("resources/{name}"), error, "a text in UTF-8"))
    }
}

/// A text with `%20` and the like replaced; `None` if that is no UTF-8.
fn without_escapes(text: &str) -> Option<String> {
    let mut parts = text.split('%');
    let mut bytes = parts.next()?.as_bytes().to_vec();
    for part in parts {
        match part.get(..2).and_then(|digits| u8::from_str_radix(digits, 16).ok()) {
            Some(byte) => {
                bytes.push(byte);
                bytes.extend(&part.as_bytes()[2..]);
            }
            None => {
                bytes.push(b'%');
                bytes.extend(part.as_bytes());
            }
        }
    }
    String::from_utf8(bytes).ok()
}
