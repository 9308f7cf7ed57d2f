"""Makes docs/templates.png, what OpenCV's two people detectors look for: `python docs/templates.py`.

Their weights are in OpenCV before version 5 (`pip install "opencv-python-headless<5"`), under the Apache licence.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import torch

from nablahog import presets
from nablahog.hog.layout import from_layout
from nablahog.invert import reconstruct_template
from nablahog.viz.pictures import Panel, contact_sheet, glyphs

DETECTORS = {
    "default": ((64, 128), cv2.HOGDescriptor.getDefaultPeopleDetector),
    "Daimler": ((48, 96), cv2.HOGDescriptor.getDaimlerPeopleDetector),
}


def main() -> None:
    panels = []
    for name, (window, weights_of) in DETECTORS.items():
        spec, size = presets.opencv(window), window[::-1]
        vector = torch.from_numpy(np.asarray(weights_of(), np.float32).ravel()[:-1])  # the last is the bias
        weights = from_layout(vector[None], spec, size)
        for sign, negative in (("positive", False), ("negative", True)):
            result = reconstruct_template(weights, spec, size, negative=negative)
            drawn = glyphs((weights[0] * (-1 if negative else 1)).clamp(min=0), spec)
            row = [Panel(drawn, f"{name}, {sign}"), Panel(result.image[0, 0], "what they see")]
            panels += [*row, Panel(1 - result.image[0, 0], "or its negative")]
    contact_sheet([panels], height=256).convert("L").save(Path(__file__).with_name("templates.png"), optimize=True)


if __name__ == "__main__":
    main()
