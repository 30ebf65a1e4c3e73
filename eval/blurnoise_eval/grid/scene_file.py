"""What a simulated picture is told, all of it: a scene file, of which the command's options override the parts they
name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

from blurnoise_eval.grid.axes import AXES, MOVES
from blurnoise_eval.grid.plan_file import Cfa, PlanFile, with_axes
from blurnoise_eval.grid.settings import setting

if TYPE_CHECKING:
    from blurnoise.motion.ego import Vehicle
    from blurnoise.scene.metering import AutoExposure

MOVING, PICTURE = "What moves", "The picture"
USUAL = {"exposure_ms": "10", "lux": "100", "dx": "0", "dy": "0", "temperature_c": "25", "gain": "0"}
"""Where a picture is taken unless told otherwise, by the name of the axis's field."""


@dataclass(frozen=True)
class SceneFile(with_axes(usual=USUAL, metavar="NUMBER", panel="Conditions, a number each")):  # type: ignore[misc]
    """A picture: its conditions, camera, light, and what moves."""

    KIND: ClassVar[str] = "scene (blurnoise simulate --scene FILE)"

    camera: str | None = setting(
        None, "a preset or a file; see 'blurnoise cameras'", "NAME|FILE", panel=PICTURE, complete="cameras"
    )
    cfa: Cfa | None = setting(None, "colour filters in place of the camera's, as in a plan")
    line_time_us: float | None = setting(
        None,
        "rolling shutter: from row to row (default: the camera's); 0: a global shutter",
        "US",
        panel=MOVING,
    )
    trajectory: str | None = setting(
        None,
        "a path beside dx and dy: places or rates of rotation over time, a shake of the seed, a vibration[,DEG]",
        "FILE.csv|shake:PX|sine:PX,HZ",
        panel=MOVING,
    )
    object: str | None = setting(
        None,
        "what moves for itself, white in a mask or a rectangle in px: with --moves targets by dx and dy, with "
        "background what is around it does; else by object_dx and object_dy of the file",
        "MASK.png|X,Y,W,H",
        panel=MOVING,
    )
    object_dx: float = setting(0.0, "motion of the object to the right, px/s; dx is the rest's")
    object_dy: float = setting(0.0, "motion of the object down, px/s")
    plate: str | None = setting(
        None, "a picture of the scene without the object (default: invented from around it)"
    )
    vehicle: Vehicle | None = setting(None, "of the camera that drives (ego_kmh)")
    auto_exposure: AutoExposure | None = setting(None, "limits of exposures and gains that the camera sets")
    illuminant: str = setting(
        "D55", "the light's spectrum: D50, D55, D65, D75, planck:2856, or a CSV file of nm and power"
    )
    grey_anchor: str | None = setting(
        None,
        "what of the picture is 18 % reflectance: its mean, a percentile, a region in px (default: its brightness is "
        "taken for reflectance)",
        "mean|pNN|x0,y0,x1,y1",
        panel=PICTURE,
    )
    encoding: Literal["srgb", "linear"] = setting(
        "srgb",
        "of IMAGE; linear: light, 1 is white and more is allowed (.hdr, float .tiff, 16 bits)",
        "srgb|linear",
        panel=PICTURE,
    )
    emitters: str | None = setting(
        None, "MASK.png:FACTOR: what sends out light, so many times the picture's where the mask is white"
    )
    pwm: str | None = setting(
        None, "HZ,DUTY[,PHASE]: a lamp of pulses; its phase, 0 to 1, is drawn from the seed if not given"
    )
    pwm_mask: str | None = setting(None, "a mask of where that lamp is, white alone (default: everywhere)")
    hdr: str | None = setting(
        None,
        "more captures, shorter by these ratios, each after the last, fused (default: the camera's)",
        "RATIO,...",
        panel=PICTURE,
    )
    hdr_white: float = setting(1.0, "the light that is white in a fused picture, times white")
    bit_depth: Literal["8", "native"] = setting(
        "8",
        "8: the sRGB picture to look at; native: the camera's digital numbers in a 16-bit PNG",
        "8|native",
        panel=PICTURE,
    )
    seed: int = setting(0, "of the noise", "N", panel=PICTURE)
    fidelity: Literal["auto", "full"] = setting(
        "auto", "auto: leave out what changes less than the tolerance; full: model everything"
    )
    tolerance_dn: float = setting(0.1, "what auto may leave out, DN RMS")

    records = PlanFile.records

    def at(self) -> dict[str, float]:
        """The value on each axis that is stated or usual, in SI, by the axis's name. Raises ``ValueError``."""
        found = {}
        for each in AXES:
            stated = getattr(self, each.key)
            if stated is None and each.key not in USUAL:
                continue
            values = each.checked(each.values(USUAL[each.key] if stated is None else stated))
            if len(values) > 1:
                raise ValueError(f"{each.key}: must be one value here; a sweep takes several")
            found[each.name] = values[0]
        return found

    @property
    def moving(self) -> str:
        """What moves by dx and dy: all, targets or background."""
        return str(MOVES.choices[int(self.at().get(MOVES.name, 0.0))])
