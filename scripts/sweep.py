#!/usr/bin/env python3
"""Sweep the packaged FMUs over a design on a Dask cluster.

    scripts/sweep.py DESIGN.csv --out ROWS.csv [--scheduler ADDRESS]

Every case gives a row, identical to the last digit to that of `magnetic-bearing sweep`, which also converts a design from TOML to CSV
(`sweep DESIGN.toml --expand`). The FMUs of the SSP are sent to the workers with the tasks, so that a worker needs only the packages of
`requirements-sweep.txt`.

Without `--scheduler` a cluster is started on this machine, with a process per processor. Every row is on disk before it counts; an
interrupted sweep resumes where it stopped, and cases of a lost worker are repeated by another.
"""

import argparse
import atexit
import csv
import decimal
import functools
import hashlib
import io
import os
import pathlib
import re
import shutil
import sys
import tempfile
import time
import tomllib
import zipfile
from xml.etree import ElementTree

HERE = pathlib.Path(__file__).resolve().parent.parent
SCENARIOS = HERE / "src" / "simulation" / "scenarios"
SSD = {"ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription"}

# Interval at the end of a run over which tracking is evaluated, in s.
STRETCH_S = 0.04


# A number and its unit, with or without a blank.
NUMBER_AND_UNIT = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?(?:nan|inf|infinity)(?![a-zA-Z]))\s*(.*)", re.IGNORECASE)


class Refused(Exception):
    """A case that cannot be run, with the reason."""


def shortest(value):
    """A number with the digits needed to read it back exactly, in the format of the native sweep."""
    sign, digits, exponent = decimal.Decimal(repr(float(value))).as_tuple()
    text = "".join(map(str, digits)).lstrip("0")
    exponent += len(text) - 1
    text = text.rstrip("0") or "0"
    if text == "0":
        exponent = 0
    return ("-" if sign else "") + text[0] + ("." + text[1:] if len(text) > 1 else "") + f"e{exponent}"


def split(column):
    """Split `plant.m [g]` into path and unit."""
    found = re.fullmatch(r"\s*(.*?) \[(.*)\]\s*", column)
    return (found[1].strip(), found[2].strip()) if found else (column.strip(), None)


# The following runs on the workers.


@functools.cache
def directory():
    """A directory that is removed when the process ends: that of the worker, if this is one."""
    import distributed

    try:
        return distributed.get_worker().local_directory
    except ValueError:
        folder = tempfile.mkdtemp(prefix="sweep-")
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        return folder


@functools.lru_cache(maxsize=4)
def system(ssp):
    """The FMUs of an SSP, unzipped, with their model descriptions, and the connections."""
    import fmpy

    folders = directory()
    archive = zipfile.ZipFile(io.BytesIO(ssp))
    structure = ElementTree.fromstring(archive.read("SystemStructure.ssd"))
    elements = {}
    for component in structure.iterfind(".//ssd:Component", SSD):
        folder = tempfile.mkdtemp(dir=folders)
        zipfile.ZipFile(io.BytesIO(archive.read(component.get("source")))).extractall(folder)
        elements[component.get("name")] = folder, fmpy.read_model_description(folder)
    connections = [
        (wire.get("startElement"), wire.get("startConnector"), wire.get("endElement"), wire.get("endConnector"))
        for wire in structure.iterfind(".//ssd:Connection", SSD)
    ]
    return elements, connections


def results(elements):
    """The result columns of the machine of these FMUs.

    Returns
    -------
    dict
        By name: the kind of result (`last`: last value, `error`: λ̂/λ - 1, `tracking`: largest magnitude at the end), and element
        and name of the output.
    """

    def of(element, pattern, rename=lambda name: name, kind="last"):
        for variable in elements[element][1].modelVariables:
            if variable.causality == "output" and re.fullmatch(pattern, variable.name):
                unit = variable.unit or (variable.declaredType and getattr(variable.declaredType, "unit", None))
                unit = "" if unit in (None, "", "1") or kind == "error" else f" [{unit}]"
                yield f"{rename(variable.name)}{unit}", (kind, element, variable.name)

    def tracking(name):
        return re.sub("e([XYZ]?)$", lambda axis: f"tracking.{axis[1] or 'X'}", name)

    return {
        **dict(of("estimator", "valid")),
        **dict(of("estimator", r"(\w\.)?lambdaHat\[.*")),
        **dict(of("estimator", r"(\w\.)?lambdaStd\[.*")),
        **dict(of("estimator", r"(\w\.)?lambdaHat\[.*", lambda name: name.replace("lambdaHat", "error"), "error")),
        **dict(of("estimator", "condition|residual")),
        **dict(of("estimator", r"unbalance.*\.magnitude")),
        **dict(of("estimator", r"unbalance.*\.phase")),
        **dict(of("estimator", "[pM][XYZ]Hat")),
        **dict(of("controller", r"(\w\.)?e[XYZ]?", tracking, "tracking")),
    }


def convert(path, description, variable, value):
    """A value of a scenario or a design as a number in the unit of the interface."""
    if variable.type == "Boolean":
        return value if isinstance(value, bool) else {"true": True, "false": False}[value]
    if variable.type == "Enumeration":
        items = {item.name: int(item.value) for item in variable.declaredType.items}
        if value not in items:
            listed = ", ".join(f"{name} ({number})" for name, number in items.items())
            raise Refused(f"{path} = {value} is refused: expected one of {listed}")
        return items[value]
    if variable.type == "Integer":
        return int(value)
    if not isinstance(value, str):
        return float(value)
    parts = NUMBER_AND_UNIT.fullmatch(value.strip())
    if not parts:
        raise Refused(f"{path} = {value} is refused: {value.split(maxsplit=1)[0]} is not a number")
    number, unit = float(parts[1]), parts[2].replace("μ", "µ").replace("°", "deg")
    name = variable.unit or variable.declaredType.unit
    if unit in ("", name):
        return number
    displays = next(candidate.displayUnits for candidate in description.unitDefinitions if candidate.name == name)
    for display in displays:
        if display.name.replace("µ", "u") == unit.replace("µ", "u"):
            return number / float(display.factor)
    raise Refused(f"{path} = {value} is refused: the unit {unit} is none of {', '.join(d.name for d in displays)}")


def flatten(table, prefix=""):
    """Yield the leaves of a table with keys joined by dots."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from flatten(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


class Element:
    """One instance of an FMU."""

    # Shared by all instances, because fmpy passes all messages to the last logger.
    messages = []

    def __init__(self, name, folder, description):
        from ctypes import byref

        from fmpy.fmi2 import FMU2Slave, defaultCallbacks, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
        from fmpy.logging import addLoggerProxy

        self.name, self.description = name, description
        self.variables = {variable.name: variable for variable in description.modelVariables}

        def take(_environment, _instance, _status, _category, message):
            Element.messages.append(message.decode())

        self.callbacks = fmi2CallbackFunctions.from_buffer_copy(defaultCallbacks)
        self.callbacks.logger = fmi2CallbackLoggerTYPE(take)
        addLoggerProxy(byref(self.callbacks))
        self.fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=name,
        )
        self.fmu.instantiate(callbacks=self.callbacks, loggingOn=False)

    @classmethod
    def error_text(cls):
        """Take the messages since the last call, without the name of the function."""
        text = " ".join(cls.messages).partition(": ")[2]
        cls.messages.clear()
        return text

    def kind(self, name):
        return "Integer" if self.variables[name].type == "Enumeration" else self.variables[name].type

    def get(self, name):
        return getattr(self.fmu, f"get{self.kind(name)}")([self.variables[name].valueReference])[0]

    def set(self, name, value):
        getattr(self.fmu, f"set{self.kind(name)}")([self.variables[name].valueReference], [value])

    def free(self):
        self.fmu.freeInstance()


def seconds(value):
    """A time of a scenario."""
    if not isinstance(value, str):
        return float(value)
    number, _, unit = value.strip().partition(" ")
    return float(number) / {"": 1.0, "s": 1.0, "ms": 1e3, "µs": 1e6, "us": 1e6}[unit.strip()]


def settings(scenario, columns, cells, elements):
    """Values of a case per element: those of the scenario, overridden by the design."""
    values = {name: {} for name in elements}
    for name, (_, description) in elements.items():
        variables = {variable.name: variable for variable in description.modelVariables}
        for table in ("all", name):
            for key, value in flatten(scenario.get(table, {})):
                if key in variables:
                    values[name][key] = convert(f"{name}.{key}", description, variables[key], value)
                elif f"{key}[1]" in variables:
                    for k, item in enumerate(value, 1):
                        at = f"{key}[{k}]"
                        values[name][at] = convert(f"{name}.{at}", description, variables[at], item)
    for column, cell in zip(columns, cells):
        path, unit = split(column)
        name, _, key = path.partition(".")
        if cell == "":
            continue
        _, description = elements[name]
        variable = next(variable for variable in description.modelVariables if variable.name == key)
        if unit and variable.type == "Real" and " " not in cell:
            cell = f"{cell} {unit}"
        values[name][key] = convert(path, description, variable, cell)
    return values


def run_case(case, ssp, scenario_text, columns, cells):
    """Run one case; return its seed, status and results."""
    elements, connections = system(ssp)
    figures = dict.fromkeys(results(elements), "")
    scenario = tomllib.loads(scenario_text)
    try:
        values = settings(scenario, columns, cells, elements)
    except (Refused, KeyError, ValueError) as error:
        return case, "", str(error), figures
    defaults = {v.name: v.start for v in elements["plant"][1].modelVariables}
    seed = values["plant"].get("sensor.seed", defaults.get("sensor.seed"))
    made = {}
    try:
        status, figures = simulate(made, elements, connections, scenario, values)
    finally:
        for element in made.values():
            element.free()
    return case, str(seed), status, figures


def simulate(made, elements, connections, scenario, values):
    """The closed loop: read all outputs, set all inputs, step all FMUs."""
    Element.messages.clear()
    refused = []
    for name, (folder, description) in elements.items():
        element = made[name] = Element(name, folder, description)
        for key, value in values[name].items():
            element.set(key, value)
        element.fmu.setupExperiment(startTime=0.0)
        element.fmu.enterInitializationMode()
        try:
            element.fmu.exitInitializationMode()
        except Exception:
            refused += [f"[{name}] {finding}" for finding in Element.error_text().split("; ")]
    if refused:
        return "; ".join(refused), dict.fromkeys(results(elements), "")

    step_s, duration_s = seconds(scenario["step"]), seconds(scenario["duration"])
    steps = round(duration_s / step_s)
    points = round(STRETCH_S / step_s)
    columns = results(elements)
    watched = {name: source for name, (kind, *source) in columns.items() if kind == "tracking"}
    tracking = {name: [] for name in watched}
    # Outputs are read and inputs set with one call per instance and type.
    wires = group(made, connections)
    status = "ok"
    for step in range(steps + 1):
        for name, (element, key) in watched.items():
            tracking[name].append(abs(made[element].get(key)))
        if step == steps:
            break
        for read, write in wires:
            write(read())
        faults = []
        for name, element in made.items():
            try:
                element.fmu.doStep(currentCommunicationPoint=step * step_s, communicationStepSize=step_s)
            except Exception:
                faults.append(f"{name}: {Element.error_text()}")
        if faults:
            status = faults[-1]
            break
    figures = {}
    plant = {variable.name: variable.start for variable in elements["plant"][1].modelVariables}
    for name, (kind, element, output) in columns.items():
        value = float(made[element].get(output))
        if kind == "error":
            truth = output.replace("lambdaHat", "lambda")
            value = value / float(values["plant"].get(truth, plant[truth])) - 1.0
        figures[name] = shortest(value)
    for name, errors in tracking.items():
        figures[name] = shortest(max(errors[-points:]))
    return status, figures


def group(made, connections):
    """Readers and writers of the connections, by pair of instances and type."""
    bundles = {}
    for source, output, target, input_ in connections:
        kind = made[source].kind(output)
        bundles.setdefault((source, target, kind), []).append((output, input_))
    wires = []
    for (source, target, kind), pairs in bundles.items():
        reads = [made[source].variables[output].valueReference for output, _ in pairs]
        writes = [made[target].variables[input_].valueReference for _, input_ in pairs]
        read = functools.partial(getattr(made[source].fmu, f"get{kind}"), reads)
        write = functools.partial(getattr(made[target].fmu, f"set{kind}"), writes)
        wires.append((read, write))
    return wires


# The following runs in this process.


class Rows:
    """The file of rows, which a native or a Dask sweep can resume."""

    def __init__(self, path, columns, cases, scenario_text, figures):
        self.path, self.columns, self.cases, self.scenario_text, self.figures = path, columns, cases, scenario_text, figures
        self.header = ["case", "seed", "status", *figures, "fingerprint", *columns]

    def fingerprint(self, case):
        digest = hashlib.sha256(self.scenario_text.encode())
        for column, cell in zip(self.columns, self.cases[case]):
            digest.update(b"\0" + column.encode() + b"\0" + cell.encode())
        return digest.hexdigest()[:12]

    def resume(self):
        """The finished cases; discards an incomplete last row."""
        text = self.path.read_bytes() if self.path.exists() else b""
        whole = text.rfind(b"\n") + 1
        with open(self.path, "ab") as file:
            file.truncate(whole)
        if whole == 0:
            self.append([self.header])
            return set()
        header, *rows = csv.reader(io.StringIO(text[:whole].decode()))
        if header != self.header:
            raise SystemExit(f"{self.path}: the rows in it have other columns; name another file with --out")
        at = self.header.index("fingerprint")
        done = set()
        for row in rows:
            case = int(row[0]) - 1
            if not 0 <= case < len(self.cases) or row[at] != self.fingerprint(case):
                raise SystemExit(f"{self.path}: case {row[0]} in it is of another design or scenario; name another file")
            done.add(case)
        return done

    def append(self, rows):
        with open(self.path, "a", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows(rows)
            file.flush()
            os.fsync(file.fileno())

    def row(self, case, seed, status, figures):
        status = status.replace("\n", " ")
        return [case + 1, seed, status, *(figures[name] for name in self.figures), self.fingerprint(case), *self.cases[case]]

    def put_in_order(self):
        with open(self.path, newline="", encoding="utf-8") as file:
            header, *rows = csv.reader(file)
        rows.sort(key=lambda row: int(row[0]))
        aside = self.path.with_name(self.path.name + ".sorted")
        with open(aside, "w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows([header, *rows])
            file.flush()
            os.fsync(file.fileno())
        os.replace(aside, self.path)


def progress(done, of, since):
    """One line on a terminal: progress and remaining time."""
    if sys.stderr.isatty():
        left = (time.monotonic() - since) / done * (of - done)
        print(f"\r{done} of {of} cases, {left:.0f} s left ", end="" if done < of else "\n", file=sys.stderr)


def read_design(path):
    """Columns and cases of a design in CSV."""
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    columns, *cases = [[cell.strip() for cell in row] for row in csv.reader(lines)] or [[]]
    names = [split(column)[0] for column in columns]
    twice = {name for name in names if names.count(name) > 1}
    findings = [f"{name} is in the design twice" for name in sorted(twice)]
    if not cases:
        findings.append("the design has no cases")
    if findings:
        raise SystemExit(f"{path}: " + "; ".join(findings))
    return columns, cases


def sweep(client, design, out, scenario_text, ssp):
    """Run all cases of a design without a row in `out`; return their number."""
    from distributed import as_completed

    columns, cases = read_design(design)
    rows = Rows(out, columns, cases, scenario_text, list(results(system(ssp)[0])))
    done = rows.resume()
    todo = [case for case in range(len(cases)) if case not in done]
    # The same FMUs for all; a hash of their content distinguishes sweeps of different FMUs.
    [shipped] = client.scatter([ssp], broadcast=True, hash=True)
    futures = [
        client.submit(run_case, case, shipped, scenario_text, columns, cases[case], pure=False) for case in todo
    ]
    since, count = time.monotonic(), 0
    for batch in as_completed(futures, with_results=True, raise_errors=False).batches():
        fresh = []
        for future, result in batch:
            if future.status == "error":
                # A failure of the worker, not of the case: recorded in the row.
                case = todo[futures.index(future)]
                result = case, "", f"{type(future.exception()).__name__}: {future.exception()}", dict.fromkeys(rows.figures, "")
            fresh.append(rows.row(*result))
        rows.append(fresh)
        count += len(fresh)
        progress(count, len(todo), since)
    rows.put_in_order()
    return len(todo)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("design", type=pathlib.Path, help="CSV; `sweep DESIGN.toml --expand` makes one of TOML")
    parser.add_argument("--out", type=pathlib.Path, required=True, help="file for the rows")
    parser.add_argument("--scenario", default="unbalanced", help="a file or a built-in scenario")
    ssp = HERE / "target" / "fmu" / "MagneticBearing.ssp"
    parser.add_argument("--ssp", type=pathlib.Path, default=ssp, help="that of the scenario's machine")
    parser.add_argument("--scheduler", help="address of a Dask scheduler; by default a local cluster is started")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes of the local cluster")
    arguments = parser.parse_args()

    import dask
    from distributed import Client, LocalCluster

    built_in = SCENARIOS / f"{arguments.scenario}.toml"
    scenario = built_in if built_in.is_file() else pathlib.Path(arguments.scenario)
    # Workers may die several times on the same case without being killed by it.
    dask.config.set({"distributed.scheduler.allowed-failures": 10})
    if arguments.scheduler:
        cluster, address = None, arguments.scheduler
    else:
        cluster = LocalCluster(n_workers=arguments.workers, threads_per_worker=1, dashboard_address=None)
        address = cluster.scheduler_address
    with Client(address) as client:
        count = sweep(
            client, arguments.design, arguments.out, scenario.read_text(encoding="utf-8"), arguments.ssp.read_bytes()
        )
    if cluster:
        cluster.close()
    print(f"{arguments.out}: {count} cases run")
    with open(arguments.out, encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    failed = sum(row["status"] != "ok" for row in rows)
    if failed:
        print(f"error: {failed} of {len(rows)} cases failed: their rows say why", file=sys.stderr)
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
