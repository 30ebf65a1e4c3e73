"""What a sweep is told, all of it: a plan file, of which the command's options override the parts they name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, make_dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from blurnoise_eval.grid.axes import AXES, Axis
from blurnoise_eval.grid.settings import Settings, setting

if TYPE_CHECKING:
    from blurnoise.motion.ego import Vehicle
    from blurnoise.scene.metering import AutoExposure
    from blurnoise_eval.grid.conditions import SweepPlan
    from blurnoise_eval.grid.objects import Objects

Cfa = Literal["none", "mono", "RGGB", "GRBG", "GBRG", "BGGR", "RCCB", "RCCC"]
WHAT, ENOUGH, WHO = "What to run", "What is enough", "Who computes"
CONDITIONS = "Conditions, each as 1,5,10, start:stop:step or low:high"
MODEL_TIMEOUT_S = 60.0


def with_axes(
    usual: Mapping[str, str] | None = None,
    metavar: str = "LIST",
    panel: str = CONDITIONS,
    axes: tuple[Axis, ...] | None = None,
) -> Any:
    """Settings with a field for each axis, named as its option; usual: what it is unless stated, by that name, in
    place of what a sweep tests."""
    fields, axes = [], AXES if axes is None else axes
    for each in axes:
        default = each.default_text if usual is None else usual.get(each.key, "")
        about = f"{each.about}; auto: {each.auto}" if each.auto else each.about
        about = f"{about} (default: {default})" if default else about
        kind = "NAME" if each.choices and metavar == "NUMBER" else metavar
        shown = f"auto|{kind}" if each.automatic else kind
        made = setting(None, about, shown, panel=panel, check=each.values)
        fields.append((each.key, "float | str | list[float | str] | None", made))
    return make_dataclass("Axes", fields, bases=(Settings,), frozen=True, namespace={"AXES": axes})


@dataclass(frozen=True)
class Enough(Settings):
    """What is enough: of a sweep, and of an exposure program."""

    keep: float | None = setting(
        None,
        "of what the same model reaches on the original pictures (default on pictures of your own: 0.9)",
        "SHARE",
        panel=ENOUGH,
    )
    threshold: float | None = setting(
        None, "in place of keep: of the score itself (default on rendered pictures: 0.6)", "C", panel=ENOUGH
    )
    score: str | None = setting(
        None,
        "target_confidence, detection_rate, recall@0.1 (at 0.1 false alarms per original picture), ap50, ap, or of "
        "text exact_match (default: target_confidence, of texts of your own exact_match)",
        "NAME",
        panel=ENOUGH,
        complete="scores",
    )
    cluster: str | None = setting(
        None,
        "pictures in whose names this regular expression finds the same count as one, such as frames of a drive "
        "(default: each picture for itself)",
        "REGEX",
    )


@dataclass(frozen=True)
class PlanFile(with_axes(), Enough):  # type: ignore[misc]  # its fields are those of the table
    """A sweep: what runs, under which conditions, what is enough, who computes."""

    KIND: ClassVar[str] = "plan of a sweep (blurnoise sweep, decide and quality --plan FILE)"

    model: tuple[str, ...] = setting(
        (),
        "a detector or a text recogniser; 'blurnoise inspect M.onnx' says how it is read; ppocr: PP-OCR of the "
        "installed package rapidocr in known boxes, ppocr-find: in text that it finds; several stand side by side "
        "(default: the built-in detector)",
        "M.onnx",
        panel=WHAT,
    )
    contract: tuple[str, ...] = setting(
        (),
        "how pictures enter the model and what its classes are: a JSON or YAML file, or a preset, and what differs; "
        "see 'blurnoise inspect --help'; one for all models, or one for each",
        "FILE|PRESET",
        panel=WHAT,
        complete="families",
    )
    dictionary: str | None = setting(None, "a file with a recogniser's characters, a line each")
    text_detector: str | None = setting(
        None, "a network (PP-OCR's) that finds text before it is read; without it the known boxes are read"
    )
    model_timeout_s: float = setting(
        MODEL_TIMEOUT_S, "how long loading a model, and its first answer, may take, s"
    )
    images: str | None = setting(
        None,
        "a folder; what is found when clean counts as target. With --labels: the folder of its pictures",
        "DIR",
        panel=WHAT,
    )
    labels: str | None = setting(
        None,
        "COCO instances, YOLO's data.yaml or folder, BDD100K's JSON, or PP-OCR's texts (.txt): the file shows which",
        "FILE|DIR",
        panel=WHAT,
        names=("--coco",),
    )
    split: str | None = setting(None, "of YOLO's data.yaml (default: val, else train)")
    target: tuple[str, ...] = setting(
        (), "only this class, and pictures with it", "CLASS", panel=WHAT, complete="classes"
    )
    keep_empty: bool = setting(False, "with target: pictures without it count by what is found in them")
    limit: int | None = setting(None, "only the first N pictures", "N", panel=WHAT)
    max_megapixels: float = setting(100.0, "larger pictures are skipped, and named; up to 178")
    camera: str | None = setting(
        None,
        "a preset or a file; see 'blurnoise cameras' (default: of the pictures)",
        "NAME|FILE",
        panel=WHAT,
        complete="cameras",
    )
    cfa: Cfa | None = setting(
        None,
        "colour filters in place of the camera's: none (a sensor for each colour), mono (one for all), RGGB, GRBG, "
        "GBRG, BGGR, RCCB or RCCC",
    )
    objects: Objects | None = setting(
        None, "what moves for itself (moves: targets, background), and its boxes"
    )
    vehicle: Vehicle | None = setting(None, "of the camera that drives (ego_kmh)")
    auto_exposure: AutoExposure | None = setting(None, "limits of exposures and gains that the camera sets")
    trajectory: str | None = setting(
        None,
        "what pictures do beside their velocity: FILE.csv, shake:PX (each picture's own, over the longest exposure), "
        "or sine:PX,HZ[,DEG]",
    )
    grey_anchor: str | None = setting(
        None,
        "what of a picture is 18 % reflectance: mean, pNN (a percentile) or x0,y0,x1,y1 (default: its brightness is "
        "taken for reflectance)",
    )
    repeats: int | None = setting(None, "noise fields per picture (default: 1; of charts 2)")
    seed: int = setting(0, "of the noise, and of the order in which decide takes pictures")
    refine: bool = setting(
        True, "compute more exposures about ends of windows and the exposure to use; a part refines nothing"
    )
    engine: str = setting(
        "threads",
        "threads over one session of each model; processes, each with its own; ray: on this machine or a cluster",
        "threads|processes|ray",
        panel=WHO,
        complete="engines",
    )
    threads: int | None = setting(
        None, "how many of them, pictures at a time (default: every core)", "N", panel=WHO
    )
    address: str | None = setting(
        None,
        "for ray: HOST:PORT of a cluster that runs, or auto (default: one on this machine, for as long as it takes)",
    )
    part: str | None = setting(
        None,
        "only the Kth of N parts of the pictures, by their names; 'blurnoise merge' joins the runs",
        "K/N",
        panel=WHO,
    )

    @classmethod
    def records(cls) -> dict[str, Any]:
        """Types of fields that are imported when a file is read."""
        from blurnoise.motion.ego import Vehicle
        from blurnoise.scene.metering import AutoExposure
        from blurnoise_eval.grid.objects import Objects

        return {"Objects": Objects, "Vehicle": Vehicle, "AutoExposure": AutoExposure}

    def grid(self, usual: Mapping[str, str] = {}) -> dict[str, tuple[float, ...]]:
        """Values by axis, in SI: those that are stated, else the usual ones, by the name of their field."""
        stated = {each: getattr(self, each.key) for each in self.AXES}
        replaced = {name for each, values in stated.items() if values is not None for name in each.without}
        grid = {}
        for each, values in stated.items():
            values = usual.get(each.key) if values is None else values
            if values is not None:
                grid[each.name] = each.values(values)
            elif each.default and each.name not in replaced:
                grid[each.name] = each.default
        return grid

    def sweep_plan(self, usual: Mapping[str, str] = {}, repeats: int = 1) -> SweepPlan:
        """What is computed; usual: values, and repeats, where none are stated."""
        from blurnoise_eval.grid.conditions import SweepPlan

        records: Any = {"objects": self.objects, "auto_exposure": self.auto_exposure, "ego": self.vehicle}
        return SweepPlan(
            self.grid(usual),
            repeats=repeats if self.repeats is None else self.repeats,
            seed=self.seed,
            grey_anchor=self.grey_anchor,
            trajectory=self.trajectory,
            **{name: record for name, record in records.items() if record is not None},
        )
