"""The transform for albumentations 2.0 and for AlbumentationsX, whichever is installed: the uses of any transform."""

import json
import os
import pickle
from typing import Any

import numpy as np
import pytest
import torch
from exposures import exposures
from torch.utils.data import DataLoader, Dataset

from blurnoise import Camera, labels_numpy
from blurnoise.training.table import ExposureTable

os.environ["NO_ALBUMENTATIONS_UPDATE"] = "1"
A = pytest.importorskip("albumentations", reason="albumentations is not installed")

from blurnoise.albumentations import RandomExposure  # noqa: E402

FAST: dict[str, Any] = {
    "speed_px_s": (500.0, 1000.0),
    "exposure_s": (0.01, 0.02),
    "illuminance_lux": (5.0, 100.0),
    "p": 1.0,
}
ROLLING: dict[str, Any] = {"exposure_s": 0.004, "speed_px_s": 900.0, "direction_deg": 30.0}
PICTURE = np.random.default_rng(1).integers(0, 256, (45, 63, 3)).astype(np.uint8)
CLIP = np.stack([PICTURE] * 3)
TABLE = ExposureTable.of_grid(
    "imx250c", exposure_s=[0.01, 0.02], illuminance_lux=[50.0], gain_db=["auto", 3.0]
)
KINDS: dict[str, Any] = {
    "ranges": lambda: RandomExposure(**FAST),
    "objects": lambda: RandomExposure(
        "ar0237", moves=("all", "targets"), gain_db="auto", grow_boxes=True, p=1.0
    ),
    "cameras": lambda: RandomExposure(
        [Camera.preset("imx250c").with_figures(read_noise_e=9.0), "ar0132x3"], encoding="linear", p=1.0
    ),
    "lamp": lambda: RandomExposure("ar0132x3", lamp_hz=90.0, lamp_lights="targets", exposure_s=0.001, p=1.0),
    "road": lambda: RandomExposure(ego_kmh=(10.0, 50.0), p=1.0),
    "table": lambda: RandomExposure(table=TABLE, channels="bgr", p=1.0),
}


def seen(transform, picture=PICTURE, seed=1, **options):
    return A.Compose([transform], seed=seed, **options)(image=picture)["image"]


@pytest.mark.parametrize(
    "picture",
    [PICTURE, PICTURE[..., 0], PICTURE[..., :1], (PICTURE / 255).astype(np.float32)],
    ids=["colour", "grey", "one channel", "float32"],
)
def test_a_picture_comes_back_as_it_came(picture):
    for found in (RandomExposure(**FAST)(image=picture)["image"], seen(RandomExposure(**FAST), picture)):
        assert (found.shape, found.dtype) == (picture.shape, picture.dtype)
        assert not np.array_equal(found, picture)
    assert np.array_equal(RandomExposure(p=0.0)(image=picture)["image"], picture)


@pytest.mark.parametrize("target", ["images", "volume", "volumes"])
@pytest.mark.parametrize("channels", [3, 1, None])
def test_frames_share_conditions_and_not_noise(target, channels):
    clip = CLIP[..., 0] if channels is None else CLIP[..., :channels]
    clip = clip[None] if target == "volumes" else clip
    found = A.Compose([RandomExposure(**FAST)], seed=1)(**{target: clip})[target]
    assert found.shape == clip.shape
    first, second = (found[0] if target == "volumes" else found)[:2]
    assert not np.array_equal(first, second)
    assert abs(float(first.mean()) - float(second.mean())) < 2
    two = A.Compose([RandomExposure(**FAST)], additional_targets={"right": "image"}, seed=1)
    stereo = two(image=PICTURE, right=PICTURE)
    assert not np.array_equal(stereo["image"], stereo["right"])


def test_seeds_containers_and_channels():
    first = seen(RandomExposure(**FAST))
    assert np.array_equal(seen(RandomExposure(**FAST)), first)
    assert not np.array_equal(seen(RandomExposure(**FAST), seed=2), first)
    assert np.array_equal(
        pickle.loads(pickle.dumps(A.Compose([RandomExposure(**FAST)], seed=1)))(image=PICTURE)["image"], first
    )
    compose = A.Compose([RandomExposure(**FAST)], seed=1)
    assert not np.array_equal(compose(image=PICTURE)["image"], compose(image=PICTURE)["image"])
    bgr = seen(RandomExposure(channels="bgr", **FAST), np.ascontiguousarray(PICTURE[..., ::-1]))
    assert np.array_equal(bgr[..., ::-1], first)
    for container in (A.OneOf, A.Sequential):
        assert not np.array_equal(seen(container([RandomExposure(**FAST)], p=1.0)), PICTURE)
    assert seen(RandomExposure(**FAST), strict=True).shape == PICTURE.shape


@pytest.mark.parametrize("kind", KINDS)
def test_saved_and_replayed_transforms_give_the_same_picture(kind):
    """As JSON and as a replay, of every kind of conditions."""
    mask = np.zeros(PICTURE.shape[:2], np.uint8)
    mask[10:30, 20:40] = 1
    given = {"image": PICTURE, "mask": mask}
    saved = json.loads(json.dumps(A.to_dict(A.Compose([KINDS[kind]()]))))
    again, pipeline = A.from_dict(saved), A.Compose([KINDS[kind]()])
    again.set_random_seed(5)
    pipeline.set_random_seed(5)
    assert np.array_equal(again(**given)["image"], pipeline(**given)["image"])
    recorded = A.ReplayCompose([KINDS[kind](), A.HorizontalFlip(p=0.5)])
    first = recorded(**given)
    replayed = A.ReplayCompose.replay(first["replay"], **given)
    assert np.array_equal(replayed["image"], first["image"])
    assert np.array_equal(replayed["mask"], first["mask"])
    assert len(repr(recorded.transforms[0])) < 600


def test_labels_are_those_of_the_numpy_door():
    boxes, points = np.array([[20.0, 10.0, 50.0, 30.0]]), np.array([[30.0, 5.0], [400.0, -20.0]])
    masks = np.stack([PICTURE[..., 0] > 99, PICTURE[..., 1] > 200]).astype(np.uint8) * 7
    pipeline = A.Compose(
        [RandomExposure("ar0237", p=1.0, **ROLLING)],
        bbox_params=A.BboxParams("pascal_voc", label_fields=["labels"]),
        keypoint_params=A.KeypointParams("xy", remove_invisible=False),
    )
    found = pipeline(
        image=PICTURE, bboxes=boxes, labels=[1], keypoints=points, masks=masks, mask=masks[0].astype(bool)
    )
    (exposure,) = exposures("ar0237", **ROLLING)
    wanted = labels_numpy(PICTURE.shape, exposure, boxes=boxes, keypoints=points, label_masks=masks)
    np.testing.assert_allclose(found["bboxes"], wanted.boxes, atol=1e-3)
    np.testing.assert_allclose(found["keypoints"], wanted.keypoints, atol=1e-3)
    assert np.array_equal(found["masks"], wanted.label_masks)
    assert np.array_equal(found["mask"], wanted.label_masks[0] > 0)
    assert not np.array_equal(found["mask"], masks[0] > 0)
    empty = pipeline(image=PICTURE, bboxes=np.zeros((0, 4)), labels=[], keypoints=np.zeros((0, 2)))
    assert len(empty["bboxes"]) == len(empty["keypoints"]) == 0


class _Same(Dataset[Any]):
    """One picture, again and again."""

    def __init__(self, transform):
        self.transform = transform

    def __len__(self):
        return 6

    def __getitem__(self, item):
        return torch.from_numpy(self.transform(image=PICTURE)["image"])


@pytest.mark.slow
@pytest.mark.parametrize("seed", [None, 7])
def test_workers_and_epochs_differ_by_torchs_seed(seed):
    def epochs(p=1.0):
        torch.manual_seed(3)
        loader = DataLoader(_Same(A.Compose([RandomExposure(**{**FAST, "p": p})], seed=seed)), num_workers=2)
        return [[each.numpy().tobytes() for each in loader] for _ in range(3)]

    every = [each for epoch in epochs() for each in epoch]
    assert len({*every}) == 18
    gates = {
        tuple(each == PICTURE.tobytes() for each in epoch[first::2])
        for epoch in epochs(0.5)
        for first in (0, 1)
    }
    assert len(gates) > 2
    if seed is not None:
        assert [each for epoch in epochs() for each in epoch] == every
