"""The command `nablahog app`: its one line, its page, and its errors."""

from __future__ import annotations

import re
import signal
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Callable
from pathlib import Path

import pytest

from nablahog.app.server import listen


@pytest.mark.slow
def test_it_serves_until_it_is_interrupted(photo: str) -> None:
    command = [sys.executable, "-m", "nablahog", "app", "--port", "0", photo]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        address = re.fullmatch(r"The page is at (http://127\.0\.0\.1:\d+/) until Ctrl-C\n", line)
        assert address is not None, line
        with urllib.request.urlopen(address[1]) as page:
            assert "∇HOG" in page.read().decode()
        with urllib.request.urlopen(f"{address[1]}api/about") as about:
            assert b'"photo-0","name":"cat.png","width":80' in about.read()
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=30)
    assert (process.returncode, errors) in ((0, ""), (130, "nablahog app: error: interrupted\n"))


def test_what_it_refuses(refused: Callable[..., None], tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        refused("app", "--port", port, message="; --port 0 takes a free one")
    with pytest.raises(ValueError, match=r"^cannot listen at 192\.0\.2\.1, port 0: [^;]*$"):
        listen("192.0.2.1", 0)  # an address of no machine
    refused("app", "--port", "70000", message="--port must be an integer in 0 … 65,535, got 70000", status=2)
    (tmp_path / "x.png").write_bytes(b"x")
    refused("app", str(tmp_path / "x.png"), message="expected an image, got a file that is none")
