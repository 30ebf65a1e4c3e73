"""``blurnoise simulate --object``: what moves for itself, what is behind it, and what is said of both."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from blurnoise_eval.datasets import write_picture
from commands import Output, main, told

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


def test_road_speeds(street: Path, capsys: Output) -> None:
    """36 km/h are 10 m/s: by the object's width alone; by its distance f V / Z wherever it is for a pinhole, off the
    axis less for f-theta: the difference of two places."""
    taken = ("simulate", street, "-o", street.with_name("seen.png"), *TAKEN, "--object", WHERE)
    by_width = told(capsys, *taken, "--object-kmh", 36, "--object-width-m", 2)
    assert by_width["object_blur_px"] == pytest.approx(10 * 20 / 2 * 0.01)
    view = ("--object-kmh", -36, "--object-m", 4, "--hfov-deg", 60)
    pinhole = told(capsys, *taken, *view, "--lens", "rectilinear")
    assert pinhole["object_blur_px"] == pytest.approx(60 / np.tan(np.pi / 6) * 10 / 4 * 0.01, rel=1e-6)
    at_side = (*taken[:-1], "90,30,20,16")
    focal, (x, y) = 60 / (np.pi / 6), (99.5 - 59.5, 37.5 - 39.5)
    told_off = told(capsys, *at_side, *view)["object_blur_px"]
    theta = np.hypot(x, y) / focal
    at = 4 * np.tan(theta) * np.array([x, y]) / np.hypot(x, y)
    places = []
    for moved in (-1e-5, 1e-5):
        across = np.hypot(at[0] + moved, at[1])
        places.append(focal * np.arctan2(across, 4) / across * np.array([at[0] + moved, at[1]]))
    assert told_off == pytest.approx(np.hypot(*(places[1] - places[0])) / 2e-5 * 10 * 0.01, rel=1e-6)
    assert told_off < 0.9 * focal * 10 / 4 * 0.01
    camera_s_own = told(capsys, *taken, "--object-kmh", 36, "--object-m", 4)
    assert camera_s_own["object_blur_px"] > 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--object-kmh", "5", "--object-m", "5"], "object_kmh: goes with object"),
        (["--object", WHERE, "--object-kmh", "5"], "needs away_m, how far it is, or width_m, how wide"),
        (["--object", WHERE, "--object-kmh", "5", "--object-m", "-1"], "away_m = -1"),
        (["--object", WHERE, "--object-width-m", "5"], "go with object_kmh"),
        (
            ["--object", WHERE, "--object-kmh", "5", "--object-dx", "5"],
            "goes without a motion of the object in px/s",
        ),
        (["--object-dx", "5"], "goes with object"),
        (["--plate", "street.png"], "goes with object"),
        (["--object", "1,2,3"], "must be MASK.png or X,Y,WIDTH,HEIGHT"),
        (["--object", "500,2,3,4"], "covers nothing"),
        (["--object", "5,2,-3,4"], "box: x, width = -3"),
        (["--object", "0,0,120,80"], "there must be a plate"),
        (["--object", "none.png"], "none.png"),
        (["--object", WHERE, "--object-dx", "1e9"], "object_dx = 1000000000.0"),
        (["--object", WHERE, "--plate", "street.png", "--grey-anchor", "mean"], "neither grey_anchor"),
    ],
)
def test_what_is_refused(
    street: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch, options: list[str], message: str
) -> None:
    monkeypatch.chdir(street.parent)
    assert main(["simulate", str(street), "-o", "seen.png", *options]) == 2
    assert message in capsys.readouterr().err
    assert not Path("seen.png").exists()
