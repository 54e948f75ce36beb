#!/usr/bin/env python3
"""Errors of `identify` for a ball below one magnet, on trajectories from slow to fast, by a simulator that shares no code with the product.

    cargo build --release
    scripts/levitation.py --seed 8101 --runs 20 [--only TEXT]

Every seed draws mass, force law, κ, coil, controller, noise and a slow force, and starts with the ball on its table; 15 s at 1 kHz. The measured
current has noise and an unknown offset of up to 10 mA, the position noise that grows with the gap, and steps of 1 µm; 1 % of the rows repeat.
The exit code is 1 if a valid answer is off by more than four stated standard deviations.

Requires: numpy.
"""

import argparse
import gzip
import json
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

PROGRAM = Path(__file__).resolve().parents[1] / "target" / "release" / "magnetic-bearing"
STEP_S, SUBSTEPS, DURATION_S = 1e-3, 10, 15.0
TABLE_M, CENTRE_M, STOP_M = 0.0165, 0.010, 0.002
START_S = 1.5
GRAVITY_M_S2 = 9.81
WORST = 4.0

STAIRS = np.array([0, -1, -2, 0, 1, 2, 1, 0, -1]) * 1e-3
COURSES = {
    "stairs, 1.7 s": lambda t, f: STAIRS[np.minimum(t // 1.7, 8).astype(int)] + 0 * f,
    "sine, 0.2 to 0.6 Hz": lambda t, f: 1.5e-3 * np.sin(2 * np.pi * (0.2 + 0.4 * f) * t),
    "sine, 1 to 2 Hz": lambda t, f: 0.8e-3 * np.sin(2 * np.pi * (1 + f) * t),
    "sweep, 0.1 to 1.6 Hz": lambda t, f: 1.2e-3 * np.sin(2 * np.pi * (0.1 + 0.05 * t) * t + f),
    "sine, 0.4 Hz, fast amplifier": lambda t, f: 2e-3 * np.sin(2 * np.pi * 0.4 * t) + 0 * f,
    "ramps": lambda t, f: 2e-3 * (4 * np.abs(((0.1 + 0.2 * f) * t) % 1 - 0.5) - 1),
    "square wave, 0.3 to 0.6 Hz": lambda t, f: 1e-3 * np.sign(np.sin(2 * np.pi * (0.3 + 0.3 * f) * t)),
    "square wave, 0.8 to 1.5 Hz": lambda t, f: 1.5e-3 * np.sign(np.sin(2 * np.pi * (0.8 + 0.7 * f) * t)),
    "at rest": lambda t, f: 0 * t * f,
}


def simulate(seeds, course):
    """Rows (time, z, i), shape seeds × rows × 3, true values, masses, and whether the ball was held. All seeds are integrated together."""
    number = list(COURSES).index(course)
    draws = [np.random.default_rng([seed, number]) for seed in seeds]
    draw = lambda low, high: np.array([random.uniform(low, high) for random in draws])
    count = round(DURATION_S / STEP_S) + 1
    normal = np.array([random.standard_normal((4, count)) for random in draws])
    repeats = np.array([random.random(count) < 0.01 for random in draws])
    mass, offset, dynamics, current = draw(0.04, 0.09), draw(1e-3, 4e-3), draw(1.0, 1.2), draw(0.7, 1.2)
    weight = mass * GRAVITY_M_S2
    constant = weight * ((CENTRE_M + offset) / current) ** 2
    coil_s, gain, bandwidth, delay_s = draw(0.015, 0.030), 2.7, draw(18, 24), draw(0.3, 1.2)
    if "fast amplifier" in course:
        coil_s = coil_s / 10
    noise_m, noise_a, offset_a = draw(10e-6, 20e-6), draw(4e-3, 8e-3), draw(0, 10e-3)
    level, slow, frequency = draw(0.005, 0.012) * weight, draw(-0.015, 0.015) * weight, draw(0, 1)
    z, v, i = (np.full(len(seeds), value) for value in (TABLE_M, 0.0, 0.0))
    held, smooth, integral, duty, former = np.full(len(seeds), True), z.copy(), 0 * z, 0 * z, 0 * z
    rows = np.empty((len(seeds), count, 3))
    for n in range(count):
        t = n * STEP_S
        read_m = np.round((z + noise_m * z / CENTRE_M * normal[:, 0, n]) / 1e-6) * 1e-6
        read_a = np.round((i + offset_a + noise_a * normal[:, 1, n]) / 2.5e-3) * 2.5e-3
        # The controller: three poles at the bandwidth, and a lead for the coil.
        part = np.clip((t - delay_s) / START_S, 0, 1)
        reference = TABLE_M + part * (CENTRE_M + COURSES[course](t, frequency) - TABLE_M)
        forget = 1 - np.exp(-150 * STEP_S)
        change = forget * (read_m - smooth)
        smooth = smooth + change
        error, w = read_m - reference, bandwidth
        integral = np.where(part > 0.2, np.clip(integral + error * STEP_S, -2e-3, 2e-3), 0)
        wanted = mass * (GRAVITY_M_S2 + dynamics * (3 * w * w * error + 3 * w * change / STEP_S + w**3 * integral))
        wanted_a = np.sqrt(np.maximum(wanted, 1e-4) / constant) * np.maximum(read_m + offset, 1e-3)
        next_duty = np.where(part > 0, np.clip((wanted_a + 80 * coil_s * (wanted_a - read_a)) / gain, 0, 1), 0)
        last = rows[:, max(n - 1, 0)]
        again = repeats[:, n] & (n > 0)
        rows[:, n] = np.stack([np.full(len(seeds), t), np.where(again, last[:, 1], read_m), np.where(again, last[:, 2], read_a)], -1)
        step = STEP_S / SUBSTEPS
        for _ in range(SUBSTEPS):
            i = i + step * (gain * duty - i) / coil_s
            v = v + step * ((weight - constant * (i / (z + offset)) ** 2) / dynamics + slow) / mass
            z = z + step * v
            v = np.where((z > TABLE_M) & (v > 0) | (z < STOP_M) & (v < 0), 0, v)
            z = np.clip(z, STOP_M, TABLE_M)
        duty = next_duty
        slow = slow + level * np.sqrt(STEP_S) * normal[:, 2, n]
        held &= (t < 4) | ((z > STOP_M + 2e-3) & (z < TABLE_M - 1e-3))
    truth = np.stack([2 * weight / current, 2 * weight / (CENTRE_M + offset), dynamics], -1)
    return rows, truth, mass, held


def identify(path, rows, mass):
    """The JSON document of `identify`."""
    with gzip.open(path, "wt", compresslevel=1) as file:
        np.savetxt(file, rows, fmt=["%.3f", "%.6f", "%.5f"], delimiter=",", header="time [s],z [m],i1 [A]", comments="")
    known = ["magnets.used=second", f"m={mass}", f"pX={mass * GRAVITY_M_S2}"]
    columns = ["--column", "Xm=z", "--column", "im[2]=i1", "--estimate", "s", "--at", f"Xm={CENTRE_M}", "--json", "-"]
    command = [str(PROGRAM), "identify", str(path), "--machine", "axial", *(f"--set={one}" for one in known), *columns]
    done = subprocess.run(command, capture_output=True, text=True)
    path.unlink()
    return json.loads(done.stdout) if done.stdout.startswith("{") else {"valid": False, "verdict": done.stderr}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seed", type=int, default=1, help="first seed")
    parser.add_argument("--runs", type=int, default=20, help="seeds")
    parser.add_argument("--only", default="", help="courses whose names contain this")
    parser.add_argument("--verbose", action="store_true", help="print why answers are not valid")
    arguments = parser.parse_args()
    seeds = range(arguments.seed, arguments.seed + arguments.runs)
    print(f"| course, {len(seeds)} seeds from {arguments.seed} | held | valid | ki, ks: rms error | ki, ks, κ: rms error/± | worst |")
    print("|---|---|---|---|---|---|", flush=True)
    furthest = 0.0
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(2) as pool:
        for course in (course for course in COURSES if arguments.only in course):
            rows, truths, masses, held = simulate(seeds, course)
            paths = [Path(folder) / f"{seed}.csv.gz" for seed in seeds]
            documents = list(pool.map(identify, paths, rows, masses))
            errors = []
            for seed, document, truth, is_held in zip(seeds, documents, truths, held):
                if arguments.verbose and not document["valid"]:
                    print(f"  {seed}{'' if is_held else ' (not held)'}: {document['verdict']}", flush=True)
                if document["valid"]:
                    point = document["operatingPoint"]
                    off = [point[name] - of for name, of in zip(("ki", "ks", "dynamics"), truth)]
                    std = [point[name + "StdTotal"] for name in ("ki", "ks", "dynamics")]
                    errors.append([off[0] / truth[0], off[1] / truth[1], *(np.array(off) / std)])
            valid = sum(document["valid"] for document in documents)
            if not errors:
                print(f"| {course} | {held.sum()} | {valid} | – | – | – |", flush=True)
                continue
            rms = np.sqrt(np.mean(np.square(errors), 0))
            worst = np.abs(np.array(errors)[:, 2:]).max()
            furthest = max(furthest, worst)
            percent = " %, ".join(f"{100 * of:.1f}" for of in rms[:2])
            deviations = ", ".join(f"{of:.2f}" for of in rms[2:])
            print(f"| {course} | {held.sum()} | {valid} | {percent} % | {deviations} | {worst:.1f} |", flush=True)
    return 0 if furthest <= WORST else 1


if __name__ == "__main__":
    sys.exit(main())
