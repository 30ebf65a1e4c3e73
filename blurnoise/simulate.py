"""One exposure of a scene by a camera, from reflectance to digital numbers: the whole chain."""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor

from blurnoise import blur
from blurnoise._core import rng
from blurnoise._core.borders import Border
from blurnoise._core.checks import Numbers, image_batch, one_of, per_image
from blurnoise.camera import Camera
from blurnoise.encoding import Encoding, linear_from_srgb
from blurnoise.plan import TOLERANCE_DN, plan
from blurnoise.sensor import readout as sensor
from blurnoise.spectra import Curve


def simulate(
    image: Tensor,
    camera: Camera,
    *,
    exposure_s: Numbers,
    illuminance_lux: Numbers,
    velocity_px_s: Tensor | Iterable[float] = (0.0, 0.0),
    temperature_c: Numbers = 25.0,
    encoding: Encoding = "srgb",
    illuminant: str | Curve = "D55",
    border: Border = "reflect",
    pattern_seed: int = 0,
    generator: rng.Randomness = None,
    fidelity: sensor.Fidelity = "auto",
    tolerance_dn: float = TOLERANCE_DN,
    noise: bool = True,
    quantised: bool = True,
) -> Tensor:
    """Expose ``image`` with ``camera``; returns digital numbers of the same shape, integral values.

    image: (B, C, H, W) in [0, 1], the scene's reflectance, sRGB-coded or "linear"; 1 is white. exposure_s
    (s) and illuminance_lux (lux on the scene) >= 0, temperature_c (degC): a number or one per image.
    velocity_px_s: (2,) or (B, 2), motion in the image, x right, y down. illuminant: the light's spectrum.
    pattern_seed: which specimen of the camera (its fixed pattern). generator: a ``torch.Generator``, one
    seed per image, or None for torch's default generator; image i depends on its own seed alone.

    Order: linear light, lens and motion, light level, then :func:`blurnoise.sensor.readout.read_out`: shot,
    dark, read, full well, gain, black level, rounding, converter limits.

    fidelity: "full" models everything, "auto" what :func:`blurnoise.plan.plan` keeps of it for each image
    within ``tolerance_dn`` (DN RMS). noise: without it, the mean frame. quantised: without it, before rounding.
    Gradients reach image, exposure, illuminance, velocity and temperature; with them, everything is modelled.
    Raises ``TypeError`` or ``ValueError`` naming the argument, its value and what is allowed.
    """
    one_of("fidelity", fidelity, ("auto", "full"))
    reflectance = scene_reflectance(image, encoding)
    batch = len(image)
    exposure = per_image("exposure_s", exposure_s, batch, reflectance, low=0.0)
    lux = per_image("illuminance_lux", illuminance_lux, batch, reflectance, low=0.0)
    temperature = per_image("temperature_c", temperature_c, batch, reflectance, low=-273.15, high=300.0)
    velocity = torch.as_tensor(velocity_px_s).to(reflectance)
    displacement = blur.displacements(velocity * exposure[:, None] if velocity.ndim < 3 else velocity, image)
    seeds = rng.item_seeds(generator, batch)
    given = (reflectance, exposure, lux, velocity, temperature)
    differentiable = torch.is_grad_enabled() and any(each.requires_grad for each in given)

    def frames(of: list[int], camera: Camera, *, moves: bool, noisy: bool) -> Tensor:
        every = len(of) == batch
        scene, motion = (each if every else each[of] for each in (reflectance, displacement))
        moved = lens_and_motion(scene, camera, motion if moves else (0.0, 0.0), border=border)
        return sensor.read_out(
            moved,
            camera,
            white_e=(lux * exposure * sensor.electrons_per_lux_s(camera, illuminant))[of],
            exposure_s=exposure[of],
            temperature_c=temperature[of],
            generator=[seeds[item] for item in of],
            fixed_pattern=frame_pattern(camera, image, pattern_seed),
            fidelity=fidelity,
            noise=noise and noisy,
            quantised=quantised,
            out=moved if moved is not scene and moved.is_contiguous() else None,
        )

    if fidelity == "full" or differentiable:
        return frames(list(range(batch)), camera, moves=True, noisy=True)
    columns = zip(exposure.tolist(), lux.tolist(), displacement.tolist(), temperature.tolist(), strict=True)
    groups: dict[tuple[Camera, bool, bool], list[int]] = {}
    for item, (of_exposure, of_lux, moved_px, of_temperature) in enumerate(columns):
        needs = plan(
            camera,
            exposure_s=of_exposure,
            illuminance_lux=of_lux,
            displacement_px=(moved_px[0], moved_px[1]),
            temperature_c=of_temperature,
            illuminant=illuminant,
            tolerance_dn=tolerance_dn,
        )
        groups.setdefault((needs.camera, needs.moves, needs.noisy), []).append(item)
    if len(groups) == 1:
        ((camera, moves, noisy),) = groups
        return frames(list(range(batch)), camera, moves=moves, noisy=noisy)
    out = torch.empty_like(reflectance, memory_format=torch.contiguous_format)
    for (reduced, moves, noisy), of in groups.items():
        out[of] = frames(of, reduced, moves=moves, noisy=noisy)
    return out


def lens_and_motion(
    reflectance: Tensor,
    camera: Camera,
    displacement_px: Tensor | Iterable[float] = (0.0, 0.0),
    *,
    border: Border = "reflect",
) -> Tensor:
    """What falls on the sensor: linear light (B, C, H, W) through the camera's lens, moved by (2,) or (B, 2) px."""
    if camera.defocus_counts_pixel:
        reflectance = blur.defocus(reflectance, camera.defocus_radius_px, border=border)
    return blur.exposure_blur(reflectance, displacement_px, camera.optics, border=border)


def scene_reflectance(image: Tensor, encoding: Encoding) -> Tensor:
    """Reflectance, linear light in [0, 1], of a picture (B, C, H, W) coded as ``encoding`` says."""
    image_batch("image", image)
    one_of("encoding", encoding, ("srgb", "linear"))
    seen = image.detach()  # NumPy's extremes wake no threads, which would spin beside the work that follows
    bounds = seen.aminmax() if seen.device.type != "cpu" else (seen.numpy().min(), seen.numpy().max())
    low, high = (float(bound) for bound in bounds)
    if low < 0.0 or high > 1.0:
        raise ValueError(f"image: values span [{low:g}, {high:g}]; must lie within [0, 1]")
    return linear_from_srgb(image) if encoding == "srgb" else image


def frame_pattern(camera: Camera, image: Tensor, pattern_seed: int) -> tuple[Tensor, Tensor] | None:
    """The camera's fixed pattern for pictures of this shape, None where it has none."""
    if camera.prnu == 0 and camera.dsnu_e == 0:
        return None
    return camera.fixed_pattern(tuple(image.shape[1:]), pattern_seed)
