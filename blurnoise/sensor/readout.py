"""The read-out: light on the pixels to digital numbers, through all stages of the sensor.

Domain: electrons and digital numbers (DN) as floating tensors (B, C, H, W). Electrons may be negative in the
dark, where read noise says so; only the converter's limits clip them from below.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby, product
from typing import Literal, NamedTuple

import torch
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.checks import Numbers, image_batch, one_of
from blurnoise._core.limits import limited_per_image
from blurnoise._core.lookup import look_up
from blurnoise._core.threads import differentiable, plain, side_by_side, threads_for
from blurnoise.light.conditions import Conditions
from blurnoise.optics.camera import Camera
from blurnoise.optics.radiometry import dark_electrons
from blurnoise.sensor import fast, stages
from blurnoise.sensor.stage import MERGE_READ_NOISE_E, Frames, Law, SensorStage

Fidelity = Literal["auto", "full"]
FixedPattern = tuple[Tensor, Tensor]
_PIECE = 1 << 16  # values that stay in a core's cache


@dataclass(frozen=True)
class ReadoutOptions:
    """What of the read-out is modelled, and by which draws.

    seeds: of the noise, one for each frame. fixed_pattern: what ``camera.fixed_pattern`` returned. fidelity: "full"
    draws Poisson counts and normal read noise; "auto" makes both of one normal value per pixel from
    ``MERGE_READ_NOISE_E`` on (:func:`.stages.noisy_electrons`) and counts alone of one below it
    (:func:`blurnoise._core.rng.poisson_of_normal`), within 0.01 of the exact law in total variation distance and
    within 0.001 from 100 electrons on. noise: without it, the mean frame. quantised: without it, the frame before
    rounding. without: names of stages that are passed over.
    """

    seeds: Sequence[int]
    fixed_pattern: FixedPattern | None = None
    fidelity: Fidelity = "auto"
    noise: bool = True
    quantised: bool = True
    without: frozenset[str] = frozenset()


class Reuse(NamedTuple):
    """What a caller who exposes one picture many times has already.

    normal: the N(0, 1) field of ``rng.standard_normal`` for the frames' seeds; read: that of its stream "read", for
    where read noise has a draw of its own. tones: a value per digital number (such as :func:`tones_8bit`), which is
    returned in its place. out: where to write, of the result's shape and dtype, contiguous or channels last; it may
    be the light itself, and gradients leave it unused.
    """

    normal: Tensor | None = None
    read: Tensor | None = None
    tones: Tensor | None = None
    out: Tensor | None = None


_NOTHING = Reuse()


def read_out(
    scene: Tensor,
    camera: Camera,
    *,
    white_e: Numbers = 1.0,
    exposure_s: Numbers,
    temperature_c: Numbers = 25.0,
    generator: rng.Randomness = None,
    fixed_pattern: FixedPattern | None = None,
    fidelity: Fidelity = "auto",
    noise: bool = True,
    quantised: bool = True,
    without: frozenset[str] = frozenset(),
    reuse: Reuse = _NOTHING,
) -> Tensor:
    """Digital numbers of a frame with ``white_e`` * ``scene`` mean photo-electrons, scene (B, C, H, W).

    white_e (electrons, >= 0), exposure_s, temperature_c (degC): numbers or one per image. The rest as
    :class:`ReadoutOptions` and :class:`Reuse` have it. Means below 0 (ringing of a blur) count as 0.
    """
    batch = len(image_batch("scene", scene))
    at = Conditions(
        camera,
        limited_per_image("exposure_s", exposure_s, batch, scene),
        limited_per_image("temperature_c", temperature_c, batch, scene),
        limited_per_image("white_e", white_e, batch, scene),
    )
    one_of("fidelity", fidelity, ("auto", "full"))
    seeds = rng.item_seeds(generator, batch)
    return digitised(
        scene, at, ReadoutOptions(seeds, fixed_pattern, fidelity, noise, quantised, without), reuse
    )


def digitised(
    scene: Tensor, at: Conditions[Tensor], options: ReadoutOptions, reuse: Reuse = _NOTHING
) -> Tensor:
    """:func:`read_out` of what is checked already: finite light (B, C, H, W), the camera and numbers of ``at``.

    Through ``STAGES`` in their order, but for those left out: by the fast route where it has them all, else stage by
    stage. The route may change a rounding step, not the law. Gradients reach scene, white_e, exposure and
    temperature: the noise is reparameterised as in :func:`.stages.noisy_electrons`, rounding lets them through
    unchanged, a clipped pixel has none. A picture expanded to a batch of lights, its normal likewise, gives the same
    bits in less time than light by light.
    """
    batch, seeds, quantised = len(scene), options.seeds, options.quantised
    normal, read, tones, out = reuse
    camera = stages.reduced(at.camera, options.without)
    white, dark = at.white_e, dark_electrons(camera, at.exposure_s, at.temperature_c)
    pattern = options.fixed_pattern
    gain, offset_e = (plane.to(scene) for plane in pattern) if pattern else (None, None)
    with_gradients = differentiable(scene, white, dark)
    active = stages.active(camera, options.without, noisy=options.noise)
    law = _law(camera, options, with_gradients, active)
    if not with_gradients:  # threads below would else start with gradients on
        scene, white, dark = scene.detach(), white.detach(), dark.detach()

    def frames(of: slice, lights: slice) -> Frames:
        light, drawn = scene[of], seeds[of]
        field = own = None
        if law in ("merged", "apart", "counts"):
            field = rng.standard_normal(drawn, light) if normal is None else normal[of]
        if law == "merged":  # for pixels whose well may be full
            needed = _may_fill_well(light, white[lights], dark[lights], gain, camera)
        else:
            needed = law != "none" and camera.read_noise_e > 0
        if needed:
            own = rng.standard_normal(drawn, light, "read") if read is None else read[of]
        means = _over(white[of]), _over(dark[of])
        return Frames(camera, law, *means, drawn, quantised, field, own, gain, offset_e)

    on_cpu = scene.device.type == "cpu"
    if with_gradients or not quantised or not on_cpu or not fast.supports(active):
        dn = _through(
            active, scene, frames(slice(None), slice(None)), in_pieces=on_cpu and not with_gradients
        )
        seen = dn if tones is None else look_up(tones, dn)
        return seen if with_gradients or out is None else out.copy_(seen)
    if out is None:
        out = torch.empty(scene.shape, dtype=scene.dtype if tones is None else tones.dtype)
    targets, interleaved = _targets(out)
    whites, darks = white.tolist(), dark.tolist()
    threads = threads_for(out)

    def expose_items(of: slice) -> None:
        first = slice(of.start, of.start + 1)
        lights = zip(whites[of], darks[of], targets[of], strict=True)
        fast.write_frames(
            fast.planes_of(scene[first], frames(first, of)),
            [fast.Target(*each, interleaved) for each in lights],
            camera,
            law,
            None if tones is None else tones.numpy(),
            threads,
        )

    alike = [scene] if law == "none" else [scene, normal]
    once = (
        law in ("none", "merged")
        and all(each is not None and each.stride(0) == 0 for each in alike)
        and max(whites) <= fast.MOST_APART * min(whites)
        and (law == "none" or (len(set(seeds)) == 1 if read is None else read.stride(0) == 0))
    )
    step = batch if once else 1
    side_by_side(expose_items, [slice(first, first + step) for first in range(0, batch, step)], threads)
    return out


def _through(active: Sequence[SensorStage], signal: Tensor, at: Frames, *, in_pieces: bool) -> Tensor:
    """The signal after all stages, the reference; pointwise neighbours in pieces that stay cached."""
    for pointwise, group in groupby(active, lambda stage: in_pieces and stage.pointwise(at)):
        neighbours = list(group)
        if not pointwise:
            signal = _after(neighbours, signal, at)
            continue
        batch, colours, height, width = signal.shape
        rows = max(1, _PIECE // (colours * width))
        whole = torch.empty_like(signal, memory_format=torch.contiguous_format)
        for item, first in product(range(batch), range(0, height, rows)):
            piece = slice(item, item + 1), slice(None), slice(first, first + rows)
            whole[piece] = _after(neighbours, signal[piece], at.part(*piece))
        signal = whole
    return signal


def _after(some: Sequence[SensorStage], signal: Tensor, at: Frames) -> Tensor:
    for stage in some:
        signal = stage.apply(signal, at)
    return signal


def _may_fill_well(light: Tensor, white: Tensor, dark: Tensor, gain: Tensor | None, camera: Camera) -> bool:
    """Whether the charge of any pixel of pictures may reach the full well, seen from its light."""
    largest_gain = 1.0 if gain is None else _most(gain)
    most_e = float(white.detach().max()) * _most(light) * largest_gain + float(dark.detach().max())
    return most_e >= stages.nearly_full_e(camera)


def _most(field: Tensor) -> float:
    """The largest value; NumPy's extremes wake no threads."""
    return float(field.numpy().max() if plain(field) else field.detach().max())


def _over(values: Tensor) -> Tensor:
    """One value per picture, (B,), over its pixels."""
    return values[:, None, None, None]


def _targets(out: Tensor) -> tuple[list[fast.Plane], bool]:
    """Each frame of a batch as (C, n), or as (n, C) where colours lie next to each other, which is also told."""
    if out.is_contiguous():
        return [frame.view(len(frame), -1).numpy() for frame in out], False
    if out.is_contiguous(memory_format=torch.channels_last):
        return [frame.permute(1, 2, 0).view(-1, len(frame)).numpy() for frame in out], True
    raise ValueError(f"out: strides are {out.stride()}; must be contiguous or channels last")


def _law(camera: Camera, options: ReadoutOptions, with_gradients: bool, active: Sequence[SensorStage]) -> Law:
    """How shot and read noise are drawn."""
    if not options.noise:
        return "none"
    if options.fidelity == "full" and not with_gradients:  # counts have no derivative
        return "exact"
    if camera.read_noise_e < MERGE_READ_NOISE_E and not with_gradients:
        return "counts"
    after_shot = active[active.index(stages.SHOT_NOISE) + 1 :]
    last = stages.READ_NOISE if stages.READ_NOISE in after_shot else stages.FULL_WELL
    between = after_shot[: after_shot.index(last)]
    return "merged" if all(stage is stages.FULL_WELL for stage in between) else "apart"
