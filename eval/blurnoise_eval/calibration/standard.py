"""The figures of EMVA 1288 release 4 (linear), as the standard defines them, beside those of a camera.

Temporal figures come from the means and variances of flat levels minus those of dark ones of the same exposure
(interpolated between two exposures), DN and DN^2. Figures of fixed patterns come from mean frames. A camera has what
a simulation needs, so some of its figures are defined differently: each row says how.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import norm

from blurnoise.camera import Camera
from blurnoise_eval.calibration.labels import light_of
from blurnoise_eval.calibration.levels import Level, columns
from blurnoise_eval.calibration.patterns import Halves, common_variances, hot_pixels
from blurnoise_eval.calibration.rounding import SHEPPARD_DN2
from blurnoise_eval.calibration.uncertain import Uncertain, Z

PASS, FAIL, CANNOT_TELL, NOT_JUDGED = "pass", "fail", "cannot tell", "-"  # verdicts
LEAST_DARK_DN2 = 0.24
"""The standard's lower limit of the variance in the dark, below which rounding hides the noise."""
LIMITED = {
    "sigma_d": "the standard: 0.24 DN² or more",
    "DSNU_pixel": "rounding weakens it",
    "DR": "the standard: 0.24 DN² or more",
}
"""The figures that are limits then, and why those of a camera are better."""
_LINEAR = (0.05, 0.95)  # of the signal at saturation, for the linearity
_USED = 0.7  # the same, for K and responsivity
_DECIBEL = 20 / math.log(10)
_ROUNDING_DN2 = 1 / 8
"""By which rounding may add more or less than 1/12 to the variance in the dark where it hides the noise, about."""


@dataclass(frozen=True)
class StandardFigures:
    """values: by the names of ``ROWS``, with standard deviations; figures that the frames do not show are missing.

    hidden: whether rounding hides the noise in the dark, so that ``LIMITED`` figures are limits.
    """

    values: Mapping[str, Uncertain]
    hidden: bool


@dataclass(frozen=True)
class _Definition:
    """A figure of the standard: title, unit, the largest difference of a camera, and why cameras differ.

    relative: whether the tolerance is a fraction. tolerance: None: not judged.
    """

    title: str
    unit: str
    tolerance: float | None
    why: str
    relative: bool = True


ROWS: Mapping[str, _Definition] = {
    "K": _Definition("system gain K", "DN/e-", 0.03, "levels are weighted, a bend is apart"),
    "QE": _Definition("quantum efficiency", "", 0.03, "levels are weighted"),
    "sigma_d": _Definition("temporal dark noise", "e-", 0.05, "of all levels"),
    "DSNU": _Definition("DSNU", "e-", None, "no hot pixels, no odd-even offsets"),
    "DSNU_pixel": _Definition("DSNU of pixels", "e-", 0.1, "before rounding; both without hot pixels"),
    "PRNU": _Definition("PRNU", "%", None, "no shading of lamp and lens"),
    "PRNU_pixel": _Definition("PRNU of pixels", "%", 0.06, "no shading of lamp and lens"),
    "saturation": _Definition("saturation capacity", "e-", 0.1, "peak of the simulated variance"),
    "DR": _Definition("dynamic range", "dB", 1.0, "of saturation and dark noise", relative=False),
    "SNR_max": _Definition("largest SNR", "dB", 0.5, "of saturation", relative=False),
    "LE": _Definition("linearity error", "%", 3.0, "simulated light is linear", relative=False),
}
"""By name, in the order of tables. Tolerances of K, QE and PRNU are what repeated measurements keep; sigma_d and DSNU
carry an error of K, too; the peak of the variance is flat."""
_SMALL = 0.1  # of the temporal noise in the dark: a smaller pattern adds less than 0.5 % to it


@dataclass(frozen=True)
class StandardRow:
    """A figure by the standard and of a camera. difference: relative or in the unit, NaN if one is unknown.

    limit: whether the standard's is the worst that the figure can be. small: a difference that always passes.

    >>> row = StandardRow("K", Uncertain(0.5, 0.001), camera=0.52)
    >>> row.cells()[:-1]
    ('system gain K, DN/e-', '0.5', '0.52', '+4 %', '3 %', 'fail')
    >>> StandardRow("DSNU_pixel", Uncertain(0.95, 0.01), camera=0.0, small=1.1).cells()[3:-1]
    ('-100 %', '10 %, 1.1 e-', 'pass')
    """

    name: str
    standard: Uncertain
    camera: float
    limit: bool = False
    small: float = 0.0

    @property
    def title(self) -> str:
        """The figure's name in texts."""
        return ROWS[self.name].title

    @property
    def difference(self) -> float:
        """Of the camera: relative to the standard's, or in its unit."""
        apart = self.camera - self.standard.value
        if not ROWS[self.name].relative:
            return apart
        return apart / self.standard.value if self.standard.value > 0 else math.nan

    @property
    def verdict(self) -> str:
        """Pass within the tolerance; fail where chance does not explain the rest."""
        row = ROWS[self.name]
        if row.tolerance is None:
            return NOT_JUDGED
        if self.limit:
            better = self.difference <= 0 if self.name == "sigma_d" else self.difference >= 0
            return PASS if better else CANNOT_TELL
        if not math.isfinite(self.difference):
            return CANNOT_TELL
        if abs(self.difference) <= row.tolerance or abs(self.camera - self.standard.value) <= self.small:
            return PASS
        chance = Z * self.standard.error / (self.standard.value if row.relative else 1.0)
        return FAIL if abs(self.difference) - chance > row.tolerance else CANNOT_TELL

    @property
    def why(self) -> str:
        """Why the two differ."""
        if self.limit:
            return LIMITED[self.name]
        if math.isnan(self.standard.value):
            missing = {"QE": "no photons are stated", "K": "too few levels", "LE": "too few levels"}
            return missing.get(self.name, "frames do not show it")
        return ROWS[self.name].why

    def cells(self) -> tuple[str, ...]:
        """The row as text, as ``HEADS``."""
        row = ROWS[self.name]
        unit = f", {row.unit}" if row.unit else ""
        numbers = ["-" if math.isnan(x) else f"{x:.4g}" for x in (self.standard.value, self.camera)]
        scale, of = (100.0, " %") if row.relative else (1.0, f" {row.unit}")
        apart = "-" if math.isnan(self.difference) else f"{float(f'{scale * self.difference:.2g}'):+g}{of}"
        allowed = "-" if row.tolerance is None else f"{scale * row.tolerance:g}{of}"
        allowed += f", {self.small:.2g} {row.unit}" if self.small else ""
        return (f"{row.title}{unit}", *numbers, apart, allowed, self.verdict, self.why)

    def record(self) -> dict[str, Any]:
        """Plain values for a file, None for what is unknown."""
        numbers = {"standard": self.standard.value, "camera": self.camera, "difference": self.difference}
        known = {name: value if math.isfinite(value) else None for name, value in numbers.items()}
        return {"figure": self.name, **known, "verdict": self.verdict, "why": self.why}


def figures_of_frames(
    dark: Sequence[Level], flat: Sequence[Level], unlit: Halves, light: Halves
) -> StandardFigures:
    """The standard's figures of all ``dark`` and ``flat`` levels of one gain, those that clip included.

    unlit, light: mean frames of dark and of flat frames that do not clip, for the fixed patterns. Figures that need
    saturation are missing where the variance of the brightest level is the largest.
    """
    x, unit = light_of([level.taken for level in flat])
    mean, variance, error = (
        np.array(column)[np.argsort(x, kind="stable")]
        for column in columns(flat, "mean_dn", "variance_dn2", "variance_error_dn2")
    )
    exposure_s = columns(flat, "exposure_s")[0][np.argsort(x, kind="stable")]
    x = np.sort(x)
    unlit_s, *of_dark = columns(dark, "exposure_s", "mean_dn", "variance_dn2", "variance_error_dn2")
    times_s = np.unique(unlit_s)
    dark_mean, dark_variance, dark_error = (
        np.interp(exposure_s, times_s, [column[unlit_s == time_s].mean() for time_s in times_s])
        for column in of_dark
    )
    signal, photo, noise = mean - dark_mean, variance - dark_variance, np.hypot(error, dark_error)
    peak = int(np.argmax(variance))
    reached = peak < len(x) - 1
    used = (signal <= _USED * signal[peak]) & (signal > 0)
    values: dict[str, Uncertain] = {}
    if used.sum() < 2:
        return StandardFigures(values, hidden=False)
    square = float(signal[used] @ signal[used])
    gain = float(signal[used] @ photo[used]) / square
    gain_error = math.sqrt(float((signal[used] * noise[used]) @ (signal[used] * noise[used]))) / square
    sloped = len(times_s) > 2
    dark_dn2 = float(np.polynomial.polynomial.polyfit(unlit_s, of_dark[1], 1)[0] if sloped else of_dark[1][0])
    hidden = dark_dn2 < LEAST_DARK_DN2
    if hidden:  # what rounding did to the dark variance is in that of no flat level
        gain_error = math.hypot(gain_error, _ROUNDING_DN2 / Z * float(signal[used].sum()) / square)
    rate = float(x[used] @ signal[used]) / float(x[used] @ x[used])
    share = gain_error / gain
    values["K"] = Uncertain(gain, gain_error)
    if unit == "photons":
        values["QE"] = Uncertain(rate / gain, share * rate / gain)
    dark_dn2 = max(dark_dn2, LEAST_DARK_DN2)
    sigma_e = math.sqrt(dark_dn2 - 1 / 12) / gain
    of_variance = float(np.sqrt((of_dark[2] ** 2).sum())) / len(dark) / (2 * (dark_dn2 - 1 / 12))
    values["sigma_d"] = Uncertain(sigma_e, sigma_e * math.hypot(share, of_variance))
    if reached:
        most_e = rate * float(x[peak]) / gain
        # the peak lies anywhere between the levels beside the largest variance
        apart = math.hypot(share, float(np.diff(x[max(0, peak - 1) : peak + 2]).max()) / float(x[peak]) / Z)
        values["saturation"] = Uncertain(most_e, apart * most_e)
        values["DR"] = Uncertain(
            _DECIBEL * math.log(most_e / (math.sqrt(dark_dn2) / gain + 0.5)),
            _DECIBEL * math.hypot(of_variance, apart),
        )
        values["SNR_max"] = Uncertain(_DECIBEL / 2 * math.log(most_e), _DECIBEL / 2 * apart)
    inside = (signal >= _LINEAR[0] * signal[peak]) & (signal <= _LINEAR[1] * signal[peak])
    if inside.sum() > 2:
        offset, slope = np.polynomial.polynomial.polyfit(x[inside], signal[inside], 1, w=1 / signal[inside])
        line = offset + slope * x[inside]
        scatter = float(np.max(np.sqrt(noise[inside]) / signal[inside]))
        values["LE"] = Uncertain(100 * float(np.max(np.abs(signal[inside] / line - 1))), scatter)
    values |= _patterns(unlit, light, gain)
    return StandardFigures(values, hidden)


def _patterns(unlit: Halves, light: Halves, gain: float) -> dict[str, Uncertain]:
    """DSNU and PRNU, in all and of pixels; missing where a variance is below 0. Those of pixels have no hot ones."""
    hot = hot_pixels((unlit[0] + unlit[1]) / 2)
    signal = float(np.mean(light) - np.mean(unlit))
    found = {}
    for name, parts, left_out in (
        ("", ("row", "column", "pixel"), np.zeros_like(hot)),
        ("_pixel", ("pixel",), hot),
    ):
        of_dark, of_light = (
            common_variances(one - one[~left_out].mean(), other - other[~left_out].mean(), left_out)
            for one, other in (unlit, light)
        )
        dark = sum(getattr(of_dark, part).value for part in parts)
        bright = sum(getattr(of_light, part).value for part in parts) - dark
        dark_error = math.hypot(*(getattr(of_dark, part).error for part in parts))
        light_error = math.hypot(dark_error, *(getattr(of_light, part).error for part in parts))
        for title, variance, error, unit in (
            ("DSNU", dark, dark_error, 1 / gain),
            ("PRNU", bright, light_error, 100 / signal),
        ):
            if variance > 0:
                root = math.sqrt(variance)
                found[title + name] = Uncertain(unit * root, unit * error / (2 * root))
    return found


HEADS = ("EMVA 1288 release 4", "frames", "camera", "difference", "allowed", "verdict", "why they differ")


def rows(found: StandardFigures, camera: Camera) -> list[StandardRow]:
    """The figures of frames beside those of ``camera``, at the gain of the frames."""
    sensor = camera.sensor
    efficiency, most_e = sensor.quantum_efficiency, peak_e(camera)
    threshold_e = math.sqrt(sensor.dark_variance_dn2()) / sensor.system_gain_dn_per_e + 0.5
    figures = {
        "K": sensor.system_gain_dn_per_e,
        "QE": float(efficiency) if isinstance(efficiency, (int, float)) else math.nan,
        "sigma_d": sensor.dark_noise_e,
        "DSNU": sensor.dsnu_total_e,
        "DSNU_pixel": sensor.dsnu_e,
        "PRNU": 100 * sensor.prnu_total,
        "PRNU_pixel": 100 * sensor.prnu,
        "saturation": most_e,
        "DR": _DECIBEL * math.log(most_e / threshold_e),
        "SNR_max": _DECIBEL / 2 * math.log(most_e),
        "LE": 0.0,
    }
    # Rounding adds up to 0.25 DN^2 there, by where the black level lies between two numbers.
    coarse = (sensor.system_gain_dn_per_e * sensor.dark_noise_e) ** 2 < SHEPPARD_DN2
    limits = LIMITED if found.hidden or coarse else ()
    small = {"DSNU_pixel": _SMALL * sensor.dark_noise_e}
    nothing = Uncertain(math.nan, math.nan)
    return [
        StandardRow(
            name, found.values.get(name, nothing), figures[name], name in limits, small.get(name, 0.0)
        )
        for name in ROWS
    ]


def peak_e(camera: Camera) -> float:
    """Mean electrons at which the temporal variance is largest: what the standard calls saturation.

    Before the clip, the bend of photon transfer and the clipping of single pixels lower the variance.

    >>> camera = Camera.preset("imx250m")
    >>> 0.97 < peak_e(camera) / camera.sensor.saturation_e < 1.0
    True
    """
    sensor = camera.sensor
    top_e, gain = sensor.saturation_e, sensor.system_gain_dn_per_e
    charge = np.linspace(0.3, 1.0, 701) * top_e
    factor = np.array([sensor.variance_factor(each) for each in charge])
    noise = np.sqrt(charge * factor + sensor.dark_variance_dn2() / gain**2)
    nodes = np.linspace(-4.0, 4.0, 81)
    weight = norm.pdf(nodes) / norm.pdf(nodes).sum()
    # of a pixel, that is off the mean by PRNU: the variance of a normal number that is clipped at z deviations
    z = (top_e - charge[:, None] * (1 + sensor.prnu_total * nodes)) / noise[:, None]
    below, density = norm.cdf(z), norm.pdf(z)
    mean = z * (1 - below) - density
    square = below - z * density + z * z * (1 - below)
    clipped = ((square - mean * mean) * weight).sum(1) * noise**2
    return float(charge[np.argmax(clipped)])
