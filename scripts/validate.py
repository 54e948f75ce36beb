#!/usr/bin/env python3
"""Check the packaged FMUs and the SSP from outside, with third-party tools.

Needs the packages of scripts/requirements.txt; scripts/test installs them. Everything is checked on the archives as
they are in target/fmu, or in the folder that --fmu names; what the archives are compared with comes from the program,
run by cargo.

How the SSP runs elsewhere, as found by these checks:

- libcosim reads the system structure, the parameter sets bound to the elements, and the communication step from the
  annotation of Open Simulation Platform. All elements step at once, then outputs are handed on, as in the program. It
  counts time in nanoseconds, so that the points of communication differ from count × step in the last bits; given the
  same points, the direct run has the same bits. Outputs at the start are not offered.
- ecos is given the step by its user, adds it up, and applies a parameter set only if its user names it (`unbalanced`);
  otherwise the FMUs run with their start values. Outputs are handed on after all steps, as in the program. What it then
  shows for outputs that follow an input at the same instant, the forces of the magnets, belongs to the new inputs.
  Given the same points in time and read at the same place, the direct run has the same bits. It knows no name but
  SystemStructure.ssd.
- Neither of the two supports variables of type Enumeration: `method` and `update.mode` keep the start values of the FMUs,
  and a warning says so. SystemStructure.ssd needs no others; in PaperSimulation.ssd the estimator then runs the method
  `predictionError`, not the paper's.
"""

import argparse
import csv
import hashlib
import io
import math
import re
import subprocess
import sys
import tempfile
import time
import traceback
import zipfile
from functools import cache
from pathlib import Path

import fmpy
import numpy as np
from elftools.elf.elffile import ELFFile
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu
from lxml import etree

from closed_loop import (
    CALLBACKS,
    FMUS,
    MESSAGES,
    NAMESPACES,
    STEP_S,
    SYSTEM,
    Instance,
    Model,
    even_times,
    read_system,
    run,
)
from compare_runs import (
    ELEMENTS,
    VARIANTS,
    differences,
    largest_difference,
    read_scenario,
    same_bits,
    without_choices,
    without_settings,
)

PROJECT = Path(__file__).resolve().parent.parent
PROGRAM = ["cargo", "run", "--release", "--locked", "--quiet", "--"]
SCENARIOS = ("paper", "unbalanced", "turned")
DURATION_S = 0.4
STEPS = round(DURATION_S / STEP_S)

# Points in time that were added up differ by up to 3e-14 s after 4000 steps. At 314 rad/s that turns a harmonic force
# of nominal 10 N by 1e-11 of its amplitude; a loop that damps disturbances does not amplify it. A sample of
# misalignment would be above 1e-2, and so would a parameter that was not applied.
TIME_ROUNDING = 1e-10
# The shortest steps that importers were seen to make at the end of a run, and the jitter of others, in seconds.
LAST_STEP_S = 1.1e-16
JITTER_S = 1e-16
# The shortest steps add up to 7e-14 s, in which a rotor at 0.02 m/s moves 1e-10 of the nominal 1e-5 m; without control,
# disturbances grow 3000-fold in 0.06 s, at 130 rad/s. A sensor that read one sample late would be above 1e-2.
STEP_ROUNDING = 1e-6
# Lengths of runs of one FMU, in sample times: with the currents of the closed loop, and with currents held too long.
DRIVEN_SAMPLES = 600
FALLING_SAMPLES = 60
# Importers that die in campaigns do so within about a thousand instances; half of that is enough to see memory grow.
INSTANCES = 500
MEMORY_GROWTH_KB = 4096

MEMBERS = [
    "modelDescription.xml",
    "model.png",
    "documentation/index.html",
    "documentation/licenses/LICENSE-MIT.txt",
    "documentation/licenses/LICENSE-APACHE.txt",
    "documentation/licenses/THIRD-PARTY.txt",
]
TEXT_ENDINGS = (".xml", ".html", ".txt", ".ssd", ".ssv")
MACHINE_PATHS = re.compile(rb"(?<![\w.])/(?:root|home|Users|tmp|work|builds|github)/|[A-Z]:\\|file:/|\.cargo/registry")

# Invalid parameters: FMU, settings, and the variables that the message must name.
REFUSED = [
    (fmu, settings, list(settings))
    for fmu in FMUS
    for settings in [
        {"m": math.nan},
        {"m": 0.0},
        {"m": -6.7},
        {"m": math.inf},
        {"s": math.nan},
        {"s": 0.0},
        {"s": -5e-4},
    ]
]
REFUSED += [
    (fmu, {name: value}, [name])
    for fmu, name in [("MagneticBearing", "sensor.Ts"), ("FlatnessController", "Ts"), ("AlgebraicEstimator", "Ts"), ("SpindleController", "Ts")]
    for value in (math.nan, 0.0, -1e-4)
]
REFUSED += [(fmu, {f"alpha[{k}]": 1.0 for k in (1, 2, 3)}, ["alpha"]) for fmu in FMUS]
REFUSED += [(fmu, {"alpha[2]": math.nan}, ["alpha[2]"]) for fmu in FMUS]
REFUSED += [
    ("MagneticBearing", {"Y0": 6e-4}, ["Y0"]),
    ("MagneticBearing", {"Z0": -5.1e-4}, ["Z0"]),
    ("MagneticBearing", {"lambda[2]": -1e-6}, ["lambda[2]"]),
    ("MagneticBearing", {"sensor.positionNoise": -1e-7}, ["sensor.positionNoise"]),
    ("MagneticBearing", {"solver.maxStep": 0.0}, ["solver.maxStep"]),
    ("FlatnessController", {"lambda0[1]": 0.0}, ["lambda0[1]"]),
    ("FlatnessController", {"F0": -1.0}, ["F0"]),
    ("FlatnessController", {"F0.modulation": 1.5, "F0.modulationFrequency": 6000.0}, ["F0.modulation", "F0.modulationFrequency"]),
    ("FlatnessController", {"reference.lobes": -1}, ["reference.lobes"]),
    ("FlatnessController", {"update.mode": 9}, ["update.mode"]),
    ("SpindleController", {"B.F0": -1.0, "X.lambda0[2]": 0.0}, ["B.F0", "X.lambda0[2]"]),
    ("SpindleController", {"Jp": 0.4}, ["Jp"]),
    ("AlgebraicEstimator", {"method": 2, "Tf": 7e-4}, ["Tf"]),
    ("AlgebraicEstimator", {"method": 2, "Tf": 0.02005}, ["Tf"]),
    ("AlgebraicEstimator", {"Tf": math.nan}, ["Tf"]),
    ("AlgebraicEstimator", {"method": 0}, ["method"]),
    ("AlgebraicEstimator", {"m": -1.0, "s": 0.0, "Ts": math.nan}, ["m", "s", "Ts"]),
]


class Report:
    """Collects the findings of the checks and prints a row for each."""

    def __init__(self):
        self.passed = 0
        self.failed = 0

    def check(self, name, function, *arguments):
        """Carry out a check.

        Parameters
        ----------
        name : str
            What is checked.
        function : callable
            Returns what it finds, as a list of texts, and a note with the figures measured.
        *arguments
            Arguments of the function.
        """
        start = time.monotonic()
        try:
            findings, note = function(*arguments)
        except Exception as error:  # A check that cannot be carried out has failed, whatever the reason.
            place = traceback.extract_tb(error.__traceback__)[-1]
            findings, note = (
                [f"{type(error).__name__} in {Path(place.filename).name}, line {place.lineno}: {error}"],
                "",
            )
        self.passed += not findings
        self.failed += bool(findings)
        print(
            f"{'FAILED' if findings else 'ok':6} {time.monotonic() - start:5.1f} s  {name:58} {note}".rstrip(),
            flush=True,
        )
        for finding in findings[:10]:
            print(f"         {finding}")
        if len(findings) > 10:
            print(f"         and {len(findings) - 10} more")


class Archives:
    """The archives under test.

    Parameters
    ----------
    folder : pathlib.Path
        Where they are.
    scratch : pathlib.Path
        A folder for whatever is extracted or recorded.
    """

    def __init__(self, folder, scratch):
        self.folder = folder
        self.scratch = scratch
        self.models = {name: Model.open(folder / f"{name}.fmu", scratch / name) for name in FMUS}
        self.ssp = folder / SYSTEM
        self.systems = {structure: read_system(self.ssp, structure) for structure in VARIANTS}
        self.direct = cache(self.direct)

    def scenario(self, name):
        """Read a built-in scenario."""
        return read_scenario(
            program("simulate", "--print", name), self.models, self.systems["SystemStructure.ssd"].connections
        )

    def direct(self, name):
        """Run a scenario over the packaged FMUs, once."""
        return run(self.scenario(name), self.models, *even_times(DURATION_S))


def program(*arguments):
    """Run the program of this project and return its output."""
    done = subprocess.run(
        [*PROGRAM, *map(str, arguments)], cwd=PROJECT, capture_output=True, encoding="utf-8", stdin=subprocess.DEVNULL
    )
    if done.returncode:
        raise RuntimeError(done.stderr.strip() or f"the program ended with {done.returncode}")
    return done.stdout


# Archives as files.


def fmpy_validation(archives, fmu):
    """Let fmpy validate an FMU: XML schema, names, structure, units."""
    return validate_fmu(str(archives.models[fmu].archive)), ""


def fmutool_check(archives, fmu):
    """Let the FMU manipulation toolbox check an FMU."""
    tool = Path(sys.executable).with_name("fmutool")
    done = subprocess.run(
        [tool, "-input", archives.models[fmu].archive, "-check"],
        capture_output=True,
        encoding="utf-8",
        stdin=subprocess.DEVNULL,
    )
    text = done.stdout + done.stderr
    findings = [line for line in text.splitlines() if not line.startswith("INFO")]
    findings += [
        f"it does not say: {words}" for words in ("compliant with FMI-2.0", "No semantic error") if words not in text
    ]
    return findings + ([f"it ended with {done.returncode}"] if done.returncode else []), ""


def schema_of_fmi(archives, fmu):
    """Compare a model description with the schema of the standard."""
    member = "modelDescription.xml"
    with zipfile.ZipFile(archives.models[fmu].archive) as archive:
        return schema_findings("schema/fmi2/fmi2ModelDescription.xsd", member, archive.read(member)), ""


def schema_of_ssp(archives, member):
    """Compare a system structure or a parameter set with the schemas of the standard."""
    with zipfile.ZipFile(archives.ssp) as archive:
        return ssp_findings(member, archive.read(member)), ""


def ssp_findings(name, text):
    """List what the schemas of the standard find in a system structure or a parameter set."""
    kind = {".ssd": "Description", ".ssv": "ParameterValues"}[Path(name).suffix]
    return schema_findings(f"ssp/schema/SystemStructure{kind}.xsd", name, text)


def schema_findings(schema, name, text):
    """List what a schema that fmpy ships finds in a text."""
    checker = etree.XMLSchema(etree.parse(str(Path(fmpy.__file__).parent / schema)))
    checker.validate(etree.fromstring(text))
    return [f"{name}, line {error.line}: {error.message}" for error in checker.error_log]


def ssp_rules(archives, structure):
    """Check what schemas cannot: names, kinds, types and units against the FMUs, and what tools require."""
    findings = []
    with zipfile.ZipFile(archives.ssp) as archive:
        text = archive.read(structure)
        root = etree.fromstring(text)
        names = archive.namelist()
        sets = {name: etree.fromstring(archive.read(name)) for name in names if name.endswith(".ssv")}
        for name in FMUS:
            if archive.read(f"resources/{name}.fmu") != archives.models[name].archive.read_bytes():
                findings.append(f"resources/{name}.fmu is another than {archives.models[name].archive.name}")
    for prefix in ("ssd", "ssc"):
        if f'xmlns:{prefix}="{NAMESPACES[prefix]}"'.encode() not in text:
            findings.append(f"the prefix {prefix} is not what libcosim and ecos look for")
    if root.find("ssd:System/ssd:Connectors", NAMESPACES) is not None:
        findings.append("the system has connectors of its own, which ecos cannot connect")
    if root.find("ssd:System/ssd:ParameterBindings", NAMESPACES) is not None:
        findings.append("parameters are bound to the system, where libcosim and ecos do not look")
    units = {unit.get("name"): exponents(unit) for unit in root.iterfind("ssd:Units/ssc:Unit", NAMESPACES)}
    connectors = {}
    for component in root.iterfind(".//ssd:Component", NAMESPACES):
        element = component.get("name")
        model = archives.models[ELEMENTS[element]]
        if component.get("type") != "application/x-fmu-sharedlibrary" or component.get("source") not in names:
            findings.append(f"{element}: type {component.get('type')}, source {component.get('source')}")
        own = {c.get("name"): c for c in component.iterfind("ssd:Connectors/ssd:Connector", NAMESPACES)}
        connectors |= {(element, name): connector for name, connector in own.items()}
        findings += [f"{element}.{line}" for line in connector_rules(own, model, units)]
        for binding in component.iterfind("ssd:ParameterBindings/ssd:ParameterBinding", NAMESPACES):
            source = binding.get("source")
            if source in sets:
                findings += [f"{source}: {line}" for line in parameter_rules(sets[source], model, VARIANTS[structure])]
            else:
                findings.append(f"{element}: {source} is not in the archive")
    connections = archives.systems[structure].connections
    findings += connection_rules(connections, connectors)
    return findings, f"{len(connectors)} connectors, {len(connections)} connections"


def connector_rules(connectors, model, units):
    """Compare the connectors of an element with the variables of its FMU."""
    kinds = {"Enumeration": "Integer"}
    declared = {unit.name: exponents_of_fmu(unit.baseUnit) for unit in model.description.unitDefinitions}
    for name, connector in connectors.items():
        variable, kind, unit = model.variables.get(name), etree.QName(connector[0]).localname, connector[0].get("unit")
        if variable is None or connector.get("kind") != variable.causality:
            yield f"{name}: the FMU has no {connector.get('kind')} of that name"
        elif kind != kinds.get(variable.type, variable.type):
            yield f"{name}: {kind} against {variable.type} in the FMU"
        elif unit != variable.unit:
            yield f"{name}: unit {unit} against {variable.unit} in the FMU"
        elif unit is not None and units.get(unit) != declared[unit]:
            yield f"{name}: unit {unit} is {units.get(unit)}, in the FMU {declared[unit]}"
    for name, variable in model.variables.items():
        if variable.causality != "local" and name not in connectors:
            yield f"{name} has no connector"


def parameter_rules(parameters, model, name):
    """Compare a parameter set with the variables of the FMU that it is bound to."""
    if parameters.get("name") != name:
        yield f"it is named {parameters.get('name')} and not {name}, by which users of ecos ask for it"
    for parameter in parameters.iterfind(".//ssv:Parameter", NAMESPACES):
        variable = model.variables.get(parameter.get("name"))
        if variable is None or variable.causality not in ("parameter", "input"):
            yield f"{parameter.get('name')} cannot be set"
        elif parameter[0].get("unit") != variable.unit:
            yield f"{variable.name} is given in {parameter[0].get('unit')}, the FMU has {variable.unit}"


def connection_rules(connections, connectors):
    """Check that connections lead from outputs to inputs of the same type and unit, and to each input once."""
    for start, end in connections:
        output, into = connectors.get(start), connectors.get(end)
        if output is None or output.get("kind") != "output":
            yield f"{'.'.join(start)} is no output to be connected"
        elif into is None or into.get("kind") != "input":
            yield f"{'.'.join(end)} is no input to be connected"
        elif (output[0].tag, output[0].get("unit")) != (into[0].tag, into[0].get("unit")):
            yield f"{'.'.join(start)} and {'.'.join(end)} differ in type or unit, which OMSimulator refuses"
    ends = [end for _, end in connections]
    yield from (f"{'.'.join(end)} is connected twice" for end in sorted(set(ends)) if ends.count(end) > 1)


def exponents(unit):
    """Read the exponents of a unit of a system structure."""
    base = unit.find("ssc:BaseUnit", NAMESPACES)
    return {name: int(base.get(name, "0")) for name in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")}


def exponents_of_fmu(base):
    """Read the exponents of a unit of an FMU."""
    return {name: int(getattr(base, name)) for name in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")}


def members(archives):
    """Look for missing and empty files of an FMU."""
    findings, platforms = [], []
    for name, model in archives.models.items():
        with zipfile.ZipFile(model.archive) as archive:
            sizes = {info.filename: info.file_size for info in archive.infolist()}
            findings += [f"{name}.fmu: {member} is missing" for member in MEMBERS if member not in sizes]
            findings += [f"{name}.fmu: {member} is all but empty" for member, size in sizes.items() if size < 100]
            platforms = sorted(member.split("/")[1] for member in sizes if member.startswith("binaries/"))
            if not platforms:
                findings.append(f"{name}.fmu has no binary")
            if archive.testzip():
                findings.append(f"{name}.fmu: {archive.testzip()} is damaged")
    return findings, "binaries for " + ", ".join(platforms)


def no_machine_paths(archives):
    """Look for paths of the packaging machine in all texts."""
    findings, count = [], 0
    for path in [*(model.archive for model in archives.models.values()), archives.ssp]:
        with zipfile.ZipFile(path) as archive:
            for member in archive.namelist():
                if member.endswith(TEXT_ENDINGS):
                    count += 1
                    found = MACHINE_PATHS.search(archive.read(member))
                    findings += [f"{path.name}: {member} holds {found.group()!r}"] if found else []
    return findings, f"{count} texts"


def reproducible(archives):
    """Package twice and compare the bytes, with those under test as well."""
    findings, digests = [], []
    folders = [archives.scratch / "once", archives.scratch / "and again"]
    for folder in folders:
        program("package", "--out", folder)
    for name in [*(f"{fmu}.fmu" for fmu in FMUS), SYSTEM]:
        once, again = (hashlib.sha256((folder / name).read_bytes()).hexdigest() for folder in folders)
        if once != again:
            findings.append(f"{name}: two runs give {once[:12]} and {again[:12]}")
        if once != hashlib.sha256((archives.folder / name).read_bytes()).hexdigest():
            findings.append(f"{name}: what is under test is not what the program packages now")
        digests.append(once[:12])
    return findings, " ".join(digests)


def exported_symbols(archives, fmu):
    """Compare what each ELF binary exports with the functions that fmpy knows, of FMI 2.0 for co-simulation, of FMI 3.0 all."""
    wanted = {name for name in dir(FMU2Slave) if name.startswith("fmi2")}
    wanted |= {name for name in dir(FMU3Slave) if name.startswith("fmi3")}
    findings = [] if len(wanted) == 34 + 75 else [f"fmpy knows {len(wanted)} functions, and not 109"]
    binaries = sorted(Path(archives.models[fmu].folder, "binaries").rglob("*.so"))
    for binary in binaries:
        with binary.open("rb") as file:
            table = ELFFile(file).get_section_by_name(".dynsym")
            found = {
                s.name
                for s in table.iter_symbols()
                if s["st_shndx"] != "SHN_UNDEF" and s["st_info"]["bind"] != "STB_LOCAL"
            }
        findings += [f"{binary.parent.name}: {name} is missing" for name in sorted(wanted - found)]
        findings += [f"{binary.parent.name}: {name} should not be exported" for name in sorted(found - wanted)]
    if not binaries:
        findings.append("there is no ELF binary")
    instance = Instance(archives.models[fmu], "version")
    version, platform = instance.fmu.getVersion(), instance.fmu.getTypesPlatform()
    instance.close()
    findings += [] if (version, platform) == ("2.0", "default") else [f"version {version}, types platform {platform}"]
    return findings, f"{len(wanted)} functions, version {version}, types {platform}"


# The closed loop.


def nominals(archives, elements):
    """Nominal values of the outputs of a system, or of one FMU.

    Parameters
    ----------
    archives : Archives
        The archives under test.
    elements : dict
        Prefix of the names, such as `plant.`, and FMU.
    """
    found = {}
    for prefix, fmu in elements.items():
        model = archives.models[fmu]
        found |= {prefix + name: float(model.variables[name].nominal or 1.0) for name in model.outputs()}
    return found


def as_the_program(archives, scenario):
    """Run a scenario over the packaged FMUs and compare all outputs with the program's, bit by bit."""
    path = archives.scratch / f"{scenario}.csv"
    program("simulate", scenario, "--csv", path)
    rows = list(csv.reader(io.StringIO(path.read_text(encoding="utf-8"))))
    values = np.array([[float(cell) for cell in row] for row in rows[1:]]).T
    theirs = {title.split(" [")[0]: column for title, column in zip(rows[0], values)}
    times_s = theirs.pop("time")
    findings = differences(archives.direct(scenario), theirs)
    if same_bits(times_s, even_times(DURATION_S)[0]):
        findings.append("the communication points differ")
    constant = sum(bool(np.all(column == column[0])) for column in theirs.values())
    return findings, f"{len(theirs)} outputs, {constant} of them constant, {len(times_s)} rows, same bits"


def parameters_of_ssp(archives, structure):
    """Compare the parameter sets of the SSP with the scenario that they come from."""
    scenario, findings, count = archives.scenario(VARIANTS[structure]), [], 0
    for element, (fmu, settings) in archives.systems[structure].elements.items():
        # An enumeration at its start value may be left out of the SSP.
        model = archives.models[fmu]
        choices = [name for name in model.choices() if model.variables[name].causality == "parameter"]
        starts = {name: int(model.variables[name].start) for name in choices}
        settings, wanted = starts | settings, starts | scenario.elements[element][1]
        count += len(wanted)
        for name in sorted(settings.keys() | wanted.keys()):
            if settings.get(name) != wanted.get(name):
                findings.append(
                    f"{element}.{name}: {settings.get(name)} in the SSP, {wanted.get(name)} in the scenario"
                )
    return findings, f"{count} values"


def in_tool(archives, tool, structure, named):
    """Run the SSP in another tool and compare all outputs with the direct run.

    Parameters
    ----------
    archives : Archives
        The archives under test.
    tool : str
        libcosim or ecos.
    structure : str
        The system structure. Another than the default one is handed over from the extracted archive: to libcosim by its
        path, to ecos under the name of the default one, as there is no other way to tell them.
    named : bool
        Whether the user names the parameter set, which ecos wants.
    """
    path = archives.ssp
    if structure != "SystemStructure.ssd":
        path = archives.scratch / f"{tool} {structure}"
        with zipfile.ZipFile(archives.ssp) as archive:
            archive.extractall(path)
        if tool == "libcosim":
            path /= structure
        else:
            (path / structure).replace(path / "SystemStructure.ssd")
    out = archives.scratch / f"{tool}.npz"
    command = [
        sys.executable,
        PROJECT / "scripts" / "system_tools.py",
        tool,
        path,
        out,
        *([VARIANTS[structure]] if named else []),
    ]
    done = subprocess.run(command, capture_output=True, encoding="utf-8", errors="replace", stdin=subprocess.DEVNULL)
    text = done.stdout + done.stderr
    if done.returncode:
        return [f"it ended with {done.returncode}", *text.splitlines()[-8:]], ""
    theirs = dict(np.load(out))

    system = archives.systems[structure]
    choices = {choice for model in archives.models.values() for choice in model.choices()}
    settings = without_choices(system, archives.models) if named or tool == "libcosim" else without_settings(system)
    findings = []
    for line in text.splitlines():
        # Warnings known to be harmless are skipped; any other is a finding.
        if re.search(r"warning|error", line, re.IGNORECASE) and not any(
            re.search(rf"\b{re.escape(choice)}\b", line) for choice in choices
        ):
            findings.append(line)
    if tool == "libcosim":
        times_s = [step * round(STEP_S * 1e9) / 1e9 for step in range(STEPS + 1)]
        lengths_s = [end - start for start, end in zip(times_s, times_s[1:])]
        first_row = 1
    else:
        times_s = [0.0]
        for _ in range(STEPS):
            times_s.append(times_s[-1] + STEP_S)
        lengths_s = [STEP_S] * STEPS
        first_row = 0
    after_inputs = tool == "ecos"
    ours = run(settings, archives.models, times_s, lengths_s, after_inputs=after_inputs)
    # Neither tool shows outputs of type Enumeration.
    ours = {name: values for name, values in ours.items() if name in theirs or name.split(".", 1)[-1] not in choices}
    findings += differences(ours, theirs, first_row)
    even = run(settings, archives.models, *even_times(DURATION_S), after_inputs=after_inputs)
    parts = {f"{element}.": fmu for element, (fmu, _) in settings.elements.items()}
    apart, name = largest_difference(theirs, even, nominals(archives, parts), first_row)
    if not apart <= TIME_ROUNDING:
        findings.append(
            f"{name} is {apart:.1e} of its nominal value from the run with even steps, limit {TIME_ROUNDING:.0e}"
        )
    names = [f"estimator.lambdaHat[{k}]" for k in (1, 2, 3)]
    estimates = max(abs(theirs[name][-1] / even[name][-1] - 1) for name in names)
    if not estimates <= TIME_ROUNDING:
        findings.append(
            f"the final estimates are {estimates:.1e} from the run with even steps, limit {TIME_ROUNDING:.0e}"
        )
    shown = " ".join(f"{theirs[name][-1] * 1e6:.4f}" for name in names)
    return findings, f"same bits at its times; even steps within {apart:.0e} of nominal; lambda {shown} e-6"


# Steps of other lengths.


def drive(archives, fmu, pieces, rows, held=1, jitter=False):
    """Run one FMU of the paper's loop alone, its inputs taken from the recording of the loop.

    Parameters
    ----------
    archives : Archives
        The archives under test.
    fmu : str
        The FMU.
    pieces : int
        Steps per sample time; 0.5 makes steps of two sample times.
    rows : int
        Length of the run in sample times.
    held : int, optional
        For how many sample times inputs are held.
    jitter : bool, optional
        Add up the times, jolt every step in its last bits and end with a step of next to nothing.

    Returns
    -------
    dict
        All outputs at whole multiples of the longer of step and sample time.
    """
    element = next(element for element, name in ELEMENTS.items() if name == fmu)
    system = archives.systems["PaperSimulation.ssd"]
    recording = archives.direct("paper")
    wires = [(".".join(start), end[1]) for start, end in system.connections if end[0] == element]
    inputs = np.array([recording[start] for start, _ in wires]).T
    instance = Instance(archives.models[fmu], element)
    try:
        instance.start(system.elements[element][1])
        outputs = instance.model.outputs()
        read, write = instance.reader(outputs), instance.writer([end for _, end in wires])
        found, added_s = [read()], 0.0
        for step in range(round(rows * pieces)):
            place = step / pieces
            if place % held == 0:
                write(list(inputs[int(place)]))
            if jitter:
                length_s = STEP_S / pieces + (JITTER_S if step % 2 else -JITTER_S)
                instance.step(added_s, length_s)
                added_s += length_s
                instance.step(added_s, LAST_STEP_S)
                added_s += LAST_STEP_S
            else:
                instance.step(step * STEP_S / pieces, STEP_S / pieces)
            if (step + 1) % max(pieces, 1) == 0:
                found.append(read())
    finally:
        instance.close()
    return dict(zip(outputs, np.array(found).T))


def other_steps(archives, fmu):
    """Compare runs with the inputs held over the same time and steps of different lengths.

    The sampled FMUs act at multiples of the sample time only and must give the same bits whatever the steps. The plant
    integrates with sub-steps of half a sample time, so that halves and doubles of it lead to the same sub-steps and
    differ by rounding; with doubles the inputs of the reference are held as long, and the run is short, because the
    rotor falls.
    """
    cases = [("halves", 2, 1, False), ("quarters", 4, 1, False), ("jitter", 1, 1, True)]
    if fmu == "MagneticBearing":
        cases = [("halves", 2, 1, False), ("doubles", 0.5, 2, False), ("jitter", 1, 1, True)]
    findings, moved, notes = [], set(), []
    for title, pieces, held, jitter in cases:
        rows = DRIVEN_SAMPLES if held == 1 else FALLING_SAMPLES
        reference = drive(archives, fmu, 1, rows, held)
        reference = {name: column[::held] for name, column in reference.items()}
        found = drive(archives, fmu, pieces, rows, held, jitter)
        moved |= {name for name, column in reference.items() if np.any(column != column[0])}
        if fmu == "MagneticBearing":
            apart, name = largest_difference(reference, found, nominals(archives, {"": fmu}))
            if not apart <= STEP_ROUNDING:
                findings.append(f"{title}: {name} is {apart:.1e} of its nominal value apart, limit {STEP_ROUNDING:.0e}")
            notes.append(f"{title} within {apart:.0e} of nominal")
        else:
            findings += [f"{title}: {line}" for line in differences(reference, found)]
            notes.append(f"{title} same bits")
    return findings, f"{', '.join(notes)}; {len(moved)} outputs that move"


# Misuse.


def start_values(archives, fmu):
    """Read all variables during initialization and compare with the start values, which are all that people see."""
    findings, count = [], 0
    instance = Instance(archives.models[fmu], "new")
    instance.fmu.setupExperiment()
    # libcosim reads everything here, the inputs as well.
    instance.fmu.enterInitializationMode()
    for name, variable in archives.models[fmu].variables.items():
        value = instance.get(name)[0]
        if not math.isfinite(value):
            findings.append(f"{name} is {value} before the run")
        if variable.start is None:
            continue
        count += 1
        start = float({"true": 1, "false": 0}.get(variable.start, variable.start))
        if value != start:
            findings.append(f"{name} starts at {value}, the description says {variable.start}")
        if (variable.min and float(variable.min) > start) or (variable.max and float(variable.max) < start):
            findings.append(f"{name} = {variable.start} lies outside {variable.min} to {variable.max}")
    instance.close()
    return findings, f"{count} start values"


def wrong_guid(archives, fmu):
    """Ask for an instance with a GUID that the binary does not know."""
    try:
        Instance(archives.models[fmu], "wrong guid", guid="{00000000-0000-0000-0000-000000000000}")
        return ["an instance was made"], ""
    except Exception as error:
        if "Failed to instantiate" not in str(error):
            raise
    messages = MESSAGES["wrong guid"]
    findings = (
        []
        if any("fmuGUID" in text and "00000000" in text for _, _, text in messages)
        else [f"no message names the GUID: {messages}"]
    )
    return findings, "no instance, and a message"


def odd_callers(archives, fmu):
    """Instantiate with the resource locations and names that importers are known to pass."""
    findings, model = [], archives.models[fmu]
    folder = Path(model.folder).as_posix()
    for location in [
        f"file:{folder}/resources",
        f"file://{folder}/resources/",
        f"file:///{folder}/resources",
        "file:///a%20b/resources",
        "",
    ]:
        for name in ["plain", "system.element with spaces.dots", "/a/path to/an instance.fmu", "é"]:
            instance = FMU2Slave(
                guid=model.description.guid, unzipDirectory=model.folder, modelIdentifier=fmu, instanceName=name
            )
            component = instance.fmi2Instantiate(
                name.encode(), 1, model.description.guid.encode(), location.encode(), CALLBACKS, 0, 1
            )
            if component is None:
                findings.append(f"refused: name {name!r}, location {location!r}")
            else:
                instance.fmi2FreeInstance(component)
            instance.freeLibrary()
    return findings, ""


def refused_parameters(archives, fmu):
    """Set parameters that cannot be and see them refused, at the latest when the initialization ends, with words that help."""
    findings, cases = [], [(settings, names) for name, settings, names in REFUSED if name == fmu]
    for settings, names in cases:
        instance = Instance(archives.models[fmu], "refused")
        try:
            instance.fmu.setupExperiment()
            try:
                instance.set(settings)
                instance.fmu.enterInitializationMode()
                instance.fmu.exitInitializationMode()
                findings.append(f"{settings} was accepted")
            except FMICallException as error:
                texts = [
                    text for status, category, text in instance.messages if status == 3 and category == "logStatusError"
                ]
                line = " ".join(texts)
                if error.status != 3:
                    findings.append(f"{settings}: status {error.status} and not fmi2Error")
                for name in names:
                    # Name, value, and what is expected.
                    if not re.search(rf"(?<![\w.]){re.escape(name)}.* = .* is refused: expected .*", line):
                        findings.append(f"{settings}: the message does not say what is wrong with {name}: {line!r}")
        finally:
            instance.close()
    return findings, f"{len(cases)} cases"


def rotor_leaves_the_gap(archives):
    """Push the rotor out of the gap; the run ends with an error, and the instance is good again after a reset."""
    findings = []
    instance = Instance(archives.models["MagneticBearing"], "pushed")
    read = instance.reader(instance.model.outputs())

    def run_alone(currents, steps):
        rows = [read()]
        for step in range(steps):
            instance.set(currents)
            instance.step(step * STEP_S, STEP_S)
            rows.append(read())
        return np.array(rows)

    fall = {"i[1]": 0.0, "i[2]": 0.0, "i[3]": 0.0}
    instance.start()
    before = run_alone(fall, 20)
    instance.fmu.reset()
    instance.start()
    instance.set({"pZ": 1e5})
    try:
        run_alone(fall, 200)
        findings.append("200 steps passed with 1e5 N on the rotor")
    except FMICallException as error:
        if error.status != 3:
            findings.append(f"status {error.status} and not fmi2Error")
        if "gap" not in str(error):
            findings.append(f"the exception does not give the reason of the FMU: {error}")
    errors = [text for status, _, text in instance.messages if status == 3]
    if not any("gap" in text and "magnet" in text for text in errors):
        findings.append(f"no message says what happened: {errors}")
    if not all(math.isfinite(value) for value in read()):
        findings.append("outputs are not finite after the error")
    try:
        instance.step(1.0, STEP_S)
        findings.append("a step after the error was done")
    except FMICallException:
        pass
    instance.fmu.reset()
    instance.start()
    if same_bits(before, run_alone(fall, 20)):
        findings.append("after the error and a reset the run is another than before")
    try:
        instance.fmu.terminate()
    except FMICallException as error:
        findings.append(f"terminate: status {error.status}")
    instance.close()

    # Importers free an instance right after an error.
    instance = Instance(archives.models["MagneticBearing"], "freed")
    instance.start()
    instance.set({"pZ": 1e5} | fall)
    try:
        instance.step(0.0, 1.0)
        findings.append("a second passed with 1e5 N on the rotor")
    except FMICallException:
        pass
    instance.close()
    return findings, errors[0] if errors else ""


def reset_is_fresh(archives):
    """Run the loop, reset all instances, run it again, and compare with each other and with fresh instances in turn."""
    system, steps = archives.systems["SystemStructure.ssd"], 600
    times_s, lengths_s = [step * STEP_S for step in range(steps + 1)], [STEP_S] * steps
    fresh = run(system, archives.models, times_s, lengths_s)
    instances = {name: Instance(archives.models[fmu], name) for name, (fmu, _) in system.elements.items()}
    findings = []
    try:
        for attempt in ("first", "second", "third"):
            for name, instance in instances.items():
                if attempt != "first":
                    instance.fmu.reset()
                instance.start(system.elements[name][1])
            found = run(system, archives.models, times_s, lengths_s, instances)
            findings += [f"{attempt} run: {line}" for line in differences(fresh, found)]
            if attempt == "second":
                for instance in instances.values():
                    instance.fmu.terminate()
    finally:
        for instance in instances.values():
            instance.close()
    return findings, f"three runs of {steps} steps"


def two_at_once(archives):
    """Run two loops with different parameters in turn; neither may see the other."""
    steps = 300
    times_s, lengths_s = [step * STEP_S for step in range(steps + 1)], [STEP_S] * steps
    paper, other = archives.systems.values()
    apart = [run(system, archives.models, times_s, lengths_s) for system in (paper, other)]
    both = paper.elements | {f"{name} two": settings for name, settings in other.elements.items()}
    wires = paper.connections + [((f"{a} two", b), (f"{c} two", d)) for (a, b), (c, d) in other.connections]
    together = run(type(paper)(both, wires, paper.duration_s), archives.models, times_s, lengths_s)
    expected = apart[0] | {name.replace(".", " two.", 1): column for name, column in apart[1].items()}
    return differences(expected, together), f"{steps} steps"


def resident_kb():
    """Memory of this process, where the system tells it."""
    status = Path("/proc/self/status")
    return int(re.search(r"VmRSS:\s+(\d+)", status.read_text()).group(1)) if status.exists() else 0


def campaign(archives):
    """Load, instantiate, run and free many times; memory must not grow."""
    start = 0
    for count in range(INSTANCES):
        # The first rounds fill caches of the interpreter and of the allocator.
        if count == INSTANCES // 5:
            start = resident_kb()
        for model in archives.models.values():
            instance = Instance(model, "campaign")
            instance.start()
            instance.step(0.0, 10 * STEP_S)
            instance.fmu.terminate()
            instance.close()
    growth = resident_kb() - start
    findings = [f"memory grew by {growth} kB"] if growth > MEMORY_GROWTH_KB else []
    return findings, f"{3 * INSTANCES} instances, memory grew by {growth} kB"


def main():
    """Carry out all checks.

    Returns
    -------
    int
        0 if all passed, 1 if not.
    """
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--fmu", type=Path, default=PROJECT / "target" / "fmu", metavar="DIR", help="folder with the archives"
    )
    parser.add_argument("--only", metavar="TEXT", default="", help="carry out only checks whose name holds this text")
    arguments = parser.parse_args()
    report = Report()

    def check(name, *rest):
        if arguments.only in name:
            report.check(name, *rest)

    with tempfile.TemporaryDirectory() as scratch:
        try:
            archives = Archives(arguments.fmu.resolve(), Path(scratch))
        except Exception as error:  # Whatever is wrong with the archives is to be said like any other finding.
            print(f"the archives in {arguments.fmu} cannot be read: {error}")
            print("0 passed, 1 failed")
            return 1
        for fmu in FMUS:
            check(f"{fmu}: fmpy validation", fmpy_validation, archives, fmu)
            check(f"{fmu}: fmutool -check", fmutool_check, archives, fmu)
            check(f"{fmu}: XML schema of FMI 2.0", schema_of_fmi, archives, fmu)
            check(f"{fmu}: exported functions", exported_symbols, archives, fmu)
        for structure in VARIANTS:
            check(f"{structure}: XML schema of SSP 1.0", schema_of_ssp, archives, structure)
            check(f"{structure}: connectors, units, what tools insist on", ssp_rules, archives, structure)
            check(f"{structure}: parameters are the scenario's", parameters_of_ssp, archives, structure)
        with zipfile.ZipFile(archives.ssp) as archive:
            for member in filter(lambda name: name.endswith(".ssv"), archive.namelist()):
                check(f"{member}: XML schema of SSP 1.0", schema_of_ssp, archives, member)
        check("archives: members", members, archives)
        check("archives: no path of a machine in texts", no_machine_paths, archives)
        check("archives: reproducible", reproducible, archives)
        for scenario in SCENARIOS:
            check(f"{scenario}: FMUs in fmpy against the program", as_the_program, archives, scenario)
        for structure in VARIANTS:
            check(f"{structure}: in libcosim", in_tool, archives, "libcosim", structure, False)
            check(f"{structure}: in ecos, parameter set named", in_tool, archives, "ecos", structure, True)
        check(
            "SystemStructure.ssd: in ecos, no parameter set named",
            in_tool,
            archives,
            "ecos",
            "SystemStructure.ssd",
            False,
        )
        for fmu in FMUS:
            check(f"{fmu}: start values", start_values, archives, fmu)
            check(f"{fmu}: steps of other lengths", other_steps, archives, fmu)
            check(f"{fmu}: wrong GUID", wrong_guid, archives, fmu)
            check(f"{fmu}: names and locations of odd callers", odd_callers, archives, fmu)
            check(f"{fmu}: parameters refused", refused_parameters, archives, fmu)
        check("MagneticBearing: rotor leaves the gap", rotor_leaves_the_gap, archives)
        check("all FMUs: a reset instance is a fresh one", reset_is_fresh, archives)
        check("all FMUs: two loops in one process", two_at_once, archives)
        check("all FMUs: many instances", campaign, archives)
    print(f"{report.passed} passed, {report.failed} failed")
    return 1 if report.failed else 0


if __name__ == "__main__":
    sys.exit(main())
