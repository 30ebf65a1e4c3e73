"""How pictures are exposed under each condition: what a sweep and a single picture share."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from annotated_types import Ge, Le
from pydantic import BeforeValidator

from blurnoise.light.lights import Light, names_of_lights
from blurnoise_eval.plan.axes import (
    AXES,
    HEADLAMP,
    LIGHT,
    LIT,
    OWN_SPECTRUM,
    SPECTRUM,
    Axis,
    axis,
)
from blurnoise_eval.plan.lit_targets import LitTargets
from blurnoise_eval.plan.reading import (
    anchor_of,
    curve_of,
    named_lights_of,
    spectra_of,
    tone_of,
    trajectory_of,
)
from blurnoise_eval.plan.settings import SettingInfo, Settings, default_text, late, nested, setting

if TYPE_CHECKING:
    from blurnoise.camera.colour import PictureTone
    from blurnoise.camera.spectra import Curve
    from blurnoise.motion.ego import Vehicle
    from blurnoise.scene.metering import AutoExposure
    from blurnoise_eval.plan.trajectory_spec import TrajectorySpec

    Anchor = str
else:
    Vehicle = late("blurnoise.motion.ego", "Vehicle")
    AutoExposure = late("blurnoise.scene.metering", "AutoExposure")
    PictureTone = Annotated[Any, BeforeValidator(tone_of)]
    Anchor = Annotated[Any, BeforeValidator(anchor_of)]
    Curve = Any
    TrajectorySpec = Annotated[Any, BeforeValidator(trajectory_of)]


@dataclass(frozen=True, kw_only=True)
class ExposureSettings(Settings):
    """Conditions, and how pictures are exposed under all of them: what a sweep and a single picture share.

    grid: by axis, values in SI units. In files and options each axis of ``AXES`` is a setting of its own, in the
    option's unit, with the axis's default. light: named lights, in place of values of ``illuminance_lux``: the grid
    has theirs, and conditions of each have its spectrum (and headlamps), unless the grid has these. own_spectrum: the
    illuminant "own", which a CSV file among the illuminants becomes. infrared: a lamp beside the light. lit: targets
    in headlamps. vehicle: drives at the speeds on the axis ``ego_speed_m_s``, and carries camera and headlamps.
    auto_exposure: sets gain and exposure where they are automatic. trajectory: motion in addition to the velocity.
    grey_anchor: the part of a picture that reflects 18 %; None: brightness is reflectance. picture_tone: the curve
    that codes pictures; None: by their kind. hdr_white: the light that is white in the merged picture of a camera of
    several captures.
    """

    AXES: ClassVar[tuple[Axis, ...]] = AXES
    LIGHTS: ClassVar[tuple[str, ...]] = ()
    """Names of the lights where neither these nor lux are chosen."""
    PANEL: ClassVar[str] = "Conditions: numbers such as 1,5,10, or a range low:high"
    METAVAR: ClassVar[str] = "LIST"

    grid: Mapping[str, Iterable[float]] = field(default_factory=dict, kw_only=False)
    lit: LitTargets = nested(LitTargets)
    light: tuple[Light, ...] = ()
    own_spectrum: Curve | None = None
    infrared: str | None = setting(
        None,
        "lamp in near infrared beside the light of lux, which do not count it: its wavelength, 850 or 940 nm, and "
        "its irradiance on the scene, W/m2",
        "NM:W/M2",
    )
    vehicle: Vehicle | None = setting(
        None, "position and orientation of the camera on a vehicle that drives (ego_kmh), or has headlamps"
    )
    auto_exposure: AutoExposure = setting(None, "limits of exposure time and gain where these are auto")
    trajectory: TrajectorySpec | None = setting(
        None,
        "camera motion in addition to dx and dy: a file of positions or rotation rates, a random shake, or a "
        "sinusoidal vibration",
        "FILE.csv|shake:PX|sine:PX,HZ[,DEG]",
    )
    grey_anchor: Anchor | None = setting(
        None,
        "part of a picture that reflects 18 %: its mean, a percentile, or a region in px (default: none; brightness "
        "is used as reflectance)",
        "mean|pNN|x0,y0,x1,y1",
    )
    picture_tone: PictureTone | None = setting(
        None,
        "tone curve of the input pictures, which is removed first; linear: values are proportional to light "
        "(default: typical for photographs, and also of cameras whose file has no tone; srgb for rendered pictures)",
        "srgb|typical|linear|filmic|FILE.yaml|POINTS",
    )
    hdr_white: Annotated[float, Ge(1e-6), Le(1e6)] = setting(
        1.0,
        "light that is white in the merged picture of a camera with several captures, in multiples of white",
    )
    seed: int = setting(0, "seed of the noise, and of the order of pictures in decide (default: 0)", "N")

    def __post_init__(self) -> None:
        from blurnoise._core.checks import integer
        from blurnoise._core.rng import LAST_SEED

        integer("seed", self.seed, 0, LAST_SEED)
        super().__post_init__()
        object.__setattr__(self, "light", named_lights_of(self.light))
        object.__setattr__(self, "own_spectrum", curve_of(self.own_spectrum))
        self._check_light()
        if self.auto_exposure is None:  # its module is heavy, so that no field can have it as default
            from blurnoise.scene.metering import USUAL

            object.__setattr__(self, "auto_exposure", USUAL)

    @classmethod
    def _settings(cls) -> Iterator[SettingInfo]:
        for each in cls.AXES:
            names = f": {', '.join(each.default_names)}" if each.default_names else ""
            default = default_text(each.default_text, names)
            if cls.LIGHTS and each.name == LIGHT.name:
                default = ""  # that of light
            metavar = f"auto|{cls.METAVAR}" if each.automatic else "|".join(each.choices) or cls.METAVAR
            metavar = "NAME,..." if each.prefix else metavar  # of many names, which its line lists
            yield SettingInfo(each.key, str, None, f"{each.about}{default}", metavar, cls.PANEL)
            if each.name != LIGHT.name:
                continue
            about = f"named lights, each with its spectrum, in place of lux: {', '.join(names_of_lights())}"
            about += f"; see 'blurnoise lights'{default_text(','.join(cls.LIGHTS))}"
            yield SettingInfo("light", str, None, about, "NAME,...", cls.PANEL)
        yield from super()._settings()

    @classmethod
    def _arguments(cls, values: Mapping[str, Any]) -> dict[str, Any]:
        curve = None
        if SPECTRUM.key in values:
            stated, curve = spectra_of(values[SPECTRUM.key])
            values = {**values, SPECTRUM.key: stated}
        chosen = {each: _values(each, values[each.key]) for each in cls.AXES if each.key in values}
        replaced = {name for each in chosen for name in each.without}
        light = values.get("light") or ()
        if values.get("light") == "":
            raise ValueError("light = '': must be names, such as street,dusk")
        if light and LIGHT.key in values:
            raise ValueError("light, lux: must not be combined; a light has its own lux")
        if not light and LIGHT.key not in values and cls.LIGHTS:
            light = cls.LIGHTS
            if values.get("emitters"):  # which light the targets
                chosen.setdefault(HEADLAMP, (0.0,))
        if light:
            replaced.add(LIGHT.name)
        usual = {each: each.default for each in cls.AXES if each.default and each.name not in replaced}
        grid = {each.name: (usual | chosen)[each] for each in cls.AXES if each in usual | chosen}
        return {"grid": grid, "light": light, "own_spectrum": curve, **super()._arguments(values)}

    def values(self, name: str) -> tuple[float, ...]:
        """The values on an axis, increasing; none where the camera has its own."""
        return tuple(self.grid.get(name, ()))

    @property
    def beams(self) -> tuple[str, ...]:
        """The beams that light its pictures under some of its conditions."""
        names = [HEADLAMP.choice(value) for value in self.spanned.get(HEADLAMP.name, ())]
        return tuple(beam for beam in HEADLAMP.choices[1:] if beam in names)

    def check_headlamps(self, emitters: str | None) -> None:
        """Raise ``ValueError`` for settings that headlamps lack, or exclude. emitters: targets that are lamps."""
        if not self.beams:
            if stated := self.lit.to_dict():
                raise ValueError(f"{', '.join(stated)}: needs headlamp, low or high")
            return
        if emitters is not None:
            raise ValueError("headlamp, emitters: must not both light the targets")
        if self.values(LIGHT.name)[:1] == (0.0,):
            raise ValueError("headlamp: needs lux > 0; moonlight is 0.3")

    def _check_light(self) -> None:
        """Give the grid the lux of the lights. Raises ``ValueError`` where it has others."""
        if self.infrared is not None:
            from blurnoise.camera.spectra import check_infrared

            check_infrared(self.infrared)
            if self.beams:
                raise ValueError(
                    "infrared, headlamp: must not be combined; headlamps multiply all light of the scene"
                )
        if self.light:
            lux = tuple(light.lux for light in self.light)
            if not set(self.values(LIGHT.name)) <= set(lux):
                raise ValueError("light, illuminance_lux: must not be combined; a light has its own lux")
            object.__setattr__(self, "grid", {**self.grid, LIGHT.name: lux})
        if self.own_spectrum is None and self._own_index in self.values(SPECTRUM.name):
            raise ValueError(f"illuminant = {OWN_SPECTRUM}: needs a CSV file of nm and power, by its path")

    @property
    def _own_index(self) -> float:
        return SPECTRUM.choice_index(OWN_SPECTRUM)

    def light_at(self, illuminance_lux: float) -> Light | None:
        """The named light of that lux; None where the plan names none."""
        return next((light for light in self.light if light.lux == illuminance_lux), None)

    def of_light(self, values: Mapping[str, float]) -> dict[str, float]:
        """Values of a condition by axis, with those that its named light has on axes which the grid leaves out."""
        light = self.light_at(values[LIGHT.name]) if self.light else None
        if light is None:
            return dict(values)
        own = {name: getattr(light, name) for name in LIT if name not in self.grid}
        return {**{name: axis(name).choice_index(value) for name, value in own.items()}, **values}

    @property
    def spanned(self) -> dict[str, tuple[float, ...]]:
        """The grid, with the values that its named lights have on axes which it leaves out."""
        of_lights = [self.of_light({LIGHT.name: light.lux}) for light in self.light]
        names = dict.fromkeys(name for each in of_lights for name in each if name != LIGHT.name)
        further = {name: tuple(sorted({each[name] for each in of_lights})) for name in names}
        return {name: self.values(name) for name in self.grid} | further


def _values(of: Axis, given: Any) -> tuple[float, ...]:
    """The values of a setting. Raises ``ValueError`` that names it."""
    try:
        return of.values(given)
    except (TypeError, ValueError) as error:
        from blurnoise._core.checks import shown

        if not str(error).startswith("must"):
            raise
        raise ValueError(f"{of.key} = {shown(given)}: {error}") from None
