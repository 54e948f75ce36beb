#!/usr/bin/env python3
"""Recordings with faults, made by a simulator that shares no code with the product, and the answers of `identify`.

    cargo build --release
    scripts/faults.py --seed 501 --runs 20 [--only TEXT]

Every seed draws a bearing, a controller and sensor noise, and records one second at 10 kHz. Each fault is applied to the recordings
of all seeds. A verdict is right if the answer is valid exactly where the fault can be corrected; the cause is right if the answer contains its
words or, without a fault, no finding. The exit code is 1 unless both are right in 19 of 20 runs, and no valid answer
is off by more than four stated standard deviations.

Requires: numpy.
"""

import argparse
import json
import math
import re
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

PROGRAM = Path(__file__).resolve().parents[1] / "target" / "release" / "magnetic-bearing"
STEP_S, SUBSTEPS = 1e-4, 4
HEADER = "time [s],Ym [m],Zm [m],im[1] [A],im[2] [A],im[3] [A],theta [rad],omega [rad/s]"
POSITIONS, CURRENTS = slice(1, 3), slice(3, 6)
WORST = 4.0


@dataclass
class Recording:
    """Columns as in HEADER, commands, final and, if different, initial λ, arguments of `identify`, random generator."""

    rows: np.ndarray
    commands: np.ndarray
    lambdas: list
    arguments: list
    random: np.random.Generator


class Amplifier:
    """Currents that follow commands with two lags, 0 for none."""

    def __init__(self, current, *lags_s):
        self.states, self.lags_s = [current] * len(lags_s), lags_s
        self.current = current

    def follow(self, command, duration_s):
        """The currents after holding the commands for this time."""
        left = [math.exp(-duration_s / lag_s) if lag_s else 0.0 for lag_s in self.lags_s]
        (first, second), (a, b) = (state - command for state in self.states), self.lags_s
        # Response of the second state to the decay of the first one.
        coupling = a / (a - b) * (left[0] - left[1]) if a and b else left[0]
        self.states = [command + first * left[0], command + (second * left[1] if b else 0.0) + first * coupling]
        self.current = self.states[1]
        return self.current


def simulate(seeds, duration_s=1.0, step_of_lambda=0.0, limit_a=np.inf, scale=(1.0, 1.0, 1.0), slow_force=0.0, push_s=0.0, amplifier_s=(0.0, 0.0, 0.0), backward_n=0.0, salt=0):
    """A recording of each seed. All bearings are integrated together.

    A PID controller with feed-forward keeps the rotor on an ellipse; forces are converted to currents with the measured gap and a guess of λ.
    A command of sample k is held from k + 1 to k + 2. λ2 changes by the fraction `step_of_lambda` in the middle; the amplifiers saturate at the
    fraction `limit_a` of the largest current of the first turns, and the currents follow the commands with a delay and two lags: `amplifier_s`.
    A force of its weight along y, half of that along z, pushes the rotor for `push_s` from 0.6 s on. `backward_n` turns against the rotor.
    """
    draws = [np.random.default_rng([seed, 1]) for seed in seeds]
    noise = [np.random.default_rng([seed, 2, salt]) for seed in seeds]
    draw = lambda low, high, *shape: np.array([random.uniform(low, high, shape or None) for random in draws])
    count, rows = len(seeds), round(duration_s / STEP_S) + 1
    mass, gap, omega = draw(3, 12), draw(4e-4, 7e-4), 2 * np.pi * draw(40, 100)
    alpha = draw(-np.pi, np.pi)[:, None] + 2 * np.pi / 3 * np.arange(3) + draw(-0.15, 0.15, 3)
    constants = draw(1.5e-6, 2.5e-6, 3) * np.array(scale)
    guess = draw(0.8, 1.25, 3) * constants
    radius, phase = gap[:, None] * draw(0.06, 0.15, 2), draw(0, 2 * np.pi)
    unbalance, angle = draw(0, 15) / omega**2, draw(0, 2 * np.pi)
    load, least = mass[:, None] * draw(-5, 5, 2), draw(1, 3) * mass
    sigma_x, sigma_i = 10 ** draw(-7.3, -6.3), 10 ** draw(-2.3, -1.7)
    poles = draw(250, 500)
    e = np.stack([np.sin(alpha), np.cos(alpha)], axis=1)  # seed, axis, magnet
    inverse = np.linalg.pinv(e)
    null = np.cross(e[:, 0], e[:, 1])
    null *= np.sign(null.sum(axis=1, keepdims=True))

    def path(time):
        turned = omega * time + phase
        shape = np.stack([np.cos(turned), np.sin(turned)], axis=1) * radius
        return shape, -(omega[:, None] ** 2) * shape

    def acceleration(time, position, current, lambdas, slow):
        gaps = gap[:, None] - np.einsum("nak,na->nk", e, position)
        force = np.einsum("nak,nk->na", e, lambdas * (current / gaps) ** 2) + load + slow
        turned = omega * time + phase + angle
        whirl = (unbalance * omega**2)[:, None] * np.stack([np.cos(turned), np.sin(turned)], axis=1)
        backward = backward_n * np.stack([np.cos(turned), -np.sin(turned)], axis=1)
        return (force + whirl + backward) / mass[:, None]

    position, velocity = path(0.0)[0], (path(1e-7)[0] - path(-1e-7)[0]) / 2e-7
    integral, filtered, slow = np.zeros((count, 2)), position.copy(), np.zeros((count, 2))
    pending = held = old = np.sqrt(np.maximum(least, 1)[:, None] / guess) * gap[:, None]
    amplifier, delay_s = Amplifier(held, *amplifier_s[1:]), amplifier_s[0]
    limit = np.full((count, 3), np.inf)
    data, commands, largest = np.zeros((count, rows, 8)), np.zeros((count, rows, 3)), np.zeros((count, 3))
    white = np.stack([random.standard_normal((rows, 7)) for random in noise])
    for row in range(rows):
        time = row * STEP_S
        read = position + sigma_x[:, None] * white[:, row, :2]
        data[:, row, 0], data[:, row, POSITIONS] = time, read
        data[:, row, CURRENTS] = amplifier.current + sigma_i[:, None] * white[:, row, 2:5]
        data[:, row, 6], data[:, row, 7] = (omega * time + phase) % (2 * np.pi), omega
        # The controller: forces that move the rotor along its reference, and magnet forces of at least `least`.
        wanted, forward = path(time)
        error = read - wanted
        rate = (read - filtered) * 3000.0
        filtered += 3000.0 * STEP_S * (read - filtered)
        drift = rate - (path(time + 1e-7)[0] - path(time - 1e-7)[0]) / 2e-7
        integral += error * STEP_S
        p = poles[:, None]
        force = mass[:, None] * (path(time + 1.5 * STEP_S)[1] - 3 * p**2 * error - 3 * p * drift - p**3 * integral)
        pulls = np.einsum("nka,na->nk", inverse, force)
        pulls += null * ((least[:, None] - pulls) / null).max(axis=1, keepdims=True)
        ahead = path(time + 1.5 * STEP_S)[0] + error
        command = (gap[:, None] - np.einsum("nak,na->nk", e, ahead)) * np.sqrt(pulls / guess)
        old, held, pending = held, pending, command
        commands[:, row] = held
        held = np.minimum(held, limit)
        if 0.2 < time < 0.3:
            largest = np.maximum(largest, held)
        elif time >= 0.3:
            limit = limit_a * largest
        slow = slow + slow_force * math.sqrt(STEP_S) * white[:, row, 5:]
        factor = np.array([1.0, 1.0 + step_of_lambda * (time > duration_s / 2), 1.0])
        push = 9.81 * mass[:, None] * np.array([1.0, 0.5]) * (0.6 < time < 0.6 + push_s)
        h = STEP_S / SUBSTEPS
        # A command has no effect in half steps that end before its delay.
        commands_now = [old if half * h / 2 < delay_s - 1e-9 else held for half in range(2 * SUBSTEPS)]
        half_steps = [amplifier.current if any(amplifier_s) else held, *(amplifier.follow(now, h / 2) for now in commands_now)]
        for part in range(SUBSTEPS):
            at, (begin, middle, end) = time + part * h, half_steps[2 * part : 2 * part + 3]
            f = lambda t, x, current: acceleration(t, x, current, factor * constants, slow + push)
            k1, k2 = f(at, position, begin), f(at + h / 2, position + h / 2 * velocity, middle)
            k3 = f(at + h / 2, position + h / 2 * velocity + h * h / 4 * k1, middle)
            k4 = f(at + h, position + h * velocity + h * h / 2 * k2, end)
            position = position + h * velocity + h * h / 6 * (k1 + k2 + k3)
            velocity = velocity + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    if not (np.abs(position) < gap[:, None]).all():
        raise SystemExit("a rotor of the simulation touches its magnets")
    recordings = []
    for n, random in enumerate(noise):
        known = {"m": mass[n], "s": gap[n]} | {f"alpha[{k + 1}]": alpha[n, k] for k in range(3)}
        arguments = [part for name, value in known.items() for part in ("--set", f"{name}={value:.12g}")]
        ends = [constants[n] * factor, constants[n]] if step_of_lambda else [constants[n]]
        recordings.append(Recording(data[n], commands[n], ends, arguments, random))
    return recordings


def commanded(recording):
    """Commands, when they take effect, in place of measured currents."""
    rows = recording.rows.copy()
    rows[:, CURRENTS] = recording.commands
    return rows


def stuck(recording):
    """A channel is stuck for 20 to 200 ms, or to the end."""
    rows, random = recording.rows.copy(), recording.random
    column, start = random.integers(1, 6), random.integers(1000, 6000)
    end = len(rows) if random.random() < 0.25 else start + random.integers(200, 2000)
    rows[start:end, column] = rows[start, column]
    return rows


def clipped(recording):
    """A current sensor is limited to 90 % of the largest current."""
    rows, column = recording.rows.copy(), recording.random.integers(3, 6)
    low, high = np.quantile(rows[:, column], [0.0, 0.999])
    rows[:, column] = np.minimum(rows[:, column], low + 0.9 * (high - low))
    return rows


def outliers(recording):
    """0.1 % of the readings are uniform within three ranges of their column; half of those of currents are 0."""
    rows, random = recording.rows.copy(), recording.random
    for column in range(1, 6):
        low, high = rows[:, column].min(), rows[:, column].max()
        for row in np.flatnonzero(random.random(len(rows)) < 1e-3):
            rows[row, column] = random.uniform(2 * low - high, 2 * high - low) if column < 3 or random.random() < 0.5 else 0.0
    return rows


def lost(part):
    return lambda recording: recording.rows[np.append(True, recording.random.random(len(recording.rows) - 1) >= part)]


def quantised(position_bits, current_bits):
    """Converters with these numbers of bits over 1 mm and over 5 A."""

    def spoil(recording):
        rows = recording.rows.copy()
        for columns, step in ((POSITIONS, 1e-3 / 2**position_bits), (CURRENTS, 5.0 / 2**current_bits)):
            rows[:, columns] = np.round(rows[:, columns] / step) * step
        return rows

    return spoil


def dropouts(recording):
    """The recorder repeats the previous row twenty times, for up to 5 ms."""
    rows, random = recording.rows.copy(), recording.random
    for start in random.integers(100, len(rows) - 100, 20):
        rows[start : start + random.integers(1, 50), 1:6] = rows[start - 1, 1:6]
    return rows


def drifting(recording):
    """The offset of one position sensor drifts by 5 µm from the start to the end."""
    rows, random = recording.rows.copy(), recording.random
    rows[:, random.integers(1, 3)] += random.choice([-5e-6, 5e-6]) * np.linspace(0.0, 1.0, len(rows))
    return rows


def shifted(recording):
    """Both position sensors have offsets of 30 µm, with either sign."""
    rows = recording.rows.copy()
    rows[:, POSITIONS] += recording.random.choice([-3e-5, 3e-5], 2)
    return rows


def typical(recording):
    """Offsets, gains and directions of the sensors are off as on a typical bench."""
    rows, normal = recording.rows.copy(), recording.random.standard_normal
    turn, skew = np.radians(0.5) * normal(2)
    across = np.array([[0.0, skew - turn], [skew + turn, 0.0]])
    rows[:, POSITIONS] = rows[:, POSITIONS] @ (np.diag(1 + 0.007 * normal(2)) + across).T + 5e-6 * normal(2)
    rows[:, CURRENTS] = rows[:, CURRENTS] * (1 + 0.005 * normal(3)) + 0.005 * normal(3)
    return rows


def plain(recording):
    return recording.rows


@dataclass
class Fault:
    """Name, modification of recordings, expected validity, words of the cause, options, simulation, columns."""

    name: str
    spoil: object = plain
    valid: bool = True
    cause: str = ""
    options: object = lambda recording: []
    world: tuple = ()
    columns: str = HEADER


def following(name, amplifier_s):
    return Fault(f"commanded currents, {name}", commanded, cause="with a lag of|The currents act", world=(("amplifier_s", amplifier_s),))


BLIND = HEADER.split(",theta")[0]
rpm = lambda off: lambda recording: ["--speed", f"{recording.rows[0, 7] * 30 / np.pi * off:.9g}"]
TYPICAL = "s=1% alpha=0.5deg sensor.offset=5um sensor.gain=0.5% current.gain=0.5% current.offset=5mA m=1%"
TOLERANCES = [part for tolerance in TYPICAL.split() for part in ("--tolerance", tolerance)]
SENSORS = r"(Ym|Zm|im\[\d\]): "
FAULTS = [
    Fault("none"),
    Fault("commanded currents", commanded, cause=r"heldAfter"),
    Fault("commanded currents, --hold heldBefore", commanded, False, r"heldAfter", lambda _: ["--hold", "heldBefore"]),
    following("lag of 20 µs", (0, 2e-5, 0)),
    following("lag of 50 µs", (0, 5e-5, 0)),
    following("lag of 100 µs", (0, 1e-4, 0)),
    following("lag of 200 µs", (0, 2e-4, 0)),
    following("lag of 50 µs after 25 µs", (2.5e-5, 5e-5, 0)),
    following("lags of 100 and 50 µs", (0, 1e-4, 5e-5)),
    Fault("measured currents, 25 µs later", cause="|The currents act", world=(("amplifier_s", (2.5e-5, 0, 0)),)),
    Fault("stuck sensor", stuck, cause=SENSORS + "(stuck|clipped)"),
    Fault("stuck sensor, tolerances", stuck, cause=SENSORS + "(stuck|clipped)", options=lambda _: TOLERANCES),
    Fault("clipped currents", clipped, cause=SENSORS + "clipped"),
    Fault("0.1 % of outliers", outliers, cause=SENSORS + ".*outlier"),
    Fault("λ2 +5 % in the middle", cause="force constants differ", world=(("step_of_lambda", 0.05),)),
    Fault("λ2 −30 % in the middle", cause="force constants differ", world=(("step_of_lambda", -0.3),)),
    Fault("a push of 5 ms", cause="something disturbs", world=(("push_s", 5e-3),)),
    Fault("a push of 20 ms", cause="something disturbs", world=(("push_s", 2e-2),)),
    Fault("3 % of rows missing", lost(0.03), cause="gaps"),
    Fault("10 % of rows missing", lost(0.10), cause="gaps"),
    Fault("3 % of rows missing, tolerances", lost(0.03), cause="gaps", options=lambda _: TOLERANCES),
    Fault("quantised: 0.24 µm, 1.2 mA", quantised(12, 12), cause="|quantised in steps"),
    Fault("quantised: 1 µm, 10 mA", quantised(10, 9), cause="quantised in steps"),
    Fault("saturated amplifiers", world=(("limit_a", 0.95),)),
    Fault("slow force, 200 mN/√s", cause="slow force", world=(("slow_force", 0.2),)),
    Fault("dropouts", dropouts, cause="repeat the previous row"),
    Fault("speed off by 0.4 %", valid=False, cause="stated speed", options=rpm(1.004), columns=BLIND),
    Fault("speed off by −0.4 %", valid=False, cause="stated speed", options=rpm(0.996), columns=BLIND),
    Fault("no angle and speed", valid=False, cause="neither angle nor speed", columns=BLIND),
    Fault("λ2 of another recording +5 %", valid=False, cause="recordings differ: λ2", world=(("scale", (1.0, 1.05, 1.0)),)),
    Fault("a position drifts by 5 µm", drifting, False, "sensors drift"),
    Fault("position offsets of 30 µm", shifted, False, r"call (most )?for"),
    Fault("the same, --tolerance sensor.offset=30um", shifted, options=lambda _: ["--tolerance", "sensor.offset=30um"]),
    Fault("sensors of a typical bench, --tolerance all=typical", typical, options=lambda _: ["--tolerance", "all=typical"]),
    Fault("a backward force of 0.5 N", valid=False, cause="force.backward", world=(("backward_n", 0.5),)),
    Fault("the same, --tolerance force.backward=2N", world=(("backward_n", 0.5),), options=lambda _: ["--tolerance", "force.backward=2N"]),
]


def write(path, rows, header):
    columns = len(header.split(","))
    np.savetxt(path, rows[:, :columns], fmt=["%.6f"] + ["%.9g"] * (columns - 1), delimiter=",", header=header, comments="")


def identify(paths, recording, options):
    """The JSON document of `identify`."""
    command = [str(PROGRAM), "identify", *map(str, paths), *recording.arguments, *options, "--json", "-"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode not in (0, 3) and not done.stdout.startswith("{"):
        raise SystemExit(f"{' '.join(command)}\n{done.stderr}")
    return json.loads(done.stdout)


def judge(fault, recording, other, folder, seed):
    """Whether verdict and cause are right, the largest error/± of a valid answer, and the document."""
    paths = [folder / f"{seed}.csv"]
    write(paths[0], fault.spoil(recording), fault.columns)
    if other is not None:
        paths.append(folder / f"{seed}-other.csv")
        write(paths[1], other.rows, HEADER)
    document = identify(paths, recording, fault.options(recording))
    for path in paths:
        path.unlink()
    texts = [document["verdict"], *document["findings"], *document.get("notes", [])]
    texts.append(document.get("stated", {}).get("hold", ""))
    cause = bool(re.search(fault.cause, " ".join(texts))) if fault.cause else not document["findings"]
    worst = 0.0
    if document["valid"]:
        found, std = np.array(document["lambdaHat"]), np.array(document["lambdaStdTotal"])
        worst = min(np.abs((found - truth) / std).max() for truth in recording.lambdas)
    return document["valid"] == fault.valid, cause, worst, document


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seed", type=int, default=1, help="first seed")
    parser.add_argument("--runs", type=int, default=20, help="seeds")
    parser.add_argument("--only", default="", help="faults whose names contain this")
    parser.add_argument("--verbose", action="store_true", help="print what is said where it is wrong")
    arguments = parser.parse_args()
    seeds = range(arguments.seed, arguments.seed + arguments.runs)
    least = len(seeds) - len(seeds) // 20
    sound, worlds = True, {}

    def world(*changes):
        if changes not in worlds:
            worlds[changes] = simulate(seeds, **dict(changes))
        return worlds[changes]

    print(f"| fault, {len(seeds)} seeds from {arguments.seed} | right verdict | right cause | valid | worst error/± |")
    print("|---|---|---|---|---|", flush=True)
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(2) as pool:
        for fault in (fault for fault in FAULTS if arguments.only in fault.name):
            differs = any(name == "scale" for name, _ in fault.world)
            recordings = world(("salt", 7)) if differs else world(*fault.world)
            others = world(*fault.world) if differs else [None] * len(seeds)
            tasks = [
                pool.submit(judge, fault, recording, other, Path(folder), seed)
                for recording, other, seed in zip(recordings, others, seeds)
            ]
            results = [task.result() for task in tasks]
            verdicts, causes, errors = ([result[n] for result in results] for n in range(3))
            valid = sum(document["valid"] for *_, document in results)
            print(f"| {fault.name} | {sum(verdicts)} | {sum(causes)} | {valid} | {max(errors):.1f} |", flush=True)
            sound &= min(sum(verdicts), sum(causes)) >= least and max(errors) <= WORST
            for seed, (verdict, cause, worst, document) in zip(seeds, results):
                if arguments.verbose and not (verdict and cause and worst <= WORST):
                    texts = [document["verdict"], *document["findings"], *document.get("notes", [])]
                    print(f"  {seed}: {worst:.1f} {' '.join(texts)}", flush=True)
    return 0 if sound else 1


if __name__ == "__main__":
    sys.exit(main())
