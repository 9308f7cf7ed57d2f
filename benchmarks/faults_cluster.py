"""A Dask cluster that faults.py disturbs: its network can be cut, its workers killed or made to allocate too much."""

from __future__ import annotations

import json
import os
import random
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

from resume import descendants

MEMORY = 1300  # megabytes of a worker
POISONED = 10  # one in so many jobs
PRELOAD = """
import hashlib, os, pickle, signal, sys, threading, time
from pathlib import Path
FOLDER = Path({folder!r})

def allocate():
    while True:
        time.sleep(0.1)
        for wish in FOLDER.glob("allocate-*"):
            try:
                wish.rename(FOLDER / f"granted-{{os.getpid()}}-{{wish.name}}")
            except OSError:
                continue
            hold = bytearray(os.urandom(1 << 20) * 2500)
            time.sleep(60)

def dask_setup(worker):
    threading.Thread(target=allocate, daemon=True).start()
    from nablahog.jobs import cluster
    real = cluster.attempt
    def attempt(job):
        if (FOLDER / "poison").exists():
            key = job.key() if callable(job.key) else job.key
            if int(hashlib.sha256(key.encode()).hexdigest(), 16) % {poisoned} == 0:
                os.kill(os.getpid(), signal.SIGKILL)
        return real(job)
    cluster.attempt = attempt
"""


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
        self.folder, self.lock = folder, threading.Lock()
        (folder / "preload.py").write_text(PRELOAD.format(folder=str(folder), poisoned=POISONED))
        self.processes: list[subprocess.Popen[bytes]] = []
        self.begin()
        threading.Thread(target=self._replace_workers, daemon=True).start()

    def begin(self) -> None:
        with self.lock:
            self._begin()

    def _begin(self) -> None:
        self.end()
        file = self.folder / "scheduler.json"
        file.unlink(missing_ok=True)
        self._start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file))
        while not file.exists() or not file.read_text().strip().endswith("}"):
            time.sleep(0.05)
        self.proxy = Proxy(int(json.loads(file.read_text())["address"].rpartition(":")[2]))
        self.address = f"tcp://127.0.0.1:{self.proxy.port}"
        self._start_workers()

    def _start_workers(self) -> None:
        preload = ["--preload", str(self.folder / "preload.py"), "--local-directory", str(self.folder / "local")]
        limits = ["--nworkers", "2", "--nthreads", "1", "--memory-limit", f"{MEMORY}MB", "--no-dashboard"]
        self._start("worker", self.address, *limits, *preload, "--host", "127.0.0.1")

    def _start(self, what: str, *options: str) -> None:
        command = [sys.executable, "-m", f"distributed.cli.dask_{what}", *options]
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1"}
        with open(self.folder / f"{what}.log", "ab") as log:
            self.processes.append(subprocess.Popen(command, stdout=log, stderr=log, env=environment, cwd=self.folder))

    def _replace_workers(self) -> None:
        """A nanny whose worker is killed while it starts ends, too; whatever has started it starts it again."""
        while True:
            time.sleep(0.5)
            with self.lock:
                if [process.poll() is None for process in self.processes] == [True, False]:
                    self.processes.pop()
                    self._start_workers()

    def end(self) -> None:
        for process in reversed(self.processes):
            below = descendants(process.pid)
            for pid in (process.pid, *below):
                with suppress(OSError):
                    os.kill(pid, signal.SIGKILL)
            process.wait()
        self.processes.clear()

    def alive(self) -> bool:
        return self.processes[0].poll() is None

    def workers(self) -> list[int]:
        """The processes that compute."""
        found = []
        for pid in descendants(self.processes[1].pid):
            with suppress(OSError):
                if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes():
                    found.append(pid)
        return found

    def kill_worker(self, rng: random.Random) -> bool:
        workers = self.workers()
        if workers:
            with suppress(OSError):
                os.kill(rng.choice(workers), signal.SIGKILL)
        return bool(workers)

    def allocate(self, rng: random.Random) -> bool:
        """Whether a worker has allocated too much; Dask sees to it."""
        wish = self.folder / f"allocate-{rng.random()}"
        wish.touch()
        time.sleep(1)
        granted = not wish.exists()
        wish.unlink(missing_ok=True)
        return granted
