"""What is known of the camera of a photograph: by the options of a command, and by its file."""

from __future__ import annotations

from ...io.exif import read_exif_focal
from ...pose.options import Lens


def read_lens(path: str, focal: float | str | None, principal_point: tuple[float, float] | None) -> Lens:
    """The lens of the photograph in a file.

    Args:
        path: of the photograph.
        focal: pixels, "exif" or "unknown"; None: as the file says, if it does.
        principal_point: x, y, pixels; None for the middle.

    Raises:
        ValueError: the file's EXIF data was asked for and has no focal length, or a principal point was given without.
    """
    if isinstance(focal, float):
        return Lens(focal, principal_point, "given")
    pixels = None if focal == "unknown" else read_exif_focal(path)
    if pixels is not None:
        return Lens(pixels, principal_point, "exif")
    if focal == "exif":
        raise ValueError(f"{path}: its EXIF data has no focal length, or the photograph was cut: expected --focal")
    if principal_point is not None:
        raise ValueError(f"{path}: --principal-point needs a known focal length: expected --focal")
    return Lens(None, None, "assumed")
