"""Gain of a camera in dB, 20 log10 of the factor on the signal: analogue before the converter, digital after it.

Convention: gain is counted from the camera's own system gain K at 0 dB, so K(g) = K g whatever the pixel does; a
switch of its conversion gain changes the full well and the read noise, not the brightness. Read noise is referred
to the input; the share of its variance that arises behind the amplifier falls with gain:
sigma^2(g) = sigma^2 (1 - share + share / g^2).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le

from blurnoise._core.limits import within
from blurnoise._core.validation import Figure, check_fields


@dataclass(frozen=True)
class ConversionGain:
    """What a pixel becomes from a gain on, where it switches to a smaller capacitance.

    from_db: the gain at which it switches. full_well_e: its well from there on. read_noise_e: rms at
    ``from_db``; read_noise_post_share: of its variance, what arises behind the amplifier.
    Raises ``TypeError`` or ``ValueError`` naming the field.
    """

    from_db: Annotated[Figure, within("from_db")]
    full_well_e: Annotated[Figure, within("full_well_e")]
    read_noise_e: Annotated[Figure, within("read_noise_e")]
    read_noise_post_share: Annotated[Figure, Ge(0), Le(1)] = 0.0

    def __post_init__(self) -> None:
        check_fields(self)


def factor(gain_db: float) -> float:
    """10^(gain_db / 20)."""
    return float(10 ** (gain_db / 20))


def read_noise_e(row: ConversionGain, gain_db: float) -> float:
    """Of a row at an analogue gain from its own on, rms, referred to the input; g is counted from the row's gain."""
    share = row.read_noise_post_share
    return row.read_noise_e * math.sqrt(1 - share + share / factor(gain_db - row.from_db) ** 2)


def row_at(rows: Sequence[ConversionGain], gain_db: float) -> ConversionGain:
    """The last of ``rows``, which rise in ``from_db``, that begins at or below the gain; else the first."""
    return next((row for row in reversed(rows) if row.from_db <= gain_db), rows[0])
