"""Groups and names of all methods in the order of their tables; importing it does not load PyTorch."""

from __future__ import annotations

from ..hog import HOGSpec, presets

NO_HOG, UOCTTI, DALAL, LIBRARIES = "No HOG", "UoCTTI HOG", "Dalal's HOG", "What libraries compute"
GROUPS = (NO_HOG, UOCTTI, DALAL, LIBRARIES)
"""The kinds of input of the methods of Table 1, in its order."""

DIALECTS: dict[str, HOGSpec] = {
    "vlfeat": presets.vlfeat(),
    "vlfeat-bilinear": presets.vlfeat(bilinear_orientations=True),
    "vlfeat-dalaltriggs": presets.vlfeat("dalaltriggs"),
    "dpm": presets.dpm(),
    "dlib": presets.dlib(),
    "piotr": presets.piotr(),
    "hog-net": presets.cnn_hog(),
    "hog-net-bilinear": presets.cnn_hog(bilinear=True),
    "seeing3d": presets.seeing3d(8),
    "aubry": presets.aubry(8),
    "skimage": presets.skimage(),
    "opencv": presets.opencv(),
    "opencv-linear": presets.opencv(gamma=False),
    "maskfeat": presets.maskfeat(),
}
"""Methods of Table 1 that invert the descriptor of a library, with cells of 8 pixels."""

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
