"""Objects in the chain: simulate, plans, sweeps' frames, lens and distortion, captures."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from blurnoise import Camera, ExposedScene, Exposure, Layer, expose_layers, plan, simulate
from blurnoise.blur.layers import object_motion
from blurnoise.light.conditions import Conditions
from blurnoise.light.effects import through
from blurnoise.light.motion import OBJECTS, displaced
from blurnoise.optics.camera import staggered
from blurnoise.optics.lens import Distortion, Lens
from blurnoise.scene.hdr import captured

CAMERA = Camera.preset("imx250")
SIZE = (61, 84)
BACKGROUND = 0.7 * torch.rand(1, 3, *SIZE, generator=torch.Generator().manual_seed(2))
SQUARE = Layer(torch.full((1, 16, 20), 0.9), torch.ones(16, 20), (1600.0, 0.0), (30, 20))
TAKEN = {"exposure_s": 0.01, "illuminance_lux": 100.0, "noise": False, "quantised": False, "generator": [1]}
"""16 px."""


def mean_frame(
    light: torch.Tensor, layers: object = (), camera: Camera = CAMERA, **taken: object
) -> torch.Tensor:
    return simulate(light, camera, **{"encoding": "linear", "layers": layers, **TAKEN, **taken})


@pytest.mark.parametrize("velocity", [(0.0, 0.0), (700.0, -300.0)])
@pytest.mark.parametrize("fidelity", ["auto", "full"])
def test_simulate_exposes_what_layers_make(velocity: tuple[float, float], fidelity: str) -> None:
    light = expose_layers(BACKGROUND, [SQUARE], exposure_s=0.01, velocity_px_s=velocity)
    found = mean_frame(BACKGROUND, [SQUARE], velocity_px_s=velocity, fidelity=fidelity)
    torch.testing.assert_close(found, mean_frame(light.clamp(0, 1)), rtol=0, atol=2.0)  # of 4095; what rings
    assert float((found - mean_frame(BACKGROUND, velocity_px_s=velocity)).abs().max()) > 100


def test_every_picture_has_its_own_layers_whatever_its_plan() -> None:
    """Pictures in the dark and in the light are planned apart, as are those with and without objects."""
    pictures = BACKGROUND.expand(3, -1, -1, -1)
    layers = [[SQUARE], [], [replace(SQUARE, velocity_px_s=(0.0, 900.0))]]
    taken = {"illuminance_lux": [0.01, 100.0, 1000.0], "generator": [4, 5, 6], "noise": True}
    together = mean_frame(pictures, layers, **taken)
    for place in range(3):
        own = {"illuminance_lux": taken["illuminance_lux"][place], "generator": [4 + place], "noise": True}
        alone = mean_frame(pictures[place : place + 1], layers[place], **own)
        assert torch.equal(together[place : place + 1], alone)


def test_a_lens_blurs_what_the_motions_make() -> None:
    """Not the layers alone, whose mattes it would soften twice."""
    blurred = replace(CAMERA, defocus_radius_px=2.5)
    light = expose_layers(BACKGROUND, [SQUARE], exposure_s=0.01, velocity_px_s=(500.0, 0.0))
    found = mean_frame(BACKGROUND, [SQUARE], blurred, velocity_px_s=(500.0, 0.0), fidelity="full")
    expected = mean_frame(light.clamp(0, 1), (), blurred, fidelity="full")
    torch.testing.assert_close(found, expected, rtol=0, atol=2.0)


def test_distortion_comes_first() -> None:
    """At rest, the distorted composite; in motion, layers move in the px of the picture."""
    barrel = Lens(distortion=Distortion("opencv", (-0.2, 0.02, 0.001, -0.0005)))
    field = replace(CAMERA, width_px=2 * SIZE[1], height_px=2 * SIZE[0], hfov_deg=70.0, lens=barrel)
    even, still = torch.full_like(BACKGROUND, 0.3), replace(SQUARE, velocity_px_s=(0.0, 0.0), place_px=(5, 6))
    sharp = expose_layers(even, [still], exposure_s=0.01)
    found, expected = (mean_frame(*each, camera=field) for each in ((even, [still]), (sharp, ())))
    undistorted = mean_frame(sharp)
    assert float((found - expected).abs().mean()) < 0.1 * float((undistorted - expected).abs().mean())


def test_plans_keep_objects_and_bound_them() -> None:
    taken = {"exposure_s": 0.01, "illuminance_lux": 100.0}
    moving = plan(CAMERA, **taken, objects=(object_motion(SQUARE, 0.01, SIZE),))
    row = {stage.name: stage for stage in moving.stages}["objects"]
    assert row.kept
    assert "matte formula" in row.how
    assert row.contribution_dn > 100
    assert "objects" not in moving.without
    both = plan(CAMERA, **taken, objects=(object_motion(SQUARE, 0.01, SIZE),), displacement_px=(5.0, 0.0))
    assert "parts of 2 px" in {stage.name: stage for stage in both.stages}["objects"].how
    assert {stage.name: stage for stage in plan(CAMERA, **taken).stages}["objects"].contribution_dn == 0


@pytest.mark.parametrize(
    ("moved", "background"), [(0.02, 0.0), (0.3, 0.0), (1.0, 0.9), (6.0, -3.0), (40.0, 0.0)]
)
def test_the_bound_holds_for_black_and_white(moved: float, background: float) -> None:
    """Against one motion for all, the background's."""
    generator = torch.Generator().manual_seed(3)
    scene, light = (torch.randint(0, 2, (1, 1, 64, 80), generator=generator).double() for _ in range(2))
    alpha = torch.zeros(64, 80, dtype=torch.float64)
    alpha[20:40, 24:56] = torch.randint(0, 2, (20, 32), generator=generator).double()
    apart, along = (Layer(light[0], alpha, (speed, 0.0)) for speed in (moved, background))
    taken = {"exposure_s": 1.0, "velocity_px_s": (background, 0.0)}
    one, other = (expose_layers(scene, [layer], **taken) for layer in (apart, along))
    at = Conditions(CAMERA, 1.0, 25.0, 1.0, (background, 0.0), objects=(object_motion(apart, 1.0, (64, 80)),))
    assert float((one - other).square().mean().sqrt()) <= OBJECTS.bound(at)


def test_sweeps_frames_are_those_of_simulate() -> None:
    scene = ExposedScene(BACKGROUND, layers=[SQUARE])
    exposures = [
        Exposure(CAMERA, s, 100.0, velocity, seed=7)
        for s in (0.005, 0.01)
        for velocity in ((0.0, 0.0), (400.0, 0.0))
    ]
    seen = [frame.picture for frame in scene.frames(exposures)]
    for exposure, picture in zip(exposures, seen, strict=True):
        (alone,) = ExposedScene(BACKGROUND, layers=[SQUARE]).frames([exposure])
        assert (alone.picture == picture).all()
    assert (seen[0] != seen[2]).any()
    assert (seen[2] != seen[3]).any()


def test_nothing_changes_where_there_are_none() -> None:
    given = {"exposure_s": 0.01, "illuminance_lux": 50.0, "velocity_px_s": (700.0, 0.0), "generator": [3]}
    assert torch.equal(
        simulate(BACKGROUND, CAMERA, **given, encoding="linear"),
        simulate(BACKGROUND, CAMERA, **given, encoding="linear", layers=[[]]),
    )
    at = Conditions(CAMERA, *[torch.zeros(1)] * 3, torch.zeros(1, 2))
    assert through(BACKGROUND, at, without=frozenset({"vignetting"})) is BACKGROUND


def test_gradients_reach_velocities_through_the_chain() -> None:
    velocity = torch.tensor([900.0, 300.0], requires_grad=True)
    mean_frame(BACKGROUND, [replace(SQUARE, velocity_px_s=velocity)])[..., 20:36, 30:40].sum().backward()
    assert velocity.grad is not None
    assert float(velocity.grad.abs().max()) > 0


def test_later_captures_have_it_further_on() -> None:
    """The second of two, 1/8 as long and right behind the first: its middle 0.5625 of an exposure later, 9 px."""
    frames = captured(
        ExposedScene(0 * BACKGROUND, layers=[SQUARE]),
        CAMERA,
        staggered(8),
        **{name: value for name, value in TAKEN.items() if name != "generator"},
    )
    across = torch.arange(SIZE[1], dtype=torch.float32)
    middles = []
    for frame in frames:
        light = (frame - CAMERA.black_level_dn)[0, 0].sum(0)
        middles.append(float((light * across).sum() / light.sum()))
    assert middles[0] == pytest.approx(39.5, abs=0.1)
    assert middles[1] - middles[0] == pytest.approx(9.0, abs=0.1)


@pytest.mark.parametrize("shift", [(3.0, -2.0), (2.4, 0.7)])
def test_layers_are_displaced_by_any_distance(shift: tuple[float, float]) -> None:
    moved = displaced(SQUARE, torch.tensor(shift))
    down = torch.arange(moved.alpha.shape[0], dtype=torch.float32)
    across = torch.arange(moved.alpha.shape[1], dtype=torch.float32)
    total = moved.alpha.sum()
    middle = ((moved.alpha.sum(0) * across).sum() / total, (moved.alpha.sum(1) * down).sum() / total)
    assert float(middle[0]) + moved.place_px[0] == pytest.approx(39.5 + shift[0], abs=0.1)
    assert float(middle[1]) + moved.place_px[1] == pytest.approx(27.5 + shift[1], abs=0.1)
    assert displaced(SQUARE, torch.zeros(2)) is SQUARE
