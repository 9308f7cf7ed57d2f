"""Models that are learned from photographs, and their files: one .npz archive each."""

from __future__ import annotations

import json
import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np
import torch
from numpy.typing import DTypeLike, NDArray
from torch import Tensor

from ..hog.spec import HOGSpec
from .npz import account_of, account_to_text, check_format, naming, read_arrays, text, write_arrays

Arrays = dict[str, NDArray[Any]]
Model = TypeVar("Model", bound="LearnedModel")


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
        KIND: what a file of it is, for messages.
        NOUN: one word for the model, for messages.
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
    def load(cls: type[Model], path: str | os.PathLike[str]) -> Model:
        """Reads what :meth:`save` wrote.  Never unpickles, so nothing in the file is ever run.

        Raises:
            FileNotFoundError: there is no such file.
            ValueError: it is no such archive, is damaged, lacks an array, holds pickled objects, NaN or Inf, or its
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


def tensor(dtype: DTypeLike) -> Codec:
    """Stores a tensor of one dtype."""

    def decode(arrays: Arrays, name: str) -> Tensor:
        array = arrays[name]
        if array.dtype != dtype:
            raise ValueError(f"the {name} must be {np.dtype(dtype)}, got {array.dtype}")
        return torch.from_numpy(array)

    return Codec(lambda value: value.cpu().numpy(), decode)


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
    """Stores a dataclass of texts, numbers and tuples of these."""
    return Codec(account_to_text, lambda arrays, name: account_of(kind, text(arrays, name)))


def _scalar(what: str, kinds: str) -> Codec:
    def decode(arrays: Arrays, name: str) -> Any:
        array = arrays[name]
        if array.shape != () or array.dtype.kind not in kinds:
            raise ValueError(f"{name} must be one {what}, got {array.dtype} of shape {array.shape}")
        return array.item()

    return Codec(lambda value: value, decode)


INTEGER = _scalar("integer", "iu")
NUMBER = _scalar("float64", "f")
TEXTS = Codec(json.dumps, lambda arrays, name: tuple(map(str, json.loads(text(arrays, name)))))
SPEC = Codec(HOGSpec.to_json, lambda arrays, name: HOGSpec.from_json(text(arrays, name)))


def check_tensor(
    name: str, value: Tensor, dtype: torch.dtype, shape: tuple[int, ...], least: float, most: float
) -> None:
    """Raises ValueError unless a tensor has this dtype and shape and lies in ``least`` … ``most``."""
    if value.dtype != dtype or value.shape != shape or not value.numel():
        expected, got = (str(each).removeprefix("torch.") for each in (dtype, value.dtype))
        raise ValueError(f"the {name} must be {expected} of shape {shape}, got {got} of {tuple(value.shape)}")
    if not ((value >= least) & (value <= most)).all():  # NaN fails too
        bounds = f"within ±{most:.5g}, got NaN, Inf or more"
        if least != -most:
            bounds = f"in {least:.5g}…{most:.5g}, got NaN, Inf or other values"
        raise ValueError(f"the {name} must lie {bounds}")
