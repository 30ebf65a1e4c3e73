"""A sweep computes what ``simulate`` and the detector give, whoever computes it."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import matched_filter
import numpy as np
import pytest
import torch
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.grid.axes import NAMES
from blurnoise_eval.grid.conditions import SweepPlan, cell_seed
from blurnoise_eval.report.run import read_run
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.sweep import run as sweep
from blurnoise_eval.sweep import run_folder as results
from blurnoise_eval.sweep import work
from blurnoise_eval.sweep.engines import ThreadEngine
from coco_oracle import target_confidence
from made_up import Pedestal, Shift, Veil
from numpy.typing import NDArray
from plans import plan as swept
from signs_in_memory import (
    BOX,
    CAMERA,
    HEIGHT_PX,
    PLAN,
    TWO,
    WIDTH_PX,
    matched_detector,
    noise,
    picture,
    picture_set,
    rows_of,
    sign,
)

from blurnoise import Camera, simulate
from blurnoise.light import effects
from blurnoise.optics.colour import srgb_from_linear
from blurnoise.picture.develop import develop_8bit
from blurnoise.scene import scene
from blurnoise.sensor import readout as sensor
from blurnoise.sensor import stages

EVERY_EFFECT = replace(
    CAMERA,
    name="every effect",
    read_noise_e=0.6,  # below 1 e- counts are drawn one by one
    prnu=0.02,
    dsnu_e=3.0,
    dark_current_e_s=400.0,
    dark_reference_c=20.0,
    dark_doubling_c=7.0,
    defocus_radius_px=1.2,
)


@pytest.fixture(scope="module")
def detector(tmp_path_factory: pytest.TempPathFactory) -> Detector:
    return matched_detector(tmp_path_factory.mktemp("model"))


@pytest.fixture(scope="module")
def uninterrupted(detector: Detector, tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    return rows_of(tmp_path_factory.mktemp("run"), [detector], CAMERA, TWO, PLAN)


@pytest.mark.parametrize("camera", [CAMERA, EVERY_EFFECT], ids=lambda camera: camera.name)
def test_cell_is_what_simulate_and_the_detector_give(
    detector: Detector, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, camera: Camera
) -> None:
    image = noise(127, 161)
    warm = {**PLAN.grid, "illuminance_lux": (333.3,), "temperature_c": (40.0,)}
    plan = SweepPlan(warm, seed=11)
    developed: list[torch.Tensor] = []
    digitised = sensor.digitised

    def watched(light: torch.Tensor, at: Any, options: Any) -> torch.Tensor:
        developed.extend(digitised(light, at, replace(options, tones=None, out=None)))
        return digitised(light, at, options)

    with Store(tmp_path, create=True) as store:
        with monkeypatch.context() as patch:
            patch.setattr(scene, "digitised", watched)
            sweep.run([detector], camera, picture_set(picture("p", lambda: image)), plan, store)
        cells = [cell for cell in store.cells() if not cell["clean"]]
        kept = 0
        assert len(cells) == len(developed) == 12
        batch = torch.from_numpy(image).permute(2, 0, 1)[None] / 255
        for cell in cells:
            dn = simulate(
                batch,
                camera,
                exposure_s=cell["exposure_s"],
                illuminance_lux=cell["illuminance_lux"],
                velocity_px_s=(cell["velocity_x_px_s"], cell["velocity_y_px_s"]),
                temperature_c=40.0,
                generator=[cell["seed"]],
            )
            # One of the sweep's pictures, number for number: conditions differ in far more than rounding.
            differing = [int((dn != each).sum()) for each in developed]
            assert min(differing) == 0, f"{cell}: {min(differing)} of {dn.numel()} digital numbers differ"
            rgb = np.ascontiguousarray(develop_8bit(dn, camera)[0].permute(1, 2, 0).numpy())
            direct, stored = detector.detect(rgb), store.detections(cell["cell_id"], cell["model"])
            for name in ("boxes_xyxy", "scores", "class_ids"):
                np.testing.assert_array_equal(getattr(stored, name), getattr(direct, name))
            assert cell["target_confidence"] == target_confidence(direct, BOX, 0)
            assert cell["blur_px"] == pytest.approx(
                cell["exposure_s"] * np.hypot(cell["velocity_x_px_s"], cell["velocity_y_px_s"])
            )
            if cell["example"]:
                kept += 1
                np.testing.assert_array_equal(cv2.imread(str(tmp_path / cell["example"]))[..., ::-1], rgb)
        assert kept == 12


FURTHER = {
    "temperature_c": (60.0,),
    "f_number": (1.4, 16.0),
    "defocus_radius_px": (0.0, 2.5),
    "gain_db": (0.0, 9.0),
}


def test_cell_of_any_axes_is_what_simulate_gives(
    detector: Detector, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The lens that is stated with its diffraction, heat, and a gain of the developed picture's light."""
    image = noise(43, 61)
    plan = swept((0.004, 0.0123), (33.3,), (0.0, 333.3), (-77.1,), seed=5, examples=False, **FURTHER)
    seen: dict[str, NDArray[np.uint8]] = {}
    made = work.frames

    def watched(*arguments: Any) -> Any:
        for frame in made(*arguments):
            seen[frame.cell.cell_id] = frame.image
            yield frame

    monkeypatch.setattr(work, "frames", watched)
    shown = picture_set(picture("p", lambda: image))
    cells, *_ = rows_of(tmp_path, [detector], EVERY_EFFECT, shown, plan)
    batch = torch.from_numpy(image).permute(2, 0, 1)[None] / 255
    exposed = [cell for cell in cells if not cell["clean"]]
    assert len({seen[cell["cell_id"]].tobytes() for cell in exposed}) == len(exposed) == 2 * 2 * 8
    for cell in exposed:
        lens = {name: cell[name] for name in ("f_number", "defocus_radius_px")}
        camera = replace(EVERY_EFFECT, diffraction_wavelength_um=0.55, **lens)
        assert camera.optics.diffraction_lambda_n_px == pytest.approx(
            0.55 * cell["f_number"] / EVERY_EFFECT.pixel_pitch_um
        )
        camera, digital_db = camera.at_gain(cell["gain_db"])
        dn = simulate(
            batch,
            camera,
            exposure_s=cell["exposure_s"],
            illuminance_lux=cell["illuminance_lux"],
            velocity_px_s=(cell["velocity_x_px_s"], cell["velocity_y_px_s"]),
            temperature_c=cell["temperature_c"],
            generator=[cell["seed"]],
            tolerance_dn=0.1 / 10 ** (max(digital_db, 0.0) / 20),  # a digital gain magnifies what is left out
        )
        black = camera.black_level_dn
        light = (dn.double() - black) / (camera.full_scale_dn - black) * 10 ** (digital_db / 20)
        rgb = srgb_from_linear(light).mul(255).round().byte()[0].permute(1, 2, 0).numpy()
        np.testing.assert_array_equal(seen[cell["cell_id"]], rgb)


def test_clean_row_is_the_detection_in_the_untouched_picture(detector: Detector, tmp_path: Path) -> None:
    direct = detector.detect(sign())
    for name, load in (("8 bit", sign), ("16 bit", partial(sign, np.uint16))):
        with Store(tmp_path / name, create=True) as store:
            sweep.run([detector], CAMERA, picture_set(picture("p", load)), replace(PLAN, repeats=1), store)
            (clean,) = (cell for cell in store.cells() if cell["clean"])
            found = store.detections(clean["cell_id"], clean["model"])
            np.testing.assert_array_equal(found.scores, direct.scores)
            np.testing.assert_array_equal(found.boxes_xyxy, direct.boxes_xyxy)
            assert clean["target_confidence"] == target_confidence(direct, BOX, 0) > 0.8
            assert [clean[key] for key in (*NAMES, "blur_px")] == [None] * (len(NAMES) + 1)
            image = cv2.imread(str(tmp_path / name / clean["example"]))
            np.testing.assert_array_equal(image[..., ::-1], sign())


def test_rows_do_not_depend_on_the_other_pictures(
    detector: Detector, tmp_path: Path, uninterrupted: list[Any]
) -> None:
    others = picture_set(picture("c", partial(noise, 21, 30)), *reversed(TWO.pictures))
    cells, targets, *_ = rows_of(tmp_path, [detector], CAMERA, others, PLAN, engine=ThreadEngine(2))
    expected = uninterrupted[0]
    assert [cell for cell in cells if cell["image"] in "ab"] == expected
    assert [target for target in targets if target["image"] in "ab"] == uninterrupted[1]


@pytest.mark.parametrize(("scatter_dn", "low", "high"), [(0, 0.95, 1.0), (75, 0.25, 0.6)])
def test_without_boxes_the_clean_detections_are_the_targets(
    detector: Detector, tmp_path: Path, scatter_dn: float, low: float, high: float
) -> None:
    """From a score of 0.25 up: a clear sign, and one in noise that is found with less certainty."""
    scatter = np.random.default_rng(2).normal(0, scatter_dn, (HEIGHT_PX, WIDTH_PX, 1))
    image = np.clip(np.round(sign() + scatter), 0, 255).astype(np.uint8)
    direct = detector.detect(image)
    assert low < direct.scores[0] < high
    assert 0.1 < direct.scores[1] < 0.25  # too little to be a target
    with Store(tmp_path, create=True) as store:
        shown = picture_set(picture("p", lambda: image, labels=None))
        sweep.run([detector], CAMERA, shown, replace(PLAN, repeats=1), store)
        (target,) = (row for row in store.targets() if row["clean"])
        assert [target[edge] for edge in ("x0", "y0", "x1", "y1")] == direct.boxes_xyxy[0].tolist()
        assert target["confidence"] == direct.scores[0]
        assert (target["label"], target["group"]) == ("stop sign", "found when clean, small (< 32 px)")
        assert len(list(store.targets())) == len(list(store.cells()))


def test_classes_that_the_model_does_not_know_count_for_nothing(detector: Detector, tmp_path: Path) -> None:
    labels = {"both": ["person", "stop sign"], "none": ["person"], "empty": []}
    pictures = picture_set(*[picture(name, labels=named) for name, named in labels.items()])
    with Store(tmp_path, create=True) as store:
        plan = swept((0.01,), (50.0,))
        results.open_run(store, [detector], CAMERA, pictures, plan, {})
        sweep.run([detector], CAMERA, pictures, plan, store)
        assert {row["image"] for row in store.targets()} == {"both"}
        assert {row["label"] for row in store.targets()} == {"stop sign"}
        for cell in store.cells():
            if cell["image"] == "both":
                assert (cell["n_targets"], cell["detection_rate"]) == (1, 1.0)
            else:
                assert (cell["n_targets"], cell["target_confidence"], cell["detection_rate"]) == (
                    0,
                    None,
                    None,
                )
        data = read_run(store, Criterion(0.6, kept=False))
        assert [answer["group"] for answer in data.answers] == ["a stop sign"]
        unknown, without = data.manifest["warnings"]
        assert "3 pictures show about 1 scene " in data.manifest["repeated"]
        assert "does not know 1 of the labels (person)" in unknown
        assert "2 pictures" in without


def test_seeds_are_shared_by_conditions_and_by_nothing_else(uninterrupted: list[Any]) -> None:
    seeds: dict[tuple[str, int], set[int]] = {}
    for cell in uninterrupted[0]:
        seeds.setdefault((cell["image"], cell["repeat"]), set()).add(cell["seed"])
    assert len(seeds) == 4
    assert all(len(shared) == 1 for shared in seeds.values())
    assert len(set.union(*seeds.values())) == 4
    assert cell_seed(0, "a", 0) != cell_seed(1, "a", 0)
    assert min(min(shared) for shared in seeds.values()) >= 0
    assert max(max(shared) for shared in seeds.values()) < 2**63


def test_run_folder_knows_its_run(detector: Detector, tmp_path: Path) -> None:
    other = Detector(matched_filter.build(tmp_path / "x.onnx", sizes_px=(22, 16, 10), input_px=64))
    facts = {"command": "a command", "threads": 2}
    with Store(tmp_path, create=True) as store:
        with pytest.raises(StoreError, match="no sweep has begun"):
            read_run(store, Criterion(0.6, kept=False))
        results.open_run(store, [detector], CAMERA, TWO, PLAN, facts)
        results.open_run(store, [detector], CAMERA, TWO, PLAN, {**facts, "threads": 1})  # threads may differ
        sweep.run([detector], CAMERA, TWO, PLAN, store)
        unboxed = picture_set(*[replace(each, targets=None) for each in TWO])
        fewer = picture_set(TWO.pictures[0])
        for named, changed in {
            "another model": ([other], CAMERA, TWO, PLAN),
            "another camera": ([detector], replace(CAMERA, f_number=2.0), TWO, PLAN),
            "another plan": ([detector], CAMERA, TWO, replace(PLAN, seed=1)),
            "another pictures": ([detector], CAMERA, fewer, PLAN),
            "another choice of targets": ([detector], CAMERA, unboxed, PLAN),
        }.items():
            with pytest.raises(StoreError, match=named):
                results.open_run(store, *changed, facts)
        assert store.about("manifest")["threads"] == 1


def test_new_entries_of_the_chains_tables_are_in_every_picture(
    detector: Detector, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An effect, a stage, and an effect that moves the picture, with which the targets move."""

    def targets(name: str) -> list[dict[str, Any]]:
        plan = swept((0.01,), (100.0,), (0.0, 300.0))
        _, rows, *_ = rows_of(tmp_path / name, [detector], CAMERA, picture_set(picture("p")), plan)
        return [row for row in rows if not row["clean"]]

    plain, found = targets("plain"), {}
    for name, effect in (("veiled", Veil(0.4)), ("moved", Shift((9, 6)))):
        with monkeypatch.context() as patch:
            patch.setattr(effects, "EFFECTS", (*effects.EFFECTS, effect))
            found[name] = targets(name)
    monkeypatch.setattr(stages, "STAGES", (*stages.STAGES[:6], Pedestal(5000.0), *stages.STAGES[6:]))
    for other in (found["veiled"], targets("lifted")):
        assert len(other) == len(plain) == 2
        assert all(a["confidence"] != b["confidence"] for a, b in zip(plain, other, strict=True))
    for before, after in zip(plain, found["moved"], strict=True):
        by = [after[edge] - before[edge] for edge in ("x0", "y0", "x1", "y1")]
        assert by == pytest.approx([9, 6, 9, 6])
        assert after["confidence"] == pytest.approx(before["confidence"], abs=0.1)
