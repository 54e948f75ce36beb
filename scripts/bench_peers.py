#!/usr/bin/env python3
"""Compare the estimator FMU with an estimator in Python, both through fmpy, and with numpy and SciPy alone.

    scripts/bench_peers.py [--ssp target/fmu/MagneticBearing.ssp]

The peer is P(20) with aligned signs (method `paper`) in numpy, exported by PythonFMU; its sums are products of a weight matrix
and the window. A second peer computes sums and low-pass with SciPy, sample by sample: `scipy.signal.lfilter` with its state. All
get the same samples in turns of some hundred steps. Prints medians and quartiles of the turns, and the median of the ratios turn by
turn. Needs the packages of `requirements-bench.txt`.
"""

import argparse
import io
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time
import zipfile

import fmpy
import numpy
from fmpy.fmi2 import FMU2Slave

HERE = pathlib.Path(__file__).resolve().parent.parent
TURNS, STEPS = 60, 200
STEP_S = 1e-4
INPUTS = ["Ym", "Zm", "im[1]", "im[2]", "im[3]"]
OUTPUTS = ["lambdaHat[1]", "lambdaHat[2]", "lambdaHat[3]"]

# The peer must be a separate file, because PythonFMU packs it.
PEER = '''
"""P(20) with aligned signs in numpy."""
import numpy
from pythonfmu import Fmi2Causality, Fmi2Slave, Real

N, STEP_S, MASS, GAP = 200, 1e-4, 6.7, 5e-4
ALPHA = numpy.array([numpy.pi, -numpy.pi / 3, numpy.pi / 3])
OMEGA, ZETA = 15.0, 0.707


def weights():
    """Weights of the positions, of the starts and of the ends of the hold intervals, one row per kernel."""
    between = numpy.arange(N) + 0.5
    rows = []
    for n, sign in ((3, 1.0), (4, -1.0), (5, 1.0)):
        a, b = between / N, 1 - between / N
        cut = lambda x: x * x - 0.25 / N**2
        psi = a ** (n - 2) * cut(a) * b * cut(b)
        phi = numpy.zeros(N + 1)
        phi[1:N] = sign / 6 * N * numpy.diff(psi)
        rows.append(phi)
    phi = numpy.array(rows)
    padded = numpy.pad(phi, ((0, 0), (1, 1)))
    position = (padded[:, 2:] - 2 * phi + padded[:, :-2]) * N
    start, end = numpy.zeros_like(phi), numpy.zeros_like(phi)
    start[:, 1:] = (2 * phi[:, :-1] + phi[:, 1:]) / (6 * N)
    end[:, 1:] = (phi[:, :-1] + 2 * phi[:, 1:]) / (6 * N)
    scale = 1 / numpy.sqrt((position**2).sum(axis=1, keepdims=True))
    return position * scale, start * scale, end * scale


class Estimation:
    """The estimator of P(20)."""

    def __init__(self):
        self.position, self.start, self.end = weights()
        self.window = numpy.zeros((7, 2 * (N + 1)))
        self.next, self.filled = 0, 0
        self.inverse = numpy.zeros((2, 3))
        self.value, self.rate = numpy.zeros(4), numpy.zeros(4)
        loss = ZETA * OMEGA * STEP_S + (OMEGA * STEP_S) ** 2 / 4
        self.decay, self.drive = (1 - loss) / (1 + loss), OMEGA**2 * STEP_S / (1 + loss)
        self.columns = (N * STEP_S) ** 2 / MASS * numpy.cos(ALPHA)
        self.estimate = numpy.full(3, 4e-6)

    def sample(self, y, z, currents):
        inverse = 1 / (GAP - numpy.sin(ALPHA) * y - numpy.cos(ALPHA) * z) ** 2
        curvature = (inverse - 2 * self.inverse[0] + self.inverse[1]) / 12 if self.filled > 1 else 0.0
        square = currents * currents if self.filled else 0 * currents
        column = numpy.concatenate([[z], square * (self.inverse[0] - curvature), square * (inverse - curvature)])
        self.inverse[1], self.inverse[0] = self.inverse[0], inverse
        self.window[:, self.next] = self.window[:, self.next + N + 1] = column
        self.next = (self.next + 1) % (N + 1)
        self.filled += 1
        if self.filled <= N:
            return self.estimate
        window = self.window[:, self.next : self.next + N + 1]
        right = self.position @ window[0]
        matrix = (self.start @ window[1:4].T + self.end @ window[4:7].T) * self.columns
        determinant = numpy.linalg.det(matrix)
        cramer = numpy.repeat(matrix[None], 3, axis=0)
        cramer[numpy.arange(3), :, numpy.arange(3)] = right
        inputs = numpy.append(numpy.linalg.det(cramer), determinant) * numpy.sign(determinant)
        rate = self.decay * self.rate + self.drive * (inputs - self.value)
        self.value += STEP_S / 2 * (self.rate + rate)
        self.rate = rate
        self.estimate = self.value[:3] / self.value[3]
        return self.estimate


class WithScipy(Estimation):
    """The same with SciPy's filters: an FIR filter per kernel, and a biquad as low-pass."""

    def __init__(self):
        from scipy import signal

        super().__init__()
        self.lfilter = signal.lfilter
        # Impulse responses are the reversed kernels.
        self.responses = [kernel[:, ::-1] for kernel in (self.position, self.start, self.end)]
        self.states = [[numpy.zeros((rows, N)) for _ in range(3)] for rows in (1, 3, 3)]
        self.low = signal.bilinear([OMEGA**2], [1, 2 * ZETA * OMEGA, OMEGA**2], 1 / STEP_S)
        self.low_state = numpy.zeros((4, 2))

    def sums(self, group, signals):
        """The three integrals of every signal after one more sample."""
        result = numpy.empty((3, len(signals)))
        for i, response in enumerate(self.responses[group]):
            state = self.states[group][i]
            value, self.states[group][i] = self.lfilter(response, [1.0], signals[:, None], zi=state)
            result[i] = value[:, 0]
        return result

    def sample(self, y, z, currents):
        inverse = 1 / (GAP - numpy.sin(ALPHA) * y - numpy.cos(ALPHA) * z) ** 2
        curvature = (inverse - 2 * self.inverse[0] + self.inverse[1]) / 12 if self.filled > 1 else 0.0
        square = currents * currents if self.filled else 0 * currents
        right = self.sums(0, numpy.array([z]))[:, 0]
        matrix = self.sums(1, square * (self.inverse[0] - curvature)) + self.sums(2, square * (inverse - curvature))
        self.inverse[1], self.inverse[0] = self.inverse[0], inverse
        self.filled += 1
        if self.filled <= N:
            return self.estimate
        matrix = matrix * self.columns
        determinant = numpy.linalg.det(matrix)
        cramer = numpy.repeat(matrix[None], 3, axis=0)
        cramer[numpy.arange(3), :, numpy.arange(3)] = right
        inputs = numpy.append(numpy.linalg.det(cramer), determinant) * numpy.sign(determinant)
        value, self.low_state = self.lfilter(*self.low, inputs[:, None], zi=self.low_state)
        self.estimate = value[:3, 0] / value[3, 0]
        return self.estimate


class Peer(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.y = self.z = self.i1 = self.i2 = self.i3 = 0.0
        self.l1 = self.l2 = self.l3 = 4e-6
        for name in ("y", "z", "i1", "i2", "i3"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        for name in ("l1", "l2", "l3"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))
        self.estimation = Estimation()

    def do_step(self, current_time, step_size):
        estimate = self.estimation.sample(self.y, self.z, numpy.array([self.i1, self.i2, self.i3]))
        self.l1, self.l2, self.l3 = map(float, estimate)
        return True
'''


def unzip(archive):
    """An FMU unzipped, with its model description."""
    folder = tempfile.mkdtemp(prefix="peer-")
    zipfile.ZipFile(archive).extractall(folder)
    return folder, fmpy.read_model_description(folder)


class Fmu:
    """An FMU instance that processes samples."""

    def __init__(self, folder, description, inputs, outputs, integers=()):
        references = {variable.name: variable.valueReference for variable in description.modelVariables}
        self.inputs = [references[name] for name in inputs]
        self.outputs = [references[name] for name in outputs]
        self.fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="bench",
        )
        self.fmu.instantiate()
        for name, value in integers:
            self.fmu.setInteger([references[name]], [value])
        self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        self.steps, self.stepping = 0, 0.0

    def step(self, sample):
        self.fmu.setReal(self.inputs, sample)
        since = time.perf_counter()
        self.fmu.doStep(currentCommunicationPoint=self.steps * STEP_S, communicationStepSize=STEP_S)
        self.stepping += time.perf_counter() - since
        self.steps += 1
        return self.fmu.getReal(self.outputs)


def record():
    """Samples of the paper's orbit: positions, and the currents required for it."""
    theta = numpy.arange(STEPS) * 2 * numpy.pi / STEPS
    position = numpy.array([30e-6 * numpy.cos(theta), 70e-6 * numpy.sin(theta)])
    alpha = numpy.array([numpy.pi, -numpy.pi / 3, numpy.pi / 3])
    direction = numpy.array([numpy.sin(alpha), numpy.cos(alpha)])
    force = -6.7 * (100 * numpy.pi) ** 2 * position
    # Two of three magnets carry the force; another 20 N in all of them cancel.
    magnets = numpy.linalg.pinv(direction) @ force
    magnets += 20 - magnets.min(axis=0)
    gap = 5e-4 - direction.T @ position
    currents = gap * numpy.sqrt(magnets / numpy.array([1.8e-6, 2.0e-6, 2.2e-6])[:, None])
    return numpy.vstack([position, currents]).T.tolist()


def report(title, spent, base):
    """Print medians, quartiles, and median ratios turn by turn, without the first turns, which fill the windows."""
    print(f"\n| {title}, through fmpy | median | quartiles | ratio |\n|---|---:|---|---:|")
    for name, times in spent.items():
        low, median, high = numpy.percentile(times[4:], [25, 50, 75])
        ratio = numpy.median(numpy.array(times[4:]) / numpy.array(spent[base][4:]))
        print(f"| {name} | {median:.2f} µs | {low:.2f} … {high:.2f} µs | {ratio:.1f} |")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--ssp", type=pathlib.Path, default=HERE / "target" / "fmu" / "MagneticBearing.ssp")
    arguments = parser.parse_args()

    folder = pathlib.Path(tempfile.mkdtemp(prefix="peer-"))
    (folder / "peer.py").write_text(PEER)
    command = [sys.executable, "-m", "pythonfmu", "build", "-f", "peer.py", "--dest", "."]
    subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)
    archive = zipfile.ZipFile(arguments.ssp).read("resources/AlgebraicEstimator.fmu")
    own = unzip(io.BytesIO(archive))

    namespace = {"__name__": "peer"}
    exec(compile(PEER, "peer.py", "exec"), namespace)
    alone, filters = namespace["Estimation"](), namespace["WithScipy"]()
    paper, default, python = "AlgebraicEstimator.fmu, paper", "AlgebraicEstimator.fmu, predictionError", "PythonFMU, paper"
    fmus = {
        paper: Fmu(*own, INPUTS, OUTPUTS, [("method", 2)]),
        default: Fmu(*own, INPUTS, OUTPUTS),
        python: Fmu(*unzip(next(folder.glob("*.fmu"))), ["y", "z", "i1", "i2", "i3"], ["l1", "l2", "l3"]),
    }
    candidates = {name: fmu.step for name, fmu in fmus.items()}
    candidates["numpy alone, paper"] = lambda s: alone.sample(s[0], s[1], numpy.array(s[2:]))
    candidates["SciPy alone, paper"] = lambda s: filters.sample(s[0], s[1], numpy.array(s[2:]))
    samples = record()
    spent = {name: [] for name in candidates}
    stepping = {name: [] for name in fmus}
    last = {}
    for _ in range(TURNS):
        for name, step in candidates.items():
            if name in fmus:
                fmus[name].stepping = 0.0
            since = time.perf_counter()
            for sample in samples:
                result = step(sample)
            spent[name].append((time.perf_counter() - since) / len(samples) * 1e6)
            if name in fmus:
                stepping[name].append(fmus[name].stepping / len(samples) * 1e6)
            last[name] = numpy.array(result)
    report("set 5, step, get 3", spent, paper)
    report("doStep alone", stepping, paper)
    for name in (python, "SciPy alone, paper"):
        difference = numpy.abs(last[paper] / last[name] - 1).max()
        print(f"\nlargest difference of the estimates of {name}, relative: {difference:.1e}")
    shutil.rmtree(folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
