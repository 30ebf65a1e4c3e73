"""A training that was stopped: it goes on to the bits of an unbroken one, and nothing but that one takes it over."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch
from blurnoise_models import training
from blurnoise_models.mixes import ARMS, Arm
from blurnoise_models.network import SignNet
from blurnoise_models.training import Pool, Step, train

pytestmark = pytest.mark.slow  # networks are trained

PICTURES, KEPT_EVERY, STOPPED_AFTER = 320, 6, 15  # steps; 20 in all


@pytest.fixture
def scenes(monkeypatch: pytest.MonkeyPatch) -> Pool:
    monkeypatch.setattr(training, "_KEPT_EVERY", KEPT_EVERY)
    return made_scenes()


def made_scenes() -> Pool:
    rng = np.random.default_rng(5)
    pictures = rng.integers(0, 256, (40, 32, 32, 3), dtype=np.uint8)
    low = rng.uniform(0, 16, (40, 1, 2)).astype(np.float32)
    return Pool(pictures, np.concatenate([low, low + 14], axis=2))


def equal(one: SignNet, other: SignNet) -> bool:
    states = one.state_dict(), other.state_dict()
    return all(torch.equal(states[0][name], states[1][name]) for name in states[0])


class Stopped(Exception):
    """In place of a kill."""


def stop(step: Step) -> None:
    if step.pictures == STOPPED_AFTER * training.BATCH:
        raise Stopped


@pytest.mark.parametrize("arm", ARMS)
def test_stopped_and_continued_is_unbroken_bit_for_bit(scenes: Pool, tmp_path: Path, arm: Arm) -> None:
    file = tmp_path / "kept" / "training.checkpoint"
    unbroken: list[Step] = []
    whole = train(scenes, arm, pictures=PICTURES, seed=3, threads=1, progress=unbroken.append)
    with pytest.raises(Stopped):
        train(scenes, arm, pictures=PICTURES, seed=3, threads=1, checkpoint=file, progress=stop)
    held = torch.load(file, weights_only=True)
    assert len(held["losses"]) == STOPPED_AFTER - STOPPED_AFTER % KEPT_EVERY
    steps: list[Step] = []
    again = train(scenes, arm, pictures=PICTURES, seed=3, threads=1, checkpoint=file, progress=steps.append)
    assert equal(whole, again)
    assert steps == unbroken
    assert [each.name for each in file.parent.iterdir()] == [file.name]


def test_killed_and_continued_is_unbroken_bit_for_bit(scenes: Pool, tmp_path: Path) -> None:
    """By SIGKILL, at whatever step it was; in another process."""
    file = tmp_path / "training.checkpoint"
    script = (
        f"import sys; sys.path[:0] = {sys.path!r}\n"
        "import runpy; from pathlib import Path; from blurnoise_models import training\n"
        f"training._KEPT_EVERY = {KEPT_EVERY}\n"
        f"scenes = runpy.run_path({__file__!r})['made_scenes']()\n"
        f"training.train(scenes, pictures=16000, seed=3, threads=1, checkpoint=Path({str(file)!r}))"
    )
    with subprocess.Popen([sys.executable, "-c", script]) as process:
        while not file.is_file() and process.poll() is None:
            time.sleep(0.02)
        process.kill()
    done = len(torch.load(file, weights_only=True)["losses"])
    assert 0 < done < 1000
    recipe = {"pictures": 16000, "seed": 3, "threads": 1}
    last = (done + 8) * training.BATCH

    def weights(checkpoint: Path | None) -> list[float]:
        losses: list[float] = []

        def tell(step: Step) -> None:
            losses.append(step.loss)
            if step.pictures == last:
                raise Stopped

        with pytest.raises(Stopped):
            train(scenes, **recipe, checkpoint=checkpoint, progress=tell)
        return losses

    assert weights(file) == weights(None)


@pytest.mark.parametrize(
    "change", [{"arm": "kornia"}, {"pictures": 336}, {"seed": 4}, {"scenes": 39}, {"size": 64}]
)
def test_checkpoint_of_another_training_is_refused(
    scenes: Pool, tmp_path: Path, change: dict[str, object]
) -> None:
    file = tmp_path / "training.checkpoint"
    with pytest.raises(Stopped):
        train(scenes, "none", pictures=PICTURES, seed=3, checkpoint=file, progress=stop)
    before = file.read_bytes()
    pictures = scenes.pictures[: change.pop("scenes", 40)]  # type: ignore[misc]
    if change.pop("size", 32) == 64:
        pictures = pictures.repeat(2, axis=1).repeat(2, axis=2)
    other = Pool(pictures, scenes.boxes_xyxy[: len(pictures)])
    asked = {"arm": "none", "pictures": PICTURES, "seed": 3, **change}
    with pytest.raises(ValueError, match=r"training\.checkpoint.*was begun with .*another folder"):
        train(other, **asked, checkpoint=file)  # type: ignore[arg-type]
    assert file.read_bytes() == before


def test_what_is_no_checkpoint_is_refused(scenes: Pool, tmp_path: Path) -> None:
    file = tmp_path / "training.checkpoint"
    for data in (b"", b"PK\x03\x04 nothing", b"\x80\x02N."):
        file.write_bytes(data)
        with pytest.raises(ValueError, match=r"checkpoint = .*is none; remove it"):
            train(scenes, "none", pictures=PICTURES, checkpoint=file)
    recipe = {"arm": "none", "seed": 0, "pictures": PICTURES, "scenes": len(scenes.pictures), "size_px": 32}
    torch.save({"recipe": recipe}, file)
    with pytest.raises(ValueError, match=r"checkpoint = .*is none; remove it"):
        train(scenes, "none", pictures=PICTURES, checkpoint=file)
