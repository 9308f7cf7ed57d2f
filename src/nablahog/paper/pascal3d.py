"""PASCAL3D+: viewpoints of the objects of PASCAL VOC, and the objects that Table 2 is computed on.

``DIR`` is the folder ``PASCAL3D+_release1.1`` with ``Annotations/chair_pascal/*.mat`` and ``CAD/chair/*.off``.

Source: Xiang, Mottaghi and Savarese, Beyond PASCAL (WACV 2014), and the code published with it.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor
from torch.nn import functional

from ..inputs.boxes import Box
from ..io.images import read_image
from ..io.matfile import read_mat
from ..runtime.errors import explain
from ..runtime.text import counted, one_line
from .annotations import Example
from .voc import check_voc, half_open, read_annotation, read_image_ids

SHORTEST = 100  # pixels of the shortest side of an object's picture (the paper, Section 3.2, Setup)
SAME_BOX = 0.5  # intersection over union from which the boxes of VOC and of a record are those of one object


@dataclass(frozen=True)
class Record:
    """The annotation of an object in PASCAL3D+, with a box in pixels.

    The viewpoint is the azimuth of the camera in 0…360, 0 in front of the object and 90 at its left; its elevation
    above the object's horizontal plane; and theta in the image plane, counter-clockwise; degrees.  It is coarse if only
    a guess is annotated.  ``cad`` is the number, from 1, of the CAD model most like the object.
    """

    category: str
    box: Box
    viewpoint: tuple[float, float, float] | None
    coarse: bool
    cad: int | None


@dataclass
class Selection:
    """The objects of a split whose pose is to be estimated.

    Attributes:
        objects: in the order of the split, named by image and number in it, from 1, as "2008_000003#1".  Images are
            photographs cut along the box; models are stems of the files of CAD models, as "03".
        coarse: the names of those with coarse viewpoints only.
        left_out: number of other objects by the first reason that applies.
        failed: why the files of an image could not be read, by its name.
    """

    objects: list[Example] = field(default_factory=list)
    coarse: set[str] = field(default_factory=set)
    left_out: Counter[str] = field(default_factory=Counter)
    failed: dict[str, str] = field(default_factory=dict)

    def summary(self) -> str:
        """A sentence: how many objects there are, and how many are left out for which reason."""
        photographs = len({example.name.partition("#")[0] for example in self.objects})
        why = ", ".join(f"{count} {reason}" for reason, count in self.left_out.items())
        coarse = len(self.coarse & {example.name for example in self.objects})
        roughly = f", {coarse} of them with coarse viewpoints only" if coarse else ""
        objects = f"{counted(len(self.objects), 'object')} of {counted(photographs, 'photograph')}"
        return f"{objects}{roughly}; left out: {why or 'none'}."


def read_record(path: Path) -> list[Record]:
    """The objects of a record of PASCAL3D+ (MATLAB), in its order.

    If the distance is 0 or missing, the coarse viewpoint is used, as in the published code.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no such record or is damaged.
    """
    variables = read_mat(path)
    try:
        (record,) = _structures(variables, "record")
        return [_record(fields) for fields in _structures(record, "objects")]
    except ValueError as error:
        raise ValueError(f"{path}: expected a record of PASCAL3D+, but {one_line(error)}") from None


def _structures(fields: dict[str, Any], name: str) -> list[dict[str, Any]]:
    value = fields.get(name)
    if not isinstance(value, list) or not all(isinstance(fields, dict) for fields in value):
        raise ValueError(f"{name} is no structure")
    return value


def _record(fields: dict[str, Any]) -> Record:
    category, box, viewpoint = fields.get("class"), fields.get("bbox"), fields.get("viewpoint")
    cad = _number(fields, "cad_index")
    if not isinstance(category, str) or not isinstance(box, np.ndarray) or box.size != 4 or not np.isfinite(box).all():
        raise ValueError("an object has no class or no bbox")
    angles: tuple[float, float, float] | None = None
    coarse = False
    if isinstance(viewpoint, list) and len(viewpoint) == 1 and isinstance(viewpoint[0], dict):
        angles, coarse = _viewpoint(viewpoint[0])
    whole = int(cad) if cad is not None and cad >= 1 else None
    return Record(category, half_open(*map(float, box.flat)), angles, coarse, whole)


def _viewpoint(fields: dict[str, Any]) -> tuple[tuple[float, float, float] | None, bool]:
    """Azimuth, elevation and theta, and whether they are coarse."""
    fine = _number(fields, "azimuth"), _number(fields, "elevation")
    rough = _number(fields, "azimuth_coarse"), _number(fields, "elevation_coarse")
    coarse = not _number(fields, "distance") or None in fine
    azimuth, elevation = rough if coarse else fine
    if azimuth is None or elevation is None:
        return None, False
    return (azimuth % 360, elevation, _number(fields, "theta") or 0.0), coarse


def _number(fields: dict[str, Any], name: str) -> float | None:
    value = fields.get(name)
    if not isinstance(value, np.ndarray) or value.size != 1:
        return None
    number = float(value.flat[0])
    return number if math.isfinite(number) else None


def read_pascal3d(voc: Path, pascal3d: Path, category: str = "chair", split: str = "val") -> Selection:
    """The paper's selection: objects that are not difficult, occluded or truncated by VOC and have a viewpoint.

    Each is cut out along its box and, if its shortest side has less than :data:`SHORTEST` pixels, enlarged to that
    (bicubic).  Objects of VOC and of PASCAL3D+ are matched by their boxes.

    Args:
        voc: the folder ``VOC2012``.
        pascal3d: the folder ``PASCAL3D+_release1.1``.
        category, split: in the names of PASCAL VOC.

    Raises:
        FileNotFoundError: a folder or the list of the split is missing.
        ValueError: the list of the split is damaged, or no object is selected.

    >>> from pathlib import Path
    >>> from PIL import Image
    >>> from scipy.io import savemat
    >>> voc, pascal3d = Path("VOC2012"), Path("PASCAL3D+_release1.1")
    >>> records = pascal3d / "Annotations" / "chair_pascal"
    >>> for folder in (voc / "Annotations", voc / "ImageSets" / "Main", voc / "JPEGImages", records):
    ...     folder.mkdir(parents=True)
    >>> _ = (voc / "ImageSets" / "Main" / "chair_val.txt").write_text("a 1\\n")  # one photograph, with one chair
    >>> Image.new("L", (160, 120)).save(voc / "JPEGImages" / "a.jpg")
    >>> box = "<xmin>11</xmin><ymin>1</ymin><xmax>120</xmax><ymax>110</ymax>"
    >>> text = f"<annotation><object><name>chair</name><bndbox>{box}</bndbox></object></annotation>"
    >>> _ = (voc / "Annotations" / "a.xml").write_text(text)
    >>> viewpoint = {"azimuth": 317.5, "elevation": 20.0, "distance": 7.5, "theta": -3.5}
    >>> chair = {"class": "chair", "bbox": [11, 1, 120, 110], "viewpoint": viewpoint, "cad_index": 3}
    >>> savemat(records / "a.mat", {"record": {"objects": chair}})
    >>> selection = nablahog.paper.pascal3d.read_pascal3d(voc, pascal3d)
    >>> [(each.name, each.image.shape, each.azimuth, each.model) for each in selection.objects]
    [('a#1', torch.Size([1, 110, 110]), 317.5, '03')]
    """
    check_voc(voc)
    records = pascal3d / "Annotations" / f"{category}_pascal"
    if not records.is_dir():
        raise FileNotFoundError(
            f"{pascal3d}: expected the folder PASCAL3D+_release1.1, but it has no Annotations/{category}_pascal"
        )
    result = Selection()
    for image_id in read_image_ids(voc, category, split):
        _select(voc, records, category, image_id, result)
    if not result.objects:
        failure = next(iter(result.failed.values()), None)
        raise ValueError(f"{voc}: no {category} of {split} is selected: {failure or result.summary()}")
    return result


def _select(voc: Path, records: Path, category: str, image_id: str, result: Selection) -> None:
    """Adds all objects of an image, or none if a file cannot be read."""
    try:
        annotated = read_annotation(voc / "Annotations" / f"{image_id}.xml")
        numbered = [(number, listed) for number, listed in enumerate(annotated, start=1) if listed.category == category]
        usable = [(number, listed) for number, listed in numbered if listed.flaw is None]
        objects: list[Example] = []
        if usable:  # the other photographs need not be read
            photograph = read_image(voc / "JPEGImages" / f"{image_id}.jpg")
            candidates = [found for found in read_record(records / f"{image_id}.mat") if found.category == category]
            for number, listed in usable:
                record = max(candidates, key=lambda found: listed.box.iou(found.box), default=None)
                if record is None or record.viewpoint is None or listed.box.iou(record.box) < SAME_BOX:
                    continue
                model = None if record.cad is None else f"{record.cad:02d}"
                picture = cut_out(photograph, listed.box)
                whole = Box(0.0, 0.0, float(picture.shape[2]), float(picture.shape[1]))
                name = f"{image_id}#{number}"
                objects.append(Example(name, picture, whole, *record.viewpoint, model))
                if record.coarse:
                    result.coarse.add(name)
    except (OSError, ValueError) as error:
        result.failed[image_id] = explain(error).replace(f"{voc}{os.sep}", "").replace(f"{records}{os.sep}", "")
        return
    result.objects += objects
    result.left_out.update(listed.flaw for _, listed in numbered if listed.flaw is not None)
    result.left_out.update(["without a viewpoint"] * (len(usable) - len(objects)))


def cut_out(image: Tensor, box: Box, shortest: int = SHORTEST) -> Tensor:
    """The part (C, h, w) of an image (C, H, W) in a box, enlarged to ``shortest`` pixels at its shortest side.

    The box is rounded to whole pixels; what lies outside the image is left out.

    Raises:
        ValueError: the box and the image have no pixel in common.
    """
    height, width = image.shape[1:]
    inside = Box(*map(round, box)).intersect(Box(0, 0, width, height))
    if inside.width <= 0 or inside.height <= 0:
        raise ValueError(f"expected a box in the image of {height}x{width} pixels, got {box}")
    part = image[:, inside.rows, inside.cols]
    scale = shortest / min(part.shape[1:])
    if scale <= 1:
        return part.contiguous()
    size = [max(shortest, round(side * scale)) for side in part.shape[1:]]
    return functional.interpolate(part[None], size, mode="bicubic", align_corners=False)[0].clamp(0, 1)
