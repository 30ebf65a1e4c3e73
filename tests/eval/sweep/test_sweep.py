"""A sweep computes what ``simulate`` and the detector give, whoever computes it, and survives its own death."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import weakref
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from blurnoise_eval import cli
from blurnoise_eval.datasets import Picture, PictureSet, Target, UnreadablePicture, rendered_signs
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.grid.axes import NAMES
from blurnoise_eval.grid.conditions import SweepPlan, cell_seed
from blurnoise_eval.scoring.matching import target_confidence
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.sweep import run as sweep
from blurnoise_eval.sweep import run_folder as results
from blurnoise_eval.sweep import work
from blurnoise_eval.sweep.blocks import count_cells
from blurnoise_eval.sweep.engines import ThreadEngine
from blurnoise_models import matched_filter
from blurnoise_models.detector import STOP_SIGN
from numpy.typing import NDArray
from plans import plan as swept

from blurnoise import Camera, charts, exposure, simulate
from blurnoise.encoding import srgb_from_linear
from blurnoise.picture.develop import develop_8bit
from blurnoise.radiometry import photoelectrons
from blurnoise.sensor import readout as sensor

CAMERA = Camera.preset("imx250")
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
SIZE_PX, HEIGHT_PX, WIDTH_PX = 24, 54, 64
PLAN = swept(
    exposures_s=(0.002, 0.0123, 0.03),
    lights_lux=(3.0, 333.3),
    right_px_s=(0.0, 333.3),
    down_px_s=(0.0, -77.1),
    repeats=2,
)


@pytest.fixture(scope="module")
def detector(tmp_path_factory: pytest.TempPathFactory) -> Detector:
    path = tmp_path_factory.mktemp("model") / "small.onnx"
    return Detector(matched_filter.build(path, sizes_px=(24, 16, 10), input_px=64))


def sign(dtype: type = np.uint8) -> NDArray[Any]:
    linear = charts.stop_sign(SIZE_PX, height_px=HEIGHT_PX, width_px=WIDTH_PX)
    coded = srgb_from_linear(linear)[0].permute(1, 2, 0).numpy()
    return np.round(coded * np.iinfo(dtype).max).astype(dtype)


def noise(height: int, width: int) -> NDArray[np.uint8]:
    return np.random.default_rng(5).integers(0, 256, (height, width, 3), np.uint8)


BOX = tuple(float(edge) for edge in charts.stop_sign_box(SIZE_PX, height_px=HEIGHT_PX, width_px=WIDTH_PX))


def picture(
    name: str, load: Callable[[], NDArray[Any]] = sign, labels: Sequence[str] | None = ("stop sign",)
) -> Picture:
    """A picture with a sign's box for each label; without labels, whatever is found when clean."""
    targets = None if labels is None else tuple(Target(label, f"a {label}", BOX) for label in labels)
    return Picture(name, targets, load, f"{name} rendered")


def picture_set(*pictures: Picture) -> PictureSet:
    return PictureSet("folder", "memory", pictures)


TWO = picture_set(picture("a"), picture("b", partial(noise, 40, 51), None))


def unreadable() -> NDArray[Any]:
    raise UnreadablePicture("bad.png: is empty (0 bytes)")


def everything(store: Store) -> list[Any]:
    """All that a run found, but not how long it took."""
    cells = [
        {key: value for key, value in cell.items() if key not in ("simulate_ms", "infer_ms")}
        for cell in store.cells()
    ]
    found = [store.detections(cell["cell_id"], cell["model"]) for cell in cells]
    boxes = [(each.boxes_xyxy.tobytes(), each.scores.tobytes(), each.class_ids.tobytes()) for each in found]
    return [cells, list(store.targets()), boxes, store.skipped()]


def n_done(store: Store) -> int:
    return len({row["cell_id"] for row in store.rows("SELECT cell_id FROM cells")})


def rows_of(folder: Path, *arguments: Any, **options: Any) -> list[Any]:
    with Store(folder, create=True) as store:
        sweep.run(*arguments, store, **options)
        return everything(store)


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
    read_out = sensor.read_out

    def watched(*arguments: Any, tones: torch.Tensor, out: torch.Tensor, **options: Any) -> torch.Tensor:
        developed.extend(read_out(*arguments, **options))
        return read_out(*arguments, tones=tones, out=out, **options)

    with Store(tmp_path, create=True) as store:
        with monkeypatch.context() as patch:
            patch.setattr(exposure, "read_out", watched)
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
        assert kept == 9  # three exposures by three speeds


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


@pytest.mark.parametrize("threads", [2, 4])
def test_rows_do_not_depend_on_threads(
    detector: Detector, tmp_path: Path, uninterrupted: list[Any], threads: int
) -> None:
    assert rows_of(tmp_path, [detector], CAMERA, TWO, PLAN, engine=ThreadEngine(threads)) == uninterrupted


def test_thread_settings_of_the_process_come_back(detector: Detector, tmp_path: Path) -> None:
    before = torch.get_num_threads(), cv2.getNumThreads()
    try:
        torch.set_num_threads(2)
        cv2.setNumThreads(2)
        rows_of(tmp_path, [detector], CAMERA, TWO, swept((0.01,), (50.0,)))
        assert (torch.get_num_threads(), cv2.getNumThreads()) == (2, 2)
    finally:
        torch.set_num_threads(before[0])
        cv2.setNumThreads(before[1])


def test_rows_do_not_depend_on_the_other_pictures(
    detector: Detector, tmp_path: Path, uninterrupted: list[Any]
) -> None:
    others = picture_set(picture("c", partial(noise, 21, 30)), *reversed(TWO.pictures))
    cells, targets, *_ = rows_of(tmp_path, [detector], CAMERA, others, PLAN, engine=ThreadEngine(2))
    expected = uninterrupted[0]
    assert [cell for cell in cells if cell["image"] in "ab"] == expected
    assert [target for target in targets if target["image"] in "ab"] == uninterrupted[1]


@pytest.mark.parametrize(("threads", "after"), [(1, 1), (1, 20), (3, 25)])
def test_interrupted_sweep_goes_on(
    detector: Detector, tmp_path: Path, uninterrupted: list[Any], threads: int, after: int
) -> None:
    settled = 0

    def interrupt(cells: int) -> None:
        nonlocal settled
        settled += cells
        if settled >= after:
            raise KeyboardInterrupt

    total = count_cells(TWO, PLAN)
    with Store(tmp_path, create=True) as store:
        with pytest.raises(KeyboardInterrupt):
            sweep.run([detector], CAMERA, TWO, PLAN, store, engine=ThreadEngine(threads), progress=interrupt)
        kept = n_done(store)  # the store is whole: it can be read at once
        assert after <= kept < total
    told: list[int] = []
    with Store(tmp_path) as store:
        outcome = sweep.run(
            [detector], CAMERA, TWO, PLAN, store, engine=ThreadEngine(threads), progress=told.append
        )
        assert (outcome.resumed, outcome.computed) == (kept, total - kept)
        assert sum(told) == total
        assert everything(store) == uninterrupted
        again = sweep.run([detector], CAMERA, TWO, PLAN, store)
        assert (again.resumed, again.computed) == (total, 0)


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="kill -9 is POSIX")
def test_killed_sweep_goes_on_with_the_same_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """kill -9 in the middle of a real command; the default detector and one default sign."""
    folder = tmp_path / "run"
    command = ["sweep", "--exposure-ms", "1:24:1", "--lux", "50", "--dx", "0,300", "--repeats", "1"]
    command += ["--limit", "1", "--threads", "1", "--json", "-o", str(folder)]
    plan = swept(tuple(ms / 1e3 for ms in range(1, 25)), (50.0,), (0.0, 300.0))
    one = PictureSet("rendered", "", rendered_signs().pictures[:1])

    started = [sys.executable, "-m", "blurnoise_eval.cli", *command]
    process = subprocess.Popen(started, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    deadline = time.monotonic() + 60
    while len(list(folder.glob("examples/*.png"))) < 4:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert process.returncode == -signal.SIGKILL
    with Store(folder) as store:
        kept = n_done(store)
    assert 0 < kept < count_cells(one, plan)

    assert cli.main(command) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["resumed"], summary["computed"]) == (kept, count_cells(one, plan) - kept)
    expected = rows_of(tmp_path / "uninterrupted", [Detector(STOP_SIGN)], CAMERA, one, plan)
    with Store(folder) as store:
        assert everything(store) == expected


@pytest.mark.parametrize("threads", [1, 2])
def test_pictures_in_memory_do_not_grow_with_the_set(
    detector: Detector, tmp_path: Path, threads: int
) -> None:
    live: set[int] = set()
    most = 0

    def load() -> NDArray[np.uint8]:
        nonlocal most
        image = noise(32, 32)
        live.add(id(image))
        weakref.finalize(image, live.discard, id(image))
        most = max(most, len(live))
        return image

    many = picture_set(*[picture(f"p{index}", load) for index in range(40)])
    plan = swept((0.01,), (50.0,), repeats=2)
    with Store(tmp_path, create=True) as store:
        sweep.run([detector], CAMERA, many, plan, store, engine=ThreadEngine(threads))
        assert n_done(store) == count_cells(many, plan) == 120
    # Scenes that are kept, and one that each task at work may still hold.
    assert most <= 2 * threads + 2


def test_confidence_falls_with_blur_and_with_darkness(detector: Detector, tmp_path: Path) -> None:
    plan = swept((0.01,), (0.3, 3.0, 300.0), (0.0, 200.0, 500.0, 1000.0))
    _, targets, *_ = rows_of(tmp_path, [detector], CAMERA, picture_set(picture("p")), plan)
    found = {
        (row["illuminance_lux"], row["velocity_x_px_s"]): row["confidence"]
        for row in targets
        if not row["clean"]
    }
    bright = [found[300.0, speed] for speed in plan.values("velocity_x_px_s")]
    assert bright == sorted(bright, reverse=True)
    assert bright[0] > 0.8
    assert bright[-1] < 0.5 * bright[0]
    still = [found[lux, 0.0] for lux in plan.values("illuminance_lux")]
    assert still == sorted(still)
    assert still[0] < 0.5 * still[-1]


def test_still_and_bright_agrees_with_clean(detector: Detector, tmp_path: Path) -> None:
    """White fills 9/10 of the well: about 50 dB of signal to noise cost next to nothing."""
    lux = 0.9 * CAMERA.saturation_e / photoelectrons(CAMERA, 1.0, 0.01)
    plan = swept((0.01,), (lux,))
    cells, *_ = rows_of(tmp_path, [detector], CAMERA, picture_set(picture("p")), plan)
    clean, exposed = (cell["target_confidence"] for cell in cells)
    assert exposed == pytest.approx(clean, abs=0.02)


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
        data = results.read_run(store, threshold=0.6)
        assert [answer["group"] for answer in data.answers] == ["a stop sign"]
        unknown, without = data.manifest["warnings"]
        assert "does not know 1 of the labels (person)" in unknown
        assert "2 pictures" in without


@pytest.mark.parametrize("threads", [1, 3])
def test_unreadable_picture_is_named_and_skipped(detector: Detector, tmp_path: Path, threads: int) -> None:
    pictures = picture_set(picture("a"), picture("bad.png", unreadable), picture("z"))
    told: list[int] = []
    for turn in ("first", "again"):
        told.clear()
        with Store(tmp_path, create=True) as store:
            outcome = sweep.run(
                [detector], CAMERA, pictures, PLAN, store, engine=ThreadEngine(threads), progress=told.append
            )
            assert outcome.skipped == {"bad.png": "bad.png: is empty (0 bytes)"}
            assert [entry["image"] for entry in store.skipped()] == ["bad.png"]
            assert {cell["image"] for cell in store.cells()} == {"a", "z"}, turn
            assert sum(told) == count_cells(pictures, PLAN)


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


def test_repeats_and_base_seed_change_the_noise(detector: Detector, tmp_path: Path) -> None:
    plan = swept((0.002,), (3.0,), repeats=2)
    first, *_ = rows_of(tmp_path / "0", [detector], CAMERA, picture_set(picture("p")), plan)
    other, *_ = rows_of(tmp_path / "1", [detector], CAMERA, picture_set(picture("p")), replace(plan, seed=1))
    found = [cell["target_confidence"] for cell in (*first, *other) if not cell["clean"]]
    assert len(set(found)) == 4


def test_run_folder_knows_its_run(detector: Detector, tmp_path: Path) -> None:
    other = Detector(matched_filter.build(tmp_path / "x.onnx", sizes_px=(22, 16, 10), input_px=64))
    facts = {"command": "a command", "threads": 2}
    with Store(tmp_path, create=True) as store:
        with pytest.raises(StoreError, match="no sweep has begun"):
            results.read_run(store, threshold=0.6)
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


def test_run_reads_back_for_the_report(detector: Detector, tmp_path: Path) -> None:
    plan = swept((0.002, 0.01), (3.0, 333.3), (0.0, 500.0), repeats=3)
    pictures = picture_set(picture("p"), picture("bad.png", unreadable))
    with Store(tmp_path, create=True) as store:
        results.open_run(store, [detector], CAMERA, pictures, plan, {"command": "c", "threads": 1})
        sweep.run([detector], CAMERA, pictures, plan, store)
        data = results.read_run(store, threshold=0.6)
    assert len(data.answers) == 4
    assert all(answer["n_targets"] == 3 for answer in data.answers)
    assert data.manifest["threshold"] == 0.6
    assert data.manifest["versions"]["blurnoise"]
    assert [entry["image"] for entry in data.skipped] == ["bad.png"]
    assert data.manifest["warnings"] == []
    clean = next(example for example in data.examples if example["clean"])
    assert Path(clean["path"]).is_file()
    assert clean["detections"][0]["label"] == "stop sign"
    found = {"confidence": clean["detections"][0]["score"]}
    found |= dict.fromkeys(("truth", "text", "read_confidence"))
    assert clean["targets"] == [{"box_xyxy": list(BOX), "label": "stop sign", **found}]


def test_a_picture_too_thin_for_a_mosaic_is_skipped_and_named(detector: Detector, tmp_path: Path) -> None:
    shown = picture_set(picture("thin", lambda: noise(1, 40)), picture("whole", lambda: noise(43, 61)))
    plan = swept((0.004,), (33.3,), examples=False)
    with Store(tmp_path / "mosaic", create=True) as store:
        outcome = sweep.run([detector], Camera.preset("imx250c"), shown, plan, store)
    assert list(outcome.skipped) == ["thin"]
    assert "40 x 1 px; behind a mosaic it must be at least 2 x 2" in outcome.skipped["thin"]
