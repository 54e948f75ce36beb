//! The layers: what each may use, and what it may not do.
//!
//! All rules are in one table. They apply to code only, not to comments and strings.

use std::fs;
use std::path::{Path, PathBuf};

/// Names that a folder must not contain, and why.
struct Rule {
    /// Folder of the project.
    folder: &'static str,
    /// Words that must not occur there.
    words: &'static [&'static str],
    /// Exempt files and folders, each with a reason beside it.
    except: &'static [&'static str],
    /// Why.
    reason: &'static str,
}

/// Elementary functions whose last bits differ from platform to platform. Square roots are exact by IEEE 754 and allowed.
const ELEMENTARY: &[&str] = &[
    "acos", "acosh", "asin", "asinh", "atan", "atan2", "atanh", "cbrt", "cos", "cosh", "exp", "exp2", "exp_m1",
    "hypot", "ln", "ln_1p", "log", "log10", "log2", "mul_add", "powf", "powi", "sin", "sin_cos", "sinh", "tan", "tanh",
];

const PRINTING: &[&str] = &["println!", "eprintln!", "print!", "eprint!", "dbg!"];
const SYSTEM: &[&str] = &["std::fs", "std::env", "std::net", "std::process", "std::thread", "std::time", "File::"];

const fn rule(
    folder: &'static str,
    words: &'static [&'static str],
    except: &'static [&'static str],
    reason: &'static str,
) -> Rule {
    Rule { folder, words, except, reason }
}

const RULES: &[Rule] = &[
    rule(
        "src/bearing",
        &["crate::plant", "crate::control", "crate::estimation"],
        &[],
        "the bearing comes before what is built on it",
    ),
    rule(
        "src/plant",
        &["crate::control", "crate::estimation"],
        &[],
        "the plant knows neither controller nor estimator",
    ),
    rule(
        "src/variables.rs",
        &["crate::", "Row", "Table", "Model", "Instance", "fmi"],
        &[],
        "equations take the description of their variables from here, and nothing of FMI besides",
    ),
    rule("src/fmu", PROGRAM, &[], "the FMUs know nothing of the program"),
    rule("src/fmu", &["fmu_export::package"], &[], "the library of the FMUs needs no packager"),
    rule(
        "src/simulation",
        &["crate::studies", "crate::report", "crate::cli"],
        &[],
        "a simulation knows neither studies nor reports",
    ),
    rule("src/studies", &["crate::report", "crate::cli"], &[], "studies know nothing of reports"),
    rule("src/report", &["crate::cli"], &[], "reports know nothing of commands"),
    rule(
        "fmu-export",
        &["magnetic_bearing"],
        &["fmu-export/tests"],
        "the crate exports any model and knows nothing of this one",
    ),
    rule("src/fmu", PRINTING, &[], "models write messages to their log"),
    // The packager says what it has written.
    rule("fmu-export/src", PRINTING, &["fmu-export/src/package"], "FMUs send messages to the importer's logger"),
    rule("src/fmu", SYSTEM, &[], "models depend on their values alone"),
    // The packager runs in a program, not in an FMU. Resources are files that the importer names.
    rule(
        "fmu-export/src",
        SYSTEM,
        &["fmu-export/src/package", "fmu-export/src/resources.rs"],
        "FMUs touch nothing but what the importer hands them",
    ),
    rule("src", &["unsafe"], &[], UNSAFE),
    rule("fmu-export/src", &["unsafe"], UNSAFE_FILES, UNSAFE),
    rule("src", &["#[test]"], &[], "Cargo.toml switches tests within src off: they would not run"),
    rule("fmu-export/src", &["#[test]"], &[], "tests belong in tests/, for the crate as well"),
];

/// The layers of the program.
const PROGRAM: &[&str] =
    &["crate::simulation", "crate::studies", "crate::report", "crate::cli", "crate::package", "crate::output"];

/// Names besides that only the equations must not use.
const FMUS: &[&str] = &["crate::fmu", "fmu_export"];

/// The folders of the equations.
const EQUATIONS: [&str; 6] =
    ["src/bearing", "src/plant", "src/control", "src/estimation", "src/invalid.rs", "src/machine.rs"];

/// The last two hold the hook that is called at unloading, and the functions that a library exports.
const UNSAFE_FILES: &[&str] = &[
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

/// Whether the line contains the word, not as a part of a longer one.
fn holds(line: &str, word: &str) -> bool {
    let part = |letter: Option<char>| letter.is_some_and(|letter| letter.is_alphanumeric() || letter == '_');
    line.match_indices(word).any(|(at, _)| {
        let before = line[..at].chars().next_back();
        let after = line[at + word.len()..].chars().next();
        let open_ended = word.ends_with(|last: char| !last.is_alphanumeric());
        !part(before) && (open_ended || !part(after))
    })
}

/// The lines of code in a folder: their place, and they without comments and strings.
fn lines(folder: &str) -> Vec<(PathBuf, usize, String)> {
    let files = files(&project().join(folder));
    assert!(!files.is_empty(), "{folder} is there");
    let of = |file: &PathBuf| {
        let text = fs::read_to_string(file).expect("a source file");
        code(&text).map(|(number, line)| (file.clone(), number, line)).collect::<Vec<_>>()
    };
    files.iter().flat_map(of).collect()
}

fn breaches(rule: &Rule) -> Vec<String> {
    let mut found = Vec::new();
    for (file, number, line) in lines(rule.folder) {
        if rule.except.iter().any(|path| file.starts_with(project().join(path))) {
            continue;
        }
        for word in rule.words.iter().filter(|word| holds(&line, word)) {
            let path = file.strip_prefix(project()).expect("a file of the project").display();
            found.push(format!("{path}:{number}: `{word}`: {}", rule.reason));
        }
    }
    found
}

#[test]
fn every_layer_keeps_to_its_rules() {
    let equations = EQUATIONS.iter().flat_map(|folder| {
        [
            rule(folder, PROGRAM, &[], "the equations know nothing of the program"),
            rule(folder, FMUS, &[], "the equations know nothing of FMUs"),
            rule(folder, PRINTING, &[], "equations do not print"),
            rule(folder, SYSTEM, &[], "equations depend on their arguments alone"),
        ]
    });
    let found: Vec<String> = equations.collect::<Vec<_>>().iter().chain(RULES).flat_map(breaches).collect();
    assert!(found.is_empty(), "\n{}", found.join("\n"));
}

#[test]
fn a_path_up_and_over_is_found_as_well() {
    // `super::super::x` would reach another layer without naming the crate.
    let layers = EQUATIONS.into_iter().chain(["src/fmu", "fmu-export/src"]);
    for (file, number, line) in layers.flat_map(lines) {
        assert!(!line.contains("super::super"), "{}:{number}: name the crate instead", file.display());
    }
}

/// Elementary functions come from the crate libm, so that every platform gives the same bits.
#[test]
fn equations_take_elementary_functions_from_libm() {
    for (file, number, line) in EQUATIONS.into_iter().flat_map(lines) {
        for name in ELEMENTARY {
            let is_used = line.contains(&format!(".{name}(")) || line.contains(&format!("f64::{name}"));
            assert!(!is_used, "{}:{number}: use libm for {name}", file.display());
        }
    }
}

/// Every unsafe block, and every unsafe implementation, has a sentence that says why it is sound.
#[test]
fn unsafe_blocks_say_why() {
    let mut blocks = 0;
    for folder in ["fmu-export/src", "fmu-export/tests", "tests"].map(|folder| project().join(folder)) {
        for file in files(&folder) {
            // The bindings are types alone, and this file speaks of blocks without having one.
            if file.ends_with("bindings.rs") || file.ends_with("layers.rs") {
                continue;
            }
            let text = fs::read_to_string(&file).expect("a source file");
            let lines: Vec<&str> = text.lines().collect();
            for (number, line) in code(&text) {
                if !line.contains("unsafe {") && !line.contains("unsafe impl") {
                    continue;
                }
                blocks += 1;
                // The sentence is above the statement, which may begin some lines before the block.
                let above = &lines[number.saturating_sub(8)..number];
                let said = above.iter().any(|line| line.trim_start().starts_with("// SAFETY: "));
                assert!(said, "{}:{number}: an unsafe block without a SAFETY sentence", file.display());
            }
        }
    }
    assert!(blocks > 40, "only {blocks} unsafe blocks were found: does this test still see them?");
}

/// The rules can fail.
#[test]
fn the_search_finds_what_it_looks_for() {
    let lines = |text: &str| code(text).map(|(_, line)| line).collect::<Vec<_>>().join("\n");
    assert!(holds(&lines("use crate::cli::main;"), "crate::cli"));
    assert!(holds(&lines("    println!(\"here\");"), "println!"));
    assert!(!holds(&lines("    eprintln!(\"here\");"), "println!"));
    assert!(!holds(&lines("// use crate::cli;"), "crate::cli"));
    assert!(!holds(&lines("let text = \"crate::cli\";"), "crate::cli"));
    assert!(!holds(&lines("let unsafely = 1;"), "unsafe"));
    assert!(holds(&lines("let text = \"//\"; unsafe { f() }"), "unsafe"));
}
