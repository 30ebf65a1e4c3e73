"""The read-out: light on the pixels to digital numbers, through all stages of the sensor.

Domain: electrons and digital numbers (DN) as floating tensors (B, C, H, W). Electrons may be negative in the
dark, where read noise says so; only the converter's limits clip them from below.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any, Literal

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.checks import Numbers, image_batch, limited_per_image, one_of
from blurnoise._core.lookup import look_up, look_up_codes
from blurnoise._core.threads import differentiable, plain, side_by_side, threads_for
from blurnoise.camera import Camera
from blurnoise.camera.radiometry import dark_electrons
from blurnoise.light.resolved import Resolved
from blurnoise.sensor import stages
from blurnoise.sensor.stage import MERGE_READ_NOISE_E, Law, ReadoutFields, SensorStage

Fidelity = Literal["auto", "full"]
FixedPattern = tuple[Tensor, Tensor]
Draw = Callable[[Sequence[int], Tensor, str], Tensor]
_PIECE = 1 << 15  # values that stay in a core's cache, and for which PyTorch wakes no threads
Plane = NDArray[Any]
_MOST_APART = 256.0  # the brightest of several lights over the faintest, as light is clipped once for all
_FAST_PIECE = 3 << 16  # values: few enough for the last cache, enough to outweigh the calls
_FAINT_E = 1e-9  # of white: less is no unit to reckon in
_BEYOND_DN = 2.0**20  # where light is clipped: above any converter, and within the last step's integers


@dataclass(frozen=True)
class ReadoutOptions:
    """Options of the read-out: which stages, which random draws, and the form of the result.

    seeds: of the noise, one for each frame. fixed_pattern: what ``camera.fixed_pattern`` returned. fidelity: "full"
    draws Poisson counts and normal read noise; "auto" makes both of one normal value per pixel from
    ``MERGE_READ_NOISE_E`` on (:func:`.stages.noisy_electrons`) and counts alone of one below it
    (:func:`blurnoise._core.rng.poisson_of_normal`). noise: without it, the mean frame. quantised: without it, the
    frame before rounding. without: names of stages that are passed over. draw: gives N(0, 1) fields, for a caller
    who keeps them. tones: a value per digital number (such as :func:`tones_8bit`) to return in its place. out:
    where to write, contiguous, of the result's shape and dtype; it may be the light itself, and gradients leave it
    unused.
    """

    seeds: Sequence[int]
    fixed_pattern: FixedPattern | None = None
    fidelity: Fidelity = "auto"
    noise: bool = True
    quantised: bool = True
    without: frozenset[str] = frozenset()
    draw: Draw = rng.standard_normal
    tones: Tensor | None = None
    out: Tensor | None = None


def read_out(
    scene: Tensor,
    camera: Camera,
    *,
    white_e: Numbers = 1.0,
    exposure_s: Numbers,
    temperature_c: Numbers = 25.0,
    generator: rng.Randomness = None,
    **options: Any,
) -> Tensor:
    """Digital numbers of a frame with ``white_e`` * ``scene`` mean photo-electrons, scene (B, C, H, W).

    white_e (electrons, >= 0), exposure_s, temperature_c (degC): numbers or one per image. options: those of
    :class:`ReadoutOptions`. Means below 0 (ringing of a blur) count as 0.
    """
    batch = len(image_batch("scene", scene))
    at = Resolved(
        camera,
        limited_per_image("exposure_s", exposure_s, batch, scene),
        limited_per_image("temperature_c", temperature_c, batch, scene),
        limited_per_image("white_e", white_e, batch, scene),
    )
    one_of("fidelity", options.get("fidelity", "auto"), ("auto", "full"))
    return digitised(scene, at, ReadoutOptions(rng.item_seeds(generator, batch), **options))


def digitised(scene: Tensor, at: Resolved[Tensor], options: ReadoutOptions) -> Tensor:
    """:func:`read_out` of valid arguments: finite light (B, C, H, W), the camera and numbers of ``at``.

    Through ``STAGES`` in their order: by the fast route where it has them all, else stage by stage. The route may
    change a rounding step, not the law. Gradients reach scene, white_e, exposure and temperature: the noise is
    reparameterised, rounding lets them through unchanged, a clipped pixel has none. A picture expanded to a batch
    of lights with one seed gives the same bits in less time than light by light.
    """
    camera, seeds, tones, out = at.camera, options.seeds, options.tones, options.out
    white, dark = at.white_e, dark_electrons(camera, at.exposure_s, at.temperature_c)
    with_gradients = differentiable(scene, white, dark)
    if not with_gradients:  # threads below would else start with gradients on
        scene, white, dark = scene.detach(), white.detach(), dark.detach()
    pattern = [None if plane is None else plane.to(scene) for plane in options.fixed_pattern or (None, None)]
    active = stages.active(camera, options.without, noisy=options.noise)
    law, known = _law(camera, options, with_gradients, active), supports(active)

    def frames(of: slice, lights: slice) -> ReadoutFields:
        light, white_e, dark_e = scene[of], white[lights, None, None, None], dark[lights, None, None, None]
        gain, offset_e = (None if plane is None else plane.expand(light.shape) for plane in pattern)
        bare = ReadoutFields(
            camera, law, white_e, dark_e, seeds[of], options.quantised, gain=gain, offset_e=offset_e
        )
        drawn: dict[str, Any] = {}
        if law in ("merged", "apart", "counts"):
            drawn["normal"] = options.draw(seeds[of], light, "frame")
        if _draws_read_noise(bare, light, known):
            drawn["read"] = options.draw(seeds[of], light, "read")
        some = [stage for stage in stages.SHARED_NOISES if stage in active]
        drawn["shared"] = {stage.name: stage.drawn(light, seeds[of]) for stage in some}
        return replace(bare, **drawn)

    if not (known and options.quantised and plain(scene)) or with_gradients:
        every = slice(None)
        in_pieces = plain(scene) and not with_gradients
        dn = (_in_pieces if in_pieces else _through)(active, scene, frames(every, every))
        seen = dn if tones is None else look_up(tones, dn)
        return seen if with_gradients or out is None else out.copy_(seen)
    if out is None:
        out = torch.empty(scene.shape, dtype=scene.dtype if tones is None else tones.dtype)
    written, threads = out, threads_for(out)

    def expose_items(of: slice) -> None:
        first = slice(of.start, of.start + 1)
        write_frames(scene[first], frames(first, of), written[of], tones, threads)

    one_draw = law == "none" or (law == "merged" and len(set(seeds)) == 1)
    alike = one_draw and scene.stride(0) == 0 and float(white.max()) <= _MOST_APART * float(white.min())
    step = len(scene) if alike else 1
    side_by_side(expose_items, [slice(first, first + step) for first in range(0, len(scene), step)], threads)
    return out


def _through(some: Iterable[SensorStage], signal: Tensor, at: ReadoutFields) -> Tensor:
    """The signal after all stages: the reference."""
    for stage in some:
        signal = stage.apply(signal, at)
    return signal


def _in_pieces(active: Sequence[SensorStage], signal: Tensor, at: ReadoutFields) -> Tensor:
    """``_through`` by pieces that stay cached through stages of the linear model and share a plane of memory."""
    batch, colours, height, width = signal.shape
    step = max(1, _PIECE // (colours * width))
    places = [(item, slice(row, row + step)) for item in range(batch) for row in range(0, height, step)]
    pieces = [(item, rows, at.part(item, rows)) for item, rows in places]
    plane, exact = torch.empty_like(signal, memory_format=torch.contiguous_format), at.law == "exact"
    for by_pieces, neighbours in groupby(
        active, lambda stage: stage in stages.LINEAR_MODEL and not (stage.draws and exact)
    ):
        if not by_pieces:
            signal = _through(neighbours, signal, at)
            continue
        if signal.untyped_storage().data_ptr() == plane.untyped_storage().data_ptr():
            plane = torch.empty_like(plane)  # a stage may return a view of other places
        signal = _write_pieces(list(neighbours), signal, pieces, plane)
    return signal


def _write_pieces(
    some: Sequence[SensorStage],
    signal: Tensor,
    pieces: Sequence[tuple[int, slice, ReadoutFields]],
    out: Tensor,
) -> Tensor:
    written = out.numpy()

    def write(piece: tuple[int, slice, ReadoutFields]) -> None:
        item, rows, at = piece
        written[item, :, rows] = _through(some, signal[item : item + 1, :, rows], at).numpy()

    side_by_side(write, pieces, threads_for(signal))
    return out


def _draws_read_noise(at: ReadoutFields, light: Tensor, known: bool) -> bool:
    """Whether read noise needs a field apart; merged, only for wells that may be full, which own stages may fill."""
    if at.law != "merged":
        return at.law != "none" and at.camera.sensor.read_noise_e > 0
    full_e = stages.nearly_full_e(at.camera)
    brightest = _most(light) * (1.0 if at.gain is None else _most(at.gain))
    return math.isfinite(full_e) and not (known and _most(at.white_e) * brightest + _most(at.dark_e) < full_e)


def _most(field: Tensor) -> float:
    """The largest value; NumPy's extremes wake no threads."""
    return float(field.numpy().max() if plain(field) else field.detach().max())


def _law(camera: Camera, options: ReadoutOptions, with_gradients: bool, active: Sequence[SensorStage]) -> Law:
    """The noise model: how shot and read noise are drawn."""
    if not options.noise:
        return "none"
    if options.fidelity == "full" and not with_gradients:  # counts have no derivative
        return "exact"
    if camera.sensor.read_noise_e < MERGE_READ_NOISE_E and not with_gradients:
        return "counts"
    after_shot = active[active.index(stages.SHOT_NOISE) + 1 :]
    last = stages.READ_NOISE if stages.READ_NOISE in after_shot else stages.FULL_WELL
    between = after_shot[: after_shot.index(last)]
    return "merged" if all(stage is stages.FULL_WELL for stage in between) else "apart"


# The fast route: NumPy planes (C, n), n pixels of C colours, float32 or float64. A piece stays in a core's cache
# through all steps, which write in place, each by what does it fastest: NumPy, OpenCV or PyTorch; frames of one
# picture under several lights share what does not depend on the light.


def supports(active: Sequence[SensorStage]) -> bool:
    """Whether :func:`write_frames` implements all of these stages, in this order."""
    own = [stage for stage in stages.LINEAR_MODEL if stage in active or stage.essential]
    return list(active) == own and stages.PHOTON_TRANSFER not in active


def write_frames(scene: Tensor, at: ReadoutFields, out: Tensor, tones: Tensor | None, threads: int) -> None:
    """Write the digital numbers (L, C, H, W) of light (1, C, H, W) under L lights, or what ``tones`` has for them.

    at: means of each light, and the fields of one frame, which all share. Several lights go with the laws "none" and
    "merged". Threads share the pieces: no bit changes.
    """
    if at.law == "exact":  # counts, drawn by the stages that lead to them, are light of one electron each
        for stage in stages.LINEAR_MODEL[: stages.LINEAR_MODEL.index(stages.FULL_WELL)]:
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
        table = np.pad(tones.numpy()[: full_scale_dn + 1], (0, 65_535 - full_scale_dn), mode="edge")
    count = threads * math.ceil(light.size / _FAST_PIECE / threads)
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
        np.multiply(normal, normal, out=bend)
        bend -= 1.0
    for white_e, dark_e, frame in zip(whites_e, darks_e, out, strict=True):
        # Light, dark charge and noise are in units of unit_e electrons: one pass less.
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
            added = mean = np.minimum(mean, min(well_e, _BEYOND_DN / gain_dn) / unit_e, out=signal)
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
            np.minimum(codes, camera.sensor.full_scale_dn, out=codes)
            np.copyto(frame, codes, casting="unsafe")
        else:
            look_up_codes(table, codes, frame)


def _where_full(
    mean: Plane, unit_e: float, camera: Camera, normal: Plane, read: Plane, offset_e: Plane | None
) -> tuple[NDArray[np.bool_], Plane] | None:
    """Pixels whose charge may reach the full well, and their codes with the well applied; None if none do."""
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
