"""Maps of runs: the command from end to end, and what it says where a run is too small to tell."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.maps import figures
from blurnoise_eval.maps.maps import Map, Maps, sentences, write
from blurnoise_eval.quality.measure import METRICS
from blurnoise_models import matched_filter
from commands import Output, main
from made_maps import KEEP, plane, scores_at


def made(**grid: Any) -> Maps:
    """A detector that needs light and dislikes blur, before sixteen metrics that know all, but the second light
    alone, and the third nothing."""
    of = plane(**grid)
    u, w = of.places.T
    values = 1 / (1 + np.exp(-u)) / (1 + np.exp(3 * w - 3))
    metrics = dict.fromkeys((metric.name for metric in METRICS), values)
    metrics |= {METRICS[0].name: values**2, METRICS[1].name: u}
    metrics |= {METRICS[2].name: np.full(len(of), np.nan)}
    return Maps(KEEP, of, metrics, (Map.of(of, metrics, scores_at(of, values)),))


def test_the_answer_opens_with_what_ranks_best_and_what_misleads() -> None:
    (text,) = sentences(made())
    assert text.startswith("m, signs: MTF50 across x ranks conditions best (rank correlation 1.00")
    assert "1 of 16 metrics cannot be told" in text
    assert "MTF50 across y misleads: 1.00 along light alone" in text
    assert "ends of windows" in text


def test_a_metric_that_may_not_rank_at_all_is_not_called_best() -> None:
    maps = made()
    (each,) = maps.every
    ranks = tuple(
        row._replace(spearman=0.3, low=-0.1 - 0.01 * place, high=0.7) for place, row in enumerate(each.ranks)
    )
    (text,) = sentences(replace(maps, every=(replace(each, ranks=ranks),)))
    assert (
        "no metric surely ranks conditions; the best is MTF50 across x (rank correlation 0.30, -0.10 to"
        in text
    )


@pytest.mark.parametrize(
    ("grid", "expected"),
    [
        ({"speeds": (0.0,)}, "The closed form's error cannot be told: light or blur does not vary"),
        ({"exposures_s": (0.01,)}, "cannot tell which metric ranks conditions"),
    ],
)
def test_what_cannot_be_told_is_said(grid: dict[str, Any], expected: str) -> None:
    wide = {"lights_lux": (0.3, 1.0, 7.0, 50.0, 360.0)} if "speeds" in grid else {}
    (text,) = sentences(made(**grid, **wide))
    assert expected in text


def test_tables_are_written_whole(tmp_path: Path) -> None:
    maps = made()
    write(maps, tmp_path)
    with (tmp_path / "maps.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["metric"] for row in rows] == [metric.name for metric in METRICS]
    columns = (
        "model metric score group n_nodes spearman low high share_told r2_h r2_l auc along_light along_blur"
    )
    assert list(rows[0]) == columns.split()
    assert (rows[2]["spearman"], rows[2]["share_told"]) == ("", "0.0")
    document = json.loads((tmp_path / "predictor.json").read_text(encoding="utf-8"))
    assert len(document["fitted"][0]["coefficients"]) == 6
    with (tmp_path / "nodes.csv").open(encoding="utf-8") as file:
        assert len(list(csv.DictReader(file))) == len(maps.nodes)


def test_a_surface_is_the_mean_nearby_and_blank_afar() -> None:
    """Two far points keep their values; between them there is nothing; each lies off nobody."""
    x, y = np.array([0.0, 10.0]), np.array([0.0, 10.0])
    surface, off = figures.smoothed(
        x, y, np.array([0.2, 0.8]), np.array([0.0, 5.0, 10.0]), np.array([0.0, 5.0, 10.0])
    )
    assert surface[0, 0] == pytest.approx(0.2)
    assert surface[2, 2] == pytest.approx(0.8)
    assert np.isnan(surface[1, 1])
    assert np.isnan(surface[0, 2])
    assert np.isnan(off)


def test_points_that_share_a_place_lie_off_each_other() -> None:
    x = np.array([0.0, 0.0, 10.0])
    surface, off = figures.smoothed(x, x, np.array([0.2, 0.6, 0.9]), x[:1], x[:1])
    assert surface[0, 0] == pytest.approx(0.4)
    assert off == pytest.approx(0.4)  # each of the pair off the other; the third is off nobody


@pytest.mark.slow
@pytest.mark.parametrize("grid", [{}, {"speeds": (0.0,)}, {"exposures_s": (0.01,)}])
def test_figures_of_any_grid(tmp_path: Path, grid: dict[str, Any]) -> None:
    written = figures.write(made(**grid), tmp_path)
    assert [path.name for path in written] == [
        f"{name}.png" for name in ("map-exposure-signs", "map-blur-signs", "scatter-signs")
    ]
    assert all(path.stat().st_size > 10_000 for path in written)


def sweep(tmp_path: Path, *conditions: str) -> Path:
    """A run of the matched filter before one small rendered sign."""
    model = matched_filter.build(tmp_path / "small.onnx", sizes_px=(100, 50, 32), input_px=160)
    run = tmp_path / "run"
    words = ["--limit", "2", "--no-refine", "--threads", "1", "-o", str(run)]
    assert main(["sweep", "--model", str(model), *conditions, *words]) == 0
    return run


@pytest.mark.slow
def test_the_command(tmp_path: Path, capsys: Output) -> None:
    grid = ("--exposure-ms", "1,4,16,64", "--lux", "1,30,900", "--dx", "0,300")
    run, out = sweep(tmp_path, *grid), tmp_path / "maps"
    capsys.readouterr()
    assert main(["maps", str(run), "-o", str(out), "--threads", "1"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert all(len(line) <= 80 for line in lines[:-1])
    with (out / "maps.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["score"] for row in rows} == {"target_confidence", "detection_rate", "ap50"}
    assert {row["n_nodes"] for row in rows} == {"24"}
    with (out / "nodes.csv").open(encoding="utf-8") as file:
        nodes = list(csv.DictReader(file))
    assert len(nodes) == 24
    assert sorted({float(node["light_lux_s"]) for node in nodes})[:2] == pytest.approx([0.001, 0.004])


@pytest.mark.slow
def test_the_command_on_one_condition_says_that_it_cannot_tell(tmp_path: Path, capsys: Output) -> None:
    run = sweep(tmp_path, "--exposure-ms", "10", "--lux", "50", "--dx", "0")
    capsys.readouterr()
    assert main(["maps", str(run), "-o", str(tmp_path / "maps"), "--json"]) == 0
    answers = json.loads(capsys.readouterr().out)["answers"]
    assert answers
    assert all(answer["best"] is None and answer["closed_form"] is None for answer in answers)


def test_a_folder_without_a_run_is_refused(tmp_path: Path, capsys: Output) -> None:
    assert main(["maps", str(tmp_path), "-o", str(tmp_path / "maps")]) == 2
    assert capsys.readouterr().err.startswith("blurnoise: error: run = ")
    assert not (tmp_path / "maps").exists()
