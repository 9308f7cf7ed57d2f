"""Groups and names of all methods in the order of their tables, and the tables as the paper prints them.

Importing this module does not load PyTorch.
"""

from __future__ import annotations

from ..hog import HOGSpec, presets

NO_HOG, UOCTTI, DALAL, LIBRARIES = "No HOG", "UoCTTI HOG", "Dalal's HOG", "What libraries compute"
GROUPS = (NO_HOG, UOCTTI, DALAL, LIBRARIES)
"""The kinds of input of the methods of Table 1, in its order."""

DIALECTS: dict[str, HOGSpec] = {
    # but the paper's two, which have rows of their own, what Dalal's stands for, and what is called otherwise below
    **{
        name: getattr(presets, name)()
        for name in presets.__all__
        if name not in ("paper", "uoctti", "dalal_triggs", "cnn_hog")
    },
    "aubry": presets.aubry(8),
    "seeing3d": presets.seeing3d(8),
    "vlfeat-bilinear": presets.vlfeat(bilinear_orientations=True),
    "vlfeat-dalaltriggs": presets.vlfeat("dalaltriggs"),
    "hog-net": presets.cnn_hog(),
    "hog-net-bilinear": presets.cnn_hog(bilinear=True),
    "opencv-linear": presets.opencv(gamma=False),
}
"""Methods of Table 1 that invert the descriptor of a library, with cells of 8 pixels: every preset, and variants."""

LEARNED_DIALECTS = tuple(f"{name}-learned" for name in DIALECTS)
"""The same with a learned prior."""

AS_PUBLISHED = (
    "paper-uoctti-single",
    "paper-dalal-single",
    "paper-dalal-multi-scale",
    "paper-dalal-multi-scale-more",
)
"""Methods of Table 1 that search as the paper does: our names after ``paper-``."""

TABLE1 = (
    "bovw",
    "hoggles",
    "cnn-hog",
    "cnn-hogb",
    "paper-uoctti-single",
    "uoctti-single",
    "uoctti-multi-scale",
    "uoctti-multi-scale-more",
    "uoctti-learned",
    "paper-dalal-single",
    "paper-dalal-multi-scale",
    "paper-dalal-multi-scale-more",
    "dalal-single",
    "dalal-multi-scale",
    "dalal-multi-scale-more",
    "dalal-learned",
    "dalal-multi-scale-more-learned",
    *DIALECTS,
    *LEARNED_DIALECTS,
)
PRIORS = {"prior": "prior", "unsigned-prior": "prior --signs unsigned"}
"""Learned priors of methods of Table 1, which come with the package, and the `nablahog learn` that trains each."""

TABLE2 = ("exemplar", "exhaustive", "paper", "paper-edges", "best")

CONDITIONS = (
    *("exact", "sides-5", "sides-10", "larger-20", "cut-15", "cut-30", "no-box", "tilted", "steep", "renderer"),
)
"""Conditions that Table 2 is also computed under: the names of :data:`.examples.CONDITIONS`."""


_PUBLISHED = {
    "bovw": (0.287, 1.182, 0.252),
    "hoggles": (0.409, 1.497, 0.271),
    "cnn-hog": (0.632, 1.211, 0.381),
    "cnn-hogb": (0.657, 1.597, 0.387),
    "uoctti-single": (0.760, 1.908, 0.433),
    "dalal-single": (0.170, 1.464, 0.301),
    "dalal-multi-scale": (0.147, 1.478, 0.293),
    "dalal-multi-scale@1/64": (0.058, 1.444, 0.121),
    "dalal-multi-scale@1/16": (0.076, 1.470, 0.147),
    "dalal-multi-scale@1/4": (0.108, 1.458, 0.221),
    "dalal-multi-scale@1/1": (0.147, 1.478, 0.293),
    "dalal-multi-scale-more": (0.236, 1.582, 0.338),
    "dalal-multi-scale-more@1/64": (0.147, 1.458, 0.251),
    "dalal-multi-scale-more@1/16": (0.191, 1.502, 0.291),
    "dalal-multi-scale-more@1/4": (0.220, 1.565, 0.320),
    "dalal-multi-scale-more@1/1": (0.236, 1.582, 0.338),
}
PUBLISHED = {
    **_PUBLISHED,
    **{f"paper-{row}": means for row, means in _PUBLISHED.items() if row.startswith(("uoctti-", "dalal-"))},
}
"""CC, MI and SSIM of the paper's Table 1, means over its 101 images, by the names of our rows.

The last level, 1/1, is also the row of the method itself.  The paper's own method stands beside the rows that search as
it does, and beside ours."""

POSE_PUBLISHED: dict[str, dict[int, float]] = {
    "exemplar": {4: 47.33, 8: 35.39, 16: 20.16, 24: 15.23},
    "paper": {4: 58.85, 8: 40.74, 16: 22.22, 24: 16.87},
}
"""Table 2 as the paper prints it: accuracy in percent on 247 chairs by the number of views, of Aubry et al. and of its
own method, under the names of ours.

It does not state the criterion.  Random azimuths are right in 50, 25, 12.5 and 8.3 percent by threshold and in half as
many by interval, so the baseline's 47.33 is above chance by interval only."""
