"""Figures of a camera: what a number in a camera's records says of itself, in one place.

A field of :class:`~blurnoise.camera.lens.Lens`, :class:`~blurnoise.camera.sensor.Sensor` or
:class:`~blurnoise.camera.isp.Isp` is the whole entry of its figure: name, type, default, limits, title, unit, and
meaning (its docstring). Files, messages, the sums of noises and the explorer's sliders follow from it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import get_type_hints

from annotated_types import BaseMetadata, GroupedMetadata

from blurnoise._core.checks import Limit
from blurnoise._core.fields import within

# Limits that several records share.
GAIN_DB = Limit(0.0, 120.0)
WELL_E = Limit(1.0, 1e12)
GAIN_DN_PER_E = Limit(1e-9, 1e9)
NOISE_E = Limit(0.0, 1e6)
LEVEL_DN = Limit(0.0, 65536.0)
SHARE = Limit(0.0, 1.0)


@dataclass(frozen=True)
class CameraFigure(GroupedMetadata):
    """Annotation of a field that is a number.

    title: a noun, as pages show it. unit: of the number. limit: of the field. span: usual values, from where to where
    a slider goes; None: it has no slider. dark_noise: it is the rms of a temporal noise that every pixel has whatever
    its charge.

    >>> list(CameraFigure("Full well", "e-", Limit(1.0, 1e12)))
    [Ge(ge=1.0), Le(le=1000000000000.0)]
    """

    title: str
    unit: str
    limit: Limit
    span: tuple[float, float] | None = None
    dark_noise: bool = False

    def __iter__(self) -> Iterator[BaseMetadata]:
        """The limits, as pydantic reads them from annotations."""
        return iter(within(self.limit))


def figures_of(record: type) -> Mapping[str, CameraFigure]:
    """The annotations of a record's fields that are figures, by name, in the order of the fields.

    >>> from blurnoise.camera.lens import Lens
    >>> figures_of(Lens)["f_number"].title
    'f-number'
    """
    hints = get_type_hints(record, include_extras=True)
    every = {name: getattr(hint, "__metadata__", ()) for name, hint in hints.items()}
    return {
        name: entry
        for name, of_field in every.items()
        for entry in of_field
        if isinstance(entry, CameraFigure)
    }
