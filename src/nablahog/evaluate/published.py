"""Table 1 as the paper prints it."""

from __future__ import annotations

from dataclasses import dataclass

NO_HOG, UOCTTI, DALAL = "No HOG", "UoCTTI HOG", "Dalal's HOG"
GROUPS = (NO_HOG, UOCTTI, DALAL)
"""What the methods of the table start from, in its order."""


@dataclass(frozen=True)
class Published:
    """A line of the paper's Table 1: means over its 101 images."""

    group: str
    cc: float
    mi: float
    ssim: float


PUBLISHED = {
    "bovw": Published(NO_HOG, 0.287, 1.182, 0.252),
    "hoggles": Published(UOCTTI, 0.409, 1.497, 0.271),
    "cnn-hog": Published(UOCTTI, 0.632, 1.211, 0.381),
    "cnn-hogb": Published(UOCTTI, 0.657, 1.597, 0.387),
    "uoctti-single": Published(UOCTTI, 0.760, 1.908, 0.433),
    "dalal-single": Published(DALAL, 0.170, 1.464, 0.301),
    "dalal-multi-scale": Published(DALAL, 0.147, 1.478, 0.293),
    "dalal-multi-scale@1/64": Published(DALAL, 0.058, 1.444, 0.121),
    "dalal-multi-scale@1/16": Published(DALAL, 0.076, 1.470, 0.147),
    "dalal-multi-scale@1/4": Published(DALAL, 0.108, 1.458, 0.221),
    "dalal-multi-scale@1/1": Published(DALAL, 0.147, 1.478, 0.293),
    "dalal-multi-scale-more": Published(DALAL, 0.236, 1.582, 0.338),
    "dalal-multi-scale-more@1/64": Published(DALAL, 0.147, 1.458, 0.251),
    "dalal-multi-scale-more@1/16": Published(DALAL, 0.191, 1.502, 0.291),
    "dalal-multi-scale-more@1/4": Published(DALAL, 0.220, 1.565, 0.320),
    "dalal-multi-scale-more@1/1": Published(DALAL, 0.236, 1.582, 0.338),
}
"""By the rows of our methods; the table's last level, 1/1, is the method's own row, too."""
