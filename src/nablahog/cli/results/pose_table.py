"""The figures of a pose as a table shows them, and what they mean."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ...viz import html

LEAST_SHOWN = 0.001  # probability of a half turn: confidences are not measured finely enough for less
_HEADINGS = {  # of columns, where they say the unit
    **{angle: f"{angle},\n°" for angle in ("azimuth", "elevation", "theta")},
    "distance": "distance,\ndiagonals",
}
# columns of poses.csv for figures of several numbers
MATRIX = [f"m{row}{col}" for row in range(3) for col in range(4)]
POSITION = [f"position_{axis}{suffix}" for suffix in ("", "_std") for axis in "xyz"]
PRINCIPAL_POINT = ["principal_point_x", "principal_point_y"]
SECOND = ["second_model", "second_azimuth", "second_elevation", "second_theta", "second_confidence"]
POSITIONS = (
    "The middle of each model's bounding box along the camera's axes: x right, y down, z forward; of objects whose "
    "camera is known. If the model's file is in millimetres, so are these."
)

DEFINITIONS = {
    "id, image_id, category_id": "Of an object, of the photograph that it is in, of the model that fits best.",
    "image, file_name, width, height": "A photograph's file, and its size in pixels.",
    "name": "Of a model.",
    "x0, y0, x1, y1": "The left, upper, right and lower side of the object's box, in pixels of the photograph: the box "
    "that was given, or the one where the object was found.",
    "bbox, area, iscrowd": "The same box as x0, y0, width, height, with its area, as readers of COCO's files expect "
    "it; iscrowd is always 0.",
    "error": "Why an object has no pose.",
    "model": "The model that fits best, of all candidates. Without --mesh they are those of nablahog.sample_chairs().",
    "azimuth": "Of the camera around the object's vertical axis, in degrees: 0 sees the front, 90 the object's left "
    "side. After “or”: further azimuths from which the model looks the same; any: it does from all around.",
    "any_azimuth": "Whether the model looks the same from all around, so that its azimuth says nothing.",
    "equivalent_azimuths": "Further azimuths, in degrees, from which the model looks the same; in poses.csv "
    "with blanks between them.",
    "elevation": "Of the camera above the object's horizon, in degrees.",
    "theta": "Counter-clockwise rotation of the picture, in degrees.",
    "distance": "From the camera to the middle of the object, in diagonals of its bounding box. It is the true one "
    "only if the focal length is known, which is hard to tell from one photograph.",
    "distance_in_file_units": "The same in the units of the model's file.",
    "x, y": "Pixels to the right and down from the middle of the photograph to the middle of the object.",
    "standard_deviations": "What follows ±: of 100 poses that are right (the confidence says how likely that is), 68 "
    "have the true value within one of them. Of a single model only. The distance has none where the focal length is "
    "assumed.",
    "covariance": "6x6, of azimuth, elevation, distance, theta, x and y in their units, in this order; null where it "
    "is infinite.",
    "azimuth_std, elevation_std, theta_std, distance_std, distance_in_file_units_std, x_std, y_std": "The same as "
    "columns of poses.csv.",
    "position, position_std": "Of the middle of the model's bounding box along the camera's axes (x right, y down, z "
    "forward), in the units of the model's file, and its standard deviations. If the focal length is assumed, the "
    "camera looks straight at the object: x and y are 0, z is the assumed distance.",
    ", ".join(POSITION): "The same as columns.",
    "focal_length": "Of the camera of the pose, in pixels of the photograph.",
    "focal_length_from": "given: by an option; exif: by the photograph's file; assumed: an object that fills its "
    "box is taken to be 3 of its diagonals away, so distances are not the true ones.",
    "principal_point": "x, y where the camera's optical axis meets the photograph, in pixels, as in intrinsics. If the "
    "focal length is assumed, that of a camera that looks straight at the object.",
    ", ".join(PRINCIPAL_POINT): "The same as columns.",
    "photograph_camera": "The camera that took the photograph, with its distortion, as the options say it; null if it "
    "distorts nothing and its pixels are square. Otherwise poses are for the ideal camera in its place: x, y, "
    "focal_length, principal_point and intrinsics belong to the undistorted photograph, image_size pixels high and "
    "wide; box and bbox to the photograph as it is; matrix to both.",
    "matrix, intrinsics": "A point X of the model's file, (x, y, z, 1), is seen at intrinsics (3x3) times the upper "
    "three rows of matrix (4x4) times X, divided by the last coordinate: OpenCV's convention. In intrinsics are "
    "focal_length, twice, and principal_point.",
    "camera_matrix, dist_coeffs, image_size": "Of photograph_camera: 3x3, OpenCV's k1, k2, p1, p2, k3, and height and "
    "width in pixels.",
    f"{', '.join(MATRIX)}": "The upper three rows of matrix, row by row, as columns of poses.csv.",
    "matrix_world": "From the camera's frame (OpenGL's: y up, it looks along -z) to a world with z up, in which the "
    "model is as Blender imports its file: Blender's matrix_world of the camera.",
    "similarity_kind": "Which similarity it is: calibrated or patches.",
    "similarity": "calibrated: the score of the rendering's linear discriminant on the window of the photograph, in "
    "standard deviations over arbitrary photographs, by the cells with which the search ends; patches: the sum over "
    "the photograph's visual elements of the dot products of the ∇HOG descriptors of their patches with those of the "
    "rendering, as in the paper.",
    "confidence": "The probability that the rotation is within 15° of the true one, or of one from which the model "
    "looks the same, as measured on rendered scenes and photographs. Rarely, it is high although the photograph does "
    "not show the object; then no pose is right.",
    "warning": "A sentence if the pose is more likely wrong than right, or if the camera's numbers seem to be for "
    "another photograph; else null.",
    "refused": "Whether the confidence is below the one asked for with --least-confidence.",
    "half_turn": "The probability that the object is seen from the opposite side: front and back may look alike.",
    "second": "The second answer: azimuth and elevation of the runner-up that is most probably right, with its "
    "confidence, if this is above 0.15.",
    ", ".join(SECOND): "The same as columns.",
    "runners_up": "The best poses from other sides; confidence: the probability that it is the right one.",
    "share": "Of a runner-up: its part of the best pose's similarity, or of the votes for its side.",
    "renderings": "The number of renderings that the search compared, of all candidates.",
    "seconds": "Wall time of the search; the first in a process takes longer, because code is loaded.",
}
"""What the figures mean."""


def show_position(figures: Mapping[str, Any]) -> dict[str, object]:
    """The position of an object in the units of the model's file, as a row of a table; empty without a known camera."""
    if figures.get("focal_length_from", "assumed") == "assumed":
        return {}
    deviations = figures["position_std"] or (None,) * 3
    return {
        f"{axis}, units of\nthe model's file": _with_deviation(value, deviation)
        for axis, value, deviation in zip("xyz", figures["position"], deviations, strict=True)
    }


def say_assumed(poses: Sequence[Mapping[str, Any]]) -> str:
    """A sentence if distances rest on an assumed focal length; else empty."""
    count = sum(figures.get("focal_length_from") == "assumed" for figures in poses)
    which = f" for {count} of {len(poses)} objects" if count < len(poses) else ""
    return f"Focal length assumed{which}, so the distance is not the true one." if count else ""


def define(names: Sequence[str], figures: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """The definitions of the columns of a table of poses, and of standard deviations if there are any."""
    deviations = ["standard_deviations"] if any(pose.get("standard_deviations") for pose in figures) else []
    defined = {*(name.split(",\n")[0] for name in names), *deviations}
    return {name: text for name, text in DEFINITIONS.items() if defined & {name, *name.split(", ")}}


def show_figures(figures: Mapping[str, Any], names: Sequence[str]) -> dict[str, object]:
    """Some figures of a pose for a table, with ± and the standard deviation where there is one."""
    shown = {name: _with_deviation(figures.get(name), get_deviation(figures, name)) for name in names}
    if figures.get("any_azimuth"):
        shown["azimuth"] = html.Shown(figures["azimuth"], "any")
    elif equivalent := figures.get("equivalent_azimuths"):
        text = " or ".join(map(html.figure, (shown["azimuth"], *equivalent)))
        shown["azimuth"] = html.Shown(figures["azimuth"], text)
    if "second" in shown:
        shown["second"] = _say_second(figures.get("second"))
    half_turn = figures.get("half_turn")
    if "half_turn" in shown and half_turn is not None and half_turn < LEAST_SHOWN:
        shown["half_turn"] = html.Shown(half_turn, f"< {LEAST_SHOWN:g}")
    return {_HEADINGS.get(name, name): value for name, value in shown.items()}


def _say_second(rival: Mapping[str, Any] | None) -> str | None:
    """The viewpoint of the second answer, with its confidence."""
    if rival is None:
        return None
    return f"{rival['azimuth']:.0f}°, {rival['elevation']:.0f}° ({rival['confidence']:.2f})"


def get_deviation(figures: Mapping[str, Any], name: str) -> float | None:
    """The standard deviation of one of the parameters; None if it is unknown."""
    return (figures.get("standard_deviations") or {}).get(name)


def _with_deviation(value: Any, deviation: float | None) -> object:
    """A figure to the decimals that its standard deviation has with two digits, at most four."""
    if deviation is None:
        return value
    decimals = min(max(1 - math.floor(math.log10(deviation)), 0), 4) if deviation > 0 else 4
    return html.Shown(value, f"{value:.{decimals}f} ± {deviation:.{decimals}f}")
