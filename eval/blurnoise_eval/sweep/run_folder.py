"""A run folder: what makes two runs the same run, and everything in it that a report shows."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from blurnoise.camera import Camera
from blurnoise.exposure_table import FILE as CONDITIONS_FILE
from blurnoise_eval.datasets import Picture, PictureSet, UnreadablePicture, content
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.model_files import shown
from blurnoise_eval.grid.axes import named
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.grid.nodes import Plan
from blurnoise_eval.grid.parts import Part
from blurnoise_eval.report import RunData
from blurnoise_eval.report.findings import crossings_text, ego_text, path_text
from blurnoise_eval.scoring.criterion import PRECISIONS, Criterion
from blurnoise_eval.scoring.curves import Endurance, endurances, endurances_across, mean_auc
from blurnoise_eval.scoring.estimates import Estimate, ratio, through
from blurnoise_eval.scoring.estimates import mean_of as mean_of_estimates
from blurnoise_eval.scoring.exposure_window import Answer, answers, flat, natural
from blurnoise_eval.scoring.on_picture import Model
from blurnoise_eval.scoring.plane import mean_over_plane
from blurnoise_eval.scoring.score_surfaces import score_surfaces
from blurnoise_eval.scoring.standings import AtBest, standings
from blurnoise_eval.scoring.surfaces import Surface
from blurnoise_eval.store import queries
from blurnoise_eval.store.exports import has_json
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.sweep.asked import asked
from blurnoise_eval.sweep.blocks import cells_per_picture
from blurnoise_eval.sweep.coco_export import write_truth
from blurnoise_eval.sweep.met_conditions import met_conditions
from blurnoise_eval.sweep.run_scores import run_scores
from blurnoise_eval.sweep.run_surfaces import dark_below, grouped_surfaces, too_little
from blurnoise_eval.system.files import write_whole
from blurnoise_eval.system.machine import hardware, versions
from blurnoise_eval.system.tables import csv_lines

_UNTOUCHED = ("target_confidence", "ap50", "ar100", "false_positives_per_image", "calibration_error")
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
    if part is not None and part.count > 1:
        identity["part"] = str(part)
    identity = _as_json(identity)
    held = store.about("identity")
    if held is not None and held != identity and not queries.has_answers(store):
        store.clear()
        held = None
    if held is not None and held != identity:
        differing = [key for key in {**identity, **held} if held.get(key) != identity.get(key)]
        differing = [_contracts(held[key], identity[key]) if key == "model" else key for key in differing]
        raise _another(store, " and ".join(differing))
    for picture in _replaced(pictures, store):
        raise _another(store, f"picture {picture.name!r}")
    write_truth(pictures, store.folder)
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


def _another(store: Store, what: str) -> StoreError:
    return StoreError(
        f"run = {str(store.folder)!r}: holds a run with another {what}; "
        "choose another folder, or repeat that run's command to resume it"
    )


def _replaced(pictures: PictureSet, store: Store) -> Iterator[Picture]:
    """Pictures that are not what their cells were computed from; only where a file has changed it is read."""
    held = store.pictures()
    for picture in pictures:
        identity, before = held.get(picture.name, (picture.identity, ""))
        if identity == picture.identity:
            continue
        try:
            now = content(picture.load())
        except UnreadablePicture:
            now = ""
        if now != before:
            yield picture
        else:
            store.note_picture(picture.name, picture.identity, now)


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
    ``withheld``. Scores are kept in the store until cells are added. Raises :class:`StoreError` for a run that never
    began.
    """
    manifest = store.about("manifest")
    if manifest is None:
        raise StoreError(f"run = {str(store.folder)!r}: no sweep has begun here")
    order = {model["name"]: place for place, model in enumerate(manifest["models"])}
    by_size = criterion.score if criterion.score in PRECISIONS else None
    scores, performances, sized = run_scores(store, list(order), cluster, progress, by_size=by_size)
    found_answers: list[Answer] = []
    found_endurances: list[Endurance] = []
    at_best = {name: AtBest() for name in order}
    withheld: list[dict[str, Any]] = []
    dark = dark_below(Camera.from_dict(manifest["camera"]))
    every = score_surfaces(sized, criterion.kept) if by_size else grouped_surfaces(store, criterion, cluster)
    for alike in on_lines(store, every):
        if too_little(alike[0]):
            names = ("model", "group", "n_targets", "reference")
            withheld.append({name: getattr(alike[0], name) for name in names})
            continue
        for surface in alike:
            at_best[surface.model].add(surface)
            found_answers += answers(surface, criterion, dark)
            found_endurances += endurances(surface.every(1 if surface.open is None else _FINE), criterion)
        if alike[0].open is None:
            found_endurances += endurances_across(alike, criterion)
    # stable: settings and velocities stay in their order
    found_answers.sort(key=lambda each: (order[each.model], natural(each.group)))
    found_endurances.sort(key=lambda each: (order[each.model], natural(each.group)))
    standing = standings(at_best)
    learnt = store.learnt()
    for model in manifest["models"]:
        model["non_finite_values"] = learnt["non_finite_values"].get(model["name"], 0)
    manifest |= {"criterion": criterion.row(), "threshold": criterion.level, "withheld": withheld}
    manifest["plan"] = store.about("identity")["plan"]
    manifest |= {"cluster": cluster, "wall_s": learnt["wall_s"], **_counts(store)}
    manifest["missing_cells"] = _missing_cells(store, manifest["images"]["count"])
    manifest["json_left_out"] = not has_json(store)
    manifest["warnings"] = [*manifest["images"]["notes"], *_warnings(store, manifest)]
    return RunData(
        manifest=manifest,
        models=[
            _summary(store, model, scores, performances, found_endurances) | standing[model["name"]]
            for model in manifest["models"]
        ],
        scores=scores,
        groups=queries.groups(store),
        skipped=store.skipped(),
        answers=[each.row() for each in found_answers],
        endurances=[each.row() for each in found_endurances],
        examples=list(_examples(store, manifest)),
    )


def write_tables(data: RunData, folder: Path) -> list[Path]:
    """Write answers.csv, scores.csv (a row per model and condition), curves.csv (a row per curve), models.csv, and
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
    ):
        columns = list(rows[0]) if rows else []
        lines = csv_lines(columns, map(named, rows))
        write_whole(folder / name, (line.encode("utf-8") for line in lines))
        written.append(folder / name)
    met = json.dumps(met_conditions(data.scores, data.manifest), allow_nan=False)
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
    if "grid" in plan:
        per_picture = cells_per_picture(SweepPlan(**{**plan, "trajectory": None}))
    else:
        batches = asked(store)
        n_pictures = batches[-1].n_pictures if batches else 0
        per_picture = 1 + plan["repeats"] * sum(len(batch.conditions) for batch in batches)
    return (n_pictures - len(store.skipped())) * per_picture - queries.count_cells_of_read(store)


def _summary(
    store: Store,
    model: dict[str, Any],
    scores: list[dict[str, Any]],
    performances: list[Estimate],
    curves: list[Endurance],
) -> dict[str, Any]:
    """One row of the table of models. mPC: mean over the conditions but the untouched, all weighted alike;
    uniform: over the plane that they cover, whatever the grid.

    P, mPC and rPC have intervals over clusters of pictures, each left out of the whole measure.
    """
    told = [
        (row, each)
        for row, each in zip(scores, performances, strict=True)
        if row["model"] == model["name"] and each.value is not None
    ]
    own = [row for row in scores if row["model"] == model["name"]]
    p = next((each for row, each in told if row["clean"]), Estimate(None))
    exposed = [(row, each) for row, each in told if not row["clean"]]
    mpc = mean_of_estimates([each for _, each in exposed])
    uniform = through([each for _, each in exposed], partial(_over_plane, [row for row, _ in exposed]))
    rpc = ratio(mpc, p)
    held = [each for each in curves if each.model == model["name"]]
    untouched = next((row for row in own if row["clean"]), {})
    latency = model.get("latency", {})
    return {
        "model": model["name"],
        "kind": model["kind"],
        "measure": "AP" if model["kind"] == "detector" else "exact match",
        **p.columns("p", (0.0, 1.0)),
        **mpc.columns("mpc", (0.0, 1.0)),
        **rpc.columns("rpc", None),
        **uniform.columns("mpc_uniform", (0.0, 1.0)),
        "auc_exposure": mean_auc(held, "exposure_s"),
        "auc_blur": mean_auc(held, "blur_px"),
        **{
            f"{name}{end}": untouched.get(f"{name}{end}")
            for name in _UNTOUCHED
            for end in ("", "_low", "_high")
        },
        "latency_ms": latency.get("median_ms"),
        "latency_p95_ms": latency.get("p95_ms"),
        "latency_threads": latency.get("threads"),
    }


def _over_plane(rows: Sequence[Mapping[str, Any]], values: Sequence[float]) -> float | None:
    of_row = iter(values)  # in the order of the rows
    return mean_over_plane(rows, lambda row: next(of_row))


def _examples(store: Store, manifest: dict[str, Any]) -> Iterator[dict[str, Any]]:
    classes = {model["name"]: model["contract"].get("classes", []) for model in manifest["models"]}
    for cell in queries.examples(store):
        found = cell.pop("detections").leading
        rows = zip(found.boxes_xyxy.tolist(), found.scores.tolist(), found.class_ids.tolist(), strict=True)
        names = classes[cell["model"]]
        yield {
            **cell,
            "path": str(store.folder / cell["example"]),
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
        f"{each['model']}, {each['group']}: in the untouched pictures it reaches {each['reference']:.2g} in sum over "
        "the targets, too little to say what is kept of it"
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


def _unsourced(values: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if key != "sources"}


def _as_json(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _as_json(entry) for key, entry in value.items()}
    return [_as_json(entry) for entry in value] if isinstance(value, (list, tuple)) else value
