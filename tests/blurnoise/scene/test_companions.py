"""A picture's frame depends on nothing but the picture, its conditions and its seed, which all stay as they are."""

from __future__ import annotations

import weakref
from dataclasses import replace

import pytest
import torch

from blurnoise import Camera, ExposedScene, Layer, simulate
from blurnoise.optics.camera import PRESETS

AT = {"exposure_s": 0.012, "illuminance_lux": 80.0, "fidelity": "full"}


@pytest.mark.parametrize("name", sorted(PRESETS))
@pytest.mark.parametrize("velocity", [torch.zeros(2), torch.zeros(2, 16, 20)])
def test_light_at_rest_is_not_written_to(name: str, velocity: torch.Tensor) -> None:
    """Effects that have nothing to do hand their input on, which is the caller's picture."""
    light = torch.full((1, 3, 16, 20), 0.5)
    camera = Camera.preset(name)
    first = simulate(light, camera, velocity_px_s=velocity, encoding="linear", generator=[1], **AT)
    assert bool((light == 0.5).all())
    scene = ExposedScene(light, fidelity="full")
    for _ in range(2):
        again = scene.expose(
            camera, exposure_s=0.012, illuminance_lux=80.0, velocity_px_s=velocity, generator=[1]
        )
        assert torch.equal(again, first)


@pytest.mark.parametrize("fidelity", ["auto", "full"])
def test_a_picture_beside_one_with_objects_is_that_alone(fidelity: str) -> None:
    """Its lens comes before its motion there, too."""
    pictures = torch.rand(2, 3, 75, 98, generator=torch.Generator().manual_seed(0))
    layer = Layer(light=torch.rand(3, 8, 8), alpha=torch.ones(8, 8))
    velocity = torch.tensor([[700.0, -300.0], [300.0, 0.0]])
    at = {**AT, "fidelity": fidelity}
    camera = Camera.preset("lin2024")
    both = simulate(pictures, camera, velocity_px_s=velocity, layers=[[], [layer]], generator=[1, 2], **at)
    for item, own in enumerate(([], [layer])):
        alone = simulate(
            pictures[item : item + 1],
            camera,
            velocity_px_s=velocity[item],
            layers=own,
            generator=[item + 1],
            **at,
        )
        assert torch.equal(both[item : item + 1], alone)


def test_dark_charge_has_shot_noise_without_light() -> None:
    camera = replace(
        Camera.preset("imx250"),
        read_noise_e=0.01,
        dark_current_e_s=500.0,
        system_gain_dn_per_e=0.4,
        black_level_dn=64,
    )
    dark = torch.ones(1, 1, 100, 100)
    auto, full = (
        simulate(
            dark,
            camera,
            exposure_s=0.05,
            illuminance_lux=0.0,
            temperature_c=70.0,
            generator=[1],
            fidelity=fidelity,
        ).std()
        for fidelity in ("auto", "full")
    )
    assert float(auto) == pytest.approx(float(full), rel=0.05)
    assert float(full) > 5


def test_a_scene_is_freed_at_once() -> None:
    """Without waiting for the collector of cycles: training makes one for every batch."""
    scene = ExposedScene(torch.rand(1, 3, 16, 20))
    scene.expose(Camera.preset("imx250"), exposure_s=0.01, illuminance_lux=50.0, generator=[1])
    gone = weakref.ref(scene)
    del scene
    assert gone() is None
