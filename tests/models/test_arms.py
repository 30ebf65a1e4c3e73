"""Networks for a comparison: which are missing, which are another training's, and trainings side by side."""

from __future__ import annotations

import json
import os
import signal
from dataclasses import replace
from multiprocessing import active_children
from multiprocessing.queues import Queue
from pathlib import Path

import onnx
import pytest
from blurnoise_models import arms
from blurnoise_models.arms import Recipe, recipes, train_all
from onnx import helper


def with_facts(recipe: Recipe) -> None:
    graph = helper.make_graph([], "nothing", [], [])
    model = helper.make_model(graph)
    helper.set_model_props(model, {"blurnoise.training": json.dumps(recipe.facts)})
    onnx.save(model, str(recipe.path))


def stand_in(recipe: Recipe, scenes: Path, told: Queue[int]) -> None:
    """In place of a training: two steps; the second seed dies as if it were short of memory."""
    told.put(recipe.pictures // 2)
    if recipe.seed == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    told.put(recipe.pictures // 2)
    with_facts(recipe)


def test_every_arm_has_every_seed(tmp_path: Path) -> None:
    wanted = recipes(tmp_path, seeds=2, scenes=5, pictures=640)
    assert [recipe.path.name for recipe in wanted] == [
        "none-0.onnx", "none-1.onnx", "kornia-0.onnx", "kornia-1.onnx", "exposure-0.onnx", "exposure-1.onnx",
    ]  # fmt: skip
    assert not any(recipe.is_ready() for recipe in wanted)
    with_facts(wanted[3])
    assert [recipe.is_ready() for recipe in wanted] == [False, False, False, True, False, False]


@pytest.mark.parametrize("change", [{"pictures": 960}, {"scenes": 6}, {"seed": 1}, {"arm": "kornia"}])
def test_file_of_another_training_is_refused(tmp_path: Path, change: dict[str, object]) -> None:
    recipe = recipes(tmp_path, seeds=1, scenes=5, pictures=640)[0]
    with_facts(recipe)
    assert recipe.is_ready()
    with pytest.raises(ValueError, match=r"none-0.onnx.*was trained with .*choose another folder"):
        replace(recipe, **change).is_ready()  # type: ignore[arg-type]


def test_networks_of_the_mix_before_are_refused(tmp_path: Path) -> None:
    recipe = recipes(tmp_path, seeds=1, scenes=5, pictures=640)[2]
    assert recipe.facts == {"arm": "exposure", "seed": 0, "scenes": 5, "pictures": 640, "mix": 2}
    model = helper.make_model(helper.make_graph([], "nothing", [], []))
    before = {name: value for name, value in recipe.facts.items() if name != "mix"}
    helper.set_model_props(model, {"blurnoise.training": json.dumps(before)})
    onnx.save(model, str(recipe.path))
    with pytest.raises(ValueError, match=r"was trained with .*, not with .*'mix': 2"):
        recipe.is_ready()


def test_file_of_no_training_is_refused(tmp_path: Path) -> None:
    recipe = recipes(tmp_path, seeds=1, scenes=5, pictures=640)[0]
    onnx.save(helper.make_model(helper.make_graph([], "nothing", [], [])), str(recipe.path))
    with pytest.raises(ValueError, match="was trained with None"):
        recipe.is_ready()


@pytest.mark.slow
def test_trainings_side_by_side(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arms, "_train", stand_in)
    wanted = recipes(tmp_path / "models", seeds=1, scenes=5, pictures=640)
    seen: list[int] = []
    train_all(wanted[:2], tmp_path, processes=2, progress=seen.append)
    assert [recipe.is_ready() for recipe in wanted] == [True, True, False]
    assert sum(seen) == 2 * 640


@pytest.mark.slow
def test_death_of_a_training_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arms, "_train", stand_in)
    wanted = recipes(tmp_path / "models", seeds=2, scenes=5, pictures=640)
    with pytest.raises(ChildProcessError, match=r"none-1.onnx died \(-9\)"):
        train_all(wanted[:2], tmp_path, processes=1)
    assert [recipe.is_ready() for recipe in wanted[:2]] == [True, False]
    assert not active_children()
