"""The arguments of ``nablahog warmup``."""

from __future__ import annotations

import argparse

from . import options
from .options import Parser
from .preset_parameters import PRESETS

STEPS = (*PRESETS, "reconstruct", "pose")


def warmup(commands: argparse._SubParsersAction[Parser]) -> None:
    """Adds ``nablahog warmup``."""
    command = commands.add_parser(
        "warmup",
        help="compile all loops now, for later calls",
        description="Compiles the loops of hog and its derivative for all presets, float32 and float64, gray and "
        "colour (uint8 takes those of float32), of reconstruct and of pose, and keeps them in the folder that it "
        "prints. Later processes load them. NABLAHOG_CACHE_DIR names another folder, in a container one that the "
        "image keeps.",
    )
    command.add_argument("steps", nargs="*", metavar="STEP", help=f"only these, of {', '.join(STEPS)}; by default all")
    command.add_argument(
        "--portable",
        action="store_true",
        help="not for this processor alone, but for all that have one of its levels (x86-64-v3, x86-64-v4): for "
        "containers and wheels",
    )
    options.quiet(command)
