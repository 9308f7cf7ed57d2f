"""A network from an object's image to the probability of each azimuth, for objects of one class."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from itertools import pairwise
from pathlib import Path
from typing import ClassVar, Literal, TypeAlias

import torch
from torch import Tensor, nn

from ..hog.spec import HOGSpec
from ..inputs.arrays import as_unit_range
from ..inputs.numbers import as_integer, check_type, shortened
from ..inputs.tensors import check_shape, check_values
from ..io.learned_model import INTEGER, SPEC, TENSOR, LearnedModel, account, build_network, check_weights
from .background import FINE_CELL, pose_spec
from .crop import CROP_SIDE
from .model import VIEW_COUNT
from .similarity import describe

STORED_VIEWPOINTS = Path(__file__).with_name("default_viewpoints") / "chairs.npz"
NETWORK_WIDTH = 48  # channels of the first layer; the later ones have two and four times as many
_HIDDEN = 128
_DROPPED = (0.4, 0.3)  # shares, in training, before the last two layers
_WIDEST = 1024


class ViewpointNetwork(nn.Module):
    """From descriptors (B, C, 32, 32) to logits (B, 48) of azimuths 0°, 7.5°, ….

    Five 3x3 convolutions, every second of which halves the resolution, and two linear layers.  Descriptors are divided
    by their root mean square first: contrast has no influence.
    """

    def __init__(self, channels: int, width: int = NETWORK_WIDTH) -> None:
        super().__init__()
        widths = [channels, width, 2 * width, 2 * width, 4 * width, 4 * width]
        layers: list[nn.Module] = []
        for k, (before, after) in enumerate(pairwise(widths)):
            layers += [nn.Conv2d(before, after, 3, 2 - k % 2, padding=1), nn.BatchNorm2d(after), nn.ReLU()]
        self.features = nn.Sequential(*layers, nn.Flatten())
        cells = CROP_SIDE // FINE_CELL // 8
        self.azimuths = nn.Sequential(
            nn.Dropout(_DROPPED[0]),
            nn.Linear(widths[-1] * cells**2, _HIDDEN),
            nn.ReLU(),
            nn.Dropout(_DROPPED[1]),
            nn.Linear(_HIDDEN, VIEW_COUNT),
        )

    def forward(self, descriptors: Tensor) -> Tensor:
        power = descriptors.square().mean(dim=(1, 2, 3), keepdim=True)
        logits: Tensor = self.azimuths(self.features(descriptors / torch.where(power > 0, power, 1).sqrt()))
        return logits


def mirror_descriptors(descriptors: Tensor) -> Tensor:
    """Descriptors (B, C, rows, cols), of unsigned bins, of the images flipped from left to right: θ becomes π − θ."""
    bins = descriptors.shape[1]
    return descriptors[:, [-k % bins for k in range(bins)]].flip(3)


@dataclass(frozen=True, kw_only=True)
class ViewpointLearning:
    """How a viewpoint prior was learned.

    Attributes:
        scenes: number of them.
        photographs: behind the objects.
        sha256: of the photographs.
        seed: the seed of all random numbers.
        epochs: passes over the scenes.
        losses: the mean loss of each epoch.
    """

    scenes: int
    photographs: int
    sha256: str
    seed: int
    epochs: int
    losses: tuple[float, ...]


@dataclass(frozen=True, eq=False, repr=False)
class ViewpointPrior(LearnedModel):
    """Which azimuths are likely for an image, learned from scenes of objects of one class.

    Attributes:
        spec: of the descriptors that the network sees: that of the last steps of the search.
        width: of the network.
        weights: all of them, (n,), float16, finite.
        learning: how it was learned.

    Raises:
        ValueError: these contradict each other.

    >>> prior = nablahog.pose.default_viewpoints()
    >>> prior.log_probabilities(torch.rand(2, 1, 128, 128)).shape
    torch.Size([2, 48])
    """

    KIND = "viewpoint prior"
    NOUN = "viewpoint prior"
    COMPRESSED = True
    ARRAYS: ClassVar = {
        "spec": SPEC,
        "width": INTEGER,
        "weights": TENSOR,
        "learning": account(ViewpointLearning),
    }

    spec: HOGSpec
    width: int
    weights: Tensor
    learning: ViewpointLearning

    def __post_init__(self) -> None:
        pose_spec(FINE_CELL).check_same(check_type("spec", self.spec, HOGSpec), f"the {self.NOUN}")
        object.__setattr__(self, "width", as_integer("the width", self.width, 1, _WIDEST))
        check_type("learning", self.learning, ViewpointLearning)
        check_weights(self.weights, self._make)

    @property
    def summary(self) -> str:
        learned = self.learning
        return f"{learned.scenes} scenes, {learned.epochs} epochs, last loss {learned.losses[-1]:.4f}"

    @property
    def _make(self) -> partial[ViewpointNetwork]:
        return partial(ViewpointNetwork, self.spec.channels, self.width)

    @cached_property
    def _network(self) -> ViewpointNetwork:
        return build_network(self._make, self.weights)

    @torch.no_grad()
    def log_probabilities(self, images: Tensor) -> Tensor:
        """Logarithms of the probabilities (B, 48) of the azimuths 0°, 7.5°, …, float32.

        The geometric mean of those for the image and for the mirrored one.

        Args:
            images: (B, 1, 128, 128) of objects that fill their crops, floats in 0…1 or uint8.

        Raises:
            TypeError: they are no dense tensor.
            ValueError: they have another shape or dtype.
        """
        images, _ = as_unit_range("images", images)
        check_shape("images", images, ("B", 1, CROP_SIDE, CROP_SIDE))
        check_values("images", images)
        descriptors = describe(images.float(), self.spec)
        both_sides = descriptors, mirror_descriptors(descriptors)
        own, mirrored = (self._network(side).log_softmax(1) for side in both_sides)
        mean: Tensor = (own + mirrored.flip(1).roll(1, 1)).div(2).log_softmax(1)
        return mean


ViewpointChoice: TypeAlias = ViewpointPrior | Literal["default"] | None


@lru_cache(maxsize=1)
def default_viewpoints() -> ViewpointPrior:
    """The viewpoint prior that comes with the package, of chairs: see ``default_viewpoints/README.md``.

    Raises:
        FileNotFoundError: the package was installed without it.

    >>> nablahog.pose.default_viewpoints().learning.scenes
    70000
    """
    return ViewpointPrior.load(STORED_VIEWPOINTS)


def choose_viewpoints(choice: ViewpointChoice) -> ViewpointPrior | None:
    """The prior of a choice; for ``"default"`` none where the package was installed without it.

    Raises:
        ValueError: it is no such choice.
    """
    if isinstance(choice, str) and choice == "default":
        return default_viewpoints() if STORED_VIEWPOINTS.exists() else None
    if choice is not None and not isinstance(choice, ViewpointPrior):
        raise ValueError(f"viewpoints must be a ViewpointPrior, 'default' or None, got {shortened(choice)}")
    return choice
