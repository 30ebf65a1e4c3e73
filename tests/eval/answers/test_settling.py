"""Claims that an exposure is settled, on samples of pictures of which all are known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from blurnoise_eval.answers.recommendation import CANNOT_TELL, averages
from blurnoise_eval.answers.settling import SETTLED
from blurnoise_eval.datasets.coco_labels import coco
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.run.evaluation import evaluate
from made_tables import table

REAL = Path(__file__).parents[4] / "shared" / "real"
EXPOSURES_S = tuple(ms / 1e3 for ms in (0.5, 1, 2, 4, 8, 16, 32))
EDGES = {
    "narrow": (-2.6, -2.2, 0.25),
    "wide": (-3.0, -1.8, 0.25),
    "dark": (-1.8, -1.0, 0.3),
    "apart": (-2.6, -2.0, 0.45),
}
"""Log10 of the exposures, s, from which on pictures are light enough, and too blurred; by how much they differ."""
SETTLED_BY_20 = {"narrow": 0.8, "wide": 0.8, "dark": 0.9, "apart": 0.1}
"""So many samples of 20 pictures settle the exposure at least: 0.87, 0.92, 0.99 and 0.22 do."""


def pictures(rng, dark, bright, spread, count=64):
    """The kept share of each picture at each exposure, (count, E), and the scores in the originals, (count,)."""
    at = np.log10(EXPOSURES_S)
    rise, fall = (edge + spread * rng.normal(size=(count, 1)) for edge in (dark, bright))
    share = 1 / (1 + np.exp((rise - at) / 0.12)) / (1 + np.exp((at - fall) / 0.12))
    share += 0.1 * rng.normal(size=share.shape) * share * (1 - share)
    return share.clip(0, 1), rng.gamma(3, size=(count, 1))


def claims(of, parts):
    """Of each sample's cells: whether it is settled, what the choice loses in all pictures, and whether the verdict
    is known. of: of all pictures; parts: of each sample."""
    for part in parts:
        places = {each: place for place, each in enumerate(zip(of.settings, of.velocities_px_s, strict=True))}
        for place, own in enumerate(zip(part.settings, part.velocities_px_s, strict=True)):
            choice = part.choose([place])
            here = of.value[places[own]]
            lost = np.nanmax(here) - here[of.exposures_s.index(choice.exposure_s)]
            yield choice.settled.sure is True, float(lost), choice.verdict != CANNOT_TELL


def shares(found):
    """The share of cells that are settled, of those that lose more though they are, and of known verdicts."""
    sure, lost, known = (np.array(each) for each in zip(*found, strict=True))
    return float(sure.mean()), float((sure & (lost > SETTLED)).mean()), float(known.mean())


def made_up(share, score):
    sums = (share * score)[:, :, None]
    return averages([table(sums, EXPOSURES_S, counts=np.broadcast_to(score[:, :, None], sums.shape))], 0.9)


@pytest.mark.slow
@pytest.mark.parametrize("count", [12, 20, 35])
@pytest.mark.parametrize("edges", EDGES)
def test_claims_from_samples_of_64_pictures_are_wrong_in_5_percent_at_most(edges, count):
    rng = np.random.default_rng([count, len(edges)])
    found = []
    for _ in range(20):
        share, score = pictures(rng, *EDGES[edges])
        some = [rng.choice(64, count, replace=False) for _ in range(15)]
        found += claims(made_up(share, score), [made_up(share[each], score[each]) for each in some])
    settled, wrong, known = shares(found)
    print(f"{edges}, {count} pictures: settled {settled:.2f}, wrong {wrong:.3f}, verdict known {known:.2f}")
    assert wrong <= 0.05
    assert count != 20 or settled >= SETTLED_BY_20[edges]


@pytest.mark.slow
@pytest.mark.skipif(not (REAL / "models").is_dir(), reason="the shared photographs are absent")
def test_twenty_of_35_photographs_settle_exposures_long_before_levels_are_known(tmp_path):
    """Two real detectors, three lights, two speeds."""
    conditions = {"exposure_ms": [1e3 * each for each in EXPOSURES_S], "lux": [5, 50, 500], "dx": [0, 600]}
    models = [REAL / "models" / f"{name}.onnx" for name in ("yolox_nano", "fastestdet_upstream")]
    photographs, plan = coco(REAL / "photos" / "instances.json"), SweepPlan.of(conditions)
    run = evaluate(models, photographs, plan=plan, output=tmp_path / "run", strategy="grid")
    tables, rng = run.tables_with_answers(), np.random.default_rng(0)
    names = sorted({name for each in tables for name in each.clusters})

    def some(of, kept):
        places = [place for place, name in enumerate(of.clusters) if name in kept]
        clusters = tuple(of.clusters[place] for place in places)
        return replace(of, clusters=clusters, sums=of.sums[places], counts=of.counts[places])

    found = []
    samples = [set(rng.choice(names, 20, replace=False)) for _ in range(25)]
    parts = [run.averages([some(each, kept) for each in tables]) for kept in samples]
    for place, of in enumerate(run.averages(tables)):
        found += claims(of, [part[place] for part in parts])
    settled, wrong, known = shares(found)
    print(f"20 of 35 photographs: settled {settled:.2f}, wrong {wrong:.3f}, verdict known {known:.2f}")
    assert wrong <= 0.05
    assert settled >= max(0.6, 2 * known)
