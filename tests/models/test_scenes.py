"""Scenes: the same bits from the same seed, boxes that bound what was drawn, shares and sizes as promised."""

import json
import math
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
from blurnoise_eval.datasets import coco
from blurnoise_models.scenes import compose, drawing, paint, scene, signs, things, write_coco

from blurnoise.charts import stop_sign_box

SEED = 11


@pytest.fixture
def bare(monkeypatch):
    """Scenes of nothing but signs, and these as plain white octagons on black, straight to 8 bit."""
    full = np.dstack([signs.face_mask(256)] * 4)
    monkeypatch.setattr(compose, "ground", lambda rng, n: np.zeros((n, n, 3), np.float32))
    monkeypatch.setattr(compose, "_scatter", lambda rng, canvas, spare, returns: None)
    monkeypatch.setattr(
        compose, "_erect", lambda rng, canvas, plane, size: canvas.paste(plane, full, signs.BOX, True)
    )
    monkeypatch.setattr(compose, "_lit", lambda rng, canvas: canvas)
    monkeypatch.setattr(compose, "_developed", lambda rng, canvas: np.rint(canvas * 255).astype(np.uint8))


def same(a, b):
    return np.array_equal(a.picture, b.picture) and np.array_equal(a.boxes_xyxy, b.boxes_xyxy)


@pytest.mark.slow
def test_a_scene_depends_on_seed_and_index_alone():
    indices = list(range(6))
    first = [scene(SEED, index, size_px=160) for index in indices]
    for cached in (paint._bank, drawing.outline, signs.face_mask):
        cached.cache_clear()  # as in a process that drew nothing before
    backwards = [scene(SEED, index, size_px=160) for index in reversed(indices)][::-1]
    with ThreadPoolExecutor(3) as pool:
        threaded = list(pool.map(lambda index: scene(SEED, index, size_px=160), indices))
    for a, b, c in zip(first, backwards, threaded, strict=True):
        assert same(a, b)
        assert same(a, c)


def test_other_seeds_indices_and_sizes_give_other_scenes():
    one = scene(SEED, 0, size_px=96)
    assert not same(one, scene(SEED, 1, size_px=96))
    assert not same(one, scene(SEED + 1, 0, size_px=96))
    assert not same(scene(1, 2, size_px=96), scene(2, 1, size_px=96))


def test_signs_retroreflect_unless_something_hides_them():
    """An octagon takes 0.83 of the square about it; at least three quarters of that must be left."""
    seen = [scene(SEED, index, size_px=160) for index in range(60)]
    for one in seen:
        for x0, y0, x1, y1 in one.boxes_xyxy.round().astype(int).tolist():
            assert one.retroreflects[y0:y1, x0:x1].mean() > 0.75 * 0.7
    assert 0 < np.mean([one.retroreflects.any() for one in seen if not len(one.boxes_xyxy)]) < 1


@pytest.mark.parametrize("size_px", [64, 97, 320])
def test_pictures_and_boxes_are_what_they_should_be(size_px):
    for index in range(12):
        one = scene(SEED, index, size_px=size_px)
        assert one.picture.shape == (size_px, size_px, 3)
        assert one.picture.dtype == np.uint8
        assert one.picture.std() > 0
        assert one.boxes_xyxy.dtype == np.float32
        assert one.boxes_xyxy.shape == (len(one.boxes_xyxy), 4)
        assert (one.boxes_xyxy >= 0).all()
        assert (one.boxes_xyxy <= size_px).all()
        assert (one.boxes_xyxy[:, :2] < one.boxes_xyxy[:, 2:]).all()


def test_boxes_bound_the_octagons_that_were_drawn_and_no_other(bare):
    """Light reaches every edge of a box to within a pixel, and one pixel outside it is all but gone.

    Bilinear sampling softens edges over a sample, hence a few percent of coverage out there.
    """
    seen = 0
    for index in range(150):
        one = scene(SEED, index)
        light = one.picture[..., 0] / 255
        for x0, y0, x1, y1 in one.boxes_xyxy.tolist():
            seen += 1
            window = light[math.floor(y0) : math.ceil(y1), math.floor(x0) : math.ceil(x1)]
            lit_rows, lit_columns = (np.flatnonzero(window.max(axis=axis) > 0.02) for axis in (1, 0))
            assert lit_rows[0] <= 1
            assert lit_columns[0] <= 1
            assert lit_rows[-1] >= window.shape[0] - 2
            assert lit_columns[-1] >= window.shape[1] - 2
            grown = slice(max(0, math.floor(y0) - 1), math.ceil(y1) + 1)
            light[grown, max(0, math.floor(x0) - 1) : math.ceil(x1) + 1] = 0
        assert light.max() < 0.08
    assert seen > 90


def test_a_box_turns_with_its_sign_as_the_charts_does():
    for roll_deg in (0.0, 8.0, 22.5, -31.0):
        plane = drawing.Plane.seen(0.0, 0.0, roll_deg, 5.0)
        unit = plane.project(signs.octagon())
        expected = stop_sign_box(1.0, angle_deg=roll_deg, height_px=4, width_px=4, centre_px=(2.0, 2.0))
        np.testing.assert_allclose([*unit.min(axis=0), *unit.max(axis=0)], np.array(expected) - 2, atol=1e-9)


def test_yaw_and_pitch_foreshorten():
    x, y = np.ptp(drawing.Plane.seen(50, 0, 0, 1e6).project(signs.octagon()), axis=0)
    assert x == pytest.approx(math.cos(math.radians(50)), rel=1e-4)
    assert y == pytest.approx(1, rel=1e-4)
    x, y = np.ptp(drawing.Plane.seen(0, 20, 0, 1e6).project(signs.octagon()), axis=0)
    assert y == pytest.approx(math.cos(math.radians(20)), rel=1e-4)
    assert x == pytest.approx(1, rel=1e-4)


@pytest.mark.parametrize("size_px", [3.0, 17.3, 60.0, 148.0])
@pytest.mark.parametrize("view", [(0, 0, 0, 5), (40, 12, 9, 3)])
def test_paste_averages_light_over_pixels(size_px, view):
    """The light on the canvas is the sprite's mean times the projected square's area, wherever it falls."""
    square = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    stripes = np.ones((256, 256, 4), np.float32)
    stripes[:, ::2, :3] = 0.2  # a mean of 0.6: nearest samples would be off by half
    for x, y in ((100.0, 100.0), (100.37, 99.81)):
        canvas = np.zeros((200, 200, 3), np.float32)
        plane = drawing.Plane.seen(*view).placed(square, size_px, (x, y))
        plane.paste(canvas, stripes, (-0.5, -0.5, 0.5, 0.5))
        area = cv2.contourArea(plane.project(square).astype(np.float32))
        assert canvas[..., 0].sum() == pytest.approx(0.6 * area, rel=0.03)
        columns = np.arange(200) + 0.5
        assert (canvas[..., 0] * columns).sum() / canvas[..., 0].sum() == pytest.approx(x, abs=0.05 * size_px)
        assert canvas.max() <= 1 + 1e-5


@pytest.mark.slow
def test_shares_sizes_and_angles_are_as_promised(bare):
    """900 scenes: a share of 0.35 is known within 5 sqrt(0.35 * 0.65 / 900) = 0.08."""
    many = [scene(SEED, index, size_px=160) for index in range(900)]
    counts = np.bincount([len(one.boxes_xyxy) for one in many], minlength=4) / len(many)
    assert counts[0] == pytest.approx(0.35, abs=0.08)
    assert len(counts) == 4
    assert counts[3] > 0.005
    boxes = np.concatenate([one.boxes_xyxy for one in many])
    whole = boxes[((boxes > 0) & (boxes < 160)).all(axis=1)]
    sides = (whole[:, 2:] - whole[:, :2]).max(axis=1) * 2  # at 320 px
    assert sides.min() >= 15.9
    assert sides.min() < 18
    assert sides.max() <= 200.1
    assert sides.max() > 150
    assert np.mean(sides < 34) > 0.35
    assert len(whole) < len(boxes)  # some are cut by the edge


def test_a_sign_that_is_cut_shows_at_least_half(bare):
    for index in range(400):
        one = scene(SEED, index, size_px=160)
        for x0, y0, x1, y1 in one.boxes_xyxy.tolist():
            lit = one.picture[math.floor(y0) : math.ceil(y1), math.floor(x0) : math.ceil(x1), 0].sum() / 255
            side = max(x1 - x0, y1 - y0)
            # The octagon fills 0.83 of its box, at most cos(50°) cos(20°) of which is foreshortening.
            assert lit > 0.5 * 0.83 * 0.55 * side * side


def test_things_can_be_drawn_small_and_large():
    for size_px in (16, 120):
        for number in range(60):
            sprite = things.thing(paint.Draws(SEED, number), size_px)
            assert sprite.dtype == np.float32
            assert sprite.shape[2] == 4
            assert np.isfinite(sprite).all()
            assert 0 < sprite[..., 3].max() <= 1 + 1e-5
            uncovered = sprite[sprite[..., 3] == 0]
            assert np.abs(uncovered[:, :3]).max(initial=0) < 1e-5  # no light without coverage


def test_a_sign_is_red_with_a_white_legend_and_leaves_its_corners_free(monkeypatch):
    monkeypatch.setattr(signs, "weathered", lambda rng, sprite: sprite)
    for number in range(60):
        white = signs._white(paint.Draws(SEED, number), 128)
        sprite = signs.stop_sign(paint.Draws(SEED, number), 128)
        assert sprite[:8, :8].max() == 0  # outside the octagon
        assert sprite[64, 64, 3] == pytest.approx(1, abs=1e-3)
        inside = signs.face_mask(128) > 0.99
        legend, face = (sprite[inside & where][:, :3].mean(axis=0) for where in (white > 0.9, white < 0.1))
        assert face[0] > 1.3 * face[1]
        assert legend[0] < 1.2 * legend[1]
        assert legend[1] > 1.5 * face[1]
        assert 0.15 < white[inside].mean() < 0.6


@pytest.mark.parametrize("font", drawing.FONTS)
def test_every_font_has_every_letter_that_is_written(font):
    letters = {letter for word in paint.WORDS for letter in word} | set(
        "ABCDEFGHIKLMNOPRSTUVWXYZaeionrst0123456789"
    )
    widths = []
    for letter in sorted(letters):
        contours, aspect = drawing.outline(letter, font)
        assert contours, f"{font} has no {letter}"
        widths.append(aspect)
    assert len(set(widths)) > 20  # one box for all would stand for missing letters


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ({"seed": -1}, ValueError),
        ({"index": -1}, ValueError),
        ({"size_px": 63}, ValueError),
        ({"size_px": 320.0}, TypeError),
        ({"index": True}, TypeError),
        ({"seed": "1"}, TypeError),
    ],
)
def test_wrong_arguments_are_named(arguments, error):
    with pytest.raises(error, match=f"{next(iter(arguments))} = "):
        scene(**{"seed": 0, "index": 0, **arguments})  # type: ignore[arg-type]


def test_a_coco_folder_gives_back_scenes_and_boxes(tmp_path):
    told: list[int] = []
    listing = write_coco(tmp_path / "drawn", SEED, 8, size_px=96, progress=told.append)
    assert sum(told) == 8
    pictures = list(coco(listing))
    assert [picture.name for picture in pictures] == [f"{index:06d}.png" for index in range(8)]
    boxes = 0
    for index, picture in enumerate(pictures):
        one = scene(SEED, index, size_px=96)
        assert np.array_equal(picture.load(), one.picture)
        found = [target.box_xyxy for target in picture.targets or ()]
        np.testing.assert_allclose(np.reshape(found, (-1, 4)), one.boxes_xyxy, atol=1e-4)
        assert {target.label for target in picture.targets or ()} <= {"stop sign"}
        boxes += len(found)
    assert boxes > 0
    document = json.loads(listing.read_text())
    for entry in document["annotations"]:
        assert entry["area"] == pytest.approx(entry["bbox"][2] * entry["bbox"][3])
        assert entry["iscrowd"] == 0


def test_an_interrupted_run_leaves_no_listing(tmp_path, monkeypatch):
    write_coco(tmp_path, SEED, 1, size_px=64)

    def stopped(seed, index, *, size_px):
        if index == 2:
            raise KeyboardInterrupt
        return scene(seed, index, size_px=size_px)

    monkeypatch.setattr(compose, "scene", stopped)
    with pytest.raises(KeyboardInterrupt):
        write_coco(tmp_path, SEED + 1, 4, size_px=64)
    assert not (tmp_path / "instances.json").exists()
    assert (tmp_path / "000001.png").exists()
