#!/usr/bin/env python3
"""Compare the FMUs of FMI 3.0 with those of FMI 2.0, to the last bit.

All FMUs of the project and of the examples of fmu-export are packaged with scalars and with arrays. Each archive is validated by
fmpy and by the FMU manipulation toolbox, both with the schema of the standard. Then the same run, with inputs that change at every
step, must give the same bits in FMI 2.0 and FMI 3.0: in direct calls of fmpy, with scalars, with event mode and with arrays; in
fmpy's own simulation; and in containers of the toolbox with one FMU, run by fmpy.

Needs the packages of scripts/requirements.txt, cargo, and the program built by `cargo build --release`. The importer in
tests/importer does the same in fmi-rs.
"""

import argparse
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import fmpy
import numpy as np
from conformance import ALL
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from toolbox import fmucontainer, fmutool, run_tool, validate_fmu

PROJECT = Path(__file__).resolve().parent.parent
PROGRAM = PROJECT / "target" / "release" / f"magnetic-bearing{'.exe' if os.name == 'nt' else ''}"
# Examples of fmu-export, with the names of their FMUs.
EXAMPLES = {
    "van_der_pol": "VanDerPol",
    "pi_controller": "PiController",
    "bouncing_ball": "BouncingBall",
    "thermostat": "Thermostat",
    "heated_rod": "HeatedRod",
}
# Off with its start values, so that its outputs are constant.
STILL = ("Thermostat",)
STEPS = 200
# Getters and setters of fmpy by the type of a variable.
GETTERS = {"Real": "getReal", "Integer": "getInteger", "Enumeration": "getInteger", "Boolean": "getBoolean"}
GETTERS3 = {"Float64": "getFloat64", "Int32": "getInt32", "Enumeration": "getInt64", "Boolean": "getBoolean"}


def command(*arguments, folder=PROJECT):
    """Run a command, which must succeed.

    Parameters
    ----------
    *arguments : str
        The command.
    folder : pathlib.Path
        Working directory.

    Returns
    -------
    str
        Its output.
    """
    done = subprocess.run(
        [str(argument) for argument in arguments],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
    )
    if done.returncode:
        raise RuntimeError(f"{arguments[0]} ended with {done.returncode}: {done.stdout[-2000:]}")
    return done.stdout


def package(folder, *switches):
    """Package all FMUs below a folder.

    Parameters
    ----------
    folder : pathlib.Path
        An empty folder.
    *switches : str
        ``--arrays``, or nothing.

    Returns
    -------
    pathlib.Path
        The folder with the FMUs.
    """
    command(PROGRAM, "package", "--all", "--out", "target/fmu", *switches, folder=folder)
    for example in EXAMPLES:
        options = ["--release", "--locked", "--quiet", "--manifest-path", PROJECT / "Cargo.toml", "--package", "fmu-export"]
        command("cargo", "run", *options, "--example", example, "--", *switches, folder=folder)
    return folder / "target" / "fmu"


def elements_of(variable):
    """List the references of the elements of a variable."""
    return range(variable.valueReference, variable.valueReference + math.prod(variable.shape or ()))


def excitation(variable, element, step):
    """Value of an input element at a step: near its start, different for each.

    Parameters
    ----------
    variable : tuple of (float, float)
        Start and nominal value.
    element : int
        Value reference of the element.
    step : int
        Number of the step.

    Returns
    -------
    float
        The value.
    """
    start, nominal = variable
    return start + 1e-3 * nominal * ((step * (element + 1)) % 17 - 8.0)


def continuous_inputs(description):
    """List the continuous inputs of an FMU of FMI 2.0: start and nominal value by reference."""
    return {
        v.valueReference: (float(v.start or 0.0), float(v.nominal or 1.0))
        for v in description.modelVariables
        if v.causality == "input" and v.type == "Real" and v.variability == "continuous"
    }


class Run2:
    """An instance of FMI 2.0."""

    def __init__(self, archive, folder):
        self.description = fmpy.read_model_description(str(archive))
        identifier = self.description.coSimulation.modelIdentifier
        fmpy.extract(str(archive), str(folder))
        self.fmu = FMU2Slave(
            guid=self.description.guid, unzipDirectory=str(folder), modelIdentifier=identifier, instanceName="two"
        )
        self.references = {}
        for variable in self.description.modelVariables:
            if getter := GETTERS.get(variable.type):
                self.references.setdefault(getter, []).append(variable.valueReference)
        self.fmu.instantiate()
        self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def step(self, inputs, step, length):
        """Set the inputs, and do a step."""
        for reference, start in inputs.items():
            self.fmu.setReal([reference], [excitation(start, reference, step)])
        self.fmu.doStep(step * length, length)

    def values(self):
        """Read all numbers, by reference."""
        found = {}
        for getter, references in self.references.items():
            found.update(zip(references, map(float, getattr(self.fmu, getter)(references)), strict=True))
        return found


class Run3:
    """An instance of FMI 3.0, with or without event mode."""

    def __init__(self, archive, folder, event_mode):
        self.description = fmpy.read_model_description(str(archive))
        self.event_mode = event_mode
        # References of the variables and of their elements, by getter.
        self.references = {}
        for variable in self.description.modelVariables:
            if variable.name != "time" and (getter := GETTERS3.get(variable.type)):
                variables, elements = self.references.setdefault(getter, ([], []))
                variables.append(variable.valueReference)
                elements += elements_of(variable)
        identifier = self.description.coSimulation.modelIdentifier
        fmpy.extract(str(archive), str(folder))
        token = self.description.instantiationToken
        self.fmu = FMU3Slave(guid=token, unzipDirectory=str(folder), modelIdentifier=identifier, instanceName="three")
        self.fmu.instantiate(eventModeUsed=event_mode)
        self.fmu.enterInitializationMode(startTime=0.0)
        self.fmu.exitInitializationMode()
        self.is_first = True

    def step(self, inputs, step, length):
        """Set the inputs, and do a step."""
        if self.event_mode and not self.is_first:
            self.fmu.enterEventMode()
        for variable in self.description.modelVariables:
            elements = elements_of(variable)
            values = [excitation(inputs[element], element, step) for element in elements if element in inputs]
            if values:
                self.fmu.setFloat64([variable.valueReference], values)
        if self.event_mode:
            if any(self.fmu.updateDiscreteStates()[:5]):
                raise RuntimeError("the FMU asks for more at an event")
            self.fmu.enterStepMode()
        self.is_first = False
        event, terminate, early, time = self.fmu.doStep(step * length, length)
        if event or terminate or early or time != step * length + length:
            raise RuntimeError(f"the step returns {event} {terminate} {early} {time}")

    def values(self):
        """Read all numbers, by reference of the element."""
        found = {}
        for getter, (variables, elements) in self.references.items():
            values = getattr(self.fmu, getter)(variables, nValues=len(elements))
            found.update(zip(elements, map(float, values), strict=True))
        return found


def same(one, other):
    """Whether two dictionaries of numbers hold the same bits."""
    if one.keys() != other.keys():
        return False
    of_one, of_other = (np.array([numbers[key] for key in one]) for numbers in (one, other))
    return of_one.tobytes() == of_other.tobytes()


def direct(name, two, three, arrays, folder):
    """Compare direct calls.

    Parameters
    ----------
    name : str
        The model.
    two, three, arrays : pathlib.Path
        Its archives: FMI 2.0, FMI 3.0, FMI 3.0 with arrays.
    folder : pathlib.Path
        Folder for the extracted archives.

    Returns
    -------
    list of str
        Differences.
    """
    wanted = Run2(two, folder / "two")
    inputs = continuous_inputs(wanted.description)
    length = float(wanted.description.defaultExperiment.stepSize)
    runs = {
        "scalars": Run3(three, folder / "three", False),
        "event mode": Run3(three, folder / "event", True),
        "arrays": Run3(arrays, folder / "arrays", False),
    }
    findings = set()
    for step in range(STEPS):
        wanted.step(inputs, step, length)
        values = wanted.values()
        for title, run in runs.items():
            run.step(inputs, step, length)
            if not same(run.values(), values):
                findings.add(f"{name}: {title} in fmpy differ from FMI 2.0")
    has_arrays = sum(bool(v.shape) for v in runs["arrays"].description.modelVariables)
    print(f"  {name:20}{STEPS} steps of {len(values)} values, {len(inputs)} of them inputs; {has_arrays} arrays")
    for run in [wanted, *runs.values()]:
        run.fmu.terminate()
        run.fmu.freeInstance()
    return sorted(findings)


def columns(result):
    """Split a recording into columns of scalars; elements of arrays get their names."""
    found = {}
    for name in result.dtype.names:
        column = result[name]
        if column.ndim == 1:
            found[name] = column
        else:
            found.update({f"{name}[{k + 1}]": column[:, k] for k in range(column.shape[1])})
    return {name: np.ascontiguousarray(column, np.float64) for name, column in found.items()}


def simulated(name, two, three, arrays):
    """Compare fmpy's own simulation, with the start values.

    Parameters
    ----------
    name : str
        The model.
    two, three, arrays : pathlib.Path
        Its archives: FMI 2.0, FMI 3.0, FMI 3.0 with arrays.

    Returns
    -------
    list of str
        Differences.
    """
    description = fmpy.read_model_description(str(two))
    length = float(description.defaultExperiment.stepSize)
    options = {"stop_time": STEPS * length, "step_size": length, "output_interval": length}
    wanted = columns(fmpy.simulate_fmu(str(two), **options))
    findings = []
    for title, archive in [("FMI 3.0", three), ("FMI 3.0 with arrays", arrays)]:
        found = columns(fmpy.simulate_fmu(str(archive), **options))
        if found.keys() != wanted.keys() or any(found[key].tobytes() != wanted[key].tobytes() for key in wanted):
            findings.append(f"{name}: fmpy's simulation of {title} differs")
    return findings


def signals(box, description, length):
    """Make signals for the continuous inputs of a container.

    Parameters
    ----------
    box : pathlib.Path
        The container.
    description : fmpy.model_description.ModelDescription
        Description of its FMU in FMI 2.0.
    length : float
        Step, in seconds.

    Returns
    -------
    numpy.ndarray
        A structured array, as fmpy takes it.
    """
    starts = continuous_inputs(description)
    references = {v.name: v.valueReference for v in description.modelVariables if v.valueReference in starts}
    # The container renames variables only if their names would occur twice.
    names = [v.name for v in fmpy.read_model_description(str(box)).modelVariables if v.name in references]
    if len(names) != len(references):
        raise RuntimeError(f"{box}: inputs {names} of {sorted(references)}")
    rows = [
        (step * length, *(excitation(starts[references[name]], references[name], step) for name in names))
        for step in range(STEPS + 1)
    ]
    return np.array(rows, dtype=[("time", float), *((name, float) for name in names)])


def contained(name, two, three, folder):
    """Compare containers of the FMU manipulation toolbox that hold the FMU of FMI 2.0 or of FMI 3.0.

    Parameters
    ----------
    name : str
        The model.
    two, three : pathlib.Path
        Its archives: FMI 2.0, FMI 3.0.
    folder : pathlib.Path
        Folder for the containers.

    Returns
    -------
    list of str
        Differences.
    """
    description = fmpy.read_model_description(str(two))
    length = float(description.defaultExperiment.stepSize)
    runs = []
    for archive in (two, three):
        place = folder / archive.stem
        place.mkdir(parents=True)
        (place / archive.name).write_bytes(archive.read_bytes())
        (place / "box.csv").write_text(f"rule;from_fmu;from_port;to_fmu;to_port\nFMU;{archive.name};;;\n", encoding="utf-8")
        version = "2" if archive is two else "3"
        run_tool(fmucontainer, "-fmu-directory", place, "-container", f"box.csv:{length!r}", "-fmi", version)
        options = {"stop_time": STEPS * length, "step_size": length, "output_interval": length}
        box = place / "box.fmu"
        runs.append(columns(fmpy.simulate_fmu(str(box), fmi_type="CoSimulation", input=signals(box, description, length), **options)))
    wanted, found = runs
    common = wanted.keys() & found.keys()
    changing = sum(bool(np.any(wanted[key] != wanted[key][0])) for key in common - {"time"})
    print(f"  {name:20}container: {len(common)} columns, {changing} of them change")
    findings = [] if changing or name in STILL else [f"{name}: nothing changes in the container"]
    findings += [f"{name}: {key} is in one container only" for key in wanted.keys() ^ found.keys()]
    findings += [f"{name}: {key} differs in the container" for key in sorted(common) if wanted[key].tobytes() != found[key].tobytes()]
    return findings


def validated(archive):
    """Validate an archive with fmpy and with the toolbox.

    Parameters
    ----------
    archive : pathlib.Path
        The archive.

    Returns
    -------
    list of str
        Findings.
    """
    findings = [f"{archive.name}: {problem}" for problem in validate_fmu(str(archive))]
    report = run_tool(fmutool, "-input", archive, "-check")
    if "compliant with FMI-3.0" not in report or "No semantic error" not in report:
        findings.append(f"{archive.name}: fmutool -check says {report}")
    return findings


def main():
    """Run all comparisons.

    Returns
    -------
    int
        0 if all is well, 1 otherwise.
    """
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    findings = []
    with tempfile.TemporaryDirectory() as scratch:
        scratch = Path(scratch)
        folders = []
        for name, switches in [("scalars", []), ("arrays", ["--arrays"])]:
            (scratch / name).mkdir()
            folders.append(package(scratch / name, *switches))
        for name in (*ALL, *EXAMPLES.values()):
            two, three = folders[0] / f"{name}.fmu", folders[0] / f"{name}_fmi3.fmu"
            arrays = folders[1] / f"{name}_fmi3.fmu"
            findings += validated(three) + validated(arrays)
            findings += direct(name, two, three, arrays, scratch / "extracted" / name)
            findings += simulated(name, two, three, arrays)
            findings += contained(name, two, three, scratch / "containers" / name)
    for finding in findings:
        print(finding)
    print(f"{len(findings)} findings")
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
