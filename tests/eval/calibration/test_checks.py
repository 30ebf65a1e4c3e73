"""Frames that no camera can be measured from are refused in one line that says which they are."""

import re

import cv2
import made_frames
import numpy as np
import pytest
import torch
from blurnoise_eval.calibration.fit import measure

from blurnoise.camera.colour import srgb_from_linear

CAMERA = made_frames.CAMERA
SIZE = (96, 121)


@pytest.fixture(scope="module")
def planes():
    return made_frames.exposed(CAMERA, 1, size=SIZE)


def flats(planes, change, only=None):
    """The planes with each flat frame, or those of one exposure, changed; the number of the frame is passed, too."""
    return {
        (kind, exposure_s): [
            change(plane, number).astype(plane.dtype)
            if kind == "flat" and only in (None, exposure_s)
            else plane
            for number, plane in enumerate(each)
        ]
        for (kind, exposure_s), each in planes.items()
    }


def refused(folder, planes, **how):
    with pytest.raises(ValueError, match=r"\S") as caught:
        measure(made_frames.save(folder / "frames", planes), **how)
    text = str(caught.value)
    assert "\n" not in text
    return text


def every(planes, change):
    return {key: [change(plane) for plane in each] for key, each in planes.items()}


def coded(plane):
    return (4095 * srgb_from_linear(torch.from_numpy(plane / 4095.0)).numpy()).astype(np.uint16)


def squeezed(plane):
    """8 bits through JPEG, then saved as something else."""
    return cv2.imdecode(cv2.imencode(".jpg", (plane / 16).astype(np.uint8))[1], cv2.IMREAD_UNCHANGED)


def blurred(plane, _):
    return cv2.blur(plane.astype(float), (2, 2))


def banded(plane, number):
    rows = 1 + 0.01 * np.sin(np.arange(SIZE[0]) / 5)[:, None]
    return plane * (rows if number else 1 / rows)


def of_50_ms(planes, change):
    first, second = planes["flat", 0.05]
    return {**planes, ("flat", 0.05): [first, change(second)]}


def sixteenth(plane):
    return (plane // 16).astype(np.uint8)


REFUSED = {
    "gamma": (lambda p: every(p, coded), "not linear"),
    "off the line": (lambda p: flats(p, lambda x, _: x * 0.85, only=0.05), "^flat 50 ms: is not linear"),
    "clipped": (
        lambda p: flats(p, lambda x, _: np.minimum(x, 300)), "clipped: [78] of 8 flat levels reach 300 DN"
    ),
    "dark cut off at 0": (
        lambda p: every(p, lambda x: np.maximum(x.astype(int) - 20, 0).astype(np.uint16)), "^dark.*clipped"
    ),
    "flicker": (
        lambda p: flats(p, lambda x, number: x * (1 - 0.04 * number), only=0.05),
        "^flat 50 ms: flicker: .* varies by 4",
    ),
    "bands": (lambda p: flats(p, banded), "flicker in bands"),
    "filtered": (lambda p: flats(p, blurred), "correlation of .* raw numbers"),
    "compressed": (lambda p: every(p, squeezed), "correlation of .* raw numbers"),
    "two exposures": (lambda p: dict(list(p.items())[:4]), "2 flat exposures with two frames or more; must be 3"),
    "no dark": (lambda p: {key: x for key, x in p.items() if key[0] == "flat"}, "dark frames are missing"),
    "one frame each": (lambda p: {key: x[:1] for key, x in p.items()}, "dark frames are missing; take two or more"),
    "sizes": (lambda p: of_50_ms(p, lambda x: x[:, :-1]), "120 x 96 px, .* but 121 x 96 px"),
    "depths": (lambda p: of_50_ms(p, sixteenth), "121 x 96 px, 8 bits, but .* 16 bits"),
}  # fmt: skip


@pytest.mark.parametrize(("change", "why"), REFUSED.values(), ids=REFUSED)
def test_refused(planes, tmp_path, change, why):
    assert re.search(why, refused(tmp_path, change(planes)))
