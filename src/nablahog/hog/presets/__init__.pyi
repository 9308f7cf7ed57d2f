from .dalal import (
    dalal_triggs as dalal_triggs,
    maskfeat as maskfeat,
    opencv as opencv,
    paper as paper,
    skimage as skimage,
)
from .uoctti import (
    aubry as aubry,
    cnn_hog as cnn_hog,
    dlib as dlib,
    dpm as dpm,
    piotr as piotr,
    seeing3d as seeing3d,
    uoctti as uoctti,
    vlfeat as vlfeat,
)

__all__: list[str]
