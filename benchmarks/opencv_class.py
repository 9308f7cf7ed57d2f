"""``compat.opencv.HOGDescriptor`` beside ``cv2.HOGDescriptor``, on one thread each: a Markdown table.

    python benchmarks/opencv_class.py [--seconds 3]

Both describe, and find people in, scikit-image's photograph of an astronaut.
"""

from __future__ import annotations

import argparse
from typing import Any

import cv2
import numpy as np
import torch
from skimage import data

from nablahog.compat.opencv import HOGDescriptor
from timing import Call, cell, in_turns, ratio, summary


def calls(make: Any) -> dict[str, Call]:
    """The calls that are measured, by their names."""
    descriptor = make()
    descriptor.setSVMDetector(HOGDescriptor.getDefaultPeopleDetector())
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
        "`detectMultiScale`, 640×480, `padding=(32, 32)`": lambda: descriptor.detectMultiScale(video, padding=(32, 32)),
        "`detectMultiScale`, 640×480, `winStride=(4, 4)`": lambda: descriptor.detectMultiScale(video, winStride=(4, 4)),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=3, help="for each row")
    seconds = parser.parse_args().seconds
    cv2.setNumThreads(1)
    torch.set_num_threads(1)
    ours, theirs = calls(HOGDescriptor), calls(cv2.HOGDescriptor)
    print(f"OpenCV {cv2.__version__}; CPU milliseconds, median (quartiles), and ratios of the same turn.\n")
    print("| call | OpenCV | ours | times as fast |\n|---|---:|---:|---:|")
    for name, call in ours.items():
        times = in_turns({"opencv": theirs[name], "ours": call}, seconds)
        opencv, own = times["opencv"].cpu, times["ours"].cpu
        print(f"| {name} | {cell(summary(opencv))} | {cell(summary(own))} | {cell(ratio(opencv, own))} |", flush=True)


if __name__ == "__main__":
    main()
