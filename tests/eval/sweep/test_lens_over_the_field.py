"""A camera whose lens distorts, from its file to a sweep: targets move with the picture, and are explained."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import matched_filter
import numpy as np
import pytest
from blurnoise_eval import SweepPlan, evaluate
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.datasets import Picture, PictureSet, Target
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.report.run import read_run
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep import run as sweep
from blurnoise_eval.sweep import run_folder
from numpy.typing import NDArray
from plans import plan as swept

from blurnoise import Camera, charts
from blurnoise.light.lens import DISTORTION
from blurnoise.optics.colour import srgb_from_linear
from blurnoise.optics.lens import Distortion, Lens, Mtf

SIZE_PX, CENTRES = 24, {(320, 480): (55.0, 40.0), (480, 320): (40.0, 430.0)}
PINCUSHION = Distortion("opencv", (0.095, 0.0, 0.0, 0.0))
CAMERA = replace(
    Camera.preset("imx250"), width_px=480, height_px=480, hfov_deg=80.0, lens=Lens(distortion=PINCUSHION)
)


def sign(height: int, width: int) -> NDArray[np.uint8]:
    linear = charts.stop_sign(SIZE_PX, height_px=height, width_px=width, centre_px=CENTRES[height, width])
    return (srgb_from_linear(linear)[0].permute(1, 2, 0).numpy() * 255).round().astype(np.uint8)


def box(height: int, width: int) -> tuple[float, float, float, float]:
    """Of the sign, whose box :func:`charts.stop_sign_box` tells for the middle alone."""
    x0, y0, x1, y1 = charts.stop_sign_box(SIZE_PX, height_px=height, width_px=width)
    (x, y), middle = CENTRES[height, width], ((x0 + x1) / 2, (y0 + y1) / 2)
    return (x0 + x - middle[0], y0 + y - middle[1], x1 + x - middle[0], y1 + y - middle[1])


def pictures() -> PictureSet:
    made = [
        Picture(f"{height}x{width}", (Target("stop sign", "a sign", box(height, width)),),
                lambda h=height, w=width: sign(h, w), "rendered", place)  # type: ignore[misc]
        for place, (height, width) in enumerate(CENTRES, start=1)
    ]  # fmt: skip
    return PictureSet("folder", "memory", tuple(made))


@pytest.fixture(scope="module")
def detector(tmp_path_factory: pytest.TempPathFactory) -> Detector:
    path = tmp_path_factory.mktemp("model") / "small.onnx"
    return Detector(matched_filter.build(path, sizes_px=(28, 26, 24), input_px=480))


def rows_of(
    detector: Detector, folder: Path, camera: Camera
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    plan = swept((0.01,), (100.0,), (0.0,))
    with Store(folder, create=True) as store:
        run_folder.open_run(store, [detector], camera, pictures(), plan, {"command": "c", "threads": 1})
        sweep.run([detector], camera, pictures(), plan, store)
        data = read_run(store, Criterion(0.6, kept=False))
        targets = [row for row in store.targets() if not row["clean"]]
    return targets, [row for row in data.scores if not row["clean"]]


def test_targets_follow_the_distortion(
    detector: Detector, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In pictures of two shapes, for the confidence in each target and for AP; unmoved boxes lose them."""
    targets, scores = rows_of(detector, tmp_path / "moved", CAMERA)
    for row in targets:
        height, width = map(int, row["image"].split("x"))
        was = np.array([box(height, width)])
        expected = CAMERA.field.moved_boxes(was, (height, width))[0]
        assert [row[edge] for edge in ("x0", "y0", "x1", "y1")] == pytest.approx(expected)
        assert np.abs(expected - was).max() > 8
        assert row["confidence"] > 0.4
    assert [row["ap50"] for row in scores] == [pytest.approx(1.0)]
    monkeypatch.setattr(type(DISTORTION), "move_boxes", lambda self, boxes, at: boxes)
    lost, lost_scores = rows_of(detector, tmp_path / "still", CAMERA)
    assert all(row["confidence"] < 0.1 for row in lost)
    assert lost_scores[0]["ap50"] < 0.1


@pytest.mark.parametrize("axis", ["f_number", "defocus_radius_px"])
def test_an_axis_that_a_measured_mtf_holds_is_refused(tmp_path: Path, axis: str) -> None:
    mtf = Mtf((0.1, 0.5), (0.8, 0.1), "cycles/px")
    plan = SweepPlan({"exposure_s": (0.01,), "illuminance_lux": (100.0,), axis: (1.0, 4.0)})
    with pytest.raises(ValueError, match=r"lens\.mtf: is measured with defocus and diffraction"):
        evaluate(
            plan=plan,
            camera=replace(CAMERA, lens=Lens(mtf=mtf)),
            pictures=pictures(),
            output=tmp_path / "run",
        )
    assert not (tmp_path / "run").exists()
