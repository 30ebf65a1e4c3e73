from __future__ import annotations

import csv
import json
import sys
from dataclasses import replace
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from blurnoise_eval.bench import chain, chain_view
from blurnoise_eval.bench.chain import (
    ALBUMENTATIONS,
    BATCH,
    BLUR,
    COLOUR,
    KORNIA,
    NOISE,
    PICTURE,
    PICTURES,
    WHOLE,
    YARDSTICK,
    Bench,
    Extent,
    Row,
)
from blurnoise_eval.bench.timing import Quartiles
from blurnoise_eval.cli import main

Output = pytest.CaptureFixture[str]
SMALL = replace(BATCH, shape=(3, 3, 61, 73), length_px=7.0)
TINY = Extent((SMALL, PICTURE), fewest=1, most=2, seconds=0)
NAMES = [*WHOLE.values(), PICTURES, BLUR, *NOISE.values(), KORNIA, YARDSTICK]


@pytest.fixture(scope="module")
def tiny() -> tuple[Bench, float]:
    shares: list[float] = []
    bench = chain.measure(TINY, 1, shares.append)
    return bench, sum(shares)


def test_bench_measures_everything(tiny: tuple[Bench, float]) -> None:
    bench, done = tiny
    assert done == pytest.approx(chain.steps(TINY))
    for case in TINY.cases:
        assert set(NAMES) <= {row.name for row in bench.rows if row.case == case.name}
        assert bench.row(case.name, YARDSTICK).to_randn == 1
        ratio = bench.row(case.name, KORNIA).ms.median / bench.row(case.name, YARDSTICK).ms.median
        assert bench.row(case.name, KORNIA).to_randn == pytest.approx(ratio)


def test_case_is_the_scene_it_says() -> None:
    """31 px and a disc of 1.5 px, another angle for each picture, light that neither clips nor vanishes."""
    assert len(set(BATCH.angles_deg)) == 8
    assert (BATCH.length_px, BATCH.camera.optics.defocus_radius_px, BATCH.encoding) == (31, 1.5, "linear")
    assert BATCH.camera.dark_current_e_s > 0
    calls = chain._calls(SMALL)
    frames = {name: calls[name][1]() for name in (*WHOLE.values(), *NOISE.values())}
    for dn in frames.values():
        assert dn.shape == SMALL.shape
        assert torch.equal(dn, dn.round())
        assert 100 < float(dn.mean()) < 0.6 * SMALL.camera.full_scale_dn
    assert torch.equal(frames[WHOLE["auto"]], frames[NOISE["auto"]])  # the stages make up the whole
    assert torch.equal(frames[WHOLE["full"]], frames[NOISE["full"]])
    assert not torch.equal(frames[WHOLE["full"]], frames[WHOLE["auto"]])
    grey, colour = calls[PICTURES][1](), calls[COLOUR][1]()
    assert grey.shape == colour.shape == SMALL.shape  # as many values
    assert grey.dtype == colour.dtype == torch.uint8
    assert COLOUR not in chain._calls(replace(PICTURE, shape=(1, 1, 20, 30)))
    blurred, other = calls[BLUR][1](), calls[KORNIA][1]()
    assert float(blurred.std()) < 0.2 < 0.28 < float(torch.rand(9999).std())
    assert other.shape == SMALL.shape


def test_one_picture_keeps_its_facts(tiny: tuple[Bench, float]) -> None:
    bench, _ = tiny
    facts = bench.document()
    assert facts["median_ms"] == bench.row(PICTURE.name, WHOLE["auto"]).ms.median
    assert facts["faster_than_papers_tool"] == pytest.approx(1e3 / facts["median_ms"])
    assert "median_ms" not in replace(bench, extent=Extent((SMALL,))).document()


def measured(**ms: float) -> Bench:
    names = {
        "auto": WHOLE["auto"],
        "full": WHOLE["full"],
        "blur": BLUR,
        "noise": NOISE["auto"],
        "kornia": KORNIA,
    }
    kinds = {"auto": "whole", "full": "whole", "blur": "stage", "noise": "stage", "kornia": "other"}
    rows = [Row("batch", names[name], kinds[name], Quartiles(t, t, t), t) for name, t in ms.items()]
    return Bench(rows, Extent((BATCH,)), {})


def test_rest_is_what_the_stages_leave() -> None:
    assert measured(auto=10, blur=6, noise=3).rest_ms("batch", "auto") == 1


def test_losses_are_told() -> None:
    assert measured(auto=10, full=10, kornia=9.9).losses() == []
    assert measured(auto=10, full=20, kornia=15).losses() == [
        f"batch: {KORNIA} takes 0.75 of the time of simulate, full"
    ]


def test_bench_is_written_whole(tiny: tuple[Bench, float], tmp_path: Path) -> None:
    bench, _ = tiny
    chain.write(bench, tmp_path)
    chain_view.write(bench, tmp_path)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["simulate.csv", "simulate.json", "simulate.png"]
    with (tmp_path / "simulate.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["name"] for row in rows] == [row.name for row in bench.rows]
    assert [float(row["ms_median"]) for row in rows] == [row.ms.median for row in bench.rows]
    document = json.loads((tmp_path / "simulate.json").read_text())
    assert len(document["rows"]) == len(rows)
    assert set(document["profile_ms"][SMALL.name]["auto"]) == {"blur", "noise", "rest"}
    picture = cv2.imread(str(tmp_path / "simulate.png"))
    assert picture.shape[0] > 800
    assert picture.std() > 10


@pytest.mark.slow
def test_command(tmp_path: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chain, "QUICK", TINY)
    folder = tmp_path / "new" / "bench"
    assert main(["bench", "simulate", "--quick", "--threads", "1", "-o", str(folder)]) == 0
    shown = capsys.readouterr().out
    assert all(name in shown for name in NAMES)
    assert "the tool of Lin et al. 2024" in shown.replace("\n", " ")
    assert main(["bench", "simulate", "--quick", "--threads", "1", "-o", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads((folder / "simulate.json").read_text())


class Compose:
    """What albumentations promises of its transforms: called by name with (H, W, C), a dict comes back."""

    def __init__(self, transforms: list[dict[str, Any]]) -> None:
        assert transforms[0]["blur_limit"] == (7, 7)
        assert [each["p"] for each in transforms] == [1, 1, 1]

    def __call__(self, image: np.ndarray) -> dict[str, np.ndarray]:
        assert image.dtype == np.float32
        assert image.shape == (61, 73, 3)
        return {"image": image}


@pytest.mark.parametrize("newest", ["ShotNoise", "MotionBlur"])
def test_albumentations_is_measured_where_it_can_be(monkeypatch: pytest.MonkeyPatch, newest: str) -> None:
    module = ModuleType("albumentations")
    module.__spec__ = ModuleSpec("albumentations", None)
    for name in ("MotionBlur", "GaussNoise", newest):
        monkeypatch.setattr(module, name, dict, raising=False)
    monkeypatch.setattr(module, "Compose", Compose, raising=False)
    monkeypatch.setitem(sys.modules, "albumentations", module)
    calls = chain._calls(SMALL)
    assert (ALBUMENTATIONS in calls) == (newest == "ShotNoise")
    if ALBUMENTATIONS in calls:
        assert len(calls[ALBUMENTATIONS][1]()) == 3
