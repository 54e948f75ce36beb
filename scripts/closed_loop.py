"""Run the packaged FMUs with direct calls, as the master of the program does, and describe how they are wired.

What is connected to what and which parameters are set is read from the packaged system structure (SSP), or from the
text of a scenario; both are read here independently of the Rust program.
"""

import tomllib
import zipfile
from ctypes import byref
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from fmpy import calloc, extract, free, read_model_description
from fmpy.fmi2 import (
    FMU2Slave,
    fmi2Boolean,
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
    fmi2Integer,
    fmi2Real,
    fmi2ValueReference,
)
from fmpy.logging import addLoggerProxy
from lxml import etree

FMUS = ("MagneticBearing", "FlatnessController", "AlgebraicEstimator")
SYSTEM = "MagneticBearing.ssp"
# System structures within the SSP and the scenarios that their parameters come from.
VARIANTS = {"SystemStructure.ssd": "unbalanced", "PaperSimulation.ssd": "paper"}
# Elements of the loop, in the order of the scenario files, and the FMU that each is an instance of.
ELEMENTS = {"plant": "MagneticBearing", "controller": "FlatnessController", "estimator": "AlgebraicEstimator"}
STEP_S = 1e-4

NAMESPACES = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
}

# Messages of all instances by instance name. The native proxy that puts messages together knows one receiver per
# process.
MESSAGES = {}


def _receive(_environment, name, status, category, message):
    MESSAGES.setdefault(name.decode(), []).append((status, (category or b"").decode(), (message or b"").decode()))


CALLBACKS = fmi2CallbackFunctions()
CALLBACKS.logger = fmi2CallbackLoggerTYPE(_receive)
CALLBACKS.allocateMemory = fmi2CallbackAllocateMemoryTYPE(calloc)
CALLBACKS.freeMemory = fmi2CallbackFreeMemoryTYPE(free)
addLoggerProxy(byref(CALLBACKS))


@dataclass
class Model:
    """An FMU: its archive, the folder it is extracted to, and its variables by name."""

    archive: Path
    folder: str
    description: object
    variables: dict = field(default_factory=dict)

    @classmethod
    def open(cls, archive, folder):
        """Extract an archive and read its description.

        Parameters
        ----------
        archive : pathlib.Path
            The FMU.
        folder : pathlib.Path
            Where to extract it.

        Returns
        -------
        Model
            The FMU, ready for instances.
        """
        # What is wrong with a description is for the checks to say, not for this.
        description = read_model_description(str(archive), validate=False)
        extract(str(archive), str(folder))
        return cls(archive, str(folder), description, {v.name: v for v in description.modelVariables})

    def names(self, causality):
        """List the variables of a causality in their order."""
        return [v.name for v in self.description.modelVariables if v.causality == causality]

    def outputs(self):
        """List the outputs in their order."""
        return self.names("output")

    def choices(self):
        """List the variables of type Enumeration."""
        return [v.name for v in self.description.modelVariables if v.type == "Enumeration"]


class Instance:
    """One instance of an FMU, called directly.

    Parameters
    ----------
    model : Model
        The FMU.
    name : str
        Name of the instance; the messages of instances of equal name are kept together.
    guid : str, optional
        Another GUID than the one of the description.
    """

    ACCESS = {
        "Real": (fmi2Real, "fmi2GetReal", "fmi2SetReal"),
        "Integer": (fmi2Integer, "fmi2GetInteger", "fmi2SetInteger"),
        "Enumeration": (fmi2Integer, "fmi2GetInteger", "fmi2SetInteger"),
        "Boolean": (fmi2Boolean, "fmi2GetBoolean", "fmi2SetBoolean"),
    }

    def __init__(self, model, name, guid=None):
        self.model = model
        self.name = name
        MESSAGES[name] = []
        self.fmu = FMU2Slave(
            guid=guid or model.description.guid,
            unzipDirectory=model.folder,
            modelIdentifier=model.description.coSimulation.modelIdentifier,
            instanceName=name,
        )
        self.fmu.instantiate(callbacks=CALLBACKS, loggingOn=True)

    @property
    def messages(self):
        """Messages so far, as (status, category, text)."""
        return MESSAGES[self.name]

    def _grouped(self, names):
        groups = {}
        for place, name in enumerate(names):
            kind = self.ACCESS[self.model.variables[name].type]
            groups.setdefault(kind, []).append((place, self.model.variables[name].valueReference))
        for (kind, getter, setter), members in groups.items():
            places = [place for place, _ in members]
            references = (fmi2ValueReference * len(members))(*(reference for _, reference in members))
            yield places, references, (kind * len(members))(), getattr(self.fmu, getter), getattr(self.fmu, setter)

    def reader(self, names):
        """Make a function that reads these variables as a list of numbers."""
        groups = list(self._grouped(names))

        def read():
            values = [0.0] * len(names)
            for places, references, buffer, get, _ in groups:
                get(self.fmu.component, references, len(places), buffer)
                for place, value in zip(places, buffer):
                    values[place] = float(value)
            return values

        return read

    def writer(self, names):
        """Make a function that writes a list of numbers to these variables."""
        groups = list(self._grouped(names))

        def write(values):
            for places, references, buffer, _, put in groups:
                for index, place in enumerate(places):
                    value = values[place]
                    buffer[index] = value if buffer._type_ is fmi2Real else int(value)
                put(self.fmu.component, references, len(places), buffer)

        return write

    def get(self, *names):
        """Read variables."""
        return self.reader(names)()

    def set(self, values):
        """Write variables, given as a dict."""
        self.writer(list(values))(list(values.values()))

    def start(self, settings=None, start_s=0.0):
        """Set parameters and begin the run."""
        self.fmu.setupExperiment(startTime=start_s)
        self.set(settings or {})
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def step(self, time_s, length_s):
        """Do one communication step."""
        self.fmu.doStep(time_s, length_s)

    def close(self):
        """Free the instance and unload the library."""
        self.fmu.freeInstance()


@dataclass
class System:
    """A closed loop: instances with their FMU and settings, and connections (from, to) of (element, variable)."""

    elements: dict
    connections: list
    duration_s: float


def read_system(ssp, structure):
    """Read a system structure of the SSP.

    Parameters
    ----------
    ssp : pathlib.Path
        The archive.
    structure : str
        The member that describes the structure.

    Returns
    -------
    System
        The loop with the parameters that are bound to its elements.
    """
    with zipfile.ZipFile(ssp) as archive:
        root = etree.fromstring(archive.read(structure))
        elements = {}
        for component in root.iterfind(".//ssd:Component", NAMESPACES):
            settings = {}
            for binding in component.iterfind(".//ssd:ParameterBinding", NAMESPACES):
                parameters = etree.fromstring(archive.read(binding.get("source")))
                for parameter in parameters.iterfind(".//ssv:Parameter", NAMESPACES):
                    settings[parameter.get("name")] = parse_value(parameter[0])
            elements[component.get("name")] = (Path(component.get("source")).stem, settings)
    connections = [
        ((c.get("startElement"), c.get("startConnector")), (c.get("endElement"), c.get("endConnector")))
        for c in root.iterfind(".//ssd:Connection", NAMESPACES)
    ]
    experiment = root.find("ssd:DefaultExperiment", NAMESPACES)
    return System(elements, connections, float(experiment.get("stopTime")))


def parse_value(element):
    """Read the value of a parameter of a parameter set."""
    text = element.get("value")
    kind = etree.QName(element).localname
    return {"Real": float, "Integer": int, "Boolean": lambda text: text == "true"}[kind](text)


def read_scenario(text, models, connections):
    """Read a scenario as the program prints it.

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
        The loop, and the estimators that run beside it.
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
    """Tell whether an FMU has a variable, or an array of variables, of that name."""
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
    # The factor of the standard turns a value into the value shown.
    return float(number) / float(next(display.factor for display in units if display.name == unit))


def without_choices(system, models):
    """Leave out the settings of choices, for tools that know no variables of type Enumeration."""
    elements = {}
    for name, (fmu, settings) in system.elements.items():
        choices = models[fmu].choices()
        elements[name] = (fmu, {key: value for key, value in settings.items() if key not in choices})
    return System(elements, system.connections, system.duration_s)


def without_settings(system):
    """Leave all parameters at the start values of the FMUs."""
    elements = {name: (fmu, {}) for name, (fmu, _) in system.elements.items()}
    return System(elements, system.connections, system.duration_s)


def even_times(duration_s, step_s=STEP_S):
    """Communication points as count × step, as the program has them, with the last steps length the same."""
    count = round(duration_s / step_s)
    return [step * step_s for step in range(count + 1)], [step_s] * count


def run(system, models, times_s, lengths_s, instances=None, after_inputs=False):
    """Run a loop: at every point all outputs are read, then all connected inputs set, then all instances stepped.

    Parameters
    ----------
    system : System
        What is connected to what.
    models : dict
        The FMUs by name.
    times_s, lengths_s : list of float
        Communication points, one more than steps, and the steps.
    instances : dict, optional
        Instances by element that were already started; by default new ones are made and closed again.
    after_inputs : bool, optional
        Record the outputs when the new inputs are set, as ecos does, and not when they are read to be handed on. It
        makes a difference to outputs that follow an input at the same instant, the forces of the magnets.

    Returns
    -------
    dict
        Values of all outputs by `element.variable`, one per communication point.
    """
    own = instances is None
    if own:
        instances = {name: Instance(models[fmu], name) for name, (fmu, _) in system.elements.items()}
    try:
        if own:
            for name, instance in instances.items():
                instance.start(system.elements[name][1])
        readers, offsets, columns = [], {}, []
        for name, instance in instances.items():
            outputs = instance.model.outputs()
            readers.append(instance.reader(outputs))
            for output in outputs:
                offsets[name, output] = len(columns)
                columns.append(f"{name}.{output}")
        writers = []
        for name, instance in instances.items():
            wires = [(offsets[start], end[1]) for start, end in system.connections if end[0] == name]
            writers.append((instance.writer([end for _, end in wires]), [offset for offset, _ in wires]))
        rows = []
        for time_s, length_s in zip(times_s, [*lengths_s, None]):
            values = [value for read in readers for value in read()]
            if length_s is not None or after_inputs:
                for write, sources in writers:
                    write([values[source] for source in sources])
            rows.append([value for read in readers for value in read()] if after_inputs else values)
            if length_s is not None:
                for instance in instances.values():
                    instance.step(time_s, length_s)
    finally:
        if own:
            for instance in instances.values():
                instance.close()
    return dict(zip(columns, np.array(rows).T))


def same_bits(one, other):
    """Count the values of two arrays that differ in any bit."""
    one, other = np.ascontiguousarray(one, np.float64), np.ascontiguousarray(other, np.float64)
    return int(np.count_nonzero(one.view(np.uint64) != other.view(np.uint64)))


def differences(one, other, first_row=0):
    """Compare two recordings bit by bit.

    Returns
    -------
    list of str
        A line for every column that is missing or differs.
    """
    findings = [f"{name} is only in one of the two" for name in sorted(one.keys() ^ other.keys())]
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
    """Find the largest difference of two recordings in parts of the nominal values.

    Parameters
    ----------
    one, other : dict
        Recordings with the same names and rows.
    nominals : dict
        Nominal values by name.
    first_row : int, optional
        Where to begin.

    Returns
    -------
    tuple of (float, str)
        The difference and the variable.
    """
    apart = {name: float(np.max(np.abs(one[name] - other[name])[first_row:])) / nominals[name] for name in one}
    # A difference that is no number is the worst.
    worst = max(apart, key=lambda name: (apart[name] != apart[name], apart[name]))
    return apart[worst], worst
