"""What a Dask cluster costs beside the processes of this machine, and how many tasks a second its scheduler takes.

    python benchmarks/cluster.py [--seconds N] [--workers 1 2] [--scheduler 1 4 16]

The first table has the efficiency of both runners: seconds of computing, over seconds of all workers from the first
job's beginning to the last one's end.  Jobs compute for a given time, and do nothing else.

The second table has tasks a second that do nothing, by the number of workers, which are threads of one process: a
bound on what the scheduler takes, and from it the workers that it keeps busy with chunks of half a second.
"""

from __future__ import annotations

import argparse
import hashlib
import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from distributed import Client, LocalCluster, wait

from nablahog.jobs.cluster import CHUNK_SECONDS, run_on_cluster
from nablahog.jobs.runner import run_jobs
from nablahog.jobs.store import JobResult, Work

Runner: TypeAlias = Callable[[Sequence[Work[JobResult]]], Iterator[Any]]

DATA = bytes(2**17)
SECONDS = (0.001, 0.01, 0.1, 0.5)  # of a job
SHARE = 0.9  # efficiency that is wanted


@dataclass(frozen=True)
class Busy:
    """Computes for some seconds of the processor, without Python's lock, as loops and PyTorch do."""

    seconds: float
    number: int

    def run(self) -> JobResult:
        """As :class:`nablahog.jobs.store.Work`; the figures are when it began and ended."""
        began, end = time.time(), time.thread_time() + self.seconds
        while time.thread_time() < end:
            hashlib.sha256(DATA)
        return JobResult([{"began": began, "ended": time.time()}], np.zeros((1, 1), np.uint8), self.seconds)


def efficiency(run: Runner, seconds: float, count: int, workers: int) -> float:
    """Seconds of computing, over those of all workers from the first job's beginning to the last one's end."""
    jobs: list[Work[JobResult]] = [Busy(seconds, number) for number in range(count)]
    figures = [outcome.figures[0] for _, outcome in run(jobs)]
    elapsed: float = max(each["ended"] for each in figures) - min(each["began"] for each in figures)
    return count * seconds / (workers * elapsed)


def tasks_a_second(workers: int, count: int) -> float:
    """Tasks that do nothing, submitted one by one."""
    with (
        LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=False, dashboard_address=None, silence_logs=50
        ) as cluster,
        Client(cluster) as client,
    ):
        wait(client.map(abs, range(100), pure=False))
        began = time.perf_counter()
        wait(client.map(abs, range(count), pure=False))
        return count / (time.perf_counter() - began)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="of computing, for each row and worker")
    parser.add_argument("--lengths", type=float, nargs="*", default=SECONDS, help="seconds of a job")
    parser.add_argument("--workers", type=int, nargs="*", default=[1, 2])
    parser.add_argument("--scheduler", type=int, nargs="*", default=[1, 8, 64, 256])
    options = parser.parse_args()
    print("| seconds of a job | workers | processes | Dask | ratio |\n|---:|---:|---:|---:|---:|")
    for workers, seconds in itertools.product(options.workers, options.lengths):
        count = max(20, round(options.seconds * workers / seconds))
        ours = efficiency(partial(run_jobs, workers=workers), seconds, count, workers)
        dask = efficiency(partial(run_on_cluster, cluster=f"local:{workers}"), seconds, count, workers)
        print(f"| {seconds:g} | {workers} | {ours:.3f} | {dask:.3f} | {dask / ours:.3f} |", flush=True)
    print("\n| workers | tasks a second | workers kept busy by chunks |\n|---:|---:|---:|")
    for workers in options.scheduler:
        rate = tasks_a_second(workers, 2000)
        print(f"| {workers} | {rate:,.0f} | {SHARE * rate * CHUNK_SECONDS:,.0f} |", flush=True)


if __name__ == "__main__":
    main()
