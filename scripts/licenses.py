#!/usr/bin/env python3
"""Collect the licences of the crates that are linked into the FMUs: modelDescription/licenses/THIRD-PARTY.txt.

Without arguments it writes the file; with ``--check`` it only reports whether the file is current. The linked crates are the
normal dependencies of this package on Linux according to `cargo tree`, without procedural macros, build scripts and tests. The
texts come from the crates' sources unpacked by cargo.
"""

import argparse
import json
import re
import subprocess
import sys
from pathlib import Path

PROJECT = Path(__file__).resolve().parent.parent
FILE = PROJECT / "modelDescription" / "licenses" / "THIRD-PARTY.txt"
# One platform, so that the file is the same everywhere; the others add only bindings to their systems.
PLATFORM = "x86_64-unknown-linux-gnu"
LICENSE_NAMES = re.compile(r"^(licen[cs]e|copying|notice|unlicense|copyright)", re.IGNORECASE)
# A line that names a holder, not one of a licence about notices.
COPYRIGHT = re.compile(r"^\W*(?i:copyright)\s+(?:\([cC]\)|©|[12]\d{3}|[A-Z])")
# Mentions of copyright in the licences themselves, and placeholders.
NO_HOLDER = re.compile(
    r"copyright (notice|license|holder|owner|and related|statement|\[yyyy\]|\{yyyy\}|law)", re.IGNORECASE
)
WIDTH = 100

HEAD = """\
Software by others in the binaries of these FMUs
================================================

The binaries are made of this project, of the Rust standard library (MIT or Apache-2.0, the Rust Project Developers), and
of the Rust packages below. Where a licence expression offers a choice with "OR", any of them may be chosen. Each text is
printed once, after the list.
"""


def cargo(*arguments):
    """Ask cargo about the packages, with the locked versions."""
    command = ["cargo", *arguments, "--locked"]
    return subprocess.run(
        command, cwd=PROJECT, check=True, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL, encoding="utf-8"
    ).stdout


def linked():
    """Find the packages linked into the library.

    Returns
    -------
    list of dict
        Packages from `cargo metadata`, ordered by name and version.
    """
    # `cargo metadata` alone includes optional packages of features that are off.
    tree = cargo("tree", "--edges=normal,no-proc-macro", "--prefix=none", f"--target={PLATFORM}", "--format={p}")
    names = {tuple(line.split()[:2]) for line in tree.splitlines()}
    packages = json.loads(cargo("metadata", "--format-version=1", f"--filter-platform={PLATFORM}"))["packages"]
    # Packages without a source belong to this project.
    chosen = [
        package for package in packages if package["source"] and (package["name"], f"v{package['version']}") in names
    ]
    return sorted(chosen, key=lambda package: (package["name"], package["version"]))


def license_files(package):
    """Read the licence files of a package.

    Parameters
    ----------
    package : dict
        The package.

    Returns
    -------
    list of tuple of str
        Name and text of each file, with uniform line ends and without trailing blanks.
    """
    folder = Path(package["manifest_path"]).parent
    paths = {path for path in folder.iterdir() if path.is_file() and LICENSE_NAMES.match(path.name)}
    paths |= {path for path in folder.glob("LICENSES/*") if path.is_file()}
    if package["license_file"]:
        paths.add((folder / package["license_file"]).resolve())
    # A file may contain only the name of another one, if packing lost a link.
    texts = [(path.name, path.read_text(encoding="utf-8", errors="replace")) for path in sorted(paths)]
    return [
        (name, "\n".join(line.rstrip() for line in text.strip("\n").splitlines()))
        for name, text in texts
        if len(text) > 80
    ]


def holders(texts):
    """Find the lines that name a copyright holder.

    Parameters
    ----------
    texts : list of tuple of str
        Names and texts of licence files.

    Returns
    -------
    list of str
        Lines, each once, in the order of the files.
    """
    lines = [line.strip(" \t#/*.") for _, text in texts for line in text.splitlines() if COPYRIGHT.match(line)]
    return list(dict.fromkeys(line for line in lines if not NO_HOLDER.search(line)))


def standard(text):
    """Normalise a text to compare licences: without copyright lines and layout."""
    kept = [line for line in text.splitlines() if not (COPYRIGHT.match(line) and not NO_HOLDER.search(line))]
    return re.sub(r"\W+", " ", " ".join(kept)).strip().lower()


def generate():
    """Make the text of the file.

    Returns
    -------
    str
        Content of THIRD-PARTY.txt.

    Raises
    ------
    SystemExit
        If a package names no licence.
    """
    listed, texts = [], {}
    for package in linked():
        title = f"{package['name']} {package['version']}"
        if not package["license"]:
            sys.exit(f"{title} names no licence: look into it before it is shipped")
        files = license_files(package)
        numbers = []
        for _, text in files:
            key = standard(text)
            if key not in texts:
                texts[key] = (len(texts) + 1, text, [])
            number, _, users = texts[key]
            users.append(title)
            numbers.append(number)
        entry = [title, f"  licence: {package['license'].replace('/', ' OR ')}"]
        entry += [f"  {line}" for line in holders(files)]
        if not files:
            # Published without a licence text: only the authors are known.
            authors = [re.sub(r" *<[^>]*>", "", author) for author in package["authors"]]
            entry += [f"  authors: {', '.join(authors) or 'not named'}"]
        found = ", ".join(map(str, sorted(set(numbers))))
        entry += [f"  texts: {found or 'none in the package; those of the same name below'}"]
        listed.append("\n".join(entry))
    parts = [HEAD, "\n\n".join(listed)]
    for number, text, users in texts.values():
        names = ", ".join(dict.fromkeys(users))
        parts.append(f"{'=' * WIDTH}\nText {number}, as found in {names}\n{'=' * WIDTH}\n\n{text}")
    return "\n\n".join(part.strip("\n") for part in parts) + "\n"


def main():
    """Write the file, or compare it.

    Returns
    -------
    int
        0 if the file is current, 1 if --check finds that it is not.
    """
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="compare instead of write")
    arguments = parser.parse_args()
    made, name = generate(), FILE.relative_to(PROJECT)
    if not arguments.check:
        FILE.write_text(made, encoding="utf-8", newline="\n")
        print(f"{name} written")
        return 0
    if not FILE.exists() or FILE.read_text(encoding="utf-8") != made:
        print(f"{name} is not current: run scripts/licenses.py")
        return 1
    print(f"{name} is current")
    return 0


if __name__ == "__main__":
    sys.exit(main())
