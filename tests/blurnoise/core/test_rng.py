"""The random contract: item i depends on its own seed alone."""

from __future__ import annotations

import math

import pytest
import torch

from blurnoise._core import rng


def test_item_depends_on_its_seed_alone() -> None:
    like = torch.empty(3, 2, 17, 19)
    together = rng.standard_normal([5, 6, 7], like)
    assert torch.equal(together[1:2], rng.standard_normal([6], like[:1]))
    assert torch.equal(together[[2, 0]], rng.standard_normal([7, 5], like[:2]))
    assert not torch.equal(together[0], together[1])


def test_bits_do_not_depend_on_threads() -> None:
    like = torch.empty(1, 3, 200, 300)
    before = torch.get_num_threads()
    fields = []
    for threads in (1, 2, 4):
        torch.set_num_threads(threads)
        fields.append((rng.standard_normal([3], like), rng.poisson(torch.full_like(like, 20.0), [3])))
    torch.set_num_threads(before)
    for normal, counts in fields[1:]:
        assert torch.equal(normal, fields[0][0])
        assert torch.equal(counts, fields[0][1])


def test_normal_moments() -> None:
    """n = 240000: mean within 5/sqrt(n) = 0.0102, variance within 5 sqrt(2/n) = 0.0145."""
    field = rng.standard_normal([11], torch.empty(1, 1, 400, 600)).double()
    assert float(field.mean()) == pytest.approx(0, abs=0.0102)
    assert float(field.var()) == pytest.approx(1, abs=0.0145)


def test_poisson_is_independent_of_the_normal_of_the_same_seed() -> None:
    """Correlation of n = 90000 independent pairs stays within 5/sqrt(n) = 0.0167."""
    like = torch.empty(1, 1, 300, 300)
    counts = rng.poisson(torch.full_like(like, 12.0), [4]).flatten()
    normal = rng.standard_normal([4], like).flatten()
    assert abs(float(torch.corrcoef(torch.stack([counts, normal]))[0, 1])) < 0.0167
    assert float(counts.mean()) == pytest.approx(12, abs=5 * math.sqrt(12 / counts.numel()))


def test_generator_gives_one_seed_per_item() -> None:
    first = rng.item_seeds(torch.Generator().manual_seed(9), 4)
    assert first == rng.item_seeds(torch.Generator().manual_seed(9), 4)
    assert first[:2] == rng.item_seeds(torch.Generator().manual_seed(9), 2)
    assert len(set(first)) == 4
    assert rng.item_seeds(3, 1) == [3]
    assert rng.item_seeds([3, 4], 2) == [3, 4]


@pytest.mark.parametrize("bad", [[1, 2, 3], 1])
def test_seed_count_must_match(bad: object) -> None:
    with pytest.raises(ValueError, match="one per item"):
        rng.item_seeds(bad, 2)  # type: ignore[arg-type]


@pytest.mark.parametrize("bad", [[0.5, 1.0], ["a", "b"], [-1, 2]])
def test_seeds_are_integers(bad: object) -> None:
    with pytest.raises(TypeError, match="generator"):
        rng.item_seeds(bad, 2)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("mean", "distance"), [(0.0, 0.0), (0.1, 1e-5), (3.0, 1e-5), (9.99, 2e-5), (10.0, 0.003), (100.0, 3e-4)]
)
def test_counts_of_a_normal_follow_poissons_law(mean: float, distance: float) -> None:
    """Equally likely z, a million of them: the counts' frequencies against the probabilities themselves."""
    z = torch.special.ndtri((torch.arange(1_000_000, dtype=torch.float64) + 0.5) / 1_000_000)
    counts = rng.poisson_of_normal(torch.full_like(z, mean), z).long()
    k = torch.arange(int(counts.max()) + 30, dtype=torch.float64)
    chances = torch.exp(k * math.log(mean) - mean - torch.lgamma(k + 1)) if mean else (k == 0).double()
    frequencies = torch.bincount(counts, minlength=len(k)).double() / len(z)
    assert float((frequencies - chances).abs().sum() / 2) <= distance
    if mean:  # a mean 10 % off would be noticed
        wrong = rng.poisson_of_normal(torch.full_like(z, 1.1 * mean), z).long()
        off = torch.bincount(wrong, minlength=len(k)).double()[: len(k)] / len(z)
        assert float((off - chances).abs().sum() / 2) > 3 * distance


def test_counts_depend_on_their_own_value_alone() -> None:
    mean = torch.tensor([0.0, 2.0, 9.999, 10.001, 1e3, 1e9])
    z = torch.tensor([1.3, -0.4, 2.2, 2.2, -3.0, 5.0])
    together = rng.poisson_of_normal(mean, z)
    alone = torch.cat([rng.poisson_of_normal(mean[i : i + 1], z[i : i + 1]) for i in range(6)])
    assert torch.equal(together, alone)
    assert torch.equal(together, together.round())
    assert float(together.min()) >= 0


def test_threads_draw_the_same_bits() -> None:
    like = torch.empty(5, 3, 150, 200)
    threads = torch.get_num_threads()
    try:
        fields = []
        for count in (1, 4):
            torch.set_num_threads(count)
            fields.append(rng.standard_normal([1, 2, 3, 4, 5], like))
    finally:
        torch.set_num_threads(threads)
    assert torch.equal(*fields)


def test_counts_from_cells_are_those_of_the_sum() -> None:
    """Random values, and values on and beside the edges of the cells and far out in the tails."""
    generator = torch.Generator().manual_seed(3)
    mean = torch.rand(60_000, generator=generator, dtype=torch.float64) * 10
    z = torch.randn(60_000, generator=generator, dtype=torch.float64) * 1.5
    edges = torch.arange(-300, 300, dtype=torch.float64) / 32
    nudged = torch.cat([edges, torch.nextafter(edges, edges + 1), torch.nextafter(edges, edges - 1)])
    mean = torch.cat([mean, nudged.abs().clamp(max=9.99), mean[: len(nudged)]])
    z = torch.cat([z, z[: len(nudged)], nudged])
    assert torch.equal(rng.poisson_of_normal(mean, z), rng._summed(mean, z))
