"""Models that are learned from photographs, and their files: one .npz archive each.

The weights of a network are one row of numbers in it.
"""

from __future__ import annotations

import json
import math
import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import MISSING, asdict, fields
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, TypeVar, get_args, get_origin, get_type_hints

import torch
from torch import Tensor, nn

from ..hog.spec import HOGSpec
from ..inputs.numbers import check_type
from ..runtime.text import one_line
from .arrays import Arrays, check_format, naming, read_arrays, read_text, write_arrays
from .input_file import Readable

Model = TypeVar("Model", bound="LearnedModel")
Network = TypeVar("Network", bound=nn.Module)
LARGEST_WEIGHT = float(torch.finfo(torch.float16).max)


class Codec(NamedTuple):
    """How a value is stored as an array.

    Attributes:
        encode: from the value to what NumPy makes an array of.
        decode: from all arrays of a file and the name of this one to the value; raises ValueError.
    """

    encode: Callable[[Any], object]
    decode: Callable[[Arrays, str], Any]


class LearnedModel(ABC):
    """A model with a file.  A subclass is a dataclass, without a ``repr``, whose checks are in ``__post_init__``.

    Attributes:
        KIND, NOUN: what a file of it is, and one word for the model, for messages.
        ARRAYS: how each array of its file is stored.
        FORMAT: version of the file.
        COMPRESSED: whether the file is compressed.
    """

    KIND: ClassVar[str]
    NOUN: ClassVar[str]
    ARRAYS: ClassVar[Mapping[str, Codec]]
    FORMAT: ClassVar[int] = 1
    COMPRESSED: ClassVar[bool] = False

    def __repr__(self) -> str:
        """Its summary, not the numbers."""
        return f"<{type(self).__name__}: {self.summary}>"

    @property
    @abstractmethod
    def summary(self) -> str:
        """Its size and what it was learned from, in a few words."""

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the model to the file ``path``, whatever its name ends in.  The file is replaced whole or not at all.

        It is an .npz archive of the array ``format``, its version, and the arrays of the class.

        Raises:
            OSError: the file cannot be written.
        """
        arrays = {name: self.ARRAYS[name].encode(value) for name, value in self._values().items()}
        write_arrays(path, self.FORMAT, arrays, compressed=self.COMPRESSED)

    @classmethod
    def load(cls: type[Model], path: Readable) -> Model:
        """Reads what :meth:`save` wrote.  Never unpickles, so nothing in the file is ever run.

        Raises:
            FileNotFoundError: there is no such file.
            ValueError: it is not such an archive, is damaged, lacks an array, holds pickled objects, NaN or Inf, or its
                arrays contradict each other.
        """
        arrays = read_arrays(path, cls.KIND, ("format", *cls.ARRAYS))
        with naming(path):
            check_format(arrays, cls.KIND, cls.FORMAT)
            return cls._of({name: codec.decode(arrays, name) for name, codec in cls.ARRAYS.items()})

    def _values(self) -> dict[str, Any]:
        """The value of each array, by default the attribute of its name."""
        return {name: getattr(self, name) for name in self.ARRAYS}

    @classmethod
    def _of(cls: type[Model], values: dict[str, Any]) -> Model:
        """The model of :meth:`_values`."""
        return cls(**values)


def integers(count: int | None = None) -> Codec:
    """Stores a tuple of ``count`` integers, or of any number of them."""

    def decode(arrays: Arrays, name: str) -> tuple[int, ...]:
        array = arrays[name]
        if array.dtype.kind not in "iu" or array.ndim != 1 or count not in (None, len(array)):
            what = "be a list of" if count is None else f"hold {count}"
            raise ValueError(f"{name} must {what} integers, got {array.dtype} of shape {array.shape}")
        return tuple(array.tolist())

    return Codec(tuple, decode)


def account(kind: type[Any]) -> Codec:
    """Stores a dataclass of texts, numbers and tuples of these; fields with defaults may be missing in older files."""

    def decode(arrays: Arrays, name: str) -> Any:
        try:
            stored = json.loads(read_text(arrays, name))
            left_out = {field.name for field in fields(kind) if field.default is not MISSING} - stored.keys()
            hints = get_type_hints(kind).items()
            return kind(**{name: _convert(hint, stored[name]) for name, hint in hints if name not in left_out})
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise ValueError(f"how it was learned cannot be read: {one_line(error)}") from None

    return Codec(lambda value: json.dumps(asdict(value)), decode)


def _convert(hint: Any, value: Any) -> Any:
    return tuple(map(get_args(hint)[0], value)) if get_origin(hint) is tuple else hint(value)


def _scalar(what: str, kinds: str) -> Codec:
    def decode(arrays: Arrays, name: str) -> Any:
        array = arrays[name]
        if array.shape != () or array.dtype.kind not in kinds:
            raise ValueError(f"{name} must be one {what}, got {array.dtype} of shape {array.shape}")
        return array.item()

    return Codec(lambda value: value, decode)


TENSOR = Codec(lambda value: value.cpu().numpy(), lambda arrays, name: torch.from_numpy(arrays[name]))
INTEGER = _scalar("integer", "iu")
NUMBER = _scalar("float64", "f")
TEXTS = Codec(json.dumps, lambda arrays, name: tuple(map(str, json.loads(read_text(arrays, name)))))
SPEC = Codec(HOGSpec.to_json, lambda arrays, name: HOGSpec.from_json(read_text(arrays, name)))


def check_tensor(
    name: str, value: Tensor, dtype: torch.dtype, shape: tuple[int, ...], least: float, most: float
) -> None:
    """Raises TypeError or ValueError unless a tensor has this dtype and shape and lies in ``least`` … ``most``."""
    check_type(f"the {name}", value, Tensor)
    if value.dtype != dtype or value.shape != shape or not value.numel():
        expected, got = (str(kind).removeprefix("torch.") for kind in (dtype, value.dtype))
        raise ValueError(f"the {name} must be {expected} of shape {shape}, got {got} of {tuple(value.shape)}")
    if not ((value >= least) & (value <= most)).all():  # NaN fails too
        bounds = f"within ±{most:.5g}, got NaN, Inf or more"
        if least != -most:
            bounds = f"in {least:.5g}…{most:.5g}, got NaN, Inf or other values"
        raise ValueError(f"the {name} must lie {bounds}")


def flatten_all(tensors: Iterable[Tensor]) -> Tensor:
    """All entries of the tensors in order, (n,), on the CPU."""
    return torch.cat([tensor.detach().flatten() for tensor in tensors]).cpu()


def load_once(model: type[Model], file: Path) -> Model:
    """The model in a file, which is read again only when the file has changed."""
    state = file.stat() if file.exists() else None
    loaded: Model = _load(model, file, state and (state.st_mtime_ns, state.st_size))
    return loaded


@lru_cache(maxsize=8)
def _load(model: type[LearnedModel], file: Path, changed: tuple[int, int] | None) -> Any:
    return model.load(file)


def count_weights(make: Callable[[], nn.Module]) -> int:
    """The number of weights of the network that ``make`` makes, without allocating them."""
    with torch.device("meta"):
        return sum(weight.numel() for weight in make().parameters())


def check_weights(weights: Tensor, make: Callable[[], nn.Module]) -> None:
    """Raises ValueError unless these are all weights of such a network, (n,), float16, finite."""
    check_tensor("weights", weights, torch.float16, (count_weights(make),), -LARGEST_WEIGHT, LARGEST_WEIGHT)


def build_network(make: Callable[[], Network], weights: Tensor) -> Network:
    """The network that ``make`` makes, with weights (n,), in float32 on the CPU, for evaluation."""
    with torch.device("meta"):
        network = make().float()  # whatever PyTorch's default dtype is
    parameters = dict(network.named_parameters())
    parts = torch.split(weights.float().cpu(), [parameter.numel() for parameter in parameters.values()])
    state = {name: part.view(each.shape) for (name, each), part in zip(parameters.items(), parts, strict=True)}
    state |= {name: torch.zeros(buffer.shape, dtype=buffer.dtype) for name, buffer in network.named_buffers()}
    network.load_state_dict(state, assign=True)  # Module.to_empty imports SymPy, for half a second
    for layer in _find_norm_layers(network):
        layer.reset_running_stats()
    return network.eval()


@torch.no_grad()
def fold_statistics(network: nn.Module) -> None:
    """Folds the running means and variances of batch normalisation into its weights.

    The network's answers stay the same, until it is trained further.
    """
    for layer in _find_norm_layers(network):
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
    moments: dict[nn.BatchNorm2d, list[tuple[Tensor, Tensor]]] = {layer: [] for layer in _find_norm_layers(network)}

    def watch(layer: nn.Module, inputs: tuple[Tensor, ...]) -> None:
        assert isinstance(layer, nn.BatchNorm2d)
        moments[layer].append((inputs[0].mean(dim=(0, 2, 3)), inputs[0].square().mean(dim=(0, 2, 3))))

    watched = [layer.register_forward_pre_hook(watch) for layer in moments]
    network.eval()
    run()
    for hook in watched:
        hook.remove()
    for layer, seen in moments.items():
        mean, square = (torch.stack(batches).mean(dim=0) for batches in zip(*seen, strict=True))
        assert layer.running_mean is not None
        assert layer.running_var is not None
        layer.running_mean.copy_(mean)
        layer.running_var.copy_(square - mean.square())
        layer.bias.add_(mean * layer.weight / math.sqrt(1 + layer.eps))
        layer.weight.mul_(torch.sqrt((layer.running_var + layer.eps) / (1 + layer.eps)))
    network.train()


def _find_norm_layers(network: nn.Module) -> Iterator[nn.BatchNorm2d]:
    return (layer for layer in network.modules() if isinstance(layer, nn.BatchNorm2d))
