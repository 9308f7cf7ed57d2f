# PYTHON_ARGCOMPLETE_OK
"""The command ``nablahog``, also as ``python -m nablahog``."""

from __future__ import annotations

import os
import sys

from .cli.interruption import end_at_interrupt


def main() -> int:
    """Runs the command; Ctrl-C while modules are imported prints no traceback, either."""
    if getattr(sys, "frozen", False):  # of a program as PyInstaller makes it, each worker process starts here
        from multiprocessing import freeze_support

        freeze_support()
    end_at_interrupt()
    # threads that wait actively take many times as long if other programs use the processors;
    # OpenMP reads this when PyTorch is loaded
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    from .cli.main import main as run

    return run()


if __name__ == "__main__":
    sys.exit(main())
