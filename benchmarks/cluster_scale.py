"""How many workers one scheduler and one client keep busy: jobs that sleep, on up to 1,000 workers of this machine.

    python benchmarks/cluster_scale.py [--workers 10 100 300 1000] [--seconds 0.5 2 5] [--time 30]

Workers are Dask's own, many to a process, and a job sleeps, so that it takes a thread and no processor: what is
measured is what the scheduler, the client and the network between them take.  Efficiency: seconds of sleeping, over
those of all workers from the first job's beginning to the last one's end.  The processor seconds of the scheduler and
of the client are those of their processes, for a chunk; neither uses more than one core, so their inverse bounds the
chunks a second.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from nablahog.jobs import cluster

HOSTED = 125  # workers of a process
TICKS = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Sleep:
    """Sleeps for some seconds; its result is when it began and ended."""

    seconds: float
    number: int

    def run(self) -> tuple[float, float]:
        """As :class:`nablahog.jobs.store.Work`."""
        began = time.time()
        time.sleep(self.seconds)
        return began, time.time()


async def host(file: str, count: int) -> None:
    """Runs workers in this process until it is killed."""
    from distributed import Worker

    workers = [Worker(scheduler_file=file, nthreads=1, memory_limit=0, dashboard=False) for _ in range(count)]
    await asyncio.gather(*workers)
    await asyncio.gather(*(worker.finished() for worker in workers))


@contextmanager
def counted_chunks() -> Iterator[list[int]]:
    """The sizes of the chunks that are sent in the block."""
    sizes: list[int] = []
    following = cluster._Waiting.next

    def next_chunk(self: cluster._Waiting, threads: int, alone: bool) -> list[int]:
        chunk = following(self, threads, alone)
        if chunk:
            sizes.append(len(chunk))
        return chunk

    cluster._Waiting.next = next_chunk  # type: ignore[method-assign]
    yield sizes
    cluster._Waiting.next = following  # type: ignore[method-assign]


def processor_seconds(pid: int) -> float:
    """That a process has used, by /proc."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


@contextmanager
def scheduler(workers: int) -> Iterator[tuple[str, int]]:
    """The file of a scheduler with so many workers, and its process."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "scheduler.json")
        python, quiet = [sys.executable], {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder}
        options = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
        processes = [subprocess.Popen([*python, "-m", "distributed.cli.dask_scheduler", *options], **quiet)]  # type: ignore[call-overload]
        while not file.exists() or not file.read_text().strip().endswith("}"):
            time.sleep(0.1)
        for first in range(0, workers, HOSTED):
            count = str(min(HOSTED, workers - first))
            processes.append(subprocess.Popen([*python, __file__, "--host", str(file), count], **quiet))  # type: ignore[call-overload]
        try:
            from distributed import Client

            with Client(scheduler_file=str(file), timeout=60) as client:
                client.wait_for_workers(workers, timeout=300)
            yield str(file), processes[0].pid
        finally:
            for process in processes:
                process.kill()
                process.wait()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, nargs="*", default=[10, 100, 300, 1000])
    parser.add_argument("--seconds", type=float, nargs="*", default=[0.5, 2, 5], help="of a job")
    parser.add_argument("--time", type=float, default=30, help="seconds of each measurement, at full efficiency")
    parser.add_argument("--host", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.host:
        asyncio.run(host(options.host[0], int(options.host[1])))
        return
    print(
        "| workers | seconds of a job | jobs | chunks | efficiency | chunks/s | scheduler ms/chunk | client ms/chunk |"
    )
    print("|---:|---:|---:|---:|---:|---:|---:|---:|")
    for workers in options.workers:
        with scheduler(workers) as (file, pid):
            for seconds in options.seconds:
                _measure(file, pid, workers, seconds, max(1, round(options.time / seconds)))


def _measure(file: str, pid: int, workers: int, seconds: float, each: int) -> None:
    jobs = [Sleep(seconds, number) for number in range(workers * each)]
    before = processor_seconds(pid), time.process_time()
    with counted_chunks() as chunks:
        times = [answer for _, answer in cluster.run_on_cluster(jobs, cluster=file) if not isinstance(answer, str)]
    used = processor_seconds(pid) - before[0], time.process_time() - before[1]
    began, ended = min(one for one, _ in times), max(two for _, two in times)
    count = len(chunks)
    efficiency = len(times) * seconds / (workers * (ended - began))
    cells = [workers, f"{seconds:g}", len(jobs), count, f"{efficiency:.3f}", f"{count / (ended - began):,.0f}"]
    print(f"| {' | '.join(map(str, [*cells, *(f'{1000 * each / count:.2f}' for each in used)]))} |", flush=True)


if __name__ == "__main__":
    main()
