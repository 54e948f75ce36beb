"""Checks of the archives as files: schemas, structure, members, exported functions."""

import hashlib
import re
import zipfile
from pathlib import Path

import fmpy
from elftools.elf.elffile import ELFFile
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from lxml import etree

from closed_loop import FMUS, NAMESPACES, SYSTEM, Instance
from compare_runs import ELEMENTS, VARIANTS, program
from toolbox import fmutool, run_tool, validate_fmu

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


def fmpy_validation(archives, fmu):
    """Let fmpy validate an FMU: XML schema, names, structure, units."""
    return validate_fmu(str(archives.models[fmu].archive)), ""


def fmutool_check(archives, fmu):
    """Let the FMU manipulation toolbox check an FMU."""
    text = run_tool(fmutool, "-input", archives.models[fmu].archive, "-check")
    findings = [line for line in text.splitlines() if not line.startswith("INFO")]
    findings += [
        f"it does not say: {words}" for words in ("compliant with FMI-2.0", "No semantic error") if words not in text
    ]
    return findings, ""


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
    """List the errors that the schemas of the standard find in a system structure or a parameter set."""
    kind = {".ssd": "Description", ".ssv": "ParameterValues"}[Path(name).suffix]
    return schema_findings(f"ssp/schema/SystemStructure{kind}.xsd", name, text)


def schema_findings(schema, name, text):
    """List the errors that a schema shipped with fmpy finds in a text."""
    checker = etree.XMLSchema(etree.parse(str(Path(fmpy.__file__).parent / schema)))
    checker.validate(etree.fromstring(text))
    return [f"{name}, line {error.line}: {error.message}" for error in checker.error_log]


def ssp_rules(archives, structure):
    """Check beyond the schemas: names, kinds, types and units against the FMUs, and requirements of tools."""
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
    """Compare a parameter set with the variables of its FMU."""
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
    """Package twice and compare the bytes with each other and with those under test."""
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
    """Compare the exports of each ELF binary with the functions that fmpy knows: FMI 2.0 for co-simulation, all of FMI 3.0."""
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
