"""How often is a descriptor of unknown origin recognised, how often is it asked about, and is the answer ever wrong?

    python benchmarks/unknown_arrays.py [--images DIR] [--photographs 2] [--rows 8] [--part judging] [--threads 1]

Descriptors of photographs in all presets, three sizes and three sets of parameters each, as `nablahog.which_hog` gets
them: in one row, and as a matrix of several.  An answer is right if dialect, parameters, layout and size of the image
are.  Thresholds were chosen on the first half of the files of a folder; the other half judges.
"""

from __future__ import annotations

import argparse
import inspect
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from skimage import data

from nablahog import hog, presets, which_hog
from nablahog.hog import HOGSpec
from nablahog.io.images import image_endings
from timing import table

SIZES = ((64, 64), (128, 64), (96, 128))  # height, width
SAMPLES = ("camera", "astronaut", "coffee", "coins", "chelsea", "rocket", "cat", "hubble_deep_field")
_ORIENTATIONS: tuple[dict[str, Any], ...] = ({}, {"orientations": 8}, {"orientations": 12})
_CELLS: tuple[dict[str, Any], ...] = ({}, {"cell_size": 4}, {"cell_size": 6})
PARAMETERS: dict[str, tuple[dict[str, Any], ...]] = {
    "aubry": _ORIENTATIONS,
    "cnn_hog": _ORIENTATIONS,
    "dalal_triggs": ({}, {"norm": "L2"}, {"bins": 8}),
    "dlib": _CELLS,
    "dpm": _CELLS,
    "maskfeat": ({}, {"layout": "tokens"}, {"nbins": 12}),
    "opencv": ({}, {"nbins": 8}, {"nbins": 12}),
    "paper": ({}, {"global_form": "robust"}, {"bins": 12}),
    "piotr": _ORIENTATIONS,
    "seeing3d": _CELLS,
    "skimage": ({}, {"cells_per_block": (2, 2)}, {"block_norm": "L1"}),
    "uoctti": _ORIENTATIONS,
    "vlfeat": ({}, {"variant": "dalaltriggs"}, {"orientations": 8}),
}


def photographs(folder: Path | None, part: str) -> Iterator[NDArray[np.uint8]]:
    """Photographs (height, width, 3): those of half of a folder in random order, or scikit-image's."""
    if folder is None:
        for name in SAMPLES:
            yield np.asarray(Image.fromarray(getattr(data, name)()).convert("RGB"))
        return
    files = sorted(file for file in folder.rglob("*") if file.suffix.lower() in image_endings())
    half = files[: len(files) // 2] if part == "choosing" else files[len(files) // 2 :]
    for index in np.random.default_rng(0).permutation(len(half)):
        yield np.asarray(Image.open(half[index]).convert("RGB"))


def describe(photograph: NDArray[np.uint8], size: tuple[int, int], spec: HOGSpec) -> NDArray[np.floating]:
    """The descriptor, in one row, of the middle of a photograph, scaled to (height, width)."""
    image = Image.fromarray(photograph)
    scale = min(side / wanted for side, wanted in zip(image.size, size[::-1], strict=True))
    width, height = (round(scale * side) for side in size[::-1])
    left, top = (image.width - width) // 2, (image.height - height) // 2
    scaled = image.resize(size[::-1], Image.Resampling.BOX, (left, top, left + width, top + height))
    single = spec.colour == "gray"
    return np.ravel(hog(np.asarray(scaled.convert("L") if single else scaled), spec, layout="native"))


def known(parameters: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """All presets that can have cells of the size of the parameters, with that size: no array tells it."""
    cells = {key: value for key, value in parameters.items() if key == "cell_size"}
    return {name: cells for name in presets.__all__ if _is_possible(name, cells)}


def _is_possible(name: str, parameters: Mapping[str, Any]) -> bool:
    if not parameters.keys() <= inspect.signature(getattr(presets, name)).parameters.keys():
        return False
    try:
        getattr(presets, name)(**parameters)
    except (TypeError, ValueError):
        return False
    return True


def judge(array: NDArray[np.floating], name: str, parameters: dict[str, Any], size: tuple[int, int]) -> str:
    """``right``, ``wrong``, or, if it asks, ``asked, right`` or ``asked, wrong`` by its first candidate."""
    spec = getattr(presets, name)(**parameters)
    found = which_hog(array, dialects=known(parameters))
    first = found.candidates[0]
    same = first.spec == spec and first.image_size == spec.image_size(*spec.grid(*size))
    return ("" if found.decided_by else "asked, ") + ("right" if same else "wrong")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--images", type=Path, help="folder of photographs (default: scikit-image's)")
    parser.add_argument("--photographs", type=int, default=2, help="vectors of each kind")
    parser.add_argument("--rows", type=int, default=8, help="vectors of a matrix")
    parser.add_argument("--part", choices=("choosing", "judging"), default="judging", help="half of the folder")
    parser.add_argument("--threads", type=int, default=1)
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    images = photographs(arguments.images, arguments.part)
    pictures = [picture for _, picture in zip(range(max(arguments.photographs, arguments.rows)), images, strict=False)]
    rows = []
    for name in presets.__all__:
        counts: dict[str, Counter[str]] = {"vector": Counter(), "matrix": Counter()}
        began = time.perf_counter()
        for parameters in PARAMETERS[name]:
            spec = getattr(presets, name)(**parameters)
            for size in SIZES:
                vectors = [describe(picture, size, spec) for picture in pictures]
                counts["matrix"][judge(np.stack(vectors[: arguments.rows]), name, parameters, size)] += 1
                for vector in vectors[: arguments.photographs]:
                    counts["vector"][judge(vector, name, parameters, size)] += 1
        seconds = (time.perf_counter() - began) / sum(map(Counter.total, counts.values()))
        rows.append([name, *(text for count in counts.values() for text in shares(count)), f"{seconds:.2f}"])
        print(rows[-1], flush=True)
    columns = [f"{kind}: {what}" for kind in ("vector", "matrix") for what in ("first is right", "asked", "wrong")]
    print(table(["preset", *columns, "s"], rows))


def shares(count: Counter[str]) -> tuple[str, str, str]:
    """Of answers: how many are right at first, how many ask, and how many are wrong without asking."""
    right, asked = count["right"] + count["asked, right"], count["asked, right"] + count["asked, wrong"]
    return tuple(f"{number} / {count.total()}" for number in (right, asked, count["wrong"]))  # type: ignore[return-value]


if __name__ == "__main__":
    main()
