"""Brackets read from files: exposures of EXIF and of tables, and pictures of a tripod that moved, put in place."""

import cv2
import made_brackets
import numpy as np
import pytest
from blurnoise_eval.calibration.bracket import align, listed, read_bracket
from PIL import Image

TIMES = (0.01, 0.02, 0.04, 0.08)


@pytest.fixture(scope="module")
def scene():
    """Smooth noise over three decades, (150, 203, 3)."""
    random = np.random.default_rng(4)
    smooth = cv2.GaussianBlur(random.normal(size=(150, 203, 3)), (0, 0), 1.5)
    return np.exp(2 * smooth / smooth.std() - 1)


def seen_from(scene, *places):
    """The scene from places (x, y), at exposures a stop apart, of 8 bits."""
    views = [scene[20 - y : 130 - y, 20 - x : 180 - x] for x, y in places]
    return [
        np.rint(255 * np.clip(view * 2.0**stop / 4, 0, 1) ** 0.5).astype(np.uint8)
        for stop, view in enumerate(views)
    ]


def test_a_tripod_at_rest_leaves_pictures_alone(scene):
    pictures = seen_from(scene, (0, 0), (0, 0), (0, 0), (0, 0))
    cut, moved = align(pictures, list("abcd"))
    assert moved == []
    assert all(one is other for one, other in zip(cut, pictures, strict=True))


def test_pictures_of_a_tripod_that_moved_are_aligned(scene):
    """By 3 px right and up from the second on, by 1 px down at the last; the rest is what all of them show."""
    places = [(0, 0), (2, -1), (2, -1), (2, 1)]
    cut, moved = align(seen_from(scene, *places), list("abcd"))
    assert moved == ["b by 2, -1 px", "d by 0, 2 px"]
    same = align(seen_from(scene, *[(0, 0)] * 4), list("abcd"))[0]
    assert cut[0].shape == (108, 158, 3)
    # where the first picture is cut, the scene at rest is cut alike
    for one, other in zip(cut, same, strict=True):
        assert np.array_equal(one, other[1 : 1 + 108, 0:158])


def test_a_move_that_is_too_far_is_refused_with_its_size(scene):
    with pytest.raises(ValueError, match=r"c: the camera moved by 9, -6 px .* at most 3 px"):
        align(seen_from(scene, (0, 0), (0, 0), (9, -6), (9, -6)), list("abcd"))


def test_a_camera_that_turned_is_refused(scene):
    pictures = seen_from(scene, (0, 0), (0, 0), (0, 0))
    turn = cv2.getRotationMatrix2D((80, 55), 6.0, 1.0)
    pictures[2] = cv2.warpAffine(pictures[2], turn, (160, 110), borderMode=cv2.BORDER_REFLECT)
    with pytest.raises(ValueError, match="c: the camera turned"):
        align(pictures, list("abc"))


def test_exposures_come_from_exif_or_the_table(tmp_path, scene):
    pictures = seen_from(scene, *[(0, 0)] * 4)
    of_exif = made_brackets.save(tmp_path / "exif", pictures, TIMES, suffix=".jpg", stated=False)
    assert [shot.exposure_s for shot in listed(of_exif)] == pytest.approx(TIMES)
    stated = made_brackets.save(tmp_path / "table", pictures, TIMES, iso=[100, 200, 100, 100], f_number=[2, 2, 2, 4],
                                speed_px_s=[0, 0, 50, 50], direction_deg=[0, 0, 90, 180])  # fmt: skip
    shots = listed(stated)
    assert [shot.exposure for shot in shots] == pytest.approx([0.0025, 0.01, 0.01, 0.005])
    assert [shot.moving for shot in shots] == [False, False, True, True]
    assert shots[2].speed_px_s == pytest.approx((0, 50), abs=1e-9)
    assert shots[3].speed_px_s == pytest.approx((-50, 0), abs=1e-9)
    # the table counts where there are both, and pictures come by exposure, whatever the order of files
    made_brackets.save(of_exif, pictures[::-1], TIMES[::-1], suffix=".jpg")
    bracket = read_bracket(of_exif)
    assert [shot.exposure_s for shot in bracket.shots] == pytest.approx(TIMES)
    means = [picture.mean() for picture in bracket.pictures]
    assert means == sorted(means)


def test_a_portrait_is_turned_as_exif_says(tmp_path, scene):
    """All turned alike are a bracket; one that is turned alone has another size, and is named."""
    pictures = seen_from(scene, *[(0, 0)] * 4)
    folder = made_brackets.save(tmp_path / "all", pictures, TIMES, suffix=".jpg", stated=False)
    for path in sorted(folder.glob("*.jpg")):
        turn(path)
    assert read_bracket(folder).pictures[0].shape == (160, 110, 3)
    folder = made_brackets.save(tmp_path / "one", pictures, TIMES, suffix=".jpg", stated=False)
    turn(folder / "2.jpg")
    with pytest.raises(
        ValueError, match=r"2.jpg: 110 x 160 px \(turned by EXIF\?\), but the others have 160 x 110"
    ):
        read_bracket(folder)


def turn(path):
    with Image.open(path) as opened:
        exif, picture = opened.getexif(), opened.copy()
    exif[0x0112] = 6
    picture.save(path, exif=exif, quality=95)


def test_large_pictures_are_reduced_with_a_note(tmp_path):
    picture = np.zeros((70, 3000, 3), np.uint8)
    picture[:, ::40] = 200
    bracket = read_bracket(made_brackets.save(tmp_path / "large", [picture, picture], (0.1, 0.2)))
    assert bracket.pictures[0].shape == (48, 2048, 3)
    assert bracket.notes == ("pictures of 3000 x 70 px were reduced to 2048 x 48",)


@pytest.mark.parametrize(
    ("table", "why"),
    [
        (None, "1.jpg: the exposure time is missing; add it to EXIF or to frames.csv"),
        ("file,exposure_s\n0.jpg,0", "0.jpg: exposure_s = 0: must be > 0"),
        ("file,exposure_s\n0.jpg,", "0.jpg: the exposure time is missing"),
        ("exposure_s,file\n0.1,0.jpg\n0.2", r"frames.csv: a row \(0.2\) has no file"),
        ("file,exposure_s\n0.jpg,1\n0.jpg,2", "frames.csv: 0.jpg is listed 2 times"),
        ("file,exposure_s,iso\n0.jpg,1,400\n1.jpg,1,", "1.jpg: the ISO is missing, and others state it"),
        (
            "file,exposure_s,f_number\n0.jpg,1,\n1.jpg,1,8",
            "0.jpg: the f-number is missing, and others state it",
        ),
        ("file,exposure_s,direction_deg\n0.jpg,1,inf", "direction_deg = 'inf' of 0.jpg: must be a number"),
        ("file,time\n0.jpg,1", "must have the columns file and exposure_s"),
        ("file,exposure_s\n0.jpg,soon", "exposure_s = 'soon' of 0.jpg: must be a number"),
        ("file,exposure_s,iso\n0.jpg,1,-100", "0.jpg: iso = -100: must be > 0"),
        ("file,exposure_s,speed_px_s\n0.jpg,1,1e9", "speed_px_s = 1e.09 of 0.jpg: must be below 1e7"),
        ("file,exposure_s\n../0.jpg,1", "0.jpg"),
        ("file,exposure_s\n", "contains no pictures"),
    ],
)
def test_what_is_missing_or_wrong_is_one_line(tmp_path, scene, table, why):
    pictures = seen_from(scene, *[(0, 0)] * 2)
    folder = made_brackets.save(tmp_path / "bracket", pictures, TIMES[:2], suffix=".jpg", stated=False)
    Image.fromarray(pictures[1]).save(folder / "1.jpg")  # without EXIF
    if table is not None:
        (folder / "frames.csv").write_text(table)
    with pytest.raises(ValueError, match=why) as raised:
        read_bracket(folder)
    assert "\n" not in str(raised.value)


def test_times_may_be_written_as_fractions(tmp_path, scene):
    folder = made_brackets.save(tmp_path / "bracket", seen_from(scene, (0, 0)), (0.02,))
    (folder / "frames.csv").write_text("file,exposure_s\n0.png,1/50\n")
    assert listed(folder)[0].exposure_s == 0.02
