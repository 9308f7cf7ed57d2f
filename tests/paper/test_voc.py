"""PASCAL VOC's annotations and lists, and what is refused of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from nablahog.paper.voc import VOCObject, check_voc, read_annotation, read_image_ids

ANNOTATION = """<annotation><folder>VOC2012</folder>
<size><width>500</width><height>375</height><depth>3</depth></size>
<object><name>chair</name><pose>Left</pose><truncated>1</truncated><occluded>0</occluded><difficult>1</difficult>
<bndbox><xmin>1</xmin><ymin>20</ymin><xmax>30</xmax><ymax>375</ymax></bndbox>
<part><name>head</name><bndbox><xmin>5</xmin><ymin>6</ymin><xmax>7</xmax><ymax>8</ymax></bndbox></part></object>
<object><name> sofa </name>
<bndbox><xmin>45.70000076293945</xmin><ymin>2</ymin><xmax>50.5</xmax><ymax>9</ymax></bndbox></object>
</annotation>"""


def test_annotation(tmp_path: Path) -> None:
    path = tmp_path / "a.xml"
    path.write_text(ANNOTATION)
    assert read_annotation(path) == [
        VOCObject("chair", (0, 19, 30, 375), True, False, True),
        VOCObject("sofa", (44.70000076293945, 1, 50.5, 9), False, False, False),
    ]
    path.write_text("<annotation/>")
    assert read_annotation(path) == []


BOMB = (
    "<!DOCTYPE annotation ["
    + "".join(f'<!ENTITY e{k + 1} "{f"&e{k};" * 10}">' for k in range(20))
    + "]><annotation>&e20;</annotation>"
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no element found"),
        ("<annotation>", "no element found"),
        ("<html/>", "its root is 'html'"),
        (BOMB, "a document type is refused"),
        ('<!DOCTYPE annotation SYSTEM "file:///etc/passwd"><annotation/>', "a document type is refused"),
        ('<?xml version="1.0" encoding="none"?><annotation/>', "unknown encoding"),
        ("<annotation><object><name>chair</name></object></annotation>", "xmin of a box is ''"),
        (ANNOTATION.replace(">20<", ">nan<"), "ymin of a box is 'nan'"),
        (ANNOTATION.replace(">20<", f">{'9' * 5000}<"), "ymin of a box is '999"),
        (ANNOTATION + " " * 2**20, "it has more than 1,048,576 bytes"),
    ],
)
def test_refused_annotations(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "a.xml"
    path.write_text(text)
    with pytest.raises(ValueError, match="expected an annotation of PASCAL VOC, but ") as error:
        read_annotation(path)
    assert message in str(error.value)
    assert len(str(error.value)) < 300 + len(str(path))


def test_lists(tmp_path: Path) -> None:
    lists = tmp_path / "ImageSets" / "Main"
    lists.mkdir(parents=True)
    with pytest.raises(FileNotFoundError, match=r"expected chair_val\.txt or val\.txt"):
        read_image_ids(tmp_path, "chair", "val")
    (lists / "val.txt").write_text("2008_000002\n2008_000003\n\n2008_000005\n")
    assert read_image_ids(tmp_path, "chair", "val") == ["2008_000002", "2008_000003", "2008_000005"]
    (lists / "chair_val.txt").write_text("2008_000002 -1\n2008_000003  1\n2008_000005  0\n")
    assert read_image_ids(tmp_path, "chair", "val") == ["2008_000003", "2008_000005"]
    for line in ("../../etc/passwd 1", "a b", "/x"):
        (lists / "chair_val.txt").write_text(f"2008_000003 1\n{line}\n")
        with pytest.raises(ValueError, match="expected lines as '2008_000003 1', got"):
            read_image_ids(tmp_path, "chair", "val")


def test_missing_files(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="but it has no Annotations"):
        check_voc(tmp_path)
    with pytest.raises(FileNotFoundError, match=r"a\.xml: no such file"):
        read_annotation(tmp_path / "a.xml")
