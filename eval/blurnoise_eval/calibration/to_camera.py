"""Cameras of measured figures: every figure with its source, what frames cannot show from a preset."""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Any

from blurnoise._core.checks import one_of
from blurnoise.metrics.values import Estimate
from blurnoise.optics.camera import PRESETS, Camera
from blurnoise_eval.calibration.fit import Measurement

Known = dict[str, tuple[Any, str]]
"""Values and their sources, by the camera's field."""


def camera_of(
    found: Measurement, name: str, *, base: str = "imx250", temperature_c: float | None = None
) -> Camera:
    """The camera that was measured. temperature_c: of the sensor meanwhile, for the dark current; ``base``: the
    preset for the rest (lens, pixel pitch, quantum efficiency without photons).

    Raises ``ValueError`` for an unknown preset, and where a figure is outside what a camera can have.
    """
    estimates, full_scale = found.estimates, 2**found.bit_depth - 1
    bits = "assumed: the fewest of 8, 10, 12, 14, 16 bits that hold the frames' numbers"
    if found.bits_given:
        bits = "stated with the frames"
    elif found.clip_dn == full_scale:
        bits = f"measured: frames clip at {full_scale} DN"
    (width, height), size = found.size_px, "measured: size of the frames"
    known: Known = {
        "bit_depth": (found.bit_depth, bits),
        "width_px": (width, size),
        "height_px": (height, size),
    }
    for figure, estimate in estimates.items():
        source = f"measured: photon transfer of {found.frames}, 95 % {'-'.join(ends(estimate))}"
        if figure == "system_gain_dn_per_e" and (linear := estimates.get("linearity_error")):
            source += f"; linearity error {100 * linear.value:.2g} %"
        if figure == "full_well_e" and (found.clip_dn or 0) >= full_scale:
            source += "; the converter clips there, the well may hold more"
        doubted = [doubt.text for doubt in found.doubts if figure in doubt.figures]
        known[figure] = (estimate.value, "; doubtful: ".join([source, *doubted]))
    known.pop("linearity_error", None)
    if "full_well_e" not in estimates:
        gain, black = (estimates[each].value for each in ("system_gain_dn_per_e", "black_level_dn"))
        brightest = (max(level.mean_dn for level in found.flat) - black) / gain
        limit = f"assumed: the converter's limit; no frame clips, up to {brightest:.4g} electrons"
        known["full_well_e"] = ((full_scale - black) / gain, limit)
    if "dark_current_e_s" not in estimates:
        part = "assumed: dark frames of one exposure do not show it; part of the black level"
        known["dark_current_e_s"] = (0.0, part)
    elif temperature_c is not None:
        known["dark_reference_c"] = (temperature_c, "stated with the frames")
    return on_base(name, known, base)


def on_base(name: str, known: Known, base: str) -> Camera:
    """The camera of ``known`` values and sources; the rest from the preset ``base``, called assumed."""
    preset = PRESETS[one_of("base", base, sorted(PRESETS))]
    names = [entry.name for entry in fields(Camera) if entry.name not in ("name", "sources")]
    every = {each: (getattr(preset, each), f"assumed, as of the preset {base}") for each in names} | known
    values = {each: value for each, (value, _) in every.items()}
    return Camera(name=name, **values, sources={each: source for each, (_, source) in every.items()})


def ends(estimate: Estimate) -> tuple[str, str]:
    """Both ends of an interval in digits that tell them apart."""
    size, width = max(abs(estimate.low), abs(estimate.high)), estimate.high - estimate.low
    digits = 3 if width <= 0 else max(3, math.ceil(math.log10(size / width)) + 2)
    return f"{estimate.low:.{digits}g}", f"{estimate.high:.{digits}g}"
