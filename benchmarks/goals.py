"""What the package should reach beside its peers, and what a record of measurements says of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from programs import BACKWARD

THEIR_OPENCV_MS = 3.64  # of 512x512 on the machine that goals in seconds were set for
Record = Mapping[str, Any]


@dataclass(frozen=True)
class Verdict:
    """One line of the table of goals.

    Attributes:
        what: is measured.
        peer: it is measured beside.
        goal: in words.
        found: in words; why not, if it was not measured.
        met: whether the goal is reached; None if it was not measured.
    """

    what: str
    peer: str
    goal: str
    result: str
    met: bool | None


@dataclass(frozen=True)
class Times:
    """To be so many times as fast as a peer, by CPU time on one thread."""

    what: str
    program: str
    peer: str
    shape: tuple[int, int]
    least: float

    def verdict(self, record: Record) -> Verdict:
        beside = f"{self.peer}, its own descriptor" if self.peer != "VLFeat" else "VLFeat, forward"
        ratio = found_ratio(record, self.program, self.peer, self.shape)
        goal = f"≥ {self.least:g}×"
        if ratio is None:
            return Verdict(self.what, beside, goal, "not measured", None)
        spread = f"{ratio['median']:.2f}× ({ratio['q1']:.2f}…{ratio['q3']:.2f})"
        return Verdict(self.what, beside, goal, spread, ratio["median"] >= self.least)


PAPERS = "ours, the paper's"
TIMES = (
    Times("scikit-image's own descriptor, 512², forward", "ours, scikit-image's", "scikit-image", (1, 512), 60),
    Times("OpenCV's own, 512², forward", "ours, OpenCV's", "OpenCV", (1, 512), 2.5),
    Times("UoCTTI, linear votes, 512², forward", "ours, UoCTTI", "VLFeat", (1, 512), 10),
    Times("the same with backward", "ours, UoCTTI" + BACKWARD, "VLFeat", (1, 512), 5),
    Times("dlib's own, 512², forward", "ours, dlib's", "dlib", (1, 512), 1.2),
    Times("the paper's (Dalal type), 512², forward", PAPERS, "OpenCV", (1, 512), 4.55),
    Times("the same with backward", PAPERS + BACKWARD, "OpenCV", (1, 512), 2.02),
    Times("the paper's, 128², the call included, forward", PAPERS, "OpenCV", (1, 128), 2.6),
    Times("the same with backward", PAPERS + BACKWARD, "OpenCV", (1, 128), 1.05),
    Times("the paper's, 64 images of 128², with backward", PAPERS + BACKWARD, "OpenCV", (64, 128), 1.69),
)


def verdicts(record: Record) -> list[Verdict]:
    return [
        *(goal.verdict(record) for goal in TIMES),
        _two_threads(record),
        _memory(record),
        _preimage(record, "fast", 0.1, at_least=0.76),
        _preimage(record, "best", 0.5, at_least=None),
        _pose(record),
    ]


def found_ratio(record: Record, program: str, peer: str, shape: tuple[int, int]) -> Any:
    """Of a program to a peer at one shape; None where either did not take part."""
    for point in record["operator"]:
        if (point["batch"], point["side"]) == shape:
            return point["programs"].get(program, {"ratios": {}})["ratios"].get(peer)
    return None


def their_machine(record: Record) -> float | None:
    """How many times as slow the machine of the goals was, by OpenCV's time; None where that was not measured."""
    for point in record["operator"]:
        if (point["batch"], point["side"]) == (1, 512) and "OpenCV" in point["programs"]:
            return float(THEIR_OPENCV_MS / point["programs"]["OpenCV"]["cpu_ms"]["median"])
    return None


def _two_threads(record: Record) -> Verdict:
    what, program = "the same with 2 threads, shortest wall times", PAPERS + BACKWARD
    for point in record["threads"]:
        by_count = point["programs"].get(program, {})
        if (point["batch"], point["side"]) == (64, 128) and "2" in by_count:
            result = by_count["1"]["min"] / by_count["2"]["min"]
            return Verdict(what, "1 thread", "≥ 1.8×", f"{result:.2f}×", result >= 1.8)
    return Verdict(what, "1 thread", "≥ 1.8×", "not measured", None)


def _memory(record: Record) -> Verdict:
    memory, goal = record["memory"], "≤ 3 images"
    ours = {n: m for n, m in memory["programs"].items() if n.startswith("ours") and _is_forward(n) and m is not None}
    what, peer = f"peak memory beyond the image, {memory['side']}², forward", "the image, float32"
    if not ours:
        return Verdict(what, peer, goal, "not measured", None)
    name = max(ours, key=lambda n: ours[n])
    most, papers = ours[name] / memory["image_mib"], ours[PAPERS] / memory["image_mib"]
    result = f"{papers:.2f} images (the paper's); at most {most:.2f} ({name.removeprefix('ours, ')})"
    return Verdict(what, peer, goal, result, most <= 3 if memory["side"] == 2048 else None)


def _is_forward(name: str) -> bool:
    return not name.endswith(BACKWARD) and "plain" not in name


def _preimage(record: Record, quality: str, seconds: float, at_least: float | None) -> Verdict:
    row = record["preimages"]["whole"][quality]
    of = f" at a CC of {at_least:g}" if at_least else ""
    what = f"pre-images of {record['preimages']['images']} photographs, UoCTTI, quality {quality}{of}"
    result, there = _scaled(row["cpu_s"], record)
    good = at_least is None or row["cc"] >= at_least
    return Verdict(what, "–", f"≤ {seconds:g} s", f"{result}, CC {row['cc']:.3f}", good and there <= seconds)


def _pose(record: Record) -> Verdict:
    row = record["poses"]["rows"]["best"]
    ratio = row["ratios"]["exhaustive"]["median"]
    result, there = _scaled(row["cpu_s"]["median"], record)
    return Verdict("a pose, known model", "360 renderings", "≤ 0.05 s", f"{result}; {ratio:.2f}×", there <= 0.05)


def _scaled(seconds: float, record: Record) -> tuple[str, float]:
    """In words, and on the machine of the goals."""
    factor = their_machine(record)
    if factor is None:
        return f"{seconds:.3f} s here", seconds
    return f"{seconds:.3f} s here, {seconds * factor:.3f} s there", seconds * factor
