//! Platforms of binaries in an FMU: their file formats, and the folders in which importers look for them.
//!
//! FMI 2.0.4, section 2.3, defines `linux64`, `win64` and `darwin64`, all of them x86-64, and refers other platforms to the
//! names of FMI 3.0, `aarch64-linux` and `aarch64-darwin`; there the first three are `x86_64-linux`, `x86_64-windows` and
//! `x86_64-darwin`. Many importers on Arm know only the first three, so [`Binaries`] also puts a binary there if the folder is free.

use std::collections::HashSet;
use std::fmt;
use std::ops::Deref;
use std::sync::OnceLock;

use super::{Member, PackageError, archive};
use crate::Standard;

/// A platform, under the name of its folder in an FMU.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Platform {
    /// Name of the folder in FMI 2.0.
    pub name: &'static str,
    /// Name of the folder in FMI 3.0.
    pub tuple: &'static str,
    /// File name extension of a shared library.
    pub ending: &'static str,
    /// The platform in words.
    pub words: &'static str,
    format: Format,
    /// Number of the processor in the file format.
    machine: u32,
}

impl Platform {
    const fn new(name: &'static str, tuple: &'static str, words: &'static str, format: Format, machine: u32) -> Self {
        let ending = match format {
            Format::Elf => "so",
            Format::Pe => "dll",
            Format::MachO => "dylib",
        };
        Self { name, tuple, ending, words, format, machine }
    }
}

impl fmt::Display for Platform {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({}, {})", self.name, self.words, self.format)
    }
}

/// All platforms, in the order in which archives hold them.
pub const PLATFORMS: &[Platform] = &[
    Platform::new("linux64", "x86_64-linux", "Linux on x86-64", Format::Elf, 62),
    Platform::new("win64", "x86_64-windows", "Windows on x86-64", Format::Pe, 0x8664),
    Platform::new("darwin64", "x86_64-darwin", "macOS on x86-64", Format::MachO, 0x0100_0007),
    Platform::new("aarch64-linux", "aarch64-linux", "Linux on Arm", Format::Elf, 183),
    Platform::new("aarch64-darwin", "aarch64-darwin", "macOS on Apple silicon", Format::MachO, 0x0100_000c),
];

/// The platform of a name.
///
/// # Errors
/// The names of all platforms.
pub fn by_name(name: &str) -> Result<&'static Platform, String> {
    PLATFORMS.iter().find(|platform| platform.name == name).ok_or_else(|| {
        let names: Vec<_> = PLATFORMS.iter().map(|platform| platform.name).collect();
        format!("`{name}` is not a platform: expected one of {}", names.join(", "))
    })
}

/// The platform this program runs on, if FMI 2.0 has a name for it.
pub fn own() -> Option<&'static Platform> {
    use std::env::consts::{ARCH, OS};
    let system = if OS == "macos" { "darwin" } else { OS };
    PLATFORMS.iter().find(|platform| platform.tuple == format!("{ARCH}-{system}"))
}

/// Format of an executable file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Format {
    Elf,
    Pe,
    MachO,
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Format::Elf => "ELF",
            Format::Pe => "PE",
            Format::MachO => "Mach-O",
        })
    }
}

/// Why a file is not a library for a platform.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotFor {
    /// It has none of the formats.
    #[error("not a shared library for {wanted}: it is neither ELF nor PE nor Mach-O with 64 bits")]
    Unknown {
        /// The platform expected.
        wanted: &'static Platform,
    },
    /// It has a known format but is not a shared library.
    #[error("not a shared library for {wanted}: it is {found} code, but not a shared library")]
    NoLibrary {
        /// The platform expected.
        wanted: &'static Platform,
        /// Kind of code found.
        found: String,
    },
    /// It is a library for another platform.
    #[error("not a shared library for {wanted}: it is one for {found}")]
    Other {
        /// The platform expected.
        wanted: &'static Platform,
        /// Platform that it was built for.
        found: String,
    },
}

/// Format and machine of a file, or of one part of a universal file.
struct Part<'a> {
    format: Format,
    machine: u32,
    is_library: bool,
    content: &'a [u8],
}

impl Part<'_> {
    fn platform(&self) -> Option<&'static Platform> {
        PLATFORMS.iter().find(|platform| platform.format == self.format && platform.machine == self.machine)
    }

    fn words(&self) -> String {
        match self.platform() {
            Some(platform) => platform.to_string(),
            None => format!("another machine ({}, {:#x})", self.format, self.machine),
        }
    }
}

fn number<const N: usize>(content: &[u8], at: usize) -> Option<[u8; N]> {
    content.get(at..)?.first_chunk().copied()
}

fn u16_le(content: &[u8], at: usize) -> Option<u16> {
    number(content, at).map(u16::from_le_bytes)
}

fn u32_le(content: &[u8], at: usize) -> Option<u32> {
    number(content, at).map(u32::from_le_bytes)
}

fn u32_be(content: &[u8], at: usize) -> Option<u32> {
    number(content, at).map(u32::from_be_bytes)
}

/// Magic number of a universal file, which holds one Mach-O file for each processor.
const UNIVERSAL: u32 = 0xcafe_babe;
/// Number of bytes of its header, and of the header's entry for each part.
const UNIVERSAL_HEAD: usize = 8;
const UNIVERSAL_ENTRY: usize = 20;
/// Parts begin at multiples of the largest page of these processors, 2¹⁴ bytes.
const UNIVERSAL_ALIGN: u32 = 14;

/// All executable parts of a file; none if the format is unknown.
fn parts(content: &[u8]) -> Vec<Part<'_>> {
    if u32_be(content, 0) == Some(UNIVERSAL) {
        let count = u32_be(content, 4).unwrap_or(0).min(16) as usize;
        let entry = |index| {
            let at = UNIVERSAL_HEAD + UNIVERSAL_ENTRY * index;
            let (offset, size) = (u32_be(content, at + 8)? as usize, u32_be(content, at + 12)? as usize);
            part(content.get(offset..offset.checked_add(size)?)?)
        };
        return (0..count).filter_map(entry).filter(|part| part.format == Format::MachO).collect();
    }
    part(content).into_iter().collect()
}

fn part(content: &[u8]) -> Option<Part<'_>> {
    let part = |format, machine, is_library| Some(Part { format, machine, is_library, content });
    if content.starts_with(b"\x7fELF\x02\x01") {
        const ET_DYN: u16 = 3;
        part(Format::Elf, u16_le(content, 18)?.into(), u16_le(content, 16)? == ET_DYN)
    } else if content.starts_with(b"MZ") {
        const IMAGE_FILE_DLL: u16 = 0x2000;
        let at = u32_le(content, 0x3c)? as usize;
        if number(content, at)? != *b"PE\0\0" {
            return None;
        }
        part(Format::Pe, u16_le(content, at + 4)?.into(), u16_le(content, at + 22)? & IMAGE_FILE_DLL != 0)
    } else if u32_le(content, 0)? == 0xfeed_facf {
        const MH_DYLIB: u32 = 6;
        part(Format::MachO, u32_le(content, 4)?, u32_le(content, 12)? == MH_DYLIB)
    } else {
        None
    }
}

/// Whether a file is for macOS, where its content is signed.
pub(super) fn is_signed(content: &[u8]) -> bool {
    parts(content).iter().any(|part| part.format == Format::MachO)
}

/// Functions that every importer needs.
fn functions(standard: Standard) -> [&'static str; 5] {
    match standard {
        Standard::Fmi2 => {
            ["fmi2GetVersion", "fmi2Instantiate", "fmi2SetupExperiment", "fmi2DoStep", "fmi2FreeInstance"]
        }
        Standard::Fmi3 { .. } => {
            ["fmi3GetVersion", "fmi3InstantiateCoSimulation", "fmi3GetFloat64", "fmi3DoStep", "fmi3FreeInstance"]
        }
    }
}

/// Functions that every importer needs, by the standards that this crate is built with, but that a library does not export; all of
/// them if it cannot be read.
pub fn missing_functions(platform: &Platform, content: &[u8]) -> Vec<&'static str> {
    let functions = Standard::BUILT.iter().flat_map(|standard| functions(*standard));
    use object::Object;
    use object::read::NameOrOrdinal;
    let parts = parts(content);
    let part = parts.iter().find(|part| part.platform() == Some(platform));
    let Some(file) = part.and_then(|part| object::File::parse(part.content).ok()) else {
        return functions.collect();
    };
    // Mach-O prefixes C names with an underscore.
    let prefix: &[u8] = if platform.format == Format::MachO { b"_" } else { b"" };
    let exports: HashSet<Vec<u8>> = file
        .exports()
        .into_iter()
        .flatten()
        .filter_map(|export| {
            let export = export.ok()?;
            let NameOrOrdinal::Name(name) = export.name() else { return None };
            Some(name.strip_prefix(prefix)?.to_vec())
        })
        .collect();
    let is_exported = |name: &str| exports.contains(name.as_bytes());
    functions.filter(|name| !is_exported(name)).collect()
}

/// A universal file from Mach-O files.
fn universal(files: &[&[u8]]) -> Vec<u8> {
    let align = 1 << UNIVERSAL_ALIGN;
    let mut offset = (UNIVERSAL_HEAD + UNIVERSAL_ENTRY * files.len()).next_multiple_of(align);
    let mut head = [UNIVERSAL.to_be_bytes(), (files.len() as u32).to_be_bytes()].concat();
    let mut body = Vec::new();
    for file in files {
        // The file itself contains type and subtype of the processor.
        let [kind, subtype] = [4, 8].map(|at| u32_le(file, at).unwrap_or(0));
        for field in [kind, subtype, offset as u32, file.len() as u32, UNIVERSAL_ALIGN] {
            head.extend(field.to_be_bytes());
        }
        body.push((offset, file));
        offset = (offset + file.len()).next_multiple_of(align);
    }
    for (offset, file) in body {
        head.resize(offset, 0);
        head.extend_from_slice(file);
    }
    head
}

/// Place of a binary in an FMU.
pub struct Place<'a> {
    /// Folder below `binaries`.
    pub folder: &'static str,
    /// File name extension.
    pub ending: &'static str,
    /// The binary.
    pub content: &'a Binary,
}

/// A binary, compressed once for all archives that hold it.
#[derive(Clone, Debug)]
pub struct Binary {
    content: Vec<u8>,
    compressed: OnceLock<Vec<u8>>,
}

impl Binary {
    fn new(content: Vec<u8>) -> Self {
        Self { content, compressed: OnceLock::new() }
    }

    /// An archive with nothing but this binary.
    pub(super) fn compressed(&self) -> Result<&[u8], PackageError> {
        if let Some(compressed) = self.compressed.get() {
            return Ok(compressed);
        }
        let compressed = archive("binary", &[Member::new("binary", self.content.as_slice())])?;
        Ok(self.compressed.get_or_init(|| compressed))
    }
}

impl Deref for Binary {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.content
    }
}

/// The binaries of an archive, at most one per platform.
#[derive(Clone, Debug, Default)]
pub struct Binaries {
    of: Vec<(&'static Platform, Binary)>,
    /// The code for all processors of macOS, if there are several.
    universal: Option<Binary>,
}

impl Binaries {
    /// Whether there is a binary for that platform.
    pub fn serve(&self, platform: &Platform) -> bool {
        self.get(platform).is_some()
    }

    /// The platforms with a binary, in the order of [`PLATFORMS`].
    pub fn platforms(&self) -> impl Iterator<Item = &'static Platform> {
        PLATFORMS.iter().filter(|platform| self.serve(platform))
    }

    fn get(&self, platform: &Platform) -> Option<&Binary> {
        self.of.iter().find(|(of, _)| *of == platform).map(|(_, binary)| binary)
    }

    /// The binaries of a format.
    fn of_format(&self, format: Format) -> impl Iterator<Item = &Binary> {
        let of_format = PLATFORMS.iter().filter(move |platform| platform.format == format);
        of_format.filter_map(|platform| self.get(platform))
    }

    /// Adds a binary, replacing an earlier one. A universal file of macOS serves every processor for which it has code, unless
    /// there is a separate binary.
    ///
    /// # Errors
    /// [`NotFor`] if the file is not a shared library for that platform; nothing is added then.
    pub fn add(&mut self, platform: &'static Platform, content: &[u8]) -> Result<(), NotFor> {
        let parts = parts(content);
        let libraries = || parts.iter().filter(|part| part.is_library);
        if !libraries().any(|part| part.platform() == Some(platform)) {
            let in_words = |parts: &[Part<'_>]| parts.iter().map(Part::words).collect::<Vec<_>>().join(" and ");
            return Err(match libraries().next() {
                _ if parts.is_empty() => NotFor::Unknown { wanted: platform },
                None => NotFor::NoLibrary { wanted: platform, found: in_words(&parts) },
                Some(_) => NotFor::Other { wanted: platform, found: in_words(&parts) },
            });
        }
        for part in libraries() {
            let Some(of) = part.platform() else { continue };
            if of == platform || !self.serve(of) {
                self.of.retain(|(other, _)| *other != of);
                self.of.push((of, Binary::new(part.content.to_vec())));
            }
        }
        let of_macos: Vec<&[u8]> = self.of_format(Format::MachO).map(|binary| &**binary).collect();
        self.universal = (of_macos.len() > 1).then(|| Binary::new(universal(&of_macos)));
        Ok(())
    }

    /// Places of the binaries in an FMU. Besides the folders of the standard, importers on Arm that know only 64-bit names find
    ///
    /// - in `darwin64` a universal file with the code for both processors of macOS;
    /// - in `linux64` the library for Arm, if there is none for x86-64, to which the folder belongs.
    ///
    /// FMI 3.0 has a name for each platform.
    pub fn places(&self, standard: Standard) -> Vec<Place<'_>> {
        let place = |platform: &'static Platform| {
            let (folder, content) = match (standard, platform.name) {
                (Standard::Fmi3 { .. }, _) => (platform.tuple, self.get(platform)),
                (_, name @ "darwin64") => {
                    (name, self.universal.as_ref().or_else(|| self.of_format(Format::MachO).next()))
                }
                (_, name @ "linux64") => (name, self.of_format(Format::Elf).next()),
                (_, name) => (name, self.get(platform)),
            };
            Some(Place { folder, ending: platform.ending, content: content? })
        };
        PLATFORMS.iter().filter_map(place).collect()
    }
}
