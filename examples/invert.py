"""A photograph, the glyphs of its HOG, and the image that is found from the HOG alone.

python examples/invert.py photo.jpg --out invert.png
"""

import argparse
from collections.abc import Sequence

import numpy as np
from PIL import Image
from skimage import data

import nablahog


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photograph", nargs="?", help="by default a photograph that comes with scikit-image")
    parser.add_argument("--out", default="invert.png", help="the picture to write")
    parser.add_argument("--size", type=int, default=192, help="pixels of the longer side")
    parser.add_argument("--quality", choices=("best", "fast"), default="best")
    arguments = parser.parse_args(argv)

    photograph = Image.open(arguments.photograph) if arguments.photograph else Image.fromarray(data.chelsea())
    photograph = photograph.convert("RGB")
    photograph.thumbnail((arguments.size, arguments.size))
    size = (photograph.height, photograph.width)

    spec = nablahog.presets.uoctti(cell_size=8)
    descriptor = nablahog.hog(photograph, spec)  # (rows, cols, 31): all that is known from here on
    result = nablahog.reconstruct(descriptor, spec, size, quality=arguments.quality)
    print(f"{descriptor.size} numbers, relative distance {float(result.distance):.3f} after {result.seconds:.1f} s")

    gray = np.asarray(photograph.convert("L")) / 255
    print(f"correlation with the photograph: {nablahog.metrics.cross_correlation(gray, result.image):.2f}")
    glyphs = Image.fromarray(np.uint8(255 * nablahog.glyphs(descriptor, spec))).resize(photograph.size)
    sheet = Image.new("RGB", (3 * size[1] + 16, size[0]), "white")
    for place, picture in enumerate((photograph, glyphs, Image.fromarray(np.uint8(255 * result.image)))):
        sheet.paste(picture, (place * (size[1] + 8), 0))
    sheet.save(arguments.out)


if __name__ == "__main__":
    main()
