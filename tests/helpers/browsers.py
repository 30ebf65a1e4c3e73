"""A headless Chromium spoken to by its DevTools protocol: pages opened, scripts run, keys pressed."""

import json
import shutil
import subprocess
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path
from urllib.request import urlopen

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None
)
_FLAGS = "--headless --no-sandbox --disable-gpu --no-first-run --disable-dev-shm-usage --window-size=1280,800"
_KEYS = {"ArrowRight": 39, "ArrowLeft": 37, "Enter": 13}


_CONTRASTS = """(() => {
  const numbers = colour => {
    const context = Object.assign(document.createElement("canvas"), {width: 1, height: 1}).getContext("2d");
    context.fillStyle = colour;
    context.fillRect(0, 0, 1, 1);
    return [...context.getImageData(0, 0, 1, 1).data];
  };
  const light = rgb => {
    const [r, g, b] = rgb.slice(0, 3).map(v => (v /= 255) <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const behind = element => {
    for (; element; element = element.parentElement) {
      const found = numbers(getComputedStyle(element).backgroundColor);
      if (found[3] === 255) return found;
    }
    return [255, 255, 255];
  };
  return Object.fromEntries([...document.querySelectorAll(SELECTOR)].map((element, index) => {
    const both = [light(numbers(getComputedStyle(element)[PROPERTY])), light(behind(element))];
    const text = `${index} ${(element.value || element.textContent).slice(0, 30)}`;
    return [text, (Math.max(...both) + 0.05) / (Math.min(...both) + 0.05)];
  }));
})()"""


def contrasts(selector, style="color"):
    """A script: of every element of a selector the contrast of a colour of its style with what is behind it, from
    1 to 21, as WCAG 2.2 defines it."""
    return _CONTRASTS.replace("SELECTOR", json.dumps(selector)).replace("PROPERTY", json.dumps(style))


class Tab:
    """A tab of its own browser context, as another visitor has; ``failures``: its errors, ``asked``: URLs it
    asked for."""

    def __init__(self, address, domains=("Page", "Runtime", "Network", "Log")):
        from websockets.sync.client import connect

        self._socket = connect(address, max_size=1 << 28, open_timeout=30, ping_interval=None)
        self._number = 0
        self.failures: list[str] = []
        self.asked: list[str] = []
        for domain in domains:
            self.call(f"{domain}.enable")

    def call(self, method, **parameters):
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            told = json.loads(self._socket.recv(timeout=60))
            if told.get("id") == self._number:
                assert "error" not in told, told
                return dict(told["result"])
            self._note(told.get("method"), told.get("params", {}))

    def _note(self, method, what):
        if method == "Runtime.exceptionThrown":
            self.failures.append(str(what["exceptionDetails"].get("exception", what["exceptionDetails"])))
        elif method == "Log.entryAdded" and what["entry"]["level"] == "error":
            self.failures.append(f"{what['entry']['text']} {what['entry'].get('url', '')}")
        elif method == "Network.requestWillBeSent":
            self.asked.append(what["request"]["url"])

    def open(self, url):
        self.call("Page.navigate", url=url)

    def run(self, script):
        """The value of an expression, awaited."""
        told = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in told, told["exceptionDetails"]
        return told["result"].get("value")

    def until(self, script, seconds=60):
        """Wait for an expression to be true; returns its value."""
        end = time.monotonic() + seconds
        told = "value instanceof Node ? true : value"  # an element has no value of its own here
        tried = f"try {{ const value = {script}; return {told}; }} catch {{ return null; }}"
        while not (value := self.run(f"(() => {{ {tried} }})()")):
            assert time.monotonic() < end, f"not within {seconds} s: {script}; failures: {self.failures}"
            time.sleep(0.05)
        return value

    def press(self, key):
        text = {"text": "\r"} if key == "Enter" else {}
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, windowsVirtualKeyCode=_KEYS[key], **text)

    def close(self):
        self._socket.close()


class Browser:
    """A Chromium; ``tab`` opens a visitor's own."""

    def __init__(self, port):
        self._port = port
        with urlopen(f"http://127.0.0.1:{port}/json/version", timeout=30) as answer:
            self._all = Tab(json.load(answer)["webSocketDebuggerUrl"], ())

    def tab(self):
        context = self._all.call("Target.createBrowserContext")["browserContextId"]
        target = self._all.call("Target.createTarget", url="about:blank", browserContextId=context)
        return Tab(f"ws://127.0.0.1:{self._port}/devtools/page/{target['targetId']}")


@contextmanager
def browser():
    """A Chromium for as long as it is used."""
    with tempfile.TemporaryDirectory(prefix="blurnoise-browser-", ignore_cleanup_errors=True) as folder:
        words = [str(CHROMIUM), *_FLAGS.split(), "--remote-debugging-port=0", f"--user-data-dir={folder}"]
        process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            said, end = Path(folder, "DevToolsActivePort"), time.monotonic() + 60
            while not (said.is_file() and said.read_text().strip()):
                assert process.poll() is None, "Chromium does not start"
                assert time.monotonic() < end, "Chromium does not say where it is"
                time.sleep(0.05)
            yield Browser(int(said.read_text().split()[0]))
        finally:
            process.terminate()
            process.wait(30)
