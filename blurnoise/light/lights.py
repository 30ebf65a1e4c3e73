"""Named lights: the illuminance of a scene, its spectrum, and the headlamps that are on, in one table with sources.

Lux are those of the surroundings on the scene, without the headlamps. Where the sources give a level alone, spectrum
and headlamps are assumed: daylight and its colours after sunset, LED or sodium lamps over streets, and low beam
wherever drivers need it. Nothing heavy is imported, as the command line's help names the lights.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from itertools import pairwise

HEADLAMPS_ON = {"off": "no headlamps", "low": "low beam", "high": "high beam"}
"""What a light's headlamp is called."""


@dataclass(frozen=True)
class Light:
    """A light by name. lux: above 0; illuminant: its spectrum by name; headlamp: "off", "low" or "high"; source: of
    the lux. Raises ``ValueError`` or ``TypeError`` naming the field.

    >>> print(Light("yard", 5.0, "sodium"))
    yard: 5 lux, sodium
    """

    name: str
    lux: float
    illuminant: str = "D55"
    headlamp: str = "off"
    source: str = ""

    def __post_init__(self) -> None:
        from blurnoise._core.checks import limited, one_of  # late, as the spectra: both take time to import
        from blurnoise.camera.spectra import check_illuminant

        if limited(f"light {self.name}: lux", self.lux, "illuminance_lux") <= 0:
            raise ValueError(f"light {self.name}: lux = {self.lux!r}: must be above 0")
        check_illuminant(self.illuminant)
        one_of(f"light {self.name}: headlamp", self.headlamp, HEADLAMPS_ON)

    def __str__(self) -> str:
        return light_text(self.name, self.lux, self.illuminant, self.headlamp)


def light_text(name: str, lux: float, illuminant: str, headlamp: str) -> str:
    """A light in words.

    >>> light_text("street", 1.0, "led-4000", "low")
    'street: 1 lux, led-4000, low beam'
    """
    beam = [] if headlamp == "off" else [HEADLAMPS_ON[headlamp]]
    return f"{name}: {', '.join([f'{lux:g} lux', illuminant, *beam])}"


@cache
def names_of_lights() -> tuple[str, ...]:
    """The names in the table, the darkest first.

    >>> names_of_lights()[3:5]
    ('street', 'twilight')
    """
    return tuple(row["name"] for row in _rows())


@cache
def named_lights() -> Mapping[str, Light]:
    """The table by name.

    >>> print(named_lights()["street"])
    street: 1 lux, led-4000, low beam
    """
    return {
        row["name"]: Light(row["name"], float(row["lux"]), row["illuminant"], row["headlamp"], row["source"])
        for row in _rows()
    }


def each_light(names: str | Light | Iterable[str | Light]) -> tuple[Light, ...]:
    """Lights in the order of their names, several of one lux included. Raises ``TypeError`` or ``ValueError``.

    >>> [light.illuminant for light in each_light(["sodium-street", "lit-street"])]
    ['sodium', 'led-4000']
    """
    from blurnoise._core.checks import known

    names = [names] if isinstance(names, Light) else names.split(",") if isinstance(names, str) else names
    found = []
    for each in names:
        if isinstance(each, str):
            known("light", each.strip(), names_of_lights())
            each = named_lights()[each.strip()]
        if not isinstance(each, Light):
            raise TypeError(f"light = {each!r}: must be names or Light")
        found.append(each)
    return tuple(found)


def lights_of(names: str | Iterable[str | Light]) -> tuple[Light, ...]:
    """Lights from "NAME,NAME", from names or from records, the darkest first.

    Raises ``ValueError`` for an unknown name, which lists the names, and for two lights of one lux, which a table by
    lux cannot tell apart.

    >>> [light.lux for light in lights_of("daylight,street")]
    [1.0, 20000.0]
    """
    lights = sorted(dict.fromkeys(each_light(names)), key=lambda light: light.lux)
    for one, other in pairwise(lights):
        if one.lux == other.lux:
            spectra, beams = (
                ",".join(dict.fromkeys((first, second)))
                for first, second in ((one.illuminant, other.illuminant), (one.headlamp, other.headlamp))
            )
            instead = f"--lux {one.lux:g} --illuminant {spectra} --headlamp {beams}"
            raise ValueError(f"light = {one.name},{other.name}: have the same lux; compare them by {instead}")
    return tuple(lights)


def _rows() -> list[dict[str, str]]:
    table = resources.files("blurnoise.light") / "data" / "lights.csv"
    return list(csv.DictReader(table.read_text(encoding="utf-8").splitlines()))
