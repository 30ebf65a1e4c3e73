"""The original pictures of a finished run, opened again.

A run keeps no pictures but their names, hashes of their contents, and boxes. They are opened again and refused where
their content is another.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from blurnoise_eval import datasets
from blurnoise_eval.datasets import Picture, PictureSet
from blurnoise_eval.label_formats import format_named
from blurnoise_eval.store.store import PictureFacts
from blurnoise_eval.system.urls import is_url

Trusted = Callable[[str, str], Path]
"""The path of a file that a run names, by what it is and where; refuses one of a run that is not trusted."""
_RENDERED = re.compile(r"rendered (?P<sizes>[\d.-]+) px, (?P<number>\d+) of seed (?P<seed>\d+)")


def original_picture(name: str, facts: PictureFacts, opened: Callable[[], PictureSet]) -> Picture:
    """A picture of a run, in memory. A rendered one is rendered again; others are in the set that ``opened`` gives.

    Raises ``ValueError`` where it is missing, or has another content by now.
    """
    rendered = _RENDERED.fullmatch(facts.identity)
    if rendered:
        sizes = [float(size) for size in rendered["sizes"].split("-")]
        number, seed = int(rendered["number"]), int(rendered["seed"])
        pictures = datasets.rendered_signs(sizes, count=number + 1, seed=seed)
    else:
        pictures = opened()
    picture = next((candidate for candidate in pictures if candidate.name == name), None)
    if picture is None:
        raise ValueError(f"picture = {name!r}: is not in {pictures.source}")
    image = picture.load()
    if datasets.content(image) != facts.content:
        raise ValueError(f"picture = {name!r}: has changed since the run was computed")
    return replace(picture, load=lambda: image)


def pictures_of_run(note: Mapping[str, Any], folder: Path | None, trusted: Trusted) -> PictureSet:
    """The pictures that a manifest notes, by default where the sweep found them. folder: where they are by now."""
    source = note["source"]
    at = note.get("at", {})
    where = at.get("source", source)
    if note["kind"] == "folder":
        return datasets.image_folder(folder or trusted("images", where))
    labels = trusted("images", where)
    if folder is None and at and not is_url(at["folder"]):
        folder = trusted("images", at["folder"])
    labels_format = format_named(note["kind"])
    if labels_format is None or not labels.exists():
        raise ValueError(f"images = {source!r}: must be a folder with the pictures of the run")
    opened: PictureSet = labels_format.open(labels, **({"images": folder} if folder else {}))
    return opened
