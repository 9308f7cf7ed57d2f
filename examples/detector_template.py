"""What a linear detector looks for: its weights as glyphs, and as the image that they ask for.

    python examples/detector_template.py --out detector_template.png

The detector is OpenCV's for people.  Without OpenCV, one for chairs is learned here, from renderings and photographs.
"""

import argparse
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from skimage import data

import nablahog


def chair_detector(spec: nablahog.HOGSpec, size: tuple[int, int]) -> NDArray[np.float32]:
    """Linear discriminant analysis of chairs from the left, and of windows of photographs."""
    camera = nablahog.Camera.from_field_of_view(30, *size)
    pose = torch.tensor([[40.0, 15, 2.6, 0, 0, 0]])
    chairs = torch.cat([nablahog.render(nablahog.datasets.chairs.chair(k), pose, camera) for k in range(30)])
    positive = nablahog.hog(chairs, spec).flatten(1).double()
    photographs = [Image.fromarray(p).convert("L") for p in (data.astronaut(), data.coffee(), data.rocket())]
    places = np.random.default_rng(0).integers(0, 200, (150, 2))
    windows = [p.crop((x, y, x + size[1], y + size[0])) for p in photographs for x, y in places]
    negative = nablahog.hog(np.stack([np.array(w)[..., None] for w in windows]), spec).reshape(len(windows), -1)
    covariance = np.cov(negative.T) + 0.01 * np.eye(negative.shape[1])
    return np.linalg.solve(covariance, positive.numpy().mean(0) - negative.mean(0)).astype(np.float32)


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", default="detector_template.png", help="the picture to write")
    parser.add_argument("--quality", choices=("best", "fast"), default="best")
    arguments = parser.parse_args(argv)

    try:
        import cv2

        size, spec = (128, 64), nablahog.presets.opencv(win_size=(64, 128))
        vector = np.asarray(cv2.HOGDescriptor_getDefaultPeopleDetector(), np.float32).ravel()
        weights = nablahog.from_layout(vector[:-1], spec, size)  # the last is the bias
    except ImportError:
        size, spec = (96, 96), nablahog.presets.uoctti(cell_size=8)
        weights = chair_detector(spec, size).reshape(*spec.grid(*size), spec.channels)

    descriptor = nablahog.template_descriptor(weights, spec, size)
    result = nablahog.reconstruct(descriptor, spec, size, quality=arguments.quality)
    pictures = [nablahog.glyphs(np.maximum(sign * weights, 0), spec) for sign in (1, -1)] + [result.image]
    large = [Image.fromarray(np.uint8(255 * p)).resize((3 * size[1], 3 * size[0])) for p in pictures]
    Image.fromarray(np.hstack([np.asarray(p) for p in large])).save(arguments.out)


if __name__ == "__main__":
    main()
