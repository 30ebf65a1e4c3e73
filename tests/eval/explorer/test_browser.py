"""The explorer in a real browser: what sliders, files, keys and two visitors do; skipped where there is no
Chromium."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import browsers
import cv2
import numpy as np
import pytest
from blurnoise_eval import SweepPlan, evaluate
from blurnoise_eval.cli import main
from blurnoise_eval.datasets import encode, read_picture, rendered_signs, write_picture
from browsers import Browser, Tab
from numpy.typing import NDArray

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
def served(*words: object) -> Iterator[tuple[str, int]]:
    """The explorer's address, with its token, and its process."""
    command = [sys.executable, "-m", "blurnoise_eval.cli", "explore", "--no-browser", *map(str, words)]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=ENVIRONMENT
    )
    try:
        assert process.stdout is not None
        found = re.search(r"http://127\.0\.0\.1:\d+/\S+", process.stdout.readline())
        assert found
        yield found[0], process.pid
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
    with served() as (found, _):
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


def test_sliders_and_what_is_typed_move_the_picture_the_numbers_and_the_url(
    tab: Tab, browser: Browser
) -> None:
    """And the URL brings the state back."""
    for name, number in {
        "exposure_s": "blur_px",
        "illuminance_lux": "snr_db",
        "velocity_x_px_s": "blur_px",
    }.items():
        before = text(tab, f"[data-number={number}]")
        changes(tab, lambda name=name: slide(tab, name, times=4))
        tab.until(f"document.querySelector('[data-number={number}]').innerText !== {before!r}")
    changes(tab, lambda: enter(tab, "12.5"))
    assert "exposure-ms=12.5" in tab.until("location.search")
    other = browser.tab()
    other.open(tab.run("location.href"))
    other.until(READY)
    assert text(other, ".numbers") == text(tab, ".numbers")
    other.close()
    enter(tab, "-4")
    tab.until("document.querySelector('.message').innerText.includes('exposure_s = -0.004: must be')")
    changes(tab, lambda: slide(tab, "illuminance_lux"))
    assert tab.run("document.querySelector('.message').offsetParent") is None


def enter(tab: Tab, exposure_ms: str) -> None:
    tab.click("[data-control=exposure_s] input")
    tab.run("document.querySelector('[data-control=exposure_s] input').select()")
    tab.call("Input.insertText", text=exposure_ms)
    tab.press("Enter")


def seen(tab: Tab) -> NDArray[Any]:
    """The picture that is shown, as the browser has it."""
    shown = tab.run(f"fetch({SHOWN}).then(r => r.arrayBuffer()).then(b => Array.from(new Uint8Array(b)))")
    return cv2.imdecode(np.array(shown, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]


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
    monkeypatch.chdir(tmp_path)
    for button in (1, 2):
        tab.click(f"nav .q-btn:nth-of-type({button})")
        copied = str(tab.until("document.querySelector('.nicegui-code pre')?.innerText"))
        if button == 1:
            assert main(shlex.split(copied)[1:]) == 0
        else:
            exec(compile(copied, "script", "exec"), {})
        assert np.array_equal(read_picture(Path("seen.png")), seen(tab))
        Path("seen.png").unlink()
        tab.run("document.querySelector('.q-dialog__backdrop').click()")
        tab.until("document.querySelector('.nicegui-code') === null")


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
    with served(run) as (address, _):
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
            assert np.array_equal(seen(tab), read_picture(run / row["example"]))
        assert tab.failures == []


def test_memory_stays_flat_over_500_changes(browser: Browser, tmp_path: Path) -> None:
    """Of the server and of the page, with a picture large enough to be seen smaller first: after the first 200
    changes, which fill what is kept and load what is compiled, 300 more add less than 48 MB and 8 MB."""
    write_picture(tmp_path / "large.png", np.random.default_rng(0).integers(0, 255, (480, 720, 3), np.uint8))
    with served(tmp_path / "large.png", "--model", "none") as (address, process):
        tab = browser.tab()
        tab.open(address)
        tab.until("document.querySelector('.seen img')?.naturalWidth")
        held = []
        for round_ in range(5):
            for step in range(100):
                name = ("exposure_s", "illuminance_lux", "velocity_x_px_s")[step % 3]
                slide(tab, name, "ArrowRight" if (step // 3 + round_) % 2 else "ArrowLeft")
                if step % 10 == 9:
                    tab.until(IDLE)
            tab.call("HeapProfiler.collectGarbage")
            resident = Path(f"/proc/{process}/statm").read_text().split()[1]
            held.append(
                (int(resident) * os.sysconf("SC_PAGE_SIZE"), tab.run("performance.memory.usedJSHeapSize"))
            )
        server, page = (max(values[2:]) - values[1] for values in zip(*held, strict=True))
        assert server < 48e6, held
        assert page < 8e6, held
        assert tab.failures == []
