"""The long profile, ``make fuzz``: every target, in parts that run side by side, and a table of what happened.

Each part is a process of its own with a seed of its own, so that the end of one is a fault like others.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from importlib import import_module
from typing import Any, NamedTuple

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from .harness import KINDS, Report, campaign

TARGETS = {"operator": 20_000, "inversions": 2_000, "files": 20_000, "kills": 100}
"""Cases of each in about half an hour on two cores."""
PART = {"operator": 1_000, "inversions": 100, "files": 2_500, "kills": 25}
"""Cases of a process."""
SILENCE = 600.0  # seconds without a word from a part, after which it hangs
# fresh memory is full of large numbers, where it is glibc's: what is read before it is written shows
_ENVIRONMENT = {"MALLOC_PERTURB_": "128", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


class Part(NamedTuple):
    """So many cases of a target, from a seed."""

    target: str
    count: int
    seed: int


def _run(part: Part) -> None:
    """Prints, as JSON lines, what becomes of a part; the last line is its report."""
    module: Any = import_module(f".{part.target}", __package__)

    def shown(report: Report) -> None:
        print(json.dumps({"done": report.cases}), flush=True)

    def check(case: Any) -> str:
        print(json.dumps({"case": repr(case)}), flush=True)
        outcome: str = module.check(case)
        return outcome

    report = campaign(check, module.cases, part.count, part.seed, shown)
    figures = module.figures() if hasattr(module, "figures") else {}
    if hasattr(module, "close"):
        module.close()
    faults = [(kind, message, repr(case)) for kind, message, case in report.faults]
    print(json.dumps({"outcomes": report.outcomes, "faults": faults, "figures": figures}))


def _while_it_talks(process: subprocess.Popen[str]) -> Iterator[str]:
    """The lines that a process prints; it is ended by a signal, SIGALRM, if it is silent for long."""
    assert process.stdout is not None
    while True:
        alarm = threading.Timer(SILENCE, process.send_signal, [signal.SIGALRM])
        alarm.start()
        line = process.stdout.readline()
        alarm.cancel()
        if not line:
            return
        yield line


class _Watch:
    """Runs parts, and adds up what they report."""

    def __init__(self, bars: Progress, tasks: dict[str, Any]) -> None:
        self.bars, self.tasks = bars, tasks
        self.cases: Counter[str] = Counter()
        self.outcomes: dict[str, Counter[str]] = {target: Counter() for target in tasks}
        self.faults: dict[str, list[list[str]]] = {target: [] for target in tasks}
        self.figures: dict[str, dict[str, str]] = {target: {} for target in tasks}
        self.seconds: Counter[str] = Counter()

    def run(self, part: Part) -> None:
        began, case, done, report = time.monotonic(), "", 0, None
        command = [sys.executable, "-m", __package__, "--part", *map(str, part)]
        with tempfile.TemporaryFile() as errors:
            process = subprocess.Popen(
                command, stdout=subprocess.PIPE, stderr=errors, text=True, env={**os.environ, **_ENVIRONMENT}
            )
            for line in _while_it_talks(process):
                message = json.loads(line)
                case = message.get("case", case)
                if "outcomes" in message:
                    report = message
                if "done" in message:
                    self.bars.advance(self.tasks[part.target], message["done"] - done)
                    done = message["done"]
            status = process.wait()
            if report is None:
                errors.seek(max(errors.seek(0, os.SEEK_END) - 2000, 0))
                told = errors.read().decode(errors="replace")
                kind = "hung" if status == -signal.SIGALRM else "crashed"
                self.faults[part.target].append([kind, f"{part}: exit status {status}: {told}", case])
        self.cases[part.target] += done
        self.seconds[part.target] += round(time.monotonic() - began)
        if report:
            self.outcomes[part.target].update(report["outcomes"])
            self.faults[part.target] += report["faults"]
            for name, figure in report["figures"].items():
                best = self.figures[part.target].get(name, "0")
                self.figures[part.target][name] = max(best, figure, key=lambda text: float(text.split()[0]))


def _table(watch: _Watch) -> Table:
    table = Table("target", "cases", "seconds", "what happened", *KINDS, "of refused files")
    for target, outcomes in watch.outcomes.items():
        kinds = Counter(fault[0] for fault in watch.faults[target])
        told = ", ".join(f"{outcome} {count:,}" for outcome, count in sorted(outcomes.items()))
        figures = "; ".join(text.split(":")[0] for text in watch.figures[target].values())
        cells = f"{watch.cases[target]:,}", f"{watch.seconds[target]:,}", told, *(str(kinds[kind]) for kind in KINDS)
        table.add_row(target, *cells, figures)
    return table


def main(argv: Sequence[str] | None = None) -> int:
    """Returns 0 if there was no fault, else 1."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"of {', '.join(TARGETS)}; all by default")
    parser.add_argument("--share", type=float, default=1.0, help="of the number of cases, by default 1")
    parser.add_argument("--seed", type=int, default=int(time.time()), help="by default the time")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes, by default one a core")
    parser.add_argument("--part", nargs=3, metavar=("TARGET", "COUNT", "SEED"), help=argparse.SUPPRESS)
    arguments = parser.parse_args(argv)
    if unknown := set(arguments.targets) - set(TARGETS):
        parser.error(f"expected targets of {', '.join(TARGETS)}, got {', '.join(sorted(unknown))}")
    if arguments.part:
        target, count, seed = arguments.part
        _run(Part(target, int(count), int(seed)))
        return 0
    console, parts = Console(width=None if sys.stdout.isatty() else 140), []
    counts = {each: max(1, round(TARGETS[each] * arguments.share)) for each in arguments.targets or TARGETS}
    for target, count in counts.items():
        for number, first in enumerate(range(0, count, PART[target])):
            parts.append(Part(target, min(PART[target], count - first), arguments.seed + number))
    with Progress(console=Console(stderr=True)) as bars, ThreadPoolExecutor(arguments.jobs) as pool:
        watch = _Watch(bars, {target: bars.add_task(target, total=count) for target, count in counts.items()})
        for finished in as_completed([pool.submit(watch.run, part) for part in parts]):
            finished.result()
    console.print(_table(watch))
    console.print(f"seed {arguments.seed}")
    for target, faults in watch.faults.items():
        for kind, message, case in faults:
            console.print(f"{target}: {kind}: {message}\n    {case}", markup=False, soft_wrap=True)
    for figures in watch.figures.values():
        for name, figure in figures.items():
            console.print(f"largest {name} of a refused file: {figure}", markup=False, soft_wrap=True)
    return int(any(watch.faults.values()))


if __name__ == "__main__":
    sys.exit(main())
