"""Evaluate: run models over pictures under the conditions of a plan, in a folder, and return the run.

``blurnoise sweep`` and ``blurnoise decide`` call :func:`evaluate`, too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from blurnoise._core.checks import one_of
from blurnoise.camera import Camera
from blurnoise_eval import datasets, default_tone
from blurnoise_eval.answers.clusters import check_cluster
from blurnoise_eval.answers.criterion import criterion_for
from blurnoise_eval.cameras import find
from blurnoise_eval.contracts.comparison import contracts_chosen
from blurnoise_eval.datasets import PictureSet
from blurnoise_eval.default_camera import default_for
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.opening import open_models
from blurnoise_eval.detectors.python_models import Find, PythonDetector
from blurnoise_eval.plan.plan import SweepPlan, usual_plan
from blurnoise_eval.plan.question import Question
from blurnoise_eval.run.computing import Outcome, compute
from blurnoise_eval.run.engines import Engine, engine_facts, engine_of, staying
from blurnoise_eval.run.exposing import check_plan
from blurnoise_eval.run.identity import begun_or_gone, open_run
from blurnoise_eval.run.latency import note_models
from blurnoise_eval.run.refine import Refine
from blurnoise_eval.run.run import Run
from blurnoise_eval.run.search import search
from blurnoise_eval.run.setup import QUESTION, note_search_space
from blurnoise_eval.run.so_far import FirstAnswer
from blurnoise_eval.run.strategy import Grid, Strategy, StrategyOf
from blurnoise_eval.run.work import count_cells
from blurnoise_eval.scoring.on_picture import Model
from blurnoise_eval.store.store import Store
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import say
from blurnoise_eval.system.working_folder import WorkingFolder, working_folder

Given = str | Path | Model | Find
"""A model: a file, one that is open, or a function."""
STRATEGIES: dict[str, StrategyOf] = {"grid": Grid, "refine": Refine, "search": search}
"""By name, as ``evaluate(strategy=...)`` takes it."""


def evaluate(
    models: Given | Sequence[Given] | None = None,
    pictures: PictureSet | None = None,
    camera: str | Camera | None = None,
    plan: SweepPlan | None = None,
    question: Question | None = None,
    output: str | Path | WorkingFolder = "run",
    *,
    strategy: str | StrategyOf = "refine",
    engine: str | Engine = "threads",
    progress: bool | None = None,
    overwrite: bool = False,
) -> Run:
    """Run models over pictures under the conditions of a plan, as ``blurnoise sweep`` does.

    models: ONNX files, opened models, or functions from an RGB picture (H, W, 3), uint8, to boxes, scores and names
        of classes (:mod:`blurnoise_eval.detectors.python_models`). Default: the built-in stop-sign detector.
    pictures: of :mod:`blurnoise_eval.datasets`. ``pictures.part("1/4")`` is the first quarter; a part is not refined,
        and :func:`~blurnoise_eval.run.merging.merge` joins the parts. Default: rendered stop signs.
    camera: a preset's name, a file, or a camera. Default: :func:`~blurnoise_eval.default_camera.default_for` these
        pictures.
    plan: the conditions. Default: :func:`usual_plan`.
    question: the score that is enough, and the pictures that count as one. Default: 0.9 of the score on the original
        pictures, and a mean confidence of 0.6 for rendered ones.
    output: the run's folder; a run begun there goes on. For a run at a URL, a
        :func:`~blurnoise_eval.system.working_folder.written_run`.
    strategy: "grid": every condition of the plan. "refine": then more exposures where a window ends between two
        tested ones, to a quarter of a stop. "search": the conditions that decide which exposure to use; of a large
        grid whose conditions share pictures, those that show where windows end. Or a function that makes a
        :class:`~blurnoise_eval.run.strategy.Strategy` of the plan and the camera.
    engine: "threads", "processes" or "ray" with a worker per core, or an
        :class:`~blurnoise_eval.run.engines.Engine` such as ``ThreadEngine(2)``.
    progress: whether to draw a bar on the terminal.
    overwrite: replace files in the folder that blurnoise did not write, or that were changed since; inputs and
        folders never are.

    Raises ``TypeError`` for values of another kind, and ``ValueError`` for what cannot be used: a model
    (:class:`~blurnoise_eval.detectors.contract.ModelError`), a folder that holds another run
    (:class:`~blurnoise_eval.store.store.StoreError`), pictures none of which can be read. Raises ``OSError`` where
    the run cannot be written, or would replace a file that is not its own.

    >>> import tempfile
    >>> from blurnoise_eval import SweepPlan, datasets, evaluate
    >>> def find(picture):  # in place of a network
    ...     return [(10, 10, 60, 60)], [0.9], ["stop sign"]
    >>> plan = SweepPlan({"exposure_s": (0.001, 0.01), "illuminance_lux": (50.0,)})
    >>> pictures = datasets.rendered_signs((50,), count=1)
    >>> run = evaluate(find, pictures, "imx250", plan, output=tempfile.mkdtemp(), strategy="grid")
    >>> len(run.cells)  # one picture: the original, and two exposures
    3
    """
    folder = working_folder(output)
    computed_by = engine_of(engine) if isinstance(engine, str) else engine
    named = find(camera) if isinstance(camera, str) else camera  # before anything is opened
    for name, value, kind in (
        ("pictures", pictures, PictureSet),
        ("camera", named, Camera),
        ("plan", plan, SweepPlan),
        ("question", question, Question),
    ):
        if value is not None and not isinstance(value, kind):
            raise TypeError(f"{name} = {value!r}: must be a {kind.__name__}")
    opened = _opened(models, pictures)
    pictures = usual_pictures(opened) if pictures is None else pictures
    camera = default_for(pictures.every) if named is None else named
    question = Question() if question is None else question
    check_cluster(question.cluster, (picture.name for picture in pictures.every))
    of_pictures = {"rendered": pictures.kind == "rendered", "labelled": pictures.labelled}
    plan = usual_plan() if plan is None else plan
    plan = plan.for_rendered() if pictures.kind == "rendered" else plan
    if pictures.kind != "rendered":
        tone, camera = default_tone.of_photographs(plan.picture_tone, camera)
        plan = replace(plan, picture_tone=tone)
    criterion_for(question, reads=not isinstance(opened[0], Detector), **of_pictures)
    check_plan(plan, camera, pictures)
    chosen = _strategy_of(strategy, pictures)(plan, camera)
    with (
        begun_or_gone(folder.path, opened, pictures.every, overwrite=overwrite),
        Store(folder.path, create=True) as store,
        staying(computed_by) as engine_kept,
    ):
        opened, comparisons = contracts_chosen(opened, pictures.every, say=progress)
        facts = {"command": folder.command, **engine_facts(computed_by)}
        open_run(store, opened, camera, pictures, chosen.plan, facts)
        store.set_about(QUESTION, vars(question))
        note_search_space(store, chosen.search_space)
        computing = partial(compute, opened, camera, pictures, store=store, engine=engine_kept)
        first = FirstAnswer(store, opened[0].name) if progress else None
        outcome = _computed(chosen, Run(store), pictures, computing, progress, first)
        note_models(store, opened, pictures, comparisons, computed=outcome.computed)
    run = Run.open(folder, question, trust=True, images=pictures.every, progress=progress)
    run.outcome = outcome
    return run


def _strategy_of(strategy: str | StrategyOf, pictures: PictureSet) -> StrategyOf:
    """By its name. A part is a grid: which exposures follow depends on the scores of all pictures."""
    if not isinstance(strategy, str):
        return strategy
    one_of("strategy", strategy, STRATEGIES)
    if pictures.whole is not None and strategy == "search":
        raise ValueError(
            f"part = '{pictures.of_part}': cannot be combined with a search, which needs all pictures"
        )
    return STRATEGIES["grid" if pictures.whole is not None else strategy]


def _computed(
    strategy: Strategy,
    run: Run,
    pictures: PictureSet,
    computing: Callable[..., Outcome],
    progress: bool | None,
    first: FirstAnswer | None,
) -> Outcome:
    """Compute a strategy's steps, one after the other, each with its own bar."""
    outcome: Outcome | None = None
    for step in strategy.steps(run):
        if progress and step.note:
            say(step.note, error=True)
        with ProgressBar(step.name, count_cells(pictures, step.plan), progress) as advance:

            def done(cells: int, plan: SweepPlan = step.plan, advance: ProgressBar = advance) -> None:
                advance(cells)
                if first is not None:
                    first.after(plan, cells)

            more = computing(step.plan, progress=done, resumed=advance.already)
        run.forget()  # the strategy chooses the next step by what is there now
        if outcome is None:
            outcome = more  # cells that were there before are counted once
        else:
            outcome.add(more)
        if len(more.skipped) == len(pictures):
            raise ValueError(f"images: none could be read (first: {next(iter(more.skipped.values()))})")
    return outcome or Outcome()


def usual_pictures(models: Sequence[Model]) -> PictureSet:
    """Rendered stop signs for detectors; for readers, the word on them."""
    return datasets.rendered_signs() if isinstance(models[0], Detector) else datasets.rendered_texts()


def _opened(models: Any, pictures: PictureSet | None) -> list[Model]:
    if models is None:
        from blurnoise_models.detector import STOP_SIGN

        models = STOP_SIGN
    each = list(models) if isinstance(models, Sequence) and not isinstance(models, str) else [models]
    if not each:
        raise ValueError("models = []: must contain at least one model")
    opened = iter(open_models([model for model in each if isinstance(model, (str, Path))]))
    models_found: list[Model] = []
    for model in each:
        if isinstance(model, (str, Path)):
            models_found.append(next(opened))
        elif isinstance(model, Detector) or hasattr(model, "read"):
            models_found.append(model)
        else:
            models_found.append(_of_python(model, pictures))
    if len({isinstance(model, Detector) for model in models_found}) > 1:
        raise ValueError(
            "models: must be detectors or text readers, not both; evaluate them in separate runs"
        )
    return models_found


def _of_python(model: Any, pictures: PictureSet | None) -> Model:
    """A function that returns names of classes as a detector of those that the pictures have."""
    kinds = "a file, a Detector, a reader of text, or a function of pictures"
    if not callable(model):
        raise TypeError(f"models: {model!r}: must be {kinds}")
    if hasattr(model, "state_dict"):  # a network of torch's
        raise TypeError(
            f"models: {type(model).__name__}: must be wrapped as TorchvisionDetector(network, classes)"
        )
    if pictures is None or not pictures.categories:
        raise ValueError(
            f"models: {model!r}: the pictures have no class names; wrap it as PythonDetector(find, classes)"
        )
    return PythonDetector(model, tuple(pictures.categories))
