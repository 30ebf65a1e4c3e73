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

import torch
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.checks import Numbers, image_batch, limited_per_image, one_of
from blurnoise._core.lookup import look_up
from blurnoise._core.threads import differentiable, plain, side_by_side, threads_for
from blurnoise.camera import Camera
from blurnoise.camera.radiometry import dark_electrons
from blurnoise.light.resolved import Resolved
from blurnoise.sensor import fused, stages
from blurnoise.sensor import shared as shared_noise
from blurnoise.sensor.stage import MERGE_READ_NOISE_E, Law, ReadoutFields, SensorStage

Fidelity = Literal["auto", "full"]
FixedPattern = tuple[Tensor, Tensor]
Draw = Callable[[Sequence[int], Tensor, str], Tensor]
_PIECE = 1 << 15  # values that stay in a core's cache, and for which PyTorch wakes no threads
_MOST_APART = 256.0  # the brightest of several lights over the faintest, as light is clipped once for all


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

    >>> from blurnoise import Camera
    >>> camera = Camera.preset("imx250").with_figures(system_gain_dn_per_e=0.5, black_level_dn=10.0)
    >>> frame = {"white_e": 501.0, "exposure_s": 0.01, "noise": False, "quantised": False}
    >>> read_out(torch.ones(1, 1, 1, 1), camera, **frame).item()  # 501 electrons, not rounded
    260.5
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

    >>> from blurnoise import Camera
    >>> grey = torch.full((1, 1, 1, 2), 0.5)
    >>> read_out(grey, Camera.preset("imx250"), white_e=1000.0, exposure_s=0.01, noise=False)
    tensor([[[[420., 420.]]]])
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

    By :func:`_through` stage by stage, which is the reference, or in one pass by :mod:`.fused` where that has all of
    the camera's stages. The route may change a rounding step, not the law. Gradients reach scene, white_e, exposure
    and temperature: the noise is reparameterised, rounding lets them through unchanged, a clipped pixel has none. A
    picture expanded to a batch of lights with one seed gives the same bits in less time than light by light.

    >>> camera = Camera.preset("imx250").with_figures(system_gain_dn_per_e=0.5, black_level_dn=10.0)
    >>> one = torch.ones(1)
    >>> at = Resolved(camera, exposure_s=0.01 * one, temperature_c=25 * one, white_e=1000 * one)
    >>> digitised(torch.full((1, 1, 1, 1), 0.5), at, ReadoutOptions(seeds=[0], noise=False)).item()
    260.0
    """
    camera = at.camera
    white_e, dark_e = at.white_e, dark_electrons(camera, at.exposure_s, at.temperature_c)
    with_gradients = differentiable(scene, white_e, dark_e)
    if not with_gradients:  # threads below would else start with gradients on
        scene, white_e, dark_e = scene.detach(), white_e.detach(), dark_e.detach()
    active = stages.active(camera, options.without, noisy=options.noise)
    law, known = _law(camera, options, with_gradients, active), fused.supports(active)
    shared = [stage for stage in (shared_noise.ROW_GAIN, *shared_noise.SHARED_NOISES) if stage in active]
    pattern = [None if plane is None else plane.to(scene) for plane in options.fixed_pattern or (None, None)]

    def drawn(frames: slice, means: slice) -> ReadoutFields:
        """Fields of some frames (B, C, H, W): the fixed pattern, and the noise that law and stages ask for."""
        light, seeds = scene[frames], options.seeds[frames]
        gain, offset_e = (None if plane is None else plane.expand(light.shape) for plane in pattern)
        fields = ReadoutFields(
            camera,
            law,
            white_e[means, None, None, None],
            dark_e[means, None, None, None],
            seeds,
            options.quantised,
            gain=gain,
            offset_e=offset_e,
        )
        noise: dict[str, Any] = {
            "shared": {stage.name: stage.drawn(light, seeds, camera) for stage in shared}
        }
        if law in ("merged", "apart", "counts"):
            noise["normal"] = options.draw(seeds, light, "frame")
        if _draws_read_noise(fields, light, known):
            noise["read"] = options.draw(seeds, light, "read")
        return replace(fields, **noise)

    if with_gradients or not (known and options.quantised and plain(scene)):
        # The reference: for gradients, for stages that the fast route does not know, and on other devices.
        every = slice(None)
        in_pieces = plain(scene) and not with_gradients
        dn = (_in_pieces if in_pieces else _through)(active, scene, drawn(every, every))
        values = dn if options.tones is None else look_up(options.tones, dn)
        return values if with_gradients or options.out is None else options.out.copy_(values)

    out = options.out
    if out is None:
        out = torch.empty(scene.shape, dtype=scene.dtype if options.tones is None else options.tones.dtype)
    written, threads = out, threads_for(out)

    def expose(frames: slice) -> None:
        first = slice(frames.start, frames.start + 1)  # several lights on one picture share its fields
        fused.write_frames(scene[first], drawn(first, frames), written[frames], options.tones, threads)

    # Frames of one picture with the same noise differ in light alone: one draw serves them all.
    one_draw = law == "none" or (law == "merged" and len(set(options.seeds)) == 1)
    near = float(white_e.max()) <= _MOST_APART * float(white_e.min())
    step = len(scene) if one_draw and scene.stride(0) == 0 and near else 1
    side_by_side(expose, [slice(first, first + step) for first in range(0, len(scene), step)], threads)
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
        # A piece must not overwrite what another piece has still to read.
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
    brightest = most(light) * (1.0 if at.gain is None else most(at.gain))
    return math.isfinite(full_e) and not (known and most(at.white_e) * brightest + most(at.dark_e) < full_e)


def most(field: Tensor) -> float:
    """The largest value, NaN if one is; NumPy's extremes wake no threads.

    >>> most(torch.tensor([0.25, 0.5]))
    0.5
    """
    return float(field.numpy().max() if plain(field) else field.detach().max())


def _law(camera: Camera, options: ReadoutOptions, with_gradients: bool, active: Sequence[SensorStage]) -> Law:
    """The noise model: how shot and read noise are drawn."""
    if not options.noise:
        return "none"
    if options.fidelity == "full" and not with_gradients:  # counts have no derivative
        return "exact"
    if camera.sensor.read_noise_e < MERGE_READ_NOISE_E and not with_gradients:
        return "counts"
    # One draw can stand for both noises only if nothing but the full well, which is handled apart, is between them.
    after_shot = active[active.index(stages.SHOT_NOISE) + 1 :]
    last = stages.READ_NOISE if stages.READ_NOISE in after_shot else stages.FULL_WELL
    between = after_shot[: after_shot.index(last)]
    return "merged" if all(stage is stages.FULL_WELL for stage in between) else "apart"
