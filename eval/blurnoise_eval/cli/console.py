"""What the commands print: facts, tables, assumptions and progress, on a terminal or as JSON."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from blurnoise_eval.system.layout import paragraph, table
from blurnoise_eval.system.terminal import say, say_json, say_wrapped, show, width

if TYPE_CHECKING:
    from blurnoise.error_budget import Plan
    from blurnoise_eval.report.data import RunData

MOST_ROWS = 9  # of those that decide; answers.csv has all


def print_opening(data: RunData) -> None:
    """What a run answers: the sentence, the four questions, and the rows that decide; in ASCII where it can be."""
    from blurnoise_eval.report import tables, words
    from blurnoise_eval.report.opening import opening

    told = opening(data)
    for sentence in told.sentences:
        _say(sentence)
    for question, text in told.questions:
        _say(f"{question:17s}{text}", hanging=17)
    rows = tables.deciding(data, told.rows, MOST_ROWS)
    if not rows:
        return
    asked = told.rows[0].shown["criterion"]
    heads = ["", "works up to", "use", "gain", "keeps" if " of its " in asked else asked.rpartition(" ")[0]]
    for row in rows:
        row["to"] = row["to"] or ("none works" if row["verdict"] == words.NONE_WORKS else row["verdict"])
    cells = [
        [_in_ascii(row[name] or "") for name in ("setting", "to", "use", "gain", "value")] for row in rows
    ]
    top, *bodies = table(heads, cells, (False, True, True, True, False), _within(2))
    say("", *(f"  {line}" for line in top))
    group = None
    for row, body in zip(rows, bodies, strict=True):
        if row["group"] != group:
            group = row["group"]
            _say(f"{f'{told.model}, ' if len(data.models) > 1 else ''}{group}, {row['pictures']}", hanging=4)
        say(*(f"  {line}" for line in body))
        for note in row["notes"]:
            _say(note, indent=6, hanging=8)
    if len(data.answers) == 1:
        return
    hidden = f"{len(told.rows) - len(rows)} more rows, and " if len(told.rows) > len(rows) else ""
    say("")
    _say(f"In answers.csv: {hidden}every {told.every} by itself.")


def _say(text: str, indent: int = 0, hanging: int = 0) -> None:
    say_wrapped(_in_ascii(text), indent, hanging)


def _within(indent: int) -> int | None:
    wide = width()
    return wide and wide - indent


def _in_ascii(line: str) -> str:
    for sign, letters in (("≤", "<="), ("≥", ">="), ("–", "-")):
        line = line.replace(sign, letters)
    return line


def print_models(rows: list[dict[str, Any]]) -> None:
    """One row per model: how well it does when all is clean, how much of that it keeps, how long it takes."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    on = sorted({f"{row['latency_threads']}" for row in rows if row["latency_threads"] is not None})
    threads = f", threads: {' or '.join(on)}" if on else ""
    table = Table(
        title="P: AP, or share of texts read right, in untouched pictures; mPC: its mean over all other "
        "conditions; uniform: over light x time and motion, whatever the grid; AUC: the area under the curves; "
        f"ms: per picture, median (95 %){threads}",
        title_justify="left",
        box=SIMPLE_HEAD,
        pad_edge=False,
        padding=(0, 1, 0, 0),
    )
    table.add_column("model", overflow="fold")
    for head in ("P", "mPC", "uniform", "rPC", "AUC\nexposure", "AUC\nblur", "ms"):
        table.add_column(head, justify="right", no_wrap=True)
    for row in rows:
        values = ("-" if row[name] is None else f"{row[name]:.3f}" for name in _MODEL_NUMBERS)
        took = "-" if row["latency_ms"] is None else f"{row['latency_ms']:.1f} ({row['latency_p95_ms']:.1f})"
        table.add_row(row["model"], *values, took)
    show(table)


_MODEL_NUMBERS = ("p", "mpc", "mpc_uniform", "rpc", "auc_exposure", "auc_blur")


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


def print_assumed(contract: Any, model: Path | None) -> None:
    """The same in one line: which fields."""
    sources = contract.to_dict()["sources"]
    assumed = [name.replace("_", " ") for name, source in sources.items() if source.startswith("assumed")]
    if assumed and model is not None:
        say_wrapped(f"{model.name}: assumed {', '.join(assumed)}; see blurnoise inspect", error=True)


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
