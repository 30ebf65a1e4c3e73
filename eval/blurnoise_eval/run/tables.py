"""The tables of a run: its scores, answers, curves and recommendations, and what else its page shows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from blurnoise_eval.answers.clusters import repeated
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.curves import endurances, endurances_across
from blurnoise_eval.answers.exposure_window import answers, natural
from blurnoise_eval.answers.model_rows import model_rows
from blurnoise_eval.answers.recommendation import average_curve, recommendations
from blurnoise_eval.answers.rows import AnswerRow, CurveRow, RecommendationRow
from blurnoise_eval.answers.settling import SETTLED
from blurnoise_eval.report.findings import reflectance
from blurnoise_eval.report.run import RunData
from blurnoise_eval.report.words import counted
from blurnoise_eval.run.grid_cells import Cells
from blurnoise_eval.run.light_lines import light_lines
from blurnoise_eval.run.outlook import outlooks
from blurnoise_eval.run.score_tables import (
    dark_below,
    models_withheld,
    on_lines,
    run_averages,
    run_scores,
    score_tables,
)
from blurnoise_eval.run.setup import Setup
from blurnoise_eval.store import queries
from blurnoise_eval.store.columns import UNKNOWN
from blurnoise_eval.store.rows import Example, LabelledBox, ScoreRow
from blurnoise_eval.store.store import Store
from blurnoise_eval.system.tables import plain

_FINE = 12  # predicted exposures for each curve over blur
_LISTED = 8  # labels that a warning names
_PREDICTED = "Answers and curves are predicted from these. The intervals include the error of prediction."
Row = dict[str, Any]


def tables_of(
    store: Store,
    setup: Setup,
    criterion: Criterion,
    progress: Callable[[int], None] = lambda scores: None,
) -> RunData:
    """All tables of a run; ``progress`` is called for each condition scored.

    Groups of which the model finds too few in the original pictures have no answers; the manifest lists them as
    ``withheld``, and models that detect next to nothing as ``withheld_models``. Scores are kept in the store until
    cells are added.
    """
    scored = run_scores(store, setup, criterion, progress)
    scores = [condition.row for condition in scored]
    unfit = models_withheld(setup.manifest, scores)
    measured = score_tables(store, setup, criterion, scored)
    tables = [table for table in on_lines(setup, measured) if table.model not in unfit]
    known = [table for table in tables if not table.reference_too_low]
    order = {name: index for index, name in enumerate(setup.models)}
    dark = dark_below(setup.camera)
    answer_rows: list[AnswerRow] = []
    curve_rows: list[CurveRow] = []
    # sorted() is stable: settings and velocities stay in their order
    for table in sorted(known, key=lambda table: (order[table.model], natural(table.group))):
        exposures, grid_s = table.conditions["exposure_s"], setup.grid_exposures_s
        answer_rows += answers(table, criterion, dark, monotone=setup.monotone, grid_s=grid_s)
        if table.prediction_cov is not None:
            thinned = table.take(np.isin(exposures, np.unique(exposures)[::_FINE]))
            curve_rows += endurances(thinned, criterion, grid_s)
        else:
            curve_rows += endurances(table, criterion, grid_s)
            of_grid = table.take(np.isin(exposures, grid_s)) if grid_s else table
            curve_rows += endurances_across(of_grid, criterion)
    averages = run_averages(store, setup, criterion, known)
    if setup.searched and not setup.predicted:
        cells = Cells.of(setup.plan, setup.camera, known)
        of_models = outlooks(cells, setup.camera, averages, known)
        averages = [
            replace(of, untested_gain=outlook.untested_gain, bracketed=outlook.bracketed)
            for of, outlook in zip(averages, of_models, strict=True)
        ]
    withheld = [
        {name: getattr(table, name) for name in ("model", "group", "n_targets", "reference", "clean")}
        for table in tables
        if table.reference_too_low
    ]
    manifest = _manifest(store, setup, criterion)
    manifest |= {"withheld": withheld, "withheld_models": unfit}
    manifest["light_spread_ev"] = queries.light_spread_ev(store, setup.camera.sensor.gain_max_db)
    manifest["light"] = _light(store, setup, scores)
    manifest["warnings"] = [*manifest["images"]["notes"], *_warnings(store, manifest)]
    models = model_rows(
        manifest["models"],
        scored,
        curve_rows,
        setup.grid_exposures_s,
        setup.labelled,
    )
    recommended = [row for average in averages for row in recommendations(average)]
    manifest["predicted"] = setup.predicted
    if not setup.searched:
        manifest["warnings"] += strategy_sentences(setup)
    else:
        manifest["searched"] = strategy_sentences(setup, recommended)
        # means over a grid's conditions, which a search does not visit evenly
        models = [replace(model, mpc=UNKNOWN, rpc=UNKNOWN) for model in models]
    return RunData(
        manifest,
        models,
        scores,
        store.skipped(),
        answer_rows,
        curve_rows,
        list(_examples(store, setup)),
        recommended,
        [average_curve(average) for average in averages],
    )


def of_page(tables: RunData, setup: Setup) -> RunData:
    """The tables that the page shows: after a search without the scores of its nodes, which lie on no grid."""
    if not setup.predicted:
        return tables
    return replace(tables, scores=[row for row in tables.scores if row.conditions.original])


def summary_of(tables: RunData, setup: Setup) -> Row:
    """What summary.json says of a run, beside the places of its files."""
    manifest = tables.manifest
    return {
        "cells": manifest["n_cells"],
        **{name: manifest[name] for name in ("missing_cells", "refined")},
        "skipped": [row.columns() for row in tables.skipped],
        **{name: manifest[name] for name in ("criterion", "threshold", "withheld", "withheld_models")},
        "targets_found": manifest.get("targets_found", {}),
        "reflectance": reflectance(tables),
        "light": manifest["light"],
        **{name: manifest[name] for name in ("cluster", "software")},
        "models": [row.columns() for row in tables.models],
        "answers": [{name: plain(value) for name, value in row.columns().items()} for row in tables.answers],
        "decided": search_counts(setup),
    }


def search_counts(setup: Setup) -> Row | None:
    """The numbers of ``nodes``, ``pictures`` and ``cells`` of a search, and of ``grid_cells`` that the grid would
    need; ``because``: why the full grid was computed. None of a run without a search."""
    space = setup.search_space
    if space is None:
        return None
    repeats, n_pictures = setup.planned["repeats"], setup.manifest["images"]["count"]
    nodes = setup.chosen if setup.searched else space.grid_conditions
    return {
        "nodes": nodes,
        "pictures": n_pictures,
        "cells": nodes * n_pictures * repeats,
        "grid_cells": space.grid_conditions * n_pictures * repeats,
        "because": list(space.because),
    }


def strategy_sentences(setup: Setup, recommended: Sequence[RecommendationRow] = ()) -> list[str]:
    """How many conditions a search has computed, and what those that it left out may gain over the recommended
    exposures; or why it was the full grid. Nothing of other runs."""
    counts, space = search_counts(setup), setup.search_space
    if counts is None or space is None:
        return []
    if counts["because"]:
        reasons = "; ".join(counts["because"])
        return [f"The full grid of {counted(counts['nodes'], 'condition')} was computed: {reasons}."]
    sentence = (
        f"{counted(counts['nodes'], 'condition')} with {counted(counts['pictures'], 'picture')}: "
        f"{counted(counts['cells'], 'cell')}. A sweep computes the {space.grid_conditions} of the grid, and more "
        "when it refines."
    )
    if setup.predicted:
        return [sentence, _PREDICTED]
    if setup.has_whole_grid:
        return [sentence, "All of the grid was needed."]
    untested = [row.untested_gain for row in recommended if row.untested_gain is not None]
    if not untested:
        return [sentence]
    if max(untested) <= SETTLED:
        return [
            sentence,
            f"No exposure that was not tested promises more than {SETTLED:g} above those to use.",
        ]
    more = f"An exposure that was not tested may score {max(untested):.2f} more than one of those to use"
    if counts["nodes"] < space.grid_conditions:
        return [sentence, f"The search has not finished. {more}. The same 'blurnoise decide' continues it."]
    return [sentence, f"{more}."]


def _manifest(store: Store, setup: Setup, criterion: Criterion) -> Row:
    """The run's manifest, with counts, times, software, and the failures of models, from all of its rows."""
    non_finite = queries.non_finite_values(store)
    models = [{**note, "non_finite_values": non_finite.get(name, 0)} for name, note in setup.models.items()]
    labelled, rendered = setup.labelled, setup.manifest["images"]["kind"] == "rendered"
    looks = {name: picture.look for name, picture in store.pictures().items()}
    manifest: Row = {
        **setup.manifest,
        "models": models,
        "plan": setup.planned,
        "software": store.software(),
        "cluster": criterion.cluster,
        "wall_s": setup.wall_s,
        **queries.counts(store),
        "simulate_ms": queries.median_simulate_ms(store),
        "errors": queries.errors(store),
        **({} if labelled else {"targets_found": queries.labels_when_clean(store)}),
        "missing_cells": setup.missing_cells(store),
        "repeated": None if rendered else repeated(looks, criterion.cluster),
        "criterion": criterion.row(),
        "threshold": criterion.level,
        "refined": setup.refined,
    }
    return manifest


def _light(store: Store, setup: Setup, scores: Sequence[ScoreRow]) -> list[str]:
    """What the lights of the run are, in lines. Raises ``StoreError`` for facts that no sweep writes."""
    tested = [row.conditions for row in scores if not row.conditions.original]
    try:
        return light_lines(setup, store.pictures(), queries.labels(store), tested)
    except ValueError as error:
        raise store.damaged("pictures.headlit", str(error)) from None


def _examples(store: Store, setup: Setup) -> Iterator[Example]:
    """The simulated pictures that the run keeps, with detections and targets."""
    for cell in queries.examples(store):
        leading, names = store.detections(cell.cell_id, cell.model).leading, setup.classes(cell.model)
        rows = zip(
            leading.boxes_xyxy.tolist(), leading.scores.tolist(), leading.class_ids.tolist(), strict=True
        )
        boxes = (LabelledBox(tuple(box), score, names[class_id]) for box, score, class_id in rows)
        targets = (row.target for row in queries.targets_of(store, cell.cell_id, cell.model))
        yield Example(cell, store.file(str(cell.example)), tuple(boxes), tuple(targets))


def _warnings(store: Store, manifest: Row) -> Iterator[str]:
    for group in manifest["withheld"]:
        yield (
            f"{group['model']}, {group['group']}: its targets score {group['clean'] or 0.0:.2g} on average in the "
            "original pictures, too little to say which share of it is kept"
        )
    for model in manifest["models"]:
        if unknown := model["unknown_labels"]:
            listed = ", ".join(unknown[:_LISTED]) + (" …" if len(unknown) > _LISTED else "")
            yield f"{model['name']}: does not know {len(unknown)} of the labels ({listed}), which are left out"
        count, first = queries.without_targets(store, model["name"])
        if count:
            yield (
                f"{model['name']}: {count} pictures have no target that the model knows "
                f"(first: {first}). Only their false positives count"
            )
