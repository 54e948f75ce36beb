#!/usr/bin/env python3
"""Check the crate fmu-export as its users would: its examples in fmpy, and its README in an empty folder.

Needs the packages of scripts/requirements.txt and cargo. The Van der Pol oscillator is compared with SciPy's solution, the PI
controller and the thermostat with the same laws in Python, the bouncing ball with its parabolas, the heated rod with its heat input
and with SciPy's solution. The README's crate is built in a separate folder, packed, validated, and compared with the closed form;
with `panic = "abort"` it must not compile, and messages of the compiler on mistakes must help. No dependency of the two crates may need a later Rust than they state, and both must be
publishable.
"""

import argparse
import json
import math
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import fmpy
import numpy as np
from fmpy.validation import validate_fmu
from scipy.integrate import solve_ivp

PROJECT = Path(__file__).resolve().parent.parent
CRATE = PROJECT / "fmu-export"

# Difference from SciPy's solution, whose own tolerance is 1e-12. The Runge-Kutta method of the example takes steps of 1 ms: its
# global error is of the order of the step to the power 4, 1e-12, times the constants of a stiff-free limit cycle over 20 s.
VAN_DER_POL_TOLERANCE = 1e-9
# The same operations in another order.
ROUNDING = 1e-12
# Lines that the README's `lib.rs` may have.
README_LINES = 30
# Lines of code that an example of a model may have, without comments and empty lines.
EXAMPLE_LINES = 59
# The rod takes steps of Euler's method of a hundredth of the fastest time constant.
HEATED_ROD_TOLERANCE_K = 0.05


def cargo(*arguments, folder=PROJECT):
    """Run cargo, which must succeed.

    Parameters
    ----------
    *arguments : str
        Arguments of ``cargo``.
    folder : pathlib.Path
        Working directory.
    """
    subprocess.run(["cargo", *arguments], cwd=folder, check=True, stdin=subprocess.DEVNULL)


def package(example):
    """Let an example pack itself.

    Parameters
    ----------
    example : str
        Name of the example.
    """
    cargo("run", "--release", "--locked", "--quiet", "--package", "fmu-export", "--example", example)


def validated(fmu):
    """Validate an archive with fmpy.

    Parameters
    ----------
    fmu : pathlib.Path
        The archive.

    Returns
    -------
    list of str
        Findings.
    """
    return [f"{fmu.name}: {problem}" for problem in validate_fmu(str(fmu))]


def far(name, found, wanted, tolerance):
    """Compare two signals.

    Parameters
    ----------
    name : str
        Name of the signal.
    found, wanted : array_like
        The signals.
    tolerance : float
        Largest permitted difference.

    Returns
    -------
    list of str
        Findings.
    """
    difference = float(np.max(np.abs(np.asarray(found) - np.asarray(wanted))))
    print(f"{name}: largest difference {difference:.2e}, allowed {tolerance:.0e}")
    return [] if difference <= tolerance else [f"{name}: {difference} is above {tolerance}"]


def van_der_pol(fmu):
    """Compare the oscillator with SciPy's solution over 20 s.

    Parameters
    ----------
    fmu : pathlib.Path
        The archive.

    Returns
    -------
    list of str
        Findings.
    """
    result = fmpy.simulate_fmu(str(fmu), stop_time=20.0, step_size=0.01, output_interval=0.01, output=["x", "v"])

    def slope(_, state):
        x, v = state
        return [v, (1.0 - x * x) * v - x]

    solution = solve_ivp(slope, (0.0, 20.0), [2.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-12, t_eval=result["time"].clip(0, 20))
    return far("VanDerPol x", result["x"], solution.y[0], VAN_DER_POL_TOLERANCE) + far(
        "VanDerPol v", result["v"], solution.y[1], VAN_DER_POL_TOLERANCE
    )


def pi_controller(fmu):
    """Compare the controller with its law, in steps that are not multiples of its sample time.

    Parameters
    ----------
    fmu : pathlib.Path
        The archive.

    Returns
    -------
    list of str
        Findings.
    """
    step = 0.004
    time = np.arange(251) * step
    reference = np.where(time < 0.5, 0.2, -1.0)
    signals = np.array(list(zip(time, reference)), dtype=[("time", float), ("r", float)])
    result = fmpy.simulate_fmu(
        str(fmu), stop_time=1.0, step_size=step, output_interval=step, input=signals, output=["u", "limited"]
    )
    wanted, integral, taken, output = [0.0], 0.0, 0, 0.0
    for number in range(len(result["time"]) - 1):
        # A sample belongs to the step that contains it, without the end.
        while taken * 0.01 < (number + 1) * step - 1e-5:
            error = reference[math.floor(taken * 0.01 / step + 1e-9)] if taken * 0.01 <= 1.0 else reference[-1]
            ahead = integral + 5.0 * 0.01 * error
            unlimited = 2.0 * error + ahead
            integral = integral if abs(unlimited) > 1.0 else ahead
            output = min(max(unlimited, -1.0), 1.0)
            taken += 1
        wanted.append(output)
    return far("PiController u", result["u"], wanted, ROUNDING)


def bouncing_ball(fmu):
    """Compare the ball with its parabolas.

    Parameters
    ----------
    fmu : pathlib.Path
        The archive.

    Returns
    -------
    list of str
        Findings.
    """
    result = fmpy.simulate_fmu(str(fmu), stop_time=2.0, step_size=0.01, output_interval=0.01, output=["h", "v", "impacts"])
    g, restitution, wanted = 9.81, 0.7, []
    for time in result["time"]:
        # Time of the last impact, and the upward velocity after it.
        begin, velocity, impacts = -math.sqrt(2.0 / g), math.sqrt(2.0 * g), 0
        while time - begin > 2.0 * velocity / g:
            begin, velocity, impacts = begin + 2.0 * velocity / g, restitution * velocity, impacts + 1
        wanted.append((velocity * (time - begin) - g / 2.0 * (time - begin) ** 2, impacts))
    height, impacts = np.transpose(wanted)
    return far("BouncingBall h", result["h"], height, 1e-9) + far("BouncingBall impacts", result["impacts"], impacts, 0)


def thermostat(fmu):
    """Compare the thermostat with its law; fmpy records no texts.

    Parameters
    ----------
    fmu : pathlib.Path
        The archive.

    Returns
    -------
    list of str
        Findings.
    """
    time = np.arange(61) * 60.0
    temperature = 293.15 + np.sin(time / 300.0)
    signals = np.array(list(zip(time, temperature)), dtype=[("time", float), ("temperature", float)])
    result = fmpy.simulate_fmu(
        str(fmu),
        stop_time=3600.0,
        step_size=60.0,
        output_interval=60.0,
        input=signals,
        start_values={"mode": 3, "room": "cellar", "hysteresis": 1.0},
        output=["on", "count"],
    )
    on, count, wanted = False, 0, [(False, 0)]
    for value in temperature[:-1]:
        before, on = on, value - 293.15 > (-0.5 if on else 0.5)
        count += on and not before
        wanted.append((on, count))
    states, counts = np.transpose(wanted)
    return far("Thermostat on", result["on"], states, 0) + far("Thermostat count", result["count"], counts, 0)


def heated_rod(fmu):
    """Compare the rod with SciPy's solution, and its heat with the heat input.

    Parameters
    ----------
    fmu : pathlib.Path
        The archive.

    Returns
    -------
    list of str
        Findings.
    """
    names = [f"temperature[{cell}]" for cell in range(1, 41)]
    result = fmpy.simulate_fmu(str(fmu), stop_time=200.0, step_size=1.0, output_interval=1.0, output=names)
    found = np.array([result[name] for name in names])

    def slope(_, cells):
        flows = 0.5 * (cells[:-1] - cells[1:])
        return (np.concatenate([[1.0], flows]) - np.concatenate([flows, [0.0]])) / 2.0

    solution = solve_ivp(slope, (0.0, 200.0), np.full(40, 293.15), method="LSODA", rtol=1e-9, atol=1e-9, t_eval=result["time"])
    heat = 2.0 * (found - 293.15).sum(axis=0)
    return far("HeatedRod", found, solution.y, HEATED_ROD_TOLERANCE_K) + far("HeatedRod heat", heat, result["time"], 1e-8)


def length(example):
    """Count the lines of an example.

    Parameters
    ----------
    example : str
        Name of the example.

    Returns
    -------
    list of str
        Findings.
    """
    text = (CRATE / "examples" / f"{example}.rs").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line.strip() and not line.strip().startswith("//")]
    print(f"{example}: {len(lines)} lines of code")
    return [] if len(lines) <= EXAMPLE_LINES else [f"{example}: more than {EXAMPLE_LINES} lines of code"]


def compiler_messages(folder, library, build):
    """Compile the README's library with mistakes.

    Parameters
    ----------
    folder : pathlib.Path
        Its crate.
    library : str
        Its source.
    build : list of str
        Arguments of ``cargo``.

    Returns
    -------
    list of str
        Mistakes whose messages do not help, or are followed by another one.
    """
    source, findings = folder / "src" / "lib.rs", []
    for right, wrong, help_, needless in [
        ("#[input(", "#[input(tunable, ", "`tunable` is unknown", "`rows`"),
        ("type State = ();", "type State = [f64; 64];", "NotSaved", "unknown"),
    ]:
        source.write_text(library.replace(right, wrong), encoding="utf-8")
        # With the dependencies of the build before.
        found = subprocess.run(["cargo", "build", "--lib", *build], cwd=folder, capture_output=True, text=True, check=False)
        if help_ not in found.stderr or needless in found.stderr:
            findings.append(f"README with {wrong}: {found.stderr}")
    source.write_text(library, encoding="utf-8")
    return findings


def readme():
    """Follow the README in an empty folder.

    Returns
    -------
    list of str
        Findings.
    """
    text = (CRATE / "README.md").read_text(encoding="utf-8")
    manifest, library, program = (
        re.search(rf"`{name}`.*?```\w+[^\n]*\n(.*?)```", text, re.DOTALL)[1]
        for name in ["Cargo.toml", "src/lib.rs", "src/main.rs"]
    )
    lines = len(library.strip().splitlines())
    print(f"README: {lines} lines of lib.rs")
    findings = []
    if lines > README_LINES:
        findings.append(f"README: more than {README_LINES} lines of lib.rs")
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "low-pass"
        (folder / "src").mkdir(parents=True)
        (folder / "Cargo.toml").write_text(manifest.replace("../fmu-export", str(CRATE)), encoding="utf-8")
        (folder / "src" / "lib.rs").write_text(library, encoding="utf-8")
        (folder / "src" / "main.rs").write_text(program, encoding="utf-8")
        # The locked versions of the project.
        (folder / "Cargo.lock").write_text((PROJECT / "Cargo.lock").read_text(encoding="utf-8"), encoding="utf-8")
        # Cargo's folder for intermediate files need not be that of the programs.
        build = ["--release", "--quiet", "--target-dir", str(PROJECT / "target" / "readme")]
        build += ["--config", f"build.build-dir='{(PROJECT / 'target' / 'readme-build').as_posix()}'"]
        # What it computes does not depend on the optimisation.
        build += ["--config", "profile.release.opt-level=0"]
        cargo("run", *build, folder=folder)
        # A panic must not end the importer. The library alone is compiled again.
        abort = ["cargo", "rustc", "--lib", *build, "--", "-Cpanic=abort"]
        refused = subprocess.run(abort, cwd=folder, capture_output=True, text=True, check=False)
        if refused.returncode == 0 or "panic = \"unwind\"" not in refused.stderr:
            findings.append("README: a library with panic = abort is not refused")
        findings += compiler_messages(folder, library, build)
        fmu = folder / "target" / "fmu" / "LowPass.fmu"
        findings += validated(fmu)
        third = fmu.with_name("LowPass_fmi3.fmu")
        findings += validated(third)
        result, again = (
            fmpy.simulate_fmu(str(archive), stop_time=1.0, step_size=0.01, output_interval=0.01) for archive in (fmu, third)
        )
        if result.tobytes() != again.tobytes():
            findings.append("README LowPass: FMI 3.0 and FMI 2.0 differ")
        findings += far("README LowPass y", result["y"], 1.0 - np.exp(-result["time"] / 0.1), ROUNDING)
    return findings


def rust_version():
    """Compare the oldest Rust version that the crate states with those of its dependencies.

    Returns
    -------
    list of str
        Dependencies that need a later one.
    """
    found = subprocess.run(
        ["cargo", "metadata", "--format-version", "1", "--locked", "--manifest-path", str(CRATE / "Cargo.toml")],
        check=True,
        capture_output=True,
        text=True,
    )
    metadata = json.loads(found.stdout)
    packages = {package["id"]: package for package in metadata["packages"]}
    edges = {node["id"]: [edge["pkg"] for edge in node["deps"]] for node in metadata["resolve"]["nodes"]}

    def version(package):
        return [int(part) for part in (package["rust_version"] or "1").split(".")]

    [crate] = [package for package in packages.values() if package["name"] == "fmu-export"]
    needed, pending = set(), [crate["id"]]
    while pending:
        at = pending.pop()
        if at not in needed:
            needed.add(at)
            pending += edges[at]
    late = [packages[at] for at in needed if version(packages[at]) > version(crate)]
    print(f"fmu-export: Rust {crate['rust_version']}, {len(needed)} crates, {len(late)} need a later one")
    return [f"{package['name']} needs Rust {package['rust_version']}" for package in late]


def main():
    """Check examples and README.

    Returns
    -------
    int
        0 if all is well, 1 otherwise.
    """
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    findings = []
    for example, name, compare in [
        ("van_der_pol", "VanDerPol", van_der_pol),
        ("pi_controller", "PiController", pi_controller),
        ("bouncing_ball", "BouncingBall", bouncing_ball),
        ("thermostat", "Thermostat", thermostat),
        ("heated_rod", "HeatedRod", heated_rod),
    ]:
        package(example)
        if example in ("bouncing_ball", "thermostat", "heated_rod"):
            findings += length(example)
        fmu = PROJECT / "target" / "fmu" / f"{name}.fmu"
        findings += validated(fmu) + compare(fmu)
    findings += readme() + rust_version()
    cargo("publish", "--dry-run", "--locked", "--allow-dirty", "--no-verify", "-p", "fmu-export-derive", "-p", "fmu-export")
    for finding in findings:
        print(finding)
    print(f"{len(findings)} findings")
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
