"""Binning: the camera whose pixels are n x n of another's, averaged after the converter, for pictures n times
smaller.

Domain: n >= 1. A mean of n^2 pixels holds n^2 times the charge before it is full, at a system gain n^2 times lower;
what is independent from pixel to pixel (read noise, DSNU, PRNU) averages: by variance n^2 e^2 of electrons, PRNU / n.
Lengths in px shrink by n, those of a lens's calibration included. Exact but for rounding, which is finer than 1/12
DN^2 in an average.
"""

from __future__ import annotations

from dataclasses import replace

from blurnoise._core.checks import integer
from blurnoise.camera import Camera
from blurnoise.lens import Lens


def binned(camera: Camera, n: int) -> Camera:
    """The camera of n x n averaged pixels. Raises ``ValueError`` for n < 1, or for figures beyond a camera's
    limits."""
    integer("n", n, 1, 1 << 10)
    if n == 1:
        return camera
    area = n * n
    return replace(
        camera,
        pixel_pitch_um=camera.pixel_pitch_um * n,
        full_well_e=camera.full_well_e * area,
        system_gain_dn_per_e=camera.system_gain_dn_per_e / area,
        read_noise_e=camera.read_noise_e * n,
        dark_current_e_s=camera.dark_current_e_s * area,
        prnu=camera.prnu / n,
        dsnu_e=camera.dsnu_e * n,
        conversion_gains=tuple(
            replace(each, full_well_e=each.full_well_e * area, read_noise_e=each.read_noise_e * n)
            for each in camera.conversion_gains
        ),
        defocus_radius_px=camera.defocus_radius_px / n,
        row_time_s=camera.row_time_s * n,
        width_px=max(1, round(camera.width_px / n)),
        height_px=max(1, round(camera.height_px / n)),
        lens=_binned_lens(camera.lens, n),
    )


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
