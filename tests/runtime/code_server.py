"""A process that calls two compiled functions in a fresh child for each question, without loading Numba anew."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

FUNCTIONS = """
import numpy as np
from nablahog.runtime.compile import compiled

@compiled
def total(x):
    result = 0.0
    for k in range(len(x)):
        result += x[k]
    return result

@compiled
def power(x, k):
    return x**k
"""
SERVER = """
import os, pathlib, sys, traceback, resource
import numba.core.registry
import nablahog.runtime.machine_code
from nablahog.runtime.cache_folder import VARIABLE
from numba.core.registry import cpu_target

cpu_target.target_context.refresh()
cpu_target.typing_context.refresh()
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

def answer(folder, limit, shipped):
    import numpy as np
    os.umask(0)
    os.environ[VARIABLE] = folder
    if shipped:
        nablahog.runtime.machine_code.SHIPPED = pathlib.Path(shipped)
    if limit:
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(limit),) * 2)
    import functions
    results = functions.total(np.arange(4.0)), functions.power(3, 4)
    both = functions.total, functions.power
    print(*results, sum(sum(each.from_python().stats.cache_hits.values()) for each in both), flush=True)

for line in sys.stdin:
    sys.stdout.flush()
    child = os.fork()
    if not child:
        status = 1
        try:
            answer(*line[:-1].split("\\t"))
            status = 0
        except BaseException:
            traceback.print_exc(file=sys.stdout)
        finally:
            sys.stdout.flush()
            os._exit(status)
    print("ended", os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


class Answer(NamedTuple):
    """What a child did.

    Attributes:
        status: its exit status, negative for a signal.
        text: what it printed: ``6.0 81`` and how many of the two functions it read from disk.
    """

    status: int
    text: str


class CodeServer:
    """The process.

    Args:
        folder: for the module with the functions.
        environment: variables beside those of this process.
    """

    def __init__(self, folder: Path, environment: Mapping[str, str] | None = None) -> None:
        self.folder = folder
        (folder / "functions.py").write_text(FUNCTIONS)
        self.process = subprocess.Popen(
            [sys.executable, "-B", "-c", SERVER],
            cwd=folder,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, "PYTHONFAULTHANDLER": "", **(environment or {})},
        )

    def ask(self, cache: Path, largest: int | None = None, shipped: Path | None = None) -> Answer:
        """Calls the functions in a child.

        Args:
            cache: ``NABLAHOG_CACHE_DIR``.
            largest: bytes of a file, where the disk shall be full.
            shipped: the folder for machine code in the package.
        """
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(f"{cache}\t{'' if largest is None else largest}\t{shipped or ''}\n")
        self.process.stdin.flush()
        lines = []
        for line in self.process.stdout:
            if line.startswith("ended "):
                return Answer(int(line.split()[1]), "".join(lines).strip())
            lines.append(line)
        raise AssertionError("".join(lines))

    def close(self) -> None:
        """Ends the process."""
        self.process.kill()
        self.process.communicate()
