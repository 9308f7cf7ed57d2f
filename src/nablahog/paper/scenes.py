"""Synthetic scenes: an object of known model and pose in front of photographs, as a benchmark of poses."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage
from torch import Tensor
from torch.nn import functional

from ..hog.gradient import GRAY_WEIGHTS
from ..inputs.boxes import Box
from ..io.images import Picture, as_array
from ..render import Camera, Light, Mesh, render
from ..render.camera import to_camera, to_screen
from .annotations import Example
from .looks import compress_jpeg, relight

Floats: TypeAlias = NDArray[np.float64]
Bounds: TypeAlias = tuple[float, float]

CHAIRS = Path(__file__).with_name("chairs.npz")
"""The 24 procedural chairs in the scenes of Table 2, by name; :func:`nablahog.sample_chairs` has others."""
_BORDER = 6  # pixels between the object and the image's border


@dataclass(frozen=True)
class SceneSettings:
    """The difficulty of scenes: ranges of uniform distributions, and shares.

    Attributes:
        size: of the square images, in pixels.
        height: of the object in pixels; less where it would not fit in its width.
        distance: from the camera to the object's centre, in diagonals of its bounding box.  It decides how strong the
            perspective is: the focal length follows from it and the height.
        albedo: factor of the model's brightness, which stays below 1.
        ambient: share of ambient light; the rest comes from one uniformly random direction.
        tint: by how much the object's R, G and B, and those of gray clutter, differ from gray, at most.
        contrast: factor of the clutter's deviations from its mean.
        zoom: pixels of the photograph of clutter for one pixel of the image.
        occlusion: share of scenes where something is in front of the object.
        occluded: share of the object's box that it covers.
        blur: σ of the Gaussian that blurs the image, in pixels.
        gamma: exponent of the image's brightness.
        exposure: factor of the image's brightness.
        noise: σ of normal noise, the same for the three colours, of an image in 0…1.
        shadow: share of the direct light that is missing in shadows that the object casts; the light is above it then.
        gloss: brightness of highlights on the object.
        jpeg: quality of the image's compression, at most 95; 0 and 0 for none.
        box_jitter: σ of the error of each side of the box, relative to its width or height.
        elevation_error: of the initial pose, at most, in degrees.

    Raises:
        ValueError: a range does not go from a smaller number to a larger one, or a field is out of its bounds.
    """

    size: int = 224
    height: Bounds = (100.0, 140.0)
    distance: Bounds = (2.5, 4.0)
    albedo: Bounds = (0.5, 1.2)
    ambient: Bounds = (0.2, 0.6)
    tint: float = 0.1
    contrast: Bounds = (0.5, 1.2)
    zoom: Bounds = (0.6, 1.8)
    occlusion: float = 0.25
    occluded: Bounds = (0.05, 0.2)
    blur: Bounds = (0.0, 1.0)
    gamma: Bounds = (0.75, 1.33)
    exposure: Bounds = (0.8, 1.2)
    noise: Bounds = (0.0, 0.03)
    shadow: float = 0.0
    gloss: float = 0.0
    jpeg: Bounds = (0.0, 0.0)
    box_jitter: float = 0.02
    elevation_error: float = 5.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            low, high = value if isinstance(value, tuple) else (value, value)
            if not 0 <= low <= high < math.inf:
                raise ValueError(f"{field.name} must be finite, at least 0 and a range from low to high, got {value}")
        if max(self.occlusion, self.tint, self.shadow, self.gloss, self.ambient[1], self.occluded[1]) > 1:
            raise ValueError("occlusion, tint, shadow, gloss, ambient and occluded must lie in 0…1")
        if any(self.jpeg) and not 1 <= self.jpeg[0] <= self.jpeg[1] <= 95:
            raise ValueError(f"jpeg must be (0, 0) or lie in 1…95, got {self.jpeg}")
        if self.distance[0] <= 1 or not 1 <= self.height[0] <= self.height[1] <= self.size - 2 * _BORDER:
            raise ValueError(
                f"distance must be above 1 and height between 1 and size - {2 * _BORDER}, "
                f"got {self.distance}, {self.height} and the size {self.size}"
            )
        if min(self.occluded[0], self.zoom[0], self.gamma[0]) <= 0:
            raise ValueError("occluded, zoom and gamma must be above 0")


SETTINGS = SceneSettings()


@dataclass(frozen=True, eq=False)
class Scene:
    """A rendered object in front of clutter, and the truth about it.

    Attributes:
        model: the name of its model.
        image: (3, H, W), float32 in 0…1: R, G, B.
        box: of the object, with the error of an annotation.
        pose: (6,), float64: the true pose, see :data:`~nablahog.render.camera.PARAMETERS`.
        camera: of the image.
        initial: (6,), float64: the pose to start from: a random azimuth, an elevation near the true one, the middle
            distance; 0 for the others.
    """

    model: str
    image: Tensor
    box: Box
    pose: Tensor
    camera: Camera
    initial: Tensor

    def annotated(self, name: str) -> Example:
        """The object of that name with its true viewpoint, and the azimuth and elevation to start from."""
        azimuth, elevation, _, theta, _, _ = self.pose.tolist()
        initial = float(self.initial[0]), float(self.initial[1])
        return Example(name, self.image, self.box, azimuth, elevation, theta, self.model, initial)


def scene(
    index: int,
    models: Mapping[str, Mesh],
    viewpoints: Floats,
    photographs: Sequence[Picture],
    *,
    seed: int = 0,
    settings: SceneSettings = SETTINGS,
) -> Scene:
    """One scene of a benchmark; the same for the same arguments.

    Args:
        index: number of the scene, at least 0.
        models: normalised meshes by name, of which one is drawn.
        viewpoints: (N, 3) azimuth, elevation, theta, as :func:`~nablahog.paper.annotations.read_viewpoints`, of which
            one is drawn.
        photographs: clutter: gray (H, W) or (1, H, W), or R, G, B (3, H, W), in 0…1.
        seed: of the benchmark, at least 0.
        settings: its difficulty.

    Raises:
        ValueError: there are no models, viewpoints or photographs, or they have other shapes.

    >>> from nablahog.paper import scenes
    >>> models = nablahog.sample_chairs()
    >>> viewpoints = np.array([[30.0, 15.0, 0.0], [200.0, 10.0, 2.0]])  # azimuth, elevation, theta
    >>> one = scenes.scene(0, models, viewpoints, [torch.rand(200, 200)])
    >>> one.image.shape, one.model in models, float(one.pose[0]) in (30.0, 200.0)
    (torch.Size([3, 224, 224]), True, True)
    """
    if not models or not photographs:
        raise ValueError(f"expected models and photographs, got {len(models)} and {len(photographs)}")
    if viewpoints.ndim != 2 or viewpoints.shape[1] != 3 or not len(viewpoints):
        raise ValueError(f"expected viewpoints of shape (N, 3), N at least 1, got {viewpoints.shape}")
    generator = np.random.default_rng([seed, index])
    name = sorted(models)[generator.integers(len(models))]
    azimuth, elevation, theta = viewpoints[generator.integers(len(viewpoints))]
    distance = generator.uniform(*settings.distance)
    start = (generator.uniform(0, 360), elevation + settings.elevation_error * generator.uniform(-1, 1))
    initial = (start[0], min(max(start[1], -90), 90), sum(settings.distance) / 2, 0, 0, 0)
    pose, camera, box = _place(models[name], (azimuth, elevation, distance, theta, 0, 0), settings, generator)
    picture, coverage = _render(models[name], pose, camera, settings, generator)
    image = compose(picture, coverage, box, photographs, settings, generator)
    if settings.jpeg[1]:
        image = compress_jpeg(image, round(generator.uniform(*settings.jpeg)))
    pixels = torch.from_numpy(image.astype(np.float32))
    jittered = _jitter(box, settings, generator)
    return Scene(name, pixels, jittered, pose, camera, torch.tensor(initial, dtype=torch.float64))


def _place(
    mesh: Mesh, pose: tuple[float, ...], settings: SceneSettings, generator: np.random.Generator
) -> tuple[Tensor, Camera, Box]:
    """The pose with its translation in the image, the camera with its focal length, and the object's bounding box."""
    poses = torch.tensor([pose], dtype=torch.float64)
    points = to_camera(mesh.vertices, poses)

    def extent(camera: Camera) -> tuple[Floats, Floats]:
        screen = to_screen(points, poses, camera)[0, :, :2]
        return screen.amin(0).numpy(), screen.amax(0).numpy()

    low, high = extent(Camera(1.0, settings.size, settings.size))
    room = settings.size - 2 * _BORDER
    focal = min(generator.uniform(*settings.height) / (high - low)[1], room / (high - low)[0])
    camera = Camera(float(focal), settings.size, settings.size)
    low, high = extent(camera)
    corner = _BORDER + generator.random(2) * (room - (high - low))
    poses[0, 4:6] = torch.from_numpy(corner - low)
    return poses[0], camera, Box(*corner.tolist(), *(corner + high - low).tolist())


def _render(
    mesh: Mesh, pose: Tensor, camera: Camera, settings: SceneSettings, generator: np.random.Generator
) -> tuple[Floats, Floats]:
    """The object on black, in colour (3, H, W), and its coverage of each pixel (H, W), shadows included."""
    brightness = (mesh.brightness * generator.uniform(*settings.albedo)).clamp(max=1)
    ambient = generator.uniform(*settings.ambient)
    x, y, z = generator.normal(size=3)
    if settings.shadow:  # lamps of scenes with a floor are above it
        z = abs(z) + 0.5 * math.hypot(x, y)
    light = Light((x, y, z), ambient, 1 - ambient)
    behind = torch.tensor([0.0, 1.0]).reshape(2, 1, 1, 1).expand(2, 1, camera.height, camera.width)
    seen, twice = Mesh(mesh.vertices, mesh.faces, brightness), pose.expand(2, 6)
    black, white = render(seen, twice, camera, background=behind, light=light)[:, 0].double().numpy()
    coverage = (1 - (white - black)).clip(0, 1)
    if settings.shadow or settings.gloss:
        strength = {"shadow": settings.shadow, "gloss": settings.gloss}
        black, coverage = relight(black, coverage, seen, pose, camera, light, **strength)
    return _draw_colours(settings.tint, generator) * black, coverage


def compose(
    picture: Floats,
    coverage: Floats,
    box: Box,
    photographs: Sequence[Picture],
    settings: SceneSettings,
    generator: np.random.Generator,
) -> Floats:
    """Composes the image (3, H, W): clutter behind the object, an occluder in front, blur, exposure, gamma and noise.

    The picture (3, H, W) is the object on black, its coverage (H, W) is that of each pixel, with its shadow.
    """
    part = partial(_clutter, photographs, coverage.shape, settings, generator)
    image = picture + (1 - coverage) * part()
    if generator.random() < settings.occlusion:
        hidden = _occluder(box, generator.uniform(*settings.occluded), generator)
        front = part()
        image[:, hidden.rows, hidden.cols] = front[:, hidden.rows, hidden.cols]
    blur = generator.uniform(*settings.blur)
    image = ndimage.gaussian_filter(image, (0, blur, blur), mode="nearest").clip(0, 1)
    image = generator.uniform(*settings.exposure) * image ** generator.uniform(*settings.gamma)
    noise = generator.normal(0, generator.uniform(*settings.noise), coverage.shape)
    result: Floats = (image + noise).clip(0, 1)
    return result


def _occluder(box: Box, share: float, generator: np.random.Generator) -> Box:
    """A random rectangle that covers ``share`` of the box: a vertical or horizontal bar, or a patch."""
    wide = float(generator.choice([share, 1.0, math.sqrt(share)]))  # in widths of the box
    width, height = wide * box.width, share / wide * box.height
    left, top = np.array([box.x0, box.y0]) + generator.random(2) * (box.width - width, box.height - height)
    return Box(round(left), round(top), round(left + width), round(top + height))


def _jitter(box: Box, settings: SceneSettings, generator: np.random.Generator) -> Box:
    sides = np.array(box) + settings.box_jitter * generator.normal(size=4) * np.tile([box.width, box.height], 2)
    return Box(*sides.clip(0, settings.size).tolist())


def _clutter(
    photographs: Sequence[Picture], shape: tuple[int, ...], settings: SceneSettings, generator: np.random.Generator
) -> Floats:
    """A random crop (3, H, W) of a photograph, rescaled, mirrored or not, of another contrast, tinted if gray."""
    photo = _check_photograph(photographs[int(generator.integers(len(photographs)))])
    room = np.array(photo.shape[1:])
    zoom = min(generator.uniform(*settings.zoom), *(room / shape))
    sides = np.minimum(np.array(shape) * zoom, room).astype(int).clip(min=1)
    top, left = generator.integers(0, room - sides + 1)
    part = photo[:, top : top + sides[0], left : left + sides[1]]
    if generator.random() < 0.5:
        part = part[:, :, ::-1]
    tensor = torch.from_numpy(part.copy())[None]
    scaled: Floats = functional.interpolate(tensor, shape, mode="bicubic", antialias=True)[0].numpy()
    scaled = scaled.mean() + generator.uniform(*settings.contrast) * (scaled - scaled.mean())
    return np.asarray(scaled if len(photo) == 3 else scaled * _draw_colours(settings.tint, generator)).clip(0, 1)


def _draw_colours(tint: float, generator: np.random.Generator) -> Floats:
    """(3, 1, 1): random factors of R, G and B that do not change the gray of Eq. 1."""
    factors = 1 + tint * generator.uniform(-1, 1, 3)
    balanced: Floats = (factors / np.dot(GRAY_WEIGHTS, factors))[:, None, None]
    return balanced


def _check_photograph(picture: Picture) -> Floats:
    values = as_array(picture)
    if values.ndim == 2:
        values = values[None]
    if values.ndim != 3 or len(values) not in (1, 3) or 0 in values.shape:
        raise ValueError(f"expected a photograph of shape (H, W), (1, H, W) or (3, H, W), got {values.shape}")
    if not (values.min() >= 0 and values.max() <= 1):  # NaN fails too
        raise ValueError(f"expected a photograph in 0…1, got {values.min():g} … {values.max():g}")
    return values
