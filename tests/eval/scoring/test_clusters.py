"""Clusters: pictures by a pattern on their names."""

from __future__ import annotations

import pytest
from blurnoise_eval.scoring.clusters import check_cluster, cluster_of


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
