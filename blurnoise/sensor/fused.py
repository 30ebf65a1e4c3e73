"""The read-out of the linear model in one pass: what :mod:`.readout` does stage by stage, to a rounding step.

Domain: NumPy planes (C, n), n pixels of C colours, float32 or float64. A piece of them stays in the cache of a core
through all stages, which write in place, each by what does it fastest: NumPy, OpenCV or PyTorch. Frames of one
picture under several lights share what does not depend on the light.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.lookup import look_up_codes
from blurnoise._core.threads import side_by_side
from blurnoise.camera import Camera
from blurnoise.sensor import stages
from blurnoise.sensor.stage import ReadoutFields, SensorStage

Plane = NDArray[Any]
_PIECE = 1 << 16  # values: few enough for a core's own cache, enough to outweigh the calls
_FAINT_E = 1e-9  # electrons of white: less is no unit to compute in
_BEYOND_DN = 2.0**20  # at which light is clipped: above any converter, and within the last step's integers


def supports(active: Sequence[SensorStage]) -> bool:
    """Whether :func:`write_frames` implements all of these stages, in this order.

    >>> supports(stages.active(Camera.preset("imx250")))
    True
    """
    own = [stage for stage in stages.LINEAR_MODEL if stage in active or stage.essential]
    return list(active) == own and stages.PHOTON_TRANSFER not in active


def write_frames(scene: Tensor, at: ReadoutFields, out: Tensor, tones: Tensor | None, threads: int) -> None:
    """Write the digital numbers (L, C, H, W) of light (1, C, H, W) under L lights, or what ``tones`` has for them.

    at: means of each light, and the fields of one frame, which all share. Several lights go with the laws "none" and
    "merged". Threads share the pieces: no bit changes.

    >>> camera = Camera.preset("imx250").with_figures(system_gain_dn_per_e=0.5, black_level_dn=10.0)
    >>> white_e, dark_e = torch.tensor([500.0, 1000.0]).view(2, 1, 1, 1), torch.zeros(2, 1, 1, 1)
    >>> at, frames = ReadoutFields(camera, "none", white_e, dark_e, seeds=[0]), torch.empty(2, 1, 1, 3)
    >>> write_frames(torch.full((1, 1, 1, 3), 0.5), at, frames, tones=None, threads=1)
    >>> frames[:, 0, 0, 0].tolist()  # 250 and 500 electrons at 0.5 DN each, above black
    [135.0, 260.0]
    """
    if at.law == "exact":  # counts, drawn by the stages that lead to them, are light of one electron each
        for stage in stages.LINEAR_MODEL[: stages.LINEAR_MODEL.index(stages.FULL_WELL)]:
            # Counts that cannot be drawn in pieces: a Poisson sampler takes one stream over the whole frame.
            scene = stage.apply(scene, at)
        at = replace(at, white_e=torch.ones_like(at.white_e), dark_e=torch.zeros_like(at.dark_e), gain=None)
    light = _flat(scene)
    colours, pixels = light.shape
    frames: Plane = out.view(len(out), colours, pixels).numpy()
    offset_e = stages.offsets_e(at)
    offset_e = None if offset_e is None else offset_e.expand(scene.shape)
    fields = [None if each is None else _flat(each) for each in (at.normal, at.read, at.gain, offset_e)]
    table, full_scale_dn = None, at.camera.sensor.full_scale_dn
    if tones is not None:  # for every code of 16 bits
        # Codes above full scale look up the last tone: that saves clipping them.
        table = np.pad(tones.numpy()[: full_scale_dn + 1], (0, 65_535 - full_scale_dn), mode="edge")
    count = threads * math.ceil(light.size / _PIECE / threads)
    step = math.ceil(pixels / count)

    def write_from(start: int) -> None:
        of = slice(start, start + step)
        parts = [None if field is None else field[:, of] for field in fields]
        _write_piece(light[:, of], parts, at, frames[..., of], table)

    side_by_side(write_from, range(0, pixels, step), threads)


def _flat(field: Tensor) -> Plane:
    flat: Plane = field.reshape(field.shape[1], -1).numpy()
    return flat


def _write_piece(
    light: Plane, fields: Sequence[Plane | None], at: ReadoutFields, out: Plane, table: Plane | None
) -> None:
    """Write the frames ``out`` (L, C, n) of light (C, n); fields: normal, read, gain and offset_e."""
    (normal, read, gain, offset_e), camera, law = fields, at.camera, at.law
    whites_e, darks_e = at.white_e.flatten().tolist(), at.dark_e.flatten().tolist()
    gain_dn, black_dn, well_e = (
        camera.sensor.system_gain_dn_per_e,
        camera.sensor.black_level_dn,
        camera.sensor.well_limit_e,
    )
    work, codes = np.empty((5, *light.shape), light.dtype), np.empty(light.shape, np.uint16)
    lit, signal, noise, skew, bend = work
    given = light if gain is None else np.multiply(light, gain, out=lit)
    most = _BEYOND_DN / gain_dn / max(min(whites_e), _FAINT_E)
    # NumPy would take three times as long.
    torch.clamp(torch.from_numpy(given), min=0.0, max=most, out=torch.from_numpy(lit))
    if law == "merged" and normal is not None:
        # z^2 - 1 of the skewness, once for all lights: it does not depend on them.
        np.multiply(normal, normal, out=bend)
        bend -= 1.0
    for white_e, dark_e, frame in zip(whites_e, darks_e, out, strict=True):
        # Light, dark charge and noise are in units of unit_e electrons: one pass less.
        # In units of white's electrons the light is the mean already, and the gain takes up the unit at the end.
        mean, unit_e = lit, white_e
        if dark_e > 0.0 or white_e <= _FAINT_E or law == "counts" or offset_e is not None:
            mean, unit_e = np.multiply(lit, white_e, out=signal), 1.0
            mean += dark_e
        added, scale_e, full = mean, 0.0, None
        if law == "merged" and normal is not None:
            scale_e = _merged_noise(mean, unit_e, camera.sensor.read_noise_e, normal, bend, noise, skew)
            added = noise
            if read is not None:
                full = _where_full(mean, unit_e, camera, normal, read, offset_e)
        else:
            if law == "counts" and normal is not None:
                mean[:] = rng.poisson_of_normal(torch.from_numpy(mean), torch.from_numpy(normal))
            most = min(well_e, _BEYOND_DN / gain_dn) / unit_e
            _, added = cv2.threshold(mean, most, 0.0, cv2.THRESH_TRUNC, dst=signal)
            mean = added
            if read is not None:
                added, scale_e = read, camera.sensor.read_noise_e
        if offset_e is not None:
            mean += offset_e
        # Gain, black level, rounding, and the limits of 16 bits.
        of_mean, of_noise = gain_dn * unit_e, gain_dn * scale_e
        cv2.addWeighted(mean, of_mean, added, of_noise, black_dn, dst=codes, dtype=cv2.CV_16U)
        if full is not None:
            codes[full[0]] = full[1]
        if table is None:
            # OpenCV's and NumPy's limits have the same bits; NumPy takes seven times as long.
            cv2.threshold(codes, camera.sensor.full_scale_dn, 0, cv2.THRESH_TRUNC, dst=codes)
            np.copyto(frame, codes, casting="unsafe")
        else:
            look_up_codes(table, codes, frame)


def _where_full(
    mean: Plane, unit_e: float, camera: Camera, normal: Plane, read: Plane, offset_e: Plane | None
) -> tuple[NDArray[np.bool_], Plane] | None:
    """Pixels whose charge may reach the full well, and their codes with the well applied; None if none do."""
    # Few pixels, if any: these are drawn in two steps, as the well clips between shot noise and read noise.
    where = mean >= stages.nearly_full_e(camera) / unit_e
    if not where.any():
        return None
    mean_e, z = (torch.from_numpy(plane[where]) for plane in (mean * unit_e, normal))
    charge = stages.noisy_electrons(mean_e, 0.0, z).clamp_(0.0, camera.sensor.well_limit_e).numpy()
    charge += camera.sensor.read_noise_e * read[where]
    if offset_e is not None:
        charge += offset_e[where]
    charge *= camera.sensor.system_gain_dn_per_e
    charge += camera.sensor.black_level_dn
    return where, np.rint(charge).clip(0, 65_535).astype(np.uint16)


def _merged_noise(
    mean: Plane, unit_e: float, read_noise_e: float, normal: Plane, bend: Plane, noise: Plane, skew: Plane
) -> float:
    """``stages.noisy_electrons`` less the mean, s z + k (z^2 - 1), into ``noise``; returns its unit in electrons."""
    variance = np.add(mean, read_noise_e**2 / unit_e, out=noise)  # mean and variance: / unit_e
    np.divide(mean, variance, out=skew)  # 6 k
    noise_, skew_ = torch.from_numpy(noise), torch.from_numpy(skew)
    noise_.addcmul_(skew_, skew_, value=-2 / 36 / unit_e)
    cv2.sqrt(noise, dst=noise)
    np.multiply(noise, normal, out=noise)
    root_e = math.sqrt(unit_e)
    noise_.addcmul_(skew_, torch.from_numpy(bend), value=1 / 6 / root_e)  # bend: z^2 - 1
    return root_e
