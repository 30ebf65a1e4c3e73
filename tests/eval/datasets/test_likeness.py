"""Pictures of one scene by their hashes: made scenes that are shifted, noisy and lit otherwise."""

from __future__ import annotations

import cv2
import numpy as np
from blurnoise_eval.datasets.likeness import look, scenes
from numpy.typing import NDArray

Pixels = NDArray[np.uint8]


def scene(seed: int, size: tuple[int, int] = (213, 320)) -> Pixels:
    """Smooth random light with a spectrum as photographs have it, in colour."""
    rng = np.random.default_rng([seed, 1])
    layers = [
        cv2.resize(rng.normal(size=(n, n, 3)), size[::-1], interpolation=cv2.INTER_CUBIC) / n
        for n in (3, 6, 12)
    ]
    whole = sum(layers)
    return np.clip(128 + 45 * whole / np.std(whole), 0, 255).astype(np.uint8)


def again(picture: Pixels, rng: np.random.Generator) -> Pixels:
    """The same shifted by up to a fiftieth of the width, at half to 1.6 times the light, with 4 % noise."""
    height, width = picture.shape[:2]
    dx, dy = rng.integers(-width // 80, width // 80 + 1, 2).tolist()
    shift = np.array([[1, 0, dx], [0, 1, dy]], np.float32)
    moved = cv2.warpAffine(picture, shift, (width, height), borderMode=cv2.BORDER_REFLECT) / 255
    lit = np.clip(moved**2.2 * 2 ** rng.uniform(-1, 0.7), 0, 1) ** (1 / 2.2)
    return np.clip(255 * lit + rng.normal(0, 10, lit.shape), 0, 255).astype(np.uint8)


def test_pictures_of_one_scene_are_found_together() -> None:
    rng = np.random.default_rng(0)
    found = scenes([look(again(scene(place // 5), rng)) for place in range(60)])
    together = np.arange(60) // 5
    assert (found[:, None] == found)[together[:, None] != together].sum() == 0
    assert 12 <= len(set(found.tolist())) <= 14


def test_hash_is_the_same_whatever_the_depth_size_and_colour() -> None:
    picture = scene(3, (600, 901))
    assert len(look(picture)) == 16
    assert look(picture.astype(np.uint16) * 257) == look(picture)
    for other in (picture.mean(axis=2).round().astype(np.uint8), cv2.resize(picture, (451, 300))):
        assert (int(look(other), 16) ^ int(look(picture), 16)).bit_count() <= 4


def test_links_make_a_scene() -> None:
    """a and c are 16 bits apart, and b is between them; d is far from all."""
    a, b, c, d = "00" * 8, "ff" + "00" * 7, "ffff" + "00" * 6, "0f" * 8
    assert scenes([a, d, c, b]).tolist() == [0, 1, 0, 0]
    assert scenes([a, d, c]).tolist() == [0, 1, 2]
    assert scenes([]).tolist() == []
