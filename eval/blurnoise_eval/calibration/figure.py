"""Figure of photon transfer: temporal variance over mean, and signal over light, of frames."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from blurnoise_eval.calibration.fit import Measurement
from blurnoise_eval.calibration.levels import columns
from blurnoise_eval.plots.style import COLOURS, GREY, small_multiples, tidy
from blurnoise_eval.system.terminal import plain

_HOLLOW: Any = {"ls": "", "marker": "o", "ms": 5, "mfc": "white", "mew": 1.3}
_MODEL: Any = {"color": GREY, "lw": 1.2, "zorder": 1}


def draw_fit(measurement: Measurement, name: str) -> Figure:
    """Draw the levels and the fitted model."""
    fit, linear = measurement.fit, measurement.linearity
    panels = 2 if linear else 1
    figure, (transfer, *rest) = small_multiples(panels, panels, (5.4, 4.6), (0.0, 0.4))
    used = [measurement.flat[index] for index in measurement.used]
    out = [level for level in measurement.flat if level not in used]
    shown = {"dark": measurement.dark, "flat": used, "flat, left out of the line": out}
    for (label, of_kind), colour in zip(shown.items(), ("black", *COLOURS), strict=False):
        noisy = [level for level in of_kind if level.variance_dn2 > 0]
        mean, variance = columns(noisy, "mean_dn", "variance_dn2")
        transfer.plot(mean - fit.dark.offset, variance, color=colour, label=label, **_HOLLOW)
    gain, read = (measurement.estimates[figure] for figure in ("system_gain_dn_per_e", "read_noise_e"))
    text = f"K {gain.value:.4g} DN/e⁻, read noise {read.value:.3g} e⁻"
    signal = np.geomspace(
        0.1, max(1.0, *(level.mean_dn - fit.dark.offset for level in measurement.flat)), 200
    )
    line = fit.at(signal + fit.dark.offset)
    transfer.plot(signal, line, label=text, **_MODEL)
    if measurement.bend:
        shares, factors = (
            np.array(measurement.bend.shares),
            np.array([factor.value for factor in measurement.bend.factors]),
        )
        bent = np.linspace(shares[0], shares[-1], 100)
        photo = fit.gain * bent * measurement.bend.top_dn * np.interp(bent, shares, factors)
        transfer.plot(
            bent * measurement.bend.top_dn, line[0] + photo, label="bend", color="black", ls="--", zorder=3
        )
    transfer.set_xscale("symlog", linthresh=1.0)
    transfer.set(yscale="log", ylim=(line[0] / 3, 5 * line[-1]))
    tidy(transfer, x="Mean above the black level / DN", y="Temporal variance / DN²")
    transfer.legend(fontsize=8, frameon=False, loc="upper left")
    if linear:
        units = {"photons": (1.0, "Light / photons per pixel"), "lux s": (1.0, "Light / lux s")}
        scale, label = units.get(linear.light, (1e3, "Exposure / ms"))
        expected = linear.slope * linear.x + linear.offset
        rest[0].plot(scale * linear.x, expected * (1 + linear.deviation), color=COLOURS[0], **_HOLLOW)
        rest[0].plot(scale * linear.x, expected, **_MODEL)
        title = f"at most {100 * linear.error.value:.2g} % off the line"
        tidy(rest[0], title=title, x=label, y="Signal / DN")
    figure.suptitle(f"{plain(name)}: photon transfer of {measurement.frames}", fontsize=11, parse_math=False)
    return figure
