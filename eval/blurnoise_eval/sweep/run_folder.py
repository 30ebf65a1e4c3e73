"""A run folder: what makes two runs the same run, and everything in it that a report shows."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from blurnoise.optics.camera import Camera
from blurnoise.training.table import FILE as CONDITIONS_FILE
from blurnoise_eval.datasets import Picture, PictureSet, UnreadablePicture, source_content, source_identity
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.model_files import shown
from blurnoise_eval.grid.axes import named
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.grid.nodes import Plan
from blurnoise_eval.grid.objects import Objects
from blurnoise_eval.grid.parts import Part
from blurnoise_eval.report import RunData
from blurnoise_eval.report.findings import crossings_text, ego_text, path_text
from blurnoise_eval.scoring.clusters import repeated
from blurnoise_eval.scoring.criterion import PRECISIONS, Criterion
from blurnoise_eval.scoring.curves import Endurance, endurances, endurances_across
from blurnoise_eval.scoring.exposure_window import Answer, answers, flat, natural
from blurnoise_eval.scoring.on_picture import Model
from blurnoise_eval.scoring.recommendation import curves, recommendations
from blurnoise_eval.scoring.score_surfaces import score_surfaces
from blurnoise_eval.scoring.surfaces import Surface
from blurnoise_eval.store import queries
from blurnoise_eval.store.documents import Stated
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.sweep.asked import asked
from blurnoise_eval.sweep.blocks import cells_per_picture
from blurnoise_eval.sweep.coco_export import write_truth
from blurnoise_eval.sweep.met_conditions import met_conditions
from blurnoise_eval.sweep.model_rows import model_rows
from blurnoise_eval.sweep.refining import exposures_of_grid
from blurnoise_eval.sweep.run_scores import run_scores
from blurnoise_eval.sweep.run_surfaces import (
    dark_below,
    grouped_surfaces,
    models_withheld,
    run_averages,
    too_little,
)
from blurnoise_eval.system.files import write_whole
from blurnoise_eval.system.machine import hardware, versions
from blurnoise_eval.system.tables import csv_lines

_FINE = 12  # predicted exposures for each curve over blur
_LISTED = 8  # labels that a warning names
Grouped = Iterator[list[Surface]]


def open_run(
    store: Store,
    models: Sequence[Model],
    camera: Camera,
    pictures: PictureSet,
    plan: Plan,
    facts: dict[str, Any],
    *,
    whole: PictureSet | None = None,
    part: Part | None = None,
) -> None:
    """Note in the store what the run is; a store that holds another run's answers is refused.

    One without any answer, of a first attempt with the wrong model or pictures, is taken over.
    ``facts``: what else the report shows (command, threads). part: which of the pictures of ``whole`` these are.
    Raises :class:`StoreError` that lists what differs, ``ValueError`` for two models of one name.
    """
    names = [model.name for model in models]
    if len(set(names)) < len(names):
        raise ValueError(f"model = {names}: names must differ, since results are told apart by them")
    identity = {
        "model": [
            {"name": model.name, "sha256": model.sha256, "contract": _unsourced(model.contract.to_dict())}
            for model in models
        ],
        "camera": _unsourced(camera.to_dict()),
        "plan": plan.to_dict(),
        "pictures": _digest(repr([picture.name for picture in whole or pictures])),
        "choice of targets": _digest(repr([picture.targets for picture in whole or pictures])),
    }
    if plan.cuts:
        identity["annotations"] = _annotations(whole or pictures)
    if part is not None and part.count > 1:
        identity["part"] = str(part)
    identity = _as_json(identity)
    held = store.about("identity")
    if held is not None and held != identity and not queries.has_answers(store):
        store.clear()
        held = None
    if held is not None and held != identity:
        differing = [key for key in {**identity, **held} if held.get(key) != identity.get(key)]
        told: dict[str, Callable[..., str]] = {"model": _contracts, "camera": _cameras}
        differing = [told[key](held[key], identity[key]) if key in told else key for key in differing]
        raise _another(store, " and ".join(differing))
    if queries.has_answers(store) and (other := other_software(computed_by(store), [versions()])):
        raise _another(store, other)
    for picture in _replaced(pictures, plan.objects, store):
        raise _another(
            store, f"picture {picture.name!r}{' or its plate' * (plan.objects.plates is not None)}"
        )
    write_truth(pictures, store.folder)
    store.computes_with(versions())
    store.set_about("identity", identity)
    before = {model["name"]: model for model in (store.about("manifest") or {"models": []})["models"]}
    store.set_about(
        "manifest",
        {
            "title": f"{', '.join(names)} seen through {camera.name}",
            "models": [{**before.get(model.name, {}), **_about(model, pictures)} for model in models],
            "camera": camera.to_dict(),
            "images": {
                "kind": pictures.kind,
                "source": pictures.source,
                "count": len(pictures),
                "labelled": pictures.labelled,
                "notes": list(pictures.notes),
                "chosen": pictures.chosen,
            },
            "seed": plan.seed,
            "grey_anchor": plan.grey_anchor,
            "trajectory": None if plan.path is None else path_text(*plan.path),
            "ego": None if plan.ego is None else ego_text(plan.ego),
            "crossings": crossings_text(plan.objects),
            "versions": versions(),
            "hardware": hardware(),
            **facts,
        },
    )


def _contracts(held: list[dict[str, Any]], asked: list[dict[str, Any]]) -> str:
    """'model', or where the files are the same which fields of their contracts differ."""
    if [(one["name"], one["sha256"]) for one in held] != [(one["name"], one["sha256"]) for one in asked]:
        return "model"
    pairs = [(one["contract"], other["contract"]) for one, other in zip(held, asked, strict=True)]
    fields = {
        name: None
        for one, other in pairs
        for name in {**one, **other}
        if name not in one or name not in other or one[name] != other[name]
    }
    return f"contract of the same model ({', '.join(fields)})"


def _cameras(held: dict[str, Any], asked: dict[str, Any]) -> str:
    """'camera' and both names, or where these are the same which fields differ."""
    if held["name"] != asked["name"]:
        return f"camera (it has {held['name']}, this is {asked['name']}; --camera names one)"
    return f"camera ({', '.join(name for name in held if held[name] != asked.get(name))})"


def computed_by(store: Store) -> list[Mapping[str, str]]:
    """Versions of the software that computed the run's cells; where these state none, the run's own."""
    return [*store.software().values()] or [(store.about("manifest") or {}).get("versions", {})]


def other_software(held: Sequence[Mapping[str, str]], asked: Sequence[Mapping[str, str]]) -> str | None:
    """'software' with the versions that differ; None where none do. What an old run does not say is not compared."""
    told = {
        f"{name} {version} there, {other[name]} here": None
        for one in held
        for other in asked
        for name, version in one.items()
        if version != other.get(name, version)
    }
    return f"software ({', '.join(told)})" if told else None


def _another(store: Store, what: str) -> StoreError:
    return StoreError(
        f"run = {str(store.folder)!r}: holds a run with another {what}; "
        "choose another folder, or repeat that run's command to resume it"
    )


def _replaced(pictures: PictureSet, objects: Objects, store: Store) -> Iterator[Picture]:
    """Those that, or whose plates, are not what their cells were computed from; only where a file has changed it is
    read."""
    held = store.pictures()
    for picture in pictures:
        if picture.name not in held:
            continue
        before, identity = held[picture.name][1], source_identity(picture, objects)
        if identity == held[picture.name][0]:
            continue
        try:
            now = source_content(picture, picture.load(), objects)
        except UnreadablePicture:
            now = ""
        if now != before:
            yield picture
        else:
            store.note_picture(picture.name, identity, now)


def _about(model: Model, pictures: PictureSet) -> dict[str, Any]:
    contract = model.contract.to_dict()
    unknown: list[str] = []
    if isinstance(model, Detector):
        contract["input_size_px"] = list(model.input_size_px)
        unknown = sorted(set(pictures.categories) - set(model.contract.classes))
    return {
        "name": model.name,
        "kind": "detector" if isinstance(model, Detector) else "reader",
        "unknown_labels": unknown,
        "file": shown(model.path),
        "sha256": model.sha256,
        "contract": contract,
    }


def read_run(
    store: Store,
    criterion: Criterion,
    *,
    cluster: str | None = None,
    progress: Callable[[int], None] = lambda scores: None,
    on_lines: Callable[[Store, Grouped], Grouped] = lambda store, measured: measured,
) -> RunData:
    """Everything that the report of this run shows; ``progress`` is told of each condition scored.

    cluster: a pattern on pictures' names, as :func:`~blurnoise_eval.scoring.clusters.cluster_of` takes it. on_lines:
    what is made of the surfaces that were measured, those of one model and group together.

    Groups of which the model knows too little to say what it keeps have no answers; the manifest lists them as
    ``withheld``, models that detect next to nothing as ``withheld_models``. Scores are kept in the store until cells
    are added. Raises :class:`StoreError` for a run that never began.
    """
    manifest = store.about("manifest")
    if manifest is None:
        raise StoreError(f"run = {str(store.folder)!r}: no sweep has begun here")
    order = Stated({model["name"]: place for place, model in enumerate(manifest["models"])})
    by_size = criterion.score if criterion.score in PRECISIONS else None
    scores, performances, sized = run_scores(store, list(order), cluster, progress, by_size=by_size)
    found_answers: list[Answer] = []
    found_endurances: list[Endurance] = []
    known: list[Surface] = []
    withheld: list[dict[str, Any]] = []
    unfit = models_withheld(manifest, scores)
    dark = dark_below(Camera.from_dict(manifest["camera"]))
    monotone = manifest.get("trajectory") is None
    grid_s = exposures_of_grid(store.about("identity")["plan"])
    every = score_surfaces(sized, criterion.kept) if by_size else grouped_surfaces(store, criterion, cluster)
    for alike in on_lines(store, every):
        if alike[0].model in unfit:
            continue
        if too_little(alike[0]):
            names = ("model", "group", "n_targets", "reference", "clean")
            withheld.append({name: getattr(alike[0], name) for name in names})
            continue
        for surface in alike:
            known.append(surface)
            found_answers += answers(surface, criterion, dark, monotone=monotone)
            thinned = surface if surface.open is None else surface.at(surface.exposures_s[::_FINE])
            found_endurances += endurances(thinned, criterion, grid_s)
        if alike[0].open is None:
            on_grid = [surface.at(grid_s) for surface in alike] if grid_s else alike
            found_endurances += endurances_across(on_grid, criterion)
    # stable: settings and velocities stay in their order
    found_answers.sort(key=lambda each: (order[each.model], natural(each.group)))
    found_endurances.sort(key=lambda each: (order[each.model], natural(each.group)))
    reached = run_averages(store, known, criterion.level)
    learnt = store.learnt()
    for model in manifest["models"]:
        model["non_finite_values"] = learnt["non_finite_values"].get(model["name"], 0)
    manifest |= {
        "criterion": criterion.row(),
        "threshold": criterion.level,
        "withheld": withheld,
        "withheld_models": unfit,
    }
    manifest["plan"] = store.about("identity")["plan"]
    manifest["software"] = store.software()
    manifest |= {"cluster": cluster, "wall_s": learnt["wall_s"], **_counts(store)}
    if not manifest["images"]["labelled"]:
        manifest["targets_found"] = queries.labels_when_clean(store)
    manifest["missing_cells"] = _missing_cells(store, manifest["images"]["count"])
    manifest["refined"] = sum(len(batch.conditions) for batch in asked(store)) if grid_s else 0
    rendered = manifest["images"]["kind"] == "rendered"
    manifest["repeated"] = None if rendered else repeated(store.looks(), cluster)
    manifest["warnings"] = [*manifest["images"]["notes"], *_warnings(store, manifest)]
    return RunData(
        manifest=manifest,
        models=model_rows(
            manifest["models"], scores, performances, found_endurances, grid_s, manifest["images"]["labelled"]
        ),
        scores=scores,
        groups=queries.groups(store),
        skipped=store.skipped(),
        answers=[each.row() for each in found_answers],
        endurances=[each.row() for each in found_endurances],
        examples=list(_examples(store, manifest)),
        recommendations=[row for each in reached for row in recommendations(each)],
        averages=[row for each in reached for row in curves(each)],
    )


def write_tables(data: RunData, folder: Path) -> list[Path]:
    """Write answers.csv, scores.csv (a row per model and condition), curves.csv (a row per curve), models.csv,
    recommendations.csv (the exposure to use: for all conditions, each light, each light and speed), and
    conditions.json, which the training augmentation draws from."""
    curves = [
        {name: value for name, value in row.items() if name not in ("x", "confidence")}
        for row in data.endurances
    ]
    written = []
    for name, rows in (
        ("answers.csv", [flat(row) for row in data.answers]),
        ("scores.csv", data.scores),
        ("curves.csv", curves),
        ("models.csv", data.models),
        ("recommendations.csv", data.recommendations),
    ):
        columns = list(rows[0]) if rows else []
        lines = csv_lines(columns, map(named, rows))
        write_whole(folder / name, (line.encode("utf-8") for line in lines))
        written.append(folder / name)
    met = json.dumps(met_conditions(data.scores, data.manifest, data.recommendations), allow_nan=False)
    write_whole(folder / CONDITIONS_FILE, met.encode("utf-8"))
    return [*written, folder / CONDITIONS_FILE]


_TOLD = ("label", "confidence", "truth", "text", "read_confidence")


def _counts(store: Store) -> dict[str, Any]:
    """Numbers of cells and targets, median times, and what models failed on."""
    return {
        **queries.counts(store),
        "simulate_ms": queries.median_simulate_ms(store),
        "errors": queries.errors(store),
    }


def _missing_cells(store: Store, n_pictures: int) -> int:
    """How many of the plan's cells are not there, those of skipped pictures apart."""
    plan = store.about("identity")["plan"]
    batches = asked(store)
    chosen: int = plan["repeats"] * sum(len(batch.conditions) for batch in batches)
    if "grid" in plan:
        per_picture = chosen + cells_per_picture(SweepPlan(**{**plan, "trajectory": None}))
    else:
        n_pictures = batches[-1].n_pictures if batches else 0
        per_picture = 1 + chosen
    return (n_pictures - len(store.skipped())) * per_picture - queries.count_cells_of_read(store)


def _examples(store: Store, manifest: dict[str, Any]) -> Iterator[dict[str, Any]]:
    classes = {model["name"]: model["contract"].get("classes", []) for model in manifest["models"]}
    for cell in queries.examples(store):
        found = cell.pop("detections").leading
        rows = zip(found.boxes_xyxy.tolist(), found.scores.tolist(), found.class_ids.tolist(), strict=True)
        names = classes[cell["model"]]
        yield {
            **cell,
            "path": str(store.file(cell["example"])),
            "detections": [
                {"box_xyxy": box, "score": score, "label": names[class_id]} for box, score, class_id in rows
            ],
            "targets": [
                {
                    "box_xyxy": [row[edge] for edge in ("x0", "y0", "x1", "y1")],
                    **{name: row[name] for name in _TOLD},
                }
                for row in queries.targets_of(store, cell["cell_id"], cell["model"])
            ],
        }


def _warnings(store: Store, manifest: dict[str, Any]) -> list[str]:
    warnings = [
        f"{each['model']}, {each['group']}: its targets score {each['clean'] or 0.0:.2g} on average in the original "
        "pictures, too little to say what is kept of it"
        for each in manifest["withheld"]
    ]
    for model in manifest["models"]:
        if unknown := model["unknown_labels"]:
            named = ", ".join(unknown[:_LISTED]) + (" …" if len(unknown) > _LISTED else "")
            warnings.append(
                f"{model['name']}: does not know {len(unknown)} of the labels ({named}); nothing counts of them"
            )
        without = queries.without_targets(store, model["name"])
        if without["pictures"]:
            warnings.append(
                f"{model['name']}: {without['pictures']} pictures have no target that the model knows; they "
                f"count for no curve, but by what is found in them (first: {without['first']})"
            )
    return warnings


def _digest(text: str) -> str:
    return hashlib.blake2b(text.encode("utf-8", "backslashreplace"), digest_size=16).hexdigest()


HARMLESS = ("id",)
"""Fields of annotations that reach neither a pixel nor a box."""


def _annotations(pictures: PictureSet) -> str:
    """What data sets say of targets beside their boxes, such as polygons that they are cut out by."""
    digest = hashlib.blake2b(digest_size=16)
    for picture in pictures:
        for target in picture.targets or ():
            said = sorted(
                (name, repr(value)) for name, value in target.annotation.items() if name not in HARMLESS
            )
            digest.update(repr(said).encode("utf-8", "backslashreplace"))
    return digest.hexdigest()


def _unsourced(values: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if key != "sources"}


def _as_json(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _as_json(entry) for key, entry in value.items()}
    return [_as_json(entry) for entry in value] if isinstance(value, (list, tuple)) else value
