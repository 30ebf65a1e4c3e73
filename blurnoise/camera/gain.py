"""Gain: a camera's figures at an analogue gain, by a law or as measured.

Gain is in dB, 20 log10 of the factor on the signal, counted from the system gain K at 0 dB: K(g) = K g whatever the
pixel does; another conversion gain changes the full well and the read noise, not the brightness. Read noise is
referred to the input: sigma^2(g) = sigma^2 (1 - share + share / g^2). Measured gains replace both laws.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated

from blurnoise._core.checks import shown
from blurnoise._core.fields import Figure, check_fields, within
from blurnoise.camera.figures import GAIN_DB, GAIN_DN_PER_E, LEVEL_DN, NOISE_E, SHARE, WELL_E


@dataclass(frozen=True)
class ConversionGain:
    """A pixel's figures from the gain on at which it switches to a smaller capacitance.

    from_db: the gain at which it switches. full_well_e: its well from there on. read_noise_e: rms at ``from_db``;
    read_noise_post_share: of its variance, what arises behind the amplifier. Raises ``TypeError`` or ``ValueError``.

    >>> quieter = ConversionGain(from_db=12.0, full_well_e=2500.0, read_noise_e=1.2)  # of a smaller capacitance
    >>> round(by_law(MeasuredGain(0.0, 0.4, 2.4, 6.0), quieter, 12.0).read_noise_e, 2)
    1.2
    """

    from_db: Annotated[Figure, within(GAIN_DB)]
    full_well_e: Annotated[Figure, within(WELL_E)]
    read_noise_e: Annotated[Figure, within(NOISE_E)]
    read_noise_post_share: Annotated[Figure, within(SHARE)] = 0.0

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True)
class MeasuredGain:
    """A camera's figures as measured at a gain.

    gain_db: above 0 dB, where the sensor's own figures hold. system_gain_dn_per_e: K there. read_noise_e: rms,
    referred to the input. black_level_dn: offset before rounding. Raises ``TypeError`` or ``ValueError``.

    >>> at_12_db = MeasuredGain(12.0, system_gain_dn_per_e=1.6, read_noise_e=2.0, black_level_dn=8.0)
    >>> measured(MeasuredGain(0.0, 0.4, 2.4, 6.0), [at_12_db], 12.0) == at_12_db
    True
    """

    gain_db: Annotated[Figure, within(GAIN_DB)]
    system_gain_dn_per_e: Annotated[Figure, within(GAIN_DN_PER_E)]
    read_noise_e: Annotated[Figure, within(NOISE_E)]
    black_level_dn: Annotated[Figure, within(LEVEL_DN)]

    def __post_init__(self) -> None:
        check_fields(self)


def fault(
    at_0_db: MeasuredGain,
    gains: Sequence[MeasuredGain],
    conversion_gains: Sequence[ConversionGain],
    last_db: float,
) -> str:
    """The first fault in a sensor's gains up to ``last_db``, "" if none. at_0_db: the sensor's figures there.

    >>> at_0_db, at_12_db = MeasuredGain(0.0, 0.4, 2.4, 6.0), MeasuredGain(12.0, 1.6, 2.0, 8.0)
    >>> fault(at_0_db, [at_12_db], [], last_db=6.0)
    'gains: gain_db are [12.0]; must increase, up to analogue_gain_max_db, 6'
    """
    starts, gains_db = [row.from_db for row in conversion_gains], [row.gain_db for row in gains]
    if sorted({*starts}) != starts or any(not 0 < start <= last_db for start in starts):
        must = f"must increase, above 0 and up to analogue_gain_max_db, {last_db:g}"
        return f"conversion_gains: from_db are {shown(starts)}; {must}"
    if gains and conversion_gains:
        return "gains: are measured whatever the conversion gain; conversion_gains must be empty beside them"
    if sorted({*gains_db}) != gains_db or any(gain_db > last_db for gain_db in gains_db):
        return f"gains: gain_db are {shown(gains_db)}; must increase, up to analogue_gain_max_db, {last_db:g}"
    if gains and gains_db[0] == 0 and gains[0] != at_0_db:
        names = "system_gain_dn_per_e, read_noise_e and black_level_dn"
        return f"gains: {shown(gains[0])}: at 0 dB must repeat the camera's own {names}, {shown(at_0_db)}"
    return ""


def measured(at_0_db: MeasuredGain, gains: Sequence[MeasuredGain], gain_db: float) -> MeasuredGain:
    """Interpolate a sensor's figures at a gain between those at 0 dB and those measured at other gains.

    Between two rows, log K, log read noise and the black level are linear in dB. Beyond the last row K follows the
    dB, and read noise and black level stay.

    >>> at_0_db, at_12_db = MeasuredGain(0.0, 0.4, 2.4, 6.0), MeasuredGain(12.0, 1.6, 2.0, 8.0)
    >>> found = measured(at_0_db, [at_12_db], 6.0)
    >>> round(found.system_gain_dn_per_e, 3), round(found.read_noise_e, 2), found.black_level_dn
    (0.8, 2.19, 7.0)
    """
    # In logarithms: amplifiers step in dB, and K measured between two steps lies on the line between them.
    rows = [at_0_db, *(row for row in gains if row.gain_db > 0)]
    for low, high in pairwise(rows):
        if gain_db <= high.gain_db:
            over = (gain_db - low.gain_db) / (high.gain_db - low.gain_db)
            return MeasuredGain(
                gain_db,
                low.system_gain_dn_per_e ** (1 - over) * high.system_gain_dn_per_e**over,
                low.read_noise_e ** (1 - over) * high.read_noise_e**over,
                low.black_level_dn + over * (high.black_level_dn - low.black_level_dn),
            )
    # Nothing was measured beyond: K follows the amplifier's law, and what else there is stays.
    factor = 10 ** ((gain_db - rows[-1].gain_db) / 20)
    return replace(rows[-1], gain_db=gain_db, system_gain_dn_per_e=rows[-1].system_gain_dn_per_e * factor)


def by_law(at_0_db: MeasuredGain, row: ConversionGain, gain_db: float) -> MeasuredGain:
    """Compute a sensor's figures at a gain from those at 0 dB and the row of its conversion gain.

    >>> found = by_law(MeasuredGain(0.0, 0.4, 2.4, 6.0), ConversionGain(0.0, 1e4, 2.4, 0.5), 20.0)
    >>> found.system_gain_dn_per_e, round(found.read_noise_e, 2)
    (4.0, 1.71)
    """
    share, over_row = row.read_noise_post_share, 10 ** ((gain_db - row.from_db) / 20)
    return MeasuredGain(
        gain_db,
        at_0_db.system_gain_dn_per_e * 10 ** (gain_db / 20),
        row.read_noise_e * math.sqrt(1 - share + share / over_row**2),
        at_0_db.black_level_dn,
    )
