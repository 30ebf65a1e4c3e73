"""What stands beside the answer: a figure with the recommended scores, and two pictures that differ in exposure."""

from dataclasses import replace

import pytest
from blurnoise_eval.report import findings, first_screen
from blurnoise_eval.report.opening import opening
from blurnoise_eval.report.page import write_report
from made_runs import made_run
from read_pages import Page


def heights_to_scores(figure, most=1.0):
    zero, one = (next(y for y, text in figure.y if text == name) for name in ("0", "1"))
    return lambda y: most * (zero - y) / (zero - one)


def test_the_figure_has_the_score_of_each_light_at_its_exposure(tmp_path):
    data = made_run(tmp_path, n_examples=0)
    figure = first_screen.main_figure(data, data.model_names[0])
    score_of = heights_to_scores(figure)
    lights = [row for row in data.recommendations if row.scope == "light"]
    assert [line.name for line in figure.lines] == ["10 lux", "200 lux"]
    for line, row in zip(figure.lines, lights, strict=True):
        # the mean over speeds and kinds of target, as that of the table; a pixel is 0.005
        assert score_of(line.chosen[1]) == pytest.approx(row.score.known, abs=1e-3)
        assert line.chosen[0] in [x for x, _ in line.points]
        assert len(line.points) == 4
        of = [a for a in data.answers if a.conditions["illuminance_lux"] == row.conditions["illuminance_lux"]]
        shortest = sum(answer.confidence[0] for answer in of) / len(of)
        assert score_of(line.points[0][1]) == pytest.approx(shortest, abs=1e-3)
    assert score_of(figure.level) == pytest.approx(0.6, abs=1e-3)
    assert [text for _, text in figure.x] == ["1", "4", "16", "64"]


def test_the_figure_of_one_light_has_a_line_for_each_speed(tmp_path):
    data = made_run(tmp_path, lights_lux=(200.0,), models=("a", "b"), n_examples=0)
    figure = first_screen.main_figure(data, "b")
    rows = [row for row in data.recommendations if (row.scope, row.model) == ("condition", "b")]
    assert [line.name for line in figure.lines] == ["0 px/s", "600 px/s"]
    scores = [heights_to_scores(figure)(line.chosen[1]) for line in figure.lines]
    assert scores == pytest.approx([row.score.known for row in rows], abs=1e-3)
    assert figure.title == "b: mean confidence over the exposure, mean of kinds of target"


@pytest.mark.parametrize(
    ("models", "lines"),
    [(("a",), ["0 px/s", "600 px/s"]), (("a", "b"), ["a", "b"])],
    ids=["speeds", "models"],
)
def test_the_figure_of_one_exposure_is_over_the_light(tmp_path, models, lines):
    data = made_run(tmp_path, exposures_s=(0.004,), models=models, n_examples=0)
    figure = first_screen.main_figure(data, "a")
    assert [line.name for line in figure.lines] == lines
    assert [text for _, text in figure.x] == ["10", "200"]
    of_a = {"model": "a"} if len(models) == 2 else {"model": "a", "velocity_x_px_s": 0.0}
    rows = [
        {"model": row.model, "velocity_x_px_s": row.conditions["velocity_x_px_s"]} for row in data.answers
    ]
    chosen = [
        answer.confidence[0]
        for answer, row in zip(data.answers, rows, strict=True)
        if answer.conditions["illuminance_lux"] == 200.0 and of_a.items() <= row.items()
    ]
    drawn = heights_to_scores(figure)(figure.lines[0].points[-1][1])
    assert drawn == pytest.approx(sum(chosen) / len(chosen), abs=3e-3)


def test_the_only_exposure_is_not_called_the_best(tmp_path):
    data = made_run(tmp_path, exposures_s=(0.004,), n_examples=0)
    none = [replace(row, n_works=0, verdict="cannot tell") for row in data.recommendations]
    assert (
        opening(replace(data, recommendations=none))
        .sentences[0]
        .startswith("The only tested exposure is 4 ms.")
    )


@pytest.mark.parametrize("shape", [{"exposures_s": (0.004,), "lights_lux": (200.0,)}, {"groups": {}}])
def test_without_two_conditions_or_targets_there_is_no_figure(tmp_path, shape):
    data = made_run(tmp_path, n_examples=0, **shape)
    assert first_screen.main_figure(data, opening(data).model) is None
    assert "<svg" not in write_report(data, tmp_path).read_text().split("</main>")[0]


def examples(data, *every):
    """Examples of (ms, lux, confidence, saturated share), and of some the signal to noise, dB."""
    (made,) = (each for each in data.examples if not each.cell.conditions.original)
    for ms, lux, confidence, saturated, *snr_db in every:
        at = made.cell.conditions.but(exposure_s=ms / 1e3, illuminance_lux=lux)
        snr = {"snr_db": snr_db[0]} if snr_db else {}
        cell = replace(made.cell, conditions=at, saturated_share=saturated, **snr)
        targets = tuple(replace(target, confidence=confidence) for target in made.targets)
        yield replace(made, cell=cell, targets=targets)


@pytest.mark.parametrize(
    ("every", "chosen"),
    [
        (((1, 10, 0.9, 0), (64, 10, 0.1, 0), (4, 200, 0.9, 0), (64, 200, 0.1, 0)), [1, 64]),  # the darker
        (((64, 10, 0.9, 0), (4, 200, 0.9, 0), (1, 200, 0.1, 0)), [4, 1]),  # of one light
        (((4, 200, 0.9, 0), (1, 200, 0.1, 0), (64, 200, 0.1, 0.9)), [4, 1]),  # no white picture
        (((1, 10, 0.9, 0), (4, 10, 0.9, 0)), [1, 4]),  # both find all
        (((1, 10, 0.9, 0), (4, 10, 0.9, 0.5)), []),
        # nothing but noise teaches as little as white, however much is lost there
        (((64, 10, 0.9, 0), (1, 10, 0.1, 0, -20.0), (4, 200, 0.9, 0), (1, 200, 0.1, 0)), [4, 1]),
        (((64, 10, 0.9, 0), (1, 10, 0.1, 0, -20.0)), [64, 1]),  # where nothing else is
    ],
)
def test_the_pair_shows_what_the_exposure_does(tmp_path, every, chosen):
    data = made_run(tmp_path)
    data = replace(data, examples=[*examples(data, *every)])
    pair = first_screen.pair(data, data.model_names[0])
    assert [1e3 * each.cell.conditions.exposure_s for each in pair] == pytest.approx(chosen)


def test_what_finds_nothing_has_no_exposure_to_use(tmp_path):
    data = made_run(tmp_path, n_examples=0)
    nothing = [replace(row, score=row.score._replace(value=0.04)) for row in data.recommendations]
    (said,) = opening(replace(data, recommendations=nothing)).sentences
    assert said == "No exposure works, and none can be recommended: the best reaches mean confidence 0.04."


def test_a_saturated_exposure_of_a_light_is_said(tmp_path):
    data = made_run(tmp_path, n_examples=0)
    bright = [
        replace(row, saturated_share=0.41 if row.conditions["illuminance_lux"] == 200.0 else 0.0)
        for row in data.recommendations
        if row.scope != "all"
    ]
    said = opening(replace(data, recommendations=bright)).sentences[0]
    assert "It saturates 41 % of the picture at 200 lux." in said


def test_combinations_are_counted_once(tmp_path):
    """Two directions of a speed are one entry of the table, and two combinations in all sentences."""
    data = made_run(tmp_path, n_examples=0)
    both = [
        replace(row, n_conditions=2 * row.n_conditions, n_works=0, n_fails=0, verdict="cannot tell")
        for row in data.recommendations
    ]
    shown = opening(replace(data, recommendations=both))
    assert "of 8 combinations of light, speed and direction" in " ".join(shown.sentences)
    assert "the verdict on 8 of 8 combinations is open" in dict(shown.notes)["What to do next"]


def test_page_has_figure_and_pair_before_what_is_folded(tmp_path):
    data = made_run(tmp_path)
    page = write_report(
        replace(data, examples=[*examples(data, (1, 10, 0.9, 0), (64, 10, 0.1, 0))]), tmp_path
    )
    html = page.read_text()
    folded = html.index("<details")
    assert html.index('<svg viewBox="0 0 460 250"') < folded
    assert html[:folded].count("data:image/jpeg") == 2


ASSUMED = ("f_number", "transmission", "row_noise_e", "prnu", "dsnu_e", "ccm")


def test_many_assumptions_are_three_sentences(tmp_path):
    """And all of their names are below, folded."""
    data = made_run(tmp_path, n_examples=0)
    camera = {"name": "mine", **dict.fromkeys(ASSUMED, 1.4), "full_well_e": 9.0}
    camera["sources"] = {**dict.fromkeys(ASSUMED, "assumed: the usual"), "full_well_e": "measured"}
    data = replace(data, manifest=data.manifest | {"camera": camera})
    line = next(each for each in findings.assumptions(data) if each.startswith("mine"))
    assert line == (
        "mine: 6 of 7 figures are assumed, as no source gives them. An error of f number and transmission shifts "
        "every exposure. Of the others, 3 are of noise, which counts in the dark, and 1 is of gain, colour or lens."
    )
    assert (
        "mine: f number, transmission, row noise e, prnu, dsnu e, ccm"
        in Page(write_report(data, tmp_path)).text
    )
