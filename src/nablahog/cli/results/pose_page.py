"""The page of a pose estimate: overlays, the similarity by azimuth, and the visual elements."""

from __future__ import annotations

from collections.abc import Mapping

from torch import Tensor

from ...hog import HOGSpec
from ...inputs.boxes import Box
from ...io.images import as_array
from ...pose import PoseEstimate
from ...pose.crop import CROP_FILL, CROP_SIDE, crop_object
from ...pose.lens import Lens
from ...pose.model import azimuth_sweep, prepared_model
from ...pose.options import SearchMethod
from ...pose.photograph import ELEMENT, PreparedPhotograph
from ...pose.result import pose_figures
from ...pose.similarity import describe
from ...render import Mesh, render
from ...viz import html
from ...viz.pictures import Panel, glyphs
from ...viz.similarity_plot import draw_boxes, draw_by_azimuth
from .pose_pictures import SEVERAL_MODELS, close_up, outline_photograph
from .pose_table import POSITIONS, define, say_assumed, show_figures, show_position

HEIGHT = 320  # of the pictures of the overlay
VIEWS = 8  # below the figure
AZIMUTHS = 180  # at which similarity is computed
SAMPLES = 4  # of a pixel along a side there: with fewer, even the derivative of covered areas is off
_CLOSE = 0.6  # share of the close-up's side for the longer side of the box
_FIGURES = (
    *("model", "azimuth", "elevation", "theta", "distance", "similarity"),
    *("confidence", "second", "half_turn", "renderings"),
)

LEAD = (
    "The pose at which a rendering of a CAD model has the HOG most like that of an object in a photograph, after "
    "Section 3.2 of See the Difference (ICCV 2015)."
)


def pose_page(
    name: str,
    photograph: Tensor,
    estimate: PoseEstimate,
    meshes: Mapping[str, Mesh],
    method: SearchMethod,
    lens: Lens,
) -> str:
    """The page as HTML.

    Args:
        name: of the photograph.
        photograph: (C, H, W) in 0…1 or uint8, undistorted.
        estimate: for that.
        meshes: the candidates by name.
        method: of the search.
        lens: what is known about the camera that took the photograph.
    """
    known, mesh = (estimate.camera.focal, estimate.principal_point), meshes[estimate.model]
    matched = PreparedPhotograph(crop_object(photograph, estimate.box, CROP_SIDE, CROP_FILL, *known))
    spec, figures = matched.background.spec, pose_figures(lens.report(estimate))
    settings = {
        "method": method,
        "similarity": estimate.similarity_kind,
        "box": ", ".join(f"{side:g}" for side in estimate.box),
        "descriptor": _named(matched.patches.spec if estimate.similarity_kind == "patches" else spec),
        "visual elements by": _named(spec),
        "candidates": ", ".join(meshes),
        "focal_length": f"{figures['focal_length']:.1f} pixels",
        "focal_length_from": figures["focal_length_from"],
    }
    camera = lens.camera
    if camera is not None and not camera.is_ideal:
        lengths = f"focal lengths {camera.fx:g} and {camera.fy:g}, principal point {camera.cx:g}, {camera.cy:g}"
        coefficients = ", ".join(f"{coefficient:g}" for coefficient in camera.distortion)
        settings["undistorted, as the box is, from the camera"] = f"{lengths}, k1, k2, p1, p2, k3 {coefficients}"
    sections = [
        html.Section(
            "Overlay",
            "The box in blue, the outline of the model at the estimated pose in red, and its rendering."
            + (SEVERAL_MODELS if len(meshes) > 1 and method == "best" else "")
            + ("" if estimate.second is None else " The last picture has the second answer, which may be right, too."),
            [*overlay(photograph, estimate, mesh), *_second_answer(photograph, estimate, meshes)],
        ),
        similarity_by_azimuth(matched, estimate, mesh),
        html.Section("Position", POSITIONS, table=[position] if (position := show_position(figures)) else []),
        html.Section(
            "Visual elements",
            "In red, the most discriminative patches of the object, and the same regions of the rendering. The "
            "calibrated similarity compares the whole window instead.",
            _glyphs(matched, estimate, mesh),
        ),
        html.Section(
            "Settings",
            "What was compared.",
            table=[{"setting": key, "value": value} for key, value in settings.items()],
        ),
    ]
    table = html.without_empty_columns([{"image": name, **show_figures(figures, _FIGURES)}])
    doubt, assumed = figures["warning"], say_assumed([figures])
    return html.page(
        f"Pose of {name}",
        " ".join(filter(None, (LEAD, doubt and f"Note: {doubt}.", assumed))),
        table,
        sections,
        define([*table[0], *settings], [figures]),
        html.footer("poses.json beside this page"),
        back=("index.html", "All poses"),
    )


def overlay(photograph: Tensor, estimate: PoseEstimate, mesh: Mesh) -> list[Panel]:
    """The photograph with the object's box and the model's outline, and closer, without and with the rendering."""
    close, pose, close_outlined = close_up(photograph, estimate, mesh, HEIGHT, _CLOSE * HEIGHT)
    pasted = render(mesh, pose, close.camera, background=close.image)
    return [
        Panel(
            outline_photograph(photograph, estimate, mesh, HEIGHT),
            "the photograph",
            f"The photograph with the object's box and the outline of {estimate.model}",
        ),
        Panel(close.image[0], "the object", "The object in gray, closer"),
        Panel(
            close_outlined,
            f"outline of {estimate.model}",
            f"The same with the outline of {estimate.model} at the pose found",
        ),
        Panel(
            pasted[0],
            f"azimuth {round(estimate.azimuth)}°, elevation {round(estimate.elevation)}°",
            f"A rendering of {estimate.model} at the pose found, in the object's place",
        ),
    ]


def _second_answer(photograph: Tensor, estimate: PoseEstimate, meshes: Mapping[str, Mesh]) -> list[Panel]:
    """The object with the outline of the second answer, if there is one."""
    second = estimate.second
    if second is None:
        return []
    *_, drawn = close_up(photograph, second, meshes[second.model], HEIGHT, _CLOSE * HEIGHT)
    where = f"second answer: azimuth {round(second.azimuth)}°, confidence {second.confidence:.2f}"
    return [Panel(drawn, where, f"The object with the outline of {second.model} at the second answer")]


def similarity_by_azimuth(matched: PreparedPhotograph, estimate: PoseEstimate, mesh: Mesh) -> html.Section:
    """The paper's figure: similarities and their derivatives by azimuth, all else as estimated."""
    start = estimate.crop_pose.clone()
    start[0] = 0
    similarity = prepared_model(mesh).similarity(
        matched.template(estimate.similarity_kind), supersampling=SAMPLES, camera=matched.crop.camera
    )
    values, derivatives = similarity.derivatives(azimuth_sweep(start, AZIMUTHS))
    traces = [trace for trace in estimate.traces if trace.model == estimate.model]
    drawing = draw_by_azimuth(
        as_array(values),
        as_array(derivatives[:, 0]),
        kind=estimate.similarity_kind,
        azimuth=estimate.azimuth,
        traces=[(trace.azimuths, trace.similarities) for trace in traces],
        views=list(render(mesh, azimuth_sweep(start, VIEWS), matched.crop.camera)),
    )
    here = float(similarity.values(estimate.crop_pose[None]))
    cells = (
        " The curve is of the larger cells with which the search begins: at the pose found, their similarity is "
        f"{html.figure(here)}. Of the smaller cells with which it ends, it is {html.figure(estimate.similarity)}."
    )
    paths = (
        " In orange, the paths of the search from its starts; their poses differ in more than the azimuth, so they do "
        "not lie on the curve."
    )
    return html.Section(
        "Similarity by azimuth",
        "Only the azimuth changes. Below: renderings at the azimuths above them."
        + ("" if estimate.confidence is None else cells)  # only the best search of the calibrated kind has one
        + (paths if traces else ""),
        drawings=[drawing],
    )


def _glyphs(matched: PreparedPhotograph, estimate: PoseEstimate, mesh: Mesh) -> list[Panel]:
    """The visual elements of the photograph, and the same regions of the rendering."""
    crop, spec = matched.crop, matched.background.spec
    rendering = render(mesh, estimate.crop_pose[None], crop.camera)
    _, elements = matched.elements
    panels = []
    for image, what in ((crop.image, "the object"), (rendering, f"the rendering of {estimate.model}")):
        (descriptor,) = describe(image, spec).permute(0, 2, 3, 1)
        drawn = glyphs(descriptor, spec, cell_pixels=24)
        down, across = (drawn.shape[axis] / descriptor.shape[axis] for axis in range(2))
        boxes = [
            Box(col * across, row * down, (col + ELEMENT[1]) * across, (row + ELEMENT[0]) * down)
            for row, col in elements.positions.tolist()
        ]
        seen = f"Strokes along the edges of {what}, cell by cell, with {len(boxes)} boxes around visual elements"
        panels += [Panel(image[0], what), Panel(draw_boxes(drawn, boxes), f"its glyphs, {len(boxes)} elements", seen)]
    return panels


def _named(spec: HOGSpec) -> str:
    return f"{spec.name}, cells of {spec.cell_size[0]}x{spec.cell_size[1]} pixels"
