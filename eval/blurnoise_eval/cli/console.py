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
    from blurnoise.scene.plan import Plan
    from blurnoise_eval.report.run import RunData


def print_opening(data: RunData) -> None:
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


def _say(text: str, indent: int = 0, hanging: int = 0) -> None:
    say_wrapped(_in_ascii(text), indent, hanging)


def _in_ascii(line: str) -> str:
    for sign, letters in (("≤", "<="), ("≥", ">="), ("–", "-")):
        line = line.replace(sign, letters)
    return line


def print_assumptions(contract: Any, model: Path | None) -> None:
    """What a contract assumes for want of a word in the model file, on standard error."""
    fields = contract.to_dict()
    assumed = [name for name, source in fields["sources"].items() if source.startswith("assumed")]
    if not assumed or model is None:
        return
    fields["classes"] = f"the {len(contract.classes)} of COCO"
    text = ", ".join(f"{name} {fields[name]}" for name in assumed)
    own = model.with_suffix(".contract.json").name
    say_wrapped(f"assumed, since nothing in {model.name} says it: {text}.", error=True)
    say_wrapped(
        f"State these in {own} beside it, or name a preset: --contract {contract.family}.", error=True
    )


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
        for entry in value if isinstance(value, list) else [value]:
            line, wide = f"{name:{longest}s}  {_number(entry)}", width()
            fits = (
                wide and max(map(len, line.split())) <= wide - longest - 2
            )  # else a path is left whole, to copy
            say(*paragraph(line, wide, hanging=longest + 2) if fits else [line])
            name = ""


def _number(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
