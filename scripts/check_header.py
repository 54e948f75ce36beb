#!/usr/bin/env python3
"""Compare our headers of FMI 2.0 and FMI 3.0, item by item, with those shipped with fmpy.

libclang reads both sides, so that the meaning for a compiler is compared, whatever the layout of the text: the values of macros and
enumeration constants, the types of typedefs, structure fields, function types and prototypes. A type is compared as written, which
distinguishes fmi2Integer from fmi2Boolean, and with all typedefs resolved, on which the other side of a call relies.

Needs the packages fmpy and libclang; no compiler is needed.
"""

import argparse
import importlib.util
import sys
from pathlib import Path

from clang import cindex

SOURCES = Path(__file__).resolve().parent.parent / "fmu-export" / "src"

# Replaces the C library, so that the result does not depend on the machine.
LIBRARY = {
    "stddef.h": "typedef __SIZE_TYPE__ size_t;\n",
    "stdlib.h": "",
    "stdbool.h": "#define bool _Bool\n#define true 1\n#define false 0\n",
    "stdint.h": "".join(
        f"typedef __{sign.upper()}INT{bits}_TYPE__ {sign}int{bits}_t;\n" for sign in ("", "u") for bits in (8, 16, 32, 64)
    ),
}
LIBRARY_FOLDER = "/library"
# One fixed platform, since the width of size_t is part of the resolved types.
COMPILER_ARGUMENTS = ["-x", "c", "-std=c99", "-target", "x86_64-unknown-linux-gnu", "-nostdinc", "-isystem", LIBRARY_FOLDER]

# An FMU for co-simulation exports none of these.
MODEL_EXCHANGE_FUNCTIONS = [
    "fmi2EnterEventMode",
    "fmi2NewDiscreteStates",
    "fmi2EnterContinuousTimeMode",
    "fmi2CompletedIntegratorStep",
    "fmi2SetTime",
    "fmi2SetContinuousStates",
    "fmi2GetDerivatives",
    "fmi2GetEventIndicators",
    "fmi2GetContinuousStates",
    "fmi2GetNominalsOfContinuousStates",
]
MODEL_EXCHANGE_TYPES = ["fmi2EventInfo"] + [f"{name}TYPE" for name in MODEL_EXCHANGE_FUNCTIONS]
# Macros that decorate exported names in C; our exports are in Rust.
EXPORT_MACROS = ["FMI2_Export", "fmi2FullName"]

# Items that our headers omit. An FMU exports all functions of FMI 3.0.
ABSENT = {
    "fmi2": set(MODEL_EXCHANGE_FUNCTIONS + MODEL_EXCHANGE_TYPES + EXPORT_MACROS),
    "fmi3": {"FMI3_Export", "fmi3FullName"},
}


def described(kind):
    """Describe a type as written and resolved.

    Parameters
    ----------
    kind : clang.cindex.Type
        The type to describe.

    Returns
    -------
    str
        Both spellings.
    """
    # fmpy declares callbacks without arguments in K&R style; the standard has (void).
    return f"{kind.spelling} = {kind.get_canonical().spelling}".replace("()", "(void)")


def cursor_items(cursor):
    """Yield the comparable parts of a declaration.

    Parameters
    ----------
    cursor : clang.cindex.Cursor
        A declaration or macro at the top level of a header.

    Yields
    ------
    tuple of (tuple of str, str)
        A key (kind, name, part), and the value to be compared.
    """
    kinds = cindex.CursorKind
    name = cursor.spelling
    if cursor.kind == kinds.MACRO_DEFINITION:
        value = " ".join(token.spelling for token in list(cursor.get_tokens())[1:])
        # A macro without a value is an include guard; one with the macro for full names decorates an exported name.
        if value and "FullName (" not in value:
            yield ("macro", name, ""), value
    elif cursor.kind == kinds.TYPEDEF_DECL:
        yield ("typedef", name, ""), described(cursor.underlying_typedef_type)
    elif cursor.kind == kinds.ENUM_DECL:
        for place, constant in enumerate(cursor.get_children()):
            yield ("enum", name, f"constant {place}"), f"{constant.spelling} = {constant.enum_value}"
    elif cursor.kind == kinds.STRUCT_DECL:
        for place, field in enumerate(cursor.type.get_fields()):
            yield ("struct", name, f"field {place}"), f"{field.spelling}: {described(field.type)}"
    elif cursor.kind == kinds.FUNCTION_DECL:
        yield ("function", name, ""), described(cursor.type)
    elif cursor.kind not in (kinds.MACRO_INSTANTIATION, kinds.INCLUSION_DIRECTIVE):
        yield ("other", name or str(cursor.location), ""), cursor.kind.name


def header_items(header):
    """Read all items of a header and its includes.

    Parameters
    ----------
    header : pathlib.Path
        The header.

    Returns
    -------
    dict
        Values by key, see `cursor_items`.

    Raises
    ------
    SystemExit
        If the header does not compile.
    """
    library = [(f"{LIBRARY_FOLDER}/{name}", text) for name, text in LIBRARY.items()]
    options = cindex.TranslationUnit.PARSE_DETAILED_PROCESSING_RECORD
    unit = cindex.Index.create().parse(str(header), args=COMPILER_ARGUMENTS, unsaved_files=library, options=options)
    if unit.diagnostics:
        sys.exit("\n".join(str(diagnostic) for diagnostic in unit.diagnostics))
    items = {}
    for cursor in unit.cursor.get_children():
        file = cursor.location.file
        # Macros without a file are the compiler's own.
        if file is not None and not file.name.startswith(LIBRARY_FOLDER):
            items.update(cursor_items(cursor))
    return items


def reference_header(standard):
    """Find fmpy's header that includes all others.

    Parameters
    ----------
    standard : str
        ``fmi2`` or ``fmi3``.

    Returns
    -------
    pathlib.Path
        The header of the functions.

    Raises
    ------
    SystemExit
        If fmpy or that header is missing.
    """
    package = importlib.util.find_spec("fmpy")
    folders = package.submodule_search_locations if package else []
    found = sorted(path for folder in folders for path in Path(folder).rglob(f"{standard}Functions.h"))
    if not found:
        sys.exit(f"fmpy with its header {standard}Functions.h is not installed for this interpreter")
    return found[0]


def differences(ours, theirs, left_out):
    """Compare two headers.

    Parameters
    ----------
    ours, theirs : dict
        Items of our header and of the reference.
    left_out : set of str
        Names that our header omits.

    Returns
    -------
    list of str
        One line per difference.
    """
    lines = []
    for key in sorted(ours.keys() | theirs.keys()):
        if key in ours and key[1] in left_out:
            lines.append(f"{' '.join(key).strip()}: listed as absent, but our header has it")
        elif key[1] not in left_out and ours.get(key) != theirs.get(key):
            lines.append(f"{' '.join(key).strip()}: ours {ours.get(key)}, theirs {theirs.get(key)}")
    # A name unknown to the reference might hide a mistake later.
    known = {name for _, name, _ in theirs}
    lines += [f"{name}: listed as absent, but the reference does not have it" for name in sorted(left_out - known)]
    return lines


def main():
    """Compare the headers and print the differences.

    Returns
    -------
    int
        0 if the headers agree, 1 if not.
    """
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    wrong = 0
    for standard, left_out in ABSENT.items():
        ours = header_items(SOURCES / standard / f"{standard}.h")
        theirs = header_items(reference_header(standard))
        lines = differences(ours, theirs, left_out)
        for line in lines:
            print(line)
        compared = sum(name not in left_out for _, name, _ in ours.keys() | theirs.keys())
        absent = sorted(left_out & {name for _, name, _ in theirs})
        print(f"{standard}.h: deliberately absent: {', '.join(absent)}")
        print(f"{standard}.h: {compared} items compared, {len(lines)} differences")
        wrong += len(lines)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
