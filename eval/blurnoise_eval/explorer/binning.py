"""Cameras of binned pixels, for previews: n x n averaged pixels are one of another camera."""

from __future__ import annotations

from dataclasses import replace

from blurnoise._core.checks import integer
from blurnoise.optics.camera import Camera
from blurnoise.optics.lens import Lens

_BINNED = {
    "pixel_pitch_um": 1,
    "full_well_e": 2,
    "system_gain_dn_per_e": -2,
    "read_noise_e": 1,
    "dark_current_e_s": 2,
    "prnu": -1,
    "dsnu_e": 1,
    "defocus_radius_px": -1,
    "row_time_s": 1,
}
"""Figures that change with binning, and by which power of n."""


def binned(camera: Camera, n: int) -> Camera:
    """The camera of n x n averaged pixels. Raises ``ValueError`` for n < 1, or for figures beyond a camera's
    limits."""
    if integer("n", n, 1, 1 << 10) == 1:
        return camera
    figures = {name: getattr(camera, name) * float(n) ** power for name, power in _BINNED.items()}
    rows = tuple(
        replace(each, full_well_e=each.full_well_e * n**2, read_noise_e=each.read_noise_e * n)
        for each in camera.conversion_gains
    )
    size = {name: max(1, round(getattr(camera, name) / n)) for name in ("width_px", "height_px")}
    return replace(camera, **figures, **size, conversion_gains=rows, lens=_binned_lens(camera.lens, n))


def _binned_lens(lens: Lens, n: int) -> Lens:
    """The lens in px of n times the side. Pixel centres are whole numbers: the corner of the sensor is -1/2."""
    distortion, mtf = lens.distortion, lens.mtf
    if distortion is not None:
        distortion = replace(
            distortion,
            focal_px=tuple(focal / n for focal in distortion.focal_px),
            centre_px=tuple((centre + 0.5) / n - 0.5 for centre in distortion.centre_px),
        )
    if mtf is not None and mtf.unit == "cycles/px":
        mtf = replace(mtf, frequencies=tuple(frequency * n for frequency in mtf.frequencies))
    return replace(lens, field_curvature_px=lens.field_curvature_px / n, distortion=distortion, mtf=mtf)
