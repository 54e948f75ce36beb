"""Call every function of the packaged FMUs through fmpy, and compare final values of all tools.

Usage: `conformance.py DIST`, with the folder of the packaged FMUs. Each FMU runs alone in fmpy, libcosim and ecos. The loops of all
machines, and twins that `identify` writes of two recordings, run in these tools and directly in the program, MagneticBearing.ssp also
in fmi-rs. All final values must agree, relative to the nominal value of every variable. Needs the packages of
scripts/requirements.txt, and cargo for the program and for the importer in tests/importer.

The FMU manipulation toolbox (fmutool) runs no FMU: it checks the model description in an archive against the schema
and its own rules (names, causality and variability, dependencies, binaries).
"""

import csv
import subprocess
import sys
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from archive_files import ssp_findings
from closed_loop import FMUS, SYSTEM, Instance, Model, read_parameters, read_system, run
from compare_runs import ELEMENTS, PROJECT, program, without_choices
from fmpy import simulate_fmu, supported_platforms
from toolbox import fmutool, run_tool, validate_fmu

STEP_S = 1e-4
STEPS = 50
# Final values of different tools, relative to the nominal values. The arithmetic is the same, but times are summed up or
# multiplied.
SAME_RUN = 1e-9
# A central difference against an exact derivative, relative to the largest in its column.
QUOTIENT = 1e-5
# The other machines: scenario, and plant, controller and estimator.
OTHERS = {
    "spindle": ("MagneticSpindle", "SpindleController", "SpindleEstimator"),
    "planar4": ("MagneticBearing4", "FlatnessController4", "AlgebraicEstimator4"),
    "spindle4": ("MagneticSpindle4", "SpindleController4", "SpindleEstimator4"),
    "axial": ("AxialBearing", "AxialController", "AxialEstimator"),
}
PLANTS = ("MagneticBearing", *(plant for plant, _, _ in OTHERS.values()))
# The closed loops: scenario and FMUs of each.
SYSTEMS = {"MagneticBearing.ssp": ("unbalanced", ELEMENTS)} | {
    f"{fmus[0]}.ssp": (scenario, dict(zip(ELEMENTS, fmus, strict=True))) for scenario, fmus in OTHERS.items()
}
# The twins of two recordings: FMUs and arguments of `identify`.
DATA = "tests/data/levitation"
TWINS = {
    "planar-twin.ssp": (ELEMENTS, ["docs/recording.csv", "--tolerance", "sensor.offset=5um", "--tolerance", "s=1%"]),
    "axial-twin.ssp": (
        SYSTEMS["AxialBearing.ssp"][1],
        [f"{DATA}/levitation-stairs-mpc.csv.gz", "--scenario", f"{DATA}/bench.toml"],
    ),
}
ALL = (*FMUS, *(fmu for fmus in OTHERS.values() for fmu in fmus))
IMPORTER = PROJECT / "tests" / "importer" / "Cargo.toml"
# The loop in different tools against the direct run, relative to the nominal values. Instances of fmpy and fmi-rs get the
# program's points in time. libcosim counts nanoseconds and ecos adds up steps, with differences up to 3e-14 s; at 314 rad/s a
# harmonic force then differs by 1e-11 of its amplitude.
SAME_LOOP = {"fmpy": 0.0, "fmi-rs": 0.0, "libcosim": 1e-10, "ecos": 1e-10}
# Functions called by fmpy itself or under another name.
INDIRECT = {"fmi2FreeInstance", "fmi2Instantiate", "fmi2GetVersion", "fmi2GetTypesPlatform"}


class Findings:
    """Collect failures, so that one run shows all of them."""

    def __init__(self):
        self.lines = []
        self.checks = 0

    def expect(self, holds, text):
        """Count a check, and note it if it fails."""
        self.checks += 1
        if not holds:
            self.lines.append(text)


class Counted(Instance):
    """An instance that records which functions were called."""

    def __init__(self, model, name, called):
        super().__init__(model, name)
        for function in [n for n in dir(self.fmu) if n.startswith("fmi2")]:
            setattr(self.fmu, function, self.counting(function, getattr(self.fmu, function), called))

    @staticmethod
    def counting(name, function, called):
        """Wrap a function of the library so that its name is recorded."""

        def wrapped(*arguments):
            called.add(name)
            return function(*arguments)

        return wrapped


def refused(call):
    """Whether a call returns an error."""
    try:
        call()
    except Exception:
        return True
    return False


def reals(model, causality):
    """List the continuous Reals of a causality: names and references."""
    chosen = [v for v in model.description.modelVariables if v.causality == causality and v.type == "Real"]
    chosen = [v for v in chosen if v.variability == "continuous"]
    return [v.name for v in chosen], [v.valueReference for v in chosen]


def states(model, called, findings):
    """Replay from snapshots and from bytes, bit for bit."""
    name = model.description.modelName
    one, other = (Counted(model, f"{name} {k}", called) for k in range(2))
    outputs = model.outputs()
    one.start()
    for k in range(STEPS):
        one.step(k * STEP_S, STEP_S)
    state = one.fmu.getFMUState()
    written = one.fmu.serializeFMUState(state)
    ends = []
    for instance in (one, one, other):
        instance.fmu.setFMUState(instance.fmu.deSerializeFMUstate(written) if instance is other else state)
        for k in range(STEPS, 2 * STEPS):
            instance.step(k * STEP_S, STEP_S)
        ends.append(instance.get(*outputs))
    findings.expect(ends[0] == ends[1], f"{name}: a run replays from a snapshot")
    findings.expect(ends[0] == ends[2], f"{name}: a run replays from bytes in another instance")
    damaged = bytes([written[0] ^ 1]) + written[1:]
    findings.expect(refused(lambda: other.fmu.deSerializeFMUstate(damaged)), f"{name}: damaged bytes are refused")
    one.fmu.freeFMUState(state)
    one.fmu.terminate()
    one.fmu.reset()
    one.start()
    one.close()
    other.close()


def questions(model, called, findings):
    """Call all other functions."""
    name = model.description.modelName
    instance = Counted(model, f"{name} asked", called)
    fmu = instance.fmu
    findings.expect(fmu.getVersion() == b"2.0" or fmu.getVersion() == "2.0", f"{name}: version 2.0")
    fmu.setDebugLogging(True, ["logEvents"])
    instance.start()
    instance.step(0.0, STEP_S)
    time_s = fmu.getRealStatus(2)
    findings.expect(abs(getattr(time_s, "value", time_s) - STEP_S) < 1e-15, f"{name}: the last successful time")
    findings.expect(refused(lambda: fmu.getIntegerStatus(0)), f"{name}: no status is an Integer")
    fmu.getStatus(0)
    fmu.getBooleanStatus(3)
    fmu.getStringStatus(1)
    findings.expect(refused(fmu.cancelStep), f"{name}: no step can be cancelled")
    fmu.fmi2GetString(fmu.component, None, 0, None)
    fmu.fmi2SetString(fmu.component, None, 0, None)
    names, inputs = reals(model, "input")
    fmu.setReal(inputs, fmu.getReal(inputs))
    fmu.setRealInputDerivatives(inputs, [1] * len(inputs), [0.0] * len(inputs))
    booleans = [v for v in model.description.modelVariables if v.type == "Boolean"]
    instance.get(*[v.name for v in booleans])
    settable = [v.valueReference for v in booleans if v.causality in ("input", "parameter") and v.variability != "fixed"]
    fmu.setBoolean(settable, fmu.getBoolean(settable))
    integers = [v.name for v in model.description.modelVariables if v.type in ("Integer", "Enumeration")]
    instance.get(*integers)
    fmu.fmi2SetInteger(fmu.component, None, 0, None)
    order = model.description.coSimulation.maxOutputDerivativeOrder
    names, outputs = reals(model, "output")
    if order:
        rates = fmu.getRealOutputDerivatives(outputs, [1] * len(outputs))
        rates = dict(zip(names, rates))
        axis = "Y" if "Y" in rates else "X"
        findings.expect(rates[axis] == instance.get(f"v{axis}")[0], f"{name}: the rate of a position is the velocity")
    else:
        findings.expect(
            refused(lambda: fmu.getRealOutputDerivatives([0], [1])), f"{name}: no derivatives of outputs are promised"
        )
    if model.description.coSimulation.providesDirectionalDerivative:
        directional(model, instance, findings)
    else:
        findings.expect(refused(lambda: fmu.getDirectionalDerivative([], [], [])), f"{name}: no directional derivatives")
    instance.close()


def directional(model, instance, findings):
    """Compare all derivatives with respect to inputs with difference quotients and with declared dependencies."""
    names, inputs = reals(model, "input")
    outputs, unknowns = reals(model, "output")
    # Different currents.
    magnets = [name for name in names if name.rpartition(".")[2].startswith("i[")]
    instance.set({name: 1.5 - 0.1 * k for k, name in enumerate(magnets)})
    declared = {u.variable.name: {d.name for d in u.dependencies or []} for u in model.description.outputs}
    for known, reference in zip(names, inputs):
        exact = instance.fmu.getDirectionalDerivative(unknowns, [reference], [1.0])
        value = instance.get(known)[0]
        step = 1e-4 * max(abs(value), 1.0)
        sides = []
        for side in (value - step, value + step):
            instance.set({known: side})
            sides.append(np.array(instance.get(*outputs)))
        instance.set({known: value})
        quotient = (sides[1] - sides[0]) / (2 * step)
        scale = max(np.abs(quotient).max(), 1e-9)
        for output, got, wanted in zip(outputs, exact, quotient):
            findings.expect(abs(got - wanted) <= QUOTIENT * scale, f"d {output}/d {known}: {got} against {wanted}")
            findings.expect(got == 0 or known in declared[output], f"{output} follows {known}, which is not declared")


def alone_in_fmpy(archive, model):
    """Final outputs of a run in fmpy."""
    result = simulate_fmu(
        str(archive), stop_time=STEPS * STEP_S, step_size=STEP_S, output_interval=STEP_S, output=model.outputs()
    )
    return {name: float(result[name][-1]) for name in model.outputs()}


def alone_in_libcosim(archive, model):
    """Final outputs of a run in libcosim."""
    from libcosimpy.CosimEnums import CosimVariableCausality, CosimVariableType
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    log_output_level(CosimLogLevel.ERROR)
    execution = CosimExecution.from_step_size(step_size=round(STEP_S * 1e9))
    slave = execution.add_local_slave(CosimLocalSlave(fmu_path=str(archive), instance_name="alone"))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    for _ in range(STEPS):
        execution.step()
    values = {}
    for kind, read in [
        (CosimVariableType.REAL, observer.last_real_values),
        (CosimVariableType.BOOLEAN, observer.last_boolean_values),
    ]:
        chosen = [v for v in execution.slave_variables(slave) if v.type == kind.value]
        chosen = [v for v in chosen if v.causality == CosimVariableCausality.OUTPUT.value]
        if chosen:
            found = read(slave, [v.reference for v in chosen])
            values.update({v.name.decode(): float(value) for v, value in zip(chosen, found)})
    return values


def alone_in_ecos(archive, model):
    """Final outputs of a run in ecos."""
    from ecospy.EcosSimulation import EcosSimulation
    from ecospy.EcosSimulationStructure import EcosSimulationStructure

    structure = EcosSimulationStructure()
    structure.add_model("alone", str(archive))
    with EcosSimulation(STEP_S, structure=structure) as simulation:
        if not simulation.init():
            raise RuntimeError("the FMU cannot be initialized")
        for _ in range(STEPS):
            simulation.step()
        kinds = {name: model.variables[name].type for name in model.outputs()}
        read = {"Real": simulation.get_real, "Boolean": simulation.get_bool, "Integer": simulation.get_integer}
        values = {name: float(read[kind](f"alone::{name}")) for name, kind in kinds.items() if kind in read}
        simulation.terminate()
    return values


def final_values(archive, model, findings):
    """Run the FMU alone in every tool and compare with direct calls."""
    name = model.description.modelName
    instance = Instance(model, f"{name} direct")
    instance.start()
    for k in range(STEPS):
        instance.step(k * STEP_S, STEP_S)
    wanted = dict(zip(model.outputs(), instance.get(*model.outputs())))
    instance.close()
    for tool, run in [("fmpy", alone_in_fmpy), ("libcosim", alone_in_libcosim), ("ecos", alone_in_ecos)]:
        try:
            got = run(archive, model)
        except ImportError as error:
            findings.expect(False, f"{tool} is not there: {error}")
            continue
        for output, value in got.items():
            nominal = float(model.variables[output].nominal or 1.0)
            miss = abs(value - wanted[output]) / nominal
            findings.expect(miss <= SAME_RUN, f"{name}: {output} in {tool}: {value} against {wanted[output]}")
        findings.expect(len(got) > 0, f"{name}: {tool} tells no outputs")


def command(*arguments):
    """Run a command and return its output."""
    done = subprocess.run(arguments, capture_output=True, encoding="utf-8", errors="replace", stdin=subprocess.DEVNULL)
    if done.returncode:
        raise RuntimeError(f"{arguments[0]} ended with {done.returncode}: {(done.stdout + done.stderr)[-2000:]}")
    return done.stdout


@dataclass
class Loop:
    """A closed loop: its SSP, the FMUs of its elements, its scenario, and the name of its parameter set."""

    archive: Path
    elements: dict
    scenario: str
    parameters: str


def twin(name, scratch, findings):
    """Identify from a recording, validate SSV and SSP of the twin, and return its loop."""
    elements, arguments = TWINS[name]
    archive, alone, scenario = (scratch / Path(name).with_suffix(ending) for ending in (".ssp", ".ssv", ".toml"))
    program("identify", *arguments, "--ssp", archive, "--ssv", alone, "--save", scenario)
    texts = {alone.name: alone.read_bytes()}
    with zipfile.ZipFile(archive) as opened:
        texts |= {member: opened.read(member) for member in opened.namelist() if member.endswith((".ssd", ".ssv"))}
    wrong = [line for member, text in texts.items() for line in ssp_findings(member, text)]
    findings.expect(not wrong, f"{name}: {wrong}")
    # The set of the system names the parameters of the elements.
    apart = {
        f"{element}.{variable}": value
        for element, (_, settings) in read_system(archive).elements.items()
        for variable, value in settings.items()
    }
    findings.expect(read_parameters(texts[alone.name]) == apart, f"{alone.name} is another set than that of {name}")
    return Loop(archive, elements, scenario.read_text(encoding="utf-8"), "identified")


def loop_in_the_program(loop, models, scratch):
    """Final outputs of the direct run in Rust, without enumerations, which some tools cannot set."""
    choices = {choice for model in models.values() for choice in model.choices()}
    lines = loop.scenario.splitlines()
    kept = [line for line in lines if line.partition("=")[0].strip().strip('"') not in {*choices, "compare"}]
    place = scratch / "without_choices.toml"
    place.write_text("\n".join(kept), encoding="utf-8")
    table = scratch / "direct.csv"
    program("simulate", place, "--csv", table)
    with open(table, encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))
    final = {head.split(" [")[0]: float(cell) for head, cell in zip(rows[0], rows[-1])}
    duration_s = read_system(loop.archive).duration_s
    if abs(final["time"] - duration_s) > 1e-9 or any(name.partition(".")[0] not in (*loop.elements, "time") for name in final):
        raise RuntimeError(f"the scenario of {loop.archive.name} is not as expected here: it ends at {final['time']} s")
    return {name: value for name, value in final.items() if name != "time"}


def loop_in_fmpy(loop, models, _scratch):
    """Final outputs of the loop over instances of fmpy."""
    rows = run(without_choices(read_system(loop.archive), models), models)
    return {name: float(values[-1]) for name, values in rows.items() if name != "time"}


def loop_in_fmi_rs(_loop, _models, _scratch):
    """Final outputs of the loop over instances of fmi-rs, written by the importer in tests/importer."""
    target = PROJECT / "target" / "importer"
    written = target / "tmp" / "final.csv"
    written.unlink(missing_ok=True)
    name = "final_values_are_written_for_comparison"
    options = ["--manifest-path", str(IMPORTER), "--target-dir", str(target), "--locked", "--quiet"]
    command("cargo", "test", *options, "--", "--exact", name)
    with open(written, encoding="utf-8", newline="") as file:
        return {name: float(value) for name, value in csv.reader(file)}


def loop_in_tool(tool):
    """Final outputs of the SSP in libcosim or ecos, in a separate process."""

    def final(loop, _models, scratch):
        out = scratch / f"{tool}.npz"
        named = [loop.parameters] if tool == "ecos" else []
        script = str(PROJECT / "scripts" / "system_tools.py")
        command(sys.executable, script, tool, str(loop.archive), str(out), *named)
        return {name: float(column[-1]) for name, column in np.load(out).items()}

    return final


def following_inputs(elements, models):
    """Outputs of the loop with direct feedthrough, from the model descriptions."""
    return {
        f"{element}.{unknown.variable.name}"
        for element, fmu in elements.items()
        for unknown in models[fmu].description.outputs
        if any(known.causality == "input" for known in unknown.dependencies or [])
    }


def loop_in_every_tool(loop, all_models, findings):
    """Run a closed loop in every tool; print and check the largest deviation from the direct run."""
    runs = {
        "fmpy": loop_in_fmpy,
        "fmi-rs": loop_in_fmi_rs,
        "libcosim": loop_in_tool("libcosim"),
        "ecos": loop_in_tool("ecos"),
    }
    elements = loop.elements
    models = {fmu: all_models[fmu] for fmu in elements.values()}
    if loop.archive.name != SYSTEM:
        # The importer in Rust runs only the planar rotor.
        del runs["fmi-rs"]
    with tempfile.TemporaryDirectory() as scratch:
        wanted = loop_in_the_program(loop, models, Path(scratch))
        print(f"Final values of {loop.archive.name}, against the direct run, in parts of the nominal")
        print(f"  {'tool':10}{'outputs':>8}{'largest':>12}{'limit':>10}  at")
        for tool, final in runs.items():
            try:
                got = final(loop, models, Path(scratch))
            except Exception as error:  # A tool that fails is a finding like any other.
                findings.expect(False, f"the loop in {tool}: {error}")
                continue
            # Two of the tools do not support variables of type Enumeration.
            unknown = {"estimator.verdict", "estimator.X.verdict"} & wanted.keys() if tool in ("libcosim", "ecos") else set()
            others = (got.keys() ^ wanted.keys()) - unknown
            findings.expect(not others, f"{tool} has other outputs: {others}")
            # ecos shows outputs with direct feedthrough for the inputs of the next step.
            left_out = following_inputs(elements, models) if tool == "ecos" else set()
            apart = {}
            for name in (got.keys() & wanted.keys()) - left_out:
                element, variable = name.split(".", 1)
                nominal = float(models[elements[element]].variables[variable].nominal or 1.0)
                apart[name] = abs(got[name] - wanted[name]) / nominal
            worst = max(apart, key=lambda name: apart[name])
            print(f"  {tool:10}{len(apart):8}{apart[worst]:12.1e}{SAME_LOOP[tool]:10.0e}  {worst if apart[worst] else '-'}")
            for name, miss in apart.items():
                findings.expect(miss <= SAME_LOOP[tool], f"the loop in {tool}: {name} is {miss:.1e} of its nominal away")


def sound_archives(folder, findings):
    """Check the archives with fmutool."""
    compliant = {}
    for name in ALL:
        report = run_tool(fmutool, "-input", folder / f"{name}.fmu", "-check")
        compliant[name] = sum("compliant with FMI-2.0" in line or "No semantic error" in line for line in report.splitlines())
        findings.expect(compliant[name] == 2, f"{name}: fmutool -check says {report}")
    print(f"  {'fmutool':10}runs no FMU; it finds {sum(count == 2 for count in compliant.values())} of {len(ALL)} archives sound")


def main():
    """Run all checks.

    Returns
    -------
    int
        0 if all hold, 1 otherwise.
    """
    folder = Path(sys.argv[1])
    findings = Findings()
    for name in ALL:
        archive = folder / f"{name}.fmu"
        called = set(INDIRECT)
        with tempfile.TemporaryDirectory() as place:
            model = Model.open(archive, Path(place))
            problems = validate_fmu(str(archive))
            findings.expect(not problems, f"{name}: {problems}")
            findings.expect(len(supported_platforms(str(archive))) > 0, f"{name}: no binary")
            states(model, called, findings)
            questions(model, called, findings)
            final_values(archive, model, findings)
            probe = Instance(model, f"{name} probe")
            exported = {n for n in dir(probe.fmu) if n.startswith("fmi2")}
            probe.close()
            findings.expect(exported <= called, f"{name}: never called: {sorted(exported - called)}")
    with tempfile.TemporaryDirectory() as place:
        models = {name: Model.open(folder / f"{name}.fmu", Path(place) / name) for name in ALL}
        for system, (scenario, elements) in SYSTEMS.items():
            text = program("simulate", "--print", scenario)
            loop_in_every_tool(Loop(folder / system, elements, text, scenario), models, findings)
        for system in TWINS:
            loop_in_every_tool(twin(system, Path(place), findings), models, findings)
    sound_archives(folder, findings)
    for line in findings.lines:
        print(f"FAILED {line}")
    print(f"{findings.checks - len(findings.lines)} of {findings.checks} checks passed")
    return 1 if findings.lines else 0


if __name__ == "__main__":
    sys.exit(main())
