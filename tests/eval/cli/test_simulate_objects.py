"""``blurnoise simulate --object``: what moves for itself, what is behind it, and what is said of both."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from blurnoise_eval.datasets import write_picture
from commands import Output, told

WIDTH, HEIGHT = 120, 80
WHERE = "50,30,20,16"
TAKEN = ("--exposure-ms", 10, "--lux", 250, "--seed", 3)


@pytest.fixture
def street(tmp_path: Path) -> Path:
    """Grey, with a white rectangle at ``WHERE``."""
    picture = np.full((HEIGHT, WIDTH), 90, np.uint8)
    picture[30:46, 50:70] = 230
    write_picture(tmp_path / "street.png", picture)
    return tmp_path / "street.png"


def read(path: Path) -> np.ndarray:
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(float)


def test_the_object_moves_and_the_rest_stays(street: Path, capsys: Output) -> None:
    seen, still = street.with_name("seen.png"), street.with_name("still.png")
    facts = told(capsys, "simulate", street, "-o", seen, *TAKEN, "--object", WHERE, "--object-dx", 2000)
    assert facts["object_blur_px"] == pytest.approx(20)
    assert facts["invented_percent"] == pytest.approx(25, abs=0.5)  # L / 4w
    assert facts["blur_px"] == 0
    told(capsys, "simulate", street, "-o", still, *TAKEN)
    moved, sharp = read(seen), read(still)
    assert (moved[38, 42] - sharp[38, 42]) > 15
    assert (sharp[38, 52] - moved[38, 52]) > 15
    np.testing.assert_allclose(moved[:20], sharp[:20], atol=1)
    assert np.abs(moved[38] - moved[38][::-1]).mean() < 6  # it is centred


def test_a_mask_is_as_good_as_a_rectangle_and_a_plate_is_not_invented(street: Path, capsys: Output) -> None:
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[30:46, 50:70] = 255
    names = {name: street.with_name(f"{name}.png") for name in ("mask", "plate", "one", "other", "third")}
    write_picture(names["mask"], mask)
    write_picture(names["plate"], np.full((HEIGHT, WIDTH), 30, np.uint8))
    moving = (*TAKEN, "--object-dx", 2000)
    told(capsys, "simulate", street, "-o", names["one"], *moving, "--object", WHERE)
    told(capsys, "simulate", street, "-o", names["other"], *moving, "--object", names["mask"])
    np.testing.assert_array_equal(read(names["one"]), read(names["other"]))
    given = (*moving, "--object", WHERE, "--plate", names["plate"])
    facts = told(capsys, "simulate", street, "-o", names["third"], *given)
    assert facts["invented_percent"] == 0
    assert read(names["third"])[:20].mean() < read(names["one"])[:20].mean() - 30


def test_the_camera_may_track_it(street: Path, capsys: Output) -> None:
    seen, still = street.with_name("seen.png"), street.with_name("still.png")
    options = ("--object", WHERE, "--dx", -3000)
    facts = told(capsys, "simulate", street, "-o", seen, *TAKEN, *options)
    assert facts["blur_px"] == pytest.approx(30)
    assert facts["object_blur_px"] == 0
    assert facts["invented_percent"] > 20
    told(capsys, "simulate", street, "-o", still, *TAKEN)
    inside = (slice(32, 44), slice(52, 68))
    np.testing.assert_allclose(read(seen)[inside].mean(), read(still)[inside].mean(), atol=1)


def test_captures_follow_and_plans_say_so(street: Path, capsys: Output) -> None:
    options = ("--object", WHERE, "--object-dx", 1000, "--dx", 400, "--hdr", 8, "--explain")
    facts = told(capsys, "simulate", street, "-o", street.with_name("seen.png"), *TAKEN, *options)
    assert facts["captures"] == 2
    (row,) = [stage for stage in facts["stages"] if stage["name"] == "objects"]
    assert row["kept"]
    assert "parts of 2 px" in row["how"]
