"""Clusters: pictures by a pattern on their names."""

from __future__ import annotations

import numpy as np
import pytest
from blurnoise_eval.answers.clusters import check_cluster, cluster_of, repeated


@pytest.mark.parametrize(
    ("pattern", "cluster"),
    [
        (None, "drive-07/frame_0012"),
        (r"drive-(\d+)", "07"),
        (r"drive-\d+", "drive-07"),
        (r"^(.*)/", "drive-07"),
        (r"(?:drive|tour)-(\d+)/(\w+)", "07"),
        (r"tour-(\d+)", "drive-07/frame_0012"),
        (r"drive-(x)?", "drive-07/frame_0012"),  # the group took no part
    ],
)
def test_pattern_names_the_cluster(pattern: str | None, cluster: str) -> None:
    assert cluster_of("drive-07/frame_0012", pattern) == cluster


def test_frames_of_one_drive_are_one() -> None:
    names = [f"drive-{drive}/frame_{frame}" for drive in (1, 2) for frame in range(3)]
    assert len({cluster_of(name, r"drive-\d+") for name in names}) == 2


@pytest.mark.parametrize("pattern", ["(", "a{2,1}", "*", "(?P<x"])
def test_other_patterns_are_refused(pattern: str) -> None:
    with pytest.raises(ValueError, match=r"cluster = .*: must be a regular expression"):
        cluster_of("a", pattern)


def test_a_pattern_that_no_name_holds_is_refused() -> None:
    names = ["drive-07/frame_0012", "other"]
    check_cluster(None, names)
    check_cluster(r"drive-(\d+)", iter(names))
    with pytest.raises(
        ValueError, match=r"^cluster = 'tour': must be found .* such as 'drive-07/frame_0012'$"
    ):
        check_cluster("tour", names)
    with pytest.raises(ValueError, match=r"must be a regular expression"):
        check_cluster("(", names)


def looks(names: list[str], per_scene: int, seed: int = 0) -> dict[str, str]:
    """Hashes of scenes that follow each other in the order of the names: 64 random bits, 3 of them turned in each."""
    rng = np.random.default_rng(seed)
    scene = [int.from_bytes(rng.bytes(8)) for _ in range(len(names))]
    turned = [sum(1 << int(bit) for bit in rng.choice(64, 3, replace=False)) for _ in names]
    return {name: f"{scene[n // per_scene] ^ turned[n]:016x}" for n, name in enumerate(names)}


def test_repeated_scenes_are_noticed_until_a_pattern_clusters_them() -> None:
    found = looks([f"scene_{n // 5:02d}_frame_{n % 5}.png" for n in range(60)], 5)
    assert repeated(found) == (
        "60 pictures show about 12 scenes but count as independent, so intervals are too narrow: give --cluster a "
        "pattern that finds the same in the file names of one scene"
    )
    assert repeated(found, r"scene_(\d+)") is None


def test_a_pattern_that_leaves_scenes_apart_is_not_enough() -> None:
    names = [f"scene_{n // 5:02d}_part_{n % 5 % 2}_{n}.png" for n in range(60)]
    told = repeated(looks(names, 5), r"(scene_\d+_part_\d)")
    assert told is not None
    assert told.startswith("the 24 clusters of pictures show about 12 scenes")


def test_unrelated_pictures_and_a_few_pairs_pass() -> None:
    names = [f"{n:04d}.png" for n in range(60)]
    assert repeated(looks(names, 1)) is None
    few = looks(names, 1)
    assert repeated(few | {"0001.png": few["0000.png"], "0031.png": few["0030.png"]}) is None
    assert repeated(dict.fromkeys(names, "")) is None
    assert repeated({}) is None


def test_of_very_many_pictures_some_are_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("blurnoise_eval.answers.clusters.MOST", 40)
    told = repeated(looks([f"{n // 20:02d}-{n % 20:02d}.png" for n in range(200)], 20))
    assert told is not None
    assert told.startswith("40 pictures show about 10 scenes")
