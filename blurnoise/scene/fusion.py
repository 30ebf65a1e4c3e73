"""Fusion of the captures of an HDR picture: electrons, noise and dynamic range, and the developed picture.

Convention: capture 1 is the reference, the most sensitive one. The electrons of capture k times
R_k = T_1 s_1 / (T_k s_k) are in electrons of capture 1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, cast

import torch
from torch import Tensor

from blurnoise._core.checks import LIMITS, an_instance, image_batch, in_range, shown
from blurnoise.camera import Camera
from blurnoise.camera.captures import Capture, factors, windows
from blurnoise.camera.colour import Encoding
from blurnoise.camera.figures import WELL_E
from blurnoise.camera.spectra import Curve
from blurnoise.picture import steps
from blurnoise.picture.steps import Development

BLEND = (0.8, 0.95)
"""Shares of a capture's range between which the next takes over, linearly: high enough to use the range, and far
enough below 1 that no clipped value takes part. The weight follows the noisy value, which lowers the mean in between
by 1 / (saturation_e (high - low)): 0.06 % at 10 715 e-; smaller wells need a wider range."""
_LEAST_WHITE_E = 1e-9  # of a picture without light


def fuse(frames: Sequence[Tensor], camera: Camera, captures: Sequence[Capture]) -> Tensor:
    """Fuse the digital numbers of all captures into electrons of the first capture; floats of any sign.

    Each capture is (DN - black level) / K times R_k. Up to ``BLEND[0]`` of its range a capture counts alone, from
    ``BLEND[1]`` on the next one; in between they are blended linearly. Raises ``ValueError`` naming the argument.
    """
    low, high = BLEND
    readers = readers_of(camera, captures)
    if len(frames) != len(captures) or any(frame.shape != frames[0].shape for frame in frames):
        raise ValueError(f"frames: got {len(frames)}; must be one per capture, {len(captures)}, of one shape")
    whole: Tensor | None = None
    for dn, reader, factor in reversed(list(zip(frames, readers, factors(captures), strict=True))):
        signal_dn = dn - reader.sensor.black_level_dn
        electrons = signal_dn * (factor / reader.sensor.system_gain_dn_per_e)
        level = signal_dn / (reader.sensor.saturated_dn - reader.sensor.black_level_dn)
        weight = ((high - level) / (high - low)).clamp(0.0, 1.0)
        whole = electrons if whole is None else torch.lerp(whole, electrons, weight)
    return cast(Tensor, whole)


def developed(
    electrons: Tensor,
    camera: Camera,
    *,
    white_e: Tensor | float,
    encoding: Encoding = "srgb",
    illuminant: str | Curve = "D55",
) -> Tensor:
    """Develop fused electrons into a picture in [0, 1]. ``white_e`` electrons, (B,) or one number, become 1.

    Brighter values clip. All picture steps of the camera after the black level apply, demosaicking included;
    ``encoding`` "linear" omits the tone curve. Raises ``TypeError`` or ``ValueError`` naming the argument.
    """
    image_batch("electrons", electrons)
    an_instance("camera", camera, Camera)
    least = _LEAST_WHITE_E if isinstance(white_e, Tensor) else in_range("white_e", white_e, 0.0, above=True)
    picture = electrons / torch.as_tensor(white_e).to(electrons).clamp_min(least).view(-1, 1, 1, 1)
    at = Development(camera.with_figures(full_well_e=WELL_E.high), 0.0, encoding, illuminant)
    for step in steps.active(camera):
        if step is not steps.BLACK_LEVEL:
            picture = step.apply(picture, at)
    return picture


def noise_e(camera: Camera, captures: Sequence[Capture], electrons: float, *, dark_e: float = 0.0) -> float:
    """Temporal noise, e- rms, of a fused pixel with a mean of ``electrons`` in the first capture, rounding included.

    dark_e: electrons of dark current in addition. Between the levels ``BLEND`` the weights of the mean apply. A
    capture k alone has R_k sqrt(n / R_k + t_k dark_e + sigma_k^2), where t_k is its share of the first exposure. Two
    gains on one exposure read the same electrons with the same noise: their weights add up before the square. Raises
    ``ValueError``.
    """
    low, high = BLEND
    in_range("electrons", electrons, 0.0, LIMITS["white_e"].high)
    in_range("dark_e", dark_e, 0.0, LIMITS["white_e"].high)
    remaining, rounding_e2 = 1.0, 0.0
    shared: dict[tuple[float, ...], list[float]] = {}  # by exposure: weight, weighted dark noise, shot noise
    each = zip(captures, readers_of(camera, captures), factors(captures), windows(captures, 1.0), strict=True)
    for count, (capture, reader, factor, (start_s, taken_s)) in enumerate(each, 1):
        seen, gain = electrons / factor + dark_e * taken_s, reader.sensor.system_gain_dn_per_e
        level = seen * gain / (reader.sensor.saturated_dn - reader.sensor.black_level_dn)
        share = 1.0 if count == len(captures) else min(1.0, max(0.0, (high - level) / (high - low)))
        weight = remaining * share * factor
        remaining *= 1 - share
        rounding_e2 += (weight / gain) ** 2 / 12
        shot_e2 = seen * reader.sensor.variance_factor(seen)
        sums = shared.setdefault((start_s, taken_s, capture.sensitivity), [0.0, 0.0, shot_e2])
        sums[0] += weight
        sums[1] += weight * reader.sensor.dark_noise_e
    return math.sqrt(
        rounding_e2 + sum(light**2 * shot_e2 + dark**2 for light, dark, shot_e2 in shared.values())
    )


def snr_db(camera: Camera, captures: Sequence[Capture], electrons: float, **beside: Any) -> float:
    """SNR, 20 log10 of electrons over :func:`noise_e`; it falls by 10 log10 R and dark noise at each switch."""
    signal = in_range("electrons", electrons, 0.0, above=True)
    return 20 * math.log10(signal / noise_e(camera, captures, electrons, **beside))


def dynamic_range_db(camera: Camera, captures: Sequence[Capture]) -> float:
    """Dynamic range, 20 log10: saturation of the last capture over the signal of the first one at SNR 1."""
    return 20 * math.log10(
        saturations_e(camera, captures)[-1] / readers_of(camera, captures)[0].sensor.threshold_e
    )


def saturations_e(camera: Camera, captures: Sequence[Capture]) -> list[float]:
    """Saturation of each capture in electrons of the first, never falling."""
    readers = readers_of(camera, captures)
    return [reader.sensor.saturation_e * by for reader, by in zip(readers, factors(captures), strict=True)]


def readers_of(camera: Camera, captures: Sequence[Capture]) -> list[Camera]:
    """The camera at each capture's gain; raises unless each capture takes over where the one before it ends."""
    an_instance("camera", camera, Camera)
    if not isinstance(captures, Sequence) or not captures:
        raise ValueError(f"captures = {shown(captures)}: must be a list of at least one")
    for capture in captures:
        an_instance("captures", capture, Capture)
        in_range("captures: gain_db", capture.gain_db, 0.0, camera.sensor.analogue_gain_max_db)
    alone = camera.with_figures(captures=()) if camera.sensor.captures else camera
    readers = [alone.at_gain(capture.gain_db).camera for capture in captures]
    ends = [reader.sensor.saturation_e * by for reader, by in zip(readers, factors(captures), strict=True)]
    for place, (end, following) in enumerate(pairwise(ends), 2):
        if following < end * (1 - 1e-9):
            raise ValueError(
                f"captures: number {place} saturates at {following:.4g} e- of the first, the one before it at "
                f"{end:.4g}; must saturate at the same light as the one before it, or at more"
            )
    return readers
