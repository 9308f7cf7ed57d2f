"""Learned priors: the image that a network expects for a descriptor, and how sure its bright side is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import torch
from torch import Tensor

from ...hog.dialects import as_spec
from ...hog.spec import HOGSpec
from ...inputs.arrays import as_unit_range
from ...inputs.numbers import as_integer, as_seed, as_size
from ...inputs.tensors import check_finite, check_shape
from ...io.learned_model import SPEC, TENSOR, LearnedModel, account, build_network, check_weights, integers
from ...runtime.pytorch import by_image
from ..arguments import MOST_SAMPLES, check_descriptor
from ..histograms import linear_vote_spec, recover_histograms
from ..starts import match_contrast, starting_images
from ..unknowns import low_pass
from .confidence import (
    Calibration,
    Confidence,
    SignEvidence,
    check_calibration,
    compare_regions,
    smooth_regions,
)
from .provenance import NetworkLearning
from .signed_network import TRAINING_CELLS, Architecture, PriorNetwork, SignedNetwork
from .unsigned_network import UnsignedNetwork

IMAGES_AT_ONCE = 8  # whose signs a network judges together: more take more memory, and hardly less time
SMALL_CELL_PIXELS = 4.0  # pixels: if cells are no larger, the integral gives all that is larger than a cell


def network_class(spec: HOGSpec) -> type[PriorNetwork]:
    """The class of networks for descriptors of ``spec``; ValueError if these cannot be inverted."""
    return SignedNetwork if linear_vote_spec(spec).signed else UnsignedNetwork


@dataclass(frozen=True, eq=False, repr=False)
class LearnedPrior(LearnedModel):
    """A network from a descriptor to an image, near the mean of all photographs that have this descriptor.

    ``nablahog.reconstruct(…, prior=prior)`` finds a pre-image near that image.

    Attributes:
        spec: a dialect that it was trained for; the prior is for all signed dialects, or for all unsigned ones.
        architecture: of its network.
        weights: all of them, (n,), float16, finite.
        learning: how it was trained.

    Raises:
        ValueError: these contradict each other.

    >>> images = {"noise": torch.rand(96, 96, generator=torch.Generator().manual_seed(0))}
    >>> prior = nablahog.train_prior(images, nablahog.presets.uoctti(cell_size=8), epochs=1)

    >>> descriptor = nablahog.hog(torch.rand(1, 1, 32, 32), prior.spec)
    >>> nablahog.reconstruct(descriptor, prior.spec, prior=prior, quality="fast").image.shape
    torch.Size([1, 1, 32, 32])
    """

    KIND = "learned prior"
    NOUN = "prior"
    COMPRESSED = True  # the names of thousands of photographs take a tenth of the file
    ARRAYS: ClassVar = {
        "spec": SPEC,
        "widths": integers(),
        "blocks": integers(),
        "weights": TENSOR,
        "training": account(NetworkLearning),
    }

    spec: HOGSpec
    architecture: Architecture
    weights: Tensor
    learning: NetworkLearning

    def __post_init__(self) -> None:
        network_class(self.spec).check(self.architecture)
        check_weights(self.weights, self._make)
        check_calibration(self.learning.calibration)

    @cached_property
    def signed(self) -> bool:
        """Whether it is for signed descriptors."""
        return linear_vote_spec(self.spec).signed

    @cached_property
    def calibration(self) -> Calibration:
        """The numbers that make probabilities of the network's log-odds; the log-odds' own where it has none."""
        return Calibration(*self.learning.calibration)

    @property
    def summary(self) -> str:
        return f"{self.learning.summary}, {len(self.weights):,} weights"

    def _values(self) -> dict[str, Any]:
        network = {**vars(self.architecture), "weights": self.weights}
        return {"spec": self.spec, **network, "training": self.learning}

    @classmethod
    def _of(cls, values: dict[str, Any]) -> LearnedPrior:
        architecture = Architecture(values["widths"], values["blocks"])
        return cls(values["spec"], architecture, values["weights"], values["training"])

    def check(self, spec: HOGSpec | str) -> None:
        """Raises ValueError if it was not trained for descriptors like those of ``spec``."""
        spec = as_spec(spec)
        trained, given = ("signed" if signed else "unsigned" for signed in (self.signed, linear_vote_spec(spec).signed))
        if trained != given:
            raise ValueError(f"the {self.NOUN} is for {trained} descriptors, but {spec.named} descriptor is {given}")

    @torch.no_grad()
    def expected(
        self, descriptor: Tensor, spec: HOGSpec | str, image_size: tuple[int, int], histograms: Tensor | None = None
    ) -> Tensor:
        """The images of the network, (B, 1, H, W) around 0.5, at the contrast of the histograms.

        The mean of the predictions for the image and for its mirror image; of signed dialects, what is large comes from
        the integral of the histograms.  If the dialect describes roots of images, the expected roots.

        Args:
            descriptor: (B, rows, cols, channels), float32 or float64, on any device.
            spec: its dialect, or the name of a preset with its defaults; signed if the prior's is, else unsigned.
            image_size: (height, width).
            histograms: those that :func:`.histograms.recover_histograms` recovers of it, if they are there already.

        Raises:
            TypeError: the descriptor is no float32 or float64 tensor.
            ValueError: the prior is not for ``spec``, or the descriptor's shape contradicts it, or it holds NaN or Inf.
        """
        spec = as_spec(spec)
        network, linear_spec, size, histograms = self._prepare(descriptor, spec, image_size, histograms)
        images = by_image(lambda cells: network.predict(cells, linear_spec, size), histograms)
        images = match_contrast(images, histograms, linear_spec)
        if spec.signed:
            images = _add_integral(images, histograms, linear_spec)
        return images.to(descriptor.dtype)

    @torch.no_grad()
    def samples(
        self, descriptor: Tensor, spec: HOGSpec | str, image_size: tuple[int, int], count: int, *, seed: int = 0
    ) -> Tensor:
        """Random images that the network considers possible, (B, count, 1, H, W), scaled as in :meth:`expected`.

        Each is the answer with other parts of the network dropped out, and its polarity is drawn by
        :meth:`polarity_confidence`.  The draws are the same for every descriptor of the batch.

        Raises:
            TypeError, ValueError: as :meth:`expected`; the prior is for signed descriptors, which leave no signs open.
        """
        count, seed = as_integer("count", count, 1, MOST_SAMPLES), as_seed(seed)
        network, linear_spec, size, histograms = self._prepare(descriptor, as_spec(spec), image_size)
        if not isinstance(network, UnsignedNetwork):
            raise ValueError("samples need a prior for unsigned descriptors, got one for signed descriptors")
        polarity = self.calibration.polarity
        draws = by_image(lambda cells: network.draw(cells, linear_spec, size, count, seed, polarity), histograms)
        images = match_contrast(draws, histograms.repeat_interleave(count, dim=0), linear_spec)
        return images.to(descriptor.dtype).reshape(-1, count, 1, *size)

    def polarity_confidence(
        self, images: Tensor, descriptor: Tensor, spec: HOGSpec | str, histograms: Tensor | None = None
    ) -> Tensor:
        """The probability that images with unsigned descriptors are not negatives, each as a whole.

        It says nothing of single regions, see :meth:`region_confidence`.

        Args:
            images: (B, 1, H, W), of any contrast, floats or uint8.
            descriptor: (B, rows, cols, channels), theirs, float32 or float64.
            spec: its dialect, or the name of a preset with its defaults.
            histograms: as for :meth:`expected`.

        Returns:
            (B,) in 0…1; an image and its negative sum to 1, a constant image gets 0.5.  It is at most
            (1 + calibration.share) / 2, 0.88 for the package's prior.  1 for signed descriptors, which determine the
            polarity.

        Raises:
            TypeError, ValueError: as :meth:`expected`.
        """
        return self.confidence(images, descriptor, spec, histograms).polarity

    def region_confidence(
        self, images: Tensor, descriptor: Tensor, spec: HOGSpec | str, histograms: Tensor | None = None
    ) -> Tensor:
        """The probability of each region of such images that it is rightly brighter or darker than its image's mean.

        A region is what a Gaussian of 8 pixels sees around a pixel.  It is sure where the network's prediction is far
        from its mean and has the image's sign, as far as the sign of the whole image is sure.

        Args:
            images, descriptor, spec, histograms: as for :meth:`polarity_confidence`.

        Returns:
            (B, 1, H, W) in 0…1; an image and its negative sum to 1, a constant image gets 0.5.  Below 0.5 the opposite
            is likelier.  No region is surer than the polarity can be, so with the package's prior few reach 0.8.  1 for
            signed descriptors.

        Raises:
            TypeError, ValueError: as :meth:`expected`.
        """
        return self.confidence(images, descriptor, spec, histograms).regions

    @torch.no_grad()
    def confidence(
        self, images: Tensor, descriptor: Tensor, spec: HOGSpec | str, histograms: Tensor | None = None
    ) -> Confidence:
        """:meth:`polarity_confidence` and :meth:`region_confidence`, for little more than one of them."""
        evidence = self.gather_evidence(images, descriptor, spec, histograms)
        if evidence is None:
            return Confidence(descriptor.new_ones(len(descriptor)), descriptor.new_ones(images.shape))
        polarity = self.calibration.polarity(evidence.log_odds)
        regions = self.calibration.regions(evidence, polarity, (images.shape[2], images.shape[3]))
        return Confidence(polarity.to(descriptor.dtype), regions.to(descriptor.dtype))

    @torch.no_grad()
    def gather_evidence(
        self, images: Tensor, descriptor: Tensor, spec: HOGSpec | str, histograms: Tensor | None = None
    ) -> SignEvidence | None:
        """What speaks for the signs of images, as for :meth:`polarity_confidence`; None for signed descriptors."""
        images, _ = as_unit_range("images", images)
        check_shape("images", images, ("B", 1, "H", "W"))
        size = (images.shape[2], images.shape[3])
        network, linear_spec, _, histograms = self._prepare(descriptor, as_spec(spec), size, histograms)
        if len(images) != len(descriptor):
            raise ValueError(f"there must be one image for each of {len(descriptor)} descriptors, got {len(images)}")
        check_finite("images", images)
        if not isinstance(network, UnsignedNetwork):
            return None
        evidence = []
        parts = (torch.split(batch, IMAGES_AT_ONCE) for batch in (images.float(), histograms))
        for part, cells in zip(*parts, strict=True):
            largest = network.largest_cells(network.rebin(cells, linear_spec, size))
            agreement = compare_regions(smooth_regions(part), largest.regions)
            evidence.append(SignEvidence(network.log_odds(part, largest), agreement))
        return SignEvidence(*map(torch.cat, zip(*evidence, strict=True)))

    def _prepare(
        self, descriptor: Tensor, spec: HOGSpec, image_size: tuple[int, int], histograms: Tensor | None = None
    ) -> tuple[PriorNetwork, HOGSpec, tuple[int, int], Tensor]:
        """The network on the descriptor's device, its linear spec, (height, width), and the recovered histograms, after
        all checks."""
        self.check(spec)
        size = check_descriptor(descriptor, spec, as_size("image_size", image_size))
        linear_spec = linear_vote_spec(spec)
        if histograms is None:
            histograms = recover_histograms(descriptor.float(), linear_spec, size)
        else:
            shape = len(descriptor), linear_spec.colours * linear_spec.bins, *linear_spec.cells(*size)
            check_shape("the histograms", histograms, shape)
        return self._network.to(descriptor.device), linear_spec, size, histograms.float()

    @cached_property
    def _network(self) -> PriorNetwork:
        return build_network(self._make, self.weights)

    def _make(self) -> PriorNetwork:
        return network_class(self.spec)(self.architecture)


def _add_integral(images: Tensor, histograms: Tensor, spec: HOGSpec) -> Tensor:
    """Images (B, 1, H, W) with the largest structures of the integrals of the ``histograms``.

    A network has seen 16x16 cells; errors that it makes in all cells of a sky add up.  Integrals are good at what is
    large in cells, and the better the smaller the cells are.
    """
    height, width = images.shape[2:]
    side = math.sqrt(spec.cell_size[0] * spec.cell_size[1])
    sigma = side * max(1.0, (side / SMALL_CELL_PIXELS) ** 3 * min(1.0, TRAINING_CELLS / (max(height, width) / side)))
    integrals = starting_images(histograms, spec, height, width, 1, 0, spread=0.0)[:, 0]
    return images + low_pass(integrals - images, sigma)
