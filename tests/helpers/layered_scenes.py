"""A textured background, a disc before it, and what is seen of both in motion."""

import torch

from blurnoise import Layer, expose_layers
from blurnoise.camera.colour import linear_from_srgb

Motion = tuple[float, float]
STILL = (0.0, 0.0)


def texture(height, width, seed):
    """Linear light (3, H, W) like a photograph's: amplitudes fall as 1 / f^1.5, the finest details with a lens."""
    generator = torch.Generator().manual_seed(seed)
    f = torch.hypot(torch.fft.fftfreq(height).double()[:, None], torch.fft.rfftfreq(width).double())
    f[0, 0] = 1.0
    spectrum = (
        torch.fft.rfft2(torch.randn(3, height, width, generator=generator, dtype=torch.float64)) / f**1.5
    )
    spectrum[:, 0, 0] = 0
    plane = torch.fft.irfft2(spectrum, s=(height, width))
    return linear_from_srgb((0.5 + 0.2 * plane / plane.std()).clamp(0, 1))


def disc(height, width, x, y, radius):
    down, across = torch.meshgrid(
        torch.arange(height, dtype=torch.float64), torch.arange(width, dtype=torch.float64), indexing="ij"
    )
    return (radius + 0.5 - torch.hypot(across - x, down - y)).clamp(0, 1)


SIZE = (91, 122)
BACKGROUND, OBJECT, OTHER = (texture(*SIZE, seed) for seed in (1, 2, 3))
MATTE, SECOND = disc(*SIZE, 58.3, 44.6, 12.0), disc(*SIZE, 68.0, 40.0, 9.0)


def seen(moved, background, *, light=OBJECT, alpha=MATTE):
    layer = Layer(light, alpha, moved)
    return expose_layers(BACKGROUND[None], [layer], exposure_s=1.0, velocity_px_s=background)


def close(one, other, tolerance=1e-9):
    torch.testing.assert_close(one, other, rtol=0, atol=tolerance)
