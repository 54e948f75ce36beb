"""Compare the estimator of this project with recursive least squares and an extended Kalman filter on the same data.

Simulates the nominal unbalanced rotor and random bearings (``cargo build --release`` first), with several seeds of sensor
noise each, with the noise known and estimated; or reads recordings of ``simulate SCENARIO --csv`` of the nominal
bearing. Prints, while the estimate is valid, the rms of error/bound and of error/standard deviation at some instants and the
largest error/standard deviation of all samples. The peers report no validity and are always judged.

* RLS: ``padasip.filters.FilterRLS`` on the equations of motion with both sides low-passed (third-order state-variable filter),
  one equation per axis with equal weights. It states no standard deviation.
* EKF: the textbook filter with the states [y, z, vy, vz, lambda 1 to 3, Uc, Us, py, pz]. The current noise is its process noise.
  Without known noise it uses the initial values of our estimator: the position noise from the fourth differences of the first
  64 samples, and 15 mA. With known noise, its covariance along the true trajectory without prior knowledge is the Cramér–Rao bound.

All know mass, gap, angles, angle and speed of the rotor, and the same first guess of lambda.

Requires: the packages of ``scripts/requirements-peers.txt``.
"""

import argparse
import csv
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from padasip.filters import FilterRLS
from scipy import signal

FILTER_RAD_S = 2 * np.pi * 150.0
INSTANTS_S = (0.035, 0.1, 0.2, 0.4, 1.0)
ROOT = Path(__file__).resolve().parents[1]
PROGRAM = ROOT / "target" / "release" / "magnetic-bearing"
KNOWN, ESTIMATED, RLS = "ours, noise known", "ours, noise estimated", "RLS (padasip)"
EKF, EKF_GUESSED = "EKF, noise known", "EKF, noise guessed"
# Colours of Okabe and Ito.
COLOURS = {KNOWN: "#0072b2", ESTIMATED: "#d55e00", EKF: "#009e73", EKF_GUESSED: "#cc79a7", RLS: "#6b727a"}


@dataclass
class Bearing:
    """Parameters of a run; SI units. The default is the nominal one: the scenario ``unbalanced`` with noise."""

    name: str = "nominal"
    m: float = 6.7
    s: float = 5e-4
    alpha: tuple = (np.pi, -np.pi / 3, np.pi / 3)
    truth: tuple = (1.8e-6, 2.0e-6, 2.2e-6)
    guess: tuple = (4e-6, 4e-6, 4e-6)
    step: float = 1e-4
    omega: float = 100 * np.pi
    radius: tuple = (30e-6, 70e-6)
    lobes: tuple = (3, 0.0)
    unbalance: tuple = (20 / (100 * np.pi) ** 2, np.radians(40))
    load: tuple = (10.0, -20.0)
    least_force: float = 20.0
    poles: float = 1000.0
    noise: tuple = (1e-7, 1e-2)

    @property
    def direction(self):
        """Unit vectors of the magnets; axis, magnet."""
        return np.stack([np.sin(self.alpha), np.cos(self.alpha)])


def draw(seed):
    """A random bearing from the ranges of ``montecarlo``."""
    rng = np.random.default_rng(seed)
    m, s, omega = np.exp(rng.uniform(np.log(2), np.log(15))), rng.uniform(3e-4, 8e-4), 2 * np.pi * rng.uniform(40, 120)
    truth = np.exp(rng.uniform(np.log(1e-6), np.log(3e-6))) * 2 ** rng.uniform(0, 1, 3)
    direction = rng.uniform(-np.pi, np.pi)
    return Bearing(
        name=f"drawn {seed}",
        m=m,
        s=s,
        alpha=tuple(rng.uniform(-np.pi, np.pi) + 2 * np.pi / 3 * np.arange(3) + rng.uniform(-0.3, 0.3, 3)),
        truth=tuple(truth),
        guess=tuple(truth * rng.uniform(0.7, 1.6, 3)),
        step=rng.choice([5e-5, 1e-4, 2e-4]),
        omega=omega,
        radius=tuple(s * rng.uniform(0.04, 0.18, 2)),
        lobes=(int(rng.integers(2, 5)), s * rng.uniform(0, 0.05) * rng.integers(0, 2)),
        unbalance=(rng.uniform(0, 60) / omega**2, rng.uniform(-np.pi, np.pi)),
        load=tuple(rng.uniform(0, 0.5) * 9.81 * m * np.array([np.cos(direction), np.sin(direction)])),
        least_force=m * rng.uniform(2, 5),
        poles=np.exp(rng.uniform(np.log(500), np.log(2000))),
        noise=(np.exp(rng.uniform(np.log(5e-8), np.log(2e-6))), np.exp(rng.uniform(np.log(5e-3), np.log(5e-2)))),
    )


def scenario(bearing, seed, known):
    """The text of a scenario."""

    def table(title, **values):
        lines = [f"[{title}]"]
        for key, value in values.items():
            value = [float(x) for x in value] if isinstance(value, tuple) else value
            lines.append(f"{key.replace('__', '.')} = {value if isinstance(value, (list, int, str)) else float(value)!r}")
        return "\n".join(lines)

    lobes, amplitude = bearing.lobes
    noise = {"sensor__positionNoise": bearing.noise[0], "sensor__currentNoise": bearing.noise[1]}
    start = {"Y0": bearing.radius[0] + amplitude, "vZ0": (bearing.radius[1] + amplitude) * bearing.omega}
    shape = {"reference__shape": "lobes", "reference__lobes": lobes, "reference__lobeAmplitude": amplitude} if amplitude else {}
    return "\n".join([
        f'title = "{bearing.name}"\nduration = "1 s"\nstep = {float(bearing.step)!r}',
        table("all", m=bearing.m, s=bearing.s, alpha=bearing.alpha, lambda0=bearing.guess, Ts=bearing.step),
        table(
            "plant",
            **{"lambda": bearing.truth, "sensor__Ts": bearing.step, "sensor__seed": seed, "omega": bearing.omega},
            **{"unbalance__magnitude": bearing.unbalance[0], "unbalance__phase": bearing.unbalance[1]},
            **{"pY": bearing.load[0], "pZ": bearing.load[1], "touchdown__clearance": bearing.s / 2},
            **start,
            **noise,
        ),
        table(
            "controller",
            **{"reference__rY": bearing.radius[0], "reference__rZ": bearing.radius[1], "reference__omega": bearing.omega},
            **{"F0": bearing.least_force, "bandwidth__tracking": bearing.poles},
            **shape,
        ),
        table("estimator", **(noise if known else {})),
    ])  # fmt: skip


def simulate(bearing, seed, known, folder):
    """Path of a recording."""
    text, recording = folder / "scenario.toml", folder / "recording.csv"
    text.write_text(scenario(bearing, seed, known), encoding="utf-8")
    done = subprocess.run([str(PROGRAM), "simulate", str(text), "--csv", str(recording)], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(done.stderr)
    return recording


def read(path):
    """Columns of a recording by name, without units."""
    with open(path, encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))
    names = [cell.split(" [")[0] for cell in rows[0]]
    return dict(zip(names, np.array(rows[1:], dtype=float).T, strict=True))


def magnets(data, name):
    """A signal of the three magnets; sample, magnet."""
    return np.stack([data[f"{name}[{k}]"] for k in (1, 2, 3)], axis=1)


def own(data):
    """Estimates, standard deviations and validity of the loop's estimator over time."""
    total = "estimator.lambdaStdTotal" if "estimator.lambdaStdTotal[1]" in data else "estimator.lambdaStd"
    return magnets(data, "estimator.lambdaHat"), magnets(data, total), data["estimator.valid"] > 0


def recursive_least_squares(data, bearing):
    """Estimates over time from filtered equations of motion, sample by sample."""
    position, current = np.stack([data["plant.Ym"], data["plant.Zm"]]), magnets(data, "plant.im").T
    theta, omega, guess = data["plant.theta"], data["plant.omegam"], np.mean(bearing.guess)
    inverse = 1.0 / (bearing.s - bearing.direction.T @ position) ** 2
    # A current sample is held over the interval that ends at it.
    square = current**2 * inverse
    square[:, 1:] = current[:, 1:] ** 2 * 0.5 * (inverse[:, 1:] + inverse[:, :-1])
    middle = theta - 0.5 * omega * bearing.step
    turning = bearing.s * omega**2 * np.stack([np.cos(middle), np.sin(middle)])
    still, weight = np.zeros_like(middle), np.full_like(middle, 9.81)
    # Columns per scaled unknown [lambda/guess, Uc/(m s), Us/(m s), py/(m g), pz/(m g)], in m/s^2.
    along = [guess * e[:, None] * square / bearing.m for e in bearing.direction]
    columns = [[*along[0], turning[0], -turning[1], weight, still], [*along[1], turning[1], turning[0], still, weight]]
    # Acceleration and forces pass the same third-order low-pass filter, with which initial values decay.
    b, a = signal.butter(3, FILTER_RAD_S, analog=True)
    smooth = signal.cont2discrete((b, a), bearing.step, "bilinear")
    twice = signal.cont2discrete((np.polymul(b, [1, 0, 0]), a), bearing.step, "bilinear")
    targets = [signal.lfilter(np.ravel(twice[0]), twice[1], axis - axis[0]) for axis in position]
    # Held currents act on average half a sample before their sample.
    centred = [[0.5 * (column + np.append(column[1:], column[-1])) for column in axis] for axis in columns]
    stacked = [np.array([signal.lfilter(np.ravel(smooth[0]), smooth[1], column) for column in axis]) for axis in centred]
    recursion = FilterRLS(n=7, mu=0.9999, eps=1e-6, w="zeros")
    recursion.w[:3] = np.array(bearing.guess) / guess
    found = np.tile(np.array(bearing.guess), (theta.size, 1))
    for sample in range(int(3 / FILTER_RAD_S * 2 * np.pi / bearing.step), theta.size):
        for axis in range(2):
            recursion.adapt(targets[axis][sample], stacked[axis][:, sample])
        found[sample] = guess * recursion.w[:3]
    return found, np.full_like(found, np.nan), np.ones(theta.size, dtype=bool)


def extended_kalman_filter(data, bearing, noise=None, true=False):
    """Estimates and standard deviations over time for this noise, by default the true one.

    With ``true`` the covariance along the true trajectory without prior knowledge, which is the Cramér–Rao bound.
    """
    measured = np.stack([data["plant.Ym"], data["plant.Zm"]], axis=1)
    truly = np.stack([data["plant.Y"], data["plant.Z"]], axis=1)
    theta, omega, step, e, m = data["plant.theta"], data["plant.omegam"], bearing.step, bearing.direction, bearing.m
    current = magnets(data, "plant.im")
    if true:
        current = magnets(data, "plant.gap") * np.sqrt(magnets(data, "plant.F") / bearing.truth)
    lam, (sigma_x, sigma_i) = np.array(bearing.truth if true else bearing.guess), noise or bearing.noise
    spread = 60 / omega[0] ** 2
    scale = np.array([sigma_x, sigma_x, 1e-3, 1e-3, *lam, spread, spread, 5 * m, 5 * m])
    prior = np.array([1, 1, 1e3, 1e3, *[30] * 3, *[100] * 4]) if true else np.array([1, 1, 200, 200, *[1] * 7])
    x = np.zeros(11)
    x[:2], x[4:7] = measured[0], lam
    p = np.diag(prior**2.0)
    found, std = np.tile(lam, (theta.size, 1)), np.tile(np.inf, (theta.size, 3))
    eye, observe = np.eye(2), np.eye(2, 11)

    def force(where, current, angle, omega):
        """Acceleration per unit of each parameter, i^2/gap^2 of the magnets, and their gaps."""
        gap = bearing.s - e.T @ where
        pull = (current / gap) ** 2
        cos, sin = omega**2 * np.cos(angle), omega**2 * np.sin(angle)
        return np.hstack([e * pull, [[cos, -sin], [sin, cos]], eye]) / m, pull, gap

    for n in range(1, theta.size):
        # Linearised in the middle of the interval; the current is held until the sample.
        middle = 0.5 * (truly[n] + truly[n - 1]) if true else x[:2] + 0.5 * step * x[2:4]
        columns, pull, gap = force(middle, current[n], theta[n] - 0.5 * omega[n] * step, omega[n])
        stiffness = e * (2 * x[4:7] * pull / gap) @ e.T / m
        a = np.eye(11)
        a[:2, :2] += 0.5 * step**2 * stiffness
        a[:2, 2:4] = step * eye + step**3 / 6 * stiffness
        a[2:4, :2] = step * stiffness
        a[2:4, 2:4] += 0.5 * step**2 * stiffness
        a[:2, 4:], a[2:4, 4:] = 0.5 * step**2 * columns, step * columns
        if not true:
            # The motion by Nyström's fourth-order method.
            at = lambda where, part: force(where, current[n], theta[n] - part * omega[n] * step, omega[n])[0] @ x[4:]  # noqa: E731
            begin = at(x[:2], 1)
            half = at(x[:2] + 0.5 * step * x[2:4] + step**2 / 8 * begin, 0.5)
            end = at(x[:2] + step * x[2:4] + 0.5 * step**2 * half, 0)
            x[:2] += step * x[2:4] + step**2 / 6 * (begin + 2 * half)
            x[2:4] += step / 6 * (begin + 4 * half + end)
        shaken = e * (2 * x[4:7] * current[n] / gap**2 * sigma_i) / m
        g = np.vstack([0.5 * step**2 * shaken, step * shaken]) / scale[:4, None]
        a *= scale / scale[:, None]
        p = a @ p @ a.T
        p[:4, :4] += g @ g.T
        # In the units of the state the position noise is 1.
        gain = np.linalg.solve(p[:2, :2] + eye, p[:2]).T
        if not true:
            x += scale * (gain @ (measured[n] - x[:2]) / sigma_x)
        keep = np.eye(11) - gain @ observe
        p = keep @ p @ keep.T + gain @ gain.T
        found[n], std[n] = x[4:7], np.sqrt(np.diag(p)[4:7]) * scale[4:7]
    return found, std, np.ones(theta.size, dtype=bool)


def estimates(bearing, known, estimated):
    """Estimates, standard deviations and validity of every estimator over time, by name."""
    tracks = {KNOWN: own(known)} | ({ESTIMATED: own(estimated)} if estimated else {})
    differences = np.diff(np.stack([known["plant.Ym"][:64], known["plant.Zm"][:64]]), 4)
    guessed = extended_kalman_filter(known, bearing, (np.sqrt(np.mean(differences**2) / 70), 1.5e-2))
    return tracks | {EKF: extended_kalman_filter(known, bearing), EKF_GUESSED: guessed, RLS: recursive_least_squares(known, bearing)}


def judge(bearing, tracks, bound, rows):
    """Per estimator: validity, error/bound and error/standard deviation at the rows, largest error/standard deviation."""
    found = {}
    for name, (hat, std, valid) in tracks.items():
        error = hat - bearing.truth
        with np.errstate(invalid="ignore", divide="ignore"):
            normalised = np.abs(error / std)
        # Evaluated only after a revolution, before which ours is not valid.
        late = valid & (np.arange(valid.size) * bearing.step > 2 * np.pi / bearing.omega)
        worst = np.max(normalised[late], initial=0) if np.isfinite(normalised[late]).all() else np.nan
        found[name] = (valid[rows], error[rows] / bound[rows], normalised[rows], worst)
    return found


def show(title, judged):
    """Print the results of several runs."""
    print(f"\n{title}")
    head = "".join(f"{f'{1e3 * instant:.0f} ms':>20}" for instant in INSTANTS_S)
    print(f"{'error/bound, error/std, valid':30}{head}{'worst/std':>11}")
    for name in judged[0]:
        valid, over_bound, normalised = (np.array([run[name][n] for run in judged]) for n in range(3))
        cells = ""
        for n in range(len(INSTANTS_S)):
            which = valid[:, n]
            rms = [np.sqrt(np.mean(x[which, n] ** 2)) if which.any() else np.nan for x in (over_bound, normalised)]
            words = " ".join("  –  " if np.isnan(value) else f"{value:.2f}" for value in rms)
            cells += f"{f'{words} {which.sum()}/{which.size}':>20}"
        worst = max(run[name][3] for run in judged)
        print(f"{name:30}{cells}{'–' if np.isnan(worst) else f'{worst:.1f}':>11}")


def plot(path, bearing, runs):
    """Plot the largest of the three errors over time: median and range of the runs."""
    import matplotlib

    matplotlib.use("svg")
    import matplotlib.pyplot as plt

    plt.rcParams["svg.hashsalt"] = "peers"
    figure, axes = plt.subplots(figsize=(9, 5), layout="constrained")
    time = np.arange(runs[0][KNOWN][0].shape[0]) * bearing.step
    shown = time >= 0.02
    for name in runs[0]:
        errors = np.array([100 * np.max(np.abs(tracks[name][0] / bearing.truth - 1), axis=1) for tracks in runs])[:, shown]
        errors, colour = np.clip(errors, 1e-3, None), COLOURS[name]
        axes.fill_between(1e3 * time[shown], errors.min(axis=0), errors.max(axis=0), color=colour, alpha=0.15, linewidth=0)
        axes.plot(1e3 * time[shown], np.median(errors, axis=0), color=colour, label=name)
    axes.set(xscale="log", yscale="log", xlabel="time in ms", ylabel="largest error of a force constant in %", ylim=(2e-2, 3e2))
    axes.set_xlim(20, 1e3 * time[-1])
    axes.xaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set_title(f"Unbalance 20 N, load (10, −20) N, 0.1 µm and 10 mA: median of {len(runs)} runs and their range", fontsize=11)
    axes.legend(ncols=2, loc="upper right")
    axes.grid(alpha=0.3)
    figure.savefig(path, metadata={"Date": None})


def main():
    """Run the comparison; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recordings", nargs="*", help="written by: cargo run --release -- simulate SCENARIO --csv FILE")
    parser.add_argument("--bearings", type=int, default=4, help="drawn bearings beside the nominal one (default: %(default)s)")
    parser.add_argument("--seeds", type=int, default=4, help="seeds of the noise of each (default: %(default)s)")
    parser.add_argument("--first", type=int, default=1, help="the first seed of noise and bearings (default: %(default)s)")
    parser.add_argument("--plot", metavar="FILE", help="draws the errors over time of the nominal bearing")
    arguments = parser.parse_args()
    if not arguments.recordings and not PROGRAM.exists():
        print("error: cargo build --release comes first", file=sys.stderr)
        return 1
    bearings = [Bearing()]
    if not arguments.recordings:
        bearings += [draw(arguments.first + n) for n in range(arguments.bearings)]
    everything = []
    for bearing in bearings:
        runs, judged, bound = [], [], None
        with tempfile.TemporaryDirectory() as folder:
            if arguments.recordings:
                pairs = ((read(path), None) for path in arguments.recordings)
            else:
                seeds = range(arguments.first, arguments.first + arguments.seeds)
                pairs = (tuple(read(simulate(bearing, seed, known, Path(folder))) for known in (True, False)) for seed in seeds)
            for known, estimated in pairs:
                if known.get("plant.touchdown.contact", np.zeros(1)).any():
                    print(f"{bearing.name}: the rotor touches down", file=sys.stderr)
                    continue
                bound = extended_kalman_filter(known, bearing, true=True)[1] if bound is None else bound
                rows = [min(round(instant / bearing.step), bound.shape[0] - 1) for instant in INSTANTS_S]
                runs.append(estimates(bearing, known, estimated))
                judged.append(judge(bearing, runs[-1], bound, rows))
        if not runs:
            continue
        last = " ".join(f"{100 * value:.3f}" for value in bound[rows[-1]] / bearing.truth)
        noise = f"{1e6 * bearing.noise[0]:.2f} µm, {1e3 * bearing.noise[1]:.0f} mA"
        show(f"{bearing.name}: {noise}, {len(runs)} seeds; bound in the end {last} %", judged)
        everything += judged
        if arguments.plot and bearing is bearings[0]:
            plot(arguments.plot, bearing, runs)
    if not everything:
        print("error: no run to judge", file=sys.stderr)
        return 1
    if len(bearings) > 1:
        show(f"all: {len(everything)} runs", everything)
    return 0


if __name__ == "__main__":
    sys.exit(main())
