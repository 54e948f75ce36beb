//! The text of a recording: compression, encoding, separator, and cells as numbers.

use std::borrow::Cow;
use std::io::{BufRead, BufReader, Read};

use encoding_rs::{UTF_8, UTF_16BE, UTF_16LE, WINDOWS_1252};
use flate2::bufread::MultiGzDecoder;

/// Size of the beginning that determines the encoding, in bytes.
const HEAD: usize = 64 * 1024;

/// The bytes of a recording, plain or compressed by gzip.
pub(super) fn bytes(from: &mut dyn Read) -> Result<Vec<u8>, String> {
    let (mut from, mut bytes) = (BufReader::new(from), Vec::new());
    let is_zipped = from.fill_buf().is_ok_and(|start| start.starts_with(&[0x1f, 0x8b]));
    let read = if is_zipped { MultiGzDecoder::new(from).read_to_end(&mut bytes) } else { from.read_to_end(&mut bytes) };
    read.map_err(|error| format!("the text cannot be read: {error}"))?;
    Ok(bytes)
}

/// The text of UTF-8, UTF-16 or Windows-1252 (which includes Latin-1), with or without byte-order mark.
pub(super) fn decoded(bytes: &[u8]) -> Cow<'_, str> {
    let start = &bytes[..bytes.len().min(HEAD)];
    // ASCII in UTF-16 has a zero in every pair of bytes.
    let has_zeros =
        |parity: usize| start.iter().skip(parity).step_by(2).filter(|byte| **byte == 0).count() > start.len() / 5;
    let encoding = match std::str::from_utf8(start) {
        _ if has_zeros(1) => UTF_16LE,
        _ if has_zeros(0) => UTF_16BE,
        // The start may end within a character.
        Err(error) if error.error_len().is_some() => WINDOWS_1252,
        _ => UTF_8,
    };
    encoding.decode(bytes).0
}

/// The most frequent separator of a header.
pub(super) fn separator(header: &str) -> Option<char> {
    let count = |separator: &char| header.matches(*separator).count();
    [',', '\t', ';'].into_iter().max_by_key(count).filter(|separator| count(separator) > 0)
}

/// Instruments write this number for an overflow, and a greater one for a value that is missing (SCPI).
const OVERFLOW: f64 = 9.9e37;

/// Whether a cell stands for a missing value.
pub(super) fn missing(cell: &str) -> bool {
    const WORDS: [&str; 13] =
        ["", "-", "--", "---", "nan", "na", "n/a", "#n/a", "#nv", "#div/0!", "1.#qnan", "-1.#ind", "null"];
    WORDS.iter().any(|word| cell.eq_ignore_ascii_case(word))
}

/// A cell as a number; `None` if it is not one, NaN if it is missing. Decimal commas are accepted unless commas separate the
/// cells.
pub(super) fn number(cell: &str, separator: char) -> Option<f64> {
    let value = match cell.parse::<f64>() {
        Err(_) if missing(cell) => f64::NAN,
        Err(_) if separator != ',' && cell.contains(',') => cell.replacen(',', ".", 1).parse().ok()?,
        parsed => parsed.ok()?,
    };
    Some(if value.abs() < OVERFLOW { value } else { f64::NAN })
}
