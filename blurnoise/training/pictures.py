"""Training pictures: each picture of a batch taken by its own exposure, and developed.

Domain: pictures (B, C, H, W) in [0, 1], sRGB-coded or linear, of any float type; the result has the same shape, type,
memory format and range. Values up to 2, which earlier augmentations leave, are white; others outside [0, 1] are
refused. A blur keeps its centroid: what moves is swept half the displacement to either side of its place. Without a
gain, pictures of little light are dark.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import torch
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.beams import BeamPlanes, checked_planes
from blurnoise._core.checks import image_batch, one_of, shown
from blurnoise._core.threads import differentiable, same_bits
from blurnoise.camera.colour import PictureTone
from blurnoise.motion.ego import USUAL_VEHICLE
from blurnoise.picture.develop import in_channels
from blurnoise.scene.cutting import Cut, checked_masks, in_motion, matte_of
from blurnoise.scene.exposure import Exposure
from blurnoise.scene.metering import AutoExposure, anchored, mean_luma
from blurnoise.scene.scene import Scene, extremes, scene_reflectance
from blurnoise.scene.take import TakeOptions, run_of, take
from blurnoise.sensor.readout import Fidelity
from blurnoise.training.source import Lights

_ROUNDING = 1 / 255  # as far as halves and 8 bits round below black
_OVERSHOOT = 0.25  # of an interpolation by splines
_BRIGHTEST = 2.0  # light above white, which earlier augmentations leave, is white


@same_bits
def expose_pictures(
    image: Tensor,
    exposure: Exposure | Sequence[Exposure],
    *,
    masks: Tensor | None = None,
    lamp_lights: Lights = "all",
    encoding: PictureTone = "srgb",
    grey_anchor: str | None = None,
    fidelity: Fidelity = "auto",
    headlamp_lux: BeamPlanes = MappingProxyType({}),
) -> Tensor:
    """Take each picture by its exposure, and develop it: :func:`blurnoise.take` for training.

    image: (B, C, H, W), float, in [0, 1]; half precision is computed in float32. exposure: one for each picture, with
    cameras and gains of their own, or one for all pictures, which differ in their noise.

    masks: (B, N, H, W) within [0, 1], the pixels that the targets of each picture cover; surplus masks are empty. The
    exposure's ``moves`` is the part that moves, and the background behind the targets is filled in from the pixels
    around them. Pictures without masks move as a whole, and so do pictures that the masks cover entirely.

    lamp_lights: the exposure's pulsed lamp lights "all", or the "targets" of pictures with masks. encoding,
    grey_anchor, fidelity: see :func:`blurnoise.simulate`. Linear light may be above 1, brighter than white. A black
    picture stays black, whatever its anchor.
    headlamp_lux: for each beam what headlamps add to the light on each pixel, lux, (B, 1, H, W), or (1, 1, H, W) for
    all pictures; the exposure's ``headlamp`` says which beam is on.

    Returns pictures in [0, 1] of image's shape and dtype, coded by the camera's tone curve, or linear if image is
    linear. Picture i depends on its own exposure alone. Gradients reach the image. Raises ``TypeError`` or
    ``ValueError`` that names the argument.

    >>> from blurnoise import Camera, Exposure
    >>> exposure = Exposure(Camera.preset("imx250"), 0.01, 50.0, velocity_px_s=(800.0, 0.0), seed=1)
    >>> expose_pictures(torch.full((2, 3, 4, 6), 0.5), exposure).shape
    torch.Size([2, 3, 4, 6])
    """
    scene = _clamped(image, light=encoding == "linear")
    batch, size = len(scene), (scene.shape[-2], scene.shape[-1])
    one_of("lamp_lights", lamp_lights, ("all", "targets"))
    if masks is not None:
        checked_masks(masks, batch, size)
    planes = {
        beam: plane.to(scene).expand(batch, -1, -1, -1)
        for beam, plane in checked_planes(
            "headlamp_lux", headlamp_lux, (batch, 1, *size), (1, 1, *size)
        ).items()
    }
    exposures = exposures_of(exposure, batch)
    for one in exposures:
        if one.headlamp != "off" and one.headlamp not in planes:
            raise ValueError(f"headlamp = {one.headlamp!r}: needs headlamp_lux[{one.headlamp!r}]")
    known = list[Tensor]()  # light of all pictures, once an auto-exposure needed it

    def reflectance(of: Any) -> Tensor:
        return known[0][of] if known else _reflectance(scene[of], encoding, grey_anchor)

    def metered_light() -> Tensor:
        light = _reflectance(scene.detach(), encoding, grey_anchor)
        if not differentiable(scene):
            known.append(light)
        return light

    exposures = _metered(exposures, metered_light, planes)
    lit_by_lamp = None
    if lamp_lights == "targets" and masks is not None and masks.shape[1]:
        lit_by_lamp = masks.amax(1).float()
    lamps = lamp_lights == "all" or lit_by_lamp is not None  # no lamp where there is nothing that it lights
    linear = isinstance(encoding, str) and encoding == "linear"
    options = TakeOptions(fidelity=fidelity, encoding="linear" if linear else "srgb")

    cuts: dict[int, Cut] = {}  # pictures of which a part moves: background and layers, in linear light
    for item, one in enumerate(exposures):
        if masks is None or one.moves == "all" or not (one.drives or any(one.velocity_px_s)):
            continue
        matte = matte_of(masks[item])
        if matte is not None:
            light = reflectance(slice(item, item + 1))
            of_targets = scene.new_tensor(one.velocity_px_s if one.moves == "targets" else (0.0, 0.0))
            lit = {beam: plane[item : item + 1] for beam, plane in planes.items() if beam == one.headlamp}
            cuts[item] = in_motion(light, matte, of_targets, one.exposure_s, lit)

    def taken_together(items: list[int]) -> Tensor:
        """Pictures of one camera, spectrum, beam, gain and vehicle, all cut or none."""
        of = run_of(items)
        cut = [cuts[item] for item in items if item in cuts]
        light = torch.cat([each.background for each in cut]) if cut else reflectance(of)
        beam = exposures[items[0]].headlamp
        lit = {} if beam == "off" else {beam: planes[beam][of]}
        if lit and cut:
            lit = {beam: torch.cat([each.headlamp_lux[beam] for each in cut])}
        some = Scene(
            light,
            headlamp_lux=lit,
            layers=[each.layers for each in cut],
            lamp_mask=None if lit_by_lamp is None else lit_by_lamp[of],
        )
        together = _together([exposures[item] for item in items], scene, cut=bool(cut), lamps=lamps)
        picture = take(some, together, options).picture
        return in_channels(picture, scene.shape[1]).to(image.dtype)

    groups: dict[Any, list[int]] = {}
    for item, one in enumerate(exposures):
        lit_by = one.illuminant, one.headlamp
        key = one.camera, *lit_by, one.gain_db, item in cuts, one.vehicle if one.drives else None
        groups.setdefault(key, []).append(item)
    parts = [taken_together(items) for items in groups.values()]
    if len(parts) == 1:
        return parts[0].contiguous(memory_format=_memory_format(image))
    out = torch.empty_like(image, memory_format=_memory_format(image))
    for items, part in zip(groups.values(), parts, strict=True):
        out[run_of(items)] = part
    return out


def exposures_of(exposure: Exposure | Sequence[Exposure], batch: int) -> list[Exposure]:
    """An exposure for each picture. One for all has the noise of its seed in the first picture, and noise of its own
    in every other one. Raises ``TypeError`` or ``ValueError``.

    >>> from blurnoise import Camera
    >>> exposures = exposures_of(Exposure(Camera.preset("imx250"), 0.01, 50.0, seed=1), 3)
    >>> exposures[0].seed, len({one.seed for one in exposures})  # noise of its own in every picture
    (1, 3)
    """
    if isinstance(exposure, Exposure):
        if exposure.batched:
            return list(exposure.each(batch))
        first: Any = exposure.seed  # an integer, as the exposure is that of one frame
        seeds = [first, *(rng.derived(first, f"picture {item}") for item in range(1, batch))]
        return [replace(exposure, seed=seed) for seed in seeds[:batch]]
    if not isinstance(exposure, Sequence) or not all(isinstance(one, Exposure) for one in exposure):
        raise TypeError(
            f"exposure = {shown(exposure)}: must be a blurnoise.Exposure, or one for each picture"
        )
    if len(exposure) != batch:
        raise ValueError(f"exposure: got {len(exposure)}; must be one, or {batch}, one for each picture")
    return list(exposure)


def _together(exposures: Sequence[Exposure], like: Tensor, *, cut: bool, lamps: bool) -> Exposure[Tensor]:
    """Exposures of one camera, spectrum, beam, gain and vehicle as a batch. cut: of backgrounds, whose layers move
    on their own. lamps: whether any lamp lights the pictures."""
    first, drives = exposures[0], exposures[0].drives
    velocities = [(0.0, 0.0) if cut and one.moves == "targets" else one.velocity_px_s for one in exposures]
    of_each: dict[str, Any] = {
        name: [getattr(one, name) for one in exposures] for name in ("seed", "trajectory", "lamp")
    }
    if not lamps or not any(of_each["lamp"]):
        of_each["lamp"] = None
    return Exposure(
        first.camera,
        exposure_s=like.new_tensor([one.exposure_s for one in exposures]),
        illuminance_lux=like.new_tensor([one.illuminance_lux for one in exposures]),
        velocity_px_s=(0.0, 0.0) if drives else like.new_tensor(velocities),
        temperature_c=like.new_tensor([one.temperature_c for one in exposures]),
        gain_db=first.gain_db,
        ego_speed_m_s=like.new_tensor([one.ego_speed_m_s for one in exposures]) if drives else 0.0,
        vehicle=first.vehicle if drives else USUAL_VEHICLE,
        illuminant=first.illuminant,
        headlamp=first.headlamp,
        **of_each,
    )


def _reflectance(scene: Tensor, encoding: PictureTone, grey_anchor: str | None) -> Tensor:
    """Pictures as reflectance, each with its anchor at 18 %; one without light, as a mosaic may leave, stays so."""
    light = scene_reflectance(scene, encoding)
    if grey_anchor is None:
        return light
    return torch.cat([anchored(one, grey_anchor) if one.any() else one for one in torch.split(light, 1)])


def _metered(
    exposures: list[Exposure], reflectance: Callable[[], Tensor], planes: BeamPlanes
) -> list[Exposure]:
    """The exposures with the gains that their auto-exposures set for the mean light of each picture."""
    if not any(isinstance(one.gain_db, AutoExposure) for one in exposures):
        return exposures
    light = reflectance()
    means: dict[Any, list[float]] = {}

    def mean_light(item: int, one: Exposure, beam: str) -> float:
        key = one.camera, one.illuminant, beam
        if key not in means:
            lit = light if beam == "off" else light * planes[beam].detach()
            means[key] = mean_luma(lit, one.camera, one.illuminant).tolist()
        return means[key][item]

    def metered(item: int, one: Exposure) -> Exposure:
        mean = mean_light(item, one, "off")
        if one.headlamp != "off":
            mean += mean_light(item, one, one.headlamp) / one.illuminance_lux
        return one.metered(mean)

    return [metered(item, one) for item, one in enumerate(exposures)]


def _memory_format(image: Tensor) -> torch.memory_format:
    last = torch.channels_last
    only = image.is_contiguous(memory_format=last) and not image.is_contiguous()
    return last if only else torch.contiguous_format


def _clamped(image: Tensor, *, light: bool = False) -> Tensor:
    """``image``, at least float32, within [0, 1]; light: above 1 it is brighter than white, and stays. Raises
    ``ValueError`` that says what other values look like."""
    halves = (torch.float16, torch.bfloat16)  # which cannot hold a full well's electrons
    image = image.float() if isinstance(image, Tensor) and image.dtype in halves else image
    image_batch("image", image)
    low, high = extremes(image)
    # Whole numbers are those of a file, not light.
    if light and low >= -_ROUNDING and high > 1.0 and not torch.equal(image, image.detach().round()):
        return image.clamp_min(0.0)
    if low < -_ROUNDING or high > _BRIGHTEST:
        raise ValueError(
            f"image: values span [{low:g}, {high:g}]; must lie within [0, 1]: {_cause(low, high)}"
        )
    return image.clamp(0.0, 1.0) if low < 0.0 or high > 1.0 else image


def _cause(low: float, high: float) -> str:
    """The likely cause of values outside [0, 1], and what to do."""
    if low < -_ROUNDING:
        if low > -_OVERSHOOT and high < 1 + _OVERSHOOT:
            return "an interpolation overshoots (clamp its result), or they are in [-1, 1] (give (image + 1) / 2)"
        if max(-low, high) <= 1 + _ROUNDING:
            return "they look like [-1, 1]: give (image + 1) / 2, and normalise after this augmentation"
        return "they look normalised by mean and standard deviation: normalise after this augmentation"
    bits = next((bits for bits in (8, 10, 12, 14, 16) if high < 2**bits), None)
    return f"they look like 0 to {2**bits - 1}: divide by {2**bits - 1}" if bits else "divide by their white"
