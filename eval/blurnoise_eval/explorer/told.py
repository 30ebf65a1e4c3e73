"""What is seen as others can repeat it: the command, and the Python script, that give the same picture bit for
bit."""

from __future__ import annotations

import shlex
from dataclasses import dataclass

from blurnoise_eval.explorer.state import BUILT_IN, NO_MODEL, OF_RUN, SIGN, State, option_text
from blurnoise_eval.grid import axes
from blurnoise_eval.grid.axes import AUTOMATIC


@dataclass(frozen=True)
class Files:
    """What a state's names stand for on disk: the picture's file or the run, the camera's, the model's; none
    for what is built in. model: none for a run's first model, too, and BUILT_IN for the built-in one before a run.
    images, trusted: as of :class:`~blurnoise_eval.explorer.runs.Run`."""

    where: str = ""
    images: str = ""
    trusted: bool = False
    camera: str = ""
    model: str = ""


def command(state: State, files: Files, output: str = "seen.png") -> str:
    """What to type for this picture."""
    words = ["blurnoise", "explore", *([files.where] if files.where else [])]
    words += ["--images", files.images] if files.images else []
    words += ["--trust"] if files.trusted else []
    if state.cell:
        words += ["--cell", state.cell]
    else:
        words += _picture(state)
        words += [] if state.camera == OF_RUN else ["--camera", files.camera or state.camera]
        words += [word for name, value in state.figures for word in ("--figure", f"{name}={value!r}")]
        stated = ((each, state.at[each.name]) for each in axes.AXES)
        words += [f"{each.option}={option_text(each, value)}" for each, value in stated if value is not None]
        words += ["--seed", str(state.seed)]
    if state.model == NO_MODEL or files.model:
        words += ["--model", files.model or NO_MODEL]
    return shlex.join([*words, "-o", output])


def _picture(state: State) -> list[str]:
    if state.picture.startswith(f"{OF_RUN}/"):
        return ["--picture", state.picture.removeprefix(f"{OF_RUN}/")]
    return (
        ["--sign", state.picture.removeprefix("sign-")]
        if is_sign(state.picture) and state.picture != SIGN
        else []
    )


def is_sign(picture: str) -> bool:
    """Whether the picture is one of the rendered stop signs."""
    return picture.startswith("sign-") and picture.removeprefix("sign-").isdecimal()


def python(state: State, files: Files, output: str = "seen.png") -> str:
    """A script for this picture, and for what the model finds in it."""
    imports, made = _scene(state, files)
    written = [f"write_picture(Path({output!r}), frame.image)"]
    if state.model != NO_MODEL:
        if not files.model and state.picture.startswith(f"{OF_RUN}/"):
            written += ["model = run.model(run.models[0])"]
        elif files.model in ("", BUILT_IN):
            imports += ["from blurnoise_eval.detectors.opening import open_models"]
            imports += ["from blurnoise_models.detector import STOP_SIGN"]
            written += ["(model,) = open_models([STOP_SIGN])"]
        else:
            imports += ["from blurnoise_eval.detectors.opening import open_models"]
            written += [f"(model,) = open_models([{files.model!r}])"]
        written += [
            "sight = view(model, picture, scene.image8).look(frame.image, frame.move_boxes, frame.sweep_boxes)",
            'print([round(target["confidence"], 3) for target in sight.targets])',
        ]
        imports += ["from blurnoise_eval.scoring.on_picture import view"]
    return "\n".join(["from pathlib import Path", "", *sorted(imports), "", *made, *written, ""])


def _scene(state: State, files: Files) -> tuple[list[str], list[str]]:
    """Imports, and the lines that make ``picture``, ``scene`` and ``frame``."""
    imports = ["from blurnoise_eval.datasets import write_picture"]
    of_run = state.picture.startswith(f"{OF_RUN}/")
    made = []
    if of_run:
        imports += ["from blurnoise_eval.explorer.runs import Run"]
        name = state.picture.removeprefix(f"{OF_RUN}/")
        given = f", {files.images!r}" if files.images else ""
        given += ", trusted=True" if files.trusted else ""
        made += [
            f"run = Run({files.where!r}{given})",
            f"picture = run.picture({name!r})",
            "scene = run.scene(picture)",
        ]
    elif files.where:
        imports += ["from blurnoise_eval.explorer.shelf import picture_of_file"]
        imports += ["from blurnoise_eval.sweep.exposing import Scene, frames"]
        made += [
            f"picture = picture_of_file({files.where!r})",
            "scene = Scene(picture.load(), picture=picture)",
        ]
    else:
        imports[0] = "from blurnoise_eval.datasets import rendered_signs, write_picture"
        imports += ["from blurnoise_eval.sweep.exposing import Scene, frames"]
        number = int(state.picture.removeprefix("sign-"))
        made += [
            f"picture = rendered_signs().pictures[{number - 1}]",
            "scene = Scene(picture.load(), picture=picture)",
        ]
    if state.cell:
        return imports, [*made, f"frame = run.expose(scene, run.cell({state.cell!r}))"]
    if state.camera == OF_RUN:
        camera = "run.camera"
    else:
        imports += ["from blurnoise import Camera"]
        camera = f"Camera.load({files.camera!r})" if files.camera else f"Camera.preset({state.camera!r})"
    if state.figures:
        imports += ["from blurnoise_eval.explorer.state import with_figures"]
        camera = f"with_figures({camera}, {state.figures!r})"
    imports += ["from blurnoise_eval.grid.conditions import Cell, Conditions"]
    stated = [f"    {name}={_number(value)}," for name, value in state.at.stated.items()]
    made += [f"camera = {camera}", "at = Conditions(", *stated, ")"]
    cell = f'Cell("seen", 0, at, seed={state.seed})'
    made += [
        f"frame = run.expose(scene, {cell}, camera)"
        if of_run
        else f"(frame,) = frames(scene, [{cell}], camera)"
    ]
    return imports, made


def _number(value: float) -> str:
    return 'float("inf")' if value == AUTOMATIC else repr(value)
