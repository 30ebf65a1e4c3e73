from __future__ import annotations

import csv
import json
import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from blurnoise_eval.bench import laws, noise, noise_view, samplers
from blurnoise_eval.bench.laws import Converter
from blurnoise_eval.bench.noise import Bench, Extent, Row
from blurnoise_eval.bench.timing import Quartiles
from blurnoise_eval.cli import main
from scipy.stats import binom, norm, poisson

Output = pytest.CaptureFixture[str]
TINY = Extent((1, 10, 100), shape=(2, 1, 101, 97), fewest=1, most=2, seconds=0)
NAMES = [sampler.name for sampler in samplers.samplers()]


@pytest.mark.parametrize("read_noise_e", [0.3, 2.44])
@pytest.mark.parametrize("gain", [0.7, 1.0, 3.0])
@pytest.mark.parametrize("mean_e", [0.1, 3.0, 40.0, 5000.0])
def test_exact_law_has_the_closed_forms_moments(mean_e: float, gain: float, read_noise_e: float) -> None:
    """Mean black + K mu, variance K^2 (mu + read^2) + 1/12, third moment K^3 mu.

    Rounding adds 1/12 up to its error for a lattice of counts, below 0.2 DN^2 at 0.3 e-; the third moment is
    compared where the noise is wide enough in DN for rounding to be white.
    """
    law = laws.exact(mean_e, Converter(read_noise_e, gain, 64.0, 65535))
    dn = np.arange(len(law))
    assert law.sum() == pytest.approx(1, abs=1e-9)
    mean = law @ dn
    white = gain * read_noise_e > 0.6
    assert mean == pytest.approx(64 + gain * mean_e, abs=1e-3 if white else 0.1)
    variance = gain**2 * (mean_e + read_noise_e**2)
    assert law @ (dn - mean) ** 2 == pytest.approx(variance + 1 / 12, abs=2e-3 * variance if white else 0.2)
    assert abs(law @ (dn - mean) ** 2 - 1.1 * variance) > 1e-2 * variance
    if white:
        assert law @ (dn - mean) ** 3 == pytest.approx(gain**3 * mean_e, rel=0.02)


def test_exact_law_by_hand() -> None:
    """1 e-, 0.3 e- read noise, 1 DN/e-, black 2, 4 bits: n electrons are 2 + n within half a DN by Phi.

    Two DN away lies a chance of 3e-7.
    """
    law = laws.exact(1.0, Converter(0.3, 1.0, 2.0, 15))
    stays = 1 - 2 * norm.sf(0.5 / 0.3)
    moves = norm.sf(0.5 / 0.3) - norm.sf(1.5 / 0.3)
    chances = poisson.pmf(np.arange(4), 1.0)
    assert law[1] == pytest.approx(chances[0] * moves, rel=1e-4)
    assert law[2] == pytest.approx(chances[0] * stays + chances[1] * moves, rel=1e-4)
    assert law[3] == pytest.approx(chances[1] * stays + (chances[0] + chances[2]) * moves, rel=1e-4)


def test_limits_hold_what_lies_beyond() -> None:
    law = laws.exact(100.0, Converter(2.44, 1.0, 0.0, 63))
    assert law[63] == pytest.approx(1, abs=1e-4)
    dark = laws.exact(1e-9, Converter(2.0, 1.0, 0.0, 63))
    assert dark[0] == pytest.approx(norm.cdf(0.25), rel=1e-6)


def test_distance() -> None:
    one, other = np.array([0.5, 0.5, 0.0]), np.array([0.25, 0.25, 0.5])
    assert laws.distance(one, other) == 0.5
    assert laws.distance(one, one) == 0
    assert laws.distance(np.eye(3)[0], np.eye(3)[1]) == 1


def test_frequencies() -> None:
    assert laws.of_values(np.array([[1.0, 3.0], [3.0, 3.0]], np.float32), 4).tolist() == [0, 0.25, 0, 0.75, 0]


def test_floor_is_the_binomials_mean_deviation() -> None:
    """By summing |k/n - p| over the binomial law of every cell; 1/n too few or too many would show."""
    law, samples = np.array([0.0, 0.03, 0.17, 0.3, 0.5]), 37
    counts = np.arange(samples + 1)
    expected = sum(0.5 * binom.pmf(counts, samples, p) @ abs(counts / samples - p) for p in law)
    assert laws.floor(law, samples) == pytest.approx(expected, rel=1e-9)
    assert laws.floor(law, samples + 1) != pytest.approx(expected, rel=1e-3)
    assert laws.floor(np.array([0.0, 1.0]), 5) == 0


@pytest.mark.parametrize("read_noise_e", [0.3, 2.44])
@pytest.mark.parametrize("mean_e", [3.0, 100.0])
def test_exact_samples_are_at_the_floor_and_wrong_ones_are_not(mean_e: float, read_noise_e: float) -> None:
    """200000 samples by scipy, within 5 deviations of 0.5 / sqrt(n) at most; 10 % more light is far off."""
    converter, samples = Converter(read_noise_e), 200_000
    law = laws.exact(mean_e, converter)
    random = np.random.default_rng(3)

    def estimate(mean: float) -> float:
        electrons = poisson.rvs(mean, size=samples, random_state=random)
        electrons = electrons + random.normal(0, read_noise_e, samples)
        return laws.distance(laws.of_values(np.round(electrons + 32).clip(0), 65535), law)

    floor, tolerance = laws.floor(law, samples), 5 * laws.spread(samples)
    assert estimate(mean_e) == pytest.approx(floor, abs=tolerance)
    assert estimate(1.1 * mean_e) > floor + 3 * tolerance


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("read_noise_e", [0.3, 2.44])
def test_samplers_draw_their_mean_and_variance(name: str, read_noise_e: float) -> None:
    """n = 160000 at 30 e-: mean and variance within 5 deviations (kurtosis of Poisson below 0.1)."""
    sampler = next(each for each in samplers.samplers() if each.name == name)
    mean_e = torch.full((2, 1, 250, 320), 30.0)
    dn = sampler.draw(mean_e, Converter(read_noise_e)).double()
    assert dn.shape == mean_e.shape
    assert torch.equal(dn, dn.round())
    assert float(mean_e.min()) == float(mean_e.max()) == 30  # the means are only read
    variance, n = 30 + read_noise_e**2 + 1 / 12, dn.numel()
    assert float(dn.mean()) == pytest.approx(62, abs=5 * math.sqrt(variance / n))
    assert float(dn.var()) == pytest.approx(variance, rel=5 * math.sqrt(2.1 / n))


@pytest.mark.parametrize("read_noise_e", [0.3, 2.44])
@pytest.mark.parametrize("name", ["auto", "plain normal"])
def test_integrated_law_is_the_drawn_one(name: str, read_noise_e: float) -> None:
    """Samples of the sampler are at the floor of its own law, and one without Poisson's skewness is not."""
    sampler = next(each for each in samplers.samplers() if each.name == name)
    mean_e, converter = torch.full((2, 1, 300, 300), 12.0), Converter(read_noise_e)
    law = sampler.law(mean_e, converter, samplers.equal_chances(mean_e.shape))
    assert law.sum() == pytest.approx(1)
    drawn = laws.of_values(sampler.draw(mean_e, converter).numpy(), 65535)
    tolerance = 5 * laws.spread(mean_e.numel())
    assert laws.distance(drawn, law) == pytest.approx(laws.floor(law, mean_e.numel()), abs=tolerance)
    far = laws.distance(law, laws.exact(12.0, converter))
    assert (far > 0.01) == (name == "plain normal")


def test_equal_chances_are_the_normals_quantiles() -> None:
    values = samplers.equal_chances((2, 1, 50, 50)).double().flatten()
    assert torch.equal(values, values.sort().values)
    assert float(values[1249]) == pytest.approx(norm.ppf(1249.5 / 5000), rel=1e-6)
    assert float(values.square().mean()) == pytest.approx(1, abs=2e-3)


@pytest.fixture(scope="module")
def tiny() -> tuple[Bench, float]:
    shares: list[float] = []
    bench = noise.measure(TINY, 1, shares.append)
    return bench, sum(shares)


def test_bench_measures_everything(tiny: tuple[Bench, float]) -> None:
    bench, done = tiny
    assert done == pytest.approx(noise.steps(TINY))
    assert len(bench.rows) == 3 * 2 * len(NAMES)
    for row in bench.rows:
        assert 0 < row.ns.low <= row.ns.median <= row.ns.high
        assert row.to_randn > 0
        assert (row.integrated is None) == (row.sampler not in ("auto", "plain normal"))
        assert not bench.noticed(row) or row.sampler == "plain normal"
    assert bench.noticed(bench.row("plain normal", 0.3, 1))
    assert bench.row("plain normal", 0.3, 1).distance > 0.1


def test_bench_is_written_whole(tiny: tuple[Bench, float], tmp_path: Path) -> None:
    bench, _ = tiny
    noise.write(bench, tmp_path)
    noise_view.write(bench, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["noise.csv", "noise.json", "noise.png"]
    with (tmp_path / "noise.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["sampler"] for row in rows] == [row.sampler for row in bench.rows]
    assert [float(row["ns_median"]) for row in rows] == [row.ns.median for row in bench.rows]
    assert [row["integrated"] == "" for row in rows] == [row.integrated is None for row in bench.rows]
    document = json.loads((tmp_path / "noise.json").read_text())
    assert len(document["rows"]) == len(rows)
    assert list(document["samplers"]) == NAMES
    picture = cv2.imread(str(tmp_path / "noise.png"))
    assert picture.shape[0] > 400
    assert picture.std() > 10


@pytest.mark.parametrize(("means", "panels"), [((1,), 1), ((1, 10, 100), 3)])
def test_chart_has_a_panel_for_each_mean(
    tiny: tuple[Bench, float], means: tuple[float, ...], panels: int
) -> None:
    figure = noise_view.chart(replace(tiny[0], extent=replace(TINY, means_e=means)))
    figure.draw_without_rendering()
    assert [axes.get_title() for axes in figure.axes] == [f"{mean:g} e-" for mean in means]
    assert len(figure.axes) == panels


def test_losses_are_told() -> None:
    """Less time by more than 2 %, a distance below auto's by more than sampling can feign."""

    def row(name: str, ns: float, integrated: float | None, sampled: float = 0.01) -> Row:
        return Row(name, 0.3, 10, Quartiles(ns, ns, ns), ns / 4, sampled, 0.01, integrated)

    def losses(auto: Row, theirs: Row, plain: Row) -> list[str]:
        every = [
            each for each in samplers.samplers() if each.name in ("auto", "torch.poisson", "plain normal")
        ]
        extent = Extent((10,), (0.3,), (1, 1, 1000, 1000))  # three deviations are 0.0015
        return Bench([auto, theirs, plain], extent, every, {}).losses()

    auto, slow = row("auto", 10, 0.002), row("plain normal", 9.9, 0.04)
    assert losses(auto, row("torch.poisson", 60, None, 0.0106), slow) == []
    assert losses(auto, row("torch.poisson", 60, None), row("plain normal", 5, 0.04)) == [
        "read noise 0.3 e-: torch.poisson is closer to the exact law than auto, off by 0.0020 at 10 e-",
        "read noise 0.3 e-: plain normal takes less time than auto: 0.50 of it at 10 e-",
    ]


@pytest.mark.slow
def test_command(tmp_path: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(noise, "QUICK", TINY)
    monkeypatch.chdir(tmp_path)
    assert main(["bench", "noise", "--quick", "--threads", "1"]) == 0
    shown = capsys.readouterr().out
    assert all(f"{name}, 0.3 e-" in shown for name in NAMES)
    assert "open bench-noise/noise.png" in shown
    names = sorted(path.name for path in (tmp_path / "bench-noise").iterdir())
    assert names == ["noise.csv", "noise.json", "noise.png"]
    assert main(["bench", "noise", "--quick", "--threads", "1", "-o", "other", "--json"]) == 0
    written = (tmp_path / "other" / "noise.json").read_text()
    assert json.loads(capsys.readouterr().out) == json.loads(written)


def test_quick_is_a_part_of_the_whole() -> None:
    assert set(noise.QUICK.means_e) < set(noise.FULL.means_e)
    assert noise.QUICK.samples < noise.FULL.samples
