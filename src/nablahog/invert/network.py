"""Which network a learned prior has: one for signed descriptors, another for unsigned ones."""

from __future__ import annotations

from functools import partial

from ..hog.spec import HOGSpec
from ..io.network_weights import count
from .histograms import searchable
from .prior_network import Architecture, PriorNetwork
from .signed_network import SignedNetwork
from .unsigned_network import UnsignedNetwork


def network_class(spec: HOGSpec) -> type[PriorNetwork]:
    """The class of networks for descriptors of ``spec``.

    Raises:
        ValueError: no image of such a descriptor can be sought.
    """
    return SignedNetwork if searchable(spec).signed else UnsignedNetwork


def make_network(spec: HOGSpec, architecture: Architecture) -> PriorNetwork:
    """A network before training."""
    return network_class(spec)(spec, architecture)


def weight_count(spec: HOGSpec, architecture: Architecture) -> int:
    """The number of weights of a network, without allocating them."""
    return count(partial(make_network, spec, architecture))
