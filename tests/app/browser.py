"""A real browser on the page: headless Chromium, and the server in a thread."""

from __future__ import annotations

import json
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import uvicorn
from selenium import webdriver
from selenium.common.exceptions import WebDriverException
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.support.ui import WebDriverWait

from nablahog.app.access import AccessRules
from nablahog.app.server import listen, make_app

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")
# without these, Chromium asks its maker's hosts for things that a test does not need
QUIET = (
    *("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage", "--hide-scrollbars"),
)
WAIT = 60.0  # seconds, for whatever is waited for: a machine may be busy


@contextmanager
def serving() -> Iterator[str]:
    """The address of a server that runs meanwhile."""
    listening = listen("127.0.0.1", 0)
    host = f"127.0.0.1:{listening.getsockname()[1]}"
    app = make_app(AccessRules(frozenset({host}), None))
    server = uvicorn.Server(uvicorn.Config(app, log_level="error", ws="websockets-sansio", timeout_graceful_shutdown=1))
    thread = threading.Thread(target=server.run, args=([listening],))
    thread.start()
    try:
        yield f"http://{host}/"
    finally:
        server.should_exit = True
        thread.join()
        listening.close()


class Page:
    """A page of the browser.

    Args:
        driver: of the browser.
        address: of the server.
    """

    def __init__(self, driver: webdriver.Chrome, address: str) -> None:
        self.driver, self.address = driver, address

    def open(self, fragment: str = "") -> None:
        """The page anew, at a state of its address."""
        self.driver.get("about:blank")
        self.driver.get(f"{self.address}{fragment}")
        self.until("document.body.dataset.ready === 'true'")

    def until(self, condition: str) -> None:
        """Waits until an expression of JavaScript is true."""
        WebDriverWait(self.driver, WAIT, poll_frequency=0.05).until(
            lambda driver: driver.execute_script(f"return Boolean({condition})"), condition
        )

    def read(self, expression: str) -> Any:
        """The value of an expression of JavaScript."""
        return self.driver.execute_script(f"return {expression}")

    def click(self, selector: str) -> None:
        """Clicks an element, once it can be."""
        self.until(f"document.querySelector({json.dumps(f'{selector}:enabled:not([aria-disabled=true])')})")
        self.driver.execute_script("document.querySelector(arguments[0]).click()", selector)

    def enter(self, selector: str, value: object) -> None:
        """Sets the value of a control as a user does."""
        self.driver.execute_script(
            "const control = document.querySelector(arguments[0]); control.value = arguments[1];"
            "for (const kind of ['input', 'change']) control.dispatchEvent(new Event(kind, {bubbles: true}));",
            selector,
            str(value),
        )

    def press(self, selector: str, key: str) -> None:
        """A key, on an element with the focus."""
        self.driver.execute_script(
            "const element = document.querySelector(arguments[0]); element.focus();"
            "element.dispatchEvent(new KeyboardEvent('keydown', {key: arguments[1], bubbles: true}));",
            selector,
            key,
        )

    def text(self, selector: str) -> str:
        """What an element says."""
        said: str = self.read(f"document.querySelector({json.dumps(selector)}).textContent")
        return said

    def idle(self) -> None:
        """Waits until nothing is under way."""
        self.until("document.body.dataset.busy === 'false'")

    def requested(self) -> list[str]:
        """The addresses that were asked for since the last call."""
        messages = [json.loads(entry["message"])["message"] for entry in self.driver.get_log("performance")]  # type: ignore[no-untyped-call]
        return [each["params"]["request"]["url"] for each in messages if each["method"] == "Network.requestWillBeSent"]

    def complaints(self) -> list[str]:
        """What the console says of errors since the last call."""
        entries = self.driver.get_log("browser")  # type: ignore[no-untyped-call]
        return [entry["message"] for entry in entries if entry["level"] in ("SEVERE", "WARNING")]


@contextmanager
def browsing(folder: Path, width: int = 1280, height: int = 900, dark: bool = False) -> Iterator[webdriver.Chrome]:
    """A browser with a profile in an empty folder; downloads come there, too."""
    options = Options()
    assert CHROMIUM is not None
    assert DRIVER is not None
    options.binary_location = CHROMIUM
    for argument in (*QUIET, f"--user-data-dir={folder}/profile", f"--window-size={width},{height}"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"performance": "ALL", "browser": "ALL"})
    options.add_experimental_option("prefs", {"download.default_directory": str(folder / "downloads")})
    try:
        driver = webdriver.Chrome(options, Service(DRIVER))
    except WebDriverException as error:
        pytest.skip(f"Chromium does not start: {error.msg}")
    try:
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
        driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        features = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
        yield driver
    finally:
        driver.quit()
