"""Checks of single FMUs: steps of other lengths, start values, and misuse."""

import math
import re
from pathlib import Path

import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave

from closed_loop import CALLBACKS, FMUS, MESSAGES, STEP_S, Instance, run
from compare_runs import ELEMENTS, differences, largest_difference, nominals, same_bits

# Shortest observed last step of an importer, and jitter of step lengths, in seconds.
LAST_STEP_S = 1.1e-16
JITTER_S = 1e-16
# The shortest steps add up to 7e-14 s, in which a rotor at 0.02 m/s moves 1e-10 of the nominal 1e-5 m; without control,
# disturbances grow 3000-fold in 0.06 s, at 130 rad/s. A delay of one sample would exceed 1e-2.
STEP_ROUNDING = 1e-6
# Lengths of runs of one FMU, in sample times: with the currents of the closed loop, and with currents held too long.
DRIVEN_SAMPLES = 600
FALLING_SAMPLES = 60
# Importers that fail in campaigns do so within about a thousand instances; half of that suffices to detect growing memory.
INSTANCES = 500
MEMORY_GROWTH_KB = 4096

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
    ("FlatnessController", {"F0.modulation": 1.5, "bandwidth.observer": 0.0}, ["F0.modulation", "bandwidth.observer"]),
    ("FlatnessController", {"F0.modulation": 0.5, "F0.modulationFrequency": 6000.0}, ["F0.modulationFrequency"]),
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


def drive(archives, fmu, pieces, rows, held=1, jitter=False):
    """Run one FMU of the paper's loop alone, with inputs from the recording of the loop.

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
        Sample times over which inputs are held.
    jitter : bool, optional
        Add up the times, perturb every step in its last bits, and follow it with a tiny step.

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
    """Compare runs with different step lengths and inputs held over the same times.

    The sampled FMUs act only at multiples of the sample time and must give the same bits whatever the steps. The plant
    integrates with sub-steps of half a sample time, so that steps of half or double length have the same sub-steps and
    differ by rounding; with double steps the inputs of the reference are held as long, and the run is short, because the
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


def start_values(archives, fmu):
    """Read all variables during initialization and compare them with the declared start values."""
    findings, count = [], 0
    instance = Instance(archives.models[fmu], "new")
    instance.fmu.setupExperiment()
    # libcosim reads everything here, including inputs.
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
    """Request an instance with an unknown GUID."""
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
    """Set invalid parameters; they must be refused by the end of initialization, with a helpful message."""
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
    """Push the rotor out of the gap; the run ends with an error, and the instance works again after a reset."""
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
    """Run two loops with different parameters in one process; neither may affect the other."""
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
    """Memory of this process; 0 if the system does not report it."""
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
