"""
Table 1 on your own photographs
===============================

The paper's Table 1 measures how similar the pre-images of several methods are to the photographs. The command
``nablahog table1`` makes this table for any folder of images.
"""

import csv
import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image
from skimage import data

import nablahog

# %%
# A folder of photographs
# -----------------------
# Here it contains five photographs that scikit-image installs. Yours may have any names and sizes.

folder = tempfile.TemporaryDirectory()
images, output = Path(folder.name) / "images", Path(folder.name) / "out"
images.mkdir()
names = ("astronaut", "camera", "chelsea", "coffee", "rocket")
for name in names:
    photograph = Image.fromarray(getattr(data, name)()).convert("RGB")
    side = min(photograph.size)
    left = (photograph.width - side) // 2
    photograph.crop((left, 0, left + side, side)).save(images / f"{name}.png")

# %%
# The table
# ---------
# The command runs as in a shell. Without ``--workers`` it uses a process for each core. Without ``--methods`` there are
# more methods, and the baselines are learned first, which takes about half an hour, once. ``--size`` and
# ``--max-evaluations`` make it fast here; pre-images are better without them.

METHODS = "uoctti-single,uoctti-learned,dalal-single,dalal-learned"
options = ["--methods", METHODS, "--size", "80", "--max-evaluations", "120", "--workers", "1", "--quiet"]
command = ["nablahog", "table1", "--images", str(images), *options, "-o", str(output)]
subprocess.run([sys.executable, "-m", *command], check=True)
print(*sorted(path.name for path in output.glob("*.*")))

# %%
# The figures
# -----------
# ``per_image.csv`` has a line for each method and image; ``index.html`` shows the table beside the paper's and defines
# every figure.

with (output / "per_image.csv").open() as file:
    rows = list(csv.DictReader(file))
methods = METHODS.split(",")
print(f"{'method':16} {'|CC|':>6} {'MI':>6} {'SSIM':>6} {'distance':>9}   means over {len(names)} photographs")
for method in methods:
    figures = [row for row in rows if row["method"] == method]
    means = [np.mean([float(row[key]) for row in figures]) for key in ("abs_cc", "mi", "ssim", "distance")]
    print(f"{method:16} {means[0]:6.3f} {means[1]:6.3f} {means[2]:6.3f} {means[3]:9.3f}")

# %%

figure, axes = plt.subplots(figsize=(9, 3.4), layout="constrained")
for k, method in enumerate(methods):
    values = [float(row["abs_cc"]) for row in rows if row["method"] == method]
    axes.scatter([k] * len(values), values, color="tab:blue", alpha=0.5, label="a photograph" if k == 0 else "")
    axes.hlines(np.mean(values), k - 0.3, k + 0.3, color="tab:red", label="mean" if k == 0 else "")
axes.set(xticks=range(len(methods)), xticklabels=methods, ylim=(0, 1), ylabel="|CC| with the photograph")
axes.legend(loc="lower left")
plt.show()

for name in ("CC", "MI", "SSIM", "distance"):
    print(f"{name}: {nablahog.metrics.DEFINITIONS[name]}")
folder.cleanup()

# %%
# |CC| is the magnitude of CC. It is used because ``dalal`` has unsigned gradients: a photograph and its negative have
# the same descriptor. These pre-images have the smallest distances here, but are the least similar to the photographs:
# the descriptor does not contain which regions are bright.
