//! The frame of every HTML page: one head, one style, light and dark, and nothing that is loaded from elsewhere.

use maud::{DOCTYPE, Markup, PreEscaped, html};

/// Inline, so that a page is a single file.
const STYLE: &str = include_str!("html/style.css");

/// A page with its title and body.
pub fn page(title: &str, body: &Markup) -> String {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body { (body) }
        }
    }
    .into_string()
}
