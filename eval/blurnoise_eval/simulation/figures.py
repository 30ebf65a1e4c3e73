"""Figures of one frame, by the names that ``blurnoise simulate`` prints."""

from __future__ import annotations

from math import hypot, pi
from typing import Any

from torch import Tensor

from blurnoise import Exposure, Scene
from blurnoise.blur.layer import Layer
from blurnoise.blur.layers import seen_behind
from blurnoise.camera.captures import windows
from blurnoise.camera.radiometry import filter_electrons, photoelectrons
from blurnoise.light.headlit import HeadlitTarget
from blurnoise.picture import fusion
from blurnoise.picture.fusion import captures_of, readers
from blurnoise.scene.cutting import Cut


def figures(scene: Scene, exposure: Exposure, dn: Tensor, cut: Cut | None) -> dict[str, Any]:
    """Figures of a frame of the first capture; where the camera drives, the blur is the median of all pixels'."""
    camera, lit_by = exposure.camera, exposure.illuminant
    first, captures = readers(exposure.amplified.camera)[0], captures_of(camera)
    white_e = photoelectrons(camera, exposure.illuminance_lux, exposure.exposure_s, lit_by)
    flow = _flow(scene, exposure)
    speeds = None if flow is None else flow.square().sum(0).sqrt()
    velocity = (0.0, 0.0) if exposure.moves == "targets" else exposure.velocity_px_s
    speed_px_s = hypot(*velocity) if speeds is None else float(speeds.median())
    found: dict[str, Any] = {
        "camera": camera.name,
        "exposure_ms": 1e3 * exposure.exposure_s,
        "gain_db": exposure.gain_db,
        "white_electrons": white_e * captures[0].sensitivity,
        "saturation_electrons": first.sensor.saturation_e,
        "blur_px": speed_px_s * exposure.exposure_s,
        "mean_dn": float(dn.mean()),
        "full_scale_dn": camera.sensor.full_scale_dn,
        "clipped_percent": 100 * float((dn >= dn.new_tensor(first.sensor.saturated_dn)).float().mean()),
    }
    if speeds is not None:
        found["longest_blur_px"] = float(speeds.max()) * exposure.exposure_s
    if camera.sensor.row_time_s:
        found["readout_ms"] = (
            1e3 * camera.sensor.row_time_s * scene.size[0] / camera.field.per_sensor_px(scene.size)
        )
    if camera.sensor.cfa != "none":
        found["cfa"] = camera.sensor.cfa
        lux_s = exposure.illuminance_lux, exposure.exposure_s
        per_lux_s = filter_electrons(camera, lit_by)
        found |= {
            f"white_electrons_{letter}": e * lux_s[0] * lux_s[1] for letter, e in per_lux_s.items() if letter
        }
    if len(captures) > 1:
        amplified = exposure.amplified.camera
        found["captures"] = len(captures)
        found["fused_saturation_electrons"] = fusion.saturations_e(amplified)[-1]
        found["dynamic_range_db"] = fusion.dynamic_range_db(amplified)
    if cut:
        found |= _of_object(cut, exposure, velocity, flow, scene.size)
    if exposure.lamp:
        found["pwm_phase"] = exposure.lamp.phase
        for number, (_, duration_s) in enumerate(windows(captures, exposure.exposure_s), 1):
            suffix = "" if number == 1 else f"_{number}"
            found[f"pwm_dark_percent{suffix}"] = 100 * exposure.lamp.dark_probability(duration_s)
    return found


def headlit_figures(target: HeadlitTarget, exposure: Exposure) -> dict[str, Any]:
    """Figures of the object in headlamps: its place, and the luminance of its white in cd/m2."""
    lux = exposure.illuminance_lux + target.illuminance_lux
    return {
        "target_distance_m": target.distance_m,
        "observation_deg": target.observation_deg,
        "headlamp_lux": target.illuminance_lux,
        "returned_cd_m2": target.luminance_cd_m2,
        "target_cd_m2": target.white * lux / pi + target.luminance_cd_m2,
    }


def _flow(scene: Scene, exposure: Exposure) -> Tensor | None:
    """Motion of each pixel (2, H, W), px/s, where the camera drives."""
    if not exposure.drives:
        return None
    return exposure.vehicle.flow_px_s(exposure.camera, scene.size, exposure.ego_speed_m_s)


def _of_object(
    cut: Cut, exposure: Exposure, behind: tuple[float, float], flow: Tensor | None, size: tuple[int, int]
) -> dict[str, Any]:
    """How far the object moves, and the share of the background behind it that shows and was filled in."""
    (layer,) = cut.layers
    own = tuple(float(along) for along in exposure.velocity_of(layer))
    if flow is not None:
        behind = _mean_behind(layer, flow)
    apart = [(along - rest) * exposure.exposure_s for along, rest in zip(own, behind, strict=True)]
    invented = seen_behind(layer, [(layer, apart)], size) if cut.invented.any() else 0.0
    return {"object_blur_px": hypot(*own) * exposure.exposure_s, "invented_percent": 100 * invented}


def _mean_behind(layer: Layer, flow: Tensor) -> tuple[float, float]:
    """Mean velocity of the background behind a layer."""
    left, top = layer.place_px
    part = flow[:, max(0, top) :, max(0, left) :][..., : len(layer.alpha), : layer.alpha.shape[1]]
    return float(part[0].mean()), float(part[1].mean())
