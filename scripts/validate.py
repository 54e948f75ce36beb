#!/usr/bin/env python3
"""Check the packaged FMUs and the SSP from outside, with third-party tools.

Needs the packages of scripts/requirements.txt; scripts/test installs them. Checks the archives in target/fmu, or in the
folder of --fmu, against results of the program, run by cargo.

The SSP in other tools, as found by these checks:

- libcosim reads the system structure, the parameter sets bound to the elements, and the communication step from the
  annotation of Open Simulation Platform. All elements step at once, then outputs are transferred, as in the program. It
  counts time in nanoseconds, so that communication points differ from count × step in the last bits; at the
  same points, the direct run has the same bits. Outputs at the start are not available.
- ecos gets the step from its user, adds it up, and applies a parameter set only if its user names it (`unbalanced`);
  otherwise the FMUs run with their start values. Outputs are transferred after all steps, as in the program. Recorded
  outputs with direct feedthrough, the forces of the magnets, then belong to the new inputs. At the same points in time
  and recorded in the same way, the direct run has the same bits. It accepts only the name SystemStructure.ssd.
- Neither supports variables of type Enumeration: `method` and `update.mode` keep the start values of the FMUs, with a
  warning. SystemStructure.ssd needs no others; in PaperSimulation.ssd the estimator then runs the method
  `predictionError` instead of the paper's.
"""

import argparse
import csv
import io
import re
import subprocess
import sys
import tempfile
import time
import traceback
import zipfile
from functools import cache
from pathlib import Path

import numpy as np

import archive_files
import single_fmus
from closed_loop import FMUS, STEP_S, SYSTEM, Model, even_times, read_system, run
from compare_runs import (
    PROJECT,
    VARIANTS,
    differences,
    largest_difference,
    nominals,
    program,
    read_scenario,
    same_bits,
    without_choices,
    without_settings,
)

SCENARIOS = ("paper", "unbalanced", "turned")
DURATION_S = 0.4
STEPS = round(DURATION_S / STEP_S)

# Added-up times differ by up to 3e-14 s after 4000 steps. At 314 rad/s this changes a harmonic force of nominal 10 N by 1e-11
# of its amplitude, which a damped loop does not amplify. A misalignment of one sample, or a parameter that was not applied,
# would exceed 1e-2.
TIME_ROUNDING = 1e-10


class Report:
    """Collect the findings of the checks and print a row for each."""

    def __init__(self):
        self.passed = 0
        self.failed = 0

    def check(self, name, function, *arguments):
        """Carry out a check.

        Parameters
        ----------
        name : str
            Name of the check.
        function : callable
            Returns its findings as a list of texts, and a note with measured figures.
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
        Their folder.
    scratch : pathlib.Path
        A folder for extracted and recorded files.
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
    """Compare the parameter sets of the SSP with their scenario."""
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
        The system structure. One other than the default is passed from the extracted archive: to libcosim by its
        path, to ecos under the default name, the only ways to select it.
    named : bool
        Whether the user names the parameter set, as ecos requires.
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
            check(f"{fmu}: fmpy validation", archive_files.fmpy_validation, archives, fmu)
            check(f"{fmu}: fmutool -check", archive_files.fmutool_check, archives, fmu)
            check(f"{fmu}: XML schema of FMI 2.0", archive_files.schema_of_fmi, archives, fmu)
            check(f"{fmu}: exported functions", archive_files.exported_symbols, archives, fmu)
        for structure in VARIANTS:
            check(f"{structure}: XML schema of SSP 1.0", archive_files.schema_of_ssp, archives, structure)
            check(f"{structure}: connectors, units, what tools insist on", archive_files.ssp_rules, archives, structure)
            check(f"{structure}: parameters are the scenario's", parameters_of_ssp, archives, structure)
        with zipfile.ZipFile(archives.ssp) as archive:
            for member in filter(lambda name: name.endswith(".ssv"), archive.namelist()):
                check(f"{member}: XML schema of SSP 1.0", archive_files.schema_of_ssp, archives, member)
        check("archives: members", archive_files.members, archives)
        check("archives: no path of a machine in texts", archive_files.no_machine_paths, archives)
        check("archives: reproducible", archive_files.reproducible, archives)
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
            check(f"{fmu}: start values", single_fmus.start_values, archives, fmu)
            check(f"{fmu}: steps of other lengths", single_fmus.other_steps, archives, fmu)
            check(f"{fmu}: wrong GUID", single_fmus.wrong_guid, archives, fmu)
            check(f"{fmu}: names and locations of odd callers", single_fmus.odd_callers, archives, fmu)
            check(f"{fmu}: parameters refused", single_fmus.refused_parameters, archives, fmu)
        check("MagneticBearing: rotor leaves the gap", single_fmus.rotor_leaves_the_gap, archives)
        check("all FMUs: a reset instance is a fresh one", single_fmus.reset_is_fresh, archives)
        check("all FMUs: two loops in one process", single_fmus.two_at_once, archives)
        check("all FMUs: many instances", single_fmus.campaign, archives)
    print(f"{report.passed} passed, {report.failed} failed")
    return 1 if report.failed else 0


if __name__ == "__main__":
    sys.exit(main())
