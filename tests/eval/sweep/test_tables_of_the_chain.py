"""Made-up entries of the chain's tables take part in sweeps and explanations; targets move with the picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.datasets import Picture, PictureSet, Target
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.report.run import read_run
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep import run as sweep
from blurnoise_eval.sweep import run_folder
from blurnoise_models import matched_filter
from made_up import Pedestal, Shift, Veil
from numpy.typing import NDArray
from plans import plan as swept

from blurnoise import Camera, charts
from blurnoise.light import effects
from blurnoise.optics.colour import srgb_from_linear
from blurnoise.sensor import stages

SIZE_PX, HEIGHT_PX, WIDTH_PX = 24, 96, 128
CAMERA = Camera.preset("imx250")


def sign() -> NDArray[np.uint8]:
    linear = charts.stop_sign(SIZE_PX, height_px=HEIGHT_PX, width_px=WIDTH_PX)
    return (srgb_from_linear(linear)[0].permute(1, 2, 0).numpy() * 255).round().astype(np.uint8)


BOX = tuple(float(edge) for edge in charts.stop_sign_box(SIZE_PX, height_px=HEIGHT_PX, width_px=WIDTH_PX))
PICTURES = PictureSet(
    "folder", "memory", (Picture("p", (Target("stop sign", "a sign", BOX),), sign, "rendered"),)
)


@pytest.fixture(scope="module")
def detector(tmp_path_factory: pytest.TempPathFactory) -> Detector:
    path = tmp_path_factory.mktemp("model") / "small.onnx"
    return Detector(matched_filter.build(path, sizes_px=(24, 16, 10), input_px=128))


def rows_of(detector: Detector, folder: Path) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Exposed targets, and scores."""
    plan = swept((0.01,), (100.0,), (0.0, 300.0))
    with Store(folder, create=True) as store:
        facts = {"command": "c", "threads": 1}
        run_folder.open_run(store, [detector], CAMERA, PICTURES, plan, facts)
        sweep.run([detector], CAMERA, PICTURES, plan, store)
        data = read_run(store, Criterion(0.6, kept=False))
        targets = [row for row in store.targets() if not row["clean"]]
    return targets, [row for row in data.scores if not row["clean"]]


def test_new_entries_are_in_every_picture_of_a_sweep(
    detector: Detector, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain, _ = rows_of(detector, tmp_path / "plain")
    with monkeypatch.context() as patch:
        patch.setattr(effects, "EFFECTS", (*effects.EFFECTS, Veil(0.4)))
        veiled, _ = rows_of(detector, tmp_path / "veiled")
    monkeypatch.setattr(stages, "STAGES", (*stages.STAGES[:6], Pedestal(5000.0), *stages.STAGES[6:]))
    lifted, _ = rows_of(detector, tmp_path / "lifted")
    for other in (veiled, lifted):
        assert len(other) == len(plain) == 2
        assert all(a["confidence"] != b["confidence"] for a, b in zip(plain, other, strict=True))


def test_targets_move_with_the_picture(
    detector: Detector, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Displaced by its own width, the sign is found as before: confidence, box and AP. Unmoved boxes lose it."""
    plain, scores = rows_of(detector, tmp_path / "plain")
    monkeypatch.setattr(effects, "EFFECTS", (*effects.EFFECTS, Shift((24, 16))))
    moved, moved_scores = rows_of(detector, tmp_path / "moved")
    for before, after in zip(plain, moved, strict=True):
        assert before["confidence"] > 0.5
        assert after["confidence"] == pytest.approx(before["confidence"], abs=0.05)
        by = [after[edge] - before[edge] for edge in ("x0", "y0", "x1", "y1")]
        assert by == pytest.approx([24, 16, 24, 16])
    for before, after in zip(scores, moved_scores, strict=True):
        assert after["ap50"] == before["ap50"] == 1
        assert after["false_positives_per_image"] == before["false_positives_per_image"]
    monkeypatch.setattr(Shift, "move_boxes", lambda self, boxes, at: boxes)
    lost, lost_scores = rows_of(detector, tmp_path / "lost")
    assert all(row["confidence"] < 0.1 for row in lost)
    assert all(row["ap50"] < 0.1 for row in lost_scores)
