"""The explorer in a real browser: what sliders, files, keys and two visitors do; skipped where there is no
Chromium."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import browsers
import numpy as np
import pytest
from blurnoise_eval import SweepPlan, evaluate
from blurnoise_eval.cli import main
from blurnoise_eval.datasets import encode, read_picture, rendered_signs, write_picture
from browsers import Browser, Tab

pytest.importorskip("nicegui")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(browsers.CHROMIUM is None, reason="no Chromium on this machine"),
]
ENVIRONMENT = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST")}
"""NiceGUI does otherwise where it finds pytest's."""
SHOWN = "document.querySelector('.seen img').src"
IDLE = "!document.querySelector('.busy')"
READY = (
    "document.querySelector('.seen img')?.naturalWidth && document.querySelector('.numbers dd') "
    "&& / (or more|tried) /.test(document.querySelector('.window').innerText)"
)


@contextmanager
def served(*words: object) -> Iterator[str]:
    """The explorer's address, with its token."""
    command = [sys.executable, "-m", "blurnoise_eval.cli", "explore", "--no-browser", *map(str, words)]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT
    )
    try:
        assert process.stdout is not None
        assert process.stderr is not None
        said = process.stdout.readline()
        threading.Thread(target=process.stderr.read, daemon=True).start()
        found = re.search(r"http://127\.0\.0\.1:\d+/\S+", said)
        assert found, said
        yield found[0]
        assert process.poll() is None, "the explorer has ended"
    finally:
        process.terminate()
        process.wait(30)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with browsers.browser() as found:
        yield found


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with served() as found:
        yield found


@pytest.fixture
def tab(browser: Browser, address: str) -> Iterator[Tab]:
    """Opened at the start; whatever a test does, the page has no error, and asks nobody but the explorer."""
    tab = browser.tab()
    tab.open(address)
    tab.until(READY)
    yield tab
    assert tab.failures == []
    assert [url for url in tab.asked if not url.startswith((base(address), "data:", "blob:", "about:"))] == []
    tab.close()


def base(address: str) -> str:
    """Less the query."""
    return address.partition("?")[0]


def changes(tab: Tab, act: object) -> str:
    """What is shown once it is another picture, in full."""
    before = tab.run(SHOWN)
    act()  # type: ignore[operator]
    shown = str(tab.until(f"{SHOWN} !== {before!r} && {IDLE} && {SHOWN}"))
    while True:  # the image takes the last picture when it has loaded the one before
        time.sleep(0.3)
        latest = str(tab.until(f"{IDLE} && {SHOWN}"))
        if latest == shown:
            return shown
        shown = latest


def text(tab: Tab, selector: str) -> str:
    return str(tab.run(f"document.querySelector({selector!r})?.innerText ?? ''"))


def slide(tab: Tab, name: str, key: str = "ArrowRight", times: int = 1) -> None:
    tab.run(f"document.querySelector('[data-control={name}] .q-slider [tabindex]').focus()")
    for _ in range(times):
        tab.press(key)


def test_the_first_screen_answers(tab: Tab) -> None:
    assert re.match(r"Keeps \d+ % of its confidence in the original .*, \d of 3 found", text(tab, "h1"))
    window = r"90 % or more from about .* to .* ms.*; most, \d+ % at \d.* ms"
    assert re.search(window, text(tab, ".window"))
    for name, told in {"white_electrons": "276.24 e-", "snr_db": "16.553 dB", "blur_px": "20 px"}.items():
        assert told in text(tab, f"[data-number={name}]")
    assert tab.run("document.querySelectorAll('.seen .boxes > g').length") >= 3
    assert tab.run("location.search") == "?exposure-ms=20&lux=2&dx=1000&dy=0&gain=auto"


def test_sliders_move_the_picture_the_numbers_and_the_url(tab: Tab) -> None:
    for name, number in (
        ("exposure_s", "blur_px"),
        ("illuminance_lux", "snr_db"),
        ("velocity_x_px_s", "blur_px"),
    ):
        before = text(tab, f"[data-number={number}]")
        changes(tab, lambda name=name: slide(tab, name, times=4))
        tab.until(f"document.querySelector('[data-number={number}]').innerText !== {before!r}")
    assert "exposure-ms=" in tab.run("location.search")


def test_the_url_brings_the_state_back(tab: Tab, browser: Browser, address: str) -> None:
    changes(tab, lambda: slide(tab, "exposure_s", "ArrowLeft", 9))
    tab.until("location.search.includes('exposure-ms')")
    other = browser.tab()
    other.open(tab.run("location.href"))
    other.until(READY)
    for each in ("blur_px", "snr_db"):
        assert text(other, f"[data-number={each}]") == text(tab, f"[data-number={each}]")
    other.close()


def test_what_a_url_cannot_have_is_told_until_something_else_is_shown(browser: Browser, address: str) -> None:
    other = browser.tab()
    other.open(f"{base(address)}?exposure-ms=-4&lux=7")
    other.until(f"location.search.includes('exposure-ms=20&lux=2') && {READY}")
    assert "exposure-ms = '-4': exposure_s = -0.004: must be" in text(other, ".message")
    changes(other, lambda: slide(other, "illuminance_lux"))
    assert other.run("document.querySelector('.message').offsetParent") is None
    other.close()


def test_two_visitors_do_not_disturb_each_other(tab: Tab, browser: Browser, address: str) -> None:
    other = browser.tab()
    other.open(address)
    other.until(READY)
    before = (text(other, "[data-number=blur_px]"), other.run(SHOWN))
    for _ in range(3):
        changes(tab, lambda: slide(tab, "exposure_s"))
        changes(other, lambda: slide(other, "illuminance_lux"))
    assert text(other, "[data-number=blur_px]") == before[0]
    assert text(tab, "[data-number=blur_px]") != before[0]
    assert "lux=2&" in tab.run("location.search")
    assert "exposure-ms=20&" in other.run("location.search")
    assert other.failures == []
    assert tab.run(f"fetch({tab.run(SHOWN)!r}).then(r => r.status)") == 200
    other.close()


_ATTACK = """async target => {
  const fails = promise => promise.then(r => `${r.type} ${r.status}`, () => "refused");
  const socket = url => new Promise(told => {
    const made = new WebSocket(url);
    made.onmessage = made.onopen = () => told("open");
    made.onerror = () => told("refused");
  });
  const sio = "_nicegui_ws/socket.io/?EIO=4&transport=";
  return [
    await fails(fetch(target)),
    await fails(fetch(target + sio + "polling")),
    await fails(fetch(target + "_nicegui/client/0/upload/1", {method: "POST", body: "a"})),
    await socket(target.replace("http", "ws") + sio + "websocket"),
  ];
}"""


def test_a_page_of_another_site_gets_nothing(address: str) -> None:
    """Whether it asks for this machine by its address, or has its own name rebound to it; even with the token."""
    rebound = base(address).replace("127.0.0.1", "evil.example")
    with browsers.browser("--host-resolver-rules=MAP evil.example 127.0.0.1") as browser, foreign() as other:
        tab = browser.tab()
        tab.open(address)
        tab.until(READY)
        assert tab.run(f"({_ATTACK})({base(address)!r})") == ["basic 200", "basic 200", "basic 404", "open"]
        for name in ("evil.example", "127.0.0.1", "localhost"):
            for target in (base(address), rebound):
                tab.open(f"http://{name}:{other}/")
                tab.until("document.title === 'foreign'")
                assert tab.run(f"({_ATTACK})({target!r})") == ["refused"] * 4, (name, target)
        tab.open(rebound)
        tab.until("document.body?.innerText.includes('not served here')")


@contextmanager
def foreign() -> Iterator[int]:
    """The port of another site on this machine."""

    class Answers(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(b"<!doctype html><title>foreign</title><body></body>")

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Answers) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield server.server_address[1]
        server.shutdown()


def test_files_are_taken_or_refused_and_the_page_lives_on(
    tab: Tab, browser: Browser, address: str, tmp_path: Path
) -> None:
    """An upload is listed for its visitor, and opened by its address."""
    sound = encode(np.random.default_rng(0).integers(0, 255, (60, 90, 3), np.uint8))
    for name, content in {"text.png": b"not a picture", "empty.png": b""}.items():
        (tmp_path / name).write_bytes(content)
        tab.choose(".q-uploader input", tmp_path / name)
        tab.until(f"document.querySelector('.message').innerText.includes({name!r})")
    (tmp_path / "sound.png").write_bytes(sound)
    tab.choose(".q-uploader input", tmp_path / "sound.png")
    tab.until("document.querySelector('.original img')?.naturalWidth === 90")
    tab.until(f"document.querySelector('.numbers dd') && {IDLE}")
    assert tab.run("document.querySelector('.message').offsetParent") is None
    assert tab.run("document.querySelector('[data-control=moves]')") is None  # nobody knows its parts
    changes(tab, lambda: slide(tab, "exposure_s"))
    other = browser.tab()
    other.open(address)
    other.until(READY)
    assert "sound.png" not in other.run("document.documentElement.outerHTML")
    other.open(tab.run("location.href"))
    other.until("document.querySelector('.original img')?.naturalWidth === 90")
    other.close()


def test_what_is_copied_gives_the_picture_that_is_seen(
    tab: Tab, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    changes(tab, lambda: slide(tab, "velocity_x_px_s", times=3))
    shown = tab.run(f"fetch({SHOWN}).then(r => r.arrayBuffer()).then(b => Array.from(new Uint8Array(b)))")
    (tmp_path / "shown.png").write_bytes(bytes(shown))
    monkeypatch.chdir(tmp_path)
    tab.click("nav .q-btn:nth-of-type(1)")
    command = str(tab.until("document.querySelector('.nicegui-code pre')?.innerText"))
    assert main(shlex.split(command)[1:]) == 0
    assert np.array_equal(read_picture(Path("seen.png")), read_picture(Path("shown.png")))
    Path("seen.png").unlink()
    tab.run("document.querySelector('.q-dialog__backdrop').click()")
    tab.until("document.querySelector('.nicegui-code') === null")
    tab.click("nav .q-btn:nth-of-type(2)")
    script = str(tab.until("document.querySelector('.nicegui-code pre')?.innerText"))
    exec(compile(script, "script", "exec"), {})
    assert np.array_equal(read_picture(Path("seen.png")), read_picture(Path("shown.png")))


def test_numbers_that_are_typed(tab: Tab) -> None:
    tab.click("[data-control=exposure_s] input")
    tab.run("document.querySelector('[data-control=exposure_s] input').select()")
    tab.call("Input.insertText", text="12.5")
    changes(tab, lambda: tab.press("Enter"))
    assert "exposure-ms=12.5" in tab.until("location.search")
    tab.run("document.querySelector('[data-control=exposure_s] input').select()")
    tab.call("Input.insertText", text="-4")
    tab.press("Enter")
    tab.until("document.querySelector('.message').innerText.includes('exposure_s = -0.004: must be')")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_phone_and_desk_in_light_and_dark(
    scheme: str, browser: Browser, address: str, tmp_path: Path
) -> None:
    for width, height in ((1280, 800), (390, 844)):
        tab = browser.tab(width, height)
        tab.scheme(scheme)
        tab.open(address)
        tab.until(READY)
        assert tab.run("document.body.classList.contains('body--dark')") is (scheme == "dark")
        assert tab.run("document.documentElement.scrollWidth <= innerWidth")
        place = tab.run("document.querySelector('.seen img').getBoundingClientRect().toJSON()")
        assert place["bottom"] < height  # the answer is on the first screen
        assert tab.run("document.querySelector('h1').getBoundingClientRect().bottom") < place["top"] + 1
        assert (
            tab.run("document.querySelector('[data-control=exposure_s]').getBoundingClientRect().top")
            < height
        )
        assert tab.failures == []
        tab.close()


def test_a_runs_cell_is_the_picture_that_the_run_kept(browser: Browser, tmp_path: Path) -> None:
    grid = {"exposure_s": (0.002, 0.02), "illuminance_lux": (1.0, 50.0), "gain_db": (float("inf"),)}
    run = tmp_path / "run"
    signs, plan = rendered_signs((50,), count=1), SweepPlan(grid)
    found = evaluate(pictures=signs, plan=plan, output=run, refine=False, progress=False)
    kept = [row for row in found.cells if row["example"] and not row["clean"]]
    with served(run) as address:
        tab = browser.tab()
        tab.open(address)
        tab.until("document.querySelector('.numbers dd') && document.querySelector('h1')")
        for row in kept[:3]:
            column = sorted(grid["exposure_s"]).index(row["exposure_s"])
            line = sorted(grid["illuminance_lux"], reverse=True).index(row["illuminance_lux"])
            tab.until("document.querySelectorAll('.map .q-btn').length === 4")
            tab.run(f"document.querySelectorAll('.map .q-btn')[{2 * line + column}].click()")
            tab.until(f"location.search.includes('cell={row['cell_id']}')")
            tab.until(IDLE)
            shown = tab.run(
                f"fetch({SHOWN}).then(r => r.arrayBuffer()).then(b => Array.from(new Uint8Array(b)))"
            )
            (tmp_path / "shown.png").write_bytes(bytes(shown))
            assert np.array_equal(read_picture(tmp_path / "shown.png"), read_picture(run / row["example"]))
        tab.click("nav .q-btn:nth-of-type(1)")
        copied = str(tab.until("document.querySelector('.nicegui-code pre')?.innerText"))
        assert shlex.split(copied)[:4] == ["blurnoise", "explore", str(run), "--at"]
        assert tab.failures == []


def test_memory_stays_flat_over_500_changes(browser: Browser, tmp_path: Path) -> None:
    """Of the server and of the page, with a picture large enough to be seen smaller first: after the first 200
    changes, which fill what is kept and load what is compiled, 300 more add less than 48 MB and 8 MB."""
    write_picture(tmp_path / "large.png", np.random.default_rng(0).integers(0, 255, (480, 720, 3), np.uint8))
    words = ["explore", str(tmp_path / "large.png"), "--model", "none", "--no-browser"]
    command = [sys.executable, "-m", "blurnoise_eval.cli", *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=ENVIRONMENT)
    try:
        assert process.stdout is not None
        found = re.search(r"http://\S+", process.stdout.readline())
        assert found
        tab = browser.tab()
        tab.open(found[0])
        tab.until("document.querySelector('.seen img')?.naturalWidth")
        held = []
        for round_ in range(5):
            for step in range(100):
                name = ("exposure_s", "illuminance_lux", "velocity_x_px_s")[step % 3]
                slide(tab, name, "ArrowRight" if (step // 3 + round_) % 2 else "ArrowLeft")
                if step % 10 == 9:
                    tab.until(IDLE)
            tab.call("HeapProfiler.collectGarbage")
            resident = Path(f"/proc/{process.pid}/statm").read_text().split()[1]
            held.append(
                (int(resident) * os.sysconf("SC_PAGE_SIZE"), tab.run("performance.memory.usedJSHeapSize"))
            )
        server, page = (max(values[2:]) - values[1] for values in zip(*held, strict=True))
        assert server < 48e6, held
        assert page < 8e6, held
        assert tab.failures == []
    finally:
        process.terminate()
        process.wait(30)
