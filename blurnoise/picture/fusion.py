"""Fusion of the captures of an HDR picture: electrons, noise and dynamic range.

Convention: capture 1 is the reference, the most sensitive one. The electrons of capture k times
R_k = T_1 s_1 / (T_k s_k) are in electrons of capture 1. A camera without captures has one, itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from typing import cast

import torch
from torch import Tensor

from blurnoise._core.checks import LIMITS, an_instance, in_range
from blurnoise.camera import Camera
from blurnoise.camera.camera import Amplified
from blurnoise.camera.captures import Capture, factors, windows

BLEND = (0.8, 0.95)
"""Shares of a capture's range between which the next takes over, linearly: high enough to use the range, and far
enough below 1 that no clipped value takes part. The weight follows the noisy value, which lowers the mean in between
by 1 / (saturation_e (high - low)): 0.06 % at 10 715 e-; smaller wells need a wider range."""


_ONLY_CAPTURE = (Capture(),)


def captures_of(camera: Camera) -> tuple[Capture, ...]:
    """The captures of a picture of this camera, at least one.

    >>> [capture.exposure_ratio for capture in captures_of(Camera.preset("ar0132x3"))]
    [1.0, 16.0, 256.0]
    """
    return camera.sensor.captures or _ONLY_CAPTURE


def amplified(camera: Camera, gain_db: float) -> Amplified:
    """The camera at a gain: analogue up to the limit of the amplifier, and the remaining digital gain, dB.

    The gain is added to that of every capture; the remaining gain is that of the first capture. Raises ``ValueError``
    beyond ``gain_max_db``.

    >>> amplified(Camera.preset("imx250"), 30.0).digital_db  # beyond the amplifier's 24 dB
    6.0
    """
    if not camera.sensor.captures:
        return camera.at_gain(gain_db)
    in_range("gain_db", gain_db, LIMITS["gain_db"].low, camera.sensor.gain_max_db)
    return _amplified(camera, float(gain_db))


@lru_cache(maxsize=256)
def _amplified(camera: Camera, gain_db: float) -> Amplified:
    totals_db = [
        min(max(gain_db, 0.0) + capture.gain_db, camera.sensor.analogue_gain_max_db)
        for capture in camera.sensor.captures
    ]
    captures = tuple(
        replace(capture, gain_db=total_db)
        for capture, total_db in zip(camera.sensor.captures, totals_db, strict=True)
    )
    first_db = gain_db + camera.sensor.captures[0].gain_db
    taken = replace(camera.with_figures(captures=captures), isp=camera.isp.at_gain(first_db))
    return Amplified(taken, first_db - totals_db[0])


@lru_cache(maxsize=256)
def readers(camera: Camera) -> tuple[Camera, ...]:
    """The camera at the gain of each capture, in order; itself where it has no captures.

    Raises ``ValueError`` unless each capture takes over where the one before it ends.

    >>> len(readers(Camera.preset("ar0132x3"))), len(readers(Camera.preset("imx250")))
    (3, 1)
    """
    if not camera.sensor.captures:
        return (camera,)
    for capture in camera.sensor.captures:
        in_range("captures: gain_db", capture.gain_db, 0.0, camera.sensor.analogue_gain_max_db)
    alone = camera.with_figures(captures=())
    each = tuple(alone.at_gain(capture.gain_db).camera for capture in camera.sensor.captures)
    ends_e = [
        reader.sensor.saturation_e * by
        for reader, by in zip(each, factors(camera.sensor.captures), strict=True)
    ]
    for number, (end_e, following_e) in enumerate(pairwise(ends_e), 2):
        # Else the capture that takes over would be full itself.
        if following_e < end_e * (1 - 1e-9):
            raise ValueError(
                f"captures: number {number} saturates at {following_e:.4g} e- of the first, the one before it at "
                f"{end_e:.4g}; must saturate at the same light as the one before it, or at more"
            )
    return each


def fuse(frames: Sequence[Tensor], camera: Camera) -> Tensor:
    """Fuse the digital numbers of all captures into electrons of the first capture; floats of any sign.

    Each capture is (DN - black level) / K times R_k. Up to ``BLEND[0]`` of its range a capture counts alone, from
    ``BLEND[1]`` on the next one; in between they are blended linearly. Raises ``ValueError`` naming the argument.

    >>> import torch
    >>> from blurnoise import Camera, Capture
    >>> camera = Camera.preset("imx250").with_figures(captures=(Capture(), Capture(exposure_ratio=16)))
    >>> clipped, short = torch.tensor([[4095.0]]), torch.tensor([[2000.0]])
    >>> round(float(fuse([clipped, short], camera)))
    78271
    """
    low, high = BLEND
    captures = captures_of(camera)
    if len(frames) != len(captures) or any(frame.shape != frames[0].shape for frame in frames):
        raise ValueError(f"frames: got {len(frames)}; must be one per capture, {len(captures)}, of one shape")
    fused: Tensor | None = None
    # From the least sensitive capture to the first: what is not clipped in a capture replaces what came before.
    for dn, reader, factor in reversed(list(zip(frames, readers(camera), factors(captures), strict=True))):
        signal_dn = dn - reader.sensor.black_level_dn
        electrons = signal_dn * (factor / reader.sensor.system_gain_dn_per_e)
        level = signal_dn / (reader.sensor.saturated_dn - reader.sensor.black_level_dn)
        weight = ((high - level) / (high - low)).clamp(0.0, 1.0)
        fused = electrons if fused is None else torch.lerp(fused, electrons, weight)
    return cast(Tensor, fused)


def noise_e(camera: Camera, electrons: float, *, dark_e: float = 0.0) -> float:
    """Temporal noise, e- rms, of a fused pixel with a mean of ``electrons`` in the first capture, rounding included.

    dark_e: electrons of dark current in addition. Between the levels ``BLEND`` the weights of the mean apply. A
    capture k alone has R_k sqrt(n / R_k + t_k dark_e + sigma_k^2), where t_k is its share of the first exposure. Two
    gains on one exposure read the same electrons with the same noise: their weights add up before the square. Raises
    ``ValueError``.

    >>> camera = Camera.preset("imx250")
    >>> round(noise_e(camera, 10_000.0)), round(noise_e(camera, 0.0), 1)  # shot noise; read noise in the dark
    (100, 2.6)
    """
    # The blend's weights are those of the mean; that they follow the noisy value changes little outside the blend.
    low, high = BLEND
    in_range("electrons", electrons, 0.0, LIMITS["white_e"].high)
    in_range("dark_e", dark_e, 0.0, LIMITS["white_e"].high)
    captures = captures_of(camera)
    remaining, rounding_e2 = 1.0, 0.0
    shared: dict[tuple[float, ...], list[float]] = {}  # by exposure: weight, weighted dark noise, shot noise
    each = zip(captures, readers(camera), factors(captures), windows(captures, 1.0), strict=True)
    for count, (capture, reader, factor, (start_s, duration_s)) in enumerate(each, 1):
        signal_e, gain = electrons / factor + dark_e * duration_s, reader.sensor.system_gain_dn_per_e
        level = signal_e * gain / (reader.sensor.saturated_dn - reader.sensor.black_level_dn)
        share = 1.0 if count == len(captures) else min(1.0, max(0.0, (high - level) / (high - low)))
        weight = remaining * share * factor
        remaining *= 1 - share
        # Every capture is rounded for itself, also two that read the same electrons.
        rounding_e2 += (weight / gain) ** 2 / 12
        shot_e2 = signal_e * reader.sensor.variance_factor(signal_e)
        sums = shared.setdefault((start_s, duration_s, capture.sensitivity), [0.0, 0.0, shot_e2])
        sums[0] += weight
        sums[1] += weight * reader.sensor.dark_noise_e
    return math.sqrt(
        rounding_e2 + sum(light**2 * shot_e2 + dark**2 for light, dark, shot_e2 in shared.values())
    )


def snr_db(camera: Camera, electrons: float, *, dark_e: float = 0.0) -> float:
    """SNR, 20 log10 of electrons over :func:`noise_e`; it falls by 10 log10 R and dark noise at each switch.

    >>> from blurnoise import Camera, Capture
    >>> camera = Camera.preset("imx250").with_figures(captures=(Capture(), Capture(exposure_ratio=16)))
    >>> [round(snr_db(camera, electrons), 1) for electrons in (8_000, 12_000)]  # across the switch
    [39.0, 28.7]
    """
    signal_e = in_range("electrons", electrons, 0.0, above=True)
    return 20 * math.log10(signal_e / noise_e(camera, electrons, dark_e=dark_e))


def dynamic_range_db(camera: Camera) -> float:
    """Dynamic range, 20 log10: saturation of the last capture over the signal of the first one at SNR 1.

    >>> from blurnoise import Camera
    >>> round(dynamic_range_db(Camera.preset("ar0132x3")), 1)
    111.4
    """
    return 20 * math.log10(saturations_e(camera)[-1] / readers(camera)[0].sensor.threshold_e)


def saturations_e(camera: Camera) -> list[float]:
    """Saturation of each capture in electrons of the first, never falling.

    >>> from blurnoise import Capture
    >>> camera = Camera.preset("imx250").with_figures(captures=(Capture(), Capture(exposure_ratio=16)))
    >>> first_e, second_e = saturations_e(camera)
    >>> round(second_e / first_e, 6)  # a sixteenth of the light, so full at 16 times as much
    16.0
    """
    an_instance("camera", camera, Camera)
    by_capture = zip(readers(camera), factors(captures_of(camera)), strict=True)
    return [reader.sensor.saturation_e * factor for reader, factor in by_capture]
