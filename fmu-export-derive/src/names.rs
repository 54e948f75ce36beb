//! Names and descriptions.

use syn::{Attribute, Error, LitStr, Meta, Result};

use crate::attributes::literal;

/// The first paragraph of a doc comment in one line, without the final full stop.
pub fn description(attributes: &[Attribute]) -> String {
    let mut lines = Vec::new();
    for attribute in attributes.iter().filter(|attribute| attribute.path().is_ident("doc")) {
        if let Meta::NameValue(pair) = &attribute.meta
            && let Some(text) = literal(&pair.value)
        {
            lines.extend(text.value().split('\n').map(|line| line.trim().to_owned()));
        }
    }
    let paragraph = lines.iter().skip_while(|line| line.is_empty()).take_while(|line| !line.is_empty());
    let text = paragraph.map(String::as_str).collect::<Vec<_>>().join(" ");
    text.strip_suffix('.').map(str::to_owned).unwrap_or(text)
}

/// Checks a literal name against the structured naming convention of FMI 2.0.4, section 2.2.9, as far as names of fields and elements
/// need it.
pub fn check(name: &LitStr) -> Result<()> {
    let text = name.value();
    let part = |part: &str| {
        let (word, indices) = part.split_once('[').map_or((part, None), |(word, indices)| (word, Some(indices)));
        let is_valid_word = if let Some(quoted) = word.strip_prefix('\'') {
            quoted.len() > 1 && quoted.ends_with('\'')
        } else {
            !word.is_empty()
                && !word.starts_with(|letter: char| letter.is_ascii_digit())
                && word.chars().all(|letter| letter.is_ascii_alphanumeric() || letter == '_')
        };
        let index = |index: &str| !index.is_empty() && index.bytes().all(|digit| digit.is_ascii_digit());
        let are_valid_indices = indices
            .is_none_or(|indices| indices.strip_suffix(']').is_some_and(|indices| indices.split(',').all(index)));
        is_valid_word && are_valid_indices
    };
    let quoted_or_derivative = text.contains('\'') || text.starts_with("der(");
    if quoted_or_derivative || text.split('.').all(part) {
        return Ok(());
    }
    let wanted =
        "expected ASCII letters, digits and underscores, not beginning with a digit, in parts divided by points";
    Err(Error::new(name.span(), format!("`{text}` is not allowed as the name of a variable: {wanted}")))
}
