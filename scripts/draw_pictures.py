"""Draw the pictures of README from a run: docs/pictures/*.svg.

Usage, with matplotlib (scripts/requirements-peers.txt):

    python scripts/draw_pictures.py            # runs the scenario and draws
    python scripts/draw_pictures.py --csv FILE # draws a recording of `simulate --csv`
    python scripts/draw_pictures.py --browser chromium #  also takes the first screen of its report page

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
    """Draw the estimates over time with two standard deviations.

    Parameters
    ----------
    columns : dict of str to list of float
        The recording.
    axes : matplotlib.axes.Axes
        Where to.
    """
    # A millisecond is less than the width of a line.
    columns = {name: values[::10] for name, values in columns.items()}
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
    axes.annotate("update", (204, 1.56), color=GREY)
    axes.legend(frameon=False, labelcolor=GREY, ncols=3, loc="upper right")


def draw_orbit(columns, axes):
    """Draw the tracking error, two revolutions before the update and the last two.

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
    for rows, colour, label in ((slice(1600, 2001, 2), COLOURS[1], "before"), (slice(3600, 4001, 2), COLOURS[0], "after")):
        axes.plot(errors["Y"][rows], errors["Z"][rows], color=colour, linewidth=1, label=label)
    axes.set(xlabel="error of y [µm]", ylabel="error of z [µm]", aspect="equal")
    axes.legend(frameon=False, labelcolor=GREY, loc="lower left", handlelength=1)


def photograph(browser, page, path):
    """Take a picture of a report's first screen, with the animation stopped at 0.117 s.

    Parameters
    ----------
    browser : str
        Chromium or one of its kind.
    page : pathlib.Path
        The report.
    path : pathlib.Path
        PNG to write.
    """
    with tempfile.TemporaryDirectory() as profile:
        subprocess.run([
            browser, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
            "--disable-background-networking", "--disable-component-update", "--hide-scrollbars", f"--user-data-dir={profile}",
            "--window-size=1280,900", "--virtual-time-budget=10000", f"--screenshot={path}", f"{page.resolve().as_uri()}#t=0.117",
        ], check=True, capture_output=True)


def main():
    """Draw all pictures; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--csv", type=Path, help="a recording of the scenario experiment, instead of running it")
    parser.add_argument("--browser", help="Chromium or a browser based on it, to take a picture of the report as well")
    arguments = parser.parse_args()

    import matplotlib

    matplotlib.use("svg")
    import matplotlib.pyplot as plt

    plt.rcParams.update({
        "svg.hashsalt": "pictures", "font.size": 10, "text.color": GREY, "axes.labelcolor": GREY, "axes.edgecolor": GREY,
        "xtick.color": GREY, "ytick.color": GREY, "axes.spines.top": False, "axes.spines.right": False,
    })
    FOLDER.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        path = arguments.csv or Path(folder) / "run.csv"
        if not arguments.csv or arguments.browser:
            command = ["cargo", "run", "--release", "--quiet", "--", "simulate", SCENARIO, "--csv", f"{folder}/run.csv", "--report", folder]
            subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
        if arguments.browser:
            photograph(arguments.browser, Path(folder) / "index.html", FOLDER / "report.png")
            print("drew docs/pictures/report.png")
        columns = read(path)
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 3.4), width_ratios=(5, 3), layout="constrained")
    draw_convergence(columns, left)
    draw_orbit(columns, right)
    path = FOLDER / "experiment.svg"
    figure.savefig(path, transparent=True, metadata={"Date": None})
    print(f"drew {path.relative_to(ROOT)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
