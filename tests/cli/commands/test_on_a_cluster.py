"""The option ``--cluster`` of `invert` and `learn`; data sets as inputs."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from nablahog import presets, save_descriptor
from nablahog.cli.commands import invert
from nablahog.cli.main import main
from nablahog.io.descriptor_dataset import DescriptorDataset
from nablahog.io.images import read_image
from nablahog.jobs import runner
from nablahog.jobs.worker import Work
from nablahog.pose.whitening import Background

from ...paper.common import ThisProcess, run_in_this_process, write_prior
from ..common import FAST, SMALL, names

OTHER = ["--cluster", "tcp://of-these-tests:1"]


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What goes to a cluster that is this process: jobs and results travel as bytes, and come in another order."""
    jobs_sent: list[Any] = []

    class ByBytes(ThisProcess):
        def submit(self, index: int, job: Any, left: int) -> None:
            super().submit(index, pickle.loads(pickle.dumps(job)), left)

        def next_outcome(self) -> tuple[int, Any]:
            index, outcome = super().next_outcome()
            return index, pickle.loads(pickle.dumps(outcome))

    def opened(jobs: Sequence[Work[Any]], workers: int, cluster: str | None) -> AbstractContextManager[ThisProcess]:
        assert cluster == OTHER[1]
        return nullcontext(ByBytes(jobs_sent.append))

    monkeypatch.setattr(runner, "open_executor", opened)
    return jobs_sent


def _figures(folder: Path) -> list[dict[str, Any]]:
    """Of ``results.json``, without times."""
    figures = json.loads((folder / "results.json").read_text())
    return [{name: value for name, value in each.items() if name != "seconds"} for each in figures]


@pytest.mark.slow
def test_invert(tmp_path: Path, photo: str, descriptor: str, sent: list[Any]) -> None:
    """The same results as without; they are stored, and an inversion is repeated for nothing."""
    bad = tmp_path / "bad.npz"
    bad.write_bytes(b"no archive")
    command = ["invert", photo, descriptor, str(bad), *SMALL]
    one, other = tmp_path / "one", tmp_path / "other"
    assert main([*command, "-o", str(one)]) == 3
    assert main([*command, "-o", str(other), *OTHER]) == 3
    assert len(sent) == 2
    assert names(one) == [name for name in names(other) if name != "work"]
    for a, b in zip(_figures(one), _figures(other), strict=True):
        for name in a.keys() | b.keys():
            close = isinstance(a[name], float) and a[name] == pytest.approx(b[name], rel=1e-3)
            assert close or a[name] == b[name], name
    before = (other / "cat_preimage.png").read_bytes()
    assert main([*command, "-o", str(other), *OTHER]) == 3
    assert len(sent) == 2
    assert (other / "cat_preimage.png").read_bytes() == before
    assert main([*command, "-o", str(other), "--seed", "1", *OTHER]) == 3
    assert len(sent) == 4


@pytest.mark.slow
@pytest.mark.usefixtures("two_iterations")
@pytest.mark.parametrize(
    "options",
    [["--method", "paper", "--preset", "paper", "--size", "24"], ["--samples", "2", "--preset", "paper", *SMALL]],
)
def test_all_pictures_travel(tmp_path: Path, photo: str, sent: list[Any], options: list[str]) -> None:
    assert main(["invert", photo, *options, "-o", str(tmp_path / "one")]) == 0
    assert main(["invert", photo, *options, "-o", str(tmp_path / "other"), *OTHER]) == 0
    assert names(tmp_path / "one") == [name for name in names(tmp_path / "other") if name != "work"]
    a, b = (read_image(tmp_path / folder / "cat_preimage.png") for folder in ("one", "other"))
    torch.testing.assert_close(a, b, rtol=0, atol=2 / 255)


@pytest.mark.slow
def test_a_prior_travels(tmp_path: Path, photo: str, sent: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers read their copy of its file."""
    asked, copy = (write_prior(tmp_path / f"{value}.npz", presets.uoctti(8), value=value) for value in (0.1, 0.01))
    command = ["invert", photo, "--quality", "fast", "--size", "24"]
    made = [tmp_path / name for name in ("of-asked", "of-copy", "cluster")]
    assert main([*command, "--prior", str(asked), "-o", str(made[0])]) == 0
    assert main([*command, "--prior", str(copy), "-o", str(made[1])]) == 0
    monkeypatch.setattr(invert, "local_path", {asked: copy}.get)
    assert main([*command, "--prior", str(asked), "-o", str(made[2]), *OTHER]) == 0
    assert [path for job in sent for path in job.files()] == [asked]
    of_asked, of_copy, by_cluster = (_figures(folder)[0]["distance"] for folder in made)
    assert by_cluster == pytest.approx(of_copy, rel=1e-3)
    assert of_asked != pytest.approx(of_copy, rel=0.1)


@pytest.mark.parametrize("options", [["--template"], ["--device", "cuda"]])
def test_what_excludes_a_cluster(
    tmp_path: Path, photo: str, refused: Callable[..., None], monkeypatch: pytest.MonkeyPatch, options: list[str]
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
    message = f"--cluster and {options[0]} exclude each other"
    refused("invert", photo, "-o", str(tmp_path / "out"), *options, *OTHER, message=message, status=2)


@pytest.mark.usefixtures("sent")
def test_a_descriptor_that_a_cluster_cannot_invert(tmp_path: Path, refused: Callable[..., None]) -> None:
    save_descriptor(tmp_path / "d.npz", torch.full((4, 4, 31), 1e7), "uoctti", (32, 32))
    command = ["invert", str(tmp_path / "d.npz"), "--prior", "none", "-o", str(tmp_path / "out")]
    refused(*command, *OTHER, message="d.npz: the descriptor's entries must be at most")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The descriptors of four images, and of one that is none, in two files."""
    folder = tmp_path_factory.mktemp("photos")
    for k in range(4):
        levels = np.random.default_rng(k).integers(0, 256, (32, 40), dtype=np.uint8)
        Image.fromarray(levels).save(folder / f"{k}.png")
    (folder / "x.png").write_bytes(b"no image")
    out = folder / "set.parquet"
    with pytest.MonkeyPatch.context() as patch:
        run_in_this_process(patch)
        assert main(["hog", str(folder), "-o", str(out), "--preset", "paper"]) == 3
    return str(out)


@pytest.mark.slow
@pytest.mark.parametrize("cluster", [[], OTHER])
def test_a_data_set_is_inverted(
    tmp_path: Path, dataset: str, sent: list[Any], cluster: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Row by row, a few at a time."""
    monkeypatch.setattr("nablahog.cli.input_files.ROWS_IN_MEMORY", 3)
    out = tmp_path / "out"
    assert main(["invert", dataset, "-o", str(out), *FAST, *cluster]) == 3
    results = json.loads((out / "results.json").read_text())
    assert [each["preimage"] for each in results[:-1]] == [f"00000{k}_{k}_preimage.png" for k in range(4)]
    assert [each["input"] for each in results] == [row.path for row in DescriptorDataset(dataset)]
    assert "expected an image" in results[-1]["error"]
    assert read_image(out / results[0]["preimage"]).shape == (1, 32, 40)


def test_data_sets_that_cannot_be_inverted(tmp_path: Path, dataset: str, refused: Callable[..., None]) -> None:
    out = ["-o", str(tmp_path / "out")]
    refused("invert", dataset, *out, "--preset", "uoctti", message="set.parquet: ")
    refused("invert", str(tmp_path / "no.parquet"), *out, message="no.parquet: no such data set of descriptors")


def test_learning(tmp_path: Path, images: str, sent: list[Any]) -> None:
    """A background, as without a cluster."""
    command = ["learn", "background", "--images", images, "--set", "cell_size=2", "-o"]
    assert main([*command, str(tmp_path / "one.npz")]) == 0
    assert main([*command, str(tmp_path / "other.npz"), *OTHER]) == 0
    assert len(sent) == 3
    one, other = (Background.load(tmp_path / f"{name}.npz") for name in ("one", "other"))
    torch.testing.assert_close(one.covariance, other.covariance, rtol=1e-12, atol=1e-12)
