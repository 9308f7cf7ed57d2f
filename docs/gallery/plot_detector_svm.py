"""
What does my SVM see?
=====================

A linear SVM on HOG has one weight for each entry of the descriptor. So its weights can be drawn as glyphs, and
``reconstruct_template`` finds the image that they ask for.
"""

import matplotlib.pyplot as plt
import numpy as np
import torch
from PIL import Image
from skimage import data
from sklearn.svm import LinearSVC

import nablahog
from nablahog.invert import reconstruct_template

SIZE = 96, 96
generator = np.random.default_rng(0)

# %%
# Data: chairs and no chairs
# --------------------------
# Negative examples are crops of photographs. Positive examples are the chairs that come with the package, rendered
# from the left in front of other crops. Three of four chairs are for training, the others for the test.

photographs = [Image.fromarray(p).convert("L") for p in (data.astronaut(), data.coffee(), data.rocket(), data.camera())]


def crops(count: int) -> torch.Tensor:
    """Gray crops (count, 1, H, W) in 0…1 of the photographs, at random places and of random sizes."""
    result = []
    for k in range(count):
        photograph = photographs[k % len(photographs)]
        side = int(generator.integers(96, 300))
        x, y = (int(generator.integers(0, n - side)) for n in photograph.size)
        result.append(np.asarray(photograph.crop((x, y, x + side, y + side)).resize(SIZE)))
    return torch.from_numpy(np.stack(result))[:, None] / 255


def chairs(meshes: list[nablahog.Mesh]) -> torch.Tensor:
    """Chairs (len(meshes), 1, H, W) at azimuths of 35° to 55°, each in front of a crop."""
    camera = nablahog.Camera.from_field_of_view(30, *SIZE)
    result = []
    for mesh, behind in zip(meshes, crops(len(meshes)), strict=True):
        pose = torch.tensor([[generator.uniform(35, 55), generator.uniform(10, 20), 2.4, 0, 0, 0]])
        result.append(nablahog.render(mesh, pose, camera, background=behind[None], supersampling=2))
    return torch.cat(result)


meshes = list(nablahog.sample_chairs().values())
known, unknown = [mesh for k, mesh in enumerate(meshes) if k % 4], meshes[::4]
training = torch.cat([chairs(2 * known), crops(300)])
labels = np.repeat([1, 0], [60, 300])
test = torch.cat([chairs(3 * unknown), crops(300)])
test_labels = np.repeat([1, 0], [30, 300])

# %%
# Train
# -----

spec = nablahog.presets.uoctti(cell_size=8)
classifier = LinearSVC(C=0.01, class_weight="balanced", random_state=0)
classifier.fit(nablahog.hog(training, spec).flatten(1).numpy(), labels)
scores = classifier.decision_function(nablahog.hog(test, spec).flatten(1).numpy())
print(f"test: {(scores[test_labels == 1] > 0).mean():.0%} of 30 chairs and", end=" ")
print(f"{(scores[test_labels == 0] > 0).mean():.0%} of 300 crops without a chair are taken for one")

# %%
# Look at the weights
# -------------------
# A template is no descriptor: its weights have both signs. Positive weights say what speaks for a chair, negative ones
# what speaks against it.

rows, cols = spec.grid(*SIZE)
weights = classifier.coef_.reshape(rows, cols, spec.channels).astype(np.float32)

figure, panels = plt.subplots(2, 4, figsize=(10, 5.6), layout="constrained")
highest = np.argsort(scores)[::-1]
right = [k for k in highest if test_labels[k] == 1][:2]
wrong = [k for k in highest if test_labels[k] == 0][:2]
for row, examples, what in zip(panels, (right, wrong), ("chair", "no chair"), strict=True):
    for axes, k in zip(row[:2], examples, strict=True):
        axes.imshow(test[k, 0], cmap="gray", vmin=0, vmax=1)
        axes.set_title(f"{what}, score {scores[k]:+.2f}", fontsize=10)
for row, negative in zip(panels, (False, True), strict=True):
    sign = "negative" if negative else "positive"
    row[2].imshow(nablahog.glyphs(np.maximum(-weights if negative else weights, 0), spec), cmap="gray")
    row[2].set_title(f"{sign} weights", fontsize=10)
    result = reconstruct_template(weights, spec, SIZE, negative=negative)
    row[3].imshow(result.image, cmap="gray", vmin=0, vmax=1)
    row[3].set_title(f"image of the {sign} weights", fontsize=10)
for axes in panels.flat:
    axes.set_axis_off()
plt.show()

# %%
# Left: the test images with the highest scores, with and without a chair; a score above 0 means a chair. Right: a back
# at the right, a seat at its left and legs below speak for a chair; edges where these chairs have none speak against
# it.
