"""Draw the pictures of README from a run: docs/pictures/*.svg.

Usage, with matplotlib (scripts/requirements-peers.txt):

    python scripts/draw_pictures.py            # runs the scenario and draws
    python scripts/draw_pictures.py --csv FILE # draws a recording of `simulate --csv`

The same run makes the same files. The background is transparent and text is grey, so that they serve light and dark pages.
"""

import argparse
import csv
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "docs" / "pictures"
SCENARIO = "experiment"
TRUTH = (2.53, 2.04, 2.42)
COLOURS = ("#0072b2", "#d55e00", "#009e73")
GREY = "#7d8590"


def read(path):
    """Read a recording.

    Parameters
    ----------
    path : pathlib.Path
        CSV with names and units in its header.

    Returns
    -------
    dict of str to list of float
        Columns by their names without units.
    """
    with open(path, encoding="utf-8", newline="") as file:
        rows = csv.reader(file)
        names = [cell.split(" [")[0] for cell in next(rows)]
        return dict(zip(names, map(list, zip(*([float(cell) for cell in row] for row in rows)))))


def draw_convergence(columns, axes):
    """Draw the estimates over time with two stated standard deviations.

    Parameters
    ----------
    columns : dict of str to list of float
        The recording.
    axes : matplotlib.axes.Axes
        Where to.
    """
    time = [1e3 * t for t in columns["time"]]
    valid = [value == 1 for value in columns["estimator.valid"]]
    for k, colour in enumerate(COLOURS, 1):
        hat = [1e6 * value for value in columns[f"estimator.lambdaHat[{k}]"]]
        std = [2e6 * value for value in columns[f"estimator.lambdaStdTotal[{k}]"]]
        low, high = [h - s for h, s in zip(hat, std)], [h + s for h, s in zip(hat, std)]
        axes.fill_between(time, low, high, where=valid, color=colour, alpha=0.25, linewidth=0)
        axes.plot(time, [h if v else float("nan") for h, v in zip(hat, valid)], color=colour, label=f"$\\hat\\lambda_{k}$")
        axes.plot(time, [float("nan") if v else h for h, v in zip(hat, valid)], ":", color=colour)
        axes.axhline(TRUTH[k - 1], color=colour, linewidth=0.7, linestyle="--")
    axes.set(xlabel="time [ms]", ylabel="force constants [10⁻⁶ N·m²/A²]", ylim=(1.5, 4.2), xlim=(0, time[-1]))
    axes.axvline(200, color=GREY, linewidth=0.8, linestyle=":")
    axes.annotate("update", (204, 3.95), color=GREY)
    axes.legend(frameon=False, labelcolor=GREY, ncols=3, loc="upper right")


def draw_orbit(columns, axes):
    """Draw the error of the path, two revolutions before the update and the last two.

    Parameters
    ----------
    columns : dict of str to list of float
        The recording, at 3000 rpm with an update at 0.2 s.
    axes : matplotlib.axes.Axes
        Where to.
    """
    errors = {
        axis: [1e6 * (is_ - ought) for is_, ought in zip(columns[f"plant.{axis}"], columns[f"controller.reference.{axis}"])]
        for axis in "YZ"
    }
    for rows, colour, label in ((slice(1600, 2001), COLOURS[1], "before"), (slice(3600, 4001), COLOURS[0], "after")):
        axes.plot(errors["Y"][rows], errors["Z"][rows], color=colour, linewidth=1, label=label)
    axes.set(xlabel="error of y [µm]", ylabel="error of z [µm]", aspect="equal")
    axes.legend(frameon=False, labelcolor=GREY)


def main():
    """Draw all pictures; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--csv", type=Path, help="a recording of the scenario experiment, instead of running it")
    arguments = parser.parse_args()

    import matplotlib

    matplotlib.use("svg")
    import matplotlib.pyplot as plt

    plt.rcParams.update({
        "svg.hashsalt": "pictures", "font.size": 10, "text.color": GREY, "axes.labelcolor": GREY, "axes.edgecolor": GREY,
        "xtick.color": GREY, "ytick.color": GREY, "axes.spines.top": False, "axes.spines.right": False,
    })
    if arguments.csv:
        columns = read(arguments.csv)
    else:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "run.csv"
            command = ["cargo", "run", "--release", "--quiet", "--", "simulate", SCENARIO, "--csv", str(path)]
            subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
            columns = read(path)
    FOLDER.mkdir(parents=True, exist_ok=True)
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 3.4), width_ratios=(5, 3), layout="constrained")
    draw_convergence(columns, left)
    draw_orbit(columns, right)
    path = FOLDER / "experiment.svg"
    figure.savefig(path, transparent=True, metadata={"Date": None})
    print(f"drew {path.relative_to(ROOT)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
