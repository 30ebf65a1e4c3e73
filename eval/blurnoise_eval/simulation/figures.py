"""The figures of a picture that was taken: electrons, blur, what was clipped, what each stage contributes."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot
from typing import Any

import torch
from torch import Tensor

from blurnoise import plan
from blurnoise.blur.layers import object_motion, seen_behind
from blurnoise.light.conditions import middle_of
from blurnoise.motion.trajectory import Trajectory
from blurnoise.optics import colour
from blurnoise.optics.camera import Camera, Capture, windows
from blurnoise.optics.radiometry import dark_electrons, filter_electrons, photoelectrons
from blurnoise.optics.spectra import Curve
from blurnoise.scene import hdr
from blurnoise.scene.cutting import Cut
from blurnoise.scene.hdr import Flicker
from blurnoise.scene.plan import Plan
from blurnoise_eval.grid.reflectance import reflectance_text, share_above_white
from blurnoise_eval.grid.scene_file import SceneFile


@dataclass(frozen=True)
class Shot:
    """What the camera sees and how it is set."""

    scene: Tensor
    camera: Camera
    at: dict[str, float]
    digital_db: float
    illuminant: str | Curve
    captures: tuple[Capture, ...]
    lamp: Flicker | None
    path: Trajectory | None
    moving: Cut | None
    velocity_px_s: tuple[float, float]
    flow_px_s: Tensor | None

    @property
    def exposure_s(self) -> float:
        """The time it is exposed for."""
        return self.at["exposure_s"]

    @property
    def lux(self) -> float:
        """Light on the scene."""
        return self.at["illuminance_lux"]

    @property
    def temperature_c(self) -> float:
        """Of the sensor."""
        return self.at["temperature_c"]

    @property
    def size(self) -> tuple[int, int]:
        """(H, W)."""
        return self.scene.shape[-2], self.scene.shape[-1]

    @property
    def white_e(self) -> float:
        """Electrons of white."""
        return photoelectrons(self.camera, self.lux, self.exposure_s, self.illuminant)

    @property
    def speed_px_s(self) -> float:
        """Of the rest; the median where places differ."""
        if self.flow_px_s is None:
            return hypot(*self.velocity_px_s)
        return float(self.flow_px_s.square().sum(0).sqrt().median())


def figures(given: SceneFile, shot: Shot, frames: list[Tensor]) -> dict[str, Any]:
    """Of the frames, one per capture, by name."""
    camera, dn = shot.camera, frames[0]
    first = camera.at_gain(shot.captures[0].gain_db).camera
    found: dict[str, Any] = {
        "camera": camera.name,
        "exposure_ms": 1e3 * shot.exposure_s,
        "gain_db": shot.at["gain_db"],
        "white_electrons": shot.white_e,
        "saturation_electrons": first.saturation_e,
        "blur_px": shot.speed_px_s * shot.exposure_s,
        "mean_dn": float(dn.mean()),
        "full_scale_dn": camera.full_scale_dn,
        "clipped_percent": 100 * float((dn >= dn.new_tensor(first.saturated_dn)).float().mean()),
    }
    if shot.flow_px_s is not None:
        found["longest_blur_px"] = float(shot.flow_px_s.square().sum(0).max().sqrt()) * shot.exposure_s
    if shot.path is not None:
        left, top, right, bottom = shot.path.seen(shot.exposure_s, shot.velocity_px_s).box
        found |= {"path_width_px": right - left, "path_height_px": bottom - top}
    if camera.row_time_s:
        found["readout_ms"] = 1e3 * camera.row_time_s * shot.size[0] / camera.field.per_sensor_px(shot.size)
    if camera.cfa != "none":
        found["cfa"] = camera.cfa
        per_lux_s = filter_electrons(camera, shot.illuminant)
        found |= {
            f"white_electrons_{each}": e * shot.lux * shot.exposure_s for each, e in per_lux_s.items() if each
        }
        if camera.ccm is not None:
            found["outside_gamut_percent"] = 100 * outside_share(shot.scene, camera)
    if given.grey_anchor is not None or given.emitters is not None or given.encoding == "linear":
        found["above_white_percent"] = 100 * share_above_white(shot.scene)
    found |= _of_captures(shot, frames[-1]) if len(shot.captures) > 1 else {}
    found |= _of_object(shot, shot.moving) if shot.moving else {}
    found |= _of_lamp(shot, shot.lamp) if shot.lamp else {}
    found["reflectance"] = reflectance_text(given.grey_anchor)
    return found


def outside_share(light: Tensor, camera: Camera) -> float:
    """Share of the pixels of pictures (B, 3, H, W) with a negative camera colour; 0 without a colour matrix."""
    if camera.ccm is None or light.shape[1] != 3:
        return 0.0
    rows = light.new_tensor(colour.inverse(camera.ccm))
    seen = torch.einsum("ij,bjhw->bihw", rows, light.detach())
    return float((seen.amin(1) < -1e-6).double().mean())


def _of_captures(shot: Shot, last: Tensor) -> dict[str, Any]:
    """What fusing gains and costs: range, SNR where the second capture takes over, the last one's displacement."""
    camera, captures = shot.camera, shot.captures
    ends_e = hdr.saturations_e(camera, captures)
    last_s = windows(captures, shot.exposure_s)[-1]
    end = last.new_tensor(camera.at_gain(captures[-1].gain_db).camera.saturated_dn)
    dark_e = dark_electrons(camera, shot.exposure_s, shot.temperature_c)
    return {
        "captures": len(captures),
        "fused_saturation_electrons": ends_e[-1],
        "fused_clipped_percent": 100 * float((last >= end).float().mean()),
        "dynamic_range_db": hdr.dynamic_range_db(camera, captures),
        "snr_db_before_switch": hdr.snr_db(camera, captures[:1], ends_e[0], dark_e=dark_e),
        "snr_db_after_switch": hdr.snr_db(camera, captures, ends_e[0], dark_e=dark_e),
        "ghost_px": shot.speed_px_s * (last_s[0] + last_s[1] / 2 - shot.exposure_s / 2),
    }


def _of_object(shot: Shot, moving: Cut) -> dict[str, Any]:
    """How far it moves, and how much of what is seen in its place was invented."""
    (layer,), behind = moving.layers, shot.velocity_px_s
    own = tuple(float(each) for each in layer.velocity_px_s)
    if shot.flow_px_s is not None:  # as it is on average behind the object
        left, top = layer.place_px
        part = shot.flow_px_s[:, max(0, top) :, max(0, left) :]
        part = part[..., : len(layer.alpha), : layer.alpha.shape[1]]
        behind = (float(part[0].mean()), float(part[1].mean()))
    apart = [(each - rest) * shot.exposure_s for each, rest in zip(own, behind, strict=True)]
    invented = seen_behind(layer, [(layer, apart)], shot.size) if moving.invented.any() else 0.0
    return {"object_blur_px": hypot(*own) * shot.exposure_s, "invented_percent": 100 * invented}


def _of_lamp(shot: Shot, lamp: Flicker) -> dict[str, Any]:
    """Of each capture: the light it got of the lamp's mean, the least and most it may get, how often none."""
    found: dict[str, Any] = {"pwm_phase": lamp.pwm.phase}
    for place, (start_s, taken_s) in enumerate(windows(shot.captures, shot.exposure_s), 1):
        least, most = lamp.pwm.extremes(taken_s)
        suffix = "" if place == 1 else f"_{place}"
        found |= {
            f"pwm_light{suffix}": float(lamp.pwm.factor(taken_s, start_s)),
            f"pwm_light_least{suffix}": least,
            f"pwm_light_most{suffix}": most,
            f"pwm_dark_percent{suffix}": 100 * lamp.pwm.dark_probability(taken_s),
        }
    return found


def plan_of(given: SceneFile, shot: Shot) -> Plan:
    """What each stage contributes."""
    motion_px = torch.tensor(shot.velocity_px_s, dtype=torch.float64) * shot.exposure_s
    varies_px = 0.0
    if shot.flow_px_s is not None:
        middle, farthest = middle_of(shot.flow_px_s[None] * shot.exposure_s)
        motion_px, varies_px = middle[0], float(farthest)
    layers = shot.moving.layers if shot.moving else ()
    return plan(
        shot.camera,
        exposure_s=shot.exposure_s,
        illuminance_lux=shot.lux,
        displacement_px=(float(motion_px[0]), float(motion_px[1])),
        variation_px=varies_px,
        trajectory=shot.path,
        temperature_c=shot.temperature_c,
        illuminant=shot.illuminant,
        tolerance_dn=given.tolerance_dn,
        objects=tuple(object_motion(layer, shot.exposure_s, shot.size) for layer in layers),
        size=shot.size,
    )
