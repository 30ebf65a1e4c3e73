"""What the arms of a comparison do with the pictures of a training, and with how many of them."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch
from blurnoise_models.mixes import ARMS, MOST, Arm, InShare, augmentation, mix, mix_facts, share_at
from torch import Tensor, nn


@pytest.fixture(autouse=True)
def seeded() -> Iterator[None]:
    with torch.random.fork_rng(devices=[]):
        torch.default_generator.manual_seed(1)
        yield


def pictures(count: int) -> Tensor:
    return torch.rand(count, 3, 24, 24)


def changed(before: Tensor, after: Tensor) -> int:
    return int((before != after).flatten(1).any(1).sum())


def test_the_share_rises_stays_and_falls() -> None:
    shares = [share_at(done / 20) for done in range(21)]
    falling = [0.45 - 0.25 * step / 8 for step in range(1, 9)]
    assert shares == pytest.approx([0.45 * step / 6 for step in range(6)] + [0.45] * 7 + falling)


@pytest.mark.parametrize("arm", ARMS)
def test_as_many_pictures_change_in_both_arms(arm: Arm) -> None:
    """Of n pictures in each of which a change has a chance p, np change, but for sqrt(np(1 - p)).

    Of those that Kornia's chain gets, 1 in 25 has neither its blur nor its noise.
    """
    seen, in_training = pictures(240), mix(arm)
    assert torch.equal(in_training(seen, 0.0), seen)
    chance = {"none": 0.0, "kornia": 0.96 * MOST, "exposure": MOST}[arm]
    count = changed(seen, in_training(seen, 0.5))
    assert count == pytest.approx(240 * chance, abs=4 * (240 * chance * (1 - chance)) ** 0.5)


def test_every_part_gets_its_pictures_and_the_rest_stays() -> None:
    class To(nn.Module):
        def __init__(self, value: float) -> None:
            super().__init__()
            self.value = value

        def forward(self, seen: Tensor) -> Tensor:
            return torch.full_like(seen, self.value)

    seen = torch.zeros(4000, 1, 1, 1)
    values = InShare(0.6, [(2 / 3, To(1.0)), (1 / 3, To(2.0))])(seen).flatten()
    for value, chance in ((0.0, 0.4), (1.0, 0.4), (2.0, 0.2)):
        assert int((values == value).sum()) == pytest.approx(
            4000 * chance, abs=4 * (4000 * chance * (1 - chance)) ** 0.5
        )
    assert not seen.any()


def test_ours_blurs_as_far_as_kornias_and_is_dark_at_rest() -> None:
    ours = augmentation("exposure", 1.0)
    ours(pictures(120))
    dark, moving = ([each._params[name] for name in ("exposure_s", "speed_px_s")] for each in ours.changes)
    assert 48 < float((moving[0] * moving[1]).max()) <= 60.0001
    assert 6 < float((dark[0] * dark[1]).max()) <= 8.0001
    (chain,) = augmentation("kornia").changes  # type: ignore[misc]
    assert chain[0]._param_generator.kernel_size == (3, 61)


def test_networks_say_which_mix_they_have_seen() -> None:
    assert [mix_facts(arm) for arm in ARMS] == [{}, {"mix": 2}, {"mix": 2}]
