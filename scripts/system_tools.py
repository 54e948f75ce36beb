"""Run the SSP in libcosim or in ecos and record all outputs: `system_tools.py TOOL SYSTEM OUT.npz [PARAMETER_SET]`.

A separate program, because these tools are native libraries: a crash then fails one check instead of ending all of them, and
their output can be checked. The SSP or the system structure is passed unchanged.
"""

import sys
import zipfile
from pathlib import Path

import numpy as np
from lxml import etree

SSD = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"


def structure(path):
    """Read the default structure of a packed or extracted SSP, or a structure alone."""
    path = Path(path)
    if path.is_dir():
        return structure(path / "SystemStructure.ssd")
    if path.suffix == ".ssd":
        return etree.fromstring(path.read_bytes())
    with zipfile.ZipFile(path) as archive:
        return etree.fromstring(archive.read("SystemStructure.ssd"))


def steps(path):
    """Length in s and number of the communication steps of a system."""
    experiment = structure(path).find(f"{SSD}DefaultExperiment")
    step_s = float(experiment.find(".//{*}FixedStepAlgorithm").get("baseStepSize"))
    return step_s, round(float(experiment.get("stopTime")) / step_s)


def outputs(path):
    """List the outputs of all elements of a system.

    Returns
    -------
    list of tuple of str
        Element, variable and type.
    """
    return [
        (component.get("name"), connector.get("name"), etree.QName(connector[0]).localname)
        for component in structure(path).iter(f"{SSD}Component")
        for connector in component.iter(f"{SSD}Connector")
        if connector.get("kind") == "output"
    ]


def run_libcosim(path, _parameter_set):
    """Run the system in libcosim with the step of the system structure.

    Returns
    -------
    dict
        Values of all outputs by `element.variable`; those at the start are not available and set to 0.
    """
    from libcosimpy.CosimEnums import CosimVariableCausality, CosimVariableType
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver

    log_output_level(CosimLogLevel.WARNING)
    execution = CosimExecution.from_ssp_file(path)
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    readers = []
    for info in execution.slave_infos():
        variables = execution.slave_variables(info.index)
        outputs = [v for v in variables if v.causality == CosimVariableCausality.OUTPUT.value]
        for kind, read in [
            (CosimVariableType.REAL, observer.last_real_values),
            (CosimVariableType.BOOLEAN, observer.last_boolean_values),
        ]:
            chosen = [v for v in outputs if v.type == kind.value]
            if chosen:
                names = [f"{info.name.decode()}.{v.name.decode()}" for v in chosen]
                readers.append((names, read, info.index, [v.reference for v in chosen]))
    names = [name for group in readers for name in group[0]]
    rows = [[0.0] * len(names)]
    step_s, count = steps(path)
    for step in range(count):
        if not execution.step():
            raise RuntimeError(f"step {step} failed")
        rows.append([float(value) for _, read, index, references in readers for value in read(index, references)])
    time_ns = execution.status().current_time
    # libcosim counts time in nanoseconds.
    if time_ns != count * round(1e9 * step_s):
        raise RuntimeError(f"after {count} steps of {step_s} s it is {time_ns} ns")
    return dict(zip(names, np.array(rows).T))


def run_ecos(path, parameter_set):
    """Run the system in ecos, whose user sets the step and names the parameter set.

    Returns
    -------
    dict
        Values of all outputs by `element.variable`.
    """
    from ecospy.EcosSimulation import EcosSimulation
    from ecospy.lib import EcosLib

    EcosLib.set_log_level("warn")
    step_s, count = steps(path)
    with EcosSimulation(step_s, ssp_path=path) as simulation:
        if not simulation.init(parameter_set=parameter_set):
            raise RuntimeError(EcosLib.get_last_error())
        readers = []
        for element, name, kind in outputs(path):
            if kind not in ("Real", "Boolean"):
                # Enumerations, which ecos does not support.
                continue
            read = simulation.get_bool if kind == "Boolean" else simulation.get_real
            readers.append((f"{element}.{name}", f"{element}::{name}", read))
        rows = [[float(read(identifier)) for _, identifier, read in readers]]
        for _ in range(count):
            simulation.step()
            rows.append([float(read(identifier)) for _, identifier, read in readers])
        simulation.terminate()
    return dict(zip([name for name, _, _ in readers], np.array(rows).T))


def main():
    """Run a system and write the recording.

    Returns
    -------
    int
        0; a tool that fails raises.
    """
    tool, path, out, *rest = sys.argv[1:]
    recording = {"libcosim": run_libcosim, "ecos": run_ecos}[tool](path, rest[0] if rest else None)
    np.savez(out, **recording)
    return 0


if __name__ == "__main__":
    sys.exit(main())
