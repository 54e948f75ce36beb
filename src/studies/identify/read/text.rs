//! The text of a recording: its encoding, its separator, and its cells as numbers.

use std::io::{self, BufRead, BufReader, Cursor, Read};

use encoding_rs::{Encoding, UTF_16BE, UTF_16LE, WINDOWS_1252};
use encoding_rs_io::{DecodeReaderBytes, DecodeReaderBytesBuilder};

/// The header must lie within so many bytes of the beginning, in UTF-8.
const HEAD: usize = 64 * 1024;

/// What is left to read: the bytes that were looked at to find the encoding, and all that follow.
type Decoder<R> = DecodeReaderBytes<io::Chain<Cursor<Vec<u8>>, R>, Vec<u8>>;

/// The beginning of a recording as lines, and the whole of it to be read again as UTF-8.
pub(super) struct Text<R: Read> {
    head: Vec<u8>,
    rest: BufReader<Decoder<R>>,
}

impl<R: Read> Text<R> {
    /// Decodes UTF-8, UTF-16 and Windows-1252 (of which Latin-1 is a part), with or without byte-order mark.
    pub(super) fn open(mut from: R) -> io::Result<Self> {
        let mut start = Vec::new();
        from.by_ref().take(HEAD as u64).read_to_end(&mut start)?;
        let encoding = encoding(&start);
        let mut decoder = DecodeReaderBytesBuilder::new();
        decoder.encoding(encoding).bom_override(true).utf8_passthru(true).strip_bom(true);
        let decoder = decoder.build(Cursor::new(start).chain(from));
        let mut rest = BufReader::with_capacity(HEAD, decoder);
        let mut head = Vec::new();
        rest.by_ref().take(HEAD as u64).read_to_end(&mut head)?;
        Ok(Self { head, rest })
    }

    /// The lines at the beginning, with the byte at which each starts.
    pub(super) fn lines(&self) -> impl Iterator<Item = (usize, String)> {
        let mut at = 0;
        self.head.split_inclusive(|byte| *byte == b'\n').map(move |line| {
            let start = at;
            at += line.len();
            (start, String::from_utf8_lossy(line).trim_end_matches(['\r', '\n']).to_owned())
        })
    }

    /// The text from a byte of the beginning on.
    pub(super) fn from(self, start: usize) -> impl BufRead {
        let mut head = Cursor::new(self.head);
        head.set_position(start as u64);
        head.chain(self.rest)
    }
}

/// The encoding that the first bytes show where no byte-order mark does.
fn encoding(start: &[u8]) -> Option<&'static Encoding> {
    // ASCII in UTF-16 has a zero in every pair of bytes.
    let zeros = |parity: usize| start.iter().skip(parity).step_by(2).filter(|byte| **byte == 0).count();
    if zeros(1) > start.len() / 5 {
        return Some(UTF_16LE);
    }
    if zeros(0) > start.len() / 5 {
        return Some(UTF_16BE);
    }
    // What was read may end within a character.
    let broken = std::str::from_utf8(start).is_err_and(|error| error.error_len().is_some());
    broken.then_some(WINDOWS_1252)
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
