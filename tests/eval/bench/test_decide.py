"""The bench of searches: planes of a detector, and methods replayed on them."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import populations_on_planes as made
import pytest
from blurnoise_eval.bench import decide, decide_planes, decide_view
from blurnoise_eval.bench.decide import QUICK, SCENARIOS, Extent, Row, Truth
from blurnoise_eval.bench.decide_planes import Planes
from blurnoise_eval.cli import main
from blurnoise_eval.datasets import rendered_signs
from blurnoise_eval.deciding.nodes import FLOOR
from blurnoise_eval.deciding.search import Search
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.grid.axes import AUTOMATIC
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.sweep.evaluation import evaluate
from blurnoise_models.detector import STOP_SIGN

from blurnoise import Camera

DATA = Path(__file__).parents[2] / "data"
TINY = Extent(2, SCENARIOS[:1], 1)


def closed_form() -> Planes:
    places = decide.nodes_of(QUICK)
    sums = (made.photographs(places) * made.REFERENCES[:, None])[None]
    clusters = tuple(f"picture {number}" for number in range(made.PICTURES))
    clean = made.REFERENCES[None]
    return Planes("made", "imx250", "fixed", places, ("all",), clusters, sums, clean, np.ones_like(clean))


@pytest.fixture(scope="module")
def bench() -> decide.Bench:
    return decide.measure([closed_form()], QUICK)


def rows(bench: decide.Bench, method: str) -> list[Row]:
    return [row for row in bench.rows if row.method == method]


def test_truth_is_the_plane_and_smooth_between() -> None:
    truth = Truth(closed_form())
    places = decide.nodes_of(QUICK)
    kept, error = truth.seen(places)
    expected = made.seen(made.photographs, places)
    assert kept[0] == pytest.approx(expected.mean, abs=1e-6)
    assert error[0] == pytest.approx(expected.error, abs=1e-6)
    between = places[places[:, 1] > 0][:60] + 0.13
    assert np.abs(truth.seen(between)[0][0] - made.seen(made.photographs, between).mean).max() < 0.03


def test_groups_of_which_the_model_knows_nothing_are_withheld() -> None:
    plane = closed_form()
    twice = replace(
        plane, groups=("all", "none"), sums=np.concatenate([plane.sums, 0.001 * plane.sums]),
        clean=np.concatenate([plane.clean, 0.001 * plane.clean]), targets=np.ones((2, made.PICTURES)),
    )  # fmt: skip
    assert Truth(twice).questions == 1


def test_finer_grids_are_nearer(bench: decide.Bench) -> None:
    wrong = [row.wrong for row in rows(bench, "grid")]
    assert wrong == sorted(wrong, reverse=True)
    assert [row.share for row in rows(bench, "grid")] == [0.4, 0.6, 1.0, 2.0]
    half, quarter = rows(bench, "bisection")
    assert quarter.calls > half.calls
    assert quarter.wrong < half.wrong


def test_the_search_is_accepted(bench: decide.Bench) -> None:
    """At its own end: a quarter of the grid's calls, edges no farther off; nearer than random nodes, as many."""
    end = rows(bench, "search")[-1]
    grid = next(row for row in rows(bench, "grid") if row.share == 1)
    assert end.own_end
    assert end.share <= 0.25
    assert end.median <= min(0.05, grid.median)
    assert end.missed <= grid.missed
    assert end.misfit is not None
    assert end.misfit < 1.5
    assert end.wrong < min(row.wrong for row in rows(bench, "random nodes") if row.calls <= end.calls)
    assert bench.losses() == []


def test_losses_are_named(bench: decide.Bench) -> None:
    worse = [replace(row, share=0.3) if row.own_end else row for row in bench.rows]
    (loss,) = decide.Bench(worse, QUICK, {}).losses()
    assert "0.300 of the grid's calls" in loss


@pytest.mark.slow
def test_replay_of_a_detector() -> None:
    """The built-in detector before 8 pictures of signs, as ``blurnoise bench decide`` makes it: few, and cliffs. With
    46 nodes half of the edges are nearer than by the grid of 200 conditions."""
    truth = Truth(Planes.read(DATA / "planes-fixed.npz"))
    on = decide._Lines(truth, SCENARIOS[0])
    about = {"plane": "", "scenario": "", "method": "", "calls": 0, "share": 0.0}
    grid = on.row(decide._between(truth, on, np.geomspace(*decide.EXPOSURES, 10)), **about)
    search = Search(on.lines, decide.EXPOSURES, decide.LEVELS)
    while len(search.nodes) < 46:
        places = search.ask()
        search.tell(places, *truth.seen(places))
    row = on.row(decide._surfaces(truth, on, search.nodes)[0], **about)
    assert truth.questions == 3
    assert row.median <= grid.median
    assert row.missed <= 2


@pytest.mark.slow
def test_a_plane_is_what_a_sweep_sees(tmp_path: Path) -> None:
    """The same sums as of the store's rows under the conditions of the nodes; at rest the floor."""
    pictures, camera = rendered_signs(count=2), Camera.preset("imx250")
    places = np.array([[-3.0, FLOOR], [-6.0, 3.0], [-8.5, 2.5]])
    for gain_db in (None, AUTOMATIC):
        found = decide_planes.computed(Detector(STOP_SIGN), pictures, camera, places, gain_db)
        for node, place in enumerate(places):
            at = decide_planes.conditions_at(place, gain_db).stated
            plan = SweepPlan({name: (value,) for name, value in at.items()}, examples=False)
            run = evaluate(STOP_SIGN, pictures, camera, plan, tmp_path / f"{gain_db}-{node}", progress=False)
            for group, name in enumerate(found.groups):
                for cluster, image in enumerate(found.clusters):
                    own = [t for t in run.targets if t["group"] == name and t["image"] == image]
                    sums = [
                        sum(t["confidence"] for t in own if t["clean"] == clean) for clean in (False, True)
                    ]
                    assert [found.sums[group, cluster, node], found.clean[group, cluster]] == pytest.approx(
                        sums
                    )
                    assert found.targets[group, cluster] == sum(t["clean"] for t in own)
    path = tmp_path / "planes.npz"
    found.write(path)
    again = Planes.read(path)
    assert again.sums == pytest.approx(found.sums, abs=1e-6)
    assert (again.model, again.gain, again.groups, again.clusters) == (
        found.model, "automatic", found.groups, found.clusters,
    )  # fmt: skip


@pytest.mark.slow
def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Planes that are there already are used; tables, JSON and a chart are written."""
    monkeypatch.setattr(decide, "QUICK", TINY)
    pictures = rendered_signs(count=2)
    model = Detector(STOP_SIGN).name
    names = tuple(picture.name for picture in pictures)
    for gain in ("fixed", "automatic"):
        plane = closed_form()
        few = replace(
            plane, model=model, gain=gain, clusters=names, sums=plane.sums[:, :2], clean=plane.clean[:, :2],
            targets=plane.targets[:, :2],
        )  # fmt: skip
        few.write(tmp_path / f"planes-{gain}.npz")
    assert main(["bench", "decide", "--quick", "-o", str(tmp_path)]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "5 lights, 4 speeds" in shown
    assert "bisection" in shown
    document = json.loads((tmp_path / "decide.json").read_text())
    with (tmp_path / "decide.csv").open() as file:
        table = list(csv.DictReader(file))
    assert len(table) == len(document["rows"]) > 20
    assert {row["method"] for row in table} == set(decide.METHODS)
    assert cv2.imread(str(tmp_path / "decide.png")).std() > 10


def test_tables_mark_the_end(bench: decide.Bench) -> None:
    (table,) = decide_view.tables(bench)
    assert any("*" in str(cell) for cell in table.columns[1].cells)


def test_images_go_with_coco(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "decide", "--images", str(tmp_path), "-o", str(tmp_path / "b")]) == 2
    assert "--coco" in capsys.readouterr().err
