"""`nablahog pose` of a list of objects; a second answer, in its tables and on the page of a pose."""

from __future__ import annotations

import base64
import csv
import io
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from torch import Tensor

from nablahog import estimate_pose, sample_chairs
from nablahog.cli.commands.pose import ObjectJob
from nablahog.cli.main import main
from nablahog.cli.results import pose_files
from nablahog.cli.results.pose_files import PosedObject, as_csv, as_json, rows
from nablahog.cli.results.pose_page import HEIGHT, pose_page
from nablahog.cli.results.pose_pictures import joined_shape
from nablahog.cli.results.pose_table import say_assumed, show_figures
from nablahog.io.images import read_image, write_image
from nablahog.io.input_file import InputFile
from nablahog.io.lists import AnnotatedObject, read_objects
from nablahog.jobs.store import JobResult
from nablahog.pose import PoseEstimate
from nablahog.pose.lens import choose_lens
from nablahog.pose.result import pose_figures
from nablahog.render import Camera, load_mesh, render
from nablahog.viz.html import figure
from nablahog.viz.pictures import RED
from tests.pose.common import degrees_between, model, photographed

from ...paper.common import run_in_this_process
from ..common import names, write_chairs
from .test_pose import RESULTS

AZIMUTH, ELEVATION = 130, 12
TRUE = {"a.png": 130.0, "b.png": 40.0}


@pytest.fixture
def photos(tmp_path: Path, here: None) -> Path:
    """Two photographs of a chair, with a list of them as CSV, and two models."""
    folder = tmp_path / "photos"
    folder.mkdir()
    write_chairs(tmp_path / "models")
    lines = ["image,x0,y0,x1,y1,azimuth,elevation"]
    for name, azimuth in TRUE.items():
        image, box = photographed(model(), azimuth, 12, behind="coffee")
        write_image(folder / name, image)
        lines.append(f"{name},{','.join(map(str, box))},{azimuth + 20},12")
    (tmp_path / "objects.csv").write_text("\n".join(lines) + "\n")
    return folder


def arguments(tmp_path: Path, *more: str, mesh: str = "models") -> list[str]:
    listed = [str(tmp_path / "photos"), "--annotations", str(tmp_path / "objects.csv")]
    return ["pose", *listed, "--mesh", str(tmp_path / mesh), "-o", str(tmp_path / "out"), "--workers", "1", *more]


@pytest.mark.slow
def test_a_list_of_objects(tmp_path: Path, photos: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments(tmp_path, "--focal", "300")) == 0
    assert "a.png" in capsys.readouterr().out
    out = tmp_path / "out"
    assert names(out) == [*RESULTS, "work"]
    rows = list(csv.DictReader((out / "poses.csv").read_text().splitlines()))
    whole = json.loads((out / "poses.json").read_text())
    assert [row["image"] for row in rows] == [image["file_name"] for image in whole["images"]] == list(TRUE)
    assert whole["categories"] == [{"id": 1, "name": "wooden"}]
    mesh = load_mesh(tmp_path / "models" / "wooden.off")
    for row, each in zip(rows, whole["annotations"], strict=True):
        assert row["model"] == each["model"] == "wooden"
        assert each["covariance"] is each["standard_deviations"] is None  # of several models
        assert degrees_between(float(row["azimuth"]), TRUE[row["image"]]) < 3
        matrix = np.array([float(row[f"m{i}{j}"]) for i in range(3) for j in range(4)]).reshape(3, 4)
        assert np.array_equal(matrix, np.array(each["matrix"])[:3])
        # the box is that of the model's points, as these figures project them
        to_file = torch.linalg.inv(mesh.from_original)
        points = (mesh.vertices @ to_file[:3, :3].T + to_file[:3, 3]).numpy()
        seen = points @ matrix[:, :3].T + matrix[:, 3]
        principal_point = [float(row["principal_point_x"]), float(row["principal_point_y"])]
        seen = float(row["focal_length"]) * seen[:, :2] / seen[:, 2:] + principal_point
        x, y, width, height = each["bbox"]
        assert np.abs(np.concatenate([seen.min(0), seen.max(0)]) - [x, y, x + width, y + height]).max() < 5
        assert each["confidence"] == float(row["confidence"]) > 0.3
    # what was written can be read
    for name in ("poses.csv", "poses.json"):
        for one, other in zip(read_objects(out / name), read_objects(tmp_path / "objects.csv"), strict=True):
            assert one.box == pytest.approx(other.box)


@pytest.mark.slow
@pytest.mark.parametrize(
    "camera",
    [["--intrinsics", "300,270,92,73"], ["--intrinsics", "300,330,60,90", "--distortion=0.2,0,0,0"]],
    ids=["unequal focal lengths", "distortion, too, and off the middle"],
)
def test_poses_of_a_calibrated_camera_are_stored_and_shown(tmp_path: Path, photos: Path, camera: list[str]) -> None:
    """The pictures on the page are of the whole undistorted photograph, beside whole close-ups."""
    assert main(arguments(tmp_path, "--page", *camera, mesh="models/wooden.off")) in (0, 4)
    out = tmp_path / "out"
    rows = list(csv.DictReader((out / "poses.csv").read_text().splitlines()))
    assert [degrees_between(float(row["azimuth"]), TRUE[row["image"]]) < 20 for row in rows] == [True, True]
    encoded = re.findall(r"data:image/png;base64,([^\"]+)", (out / "index.html").read_text(encoding="utf-8"))
    shown = [read_image(InputFile("shown.png", base64.b64decode(each))) for each in encoded]
    numbers, bent = camera[1].split(","), "".join(camera[2:]).partition("=")[2]
    distortion = tuple(map(float, bent.split(","))) if bent else None
    photograph = read_image(photos / "a.png", as_bytes=True)
    whole = choose_lens((150, 180), intrinsics=[*map(float, numbers)], distortion=distortion).undistort(photograph)
    assert [tuple(picture.shape) for picture in shown] == [joined_shape(whole.shape[1:])] * 2


def test_a_run_is_resumed(tmp_path: Path, photos: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert main(arguments(tmp_path, mesh="models/wooden.off")) == 0
    first = (tmp_path / "out" / "poses.json").read_bytes()
    begun: list[ObjectJob] = []
    run_in_this_process(monkeypatch, begun.append)
    assert main(arguments(tmp_path, mesh="models/wooden.off")) == 0
    assert (tmp_path / "out" / "poses.json").read_bytes() == first
    assert not begun
    (photos / "b.png").write_bytes((photos / "a.png").read_bytes())
    assert main(arguments(tmp_path, mesh="models/wooden.off")) in (0, 4)
    assert [job.listed.image for job in begun] == ["b.png"]


def test_an_object_that_cannot_be_searched_is_skipped(
    tmp_path: Path, photos: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (photos / "b.png").unlink()
    assert main(arguments(tmp_path, mesh="models/wooden.off")) == 3
    assert "nablahog pose: skipped: object 2: " in capsys.readouterr().err
    whole = json.loads((tmp_path / "out" / "poses.json").read_text())
    assert [each["file_name"] for each in whole["failed"]] == ["b.png"]
    rows = list(csv.DictReader((tmp_path / "out" / "poses.csv").read_text().splitlines()))
    assert [bool(row["error"]) for row in rows] == [False, True]


def test_an_object_that_is_listed_by_its_outline_alone(tmp_path: Path, photos: Path) -> None:
    sides = [30.0, 10.0, 150.0, 10.0, 150.0, 140.0, 30.0, 140.0]
    annotation = {"id": 1, "image_id": 1, "segmentation": [sides]}
    listed = tmp_path / "objects.json"
    listed.write_text(json.dumps({"images": [{"id": 1, "file_name": "a.png"}], "annotations": [annotation]}))
    mesh = str(tmp_path / "models" / "wooden.off")
    options = ["--mesh", mesh, "--workers", "1", "-o", str(tmp_path / "out")]
    assert main(["pose", str(photos), "--annotations", str(listed), *options]) in (0, 4)
    (pose,) = json.loads((tmp_path / "out" / "poses.json").read_text())["annotations"]
    assert degrees_between(pose["azimuth"], TRUE["a.png"]) < 3


def test_several_boxes(tmp_path: Path, photos: Path) -> None:
    boxes = [f"--box={','.join(line.split(',')[1:5])}" for line in (tmp_path / "objects.csv").read_text().split()[1:]]
    options = ["--mesh", str(tmp_path / "models" / "wooden.off"), "--workers", "1", "-o", str(tmp_path / "out")]
    status = main(["pose", str(photos / "a.png"), *boxes, *options, "--init", "0,12"])
    assert status in (0, 4)  # the second box is that of another photograph, and may be off
    whole = json.loads((tmp_path / "out" / "poses.json").read_text())
    assert [each["id"] for each in whole["annotations"]] == [1, 2]
    assert degrees_between(whole["annotations"][0]["azimuth"], TRUE["a.png"]) < 3


def test_bad_lists(tmp_path: Path, photos: Path, refused: Callable[..., None]) -> None:
    whole = arguments(tmp_path)
    refused("pose", str(photos / "a.png"), *whole[2:], message="expected a folder of the photographs")
    refused(*whole, "--box", "1,2,30,40", message="expected no --box, --init or --mask", status=2)
    (tmp_path / "objects.csv").write_text("image,x0,y0,x1,y1\na.png,1,2,3,w\n")
    refused(*whole, message="objects.csv, line 2, column y1 must be a finite number, got 'w'")
    (tmp_path / "objects.csv").write_text("image\nnone.png\nother.png\n")
    refused(*whole, message="no object has a pose; the first: object 1: ")


MESHES = dict(list(sample_chairs().items())[:1])


@pytest.fixture(scope="module")
def photograph() -> Tensor:
    (mesh,) = MESHES.values()
    pose = torch.tensor([[180.0, 10, 2, 0, 0, 0]])
    return render(mesh, pose, Camera.from_field_of_view(30, 128, 128))[0]


@pytest.fixture(scope="module")
def found(photograph: Tensor) -> PoseEstimate:
    estimate = estimate_pose(photograph, MESHES, box=(28, 12, 95, 125), initial=(180, 10))
    assert estimate.runners_up
    assert estimate.renderings >= 144 + sum(len(trace.azimuths) for trace in estimate.traces)  # views, and each step
    return estimate


def with_second(found: PoseEstimate, confidence: float) -> PoseEstimate:
    rival = replace(found.runners_up[0], azimuth=1.6, elevation=12.4, confidence=confidence)
    return replace(found, runners_up=(rival,))


@pytest.mark.parametrize(("confidence", "shown"), [(0.31, "2°, 12° (0.31)"), (0.14, None)])
def test_the_table_has_it_where_it_is_likely(found: PoseEstimate, confidence: float, shown: str | None) -> None:
    listed = AnnotatedObject(1, "a.png", None, None)
    posed = PosedObject(listed, pose_figures(with_second(found, confidence)))
    failed = PosedObject(listed, failure="no such file")
    assert [row["second"] for row in rows([posed, failed])] == [shown, None]
    other = replace(failed, listed=replace(listed, image="b.png"))
    shapes = [{"id": 1, "file_name": "a.png", "height": 128, "width": 128}, {"id": 2, "file_name": "b.png"}]
    assert as_json([posed, failed, other])["images"] == shapes


@pytest.mark.parametrize("most", [1, 2])
def test_of_many_objects_the_first_are_shown(
    found: PoseEstimate, tmp_path: Path, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pose_files, "SHOWN", most)
    figures = {**pose_figures(with_second(found, 0.31)), "seconds": 1.0}
    posed = [PosedObject(AnnotatedObject(k, "a.png"), figures, np.zeros((3, 8, 8), np.uint8)) for k in (1, 2)]
    pose_files.write(tmp_path, posed, 0.3, several=False)
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == most
    assert (f"Only the first {most} are shown." in page) == (most == 1)


@pytest.mark.parametrize(("others", "shown"), [((65.64, 155.0), "180.0 or 65.6 or 155.0"), ((7.5,) * 47, "any")])
def test_other_azimuths_that_look_the_same_are_shown(
    found: PoseEstimate, others: tuple[float, ...], shown: str
) -> None:
    estimate = replace(with_second(found, 0.31), azimuth=180.0, equivalent_azimuths=others, covariance=None)
    figures = {**pose_figures(estimate), "seconds": 1.0}
    posed = PosedObject(AnnotatedObject(1, "a.png"), figures)
    assert figure(rows([posed])[0]["azimuth,\n°"]) == shown
    (row,) = csv.DictReader(as_csv([posed]).splitlines())
    assert {name for name, value in figures.items() if isinstance(value, str | float | bool)} <= {*row}
    assert (row["any_azimuth"], [*map(float, row["equivalent_azimuths"].split())]) == (str(shown == "any"), [*others])
    assert (row["second_azimuth"], row["second_confidence"]) == ("1.6", "0.31")


@pytest.mark.parametrize(("half_turn", "shown"), [(0.0009, "< 0.001"), (0.001, "0.001"), (0.0011, "0.001")])
def test_probabilities_of_half_turns_are_shown_as_finely_as_they_are_known(half_turn: float, shown: str) -> None:
    assert figure(show_figures({"half_turn": half_turn}, ["half_turn"])["half_turn"]) == shown


@pytest.mark.parametrize(
    ("deviation", "shown"),
    [
        *((123.0, "12 ± 123"), (12.6, "12 ± 13"), (10.0, "12 ± 10"), (9.9, "12.3 ± 9.9"), (1.0, "12.3 ± 1.0")),
        *((0.126, "12.35 ± 0.13"), (0.0126, "12.346 ± 0.013"), (1e-3, "12.3457 ± 0.0010")),
        *((1e-9, "12.3457 ± 0.0000"), (0.0, "12.3457 ± 0.0000"), (None, "12.3")),
    ],
)
def test_figures_have_the_decimals_of_two_digits_of_their_deviations(deviation: float | None, shown: str) -> None:
    figures = {"x": 12.3457, "standard_deviations": {"x": deviation}}
    assert figure(show_figures(figures, ["x"])["x"]) == shown


def test_a_pose_that_is_as_sure_as_was_asked_for_is_not_refused() -> None:
    for confidence, refused in ((0.3, False), (0.2999, True), (None, False)):
        result = JobResult([{"confidence": confidence, "drawn_size": (8, 8)}], np.zeros((1, 8, 8), np.uint8), 0.0)
        assert PosedObject.of(AnnotatedObject(1, "a.png"), result, 0.3).refused == refused


@pytest.mark.parametrize(
    ("known", "said"), [("ag", " for 1 of 2 objects,"), ("aa", "assumed, so"), ("a", "assumed, so"), ("eg", "")]
)
def test_of_how_many_objects_the_focal_length_is_assumed(known: str, said: str) -> None:
    words = {"a": "assumed", "g": "given", "e": "exif"}
    sentence = say_assumed([{"focal_length_from": words[letter]} for letter in known])
    assert said in sentence
    assert bool(sentence) == bool(said)


def test_the_page_has_a_picture_of_it(found: PoseEstimate, photograph: Tensor) -> None:
    with_it, without = (
        pose_page("a.png", photograph, with_second(found, confidence), MESHES, "best", choose_lens((128, 128)))
        for confidence in (0.31, 0.14)
    )
    assert "second answer: azimuth 2°, confidence 0.31" in with_it
    assert "second answer: azimuth 2°" not in without
    headings = ["Overlay", "Similarity by azimuth", "Visual elements", "Settings", "What the figures mean"]
    assert re.findall("<h2>(.*?)</h2>", without) == headings
    pictures, others = (re.findall(r"data:image/png;base64,([^\"]+)", page) for page in (with_it, without))
    (added,) = set(pictures) - set(others)
    picture = np.asarray(Image.open(io.BytesIO(base64.b64decode(added))).convert("RGB")) / 255
    drawn = (abs(picture - RED) < 0.1).all(axis=2).any(axis=0).nonzero()[0]
    assert 0.3 * HEIGHT < np.ptp(drawn) < 0.7 * HEIGHT  # the outline, of which the longer side is 0.6 of the picture's
