"""What an OpenCV ``HOGDescriptor`` holds: sizes, constants and a linear detector, and files of these."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...hog import HOGSpec, presets
from . import arguments, storage
from .arguments import Size, from_umat
from .storage import people_detector
from .windows import Scheme, scheme


@dataclass(frozen=True, init=False, eq=False)
class Parameters:
    """All of :class:`.HOGDescriptor` that needs no image; attributes can only be read, as in OpenCV."""

    winSize: Size
    blockSize: Size
    blockStride: Size
    cellSize: Size
    nbins: int
    derivAperture: int
    winSigma: float
    histogramNormType: int
    L2HysThreshold: float
    gammaCorrection: bool
    nlevels: int
    signedGradient: bool
    svmDetector: NDArray[np.float32] | tuple[()] = field(repr=False)
    spec: HOGSpec = field(repr=False)

    def __init__(
        self,
        _winSize: Sequence[int] | str | os.PathLike[str] | None = None,
        _blockSize: Sequence[int] | None = None,
        _blockStride: Sequence[int] | None = None,
        _cellSize: Sequence[int] | None = None,
        _nbins: int | None = None,
        _derivAperture: int = 1,
        _winSigma: float = -1,
        _histogramNormType: int = 0,
        _L2HysThreshold: float = 0.2,
        _gammaCorrection: bool | None = None,
        _nlevels: int = 64,
        _signedGradient: bool = False,
    ) -> None:
        self.__dict__["svmDetector"] = ()
        if isinstance(_winSize, str | os.PathLike):
            self.load(_winSize)
            return
        if all(value is None for value in (_winSize, _blockSize, _blockStride, _cellSize, _nbins)):  # HOGDescriptor()
            _winSize, _blockSize, _blockStride, _cellSize, _nbins = (64, 128), (16, 16), (8, 8), (8, 8), 9
            _gammaCorrection = True
        window, block = arguments.pair("winSize", _winSize), arguments.pair("blockSize", _blockSize)
        stride, cell = arguments.pair("blockStride", _blockStride), arguments.pair("cellSize", _cellSize)
        if _nbins is None:
            raise TypeError("HOGDescriptor takes no argument, or at least the first five: there is no _nbins")
        bins, sigma = arguments.integer("nbins", _nbins, 9), arguments.number("winSigma", _winSigma, -1.0)
        clip = arguments.number("L2HysThreshold", _L2HysThreshold, 0.2)
        gamma = arguments.truth("gammaCorrection", _gammaCorrection)
        signed = arguments.truth("signedGradient", _signedGradient)
        self.__dict__.update(  # frozen, as OpenCV's attributes are
            winSize=window,
            blockSize=block,
            blockStride=stride,
            cellSize=cell,
            nbins=bins,
            derivAperture=arguments.integer("derivAperture", _derivAperture, 1),
            winSigma=sigma,
            histogramNormType=arguments.integer("histogramNormType", _histogramNormType, 0),
            L2HysThreshold=clip,
            gammaCorrection=gamma,
            nlevels=arguments.integer("nlevels", _nlevels, 64),
            signedGradient=signed,
            spec=presets.opencv(
                window,
                block,
                stride,
                cell,
                bins,
                win_sigma=sigma if sigma > 0 else -1,
                l2hys_threshold=clip,
                gamma=gamma,
                signed=signed,
            ),
        )

    @cached_property
    def _scheme(self) -> Scheme:
        return scheme(self.winSize, self.spec)

    def getDescriptorSize(self) -> int:
        """Length of the descriptor of one window."""
        return self._scheme.size

    def getWinSigma(self) -> float:
        """Standard deviation in pixels of the Gaussian over a block."""
        return self.winSigma if self.winSigma > 0 else sum(self.blockSize) / 8

    def setSVMDetector(self, svmdetector: Any) -> None:
        """Sets the coefficients of the linear detector.

        Args:
            svmdetector: an array of numbers in one line, with or without a bias behind; None for no detector.

        Raises:
            TypeError: it is no array of numbers.
            ValueError: it has another length than a descriptor, or one more.
        """
        coefficients = np.asarray(() if svmdetector is None else from_umat(svmdetector))
        if coefficients.dtype.kind not in "fiu":
            raise TypeError(f"svmdetector must be an array of numbers, got {coefficients.dtype}")
        size = self.getDescriptorSize()
        if coefficients.size not in (0, size, size + 1) or coefficients.size not in (0, *coefficients.shape):
            raise ValueError(
                f"svmdetector must be the {size} coefficients of a descriptor in one line, and one more for a bias, "
                f"got an array of the shape {coefficients.shape}"
            )
        with np.errstate(over="ignore"):  # to infinity, as OpenCV's
            copy = np.array(coefficients, np.float32).reshape(-1)  # so that what it was made of may change
        self.__dict__["svmDetector"] = copy if copy.size else ()

    def checkDetectorSize(self) -> bool:
        """Whether the detector is of the descriptor's length, or one more, or there is none."""
        return len(self.svmDetector) in (0, self.getDescriptorSize(), self.getDescriptorSize() + 1)

    @staticmethod
    def getDefaultPeopleDetector() -> NDArray[np.float32]:
        """Coefficients (3781,) of OpenCV's detector of people in windows of 64x128.

        They are OpenCV's own, and no part of this package.  They come from the folder that the environment variable
        ``NABLAHOG_PEOPLE_DETECTORS`` names, if it has a file ``default.yml`` that a descriptor with this detector has
        saved; otherwise from an installed OpenCV that has them, 4.x or 5 with the contributed modules.

        Raises:
            RuntimeError: there is neither.
            ValueError: the file holds another detector.

        >>> nablahog.compat.opencv.HOGDescriptor_getDefaultPeopleDetector().shape  # doctest: +SKIP
        (3781,)
        """
        return people_detector("Default", 3781)

    @staticmethod
    def getDaimlerPeopleDetector() -> NDArray[np.float32]:
        """Coefficients (1981,) of OpenCV's other detector of people, in windows of 48x96; see the one above.

        The file's name is ``daimler.yml``.

        Raises:
            RuntimeError: there is neither.
            ValueError: the file holds another detector.

        >>> nablahog.compat.opencv.HOGDescriptor_getDaimlerPeopleDetector().shape  # doctest: +SKIP
        (1981,)
        """
        return people_detector("Daimler", 1981)

    def save(self, filename: str | os.PathLike[str], objname: str = "") -> None:
        """Writes parameters and detector to a file that OpenCV reads, too.

        It is ``.yml``, ``.xml`` or ``.json``, or one of these and ``.gz``; written whole or not at all.

        Args:
            filename: to write; of other endings, YAML.
            objname: of the object in the file; the file's own name without its ending if empty.

        Raises:
            OSError: it cannot be written.
        """
        node: dict[str, object] = {name: getattr(self, name) for name in _STORED}
        node |= {name: int(node[name]) for name in ("gammaCorrection", "signedGradient")}  # type: ignore[call-overload]
        node["winSigma"] = self.getWinSigma()
        if len(self.svmDetector):
            node["SVMDetector"] = self.svmDetector
        storage.write(filename, objname, node)

    def load(self, filename: str | os.PathLike[str], objname: str = "") -> bool:
        """Reads parameters and detector from a file of :meth:`save`, here or of OpenCV.

        Without a detector in the file, the object has none then; OpenCV keeps the one before.

        Args:
            filename: to read, of any of the formats.
            objname: of the object in the file; the first one if empty.

        Returns:
            True.

        Raises:
            FileNotFoundError: there is no such file.
            ValueError: it is no such file, or what it holds is out of range; the object is as before then.
        """
        node = storage.read(filename, objname)
        try:
            loaded = type(self)(**{f"_{name}": _parameter(node, name) for name in _STORED if name in node})
            loaded.setSVMDetector(storage.floats(node, "SVMDetector") if "SVMDetector" in node else None)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{filename}: {error}") from None
        self.__dict__.clear()
        self.__dict__.update(loaded.__dict__)
        return True


_PAIRS = ("winSize", "blockSize", "blockStride", "cellSize")
_STORED = (
    *_PAIRS,
    *("nbins", "derivAperture", "winSigma", "histogramNormType", "L2HysThreshold", "gammaCorrection", "nlevels"),
    "signedGradient",
)


def _parameter(node: storage.Node, name: str) -> Any:
    read = storage.floats if name in ("winSigma", "L2HysThreshold") else storage.integers
    values, count = read(node, name), 2 if name in _PAIRS else 1
    if len(values) != count:
        raise ValueError(f"{name} must have length {count}, got {len(values)}")
    return values if name in _PAIRS else values[0]
