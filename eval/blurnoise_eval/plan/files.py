"""Files of settings of the commands: a sweep's plan, a simulated picture's scene, an exposure program.

Options of the commands override the settings that they name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, make_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from blurnoise_eval import label_formats
from blurnoise_eval.plan.axes import AXES, MOVES, VELOCITY, Axis, axis, bounds
from blurnoise_eval.plan.question import Question
from blurnoise_eval.plan.settings import Settings, setting

if TYPE_CHECKING:
    from blurnoise.camera.colour import PictureTone
    from blurnoise.motion.ego import Vehicle
    from blurnoise.scene.metering import AutoExposure
    from blurnoise_eval.plan.conditions import SweepPlan
    from blurnoise_eval.plan.objects import Objects

Cfa = Literal["none", "mono", "RGGB", "GRBG", "GBRG", "BGGR", "RCCB", "RCCC"]
SCENE = {"exposure_ms": "10", "lux": "100", "dx": "0", "dy": "0", "temperature_c": "25", "gain": "0"}
"""Default conditions of a simulated picture, by setting."""
MODEL_TIMEOUT_S = 60.0
TONES = ("srgb", "linear", "filmic")
TONE_CHOICES = (
    "srgb, linear, filmic, a camera file with 'tone:', or points light:value such as 0:0,0.2:0.5,1:1"
)
LISTS = "Conditions: numbers such as 1,5,10, or a range low:high"
LAMPS = ("emitters", "pwm", "pwm_mask", "pwm_phase")
"""Settings of a plan that make its lamps."""


class _Axes(Settings):
    """Settings with a field for each axis, values in SI units."""

    AXES: ClassVar[tuple[Axis, ...]]
    DEFAULTS: ClassVar[Mapping[str, str]]

    def grid(self, usual: Mapping[str, str] = {}) -> dict[str, tuple[float, ...]]:
        """Values of each axis in SI units: from the file, else from ``usual``, else the defaults."""
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
    """A class of settings with a field for each axis. defaults: by setting, instead of those of a sweep."""
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
    """The tone curve of a picture from a name, points (such as "0:0,0.2:0.5,1:1"), or a camera file with ``tone``.

    Raises ``ValueError``.
    """
    from blurnoise._core.files import read_document
    from blurnoise.camera.colour import picture_tone

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


def phases(given: object) -> tuple[float, ...]:
    """Phases of a pulsed lamp: "random", none, or numbers. Raises ``ValueError``."""
    from blurnoise_eval.plan.lamps import phases_of

    return phases_of(given)


@dataclass(frozen=True)
class Taking(Settings):
    """How pictures are taken, in a sweep or one picture at a time."""

    camera: str | None = setting(
        None,
        "a preset or a camera file (default: imx250c for colour pictures, imx250m for grey)",
        "NAME|FILE",
    )
    cfa: Cfa | None = setting(
        None,
        "colour filters: RGGB, GRBG, GBRG, BGGR, RCCB or RCCC; mono: no colours; none: one sensor for each colour",
    )
    vehicle: Vehicle | None = setting(
        None, "position and orientation of the camera on a vehicle that drives (ego_kmh)"
    )
    auto_exposure: AutoExposure | None = setting(
        None, "limits of exposure time and gain where these are auto"
    )
    trajectory: str | None = setting(
        None,
        "camera motion in addition to dx and dy: a file of positions or rotation rates, a random shake, or a "
        "sinusoidal vibration",
        "FILE.csv|shake:PX|sine:PX,HZ[,DEG]",
    )
    grey_anchor: str | None = setting(
        None,
        "part of a picture that reflects 18 %: its mean, a percentile, or a region in px (default: none; brightness "
        "is used as reflectance)",
        "mean|pNN|x0,y0,x1,y1",
    )
    picture_tone: PictureTone = setting(
        "srgb",
        "tone curve of the input pictures, which is removed first; linear: values are proportional to light "
        "(default: srgb)",
        "srgb|linear|filmic|FILE.yaml|POINTS",
        read=tone_of,
    )
    hdr_white: float = setting(
        1.0,
        "light that is white in the merged picture of a camera with several captures, in multiples of white",
    )
    seed: int = setting(0, "seed of the noise, and of the order of pictures in decide (default: 0)", "N")


@dataclass(frozen=True)
class PlanFile(with_axes(LISTS, "LIST"), Taking, Question):  # type: ignore[misc]  # its fields are those of the table
    """A sweep: models, pictures, conditions, the criterion, and the workers."""

    KIND: ClassVar[str] = "plan of a sweep (blurnoise sweep, decide and quality --plan FILE)"

    model: tuple[str, ...] = setting(
        (),
        "detector or text recogniser; repeat it to compare models. ppocr: PP-OCR of the package rapidocr, which "
        "reads the labelled boxes; ppocr-find: it also finds the text (default: the built-in stop-sign detector)",
        "M.onnx",
    )
    contract: tuple[str, ...] = setting(
        (),
        "how pictures enter the model and how its outputs are read, see 'blurnoise inspect --help'; one for all "
        "models, or one for each",
        "FILE|PRESET",
    )
    dictionary: str | None = setting(None, "file with the characters of a text recogniser, one per line")
    text_detector: str | None = setting(
        None, "PP-OCR network that finds text (default: none; the labelled boxes are read)"
    )
    model_timeout_s: float = setting(
        MODEL_TIMEOUT_S, "time limit for loading a model and for its first inference, s"
    )
    images: str | None = setting(
        None,
        "folder of pictures; without labels, the targets are the model's detections in the original pictures",
        "DIR",
    )
    labels: str | None = setting(
        None,
        label_formats.HELP,
        "FILE|DIR",
        names=("--coco",),
    )
    target: tuple[str, ...] = setting(
        (), "use only this class, and the pictures with it; repeatable", "CLASS"
    )
    limit: int | None = setting(None, "use only the first N pictures", "N")
    objects: Objects | None = setting(None, "speeds and boxes of objects, where targets or background move")
    emitters: str | None = setting(
        None,
        "targets:FACTOR: the targets are lamps, FACTOR times brighter than in the picture",
        "targets:FACTOR",
    )
    pwm: str | None = setting(None, "a pulsed lamp: frequency in Hz, and duty cycle", "HZ,DUTY")
    pwm_mask: str | None = setting(
        None, "targets: only the targets are pulsed lamps (default: they light the whole scene)", "targets"
    )
    pwm_phase: tuple[float, ...] | None = setting(
        None,
        "phase of the lamp when an exposure begins, 0 to 1: random for each picture and repeat (default), or "
        "values for all pictures, over which scores are averaged",
        "random|LIST",
        read=phases,
    )
    repeats: int | None = setting(None, "number of repeats with other noise (default: 1; 2 for charts)")
    refine: bool = setting(
        True, "compute additional exposures near the ends of exposure windows; not for parts"
    )
    engine: str = setting(
        "threads",
        "kind of workers; ray: on this machine, or on a cluster at address (default: threads)",
        "threads|processes|ray",
    )
    threads: int | None = setting(None, "number of workers (default: one per core)", "N")
    address: str | None = setting(None, "Ray cluster, HOST:PORT or auto (default: this machine)")
    part: str | None = setting(
        None, "compute only part K of N of the pictures; 'blurnoise merge' joins the runs", "K/N"
    )

    def __post_init__(self) -> None:
        """The question is checked once options have replaced what the file says of it."""

    def sweep_plan(self, usual: Mapping[str, str] = {}, repeats: int = 1) -> SweepPlan:
        """The plan of a sweep. usual, repeats: defaults for what the file leaves out."""
        from blurnoise_eval.plan.conditions import SweepPlan
        from blurnoise_eval.plan.lamps import Lamps

        names = ("seed", "grey_anchor", "picture_tone", "trajectory", "objects", "auto_exposure", "hdr_white")
        held: Any = {"ego": self.vehicle} | {name: getattr(self, name) for name in names}
        held["repeats"] = repeats if self.repeats is None else self.repeats
        if lamps := {name: value for name in LAMPS if (value := getattr(self, name)) is not None}:
            held["lamps"] = Lamps(**lamps)
            held["repeats"] *= max(1, len(held["lamps"].phases))
        return SweepPlan(
            self.grid(usual), **{name: value for name, value in held.items() if value is not None}
        )


@dataclass(frozen=True)
class SceneFile(with_axes("Conditions: one number each", "NUMBER", SCENE), Taking):  # type: ignore[misc]
    """One picture: its conditions, camera, light and moving objects."""

    KIND: ClassVar[str] = "scene (blurnoise simulate --scene FILE)"

    line_time_us: float | None = setting(
        None, "time from row to row of a rolling shutter, µs; 0: global shutter (default: the camera's)"
    )
    object: str | None = setting(
        None,
        "moving object: the white part of a mask, or a rectangle in px. dx and dy move it if moves is targets, and "
        "the rest if moves is background; otherwise it moves by object_dx and object_dy",
        "MASK.png|X,Y,W,H",
    )
    object_dx: float = setting(0.0, "motion of the object to the right, px/s; dx moves the rest")
    object_dy: float = setting(0.0, "motion of the object down, px/s")
    plate: str | None = setting(None, "picture of the scene without the object (default: inpainted)")
    illuminant: str = setting(
        "D55", "spectrum of the light: D50, D55, D65, D75, planck:KELVIN, or a CSV file of nm and power"
    )
    emitters: str | None = setting(
        None, "MASK.png:FACTOR: lamps; the white part of the mask is that much brighter"
    )
    pwm: str | None = setting(
        None, "HZ,DUTY[,PHASE]: pulsed lamp; PHASE from 0 to 1 (default: drawn with the seed)"
    )
    pwm_mask: str | None = setting(None, "mask whose white part the pulsed lamp lights (default: everything)")
    hdr: str | None = setting(
        None, "further captures of an HDR sensor, each shorter by its ratio; all are merged", "RATIO,..."
    )
    bit_depth: Literal["8", "native"] = setting(
        "8",
        "8: sRGB picture for viewing; native: digital numbers of the camera in a 16-bit PNG (default: 8)",
        "8|native",
    )
    fidelity: Literal["auto", "full"] = setting(
        "auto", "auto: skip stages that contribute less than tolerance_dn; full: all stages"
    )
    tolerance_dn: float = setting(0.1, "largest contribution that fidelity auto may skip, DN RMS")

    def at(self) -> dict[str, float]:
        """The value of each axis, in SI units, from the file or from ``SCENE``. Raises ``ValueError``."""
        found = dict.fromkeys(VELOCITY, (0.0,)) | self.grid()
        for name, values in found.items():
            if len(values) > 1:
                raise ValueError(f"{axis(name).key}: must be one value; a sweep takes several")
        return {name: values[0] for name, values in found.items()}

    @property
    def moving(self) -> str:
        """The part of the picture that dx and dy move: all, targets or background."""
        return str(MOVES.choices[int(self.at().get(MOVES.name, 0.0))])


@dataclass(frozen=True)
class ProgramFile(Question):
    """An exposure program: lights, speeds and targets, the criterion, and the limits of the camera."""

    KIND: ClassVar[str] = "exposure program (blurnoise program --plan FILE)"

    def __post_init__(self) -> None:
        """The question is checked once options have replaced what the file says of it."""

    model: str | None = setting(None, "model of the run (default: the only one)", "NAME")
    lux: tuple[float, float] | None = setting(
        None,
        "range of illuminance, lux, in steps of half a stop (default: that of the run)",
        "LOW:HIGH",
        read=bounds,
    )
    speeds: str | None = setting(
        None,
        "speeds, px/s, and how often each occurs, see 'blurnoise motion' (default: those of the run, equally often)",
        "V:SHARE,...",
    )
    targets: str | None = setting(
        None, "WORD:SHARE,...: weights of groups, by a part of their name (default: equal)"
    )
    objective: Literal["expected", "worst", "tail"] = setting(
        "expected",
        "what to maximise over speeds and targets; expected: the mean; worst: the minimum; tail: the mean of the "
        "worst cases (default: expected)",
        "expected|worst|tail",
    )
    tail: float = setting(0.2, "share of the cases that the objective tail averages")
    fps: float = setting(30.0, "frames per second; limits the exposure time (default: 30)", "N")
    readout_ms: float = setting(0.0, "time in each frame for the read-out, ms (default: 0)", "MS")
    anti_flicker: Literal["50", "60"] | None = setting(
        None, "frequency of the mains, Hz; allows only exposures of whole flicker periods", "50|60"
    )
    led: bool = setting(
        False, "allow only exposures of 1/90 s or more, so that no pulse of an LED lamp is missed"
    )
    most_gain_db: float = setting(120.0, "largest gain, dB, if less than the camera's")
    line_time_us: float = setting(0.0, "line time of the sensor, µs; exposures are multiples of it")
    least_exposure_us: float | None = setting(None, "shortest exposure, µs (default: the line time, or 20)")
