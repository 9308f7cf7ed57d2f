"""Synthetic scenes: an object of known model and pose in front of photographs, as a benchmark of poses."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage
from torch import Tensor
from torch.nn import functional

from ..hog.box import Box
from ..hog.gradient import GRAY_WEIGHTS
from ..io.images import Picture, as_array
from ..render import Camera, Light, Mesh, render
from ..render.camera import to_camera, to_screen

Floats: TypeAlias = NDArray[np.float64]
Range: TypeAlias = tuple[float, float]

_MARGIN = 6  # pixels between the object and the image's border


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
        box_jitter: σ of the error of each side of the box, relative to its width or height.
        elevation_error: of the initial pose, at most, in degrees.

    Raises:
        ValueError: a range does not go from a smaller number to a larger one, or a field is out of its bounds.
    """

    size: int = 224
    height: Range = (100.0, 140.0)
    distance: Range = (2.5, 4.0)
    albedo: Range = (0.5, 1.2)
    ambient: Range = (0.2, 0.6)
    tint: float = 0.1
    contrast: Range = (0.5, 1.2)
    zoom: Range = (0.6, 1.8)
    occlusion: float = 0.25
    occluded: Range = (0.05, 0.2)
    blur: Range = (0.0, 1.0)
    gamma: Range = (0.75, 1.33)
    exposure: Range = (0.8, 1.2)
    noise: Range = (0.0, 0.03)
    box_jitter: float = 0.02
    elevation_error: float = 5.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, list):
                value = tuple(value)
                object.__setattr__(self, field.name, value)
            low, high = value if isinstance(value, tuple) else (value, value)
            if not 0 <= low <= high < math.inf:
                raise ValueError(f"{field.name} must be at least 0, finite and a range from low to high, got {value}")
        for name in ("occlusion", "tint"):
            if getattr(self, name) > 1:
                raise ValueError(f"{name} must lie in 0…1, got {getattr(self, name)}")
        if self.ambient[1] > 1 or self.occluded[1] > 1:
            raise ValueError(f"ambient and occluded must lie in 0…1, got {self.ambient} and {self.occluded}")
        if self.distance[0] <= 1 or not 1 <= self.height[0] <= self.height[1] <= self.size - 2 * _MARGIN:
            raise ValueError(
                f"distance must be above 1 and height between 1 and size - {2 * _MARGIN}, "
                f"got {self.distance}, {self.height} and the size {self.size}"
            )
        for name in ("occluded", "zoom", "gamma"):
            if getattr(self, name)[0] <= 0:
                raise ValueError(f"{name} must be above 0, got {getattr(self, name)}")


SETTINGS = SceneSettings()


@dataclass(frozen=True, eq=False)
class Scene:
    """One test object.

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
        viewpoints: (N, 3) azimuth, elevation, theta, as :func:`~nablahog.datasets.viewpoints.read_viewpoints`, of which
            one is drawn.
        photographs: clutter: gray (H, W) or (1, H, W), or R, G, B (3, H, W), in 0…1.
        seed: of the benchmark, at least 0.
        settings: its difficulty.

    Raises:
        ValueError: there are no models, viewpoints or photographs, or they have other shapes.

    >>> from nablahog.datasets import chairs, scenes
    >>> models = {"a": chairs.chair(1), "b": chairs.chair(2)}
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
    image = compose(picture, coverage, box, [_photograph(photo) for photo in photographs], settings, generator)
    return Scene(
        model=name,
        image=torch.from_numpy(image.astype(np.float32)),
        box=_jitter(box, settings, generator),
        pose=pose,
        camera=camera,
        initial=torch.tensor(initial, dtype=torch.float64),
    )


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
    room = settings.size - 2 * _MARGIN
    focal = min(generator.uniform(*settings.height) / (high - low)[1], room / (high - low)[0])
    camera = Camera(float(focal), settings.size, settings.size)
    low, high = extent(camera)
    corner = _MARGIN + generator.random(2) * (room - (high - low))
    poses[0, 4:6] = torch.from_numpy(corner - low)
    return poses[0], camera, Box.of((*corner.tolist(), *(corner + high - low).tolist()))


def _render(
    mesh: Mesh, pose: Tensor, camera: Camera, settings: SceneSettings, generator: np.random.Generator
) -> tuple[Floats, Floats]:
    """The object on black, in colour (3, H, W), and its coverage of each pixel (H, W)."""
    brightness = (mesh.brightness * generator.uniform(*settings.albedo)).clamp(max=1)
    ambient = generator.uniform(*settings.ambient)
    x, y, z = generator.normal(size=3)
    light = Light((x, y, z), ambient, 1 - ambient)
    behind = torch.tensor([0.0, 1.0]).reshape(2, 1, 1, 1).expand(2, 1, camera.height, camera.width)
    twice = pose.expand(2, 6)
    black, white = (
        render(Mesh(mesh.vertices, mesh.faces, brightness), twice, camera, background=behind, light=light)[:, 0]
        .double()
        .numpy()
    )
    return _colours(settings, generator) * black, (1 - (white - black)).clip(0, 1)


def _colours(settings: SceneSettings, generator: np.random.Generator) -> Floats:
    """(3, 1, 1): random factors of R, G and B that do not change the gray of Eq. 1."""
    factors = 1 + settings.tint * generator.uniform(-1, 1, 3)
    colours: Floats = (factors / np.dot(GRAY_WEIGHTS, factors))[:, None, None]
    return colours


def compose(
    picture: Floats,
    coverage: Floats,
    box: Sequence[float],
    photographs: Sequence[Floats],
    settings: SceneSettings,
    generator: np.random.Generator,
) -> Floats:
    """Composes the image: clutter behind the object, an occluder in front, then blur, exposure, gamma and noise.

    Args:
        picture: (3, H, W), the object on black.
        coverage: (H, W) in 0…1, of each pixel by the object.
        box: x0, y0, x1, y1 of the object, pixels.
        photographs: clutter, (1 or 3, h, w) in 0…1.
        settings: its difficulty.
        generator: of random numbers.

    Returns:
        (3, H, W), float64 in 0…1.

    >>> from nablahog.datasets import scenes
    >>> picture, coverage = np.full((3, 64, 64), 0.5), np.zeros((64, 64))
    >>> coverage[16:48, 16:48] = 1.0  # the object is a gray square
    >>> clutter = [np.random.default_rng(0).random((1, 80, 80))]
    >>> generator = np.random.default_rng(0)
    >>> scenes.compose(picture * coverage, coverage, (16, 16, 48, 48), clutter, scenes.SceneSettings(), generator).shape
    (3, 64, 64)
    """
    image = picture + (1 - coverage) * _clutter(photographs, coverage.shape, settings, generator)
    if generator.random() < settings.occlusion:
        hidden = _occluder(Box.of(box), generator.uniform(*settings.occluded), generator)
        front = _clutter(photographs, coverage.shape, settings, generator)
        image[:, hidden.rows, hidden.cols] = front[:, hidden.rows, hidden.cols]
    blur = generator.uniform(*settings.blur)
    image = ndimage.gaussian_filter(image, (0, blur, blur), mode="nearest").clip(0, 1)
    image = generator.uniform(*settings.exposure) * image ** generator.uniform(*settings.gamma)
    noise = generator.normal(0, generator.uniform(*settings.noise), coverage.shape)
    result: Floats = (image + noise).clip(0, 1)
    return result


def _clutter(
    photographs: Sequence[Floats], shape: tuple[int, ...], settings: SceneSettings, generator: np.random.Generator
) -> Floats:
    """(3, H, W): a random crop of a photograph, rescaled, with another contrast, possibly mirrored."""
    photo = photographs[int(generator.integers(len(photographs)))]
    room = np.array(photo.shape[1:])
    sides = (
        np.minimum(np.array(shape) * min(generator.uniform(*settings.zoom), *(room / shape)), room)
        .astype(int)
        .clip(min=1)
    )
    top, left = generator.integers(0, room - sides + 1)
    part = photo[:, top : top + sides[0], left : left + sides[1]]
    if generator.random() < 0.5:
        part = part[:, :, ::-1]
    tensor = torch.from_numpy(part.copy())[None]
    scaled: Floats = functional.interpolate(tensor, shape, mode="bicubic", antialias=True)[0].numpy()
    scaled = scaled.mean() + generator.uniform(*settings.contrast) * (scaled - scaled.mean())
    return np.asarray(scaled if len(photo) == 3 else scaled * _colours(settings, generator)).clip(0, 1)


def _occluder(box: Box, share: float, generator: np.random.Generator) -> Box:
    """A random rectangle that covers ``share`` of the box: a vertical or horizontal bar, or a patch."""
    wide = float(generator.choice([share, 1.0, math.sqrt(share)]))  # in widths of the box
    width, height = wide * box.width, share / wide * box.height
    left, top = np.array([box.x0, box.y0]) + generator.random(2) * (box.width - width, box.height - height)
    return Box(round(left), round(top), round(left + width), round(top + height))


def _jitter(box: Box, settings: SceneSettings, generator: np.random.Generator) -> Box:
    sides = np.array(box) + settings.box_jitter * generator.normal(size=4) * np.tile([box.width, box.height], 2)
    return Box.of(sides.clip(0, settings.size).tolist())


def _photograph(picture: Picture) -> Floats:
    values = as_array(picture)
    if values.ndim == 2:
        values = values[None]
    if values.ndim != 3 or len(values) not in (1, 3) or 0 in values.shape:
        raise ValueError(f"expected a photograph of shape (H, W), (1, H, W) or (3, H, W), got {values.shape}")
    if not (values.min() >= 0 and values.max() <= 1):  # NaN fails too
        raise ValueError(f"expected a photograph in 0…1, got {values.min():g} … {values.max():g}")
    return values
