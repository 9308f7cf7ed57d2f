"""Pictures and the page of a pose estimate."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import interpolate

from ...hog import HOGSpec
from ...hog.box import Box
from ...io.files import distinct_stems, write_text
from ...io.images import Picture, as_array, write_image
from ...pose.crop import FILL, crop_object
from ...pose.prepared import ELEMENT
from ...pose.similarity import describe
from ...render import Camera, Mesh, render, silhouette
from ...viz import html
from ...viz.pictures import Panel, contact_sheet, glyphs, outlined
from ...viz.similarity_plot import boxed, by_azimuth
from ...viz.svg import Drawing
from .pose_result import SAMPLES, STEP, PoseResult

HEIGHT = 320  # of the pictures of the overlay
WIDEST = 1280  # a photograph there
VIEWS = 8  # below the figure
_CLOSE = 0.6  # of the close-up's side, the longer side of the box

LEAD = (
    "The pose at which a rendering of a CAD model has the HOG most like that of an object in a photograph, after "
    "Section 3.2 of See the Difference (ICCV 2015)."
)


def result_names(path: str) -> list[str]:
    """The names of the files that :func:`write` leaves for the photograph ``path``."""
    (stem,) = distinct_stems([Path(path)])
    endings = ("overlay.png", "elements.png", "similarity.svg", "pose.json")
    return [*(f"{stem}_{ending}" for ending in endings), "index.html"]


def write(folder: Path, result: PoseResult) -> None:
    """Writes the files of :func:`result_names` into ``folder``; all are made before the first is written.

    Raises:
        OSError: a file cannot be written.
    """
    names = [folder / name for name in result_names(result.photo)]
    overlay, turned, drawn = _overlay(result), _around(result), _glyphs(result)
    sheets = [contact_sheet([panels], HEIGHT) for panels in (overlay, drawn)]
    figures = json.dumps(result.figures(), indent=2, allow_nan=False) + "\n"
    html = _page(result, overlay, turned, drawn)
    for path, picture in zip(names, sheets, strict=False):
        write_image(path, picture)
    for path, text in zip(names[2:], (turned.svg(), figures, html), strict=True):
        write_text(path, text)


def _overlay(result: PoseResult) -> list[Panel]:
    """The photograph with the object's box and the model's outline, and closer, without and with the rendering."""
    estimate, mesh = result.estimate, result.mesh
    height, width = result.photograph.shape[1:]
    zoom = min(HEIGHT / height, WIDEST / width)
    size = max(1, round(height * zoom)), max(1, round(width * zoom))
    whole = interpolate(result.photograph[None], size, mode="bilinear", antialias=True)[0]
    drawn, pose, camera = estimate.render_arguments(mesh)
    whole_outlined = _outlined(whole, drawn, _scaled(pose[0], zoom), Camera(camera.focal * zoom, *size))
    known = estimate.camera.focal, estimate.principal_point
    close = crop_object(result.photograph, result.box, HEIGHT, fill := _CLOSE * HEIGHT, *known)
    pose = _scaled(estimate.crop_pose, fill / FILL)
    pasted = render(mesh, pose, close.camera, background=close.image)
    return [
        Panel(
            boxed(whole_outlined, [[side * zoom for side in result.box]]),
            "the photograph",
            f"The photograph with the object's box and the outline of {estimate.model}",
        ),
        Panel(close.image[0], "the object", "The object in gray, closer"),
        Panel(
            _outlined(close.image[0], mesh, pose, close.camera),
            f"outline of {estimate.model}",
            f"The same with the outline of {estimate.model} at the pose found",
        ),
        Panel(
            pasted[0],
            f"azimuth {round(estimate.azimuth)}°, elevation {round(estimate.elevation)}°",
            f"A rendering of {estimate.model} at the pose found, in the object's place",
        ),
    ]


def _outlined(picture: Picture, mesh: Mesh, pose: Tensor, camera: Camera) -> NDArray[np.float64]:
    return outlined(picture, as_array(silhouette(mesh, pose, camera)[0, 0]) >= 0.5)


def _scaled(pose: Tensor, zoom: float) -> Tensor:
    """A pose (6,), as (1, 6), for a picture of another size."""
    scaled = pose.clone()
    scaled[4:] *= zoom
    return scaled[None]


def _around(result: PoseResult) -> Drawing:
    """The paper's figure."""
    estimate, around = result.estimate, result.around
    return by_azimuth(
        around.similarities,
        around.derivatives,
        around.differences,
        what=estimate.similarity_kind,
        how=f"gray: central differences over ±{STEP:g}°; cosine {around.cosine:.2f}",
        azimuth=estimate.azimuth,
        traces=[(trace.azimuths, trace.similarities) for trace in result.traces],
        views=list(render(result.mesh, result.turned(VIEWS), result.matched.crop.camera)),
    )


def _glyphs(result: PoseResult) -> list[Panel]:
    """The visual elements of the photograph, and the same regions of the rendering."""
    crop, spec = result.matched.crop, result.matched.background.spec
    rendering = render(result.mesh, result.estimate.crop_pose[None], crop.camera)
    _, elements = result.matched.elements
    panels = []
    for image, what in ((crop.image, "the object"), (rendering, f"the rendering of {result.estimate.model}")):
        (descriptor,) = describe(image, spec).permute(0, 2, 3, 1)
        drawn = glyphs(descriptor, spec, cell_pixels=24)
        down, across = (drawn.shape[axis] / descriptor.shape[axis] for axis in range(2))
        boxes = [
            Box(col * across, row * down, (col + ELEMENT[1]) * across, (row + ELEMENT[0]) * down)
            for row, col in elements.positions.tolist()
        ]
        seen = f"Strokes along the edges of {what}, cell by cell, with {len(boxes)} boxes around visual elements"
        panels += [Panel(image[0], what), Panel(boxed(drawn, boxes), f"its glyphs, {len(boxes)} elements", seen)]
    return panels


def _named(spec: HOGSpec) -> str:
    return f"{spec.name}, cells of {spec.cell_size[0]}x{spec.cell_size[1]} pixels"


def _page(result: PoseResult, overlay: list[Panel], turned: Drawing, drawn: list[Panel]) -> str:
    spec = result.matched.background.spec
    initial = "unknown" if result.initial is None else "azimuth {:g}°, elevation {:g}°".format(*result.initial)
    phi = spec if result.estimate.similarity_kind != "patches" else result.matched.patches.spec
    settings_shown = {
        "method": result.method,
        "similarity": result.estimate.similarity_kind,
        "initial pose": initial,
        "box": ", ".join(f"{side:g}" for side in result.box),
        "descriptor": _named(phi),
        "visual elements by": _named(spec),
        "models": result.models or "chairs that come with nablahog",
        "candidates": ", ".join(result.candidates),
        **{f"passed over: {name}": reason for name, reason in result.passed_over.items()},
    }
    paths = (
        " In orange, the paths of the search from its starts; their poses differ in more than the azimuth, so they do "
        "not lie on the curve."
    )
    sections = [
        html.Section("Overlay", "The outline of the model at the estimated pose, and its rendering.", overlay),
        html.Section(
            "Similarity by azimuth",
            "Only the azimuth changes. Below: renderings at the azimuths above them. "
            f"The cells have {spec.cell_size[0]} pixels of the {result.matched.crop.image.shape[-1]} that the object "
            f"is scaled to. Pixels have {SAMPLES}x{SAMPLES} samples, and the derivative is that of the area that edges "
            f"cover: its cosine with central differences of the curve over ±{STEP:g}° is {result.around.cosine:.2f}. "
            f"That of OpenDR's derivative with one sample a pixel is {result.around.opendr_cosine:.2f}."
            + (paths if result.traces else ""),
            drawings=[turned],
        ),
        html.Section(
            "Visual elements",
            "In red, the most discriminative patches of the object, and the same regions of the rendering. The "
            "calibrated similarity compares the whole window instead.",
            drawn,
        ),
        html.Section(
            "Settings",
            "What was asked for, and what was compared.",
            table=[{"setting": key, "value": value} for key, value in settings_shown.items()],
        ),
    ]
    row = result.row()
    return html.page(
        f"Pose of {row['photograph']}",
        LEAD if result.warning is None else f"{LEAD} Mind that {result.warning}.",
        [row],
        sections,
        result.definitions(),
        html.footer(f"{result_names(result.photo)[3]} beside this page", f", seed {result.seed}"),
    )
