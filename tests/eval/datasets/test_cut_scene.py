"""Cut scenes: targets move, or all else does, against scenes rendered place by place."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from blurnoise_eval.datasets.cut_outs import CutScene

from blurnoise import Camera, charts
from blurnoise.blur.layers import Layer
from blurnoise.motion.trajectory import Trajectory
from blurnoise.scene.cutting import Cut
from blurnoise.scene.scene import ExposedScene, Exposure

CAMERA = Camera.preset("imx250")
HEIGHT, WIDTH, SIZE_PX = 91, 140, 30.0
CENTRE = (70.3, 44.8)
EXPOSURE_S = 0.01
VELOCITY = (1600.0, -500.0)
PARTS = 160


def ground(shift: tuple[float, float] = (0.0, 0.0)) -> torch.Tensor:
    """Waves in two directions, known between the pixels, (1, 3, H, W)."""
    x = torch.arange(WIDTH, dtype=torch.float64) + 0.5 - shift[0]
    y = torch.arange(HEIGHT, dtype=torch.float64)[:, None] + 0.5 - shift[1]
    wave = 0.35 + 0.15 * torch.sin(0.31 * x + 0.2 * y) + 0.12 * torch.cos(0.11 * x - 0.43 * y)
    return wave.float().expand(1, 3, -1, -1).clone()


def sign(behind: torch.Tensor, shift: tuple[float, float] = (0.0, 0.0)) -> torch.Tensor:
    return charts.stop_sign(
        SIZE_PX, centre_px=(CENTRE[0] + shift[0], CENTRE[1] + shift[1]), background=behind
    )


def cut(**changes: Any) -> Cut:
    frame: Any = {"height_px": HEIGHT, "width_px": WIDTH, "centre_px": CENTRE}
    black, white = (charts.stop_sign(SIZE_PX, background=level, **frame)[0] for level in (0.0, 1.0))
    alpha = (1 - (white - black).mean(0)).clamp(0, 1)
    layer = Layer(black / alpha.clamp_min(1e-3), alpha)
    return Cut(ground(), (layer,), np.zeros((HEIGHT, WIDTH), bool))._replace(**changes)


def taken(moves: str, seed: int = 3, velocity: tuple[float, float] = VELOCITY) -> Exposure:
    return Exposure(CAMERA, EXPOSURE_S, 60.0, velocity, seed=seed, moves=moves)


def frame(scene: ExposedScene, exposure: Exposure) -> Any:
    return next(iter(scene.frames([exposure]))).picture.astype(float)


def averaged(moves: str) -> Any:
    """The picture of light that is the mean of scenes rendered at each of many moments, nothing cut out."""
    total = torch.zeros(1, 3, HEIGHT, WIDTH)
    for part in range(PARTS):
        shift = tuple(along * EXPOSURE_S * ((part + 0.5) / PARTS - 0.5) for along in VELOCITY)
        still = (0.0, 0.0)
        total += sign(
            ground(still if moves == "targets" else (shift[0], shift[1])),
            still if moves == "background" else (shift[0], shift[1]),
        )
    return frame(ExposedScene(total / PARTS), taken("all", velocity=(0.0, 0.0)))


def rms(one: Any, other: Any) -> float:
    inside = np.s_[12:-12, 18:-18]  # beyond the border the waves go on otherwise than a reflection
    return float(np.sqrt(np.mean((one[inside] - other[inside]) ** 2)))


@pytest.mark.slow
@pytest.mark.parametrize("moves", ["all", "targets", "background"])
def test_each_kind_is_the_mean_of_scenes_rendered_at_every_moment(moves: str) -> None:
    expected = {kind: averaged(kind) for kind in ("all", "targets", "background")}
    found = frame(CutScene(cut()), taken(moves))
    assert rms(found, expected[moves]) < 1.5
    for other in expected.keys() - {moves}:
        assert rms(found, expected[other]) > 4.0  # so that one cannot be taken for another


def test_speeds_are_multiples_of_the_velocity() -> None:
    still = frame(CutScene(cut()), taken("all", velocity=(0.0, 0.0)))
    stands = CutScene(cut(), [0.0])
    assert rms(frame(stands, taken("targets")), still) < 0.1
    whole = ExposedScene(sign(ground()))
    assert rms(frame(stands, taken("background")), frame(whole, taken("all"))) < 0.5
    half = frame(CutScene(cut(), [0.5]), taken("targets"))
    slower = (VELOCITY[0] / 2, VELOCITY[1] / 2)
    assert np.array_equal(half, frame(CutScene(cut()), taken("targets", velocity=slower)))


def test_what_was_invented_counts_by_what_is_seen_of_it() -> None:
    """A box w px wide that moves L shows L / 4w of what is behind it, whichever of the two moves."""
    layer = Layer(torch.ones(3, 20, 40), torch.ones(20, 40), place_px=(50, 15))
    cuts = Cut(ground(), (layer, replace(layer, place_px=(50, 55))), np.ones((HEIGHT, WIDTH), bool))
    scene = CutScene(cuts, [1.0, 2.0])
    for moves in ("targets", "background"):
        found = scene.invented(taken(moves, velocity=(2000.0, 0.0)))
        assert found == pytest.approx((20 / 160, 40 / 160), abs=0.004)
    assert scene.invented(taken("all")) == (0.0, 0.0)
    assert CutScene(cuts._replace(invented=np.zeros((HEIGHT, WIDTH), bool))).invented(taken("targets")) == (
        0,
        0,
    )


@pytest.mark.parametrize("shutter", ["global", "rolling", "global-reset"])
def test_parts_shake_with_the_camera_row_by_row(shutter: Any) -> None:
    """Where nothing moves but the camera, cut parts and whole pictures are the same; else the target moves beside."""
    row_s = 0.0 if shutter == "global" else 2e-5
    camera = replace(CAMERA, row_time_s=row_s, shutter="rolling" if shutter == "global" else shutter)
    path = Trajectory.sinusoid(4.0, 35.0, 0.2, direction_deg=30.0)

    def shaken(scene: ExposedScene, moves: str, velocity: tuple[float, float], along: Any = path) -> Any:
        at = replace(taken(moves, velocity=velocity), camera=camera, trajectory=along)
        return frame(scene, at)

    still = (0.0, 0.0)
    whole = shaken(ExposedScene(sign(ground())), "all", still)
    assert rms(shaken(CutScene(cut()), "targets", still), whole) < 0.8
    assert rms(shaken(CutScene(cut()), "targets", still, None), whole) > 3.0
    assert rms(shaken(CutScene(cut()), "targets", VELOCITY), whole) > 3.0
