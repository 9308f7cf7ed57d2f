"""The store's bound, the queues of work, and the imports of the scripts."""

from __future__ import annotations

import asyncio
import re
import threading
from graphlib import TopologicalSorter

import pytest
import torch

from nablahog.app import server
from nablahog.app.messages import RequestError
from nablahog.app.snippets import FitFiles, write_pose_snippets
from nablahog.app.store import Photograph, Store
from nablahog.app.work_queue import Cancelled, CancelToken, WorkQueue
from nablahog.requests.pose import PoseRequest


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


def test_ids_of_one_server_say_nothing_of_another() -> None:
    assert Store(b"a").add(photograph(2), b"x") != Store(b"b").add(photograph(2), b"x")


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


def test_snippets_for_a_pose_have_its_seed() -> None:
    snippets = write_pose_snippets(PoseRequest(seed=5), FitFiles("photo.png", False, "chair.obj"))
    assert "seed=5" in snippets["python"]
    assert snippets["command"].endswith("--seed 5")
