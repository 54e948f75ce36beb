//! The layers: forbidden dependencies and calls of each. The rules apply to code only, not to comments and strings.

use crate::prelude::*;

/// Words, or files and folders.
type Words = &'static [&'static str];

/// Elementary functions whose last bits depend on the platform. Square roots are exact by IEEE 754 and allowed.
const ELEMENTARY: &[&str] = &[
    "acos", "acosh", "asin", "asinh", "atan", "atan2", "atanh", "cbrt", "cos", "cosh", "exp", "exp2", "exp_m1",
    "hypot", "ln", "ln_1p", "log", "log10", "log2", "mul_add", "powf", "powi", "sin", "sin_cos", "sinh", "tan", "tanh",
];

const PRINTING: Words = &["println!", "eprintln!", "print!", "eprint!", "dbg!"];
const SYSTEM: Words = &["std::fs", "std::env", "std::net", "std::process", "std::thread", "std::time", "File::"];

/// Folders, words forbidden there, and the reasons.
const RULES: &[(Words, Words, &str)] = &[
    (EQUATIONS, PROGRAM, "the equations know nothing of the program"),
    (EQUATIONS, &["crate::fmu", "fmu_export"], "the equations know nothing of FMUs"),
    (EQUATIONS, PRINTING, "equations do not print"),
    (EQUATIONS, SYSTEM, "equations depend on their arguments alone"),
    (&["src/bearing"], &["crate::plant", "crate::control", "crate::estimation"], "the bearing comes before its users"),
    (&["src/plant"], &["crate::control", "crate::estimation"], "the plant knows neither controller nor estimator"),
    // Equations use it to describe their variables.
    (&["src/variables.rs"], &["crate::", "Row", "Table", "Model", "Instance", "fmi"], "variables know nothing of FMI"),
    // This reaches another layer without naming the crate.
    (EQUATIONS, &["super::super"], "name the crate instead"),
    (&["src/fmu", "fmu-export/src"], &["super::super"], "name the crate instead"),
    (&["src/fmu"], PROGRAM, "the FMUs know nothing of the program"),
    (&["src/fmu"], &["fmu_export::package"], "the library of the FMUs needs no packager"),
    (&["src/simulation"], &["crate::studies", "crate::report", "crate::cli"], "simulation knows no studies or reports"),
    (&["src/studies"], &["crate::report", "crate::cli"], "studies know nothing of reports"),
    (&["src/report"], &["crate::cli"], "reports know nothing of commands"),
    (&["src/fmu"], PRINTING, "models write messages to their log"),
    (&["src/fmu"], SYSTEM, "models depend on their values alone"),
    (&["src"], &["unsafe"], UNSAFE),
    (&["src"], &["#[test]"], "Cargo.toml switches tests within src off: they would not run"),
    (&["fmu-export/src"], &["#[test]"], "tests belong in tests/, for the crate as well"),
    (&["fmu-export"], &["magnetic_bearing"], "the crate exports any model"),
    (&["fmu-export/src"], PRINTING, "FMUs send messages to the importer's logger"),
    (&["fmu-export/src"], SYSTEM, "FMUs touch nothing but what the importer hands them"),
    (&["fmu-export/src"], &["unsafe"], UNSAFE),
];

/// Files and folders that may contain one of these words.
const EXEMPT: &[(Words, Words)] = &[
    (&["fmu-export/tests"], &["magnetic_bearing"]),
    // The packager runs in a program, not in an FMU, and prints what it has written. Resources are files that the importer names.
    (&["fmu-export/src/package"], PRINTING),
    (OF_IMPORTERS, SYSTEM),
    (UNSAFE_FILES, &["unsafe"]),
];

const OF_IMPORTERS: Words = &["fmu-export/src/package", "fmu-export/src/resources.rs"];

/// The layers of the program.
const PROGRAM: Words =
    &["crate::simulation", "crate::studies", "crate::report", "crate::cli", "crate::package", "crate::output"];

/// The folders of the equations.
const EQUATIONS: Words =
    &["src/bearing", "src/plant", "src/control", "src/estimation", "src/invalid.rs", "src/machine.rs"];

/// The last two hold the hook called at unloading and the functions that a library exports.
const UNSAFE_FILES: Words = &[
    "fmu-export/src/interface",
    "fmu-export/src/fmi2",
    "fmu-export/src/fmi3",
    "fmu-export/src/fmus.rs",
    "fmu-export/src/export.rs",
];

const UNSAFE: &str = "unsafe code belongs in the C interface: interface, fmi2 and fmi3 of fmu-export/src";

fn project() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).into()
}

/// All Rust files below a folder, or the file itself.
fn files(path: &Path) -> Vec<PathBuf> {
    if path.is_file() {
        return vec![path.to_owned()];
    }
    let entries = fs::read_dir(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut found: Vec<_> = entries.flat_map(|entry| files(&entry.expect("an entry of the folder").path())).collect();
    found.retain(|file| file.extension().is_some_and(|ending| ending == "rs"));
    found.sort();
    found
}

/// The lines without comments and string literals, numbered from 1.
fn code(text: &str) -> impl Iterator<Item = (usize, String)> {
    text.lines().enumerate().map(|(number, line)| {
        let mut bare = String::new();
        let mut quoted = false;
        let mut former = ' ';
        for (at, letter) in line.char_indices() {
            if letter == '"' && former != '\\' && former != '\'' {
                quoted = !quoted;
            } else if !quoted && line[at..].starts_with("//") {
                break;
            } else if !quoted {
                bare.push(letter);
            }
            former = letter;
        }
        (number + 1, bare)
    })
}

/// Whether the line contains the word, not as part of a longer one.
fn holds(line: &str, word: &str) -> bool {
    let is_letter = |letter: Option<char>| letter.is_some_and(|letter| letter.is_alphanumeric() || letter == '_');
    line.match_indices(word).any(|(at, _)| {
        let before = line[..at].chars().next_back();
        let after = line[at + word.len()..].chars().next();
        let open_ended = word.ends_with(|last: char| !last.is_alphanumeric());
        !is_letter(before) && (open_ended || !is_letter(after))
    })
}

/// The lines of code in a folder: file, line number, and text without comments and strings.
fn lines(folder: &str) -> Vec<(PathBuf, usize, String)> {
    let files = files(&project().join(folder));
    assert!(!files.is_empty(), "{folder} is there");
    let of = |file: &PathBuf| {
        let text = fs::read_to_string(file).expect("a source file");
        code(&text).map(|(number, line)| (file.clone(), number, line)).collect::<Vec<_>>()
    };
    files.iter().flat_map(of).collect()
}

#[test]
fn every_layer_keeps_to_its_rules() {
    let is_exempt = |file: &Path, word: &str| {
        let mut of_word = EXEMPT.iter().filter(|(_, words)| words.contains(&word));
        of_word.any(|(paths, _)| paths.iter().any(|path| file.starts_with(path)))
    };
    let mut found = Vec::new();
    for (folders, words, reason) in RULES {
        for (file, number, line) in folders.iter().flat_map(|folder| lines(folder)) {
            let file = file.strip_prefix(project()).expect("a file of the project");
            for word in words.iter().filter(|word| holds(&line, word) && !is_exempt(file, word)) {
                found.push(format!("{}:{number}: `{word}`: {reason}", file.display()));
            }
        }
    }
    assert!(found.is_empty(), "\n{}", found.join("\n"));
}

/// Elementary functions come from the crate libm, so that all platforms give the same bits.
#[test]
fn equations_take_elementary_functions_from_libm() {
    for (file, number, line) in EQUATIONS.iter().flat_map(|folder| lines(folder)) {
        for name in ELEMENTARY {
            let is_used = line.contains(&format!(".{name}(")) || line.contains(&format!("f64::{name}"));
            assert!(!is_used, "{}:{number}: use libm for {name}", file.display());
        }
    }
}

/// Every unsafe block and implementation has a comment that states why it is sound.
#[test]
fn unsafe_blocks_say_why() {
    let mut blocks = 0;
    let mut files =
        ["fmu-export/src", "fmu-export/tests", "tests"].map(|folder| files(&project().join(folder))).concat();
    // The bindings are types only, and this file mentions blocks without having one.
    files.retain(|file| !file.ends_with("bindings.rs") && !file.ends_with("layers.rs"));
    for file in files {
        let text = fs::read_to_string(&file).expect("a source file");
        let lines: Vec<&str> = text.lines().collect();
        for (number, _) in code(&text).filter(|(_, line)| line.contains("unsafe {") || line.contains("unsafe impl")) {
            blocks += 1;
            // The comment is above the statement, which may begin some lines before the block.
            let above = &lines[number.saturating_sub(8)..number];
            let is_explained = above.iter().any(|line| line.trim_start().starts_with("// SAFETY: "));
            assert!(is_explained, "{}:{number}: an unsafe block without a SAFETY sentence", file.display());
        }
    }
    assert!(blocks > 40, "only {blocks} unsafe blocks were found: does this test still see them?");
}

/// The search for words can fail.
#[test]
fn words_are_found_in_code_only() {
    for (text, word, is_found) in [
        ("use crate::cli::main;", "crate::cli", true),
        ("    println!(\"here\");", "println!", true),
        ("    eprintln!(\"here\");", "println!", false),
        ("// use crate::cli;", "crate::cli", false),
        ("let text = \"crate::cli\";", "crate::cli", false),
        ("let unsafely = 1;", "unsafe", false),
        ("let text = \"//\"; unsafe { f() }", "unsafe", true),
        ("use super::super::control;", "super::super", true),
    ] {
        assert_eq!(code(text).any(|(_, line)| holds(&line, word)), is_found, "{word} in {text}");
    }
}
