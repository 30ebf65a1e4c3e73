"""What the page shows as others can repeat it: the command, and the Python script, that give the same picture bit for
bit."""

from __future__ import annotations

import shlex
from dataclasses import fields, replace
from typing import Any

from blurnoise_eval.explorer.catalogue import Catalogue
from blurnoise_eval.explorer.state import GIVEN, NO_MODEL, OF_RUN, State


def command(catalogue: Catalogue, state: State, output: str = "seen.png") -> str:
    """What to type for this picture."""
    arguments, own = _elsewhere(catalogue, state)
    base = catalogue.base if own == state else replace(catalogue.base, picture=GIVEN, camera="", model="")
    words = ["blurnoise", "explore"]
    for name, value in arguments.items():
        if value:
            words += [] if name == "where" else [f"--{name}"]
            words += [] if value is True else [str(value)]
    return shlex.join([*words, "--at", own.query(base), "-o", output])


def python(catalogue: Catalogue, state: State, output: str = "seen.png") -> str:
    """A script for this picture, and for what the model finds in it."""
    arguments, own = _elsewhere(catalogue, state)
    usual = State()
    stated = [
        f"    {each.name}={getattr(own, each.name)!r},"
        for each in fields(own)
        if each.name == "at" or getattr(own, each.name) != getattr(usual, each.name)
    ]
    given = ", ".join(
        f"{name}={value if value is True else str(value)!r}" for name, value in arguments.items() if value
    )
    lines = [
        *(["from math import inf"] if own.at.automatic else []),
        "from pathlib import Path",
        "",
        "from blurnoise_eval.datasets import write_picture",
        "from blurnoise_eval.explorer.catalogue import Catalogue",
        "from blurnoise_eval.explorer.state import State",
        "from blurnoise_eval.grid.conditions import Conditions",
        "",
        f"catalogue = Catalogue({given})",
        "state = State(",
        *stated,
        ")",
        "found = catalogue.render(state)",
        f"write_picture(Path({output!r}), found.image)",
    ]
    if own.model != NO_MODEL:
        lines += ['print([round(target["confidence"], 3) for target in found.sight.targets])']
    return "\n".join([*lines, ""])


def _elsewhere(catalogue: Catalogue, state: State) -> tuple[dict[str, Any], State]:
    """What a catalogue elsewhere is made with, and the state in it: an upload is the file that it was. Raises
    ``ValueError`` for an upload before a run's camera."""
    arguments = dict(catalogue.arguments)
    if camera := catalogue.uploaded(state.camera):
        arguments["camera"] = camera.title
        state = replace(state, camera=GIVEN)
    if picture := catalogue.uploaded(state.picture):
        if state.camera == OF_RUN:
            raise ValueError("camera: the run's is not in a command for an uploaded picture; choose another")
        arguments |= {"where": picture.title, "images": None, "trust": False}
        own = state.model.removeprefix(f"{OF_RUN}/")
        if catalogue.run and own != state.model:
            arguments["model"] = catalogue.run.model_file(own)
            state = replace(state, model=GIVEN)
        state = replace(state, picture=GIVEN)
    return arguments, state
