"""The default camera: of one sensor, in colour or grey as the pictures are."""

from dataclasses import replace

import numpy as np
import pytest
from blurnoise_eval import datasets, default_tone
from blurnoise_eval.cli import inputs
from blurnoise_eval.default_camera import camera_text, default_camera, in_colour, is_grey
from blurnoise_eval.plan.axes import AXES
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.plan.typed import AUTOMATIC
from blurnoise_eval.run.evaluation import evaluate
from blurnoise_eval.store.store import Store, StoreError
from signs_in_memory import matched_detector

from blurnoise import AutoExposure, Camera
from blurnoise.training.ranges import ExposureRanges

PLAN = SweepPlan({"exposure_s": (0.01,), "illuminance_lux": (100.0,)})


def made(*, colour, seed=1):
    """Of 45 x 63 px, at random."""
    grey = np.random.default_rng(seed).integers(0, 256, (45, 63, 1)).astype(np.uint8)
    return np.concatenate([grey, grey, 255 - grey if colour else grey], axis=-1)


def folder_of(folder, *colours):
    folder.mkdir(exist_ok=True)
    for place, colour in enumerate(colours):
        datasets.write_picture(folder / f"{place}.png", made(colour=colour, seed=place))
    return datasets.image_folder(folder)


def manifest(done):
    with Store(done.folder) as store:
        return dict(store.about("manifest")["camera"])


@pytest.mark.parametrize(
    ("colours", "name"), [((True, True), "imx250c"), ((False, False), "imx250m"), ((False, True), "imx250c")]
)
def test_pictures_choose_the_camera_and_the_manifest_says_why(tmp_path, colours, name):
    model, pictures = matched_detector(tmp_path), folder_of(tmp_path / "pictures", *colours)
    camera = manifest(evaluate(model, pictures, plan=PLAN, output=tmp_path / "run"))
    assert camera["name"] == name
    assert camera["sources"]["name"].startswith("chosen: default, ")  # type: ignore[index]
    each = [in_colour(replace(pictures, pictures=(picture,))) for picture in pictures]
    assert each == list(colours)


def test_the_last_of_many_pictures_is_looked_at(tmp_path):
    assert in_colour(folder_of(tmp_path, *[False] * 9, True))  # 8 of 10 are


@pytest.mark.parametrize("named", ["ar0237", "imx250", "imx250m"])
def test_a_named_camera_wins(tmp_path, named):
    model, pictures = matched_detector(tmp_path), folder_of(tmp_path / "pictures", True)
    camera = manifest(evaluate(model, pictures, named, PLAN, output=tmp_path / "run"))
    _, written = default_tone.of_photographs(None, Camera.preset(named))
    assert camera == written.to_dict()


def test_a_run_of_another_camera_is_not_resumed(tmp_path):
    model, pictures = matched_detector(tmp_path), folder_of(tmp_path / "pictures", True)
    evaluate(model, pictures, "imx250", PLAN, output=tmp_path / "run")
    with pytest.raises(StoreError, match=r"another camera\.name \(imx250 there, imx250c here\)"):
        evaluate(model, pictures, plan=PLAN, output=tmp_path / "run")
    again = evaluate(model, pictures, "imx250", PLAN, output=tmp_path / "run")
    assert again.outcome is not None
    assert again.outcome.resumed == 2
    brighter = Camera.preset("imx250").with_figures(f_number=1.2)
    with pytest.raises(StoreError, match=r"another camera\.f_number \("):
        evaluate(model, pictures, brighter, PLAN, output=tmp_path / "run")


def test_grey_is_grey_in_spite_of_an_overlay_and_of_rounding():
    grey, colour = made(colour=False), made(colour=True)
    assert is_grey(grey)
    assert is_grey(grey[..., :1])
    assert not is_grey(colour)
    rounded = grey.copy()
    rounded[..., 2] = np.clip(rounded[..., 2].astype(int) - 2, 0, 255)
    assert is_grey(rounded)
    overlaid = grey.copy()
    overlaid[:3, :8] = (255, 0, 0)  # 24 of 2835 px
    assert is_grey(overlaid)
    overlaid[:9, :8] = (255, 0, 0)
    assert not is_grey(overlaid)
    assert not is_grey(colour.astype(np.uint16) * 257)
    assert is_grey(grey.astype(np.uint16) * 257)


def test_the_terminal_names_a_default_and_three_sensors():
    for camera in (Camera.preset("imx250"), inputs.camera(None, cfa="none")):
        assert "a sensor for each colour" in str(camera_text(camera, colour=True))
    assert camera_text(Camera.preset("imx250"), colour=False) is None
    assert camera_text(Camera.preset("imx250c"), colour=True) is None
    assert camera_text(default_camera(colour=True), colour=True) == (
        "camera: imx250c, the default for pictures in colour"
    )


def test_trainings_draw_from_what_sweeps_test():
    usual = ExposureRanges()
    spans = {
        "exposure_s": usual.exposure_s,
        "illuminance_lux": usual.illuminance_lux,
        "velocity_x_px_s": usual.speed_px_s,
    }
    tested = {axis.name: axis.default for axis in AXES}
    assert spans == {name: (min(tested[name]), max(tested[name])) for name in spans}
    assert usual.cameras == (Camera.preset(default_camera(colour=True).name),)
    assert usual.gain_db == AutoExposure()
    assert tested["gain_db"] == (AUTOMATIC,)
