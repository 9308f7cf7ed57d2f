"""What does a Dask cluster cost beside the processes of this machine, and how many workers does a scheduler keep busy?

    python benchmarks/cluster.py [--seconds 0.001 0.01 0.1 0.5] [--workers 1 2] [--scale 10 100 300 1000] [--time 10]

Efficiency: seconds of the jobs, over those of all workers from the first job's beginning to the last one's end.  First
jobs compute, on this machine's processes and on Dask's.  Then they sleep, so that they take a thread and no processor,
on many workers, Dask's own, many to a process: what is measured is what the scheduler, the client and the network
between them take.  The processor seconds of the scheduler and of the client are those of their processes; neither uses
more than one core, so that their inverse bounds the jobs a second.
"""

from __future__ import annotations

import argparse
import asyncio
import hashlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from nablahog.jobs.runner import run_jobs
from nablahog.jobs.store import JobResult
from nablahog.jobs.worker import Work
from timing import table

Runner: TypeAlias = Callable[[Sequence[Work[JobResult]]], Iterator[Any]]
HOSTED = 125  # workers of a process
UNWATCHED = {"distributed.worker.profile.enabled": False, "distributed.admin.system-monitor.interval": "1 day"}


@dataclass(frozen=True)
class Timed:
    """Computes for some seconds of the processor, without Python's lock, as loops and PyTorch do; or sleeps."""

    seconds: float
    number: int
    asleep: bool

    def run(self) -> JobResult:
        """As :class:`nablahog.jobs.worker.Work`; the figures are when it began and ended."""
        began, end = time.time(), time.thread_time() + self.seconds
        if self.asleep:
            time.sleep(self.seconds)
        while not self.asleep and time.thread_time() < end:
            hashlib.sha256(bytes(2**17))
        return JobResult([{"began": began, "ended": time.time()}], np.zeros((1, 1), np.uint8), self.seconds)


def efficiency(run: Runner, seconds: float, workers: int, length: float, asleep: bool = False) -> tuple[float, int]:
    """Of jobs of so many seconds, for about ``length`` seconds; and how many jobs there were."""
    count = max(workers if asleep else 20, round(length * workers / seconds))
    jobs: list[Work[JobResult]] = [Timed(seconds, number, asleep) for number in range(count)]
    figures = [outcome.figures[0] for _, outcome in run(jobs)]
    elapsed: float = max(each["ended"] for each in figures) - min(each["began"] for each in figures)
    return count * seconds / (workers * elapsed), count


async def host(file: str, count: int) -> None:
    """Runs workers in this process until it is killed."""
    import dask
    from distributed import Worker

    # what each of them does beside its jobs, on a core of its own elsewhere, would take all of this machine
    dask.config.set(UNWATCHED)
    workers = [Worker(scheduler_file=file, nthreads=1, memory_limit=0, dashboard=False) for _ in range(count)]
    await asyncio.gather(*workers)
    await asyncio.gather(*(worker.finished() for worker in workers))


def processor_seconds(pid: int) -> float:
    """Processor seconds that a process has used, by /proc."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def scheduler(workers: int) -> Iterator[tuple[str, int]]:
    """The file of a scheduler with so many workers, and its process."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "scheduler.json")
        options = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
        commands = [["-m", "distributed.cli.dask_scheduler", *options]]
        counts = (min(HOSTED, workers - first) for first in range(0, workers, HOSTED))
        commands += [[__file__, "--host", str(file), str(count)] for count in counts]
        nowhere, processes = subprocess.DEVNULL, []
        try:
            for command in commands:
                started = subprocess.Popen([sys.executable, *command], stdout=nowhere, stderr=nowhere, cwd=folder)
                processes.append(started)
                while not file.exists() or not file.read_text().strip().endswith("}"):
                    time.sleep(0.1)
            from distributed import Client

            with Client(scheduler_file=str(file), timeout=60) as client:
                client.wait_for_workers(workers, timeout=1200)
            yield str(file), processes[0].pid
        finally:
            for process in processes:
                process.kill()
                process.wait()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, nargs="*", default=[0.001, 0.01, 0.1, 0.5], help="of a job")
    parser.add_argument("--workers", type=int, nargs="*", default=[1, 2], help="that compute")
    parser.add_argument("--scale", type=int, nargs="*", default=[10, 100, 300, 1000], help="workers that sleep")
    parser.add_argument("--time", type=float, default=10.0, help="seconds of each measurement")
    parser.add_argument("--host", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.host:
        asyncio.run(host(options.host[0], int(options.host[1])))
        return
    rows = []
    for workers in options.workers:
        for seconds in options.seconds:
            ours, _ = efficiency(partial(run_jobs, workers=workers), seconds, workers, options.time)
            on_dask = partial(run_jobs, workers=workers, cluster=f"local:{workers}")
            dask, _ = efficiency(on_dask, seconds, workers, options.time)
            rows.append([f"{seconds:g}", str(workers), f"{ours:.3f}", f"{dask:.3f}"])
    print(table(["seconds of a job", "workers", "processes", "Dask"], rows), flush=True)
    rows = []
    for workers in options.scale:
        with scheduler(workers) as (file, pid):
            for seconds in (0.5, 2.0, 5.0):
                before = processor_seconds(pid), time.process_time()
                run = partial(run_jobs, workers=workers, cluster=file)
                share, count = efficiency(run, seconds, workers, options.time, True)
                used = processor_seconds(pid) - before[0], time.process_time() - before[1]
                each = (f"{1000 * spent / count:.2f}" for spent in used)
                rows.append([str(workers), f"{seconds:g}", str(count), f"{share:.3f}", *each])
    head = ["workers", "seconds of a job", "jobs", "efficiency", "scheduler ms a job", "client ms a job"]
    print(f"\n{table(head, rows)}")


if __name__ == "__main__":
    main()
