"""Cameras of what was measured: every figure with its source, what frames cannot tell from a preset."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from blurnoise._core.checks import one_of
from blurnoise.metrics.estimate import Estimate
from blurnoise.optics.camera import PRESETS, Camera
from blurnoise_eval.calibration.measurement import Measurement

_MEASURED = (
    "system_gain_dn_per_e", "read_noise_e", "dark_current_e_s", "black_level_dn", "prnu", "dsnu_e", "full_well_e",
    "quantum_efficiency",
)  # fmt: skip


def camera_of(
    found: Measurement, name: str, *, base: str = "imx250", temperature_c: float | None = None
) -> Camera:
    """The camera that was measured. temperature_c: of the sensor meanwhile, for the dark current; ``base``: the
    preset for what frames do not tell (lens, pixel pitch, quantum efficiency without photons).

    Raises ``ValueError`` for an unknown preset, and where a figure is outside what a camera can have.
    """
    values: dict[str, Any] = {"name": name}
    sources: dict[str, str] = {}
    for figure in _MEASURED:
        if figure in found.estimates:
            told = found.estimates[figure]
            values[figure] = told.value
            sources[figure] = f"measured: photon transfer of {found.frames}, {interval(told)}"
    if linear := found.estimates.get("linearity_error"):
        sources["system_gain_dn_per_e"] += f"; linearity error {100 * linear.value:.2g} %"
    for doubt in found.doubts:
        for figure in {*doubt.figures} & {*sources}:
            sources[figure] += f"; doubtful: {doubt.text}"
    width, height = found.size_px
    values |= {"bit_depth": found.bit_depth, "width_px": width, "height_px": height}
    sources |= dict.fromkeys(("width_px", "height_px"), "measured: size of the frames")
    full_scale = 2**found.bit_depth - 1
    sources["bit_depth"] = (
        "stated with the frames" if found.bits_stated
        else f"measured: frames clip at {full_scale} DN" if found.clip_dn == full_scale
        else "assumed: the fewest of 8, 10, 12, 14, 16 bits that hold the frames' numbers"
    )  # fmt: skip
    gain = found.estimates["system_gain_dn_per_e"].value
    brightest = max(level.mean_dn for level in found.flat) - found.estimates["black_level_dn"].value
    if found.clip_dn is None:
        values["full_well_e"] = (full_scale - found.estimates["black_level_dn"].value) / gain
        sources["full_well_e"] = (
            f"assumed: the converter's limit; no frame clips, up to {brightest / gain:.4g} electrons"
        )
    elif found.clip_dn >= full_scale:
        sources["full_well_e"] += "; the converter clips there, the well may hold more"
    if "dark_current_e_s" not in values:
        values["dark_current_e_s"] = 0.0
        sources["dark_current_e_s"] = (
            "assumed: dark frames of one exposure do not tell it; part of the black level"
        )
    elif temperature_c is not None:
        values["dark_reference_c"] = temperature_c
        sources["dark_reference_c"] = "stated with the frames"
    else:
        sources["dark_reference_c"] = "assumed: nobody said how warm the sensor was"
        values["dark_reference_c"] = PRESETS[base].dark_reference_c if base in PRESETS else 20.0
    return on_base(values, sources, base)


def on_base(values: Mapping[str, Any], sources: Mapping[str, str], base: str) -> Camera:
    """The camera of ``values``; the rest as the preset ``base`` has it, called assumed."""
    one_of("base", base, sorted(PRESETS))
    preset = PRESETS[base]
    rest = {entry.name: getattr(preset, entry.name) for entry in fields(Camera)}
    assumed = {name: f"assumed, as of the preset {base}" for name in rest if name not in ("name", "sources")}
    return Camera(**{**rest, **values, "sources": {**assumed, **sources}})


def interval(told: Estimate) -> str:
    """'95 % 0.371-0.379', with as many digits as tell its ends apart."""
    low, high = ends(told)
    return f"95 % {low}-{high}"


def ends(told: Estimate) -> tuple[str, str]:
    """Both ends of an interval in digits that tell them apart."""
    size, width = max(abs(told.low), abs(told.high)), told.high - told.low
    digits = 3 if width <= 0 else max(3, math.ceil(math.log10(size / width)) + 2)
    return f"{told.low:.{digits}g}", f"{told.high:.{digits}g}"
