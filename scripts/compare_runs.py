"""Helpers of the checks: scenarios of the program, settings that some tools ignore, comparisons."""

import subprocess
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np

from closed_loop import System

PROJECT = Path(__file__).resolve().parent.parent
PROGRAM = ["cargo", "run", "--release", "--locked", "--quiet", "--"]

# System structures within the SSP and the scenarios that their parameters come from.
VARIANTS = {"SystemStructure.ssd": "unbalanced", "PaperSimulation.ssd": "paper"}
# Elements of the loop, in the order of the scenario files, with their FMUs.
ELEMENTS = {"plant": "MagneticBearing", "controller": "FlatnessController", "estimator": "AlgebraicEstimator"}


def program(*arguments):
    """Run the program of this project and return its output."""
    done = subprocess.run(
        [*PROGRAM, *map(str, arguments)], cwd=PROJECT, capture_output=True, encoding="utf-8", stdin=subprocess.DEVNULL
    )
    if done.returncode:
        raise RuntimeError(done.stderr.strip() or f"the program ended with {done.returncode}")
    return done.stdout


def read_scenario(text, models, connections):
    """Read a scenario printed by the program.

    Parameters
    ----------
    text : str
        The scenario, TOML.
    models : dict
        The FMUs by name.
    connections : list
        Connections of the loop; those of the estimator are repeated for every method to be compared.

    Returns
    -------
    System
        The loop, with further estimators for comparison.
    """
    document = tomllib.loads(text)
    elements = {}
    for name, fmu in ELEMENTS.items():
        model = models[fmu]
        common = {key: value for key, value in leaves(document.get("all", {})) if knows(model, key)}
        own = dict(leaves(document.get(name, {})))
        settings = {}
        for key, value in [*common.items(), *own.items()]:
            values = {key: value} if not isinstance(value, list) else {f"{key}[{k}]": v for k, v in enumerate(value, 1)}
            settings |= {name: convert(model, name, value) for name, value in values.items()}
        elements[name] = (fmu, settings)
    fmu, settings = elements["estimator"]
    connections = list(connections)
    for method in document.get("compare", []):
        elements[method] = (fmu, settings | {"method": convert(models[fmu], "method", method)})
        connections += [(start, (method, end[1])) for start, end in connections if end[0] == "estimator"]
    duration, unit = document["duration"].split()
    step, step_unit = document["step"].split()
    if (unit, step, step_unit) != ("s", "100", "µs"):
        raise ValueError(f"duration {document['duration']} and step {document['step']} are not as expected here")
    return System(elements, connections, float(duration))


def leaves(table, prefix=""):
    """Yield the keys of nested tables, joined by dots, with their values."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from leaves(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def knows(model, key):
    """Whether an FMU has a variable or an array of that name."""
    return key in model.variables or f"{key}[1]" in model.variables


def convert(model, name, value):
    """Convert a value of a scenario to the type and unit of a variable."""
    variable = model.variables[name]
    if not isinstance(value, str):
        return value
    if variable.type == "Enumeration":
        return int(next(item.value for item in variable.declaredType.items if item.name == value))
    number, _, unit = value.partition(" ")
    if unit in ("", variable.unit):
        return float(number)
    units = {u.name: u for u in model.description.unitDefinitions}[variable.unit].displayUnits
    # The standard's factor converts a value to the displayed value.
    return float(number) / float(next(display.factor for display in units if display.name == unit))


def without_choices(system, models):
    """Leave out enumeration settings, for tools without variables of type Enumeration."""
    elements = {}
    for name, (fmu, settings) in system.elements.items():
        choices = models[fmu].choices()
        elements[name] = (fmu, {key: value for key, value in settings.items() if key not in choices})
    return replace(system, elements=elements)


def without_settings(system):
    """Leave all parameters at the start values of the FMUs."""
    elements = {name: (fmu, {}) for name, (fmu, _) in system.elements.items()}
    return replace(system, elements=elements)


def same_bits(one, other):
    """Count the values of two arrays that differ in any bit."""
    one, other = np.ascontiguousarray(one, np.float64), np.ascontiguousarray(other, np.float64)
    return int(np.count_nonzero(one.view(np.uint64) != other.view(np.uint64)))


def differences(one, other, first_row=0):
    """Compare two recordings bit by bit; `time` may be missing in one.

    Returns
    -------
    list of str
        A line for every column that is missing or differs.
    """
    findings = [f"{name} is only in one of the two" for name in sorted((one.keys() ^ other.keys()) - {"time"})]
    for name in one.keys() & other.keys():
        a, b = one[name][first_row:], other[name][first_row:]
        if len(a) != len(b):
            findings.append(f"{name}: {len(a)} rows against {len(b)}")
        elif count := same_bits(a, b):
            row = int(np.flatnonzero(a.view(np.uint64) != b.view(np.uint64))[0])
            findings.append(
                f"{name}: {count} of {len(a)} values differ, first at row {row + first_row}: {a[row]!r} {b[row]!r}"
            )
    return findings


def largest_difference(one, other, nominals, first_row=0):
    """Find the largest difference of two recordings relative to the nominal values.

    Parameters
    ----------
    one, other : dict
        Recordings with the same names and rows.
    nominals : dict
        Nominal values by name.
    first_row : int, optional
        First row to compare.

    Returns
    -------
    tuple of (float, str)
        The difference and the variable.
    """
    apart = {name: float(np.max(np.abs(one[name] - other[name])[first_row:])) / nominals[name] for name in one if name != "time"}
    # NaN counts as the largest difference.
    worst = max(apart, key=lambda name: (apart[name] != apart[name], apart[name]))
    return apart[worst], worst


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
