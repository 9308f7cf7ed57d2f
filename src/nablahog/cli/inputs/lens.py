"""What is known of the camera of a photograph: the options of a command, and its file."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import dataclass
from typing import NamedTuple

from ...io.exif import read_exif_focal
from ...pose.options import FocalSource
from ...render import Camera


class Lens(NamedTuple):
    """Focal length and principal point x, y, pixels, None where unknown, and where the focal length is from."""

    focal: float | None
    principal_point: tuple[float, float] | None
    source: FocalSource


@dataclass(frozen=True)
class LensOptions:
    """What a command says of the camera.

    Attributes:
        focal: pixels, "exif" or "unknown"; None: as the photograph's file says, if it does.
        field_of_view: degrees from the upper to the lower border, instead of ``focal``.
        principal_point: x, y, pixels.
    """

    focal: float | str | None = None
    field_of_view: float | None = None
    principal_point: tuple[float, float] | None = None

    @classmethod
    def of(cls, arguments: Namespace) -> LensOptions:
        return cls(arguments.focal, arguments.field_of_view, arguments.principal_point)

    def lens(self, path: str, height: int, width: int) -> Lens:
        """That of the photograph in the file ``path``.

        Raises:
            ValueError: its EXIF data was asked for and has no focal length, or a principal point was given without any.
        """
        given = self.focal
        if self.field_of_view is not None:
            given = Camera.from_field_of_view(self.field_of_view, height, width).focal
        if isinstance(given, float):
            return Lens(given, self.principal_point, "given")
        focal = None if given == "unknown" else read_exif_focal(path)
        if focal is not None:
            return Lens(focal, self.principal_point, "exif")
        if given == "exif":
            raise ValueError(f"{path}: its EXIF data has no focal length, or the photograph was cut: expected --focal")
        if self.principal_point is not None:
            raise ValueError(f"{path}: --principal-point needs a known focal length: expected --focal")
        return Lens(None, None, "assumed")
