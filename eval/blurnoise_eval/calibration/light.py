"""Calibration of light: measured electrons per lux second, and the camera's figures that follow.

Domain: mean photo-electrons per pixel behind the strongest filter (green, clear), over the whole field, for one lux
second on a white surface. This is a product of lens, pixel and filters: f-number and pitch stay unchanged, and
transmission follows; quantum efficiency follows if the transmission is known, or would be above 1.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from blurnoise.camera import Camera, lens, radiometry
from blurnoise.camera.colour import FilterCurves
from blurnoise.camera.spectra import Curve
from blurnoise_eval.calibration.fit import Measurement
from blurnoise_eval.calibration.levels import columns
from blurnoise_eval.calibration.to_camera import Known
from blurnoise_eval.calibration.uncertain import Uncertain, interval_texts

RESTS_ON = ("f_number", "transmission", "pixel_pitch_um", "quantum_efficiency")
"""Figures of a camera that determine its electrons per lux second; a t_number stands for the first two."""
_TIED = "electrons per lux second"  # in the source of a figure that follows from them
_GREY = 0.18
_COARSE = 64  # pixels along the shorter side, for the average over the field


def electrons_per_lux_s(camera: Camera, illuminant: str | Curve = "D55") -> float:
    """Mean electrons per lux second behind the strongest filter, over the field of the lens.

    >>> camera = Camera.preset("imx250")
    >>> falling = camera.with_figures(falloff_power=4.0, hfov_deg=60.0)
    >>> 0.7 < electrons_per_lux_s(falling) / electrons_per_lux_s(camera) < 0.9  # mean over the field
    True
    """
    height, width = camera.field.size
    step = max(1, min(height, width) // _COARSE)
    field = lens.light(camera.field, (max(1, height // step), max(1, width // step)))
    return float(field.mean()) * radiometry.electrons_per_lux_s(camera, illuminant)


def tied(camera: Camera, measured: float, source: str, illuminant: str | Curve = "D55") -> Known:
    """The figures with which :func:`electrons_per_lux_s` of the camera has the value ``measured``.

    source: of the measurement. Raises ``ValueError`` if that needs a quantum efficiency above 1.

    >>> camera = Camera.preset("imx250")
    >>> half = tied(camera, 0.5 * electrons_per_lux_s(camera), "a grey card")
    >>> round(half["transmission"][0] / camera.lens.transmission, 3)
    0.5
    """
    lens_source = camera.sources.get("transmission", "assumed")
    lens_known = "assum" not in lens_source and _TIED not in lens_source
    whole = camera if lens_known else camera.with_figures(transmission=1.0)
    # Electrons are proportional to transmission and to quantum efficiency alike: frames cannot tell them apart.
    share = measured / electrons_per_lux_s(whole, illuminant)
    by = f"{source}: {measured:.4g} {_TIED}, mean over the field"
    known: Known = {}
    if not lens_known:
        text = f"{by}, with f_number, pitch and efficiency as they are here"
        known["transmission"] = (min(share, 1.0), text)
        by = f"derived: times {share:.3g} for the {_TIED} of transmission"
    if lens_known or share > 1:
        try:
            source = f"{by}; {camera.sources.get('quantum_efficiency', '')}"
            known["quantum_efficiency"] = (scaled(camera.sensor.quantum_efficiency, share), source)
        except ValueError:
            values = ", ".join(f"{name} = {camera.figure(name):g}" for name in ("f_number", "pixel_pitch_um"))
            needs = f"need {share:.3g} times the quantum efficiency, above 1; {values} may be wrong"
            raise ValueError(f"{measured:.4g} {_TIED}: {needs}; set them in a file for --base") from None
    return known


def scaled(curves: Any, by: float, only: str = "") -> Any:
    """A quantum efficiency times a factor; only: of one filter. Raises ``ValueError`` above 1.

    >>> scaled(0.5, 1.2)
    0.6
    """
    if isinstance(curves, FilterCurves):
        filters = curves.items()
        return FilterCurves(**{name: scaled(x, by) if only in ("", name) else x for name, x in filters})
    values = curves.values if isinstance(curves, Curve) else (curves,)
    if by * max(values) > 1:
        raise ValueError(f"quantum_efficiency = {by * max(values):g}: must be <= 1")
    if not isinstance(curves, Curve):
        return by * curves
    return Curve(curves.wavelengths_nm, tuple(by * value for value in values))


def card(text: str) -> tuple[float | None, float]:
    """Read "LUX,REFLECTANCE" or "REFLECTANCE" of a grey card. Raises ``ValueError``.

    >>> card("500,0.18")
    (500.0, 0.18)
    """
    try:
        *lux, reflectance = (float(part) for part in text.split(","))
    except ValueError:
        lux, reflectance = [], math.nan
    if len(lux) > 1 or not 0 < reflectance <= 1 or not all(0 < value <= 1e7 for value in lux):
        raise ValueError(f"grey_card = {text!r}: must be LUX,REFLECTANCE or REFLECTANCE, such as 500,0.18")
    return (lux[0] if lux else None), reflectance


def of_grey_card(measurement: Measurement, camera: Camera, grey_card: str | None) -> Known:
    """The camera's figures by flat frames of a grey card under a lux meter; nothing without lux.

    grey_card: see :func:`card`; illuminance_lux in ``frames.csv`` takes precedence over its lux. Raises
    ``ValueError`` for a card without any lux, and as :func:`tied` does.
    """
    lux, reflectance = (None, _GREY) if grey_card is None else card(grey_card)
    flat = [measurement.flat[index] for index in measurement.used]
    listed = [level.taken.illuminance_lux for level in flat]
    levels_lux = [lux if level_lux is None else level_lux for level_lux in listed]
    lit = [(level, float(on)) for level, on in zip(flat, levels_lux, strict=True) if on]
    if not lit:
        if grey_card is not None:
            raise ValueError(
                f"grey_card = {grey_card!r}: needs lux, such as 500,0.18, or illuminance_lux in frames.csv"
            )
        return {}
    exposure_s, mean_dn = columns([level for level, _ in lit], "exposure_s", "mean_dn")
    lux_s = np.array([on for _, on in lit]) * exposure_s * reflectance
    signal_e = (mean_dn - measurement.fit.dark.at(exposure_s)) / measurement.fit.gain
    per_lux_s = float(signal_e.sum() / lux_s.sum())
    off_e = signal_e - per_lux_s * lux_s
    scatter = math.sqrt(float((off_e**2).sum()) * len(lit) / max(1, len(lit) - 1)) / float(signal_e.sum())
    error = per_lux_s * math.hypot(scatter, measurement.fit.error(1) / measurement.fit.gain)
    interval = "-".join(interval_texts(Uncertain(per_lux_s, error).interval()))
    of_card = f"reflectance {reflectance:g}" + (" (assumed)" if grey_card is None else "")
    source = f"measured: {len(lit)} levels of a grey card, {of_card}, 95 % {interval} (without the lux meter's error)"
    return tied(camera, per_lux_s, source)


def lux_text(camera: Camera) -> str | None:
    """A line on the assumed values on which the lux of this camera depend, None if there are none."""
    rests_on = RESTS_ON[2:] if camera.lens.t_number else RESTS_ON
    sources = {name: camera.sources.get(name, "") for name in rests_on}
    tied_by = {name: before for name in rests_on for before, of, _ in [sources[name].partition(_TIED)] if of}
    assumed = [name for name, source in (tied_by or sources).items() if "assum" in source]
    shown = [
        name if name == "quantum_efficiency" else f"{name} {camera.figure(name):.4g}" for name in assumed
    ]
    measures = "measure them with a grey card and a lux meter: 'blurnoise cameras fit --grey-card'"
    return (
        f"camera: {camera.name}, lux depend on assumed values of {', '.join(shown)}; {measures}"
        if shown
        else None
    )
