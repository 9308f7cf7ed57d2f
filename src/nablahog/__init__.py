"""∇HOG: HOG you can differentiate, invert and fit.

Describe images      ``hog``, ``HOG``, ``HOGLoss``, ``HOGSpec``, ``presets``, ``stream``, ``compat``
Invert descriptors   ``reconstruct``, ``reconstruct_multiscale``, ``Reconstruction``, ``template_descriptor``,
                     ``LearnedPrior``, ``train_prior``
Render objects       ``render``, ``Renderer``, ``Mesh``, ``load_mesh``, ``Camera``, ``sample_chairs``
Find their poses     ``estimate_pose``, ``PoseEstimate``
Look and measure     ``glyphs``, ``metrics``
Files and layouts    ``load_descriptor``, ``save_descriptor``, ``to_layout``, ``from_layout``

Axes, ranges, angles and boxes: ``docs/conventions.md``.
"""

from typing import TYPE_CHECKING

from .runtime.lazy import names_when_used

if TYPE_CHECKING:
    from . import compat, metrics
    from .hog import HOG, HOGLoss, HOGSpec, from_layout, hog, presets, stream, to_layout
    from .invert import (
        LearnedPrior,
        Reconstruction,
        reconstruct,
        reconstruct_multiscale,
        template_descriptor,
        train_prior,
    )
    from .io import load_descriptor, save_descriptor
    from .pose import PoseEstimate, estimate_pose
    from .render import Camera, Mesh, Renderer, load_mesh, render, sample_chairs
    from .viz import glyphs

__version__ = "0.1.0"

__all__ = [
    "HOG",
    "Camera",
    "HOGLoss",
    "HOGSpec",
    "LearnedPrior",
    "Mesh",
    "PoseEstimate",
    "Reconstruction",
    "Renderer",
    "__version__",
    "compat",
    "estimate_pose",
    "from_layout",
    "glyphs",
    "hog",
    "load_descriptor",
    "load_mesh",
    "metrics",
    "presets",
    "reconstruct",
    "reconstruct_multiscale",
    "render",
    "sample_chairs",
    "save_descriptor",
    "stream",
    "template_descriptor",
    "to_layout",
    "train_prior",
]

# each name is looked up in its room when it is first used: PyTorch takes two seconds to load
names_when_used(
    __name__,
    hog=("HOG", "HOGLoss", "HOGSpec", "from_layout", "hog", "presets", "stream", "to_layout"),
    invert=(
        "LearnedPrior",
        "Reconstruction",
        "reconstruct",
        "reconstruct_multiscale",
        "template_descriptor",
        "train_prior",
    ),
    io=("load_descriptor", "save_descriptor"),
    pose=("PoseEstimate", "estimate_pose"),
    render=("Camera", "Mesh", "Renderer", "load_mesh", "render", "sample_chairs"),
    viz=("glyphs",),
)
