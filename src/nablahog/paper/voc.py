"""PASCAL VOC as it is published: lists of images, photographs, and the objects annotated in them.

``DIR`` is the folder ``VOC2012`` with ``Annotations/*.xml``, ``ImageSets/Main/*.txt`` and ``JPEGImages/*.jpg``.

Source: Everingham et al., The PASCAL Visual Object Classes Challenge: A Retrospective (IJCV 2015), and its devkit.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from ..inputs.boxes import Box
from ..io.input_file import input_file
from ..runtime.text import one_line

FLAWS = ("difficult", "occluded", "truncated")
MAX_ANNOTATION_BYTES = 2**20  # of an annotation; published ones have at most some ten thousand
MAX_LIST_BYTES = 2**26  # of a list of images


@dataclass(frozen=True)
class VOCObject:
    """An annotated object: its category, such as "chair", and its box in pixels.

    A flaw is the first of "difficult" (not counted in evaluations), "occluded" and "truncated" (it extends beyond the
    image or the box) that the file says of it; None if it says none of them.
    """

    category: str
    box: Box
    flaw: str | None


def check_voc(voc: Path) -> None:
    """Raises FileNotFoundError unless ``voc`` has the three folders of VOC."""
    for name in ("Annotations", "ImageSets/Main", "JPEGImages"):
        if not (voc / name).is_dir():
            raise FileNotFoundError(f"{voc}: expected the folder VOC2012 of PASCAL VOC, but it has no {name}")


def read_image_ids(voc: Path, category: str, split: str) -> list[str]:
    """The images of a split with a category: of ``CATEGORY_SPLIT.txt``, or all of ``SPLIT.txt`` if it is missing.

    Raises:
        FileNotFoundError: both are missing.
        ValueError: a line is not the name of an image, with or without 1, 0 or -1.
    """
    lists = voc / "ImageSets" / "Main"
    path = next((path for path in (lists / f"{category}_{split}.txt", lists / f"{split}.txt") if path.is_file()), None)
    if path is None:
        raise FileNotFoundError(f"{lists}: expected {category}_{split}.txt or {split}.txt, got neither")
    if path.stat().st_size > MAX_LIST_BYTES:
        raise ValueError(f"{path}: a list of images of more than {MAX_LIST_BYTES:,} bytes is refused")
    result = []
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        name, *marks = line.split() or [""]
        plain = name.isascii() and name.replace("_", "0").replace("-", "0").isalnum()  # no path separators
        if name and not (plain and marks in ([], ["-1"], ["0"], ["1"])):
            raise ValueError(f"{path}: expected lines like '2008_000003 1', got {one_line(repr(line), 60)}")
        if name and marks != ["-1"]:
            result.append(name)
    return result


class _NoDocumentType(ElementTree.TreeBuilder):
    """Refuses document types, which may define entities; annotations have none."""

    def doctype(self, name: str, pubid: str, system: str) -> None:
        raise ElementTree.ParseError("a document type is refused")


def read_annotation(path: Path) -> list[VOCObject]:
    """The objects of an annotation file (XML), in its order; their parts are ignored.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no such annotation, is damaged, has a document type, or is larger than
            :data:`MAX_ANNOTATION_BYTES`.
    """
    input_file(path).check("an annotation of PASCAL VOC")
    with open(path, "rb") as file:
        data = file.read(MAX_ANNOTATION_BYTES + 1)
    try:
        if len(data) > MAX_ANNOTATION_BYTES:
            raise ValueError(f"it has more than {MAX_ANNOTATION_BYTES:,} bytes")
        root = ElementTree.fromstring(data, ElementTree.XMLParser(target=_NoDocumentType()))
        if root.tag != "annotation":
            raise ValueError(f"its root is {root.tag[:60]!r}")
        return [_object(element) for element in root.iterfind("object")]
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # LookupError: an unknown encoding
        raise ValueError(f"{path}: expected an annotation of PASCAL VOC, but {one_line(error)}") from None


def half_open(xmin: float, ymin: float, xmax: float, ymax: float) -> Box:
    """The box of PASCAL's numbers, which count pixels from 1 and include both ends."""
    return Box(xmin - 1, ymin - 1, xmax, ymax)


def _object(element: ElementTree.Element) -> VOCObject:
    return VOCObject(
        (element.findtext("name") or "").strip(),
        half_open(*_sides(element)),
        next((flaw for flaw in FLAWS if (element.findtext(flaw) or "").strip() == "1"), None),
    )


def _sides(element: ElementTree.Element) -> Iterator[float]:
    for side in ("xmin", "ymin", "xmax", "ymax"):
        text = (element.findtext(f"bndbox/{side}") or "").strip()
        whole, _, fraction = text.partition(".")
        if not (whole.isdecimal() and len(whole) <= 6 and f"0{fraction}".isdecimal()):
            raise ValueError(f"{side} of a box is {text[:60]!r}")
        yield float(text)
