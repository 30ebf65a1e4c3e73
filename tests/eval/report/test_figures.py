"""The figures show what was measured, in its units, and mark what is found, read and best."""

import math
from dataclasses import replace
from itertools import combinations

import pytest
from blurnoise_eval.report import charts, figures
from blurnoise_eval.report.figures import figures_of
from made_runs import EXPOSURES_S, made_run


def _lines(figure, panel):
    """Abscissae and ordinates of a panel's labelled lines."""
    lines = [line for line in figure.axes[panel].lines if not line.get_label().startswith("_")]
    return {line.get_label(): (list(line.get_xdata()), list(line.get_ydata())) for line in lines}


def _near(values):
    """As they are drawn: to four decimals."""
    return pytest.approx(values, abs=6e-5)


def _drawn(data, word):
    """The figure of the view of this name."""
    file = next(view.file for view in charts.views(data) if view.word == word)
    groups = data.largest_groups(12)
    return figures_of(data, groups, charts.numbers(data, groups))[file]()


def test_figures_draw_the_measured_points_in_their_units(tmp_path):
    data = made_run(tmp_path, n_examples=0)
    answer = data.answers[3]  # 100 px sign, 200 lux, 600 px/s
    by_exposure = _lines(_drawn(data, "exposure"), 1)
    assert by_exposure["600 px/s"] == (pytest.approx([1, 4, 16, 64]), _near(answer.confidence))
    for word, x in (("blur", [0, 1 + math.log10(0.004 * 600)]), ("speed", [0, 600])):
        lines = _lines(_drawn(data, word), 1)
        assert set(lines) == {"1 ms", "4 ms", "16 ms", "64 ms"}
        expected = [data.answers[2].confidence[1], answer.confidence[1]]
        assert lines["4 ms"] == (pytest.approx(x), _near(expected))
    assert "only the speed changes" in " ".join(_drawn(data, "blur").get_supxlabel().split())


def test_exposures_beyond_the_grid_refine_the_curves_over_exposure_alone(tmp_path):
    data = made_run(tmp_path, n_examples=0)
    grid = {"plan": {"grid": {"exposure_s": (0.001, 0.016, 0.064)}}}
    data = replace(data, manifest=data.manifest | grid)
    assert data.axes[0].values == (0.001, 0.016, 0.064, 0.004)
    assert _lines(_drawn(data, "exposure"), 1)["0 px/s"][0] == pytest.approx([1, 4, 16, 64])
    assert set(_lines(_drawn(data, "blur"), 1)) == {"1 ms", "16 ms", "64 ms"}


@pytest.mark.parametrize(("models", "groups", "lights"), [(1, 60, 7), (20, 2, 3)])
def test_panels_are_capped_and_it_is_said(tmp_path, models, groups, lights):
    lights_lux, names = tuple(10.0 * 2**i for i in range(lights)), tuple(f"model {i}" for i in range(models))
    every = {f"class {i}": 0.9 for i in range(groups)}
    data = made_run(tmp_path, every, EXPOSURES_S[:2], lights_lux, (0.0,), n_examples=0, models=names)
    figure = _drawn(data, "exposure")
    shown = [axes.get_title() for axes in figure.axes if axes.get_title()]
    assert 1 < len(shown) <= figures.MAX_PANELS
    possible = models * min(groups, 12) * lights
    assert f"{len(shown)} of {possible} panels shown" in figure.get_supxlabel()
    assert ("12 of 60 groups of targets shown" in figure.get_supxlabel()) == (groups == 60)


def test_a_further_axis_has_a_figure_of_its_own(tmp_path):
    data = made_run(tmp_path, n_examples=0, f_numbers=(1.4, 2.0, 2.8), temperatures_c=(25.0, 85.0))
    figure = _drawn(data, "f-number")
    assert figure.axes[3].get_title() == "stop sign 100 px\n200 lux · 85 °C · n = 12"
    own = [
        a for a in data.answers
        if a.group == "stop sign 100 px" and a.conditions.velocity_px_s == (600.0, 0.0)
        and (a.conditions["illuminance_lux"], a.conditions["temperature_c"]) == (200.0, 85.0)
    ]  # fmt: skip
    assert _lines(figure, 3)["4 ms"] == ([1.4, 2.0, 2.8], _near([a.confidence[1] for a in own]))
    assert figure.axes[0].get_xscale() == "log"
    assert list(figure.axes[0].get_xticks()) == [1.4, 2.0, 2.8]
    assert figure.get_supxlabel().splitlines()[:2] == ["f-number", "At 600 px/s."]
    assert _drawn(data, "temperature").axes[0].get_title() == "stop sign 100 px\n10 lux · f/1.4 · n = 12"


def test_panels_name_their_lights_and_the_caption_says_what_goes_with_them(tmp_path):
    """Titles of neighbours would overlap with spectrum and headlamps."""
    data = made_run(tmp_path, lights_lux=(1.0, 20.0), n_examples=0)
    street = {"name": "street", "lux": 1.0, "illuminant": "led-4000", "headlamp": "low"}
    lights = [street, street | {"name": "lit-street", "lux": 20.0}]
    named = replace(data, manifest=data.manifest | {"plan": {"light": lights}})
    figure = _drawn(named, "exposure")
    titles = [axes.get_title() for axes in figure.axes[:2]]
    assert titles == [
        f"stop sign 100 px\n{light} · n = 12" for light in ("street, 1 lux", "lit-street, 20 lux")
    ]
    caption = " ".join(figure.get_supxlabel().split())
    assert "street: 1 lux, led-4000, low beam; lit-street: 20 lux, led-4000, low beam." in caption
    assert "1 lux;" not in _drawn(data, "exposure").get_supxlabel()  # there is nothing besides


@pytest.mark.parametrize("models", [("m",), ("one", "another")])
@pytest.mark.parametrize("lights_lux", [(10.0,), (1.0, 20.0, 400.0, 20000.0)])
def test_margins_have_room_for_every_text(tmp_path, models, lights_lux):
    data = made_run(tmp_path, lights_lux=lights_lux, models=models, n_examples=0)
    lights = [
        {"name": f"road {lux:g}", "lux": lux, "illuminant": "led-4000", "headlamp": "low"}
        for lux in lights_lux
    ]
    named = replace(data, manifest=data.manifest | {"plan": {"light": lights}})
    for word in ("exposure", "speed"):
        figure = _drawn(named, word)
        figure.draw_without_rendering()
        legend, caption, label = (
            text.get_window_extent() for text in (figure.legends[0], figure._supxlabel, figure._supylabel)
        )
        panels = {axes: axes.get_tightbbox() for axes in figure.axes if axes.get_title()}
        for panel in panels.values():
            assert caption.y1 <= panel.y0 < panel.y1 <= legend.y0
            assert label.x1 <= panel.x0 < panel.x1 <= figure.bbox.x1
        for (one, of_one), (other, of_other) in combinations(panels.items(), 2):
            if one.get_position().y0 > other.get_position().y1:
                assert of_one.y0 >= of_other.y1
        assert caption.y0 >= 0
        assert legend.y1 <= figure.bbox.y1
