"""
What is lost by unsigned orientation bins?
==========================================

Unsigned bins put opposite gradients together: an edge from dark to bright and an edge from bright to dark are the same
vote. Therefore a photograph and its negative have the same descriptor. How much harder is it to invert?
"""

from dataclasses import replace
from typing import Literal

import matplotlib.pyplot as plt
import numpy as np
import torch
from PIL import Image
from skimage import data

import nablahog

PLACES = {"astronaut": (90, 0, 346, 256), "coffee": (150, 20, 500, 370), "camera": (100, 40, 356, 296)}
images = torch.stack(
    [
        torch.from_numpy(np.array(Image.fromarray(getattr(data, name)()).convert("L").crop(box).resize((128, 128))))
        for name, box in PLACES.items()
    ]
)[:, None]  # (B, 1, H, W), uint8

# %%
# Two specs that differ in one convention
# ---------------------------------------
# 9 bins over 180° and 18 bins over 360° have the same width. The sum of opposite signed bins is the unsigned bin.

unsigned = nablahog.presets.opencv(gamma=False, win_size=(128, 128))
signed = nablahog.presets.opencv(gamma=False, win_size=(128, 128), nbins=18, signed=True)

for name, spec in {"unsigned": unsigned, "signed": signed}.items():
    of_images, of_negatives = nablahog.hog(images, spec), nablahog.hog(255 - images, spec)
    change = (of_images - of_negatives).norm() / of_images.norm()
    print(f"{name:8} {spec.bins:2} bins: the descriptor of the negative differs by {change:.3f} of its length")

# %%
# Invert both
# -----------
# Unsigned and signed bins, each without and with the priors that come with the package.

settings: dict[str, tuple[nablahog.HOGSpec, Literal["default"] | None]] = {
    "unsigned": (unsigned, None),
    "unsigned, learned prior": (unsigned, "default"),
    "signed": (signed, None),
    "signed, learned prior": (signed, "default"),
}
figure, panels = plt.subplots(3, 5, figsize=(11, 7.4), layout="constrained")
for row, image, name in zip(panels, images, PLACES, strict=True):
    row[0].imshow(image[0], cmap="gray")
    row[0].set_title(name, fontsize=10)
correlations, confidence = {}, None
for col, (name, (spec, prior)) in enumerate(settings.items(), start=1):
    result = nablahog.reconstruct(nablahog.hog(images, spec), spec, (128, 128), prior=prior, quality="fast", seed=0)
    correlations[name] = [
        nablahog.metrics.cross_correlation(image[0], preimage[0])
        for image, preimage in zip(images, result.image, strict=True)
    ]
    confidence = result.polarity_confidence if name == "unsigned, learned prior" else confidence
    for row, preimage, correlation in zip(panels, result.image, correlations[name], strict=True):
        row[col].imshow(preimage[0], cmap="gray", vmin=0, vmax=1)
        row[col].set_title(f"{name}\nCC {correlation:.2f}", fontsize=10)
for axes in panels.flat:
    axes.set_axis_off()
plt.show()

# %%
# CC is the correlation with the photograph; below 0 the pre-image is a negative. With the learned prior the result has
# a confidence in the bright side:

assert confidence is not None
for name, each in zip(PLACES, confidence.tolist(), strict=True):
    print(f"{name:10} probability that the pre-image is not a negative: {each:.2f}")

# %%
# Is it the number of bins?
# -------------------------
# Both descriptors above have bins 20° wide, so the signed one has twice as many numbers. Here both have about the same
# number of bins, so a signed bin is twice as wide.

for bins in (5, 9, 18):
    for name, spec in {"unsigned": unsigned, "signed": signed}.items():
        spec = replace(spec, bins=bins if name == "unsigned" else 2 * (bins // 2), name=f"{name} {bins}")
        result = nablahog.reconstruct(nablahog.hog(images, spec), spec, (128, 128), prior=None, quality="fast", seed=0)
        mean = np.mean(
            [
                abs(nablahog.metrics.cross_correlation(image[0], preimage[0]))
                for image, preimage in zip(images, result.image, strict=True)
            ]
        )
        print(f"{spec.bins:2} {name:8} bins: mean |CC| of the three {mean:.2f}")

# %%
# The magnitude |CC| does not depend on which side of the whole image is bright. With equally many numbers signed bins
# still keep more: they contain the signs of neighbouring regions.
