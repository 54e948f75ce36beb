//! Binaries of several platforms in one archive: acceptance, placement, refusals.
//!
//! Most binaries here are only file headers; `scripts/test-platforms` builds and runs real ones.

use crate::package::members;
use crate::prelude::*;
use fmu_export::Standard;
use fmu_export::package::platforms::{Binaries, PLATFORMS, by_name};
use magnetic_bearing::package::built_library;

const X86: u16 = 62;
const ARM: u16 = 183;
const MACH_X86: u32 = 0x0100_0007;
const MACH_ARM: u32 = 0x0100_000c;

/// A file with these bytes from an offset on.
fn with<const N: usize>(mut file: Vec<u8>, at: usize, bytes: [u8; N]) -> Vec<u8> {
    file[at..at + N].copy_from_slice(&bytes);
    file
}

/// An ELF file of a machine and a type; 3 is a shared library.
fn elf_of(machine: u16, kind: u16) -> Vec<u8> {
    with(with(with(vec![0; 64], 0, *b"\x7fELF\x02\x01"), 16, kind.to_le_bytes()), 18, machine.to_le_bytes())
}

fn elf(machine: u16) -> Vec<u8> {
    elf_of(machine, 3)
}

fn pe(machine: u16, characteristics: u16) -> Vec<u8> {
    let head = with(with(vec![0; 0x100], 0, *b"MZ"), 0x3c, 0x80_u32.to_le_bytes());
    let head = with(with(head, 0x80, *b"PE\0\0"), 0x84, machine.to_le_bytes());
    with(head, 0x96, characteristics.to_le_bytes())
}

fn dll() -> Vec<u8> {
    pe(0x8664, 0x2022)
}

fn dylib(machine: u32) -> Vec<u8> {
    let words = [0xfeed_facf, machine, 3, 6].map(u32::to_le_bytes);
    [words.concat(), vec![machine as u8; 984]].concat()
}

fn binaries(files: &[(&str, Vec<u8>)]) -> Binaries {
    let mut binaries = Binaries::default();
    for (name, content) in files {
        binaries.add(by_name(name).expect("a platform"), content).expect("a binary");
    }
    binaries
}

fn names(binaries: &Binaries) -> Vec<&'static str> {
    binaries.platforms().map(|platform| platform.name).collect()
}

/// Folders and the binaries in them.
fn places(binaries: &Binaries) -> Vec<(&'static str, Vec<u8>)> {
    binaries.places(Standard::Fmi2).into_iter().map(|place| (place.folder, place.content.to_vec())).collect()
}

/// One file with the code for both processors.
fn universal() -> Vec<u8> {
    let both = binaries(&[("darwin64", dylib(MACH_X86)), ("aarch64-darwin", dylib(MACH_ARM))]);
    let [(folder, content), _] = &places(&both)[..] else { panic!("two folders") };
    assert_eq!(*folder, "darwin64");
    content.clone()
}

#[test]
fn every_platform_has_its_folder() {
    let all = binaries(&[
        ("aarch64-darwin", dylib(MACH_ARM)),
        ("aarch64-linux", elf(ARM)),
        ("darwin64", dylib(MACH_X86)),
        ("win64", dll()),
        ("linux64", elf(X86)),
    ]);
    let listed = ["linux64", "win64", "darwin64", "aarch64-linux", "aarch64-darwin"];
    assert!(PLATFORMS.iter().map(|platform| platform.name).eq(listed), "{listed:?}");
    assert_eq!(names(&all), listed);
    let contents = [elf(X86), dll(), universal(), elf(ARM), dylib(MACH_ARM)];
    assert_eq!(places(&all), listed.into_iter().zip(contents).collect::<Vec<_>>());
    let endings: Vec<_> = all.places(Standard::Fmi2).iter().map(|place| place.ending).collect();
    assert_eq!(endings, ["so", "dll", "dylib", "so", "dylib"]);
    // FMI 3.0 has other names, and each folder contains the library for its platform only.
    let places: Vec<_> = all.places(Standard::Fmi3 { arrays: false });
    let folders: Vec<_> = places.iter().map(|place| place.folder).collect();
    assert_eq!(folders, ["x86_64-linux", "x86_64-windows", "x86_64-darwin", "aarch64-linux", "aarch64-darwin"]);
    assert!(**places[2].content == *dylib(MACH_X86) && **places[4].content == *dylib(MACH_ARM));
}

#[test]
fn darwin64_contains_the_code_for_both_processors() {
    let made = universal();
    let word = |at: usize| u32::from_be_bytes(made[at..at + 4].try_into().expect("four bytes"));
    assert_eq!([word(0), word(4)], [0xcafe_babe, 2]);
    for (entry, machine) in [(8, MACH_X86), (28, MACH_ARM)] {
        let [kind, subtype, offset, size, align] = [0, 4, 8, 12, 16].map(|at| word(entry + at));
        assert_eq!([kind, subtype, align], [machine, 3, 14]);
        assert_eq!(offset % (1 << align), 0, "macOS maps the parts as pages");
        assert_eq!(made[offset as usize..][..size as usize], dylib(machine));
    }
    // It serves each processor that it has code for.
    for given in ["darwin64", "aarch64-darwin"] {
        let both = binaries(&[(given, made.clone())]);
        assert_eq!(names(&both), ["darwin64", "aarch64-darwin"]);
        assert_eq!(places(&both), [("darwin64", made.clone()), ("aarch64-darwin", dylib(MACH_ARM))]);
    }
}

#[test]
fn arm_binaries_are_also_where_importers_look_if_that_is_free() {
    for (given, wanted) in [
        (&[("aarch64-linux", elf(ARM))][..], [("linux64", elf(ARM)), ("aarch64-linux", elf(ARM))]),
        (&[("aarch64-linux", elf(ARM)), ("linux64", elf(X86))], [("linux64", elf(X86)), ("aarch64-linux", elf(ARM))]),
        (&[("aarch64-darwin", dylib(MACH_ARM))], [("darwin64", dylib(MACH_ARM)), ("aarch64-darwin", dylib(MACH_ARM))]),
    ] {
        let binaries = binaries(given);
        assert_eq!(places(&binaries), wanted);
        assert_eq!(names(&binaries).len(), given.len());
    }
}

#[test]
fn files_for_other_platforms_are_refused() {
    let broken_universal = [0xca, 0xfe, 0xba, 0xbe, 0, 0, 0, 1].to_vec();
    let kind_of_dylib = with(dylib(MACH_X86), 12, 2_u32.to_le_bytes());
    let far = with(dll(), 0x3c, u32::MAX.to_le_bytes());
    let cases = [
        ("linux64", elf(ARM), "it is one for aarch64-linux (Linux on Arm, ELF)"),
        ("aarch64-linux", elf(X86), "it is one for linux64 (Linux on x86-64, ELF)"),
        ("linux64", dll(), "it is one for win64 (Windows on x86-64, PE)"),
        ("win64", elf(X86), "it is one for linux64 (Linux on x86-64, ELF)"),
        ("darwin64", dylib(MACH_ARM), "it is one for aarch64-darwin (macOS on Apple silicon, Mach-O)"),
        ("win64", pe(0xaa64, 0x2022), "it is one for another machine (PE, 0xaa64)"),
        ("win64", pe(0x8664, 0x22), "but not a shared library"),
        ("linux64", elf_of(X86, 2), "but not a shared library"),
        ("darwin64", kind_of_dylib, "but not a shared library"),
        ("win64", pe(X86, 0x2022), "it is one for another machine (PE, 0x3e)"),
        ("linux64", with(elf(X86), 4, [1, 1]), "neither ELF nor PE nor Mach-O with 64 bits"),
        ("linux64", Vec::new(), "neither ELF nor PE nor Mach-O with 64 bits"),
        ("linux64", elf(X86)[..12].to_vec(), "neither ELF nor PE nor Mach-O with 64 bits"),
        ("win64", dll()[..0x82].to_vec(), "neither ELF nor PE nor Mach-O with 64 bits"),
        ("win64", far, "neither ELF nor PE nor Mach-O with 64 bits"),
        ("darwin64", broken_universal, "neither ELF nor PE nor Mach-O with 64 bits"),
    ];
    for (name, content, words) in cases {
        let mut binaries = Binaries::default();
        let refused = binaries.add(by_name(name).expect("a platform"), &content).expect_err(words).to_string();
        assert!(refused.contains(words) && refused.contains(&format!("for {name} (")), "{name}: {refused}");
        assert_eq!(names(&binaries), [""; 0], "nothing is added");
    }
}

/// The library that was built with the tests.
fn built() -> Vec<u8> {
    fs::read(built_library().expect("the library is built with the tests")).expect("a library")
}

/// Runs `package` with these binaries.
fn package(folder: &Path, binaries: &[&str]) -> (i32, String, String) {
    let options = binaries.iter().flat_map(|binary| ["--binary", binary]);
    run(folder, &["package", "--out", "out"].into_iter().chain(options).collect::<Vec<_>>())
}

/// The libraries in a packaged FMU.
fn libraries(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let members = members(&fs::read(folder.join("out/MagneticBearing.fmu")).expect("an archive"));
    members.into_iter().filter(|(name, _)| name.starts_with("binaries/")).collect()
}

#[test]
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
fn the_command_adds_and_lists_platforms() {
    let folder = folder("platforms/adds");
    // A Linux library with the machine number of another processor.
    write(&folder, "some name.so", with(built(), 18, ARM.to_le_bytes()));
    let (code, out, errors) = package(&folder, &["aarch64-linux=some name.so"]);
    assert_eq!(code, 0, "{errors}");
    let archives = MODELS[..6].iter().map(|model| format!("{model}.fmu"));
    for archive in archives.chain(["MagneticBearing.ssp".to_owned()]) {
        let line = out.lines().find(|line| line.contains(archive.as_str())).unwrap_or_default();
        assert!(line.ends_with("for linux64, aarch64-linux"), "{archive}: {out}");
    }
    let libraries = libraries(&folder);
    let names: Vec<&str> = libraries.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["binaries/aarch64-linux/MagneticBearing.so", "binaries/linux64/MagneticBearing.so"]);

    // A binary for this platform replaces the built one.
    let other = [built(), b"another".to_vec()].concat();
    write(&folder, "lib.so", &other);
    let (code, _, errors) = package(&folder, &["linux64=lib.so"]);
    assert_eq!(code, 0, "{errors}");
    let wanted = ("binaries/linux64/MagneticBearing.so".to_owned(), other);
    assert!(self::libraries(&folder) == [wanted], "it is the file that was given");
}

#[test]
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
fn the_command_refuses_invalid_binaries() {
    let folder = folder("platforms/refuses");
    write(&folder, "lib.so", elf(X86));
    write(&folder, "library.so", built());
    // Position-independent programs are shared objects as well.
    let program = format!("linux64={}", env!("CARGO_BIN_EXE_magnetic-bearing"));
    for (given, code, words) in [
        (&["linux32=lib.so"][..], 2, &["`linux32` is not a platform", "linux64, win64, darwin64, aarch64-linux"][..]),
        (&["lib.so"], 2, &["expected PLATFORM=FILE"]),
        (&["win64=missing.dll"], 1, &["missing.dll", "No such file"]),
        (&["win64=lib.so"], 1, &["lib.so is not a shared library for win64", "one for linux64"]),
        (&["linux64=library.so"; 2], 1, &["two binaries are given for the platform linux64"]),
        (&["linux64=lib.so"], 1, &["lib.so is not the library of an FMU", "fmi2Instantiate"]),
        (&[&program], 1, &["is not the library of an FMU: it does not export fmi2GetVersion"]),
        (&["aarch64-linux=library.so"], 1, &["it is one for linux64"]),
    ] {
        let (found, _, errors) = package(&folder, given);
        assert_eq!(found, code, "{given:?}: {errors}");
        assert_contains(&errors, words);
        assert!(!folder.join("out").exists(), "{given:?}: nothing is written");
    }
}
