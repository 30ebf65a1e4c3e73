"""Gain of a camera in dB, 20 log10 of the factor on the signal, and the captures of which it makes one HDR picture.

Convention: gain is counted from the camera's own system gain K at 0 dB, so K(g) = K g whatever the pixel does; a
switch of its conversion gain changes the full well and the read noise, not the brightness. Read noise is referred
to the input; the share of its variance that arises behind the amplifier falls with gain:
sigma^2(g) = sigma^2 (1 - share + share / g^2).

Of captures the first is the reference, the most sensitive one; times count from where it begins. Dimensionless
ratios are those of the first to the other: R_k = T_1 s_1 / (T_k s_k) electrons of the first for one of capture k.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le

from blurnoise._core.checks import Figure, check_fields, shown, within


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


_ROUNDING = 1e-9  # of the first exposure: windows that meet do not overlap


@dataclass(frozen=True)
class Capture:
    """One of the captures.

    exposure_ratio: T_1 / T_k. sensitivity: electrons per light and time over the camera's (split pixels).
    gain_db: analogue, see :meth:`Camera.at_gain`. start_s: counted from where the first begins; None: where the
    one before it ends. Raises ``TypeError`` or ``ValueError`` naming the field and what is allowed.
    """

    exposure_ratio: Annotated[Figure, within("exposure_ratio")] = 1.0
    sensitivity: Annotated[Figure, within("sensitivity")] = 1.0
    gain_db: Annotated[Figure, within("gain_db")] = 0.0
    start_s: Annotated[Figure, within("start_s")] | None = None

    def __post_init__(self) -> None:
        check_fields(self)


def staggered(*ratios: float) -> tuple[Capture, ...]:
    """A capture and shorter ones of it, one after the other: ``staggered(16)``, ``staggered(16, 256)``."""
    return (Capture(), *(Capture(exposure_ratio=ratio) for ratio in ratios))


def dual_gain(gain_db: float) -> tuple[Capture, Capture]:
    """One exposure read at a gain and at 0 dB, as with dual conversion gain: nothing moves between the two."""
    return Capture(gain_db=gain_db), Capture(start_s=0.0)


def factors(captures: Sequence[Capture]) -> list[float]:
    """R_k of every capture, 1 of the first."""
    first = captures[0].exposure_ratio / captures[0].sensitivity
    return [each.exposure_ratio / each.sensitivity / first for each in captures]


def windows(captures: Sequence[Capture], exposure_s: float) -> list[tuple[float, float]]:
    """When each capture begins and how long it takes, s. Raises ``ValueError`` for such as overlap."""
    times: list[tuple[float, float]] = []
    for capture in captures:
        taken_s = exposure_s * captures[0].exposure_ratio / capture.exposure_ratio
        follows_s = sum(times[-1]) if times else 0.0
        times.append((follows_s if capture.start_s is None else capture.start_s, taken_s))
    if times[0][0] != 0:
        raise ValueError(
            f"captures: start_s = {shown(times[0][0])} of the first; must be 0, all count from it"
        )
    for place, (start_s, taken_s) in enumerate(times):
        for other, (begun_s, lasted_s) in enumerate(times[:place]):
            one_exposure = (start_s, taken_s) == (begun_s, lasted_s)
            apart_s = max(start_s - begun_s - lasted_s, begun_s - start_s - taken_s)
            if apart_s < -_ROUNDING * exposure_s and not (
                one_exposure or captures[place].sensitivity != captures[other].sensitivity
            ):
                raise ValueError(
                    f"captures: number {place + 1}, {1e3 * start_s:g} to {1e3 * (start_s + taken_s):g} ms, overlaps "
                    f"number {other + 1}, {1e3 * begun_s:g} to {1e3 * (begun_s + lasted_s):g} ms; must follow it, "
                    "share its whole time (two gains) or have a sensitivity of its own (split pixels)"
                )
    return times
