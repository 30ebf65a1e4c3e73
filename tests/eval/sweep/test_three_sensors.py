"""What a sensor for each colour is worth: against simulated noise, and from figures worked out by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from blurnoise_eval.sweep.three_sensors import behind_bayer, worth

from blurnoise import Camera, develop, simulate
from blurnoise.optics.radiometry import photoelectrons

IMX250 = Camera.preset("imx250")


def brightness_noise(camera: Camera, lux: float, seed: int) -> float:
    """Relative standard deviation of the luminance of 18 % grey, means over 16 x 16 px: 3072 of them."""
    dn = simulate(
        torch.full((1, 3, 768, 1024), 0.18), camera, exposure_s=0.01, illuminance_lux=lux,
        generator=[seed], encoding="linear",
    )  # fmt: skip
    picture = develop(dn, camera, encoding="linear")
    luminance = torch.einsum("c,bchw->bhw", torch.tensor([0.2126, 0.7152, 0.0722]), picture)
    blocks = torch.nn.functional.avg_pool2d(luminance, 16)[:, 1:-1, 1:-1]
    return float(blocks.std() / blocks.mean())


@pytest.mark.parametrize(("read_noise_e", "lux"), [(0.01, 40.0), (300.0, 145.0)])
def test_so_much_more_light_gives_the_same_noise_of_brightness(read_noise_e: float, lux: float) -> None:
    """A deviation of 2852 means is known to 1 / sqrt(2 n) = 1.3 %, a ratio to 1.9 %: five of these.

    A grey of six read noises of 300 e-, so that nothing is clipped, has a fiftieth of their variance in shot noise;
    behind the filters a twentieth, hence 1.5 % on top.
    """
    camera = replace(
        IMX250, read_noise_e=read_noise_e, read_noise_post_share=0.0, full_well_e=60e3,
        system_gain_dn_per_e=1.0, bit_depth=16, black_level_dn=3000.0,
    )  # fmt: skip
    stops = worth(camera)
    more = stops.in_the_light if read_noise_e < 1 else stops.in_the_dark
    bayer = brightness_noise(behind_bayer(camera), lux * 2**more, seed=2)
    assert bayer / brightness_noise(camera, lux, seed=1) == pytest.approx(1.0, abs=0.095 + 0.015)


def test_filters_that_pass_all_leave_sites_and_matrix() -> None:
    """A number is taken as measured behind filters; of red, green and blue sites there are 1, 2 and 1 of 4."""
    stops = worth(replace(IMX250, quantum_efficiency=0.5))
    y, m = (0.2126, 0.7152, 0.0722), behind_bayer(IMX250).ccm
    assert m is not None
    mixed = [sum(y[row] * m[row][column] / sum(m[row]) for row in range(3)) for column in range(3)]
    times = sum(w * w * n for w, n in zip(mixed, (4, 2, 4), strict=True)) / sum(each * each for each in y)
    assert stops.in_the_light == pytest.approx(math.log2(times))
    assert stops.in_the_dark == pytest.approx(math.log2(times) / 2)
    assert photoelectrons(behind_bayer(IMX250), 1, 1) < photoelectrons(IMX250, 1, 1)


def test_a_mosaic_or_one_plane_is_refused() -> None:
    for name in ("imx250c", "imx250m"):
        with pytest.raises(ValueError, match=r"cfa = .* must be 'none'"):
            worth(Camera.preset(name))
