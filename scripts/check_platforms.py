#!/usr/bin/env python3
"""Check the binaries within archives for several platforms.

    scripts/check_platforms.py target/fmu-all [--without-macos]

All FMUs must hold the same binary per platform, in its folder; each binary must export exactly the functions of the headers fmi2.h
and fmi3.h of fmu-export/src, need only system libraries, and hold no time and no path of the machine that built it.
Needs the package lief.
"""

import io
import os
import re
import sys
import zipfile
from pathlib import Path

import lief

PROJECT = Path(__file__).resolve().parent.parent
XMLS = (path.stem for path in (PROJECT / "modelDescription").glob("*.xml"))
MODELS = sorted(name for name in XMLS if not name.endswith("_fmi3"))
FOLDERS = {"linux64": "so", "win64": "dll", "darwin64": "dylib", "aarch64-linux": "so", "aarch64-darwin": "dylib"}
if "--without-macos" in sys.argv:
    FOLDERS = {folder: ending for folder, ending in FOLDERS.items() if ending != "dylib"}
# The version in Red Hat Enterprise Linux 7.
GLIBC_NEWEST = (2, 17)
MACOS_OLDEST = [11, 0, 0]
SYSTEM_LIBRARIES = re.compile(
    r"libc\.so\.6|libdl\.so\.2|libpthread\.so\.0|libm\.so\.6|libgcc_s\.so\.1|ld-linux-x86-64\.so\.2|ld-linux-aarch64\.so\.1"
    r"|(kernel32|ntdll|msvcrt|advapi32|userenv|ws2_32|bcrypt|bcryptprimitives|api-ms-win-core-synch-l1-2-0)\.dll"
    r"|/usr/lib/libSystem\.B\.dylib",
    re.IGNORECASE,
)
# Paths of machines. Debian's standard library contains the path of its source.
PATHS = re.compile(rb"(?<![\w.])/(?:root|home|Users|tmp|work|builds?|mnt|opt|var)/[\w./-]+|index\.crates|registry/src|/\.cargo")
PATHS_ALLOWED = re.compile(rb"/(?:tmp|var/run)/?$")

problems = []
checks = 0


def check(holds, problem):
    """Count a check, and collect the failures."""
    global checks
    checks += 1
    if not holds:
        problems.append(problem)


def functions_of_standard():
    """Read the names of the functions of FMI 2.0 and FMI 3.0 from the headers.

    Returns
    -------
    set of str
        The names.
    """
    names = set()
    for standard in ("fmi2", "fmi3"):
        text = (PROJECT / "fmu-export" / "src" / standard / f"{standard}.h").read_text(encoding="utf-8")
        names |= set(re.findall(rf"^{standard}\w+TYPE ({standard}\w+);", text, re.MULTILINE))
    return names


def check_elf(name, binary, machine):
    """Check a library of Linux.

    Returns
    -------
    set of str
        The exported names.
    """
    check(binary.header.machine_type == machine, f"{name}: {binary.header.machine_type}")
    for library in binary.libraries:
        check(SYSTEM_LIBRARIES.fullmatch(library), f"{name} needs {library}")
    for requirement in binary.symbols_version_requirement:
        for version in requirement.get_auxiliary_symbols():
            number = re.fullmatch(r"GLIBC_([\d.]+)", version.name)
            newest = number and tuple(map(int, number[1].split("."))) <= GLIBC_NEWEST
            check(newest or version.name.startswith("GCC_"), f"{name} needs {version.name}")
    check(not binary.has_section(".symtab") and not binary.has_section(".debug_info"), f"{name} is not stripped")
    return {symbol.name for symbol in binary.dynamic_symbols if symbol.exported}


def check_pe(name, binary):
    """Check a library of Windows.

    Returns
    -------
    set of str
        The exported names.
    """
    check(binary.header.machine == lief.PE.Header.MACHINE_TYPES.AMD64, f"{name}: {binary.header.machine}")
    check(binary.header.time_date_stamps == 0, f"{name} holds the time {binary.header.time_date_stamps}")
    check(binary.get_export().timestamp == 0, f"{name} holds a time in its exports")
    for library in binary.imports:
        check(SYSTEM_LIBRARIES.fullmatch(library.name), f"{name} needs {library.name}")
    return {entry.name for entry in binary.get_export().entries}


def check_macho(name, binary, machine):
    """Check a library of macOS.

    Returns
    -------
    set of str
        The exported names, without the underscore of C.
    """
    check(binary.header.cpu_type == machine, f"{name}: {binary.header.cpu_type}")
    check(binary.header.file_type == lief.MachO.Header.FILE_TYPE.DYLIB, f"{name}: {binary.header.file_type}")
    for library in binary.libraries:
        own = library.command == lief.MachO.LoadCommand.TYPE.ID_DYLIB
        check(own == library.name.startswith("@rpath/"), f"{name} needs {library.name}")
        check(own or SYSTEM_LIBRARIES.fullmatch(library.name), f"{name} needs {library.name}")
    check(list(binary.build_version.minos) == MACOS_OLDEST, f"{name} needs macOS {binary.build_version.minos}")
    # Apple silicon runs only signed code; the linker's signature suffices.
    signed = binary.has_code_signature
    check(signed or machine == lief.MachO.Header.CPU_TYPE.X86_64, f"{name} is not signed")
    exports = binary.dyld_info.exports if binary.has_dyld_info else binary.dyld_exports_trie.exports
    return {entry.symbol.name.removeprefix("_") for entry in exports}


def check_content(name, folder, content, expected):
    """Check one binary of an FMU."""
    arm = folder.startswith("aarch64")
    for path in PATHS.findall(content):
        check(PATHS_ALLOWED.search(path), f"{name} holds the path {path.decode()}")
    for folder_here in {str(PROJECT), str(Path.home()), os.environ.get("CARGO_HOME", "")} - {"", "/"}:
        check(folder_here.encode() not in content, f"{name} holds the path {folder_here}")
    if folder.endswith(("linux64", "linux")):
        machine = lief.ELF.ARCH.AARCH64 if arm else lief.ELF.ARCH.X86_64
        exports = [check_elf(name, lief.ELF.parse(io.BytesIO(content)), machine)]
    elif folder == "win64":
        exports = [check_pe(name, lief.PE.parse(io.BytesIO(content)))]
    else:
        cpu = lief.MachO.Header.CPU_TYPE
        machines = [cpu.ARM64] if arm else [cpu.X86_64, cpu.ARM64]
        # Keeps the universal file, which owns the parts.
        whole = lief.MachO.parse(io.BytesIO(content))
        slices = list(whole)
        check(len(slices) == len(machines), f"{name} holds {len(slices)} libraries")
        exports = [check_macho(name, part, machine) for part, machine in zip(slices, machines)]
    for names in exports:
        check(names == expected, f"{name}: exports differ from the headers: {sorted(names ^ expected)[:5]}")


def main():
    """Check all archives of a folder.

    Returns
    -------
    int
        0 if all is well, 1 if not.
    """
    folder = Path(sys.argv[1])
    expected = functions_of_standard()
    check(len(expected) == 34 + 75, f"the headers have {len(expected)} functions")
    binaries = {}
    check(len(MODELS) == 15, f"{len(MODELS)} models are described")
    for system in sorted(folder.glob("*.ssp")):
        content = zipfile.ZipFile(system)
        fmus = [name for name in content.namelist() if name.endswith(".fmu")]
        check(len(fmus) == 3, f"{system.name} holds {len(fmus)} FMUs")
        for name in fmus:
            same = content.read(name) == (folder / Path(name).name).read_bytes()
            check(same, f"{name} within {system.name} is another one")
    for model in MODELS:
        archive = (folder / f"{model}.fmu").read_bytes()
        fmu = zipfile.ZipFile(io.BytesIO(archive))
        found = {name for name in fmu.namelist() if name.startswith("binaries/")}
        wanted = {f"binaries/{platform}/{model}.{ending}" for platform, ending in FOLDERS.items()}
        check(found == wanted, f"{model}.fmu: {sorted(found ^ wanted)}")
        for name in sorted(found & wanted):
            platform = name.split("/")[1]
            content = fmu.read(name)
            check(binaries.setdefault(platform, content) == content, f"{name} is another one than in the other FMUs")
    for platform, content in binaries.items():
        check_content(platform, platform, content, expected)
        print(f"{platform:16}{len(content) / 1e3:8.0f} kB")
    if "darwin64" in binaries:
        fat, thin = (lief.MachO.parse(io.BytesIO(binaries[name])) for name in ("darwin64", "aarch64-darwin"))
        same = fat.at(1).uuid.uuid == thin.at(0).uuid.uuid
        check(same, "aarch64-darwin is another library than the one within darwin64")
    print("\n".join(problems))
    print(f"archives: {checks - len(problems)} passed, {len(problems)} failed")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
