"""The page of failures: which targets a model finds at one exposure and misses at another, picture by picture.

Domain: boxes px; confidences 0 to 1, of targets that count as found from ``RunData.found_from`` on.
"""

from __future__ import annotations

import base64
import math
import re
import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import partial
from itertools import groupby
from operator import attrgetter, itemgetter
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.datasets import Picture, eight_bit
from blurnoise_eval.plan.axes import EXPOSURE, velocity_text
from blurnoise_eval.report.first_screen import can_be_seen
from blurnoise_eval.report.lights import lights_of_run
from blurnoise_eval.report.page import FAILURES, PICTURE_PX, TEMPLATES, jpeg, write_page
from blurnoise_eval.report.run import RunData
from blurnoise_eval.report.settings import TestedSettings, word
from blurnoise_eval.store import queries
from blurnoise_eval.store.columns import AxisValues
from blurnoise_eval.store.rows import TargetAnswer, TargetRow
from blurnoise_eval.store.store import Store

MOST_CODES = 2_000_000
"""Targets times conditions of a model, 3 bytes each; those whose confidence changes least are left out first."""
MOST_PICTURE_BYTES, MOST_PICTURE_PX = 9_000_000, 400_000_000
"""Of original pictures on the page, and of those that are opened: some seconds."""
MOST_CROPS, MOST_CROP_PX = 8, 16_000_000
"""Targets that are simulated again at A and B, and pixels simulated for them: half a second."""
_CROP_PX, _LEAST_CROP_PX, _AROUND = 240, 64, 1.6
# No confidence reaches it: 2 * 1000 + 1 is the largest code.
_NONE = 0xFFFF
Codes = NDArray[np.uint16]
Row = dict[str, Any]
Places = tuple[int, ...]


class PicturesOfRun(Protocol):
    """The pictures of a run, opened and simulated again. Both raise ``ValueError`` or ``OSError``."""

    def picture(self, name: str) -> Picture:
        """The original picture of a name."""

    def simulate(self, cell_id: str) -> NDArray[np.uint8]:
        """The picture of a cell, (H, W, 3), uint8, RGB."""


class _TestedConditions(NamedTuple):
    """axes: word and texts, exposure first; keys: every condition with its repeat; places: of each on the axes, None
    of the original pictures."""

    axes: list[tuple[str, list[str]]]
    keys: list[tuple[AxisValues, int]]
    places: list[Places | None]


class _Model(NamedTuple):
    """targets: rows in the original pictures. codes: by condition and target twice the confidence in thousandths, and
    1 more where it is found; ``_NONE`` where it was not evaluated."""

    name: str
    targets: list[TargetRow]
    codes: Codes
    n_left_out: int


class _OpeningView(NamedTuple):
    """What the page opens with: a model, the places of A and B, targets found at A alone, the greatest loss
    first. teaches: how much there is to see, greater is better."""

    model: int
    a: int
    b: int
    lost: list[int]
    teaches: tuple[float, ...]


def write_failures(store: Store, data: RunData, folder: Path, run: PicturesOfRun) -> Path:
    """Write ``folder``/failures.html, which works offline; returns its path. Raises ``OSError``.

    What the limits above leave out, and pictures that cannot be opened, are named on the page.
    """
    tested = _conditions(store, data)
    models = [_model(store, name, tested, data.found_from) for name in data.model_names]
    changes: dict[str, int] = {}
    for model in models:
        for row, change in zip(model.targets, _changes(model.codes).tolist(), strict=True):
            changes[row.image] = max(changes.get(row.image, 0), change)
    names = sorted(changes, key=lambda name: -changes[name])
    seen = {(row.model, row.conditions) for row in data.exposed_scores if can_be_seen(row)}
    views = (view for number, model in enumerate(models) for view in _views(number, model, tested, seen))
    opening = max(views, key=attrgetter("teaches"), default=None)
    sizes, (pictures, unopened) = store.pictures(), _pictures(run, names)
    page = folder / FAILURES
    # A page that shows pictures is worth more than a new one without: the data set may be on another machine now.
    if unopened and (standing := _pictures_of(page)) > len(pictures):
        warnings.warn(
            f"{page}: stays as it was, with {standing} pictures; {len(pictures)} of {len(names)} can be opened now "
            f"({unopened[0]}); --images names their folder",
            stacklevel=2,
        )
        return page
    number_of = {name: number for number, name in enumerate(names)}
    numbers = {
        "axes": [texts for _, texts in tested.axes],
        "conditions": tested.places,
        "pictures": [[name, *sizes[name][2:4], pictures.get(name)] for name in names],
        "models": [_packed(model, number_of) for model in models],
        "opening": opening and opening[:3],
        "crops": dict(_crops(store, run, models[opening.model], tested, opening)) if opening else {},
    }
    about = {
        "n_pictures": len(pictures),
        "n_left_out": sum(model.n_left_out for model in models),
        "unopened": unopened,
    }
    if unopened and not pictures:
        warnings.warn(f"{page}: has no pictures ({unopened[0]}); --images names their folder", stacklevel=2)
    template = TEMPLATES / "failures.html.j2"
    write_page(page, template, data=data, axes=tested.axes, failures=numbers, **about)
    return page


def _pictures_of(page: Path) -> int:
    """How many pictures a page shows that stands there already."""
    if not page.is_file():
        return 0
    with page.open("rb") as file:
        said = re.search(rb'<meta name="pictures" content="(\d+)">', file.read(1000))
    return int(said[1]) if said else 0


def _conditions(store: Store, data: RunData) -> _TestedConditions:
    recorded = {
        (columns.conditions[condition], repeat)
        for columns in (queries.target_columns(store, model) for model in data.model_names)
        for condition, repeat in set(zip(columns.condition.tolist(), columns.repeat.tolist(), strict=True))
    }
    exposed = [(at, repeat) for at, repeat in recorded if not at.original]
    axes: list[tuple[str, Any, Any]] = [("exposure", lambda key: key[0].exposure_s, EXPOSURE.text)]
    axes += [("speed", lambda key: key[0].velocity_px_s, velocity_text)]
    settings = TestedSettings((at for at, _ in exposed), lights_of_run(data.manifest))
    for axis in settings.axes:
        axes.append(
            (word(axis), lambda key, name=axis.name: key[0][name], partial(settings.value_text, axis))
        )
    axes += [("repeat", itemgetter(1), str)]
    shown, values = [], []
    for title, of, text in axes:
        every = sorted({of(key) for key in exposed})
        # An axis of one value would be a slider that cannot move; exposure is what A and B differ in.
        if title == "exposure" or len(every) > 1:
            shown.append((title, [text(value) for value in every]))
            values.append((of, {value: index for index, value in enumerate(every)}))
    placed = [
        (None if key[0].original else tuple(places[of(key)] for of, places in values), key)
        for key in recorded
    ]
    # The original pictures, which have no place on the axes, come first; the others follow the axes.
    placed.sort(key=lambda each: (each[0] is not None, each[0] or (), each[1][-1]))
    return _TestedConditions(shown, [key for _, key in placed], [places for places, _ in placed])


def _model(store: Store, name: str, tested: _TestedConditions, found_from: float) -> _Model:
    targets = list(queries.targets_when_clean(store, name))
    columns = queries.target_columns(store, name)
    row_of = {(row.image, row.target.target_id): index for index, row in enumerate(targets)}
    condition_of = {key: index for index, key in enumerate(tested.keys)}
    pictures, ids = (each.tolist() for each in (columns.picture, columns.target_id))
    row = [row_of.get((columns.pictures[at], target), -1) for at, target in zip(pictures, ids, strict=True)]
    places, repeats = columns.condition.tolist(), columns.repeat.tolist()
    at = [condition_of[columns.conditions[c], repeat] for c, repeat in zip(places, repeats, strict=True)]
    n_columns = len(targets) + 1  # the last is of targets that the original picture does not have
    codes = np.full((len(tested.keys), n_columns), _NONE, np.uint16)
    codes[at, row] = 2 * np.round(1000 * columns.confidence) + (columns.confidence >= found_from)
    codes = codes[:, :-1]
    # Stable, so that the page of a run is the same file each time it is written.
    order = np.argsort(-_changes(codes), kind="stable")[: MOST_CODES // max(1, len(codes))]
    return _Model(name, [targets[index] for index in order], codes[:, order], len(targets) - len(order))


def _changes(codes: Codes) -> NDArray[np.int64]:
    """Of each target the greatest difference between two conditions."""
    if not codes.size:
        return np.zeros(codes.shape[1], np.int64)
    known = codes != _NONE
    low, high = np.where(known, codes, _NONE).min(axis=0), np.where(known, codes, 0).max(axis=0)
    return np.asarray(np.maximum(high.astype(np.int64) - low, 0))


def _packed(model: _Model, number_of: Mapping[str, int]) -> Row:
    groups = sorted({row.target.group for row in model.targets})
    labels = sorted({row.target.label for row in model.targets})
    targets = [
        [number_of[row.image], groups.index(row.target.group), labels.index(row.target.label)]
        + [round(edge, 1) for edge in row.target.box_xyxy]
        for row in model.targets
    ]
    # Little-endian, as the browser reads it into a Uint16Array.
    codes = base64.b64encode(model.codes.astype("<u2").tobytes()).decode("ascii")
    return {"groups": groups, "labels": labels, "targets": targets, "codes": codes}


def _views(
    number: int, model: _Model, tested: _TestedConditions, seen: Collection[tuple[str, AxisValues]]
) -> Iterator[_OpeningView]:
    """For each light and speed the exposure at which most targets are found, against each other one."""
    at: dict[Places, list[int]] = {}
    for index, places in enumerate(tested.places):
        if places is not None:
            at.setdefault(places[1:], []).append(index)
    codes = model.codes.astype(int)
    found, known = codes % 2 == 1, model.codes != _NONE
    found &= known
    for same in at.values():
        # Of exposures that find as many, the one that is surest of them.
        a = max(same, key=lambda index: (int(found[index].sum()), int(codes[index][found[index]].sum())))
        for b in same:
            if b == a:
                continue
            lost = found[a] & known[b] & ~found[b]
            order = np.argsort(codes[b] - codes[a], kind="stable")
            at_a, at_b = tested.keys[a][0], tested.keys[b][0]
            # A white or black picture says only that it is. Motion blur by night is what an exposure is chosen
            # against: so a longer one comes before a shorter one, the dark before the bright, of these the nearest.
            both = all((model.name, each) in seen for each in (at_a, at_b))
            count, step = int(lost.sum()), (tested.places[b] or (0,))[0] - (tested.places[a] or (0,))[0]
            dark = -at_a.illuminance_lux
            teaches = count > 0, both, step > 0, min(count, 2), dark, count, -abs(step)
            yield _OpeningView(number, a, b, order[lost[order]].tolist(), teaches)


def _pictures(run: PicturesOfRun, names: Sequence[str]) -> tuple[dict[str, str], list[str]]:
    """The original pictures as small JPEGs, as far as the limits go; and what is wrong with the others."""
    opened, wrong, n_bytes, n_px = dict[str, str](), list[str](), 0, 0
    for name in names:
        if n_bytes > MOST_PICTURE_BYTES or n_px > MOST_PICTURE_PX:
            wrong.append(f"left out, so that the page stays below {2 * MOST_PICTURE_BYTES // 1_000_000} MB")
            continue
        try:
            image = eight_bit(run.picture(name).load())
        except (ValueError, OSError) as error:
            wrong.append(str(error))
            continue
        opened[name] = jpeg(_resized(image, PICTURE_PX / max(image.shape[:2])))
        n_bytes, n_px = n_bytes + len(opened[name]), n_px + image.shape[0] * image.shape[1]
    return opened, wrong


def _resized(image: NDArray[np.uint8], scale: float) -> NDArray[np.uint8]:
    size = max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale))
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_NEAREST
    return np.asarray(cv2.resize(image, size, interpolation=method), np.uint8)


def _crops(
    store: Store, run: PicturesOfRun, model: _Model, tested: _TestedConditions, view: _OpeningView
) -> Iterator[tuple[str, list[Any]]]:
    """By target and condition: the simulated picture around the target, and its box there in % of that."""

    def picture_of(target: int) -> str:
        return model.targets[target].image

    n_px = 0
    for name, group in groupby(sorted(view.lost[:MOST_CROPS], key=picture_of), picture_of):
        try:
            height, width = run.picture(name).load().shape[:2]
            for target in group:
                # Each target needs two simulated pictures, at A and at B.
                n_px += 2 * height * width
                if n_px > MOST_CROP_PX:
                    return
                cells = [
                    _cell(store, model, target, tested.keys[condition]) for condition in (view.a, view.b)
                ]
                around = _around([row for _, row in cells], (height, width))
                for condition, (cell_id, row) in zip((view.a, view.b), cells, strict=True):
                    yield f"{view.model}:{target}:{condition}", _crop(run.simulate(cell_id), around, row)
        except (ValueError, OSError):
            continue  # the page works without; _pictures says what is wrong with a picture


def _cell(store: Store, model: _Model, target: int, key: tuple[AxisValues, int]) -> tuple[str, TargetAnswer]:
    """The cell of a target's picture under a condition, and the model's answer for the target there."""
    row = model.targets[target]
    cell, *_ = queries.cells_at(store, model.name, key[0], row.image, key[1])
    rows = (each.target for each in queries.targets_of(store, cell.cell_id, model.name))
    return cell.cell_id, next(each for each in rows if each.target_id == row.target.target_id)


def _around(rows: Sequence[TargetAnswer], size: tuple[int, int]) -> tuple[int, int, int, int]:
    """A square (left, top, right, bottom) around the boxes, as far as the picture goes."""
    left, top = min(row.x0 for row in rows), min(row.y0 for row in rows)
    right, bottom = max(row.x1 for row in rows), max(row.y1 for row in rows)
    # Some of the surroundings, so that a small target can be recognised, and a box of a few px is not all there is.
    half = max(_AROUND * max(right - left, bottom - top), _LEAST_CROP_PX) / 2
    spans = [((left + right) / 2, size[1]), ((top + bottom) / 2, size[0])]
    middles = ((min(max(middle, 0), most), most) for middle, most in spans)  # a box may leave the picture
    x, y = ((max(0, int(mid - half)), min(most, math.ceil(mid + half))) for mid, most in middles)
    return x[0], y[0], x[1], y[1]


def _crop(image: NDArray[np.uint8], around: tuple[int, int, int, int], row: TargetAnswer) -> list[Any]:
    left, top, right, bottom = around
    part = image[top:bottom, left:right]
    sides = [(row.x0 - left, right - left), (row.y0 - top, bottom - top)]
    sides += [(row.x1 - row.x0, right - left), (row.y1 - row.y0, bottom - top)]
    return [jpeg(_resized(part, _CROP_PX / max(part.shape[:2]))), *(round(100 * a / b, 1) for a, b in sides)]
