"""A headless Chromium spoken to by its DevTools protocol: pages opened, keys pressed, files chosen."""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from urllib.request import urlopen

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None
)
_FLAGS = "--headless --no-sandbox --disable-gpu --no-first-run --disable-dev-shm-usage --window-size=1280,800"
_KEYS: Mapping[str, int] = {"ArrowRight": 39, "ArrowLeft": 37, "Enter": 13}


class Tab:
    """A tab of its own browser context, as another visitor has; ``failures``: its errors, ``asked``: URLs it
    asked for."""

    def __init__(self, address: str) -> None:
        self._open(address)
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")

    def _open(self, address: str) -> None:
        from websockets.sync.client import connect

        self._opened = ExitStack()
        self._socket = self._opened.enter_context(
            connect(address, max_size=1 << 28, open_timeout=30, ping_interval=None)
        )
        self._number = 0
        self.failures: list[str] = []
        self.asked: list[str] = []

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            told = json.loads(self._socket.recv(timeout=60))
            if told.get("id") == self._number:
                assert "error" not in told, told
                return dict(told["result"])
            self._note(told)

    def _note(self, told: dict[str, Any]) -> None:
        method, what = told.get("method"), told.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.failures.append(str(what["exceptionDetails"].get("exception", what["exceptionDetails"])))
        elif method == "Log.entryAdded" and what["entry"]["level"] == "error":
            self.failures.append(f"{what['entry']['text']} {what['entry'].get('url', '')}")
        elif method == "Network.requestWillBeSent":
            self.asked.append(what["request"]["url"])

    def open(self, url: str) -> None:
        self.call("Page.navigate", url=url)

    def run(self, script: str) -> Any:
        """The value of an expression, awaited."""
        told = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in told, told["exceptionDetails"]
        return told["result"].get("value")

    def until(self, script: str, seconds: float = 60) -> Any:
        """Wait for an expression to be true; returns its value."""
        end = time.monotonic() + seconds
        while True:
            told = "value instanceof Node ? true : value"  # an element has no value of its own here
            tried = f"try {{ const value = {script}; return {told}; }} catch {{ return null; }}"
            value = self.run(f"(() => {{ {tried} }})()")
            if value:
                return value
            assert time.monotonic() < end, f"not within {seconds} s: {script}; failures: {self.failures}"
            time.sleep(0.05)

    def press(self, key: str) -> None:
        code = _KEYS.get(key, 0)
        text = {} if code and key != "Enter" else {"text": "\r" if key == "Enter" else key}
        for kind in ("keyDown", "keyUp"):
            self.call(
                "Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code, **text
            )

    def click(self, selector: str) -> None:
        at = self.run(
            f"(() => {{ const e = document.querySelector({selector!r}); e.scrollIntoView({{block: 'center'}});"
            " const b = e.getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2]; })()"
        )
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=at[0], y=at[1], button="left", clickCount=1)

    def close(self) -> None:
        self._opened.close()


class Browser:
    """A Chromium; ``tab`` opens a visitor's own."""

    def __init__(self, port: int) -> None:
        self._port = port
        with urlopen(f"http://127.0.0.1:{port}/json/version", timeout=30) as answer:
            self._all = Tab.__new__(Tab)  # the browser itself, which has no page
            self._all._open(json.load(answer)["webSocketDebuggerUrl"])
        self._tabs: list[Tab] = []

    def tab(self) -> Tab:
        context = self._all.call("Target.createBrowserContext")["browserContextId"]
        target = self._all.call("Target.createTarget", url="about:blank", browserContextId=context)[
            "targetId"
        ]
        tab = Tab(f"ws://127.0.0.1:{self._port}/devtools/page/{target}")
        self._tabs.append(tab)
        return tab

    def close(self) -> None:
        for tab in self._tabs:
            tab.close()
        self._all.close()


@contextmanager
def browser() -> Iterator[Browser]:
    """A Chromium for as long as it is used."""
    folder = Path(tempfile.mkdtemp(prefix="blurnoise-browser-"))
    words = [
        str(CHROMIUM),
        *_FLAGS.split(),
        "--remote-debugging-port=0",
        f"--user-data-dir={folder}",
        "about:blank",
    ]
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        said = folder / "DevToolsActivePort"
        end = time.monotonic() + 60
        while not (said.is_file() and said.read_text().strip()):
            assert process.poll() is None, "Chromium does not start"
            assert time.monotonic() < end, "Chromium does not say where it is"
            time.sleep(0.05)
        found = Browser(int(said.read_text().split()[0]))
        try:
            yield found
        finally:
            found.close()
    finally:
        process.terminate()
        process.wait(30)
        shutil.rmtree(folder, ignore_errors=True)
