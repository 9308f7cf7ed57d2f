"""What an OpenCV ``HOGDescriptor`` holds: sizes, constants and a linear detector, and files of these."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import EllipsisType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...hog import HOGSpec, presets
from ...inputs.numbers import shortened
from ...io.input_file import InputFile
from . import arguments, storage
from .arguments import Size
from .original import people_detector
from .windows import Scheme, make_scheme


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
    _detector: NDArray[np.float32] = field(repr=False)
    spec: HOGSpec = field(repr=False)

    def __init__(
        self,
        _winSize: Sequence[int] | str | bytes | os.PathLike[str] | EllipsisType = ...,
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
        self.__dict__["_detector"] = np.empty(0, np.float32)
        sizes = [_winSize, _blockSize, _blockStride, _cellSize, _nbins]
        rest = _derivAperture, _winSigma, _histogramNormType, _L2HysThreshold, _gammaCorrection, _nlevels
        defaults = Parameters.__init__.__defaults__ or ()
        alone = all(a is b for a, b in zip((*sizes[1:], *rest, _signedGradient), defaults[1:], strict=True))
        if alone and isinstance(_winSize, str | bytes | os.PathLike):
            self.load(_winSize)
            return
        if alone and _winSize is ...:  # HOGDescriptor()
            sizes, _gammaCorrection = [(64, 128), (16, 16), (8, 8), (8, 8), 9], True
        if any(value is None or value is ... for value in sizes):
            raise TypeError(
                "HOGDescriptor takes no argument, the name of a file, or at least the first five, none of them None: "
                f"got {', '.join(map(shortened, sizes))} for _winSize, _blockSize, _blockStride, _cellSize and _nbins"
            )
        window, block, stride, cell = map(arguments.pair, _PAIRS, sizes)
        bins, sigma = arguments.integer("nbins", sizes[4]), arguments.number("winSigma", _winSigma, -1)
        clip, levels = (
            arguments.number("L2HysThreshold", _L2HysThreshold, 0.2),
            arguments.integer("nlevels", _nlevels, 64),
        )
        gamma = arguments.flag("gammaCorrection", _gammaCorrection)
        signed = arguments.flag("signedGradient", _signedGradient)
        if not 3 <= bins <= 128:  # OpenCV's bins are signed integers of 8 bits
            raise ValueError(f"nbins must be 3 to 128, got {bins}")
        if not clip > 0:
            raise ValueError(f"L2HysThreshold must be above 0, got {clip}")
        if levels < 1:
            raise ValueError(f"nlevels must be at least 1, got {levels}")
        self.__dict__.update(  # frozen, as OpenCV's attributes are
            winSize=window,
            blockSize=block,
            blockStride=stride,
            cellSize=cell,
            nbins=bins,
            derivAperture=arguments.integer("derivAperture", _derivAperture, 1),
            winSigma=sigma,
            histogramNormType=arguments.integer("histogramNormType", _histogramNormType),
            L2HysThreshold=clip,
            gammaCorrection=gamma,
            nlevels=levels,
            signedGradient=signed,
            spec=presets.opencv(
                window,
                block,
                stride,
                cell,
                bins,
                win_sigma=min(max(sigma, 1e-12), 1e12) if sigma > 0 else -1,  # beyond these, weights do not change
                l2hys_threshold=min(max(clip, 1e-12), 1e12),
                gamma=gamma,
                signed=signed,
            ),
        )

    @cached_property
    def _scheme(self) -> Scheme:
        return make_scheme(self.winSize, self.spec)

    @property
    def svmDetector(self) -> NDArray[np.float32] | tuple[()]:
        """A copy of the coefficients; an empty tuple for none, as in OpenCV."""
        return self._detector.copy() if len(self._detector) else ()

    def getDescriptorSize(self) -> int:
        """Length of the descriptor of one window."""
        return self._scheme.size

    def getWinSigma(self) -> float:
        """Standard deviation in pixels of the Gaussian over a block."""
        return self.winSigma if self.winSigma > 0 else sum(self.blockSize) / 8

    def setSVMDetector(self, svmdetector: Any) -> None:
        """Sets the coefficients of the linear detector.

        Args:
            svmdetector: an array of numbers, (n,), (n, 1) or (1, n), ``cv2.UMat`` or tuple, with or without a bias
                behind; None for no detector.

        Raises:
            TypeError: it is no such array of numbers.
            ValueError: it has another length than a descriptor, or one more.
        """
        values = arguments.array("svmdetector", () if svmdetector is None else svmdetector)
        size, shape = self.getDescriptorSize(), values.shape
        if len(shape) != 3 or shape[2] != 1 or min(shape[:2]) > 1 or values.size not in (0, size, size + 1):
            raise ValueError(
                f"svmdetector must be the {size} coefficients of a descriptor in a row or column, perhaps with a bias, "
                f"got an array of the shape {np.shape(svmdetector)}"
            )
        with np.errstate(over="ignore"):  # to infinity, as in OpenCV
            self.__dict__["_detector"] = np.array(values, np.float32).reshape(-1)  # a copy: the argument may change

    def checkDetectorSize(self) -> bool:
        """Whether the detector is of the descriptor's length, or one more, or there is none."""
        return len(self._detector) in (0, self.getDescriptorSize(), self.getDescriptorSize() + 1)

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

    def save(self, filename: str | bytes | os.PathLike[str], objname: str = "") -> None:
        """Writes parameters and detector to a file that OpenCV reads, too.

        It is ``.yml``, ``.xml`` or ``.json``, or one of these and ``.gz``; written whole or not at all.

        Args:
            filename: to write; of other endings, YAML.
            objname: of the object in the file; the file's own name without its ending if empty.

        Raises:
            OSError: it cannot be written.
            ValueError: a name is none that OpenCV writes.
        """
        node: dict[str, object] = {name: getattr(self, name) for name in _STORED}
        node |= {name: int(node[name]) for name in ("gammaCorrection", "signedGradient")}  # type: ignore[call-overload]
        node["winSigma"] = self.getWinSigma()
        if len(self._detector):
            node["SVMDetector"] = self._detector
        storage.write(arguments.text("filename", filename), arguments.text("objname", objname, ""), node)

    def load(self, filename: str | bytes | os.PathLike[str] | InputFile, objname: str = "") -> bool:
        """Reads parameters and detector from a file of :meth:`save`, here or of OpenCV.

        Without a detector in the file, the object keeps the one before, as in OpenCV.

        Args:
            filename: to read, of any of the formats.
            objname: of the object in the file; the first one if empty.

        Returns:
            True.

        Raises:
            FileNotFoundError: there is no such file.
            ValueError: it is no such file, what it holds is out of range, or the detector that the object keeps is of
                another length than its descriptors; the object is as before then.
        """
        file = filename if isinstance(filename, InputFile) else InputFile(arguments.text("filename", filename))
        node = storage.read(file, arguments.text("objname", objname, ""))
        try:
            loaded = type(self)(**{f"_{key}": _parameter(node, key) for key in _STORED if key in node})
            loaded.setSVMDetector(storage.floats(node, "SVMDetector") if "SVMDetector" in node else self._detector)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{file}: {error}") from None
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
