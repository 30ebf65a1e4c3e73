"""How soon the explorer shows what a slider asks for: from the slider's input event to the painted picture, in a
headless Chromium on this machine.

``python tests/helpers/explorer_latency.py`` prints median and 90th percentile, ms, of a picture of 1280 x 720 px
while a slider moves and once it rests, what the server computes for it, ms of core time, and the machine's load,
which the times by the clock hang on.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import browsers
import cv2
from blurnoise_eval.datasets import rendered_signs, write_picture

SIZE_PX = (1280, 720)
MOVES = 40
_WATCHED = """(() => {
  let moved = 0, awaited = {};
  window.painted = kind => new Promise((told, late) => {
    awaited = {[kind]: told};
    setTimeout(late, 30000, "not painted");
  });
  const after = paint => requestAnimationFrame(() => {
    const next = new MessageChannel();
    next.port1.onmessage = paint;
    next.port2.postMessage(0);
  });
  addEventListener("pointermove", event => { moved = event.timeStamp; }, true);
  const image = document.querySelector(".seen img");
  new MutationObserver(() => {
    const kind = image.src.startsWith("data:") ? "preview" : "full";
    const since = () => awaited[kind]?.(performance.now() - moved);
    image.decode().catch(() => 0).then(() => after(since));
  }).observe(image, {attributes: true, attributeFilter: ["src"]});
})()"""


def measured(tab: browsers.Tab, server: int) -> dict[str, list[float]]:
    """Of each move, ms: until its picture is painted while moves go on, in full at rest; the server's core time."""
    tab.run(_WATCHED)
    box = tab.run(
        "document.querySelector('[data-control=velocity_x_px_s] .q-slider').getBoundingClientRect().toJSON()"
    )

    def point(kind: str, share: float) -> None:
        at: dict[str, Any] = {"x": box["x"] + box["width"] * share, "y": box["y"] + box["height"] / 2}
        tab.call("Input.dispatchMouseEvent", type=kind, button="left", buttons=1, clickCount=1, **at)

    point("mousePressed", 0.3)
    found: dict[str, list[float]] = {"moving": [], "at rest": [], "core": []}
    for kind, counted in (("preview", MOVES), ("full", MOVES // 4)):
        time.sleep(3)
        for move in range(counted):
            before = _core_ms(server)
            tab.run(f"window.next = painted({kind!r}), 0")
            point("mouseMoved", 0.3 + 0.4 * (move % 20 + 1) / 20)
            taken = float(tab.run("next"))
            found["moving" if kind == "preview" else "at rest"].append(taken)
            if kind == "preview":
                found["core"].append(_core_ms(server) - before)
                time.sleep(0.05 + 0.01 * (move % 5))  # moves come at any time of what is being computed
    return found


def _core_ms(process: int) -> float:
    told = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return 1e3 * (int(told[11]) + int(told[12])) / os.sysconf("SC_CLK_TCK")


def main() -> None:
    """Measure and print."""
    with TemporaryDirectory() as folder, browsers.browser() as browser:
        photo = Path(folder) / "photo.png"
        write_picture(
            photo, cv2.resize(next(iter(rendered_signs())).load(), SIZE_PX, interpolation=cv2.INTER_CUBIC)
        )
        words = [sys.executable, "-m", "blurnoise_eval.cli", "explore", str(photo), "--no-browser"]
        with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
            try:
                assert process.stdout is not None
                address = re.search(r"http://\S+", process.stdout.readline())
                assert address, "the explorer does not start"
                tab = browser.tab()
                tab.open(address[0])
                tab.until("document.querySelector('.seen img')?.naturalWidth")
                tab.until("document.querySelector('.numbers dd') && !document.querySelector('.busy')")
                load = os.getloadavg()[0]
                found = measured(tab, process.pid)
            finally:
                process.terminate()
    for what, values in found.items():
        high = sorted(values)[int(0.9 * len(values))]
        print(
            f"{what:8s} median {median(values):4.0f} ms, 90 % within {high:4.0f} ms, of {len(values)} moves"
        )
    print(f"load {load:.1f} to {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
