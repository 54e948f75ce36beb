//! Tables and paragraphs on a terminal.

use super::say;
use crate::table::Table;

/// Prints a table under its title and note.
pub fn table(table: &Table) {
    say!("{}", table.title);
    for line in wrapped(&table.note) {
        say!("  {line}");
    }
    columns(&table.head, &table.rows);
}

/// Prints a paragraph.
pub fn paragraph(text: &str) {
    for line in wrapped(text) {
        say!("{line}");
    }
}

/// Wraps a text at 100 characters.
fn wrapped(text: &str) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.chars().count() + word.chars().count() < 100 => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.into()),
        }
    }
    lines
}

/// Prints a column of text and further columns of numbers, aligned right.
fn columns(head: &[String], rows: &[Vec<String>]) {
    let all = || std::iter::once(head).chain(rows.iter().map(Vec::as_slice));
    let width = |column: usize| all().filter_map(|row| row.get(column)).map(|cell| cell.chars().count()).max();
    let widths: Vec<usize> = (0..head.len()).map(|column| width(column).unwrap_or(0)).collect();
    for row in all() {
        let mut line = String::from(" ");
        for (column, (cell, width)) in row.iter().zip(widths.iter().copied()).enumerate() {
            line += &if column == 0 { format!(" {cell:width$}") } else { format!("  {cell:>width$}") };
        }
        say!("{}", line.trim_end());
    }
}
