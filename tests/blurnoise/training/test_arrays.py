"""NumPy pictures: one function, and the transform for albumentations, beside Kornia's augmentation."""

import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
import torch
from kornia.geometry.boxes import Boxes

from blurnoise import RandomExposure
from blurnoise.training.arrays import expose_numpy
from blurnoise.training.augmentation import expose_pictures

TAKEN: dict[str, Any] = {"exposure_s": 0.01, "illuminance_lux": 100.0}
FAST: dict[str, Any] = {"speed_px_s": (500.0, 1000.0), "exposure_s": (0.01, 0.02), "grow_boxes": True}


@pytest.fixture
def picture():
    return np.random.default_rng(1).integers(0, 256, (45, 63, 3)).astype(np.uint8)


@pytest.fixture
def albumentations(monkeypatch):
    monkeypatch.setitem(os.environ, "NO_ALBUMENTATIONS_UPDATE", "1")
    return pytest.importorskip("albumentations", reason="albumentations is not installed")


@pytest.mark.parametrize("kind", ["uint8", "float32", "float64"])
def test_an_array_gets_what_a_tensor_gets(picture, kind):
    given = picture if kind == "uint8" else (picture / 255).astype(kind)
    seen = expose_numpy(np.stack([given, given]), "imx250c", **TAKEN, generator=[1, 2])
    tensor = torch.from_numpy(np.stack([given, given])).permute(0, 3, 1, 2)
    tensor = tensor / 255.0 if kind == "uint8" else tensor
    wanted = expose_pictures(tensor, "imx250c", **TAKEN, generator=[1, 2]).permute(0, 2, 3, 1).numpy()
    assert seen.dtype == given.dtype
    assert np.abs(seen / (255 if kind == "uint8" else 1) - wanted).max() <= (0.5 / 255 + 1e-6)
    alone = expose_numpy(given, "imx250c", **TAKEN, generator=[2])
    assert np.array_equal(alone, seen[1])


def test_the_order_of_channels_is_stated(picture):
    rgb = expose_numpy(picture, "imx250c", **TAKEN, generator=1)
    bgr = expose_numpy(picture[..., ::-1], "imx250c", channels="bgr", **TAKEN, generator=1)
    assert np.array_equal(bgr[..., ::-1], rgb)
    assert expose_numpy(picture[..., 0], "imx250m", **TAKEN).shape == (45, 63)


@pytest.mark.parametrize(
    ("image", "options", "words"),
    [
        (np.zeros((4, 5, 3), np.int32), {}, "int32"),
        (np.zeros((4, 5, 2), np.uint8), {}, "2 channels"),
        (np.zeros(4, np.uint8), {}, r"shape \(4,\)"),
        ([[1.0]], {}, "must be an array"),
        (np.zeros((4, 5, 3), np.uint8), {"channels": "gbr"}, "channels"),
    ],
)
def test_other_arrays_are_refused(image, options, words):
    with pytest.raises((TypeError, ValueError), match=words):
        expose_numpy(image, "imx250c", **TAKEN, **options)


def test_albumentations_grows_boxes_as_kornia_does(albumentations, picture):
    from blurnoise import albumentations as ours

    boxes = albumentations.BboxParams("pascal_voc", label_fields=["labels"])
    transform = ours.RandomExposure(p=1.0, **FAST)
    keypoints = albumentations.KeypointParams("xy")
    compose = albumentations.Compose([transform], bbox_params=boxes, keypoint_params=keypoints, seed=3)
    mask = (picture[..., 0] > 99).astype(np.uint8)
    seen = compose(image=picture, bboxes=[[20, 10, 50, 30]], labels=[1], mask=mask, keypoints=[(5, 6)])
    assert not np.array_equal(seen["image"], picture)
    assert np.array_equal(seen["mask"], mask)
    assert np.array_equal(seen["keypoints"], [[5, 6]])
    kornia = RandomExposure(p=1.0, **FAST)
    params = {**kornia.forward_parameters(torch.Size([1, 3, 45, 63])), **transform.params["drawn"]}
    last = Boxes.from_tensor(torch.tensor([[[20.0, 10.0, 50.0, 30.0]]]), mode="xyxy")
    wanted = kornia.transform_boxes(last, params, kornia.flags).data[0, 0]
    assert seen["bboxes"][0] == pytest.approx(
        [*wanted[0].tolist(), *(wanted[2] + 1).tolist()], abs=1e-4
    )  # last px
    assert wanted[0, 0] < 19.9 or wanted[0, 1] < 9.9


@pytest.mark.parametrize("kind", ["uint8", "float32"])
def test_albumentations_seeds_and_replays(albumentations, picture, kind):
    from blurnoise import albumentations as ours

    given = picture if kind == "uint8" else (picture / 255).astype(kind)

    def compose(seed):
        return albumentations.Compose([ours.RandomExposure(p=1.0, moves="targets", **FAST)], seed=seed)

    target = np.zeros((45, 63), np.uint8)
    target[10:30, 20:50] = 1
    seen = compose(4)(image=given, masks=[target])["image"]
    assert seen.dtype == given.dtype
    assert np.array_equal(compose(4)(image=given, masks=[target])["image"], seen)
    assert not np.array_equal(compose(5)(image=given, masks=[target])["image"], seen)
    replayed = albumentations.ReplayCompose([ours.RandomExposure("imx250c", p=1.0, **FAST)])
    first = replayed(image=given)
    again = albumentations.ReplayCompose.replay(first["replay"], image=given)
    assert np.array_equal(again["image"], first["image"])


def test_a_torchvision_of_another_build_is_named(tmp_path):
    """torchvision's wheel for CUDA beside torch's for the CPU."""
    (tmp_path / "torchvision.py").write_text('raise RuntimeError("operator torchvision::nms does not exist")')
    paths = os.pathsep.join([str(tmp_path), *sys.path])
    done = subprocess.run(
        [sys.executable, "-c", "import blurnoise.training.torchvision"],
        env=os.environ | {"PYTHONPATH": paths}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "ImportError: torchvision and torch are different builds" in done.stderr
