"""Cut-outs: where targets are by what is known of them, which is in front, and what is behind them."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from blurnoise_eval.datasets import Picture, Target, cut_out, rendered_signs, rendered_texts
from blurnoise_eval.datasets.cut_outs import CutScene
from blurnoise_eval.plan.objects import ObjectSettings

from blurnoise import Camera, charts, expose_layers
from blurnoise.blur.layer import Layer
from blurnoise.scene.cutting import Cut
from blurnoise.scene.exposure import Exposure
from blurnoise.scene.scene import Scene
from blurnoise.scene.take import take_each

HEIGHT, WIDTH = 60, 81


def image():
    return np.random.default_rng(3).integers(60, 90, (HEIGHT, WIDTH, 3), np.uint8)


def light(seen):
    return Scene.of_picture(seen).light


def made(*targets, name="a.png"):
    return Picture(name, targets, image, "a")


def box(x0, y0, x1, y1, **more):
    return Target(more.pop("label", "car"), "cars", (x0, y0, x1, y1), **more)


def found(picture, **how):
    return cut_out(picture, light(image()), ObjectSettings(**how))


@pytest.mark.parametrize("rendered", [rendered_signs, rendered_texts])
def test_rendered_signs_and_what_is_behind_them_make_the_picture(rendered):
    for picture in list(rendered((64, 40), count=4)):
        seen = picture.load()
        told = cut_out(picture, light(seen), ObjectSettings(), scale=1.0)
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


def test_what_stands_is_background():
    assert found(made(box(10, 10, 40, 40)), speeds={"car": 0.0}).cut.layers == ()
    boxes = [(55, 5, 70, 30), (30, 5, 40, 30), (70, 20, 80, 55)]  # behind and aside, right behind, in front
    persons = [box(*corners, label="person") for corners in boxes]
    told = found(made(box(10, 15, 50, 45), *persons), speeds={"person": 0.0})
    assert (told.targets, told.speeds) == ((2, 0, 3), (0.0, 1.0, 0.0))  # as these hide each other


USELESS: list[Any] = [
    [[1.0, 2.0]],
    {"size": [7, 7], "counts": [49]},
    {"size": [60, 81], "counts": [1.5, 3]},
    [[500.0, 500.0, 510.0, 500.0, 505.0, 510.0]],
]


@pytest.mark.parametrize("segmentation", USELESS)
def test_a_segmentation_of_no_use_leaves_the_box(segmentation):
    (layer,) = found(made(box(10, 10, 40, 40, annotation={"segmentation": segmentation}))).cut.layers
    assert float(layer.alpha.sum()) == 900  # nothing in noise sets the box apart from what is around it


def test_who_ends_further_down_is_in_front():
    told = found(made(box(5, 20, 25, 50), box(20, 5, 45, 30), box(40, 10, 60, 55)))
    assert told.targets == (1, 0, 2)
    assert [layer.place_px for layer in told.cut.layers] == [(20, 5), (5, 20), (40, 10)]


def test_who_is_behind_shows_nothing_of_who_is_in_front():
    """Where these move apart a copy of the front one would appear, on the rear one."""
    seen = np.full((HEIGHT, WIDTH, 3), 60, np.uint8)
    seen[15:45, 10:50], seen[20:55, 30:60] = 120, 230
    car, person = box(10, 15, 50, 45), box(30, 20, 60, 55, label="person")
    for speeds, rear in (({"car": 0.5}, 120), ({}, 230)):  # those that move alike never come apart
        how = ObjectSettings(speeds=speeds)
        behind, front = cut_out(made(car, person), light(seen), how).cut.layers
        level = float(light(np.full((1, 1, 3), rear, np.uint8))[0, 0, 0, 0])
        torch.testing.assert_close(behind.light[:, 6:, 21:], torch.full((3, 24, 19), level))
        assert torch.equal(front.light, light(seen)[0, :, 20:55, 30:60])


# --- cut scenes, against scenes rendered place by place ---


CAMERA = Camera.preset("imx250")
ROWS, COLUMNS, SIZE_PX = 91, 140, 30.0
CENTRE = (70.3, 44.8)
EXPOSURE_S = 0.01
VELOCITY = (1600.0, -500.0)
PARTS = 160


def ground(shift=(0.0, 0.0)):
    """Waves in two directions, known between the pixels, (1, 3, H, W)."""
    x = torch.arange(COLUMNS, dtype=torch.float64) + 0.5 - shift[0]
    y = torch.arange(ROWS, dtype=torch.float64)[:, None] + 0.5 - shift[1]
    wave = 0.35 + 0.15 * torch.sin(0.31 * x + 0.2 * y) + 0.12 * torch.cos(0.11 * x - 0.43 * y)
    return wave.float().expand(1, 3, -1, -1).clone()


def sign(behind, shift=(0.0, 0.0)):
    return charts.stop_sign(
        SIZE_PX, centre_px=(CENTRE[0] + shift[0], CENTRE[1] + shift[1]), background=behind
    )


def cut(**changes):
    frame: Any = {"height_px": ROWS, "width_px": COLUMNS, "centre_px": CENTRE}
    black, white = (charts.stop_sign(SIZE_PX, background=level, **frame)[0] for level in (0.0, 1.0))
    alpha = (1 - (white - black).mean(0)).clamp(0, 1)
    layer = Layer(black / alpha.clamp_min(1e-3), alpha)
    return Cut(ground(), (layer,), np.zeros((ROWS, COLUMNS), bool))._replace(**changes)


def taken(moves, seed=3, velocity=VELOCITY):
    return Exposure(CAMERA, EXPOSURE_S, 60.0, velocity, seed=seed, moves=moves)


def frame(scene, exposure):
    return next(take_each(scene, [exposure])).images()[0].astype(float)


def averaged(moves):
    """The picture of light that is the mean of scenes rendered at each of many moments, nothing cut out."""
    total = torch.zeros(1, 3, ROWS, COLUMNS)
    for part in range(PARTS):
        shift = tuple(along * EXPOSURE_S * ((part + 0.5) / PARTS - 0.5) for along in VELOCITY)
        still = (0.0, 0.0)
        total += sign(
            ground(still if moves == "targets" else (shift[0], shift[1])),
            still if moves == "background" else (shift[0], shift[1]),
        )
    return frame(Scene(total / PARTS), taken("all", velocity=(0.0, 0.0)))


def rms(one, other):
    inside = np.s_[12:-12, 18:-18]  # beyond the border the waves go on otherwise than a reflection
    return float(np.sqrt(np.mean((one[inside] - other[inside]) ** 2)))


@pytest.mark.slow
@pytest.mark.parametrize("moves", ["all", "targets", "background"])
def test_each_kind_is_the_mean_of_scenes_rendered_at_every_moment(moves):
    expected = {kind: averaged(kind) for kind in ("all", "targets", "background")}
    found = frame(CutScene(cut()).scene, taken(moves))
    assert rms(found, expected[moves]) < 1.5
    for other in expected.keys() - {moves}:
        assert rms(found, expected[other]) > 4.0  # so that one cannot be taken for another


def test_what_was_invented_counts_by_what_is_seen_of_it():
    """A box w px wide that moves L shows L / 4w of what is behind it, whichever of the two moves."""
    layer = Layer(torch.ones(3, 20, 40), torch.ones(20, 40), place_px=(50, 15))
    cuts = Cut(ground(), (layer, replace(layer, place_px=(50, 55))), np.ones((ROWS, COLUMNS), bool))
    scene = CutScene(cuts, [1.0, 2.0])
    for moves in ("targets", "background"):
        found = scene.invented(taken(moves, velocity=(2000.0, 0.0)))
        assert found == pytest.approx((20 / 160, 40 / 160), abs=0.004)
    assert scene.invented(taken("all")) == (0.0, 0.0)
    assert CutScene(cuts._replace(invented=np.zeros((ROWS, COLUMNS), bool))).invented(taken("targets")) == (
        0,
        0,
    )
