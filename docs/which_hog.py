"""Makes docs/which_hog.png: `python docs/which_hog.py`.  Needs OpenCV 4, one of the development dependencies.

A photograph of 128x64 pixels; its HOG by OpenCV (cv) and by scikit-image (ski), 3780 numbers each, both inverted as
either.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import torch
from skimage import data
from skimage.feature import hog

from nablahog import presets, reconstruct
from nablahog.hog.gradient import gray
from nablahog.hog.layout import from_layout
from nablahog.viz.pictures import Panel, contact_sheet

HERE = Path(__file__).parent
SIZE = 128, 64
SPECS = {"cv": presets.opencv(), "ski": presets.skimage(cells_per_block=(2, 2), channel_axis=-1)}


def main() -> None:
    photo = np.ascontiguousarray(data.astronaut()[40:168, 190:254])
    vectors = {
        "cv": cv2.HOGDescriptor().compute(photo),
        "ski": hog(photo, cells_per_block=(2, 2), channel_axis=-1),
    }
    picture = torch.from_numpy(photo).permute(2, 0, 1)[None] / 255
    panels = [Panel(gray(picture)[0], "photograph")]
    for source, vector in vectors.items():
        native = torch.from_numpy(vector).float()[None]
        for guess, spec in SPECS.items():
            descriptor = from_layout(native, spec, SIZE).contiguous()
            result = reconstruct(descriptor, replace(spec, layout="cells"), image_size=SIZE, prior=None, seed=0)
            caption = f"{source} as {guess}: {float(result.distance[0]):.2f}"
            print(caption)
            panels.append(Panel(result.image[0], caption))
    contact_sheet([panels], 256).save(HERE / "which_hog.png", optimize=True)


if __name__ == "__main__":
    main()
