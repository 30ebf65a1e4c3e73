"""The CPU's route through the sensor: the formulas' law, and no bit that depends on pieces, lights or layout."""

import math

import pytest
import torch

from blurnoise import Camera
from blurnoise._core import lookup, rng
from blurnoise.picture.develop import tones_8bit
from blurnoise.sensor import readout as sensor

BASE = Camera.preset("imx250").with_figures(
    name="test",
    full_well_e=9000.0,
    system_gain_dn_per_e=0.4,
    read_noise_e=2.45,
    black_level_dn=6.0,
)
EVERY_EFFECT = BASE.with_figures(name="every effect", dark_current_e_s=900.0, prnu=0.02, dsnu_e=2.0)
CAMERAS = [BASE, EVERY_EFFECT, BASE.with_figures(name="quiet", read_noise_e=0.4)]
by_camera = pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.name)


def scene(height=53, width=71):
    """Somewhat below black and above white, as beside the edges of a blur."""
    return torch.rand(1, 3, height, width, generator=torch.Generator().manual_seed(1)) * 1.1 - 0.05


def exposed(light, camera, **options):
    pattern = camera.sensor.fixed_pattern(tuple(light.shape[1:]), 3) if camera.sensor.prnu else None
    given = {"exposure_s": 0.02, "temperature_c": 30.0, "generator": [5] * len(light), "white_e": 800.0}
    return sensor.read_out(light, camera, **given | {"fixed_pattern": pattern} | options)


@by_camera
@pytest.mark.parametrize("tones", [False, True])
def test_lights_together_are_lights_alone(camera, tones):
    light, table, lights_e = scene(), tones_8bit(camera) if tones else None, [40.0, 700.0, 9000.0]
    shared = exposed(light.expand(3, -1, -1, -1), camera, white_e=lights_e, tones=table)
    alone = [exposed(light, camera, white_e=white_e, tones=table) for white_e in lights_e]
    assert torch.equal(shared, torch.cat(alone))
    assert not torch.equal(shared[0], shared[1])


@pytest.mark.parametrize("lights_e", [[0.0, 700.0], [1e-12, 1e-10], [1e-3, 1e12], [1e30, 1e31], [0.0, 0.0]])
def test_lights_far_apart_or_out_of_range(lights_e):
    light = scene()
    shared = exposed(light.expand(2, -1, -1, -1), BASE, white_e=lights_e)
    for dn, white_e in zip(shared, lights_e, strict=True):
        assert torch.equal(dn, exposed(light, BASE, white_e=white_e)[0])
        if white_e < 1e-6:
            assert float(dn.mean()) == pytest.approx(6.0, abs=5 * 0.98 / math.sqrt(dn.numel()) + 0.01)
        if white_e > 1e9:
            full = dn[light[0] > 1e-3].double()  # of the well, with its read noise of 0.98 DN
            assert float(full.mean()) == pytest.approx(
                BASE.sensor.clip_dn, abs=5 * 1.02 / math.sqrt(full.numel())
            )
            assert float(full.std()) == pytest.approx(math.hypot(0.98, 12**-0.5), rel=0.05)


def test_light_lies_in_memory_as_it_likes():
    light = torch.rand(1, 3, 21, 34, generator=torch.Generator().manual_seed(5))
    beside = exposed(light.contiguous(memory_format=torch.channels_last), EVERY_EFFECT)
    assert torch.equal(beside, exposed(light, EVERY_EFFECT))


@pytest.mark.parametrize("fidelity", ["auto", "full"])
def test_tones_are_looked_up_for_every_number(fidelity, monkeypatch):
    """By OpenCV's 16-bit tables and, where it has none, by NumPy; from black to far beyond white."""
    tones = torch.randint(0, 256, (4096,), generator=torch.Generator().manual_seed(2), dtype=torch.uint8)
    small_well, options = BASE.with_figures(full_well_e=5000.0), {"white_e": 30_000.0, "fidelity": fidelity}
    numbers = exposed(scene(), small_well, **options).long()
    assert small_well.sensor.clip_dn <= int(numbers.max()) <= small_well.sensor.clip_dn + 6 * 0.4 * 2.45 + 0.5
    assert int(numbers.min()) < 20
    for wide in (lookup._LOOKS_UP_16_BITS, False):
        monkeypatch.setattr(lookup, "_LOOKS_UP_16_BITS", wide)
        assert torch.equal(exposed(scene(), small_well, tones=tones, **options), tones[numbers])


@by_camera
def test_fields_of_ones_own_are_taken_as_given(camera):
    light, signs = scene().expand(2, -1, -1, -1), {"frame": 1, "read": 1}

    def draw(seeds, like, stream):
        return signs[stream] * rng.standard_normal(seeds, like, stream)

    given = {"generator": [7, 8], "white_e": [800.0, 9500.0]}
    drawn = exposed(light, camera, **given)
    assert torch.equal(exposed(light, camera, draw=draw, **given), drawn)
    for stream in signs:
        signs[stream] = -1
        assert not torch.equal(exposed(light, camera, draw=draw, **given)[1], drawn[1])


def test_sixteen_bits_are_all_there():
    """A ramp without noise from below black to beyond full scale: every code in between, exactly."""
    deep = BASE.with_figures(bit_depth=16, system_gain_dn_per_e=7.0, black_level_dn=100.0, full_well_e=1e5)
    ramp = torch.linspace(-500, 70_000, 70_501, dtype=torch.float64)[None, None, None]
    dn = exposed(ramp / 7, deep, white_e=1.0, noise=False)
    assert torch.equal(dn, (ramp.clamp(min=0) + 100).clamp(max=65_535))
