from .hog import HOG, HOGSpec, hog, presets
