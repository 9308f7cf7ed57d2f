"""The store's bound, the queues of work, and the imports of the scripts."""

from __future__ import annotations

import asyncio
import gc
import re
import threading
import time
import weakref
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from graphlib import TopologicalSorter

import pytest
import torch

from nablahog.app import server
from nablahog.app import store as store_module
from nablahog.app.chart import SimilarityChart
from nablahog.app.messages import RequestError, as_request_error
from nablahog.app.snippets import FitFiles, write_pose_snippets
from nablahog.app.store import MeshEntry, Photograph, Store
from nablahog.app.work_queue import Cancelled, CancelToken, WorkQueue
from nablahog.io.input_file import InputFile
from nablahog.pose.model import prepared_model
from nablahog.pose.symmetry import view_correlations
from nablahog.render import load_mesh
from nablahog.requests.pose import PoseRequest
from nablahog.runtime.errors import InputError

TETRAHEDRON = b"OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"


def photograph(side: int) -> Photograph:
    return Photograph("p", torch.zeros(1, side, side))


def test_the_oldest_that_nobody_asked_for_goes_first() -> None:
    store = Store(b"", most=3 * photograph(10).nbytes)
    first, second, third = (store.add(photograph(10), bytes([k])) for k in range(3))
    store.get(first, Photograph)
    store.add(photograph(10), b"new")
    assert store.nbytes == 3 * photograph(10).nbytes
    store.get(first, Photograph)
    store.get(third, Photograph)
    with pytest.raises(RequestError, match="open it again"):
        store.get(second, Photograph)


def test_what_is_larger_than_all_is_refused() -> None:
    with pytest.raises(RequestError) as refused:
        Store(b"", most=100).add(photograph(10))
    assert refused.value.status == 413


@pytest.mark.slow
@pytest.mark.parametrize("again", [False, True])
def test_a_mesh_that_is_dropped_is_freed(again: bool) -> None:
    entries = [MeshEntry("m", load_mesh(InputFile("m.off", TETRAHEDRON))) for _ in range(2)]
    dropped = weakref.ref(entries[0].mesh)
    view_correlations(prepared_model(entries[0].mesh), 15.0)
    store = Store(b"", most=entries[0].nbytes)
    for number in range(2):
        store.add(entries.pop(0), b"" if again else bytes([number]))
    gc.collect()
    assert dropped() is None


def test_a_size_of_a_photograph_is_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    computed: list[int] = []

    def slow(image: torch.Tensor, side: int) -> torch.Tensor:
        computed.append(side)
        time.sleep(0.05)
        return image[:, :side, :side].clone()

    monkeypatch.setattr(store_module, "limit_size", slow)
    shared = photograph(100)
    with ThreadPoolExecutor(3) as threads:
        images = list(threads.map(shared.shrunk, [8] * 3))
    assert computed == [8]
    assert all(image is images[0] for image in images)
    for side in (9, 10, 11, 8, 12, 8, 9):  # four are kept, those used last
        shared.shrunk(side)
    assert computed == [8, 9, 10, 11, 12, 9]


def test_of_a_file_of_which_nothing_is_known_nothing_is_asked() -> None:
    with pytest.raises(RequestError) as refused, as_request_error():
        raise InputError("too small", "descriptor")
    assert refused.value.answer == {"error": "too small"}


def test_ids_are_of_the_server_the_kind_and_each_part_of_the_content() -> None:
    mesh = MeshEntry("m", load_mesh(InputFile("m.off", TETRAHEDRON)))
    added = [(b"a", photograph(2), b"xy"), (b"b", photograph(2), b"xy"), (b"a", mesh, b"xy")]
    parts = [(b"x", b"y"), (b"", b"xy"), (b"xy", b""), (b"y", b"x")]
    ids = [Store(secret).add(item, content) for secret, item, content in added]  # type: ignore[arg-type]
    ids += [Store(b"a").add(photograph(2), *content) for content in parts]
    assert len({*ids}) == len(ids)
    assert Store(b"a").add(photograph(3), b"xy") == ids[0]


def test_a_full_lane_refuses_and_a_cancelled_one_ends_its_work() -> None:
    queue, began, ended = WorkQueue("test", most=2), threading.Event(), threading.Event()

    def work(cancel: CancelToken) -> None:
        began.set()
        try:
            while True:
                cancel.check()
        except Cancelled:
            ended.set()
            raise

    async def crowded() -> None:
        running, waiting = (asyncio.create_task(queue.run(work)) for _ in range(2))
        await asyncio.to_thread(began.wait)
        with pytest.raises(RequestError, match="busy: 2 computations wait already"):
            await queue.run(work)
        for task in (running, waiting):
            task.cancel()
        await asyncio.wait([running, waiting])
        assert await asyncio.to_thread(ended.wait, 5)
        assert await queue.run(lambda _: 3) == 3
        await asyncio.sleep(0)
        assert queue.count == 0

    asyncio.run(crowded())


def test_a_queue_counts_work_that_ends_at_once() -> None:
    async def many() -> int:
        queue = WorkQueue("test", most=2)
        for _ in range(200):
            await queue.run(lambda _: None)
        return queue.count

    assert asyncio.run(many()) == 0


def test_there_is_no_circle_among_the_scripts() -> None:
    scripts = {path.name: path.read_text(encoding="utf-8") for path in server.STATIC.glob("*.js")}
    imports = {name: re.findall(r'^import .* from "\./(.+)";$', text, re.MULTILINE) for name, text in scripts.items()}
    assert imports["main.js"]
    TopologicalSorter(imports).prepare()  # raises CycleError, with the circle


@pytest.mark.parametrize(("asked", "width"), [(1, 280), (300, 300), (10_000, 2000)])
def test_the_width_of_a_chart(asked: int, width: int) -> None:
    chart = SimilarityChart()
    chart.move((30.0, 20.0, 3.0, 0.0, 0.0, 0.0), 1.0, 0.0, asked)
    assert f'width="{width}"' in chart.draw()["svg"]


def test_a_curve_before_any_pose() -> None:
    """It is that of the pose that is shown, and nothing is said of a similarity here."""
    chart = SimilarityChart()
    chart.begin_curve((0.0, 20.0, 3.0, 0.0, 0.0, 0.0))
    chart.add_to_curve(90, torch.tensor([1.0, 0.5]), torch.zeros(2))
    drawn = chart.draw()
    assert drawn["description"] == "Similarity over all azimuths: the largest is 1.000 at 180°"
    assert 'class="l-curve"' in drawn["svg"]
    assert "nan" not in drawn["svg"]


def test_a_chart_shows_the_newest_steps() -> None:
    chart = SimilarityChart()
    chart.move((30.0, 20.0, 3.0, 0.0, 0.0, 0.0), 1.0, 0.0, 480)
    chart.steps += [(0.0, 1.0), *300 * [(10.0, 1.0)]]
    places = Counter(re.findall('<circle.+? cx="(.+?)"', chart.draw()["svg"]))
    assert sorted(places.values()) == [2, 300]  # the pose itself in both parts


def test_snippets_for_a_pose_have_its_seed() -> None:
    snippets = write_pose_snippets(PoseRequest(seed=5), FitFiles("photo.png", False, "chair.obj"))
    assert "seed=5" in snippets["python"]
    assert snippets["command"].endswith("--seed 5")
