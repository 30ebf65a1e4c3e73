"""A miniature training: the loss falls, the pool is drawn once, the export is the network."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from blurnoise_eval.detectors.detector import Detector
from blurnoise_models import training
from blurnoise_models.export import write_onnx
from blurnoise_models.mixes import ARMS, Arm, augmentation
from blurnoise_models.network import Decoded, SignNet
from blurnoise_models.training import Pool, Step, batch, train

pytestmark = pytest.mark.slow  # networks are trained

SIZE_PX = 96


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Pool:
    return training.pool(tmp_path_factory.mktemp("pool"), 48, size_px=SIZE_PX)


@pytest.fixture(scope="module")
def miniature(scenes: Pool) -> tuple[SignNet, list[Step]]:
    steps: list[Step] = []
    return train(scenes, "exposure", pictures=80 * 16, seed=3, threads=1, progress=steps.append), steps


def test_loss_falls(miniature: tuple[SignNet, list[Step]]) -> None:
    _, steps = miniature
    assert [step.pictures for step in steps] == list(range(16, 1281, 16))
    losses = [step.loss for step in steps]
    assert np.mean(losses[-10:]) < 0.8 * np.mean(losses[:10])


def test_export_equals_the_network(miniature: tuple[SignNet, list[Step]], tmp_path: Path) -> None:
    network, _ = miniature
    path = write_onnx(network, tmp_path / "mini.onnx", input_px=SIZE_PX, facts={"arm": "exposure"})
    pictures = torch.rand(1, 3, SIZE_PX, SIZE_PX, generator=torch.Generator().manual_seed(1))
    with torch.no_grad():
        expected = Decoded(network)(pictures).numpy()
    session = onnxruntime.InferenceSession(path)
    (got,) = session.run(None, {"images": pictures.numpy()})
    assert got.shape == (1, 5, (SIZE_PX // 8) ** 2)
    np.testing.assert_allclose(got[:, :4], expected[:, :4], atol=1e-4 * SIZE_PX)
    np.testing.assert_allclose(got[:, 4], expected[:, 4], atol=1e-4)
    properties = {entry.key: entry.value for entry in onnx.load(path).metadata_props}
    assert json.loads(properties["blurnoise.training"]) == {"arm": "exposure"}
    assert [entry.name for entry in tmp_path.iterdir()] == ["mini.onnx"]


def test_export_states_its_own_contract(miniature: tuple[SignNet, list[Step]], tmp_path: Path) -> None:
    detector = Detector(write_onnx(miniature[0], tmp_path / "mini.onnx", input_px=SIZE_PX))
    assert detector.contract.classes == ("stop sign",)
    assert detector.contract.resize == "letterbox"
    assert not detector.contract.assumptions
    assert detector.detect(np.zeros((40, 60, 3), np.uint8)).boxes_xyxy.shape[1] == 4


def test_export_says_nothing_of_the_machine_it_ran_on(
    miniature: tuple[SignNet, list[Step]], tmp_path: Path
) -> None:
    written = write_onnx(miniature[0], tmp_path / "mini.onnx", input_px=SIZE_PX).read_bytes()
    shipped = Path(training.__file__).with_name("stop_sign.onnx").read_bytes()
    for data in (written, shipped):
        for trace in (str(Path(training.__file__).parent), "network.py", "site-packages", "stack_trace"):
            assert trace.encode() not in data, trace


def test_same_arguments_same_network_and_the_global_generator_stays(scenes: Pool) -> None:
    torch.default_generator.manual_seed(5)
    state = torch.get_rng_state()
    first, again, other = (
        train(scenes, arm, pictures=320, seed=seed, threads=1).state_dict()
        for arm, seed in (("kornia", 1), ("kornia", 1), ("kornia", 2))
    )
    assert torch.equal(torch.get_rng_state(), state)
    assert all(torch.equal(first[name], again[name]) for name in first)
    assert not all(torch.equal(first[name], other[name]) for name in first)


@pytest.mark.parametrize("arm", ARMS)
def test_arms_keep_shape_and_range(scenes: Pool, arm: Arm) -> None:
    pictures, boxes = batch(scenes, np.arange(8))
    assert boxes.shape[::2] == (8, 4)
    with torch.random.fork_rng(devices=[]):
        torch.default_generator.manual_seed(0)
        seen = augmentation(arm)(pictures)
    assert seen.shape == pictures.shape
    assert float(seen.min()) >= 0
    assert float(seen.max()) <= 1
    assert torch.equal(seen, pictures) == (arm == "none")


def test_the_pool_is_drawn_once(tmp_path: Path) -> None:
    told: list[int] = []
    first = training.pool(tmp_path, 3, size_px=64, progress=told.append)
    written = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    again = training.pool(tmp_path, 3, size_px=64, progress=told.append)
    assert sum(told) == 6
    assert {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == written
    np.testing.assert_array_equal(first.pictures, again.pictures)
    np.testing.assert_array_equal(first.boxes_xyxy, again.boxes_xyxy)


def test_a_pool_that_fails_leaves_no_pictures(tmp_path: Path) -> None:
    def stop(_: int) -> None:
        raise InterruptedError("enough")

    with pytest.raises(InterruptedError, match="enough"):
        training.pool(tmp_path, 3, size_px=64, progress=stop)
    assert not list(tmp_path.iterdir())


def test_every_scene_comes_once_before_any_comes_again() -> None:
    drawn = training._batches(40, seed=1)
    seen = np.concatenate([next(drawn) for _ in range(5)])
    assert (np.bincount(seen, minlength=40) == 2).all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda pool: train(pool, "best", pictures=320), "arm"),  # type: ignore[arg-type]
        (lambda pool: train(pool, pictures=319), "pictures = 319"),
        (lambda pool: train(pool, pictures=320, seed=-1), "seed"),
        (lambda pool: training.pool(Path("never"), 0), "count = 0"),
        (lambda pool: training.pool(Path("never"), 8, size_px=100), "size_px = 100"),
        (lambda pool: write_onnx(SignNet(), Path("model.pt")), "model.pt"),
    ],
)
def test_bad_arguments_are_named(scenes: Pool, call: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        call(scenes)  # type: ignore[operator]
    assert not Path("never").exists()
