"""A state of the explorer as a Python script, of names that blurnoise and blurnoise_eval export."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields

from blurnoise.optics.camera import Camera
from blurnoise_eval.explorer.run import Run
from blurnoise_eval.explorer.state import BUILT_IN, GIVEN, NO_MODEL, OF_RUN, State, with_figures
from blurnoise_eval.grid.axes import AUTOMATIC, CHOICES


def script(state: State, camera: Camera, run: Run | None, arguments: Mapping[str, str | bool]) -> str:
    """What writes the picture of a state, and prints what the model finds in it.

    camera: the state's, without its figures. arguments: that the explorer was started with.
    """
    given = {name: repr(arguments.get("where" if name == "picture" else name)) for name in _ENTRIES}
    picture, by, model = (_entry(name, getattr(state, name), given[name]) for name in _ENTRIES)
    of_run = state.picture.startswith(f"{OF_RUN}/")
    taken = [f"seed={state.seed}", *["run=run"] * of_run]
    taken += [f"{name}={_value(name, value)!r}" for name, value in state.at.stated.items() if value]
    figures = _arguments(_changed(camera, with_figures(camera, state.figures)))
    opened = {"images": arguments.get("images"), "trusted": arguments.get("trust")}
    options = _arguments({name: value for name, value in opened.items() if value})
    names = ["STOP_SIGN", "Detector", "Run", "datasets", "expose"]
    body = [
        *[f"run = Run({', '.join(filter(None, (repr(str(run.folder)), options)))})" for run in (run,) if run],
        f"picture = {picture}",
        f"camera = {by}",
        *[f"camera = replace(camera, {figures})"] * bool(figures),
        "seen = expose(",
        *(f"    {each}," for each in ("picture", "camera", *taken)),
        ")",
        "datasets.write_picture('seen.png', seen.image)",
        *[f"print({model}.detect(seen.image))"] * bool(model),
    ]
    used = [name for name in names if any(f"{name}{end}" in line for line in body for end in "(.)")]
    head = ["from dataclasses import replace", ""] if figures else []
    head += ["from blurnoise import Camera"] * any("Camera." in line for line in body)
    return "\n".join([*head, f"from blurnoise_eval import {', '.join(used)}", "", *body, ""])


_ENTRIES = ("picture", "camera", "model")


def _entry(kind: str, name: str, given: str) -> str:
    """An entry of the explorer in Python, empty for no model. given: the file that the explorer was started with."""
    if name.startswith(f"{OF_RUN}/"):
        return f"run.{kind}({name.removeprefix(f'{OF_RUN}/')!r})"
    if name.startswith("sign-"):
        return f"datasets.rendered_signs().pictures[{int(name.removeprefix('sign-')) - 1}]"
    special = {
        ("picture", GIVEN): f"datasets.read_picture({given})",
        ("camera", GIVEN): f"Camera.load({given})",
        ("camera", OF_RUN): "run.camera",
        ("model", GIVEN): f"Detector({given})",
        ("model", BUILT_IN): "Detector(STOP_SIGN)",
        ("model", NO_MODEL): "",
    }
    return special.get((kind, name), f"Camera.preset({name!r})")


def _value(name: str, value: float) -> float | str:
    """A value of an axis as :func:`blurnoise_eval.expose` takes it."""
    if value == AUTOMATIC:
        return "auto"
    return CHOICES[name][int(value)] if name in CHOICES else value


def _changed(own: Camera, camera: Camera) -> dict[str, object]:
    """The fields of a camera that differ from those of ``own``."""
    both = {entry.name: (getattr(own, entry.name), getattr(camera, entry.name)) for entry in fields(Camera)}
    return {name: new for name, (old, new) in both.items() if new != old}


def _arguments(values: Mapping[str, object]) -> str:
    return ", ".join(f"{name}={value!r}" for name, value in values.items())
