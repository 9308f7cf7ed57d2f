"""The names of all methods, in the order of their tables: what can be asked for, without loading what they need."""

from __future__ import annotations

DIALECTS = (
    "vlfeat",
    "vlfeat-bilinear",
    "vlfeat-dalaltriggs",
    "dpm",
    "dlib",
    "piotr",
    "hog-net",
    "hog-net-bilinear",
    "seeing3d",
    "aubry",
    "skimage",
    "opencv",
    "opencv-linear",
    "maskfeat",
)
"""Of Table 1, the methods that invert what a library computes, one for each dialect with cells of 8 pixels."""

TABLE1 = (
    "bovw",
    "hoggles",
    "cnn-hog",
    "cnn-hogb",
    "ridge",
    "nearest",
    "triangles",
    "uoctti-single",
    "uoctti-multi-scale",
    "uoctti-multi-scale-more",
    "uoctti-learned",
    "dalal-single",
    "dalal-multi-scale",
    "dalal-multi-scale-more",
    *DIALECTS,
)
TABLE2 = ("exemplar", "exhaustive", "paper", "best")
