"""Clusters of pictures: pictures that are not independent, such as the frames of one drive, count as one.

Domain: pictures' names as the store has them. Without a pattern each picture is a cluster.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from functools import lru_cache

import numpy as np

from blurnoise_eval.datasets.likeness import MOST, scenes

# Intervals shrink with the root of the number of independent pictures.
_FEWER = 0.9  # of the pictures: so few scenes make intervals a twentieth too narrow


def cluster_of(picture: str, pattern: str | None = None) -> str:
    """The cluster of a picture's name.

    pattern: a regular expression that is searched in the name. The text of its first group, or of the whole match
    without a group, names the cluster. A picture whose name does not match is a cluster by itself.
    Raises ``ValueError`` for a pattern that is not a regular expression.

    >>> cluster_of("drive_12/frame_003.png", r"drive_(\\d+)"), cluster_of("alone.png", r"drive_(\\d+)")
    ('12', 'alone.png')
    """
    if pattern is None:
        return picture
    compiled = _compiled(pattern)
    match = compiled.search(picture)
    shared = None if match is None else match.group(1 if compiled.groups else 0)
    return picture if shared is None else shared


def check_cluster(pattern: str | None, pictures: Iterable[str]) -> None:
    """Raises ``ValueError`` for a pattern that is not a regular expression, or is found in none of the names.

    >>> check_cluster("drive", ["night_1.png"])
    Traceback (most recent call last):
        ...
    ValueError: cluster = 'drive': must be found in the names of pictures, such as 'night_1.png'
    """
    names = list(pictures)
    if pattern is not None and names and not any(_compiled(pattern).search(name) for name in names):
        raise ValueError(
            f"cluster = {pattern!r}: must be found in the names of pictures, such as {names[0]!r}"
        )


@lru_cache(maxsize=8)
def _compiled(pattern: str) -> re.Pattern[str]:
    try:
        return re.compile(pattern)
    except (re.error, RecursionError, OverflowError) as error:
        raise ValueError(f"cluster = {pattern!r}: must be a regular expression ({error})") from None


def repeated(looks: Mapping[str, str], pattern: str | None = None) -> str | None:
    """A warning where pictures show the same scenes but count as independent; None where few or none do.

    looks: by picture's name its :func:`~blurnoise_eval.datasets.likeness.perceptual_hash`, "" where there is none.
    pattern: what they are clustered by. Above ``MOST`` pictures as many of them, evenly spread, are compared.

    >>> looks = {f"frame_{number}.png": "" for number in range(3)}
    >>> repeated(looks) is None  # nothing is known of their looks
    True
    """
    names = sorted(looks)
    if len(names) > MOST:
        # Comparing all pairs takes time by the square of their number.
        names = [names[index] for index in np.linspace(0, len(names) - 1, MOST).round().astype(int).tolist()]
    clusters = [cluster_of(name, pattern) for name in names]
    count, apart = len(set(clusters)), len(set(scenes([looks[name] for name in names], clusters).tolist()))
    if apart >= _FEWER * count:
        return None
    pictures = f"{count} pictures" if pattern is None else f"the {count} clusters of pictures"
    return (
        f"{pictures} show about {apart} scene{'' if apart == 1 else 's'} but count as independent, so the intervals "
        "are too narrow. Give --cluster a pattern that finds the same text in the file names of one scene"
    )
