"""A run is that of its contents: all that reaches a pixel or a box, and its software; it is read back as it was."""

import os
import shutil
from dataclasses import fields, replace

import matched_filter
import numpy as np
import pytest
from blurnoise_eval.datasets import Picture, PictureSet, Target, image_folder, write_picture
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.plan.objects import ObjectSettings
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.run import identity
from blurnoise_eval.run.computing import compute
from blurnoise_eval.run.evaluation import evaluate
from blurnoise_eval.run.identity import open_run
from blurnoise_eval.run.merging import merge
from blurnoise_eval.run.setup import Batch, Setup, note_batch
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.system.machine import versions
from plans import plan as swept
from signs_in_memory import CAMERA, TWO

from blurnoise.motion.ego import Vehicle
from blurnoise.scene.metering import AutoExposure

SMALL = swept((0.004,), (33.3,), (0.0, 333.3), examples=False)
GRID = {"exposure_s": (0.005,), "illuminance_lux": (50.0,), "velocity_x_px_s": (100.0,)}
CUTTING = SweepPlan({**GRID, "moves": ("targets",)}, objects=ObjectSettings(), picture_tone="srgb")
OUTLINE = {"segmentation": [[20.0, 20.0, 60.0, 20.0, 20.0, 60.0]]}
TARGET = Target("stop sign", "signs", (20.0, 20.0, 60.0, 60.0), annotation=OUTLINE)
CHANGED = {
    "label": "car",
    "group": "cars",
    "box_xyxy": (20.0, 20.0, 61.0, 60.0),
    "area_px2": 5.0,
    "crowd": True,
    "text": "STOP",
    "annotation": {"segmentation": [[20.0, 20.0, 60.0, 20.0, 20.0, 59.0]]},
}


def noise(seed):
    return np.random.default_rng(seed).integers(0, 256, (41, 53, 3), np.uint8)


def labelled(target=TARGET):
    one = Picture("a.png", (target,), lambda: np.resize(noise(3), (80, 90, 3)), "a.png", 1)
    return PictureSet("coco", "a", (one,), {"stop sign": 1, "car": 2})


@pytest.fixture
def photos(tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    for seed, name in enumerate("ab"):
        write_picture(folder / f"{name}.bmp", noise(seed))
    return folder


def computed(detector, photos, run, plan=SMALL, **changed):
    pictures = replace(image_folder(photos), **changed)
    with Store(run, create=True) as store:
        open_run(store, [detector], CAMERA, pictures, plan, {})
        done = compute([detector], CAMERA, pictures, plan, store)
    return done.computed, done.resumed


def test_a_picture_of_the_same_size_is_another(detector, photos, tmp_path):
    file, run = photos / "b.bmp", tmp_path / "run"
    assert computed(detector, photos, run) == (6, 0)
    before = file.stat()
    write_picture(file, noise(7))
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert file.stat().st_size == before.st_size
    with pytest.raises(StoreError, match=r"holds a run with another picture 'b\.bmp'"):
        computed(detector, photos, run)
    file.unlink()
    write_picture(file, noise(1))  # the old one, in a new file
    assert computed(detector, photos, run) == (0, 6)
    file.write_bytes(b"")
    with pytest.raises(StoreError, match=r"another picture 'b\.bmp'"):
        computed(detector, photos, run)


def test_a_picture_that_changes_under_the_sweep_ends_it(detector, photos, tmp_path):
    first, second = image_folder(photos)
    seen = []

    def changing():
        seen.append(1)
        return noise(len(seen))

    pictures = (replace(first, load=changing), second)
    assert computed(detector, photos, tmp_path / "run", pictures=pictures) == (6, 0)
    shown = replace(image_folder(photos), pictures=pictures)
    with Store(tmp_path / "run", create=True) as store:
        before = [row for row in store.cells() if row.image == "a.bmp"]
        with pytest.raises(StoreError, match=r"picture 'a\.bmp' has changed since"):
            compute([detector], CAMERA, shown, replace(SMALL, repeats=2), store)
        assert [row for row in store.cells() if row.image == "a.bmp"] == before


def test_every_part_of_a_run_is_in_its_identity(cut, detector, tmp_path):
    shown = labelled()

    def opened(camera=CAMERA, pictures=shown, plan=CUTTING, threads=1, model=detector):
        open_run(store, [model], camera, pictures, plan, {"threads": threads})

    other = Detector(matched_filter.build(tmp_path / "m.onnx", sizes_px=(22, 16, 10), input_px=64))
    with Store(shutil.copytree(cut, tmp_path / "run"), create=True) as store:
        opened(threads=2)
        opened()
        assert store.about("manifest")["threads"] == 1
        (one,) = shown.pictures
        for named, changes in (
            ("model", {"model": other}),
            ("camera", {"camera": CAMERA.with_figures(f_number=2.0)}),
            ("plan", {"plan": replace(CUTTING, seed=1)}),
            ("pictures", {"pictures": replace(shown, pictures=(replace(one, name="b.png"),))}),
            ("choice of targets", {"pictures": replace(shown, pictures=(replace(one, targets=None),))}),
        ):
            with pytest.raises(StoreError, match=f"another {named}"):
                opened(**changes)
        assert CHANGED.keys() == {field.name for field in fields(Target)}
        for name, value in CHANGED.items():
            with pytest.raises(StoreError, match=r"another (choice of targets|annotations)"):
                opened(pictures=labelled(replace(TARGET, **{name: value})))
        for harmless in identity.HARMLESS:
            opened(pictures=labelled(replace(TARGET, annotation={**OUTLINE, harmless: 7})))


@pytest.fixture(scope="module")
def cut(tmp_path_factory, detector):
    run = tmp_path_factory.mktemp("cut") / "run"
    evaluate(detector, labelled(), CAMERA, CUTTING, output=run, strategy="grid")
    return run


@pytest.mark.parametrize("name", ["torch", "blurnoise", "sources"])
def test_other_software_is_named(cut, detector, tmp_path, name):
    run = shutil.copytree(cut, tmp_path / "run")
    with Store(run, create=True) as store:
        store.set_about("manifest", {**store.about("manifest"), "versions": {**versions(), name: "0.0.7"}})
    with pytest.raises(StoreError, match=rf"another software\.{name} \(0\.0\.7 there, .* here\)"):
        evaluate(detector, labelled(), CAMERA, CUTTING, output=run, strategy="grid")
    with pytest.raises(StoreError, match=rf"differs from .* in software\.{name} \(.*0\.0\.7"):
        merge([cut, run], tmp_path / "merged")


PLAN = swept((0.01, 0.02), (50.0,), (0.0, 300.0))
MOVED = swept((0.01,), (50.0,), (0.0, 300.0), gain_db=("auto",), moves=(0.0, 1.0))
NODES = SweepPlan({"gain_db": (6.0,)}, repeats=2, direction=(0.6, 0.8))


@pytest.mark.parametrize(
    "plan",
    [
        replace(PLAN, repeats=3, seed=7, grey_anchor="mean", examples=False, trajectory="shake:6"),
        replace(
            MOVED, auto_exposure=AutoExposure(target=0.3), objects=ObjectSettings(speeds={"stop sign": 0.5})
        ),
        replace(swept((0.01,), (50.0,), ego_speed_m_s=(20.0,)), vehicle=Vehicle(height_m=2.0)),
        NODES,
    ],
)
def test_a_plan_is_read_back(plan, detector, tmp_path):
    with Store(tmp_path, create=True) as store:
        open_run(store, [detector], CAMERA, TWO, plan, {})
        setup = Setup.read(store)
        assert (setup.plan, setup.camera) == (plan, CAMERA)


def test_what_is_missing_is_counted(detector, tmp_path):
    """Of a grid with the exposures that were asked for beside it; of a search for the pictures that it took."""
    (extra,) = swept((0.015,), (50.0,)).conditions()
    for plan, n_pictures, expected in ((PLAN, len(TWO), 2 * (1 + 4 + 1)), (NODES, 1, 1 * (1 + 2 * 1))):
        with Store(tmp_path / str(n_pictures), create=True) as store:
            open_run(store, [detector], CAMERA, TWO, plan, {})
            note_batch(store, Batch(n_pictures, (), (extra,)))
            assert Setup.read(store).missing_cells(store) == expected
            store.skip(TWO.pictures[0].name, "cannot be read")
            assert Setup.read(store).missing_cells(store) == expected // n_pictures * (n_pictures - 1)


def test_a_store_without_a_run_is_refused(tmp_path):
    with Store(tmp_path, create=True) as store, pytest.raises(StoreError, match="contains no sweep"):
        Setup.read(store)
