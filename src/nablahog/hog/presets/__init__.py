"""The dialects by name: each is one HOGSpec with its source."""

from .dalal import dalal_triggs, maskfeat, opencv, skimage
from .paper import paper
from .uoctti import aubry, cnn_hog, dlib, dpm, piotr, seeing3d, uoctti, vlfeat

__all__ = [
    "aubry",
    "cnn_hog",
    "dalal_triggs",
    "dlib",
    "dpm",
    "maskfeat",
    "opencv",
    "paper",
    "piotr",
    "seeing3d",
    "skimage",
    "uoctti",
    "vlfeat",
]
