"""∇HOG: HOG you can differentiate, invert and fit.

Describe images      ``hog``, ``HOG``, ``HOGLoss``, ``HOGSpec``, ``presets``, ``stream``, ``compat``
Invert descriptors   ``reconstruct``, ``reconstruct_multiscale``, ``Reconstruction``, ``template_descriptor``,
                     ``LearnedPrior``, ``train_prior``, ``which_hog``
Render objects       ``render``, ``Renderer``, ``Mesh``, ``load_mesh``, ``Camera``, ``sample_chairs``
Find their poses     ``estimate_pose``, ``PoseEstimate``
Look and measure     ``glyphs``, ``metrics``
Files and layouts    ``load_descriptor``, ``save_descriptor``, ``to_layout``, ``from_layout``

Axes, ranges, angles and boxes: ``docs/conventions.md``.
"""

from .runtime.stubs import attach

__version__ = "0.1.0"

# PyTorch takes two seconds to load
__getattr__, __dir__, __all__ = attach(__name__)
