"""The weights of a network as one row of numbers, as files hold them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

import torch
from torch import Tensor, nn
from torch.nn.utils import vector_to_parameters

from .learned_model import check_tensor

LARGEST = float(torch.finfo(torch.float16).max)
Network = TypeVar("Network", bound=nn.Module)


def flat(tensors: Iterable[Tensor]) -> Tensor:
    """All entries of the tensors in order, (n,), on the CPU."""
    return torch.cat([tensor.detach().flatten() for tensor in tensors]).cpu()


def count(make: Callable[[], nn.Module]) -> int:
    """The number of weights of the network that ``make`` makes, without allocating them."""
    with torch.device("meta"):
        return sum(weight.numel() for weight in make().parameters())


def check_weights(weights: Tensor, make: Callable[[], nn.Module]) -> None:
    """Raises ValueError unless these are all weights of such a network, (n,), float16, finite."""
    check_tensor("weights", weights, torch.float16, (count(make),), -LARGEST, LARGEST)


def with_weights(make: Callable[[], Network], weights: Tensor) -> Network:
    """The network that ``make`` makes, with weights (n,), in float32 on the CPU, for evaluation."""
    with torch.device("meta"):
        network = make()
    network.to_empty(device="cpu")
    vector_to_parameters(weights.float().cpu(), network.parameters())
    for layer in _normalised(network):
        layer.reset_running_stats()
    return network.eval()


@torch.no_grad()
def fold_statistics(network: nn.Module) -> None:
    """Folds the running means and variances of batch normalisation into its weights.

    The network's answers stay the same, until it is trained further.
    """
    for layer in _normalised(network):
        mean, variance = layer.running_mean, layer.running_var
        assert mean is not None
        assert variance is not None
        layer.weight.mul_(torch.sqrt((1 + layer.eps) / (variance + layer.eps)))
        layer.bias.sub_(mean * layer.weight / math.sqrt(1 + layer.eps))
        layer.reset_running_stats()


@torch.no_grad()
def unfold_statistics(network: nn.Module, run: Callable[[], object]) -> None:
    """Undoes :func:`fold_statistics`, so that the network can be trained further.

    It normalises by the means and variances of its inputs during ``run``.  Its answers stay the same, until it is
    trained.
    """
    moments: dict[nn.BatchNorm2d, list[tuple[Tensor, Tensor]]] = {layer: [] for layer in _normalised(network)}

    def watch(layer: nn.Module, inputs: tuple[Tensor, ...]) -> None:
        assert isinstance(layer, nn.BatchNorm2d)
        moments[layer].append((inputs[0].mean(dim=(0, 2, 3)), inputs[0].square().mean(dim=(0, 2, 3))))

    watched = [layer.register_forward_pre_hook(watch) for layer in moments]
    network.eval()
    run()
    for hook in watched:
        hook.remove()
    for layer, seen in moments.items():
        mean, square = (torch.stack(each).mean(dim=0) for each in zip(*seen, strict=True))
        assert layer.running_mean is not None
        assert layer.running_var is not None
        layer.running_mean.copy_(mean)
        layer.running_var.copy_(square - mean.square())
        layer.bias.add_(mean * layer.weight / math.sqrt(1 + layer.eps))
        layer.weight.mul_(torch.sqrt((layer.running_var + layer.eps) / (1 + layer.eps)))
    network.train()


def _normalised(network: nn.Module) -> Iterator[nn.BatchNorm2d]:
    return (layer for layer in network.modules() if isinstance(layer, nn.BatchNorm2d))
