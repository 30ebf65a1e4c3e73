"""Clusters of pictures: those that were taken together and so count as one in every interval.

Domain: pictures' names as the store has them. Without a pattern each picture is a cluster of its own.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import lru_cache


def cluster_of(picture: str, pattern: str | None = None) -> str:
    """The cluster of a picture's name.

    pattern: a regular expression, found anywhere in the name; what its first group, or else all of it, matches
    names the cluster. A name that it does not match, or in which its group took no part, is a cluster of its own.
    Raises ``ValueError`` for a pattern that is not a regular expression.
    """
    if pattern is None:
        return picture
    compiled = _compiled(pattern)
    found = compiled.search(picture)
    if found is None:
        return picture
    shared = found.group(1 if compiled.groups else 0)
    return picture if shared is None else shared


def check_cluster(pattern: str | None, pictures: Iterable[str]) -> None:
    """Raises ``ValueError`` for a pattern that is not a regular expression, or is found in none of the names."""
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
