"""Run closed loops of FMUs and Python functions in fmpy.

A :class:`System` lists components and connections. A component is an FMU or any Python callable;
:func:`read_system` reads a system from an SSP, and its components can be replaced::

    system = read_system("target/fmu/MagneticBearing.ssp")
    system.elements["controller"] = (pid, {})
    rows = run(system, stop_s=0.2)
    plt.plot(rows["time"], rows["plant.Y"])

At every communication point all outputs are read, then all connected inputs are set, then every component steps, as in
`magnetic-bearing simulate`. The response of a component to its inputs at `t` thus acts from the next point on.
"""

import tempfile
import zipfile
from contextlib import contextmanager
from ctypes import byref
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from fmpy import calloc, extract, free, read_model_description
from fmpy.fmi1 import FMICallException
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
STEP_S = 1e-4

NAMESPACES = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
    "osp": "http://opensimulationplatform.com/SSP/OSPAnnotations",
}

# Messages of all instances by instance name: the native proxy that formats them has one receiver per process.
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
    """An FMU: its archive, its extracted folder, and its variables by name."""

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
            Folder for its files.

        Returns
        -------
        Model
            The FMU, ready for instances.
        """
        # Reporting errors of a description is the task of the checks.
        description = read_model_description(str(archive), validate=False)
        extract(str(archive), str(folder))
        return cls(archive, str(folder), description, {v.name: v for v in description.modelVariables})

    def names(self, causality):
        """List the variables of a causality in their order."""
        return [v.name for v in self.description.modelVariables if v.causality == causality]

    def outputs(self):
        """List the outputs in their order."""
        return self.names("output")

    def value(self, name, value):
        """Convert the name of an enumeration item to its number; other values are returned unchanged."""
        if name not in self.variables:
            raise KeyError(f"{self.archive.name} has no variable {name}")
        if not isinstance(value, str):
            return value
        items = {item.name: int(item.value) for item in self.variables[name].declaredType.items}
        if value not in items:
            raise ValueError(f"{name} = {value}: expected one of {', '.join(items)}")
        return items[value]

    def choices(self):
        """List the variables of type Enumeration."""
        return [v.name for v in self.description.modelVariables if v.type == "Enumeration"]


class CallFailed(FMICallException):
    """A failed call of an FMU, with the FMU's reason as text."""

    def __init__(self, error, reason):
        super().__init__(error.function, error.status)
        self.reason = reason

    def __str__(self):
        return self.reason


class Instance:
    """One instance of an FMU, called directly.

    Parameters
    ----------
    model : Model
        The FMU.
    name : str
        Name of the instance; messages of instances with equal names are collected together.
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

    @contextmanager
    def _with_reason(self):
        """Replace the status of a failed call by the FMU's messages."""
        before = len(self.messages)
        try:
            yield
        except FMICallException as error:
            # Status 2 is a discarded call, 3 an error, 4 a fatal one.
            reasons = [text for status, _, text in self.messages[before:] if status >= 2]
            raise (CallFailed(error, f"{self.name}: {'; '.join(reasons)}") if reasons else error) from None

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

    def outputs(self):
        """List the outputs in their order."""
        return self.model.outputs()

    def start(self, settings=None, start_s=0.0):
        """Set parameters and begin the run; an enumeration may be given by the name of its item."""
        with self._with_reason():
            self.fmu.setupExperiment(startTime=start_s)
            self.set({name: self.model.value(name, value) for name, value in (settings or {}).items()})
            self.fmu.enterInitializationMode()
            self.fmu.exitInitializationMode()

    def step(self, time_s, length_s):
        """Do one communication step."""
        with self._with_reason():
            self.fmu.doStep(time_s, length_s)

    def close(self):
        """Free the instance and unload the library."""
        self.fmu.freeInstance()


class Function:
    """A Python callable as a component.

    Parameters
    ----------
    function : callable
        Called in every step as `function(t, inputs)` with the time in s and a dict of the connected inputs by name;
        returns a dict of outputs, which hold from the next communication point on. Missing ones keep their values.
    outputs : list of str
        Names of the outputs.
    """

    def __init__(self, function, outputs):
        self.function = function
        self.values = dict.fromkeys(outputs, 0.0)
        self.inputs = {}

    def outputs(self):
        """List the outputs."""
        return list(self.values)

    def reader(self, names):
        """Make a function that reads these outputs as a list of numbers."""
        return lambda: [float(self.values[name]) for name in names]

    def writer(self, names):
        """Make a function that writes a list of numbers to these inputs."""
        return lambda values: self.inputs.update(zip(names, values))

    def start(self, settings=None):
        """Set the outputs at the start; 0 by default."""
        self._take(settings or {})

    def step(self, time_s, _length_s):
        """Call the function."""
        self._take(self.function(time_s, dict(self.inputs)))

    def _take(self, values):
        if unknown := values.keys() - self.values.keys():
            raise KeyError(f"outputs that nothing is connected to: {', '.join(sorted(unknown))}")
        self.values.update(values)

    def close(self):
        """Do nothing: a callable has nothing to free."""


@dataclass
class System:
    """A closed loop.

    Parameters
    ----------
    elements : dict
        By name, a component and a dict of settings: `(what, settings)`. The component is the path of an FMU, a
        :class:`Model`, a callable (see :class:`Function`), or a name in the `models` of :func:`run`. The settings of an FMU
        are its parameters, those of a callable its initial outputs.
    connections : list
        Pairs of output and input, each `"element.variable"` or `(element, variable)`.
    duration_s, step_s : float, optional
        Default length of a run and of a step.
    archive : pathlib.Path, optional
        An SSP with the FMUs of the elements.
    """

    elements: dict
    connections: list
    duration_s: float = 1.0
    archive: Path | None = None
    step_s: float = STEP_S

    def __post_init__(self):
        def end(of):
            return tuple(of.split(".", 1)) if isinstance(of, str) else tuple(of)

        self.connections = [(end(start), end(stop)) for start, stop in self.connections]


def read_system(ssp, structure="SystemStructure.ssd"):
    """Read a system structure of an SSP.

    Parameters
    ----------
    ssp : pathlib.Path or str
        The archive.
    structure : str, optional
        The member with the structure.

    Returns
    -------
    System
        The loop with the parameters bound to its elements.
    """
    with zipfile.ZipFile(ssp) as archive:
        root = etree.fromstring(archive.read(structure))
        elements = {}
        for component in root.iterfind(".//ssd:Component", NAMESPACES):
            settings = {}
            for binding in component.iterfind(".//ssd:ParameterBinding", NAMESPACES):
                settings |= read_parameters(archive.read(binding.get("source")))
            elements[component.get("name")] = (Path(component.get("source")).stem, settings)
    connections = [
        ((c.get("startElement"), c.get("startConnector")), (c.get("endElement"), c.get("endConnector")))
        for c in root.iterfind(".//ssd:Connection", NAMESPACES)
    ]
    experiment = root.find("ssd:DefaultExperiment", NAMESPACES)
    step_s = float(experiment.find(".//osp:FixedStepAlgorithm", NAMESPACES).get("baseStepSize"))
    return System(elements, connections, float(experiment.get("stopTime")), Path(ssp), step_s)


def read_parameters(text):
    """Read the values of a parameter set by name."""
    parameters = etree.fromstring(text).iterfind(".//ssv:Parameter", NAMESPACES)
    return {parameter.get("name"): parse_value(parameter[0]) for parameter in parameters}


def parse_value(element):
    """Read the value of a parameter of a parameter set."""
    text = element.get("value")
    kind = etree.QName(element).localname
    return {"Real": float, "Integer": int, "Boolean": lambda text: text == "true"}[kind](text)


def even_times(duration_s, step_s=STEP_S):
    """Communication points as count × step, as in the program, with a constant step length."""
    count = round(duration_s / step_s)
    return [step * step_s for step in range(count + 1)], [step_s] * count


def open_models(system, folder):
    """Extract the FMUs of a system.

    Parameters
    ----------
    system : System
        The system.
    folder : pathlib.Path
        Folder for their files.

    Returns
    -------
    dict
        The FMUs by the name or path used in the elements.
    """
    models = {}
    wanted = {what for what, _ in system.elements.values() if isinstance(what, str | Path)}
    for number, what in enumerate(sorted(wanted, key=str)):
        path = Path(what)
        if not path.is_file():
            if system.archive is None:
                raise FileNotFoundError(f"{what}: there is no such FMU")
            with zipfile.ZipFile(system.archive) as archive:
                path = Path(archive.extract(f"resources/{what}.fmu", folder))
        models[what] = Model.open(path, folder / str(number))
    return models


def instantiate(system, models):
    """Make an instance of every component, by the name of its element."""
    instances = {}
    for name, (what, _) in system.elements.items():
        if callable(what):
            # Its outputs are those that are connected.
            outputs = dict.fromkeys(start[1] for start, _ in system.connections if start[0] == name)
            instances[name] = Function(what, outputs)
        else:
            instances[name] = Instance(what if isinstance(what, Model) else models[what], name)
    return instances


def run(
    system,
    models=None,
    times_s=None,
    lengths_s=None,
    instances=None,
    after_inputs=False,
    stop_s=None,
    step_s=None,
):
    """Run a loop: at every point read all outputs, then set all connected inputs, then step all instances.

    Parameters
    ----------
    system : System
        The loop.
    models : dict, optional
        Opened FMUs by name; by default those of the system are opened temporarily.
    times_s, lengths_s : list of float, optional
        Communication points, one more than steps, and step lengths; by default multiples of `step_s` up to `stop_s`.
    instances : dict, optional
        Started instances by element; by default new ones are made and closed again.
    after_inputs : bool, optional
        Record the outputs after the new inputs are set, as ecos does, instead of before. This matters for outputs with
        direct feedthrough, the forces of the magnets.
    stop_s, step_s : float, optional
        Length of the run and of a step; by default those of the system.

    Returns
    -------
    dict
        `time` and the values of all outputs by `element.variable`, one per communication point.
    """
    if models is None and instances is None:
        with tempfile.TemporaryDirectory() as folder:
            models = open_models(system, Path(folder))
            return run(system, models, times_s, lengths_s, None, after_inputs, stop_s, step_s)
    if times_s is None:
        times_s, lengths_s = even_times(stop_s or system.duration_s, step_s or system.step_s)
    own = instances is None
    if own:
        instances = instantiate(system, models)
    try:
        for start, end in system.connections:
            for element, variable in (start, end):
                if element not in instances:
                    raise KeyError(f"{element}.{variable} is connected, and there is no {element}")
            if start[1] not in instances[start[0]].outputs():
                raise KeyError(f"{'.'.join(start)} is connected, and is no output")
        if own:
            for name, instance in instances.items():
                instance.start(system.elements[name][1])
        readers, offsets, columns = [], {}, []
        for name, instance in instances.items():
            outputs = instance.outputs()
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
    return {"time": np.array(times_s)} | dict(zip(columns, np.array(rows).T))
