"""The figures show what was measured, in its units, and mark what is found, read and best."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from blurnoise_eval.plots import annotate as pictures
from blurnoise_eval.plots.style import line_colours, spread
from blurnoise_eval.report import charts, figures, words
from blurnoise_eval.report.figures import common_windows, figures_of
from blurnoise_eval.report.run import RunData
from made_runs import EXPOSURES_S, THRESHOLD, made_run


def _lines(figure: Any, panel: int) -> dict[str, tuple[list[float], list[float]]]:
    """Abscissae and ordinates of a panel's labelled lines."""
    lines = [line for line in figure.axes[panel].lines if not line.get_label().startswith("_")]
    return {line.get_label(): (list(line.get_xdata()), list(line.get_ydata())) for line in lines}


def _near(values: list[float]) -> Any:
    """As they are drawn: to four decimals."""
    return pytest.approx(values, abs=6e-5)


def _drawn(data: RunData, word: str) -> Any:
    """The figure of the view of this name."""
    file = next(view.file for view in charts.views(data) if view.word == word)
    groups = data.largest_groups(12)
    return figures_of(data, groups, charts.numbers(data, groups))[file]()


def test_figures_draw_the_measured_points_in_their_units(tmp_path: Path) -> None:
    data = made_run(tmp_path, n_examples=0)
    answer = data.answers[3]  # 100 px sign, 200 lux, 600 px/s
    by_exposure = _lines(_drawn(data, "exposure"), 1)
    assert by_exposure["600 px/s"] == (pytest.approx([1, 4, 16, 64]), _near(answer["confidence"]))
    for word, x in (("blur", [0, 1 + math.log10(0.004 * 600)]), ("speed", [0, 600])):
        lines = _lines(_drawn(data, word), 1)
        assert set(lines) == {"1 ms", "4 ms", "16 ms", "64 ms"}
        expected = [data.answers[2]["confidence"][1], answer["confidence"][1]]
        assert lines["4 ms"] == (pytest.approx(x), _near(expected))
    assert "only the speed changes" in " ".join(_drawn(data, "blur").get_supxlabel().split())


@pytest.mark.parametrize("lights_lux", [(10.0,), (10.0, 50.0), (10.0, 50.0, 200.0, 1000.0)])
def test_captions_stay_within_the_figure(tmp_path: Path, lights_lux: tuple[float, ...]) -> None:
    data = made_run(tmp_path, {"sign": 0.9}, lights_lux=lights_lux, n_examples=0)
    for view in charts.views(data):
        figure = _drawn(data, view.word)
        figure.canvas.draw()
        extent = figure._supxlabel.get_window_extent()
        assert figure.bbox.x0 <= extent.x0 < extent.x1 <= figure.bbox.x1, view.word


def test_exposures_beyond_the_grid_refine_the_curves_over_exposure_alone(tmp_path: Path) -> None:
    data = made_run(tmp_path, n_examples=0)
    grid = {"plan": {"grid": {"exposure_s": (0.001, 0.016, 0.064)}}}
    data = replace(data, manifest=data.manifest | grid)
    assert data.axes[0].values == (0.001, 0.016, 0.064, 0.004)
    assert _lines(_drawn(data, "exposure"), 1)["0 px/s"][0] == pytest.approx([1, 4, 16, 64])
    assert set(_lines(_drawn(data, "blur"), 1)) == {"1 ms", "16 ms", "64 ms"}


def test_every_model_has_its_own_panels(tmp_path: Path) -> None:
    one = _drawn(made_run(tmp_path, n_examples=0), "exposure")
    assert one.axes[0].get_title() == "stop sign 100 px\n10 lux · n = 12"
    data = made_run(tmp_path, n_examples=0, models=("first", "second"))
    figure = _drawn(data, "exposure")
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[0] == "first\nstop sign 100 px\n10 lux · n = 12"
    assert titles[4] == "second\nstop sign 100 px\n10 lux · n = 12"
    second = next(a for a in data.answers if a["model"] == "second")
    assert _lines(figure, 4)["0 px/s"][1] == _near(second["confidence"])


@pytest.mark.parametrize(("n_models", "n_groups", "n_lights"), [(1, 60, 7), (3, 9, 3), (5, 2, 4), (20, 2, 3)])
def test_panels_are_capped_and_what_is_left_out_is_said(
    tmp_path: Path, n_models: int, n_groups: int, n_lights: int
) -> None:
    data = made_run(
        tmp_path,
        {f"class {i}": 0.9 for i in range(n_groups)},
        EXPOSURES_S[:2],
        tuple(float(10 * 2**i) for i in range(n_lights)),
        (0.0,),
        n_examples=0,
        models=tuple(f"model {i}" for i in range(n_models)),
    )
    figure = _drawn(data, "exposure")
    shown = [axes.get_title() for axes in figure.axes if axes.get_title()]
    assert 1 < len(shown) <= figures.MAX_PANELS
    every = n_models * min(n_groups, 12) * n_lights
    assert f"{len(shown)} of {every} panels shown" in figure.get_supxlabel()
    assert ("12 of 60 groups of targets shown" in figure.get_supxlabel()) == (n_groups == 60)


def test_a_further_axis_has_a_figure_of_its_own(tmp_path: Path) -> None:
    data = made_run(tmp_path, n_examples=0, f_numbers=(1.4, 2.0, 2.8), temperatures_c=(25.0, 85.0))
    figure = _drawn(data, "f-number")
    assert figure.axes[3].get_title() == "stop sign 100 px\n200 lux · 85 °C · n = 12"
    own = [
        a for a in data.answers
        if (a["group"], a["illuminance_lux"], a["temperature_c"]) == ("stop sign 100 px", 200.0, 85.0)
        and a["velocity_x_px_s"] == 600.0
    ]  # fmt: skip
    assert _lines(figure, 3)["4 ms"] == ([1.4, 2.0, 2.8], _near([a["confidence"][1] for a in own]))
    assert figure.axes[0].get_xscale() == "log"
    assert list(figure.axes[0].get_xticks()) == [1.4, 2.0, 2.8]
    assert figure.get_supxlabel().splitlines()[:2] == ["f-number", "Held: 600 px/s."]
    assert _drawn(data, "temperature").axes[0].get_title() == "stop sign 100 px\n10 lux · f/1.4 · n = 12"


def test_points_of_one_speed_in_two_directions_are_not_joined(tmp_path: Path) -> None:
    data = made_run(tmp_path, n_examples=0)
    turned = [
        a | {"velocity_x_px_s": 0.0, "velocity_y_px_s": a["velocity_x_px_s"]}
        for a in data.answers
        if a["velocity_x_px_s"]
    ]
    both = replace(data, answers=data.answers + turned)
    labelled = [line for line in _drawn(both, "speed").axes[0].lines if "ms" in line.get_label()]
    assert {line.get_linestyle() for line in labelled} == {"None"}
    assert "(0, 600) px/s" in _lines(_drawn(both, "exposure"), 0)


def test_common_windows_are_the_intersection() -> None:
    assert common_windows([[[1, 5], [8, 9]], [[2, 8.5]], [[0, 20]]]) == [(2, 5), (8, 8.5)]
    assert common_windows([[[1, 2]], [[3, 4]]]) == []
    assert common_windows([[[1, 2]], []]) == common_windows([]) == []


def test_spread_keeps_both_ends() -> None:
    assert spread(range(100), 4) == [0, 33, 66, 99]
    assert spread("abc", 5) == ["a", "b", "c"]


def test_no_lines_have_no_colours() -> None:
    assert [len(line_colours("plasma", count)) for count in range(4)] == [0, 1, 2, 3]


def test_examples_keep_the_models_of_a_condition_together(tmp_path: Path) -> None:
    data = made_run(tmp_path, n_examples=9, models=("first", "second", "third"))
    data = replace(data, examples=data.examples[::-1])
    kept = data.spread_examples(16)
    assert [example["model"] for example in kept] == ["first", "second", "third"] * 5
    assert all(len({example["path"] for example in kept[i : i + 3]}) == 1 for i in range(0, 15, 3))
    assert replace(data, examples=[]).spread_examples(2) == []


def test_boxes_have_the_colour_of_their_outcome(tmp_path: Path) -> None:
    path = tmp_path / "grey.png"
    cv2.imwrite(str(path), np.full((100, 200, 3), 128, np.uint8))
    targets = [
        {"box_xyxy": [20, 40, 60, 80], "label": "a", "confidence": 0.61, "text": None},
        {"box_xyxy": [120, 40, 160, 80], "label": "a", "confidence": 0.59, "text": None},
    ]
    detections = [
        {"box_xyxy": [26, 44, 60, 80], "label": "a", "score": 0.61},  # the first target's own
        {"box_xyxy": [80, 40, 100, 80], "label": "b", "score": 0.29},  # too weak to be drawn
    ]
    example = {"path": str(path), "targets": targets, "detections": detections}
    picture = pictures.drawn_example(example, 400, THRESHOLD)
    assert picture is not None
    assert picture.shape == (200, 400, 3)
    left_edges = {x: {tuple(map(int, pixel)) for pixel in picture[90:150, x]} for x in (40, 52, 160, 240)}
    assert left_edges[40] == {pictures.FOUND_RGB}  # solid
    assert {pictures.MISSED_RGB, (128, 128, 128)} <= left_edges[240]  # dashed
    assert left_edges[52] == left_edges[160] == {(128, 128, 128)}
    stronger = example | {"detections": [detections[1] | {"score": 0.31}]}
    drawn = pictures.drawn_example(stronger, 400, THRESHOLD)
    assert drawn is not None
    assert np.abs(drawn[120, 160] - np.array(pictures.OTHER_RGB)).max() < 20  # antialiased


def test_what_was_read_is_written_at_its_box(tmp_path: Path) -> None:
    path = tmp_path / "grey.png"
    cv2.imwrite(str(path), np.full((100, 200, 3), 128, np.uint8))
    target = {"box_xyxy": [20, 40, 60, 80], "label": "text", "confidence": 0.9, "text": "I"}
    short, long = (
        pictures.drawn_example(
            {"path": str(path), "detections": [], "targets": [target | {"text": text}]}, 400, 0.6
        )
        for text in ("I", "WWWWWWWW")
    )
    assert short is not None
    assert long is not None
    black = [(picture == (20, 20, 20)).all(axis=2).any(axis=0).sum() for picture in (short, long)]
    assert black[1] > 3 * black[0]
    example = {"error": None, "detections": [], "targets": [target, target | {"text": "", "confidence": 0.0}]}
    assert words.outcome_text(example, 0.6) == "read “I”, confidence 0.90; read nothing"
    assert words.outcome_text(example | {"error": "bad"}, 0.6) == "the model failed: bad"


def test_a_line_for_each_of_what_moves_over_speed(tmp_path: Path) -> None:
    """A panel per exposure, at the middle light; only of runs in which several things move."""
    speeds = (0.0, 300.0, 600.0)
    data = made_run(tmp_path, n_examples=0, speeds=speeds, moves=(0.0, 1.0, 2.0))
    figure = _drawn(data, "motion")
    assert "Held: 200 lux." in figure.get_supxlabel()
    for place, exposure_s in enumerate(EXPOSURES_S):
        assert figure.axes[place].get_title().startswith(f"stop sign 100 px\n{1e3 * exposure_s:g} ms")
        for kind, (x, scores) in enumerate(_lines(figure, place).values()):
            expected = [
                answer["confidence"][place]
                for answer in data.answers
                if (answer["group"], answer["moves"]) == ("stop sign 100 px", kind)
                and answer["illuminance_lux"] == 200.0
            ]
            assert (x, scores) == (list(speeds), _near(expected))
        assert list(_lines(figure, place)) == ["all moves", "targets move", "background moves"]
