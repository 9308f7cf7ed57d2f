"""Disturbs commands on a Dask cluster in every way that clusters are disturbed, and compares their results.

    python benchmarks/faults.py [--faults 100] [--kinds worker memory …] [--commands table1 table2 hog] [--seed 0]

Each command runs once undisturbed, on the processes of this machine; then on a cluster with faults at random moments,
repeated until it ends, until there have been so many faults of a kind.  In the end its files must have the same bytes.
Of each kind and command it prints the faults, how often the command was run and came to its end, how many ends had
the same bytes, and the results that were lost (missing in the end) and doubled (stored twice).

    worker     a worker gets SIGKILL
    memory     a worker allocates more than it may; Dask ends it
    scheduler  the scheduler gets SIGKILL; a new cluster is started
    client     the command itself gets SIGKILL
    network    all connections to the scheduler are cut, and refused for a second
    poison     jobs that kill their worker each time: they must be named as failures, and only they; then they are cured
    disk       the output is on a full disk (a tmpfs: needs root); then it is larger
    clients    two of the same command run at a time

Needs /proc (Linux).
"""

from __future__ import annotations

import argparse
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from PIL import Image

from faults_cluster import Cluster

KINDS = ("worker", "memory", "scheduler", "client", "network", "poison", "disk", "clients")
COMMANDS = ("table1", "table2", "hog")
IMAGES = {"table1": 20, "hog": 300}
FULL, ENOUGH = {"table1": "150k", "table2": "60k", "hog": "250k"}, "200m"
LONGEST = 1800.0  # seconds of a run; more is an error


@dataclass
class Tally:
    """Of a kind of fault and a command."""

    faults: int = 0
    runs: int = 0
    ends: int = 0
    same: int = 0
    lost: int = 0
    doubled: int = 0
    seconds: float = field(default_factory=time.monotonic)


class Command:
    """A command with its inputs, and the files of an undisturbed run."""

    def __init__(self, name: str, folder: Path) -> None:
        self.name, self.folder = name, folder
        images = folder / "images"
        images.mkdir(parents=True)
        for k in range(IMAGES.get(name, 0)):
            levels = np.random.default_rng(k).integers(0, 256, (6, 6), dtype=np.uint8)
            Image.fromarray(levels).resize((32, 32), Image.Resampling.BICUBIC).save(images / f"{k:03d}.png")
        self.arguments = {
            "table1": ["--images", str(images), "--methods", "dalal-single,uoctti-single,skimage",
                       "--max-evaluations", "3"],
            "table2": ["--objects", "24", "--methods", "exhaustive,best", "--conditions", "none"],
            "hog": [str(images), "--shard", "10", "--preset", "dpm"],
        }[name]  # fmt: skip
        self.run(folder / "undisturbed", "--workers", "2").wait()
        self.expected = self.files(folder / "undisturbed")
        assert self.expected

    def run(self, out: Path, *more: str) -> subprocess.Popen[bytes]:
        target = out / "set.parquet" if self.name == "hog" else out
        command = [sys.executable, "-m", "nablahog", self.name, *self.arguments, "-o", str(target), "-q", *more]
        with open(self.folder / "log", "ab") as log:
            return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=log)

    def files(self, out: Path) -> dict[str, bytes]:
        """All that must not differ: not the times."""
        found = {path.name: path.read_bytes() for path in (*out.glob("*.csv"), *out.glob("set.parquet/*"))}
        found.pop("times.csv", None)
        if "per_object.csv" in found:  # whose last column is the time
            lines = found["per_object.csv"].splitlines()
            found["per_object.csv"] = b"\n".join(line.rpartition(b",")[0] for line in lines)
        return found

    def stored(self, out: Path) -> int:
        """Results on disk, parts of some included."""
        return sum(path.is_file() for path in (*out.glob("work/*/*"), *out.glob("set.parquet/*")))

    def failures(self, out: Path) -> str:
        return (out / "failures.csv").read_text()


def disturb(kind: str, cluster: Cluster, client: subprocess.Popen[bytes], rng: random.Random) -> bool:
    """Whether there was a fault."""
    if client.poll() is not None:
        return False
    if kind == "worker":
        return cluster.kill_worker(rng)
    if kind == "memory":
        return cluster.allocate(rng)
    if kind == "scheduler":
        cluster.processes[0].kill()
    elif kind == "client":
        client.kill()
    elif kind == "network":
        cluster.proxy.cut(1.0)
    return True


def measured(kind: str, command: Command, cluster: Cluster, faults: int, rng: random.Random) -> Tally:
    tally = Tally()
    total = command.stored(command.folder / "undisturbed")
    while tally.faults < faults:
        out = Path(tempfile.mkdtemp(dir=command.folder))
        if kind in ("poison", "disk", "clients"):
            ONCE[kind](command, cluster, out, tally)
        else:
            _until_it_ends(kind, command, cluster, out, tally, faults, rng)
        files, stored = command.files(out), command.stored(out)
        tally.ends += 1
        tally.same += files == command.expected
        tally.lost += max(0, total - stored)
        tally.doubled += max(0, stored - total)
        if files != command.expected:
            print(f"  differ: {out}: {sorted(n for n in command.expected if files.get(n) != command.expected[n])}")
        else:
            shutil.rmtree(out)
    tally.seconds = time.monotonic() - tally.seconds
    return tally


def _until_it_ends(
    kind: str, command: Command, cluster: Cluster, out: Path, tally: Tally, faults: int, rng: random.Random
) -> None:
    pause = {"worker": (0.3, 2), "memory": (0.5, 2), "network": (2, 8)}.get(kind, (2.5, 8))
    while True:
        client = command.run(out, "--cluster", cluster.address)
        tally.runs += 1
        began = time.monotonic()
        while client.poll() is None:
            assert time.monotonic() - began < LONGEST
            with suppress(subprocess.TimeoutExpired):
                client.wait(rng.uniform(*pause))
            if tally.faults < faults:
                tally.faults += disturb(kind, cluster, client, rng)
            if kind in ("scheduler", "client"):
                client.wait(LONGEST)
        if not cluster.alive():
            cluster.begin()
        if client.returncode == 0:
            return


def _poison(command: Command, cluster: Cluster, out: Path, tally: Tally) -> None:
    (cluster.folder / "poison").touch()
    client = command.run(out, "--cluster", cluster.address)
    client.wait(LONGEST)
    (cluster.folder / "poison").unlink()
    expected = int(command.name == "hog")
    assert client.returncode == expected, (command.folder / "log").read_text()[-2000:]
    if command.name == "hog":
        missing = len(command.expected) - len(command.files(out))
    else:
        missing = command.failures(out).count("the process at work on it died, 2 times")
    assert missing, "no job was poisoned"
    tally.faults += missing
    _finish(command, cluster, out, tally)


def _disk(command: Command, cluster: Cluster, out: Path, tally: Tally) -> None:
    with mounted(out, FULL[command.name]) as enlarge:
        client = command.run(out, "--cluster", cluster.address)
        assert client.wait(LONGEST) != 0, "the disk was large enough"
        tally.faults += 1
        enlarge()
        _finish(command, cluster, out, tally)
        kept = out.with_name(f"{out.name}-kept")
        shutil.copytree(out, kept)
    shutil.rmtree(out)
    kept.rename(out)


@contextmanager
def mounted(folder: Path, size: str) -> Iterator[Callable[[], object]]:
    """A small file system, and a function that makes it large."""
    options = f"size={size}"
    subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)], check=True)
    try:
        yield lambda: subprocess.run(["mount", "-o", f"remount,size={ENOUGH}", str(folder)], check=True)
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def _clients(command: Command, cluster: Cluster, out: Path, tally: Tally) -> None:
    clients = [command.run(out, "--cluster", cluster.address) for _ in range(2)]
    tally.runs += 1
    tally.faults += 1
    statuses = [client.wait(LONGEST) for client in clients]
    if statuses != [0, 0]:
        print(f"  two clients: exit status {statuses}")
        _finish(command, cluster, out, tally)


def _finish(command: Command, cluster: Cluster, out: Path, tally: Tally) -> None:
    tally.runs += 2
    client = command.run(out, "--cluster", cluster.address)
    assert client.wait(LONGEST) == 0, (command.folder / "log").read_text()[-2000:]


ONCE = {"poison": _poison, "disk": _disk, "clients": _clients}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--faults", type=int, default=100, help="of each kind and command, at least")
    parser.add_argument("--kinds", nargs="*", default=KINDS, choices=KINDS)
    parser.add_argument("--commands", nargs="*", default=COMMANDS, choices=COMMANDS)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = random.Random(options.seed)
    with tempfile.TemporaryDirectory(prefix="nablahog-faults-") as name:
        folder = Path(name)
        (folder / "cluster").mkdir()
        commands = [Command(each, folder / each) for each in options.commands]
        cluster = Cluster(folder / "cluster")
        print("| fault | command | faults | runs | ends | the same bytes | lost | doubled | seconds |")
        print("|---|---|---:|---:|---:|---:|---:|---:|---:|")
        try:
            for kind in options.kinds:
                for command in commands:
                    of = measured(kind, command, cluster, options.faults, rng)
                    counts = f"{of.faults} | {of.runs} | {of.ends} | {of.same} | {of.lost} | {of.doubled}"
                    print(f"| {kind} | {command.name} | {counts} | {of.seconds:.0f} |", flush=True)
        finally:
            cluster.end()


if __name__ == "__main__":
    main()
