"""Rendered signs: where they stand, what is behind them, and that each picture is its own."""

import itertools
import pickle

import numpy as np
import pytest
from blurnoise_eval.datasets import RENDERED_SIZE_PX, rendered_signs, rendered_texts

KINDS = 4  # of backgrounds, in turn: plain, graded, 1/f, cluttered


def boxes(picture):
    return np.array([target.box_xyxy for target in picture.targets or ()])


def test_a_sign_fills_its_box_and_no_more():
    """On plain grey, all that differs from the background lies in the box, and reaches its four sides."""
    for picture in rendered_signs([50], count=3 * KINDS).pictures[::KINDS]:
        image = picture.load()
        assert image.shape == (RENDERED_SIZE_PX, RENDERED_SIZE_PX, 3)
        ((x0, y0, x1, y1),) = boxes(picture)
        rows, columns = np.nonzero((image != image[0, 0]).any(axis=2))
        for first, last, low, high in (
            (columns.min(), columns.max(), x0, x1),
            (rows.min(), rows.max(), y0, y1),
        ):
            assert np.floor(low) <= first <= np.floor(low) + 1  # a sliver of a pixel may not show in 8 bits
            assert np.ceil(high) - 2 <= last <= np.ceil(high) - 1
        np.testing.assert_array_equal(picture.load(), image)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_signs_stand_apart_with_room_for_their_smear(seed):
    sizes = (100, 50, 32)
    found = rendered_signs(sizes, seed=seed)
    assert len(found) == 20
    every = np.array([boxes(picture) for picture in found])  # (pictures, signs, 4)
    width, height = every[..., 2] - every[..., 0], every[..., 3] - every[..., 1]
    np.testing.assert_allclose(width, height)
    ratio = width / sizes
    assert 0.95 <= ratio.min() < 0.97 < 1.03 < ratio.max() <= 1.05
    assert every[..., 0].min() >= 45 <= RENDERED_SIZE_PX - every[..., 2].max()
    for of_picture in every:
        tops, bottoms = np.sort(of_picture[:, 1]), np.sort(of_picture[:, 3])
        assert (np.append(tops, RENDERED_SIZE_PX) - np.insert(bottoms, 0, 0)).min() >= 24 - 1e-9
    assert {target.group for each in found for target in each.targets or ()} == {
        f"stop sign {size} px" for size in sizes
    }
    assert [len({t.group for t in each.targets or ()}) for each in found] == [3] * 20
    centres = (every[..., :2] + every[..., 2:]).reshape(-1) / 2
    phase = np.histogram(centres % 1, 4, (0, 1))[0]  # of 120; each quarter of a pixel 30 ± 5 x 4.7
    assert phase.min() > 30 - 5 * 4.75
    orders = {tuple(np.argsort(of_picture[:, 1])) for of_picture in every}
    assert len(orders) == 6  # 20 of 6 orders: one is missing with 16 %


def test_a_picture_depends_on_seed_and_number_alone():
    few, many, other = (rendered_signs(count=count, seed=seed) for count, seed in ((5, 0), (12, 0), (5, 1)))
    for a, b, c in zip(few, many, other, strict=False):
        assert (a.name, a.targets, a.identity, a.image_id) == (b.name, b.targets, b.identity, b.image_id)
        np.testing.assert_array_equal(a.load(), pickle.loads(pickle.dumps(b)).load())
        assert a.targets != c.targets
        assert a.identity != c.identity
        assert (a.load() != c.load()).any()
    assert rendered_signs([50], count=1).pictures[0].name == "stop-signs-50px-01"
    images = [picture.load() for picture in many]
    assert all((a != b).any() for a, b in itertools.combinations(images, 2))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"sizes_px": (400,)}, "inside the picture, 320 x 320 px"),
        ({"sizes_px": (200, 100)}, r"sizes_px = \[200, 100\]: must fit side by side"),
        ({"count": 0}, "count = 0: must be >= 1"),
    ],
)
def test_bad_input_is_named(given, message):
    for of in (rendered_signs, rendered_texts):
        with pytest.raises(ValueError, match=message):
            of(**given)


def test_the_text_is_the_white_word_on_the_red_sign():
    found = rendered_texts([100, 50], count=4)
    assert (found.kind, found.categories, len(found)) == ("rendered", {"text": 1}, 4)
    assert len(rendered_texts()) == 20
    for picture, sign in zip(found, rendered_signs([100, 50], count=4), strict=True):
        target = (picture.targets or ())[0]
        assert (target.label, target.text, target.group) == ("text", "STOP", "STOP on a sign of 100 px")
        image = picture.load()
        np.testing.assert_array_equal(image, sign.load())
        x0, y0, x1, y1 = (round(edge) for edge in target.box_xyxy)
        rows, columns = np.nonzero(image[y0 - 3 : y1 + 3, x0 - 3 : x1 + 3, 1] > 128)  # red has little green
        found_box = (
            columns.min() - 3, rows.min() - 3, columns.max() - 2 - (x1 - x0), rows.max() - 2 - (y1 - y0),
        )  # fmt: skip
        assert np.abs(found_box).max() <= 1
