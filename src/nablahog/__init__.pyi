from . import compat as compat, metrics as metrics
from .hog import (
    HOG as HOG,
    HOGLoss as HOGLoss,
    HOGSpec as HOGSpec,
    from_layout as from_layout,
    hog as hog,
    presets as presets,
    stream as stream,
    to_layout as to_layout,
)
from .invert import (
    LearnedPrior as LearnedPrior,
    Reconstruction as Reconstruction,
    reconstruct as reconstruct,
    reconstruct_multiscale as reconstruct_multiscale,
    template_descriptor as template_descriptor,
    train_prior as train_prior,
    which_hog as which_hog,
)
from .io import load_descriptor as load_descriptor, save_descriptor as save_descriptor
from .pose import PoseEstimate as PoseEstimate, estimate_pose as estimate_pose
from .render import (
    Camera as Camera,
    Mesh as Mesh,
    Renderer as Renderer,
    load_mesh as load_mesh,
    render as render,
    sample_chairs as sample_chairs,
)
from .viz import glyphs as glyphs

__version__: str
