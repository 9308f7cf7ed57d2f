"""Kills `nablahog table1` at random moments and compares its tables with those of an undisturbed run.

    python benchmarks/resume.py [--kills 10] [--images DIR] [--limit N] [--methods a,b] [--seed 0]

Each round starts the command and, after a random time, kills either it or, first, one of its workers and then it, with
SIGKILL; then no process of it may be left.  When a round gets to the end before that, per_image.csv and summary.csv
must have the same bytes as those of the undisturbed run, and the next round begins anew; so must they in the end.
Needs /proc (Linux).
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path


def descendants(pid: int) -> list[int]:
    """The processes that ``pid`` started."""
    try:
        threads = list(Path(f"/proc/{pid}/task").glob("*/children"))
        children = [int(child) for thread in threads for child in thread.read_text().split()]
    except OSError:
        return []
    return children + [below for child in children for below in descendants(child)]


def running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_until_gone(pids: list[int]) -> float:
    """The seconds until none of ``pids`` runs; fails after half a minute."""
    began = time.monotonic()
    while left := [pid for pid in pids if running(pid)]:
        if time.monotonic() - began > 30:
            sys.exit(f"processes left after 30 s: {left}")
        time.sleep(0.05)
    return time.monotonic() - began


def disturbed(command: list[str], after: float, worker_first: bool) -> str | None:
    """Starts the command, kills it ``after`` seconds, and says how; None if it had come to its end."""
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        with suppress(subprocess.TimeoutExpired):
            process.wait(after)
            return None
        before = descendants(process.pid)
        if worker_first and before:
            os.kill(before[-1], signal.SIGKILL)
            with suppress(subprocess.TimeoutExpired):
                process.wait(1)
        pids = descendants(process.pid)
        process.kill()
    gone = wait_until_gone([*before, *pids])
    return f"killed{' after a worker' if worker_first else ''}, its {len(pids)} processes gone in {gone:.2f} s"


def compare(one: Path, other: Path) -> None:
    for name in ("per_image.csv", "summary.csv"):
        if (one / name).read_bytes() != (other / name).read_bytes():
            sys.exit(f"{name} differs")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--images", help="folder of images; by default those that come with scikit-image")
    parser.add_argument("--limit", type=int, default=4, help="only the first N images")
    parser.add_argument("--methods", default="dalal-single,uoctti-single")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    options = parser.parse_args()

    command = [sys.executable, "-m", "nablahog", "table1", "--limit", str(options.limit), "--methods", options.methods]
    command += ["--images", options.images] if options.images else []
    with tempfile.TemporaryDirectory() as temporary:
        undisturbed, killed = Path(temporary, "undisturbed"), Path(temporary, "killed")
        began = time.monotonic()
        subprocess.run([*command, "-o", str(undisturbed)], check=True, stdout=subprocess.DEVNULL)
        whole = time.monotonic() - began
        print(f"undisturbed: {whole:.1f} s", flush=True)
        chance, kills = random.Random(options.seed), 0
        while kills < options.kills:
            after = chance.uniform(0.1, 0.8) * whole
            what = disturbed([*command, "-o", str(killed)], after, chance.random() < 0.4)
            if what is None:
                compare(undisturbed, killed)
                shutil.rmtree(killed)
                print("came to the end: the same tables; anew", flush=True)
                continue
            kills += 1
            stored = len(list(killed.glob("work/*/*.npz")))
            print(f"{kills}: {after:.1f} s, {what}, {stored} results stored", flush=True)
        subprocess.run([*command, "-o", str(killed)], check=True, stdout=subprocess.DEVNULL)
        compare(undisturbed, killed)
    print("the same tables")


if __name__ == "__main__":
    main()
