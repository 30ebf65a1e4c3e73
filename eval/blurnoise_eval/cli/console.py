"""What the commands print: facts, tables, assumptions and progress, on a terminal or as JSON."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from blurnoise_eval.system.terminal import (
    PROSE,
    paragraph,
    say,
    say_json,
    say_wrapped,
    show,
    table_lines,
    width,
)

if TYPE_CHECKING:
    from blurnoise.optics.camera import Camera
    from blurnoise.scene.plan import Plan
    from blurnoise_eval.report.opening import Opening
    from blurnoise_eval.report.run import RunData


def print_opening(data: RunData) -> Opening:
    """What a run answers: the sentence, the table of light x speed, what limits, and how to be surer; in ASCII."""
    from blurnoise_eval.report.opening import MAX_ROWS, MAX_SPEEDS, opening, table_rows

    told = opening(data)
    for sentence in told.sentences:
        _say(sentence)
    if told.rows:
        for speeds in range(MAX_SPEEDS, -1, -1):  # as many as fit
            heads, rows, hidden = table_rows(told, MAX_ROWS, speeds)
            lines = table_lines(heads, rows, (False,) * len(heads), rule=False)
            if max(map(len, lines)) + 2 <= (width() or PROSE):
                break
        else:
            lines = table_lines(heads, rows, (False,) * len(heads), (width() or PROSE) - 2, rule=False)
        name = [f"{told.model}:"] if len(data.models) > 1 else []
        say("", *name, *(f"  {_in_ascii(line)}" for line in lines))
        _say(told.legend + (f"; {hidden} more cells: recommendations.csv" if hidden else ""), 2, 2)
    for title, text in told.notes:
        _say(f"{title}: {text}", hanging=len(title) + 2)
    return told


def _say(text: str, indent: int = 0, hanging: int = 0) -> None:
    say_wrapped(_in_ascii(text), indent, hanging)


def _in_ascii(line: str) -> str:
    for sign, letters in (("≤", "<="), ("≥", ">="), ("–", "-")):
        line = line.replace(sign, letters)
    return line


def print_assumptions(contract: Any, model: Path | None) -> None:
    """What a contract assumes for want of a word in the model file, on standard error."""
    stated = contract.to_dict()
    assumed = [name for name, source in stated["sources"].items() if source.startswith("assumed")]
    if not assumed or model is None:
        return
    values = {name: stated[name] for name in assumed}
    if "classes" in values:
        values["classes"] = f"the {len(contract.classes)} of COCO"
    told = ", ".join(f"{name} {values[name]}" for name in assumed)
    say_wrapped(f"assumed, since nothing in {model.name} says it: {told}.", error=True)
    say_wrapped(
        f"State these in {model.with_suffix('.contract.json').name} beside it, or name a preset with "
        f"--contract {stated.get('family', 'ppocr')}.",
        error=True,
    )


def print_camera(camera: Camera, *, colour: bool) -> None:
    """Which camera pictures in colour or grey meet, if nobody named one, or if it has three sensors."""
    from blurnoise_eval.sweep.default_camera import camera_text

    if told := camera_text(camera, colour=colour):
        say_wrapped(told, hanging=2, error=True)


def print_stages(needs: Plan, fidelity: str) -> None:
    """A scene's plan: a row per stage."""
    from rich.table import Table

    table = Table("stage", "DN RMS", "modelled", "how", title_justify="left")
    table.title = "What each stage contributes where the picture is white, in the order of the physics"
    for stage in needs.stages:
        kept = stage.kept or (fidelity == "full" and stage.contribution_dn > 0)
        how = stage.how if stage.kept or not kept else "asked for by --fidelity full"
        table.add_row(stage.name, f"{stage.contribution_dn:.3g}", "yes" if kept else "no", how)
    show(table)
    if fidelity == "auto":
        say(f"left out: {needs.left_out_dn:.2g} of at most {needs.tolerance_dn:g} DN RMS")


def print_facts(facts: dict[str, Any], as_json: bool) -> None:
    """Names and values, a line each, or one line of JSON."""
    if as_json:
        say_json(facts)
        return
    longest = max(map(len, facts))
    for name, value in facts.items():
        if isinstance(value, dict):
            value = [f"{key}: {_number(entry)}" for key, entry in value.items()]
        for line in value if isinstance(value, list) else [value]:
            _say_fact(f"{name:{longest}s}  {_number(line)}", longest + 2)
            name = ""


def _say_fact(line: str, hanging: int) -> None:
    """In the terminal's width, a path that does not fit left whole, to be copied."""
    wide = width()
    fits = wide and max(map(len, line.split())) <= wide - hanging
    say(*paragraph(line, wide, hanging=hanging) if fits else [line])


def _number(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
