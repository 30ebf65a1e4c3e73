"""From light on the scene to digital numbers: the linear model of EMVA 1288 release 4.

Domain: electrons and digital numbers (DN) as floating tensors (B, C, H, W). Electrons may be negative in the
dark, where read noise says so; only the converter's limits clip them from below.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
import torch
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.checks import Numbers, image_batch, non_negative, one_of, per_image
from blurnoise._core.threads import WORTH_IT, in_pieces, side_by_side
from blurnoise.camera import Camera
from blurnoise.encoding import Encoding, srgb_from_linear
from blurnoise.sensor import fused as frames
from blurnoise.sensor.fused import Law
from blurnoise.spectra import VISIBLE_NM, Curve, Spectrum, photons_per_lux_s_um2

MERGE_READ_NOISE_E = 1.0
"""From this read noise (e- rms) up, shot and read noise share one draw; see :func:`noisy_electrons`."""
Fidelity = Literal["auto", "full"]
FixedPattern = tuple[Tensor, Tensor]


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


def expose(
    photons: Tensor,
    camera: Camera,
    *,
    exposure_s: Numbers,
    temperature_c: Numbers = 25.0,
    fixed_pattern: FixedPattern | None = None,
    generator: rng.Randomness = None,
    illuminant: str | Curve = "D55",
    fidelity: Fidelity = "auto",
) -> Tensor:
    """Digital numbers of a frame that receives mean ``photons`` per pixel, (B, C, H, W), each >= 0.

    For photon transfer measurements: the photons meet the camera's quantum efficiency (a curve counts by its
    mean over the photons of ``illuminant``) and then the chain of :func:`read_out`. Raises ``ValueError`` for
    negative photons.
    """
    image_batch("photons", photons)
    if float(photons.detach().min()) < 0:
        raise ValueError(f"photons: smallest value is {float(photons.min()):g}; must be >= 0")
    return read_out(
        photons,
        camera,
        white_e=mean_quantum_efficiency(camera, illuminant),
        exposure_s=exposure_s,
        temperature_c=temperature_c,
        generator=generator,
        fixed_pattern=fixed_pattern,
        fidelity=fidelity,
    )


@lru_cache(maxsize=64)
def mean_quantum_efficiency(camera: Camera, illuminant: str | Curve = "D55") -> float:
    """Electrons per photon of ``illuminant`` within 400-700 nm."""
    if not isinstance(camera.quantum_efficiency, Curve):
        return float(camera.quantum_efficiency)
    electrons = photons_per_lux_s_um2(illuminant, (camera.quantum_efficiency,), VISIBLE_NM)
    return electrons / photons_per_lux_s_um2(illuminant, (), VISIBLE_NM)


def read_out(
    scene: Tensor,
    camera: Camera,
    *,
    white_e: Numbers = 1.0,
    exposure_s: Numbers,
    temperature_c: Numbers,
    generator: rng.Randomness,
    fixed_pattern: FixedPattern | None = None,
    fidelity: Fidelity = "auto",
    noise: bool = True,
    quantised: bool = True,
    normal: Tensor | None = None,
    read: Tensor | None = None,
    tones: Tensor | None = None,
    out: Tensor | None = None,
) -> Tensor:
    """Digital numbers of a frame with ``white_e`` * ``scene`` mean photo-electrons, scene (B, C, H, W).

    PRNU, dark current, shot and read noise, DSNU, full well, gain, black level, rounding, converter limits.
    white_e (electrons, >= 0), exposure_s, temperature_c (degC): numbers or one per image. fixed_pattern:
    what ``camera.fixed_pattern`` returned. Means below 0 (ringing of a blur) count as 0.

    fidelity: "full" draws Poisson counts and normal read noise; "auto" makes both of one normal value per
    pixel from ``MERGE_READ_NOISE_E`` on (:func:`noisy_electrons`) and counts alone of one below it
    (:func:`blurnoise._core.rng.poisson_of_normal`), within 0.01 of the exact law in total variation distance and
    within 0.001 from 100 electrons on. noise: without it, the mean frame. quantised: without it, the frame
    before rounding.

    Gradients reach scene, white_e, exposure and temperature: the noise is reparameterised as in
    :func:`noisy_electrons`, rounding lets them through unchanged, a clipped pixel has none.

    For a caller who exposes one picture many times: normal, the N(0, 1) field of ``rng.standard_normal`` for
    these seeds, drawn once, and read, that of its stream "read", for where read noise has a draw of its own;
    tones, a value per digital number (such as :func:`tones_8bit`), which is returned instead of the digital
    number itself. A picture expanded to a batch of lights, its normal likewise, gives the same bits in less
    time than light by light. out: where to write, of the result's shape and dtype, contiguous or channels last;
    it may be ``scene``. Gradients leave it unused.
    """
    batch = len(scene)
    one_of("fidelity", fidelity, ("auto", "full"))
    exposure = per_image("exposure_s", exposure_s, batch, scene, low=0.0)
    temperature = per_image("temperature_c", temperature_c, batch, scene, low=-273.15, high=300.0)
    white = per_image("white_e", white_e, batch, scene, low=0.0)
    dark = dark_electrons(camera, exposure, temperature)
    seeds = rng.item_seeds(generator, batch)
    gain, offset_e = (plane.to(scene) for plane in fixed_pattern) if fixed_pattern else (None, None)
    differentiable = torch.is_grad_enabled() and any(each.requires_grad for each in (scene, white, dark))
    law = _law(camera, fidelity, noise, differentiable)
    if not differentiable:  # threads below would else start with gradients on
        scene, white, dark = scene.detach(), white.detach(), dark.detach()

    def planes(of: slice) -> _Planes:
        light, drawn = scene[of], seeds[of]
        field = own = counts = None
        if law in ("merged", "counts"):
            field = rng.standard_normal(drawn, light) if normal is None else normal[of]
        if law in ("counts", "exact") and camera.read_noise_e > 0:
            own = rng.standard_normal(drawn, light, "read") if read is None else read[of]
        if law == "exact":
            counts = rng.poisson(_mean_electrons(light, _over(white[of]), _over(dark[of]), gain), drawn)
        return _Planes(light, field, own, counts, gain, offset_e)

    if differentiable or not quantised or scene.device.type != "cpu":
        dn = _frame(planes(slice(None)), _over(white), _over(dark), law, camera, quantised=quantised)
        seen = dn if tones is None else _look_up(tones, dn)
        return seen if differentiable or out is None else out.copy_(seen)
    if out is None:
        out = torch.empty(scene.shape, dtype=scene.dtype if tones is None else tones.dtype)
    targets, interleaved = _targets(out)
    whites, darks = white.tolist(), dark.tolist()
    threads = torch.get_num_threads() if out.numel() >= WORTH_IT else 1

    def expose_items(of: slice) -> None:
        light, *others = planes(slice(of.start, of.start + 1))
        flat = [None if plane is None else plane.reshape(scene.shape[1], -1).numpy() for plane in others]
        lights = zip(whites[of], darks[of], targets[of], strict=True)
        frames.expose(
            frames.Planes(light.reshape(scene.shape[1], -1).numpy(), *flat),
            [frames.Exposure(*each, interleaved) for each in lights],
            camera,
            law,
            None if tones is None else tones.numpy(),
            threads,
        )

    alike = [scene] if law == "none" else [scene, normal]
    once = (
        law in ("none", "merged")
        and all(each is not None and each.stride(0) == 0 for each in alike)
        and max(whites) <= frames.MOST_APART * min(whites)
    )
    step = batch if once else 1
    side_by_side(expose_items, [slice(first, first + step) for first in range(0, batch, step)], threads)
    return out


def _over(values: Tensor) -> Tensor:
    """One value per picture, (B,), over its pixels."""
    return values[:, None, None, None]


def _targets(out: Tensor) -> tuple[list[frames.Plane], bool]:
    """Each frame of a batch as (C, n), or as (n, C) where colours lie next to each other, which is also told."""
    if out.is_contiguous():
        return [frame.view(len(frame), -1).numpy() for frame in out], False
    if out.is_contiguous(memory_format=torch.channels_last):
        return [frame.permute(1, 2, 0).view(-1, len(frame)).numpy() for frame in out], True
    raise ValueError(f"out: strides are {out.stride()}; must be contiguous or channels last")


def _law(camera: Camera, fidelity: Fidelity, noise: bool, differentiable: bool) -> Law:
    """How shot and read noise are drawn."""
    if not noise:
        return "none"
    if differentiable:  # counts have no derivative
        return "merged"
    if fidelity == "full":
        return "exact"
    return "merged" if camera.read_noise_e >= MERGE_READ_NOISE_E else "counts"


def noisy_electrons(mean_e: Tensor, read_noise_e: float, normal: Tensor) -> Tensor:
    """Shot and read noise in one draw: a normal corrected to the skewness of Poisson(mean) + N(0, read^2).

    x = mean + s z + k (z^2 - 1) with k = mean / (6 v), s^2 = v - 2 k^2, v = mean + read^2 (the first terms
    of Cornish and Fisher): mean and variance exact. After gain and rounding the total variation distance
    from the exact law is below 0.008 everywhere and below 0.0005 from 100 electrons on, for a read noise of
    at least 1 electron; below that Poisson's integer steps show and :func:`read_out` draws counts instead.
    mean_e, normal: any shape.
    """
    # Without light and read noise there is no variance: the least of either keeps 0 / 0 and its derivative away.
    variance = mean_e + max(read_noise_e**2, 1e-6)
    skew = mean_e / variance / 6
    spread = variance - 2 * skew * skew
    if read_noise_e**2 < 1 / 18:  # else v > 2 k^2 throughout
        spread = spread.clamp(min=1e-6)
    return mean_e - skew + (torch.sqrt(spread) + skew * normal) * normal


class _Planes(NamedTuple):
    """What varies over a frame; see :class:`blurnoise.sensor.fused.Planes`."""

    scene: Tensor
    normal: Tensor | None
    read: Tensor | None
    counts: Tensor | None
    gain: Tensor | None
    offset_e: Tensor | None


def _frame(
    planes: _Planes, white_e: Tensor, dark_e: Tensor, law: Law, camera: Camera, *, quantised: bool
) -> Tensor:
    """The chain, element by element, differentiable and on any device."""
    scene, normal, read, counts, gain, offset_e = planes
    electrons = counts if counts is not None else _mean_electrons(scene, white_e, dark_e, gain)
    if law == "merged" and normal is not None:
        electrons = noisy_electrons(electrons, camera.read_noise_e, normal)
    elif law == "counts" and normal is not None:
        electrons = rng.poisson_of_normal(electrons, normal)
    if read is not None:
        electrons = electrons + camera.read_noise_e * read
    if offset_e is not None:
        electrons = electrons + offset_e
    dn = electrons * camera.system_gain_dn_per_e + camera.black_level_dn
    if quantised:  # beside a derivative, rounding adds a constant: its own derivative would be 0 throughout
        dn = dn + (torch.round(dn) - dn).detach()
    return dn.clamp(0.0, camera.clip_dn)  # the full well's clip, after the same rounding


def _mean_electrons(scene: Tensor, white_e: Tensor, dark_e: Tensor, gain: Tensor | None) -> Tensor:
    """What shot noise is drawn from: photo signal with PRNU, never below 0, and dark charge."""
    photo_e = scene * white_e if gain is None else scene * white_e * gain
    return photo_e.clamp(min=0.0) + dark_e


def develop(dn: Tensor, camera: Camera, *, encoding: Encoding = "srgb") -> Tensor:
    """Digital numbers to a picture in [0, 1] for viewing and for detectors; no automatic gain.

    (dn - black) / (full scale - black), clamped, then sRGB-coded unless ``encoding`` is "linear".
    dn: any shape, integral values within the converter's range. Returns dn's floating dtype. Where gradients
    are asked for it goes by the formula, else by a table of it.
    """
    if dn.requires_grad and torch.is_grad_enabled():
        return _developed(dn, camera, encoding)
    return _look_up(_tones(camera, encoding).to(dn), dn)


def develop_8bit(dn: Tensor, camera: Camera) -> Tensor:
    """The sRGB picture of :func:`develop` as an 8-bit camera file would hold it: uint8, same shape."""
    return _look_up(tones_8bit(camera).to(dn.device), dn)


@lru_cache(maxsize=64)
def tones_8bit(camera: Camera, gain_db: float = 0.0) -> Tensor:
    """The 8-bit sRGB value of every digital number, its light times 10^(gain_db / 20), uint8 on the CPU."""
    if gain_db == 0:
        return _tones(camera, "srgb").mul(255.0).round().to(torch.uint8)
    dn = torch.arange(camera.full_scale_dn + 1, dtype=torch.float64)
    light = (dn - camera.black_level_dn) / (camera.full_scale_dn - camera.black_level_dn)
    return srgb_from_linear(light * 10 ** (gain_db / 20)).mul(255.0).round().to(torch.uint8)


@lru_cache(maxsize=8)
def _tones(camera: Camera, encoding: Encoding) -> Tensor:
    """The developed value of every digital number, float64 on the CPU."""
    return _developed(torch.arange(camera.full_scale_dn + 1, dtype=torch.float64), camera, encoding)


def _developed(dn: Tensor, camera: Camera, encoding: Encoding) -> Tensor:
    one_of("encoding", encoding, ("srgb", "linear"))
    light = (dn - camera.black_level_dn) / (camera.full_scale_dn - camera.black_level_dn)
    return srgb_from_linear(light) if encoding == "srgb" else light.clamp(0.0, 1.0)


def _look_up(table: Tensor, dn: Tensor) -> Tensor:
    if dn.device.type != "cpu":
        return table[dn.detach().clamp(0, len(table) - 1).int()]
    numbers, values = dn.detach().reshape(-1).numpy(), table.numpy()
    out = np.empty(len(numbers), values.dtype)

    def look_up(piece: slice) -> None:
        np.take(values, numbers[piece].astype(np.int32), mode="clip", out=out[piece])

    in_pieces(look_up, len(numbers), torch.get_num_threads())
    return torch.from_numpy(out).view(dn.shape)
