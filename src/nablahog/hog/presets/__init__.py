"""The dialects by name: each is one HOGSpec with its source."""

from ...runtime.lazy import names_when_used
from ...runtime.text import did_you_mean
from ..checks import shortened
from ..spec import HOGSpec
from .dalal import dalal_triggs, maskfeat, opencv, paper, skimage
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

BY_NAME: dict[str, HOGSpec] = {name: globals()[name]() for name in __all__}
"""Each with its defaults."""


def as_spec(spec: HOGSpec | str) -> HOGSpec:
    """A spec, or the preset of that name with its defaults.

    Raises:
        TypeError: it is neither a spec nor a name.
        ValueError: there is no such preset.
    """
    if isinstance(spec, HOGSpec):
        return spec
    if not isinstance(spec, str):
        raise TypeError(f"spec must be a HOGSpec or the name of a preset, got {type(spec).__name__}")
    if spec not in BY_NAME:
        raise ValueError(
            f"spec must be a HOGSpec or one of {', '.join(BY_NAME)}, got {shortened(spec)}{did_you_mean(spec, BY_NAME)}"
        )
    return BY_NAME[spec]


names_when_used(__name__)  # for dir() and wrong names
