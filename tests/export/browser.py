"""Headless Chromium, spoken to in plain WebDriver, and a file server for its pages."""

import base64
import functools
import http.server
import json
import shutil
import socket
import subprocess
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

ELEMENT = "element-6066-11e4-a52e-4f735466cecf"  # of the standard
ARGUMENTS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-dev-shm-usage", "--use-fake-device-for-media-stream",
    "--use-fake-ui-for-media-stream",
)  # fmt: skip
TAB, ENTER = "\ue004", "\ue007"


def missing() -> str | None:
    """Why no browser can be started here."""
    absent = [name for name in ("chromium", "chromedriver") if shutil.which(name) is None]
    return f"no {absent[0]} on the PATH" if absent else None


class Browser:
    """One session of a browser."""

    def __init__(self, base: str, session: str) -> None:
        self.base = f"{base}/session/{session}"

    def call(self, path: str, **body: Any) -> Any:
        return post(f"{self.base}/{path}", body)

    def open(self, url: str) -> None:
        self.call("url", url=url)

    def run(self, script: str, *arguments: object) -> Any:
        return self.call("execute/sync", script=script, args=list(arguments))

    def find(self, selector: str) -> str:
        found = self.call("element", using="css selector", value=selector)
        return found[ELEMENT]

    def type(self, selector: str, text: str) -> None:
        """Type into an element; of a file input, the path of the file."""
        self.call(f"element/{self.find(selector)}/value", text=text)

    def press(self, *keys: str) -> None:
        """Press keys wherever the focus is."""
        strokes = [{"type": kind, "value": key} for key in keys for kind in ("keyDown", "keyUp")]
        self.call("actions", actions=[{"type": "key", "id": "keyboard", "actions": strokes}])

    def click(self, selector: str) -> None:
        self.call(f"element/{self.find(selector)}/click")

    def text(self, selector: str) -> str:
        return self.run("return document.querySelector(arguments[0]).textContent", selector)

    def wait(self, script: str, seconds: float = 60) -> Any:
        """Wait until a script gives something true, and return it."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if found := self.run(script):
                return found
            time.sleep(0.05)
        raise AssertionError(f"{script} was never true; the page says: {self.text('body')}")

    def log(self) -> list[str]:
        """What the console has said since the last call."""
        return [entry["message"] for entry in self.call("se/log", type="browser")]

    def picture(self, path: Path, width: int, height: int) -> None:
        self.call("goog/cdp/execute", cmd="Emulation.setDeviceMetricsOverride", params={
            "width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600,
        })  # fmt: skip
        time.sleep(0.3)
        shot = self.call("goog/cdp/execute", cmd="Page.captureScreenshot",
                         params={"captureBeyondViewport": True})  # fmt: skip
        path.write_bytes(base64.b64decode(shot["data"]))


def post(url: str, body: dict[str, Any]) -> Any:
    request = urllib.request.Request(url, json.dumps(body).encode(), {"Content-Type": "json"})
    try:
        with urllib.request.urlopen(request, timeout=120) as answer:
            return json.load(answer)["value"]
    except urllib.error.HTTPError as error:
        raise AssertionError(json.load(error)["value"]["message"]) from error


@contextmanager
def browser(profile: Path) -> Iterator[Browser]:
    """Start a browser with a profile folder of its own."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    driver = subprocess.Popen(
        ["chromedriver", f"--port={port}"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    base = f"http://127.0.0.1:{port}"
    options = {"args": [*ARGUMENTS, f"--user-data-dir={profile}"]}
    wanted = {"goog:chromeOptions": options, "goog:loggingPrefs": {"browser": "ALL"}}
    try:
        session = _session(base, {"capabilities": {"alwaysMatch": wanted}})
        found = Browser(base, session["sessionId"])
        try:
            yield found
        finally:
            urllib.request.urlopen(urllib.request.Request(found.base, method="DELETE")).close()
    finally:
        driver.terminate()
        driver.wait(10)


def _session(base: str, body: dict[str, Any]) -> Any:
    for _ in range(100):
        try:
            return post(f"{base}/session", body)
        except urllib.error.URLError:  # the driver is not listening yet
            time.sleep(0.05)
    raise AssertionError("chromedriver did not start")


class Quiet(http.server.SimpleHTTPRequestHandler):
    """A plain file server that keeps its log to itself."""

    def log_message(self, *_: object) -> None:
        pass


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """The address of a folder on a plain file server."""
    handler = functools.partial(Quiet, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://localhost:{server.server_port}/"
        server.shutdown()
