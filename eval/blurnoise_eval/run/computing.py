"""Computing a plan: every picture under every condition before every model, by any engine, into a store.

The store is whole at any time: a run that was stopped goes on where it was.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import lru_cache

from blurnoise.camera import Camera
from blurnoise_eval.datasets import PictureSet, UnreadablePicture
from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.run.engines import Engine, ThreadEngine, WorkerDied
from blurnoise_eval.run.work import Block, Work, blocks
from blurnoise_eval.scoring.on_picture import Model
from blurnoise_eval.store.store import CellResult, Store
from blurnoise_eval.system.files import write_whole
from blurnoise_eval.system.interrupts import keeps

_HOPELESS = 8  # failures of a model, without one answer, after which a sweep gives up
_ONE_THREAD = ThreadEngine(1)


@dataclass
class Outcome:
    """What a sweep did: cells computed now and before, pictures skipped with the reason, seconds, and workers that
    were replaced."""

    computed: int = 0
    resumed: int = 0
    skipped: dict[str, str] = field(default_factory=dict)
    wall_s: float = 0.0
    workers_died: int = 0

    def add(self, more: Outcome) -> None:
        """What another run into the same store did; cells are resumed once."""
        self.computed += more.computed
        self.wall_s += more.wall_s
        self.skipped |= more.skipped
        self.workers_died += more.workers_died


def compute(
    models: Sequence[Model],
    camera: Camera,
    pictures: PictureSet,
    plan: SweepPlan,
    store: Store,
    *,
    engine: Engine = _ONE_THREAD,
    progress: Callable[[int], None] = lambda cells: None,
    resumed: Callable[[int], None] | None = None,
    died: Callable[[int], None] = lambda workers: None,
) -> Outcome:
    """Compute every cell that ``store`` does not hold yet; ``progress`` is called with the number of cells computed,
    ``resumed`` with that of cells that need no work (without it ``progress``), ``died`` with that of dead workers.

    The rows do not depend on the engine. A picture that cannot be read, or on which workers die, is skipped; one on
    which a model fails is noted in its row. Raises :class:`ModelError` where a model does nothing but fail, and what
    the engine raises. An interrupt leaves the store whole; the same call resumes.
    """
    started = time.perf_counter()
    no_work = progress if resumed is None else resumed
    outcome = Outcome()
    keeps(lambda: outcome.computed + outcome.resumed > 0)
    failures = dict.fromkeys((model.name for model in models), 0)  # of models that never answered
    # without the chosen conditions, so that processes with the same work stay from batch to batch
    work = Work(tuple(models), camera, plan.of_every_cell)
    # as a picture begins, for no cell comes twice; two pictures take turns
    finished = lru_cache(2)(store.done)

    def unfinished() -> Iterator[Block]:
        for block in blocks(pictures, plan):
            todo = block.without(finished(block.picture.name))
            held = len(block.cells) - len(todo.cells)
            outcome.resumed += held
            if block.picture.name in outcome.skipped:
                held = len(block.cells)
            no_work(held)
            if held < len(block.cells):
                yield todo

    try:
        with closing(engine.map(work, unfinished())) as answers:
            for block, answer in answers:
                name = block.picture.name
                if isinstance(answer, WorkerDied):
                    outcome.workers_died += 1
                    died(outcome.workers_died)
                    continue
                if isinstance(answer, UnreadablePicture):
                    outcome.skipped[name] = str(answer)
                elif isinstance(answer, Exception):
                    raise answer
                else:
                    _keep(answer, store)
                    outcome.computed += len(block.cells)
                    for result in answer:
                        _check_hope(failures, result.cell.model, result.cell.error)
                if name in outcome.skipped:  # also where it was given up while others computed it
                    store.skip(name, outcome.skipped[name])
                progress(len(block.cells))
    finally:
        outcome.wall_s = time.perf_counter() - started
        store.set_about("wall_s", (store.about("wall_s") or 0.0) + outcome.wall_s)
    return outcome


def _keep(results: Sequence[CellResult], store: Store) -> None:
    """Write the pictures that people will look at, then the rows that name them."""
    for result in results[:1]:
        if result.picture:
            store.note_picture(result.cell.image, result.picture)
    pictures = {result.cell.example: result.example_png for result in results}
    for name, png in pictures.items():
        if name is not None and png is not None:
            file = store.file(name)
            file.parent.mkdir(exist_ok=True)
            write_whole(file, png)
    store.add(results)


def _check_hope(failures: dict[str, int], model: str, error: str | None) -> None:
    """Raise :class:`ModelError` where a model has failed often and has not answered once."""
    if error is None:
        failures.pop(model, None)
    elif model in failures:
        failures[model] += 1
        if failures[model] >= _HOPELESS:
            raise ModelError(f"{error} (and so on every one of {failures[model]} pictures)")
