"""Pictures of the README: `python docs/picture.py` fits a model and writes figures/overview.png.

It also writes figures/gallery.png, the thumbnails of the gallery, where the site has been built.
A minute on two cores. Top: accelerations with 5 % noise, as sensors see them; what the fitted
network simulates of another motion from its forces alone; the force that no sensor saw. Bottom:
stiffnesses with their intervals; published models, one step ahead and in free run.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import torch
from PIL import Image

from models.zoo.index import entries
from runner import train

ROOT = Path(__file__).parents[1]
PICTURE = ROOT / "docs/figures/overview.png"
THUMBNAILS = ROOT / "docs/gallery/images/thumb"
SHEET, COLUMNS, CELL = ROOT / "docs/figures/gallery.png", 4, (250, 175)  # pixels
MOST = 1000.0  # [%] where a free run diverges
SENSORS = {"model/reads": "accelerations", "scenario": "noisy", "scenario.level": 0.05}

run = train(
    "baselines=none",
    "figures=false",
    "data.train_records=4",
    **SENSORS,
    folder=ROOT / "build/overview",
    model="element_network",
    system="bilinear",
    seed=0,
)
(test, *_) = run.records["test"]
motion = run.model.free_run(test.drive())
y, r = run.model.element_loops(test.drive())

plt.rcParams.update({"font.size": 12, "axes.titlesize": 12, "axes.grid": True, "grid.alpha": 0.3})
figure, ((wave, loop), (bars, errors)) = plt.subplots(2, 2, figsize=(9, 7), layout="constrained")
shown = slice(1000, 1500)
t = test.dt * torch.arange(test.samples)
wave.plot(t[shown], test.a[shown, 0], color="0.7", lw=4, label="measured")
wave.plot(t[shown], motion.a[shown, 0], color="C3", lw=1.2, label="simulated")
error = run.metrics["free_run"]["relative_rms_percent_true"]
wave.set(
    title=f"Unseen motion, simulated: {error:.1f} % error",
    xlabel="time [s]",
    ylabel="acceleration of x1 [m/s²]",
)
wave.legend(loc="upper right", ncols=2, fontsize=10)

ours, true = 3, 1  # between x1 and x2, in the order of the network and of the structure
loop.plot(test.truth.y[shown, true], test.truth.r[shown, true], color="0.7", lw=4, label="true")
loop.plot(y[shown, ours], r[shown, ours], color="C3", lw=1, label="identified")
loop.set(
    title="A slipping joint, which no sensor saw", xlabel="deformation [m]", ylabel="force [N]"
)
loop.legend(fontsize=10)

stiffness = [
    one
    for one in run.metrics["uncertainty"]["parameters"]
    if one["name"].endswith(".stiffness") and one["name"].count(".") == 1
]
names = [one["name"].partition(".")[0] for one in stiffness]
bars.errorbar(
    names,
    [one["value"] for one in stiffness],
    [one["believed"] for one in stiffness],
    fmt="o",
    color="C3",
    capsize=5,
    label="identified, 95 %",
)
bars.scatter(
    names, [one["truth"] for one in stiffness], marker="_", s=500, color="0.3", label="true"
)
bars.set(title="How sure: stiffness of each element", ylabel="stiffness [N/m]")
bars.legend(fontsize=10)

zoo = [one for one in entries() if one.system == "bilinear"]
zoo.sort(key=lambda one: float(one.facts["one_step_percent"]), reverse=True)
for row, entry in enumerate(zoo):
    ahead, free = (entry.facts[f"{way}_percent"] for way in ("one_step", "free_run"))
    errors.plot(float(ahead), row, "o", color="C0", label="one step ahead" if row == 0 else None)
    place = free if isinstance(free, float) else MOST
    errors.plot(
        place,
        row,
        ">" if place == MOST else "s",
        color="C3",
        label="simulated" if row == 0 else None,
    )
errors.set(xscale="log", title="What one step ahead does not show", xlabel="error [%]; ▸ diverges")
errors.set_yticks(range(len(zoo)), [one.model for one in zoo], fontsize=9)
errors.legend(fontsize=10, loc="lower left")
figure.savefig(PICTURE, dpi=100)
Image.open(PICTURE).quantize(64).save(PICTURE, optimize=True)

thumbnails = sorted(THUMBNAILS.glob("*.png"))
if thumbnails:
    rows = -(-len(thumbnails) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * CELL[0], rows * CELL[1]), "white")
    for number, path in enumerate(thumbnails):
        one = Image.open(path).convert("RGB").resize((CELL[0] - 10, CELL[1] - 10))
        sheet.paste(one, (number % COLUMNS * CELL[0], number // COLUMNS * CELL[1]))
    sheet.quantize(64).save(SHEET, optimize=True)
