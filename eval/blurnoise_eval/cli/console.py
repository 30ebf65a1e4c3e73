"""What the commands print: facts, tables, assumptions and progress, on a terminal or as JSON."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from blurnoise_eval.system.terminal import say, say_json, show

if TYPE_CHECKING:
    from blurnoise.error_budget import Plan


def print_answers(found: list[dict[str, Any]], threshold: float) -> None:
    """One row per model, target and setting, one column per velocity: the recommended exposure and the window."""
    from rich.table import Table

    from blurnoise_eval.grid.axes import LIGHT, velocity_of, velocity_text
    from blurnoise_eval.report.settings import Setting, settings_of, word

    settings = settings_of(found)
    velocities = list(dict.fromkeys(map(velocity_of, found)))
    several = len({a["model"] for a in found}) > 1
    table = Table(
        title=f"Exposure to use, ms, and (range that keeps mean confidence >= {threshold:g}; < > reach the "
        "shortest or longest tested)",
        title_justify="left",
    )
    for head in (*(["model"] if several else []), "target"):
        table.add_column(head)
    for axis in settings.axes:
        table.add_column(axis.unit if axis is LIGHT else f"{word(axis)} {axis.unit}".strip(), justify="right")
    for velocity in velocities:
        table.add_column(velocity_text(velocity))
    rows: dict[tuple[str, str, Setting], dict[tuple[float, float], str]] = {}
    for answer in found:
        row = rows.setdefault((answer["model"], answer["group"], settings.of(answer)), {})
        row[velocity_of(answer)] = _answer_text(answer)
    for (model, group, setting), row in rows.items():
        named = (model, group) if several else (group,)
        numbers = (f"{axis.shown(value):g}" for axis, value in zip(settings.axes, setting, strict=True))
        table.add_row(*named, *numbers, *(row.get(velocity, "") for velocity in velocities))
    show(table)


def print_models(rows: list[dict[str, Any]]) -> None:
    """One row per model: how well it does when all is clean, how much of that it keeps, how long it takes."""
    from rich.table import Table

    table = Table(
        title="P: AP, or share of texts read right, in untouched pictures; mPC: its mean over all other "
        "conditions; AUC: mean confidence over the range",
        title_justify="left",
    )
    heads = ("model", "P", "mPC", "rPC", "AUC exposure", "AUC blur", "ms per picture (95 %), threads")
    for head in heads:
        table.add_column(head, justify="left" if head == "model" else "right")
    for row in rows:
        values = ("-" if row[name] is None else f"{row[name]:.3f}" for name in _MODEL_NUMBERS)
        took = "-"
        if row["latency_ms"] is not None:
            took = f"{row['latency_ms']:.1f} ({row['latency_p95_ms']:.1f}), {row['latency_threads']}"
        table.add_row(row["model"], *values, took)
    show(table)


_MODEL_NUMBERS = ("p", "mpc", "rpc", "auc_exposure", "auc_blur")


def _answer_text(answer: dict[str, Any]) -> str:
    if answer["recommended_s"] is None:
        return "none works"
    ends = [[f"{1e3 * low:.3g}", f"{1e3 * high:.3g}"] for low, high in answer["windows_s"]]
    ends[0][0] = ("<" if answer["open_low"] else "") + ends[0][0]
    ends[-1][1] = (">" if answer["open_high"] else "") + ends[-1][1]
    return f"{1e3 * answer['recommended_s']:g} ({', '.join('-'.join(pair) for pair in ends)})"


def print_assumptions(contract: Any, model: Path | None) -> None:
    """What a contract assumes for want of a word in the model file, on standard error."""
    stated = contract.to_dict()
    assumed = [name for name, source in stated["sources"].items() if source.startswith("assumed")]
    if not assumed or model is None:
        return
    values = {name: stated[name] for name in assumed}
    if "classes" in values:
        values["classes"] = f"the {len(contract.classes)} of COCO"
    say(
        f"assumed, since nothing in {model.name} says it: "
        + ", ".join(f"{name} {values[name]}" for name in assumed)
        + ".",
        f"State these in {model.with_suffix('.contract.json').name} beside it, or name a preset with "
        f"--contract {stated.get('family', 'ppocr')}.",
        error=True,
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
    width = max(map(len, facts))
    for name, value in facts.items():
        if isinstance(value, dict):
            value = [f"{key}: {_number(entry)}" for key, entry in value.items()]
        for line in value if isinstance(value, list) else [value]:
            say(f"{name:{width}s}  {_number(line)}")
            name = ""


def _number(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
