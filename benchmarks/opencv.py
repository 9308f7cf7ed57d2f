"""Is ``compat.opencv.HOGDescriptor`` as fast as OpenCV's, and does OpenCV's own sample find the same people with it?

    python benchmarks/opencv.py [--seconds 3] [--sample PEOPLEDETECT.py IMAGE …]

On one thread each, on scikit-image's photograph of an astronaut.  The sample is ``samples/python/peopledetect.py`` of
OpenCV's repository: it runs as it is, and with ``import nablahog.compat.opencv as cv``.  No window opens.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
from pathlib import Path
from typing import Any
from unittest import mock

import cv2
import numpy as np
import torch
from skimage import data

from nablahog.compat import opencv
from timing import Call, cell, in_turns, ratio, summary, table, times_as_fast

THEIRS, OURS = "import cv2 as cv", "import nablahog.compat.opencv as cv"


def calls(make: Any) -> dict[str, Call]:
    """The calls that are measured, by their names."""
    descriptor = make()
    descriptor.setSVMDetector(opencv.HOGDescriptor.getDefaultPeopleDetector())
    photograph = np.ascontiguousarray(data.astronaut())
    window, video = photograph[:128, :64].copy(), cv2.resize(photograph, (640, 480))
    gray = cv2.cvtColor(video, cv2.COLOR_RGB2GRAY)
    return {
        "`compute`, a window of 64×128": lambda: descriptor.compute(window),
        "`compute`, a window of 64×128, gray": lambda: descriptor.compute(window[..., 0].copy()),
        "`compute`, all windows of 512×512": lambda: descriptor.compute(photograph),
        "`detect`, 640×480": lambda: descriptor.detect(video),
        "`detectMultiScale`, 640×480": lambda: descriptor.detectMultiScale(video),
        "`detectMultiScale`, 640×480, gray": lambda: descriptor.detectMultiScale(gray),
        "`detectMultiScale`, 640×480, `winStride=(4, 4)`": lambda: descriptor.detectMultiScale(video, winStride=(4, 4)),
    }


def people(program: str, module: Any, image: str) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Rectangles and weights that a program finds with the ``HOGDescriptor`` of a module, and the pictures it shows."""
    made, detections, shown = module.HOGDescriptor, [], []

    class Recorded:
        """Hands everything on; no subclass, on which OpenCV's own class crashes."""

        def __init__(self, *arguments: Any) -> None:
            self._descriptor = made(*arguments)

        def __getattr__(self, name: str) -> Any:
            return getattr(self._descriptor, name)

        def detectMultiScale(self, *arguments: Any, **named: Any) -> Any:
            detections.append(self._descriptor.detectMultiScale(*arguments, **named))
            return detections[-1]

    with contextlib.ExitStack() as stack:
        stack.enter_context(mock.patch.object(cv2, "imshow", lambda name, image: shown.append(image.copy())))
        stack.enter_context(mock.patch.object(cv2, "waitKey", return_value=-1))
        stack.enter_context(mock.patch.object(cv2, "destroyAllWindows"))
        stack.enter_context(mock.patch.object(module, "HOGDescriptor", Recorded))
        stack.enter_context(mock.patch.object(sys, "argv", ["sample", image]))
        stack.enter_context(contextlib.redirect_stdout(stack.enter_context(open(os.devnull, "w"))))
        exec(compile(program, "sample", "exec"), {"__name__": "__main__"})
    rectangles, weights = detections[0] if detections else ((), ())
    return np.reshape(rectangles, (-1, 4)), np.ravel(weights), shown


def sample(file: Path, images: list[str]) -> str:
    """A table of what the program finds in each image."""
    program, rows = file.read_text(), []
    if THEIRS not in program:
        raise SystemExit(f"expected a program with the line {THEIRS!r}")
    for image in images:
        theirs, ours = people(program, cv2, image), people(program.replace(THEIRS, OURS), opencv, image)
        same = np.array_equal(theirs[0], ours[0]) and all(map(np.array_equal, theirs[2], ours[2]))
        apart = f"{np.abs(theirs[1] - ours[1]).max(initial=0):.1e}" if same else "–"
        rows.append([Path(image).name, str(len(theirs[0])), "the same" if same else "differ", apart])
    return table(["image", "people", "rectangles and pictures", "largest difference of weights"], rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=3, help="for each row")
    parser.add_argument("--sample", nargs="+", metavar="FILE", help="OpenCV's program, and photographs")
    options = parser.parse_args()
    cv2.setNumThreads(1)  # with several, weights are in no fixed order
    torch.set_num_threads(1)
    if options.sample:
        print(sample(Path(options.sample[0]), options.sample[1:]))
        return
    ours, theirs, rows = calls(opencv.HOGDescriptor), calls(cv2.HOGDescriptor), []
    for name, call in ours.items():
        times = in_turns({"opencv": theirs[name], "ours": call}, options.seconds)
        both = times["opencv"].cpu, times["ours"].cpu
        rows.append([name, *(cell(summary(each)) for each in both), times_as_fast(ratio(*both))])
    print(f"OpenCV {cv2.__version__}; CPU ms\n\n{table(['call', 'OpenCV', 'ours', 'times as fast'], rows)}")


if __name__ == "__main__":
    main()
