"""Readers of settings: tone curves, grey anchors and trajectories, from what Python, a file or an option has.

Each raises ``ValueError`` of one line. Heavy modules are imported once there is a value.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from blurnoise_eval.plan.axes import OWN_SPECTRUM

if TYPE_CHECKING:
    from blurnoise.camera.colour import PictureTone
    from blurnoise.camera.spectra import Curve
    from blurnoise.light.lights import Light
    from blurnoise_eval.plan.trajectory_spec import TrajectorySpec

_TONES = ("srgb", "linear", "filmic", "typical")
_TONE_CHOICES = (
    "srgb, linear, filmic, typical, a camera file with 'tone:', or points light:value such as 0:0,0.2:0.5,1:1"
)


def tone_of(given: Any) -> PictureTone | None:
    """The tone curve of a picture from a name, points (such as "0:0,0.2:0.5,1:1"), or a camera file with ``tone``.

    None: left to the pictures, see :func:`blurnoise_eval.default_tone.with_tone`.

    >>> tone_of("0:0,0.2:0.5,1:1")
    ((0.0, 0.0), (0.2, 0.5), (1.0, 1.0))
    """
    from blurnoise._core.files import read_document
    from blurnoise.camera.colour import picture_tone

    value: Any = given
    if given is None:
        return None
    if isinstance(given, str) and ":" in given and not given.endswith((".yaml", ".yml", ".json")):
        value = [pair.split(":") for pair in given.split(",")]
    elif isinstance(given, str) and given not in _TONES:
        try:
            camera = read_document(Path(given))
        except OSError:
            raise ValueError(f"must be {_TONE_CHOICES}") from None
        value = camera.get("tone") if isinstance(camera, Mapping) else None
        if value is None:
            raise ValueError(f"must be {_TONE_CHOICES}; this file has no 'tone:'")
    try:
        return picture_tone(value, "picture_tone")
    except TypeError as error:
        raise ValueError(str(error)) from None


def anchor_of(given: Any) -> str | None:
    """A grey anchor, as :class:`blurnoise.scene.metering.GreyAnchor` writes it.

    >>> anchor_of("P50.0")
    'p50'
    """
    from blurnoise.scene.metering import GreyAnchor

    return None if given is None else str(GreyAnchor.parse(given))


def named_lights_of(given: Any) -> tuple[Light, ...]:
    """Named lights from "NAME,NAME", a list of names, records, or the fields of records as a run has them.

    >>> [light.name for light in named_lights_of("dusk,street")]
    ['street', 'dusk']
    """
    from blurnoise.light.lights import Light, lights_of

    if isinstance(given, str | Light):
        given = [given] if isinstance(given, Light) else given.split(",")
    if not isinstance(given, Iterable):
        raise ValueError(f"light = {given!r}: must be names, such as street,dusk")
    return lights_of(Light(**each) if isinstance(each, Mapping) else each for each in given)


def spectra_of(given: Any) -> tuple[list[Any], Curve | None]:
    """Illuminants as an option or a file has them, with "own" in place of a CSV file, and the curve of that file.

    Raises ``ValueError`` for several files, ``OSError`` for one that cannot be read.
    """
    from blurnoise.camera.spectra import Curve, check_illuminant, refuse_infrared

    listed = given if isinstance(given, list | tuple) else [given]
    parts = [part for each in listed for part in (each.split(",") if isinstance(each, str) else [each])]
    for part in parts:
        if isinstance(part, str):
            refuse_infrared(part)
    files = [
        part.strip() for part in parts if isinstance(part, str) and part.strip().lower().endswith(".csv")
    ]
    if len(set(files)) > 1:
        raise ValueError(f"illuminant = {','.join(files)}: must be one CSV file at most")
    stated = [OWN_SPECTRUM if isinstance(part, str) and part.strip() in files else part for part in parts]
    if not files:
        return stated, None
    curve = Curve.from_csv(files[0])
    try:
        check_illuminant(curve)
    except ValueError as error:
        raise ValueError(f"{files[0]}: {error}") from None
    return stated, curve


def curve_of(given: Any) -> Curve | None:
    """A spectrum from a curve, or from the fields of one as a run has them."""
    from blurnoise.camera.spectra import Curve

    if given is None or isinstance(given, Curve):
        return given
    return Curve(*(tuple(map(float, given[name])) for name in ("wavelengths_nm", "values")))


def trajectory_of(given: Any) -> TrajectorySpec | None:
    """A trajectory from the text of an option; a file is read now."""
    from blurnoise_eval.plan.trajectory_spec import TrajectorySpec

    if given is None or isinstance(given, TrajectorySpec):
        return given
    if not isinstance(given, str):
        raise ValueError("must be text, such as shake:3")
    return TrajectorySpec.parse(given)
