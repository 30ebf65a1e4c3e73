"""Files of settings of the commands: a sweep's plan, a simulated picture's scene, an exposure program.

Options of the commands override the settings that they name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, make_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from blurnoise_eval.grid.axes import AXES, MOVES, VELOCITY, Axis, axis, bounds
from blurnoise_eval.grid.settings import Settings, setting

if TYPE_CHECKING:
    from blurnoise.motion.ego import Vehicle
    from blurnoise.optics.colour import PictureTone
    from blurnoise.scene.metering import AutoExposure
    from blurnoise_eval.grid.conditions import SweepPlan
    from blurnoise_eval.grid.objects import Objects

Cfa = Literal["none", "mono", "RGGB", "GRBG", "GBRG", "BGGR", "RCCB", "RCCC"]
SCENE = {"exposure_ms": "10", "lux": "100", "dx": "0", "dy": "0", "temperature_c": "25", "gain": "0"}
"""Conditions of a simulated picture that are not specified, by the setting's name."""
MODEL_TIMEOUT_S = 60.0
TONES = ("srgb", "linear", "filmic")
TONE_CHOICES = (
    "srgb, linear, filmic, a camera's file with tone, or points light:value such as 0:0,0.2:0.5,1:1"
)
LISTS = "Conditions, each as 1,5,10 or low:high"


class _Axes(Settings):
    """Settings with a field for each axis, values in the column's unit."""

    AXES: ClassVar[tuple[Axis, ...]]
    DEFAULTS: ClassVar[Mapping[str, str]]

    def grid(self, usual: Mapping[str, str] = {}) -> dict[str, tuple[float, ...]]:
        """Values by axis, in SI: those of the file, else of ``usual``, by the setting, else the defaults."""
        stated = {each: getattr(self, each.key) for each in self.AXES}
        replaced = {name for each, values in stated.items() if values is not None for name in each.without}
        defaults = {each.key: self.DEFAULTS.get(each.key) for each in self.AXES if each.name not in replaced}
        for each in [each for each, values in stated.items() if values is None]:
            text = usual.get(each.key, defaults.get(each.key))
            stated[each] = None if text is None else each.values(text)
        return {each.name: values for each, values in stated.items() if values is not None}


def with_axes(
    panel: str, metavar: str, defaults: Mapping[str, str] | None = None, axes: tuple[Axis, ...] = ()
) -> Any:
    """The class of a table of axes; defaults: in place of a sweep's, by the setting's name. axes: default all."""
    axes = axes or AXES
    usual = defaults or {each.key: ",".join(map(each.typed, each.default)) for each in axes if each.default}
    made = []
    for each in axes:
        names = "" if defaults or not each.default_names else f": {', '.join(each.default_names)}"
        about = f"{each.about} (default: {usual[each.key]}{names})" if each.key in usual else each.about
        shown = f"auto|{metavar}" if each.automatic else "|".join(each.choices) or metavar
        field = setting(None, about, shown, panel=panel, read=each.values)
        made.append((each.key, "tuple[float, ...] | None", field))
    held = {"AXES": axes, "DEFAULTS": usual}
    return make_dataclass("Axes", made, bases=(_Axes,), frozen=True, namespace=held)


def tone_of(given: object) -> PictureTone:
    """A picture's tone curve: a name, points (as text "0:0,0.2:0.5,1:1"), or the ``tone`` of a camera's file.

    Raises ``ValueError``.
    """
    from blurnoise._core.files import read_document
    from blurnoise.optics.colour import picture_tone

    value: Any = given
    if isinstance(given, str) and ":" in given and not given.endswith((".yaml", ".yml", ".json")):
        value = [pair.split(":") for pair in given.split(",")]
    elif isinstance(given, str) and given not in TONES:
        try:
            held = read_document(Path(given))
        except OSError:
            raise ValueError(f"must be {TONE_CHOICES}") from None
        value = held.get("tone") if isinstance(held, Mapping) else None
        if value is None:
            raise ValueError(f"must be {TONE_CHOICES}; this file has no 'tone:'")
    try:
        return picture_tone(value, "picture_tone")
    except TypeError as error:
        raise ValueError(str(error)) from None


@dataclass(frozen=True)
class Taking(Settings):
    """How pictures are taken: of a sweep, and of a single picture."""

    camera: str | None = setting(None, "a preset or a file (default: by the pictures)", "NAME|FILE")
    cfa: Cfa | None = setting(
        None,
        "filters, RGGB, GRBG, GBRG, BGGR, RCCB or RCCC; mono: one for all; none: a sensor for each colour",
    )
    vehicle: Vehicle | None = setting(None, "of the camera that drives (ego_kmh)")
    auto_exposure: AutoExposure | None = setting(None, "limits of exposures and gains that the camera sets")
    trajectory: str | None = setting(
        None,
        "motion beside dx and dy: places or rates of rotation over time, a shake of the seed, or a vibration",
        "FILE.csv|shake:PX|sine:PX,HZ[,DEG]",
    )
    grey_anchor: str | None = setting(
        None,
        "18 % reflectance: the mean, a percentile, a region in px (default: brightness is taken for reflectance)",
        "mean|pNN|x0,y0,x1,y1",
    )
    picture_tone: PictureTone = setting(
        "srgb",
        "the pictures' own tone curve, taken out before they are exposed; linear: numbers are light",
        "srgb|linear|filmic|FILE.yaml|POINTS",
        read=tone_of,
    )
    seed: int = setting(0, "of the noise, and of the order in which decide takes pictures", "N")


@dataclass(frozen=True)
class Enough(Settings):
    """Which score is enough: of a sweep, and of an exposure program."""

    keep: float | None = setting(
        None, "share of the score on the original pictures that is enough (default on your own: 0.9)", "SHARE"
    )
    threshold: float | None = setting(
        None, "score that is enough, in place of keep (default on rendered pictures: 0.6)", "C"
    )
    score: str | None = setting(
        None,
        "target_confidence, detection_rate, recall@0.1 (at 0.1 false alarms per original picture), ap50, ap, or of "
        "text exact_match (default: target_confidence, of texts of your own exact_match)",
        "NAME",
    )
    cluster: str | None = setting(
        None, "pictures with the same match of a regular expression count as one: frames of a drive", "REGEX"
    )


@dataclass(frozen=True)
class PlanFile(with_axes(LISTS, "LIST"), Taking, Enough):  # type: ignore[misc]  # its fields are those of the table
    """A sweep: models, pictures, conditions, the score that is enough, and the workers."""

    KIND: ClassVar[str] = "plan of a sweep (blurnoise sweep, decide and quality --plan FILE)"

    model: tuple[str, ...] = setting(
        (),
        "a detector or text recogniser, see 'blurnoise inspect'; ppocr: PP-OCR of the package rapidocr in known "
        "boxes, ppocr-find: in text that it finds; several are compared (default: the built-in detector)",
        "M.onnx",
    )
    contract: tuple[str, ...] = setting(
        (),
        "how pictures enter the model and what its classes are, see 'blurnoise inspect --help'; one, or one for each",
        "FILE|PRESET",
    )
    dictionary: str | None = setting(None, "a file with a recogniser's characters, a line each")
    text_detector: str | None = setting(None, "PP-OCR's network that finds text (default: known boxes)")
    model_timeout_s: float = setting(MODEL_TIMEOUT_S, "for loading a model, and for its first answer, s")
    images: str | None = setting(None, "pictures; without --labels, targets are what is found in them", "DIR")
    labels: str | None = setting(
        None,
        "COCO instances, YOLO's data.yaml or folder, BDD100K's JSON, or PP-OCR's texts (.txt)",
        "FILE|DIR",
        names=("--coco",),
    )
    target: tuple[str, ...] = setting((), "only this class, and pictures with it", "CLASS")
    limit: int | None = setting(None, "only the first N pictures", "N")
    objects: Objects | None = setting(None, "objects that move (moves: targets, background), and their boxes")
    repeats: int | None = setting(None, "noise fields per picture (default: 1; of charts 2)")
    refine: bool = setting(True, "compute more exposures about ends of windows, but in parts")
    engine: str = setting("threads", "ray: on this machine, or a cluster at address", "threads|processes|ray")
    threads: int | None = setting(None, "how many workers (default: one per core)", "N")
    address: str | None = setting(None, "HOST:PORT of a Ray cluster, or auto (default: this machine)")
    part: str | None = setting(None, "a part of the pictures; 'blurnoise merge' joins the runs", "K/N")

    def sweep_plan(self, usual: Mapping[str, str] = {}, repeats: int = 1) -> SweepPlan:
        """The plan of a sweep; usual: values, and repeats, where the file has none."""
        from blurnoise_eval.grid.conditions import SweepPlan

        names = ("seed", "grey_anchor", "picture_tone", "trajectory", "objects", "auto_exposure")
        held: Any = {"ego": self.vehicle} | {name: getattr(self, name) for name in names}
        held["repeats"] = repeats if self.repeats is None else self.repeats
        return SweepPlan(
            self.grid(usual), **{name: value for name, value in held.items() if value is not None}
        )


@dataclass(frozen=True)
class SceneFile(with_axes("Conditions, a number each", "NUMBER", SCENE), Taking):  # type: ignore[misc]
    """A picture: its conditions, camera, light, and what moves."""

    KIND: ClassVar[str] = "scene (blurnoise simulate --scene FILE)"

    line_time_us: float | None = setting(None, "from row to row (default: the camera's); 0: global shutter")
    object: str | None = setting(
        None,
        "white in a mask, or a rectangle, px; with --moves targets dx and dy are its motion, with background that of "
        "all else; else object_dx and object_dy of the file are its own",
        "MASK.png|X,Y,W,H",
    )
    object_dx: float = setting(0.0, "motion of the object to the right, px/s; dx is the rest's")
    object_dy: float = setting(0.0, "motion of the object down, px/s")
    plate: str | None = setting(None, "a picture of the scene without the object (default: invented)")
    illuminant: str = setting("D55", "D50, D55, D65, D75, planck:2856, or a CSV file of nm and power")
    emitters: str | None = setting(None, "MASK.png:FACTOR: lamps, so many times brighter where it is white")
    pwm: str | None = setting(None, "HZ,DUTY[,PHASE]: a lamp of pulses; phase 0 to 1 (default: by the seed)")
    pwm_mask: str | None = setting(None, "a mask of where that lamp is, white alone (default: everywhere)")
    hdr: str | None = setting(None, "further captures, each shorter by its ratio, fused", "RATIO,...")
    hdr_white: float = setting(1.0, "the light that is white in a fused picture, times white")
    bit_depth: Literal["8", "native"] = setting(
        "8", "8: sRGB to look at; native: the camera's digital numbers, in a 16-bit PNG", "8|native"
    )
    fidelity: Literal["auto", "full"] = setting("auto", "auto: leave out what is within tolerance_dn")
    tolerance_dn: float = setting(0.1, "what auto may leave out, DN RMS")

    def at(self) -> dict[str, float]:
        """The value on each axis that the file or ``SCENE`` has, in SI, by the axis's name. Raises ``ValueError``."""
        found = dict.fromkeys(VELOCITY, (0.0,)) | self.grid()
        for name, values in found.items():
            if len(values) > 1:
                raise ValueError(f"{axis(name).key}: must be one value here; a sweep takes several")
        return {name: values[0] for name, values in found.items()}

    @property
    def moving(self) -> str:
        """What moves by dx and dy: all, targets or background."""
        return str(MOVES.choices[int(self.at().get(MOVES.name, 0.0))])


@dataclass(frozen=True)
class ProgramFile(Enough):
    """An exposure program: lights, speeds and targets, the score that is enough, and the camera's limits."""

    KIND: ClassVar[str] = "exposure program (blurnoise program --plan FILE)"

    model: str | None = setting(None, "of the run's models (default: its only one)", "NAME")
    lux: tuple[float, float] | None = setting(
        None, "lights, half a stop apart (default: those of the run)", "LOW:HIGH", read=bounds
    )
    speeds: str | None = setting(
        None,
        "px/s, see 'blurnoise motion', and how often each occurs (default: the run's, alike)",
        "V:SHARE,...",
    )
    targets: str | None = setting(None, "WORD:SHARE,...: by part of their name (default: all, alike)")
    objective: Literal["expected", "worst", "tail"] = setting(
        "expected",
        "over speeds and targets: their mean (expected), the worst, or the mean of the worst share (tail)",
        "expected|worst|tail",
    )
    tail: float = setting(0.2, "share of the cases, for the objective tail")
    fps: float = setting(30.0, "frames a second: an exposure ends before the next frame (default: 30)", "N")
    readout_ms: float = setting(0.0, "of each frame's time, for its read-out (default: 0)", "MS")
    anti_flicker: Literal["50", "60"] | None = setting(None, "Hz of the mains: whole periods alone", "50|60")
    led: bool = setting(False, "1/90 s or more, so that no pulse of an LED is missed")
    most_gain_db: float = setting(120.0, "largest gain, where that is less than the camera's")
    line_time_us: float = setting(0.0, "exposures are whole lines of the sensor")
    least_exposure_us: float | None = setting(None, "the sensor's shortest (default: its line time, or 20)")
