"""What is enough: as stated or usual; and clusters of pictures by a pattern on their names."""

import numpy as np
import pytest
from blurnoise_eval.answers.clusters import check_cluster, cluster_of, repeated
from blurnoise_eval.answers.criterion import Criterion, criterion_for, names
from blurnoise_eval.plan.question import Question


@pytest.mark.parametrize(
    ("options", "rendered", "reads", "expected"),
    [
        ({}, False, False, Criterion(0.9, kept=True)),
        ({}, True, False, Criterion(0.6, kept=False)),
        ({}, False, True, Criterion(0.9, kept=True, score="exact_match")),
        ({}, True, True, Criterion(0.6, kept=False)),
        ({"keep": 0.8}, True, False, Criterion(0.8, kept=True)),
        ({"threshold": 0.3}, False, False, Criterion(0.3, kept=False)),
        ({"score": "ap50"}, False, False, Criterion(0.9, kept=True, score="ap50")),
        ({"score": "recall@0.05", "keep": 1.0}, False, False, Criterion(1.0, kept=True, score="recall@0.05")),
    ],
)
def test_what_is_usual(options, rendered, reads, expected):
    assert criterion_for(Question(**options), rendered=rendered, reads=reads) == expected


@pytest.mark.parametrize(
    ("options", "reads", "message"),
    [
        ({"keep": 0.9, "threshold": 0.6}, False, r"^keep = 0.9: cannot be combined with threshold = 0.6"),
        ({"keep": 1.5}, False, r"^keep = 1.5"),
        ({"keep": 0.0}, False, r"^keep = 0.0: must be .* > 0"),
        ({"threshold": -0.1}, False, r"^threshold = -0.1"),
        (
            {"score": "exact_match"},
            False,
            r"^score = 'exact_match': must be one of target_confidence, .* detectors",
        ),
        (
            {"score": "ap50"},
            True,
            r"^score = 'ap50': must be one of target_confidence, .*exact_match for text",
        ),
        ({"score": "recall@nan"}, False, r"^score = 'recall@nan'"),
        ({"score": "accuracy"}, False, r"^score = 'accuracy': must be one of"),
    ],
)
def test_what_cannot_be(options, reads, message):
    with pytest.raises(ValueError, match=message) as raised:
        criterion_for(Question(**options), rendered=False, reads=reads)
    assert "\n" not in str(raised.value)


def test_in_words():
    assert Criterion(0.9, kept=True).text == "keeps 0.9 of its confidence"
    assert Criterion(0.6, kept=False).text == "mean confidence 0.6"
    every = [name.replace("RATE", "2") for kind in ("detector", "reader") for name in names(kind)]
    assert len({Criterion(0.5, kept=True, score=name).text for name in every}) == len(set(every))


@pytest.mark.parametrize(
    ("pattern", "cluster"),
    [
        (None, "drive-07/frame_0012"),
        (r"drive-(\d+)", "07"),
        (r"drive-\d+", "drive-07"),
        (r"tour-(\d+)", "drive-07/frame_0012"),
        (r"drive-(x)?", "drive-07/frame_0012"),  # the group took no part
    ],
)
def test_pattern_names_the_cluster(pattern, cluster):
    assert cluster_of("drive-07/frame_0012", pattern) == cluster


def test_a_pattern_that_no_name_holds_is_refused():
    names = ["drive-07/frame_0012", "other"]
    check_cluster(None, names)
    check_cluster(r"drive-(\d+)", iter(names))
    told = r"^cluster = 'tour': must be found .* such as 'drive-07/frame_0012'$"
    with pytest.raises(ValueError, match=told):
        check_cluster("tour", names)
    with pytest.raises(ValueError, match=r"must be a regular expression"):
        check_cluster("(", names)


def looks(names, per_scene, seed=0):
    """Hashes of scenes that follow each other in the order of the names: 64 random bits, 3 of them turned in each."""
    rng = np.random.default_rng(seed)
    scene = [int.from_bytes(rng.bytes(8)) for _ in range(len(names))]
    turned = [sum(1 << int(bit) for bit in rng.choice(64, 3, replace=False)) for _ in names]
    return {name: f"{scene[n // per_scene] ^ turned[n]:016x}" for n, name in enumerate(names)}


def test_repeated_scenes_are_noticed_until_a_pattern_clusters_them():
    found = looks([f"scene_{n // 5:02d}_frame_{n % 5}.png" for n in range(60)], 5)
    assert repeated(found) == (
        "60 pictures show about 12 scenes but count as independent, so the intervals are too narrow. Give --cluster "
        "a pattern that finds the same text in the file names of one scene"
    )
    assert repeated(found, r"scene_(\d+)") is None
    names = [f"{n:04d}.png" for n in range(60)]
    few = looks(names, 1)
    assert repeated(few) is None
    assert repeated(few | {"0001.png": few["0000.png"], "0031.png": few["0030.png"]}) is None
    assert repeated(dict.fromkeys(names, "")) is None
    assert repeated({}) is None
