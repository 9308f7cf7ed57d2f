"""OpenCV's own sample, before and after one changed import, on photographs: a Markdown table.

    python benchmarks/opencv_sample.py PEOPLEDETECT.py IMAGE...

The sample is ``samples/python/peopledetect.py`` of OpenCV's repository, or another one with the line ``import cv2 as
cv`` that takes names of images.  It runs as it is, and with ``import nablahog.compat.opencv as cv``.  No window opens.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import cv2
import numpy as np

from nablahog.compat import opencv

THEIRS, OURS = "import cv2 as cv", "import nablahog.compat.opencv as cv"


class Found(NamedTuple):
    """What one call of ``detectMultiScale`` returned."""

    size: tuple[int, int]  # of the image, width and height
    rectangles: np.ndarray
    weights: np.ndarray


class Run(NamedTuple):
    """Of the program: what it found, and the pictures that it showed."""

    found: list[Found]
    shown: list[np.ndarray]


@contextlib.contextmanager
def without_windows(shown: list[np.ndarray]) -> Iterator[None]:
    """Keeps the pictures that OpenCV would show: its headless package has no windows, and others wait for a key."""
    names = "imshow", "waitKey", "destroyAllWindows"
    stubs = lambda name, image: shown.append(image.copy()), lambda *_: -1, lambda: None
    with contextlib.ExitStack() as stack:
        for name, stub in zip(names, stubs, strict=True):
            stack.enter_context(mock.patch.object(cv2, name, stub))
        yield


def run(program: str, module: Any, images: list[str]) -> Run:
    """Runs a program that takes ``HOGDescriptor`` from ``module``."""
    result, made = Run([], []), module.HOGDescriptor

    class Recorded:
        """Hands everything on; no subclass, on which OpenCV's own class crashes."""

        def __init__(self, *arguments: Any) -> None:
            self._descriptor = made(*arguments)

        def __getattr__(self, name: str) -> Any:
            return getattr(self._descriptor, name)

        def detectMultiScale(self, img: np.ndarray, *arguments: Any, **named: Any) -> Any:
            rectangles, weights = self._descriptor.detectMultiScale(img, *arguments, **named)
            result.found.append(Found(img.shape[1::-1], np.reshape(rectangles, (-1, 4)), np.ravel(weights)))
            return rectangles, weights

    with (
        without_windows(result.shown),
        mock.patch.object(module, "HOGDescriptor", Recorded),
        mock.patch.object(sys, "argv", ["sample", *images]),
        open(os.devnull, "w") as nowhere,
        contextlib.redirect_stdout(nowhere),
    ):
        exec(compile(program, "sample", "exec"), {"__name__": "__main__"})
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sample", type=Path, help="a copy of OpenCV's samples/python/peopledetect.py")
    parser.add_argument("images", nargs="+", help="photographs that OpenCV reads")
    arguments = parser.parse_args()
    program = arguments.sample.read_text()
    if THEIRS not in program:
        parser.error(f"expected a program with the line {THEIRS!r}")
    cv2.setNumThreads(1)  # with several, weights are in no fixed order
    print(f"OpenCV {cv2.__version__}, {arguments.sample.name}\n")
    print("| image | size | people | rectangles | largest difference of weights | picture |")
    print("|---|---|---:|---|---:|---|")
    total, alike, largest = 0, 0, 0.0
    for image in arguments.images:
        theirs, ours = run(program, cv2, [image]), run(program.replace(THEIRS, OURS), opencv, [image])
        if not theirs.found:
            print(f"| {Path(image).name} | not read | | | | |")
            continue
        before, after = theirs.found[0], ours.found[0]
        same = np.array_equal(before.rectangles, after.rectangles)
        apart = float(np.abs(before.weights - after.weights).max(initial=0)) if same else float("nan")
        picture = all(map(np.array_equal, theirs.shown, ours.shown))
        total, alike, largest = total + len(before.rectangles), alike + same, max(largest, apart)
        cells = f"{before.size[0]}×{before.size[1]}", len(before.rectangles), "same" if same else "differ"
        told = *cells, f"{apart:.1e}", "same" if picture else "differs"
        print(f"| {Path(image).name} | {' | '.join(map(str, told))} |", flush=True)
    print(f"| all {len(arguments.images)} | | {total} | same in {alike} | {largest:.1e} | |")


if __name__ == "__main__":
    main()
