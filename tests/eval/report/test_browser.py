"""The page in a real browser, at the widths of a desk and of a phone; skipped where there is none."""

import html
import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from blurnoise_eval.report import figures
from blurnoise_eval.report.page import write_report
from made_runs import made_run

BROWSERS = map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))
BROWSER = next(filter(None, BROWSERS), None)
pytestmark = [pytest.mark.slow, pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine")]
HOSTILE = "<b>bold</b></script><img src=x onerror=document.title='hacked'>"
WIDTHS_PX = (1280, 390)

# Listens from the first moment on, then works every control and tells the frame's owner what it saw.
LISTEN = """<script>
const seen = {errors: [], blocked: [], overflow: 0, shots: {}};
addEventListener("error", event => seen.errors.push(String(event.message)));
addEventListener("securitypolicyviolation", event => seen.blocked.push(event.blockedURI));
</script>"""
PROBE = """<script>
addEventListener("load", async () => {
  const every = selector => [...document.querySelectorAll(selector)];
  const look = name => {
    const root = document.documentElement;
    seen.overflow = Math.max(seen.overflow, root.scrollWidth - root.clientWidth);
    const drawn = every(".plot").filter(plot => plot.querySelector("svg .trace"));
    seen.shots[name] = {plots: every(".plot").length, drawn: drawn.length,
      wide: drawn.filter(plot => plot.getBoundingClientRect().right > root.clientWidth + 0.5).length,
      colours: every(".curve .point").map(each => each.style.fill),
      lines: every(".curve .scatterlayer .js-line").length,
      marks: every(".curve .scatterlayer .point").length, tiles: every(".map .barlayer .point").length,
      written: every(".map .bartext").map(each => each.textContent),
      map: every(".map .xtitle, .map .ytitle").map(each => each.textContent)};
  };
  const choose = (id, word) => {
    byId(id).value = [...byId(id).options].find(option => option.text === word).value;
    byId(id).dispatchEvent(new Event("change"));
  };
  await ready;
  look("start");
  for (const option of byId("view").options) { choose("view", option.text); look(option.text); }
  if (byId("f-number")) {
    choose("view", "f-number");
    choose("up", "temperature");
    look("f-number and temperature");
  }
  every("details").forEach(details => { details.open = true; });
  const tapped = every("select, summary").filter(each => each.offsetParent !== null);
  seen.tap = Math.min(...tapped.map(each => each.getBoundingClientRect().height));
  const texts = every("p, td, th, small, li, button, figcaption");
  seen.font = Math.min(...texts.map(each => parseFloat(getComputedStyle(each).fontSize)));
  seen.fetched = performance.getEntriesByType("resource").map(entry => entry.name);
  seen.images = every("img").length;
  seen.bold = every("svg [style*=bold]").length;
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


@pytest.fixture
def looked_at(tmp_path, monkeypatch):
    """What a run's page is like in frames of WIDTHS_PX, by width; a window itself cannot be as narrow as a phone."""
    monkeypatch.setattr(figures, "figures_of", lambda *_: {})

    def looks(**shape):
        page: Path = write_report(made_run(tmp_path, **shape), tmp_path)
        text = page.read_text(encoding="utf-8").replace("<head>", f"<head>{LISTEN}", 1)
        page.with_name("probed.html").write_text(PROBE.join(text.rsplit("</body>", 1)), encoding="utf-8")
        frames = "".join(f"<iframe src=probed.html width={width} height=900></iframe>" for width in WIDTHS_PX)
        owner = page.with_name("frames.html")
        owner.write_text(OWNER % frames, encoding="utf-8")
        how = "--headless --no-sandbox --disable-gpu --window-size=1400,1000 --virtual-time-budget=20000 --dump-dom"
        command = [str(BROWSER), *how.split(), f"--user-data-dir={tmp_path / 'profile'}", owner.as_uri()]
        dumped = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
        found = re.search(r"<pre>(.*?)</pre>", dumped, re.DOTALL)
        assert found, dumped[:2000]
        every = {each["width"]: each for each in json.loads(html.unescape(found[1]) or "[]")}
        assert set(every) == set(WIDTHS_PX)
        for look in every.values():
            assert look["errors"] == look["blocked"] == []
            assert [name for name in look["fetched"] if not name.startswith("data:")] == []
            assert look["overflow"] <= 0
            assert all(shot["wide"] == 0 for shot in look["shots"].values())
            assert look["font"] >= 12
        return every

    return looks


def test_three_models_side_by_side(looked_at):
    """Below eight pictures no tile reads as certain."""
    models = ("yolox-nano", HOSTILE, "a_model_of_one_very_long_word_" * 4)
    for width, look in looked_at(
        speeds=(0.0, 200.0, 600.0), models=models, n_examples=3, interval=False
    ).items():
        start = look["shots"]["start"]
        assert start["plots"] == start["drawn"] == 6  # 3 curves, 3 maps
        assert start["tiles"] == 3 * 4 * 3
        assert len(set(start["colours"])) == 3  # a colour for each speed, as its legend has it
        assert start["written"]
        assert all(text.endswith("?") for text in start["written"])
        assert (look["images"], look["bold"], look["title"]) == (
            9,
            0,
            "Exposure sweep",
        )  # no name became markup
        assert look["tap"] >= (40 if width < 640 else 28)


def test_every_axis_is_drawn_over_and_mapped(looked_at):
    shape = {"f_numbers": (1.4, 2.0, 2.8), "temperatures_c": (25.0, 85.0), "n_examples": 1}
    for look in looked_at(speeds=(0.0, 200.0, 600.0), **shape).values():
        shots = look["shots"]
        assert all(shot["plots"] == shot["drawn"] == 2 for shot in shots.values())
        assert (shots["start"]["tiles"], shots["start"]["map"]) == (
            4 * 3,
            ["Exposure / ms", "Speed / (px/s)"],
        )
        both = shots["f-number and temperature"]
        assert (both["lines"], both["marks"]) == (
            4,
            4 * 3,
        )  # one per exposure; at one speed, light, temperature
        assert (both["tiles"], both["map"]) == (4 * 2, ["Exposure / ms", "Sensor temperature / °C"])
