//! The layers keep to themselves: what each may name, and what it may not do.
//!
//! All rules stand in one table. They look at the code alone: comments and texts may name what they like.

use std::fs;
use std::path::{Path, PathBuf};

/// What a folder must not hold, and why.
struct Rule {
    /// Folder below `src`, or a file.
    folder: &'static str,
    /// Words that do not stand there.
    words: &'static [&'static str],
    /// Files below the folder that are exempt, each for the reason that stands beside it.
    except: &'static [&'static str],
    /// Why.
    reason: &'static str,
}

/// Elementary functions whose last bits differ from platform to platform. Roots are exact by IEEE 754 and may be taken.
const ELEMENTARY: &[&str] = &[
    "acos", "acosh", "asin", "asinh", "atan", "atan2", "atanh", "cbrt", "cos", "cosh", "exp", "exp2", "exp_m1",
    "hypot", "ln", "ln_1p", "log", "log10", "log2", "mul_add", "powf", "powi", "sin", "sin_cos", "sinh", "tan", "tanh",
];

const PRINTING: &[&str] = &["println!", "eprintln!", "print!", "eprint!", "dbg!"];
const SYSTEM: &[&str] = &["std::fs", "std::env", "std::net", "std::process", "std::thread", "std::time", "File::"];

const RULES: &[Rule] = &[
    Rule {
        folder: "model",
        words: &["crate::slave", "crate::fmi2", "crate::app"],
        except: &[],
        reason: "the equations know nothing of slaves, the standard or the program",
    },
    Rule {
        folder: "slave",
        words: &["crate::fmi2", "crate::app"],
        except: &[],
        reason: "slaves know nothing of the standard or the program",
    },
    Rule {
        folder: "fmi2",
        words: &["crate::app", "crate::model"],
        except: &[],
        reason: "the standard's layer works on slaves alone",
    },
    Rule {
        folder: "fmi2",
        words: &["slave::plant", "slave::controller", "slave::estimator", "slave::bearing", "slave::find"],
        except: &[],
        reason: "the standard's layer knows of bearings through slave::catalogue alone",
    },
    Rule {
        folder: "slave",
        words: &["model::"],
        // The slaves of this project, their common rows, and the type of a finding that all layers share.
        except: &["plant.rs", "controller.rs", "estimator.rs", "bearing.rs"],
        reason: "what slaves have in common names no equation",
    },
    Rule { folder: "model", words: PRINTING, except: &[], reason: "equations do not print" },
    Rule { folder: "slave", words: PRINTING, except: &[], reason: "slaves speak through their log" },
    Rule { folder: "fmi2", words: PRINTING, except: &[], reason: "FMUs speak through the importer's logger" },
    Rule { folder: "model", words: SYSTEM, except: &[], reason: "equations depend on their arguments alone" },
    Rule { folder: "slave", words: SYSTEM, except: &[], reason: "slaves depend on their values alone" },
    Rule { folder: "fmi2", words: SYSTEM, except: &[], reason: "FMUs touch nothing but what the importer hands them" },
    Rule { folder: "model", words: &["unsafe"], except: &[], reason: "unsafe code is at home in src/fmi2" },
    Rule { folder: "slave", words: &["unsafe"], except: &[], reason: "unsafe code is at home in src/fmi2" },
    Rule { folder: "app", words: &["unsafe"], except: &[], reason: "unsafe code is at home in src/fmi2" },
    Rule {
        folder: "",
        words: &["#[test]"],
        except: &[],
        reason: "Cargo.toml switches tests within src off: they would not run",
    },
    Rule { folder: "lib.rs", words: &["unsafe"], except: &[], reason: "unsafe code is at home in src/fmi2" },
    Rule { folder: "main.rs", words: &["unsafe"], except: &[], reason: "unsafe code is at home in src/fmi2" },
];

/// What the rule on the common part of the slaves lets through: the type of a finding, and a list of them.
const FINDING: &str = "crate::model::Invalid";

fn source() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
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

/// The lines without comments and without what stands in quotation marks, numbered from 1.
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

/// Whether the word stands in the line on its own, not as a part of a longer word.
fn holds(line: &str, word: &str) -> bool {
    let part = |letter: Option<char>| letter.is_some_and(|letter| letter.is_alphanumeric() || letter == '_');
    line.match_indices(word).any(|(at, _)| {
        let before = line[..at].chars().next_back();
        let after = line[at + word.len()..].chars().next();
        let open_ended = word.ends_with(|last: char| !last.is_alphanumeric());
        !part(before) && (open_ended || !part(after))
    })
}

fn breaches(rule: &Rule) -> Vec<String> {
    let mut found = Vec::new();
    let files = files(&source().join(rule.folder));
    assert!(!files.is_empty(), "{} is there", rule.folder);
    for file in files {
        if rule.except.iter().any(|name| file.ends_with(name)) {
            continue;
        }
        let text = fs::read_to_string(&file).expect("a source file");
        for (number, line) in code(&text) {
            let line = line.replace(FINDING, "");
            for word in rule.words.iter().filter(|word| holds(&line, word)) {
                let path = file.strip_prefix(source()).expect("a file below src").display();
                found.push(format!("src/{path}:{number}: `{word}`: {}", rule.reason));
            }
        }
    }
    found
}

#[test]
fn every_layer_keeps_to_its_rules() {
    let found: Vec<String> = RULES.iter().flat_map(breaches).collect();
    assert!(found.is_empty(), "\n{}", found.join("\n"));
}

#[test]
fn a_path_up_and_over_is_found_as_well() {
    // `super::super::x` would reach another layer without naming the crate.
    for layer in ["model", "slave", "fmi2"] {
        for file in files(&source().join(layer)) {
            let text = fs::read_to_string(&file).expect("a source file");
            for (number, line) in code(&text) {
                assert!(!line.contains("super::super"), "{}:{number}: name the crate instead", file.display());
            }
        }
    }
}

/// One place gives elementary functions, so that every platform gives the same bits: the crate libm.
#[test]
fn equations_take_elementary_functions_from_libm() {
    for file in files(&source().join("model")) {
        let text = fs::read_to_string(&file).expect("a source file");
        for (number, line) in code(&text) {
            for name in ELEMENTARY {
                let method = line.contains(&format!(".{name}("));
                let function = line.contains(&format!("f64::{name}"));
                assert!(!(method || function), "{}:{number}: {name} is libm's affair", file.display());
            }
        }
    }
}

/// Every unsafe block, and every unsafe implementation, has a sentence that says why it is sound.
#[test]
fn unsafe_blocks_say_why() {
    let mut blocks = 0;
    for folder in [source().join("fmi2"), source().with_file_name("tests")] {
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
                // The sentence stands above the statement, which may have begun some lines before the block.
                let above = &lines[number.saturating_sub(8)..number];
                let said = above.iter().any(|line| line.trim_start().starts_with("// SAFETY: "));
                assert!(said, "{}:{number}: an unsafe block without a SAFETY sentence", file.display());
            }
        }
    }
    assert!(blocks > 40, "only {blocks} unsafe blocks were found: does this test still see them?");
}

/// The rules are worth something only if they can be broken.
#[test]
fn the_search_finds_what_it_looks_for() {
    let lines = |text: &str| code(text).map(|(_, line)| line).collect::<Vec<_>>().join("\n");
    assert!(holds(&lines("use crate::app::cli;"), "crate::app"));
    assert!(holds(&lines("    println!(\"here\");"), "println!"));
    assert!(!holds(&lines("    eprintln!(\"here\");"), "println!"));
    assert!(!holds(&lines("// use crate::app::cli;"), "crate::app"));
    assert!(!holds(&lines("let text = \"crate::app\";"), "crate::app"));
    assert!(!holds(&lines("let unsafely = 1;"), "unsafe"));
    assert!(holds(&lines("let text = \"//\"; unsafe { f() }"), "unsafe"));
}
