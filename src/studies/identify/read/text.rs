//! The text of a recording: compression, encoding, separator, and cells as numbers.

use std::io::{self, Chain, Cursor, Read};

use encoding_rs::{Encoding, UTF_16BE, UTF_16LE, WINDOWS_1252};
use encoding_rs_io::DecodeReaderBytesBuilder;
use flate2::read::MultiGzDecoder;

/// The header must lie within so many bytes of the beginning, in UTF-8.
const HEAD: usize = 64 * 1024;

/// The beginning of a recording and the whole of it, as UTF-8: from UTF-8, UTF-16 or Windows-1252 (of which Latin-1 is a part), with or without
/// byte-order mark, plain or compressed by gzip.
pub(super) fn open(from: &mut dyn Read) -> io::Result<(String, impl Read)> {
    let (start, from) = peek(from)?;
    let plain: Box<dyn Read> =
        if start.starts_with(&[0x1f, 0x8b]) { Box::new(MultiGzDecoder::new(from)) } else { Box::new(from) };
    let (start, plain) = peek(plain)?;
    let mut decoder = DecodeReaderBytesBuilder::new();
    decoder.encoding(encoding(&start)).bom_override(true).utf8_passthru(true).strip_bom(true);
    let (head, text) = peek(decoder.build(plain))?;
    // The head may end within a character.
    Ok((String::from_utf8_lossy(&head).into_owned(), text))
}

/// Bytes that were read already, and those that follow.
type Again<R> = Chain<Cursor<Vec<u8>>, R>;

/// The first bytes, and all of them.
fn peek<R: Read>(mut from: R) -> io::Result<(Vec<u8>, Again<R>)> {
    let mut start = Vec::new();
    from.by_ref().take(HEAD as u64).read_to_end(&mut start)?;
    Ok((start.clone(), Cursor::new(start).chain(from)))
}

/// The encoding that the first bytes show where no byte-order mark does.
fn encoding(start: &[u8]) -> Option<&'static Encoding> {
    // ASCII in UTF-16 has a zero in every pair of bytes.
    let zeros = |parity: usize| start.iter().skip(parity).step_by(2).filter(|byte| **byte == 0).count();
    let many = start.len() / 5;
    // A block may end within a character.
    let broken = std::str::from_utf8(start).is_err_and(|error| error.error_len().is_some());
    [(zeros(1) > many, UTF_16LE), (zeros(0) > many, UTF_16BE), (broken, WINDOWS_1252)]
        .into_iter()
        .find_map(|(is, encoding)| is.then_some(encoding))
}

/// The separator that a header has most of.
pub(super) fn separator(header: &str) -> Option<char> {
    let count = |separator: &char| header.matches(*separator).count();
    [',', '\t', ';'].into_iter().max_by_key(count).filter(|separator| count(separator) > 0)
}

/// A cell that stands for a missing value.
pub(super) fn missing(cell: &str) -> bool {
    matches!(cell, "" | "-") || ["nan", "na", "n/a", "null"].iter().any(|word| cell.eq_ignore_ascii_case(word))
}

/// A cell as a number; `None` for what is none, NaN for what is missing. A decimal comma is understood where the comma does
/// not separate the cells.
pub(super) fn number(cell: &[u8], separator: char) -> Option<f64> {
    let cell = std::str::from_utf8(cell).ok()?.trim();
    if missing(cell) {
        return Some(f64::NAN);
    }
    match cell.parse::<f64>() {
        Ok(value) => Some(if value.is_finite() { value } else { f64::NAN }),
        Err(_) if separator != ',' && cell.contains(',') => cell.replacen(',', ".", 1).parse().ok(),
        Err(_) => None,
    }
}
