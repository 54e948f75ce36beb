# %% [markdown]
# # A magnetic bearing with your own controller
#
# The plant and the estimator are FMUs. The controller is a Python function: a PID for each axis. You can put your own in its
# place. Build the FMUs first: `cargo run --release` leaves them in `target/fmu`.

# %%
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

project = next(folder for folder in [Path.cwd(), *Path.cwd().parents] if (folder / "Cargo.toml").is_file())
sys.path.insert(0, str(project / "scripts"))
from closed_loop import read_system, run

# %% [markdown]
# ## The original loop
#
# `MagneticBearing.ssp` holds the three FMUs, their wiring, and a rotor with unbalance. Parameters are set by their names;
# all of them are in `modelDescription/VARIABLES.md`.

# %%
loop = read_system(project / "target" / "fmu" / "MagneticBearing.ssp")
plant_parameters = loop.elements["plant"][1]
plant_parameters |= {"sensor.positionNoise": 1e-7, "sensor.currentNoise": 0.01}
rows = run(loop, stop_s=0.3)


def show(rows, title):
    """Plot the orbit, the currents and the estimated force constants."""
    figure, (orbit, currents, estimates) = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    figure.suptitle(title)
    orbit.plot(rows["plant.Y"] * 1e6, rows["plant.Z"] * 1e6, linewidth=0.7)
    orbit.set(xlabel="y in µm", ylabel="z in µm", aspect="equal")
    for k in (1, 2, 3):
        currents.plot(rows["time"], rows[f"plant.im[{k}]"], linewidth=0.7, label=f"i{k}")
        valid = rows["estimator.valid"] == 1.0
        estimate = np.where(valid, rows[f"estimator.lambdaHat[{k}]"], np.nan) * 1e6
        (line,) = estimates.plot(rows["time"], estimate, label=f"λ{k}")
        estimates.axhline(plant_parameters.get(f"lambda[{k}]", (1.8e-6, 2.0e-6, 2.2e-6)[k - 1]) * 1e6, color=line.get_color(), dashes=(4, 4))
    currents.set(xlabel="time in s", ylabel="current in A")
    estimates.set(xlabel="time in s", ylabel="force constant in 10⁻⁶ N·m²/A²", title="while valid; dashed: the truth")
    currents.legend()
    estimates.legend()


show(rows, "The controller of this project")

# %% [markdown]
# ## A PID in its place
#
# All magnets carry a bias current; the PID adds a difference that pulls the rotor to its reference. At the bias the
# bearing has the force-current factor 3 λ i₀/s² and the negative stiffness 3 λ i₀²/s³ on both axes. The gains place three
# poles at `bandwidth`, for a guess of λ: the PID does not need the estimate.

# %%
step_s = 1e-4
mass, gap, guess, bias = 6.7, 5e-4, 2e-6, 1.5
bandwidth = 350.0
omega = 2 * np.pi * 50
# Directions (y, z) of the magnets at the angles π, -π/3, π/3.
alpha = np.array([np.pi, -np.pi / 3, np.pi / 3])
directions = np.column_stack([np.sin(alpha), np.cos(alpha)])

current_factor = 3 * guess * bias / gap**2
stiffness = 3 * guess * bias**2 / gap**3
proportional = (3 * mass * bandwidth**2 + stiffness) / current_factor
derivative = 3 * mass * bandwidth / current_factor
integral = mass * bandwidth**3 / current_factor


class Pid:
    """A PID for both axes, with a filtered derivative."""

    def __init__(self):
        self.sum = np.zeros(2)
        self.slope = np.zeros(2)
        self.last = None

    def __call__(self, time_s, inputs):
        """From the measured positions to the currents of the next step."""
        reference = np.array([30e-6 * np.cos(omega * time_s), 70e-6 * np.sin(omega * time_s)])
        error = reference - np.array([inputs["Ym"], inputs["Zm"]])
        if self.last is not None:
            self.slope += 0.4 * ((error - self.last) / step_s - self.slope)
        self.last = error
        self.sum += error * step_s
        pull = proportional * error + derivative * self.slope + integral * self.sum
        currents = np.clip(bias + directions @ pull, 0.0, 10.0)
        return {f"i[{k}]": current for k, current in enumerate(currents, 1)}


loop.elements["controller"] = (Pid(), {"i[1]": bias, "i[2]": bias, "i[3]": bias})
rows = run(loop, stop_s=0.4)
show(rows, "A PID")

# %% [markdown]
# ## Estimates
#
# The estimator needs only positions, currents and the angle of the rotor; it knows nothing of the controller.

# %%
for k in (1, 2, 3):
    estimate, std = (rows[f"estimator.{name}[{k}]"][-1] for name in ("lambdaHat", "lambdaStdTotal"))
    print(f"λ{k} = ({estimate * 1e6:.4f} ± {std * 1e6:.4f}) 10⁻⁶ N·m²/A²")
unbalance = rows["estimator.unbalance.magnitude"][-1]
print(f"unbalance = {unbalance * 1e6:.1f} g·mm, in truth {plant_parameters['unbalance.magnitude'] * 1e6:.1f} g·mm")
if not rows["estimator.valid"][-1]:
    raise RuntimeError("the estimate is not valid")
plt.show()
