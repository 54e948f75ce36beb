#!/usr/bin/env python3
"""Accuracy of `identify` for planar4, spindle and spindle4, from recordings of `simulate` with random λ (±20 %) and noise.

    cargo build --release
    scripts/machines.py --seed 9101 --runs 20 [--machine spindle] [--commanded | --bench] [--missing 0.1]
    cargo run --release -- package --all && .venv/bin/python scripts/machines.py --seed 9101 --runs 20 --lag 50e-6

Positions have 0.05 to 0.5 µm of noise, currents 5 to 20 mA. Prints error/± (rms over all magnets of all valid answers) in total and from noise, the
worst, and how often currents were taken as measured ones; `--commanded` records the commands of the controller instead. With `--bench` mass, inertia,
gaps, angles, positions along the shaft, gains and offsets are off by the tolerances of a typical bench, which `identify` knows. With `--lag` the
currents follow the commands, which are recorded, with this time constant in s: plant and controller are FMUs in fmpy, with amplifiers between them.
`--missing` omits this fraction of the rows at random.
"""

import argparse
import json
import math
import random
import re
import subprocess
import tempfile
from pathlib import Path

PROGRAM = Path(__file__).resolve().parents[1] / "target" / "release" / "magnetic-bearing"
SYSTEMS = {"planar4": "MagneticBearing4", "spindle": "MagneticSpindle", "spindle4": "MagneticSpindle4"}
TIMES_S = (0.1, 1.0, 5.0)
RATE_HZ = 10_000
# Steps of the plant per sample, each with the mean of the lagging current.
STEPS = 20

# Standard deviations of a typical bench, and names of shaft parameters.
RELATIVE = {"m": 0.01, "s": 0.01, "Jt": 0.01, "Jp": 0.01}
ABSOLUTE = {"alpha": math.radians(0.5), "position": 5e-4, "sensorPosition": 5e-4, "unbalance.position": 5e-4}
SHAFT = ("Jt", "Jp", "position", "sensorPosition", "unbalance", "X.sensor.gain")
# Mean and half the difference of two independent sensor gains.
SENSORS = {"sensor.offset": "5um", "sensor.gain": 0.005 / math.sqrt(2), "sensor.gainDifference": 0.005 / math.sqrt(2)}
CURRENTS = {"current.gain": 0.005, "current.offset": "5mA"}
TOLERANCES = {"m": 0.01, "s": 0.01, "alpha": "0.5deg", **SENSORS, **CURRENTS}
TOLERANCES |= {"Jt": 0.01, "Jp": 0.01, "position": "0.5mm", "sensorPosition": "0.5mm", "unbalance": "0.5mm"}
TOLERANCES |= {"X.sensor.gain": 0.005}


def magnets(machine: str) -> list[str]:
    """Names of the force constants."""
    if machine == "planar4":
        return [f"lambda[{k}]" for k in range(1, 5)]
    radial = range(1, 5 if machine == "spindle4" else 4)
    return [f"{bearing}.lambda[{k}]" for bearing in "AB" for k in radial] + ["X.lambda[1]", "X.lambda[2]"]


def start_values(machine: str) -> dict[str, float]:
    """Start values of the machine's estimator by name."""
    model = {"planar4": "AlgebraicEstimator4", "spindle": "SpindleEstimator", "spindle4": "SpindleEstimator4"}[machine]
    text = (Path(__file__).resolve().parents[1] / "modelDescription" / f"{model}.xml").read_text()
    found = re.findall(r'<ScalarVariable[^>]*name="([^"]+)".*?(?:start="([^"]+)"|</ScalarVariable>)', text, re.DOTALL)
    return {name: float(start) for name, start in found if re.fullmatch(r"[-+.\deE]+", start)}


def bench(machine: str, draw: random.Random) -> tuple[dict[str, float], list[str]]:
    """Sensor errors of the plant, and options of `identify`: wrong values, and all tolerances."""
    errors, options = {}, []
    for name, value in start_values(machine).items():
        plain = re.sub(r"^[ABX]\.|\[\d\]", "", name)
        if plain in RELATIVE:
            options.append(f"--set={name}={value * (1 + draw.gauss(0, RELATIVE[plain]))}")
        elif plain in ABSOLUTE:
            options.append(f"--set={name}={value + draw.gauss(0, ABSOLUTE[plain])}")
    for bearing in [""] if machine == "planar4" else ["A.", "B.", "X."]:
        for axis in [""] if bearing == "X." else "YZ":
            errors[f"{bearing}sensor.offset{axis}"] = draw.gauss(0, 5e-6)
            errors[f"{bearing}sensor.gainError{axis}"] = draw.gauss(0, 0.005)
    for name in magnets(machine):
        for kind, std in (("Offset", 0.005), ("GainError", 0.005)):
            errors[name.replace("lambda", f"sensor.current{kind}")] = draw.gauss(0, std)
    options += [f"--tolerance={name}={std}" for name, std in TOLERANCES.items() if machine != "planar4" or name not in SHAFT]
    return errors, options


def lagging(machine: str, values: dict[str, float], lag_s: float) -> list[str]:
    """Header and rows of a loop whose currents follow the commands with a lag."""
    from closed_loop import Instance, open_models, read_system

    system = read_system(PROGRAM.parents[1] / "fmu" / f"{SYSTEMS[machine]}.ssp")
    with tempfile.TemporaryDirectory() as folder:
        models = open_models(system, Path(folder))
        plant, controller = (Instance(models[system.elements[name][0]], name) for name in ("plant", "controller"))
        plant.start(system.elements["plant"][1] | values)
        guess = {name.replace("lambda", "lambda0"): values[name] for name in magnets(machine)}
        controller.start(system.elements["controller"][1] | guess | {"update.mode": "never"})
        commands = [name.replace("lambda", "i") for name in magnets(machine)]
        readings = [end for (of, _), (to, end) in system.connections if (of, to) == ("plant", "controller")]
        positions = [name for name in readings if name.endswith("m")]
        measure, turn, command = plant.reader(readings), plant.reader(["theta", "omegam"]), controller.reader(commands)
        answer, drive = controller.writer(readings), plant.writer(commands)
        sample_s, step_s = 1 / RATE_HZ, 1 / RATE_HZ / STEPS
        left = math.exp(-step_s / lag_s)
        mean, currents = lag_s / step_s * (1 - left), command()
        read = [name.replace("i[", "im[") for name in commands]
        head = ["time [s]", *(f"{name} [m]" for name in positions), *(f"{name} [A]" for name in read)]
        rows = [",".join([*head, "theta [rad]", "omega [rad/s]"])]
        for row in range(round(TIMES_S[-1] * RATE_HZ) + 1):
            seen, held, time_s = measure(), command(), row * sample_s
            cells = [time_s, *(value for name, value in zip(readings, seen) if name in positions), *held, *turn()]
            rows.append(",".join(map(repr, cells)))
            answer(seen)
            controller.step(time_s, sample_s)
            for step in range(STEPS):
                drive([to + (current - to) * mean for current, to in zip(currents, held)])
                plant.step(time_s + step * step_s, step_s)
                currents = [to + (current - to) * left for current, to in zip(currents, held)]
        plant.close()
        controller.close()
    return rows


def record(machine: str, seed: int, commanded: bool, off: bool, lag_s: float | None) -> tuple[dict[str, float], list[str], list[str]]:
    """The true force constants, header and rows of the recording, and options of `identify`."""
    draw = random.Random(seed)
    truth = {name: 2e-6 * draw.uniform(0.8, 1.2) for name in magnets(machine)}
    values = {"sensor.seed": seed, "sensor.positionNoise": 10 ** draw.uniform(-7.3, -6.3)}
    values["sensor.currentNoise"] = draw.uniform(0.005, 0.02)
    errors, options = bench(machine, draw) if off else ({}, [])
    if lag_s:
        return truth, lagging(machine, values | truth | errors, lag_s), options
    changes = [f"--set=plant.{name}={value}" for name, value in (values | truth | errors).items()]
    command = [PROGRAM, "simulate", machine, f"--set=duration={TIMES_S[-1]}", *changes, "--csv", "-"]
    currents = re.compile(r"controller\.((?:[ABX]\.)?)i\[" if commanded else r"plant\.((?:[ABX]\.)?)im\[")
    others = re.compile(r"time|plant\..*[XYZ]m \[m\]|plant\.theta|plant\.omegam")
    rows, kept = [], []
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as run:
        for line in run.stdout:
            cells = line.rstrip("\n").split(",")
            if not rows:
                kept = [at for at, name in enumerate(cells) if currents.match(name) or others.match(name)]
                cells = [currents.sub(r"\1im[", name) for name in cells]
            rows.append(",".join(cells[at] for at in kept))
    return truth, rows, options


def main() -> None:
    """Print a line per machine and length."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--machine", nargs="*", default=["planar4", "spindle", "spindle4"])
    parser.add_argument("--commanded", action="store_true")
    parser.add_argument("--bench", action="store_true")
    parser.add_argument("--lag", type=float, metavar="SECONDS")
    parser.add_argument("--missing", type=float, default=0.0, metavar="PART", help="leaves out this part of the rows at random")
    arguments = parser.parse_args()
    print("| machine | recording | valid | error/± in all | error/± of noise | worst/± in all | rms error [%] | read as measured |")
    print("|---|---|---|---|---|---|---|---|")
    for machine in arguments.machine:
        seeds = range(arguments.seed, arguments.seed + arguments.runs)
        recordings = [record(machine, seed, arguments.commanded, arguments.bench, arguments.lag) for seed in seeds]
        for time_s in TIMES_S:
            valid, measured, errors = 0, 0, []
            for seed, (truth, rows, options) in zip(seeds, recordings):
                drawn = random.Random(seed)
                command = [PROGRAM, "identify", "-", "--machine", machine, *options, "--json", "-"]
                whole = enumerate(rows[: round(time_s * RATE_HZ) + 2])
                text = "".join(f"{row}\n" for at, row in whole if at < 2 or drawn.random() >= arguments.missing)
                answer = json.loads(subprocess.run(command, input=text, capture_output=True, text=True).stdout)
                if answer["valid"]:
                    valid += 1
                    measured += answer["stated"]["hold"] == "heldBefore"
                    stated = zip(truth.values(), answer["lambdaHat"], answer["lambdaStdTotal"], answer["lambdaStd"])
                    errors += [((hat - true) / total, (hat - true) / noise, hat / true - 1) for true, hat, total, noise in stated]
            total, noise, relative = (math.sqrt(sum(e[n] ** 2 for e in errors) / max(len(errors), 1)) for n in range(3))
            worst = max((abs(e[0]) for e in errors), default=math.nan)
            print(f"| {machine} | {time_s:g} s | {valid} | {total:.2f} | {noise:.2f} | {worst:.1f} | {100 * relative:.2f} | {measured} |", flush=True)


if __name__ == "__main__":
    main()
