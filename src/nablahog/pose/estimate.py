"""estimate_pose(): from an object in a photograph and models of it to azimuth, elevation and distance (Section 3.2)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import torch
from torch import Tensor

from ..hog.inputs import ArrayImage, image_batch
from ..render import Camera, Mesh
from .canvas import cut_out
from .choices import Kind, Search
from .matching import Photograph, model_of
from .strategies import SEARCHES
from .task import Ascent, Path, Task
from .whitening import Background


@dataclass(frozen=True, eq=False)
class PoseEstimate:
    """The pose found.

    Attributes:
        azimuth, elevation, theta: degrees; azimuth in 0…360.
        distance: units of the mesh.
        x, y: pixels of the photograph, from its middle to where the object's origin is seen.
        camera: that these are meant for; it sees the whole photograph.
        model: the name of the model that fits best.
        similarity: of its rendering to the photograph, as ``similarity_kind`` has it.
        similarity_kind: see :mod:`.similarity`.
        on_canvas: (6,): the same pose for the canvas, see :func:`.canvas.cut_out`.
        renderings: that the search has looked at, those of views that are kept for every photograph included.
        paths: of the searches from all starts, if the method keeps them.

    >>> mesh, camera = nablahog.datasets.chairs.chair(3), nablahog.Camera.from_field_of_view(30, 128, 128)
    >>> photograph = nablahog.render(mesh, torch.tensor([[30.0, 20, 2, 0, 0, 0]]), camera)[0]
    >>> box = (28, 12, 95, 125)  # x0, y0, x1, y1

    >>> estimate = nablahog.estimate_pose(photograph, mesh, box=box, initial=(0, 20), method="exhaustive")
    >>> nablahog.render(mesh, estimate.pose, estimate.camera).shape
    torch.Size([1, 1, 128, 128])
    """

    azimuth: float
    elevation: float
    distance: float
    theta: float
    x: float
    y: float
    camera: Camera
    model: str
    similarity: float
    similarity_kind: Kind
    on_canvas: Tensor
    renderings: int
    paths: tuple[Path, ...] = field(default=(), repr=False)

    @property
    def pose(self) -> Tensor:
        """(1, 6), to render it with ``camera``."""
        values = (self.azimuth, self.elevation, self.distance, self.theta, self.x, self.y)
        return torch.tensor([values], dtype=torch.float64)


def estimate_pose(
    photograph: Tensor | ArrayImage,
    models: Mesh | Mapping[str, Mesh],
    *,
    box: Sequence[float] | None = None,
    initial: tuple[float, float] | None = None,
    method: Search = "best",
    similarity: Kind | None = None,
    ascent: Ascent = "hill",
    background: Background | None = None,
    seed: int = 0,
    progress: Callable[[int, int, str], None] = lambda done, total, what: None,
) -> PoseEstimate:
    """The pose at which a rendering of a model has the HOG most like the photograph's.

    Args:
        photograph: (C, H, W), float in 0…1, one channel or R, G, B; or an array (H, W) or (H, W, C), or a PIL image.
        models: normalised meshes by name, or one mesh; all are tried, the best is returned.
        box: of the object, x0, y0, x1, y1 in pixels; by default the whole photograph.
        initial: azimuth and elevation to begin at, degrees; by default unknown.
        method: ``"best"``: views all around at about the initial elevation (or at several, if unknown), then an ascent
            over all six parameters from the best of them, at last with smaller cells.  ``"paper"``: visual elements of
            the photograph, OpenDR's derivatives, momentum over azimuth and every few steps over distance, from the
            initial pose and 8 azimuths around.  ``"exhaustive"``: every degree of azimuth at the initial elevation.
        similarity: ``"dot"``, ``"whitened"`` or ``"calibrated"``, see :mod:`.similarity`; by default ``"dot"`` for the
            paper's method and ``"calibrated"`` for the others.
        ascent: of ``"best"``: ``"hill"``, fits of a quadratic to samples, see :func:`.hill.climb`; ``"momentum"`` and
            ``"lbfgs"`` follow single derivatives.
        background: of the coarse descriptor, which also says which descriptor that is; by default that of
            :func:`.matching.pose_spec`, learned from photographs that come with scikit-image.
        seed: of what is sampled.
        progress: called with the models done, their number and the name of the one at work.

    Returns:
        The pose for the photograph, with the camera it is meant for.  Its distance goes with that camera's lens: how
        strong the perspective was, a photograph of one object hardly tells.

    Raises:
        ValueError: the photograph, the box, the models or an option is none of the above.

    >>> mesh, camera = nablahog.datasets.chairs.chair(3), nablahog.Camera.from_field_of_view(30, 128, 128)
    >>> photograph = nablahog.render(mesh, torch.tensor([[30.0, 20, 2, 0, 0, 0]]), camera)[0]
    >>> box = (28, 12, 95, 125)  # x0, y0, x1, y1

    >>> estimate = nablahog.estimate_pose(photograph, mesh, box=box, initial=(0, 20), method="exhaustive")
    >>> 25 < estimate.azimuth < 35
    True
    """
    named = {"": models} if isinstance(models, Mesh) else dict(models)
    if not named:
        raise ValueError("expected at least one model, got none")
    if method not in SEARCHES:
        raise ValueError(f"method must be one of {', '.join(map(repr, SEARCHES))}, got {method!r}")
    if ascent not in ("hill", "momentum", "lbfgs"):
        raise ValueError(f"ascent must be 'hill', 'momentum' or 'lbfgs', got {ascent!r}")
    if similarity not in (None, "dot", "whitened", "calibrated"):
        raise ValueError(f"similarity must be 'dot', 'whitened' or 'calibrated', got {similarity!r}")
    if initial is not None and not (all(map(math.isfinite, initial)) and -90 <= initial[1] <= 90):
        raise ValueError(f"initial must be a finite azimuth and an elevation in -90…90, got {initial}")
    if not isinstance(photograph, Tensor):
        images, single = image_batch("the photograph", photograph)
        if not single:
            raise ValueError(f"expected one photograph, got {len(images)}")
        photograph = images[0] / 255 if images.dtype == torch.uint8 else images[0]
    if photograph.dim() != 3:
        shape = tuple(photograph.shape)
        raise ValueError(f"the photograph must be a floating point tensor (1 or 3, H, W), got the shape {shape}")
    height, width = photograph.shape[1:]
    canvas = cut_out(photograph, (0, 0, width, height) if box is None else box)
    task = Task(
        Photograph(canvas, background),
        {name: model_of(mesh, canvas.camera) for name, mesh in named.items()},
        initial,
        similarity,
        ascent,
        torch.Generator().manual_seed(seed),
        progress,
    )
    found = SEARCHES[method](task)
    pose, camera = canvas.in_photograph(found.pose, height, width)
    values = pose.tolist()
    return PoseEstimate(
        azimuth=values[0] % 360,
        elevation=values[1],
        distance=values[2],
        theta=values[3],
        x=values[4],
        y=values[5],
        camera=camera,
        model=found.model,
        similarity=found.value,
        similarity_kind=found.kind,
        on_canvas=found.pose,
        renderings=found.renderings,
        paths=found.paths,
    )
