//! The frame of every HTML page: one head, one style, light and dark, and nothing that is loaded from elsewhere.

use maud::{DOCTYPE, Markup, PreEscaped, html};

/// Inline, so that a page is a single file.
const STYLE: &str = include_str!("style.css");

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

/// The command that runs this program as it runs now, with every argument, for the page that it makes.
pub fn command_line() -> String {
    let quoted = std::env::args_os()
        .map(|argument| argument.to_string_lossy().into_owned())
        .skip(1)
        .map(|argument| quote(&argument))
        .collect::<Vec<_>>();
    match quoted.as_slice() {
        [] => "cargo run --release".into(),
        arguments => format!("cargo run --release -- {}", arguments.join(" ")),
    }
}

/// An argument as a shell reads it.
fn quote(argument: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "-_./=,:+@%".contains(c);
    if !argument.is_empty() && argument.chars().all(plain) {
        argument.into()
    } else {
        format!("'{}'", argument.replace('\'', "'\\''"))
    }
}
