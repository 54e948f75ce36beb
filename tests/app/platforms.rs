//! Binaries of several platforms in one archive: what is accepted, where it is placed, and what is refused with which message.
//!
//! Most binaries here are file headers only; real ones are built and run by `scripts/test-platforms`.

use std::fs;
use std::path::Path;
use std::process::Output;

use crate::program::{folder, program};
use crate::support::MODELS;
use fmu_export::Standard;
use fmu_export::package::platforms::{Binaries, PLATFORMS, Platform, by_name};
use magnetic_bearing::package::built_library;

const X86: u16 = 62;
const ARM: u16 = 183;
const MACH_X86: u32 = 0x0100_0007;
const MACH_ARM: u32 = 0x0100_000c;

fn with_u16(mut head: Vec<u8>, at: usize, number: u16) -> Vec<u8> {
    head[at..at + 2].copy_from_slice(&number.to_le_bytes());
    head
}

fn with_u32(mut head: Vec<u8>, at: usize, number: u32) -> Vec<u8> {
    head[at..at + 4].copy_from_slice(&number.to_le_bytes());
    head
}

fn elf(machine: u16) -> Vec<u8> {
    let mut head = vec![0; 64];
    head[..6].copy_from_slice(b"\x7fELF\x02\x01");
    with_u16(with_u16(head, 16, 3), 18, machine)
}

fn pe(machine: u16, characteristics: u16) -> Vec<u8> {
    let mut head = with_u32(vec![0; 0x100], 0x3c, 0x80);
    head[..2].copy_from_slice(b"MZ");
    head[0x80..0x84].copy_from_slice(b"PE\0\0");
    with_u16(with_u16(head, 0x84, machine), 0x96, characteristics)
}

fn dll() -> Vec<u8> {
    pe(0x8664, 0x2022)
}

fn dylib(machine: u32) -> Vec<u8> {
    let head = with_u32(with_u32(vec![machine as u8; 1000], 0, 0xfeed_facf), 4, machine);
    with_u32(with_u32(head, 8, 3), 12, 6)
}

fn platform(name: &str) -> &'static Platform {
    by_name(name).expect("a platform")
}

fn binaries(files: &[(&str, Vec<u8>)]) -> Binaries {
    let mut binaries = Binaries::default();
    for (name, content) in files {
        binaries.add(platform(name), content).expect("a binary");
    }
    binaries
}

fn names(binaries: &Binaries) -> Vec<&'static str> {
    binaries.platforms().map(|platform| platform.name).collect()
}

/// Folders with the binaries in them.
fn places(binaries: &Binaries) -> Vec<(&'static str, Vec<u8>)> {
    binaries.places(Standard::Fmi2).into_iter().map(|place| (place.folder, place.content.into_owned())).collect()
}

fn universal(files: &[Vec<u8>]) -> Vec<u8> {
    let kinds = ["darwin64", "aarch64-darwin"];
    let files: Vec<_> = kinds.into_iter().zip(files.to_vec()).collect();
    let [(folder, content), _] = &places(&binaries(&files))[..] else { panic!("two folders") };
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
    let listed: Vec<_> = PLATFORMS.iter().map(|platform| platform.name).collect();
    assert_eq!(listed, ["linux64", "win64", "darwin64", "aarch64-linux", "aarch64-darwin"]);
    assert_eq!(names(&all), listed);
    let places = places(&all);
    assert_eq!(places.iter().map(|(folder, _)| *folder).collect::<Vec<_>>(), listed);
    assert_eq!(places[0].1, elf(X86));
    assert_eq!(places[1].1, dll());
    assert_eq!(places[3].1, elf(ARM));
    assert_eq!(places[4].1, dylib(MACH_ARM));
    let endings: Vec<_> = all.places(Standard::Fmi2).iter().map(|place| place.ending).collect();
    assert_eq!(endings, ["so", "dll", "dylib", "so", "dylib"]);
    // FMI 3.0 has other names, and each folder holds the library for its platform alone.
    let places: Vec<_> = all.places(Standard::Fmi3 { arrays: false });
    let folders: Vec<_> = places.iter().map(|place| place.folder).collect();
    assert_eq!(folders, ["x86_64-linux", "x86_64-windows", "x86_64-darwin", "aarch64-linux", "aarch64-darwin"]);
    assert!(*places[2].content == *dylib(MACH_X86) && *places[4].content == *dylib(MACH_ARM));
}

#[test]
fn darwin64_holds_the_code_for_both_processors() {
    let made = universal(&[dylib(MACH_X86), dylib(MACH_ARM)]);
    let word = |at: usize| u32::from_be_bytes(made[at..at + 4].try_into().expect("four bytes"));
    assert_eq!([word(0), word(4)], [0xcafe_babe, 2]);
    for (entry, machine) in [(8, MACH_X86), (28, MACH_ARM)] {
        let [kind, subtype, offset, size, align] = [0, 4, 8, 12, 16].map(|at| word(entry + at));
        assert_eq!([kind, subtype, align], [machine, 3, 14]);
        assert_eq!(offset % (1 << align), 0, "macOS maps the parts as pages");
        assert_eq!(made[offset as usize..][..size as usize], dylib(machine));
    }
}

#[test]
fn a_universal_file_serves_every_processor_it_holds() {
    let made = universal(&[dylib(MACH_X86), dylib(MACH_ARM)]);
    for given in ["darwin64", "aarch64-darwin"] {
        let both = binaries(&[(given, made.clone())]);
        assert_eq!(names(&both), ["darwin64", "aarch64-darwin"]);
        assert_eq!(places(&both), [("darwin64", made.clone()), ("aarch64-darwin", dylib(MACH_ARM))]);
    }
}

#[test]
fn arm_binaries_lie_where_importers_look_if_there_is_room() {
    assert_eq!(places(&binaries(&[("aarch64-linux", elf(ARM))])), [("linux64", elf(ARM)), ("aarch64-linux", elf(ARM))]);
    assert_eq!(
        places(&binaries(&[("aarch64-linux", elf(ARM)), ("linux64", elf(X86))])),
        [("linux64", elf(X86)), ("aarch64-linux", elf(ARM))]
    );
    let arm = dylib(MACH_ARM);
    assert_eq!(
        places(&binaries(&[("aarch64-darwin", arm.clone())])),
        [("darwin64", arm.clone()), ("aarch64-darwin", arm)]
    );
    assert_eq!(names(&binaries(&[("aarch64-linux", elf(ARM))])), ["aarch64-linux"]);
}

#[test]
fn files_that_are_not_of_the_platform_are_refused() {
    let program = with_u16(elf(X86), 16, 2);
    let broken_universal = [0xca, 0xfe, 0xba, 0xbe, 0, 0, 0, 1].to_vec();
    let cases = [
        ("linux64", elf(ARM), "it is one for aarch64-linux (Linux on Arm, ELF)"),
        ("aarch64-linux", elf(X86), "it is one for linux64 (Linux on x86-64, ELF)"),
        ("linux64", dll(), "it is one for win64 (Windows on x86-64, PE)"),
        ("win64", elf(X86), "it is one for linux64 (Linux on x86-64, ELF)"),
        ("darwin64", dylib(MACH_ARM), "it is one for aarch64-darwin (macOS on Apple silicon, Mach-O)"),
        ("win64", pe(0xaa64, 0x2022), "it is one for another machine (PE, 0xaa64)"),
        ("win64", pe(0x8664, 0x22), "but not a shared library"),
        ("linux64", program, "but not a shared library"),
        ("darwin64", with_u32(dylib(MACH_X86), 12, 2), "but not a shared library"),
        ("win64", pe(X86, 0x2022), "it is one for another machine (PE, 0x3e)"),
        ("linux64", with_u16(elf(X86), 4, 0x0101), "neither ELF nor PE nor Mach-O with 64 bits"),
        ("linux64", Vec::new(), "neither ELF nor PE nor Mach-O with 64 bits"),
        ("linux64", elf(X86)[..12].to_vec(), "neither ELF nor PE nor Mach-O with 64 bits"),
        ("win64", dll()[..0x82].to_vec(), "neither ELF nor PE nor Mach-O with 64 bits"),
        ("win64", with_u32(dll(), 0x3c, u32::MAX), "neither ELF nor PE nor Mach-O with 64 bits"),
        ("darwin64", broken_universal, "neither ELF nor PE nor Mach-O with 64 bits"),
    ];
    for (name, content, words) in cases {
        let mut binaries = Binaries::default();
        let refused = binaries.add(platform(name), &content).expect_err(words).to_string();
        assert!(refused.contains(words) && refused.contains(&format!("for {name} (")), "{name}: {refused}");
        assert_eq!(names(&binaries), [""; 0], "nothing is added");
    }
}

/// The library that was built with the tests.
fn built() -> Vec<u8> {
    fs::read(built_library().expect("the library is built with the tests")).expect("a library")
}

fn package(folder: &Path, arguments: &[String]) -> Output {
    program(folder, &["package", "--out", "out"]).args(arguments).output().expect("the program runs")
}

fn members(archive: &Path) -> Vec<String> {
    let archive = zip::ZipArchive::new(fs::File::open(archive).expect("an archive")).expect("a sound archive");
    let names = archive.file_names().map(|name| name.expect("a name").into_owned());
    let mut names: Vec<_> = names.filter(|name| name.starts_with("binaries/")).collect();
    names.sort();
    names
}

#[test]
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
fn the_command_adds_platforms_and_says_so() {
    let folder = folder("platforms/adds");
    // A Linux library with the machine number of another processor.
    let path = folder.join("some name.so");
    fs::write(&path, with_u16(built(), 18, ARM)).expect("a file");
    let output = package(&folder, &["--binary".into(), format!("aarch64-linux={}", path.display())]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let said = String::from_utf8(output.stdout).expect("text");
    let archives = MODELS[..6].iter().map(|model| format!("{model}.fmu"));
    for archive in archives.chain(["MagneticBearing.ssp".to_owned()]) {
        let line = said.lines().find(|line| line.contains(archive.as_str())).unwrap_or_default();
        assert!(line.ends_with("for linux64, aarch64-linux"), "{archive}: {said}");
    }
    let fmu = members(&folder.join("out/MagneticBearing.fmu"));
    assert_eq!(fmu, ["binaries/aarch64-linux/MagneticBearing.so", "binaries/linux64/MagneticBearing.so"]);
}

#[test]
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
fn a_binary_for_the_own_platform_takes_the_place_of_the_built_one() {
    use std::io::Read;

    let folder = folder("platforms/own");
    let path = folder.join("lib.so");
    let other = [built(), b"another".to_vec()].concat();
    fs::write(&path, &other).expect("a file");
    let output = package(&folder, &["--binary".into(), format!("linux64={}", path.display())]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let file = fs::File::open(folder.join("out/MagneticBearing.fmu")).expect("an archive");
    let mut archive = zip::ZipArchive::new(file).expect("a sound archive");
    let mut content = Vec::new();
    let mut member = archive.by_name("binaries/linux64/MagneticBearing.so").expect("the binary");
    member.read_to_end(&mut content).expect("its content");
    assert!(content == other, "it is the file that was given");
}

#[test]
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
fn the_command_refuses_what_makes_no_sense() {
    let folder = folder("platforms/refuses");
    let path = folder.join("lib.so");
    fs::write(&path, elf(X86)).expect("a file");
    let path = path.display();
    let library = folder.join("library.so");
    fs::write(&library, built()).expect("a file");
    let library = library.display();
    // Position-independent programs are shared objects as well.
    let program = env!("CARGO_BIN_EXE_magnetic-bearing");
    let missing = folder.join("missing.dll");
    let missing = missing.display();
    let cases = [
        (
            vec![format!("linux32={path}")],
            2,
            vec!["`linux32` is not a platform", "linux64, win64, darwin64, aarch64-linux"],
        ),
        (vec![format!("{path}")], 2, vec!["expected PLATFORM=FILE"]),
        (vec![format!("win64={missing}")], 1, vec!["missing.dll", "No such file"]),
        (vec![format!("win64={path}")], 1, vec!["lib.so is not a shared library for win64", "one for linux64"]),
        (vec![format!("linux64={library}"); 2], 1, vec!["two binaries are given for the platform linux64"]),
        (vec![format!("linux64={path}")], 1, vec!["lib.so is not the library of an FMU", "fmi2Instantiate"]),
        (
            vec![format!("linux64={program}")],
            1,
            vec!["is not the library of an FMU: it does not export fmi2GetVersion"],
        ),
        (vec![format!("aarch64-linux={library}")], 1, vec!["it is one for linux64"]),
    ];
    for (given, code, words) in cases {
        let arguments: Vec<_> = given.iter().flat_map(|binary| ["--binary".to_owned(), binary.clone()]).collect();
        let output = package(&folder, &arguments);
        let said = String::from_utf8(output.stderr).expect("text");
        assert_eq!(output.status.code(), Some(code), "{given:?}: {said}");
        for word in words {
            assert!(said.contains(word), "{given:?}: {said}");
        }
        assert!(!folder.join("out").exists(), "{given:?}: nothing is written");
    }
}
