"""The page in a real browser, at the widths of a desk and of a phone; skipped where there is none."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from blurnoise_eval.report import figures
from blurnoise_eval.report.page import write_report
from made_runs import made_run

BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None
)
pytestmark = pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine")

HOSTILE = "<b>bold</b></script><img src=x onerror=document.title='hacked'>"
WIDTHS_PX = (1280, 390)

# Listens from the first moment on, then works every control and tells the frame's owner what it saw.
LISTEN = """<script>
const seen = {errors: [], blocked: [], overflow: 0, shots: []};
addEventListener("error", event => seen.errors.push(String(event.message)));
addEventListener("securitypolicyviolation", event => seen.blocked.push(event.blockedURI));
</script>"""
PROBE = """<script>
addEventListener("load", async () => {
  const look = name => {
    const root = document.documentElement;
    seen.overflow = Math.max(seen.overflow, root.scrollWidth - root.clientWidth);
    const drawn = [...document.querySelectorAll(".plot")].filter(plot => plot.querySelector("svg .trace"));
    const wide = drawn.filter(plot => plot.getBoundingClientRect().right > root.clientWidth + 0.5).length;
    const count = selector => document.querySelectorAll(selector).length;
    seen.shots.push({name, plots: count(".plot"), drawn: drawn.length, wide,
      curves: count(".curve .scatterlayer .trace"),
      colours: [...document.querySelectorAll(".curve .point")].map(each => each.style.fill),
      lines: count(".curve .scatterlayer .js-line"),
      marks: count(".curve .scatterlayer .point"), tiles: count(".map .barlayer .point"),
      written: [...document.querySelectorAll(".map .bartext")].map(each => each.textContent),
      map: [...document.querySelectorAll(".map .xtitle, .map .ytitle")].map(each => each.textContent)});
  };
  await ready;
  look("start");
  const choose = (id, value) => {
    byId(id).value = value;
    byId(id).dispatchEvent(new Event("change"));
  };
  const called = (id, word) => [...byId(id).options].find(option => option.text === word).value;
  const visible = id => byId(id) !== null && byId(id).offsetParent !== null;
  for (const option of byId("view").options) {
    choose("view", option.value);
    look(option.text);
  }
  if (byId("f-number")) {
    choose("view", called("view", "f-number"));
    choose("up", called("up", "temperature"));
    look("f-number and temperature");
    seen.shown = ["exposure", "speed", "light", "temperature", "f-number"].filter(visible);
    choose("up", called("up", "speed"));
    look("speed");
  }
  for (const select of document.querySelectorAll("select")) {
    select.selectedIndex = select.options.length - 1;
    select.dispatchEvent(new Event("change"));
    look(select.id);
  }
  for (const details of document.querySelectorAll("details")) details.open = true;
  const tapped = [...document.querySelectorAll("select, summary")].filter(
    each => each.offsetParent !== null);  // what is not shown cannot be tapped
  seen.tap = Math.min(...tapped.map(each => each.getBoundingClientRect().height));
  seen.font = Math.min(...[...document.querySelectorAll("p, td, th, small, li, button, figcaption")].map(
    each => parseFloat(getComputedStyle(each).fontSize)));
  seen.fetched = performance.getEntriesByType("resource").map(entry => entry.name);
  seen.images = document.querySelectorAll("img").length;
  seen.bold = document.querySelectorAll("svg [style*=bold]").length;
  seen.title = document.title;
  parent.postMessage({width: innerWidth, ...seen}, "*");
});
</script>"""
OWNER = """<!doctype html><body><pre></pre>%s<script>
const said = [];
addEventListener("message", event => {
  said.push(event.data);
  document.querySelector("pre").textContent = JSON.stringify(said);
});
</script>"""


def looked_at(page: Path, folder: Path) -> dict[int, dict[str, Any]]:
    """What the page is like in frames of WIDTHS_PX, by width; a window itself cannot be as narrow as a phone."""
    text = page.read_text(encoding="utf-8").replace("<head>", f"<head>{LISTEN}", 1)
    probed = page.with_name("probed.html")
    probed.write_text(PROBE.join(text.rsplit("</body>", 1)), encoding="utf-8")
    frames = "".join(f"<iframe src=probed.html width={width} height=900></iframe>" for width in WIDTHS_PX)
    owner = page.with_name("frames.html")
    owner.write_text(OWNER % frames, encoding="utf-8")
    command = [
        *(str(BROWSER), "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder}"),
        *("--window-size=1400,1000", "--virtual-time-budget=20000", "--dump-dom", owner.as_uri()),
    ]
    dumped = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
    found = re.search(r"<pre>(.*?)</pre>", dumped, re.DOTALL)
    assert found, dumped[:2000]
    return {each["width"]: each for each in json.loads(html.unescape(found[1]) or "[]")}


@pytest.fixture
def page_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figures, "figures_of", lambda *_: {})


@pytest.mark.slow
def test_three_models_side_by_side(tmp_path: Path, page_only: None) -> None:
    models = ("yolox-nano", HOSTILE, "a_model_of_one_very_long_word_" * 4)
    data = made_run(tmp_path, speeds=(0.0, 200.0, 600.0), models=models, n_examples=3)
    looks = looked_at(write_report(data, tmp_path), tmp_path / "profile")
    assert set(looks) == set(WIDTHS_PX)
    for width, look in looks.items():
        _is_sound(look)
        shots = {shot["name"]: shot for shot in look["shots"]}
        assert shots["start"]["plots"] == shots["start"]["drawn"] == 6  # 3 curves, 3 maps
        assert shots["start"]["tiles"] == 3 * 4 * 3
        assert len(set(shots["start"]["colours"])) == 3  # a colour for each speed, as its legend has it
        assert look["images"] == 9
        assert look["bold"] == 0  # no name became markup in a plot
        assert look["title"] == "Exposure sweep"
        assert look["tap"] >= (40 if width < 640 else 28)


@pytest.mark.slow
def test_one_reader_and_two_directions(tmp_path: Path, page_only: None) -> None:
    data = made_run(tmp_path, kind="reader", speeds=(-600.0, 0.0, 600.0), n_examples=1)
    for look in looked_at(write_report(data, tmp_path), tmp_path / "profile").values():
        _is_sound(look)
        start = look["shots"][0]
        assert (start["plots"], start["drawn"]) == (2, 2)
        assert start["tiles"] == 3 * 4


@pytest.mark.slow
def test_below_eight_pictures_no_tile_reads_as_certain(tmp_path: Path, page_only: None) -> None:
    data = made_run(tmp_path, n_examples=1, interval=False)
    for look in looked_at(write_report(data, tmp_path), tmp_path / "profile").values():
        written = look["shots"][0]["written"]
        assert written
        assert all(text.endswith("?") for text in written)


@pytest.mark.slow
def test_every_axis_is_drawn_over_and_mapped(tmp_path: Path, page_only: None) -> None:
    data = made_run(
        tmp_path,
        speeds=(0.0, 200.0, 600.0),
        f_numbers=(1.4, 2.0, 2.8),
        temperatures_c=(25.0, 85.0),
        n_examples=1,
    )
    for look in looked_at(write_report(data, tmp_path), tmp_path / "profile").values():
        _is_sound(look)
        shots = {shot["name"]: shot for shot in look["shots"]}
        assert all(shot["plots"] == shot["drawn"] == 2 for shot in look["shots"])
        assert shots["start"]["tiles"] == 4 * 3
        assert shots["start"]["map"] == ["Exposure / ms", "Speed / (px/s)"]
        both = shots["f-number and temperature"]
        assert both["lines"] == 4  # one per exposure
        assert both["marks"] == 4 * 3  # at one speed, light and temperature
        assert both["tiles"] == 4 * 2
        assert both["map"] == ["Exposure / ms", "Sensor temperature / °C"]
        assert look["shown"] == ["speed", "light", "temperature", "f-number"]
        assert shots["speed"]["tiles"] == 4 * 3
        assert shots["speed"]["map"] == ["Exposure / ms", "Speed / (px/s)"]


def _is_sound(look: dict[str, Any]) -> None:
    assert look["errors"] == []
    assert look["blocked"] == []
    assert [name for name in look["fetched"] if not name.startswith("data:")] == []
    assert look["overflow"] <= 0
    assert all(shot["wide"] == 0 for shot in look["shots"])
    assert look["font"] >= 12
