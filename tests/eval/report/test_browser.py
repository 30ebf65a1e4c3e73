"""The page in a real browser, at the widths of a desk and of a phone; skipped where there is none."""

import browsers
import pytest
from blurnoise_eval.report import figures
from blurnoise_eval.report.page import write_report
from made_runs import made_run

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(browsers.CHROMIUM is None, reason="no Chromium on this machine"),
]
HOSTILE = "<b>bold</b></script><img src=x onerror=document.title='hacked'>"
WIDTHS_PX = (1280, 390)

# Works every control; the value is what is seen then.
PROBE = """(async () => {
  const seen = {overflow: 0, shots: {}};
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
  const top = selector => document.querySelector(selector).getBoundingClientRect().top;
  seen.tops = [".drawing", ".uses", ".lead"].map(top);
  seen.scrolled = Math.max(...every(".uses .scroll").map(each => each.scrollWidth - each.clientWidth));
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
  seen.images = every("img").length;
  seen.bold = every("svg [style*=bold]").length;
  seen.title = document.title;
  return seen;
})()"""


@pytest.fixture
def looked_at(tmp_path, monkeypatch):
    """What a run's page is like at each of WIDTHS_PX, by width."""
    monkeypatch.setattr(figures, "figures_of", lambda *_: {})

    def looks(**shape):
        page = write_report(made_run(tmp_path, **shape), tmp_path)
        every = {}
        with browsers.browser() as browser:
            for width in WIDTHS_PX:
                tab = browser.tab()
                screen = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
                tab.call("Emulation.setDeviceMetricsOverride", **screen)
                tab.open(page.as_uri())
                tab.until("document.readyState === 'complete' && byId('view')")
                every[width] = look = tab.run(PROBE)
                assert not tab.failures
                assert [url for url in tab.asked if not url.startswith(("file:", "data:"))] == []
                tab.close()
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
        # no name became markup
        assert (look["images"], look["bold"], look["title"]) == (9 + 2, 0, "Exposure sweep")
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
        # one per exposure; at one speed, light, temperature
        assert (both["lines"], both["marks"]) == (4, 4 * 3)
        assert (both["tiles"], both["map"]) == (4 * 2, ["Exposure / ms", "Sensor temperature / °C"])


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_figures_and_numbers_are_readable_by_day_and_by_night(tmp_path, monkeypatch, scheme):
    """WCAG 2.2: 4.5 of text (1.4.3), 3 of lines (1.4.11); the brightest line of three is between."""
    monkeypatch.setattr(figures, "figures_of", lambda *_: {})
    page = write_report(made_run(tmp_path, speeds=(0.0, 200.0, 600.0)), tmp_path)
    with browsers.browser() as browser:
        tab = browser.tab()
        tab.call(
            "Emulation.setDeviceMetricsOverride", width=1280, height=900, deviceScaleFactor=1, mobile=False
        )
        tab.open(page.as_uri())
        tab.until("document.querySelectorAll('.plot .trace').length > 1")
        # the charts follow when the system changes, too
        tab.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        paper = "getComputedStyle(document.body).backgroundColor"
        chart = "getComputedStyle(document.querySelector('.curve .main-svg')).backgroundColor"
        tab.until(f"{chart} === {paper}")
        for selector in (
            "p, td, th, li, summary, select, figcaption, .legend span",
            ".drawing text",
            ".xtitle",
        ):
            texts = tab.run(browsers.contrasts(selector, "color" if selector[0] == "p" else "fill"))
            assert texts
            assert {text: ratio for text, ratio in texts.items() if ratio < 4.5} == {}
        least = 3.0 if scheme == "dark" else 1.7
        for lines in (".drawing polyline", ".curve .js-line"):
            ratios = tab.run(browsers.contrasts(lines, "stroke"))
            assert ratios
            assert min(ratios.values()) >= least, ratios
        first = tab.run("(() => { const box = document.querySelector('.first aside').getBoundingClientRect(); "
                        "return [box.left, box.top, box.bottom]; })()")  # fmt: skip
        assert first[0] > 640  # beside the answer
        assert 0 < first[1] < first[2] <= 900  # on the first screen
        tab.close()


def test_a_phone_shows_figure_and_table_before_the_text_and_a_desk_the_whole_table(looked_at):
    seen = looked_at(speeds=(0.0, 300.0, 600.0, 900.0), n_examples=0)
    drawing, table, text = seen[390]["tops"]
    assert drawing < table < text
    assert seen[1280]["scrolled"] <= 0
