"""Finds somebody by a linear detector, and asks which pixels the score depends on.

    python examples/detector_score.py --out detector_score.png

The detector is made of one window: its descriptor less the mean of all others.  ``HOGDescriptor`` is OpenCV's class.
"""

import argparse
from collections.abc import Sequence

import numpy as np
import torch
from PIL import Image
from skimage import data

import nablahog


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=30, help="of gradient ascent of the score")
    parser.add_argument("--out", default="detector_score.png", help="the picture to write")
    arguments = parser.parse_args(argv)

    photograph = data.astronaut()
    small = np.asarray(Image.fromarray(photograph).resize((256, 256)))
    descriptor = nablahog.compat.opencv.HOGDescriptor()
    window = descriptor.compute(small, locations=[(76, 8)])
    mean = descriptor.compute(small).reshape(-1, len(window)).mean(axis=0)
    weights = window - mean
    descriptor.setSVMDetector(np.append(weights, -weights @ (window + mean) / 2))

    rectangles, scores = descriptor.detectMultiScale(photograph, scale=1.05, groupThreshold=0)
    x, y, width, height = rectangles[np.argmax(scores)]
    print(f"{len(rectangles)} windows found, the best at {x}, {y}, {width}x{height} pixels, with {max(scores):.2f}")

    found = Image.fromarray(photograph).crop((x, y, x + width, y + height)).resize((64, 128))
    before = torch.from_numpy(np.array(found)).permute(2, 0, 1).unsqueeze(0) / 255
    image, derivative = before.clone(), before
    for step in range(arguments.steps):
        image.requires_grad_()
        value = nablahog.compat.opencv.score(image, descriptor)
        (gradient,) = torch.autograd.grad(value.sum(), image)
        derivative = gradient if step == 0 else derivative
        image = (image.detach() + 0.01 * gradient / gradient.abs().amax()).clamp(0, 1)
    print(f"after {arguments.steps} steps along its derivative: {value.item():.2f}")

    strength = derivative.abs().sum(dim=1, keepdim=True)
    pictures = torch.cat([before, (strength / strength.max()).sqrt().expand(-1, 3, -1, -1), image], dim=3)
    array = np.uint8(255 * pictures[0].permute(1, 2, 0).numpy())
    Image.fromarray(array).resize((3 * array.shape[1], 3 * array.shape[0])).save(arguments.out)


if __name__ == "__main__":
    main()
