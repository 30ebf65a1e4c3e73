"""The explorer in a real browser: what sliders, dropped files and keys do; skipped where there is no Chromium."""

import math
import re
import subprocess
import sys
import time
from typing import Any

import browsers
import pytest
from blurnoise_eval.datasets import rendered_signs, write_picture

pytest.importorskip("uvicorn")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(browsers.CHROMIUM is None, reason="no Chromium on this machine"),
]
SHOWN = "document.querySelector('.seen img').src"
IDLE = "!document.querySelector('.busy')"
READY = (
    "document.querySelector('.seen img')?.naturalWidth && document.querySelector('#numbers dd') "
    "&& / (or more|tested) /.test(document.querySelector('#window').innerText)"
)


@pytest.fixture(scope="module")
def browser():
    with browsers.browser() as found:
        yield found


@pytest.fixture(scope="module")
def address():
    """The explorer's, with its token."""
    command = [sys.executable, "-m", "blurnoise_eval.cli", "explore", "--no-browser"]
    pipes: Any = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    process = subprocess.Popen(command, text=True, **pipes)
    try:
        found = re.search(r"http://127\.0\.0\.1:\d+/\S+", process.stdout.readline())  # type: ignore[union-attr]
        assert found
        yield found[0]
        assert process.poll() is None, "the explorer has ended"
    finally:
        process.terminate()
        process.wait(30)


@pytest.fixture
def tab(browser, address):
    """Opened at the start; whatever a test does, the page has no error, and asks nobody but the explorer."""
    tab = browser.tab()
    tab.open(address)
    tab.until(READY)
    yield tab
    assert tab.failures == []
    own = address.partition("?")[0], "data:", "blob:", "about:"
    assert [url for url in tab.asked if not url.startswith(own)] == []
    tab.close()


def changes(tab, act):
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


def text(tab, selector):
    return str(tab.run(f"document.querySelector({selector!r})?.innerText ?? ''"))


def slide(tab, name, key="ArrowRight", times=1):
    tab.run(f"document.querySelector('[data-control={name}] [type=range]').focus()")
    for _ in range(times):
        tab.press(key)


def test_the_first_screen_answers(tab):
    assert re.match(r"Keeps \d+ % of its confidence in the original .*, \d of 3 found", text(tab, "h1"))
    window = r"90 % or more from about .* to .* ms.*; best: \d+ % at \d.* ms"
    assert re.search(window, text(tab, "#window"))
    for name, told in {"white_electrons": "71.137 e-", "snr_db": "9.6521 dB", "blur_px": "5 px"}.items():
        assert told in text(tab, f"[data-number={name}]")
    assert tab.run("document.querySelectorAll('.seen svg > g').length") >= 3
    assert tab.run("location.search") == "?exposure-ms=5&lux=5&dx=1000&dy=0&gain=auto"


def test_no_key_is_lost_however_fast_they_are_pressed(tab):
    changes(tab, lambda: slide(tab, "exposure_s", times=20))
    ratio = 900 / 0.003
    expected = 0.003 * ratio ** ((round(200 * math.log(5 / 0.003, ratio)) + 20) / 200)
    assert float(tab.run("document.querySelector('#exposure_s').value")) == pytest.approx(expected, rel=5e-3)


def drop(tab, path):
    for kind in ("dragEnter", "dragOver", "drop"):
        data = {"items": [], "files": [str(path)], "dragOperationsMask": 1}
        tab.call("Input.dispatchDragEvent", type=kind, x=300, y=300, data=data)


def test_a_dropped_picture_is_shown_and_a_wrong_file_is_a_line(tab, tmp_path):
    picture, wrong = tmp_path / "50.png", tmp_path / "wrong.png"
    write_picture(picture, rendered_signs((50,), count=1).pictures[0].load())
    wrong.write_text("no picture")
    drop(tab, wrong)
    tab.until("document.querySelector('#message').innerText.startsWith('wrong.png: must be an 8- or 16-bit')")
    tab.failures.clear()  # the browser's own, of the status 422
    drop(tab, picture)
    tab.until("location.search.includes('picture=dropped-1')")
    tab.until(READY)
    assert "1 of 1 found" in text(tab, "h1")
    assert "50.png" in text(tab, "aside")


def test_sliders_and_what_is_typed_move_the_picture_the_numbers_and_the_url(tab, browser):
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
    assert text(other, "#numbers") == text(tab, "#numbers")
    other.close()
    enter(tab, "-4")
    tab.until("document.querySelector('#message').innerText.includes('exposure_s = -0.004: must be')")
    tab.failures.clear()  # the browser's own, of the status 422
    assert tab.run("document.querySelector('#exposure_s').value") == "12.5"
    changes(tab, lambda: slide(tab, "illuminance_lux"))
    assert text(tab, "#message") == ""


def enter(tab, exposure_ms):
    tab.run("document.querySelector('#exposure_s').focus()")
    tab.run("document.querySelector('#exposure_s').select()")
    tab.call("Input.insertText", text=exposure_ms)
    tab.press("Enter")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_numbers_are_readable_by_day_and_by_night(tab, scheme):
    """WCAG 2.2, 1.4.3: text has a contrast of 4.5 or more with what is behind it."""
    tab.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
    tab.run("document.querySelector('details').open = true")
    seen = tab.run(browsers.contrasts("input:not([type]), select, dd, dt, label, figcaption, h1, #window"))
    assert len(seen) > 30
    assert {text: ratio for text, ratio in seen.items() if ratio < 4.5} == {}
