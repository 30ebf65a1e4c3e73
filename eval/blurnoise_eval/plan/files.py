"""Files of settings of the commands: a sweep's plan, a simulated picture's scene, an exposure program.

Options of the commands override the settings that they name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator

from blurnoise_eval import label_formats
from blurnoise_eval.plan.axes import AXES, GAIN, LIGHT, MOVES, VELOCITY, axis, with_defaults
from blurnoise_eval.plan.exposure_settings import ExposureSettings
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.plan.question import Question
from blurnoise_eval.plan.settings import Settings, Text, Texts, as_text, nested, setting
from blurnoise_eval.plan.typed import bounds

Cfa = Literal["none", "mono", "RGGB", "GRBG", "GBRG", "BGGR", "RCCB", "RCCC"]
MODEL_TIMEOUT_S = 60.0
NOT_TAKEN = "unused"
"""Of a scene whose lux are given: the photograph's own exposure does not count."""
_CAMERA = "a preset or a camera file (default: imx250c for colour pictures, imx250m for grey)"
_CFA = (
    "colour filters: RGGB, GRBG, GBRG, BGGR, RCCB or RCCC; mono: no colours; none: one sensor for each colour"
)
_Bounds = Annotated[Any, BeforeValidator(bounds)]


@dataclass(frozen=True)
class PlanFile(Settings):
    """A sweep: models, pictures, camera, plan, the question, and the workers."""

    KIND: ClassVar[str] = "plan of a sweep (blurnoise sweep, decide and measure --plan FILE)"

    plan: SweepPlan = nested(SweepPlan)
    camera: Text | None = setting(None, _CAMERA, "NAME|FILE")
    cfa: Cfa | None = setting(None, _CFA)
    question: Question = nested(Question)
    model: Texts = setting(
        (),
        "detector or text recogniser; repeat it to compare models. ppocr: PP-OCR of the package rapidocr, which "
        "reads the labelled boxes (default: the built-in stop-sign detector)",
        "M.onnx",
    )
    contract: Texts = setting(
        (),
        "how pictures enter the model and how its outputs are read, see 'blurnoise inspect --help'; one for all "
        "models, or one for each",
        "FILE|PRESET",
    )
    dictionary: Text | None = setting(None, "file with the characters of a text recogniser, one per line")
    model_timeout_s: float = setting(
        MODEL_TIMEOUT_S, "time limit for loading a model and for its first inference, s"
    )
    images: Text | None = setting(
        None,
        "folder of pictures; without labels, the targets are the model's detections in the original pictures",
        "DIR",
    )
    labels: Text | None = setting(
        None,
        label_formats.HELP,
        "FILE|DIR",
        names=("--coco",),
    )
    target: Texts = setting((), "use only this class, and the pictures with it; repeatable", "CLASS")
    limit: int | None = setting(None, "use only the first N pictures", "N")
    refine: bool = setting(
        True, "compute additional exposures near the ends of exposure windows; not for parts"
    )
    engine: Text = setting(
        "threads",
        "kind of workers; ray: on this machine, or on a cluster at address (default: threads)",
        "threads|processes|ray",
    )
    threads: int | None = setting(None, "number of workers (default: one per core)", "N")
    address: Text | None = setting(None, "Ray cluster, HOST:PORT or auto (default: this machine)")
    part: Text | None = setting(
        None, "compute only part K of N of the pictures; 'blurnoise merge' joins the runs", "K/N"
    )


@dataclass(frozen=True, kw_only=True)
class SceneFile(ExposureSettings):
    """One picture: its conditions, camera, light and moving objects."""

    KIND: ClassVar[str] = "scene (blurnoise simulate --scene FILE)"
    AXES = with_defaults(
        AXES,
        exposure_s=(0.01,),
        illuminance_lux=(100.0,),
        velocity_x_px_s=(0.0,),
        velocity_y_px_s=(0.0,),
        temperature_c=(25.0,),
    )
    PANEL = "Conditions: one number each"
    METAVAR = "NUMBER"

    camera: Text | None = setting(None, _CAMERA, "NAME|FILE")
    cfa: Cfa | None = setting(None, _CFA)
    line_time_us: float | None = setting(
        None, "time from row to row of a rolling shutter, µs; 0: global shutter (default: the camera's)"
    )
    taken: Text | None = setting(
        None,
        "exposure of the photograph, by which lux follow: time in s, ISO and f-number, such as 1/30,200,f2.8 "
        "(default: that of its EXIF, if lux and light are not given)",
        "S,ISO,F",
    )
    object: Text | None = setting(
        None,
        "moving object: the white part of a mask, or a rectangle in px. dx and dy move it if moves is targets, and "
        "the rest if moves is background; otherwise it moves by object_dx and object_dy",
        "MASK.png|X,Y,W,H",
    )
    object_dx: float = setting(0.0, "motion of the object to the right, px/s; dx moves the rest")
    object_dy: float = setting(0.0, "motion of the object down, px/s")
    plate: Text | None = setting(None, "picture of the scene without the object (default: inpainted)")
    emitters: Text | None = setting(
        None, "MASK.png:FACTOR: lamps; the white part of the mask is that much brighter"
    )
    pwm: Text | None = setting(
        None, "HZ,DUTY[,PHASE]: pulsed lamp; PHASE from 0 to 1 (default: drawn with the seed)"
    )
    pwm_mask: Text | None = setting(
        None, "mask whose white part the pulsed lamp lights (default: everything)"
    )
    hdr: Text | None = setting(
        None, "further captures of an HDR sensor, each shorter by its ratio; all are merged", "RATIO,..."
    )
    bit_depth: Annotated[Literal["8", "native"], BeforeValidator(as_text)] = setting(
        "8",
        "8: sRGB picture for viewing; native: digital numbers of the camera in a 16-bit PNG (default: 8)",
        "8|native",
    )
    fidelity: Literal["auto", "full"] = setting(
        "auto", "auto: skip stages that contribute less than tolerance_dn; full: all stages"
    )
    tolerance_dn: float = setting(0.1, "largest contribution that fidelity auto may skip, DN RMS")

    @classmethod
    def _arguments(cls, values: Mapping[str, Any]) -> dict[str, Any]:
        stated = LIGHT.key in values or values.get("light")
        if stated and values.get("taken") not in (None, NOT_TAKEN):
            raise ValueError("taken, lux: must not be combined; lux follow from how the photograph was taken")
        return super()._arguments({**values, "taken": NOT_TAKEN} if stated else values)

    def at(self) -> dict[str, float]:
        """The value of each axis, in SI units; of what is not stated nor the camera's, 0. Raises ``ValueError``."""
        found = dict.fromkeys((*VELOCITY, GAIN.name), (0.0,)) | self.spanned
        for name, values in found.items():
            if len(values) > 1:
                setting = "light" if name == LIGHT.name and self.light else axis(name).key
                raise ValueError(f"{setting}: must be one value; a sweep takes several")
        return {name: values[0] for name, values in found.items()}

    @property
    def moving(self) -> str:
        """The part of the picture that dx and dy move: all, targets or background."""
        return str(MOVES.choices[int(self.at().get(MOVES.name, 0.0))])


@dataclass(frozen=True)
class ProgramFile(Settings):
    """An exposure program: the question, lights, speeds and targets, and the limits of the camera."""

    KIND: ClassVar[str] = "exposure program (blurnoise program --plan FILE)"

    question: Question = nested(Question)
    model: Text | None = setting(None, "model of the run (default: the only one)", "NAME")
    lux: _Bounds | None = setting(
        None,
        "range of illuminance, lux, in steps of half a stop (default: that of the run)",
        "LOW:HIGH",
    )
    light: Text | None = setting(
        None, "named lights of the run's spectrum; the range between them, in place of lux", "NAME,..."
    )
    speeds: Text | None = setting(
        None,
        "speeds, px/s, and how often each occurs, see 'blurnoise motion' (default: those of the run, equally often)",
        "V:SHARE,...",
    )
    targets: Text | None = setting(
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
    anti_flicker: Annotated[Literal["50", "60"] | None, BeforeValidator(as_text)] = setting(
        None, "frequency of the mains, Hz; allows only exposures of whole flicker periods", "50|60"
    )
    led: bool = setting(
        False, "allow only exposures of 1/90 s or more, so that no pulse of an LED lamp is missed"
    )
    most_gain_db: float = setting(120.0, "largest gain, dB, if less than the camera's")
    line_time_us: float = setting(0.0, "line time of the sensor, µs; exposures are multiples of it")
    least_exposure_us: float | None = setting(None, "shortest exposure, µs (default: the line time, or 20)")
