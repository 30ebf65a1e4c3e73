"""Output of the commands: facts and tables, on a terminal or as JSON."""

from __future__ import annotations

import shlex
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


def print_opening(data: RunData, run: str) -> None:
    """Print the answers of a run in ASCII: sentences, the table of lights and speeds of each model, limits, what to
    do next. run: the folder or URL of the run."""
    from blurnoise_eval.report.opening import MAX_ROWS, MAX_SPEEDS, opening, table_rows

    found, wide = opening(data, shlex.quote(run)), width() or PROSE
    for sentence in found.sentences:
        say_wrapped(_in_ascii(sentence))
    left_out = 0
    for table in (found, *found.further) if found.rows else ():
        for speeds in range(MAX_SPEEDS, -1, -1):  # as many as fit
            heads, rows, hidden = table_rows(table, MAX_ROWS, speeds)
            plain = (False,) * len(heads)
            lines = table_lines(heads, rows, plain, None if speeds else wide - 2, rule=False)
            if max(map(len, lines)) + 2 <= wide:
                break
        name = f"{table.model}: " if len(data.models) > 1 else ""
        say("")
        say_wrapped(_in_ascii(f"{name}{found.caption}" if table is found else name))
        say(*(f"  {_in_ascii(line)}" for line in lines))
        left_out += hidden
    if found.rows:
        more = f". {left_out} more entries: recommendations.csv" if left_out else ""
        say_wrapped(_in_ascii(found.legend + more), 2, 2)
    for title, text in found.notes:
        say_wrapped(_in_ascii(f"{title}: {text}"), hanging=2)
    for line in found.lights:
        say_wrapped(_in_ascii(line), hanging=2)


def _in_ascii(line: str) -> str:
    return line.replace("≤", "<=").replace("≥", ">=").replace("–", "-")


def print_stages(needs: Plan, fidelity: str) -> None:
    """Print a row for each stage of the simulation."""
    from rich.table import Table

    table = Table("stage", "DN RMS", "simulated", "how", title_justify="left")
    table.title = "Contribution of each stage at a white pixel, in causal order"
    for stage in needs.stages:
        kept = stage.kept or (fidelity == "full" and stage.contribution_dn > 0)
        how = stage.how if stage.kept or not kept else "fidelity: full"
        table.add_row(stage.name, f"{stage.contribution_dn:.3g}", "yes" if kept else "no", how)
    show(table)
    if fidelity == "auto":
        say(f"left out: {needs.left_out_dn:.2g} DN RMS in total; {needs.tolerance_dn:g} DN RMS is allowed")


def print_facts(facts: dict[str, Any], as_json: bool) -> None:
    """Print names and values, one per line, or one line of JSON."""
    if as_json:
        say_json(facts)
        return
    longest, wide = max(map(len, facts)) + 2, width()
    for name, value in facts.items():
        if isinstance(value, dict):
            value = [f"{key}: {_number(entry)}" for key, entry in value.items()]
        for entry in value if isinstance(value, list) else [value]:
            line = f"{name:{longest}s}{_number(entry)}"
            wraps = wide and len(line.split()) > 2  # a path or an option is left whole, to copy
            say(*paragraph(line, wide, hanging=longest, whole=True) if wraps else [line])
            name = ""


def _number(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
