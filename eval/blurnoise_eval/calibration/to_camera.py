"""Cameras of measured figures, each with its source; figures that frames cannot show are those of a preset."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from blurnoise._core.checks import one_of
from blurnoise.camera import PRESETS, Camera
from blurnoise.camera.camera_files import KEYS
from blurnoise.camera.gain import MeasuredGain
from blurnoise_eval.calibration.fit import Measurement
from blurnoise_eval.calibration.uncertain import interval_texts
from blurnoise_eval.cameras import find

_COUNTED = "counted from "  # in a source: the gain of the frames that is 0 dB of the camera
Known = dict[str, tuple[Any, str]]
"""Values and their sources by the field of the camera."""


def camera_of(
    measurement: Measurement, name: str, *, base: str = "imx250", temperature_c: float | None = None
) -> Camera:
    """The camera of a measurement. temperature_c: of the sensor, for the dark current; None: that of the frames.
    base: the preset for the other figures (lens, pixel pitch, quantum efficiency without photons).

    Raises ``ValueError`` for an unknown preset, and for a figure outside its limits.
    """
    if temperature_c is None:
        temperature_c = measurement.temperature_c
    estimates, full_scale = measurement.estimates, 2**measurement.bit_depth - 1
    bits = "assumed: the fewest of 8, 10, 12, 14, 16 bits that hold the frames' numbers"
    if measurement.bits_given:
        bits = "stated with the frames"
    elif measurement.clip_dn == full_scale:
        bits = f"measured: frames clip at {full_scale} DN"
    known: Known = {"bit_depth": (measurement.bit_depth, bits)}
    for name_px, side in zip(("width_px", "height_px"), measurement.size_px, strict=True):
        known[name_px] = (side, "measured: size of the frames")
    for figure, estimate in estimates.items():
        source = (
            f"measured: photon transfer of {measurement.frames}, 95 % {'-'.join(interval_texts(estimate))}"
        )
        if figure == "full_well_e" and (measurement.clip_dn or 0) >= full_scale:
            source += "; the converter clips there, the full well may be larger"
        source += "; 0 is within" if estimate.low <= 0 == estimate.value else ""
        doubted = [doubt.text for doubt in measurement.doubts if figure in doubt.figures]
        known[figure] = (estimate.value, "; doubtful: ".join([source, *doubted]))
    known.pop("linearity_error", None)
    if measurement.bend:
        straight = measurement.bend.straight_dn is not None
        factors = [
            f"{point.value:.3g} ({'-'.join(interval_texts(point))})"
            for point in measurement.bend.factors[straight:]
        ]
        of = (
            "the straight part" if straight else "the levels up to 70 % of saturation, as no part is straight"
        )
        text = f"measured: variance over the line's, 95 %, {', '.join(factors)}; K is of {of}"
        points = zip(measurement.bend.shares, measurement.bend.factors, strict=True)
        known["photon_transfer"] = (tuple((share, point.value) for share, point in points), text)
    preset = PRESETS[one_of("base", base, sorted(PRESETS))]
    known |= _gains(measurement, preset)
    if not measurement.cfa and preset.sensor.cfa == "none":
        known["cfa"] = ("mono", "measured: the pixels of each 2 x 2 have no colour filters")
    if measurement.cfa and set(measurement.cfa) == set(preset.sensor.cfa):
        doubted = [doubt.text for doubt in measurement.doubts if "cfa" in doubt.figures]
        known["cfa"] = (measurement.cfa, "; doubtful: ".join(["stated with the frames", *doubted]))
    if "quantum_efficiency" in known and preset.sensor.cfa not in ("none", "mono"):
        of_green = f"{known['quantum_efficiency'][0]:.3g} in the frames' light and the green pixels"
        source = f"assumed, as of the preset {base}: measured was {of_green}, not of each colour"
        known["quantum_efficiency"] = (preset.sensor.quantum_efficiency, source)
    if "full_well_e" not in known:
        gain, black = (estimates[figure].value for figure in ("system_gain_dn_per_e", "black_level_dn"))
        limit = "assumed: the limit of the converter, as no frame clips"
        known["full_well_e"] = ((full_scale - black) / gain, limit)
    if "dark_current_e_s" not in estimates:
        part = "assumed: not measurable with one dark exposure; part of the black level"
        known["dark_current_e_s"] = (0.0, part)
    elif temperature_c is not None:
        known["dark_reference_c"] = (temperature_c, "stated with the frames")
    if "dark_current_e_s" in estimates and estimates["dark_current_e_s"].low <= 0:
        # A camera need not have one, and exposure programs hold for cameras without.
        value, source = known["dark_current_e_s"]
        known["dark_current_e_s"] = (0.0, f"{source}; {value:.3g} is not told from 0, which is used")
    return on_base(name, known, base)


def _gains(measurement: Measurement, preset: Camera) -> Known:
    """The figures that were measured at several gains, or those of the preset."""
    lowest = f"; {_COUNTED}{measurement.lowest_db:g} dB, the lowest measured" if measurement.lowest_db else ""
    if not measurement.gains:
        law = f"assumed: from the preset {preset.name}, as the frames have one gain{lowest}"
        return {"read_noise_post_share": (preset.sensor.read_noise_post_share, law)}
    rows = [
        MeasuredGain(gain_db, **{name: estimate.value for name, estimate in figures.items()})
        for gain_db, figures in measurement.gains.items()
    ]
    intervals = [
        f"{gain_db:g} dB: "
        + ", ".join(f"{name} {'-'.join(interval_texts(estimate))}" for name, estimate in figures.items())
        for gain_db, figures in measurement.gains.items()
    ]
    known: Known = {
        "gains": (tuple(rows), f"measured: photon transfer at each, 95 % at {'; '.join(intervals)}{lowest}"),
        "read_noise_post_share": (0.0, "not used: read noise was measured at gains"),
        "conversion_gains": ((), "not used: read noise was measured at gains"),
    }
    for limit in ("analogue_gain_max_db", "gain_max_db"):
        if preset.figure(limit) < max(measurement.gains):
            known[limit] = (max(measurement.gains), "measured: the highest gain of the frames")
    return known


def lowest_gain_db(camera: Camera) -> float:
    """The gain of the frames that is 0 dB of the camera, by its sources; 0 if they name none."""
    match = re.search(rf"{_COUNTED}(\S+) dB", " ".join(map(str, camera.sources.values())))
    return float(match[1]) if match else 0.0


def on_base(name: str, known: Known, base: str) -> Camera:
    """A camera with ``known`` values and sources; the others are those of ``base``, a file or preset (assumed).

    Raises ``ValueError`` for another name.

    >>> camera = on_base("mine", {"read_noise_e": (3.0, "measured: my frames")}, "imx250")
    >>> camera.sensor.read_noise_e, camera.sources["read_noise_e"], camera.sources["f_number"]
    (3.0, 'measured: my frames', 'assumed, as of the preset imx250')
    """
    if not Path(base).is_file():
        one_of("base", base, sorted(PRESETS))
    camera = find(base)
    names = [key for key in KEYS if key not in ("name", "sources")]
    sources = dict.fromkeys(names, f"assumed, as of the preset {base}") if base in PRESETS else camera.sources
    return changed(camera.with_figures(name=name, sources=sources), known)


def changed(camera: Camera, known: Known) -> Camera:
    """The camera with other figures and their sources."""
    sources = {**camera.sources, **{name: source for name, (_, source) in known.items()}}
    figures = {name: value for name, (value, _) in known.items()}
    figures |= figures.pop("lens", {})  # of the lens over the field, as in camera files
    return camera.with_figures(**figures, sources=sources)
