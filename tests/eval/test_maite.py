"""MAITE's protocols: what data set, model and augmentation return, and that noise belongs to the datum."""

from dataclasses import replace

import numpy as np
import pytest
from blurnoise_eval import STOP_SIGN, Detector, datasets
from blurnoise_eval.maite import MaiteDataset, MaiteExposure, MaiteModel

from blurnoise import Camera, Exposure

SIGNS = datasets.rendered_signs((80,), count=3)
DUSK = Exposure(Camera.preset("imx250c"), 0.01, 5.0, velocity_px_s=(300.0, 0.0))


def batch(data):
    return tuple(zip(*(data[index] for index in range(len(data))), strict=True))


def test_a_datum_is_a_picture_with_channels_first_and_its_targets():
    picture, target, metadata = MaiteDataset(SIGNS)[1]
    assert np.array_equal(picture.transpose(1, 2, 0), SIGNS.pictures[1].load())
    assert target.boxes.tolist() == [pytest.approx(SIGNS.pictures[1].targets[0].box_xyxy)]
    assert metadata == {"id": SIGNS.pictures[1].name}


def test_labels_are_the_numbers_of_the_given_classes_and_others_are_left_out():
    picture = SIGNS.pictures[0]
    cat = replace(picture.targets[0], label="cat")
    crowd = replace(picture.targets[0], crowd=True)
    pictures = replace(SIGNS, pictures=(replace(picture, targets=(cat, *picture.targets, crowd)),))
    assert MaiteDataset(pictures, {11: "stop sign"})[0][1].labels.tolist() == [11]


def test_pictures_without_labels_are_an_error():
    with pytest.raises(ValueError, match="has no labels"):
        MaiteDataset(replace(SIGNS, pictures=(replace(SIGNS.pictures[0], targets=None),)))


@pytest.mark.parametrize("index", [-1, 3])
def test_an_index_beyond_the_data_ends_an_iteration(index):
    with pytest.raises(IndexError, match=f"index = {index}"):
        MaiteDataset(SIGNS)[index]


def test_the_model_finds_what_its_detector_finds():
    detector = Detector(STOP_SIGN)
    found = MaiteModel(detector, min_score=0.1)([MaiteDataset(SIGNS)[0][0]])[0]
    own = detector.detect(SIGNS.pictures[0].load(), min_score=0.1)
    assert np.array_equal(found.boxes, own.boxes_xyxy)
    assert np.array_equal(found.scores, own.scores)


def test_pictures_in_floating_point_are_those_in_bytes():
    model, picture = MaiteModel(Detector(STOP_SIGN)), MaiteDataset(SIGNS)[0][0]
    one, two = model([picture, picture.astype(np.float32) / 255])
    assert np.array_equal(one.scores, two.scores)


def test_floating_point_beyond_1_is_an_error():
    with pytest.raises(
        TypeError, match=r"picture: must be uint8 or float in \[0, 1\], got float32 from 0.0 to 255.0"
    ):
        MaiteModel(Detector(STOP_SIGN))([np.array([[[0.0, 255.0]]], np.float32)])


def test_noise_depends_on_the_datum_and_not_on_its_batch():
    data, dusk = MaiteDataset(SIGNS), MaiteExposure(DUSK)
    together, alone = (
        dusk(batch(data))[0],
        [dusk(tuple([part] for part in data[index]))[0][0] for index in (2, 0)],
    )
    assert np.array_equal(together[2], alone[0])
    assert np.array_equal(together[0], alone[1])


def test_another_seed_gives_other_noise():
    data = batch(MaiteDataset(SIGNS))
    one, two = (MaiteExposure(replace(DUSK, seed=seed))(data)[0][0] for seed in (0, 1))
    assert not np.array_equal(one, two)


def test_boxes_follow_a_rolling_shutter():
    rolling = replace(DUSK, camera=Camera.preset("ar0237"))
    data = batch(MaiteDataset(SIGNS))
    _, moved, metadata = MaiteExposure(rolling)(data)
    assert abs(moved[0].boxes - data[1][0].boxes)[0, 0] > 0.01
    assert moved[0].labels.tolist() == [0]
    assert metadata == list(data[2])
