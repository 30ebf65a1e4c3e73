"""Operating points of a batch: what belongs to each picture goes with it when some are taken out."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from blurnoise import Camera, Layer, RandomExposure, Trajectory, simulate
from blurnoise.light.conditions import Conditions, middle_of

CAMERA = Camera.preset("imx250")
LIGHT = torch.full((4, 1, 7, 9), 0.5)
PATHS = [Trajectory.sinusoid(float(1 + k), 90.0, 0.2) if k != 2 else None for k in range(4)]
LAYERS = tuple(
    (Layer(torch.ones(1, 2, 2), torch.ones(2, 2), (100.0 * k, 0.0)),) if k else () for k in range(4)
)
GIVEN: dict[str, Any] = {"temperature_c": 25.0, "illuminant": "D55"}
GIVEN |= {"exposure_s": [0.01, 0.02, 0.03, 0.04], "illuminance_lux": [1.0, 2.0, 3.0, 4.0]}


@pytest.mark.parametrize("of", [[2], [3, 0], [1, 1]])
def test_layers_and_trajectories_go_with_their_pictures(of: list[int]) -> None:
    velocities = [(float(k), -float(k)) for k in range(4)]
    every = Conditions.of(LIGHT, CAMERA, velocity_px_s=velocities, trajectory=PATHS, objects=LAYERS, **GIVEN)
    some = every.part(of)
    assert some.exposure_s.tolist() == pytest.approx([0.01 * (k + 1) for k in of])
    assert (some.trajectories or (None,) * len(of)) == tuple(PATHS[k] for k in of)
    assert some.objects == tuple(LAYERS[k] for k in of)
    for k, at in zip(of, some.each(), strict=True):
        assert at.displacement_px == pytest.approx((0.01 * (k + 1) * k, -0.01 * (k + 1) * k))
        assert at.trajectory is PATHS[k]
        assert [each.displacement_px[0] for each in at.objects] == pytest.approx([k * (k + 1)] if k else [])  # type: ignore[union-attr]


def test_nothing_is_left_where_those_taken_out_have_none() -> None:
    every = Conditions.of(LIGHT, CAMERA, velocity_px_s=(0.0, 0.0), trajectory=PATHS, objects=LAYERS, **GIVEN)
    assert every.part([2]).trajectories == ()
    assert every.part([0]).objects == ()


@pytest.mark.parametrize("of", [[2], [3, 0]])
def test_flows_go_with_their_pictures(of: list[int]) -> None:
    flow = torch.rand(4, 2, 7, 9, generator=torch.Generator().manual_seed(1)) * 100
    every = Conditions.of(LIGHT, CAMERA, velocity_px_s=flow, **GIVEN)
    some = every.part(of)
    exposures = torch.tensor(GIVEN["exposure_s"])[of]
    expected = flow[of] * exposures[:, None, None, None]
    assert some.flow_px is not None
    torch.testing.assert_close(some.flow_px, expected)
    middle, farthest = middle_of(expected)
    torch.testing.assert_close(some.displacement_px, middle)
    torch.testing.assert_close(some.variation_px, farthest)
    assert [at.variation_px for at in some.each()] == pytest.approx(farthest.tolist())
    none = Conditions.of(LIGHT, CAMERA, velocity_px_s=(1.0, 2.0), **GIVEN)
    assert none.part(of).flow_px is None
    assert [at.variation_px for at in none.part(of).each()] == [0.0] * len(exposures)


def test_the_middle_of_a_flow() -> None:
    """Between its least and most along each axis, not its mean; the farthest is one of its own pixels."""
    flow = torch.zeros(1, 2, 3, 3)
    flow[0, 0, 0, 0], flow[0, 1, 2, 2] = 6.0, -8.0
    middle, farthest = middle_of(flow)
    assert middle.tolist() == [[3.0, -4.0]]
    assert farthest.tolist() == [5.0]


@pytest.mark.parametrize("size", [(1, 1), (1, 5), (5, 1)])
def test_a_picture_below_a_tile_of_its_mosaic_is_refused(size: tuple[int, int]) -> None:
    mosaic, picture = Camera.preset("imx250c"), torch.rand(1, 3, *size)
    height, width = size
    must = rf"^image: {width} x {height} px; behind cfa = 'RGGB' must be at least 2 x 2$"
    for take in (simulate, RandomExposure(mosaic, p=1.0)):
        given: Any = (
            {"camera": mosaic, "exposure_s": 0.01, "illuminance_lux": 50.0} if take is simulate else {}
        )
        with pytest.raises(ValueError, match=must):
            take(picture, **given)
