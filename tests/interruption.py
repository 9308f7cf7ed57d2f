"""Ctrl-C at a step of long work."""

from __future__ import annotations


class Interruption:
    """To be called with the progress: it interrupts when ``at`` steps are done, or never."""

    def __init__(self, at: int | None = None) -> None:
        self.at = at
        self.steps: list[int] = []

    def __call__(self, done: int, total: int, what: str) -> None:
        if done == self.at:
            raise KeyboardInterrupt
        self.steps.append(done)
