"""Compare the whirl of the spindle with ROSS, a rotordynamics package: natural frequencies and unbalance response over speed.

    cargo build --release
    python3 -m venv .venv-ross && .venv-ross/bin/pip install -r scripts/requirements-ross.txt
    .venv-ross/bin/python scripts/whirl_peers.py

ROSS uses finite elements: the rigid shaft is a nearly massless, nearly rigid one with a disc that has the mass and the inertia. The exit
code is 1 if a frequency or an amplitude differs by more than 0.5 %.
"""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import ross

PROGRAM = Path(__file__).resolve().parents[1] / "target" / "release" / "magnetic-bearing"
# The built-in scenario `spindle`; SI units.
MASS, TRANSVERSE, POLAR = 12.0, 0.16, 0.02
BEARINGS = (-0.12, 0.15)
UNBALANCES = ((8e-5, 0.7, -0.08), (5e-5, -1.9, 0.10))
STIFFNESS, DAMPING = 2e6, 200.0
GREATEST_RPM = 12000
TOLERANCE = 5e-3


def ours(damping):
    """Rows of the table of `whirl`: rpm, four frequencies in Hz (two modes, backward and forward), amplitude in µm and angle at A and at B."""
    command = [str(PROGRAM), "whirl", "spindle", f"--stiffness={STIFFNESS}", f"--damping={damping}", f"--to={GREATEST_RPM}"]
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    rows = [line.split() for line in text.splitlines() if re.match(r"\s+\d", line)]
    return np.array([[float(cell) for cell in row] for row in rows if len(row) == 9])


def rotor(damping):
    """The same rotor in ROSS, with a node at the centre of gravity, at each bearing and at each plane of unbalance."""
    nodes = sorted({0.0, *BEARINGS, *(position for _, _, position in UNBALANCES)})
    stiff = ross.Material("stiff", rho=1e-6, E=1e16, G_s=4e15)
    lengths = np.diff(nodes)
    shaft = [ross.ShaftElement(L=length, idl=0.0, odl=0.1, material=stiff, gyroscopic=False) for length in lengths]
    disc = ross.DiskElement(n=nodes.index(0.0), m=MASS, Id=TRANSVERSE, Ip=POLAR)
    bearings = [ross.BearingElement(n=nodes.index(at), kxx=STIFFNESS, cxx=damping) for at in BEARINGS]
    return ross.Rotor(shaft, [disc], bearings), nodes


def main():
    """Compare; return the exit code."""
    worst = 0.0
    model, _ = rotor(0.0)
    print("natural frequencies in Hz, ours / ROSS")
    for row in ours(0.0):
        found = np.sort(model.run_modal(row[0] * np.pi / 30, num_modes=16).wn)
        found = found[found > 2 * np.pi] / (2 * np.pi)
        mine = np.sort(row[1:5])
        theirs = np.sort(np.unique(np.round(found, 6)))[:4] if row[0] else np.repeat(np.unique(np.round(found, 3))[:2], 2)
        worst = max(worst, np.max(np.abs(mine / theirs - 1)))
        print(f"{row[0]:7.0f} rpm  " + "  ".join(f"{a:9.4f} / {b:9.4f}" for a, b in zip(mine, theirs)))
    model, nodes = rotor(DAMPING)
    print("unbalance response in µm at A and B, ours / ROSS")
    rows = ours(DAMPING)[1:]
    planes = [nodes.index(position) for _, _, position in UNBALANCES]
    response = model.run_unbalance_response(
        planes, [size for size, _, _ in UNBALANCES], [angle for _, angle, _ in UNBALANCES], rows[:, 0] * np.pi / 30
    ).forced_resp
    degrees = model.number_dof
    for column, row in enumerate(rows):
        theirs = [1e6 * abs(response[degrees * nodes.index(at), column]) for at in BEARINGS]
        mine = [row[5], row[7]]
        worst = max(worst, np.max(np.abs(np.array(mine) / theirs - 1)))
        print(f"{row[0]:7.0f} rpm  " + "  ".join(f"{a:9.4f} / {b:9.4f}" for a, b in zip(mine, theirs)))
    print(f"largest difference {100 * worst:.3f} %")
    return int(worst > TOLERANCE)


if __name__ == "__main__":
    sys.exit(main())
