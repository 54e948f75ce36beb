//! Head and style of every HTML page, light and dark; nothing is loaded from elsewhere.

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

/// The command of this run, to show on its page.
pub fn command_line() -> String {
    let arguments: Vec<_> = std::env::args_os().skip(1).map(|argument| quote(&argument.to_string_lossy())).collect();
    match &arguments[..] {
        [] => "cargo run --release".into(),
        arguments => format!("cargo run --release -- {}", arguments.join(" ")),
    }
}

/// Quotes an argument for a shell.
fn quote(argument: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "-_./=,:+@%".contains(c);
    if !argument.is_empty() && argument.chars().all(plain) {
        argument.into()
    } else {
        format!("'{}'", argument.replace('\'', "'\\''"))
    }
}
