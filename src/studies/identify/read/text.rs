//! The text of a recording: compression, encoding, separator, and cells as numbers.

use std::io::{self, Cursor, Read};

use encoding_rs::{Encoding, UTF_8, UTF_16BE, UTF_16LE, WINDOWS_1252};
use encoding_rs_io::DecodeReaderBytesBuilder;
use flate2::read::MultiGzDecoder;

/// Size of the beginning that must contain the header, in bytes of UTF-8.
const HEAD: u64 = 64 * 1024;

/// The beginning of a recording and the whole of it, as UTF-8: from UTF-8, UTF-16 or Windows-1252 (which includes Latin-1), with or without
/// byte-order mark, plain or compressed by gzip.
pub(super) fn open(from: &mut dyn Read) -> io::Result<(String, impl Read)> {
    let (start, from) = peek(from)?;
    let plain: Box<dyn Read> =
        if start.starts_with(&[0x1f, 0x8b]) { Box::new(MultiGzDecoder::new(from)) } else { Box::new(from) };
    let (start, plain) = peek(plain)?;
    let mut decoder = DecodeReaderBytesBuilder::new();
    let (head, text) = peek(decoder.encoding(Some(encoding(&start))).bom_override(true).strip_bom(true).build(plain))?;
    // The head may end within a character.
    Ok((String::from_utf8_lossy(&head).into_owned(), text))
}

/// The first bytes, and a reader of all bytes.
fn peek(mut from: impl Read) -> io::Result<(Vec<u8>, impl Read)> {
    let mut start = Vec::new();
    from.by_ref().take(HEAD).read_to_end(&mut start)?;
    Ok((start.clone(), Cursor::new(start).chain(from)))
}

/// The encoding by the first bytes, if there is no byte-order mark.
fn encoding(start: &[u8]) -> &'static Encoding {
    // ASCII in UTF-16 has a zero in every pair of bytes.
    let has_zeros =
        |parity: usize| start.iter().skip(parity).step_by(2).filter(|byte| **byte == 0).count() > start.len() / 5;
    match std::str::from_utf8(start) {
        _ if has_zeros(1) => UTF_16LE,
        _ if has_zeros(0) => UTF_16BE,
        // A block may end within a character.
        Err(error) if error.error_len().is_some() => WINDOWS_1252,
        _ => UTF_8,
    }
}

/// The most frequent separator of a header.
pub(super) fn separator(header: &str) -> Option<char> {
    let count = |separator: &char| header.matches(*separator).count();
    [',', '\t', ';'].into_iter().max_by_key(count).filter(|separator| count(separator) > 0)
}

/// Whether a cell stands for a missing value.
pub(super) fn missing(cell: &str) -> bool {
    ["", "-", "---", "nan", "na", "n/a", "#n/a", "null"].iter().any(|word| cell.eq_ignore_ascii_case(word))
}

/// A cell as a number; `None` if it is not one, NaN if it is missing. Decimal commas are accepted unless commas separate the
/// cells.
pub(super) fn number(cell: &str, separator: char) -> Option<f64> {
    let value = match cell.parse::<f64>() {
        Err(_) if missing(cell) => f64::NAN,
        Err(_) if separator != ',' && cell.contains(',') => cell.replacen(',', ".", 1).parse().ok()?,
        parsed => parsed.ok()?,
    };
    Some(if value.is_finite() { value } else { f64::NAN })
}
