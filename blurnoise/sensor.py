"""From light on the scene to digital numbers: the linear model of EMVA 1288 release 4.

Domain: electrons and digital numbers (DN) as floating tensors (B, C, H, W). Electrons may be negative in the
dark, where read noise says so; only the converter's limits clip them from below.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from functools import lru_cache

import torch
from torch import Tensor

from blurnoise import rng
from blurnoise.camera import Camera
from blurnoise.checks import Numbers, non_negative, one_of, per_image
from blurnoise.encoding import Encoding, srgb_from_linear
from blurnoise.spectra import VISIBLE_NM, Curve, Spectrum, photons_per_lux_s_um2

MERGE_READ_NOISE_E = 1.0
"""From this read noise (e- rms) up, shot and read noise share one draw; see :func:`noisy_electrons`."""
_CHUNK = 1 << 17  # values handled at a time: the temporaries stay in a core's cache
Buffers = tuple[Tensor | None, Tensor | None, Tensor | None]


def photoelectrons(
    camera: Camera,
    illuminance_lux: float,
    exposure_s: float,
    illuminant: str | Curve = "D55",
    *,
    ir_cut: Spectrum = 1.0,
    band_nm: tuple[float, float] = VISIBLE_NM,
) -> float:
    """Mean photo-electrons per pixel of a white (reflectance 1) surface.

    E T p^2 tau / (4 N^2) * integral W Q I lambda/(h c) dlambda / (683 integral W V dlambda): Lin et al.,
    Sensors 2024, 24, 5135, eq. 9-13, without the rounding of h. illuminance_lux and exposure_s >= 0;
    illuminant: a name or a curve (see :func:`blurnoise.spectra.illuminant`); ir_cut: a transmission or a
    curve; band_nm: the wavelengths that count. Raises ``ValueError`` for values outside these ranges.
    """
    lux = non_negative("illuminance_lux", illuminance_lux)
    exposure = non_negative("exposure_s", exposure_s)
    return lux * exposure * electrons_per_lux_s(camera, illuminant, ir_cut, band_nm)


@lru_cache(maxsize=64)
def electrons_per_lux_s(
    camera: Camera,
    illuminant: str | Curve = "D55",
    ir_cut: Spectrum = 1.0,
    band_nm: tuple[float, float] = VISIBLE_NM,
) -> float:
    """Electrons per pixel for one lux second on a white surface; see :func:`photoelectrons`."""
    on_sensor_um2 = camera.pixel_pitch_um**2 * camera.transmission / (4 * camera.f_number**2)
    responses = (camera.quantum_efficiency, ir_cut)
    return on_sensor_um2 * photons_per_lux_s_um2(illuminant, responses, band_nm)


def dark_electrons(camera: Camera, exposure_s: Tensor, temperature_c: Tensor) -> Tensor:
    """Mean (and variance) of the dark charge: mu_I(ref) 2^((temp - ref)/doubling) T, EMVA 1288 eq. 14."""
    doublings = (temperature_c - camera.dark_reference_c) / camera.dark_doubling_c
    return camera.dark_current_e_s * torch.exp2(doublings) * exposure_s


def read_out(
    scene: Tensor,
    camera: Camera,
    *,
    white_e: Numbers = 1.0,
    exposure_s: Numbers,
    temperature_c: Numbers,
    generator: rng.Randomness,
    fixed_pattern: tuple[Tensor, Tensor] | None = None,
    normal: Tensor | None = None,
    tones: Tensor | None = None,
) -> Tensor:
    """Digital numbers of a frame with ``white_e`` * ``scene`` mean photo-electrons, scene (B, C, H, W).

    PRNU, dark current, shot and read noise, DSNU, full well, gain, black level, rounding, converter limits.
    white_e (electrons, >= 0), exposure_s, temperature_c (degC): numbers or one per image. fixed_pattern:
    what ``camera.fixed_pattern`` returned. Means below 0 (ringing of a blur) count as 0. For a caller who
    exposes one picture many times: normal, the N(0, 1) field of ``rng.standard_normal`` for these seeds,
    drawn once; tones, a value per digital number (such as :func:`tones_8bit`), which is returned instead of
    the digital number itself.
    """
    batch = len(scene)
    exposure = per_image("exposure_s", exposure_s, batch, scene, low=0.0)
    temperature = per_image("temperature_c", temperature_c, batch, scene, low=-273.15, high=300.0)
    white = per_image("white_e", white_e, batch, scene, low=0.0)[:, None, None, None]
    dark = dark_electrons(camera, exposure, temperature)[:, None, None, None]
    seeds = rng.item_seeds(generator, batch)
    if normal is None:
        normal = rng.standard_normal(seeds, scene)
    gain, offset_e = (plane.to(scene) for plane in fixed_pattern) if fixed_pattern else (None, None)
    counts: Tensor | None = None
    if camera.read_noise_e < MERGE_READ_NOISE_E:
        counts = rng.poisson(_mean_electrons(scene, white, dark, gain, None), seeds)
    if scene.requires_grad or white.requires_grad or dark.requires_grad:
        dn = _frame(scene, white, dark, normal, counts, gain, offset_e, camera)
        return dn if tones is None else _look_up(tones, dn)

    out = torch.empty(scene.shape, dtype=scene.dtype if tones is None else tones.dtype, device=scene.device)
    chunk = _CHUNK if scene.device.type == "cpu" else out[0].numel()
    scratch = _scratch(min(chunk, out[0].numel()), scene)
    for item in range(batch):
        white_of, dark_of = white[item, 0, 0], dark[item, 0, 0] if bool(dark[item]) else None
        lights, fields, parts = (_pieces(plane, chunk) for plane in (scene[item], normal[item], out[item]))
        rest = [
            [None] * len(parts) if plane is None else _pieces(plane, chunk)
            for plane in (None if counts is None else counts[item], gain, offset_e)
        ]
        for light, field, part, count, factor, offset in zip(lights, fields, parts, *rest, strict=True):
            first, second, third = scratch[:, : len(part)]
            into = (part if tones is None else first, second, third)
            dn = _frame(light, white_of, dark_of, field, count, factor, offset, camera, into)
            if tones is not None:
                torch.index_select(tones, 0, dn.to(torch.int32), out=part)
    return out


_kept = threading.local()


def _scratch(length: int, like: Tensor) -> Tensor:
    """Three buffers of ``length``, kept per thread: fresh memory would cost more than the arithmetic."""
    if like.device.type != "cpu":
        return like.new_empty(3, length)
    kept: Tensor | None = getattr(_kept, "scratch", None)
    if kept is None or kept.dtype != like.dtype or kept.shape[1] < length:
        kept = _kept.scratch = like.new_empty(3, length)
    return kept


def _pieces(plane: Tensor, length: int) -> Sequence[Tensor]:
    return torch.split(plane.reshape(-1), length)


def noisy_electrons(
    mean_e: Tensor, read_noise_e: float, normal: Tensor, into: Buffers = (None, None, None)
) -> Tensor:
    """Shot and read noise in one draw: a normal corrected to the skewness of Poisson(mean) + N(0, read^2).

    x = mean + s z + k (z^2 - 1) with k = mean / (6 v), s^2 = v - 2 k^2, v = mean + read^2 (the first terms
    of Cornish and Fisher): mean and variance exact. After gain and rounding the total variation distance
    from the exact law is below 0.008 everywhere and below 0.0005 from 100 electrons on, for a read noise of
    at least 1 electron; below that Poisson's integer steps show and :func:`read_out` draws counts instead.
    mean_e, normal: any shape. into: three buffers of that shape to work in (the first may be mean_e).
    """
    mean_into, spread_into, skew_into = into
    variance = torch.add(mean_e, read_noise_e**2, out=spread_into)
    skew6 = torch.div(mean_e, variance, out=skew_into)  # 6 k
    spread = torch.addcmul(variance, skew6, skew6, value=-2 / 36, out=spread_into)
    spread = torch.sqrt(spread, out=spread_into)
    spread = torch.addcmul(spread, skew6, normal, value=1 / 6, out=spread_into)  # s + k z
    centre = torch.add(mean_e, skew6, alpha=-1 / 6, out=mean_into)
    return torch.addcmul(centre, spread, normal, out=mean_into)


def _frame(
    scene: Tensor,
    white_e: Tensor,
    dark_e: Tensor | None,
    normal: Tensor,
    counts: Tensor | None,
    gain: Tensor | None,
    offset_e: Tensor | None,
    camera: Camera,
    into: Buffers = (None, None, None),
) -> Tensor:
    """The chain, element by element; in ``into``'s buffers where no gradient is asked for."""
    out = into[0]
    if counts is not None:
        electrons = torch.add(counts, normal, alpha=camera.read_noise_e, out=out)
    else:
        mean_e = _mean_electrons(scene, white_e, dark_e, gain, out)
        electrons = noisy_electrons(mean_e, camera.read_noise_e, normal, into)
    if offset_e is not None:
        electrons = torch.add(electrons, offset_e, out=out)
    dn = torch.mul(electrons, camera.system_gain_dn_per_e, out=out)
    dn = torch.round(torch.add(dn, camera.black_level_dn, out=out), out=out)
    return torch.clamp(dn, 0.0, camera.clip_dn, out=out)  # the full well's clip, after the same rounding


def _mean_electrons(
    scene: Tensor, white_e: Tensor, dark_e: Tensor | None, gain: Tensor | None, out: Tensor | None
) -> Tensor:
    """What shot noise is drawn from: photo signal with PRNU, never below 0, and dark charge."""
    photo_e = torch.mul(scene, white_e, out=out)
    if gain is not None:
        photo_e = torch.mul(photo_e, gain, out=out)
    photo_e = torch.clamp(photo_e, min=0.0, out=out)
    return photo_e if dark_e is None else torch.add(photo_e, dark_e, out=out)


def develop(dn: Tensor, camera: Camera, *, encoding: Encoding = "srgb") -> Tensor:
    """Digital numbers to a picture in [0, 1] for viewing and for detectors; no automatic gain.

    (dn - black) / (full scale - black), clamped, then sRGB-coded unless ``encoding`` is "linear".
    dn: any shape, integral values within the converter's range. Returns dn's floating dtype.
    """
    return _look_up(_tones(camera, encoding).to(dn), dn)


def develop_8bit(dn: Tensor, camera: Camera) -> Tensor:
    """The sRGB picture of :func:`develop` as an 8-bit camera file would hold it: uint8, same shape."""
    return _look_up(tones_8bit(camera).to(dn.device), dn)


@lru_cache(maxsize=8)
def tones_8bit(camera: Camera) -> Tensor:
    """The 8-bit sRGB value of every digital number, uint8 on the CPU."""
    return _tones(camera, "srgb").mul(255.0).round().to(torch.uint8)


@lru_cache(maxsize=8)
def _tones(camera: Camera, encoding: Encoding) -> Tensor:
    """The developed value of every digital number, float64 on the CPU."""
    one_of("encoding", encoding, ("srgb", "linear"))
    codes = torch.arange(camera.full_scale_dn + 1, dtype=torch.float64)
    light = (codes - camera.black_level_dn) / (camera.full_scale_dn - camera.black_level_dn)
    return srgb_from_linear(light) if encoding == "srgb" else light.clamp(0.0, 1.0)


def _look_up(table: Tensor, dn: Tensor) -> Tensor:
    index = dn.reshape(-1).clamp(0, len(table) - 1).to(torch.int32)
    return table.index_select(0, index).view(dn.shape)
