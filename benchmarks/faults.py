"""Are results the same after faults of every kind on a cluster?

    python benchmarks/faults.py [--faults 100] [--kinds worker …] [--commands table1 table2 hog] [--seed 0]

Each command runs once undisturbed, on the processes of this machine; then on a cluster with faults at random moments,
repeated until it ends, until there have been so many faults of a kind.  In the end its files must have the same bytes.
Of each kind and command it prints the faults, how often the command was run and came to its end, and how many ends had
the same bytes.

    worker     a worker gets SIGKILL
    scheduler  the scheduler gets SIGKILL; a new cluster is started
    client     the command itself gets SIGKILL
    network    all connections to the scheduler are cut, and refused for a second

Needs /proc (Linux).
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
from PIL import Image

PAUSES = {"worker": (0.3, 2.0), "scheduler": (2.5, 8.0), "client": (2.5, 8.0), "network": (2.0, 8.0)}  # seconds
IMAGES = {"table1": 20, "hog": 300}
LONGEST = 1800.0  # seconds of a run; more is an error


def descendants(pid: int) -> list[int]:
    """The processes that ``pid`` started."""
    try:
        threads = list(Path(f"/proc/{pid}/task").glob("*/children"))
        children = [int(child) for thread in threads for child in thread.read_text().split()]
    except OSError:
        return []
    return children + [below for child in children for below in descendants(child)]


class Proxy(threading.Thread):
    """Passes connections on to a port, until they are cut."""

    def __init__(self, target: int) -> None:
        super().__init__(daemon=True)
        self.target, self.open, self.sockets = target, True, list[socket.socket]()
        self.server = socket.create_server(("127.0.0.1", 0))
        self.port: int = self.server.getsockname()[1]
        self.start()

    def run(self) -> None:
        while True:
            with suppress(OSError):
                one, _ = self.server.accept()
                if not self.open:
                    one.close()
                    continue
                other = socket.create_connection(("127.0.0.1", self.target))
                self.sockets += [one, other]
                for ends in ((one, other), (other, one)):
                    threading.Thread(target=self._pass, args=ends, daemon=True).start()

    def _pass(self, source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(1 << 16):
                sink.sendall(data)
        for end in (source, sink):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def cut(self, seconds: float) -> None:
        self.open = False
        for each in self.sockets:
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
        self.sockets.clear()
        time.sleep(seconds)
        self.open = True


class Cluster:
    """A scheduler behind a proxy, and two workers, whose nannies start them again."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.processes: list[subprocess.Popen[bytes]] = []
        self.begin()

    def begin(self) -> None:
        self.end()
        file = self.folder / "scheduler.json"
        file.unlink(missing_ok=True)
        self._start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file))
        while not file.exists() or not file.read_text().strip().endswith("}"):
            time.sleep(0.05)
        self.proxy = Proxy(int(json.loads(file.read_text())["address"].rpartition(":")[2]))
        self.address = f"tcp://127.0.0.1:{self.proxy.port}"
        limits = ["--nworkers", "2", "--nthreads", "1", "--no-dashboard", "--host", "127.0.0.1"]
        self._start("worker", self.address, *limits, "--local-directory", str(self.folder / "local"))

    def _start(self, what: str, *options: str) -> None:
        command = [sys.executable, "-m", f"distributed.cli.dask_{what}", *options]
        with open(self.folder / f"{what}.log", "ab") as log:
            environment = {**os.environ, "OMP_NUM_THREADS": "1"}
            self.processes.append(subprocess.Popen(command, stdout=log, stderr=log, env=environment, cwd=self.folder))

    def end(self) -> None:
        for process in reversed(self.processes):
            for pid in (process.pid, *descendants(process.pid)):
                with suppress(OSError):
                    os.kill(pid, signal.SIGKILL)
            process.wait()
        self.processes.clear()

    def alive(self) -> bool:
        return all(process.poll() is None for process in self.processes)

    def kill_worker(self, rng: random.Random) -> bool:
        """Kills a worker; returns whether there was one."""
        workers = []
        for pid in descendants(self.processes[1].pid):
            with suppress(OSError):
                if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes():
                    workers.append(pid)
        if workers:
            with suppress(OSError):
                os.kill(rng.choice(workers), signal.SIGKILL)
        return bool(workers)


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
            "table1": ["--images", str(images), "--methods", "dalal-single,uoctti-single", "--max-evaluations", "3"],
            "table2": ["--objects", "24", "--methods", "exhaustive,best", "--conditions", "none"],
            "hog": [str(images), "--preset", "dpm"],
        }[name]
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


def disturb(kind: str, cluster: Cluster, client: subprocess.Popen[bytes], rng: random.Random) -> bool:
    """Causes a fault; returns whether there was one."""
    if client.poll() is not None:
        return False
    if kind == "worker":
        return cluster.kill_worker(rng)
    if kind == "network":
        cluster.proxy.cut(1.0)
    else:
        (client if kind == "client" else cluster.processes[0]).kill()
    return True


def measured(kind: str, command: Command, cluster: Cluster, wanted: int, rng: random.Random) -> str:
    """The cells of the table's row."""
    faults, runs, ends, same = 0, 0, 0, 0
    while faults < wanted:
        out, status = Path(tempfile.mkdtemp(dir=command.folder)), 1
        while status:
            client = command.run(out, "--cluster", cluster.address)
            runs, began = runs + 1, time.monotonic()
            while client.poll() is None:
                assert time.monotonic() - began < LONGEST
                with suppress(subprocess.TimeoutExpired):
                    client.wait(rng.uniform(*PAUSES[kind]))
                faults += faults < wanted and disturb(kind, cluster, client, rng)
                if kind in ("scheduler", "client"):
                    client.wait(LONGEST)
            status = client.returncode
            if not cluster.alive():
                cluster.begin()
        ends += 1
        same += command.files(out) == command.expected
        shutil.rmtree(out)
    return f"{faults} | {runs} | {ends} | {same}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--faults", type=int, default=100, help="least number of faults of each kind and command")
    parser.add_argument("--kinds", nargs="*", default=[*PAUSES], choices=PAUSES)
    parser.add_argument("--commands", nargs="*", default=["table1", "table2", "hog"])
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = random.Random(options.seed)
    with tempfile.TemporaryDirectory(prefix="nablahog-faults-") as folder:
        Path(folder, "cluster").mkdir()
        commands = [Command(each, Path(folder, each)) for each in options.commands]
        cluster = Cluster(Path(folder, "cluster"))
        print("| fault | command | faults | runs | ends | the same bytes |\n|---|---|---:|---:|---:|---:|")
        try:
            for kind in options.kinds:
                for command in commands:
                    cells = measured(kind, command, cluster, options.faults, rng)
                    print(f"| {kind} | {command.name} | {cells} |", flush=True)
        finally:
            cluster.end()


if __name__ == "__main__":
    main()
