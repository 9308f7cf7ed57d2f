"""Sentences of errors."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from nablahog.runtime.errors import explain


def test_errors_of_the_system_name_the_file_once_and_no_number(tmp_path: Path) -> None:
    missing = tmp_path / "it's missing.obj"
    for file in (missing, bytes(missing)):
        with pytest.raises(FileNotFoundError) as caught:
            os.stat(file)
        assert explain(caught.value) == f"{missing}: no such file or directory"
    assert explain(OSError(errno.ENOSPC, "No space left on device")) == "no space left on device"
    assert explain(FileNotFoundError("a.png: no such file")) == "a.png: no such file"
    assert explain(ValueError("No numbers")) == "No numbers"
