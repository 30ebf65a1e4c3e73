"""Laws of augmentations: what they see of a library whose faults are known, and of ours."""

import numpy as np
import pytest
from blurnoise_eval.bench import laws
from blurnoise_eval.bench.laws import LAWS, Library

BY_NAME = {law.name.split(" px")[0]: law.seen for law in LAWS}


def noisy(picture, seed, add=0.0):
    """Noise of standard deviation 4."""
    drawn = np.random.default_rng(seed).normal(add, 4, picture.shape)
    return (picture + drawn).round().clip(0, 255).astype(np.uint8)


def moved(picture, length, angle=0.0):
    """Blurred along x by an odd number of px."""
    return np.mean([np.roll(picture, x, axis=1) for x in range(-(length // 2), length // 2 + 1)], axis=0)


MADE = Library(
    "made", "made",
    noise=lambda picture, seed: noisy(picture, seed, add=-3.0),
    clip=lambda frames, seed: [noisy(frame, seed) for frame in frames],
    blur=lambda picture, length, angle: np.minimum(moved(picture, length if angle == 0 else 11), 1.0),
    default_blur=lambda picture, seed: np.roll(picture, (-3, 4), axis=(0, 1)),
    exposed=lambda picture, seconds: np.full_like(picture, 90),
    still=lambda picture, seed: moved(picture, 3),
)  # fmt: skip


# Of 97 x 97 x 3 values of standard deviation 4, five times: 5 sigma of the mean are .05, of the deviation .09.
@pytest.mark.parametrize(
    ("law", "seen"),
    [
        ("noise keeps the mean", "64, 128, 200 become 61.0, 125.0, 197.0"),
        ("even grey gets noise", "standard deviation 4.0"),
        ("frames of a clip have noise of their own", "correlation of their noise 1.00"),
        ("a longer exposure is brighter", "mean 90 with 1 ms, 90 with 4 ms"),
        ("blur leaves an object where its box is", "moved by up to 5.0 px"),
        ("light above white is kept", "3.0 becomes 1.0"),
        ("the same seed gives the same bits", "yes"),
        ("without motion nothing is blurred", "33 % of a point stays in its pixel"),
        ("draws can be replayed on another size", None),
    ],
)
def test_a_law_sees_the_fault_of_a_library(law, seen):
    assert BY_NAME[law](MADE) == seen


def test_a_line_of_n_pixels_spreads_as_one_of_root_n2_minus_1():
    # The variance of n points one px apart is (n^2 - 1) / 12.
    assert BY_NAME["blur of 21"](MADE) == "21.0, 11.0, 11.0, 11.0"


def test_our_augmentation_and_kornias_differ_where_the_guide_says():
    ours, kornia = laws.installed(["blurnoise", "kornia"])
    law = "frames of a clip have noise of their own"
    assert [BY_NAME[law](each) for each in (ours, kornia)] == [
        f"correlation of their noise {c}" for c in ("0.00", "1.00")
    ]
    assert BY_NAME["noise keeps the mean"](ours) == "64, 128, 200 become 64.0, 128.0, 200.0"
    law = "draws can be replayed on another size"
    assert [BY_NAME[law](each)[:12] for each in (ours, kornia)] == ["yes", "RuntimeError"]
