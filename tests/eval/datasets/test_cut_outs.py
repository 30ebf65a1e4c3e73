"""Cut-outs: where targets are by what is known of them, which is in front, and what is behind them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from blurnoise_eval.datasets import (
    Picture,
    Target,
    cut_out,
    rendered_signs,
    rendered_texts,
)
from blurnoise_eval.grid.objects import Objects

from blurnoise import expose_layers
from blurnoise.scene.scene import ExposedScene

HEIGHT, WIDTH = 60, 81
TRIANGLE = {"segmentation": [[10.0, 10.0, 40.0, 10.0, 10.0, 40.0]]}


def image() -> Any:
    return np.random.default_rng(3).integers(60, 90, (HEIGHT, WIDTH, 3), np.uint8)


def light(seen: Any) -> torch.Tensor:
    return ExposedScene.of_picture(seen).light


def made(*targets: Target, name: str = "a.png") -> Picture:
    return Picture(name, targets, image, "a")


def box(x0: float, y0: float, x1: float, y1: float, **more: Any) -> Target:
    return Target(more.pop("label", "car"), "cars", (x0, y0, x1, y1), **more)


def found(picture: Picture, **how: Any) -> Any:
    return cut_out(picture, light(image()), Objects(**how))


@pytest.mark.parametrize("rendered", [rendered_signs, rendered_texts])
def test_rendered_signs_and_what_is_behind_them_make_the_picture(rendered: Any) -> None:
    for picture in list(rendered((64, 40), count=4)):
        seen = picture.load()
        told = cut_out(picture, light(seen), Objects(), scale=1.0)
        again = expose_layers(told.cut.background, told.cut.layers, exposure_s=0.0)
        assert (again - light(seen)).abs().max() < 0.0046  # half a code of 8 bits is at most so much light
        assert told.targets == (0, 1)
        assert not told.cut.invented.any()
        for place, layer in zip(told.targets, told.cut.layers, strict=True):
            x0, y0, x1, y1 = picture.targets[place].box_xyxy  # type: ignore[index]
            left, top = layer.place_px
            assert left <= x0
            assert top <= y0
            assert x1 <= left + layer.alpha.shape[1]
            assert y1 <= top + layer.alpha.shape[0]


def test_a_segmentation_is_the_target() -> None:
    told = found(made(box(10, 10, 40, 40, annotation=TRIANGLE)))
    (layer,) = told.cut.layers
    assert float(layer.alpha.sum()) == pytest.approx(450, rel=0.02)


def test_what_stands_is_background() -> None:
    assert found(made(box(10, 10, 40, 40)), speeds={"car": 0.0}).cut.layers == ()
    boxes = [(55, 5, 70, 30), (30, 5, 40, 30), (70, 20, 80, 55)]  # behind and aside, right behind, in front
    persons = [box(*corners, label="person") for corners in boxes]
    told = found(made(box(10, 15, 50, 45), *persons), speeds={"person": 0.0})
    assert (told.targets, told.speeds) == ((2, 0, 3), (0.0, 1.0, 0.0))  # as these hide each other


@pytest.mark.parametrize(
    "segmentation",
    [
        [[1.0, 2.0]],
        {"size": [7, 7], "counts": [49]},
        {"size": 5, "counts": [1]},
        {"size": [60, 81], "counts": [1.5, 3]},
        {"size": [60, 81], "counts": [[1]]},
        [[500.0, 500.0, 510.0, 500.0, 505.0, 510.0]],
    ],
)
def test_a_segmentation_of_no_use_leaves_the_box(segmentation: Any) -> None:
    (layer,) = found(made(box(10, 10, 40, 40, annotation={"segmentation": segmentation}))).cut.layers
    assert float(layer.alpha.sum()) == 900  # nothing in noise sets the box apart from what is around it


def test_who_ends_further_down_is_in_front() -> None:
    told = found(made(box(5, 20, 25, 50), box(20, 5, 45, 30), box(40, 10, 60, 55)))
    assert told.targets == (1, 0, 2)
    assert [layer.place_px for layer in told.cut.layers] == [(20, 5), (5, 20), (40, 10)]


def test_who_is_behind_shows_nothing_of_who_is_in_front() -> None:
    """Where these move apart a copy of the front one would appear, on the rear one."""
    seen = np.full((HEIGHT, WIDTH, 3), 60, np.uint8)
    seen[15:45, 10:50], seen[20:55, 30:60] = 120, 230
    car, person = box(10, 15, 50, 45), box(30, 20, 60, 55, label="person")
    for speeds, rear in (({"car": 0.5}, 120), ({}, 230)):  # those that move alike never come apart
        how = Objects(speeds=speeds)
        behind, front = cut_out(made(car, person), light(seen), how).cut.layers
        level = float(light(np.full((1, 1, 3), rear, np.uint8))[0, 0, 0, 0])
        torch.testing.assert_close(behind.light[:, 6:, 21:], torch.full((3, 24, 19), level))
        assert torch.equal(front.light, light(seen)[0, :, 20:55, 30:60])
