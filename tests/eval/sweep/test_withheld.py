"""Detectors without answers, and what is taken for targets where nothing is labelled."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import matched_filter
import pytest
from blurnoise_eval.datasets import rendered_signs, write_picture
from blurnoise_eval.sweep.score_tables import LEAST_AP50, models_withheld
from commands import main

Output = pytest.CaptureFixture[str]


@pytest.mark.parametrize(
    ("ap50", "kind", "labelled", "withheld"),
    [
        (LEAST_AP50 - 0.001, "detector", True, True),
        (LEAST_AP50, "detector", True, False),
        (None, "detector", True, False),
        (0.0, "reader", True, False),
        (0.0, "detector", False, False),
    ],
)
def test_a_detector_of_no_precision_is_withheld(
    ap50: float | None, kind: str, labelled: bool, withheld: bool
) -> None:
    manifest = {"models": [{"name": "m", "kind": kind}], "images": {"labelled": labelled}}
    scores = [{"model": "m", "clean": 0, "ap50": 0.9}, {"model": "m", "clean": 1, "ap50": ap50}]
    assert list(models_withheld(manifest, scores)) == (["m"] if withheld else [])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two pictures of signs, a detector of them, and labels that lie elsewhere."""
    path = tmp_path_factory.mktemp("photos")
    images: list[dict[str, Any]] = []
    for number, picture in enumerate(rendered_signs([32], count=2), 1):
        write_picture(path / f"{number}.png", picture.load())
        height, width = picture.load().shape[:2]
        images.append({"id": number, "file_name": f"{number}.png", "width": width, "height": height})
    labels = [
        {"id": number, "image_id": number, "category_id": 1, "bbox": [1, 1, 9, 9], "area": 81, "iscrowd": 0}
        for number in (1, 2)
    ]
    told = {"images": images, "annotations": labels, "categories": [{"id": 1, "name": "stop sign"}]}
    (path / "labels.json").write_text(json.dumps(told))
    matched_filter.build(path / "m.onnx", sizes_px=(48, 32, 24), input_px=320)
    return path


def swept(folder: Path, output: Path, *options: str) -> list[str]:
    grid = ("--exposure-ms", "5", "--lux", "500", "--dx", "0", "--camera", "imx250")
    return ["sweep", "--model", str(folder / "m.onnx"), *options, *grid, "-o", str(output)]


def test_a_run_of_such_a_detector_gives_the_reason_and_no_exposure(
    folder: Path, tmp_path: Path, capsys: Output
) -> None:
    assert main(swept(folder, tmp_path / "run", "--coco", str(folder / "labels.json"))) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert (
        "m: no exposure is recommended, because its AP50 in the original pictures is 0.000, below 0.05" in out
    )
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert list(summary["withheld_models"]) == ["m"]
    assert summary["answers"] == []
