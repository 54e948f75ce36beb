"""Peers on the same data: recursive least squares and an extended Kalman filter beside the estimators of this project.

Runs the scenario ``unbalanced`` with sensor noise and several seeds (``cargo build --release`` first), or reads recordings of
``simulate SCENARIO --csv`` in which the scenario compares methods. Prints the rms errors at 35 ms, 100 ms and 200 ms and the time
from which each stays within one per cent.

* RLS: ``filterpy`` has none for vectors, so ``padasip.filters.FilterRLS`` is used, on the equations of motion with both sides
  low-passed (state-variable filter of third order), one filter per axis, the results weighted alike.
* EKF: ``filterpy.kalman.ExtendedKalmanFilter`` with the states [y, z, vy, vz, py, pz, lambda 1 to 3, Uc, Us].

Both know what our estimator knows: mass, gap, angles, angle and speed of the rotor, and the sensor noise.

Requires: the packages of ``scripts/requirements-peers.txt``.
"""

import argparse
import csv
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from padasip.filters import FilterRLS
from scipy import signal

M_KG = 6.7
GAP_M = 5e-4
ALPHA_RAD = np.array([np.pi, -np.pi / 3, np.pi / 3])
DIRECTION = np.stack([np.sin(ALPHA_RAD), np.cos(ALPHA_RAD)])  # axis, magnet
TRUTH = np.array([1.8e-6, 2.0e-6, 2.2e-6])
LAMBDA0 = 4e-6
POSITION_NOISE_M = 1e-7
CURRENT_NOISE_A = 1e-2
FILTER_RAD_S = 2 * np.pi * 150.0
INSTANTS_S = (0.035, 0.1, 0.2)
WITHIN = 0.01
ROOT = Path(__file__).resolve().parents[1]
PROGRAM = ROOT / "target" / "release" / "magnetic-bearing"
# Okabe and Ito.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#b55a92", "#6b727a")


def read(path):
    """Columns of a recording by name, without units."""
    with open(path, encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))
    names = [cell.split(" [")[0] for cell in rows[0]]
    return dict(zip(names, np.array(rows[1:], dtype=float).T, strict=True))


def inputs(data):
    """Time, positions (axis, sample), currents and mean 1/gap^2 of each interval (magnet, sample), angle and speed."""
    position = np.stack([data["plant.Ym"], data["plant.Zm"]])
    current = np.stack([data[f"plant.im[{k}]"] for k in (1, 2, 3)])
    inverse = 1.0 / (GAP_M - DIRECTION.T @ position) ** 2
    # The sample of a current is the one held over the interval that ends there.
    mean = inverse.copy()
    mean[:, 1:] = 0.5 * (inverse[:, 1:] + inverse[:, :-1])
    return data["time"], position, current, mean, data["plant.theta"], data["plant.omegam"]


def regressors(square, theta, omega, axis):
    """Columns of the motion along one axis, in m/s^2 per scaled unknown [lambda/lambda0, Uc/U0, Us/U0, load/(m g)]."""
    turning = omega**2 * np.stack([np.cos(theta), np.sin(theta)])
    pair = turning * np.array([[1], [-1]]) if axis == 0 else turning[::-1]
    magnets = LAMBDA0 * DIRECTION[axis][:, None] * square
    return np.vstack([magnets, GAP_M * M_KG * pair, np.full_like(theta, 9.81 * M_KG)[None]]) / M_KG


def recursive_least_squares(data):
    """Estimates of lambda over time from filtered equations of motion, sample by sample."""
    time, position, current, mean, theta, omega = inputs(data)
    square = current**2 * mean
    step = time[1] - time[0]
    # Acceleration and forces pass the same low-pass filter of third order; initial values die away with it.
    b, a = signal.butter(3, FILTER_RAD_S, analog=True)
    smooth = signal.cont2discrete((b, a), step, "bilinear")
    twice = signal.cont2discrete((np.polymul(b, [1, 0, 0]), a), step, "bilinear")
    # Held currents stand half a sample before the instant of their sample.
    half = np.array([0.5, 0.5])
    found = np.full((time.size, 3), LAMBDA0)
    rows, targets = [], []
    for axis in range(2):
        offset = position[axis] - position[axis][0]
        targets.append(signal.lfilter(np.ravel(twice[0]), twice[1], offset))
        held = regressors(square, theta - 0.5 * omega * step, omega, axis)
        at_sample = np.array([signal.lfilter(half, [1.0], np.append(row[1:], row[-1])) for row in held])
        rows.append(signal.lfilter(np.ravel(smooth[0]), smooth[1], at_sample))
    size = rows[0].shape[0] + 1
    stacked = [np.vstack([rows[0], np.zeros_like(time)]), np.vstack([rows[1][:-1], np.zeros_like(time), rows[1][-1]])]
    recursion = FilterRLS(n=size, mu=0.9999, eps=1e-6, w="zeros")
    recursion.w[:3] = 1.0
    settled = int(3 / FILTER_RAD_S * 2 * np.pi / step)
    for sample in range(time.size):
        if sample > settled:
            for axis in range(2):
                recursion.adapt(targets[axis][sample], stacked[axis][:, sample])
        found[sample] = LAMBDA0 * recursion.w[:3]
    return found


def extended_kalman_filter(data):
    """Estimates of lambda over time; the noise of the currents is the noise of the process."""
    time, position, current, mean, theta, omega = inputs(data)
    step = time[1] - time[0]
    scale = np.array([1e-4, 1e-4, 1e-2, 1e-2, 10, 10, LAMBDA0, LAMBDA0, LAMBDA0, GAP_M * M_KG * 0.1, GAP_M * M_KG * 0.1])
    kalman = ExtendedKalmanFilter(dim_x=11, dim_z=2)
    kalman.x = np.array([*position[:, 0] / scale[:2], 0, 0, 0, 0, 1, 1, 1, 0, 0], dtype=float)
    kalman.P = np.diag([1e-6, 1e-6, 25, 25, 100, 100, 1, 1, 1, 1, 1.0])
    kalman.R = np.eye(2) * POSITION_NOISE_M**2
    observe = np.zeros((2, 11))
    observe[0, 0] = observe[1, 1] = scale[0]
    found = np.full((time.size, 3), LAMBDA0)
    for sample in range(1, time.size):
        middle = 0.5 * (theta[sample] + theta[sample - 1])
        c, s = omega[sample] ** 2 * np.cos(middle), omega[sample] ** 2 * np.sin(middle)
        force = np.zeros((2, 11))
        force[:, 4:6] = np.eye(2)
        # 1/gap^2 from the filter's own position rather than from one noisy sample.
        where = kalman.x[:2] * scale[:2] + 0.5 * step * kalman.x[2:4] * scale[2:4]
        gap = GAP_M - DIRECTION.T @ where
        force[:, 6:9] = DIRECTION * (current[:, sample] / gap) ** 2
        force[:, 9:] = [[c, -s], [s, c]]
        accel = force / M_KG * scale
        transition = np.eye(11)
        transition[0:2, 2:4] += np.eye(2) * step * scale[2] / scale[0]
        transition[0:2] += 0.5 * step**2 * accel / scale[0]
        transition[2:4] += step * accel / scale[2]
        noise = np.zeros((11, 3))
        strength = 2 * kalman.x[6:9] * LAMBDA0 * current[:, sample] * mean[:, sample] * CURRENT_NOISE_A / M_KG
        noise[0:2] = 0.5 * step**2 * DIRECTION * strength / scale[0]
        noise[2:4] = step * DIRECTION * strength / scale[2]
        kalman.F = transition
        kalman.Q = noise @ noise.T
        kalman.predict()
        kalman.update(position[:, sample], lambda _x: observe, lambda x: observe @ x)
        found[sample] = LAMBDA0 * kalman.x[6:9]
    return found


def own(data, method):
    """Estimates of one of the methods of this project, if the recording has them."""
    names = [f"{method}.lambdaHat[{k}]" for k in (1, 2, 3)]
    return np.stack([data[name] for name in names], axis=1) if names[0] in data else None


def settled_s(time, found):
    """The instant from which every estimate stays within one per cent, or None."""
    outside = np.any(np.abs(found / TRUTH - 1) > WITHIN, axis=1)
    last = np.flatnonzero(outside)
    if last.size == 0:
        return time[0]
    return None if last[-1] == time.size - 1 else time[last[-1] + 1]


def simulate(seed, folder):
    """Path of a recording of the unbalanced rotor with this seed of the sensor noise."""
    run = [str(PROGRAM), "simulate"]
    text = subprocess.run([*run, "--print", "unbalanced"], check=True, capture_output=True, text=True).stdout
    noise = f"sensor.positionNoise = {POSITION_NOISE_M}\nsensor.currentNoise = {CURRENT_NOISE_A}\n"
    text = text.replace("[plant]\n", f"[plant]\nsensor.seed = {seed}\n{noise}").replace("[estimator]\n", f"[estimator]\n{noise}")
    scenario, recording = folder / "scenario.toml", folder / f"{seed}.csv"
    scenario.write_text(text, encoding="utf-8")
    subprocess.run([*run, str(scenario), "--csv", str(recording)], check=True, capture_output=True)
    return recording


def estimates(path):
    """Time, and the estimates of every method over time."""
    data = read(path)
    tracks = {name: own(data, name) for name in ("paper", "leastSquares", "unbalance")}
    tracks["RLS (padasip)"] = recursive_least_squares(data)
    tracks["EKF (filterpy)"] = extended_kalman_filter(data)
    return data["time"], {name: found for name, found in tracks.items() if found is not None}


def draw(path, time, runs):
    """The largest of the three errors over time: median of the runs, and from the least to the greatest."""
    import matplotlib

    matplotlib.use("svg")
    import matplotlib.pyplot as plt

    plt.rcParams["svg.hashsalt"] = "peers"
    figure, axes = plt.subplots(figsize=(9, 5), layout="constrained")
    shown = time >= 0.02
    for colour, name in zip(COLOURS, runs[0], strict=False):
        errors = np.array([100 * np.max(np.abs(tracks[name] / TRUTH - 1), axis=1) for tracks in runs])[:, shown]
        errors = np.clip(errors, 1e-2, None)
        axes.fill_between(1e3 * time[shown], errors.min(axis=0), errors.max(axis=0), color=colour, alpha=0.15, linewidth=0)
        style = "--" if name == "leastSquares" else "-"
        axes.plot(1e3 * time[shown], np.median(errors, axis=0), style, color=colour, label=name)
    axes.axhline(100 * WITHIN, color="grey", linestyle=":", label="1 %")
    axes.set(yscale="log", xlabel="time in ms", ylabel="largest error of a force constant in %", ylim=(2e-2, 3e3))
    axes.set_xlim(20, 1e3 * time[-1])
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set_title(f"Unbalance 20 N, load (10, −20) N, 0.1 µm and 10 mA: median of {len(runs)} runs and their range", fontsize=11)
    axes.legend(ncols=3, loc="upper right")
    axes.grid(alpha=0.3)
    figure.savefig(path, metadata={"Date": None})


def main():
    """Runs the comparison; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recordings", nargs="*", help="written by: cargo run --release -- simulate SCENARIO --csv FILE")
    parser.add_argument("--seeds", type=int, default=10, help="without recordings: how many runs (default: %(default)s)")
    parser.add_argument("--first", type=int, default=1, help="the first seed (default: %(default)s)")
    parser.add_argument("--plot", metavar="FILE", help="draws the errors over time")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if not arguments.recordings and not PROGRAM.exists():
            print("error: cargo build --release comes first", file=sys.stderr)
            return 1
        paths = arguments.recordings or (
            simulate(seed, Path(folder)) for seed in range(arguments.first, arguments.first + arguments.seeds)
        )
        found = [estimates(path) for path in paths]
    time, runs = found[0][0], [tracks for _, tracks in found]
    head = "".join(f"{f'{1e3 * instant:.0f} ms':>22}" for instant in INSTANTS_S)
    print(f"{len(runs)} runs; rms errors of lambda 1, 2, 3 in %")
    print(f"{'':16}{head}{'within 1 % from, ms: median (range)':>38}")
    for name in runs[0]:
        cells = ""
        for instant in INSTANTS_S:
            row = min(np.searchsorted(time, instant - 1e-9), time.size - 1)
            errors = np.array([tracks[name][row] / TRUTH - 1 for tracks in runs])
            cells += f"{'  '.join(f'{100 * rms:.2f}' for rms in np.sqrt(np.mean(errors**2, axis=0))):>22}"
        settled = [settled_s(time, tracks[name]) for tracks in runs]
        reached = sorted(1e3 * when for when in settled if when is not None)
        if reached:
            when = f"{np.median(reached):.0f} ({reached[0]:.0f} to {reached[-1]:.0f})"
            when += "" if len(reached) == len(runs) else f", {len(reached)} of {len(runs)} runs"
        else:
            when = "never"
        print(f"{name:16}{cells}{when:>38}")
    if arguments.plot:
        draw(arguments.plot, time, runs)
    return 0


if __name__ == "__main__":
    sys.exit(main())
