"""A miniature training: the loss falls, one that was stopped goes on to the same bits, the export is the network."""

import json
import math
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from blurnoise_eval.detectors.detector import Detector
from blurnoise_models import training
from blurnoise_models.augmentation import MOST, MOST_TIMES, InShare, exposures, share_at
from blurnoise_models.export import write_onnx
from blurnoise_models.network import Decoded, SignNet
from blurnoise_models.training import BATCH, batch, train
from torch import nn

from blurnoise.camera.colour import linear_from_srgb

SIZE_PX = 96
SMALL = {"pictures": 320, "size_px": 64, "seed": 3, "threads": 1}
trains = pytest.mark.slow


class Stopped(Exception):
    """In place of a kill."""


def stop(pictures, loss):
    if pictures == 15 * BATCH:
        raise Stopped


@pytest.fixture
def saved_often(monkeypatch):
    monkeypatch.setattr(training, "_SAVED_EVERY_S", 0.0)


@pytest.fixture(scope="module")
def miniature():
    steps: list[tuple[int, float]] = []
    network = train(
        exposures(),
        pictures=80 * BATCH,
        size_px=SIZE_PX,
        seed=3,
        threads=1,
        progress=lambda *step: steps.append(step),
    )
    return network, steps


@trains
def test_loss_falls(miniature):
    _, steps = miniature
    assert [pictures for pictures, _ in steps] == list(range(16, 1281, 16))
    losses = [loss for _, loss in steps]
    assert np.mean(losses[-10:]) < 0.8 * np.mean(losses[:10])


@trains
def test_the_export_is_the_network_and_states_contract_and_training(miniature, tmp_path):
    network, _ = miniature
    path = write_onnx(network, tmp_path / "mini.onnx", input_px=SIZE_PX, facts={"seed": 3})
    pictures = torch.rand(1, 3, SIZE_PX, SIZE_PX, generator=torch.Generator().manual_seed(1))
    with torch.no_grad():
        expected = Decoded(network)(pictures).numpy()
    (got,) = onnxruntime.InferenceSession(path).run(None, {"images": pictures.numpy()})
    assert got.shape == (1, 5, (SIZE_PX // 8) ** 2)
    np.testing.assert_allclose(got[:, :4], expected[:, :4], atol=1e-4 * SIZE_PX)
    np.testing.assert_allclose(got[:, 4], expected[:, 4], atol=1e-4)
    properties = {entry.key: entry.value for entry in onnx.load(path).metadata_props}
    assert json.loads(properties["blurnoise.training"]) == {"seed": 3}
    detector = Detector(path)
    assert detector.contract.classes == ("stop sign",)
    assert not detector.contract.assumptions
    shipped = Path(training.__file__).with_name("stop_sign.onnx")
    for data in (path.read_bytes(), shipped.read_bytes()):  # nothing of the machine that wrote them
        for trace in (str(Path(training.__file__).parent), "network.py", "site-packages", "stack_trace"):
            assert trace.encode() not in data, trace


@trains
def test_stopped_and_continued_is_unbroken_bit_for_bit(saved_often, tmp_path):
    file = tmp_path / "saved" / "training.checkpoint"
    unbroken: list[tuple[int, float]] = []
    state = torch.get_rng_state()
    whole = train(exposures(), **SMALL, progress=lambda *step: unbroken.append(step)).state_dict()
    assert torch.equal(torch.get_rng_state(), state)  # the caller's generator
    with pytest.raises(Stopped):
        train(exposures(), **SMALL, checkpoint=file, progress=stop)
    steps: list[tuple[int, float]] = []
    again = train(
        exposures(), **SMALL, checkpoint=file, progress=lambda *step: steps.append(step)
    ).state_dict()
    assert all(torch.equal(whole[name], again[name]) for name in whole)
    assert steps == unbroken
    other = train(exposures(), **{**SMALL, "seed": 4}).state_dict()
    assert not all(torch.equal(whole[name], other[name]) for name in whole)


@trains
@pytest.mark.parametrize("change", [{"pictures": 336}, {"seed": 4}, {"size_px": 96}, {"facts": {"mix": 1}}])
def test_the_checkpoint_of_another_training_is_refused(saved_often, tmp_path, change):
    file = tmp_path / "training.checkpoint"
    with pytest.raises(Stopped):
        train(**SMALL, checkpoint=file, progress=stop)
    before = file.read_bytes()
    with pytest.raises(ValueError, match=r"training\.checkpoint.*another folder; it was begun with"):
        train(**{**SMALL, **change}, checkpoint=file)
    assert file.read_bytes() == before


@pytest.mark.parametrize("data", [b"", b"PK\x03\x04 nothing", b"\x80\x02N."])
def test_a_file_that_is_no_checkpoint_is_refused(tmp_path, data):
    file = tmp_path / "training.checkpoint"
    file.write_bytes(data)
    with pytest.raises(ValueError, match=r"checkpoint = .*: remove it, .* is no checkpoint"):
        train(**SMALL, checkpoint=file)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: train(pictures=319), "pictures = 319"),
        (lambda: train(pictures=320, seed=-1), "seed = -1"),
        (lambda: train(pictures=320, size_px=100), "size_px = 100"),
        (lambda: write_onnx(SignNet(), Path("model.pt")), "model.pt"),
    ],
)
def test_bad_arguments_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()  # type: ignore[operator]


def test_batches_are_the_scenes_in_their_order():
    pictures, returns, boxes = batch(5, 3, size_px=64)
    assert pictures.shape == (3, 3, 64, 64)
    for number in range(3):
        one = training.scene(training.SCENES_SEED, 5 + number, size_px=64)
        shown = (pictures[number].permute(1, 2, 0) * 255).round().byte().numpy()
        assert np.array_equal(shown, one.picture)
        assert np.array_equal(returns[number, 0].numpy(), one.retroreflects)
        assert np.array_equal(boxes[number][: len(one.boxes_xyxy)].numpy(), one.boxes_xyxy)
    drawn = list(training._batches(0, 2, 64))
    assert torch.equal(drawn[1][0], batch(BATCH, size_px=64)[0])
    assert len(drawn) == 2


def test_the_share_of_changed_pictures_rises_stays_and_falls():
    shares = [share_at(done / 20) for done in range(21)]
    falling = [0.45 - 0.25 * step / 8 for step in range(1, 9)]
    assert shares == pytest.approx([0.45 * step / 6 for step in range(6)] + [0.45] * 7 + falling)


def test_every_change_gets_its_share_of_pictures_and_the_rest_stay():
    """Of n pictures in each of which a change has a chance p, np change, but for sqrt(np(1 - p))."""

    class To(nn.Module):
        def __init__(self, value):
            super().__init__()
            self.value = value

        def forward(self, pictures):
            return torch.full_like(pictures, self.value)

    pictures, count = torch.zeros(4000, 1, 1, 1), 4000
    with torch.random.fork_rng(devices=[]):
        torch.default_generator.manual_seed(1)
        values = InShare([To(1.0), To(2.0)])(pictures, pictures, 0.5).flatten()
        assert torch.equal(InShare([To(1.0)])(pictures, pictures, 0.0), pictures)
    for value, chance in ((0.0, 1 - MOST), (1.0, MOST / 2), (2.0, MOST / 2)):
        expected, spread = count * chance, (count * chance * (1 - chance)) ** 0.5
        assert int((values == value).sum()) == pytest.approx(expected, abs=4 * spread)
    assert not pictures.any()


def test_headlamps_light_their_share_of_the_changed_pictures():
    """The brightness of a sign beside the rest is log-uniform, so its logarithm has a mean of half the largest."""
    count, white = 4000, torch.ones(4000, 1, 1, 2)
    returns = torch.tensor([1.0, 0.0]).expand(count, 1, 1, 2)
    with torch.random.fork_rng(devices=[]):
        torch.default_generator.manual_seed(1)
        seen = InShare([nn.Identity()], lit=0.25)(white, returns, 0.5)
    assert seen[..., 0].min() > 1 - 1e-6
    times = 1 / linear_from_srgb(seen[..., 1].flatten())
    chance = MOST * 0.25
    lit = times[times > 1.0001].log()
    assert len(lit) == pytest.approx(count * chance, abs=4 * (count * chance * (1 - chance)) ** 0.5)
    largest = math.log(MOST_TIMES)
    assert float(lit.max()) <= 1.0001 * largest
    assert float(lit.mean()) == pytest.approx(largest / 2, abs=4 * largest / math.sqrt(12 * len(lit)))


def test_exposures_are_dark_at_rest_or_blurred_in_light_by_both_cameras_and_gains():
    """The longest of 60 blurs that are uniform up to 60 px is above 54 px but for a chance of 0.9^60 = 0.002."""
    with torch.random.fork_rng(devices=[]):
        torch.default_generator.manual_seed(1)
        changes = list(exposures().changes)
        for number, change in enumerate(changes):
            seen = change(torch.rand(60, 3, 32, 32))
            assert float(seen.min()) >= 0
            assert float(seen.max()) <= 1
            drawn = change._params
            longest = float((drawn["exposure_s"] * drawn["speed_px_s"]).max())
            most = (8.0, 8.0, 60.0, 60.0)[number]
            assert 0.9 * most < longest <= 1.0001 * most
            assert set(drawn["camera_index"].tolist()) == {0, 1}
    assert [change.ranges.gain_db == 0.0 for change in changes] == [True, False, True, False]
