"""Headless Chromium, driven through the DevTools protocol: pages, clicks, keys, screenshots, requests."""

from __future__ import annotations

import base64
import contextlib
import itertools
import json
import shutil
import subprocess
import time
from typing import TYPE_CHECKING, Any, Self

import websocket

if TYPE_CHECKING:
    from pathlib import Path

NAMES = ("chromium", "chromium-browser", "google-chrome")
FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage", "--mute-audio",
    "--remote-debugging-port=0",
)  # fmt: skip
PATIENCE = 60.0  # [s]


def find_chromium() -> str | None:
    """Path of the browser, or None."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


class Page:
    """One tab.

    Parameters
    ----------
    program : str
        From `find_chromium`.
    profile : Path
        A folder for the browser's own files.
    """

    def __init__(self, program: str, profile: Path) -> None:
        self.requests: list[str] = []
        self.problems: list[str] = []
        self._numbers = itertools.count(1)
        command = [program, *FLAGS, f"--user-data-dir={profile}", "about:blank"]
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            port, path = _wait_for(profile / "DevToolsActivePort").split()
            self._socket = websocket.create_connection(
                f"ws://127.0.0.1:{port}{path}", timeout=PATIENCE, suppress_origin=True
            )
        except BaseException:
            self._stop()
            raise
        self._session: str | None = None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Network", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()
        self._stop()

    def _stop(self) -> None:
        self._process.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(10)
            return
        self._process.kill()
        self._process.wait()

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send one command and return its result."""
        number = next(self._numbers)
        message: dict[str, Any] = {"id": number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        self._socket.send(json.dumps(message))
        while True:
            answer = json.loads(self._socket.recv())
            if answer.get("id") == number:
                assert "error" not in answer, f"{method}: {answer['error']}"
                result: dict[str, Any] = answer["result"]
                return result
            self._note(answer)

    def open(self, path: Path) -> None:
        """Load a file, and wait until it and its pictures are there."""
        self.requests.clear()
        self.problems.clear()
        self.call("Page.navigate", url=path.as_uri())
        address = json.dumps(path.as_uri())
        loaded = f"location.href === {address} && document.readyState === 'complete'"
        deadline = time.monotonic() + PATIENCE
        while not self.ask(loaded):
            assert time.monotonic() < deadline, f"{path} was not loaded in {PATIENCE:g} s"
            time.sleep(0.02)
        self.ask(
            "Promise.all([...document.images].filter((one) => one.src).map((one) => one.decode())).then(() => 1)"
        )

    def ask(self, expression: str) -> Any:
        """Value of a JavaScript expression; a promise is awaited."""
        told = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in told, told["exceptionDetails"]
        return told["result"].get("value")

    def resize(self, width: int, height: int, *, dark: bool = False, touch: bool = False) -> None:
        """Show the page as a screen of that size would."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=touch,
        )
        self.call("Emulation.setTouchEmulationEnabled", enabled=touch, maxTouchPoints=2 if touch else 1)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])

    def choose(self, name: str, value: str) -> None:
        """Choose an option of a select element."""
        words = json.dumps([name, value])
        self.ask(
            "(([name, value]) => { const one = document.getElementById(name); one.value = value;"
            f"one.dispatchEvent(new Event('change')); }})({words})"
        )

    def centre(self, selector: str) -> tuple[float, float]:
        """Middle of an element, scrolled into view [CSS pixel]."""
        box = self.ask(
            f"(() => {{ const one = document.querySelector({json.dumps(selector)});"
            "one.scrollIntoView({block: 'center', behavior: 'instant'}); const box = one.getBoundingClientRect();"
            "return [box.left + box.width / 2, box.top + box.height / 2]; })()"
        )
        return float(box[0]), float(box[1])

    def drag(self, start: tuple[float, float], stop: tuple[float, float]) -> None:
        """Press the mouse, move it, and let go."""
        middle = ((start[0] + stop[0]) / 2, (start[1] + stop[1]) / 2)
        self._mouse("mouseMoved", start)
        self._mouse("mousePressed", start)
        self._mouse("mouseMoved", middle)
        self._mouse("mouseMoved", stop)
        self._mouse("mouseReleased", stop)

    def swipe(self, start: tuple[float, float], stop: tuple[float, float]) -> None:
        """Drag a finger."""
        middle = ((start[0] + stop[0]) / 2, (start[1] + stop[1]) / 2)
        for kind, place in (
            ("touchStart", start),
            ("touchMove", middle),
            ("touchMove", stop),
            ("touchEnd", None),
        ):
            points = [] if place is None else [{"x": place[0], "y": place[1]}]
            self.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)

    def press(self, key: str) -> None:
        """Press and release a key that has a name, such as ArrowLeft, or one character."""
        written = {"text": key} if len(key) == 1 else {}
        self.call("Input.dispatchKeyEvent", type="keyDown", key=key, **written)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key)

    def screenshot(self, path: Path, *, whole: bool = True) -> None:
        """Write a PNG of the whole page, or of what the window shows."""
        told = self.call(
            "Page.captureScreenshot", format="png", captureBeyondViewport=whole, **self._clip(whole)
        )
        path.write_bytes(base64.b64decode(told["data"]))

    def _clip(self, whole: bool) -> dict[str, Any]:
        if not whole:
            return {}
        size = self.call("Page.getLayoutMetrics")["cssContentSize"]
        return {"clip": {"x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1}}

    def _mouse(self, kind: str, place: tuple[float, float]) -> None:
        buttons = 0 if kind == "mouseReleased" else 1
        self.call(
            "Input.dispatchMouseEvent",
            type=kind, x=place[0], y=place[1], button="left", buttons=buttons, clickCount=1,
        )  # fmt: skip

    def _note(self, event: dict[str, Any]) -> None:
        """Keep requests, errors and complaints."""
        told = event.get("params", {})
        if event.get("method") == "Network.requestWillBeSent":
            self.requests.append(told["request"]["url"])
        elif event.get("method") == "Runtime.exceptionThrown":
            self.problems.append(str(told["exceptionDetails"]))
        elif event.get("method") == "Log.entryAdded" and told["entry"]["level"] in ("error", "warning"):
            self.problems.append(told["entry"]["text"])


def _wait_for(path: Path) -> str:
    """Content of a file that appears."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        with contextlib.suppress(FileNotFoundError):
            content = path.read_text(encoding="utf-8")
            if len(content.split()) == 2:
                return content
        time.sleep(0.02)
    raise AssertionError(f"the browser did not start in {PATIENCE:g} s")
