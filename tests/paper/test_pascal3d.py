"""PASCAL VOC's annotations, PASCAL3D+'s records and the paper's selection, on files in the published layout."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from scipy import io

from nablahog.inputs.boxes import Box
from nablahog.paper.pascal3d import cut_out, read_pascal3d, read_record
from nablahog.paper.voc import VOCObject, read_annotation, read_image_ids

FINE = {"azimuth": 317.5, "elevation": 20.1, "distance": 7.5, "theta": -3.5, "azimuth_coarse": 315}
COARSE = {"azimuth": 1.0, "elevation": 2.0, "distance": 0.0, "azimuth_coarse": -45, "elevation_coarse": 10}


def _object(box: tuple[float, ...], viewpoint: object, *, category: str = "chair", cad: object = 3.0) -> dict[str, Any]:
    return {"class": category, "bbox": list(box), "viewpoint": viewpoint, "cad_index": cad}


def _write_record(path: Path, *objects: dict[str, Any]) -> Path:
    fields = [(name, object) for name in objects[0]]
    stored = np.array([tuple(each.values()) for each in objects], dtype=fields)
    path.parent.mkdir(parents=True, exist_ok=True)
    io.savemat(path, {"record": {"filename": f"{path.stem}.jpg", "objects": stored}})
    return path


def test_record(tmp_path: Path) -> None:
    path = _write_record(
        tmp_path / "a.mat",
        _object((282, 236, 365, 348), FINE),
        _object((1, 2, 3, 4), COARSE, category="sofa", cad=np.zeros((0, 0))),
        _object((1, 2, 3, 4), np.zeros((0, 0))),
        _object((1, 2, 3, 4), {**FINE, "azimuth": np.zeros((0, 0)), "elevation_coarse": 16}),
        _object((1, 2, 3, 4), {"distance": 0}, cad=1),
        _object((1, 2, 3, 4), {"azimuth": 5, "elevation": float("nan"), "distance": 1}),
        _object((1, 2, 3, 4), "none", cad=0),
    )
    result = read_record(path)
    assert (result[0].category, result[0].box, result[0].cad) == ("chair", (281, 235, 365, 348), 3)
    assert (result[0].viewpoint, result[0].coarse) == ((317.5, 20.1, -3.5), False)
    assert (result[1].category, result[1].cad) == ("sofa", None)
    assert (result[1].viewpoint, result[1].coarse) == ((315.0, 10.0, 0.0), True)
    assert (result[3].viewpoint, result[3].coarse) == ((315.0, 16.0, -3.5), True)
    assert [result[k].viewpoint for k in (2, 4, 5, 6)] == [None] * 4
    assert [result[k].cad for k in (4, 6)] == [1, None]


def test_refused_records(tmp_path: Path) -> None:
    wrong: list[tuple[Any, str]] = [
        (1.0, "record is no structure"),
        ({"objects": "chair"}, "objects is no structure"),
        ({"objects": {"class": "chair", "bbox": [1, 2, 3, np.nan]}}, "no class or no bbox"),
    ]
    for record, message in wrong:
        io.savemat(tmp_path / "a.mat", {"record": record})
        with pytest.raises(ValueError, match=f"expected a record of PASCAL3D.*{message}"):
            read_record(tmp_path / "a.mat")


def _annotation(box: tuple[float, ...], **flags: int) -> str:
    sides = "".join(f"<{n}>{v}</{n}>" for n, v in zip(("xmin", "ymin", "xmax", "ymax"), box, strict=True))
    of = "".join(f"<{name}>{value}</{name}>" for name, value in flags.items())
    return f"<object><name>chair</name>{of}<bndbox>{sides}</bndbox></object>"


@pytest.fixture
def published(tmp_path: Path) -> tuple[Path, Path]:
    """Four photographs of 120x160 pixels, whose gray at x, y is (x + y) / 2."""
    voc, pascal3d = tmp_path / "VOC2012", tmp_path / "PASCAL3D+_release1.1"
    for name in ("Annotations", "ImageSets/Main", "JPEGImages"):
        (voc / name).mkdir(parents=True)
    (voc / "ImageSets" / "Main" / "chair_val.txt").write_text("a 1\nb 1\nc -1\nd 0\ne 1\n")
    large, small, out = (11, 1, 120, 110), (21, 41, 70, 80), (1, 1, 50, 50)
    objects = {
        "a": [_annotation(large), _annotation(out, occluded=1, truncated=1), _annotation(small, difficult=0)],
        "b": [_annotation(out, truncated=1), _annotation(small), _annotation(large, difficult=1, occluded=1)],
        "c": [_annotation(large)],
        "d": [_annotation(out, difficult=1)],
        "e": [_annotation(large)],
    }
    y, x = np.mgrid[:120, :160]
    for name, annotated in objects.items():
        (voc / "Annotations" / f"{name}.xml").write_text(f"<annotation>{''.join(annotated)}</annotation>")
        Image.fromarray(((x + y) // 2).astype(np.uint8)).save(voc / "JPEGImages" / f"{name}.jpg", quality=95)
    records = pascal3d / "Annotations" / "chair_pascal"
    nearly = (22, 40, 71, 80)
    _write_record(records / "a.mat", _object(nearly, COARSE, cad=11), _object(large, FINE), _object(out, FINE))
    _write_record(records / "b.mat", _object(small, FINE, category="sofa"), _object(large, FINE))
    _write_record(records / "c.mat", _object(large, FINE))
    (records / "e.mat").write_bytes(b"hello")
    return voc, pascal3d


def test_the_selection(published: tuple[Path, Path]) -> None:
    result = read_pascal3d(*published)
    assert [each.name for each in result.objects] == ["a#1", "a#3"]
    assert [each.model for each in result.objects] == ["03", "11"]
    assert [each.azimuth for each in result.objects] == [317.5, 315.0]
    assert [tuple(each.image.shape) for each in result.objects] == [(1, 110, 110), (1, 100, 125)]
    assert [each.box for each in result.objects] == [(0, 0, 110, 110), (0, 0, 125, 100)]
    assert result.left_out == {"occluded": 1, "truncated": 1, "difficult": 2, "without a viewpoint": 1}
    assert result.summary() == (
        "2 objects of 1 photograph, 1 of them with coarse viewpoints only; "
        "left out: 1 occluded, 1 truncated, 2 difficult, 1 without a viewpoint."
    )
    assert list(result.failed) == ["e"]
    assert result.failed["e"].startswith("e.mat: expected a MATLAB file")
    expected = (np.add.outer(np.arange(0, 110), np.arange(10, 120)) // 2) / 255
    assert abs(result.objects[0].image[0].numpy() - expected).max() < 4 / 255


@pytest.mark.parametrize(("bottom", "is_same"), [(120, True), (121, False)])
def test_boxes_of_which_half_is_common_are_of_one_object(
    published: tuple[Path, Path], bottom: int, is_same: bool
) -> None:
    records = published[1] / "Annotations" / "chair_pascal"
    _write_record(records / "a.mat", _object((21, 41, 70, bottom), FINE), _object((11, 1, 120, 110), FINE))
    assert ("a#3" in [each.name for each in read_pascal3d(*published).objects]) == is_same


def test_nothing_to_select(published: tuple[Path, Path]) -> None:
    voc, pascal3d = published
    for listed, message in (
        ("d 1", "no chair of val is selected: 0 objects of 0 photographs; left out: 1 diff"),
        ("f 1", r"is selected: Annotations/f\.xml: no such file"),
    ):
        (voc / "ImageSets" / "Main" / "chair_val.txt").write_text(listed)
        with pytest.raises(ValueError, match=message):
            read_pascal3d(voc, pascal3d)
    with pytest.raises(FileNotFoundError, match="but it has no Annotations/chair_pascal"):
        read_pascal3d(voc, voc)
    with pytest.raises(FileNotFoundError, match="expected the folder VOC2012"):
        read_pascal3d(pascal3d, pascal3d)


def test_cut_out() -> None:
    image = torch.rand(3, 40, 60)
    assert torch.equal(cut_out(image, Box(10, 5, 30, 40), shortest=20), image[:, 5:40, 10:30])
    assert torch.equal(cut_out(image, Box(-9, 5.4, 99, 99), shortest=1), image[:, 5:])
    enlarged = cut_out(image, Box(10, 5, 30, 35), shortest=50)
    assert enlarged.shape == (3, 75, 50)
    assert cut_out(image, Box(10, 5, 30, 35), shortest=30).shape == (3, 45, 30)
    assert 0 <= enlarged.min() <= enlarged.max() <= 1
    constant = cut_out(torch.full((1, 9, 9), 0.5), Box(0, 0, 4, 3))
    assert constant.shape == (1, 100, 133)
    assert torch.allclose(constant, torch.tensor(0.5))
    with pytest.raises(ValueError, match="expected a box in the image of 40x60 pixels"):
        cut_out(image, Box(60, 0, 70, 9))


# --- PASCAL VOC

ANNOTATION = """<annotation><folder>VOC2012</folder>
<object><name>chair</name><truncated>1</truncated><occluded>0</occluded><difficult>1</difficult>
<bndbox><xmin>1</xmin><ymin>20</ymin><xmax>30</xmax><ymax>375</ymax></bndbox>
<part><name>head</name><bndbox><xmin>5</xmin><ymin>6</ymin><xmax>7</xmax><ymax>8</ymax></bndbox></part></object>
<object><name> sofa </name>
<bndbox><xmin>45.70000076293945</xmin><ymin>2</ymin><xmax>50.5</xmax><ymax>9</ymax></bndbox></object>
</annotation>"""
ENTITIES = "".join(f'<!ENTITY e{k + 1} "{f"&e{k};" * 10}">' for k in range(20))


def test_annotation(tmp_path: Path) -> None:
    path = tmp_path / "a.xml"
    path.write_text(ANNOTATION)
    assert read_annotation(path) == [
        VOCObject("chair", (0, 19, 30, 375), "difficult"),
        VOCObject("sofa", (44.70000076293945, 1, 50.5, 9), None),
    ]
    path.write_text(ANNOTATION.replace(">375<", ">999999<"))
    assert read_annotation(path)[0].box.y1 == 999999


def test_refused_annotations(tmp_path: Path) -> None:
    path = tmp_path / "a.xml"
    for text, message in (
        ("<annotation>", "no element found"),
        ("<html/>", "its root is 'html'"),
        (f"<!DOCTYPE annotation [{ENTITIES}]><annotation>&e20;</annotation>", "a document type is refused"),
        ('<!DOCTYPE annotation SYSTEM "file:///etc/passwd"><annotation/>', "a document type is refused"),
        ('<?xml version="1.0" encoding="none"?><annotation/>', "unknown encoding"),
        (ANNOTATION.replace(">20<", ">nan<"), "ymin of a box is 'nan'"),
        (ANNOTATION.replace(">20<", ">1000000<"), "ymin of a box is '1000000'"),
        (ANNOTATION + " " * 2**20, "it has more than 1,048,576 bytes"),
    ):
        path.write_text(text)
        with pytest.raises(ValueError, match=f"expected an annotation of PASCAL VOC, but .*{message}"):
            read_annotation(path)


def test_lists(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lists = tmp_path / "ImageSets" / "Main"
    lists.mkdir(parents=True)
    with pytest.raises(FileNotFoundError, match=r"expected chair_val\.txt or val\.txt"):
        read_image_ids(tmp_path, "chair", "val")
    (lists / "val.txt").write_text("2008_000002\n2008_000003\n\n2008_000005\n")
    assert read_image_ids(tmp_path, "chair", "val") == ["2008_000002", "2008_000003", "2008_000005"]
    (lists / "chair_val.txt").write_text("2008_000002 -1\n2008_000003  1\n2008_000005  0\n")
    assert read_image_ids(tmp_path, "chair", "val") == ["2008_000003", "2008_000005"]
    (lists / "chair_val.txt").write_text("2008_000003 1\n../../etc/passwd 1\n")
    with pytest.raises(ValueError, match="expected lines like '2008_000003 1', got"):
        read_image_ids(tmp_path, "chair", "val")
    (lists / "chair_val.txt").write_bytes(b"a\nb\n")
    monkeypatch.setattr("nablahog.paper.voc.MAX_LIST_BYTES", 4)
    assert read_image_ids(tmp_path, "chair", "val") == ["a", "b"]
    monkeypatch.setattr("nablahog.paper.voc.MAX_LIST_BYTES", 3)
    with pytest.raises(ValueError, match="a list of images of more than 3 bytes is refused"):
        read_image_ids(tmp_path, "chair", "val")
