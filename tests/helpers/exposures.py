"""Exposures of the pictures of a batch from columns of conditions: numbers, or one for each picture."""

import torch

from blurnoise import Camera, Exposure, expose_pictures
from blurnoise.training.source import velocity_px_s

OPTIONS = ("masks", "lamp_lights", "encoding", "fidelity")


def column(value, count):
    if isinstance(value, torch.Tensor):
        value = value.tolist()
    return list(value) if isinstance(value, list | tuple) else [value] * count


def exposures(camera, count=1, *, seeds=None, speed_px_s=0.0, direction_deg=0.0, ego_kmh=None, **fields):
    """An exposure for each of ``count`` pictures. seeds: 0, 1, ... where they are left out."""
    columns = {name: column(value, count) for name, value in {"illuminance_lux": 0.0, **fields}.items()}
    cameras = column(camera, count)
    columns["camera"] = [Camera.preset(each) if isinstance(each, str) else each for each in cameras]
    speeds, angles = (
        torch.tensor(column(value, count), dtype=torch.float32) for value in (speed_px_s, direction_deg)
    )
    columns["velocity_px_s"] = list(map(tuple, velocity_px_s(speeds, angles).tolist()))
    if ego_kmh is not None:
        columns["ego_speed_m_s"] = [kmh / 3.6 for kmh in column(ego_kmh, count)]
    columns["seed"] = list(range(count)) if seeds is None else list(seeds)
    return [Exposure(**{name: values[item] for name, values in columns.items()}) for item in range(count)]


def exposed(image, camera, **given):
    """The pictures (B, C, H, W) exposed; given: options of ``expose_pictures`` and columns of conditions."""
    options = {name: given.pop(name) for name in OPTIONS if name in given}
    return expose_pictures(image, exposures(camera, len(image), **given), **options)
