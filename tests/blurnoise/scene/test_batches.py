"""A picture of a batch is what it would be alone, to the bit, whatever the others are given."""

from typing import Any

import pytest
import torch

from blurnoise import Camera, Exposure, Layer, Trajectory, simulate

SIZE = HEIGHT, WIDTH = (41, 67)
IMX250 = Camera.preset("imx250").with_figures(width_px=WIDTH, height_px=HEIGHT)
CAMERAS = {
    "global": IMX250,
    "soft": IMX250.with_figures(defocus_radius_px=1.2, dark_current_e_s=200.0, prnu=0.01, dsnu_e=3.0),
    "rolling": IMX250.with_figures(defocus_radius_px=1.0, row_time_s=3e-4, shutter="rolling"),
}
STEADY = torch.tensor([[400.0, -90.0], [-120.0, 30.0], [0.0, 0.0]])[..., None, None].expand(-1, -1, *SIZE)
ZOOM = STEADY * torch.linspace(0.5, 1.5, WIDTH)
SQUARE = [
    Layer(torch.full((1, 16, 20), 0.9), torch.ones(16, 20), velocity, (30, 20))
    for velocity in ((1600.0, 0.0), (0.0, 900.0))
]
PATHS = [
    Trajectory.sinusoid(4.0, 80.0, 0.05, direction_deg=30.0, phase_rad=0.5),
    Trajectory.sinusoid(3.0, 90.0, 0.1),
    None,
]
GIVEN: dict[str, dict[str, Any]] = {
    "dark, bright and saturated": {
        "exposure_s": [0.0, 0.03, 100.0],
        "illuminance_lux": [1e-9, 80.0, 1e5],
        "velocity_px_s": [(5.0, 0.0), (400.0, 300.0), (0.01, 0.0)],
    },
    "motions": {
        "velocity_px_s": [(500.0, 300.0), (90.0, -20.0), (300.0, 0.0)],
        "exposure_s": [0.01, 0.02, 0.004],
    },
    "paths": {"trajectory": PATHS, "velocity_px_s": [(100.0, 0.0), (50.0, 50.0), (900.0, -300.0)]},
    "flows": {"velocity_px_s": ZOOM},
    "objects": {"layers": [[SQUARE[0]], [], [SQUARE[1]]], "illuminance_lux": [0.01, 100.0, 1000.0]},
    "objects and motion": {"layers": [[SQUARE[0]], [], [SQUARE[1]]], "velocity_px_s": [(-300.0, 100.0)] * 3},
    "objects and paths": {"layers": [[SQUARE[0]], [], [SQUARE[1]]], "trajectory": PATHS},
    "objects and flows": {"layers": [[SQUARE[0]], [], [SQUARE[1]]], "velocity_px_s": ZOOM},
}


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("given", GIVEN)
def test_a_picture_of_a_batch_is_what_it_would_be_alone(given, camera):
    light = torch.rand(3, 3, *SIZE, generator=torch.Generator().manual_seed(3))
    taken: dict[str, Any] = {"exposure_s": [0.01] * 3, "illuminance_lux": [60.0] * 3, "generator": [1, 2, 3]}
    taken |= GIVEN[given]
    together = simulate(light, CAMERAS[camera], **taken)
    for item in range(3):
        own = {name: value[item : item + 1] for name, value in taken.items()}
        assert torch.equal(together[[item]], simulate(light[[item]], CAMERAS[camera], **own)), item
    assert not torch.equal(together[0], together[1])


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("still", [{"velocity_px_s": 0 * ZOOM[:1]}, {"trajectory": [None]}, {"layers": [[]]}])
def test_nothing_that_moves_is_as_if_nothing_had_been_given(still, camera):
    light = torch.rand(1, 3, *SIZE, generator=torch.Generator().manual_seed(3))
    taken: dict[str, Any] = {"exposure_s": 0.01, "illuminance_lux": 60.0, "generator": [1]}
    expected = simulate(light, CAMERAS[camera], **taken)
    assert torch.equal(simulate(light, CAMERAS[camera], **taken, **still), expected)


def of_two(exposure_s=(0.01, 0.02), velocity_px_s=(0.0, 0.0), seed=(1, 2)):
    return Exposure(
        Camera.preset("imx250"),
        torch.tensor(exposure_s),
        torch.tensor([5.0, 6.0]),
        velocity_px_s=velocity_px_s,
        seed=seed,
    )


def test_exposures_of_batches_compare_as_a_whole():
    assert of_two() == of_two()
    speeds = torch.tensor([3.0, 4.0])
    assert of_two(velocity_px_s=(speeds, speeds)) == of_two(velocity_px_s=(speeds.clone(), speeds.clone()))
    for other in (of_two((0.01, 0.03)), of_two(seed=(1, 3)), of_two(velocity_px_s=(speeds, speeds))):
        assert of_two() != other


def test_an_exposure_of_one_frame_equals_another_and_hashes():
    one, other, longer = (Exposure(Camera.preset("imx250"), time_s, 5.0) for time_s in (0.01, 0.01, 0.02))
    assert one == other != longer
    assert hash(one) == hash(other)
    assert one != "exposure"
