"""What the commands print: facts, tables, assumptions and progress, on a terminal or as JSON."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from blurnoise_eval.system.terminal import say, say_json, show

if TYPE_CHECKING:
    from blurnoise.error_budget import Plan


def print_answers(found: list[dict[str, Any]], threshold: float) -> None:
    """A block per model, target and setting, a line per velocity: the verdict, or the window, the exposure to use
    with its confidence, and what it may lose; 80 columns unless names are long."""
    from blurnoise_eval.grid.axes import AUTOMATIC, velocity_of
    from blurnoise_eval.report import words
    from blurnoise_eval.report.settings import Setting, settings_of

    if not found:
        return
    settings = settings_of(found)
    several = len({answer["model"] for answer in found}) > 1
    say(
        f"Exposures, ms, that keep mean confidence at or above {threshold:g}, 95 % intervals",
        "over pictures; <= and >=: as far as was tested. use: one of them, its",
        "confidence, and what it loses at most against the best tested; (use): a guess.",
    )
    if left := [axis.text(value) for axis, value in settings.held if value == AUTOMATIC]:
        say(f"With {', '.join(left)}.")
    blocks: dict[tuple[str, str, Setting], list[dict[str, Any]]] = {}
    for answer in found:
        blocks.setdefault((answer["model"], answer["group"], settings.of(answer)), []).append(answer)
    for (model, group, setting), answers in blocks.items():
        named = (model, group) if several else (group,)
        counted = max(answers, key=lambda answer: answer["n_pictures"])
        few = " (few)" if any(answer["few_pictures"] for answer in answers) else ""
        where = settings.text(setting).replace(" · ", ", ")
        say("", ", ".join((*named, where, words.pictures_text(counted) + few)))
        say(_line("px/s", "works from, to", "use", "confidence", "loses"))
        for answer in answers:
            x, y = velocity_of(answer)
            for line in _answer_lines(f"{x:g}" if y == 0 and x >= 0 else f"{x:g},{y:g}", answer):
                say(_in_ascii(line))


def _line(speed: str, window: str, use: str, confidence: str, loses: str) -> str:
    return f"{speed:>8s}  {window:33s} {use:>6s}  {confidence:17s} {loses}".rstrip()


def _answer_lines(speed: str, answer: dict[str, Any]) -> list[str]:
    from blurnoise_eval.grid.axes import milliseconds
    from blurnoise_eval.report import words

    if answer["verdict"] == words.NONE_WORKS:
        return [_line(speed, f"{words.NONE_WORKS}; {words.best_text(answer)}", "", "", "")]
    used = answer["recommended_s"]
    use = "" if used is None else milliseconds(used)
    confidence = "" if used is None else words.confidence_text(answer)
    loses = "" if answer["regret_95"] is None else f"{answer['regret_95']:.3f}"
    if answer["verdict"] == words.CANNOT_TELL:
        told = f"{answer['verdict']}; {words.needed_text(answer)}"
        if used is None:
            return [_line(speed, f"{told}; {words.best_text(answer)}", "", "", "")]
        return [_line(speed, told, f"({use})", confidence, loses)]
    windows = [f"{low} to {high}" for low, high in words.window_ends(answer)]
    lines = [_line(speed, windows[0], use, confidence, loses)]
    lines += [_line("", f"and {window}", "", "", "") for window in windows[1:]]
    notes = words.reservations(answer)[answer["few_pictures"] :]  # the block's head says that they are few
    return [*lines, *(f"{'':12s}{note}" for note in notes)]


def _in_ascii(line: str) -> str:
    for sign, plain in (("≤", "<="), ("≥", ">="), ("–", "-")):
        line = line.replace(sign, plain)
    return line


def print_models(rows: list[dict[str, Any]]) -> None:
    """One row per model: how well it does when all is clean, how much of that it keeps, how long it takes."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(
        title="P: AP, or share of texts read right, in untouched pictures; mPC: its mean over all other "
        "conditions; uniform: over light x time and motion, whatever the grid; AUC: mean confidence over the range; "
        "ms: per picture, median and 95 %",
        title_justify="left",
        box=SIMPLE_HEAD,
        pad_edge=False,
    )
    for head in ("model", "P", "mPC", "uniform", "rPC", "AUC exposure", "AUC blur", "ms, threads"):
        table.add_column(head, justify="left" if head == "model" else "right", overflow="fold")
    for row in rows:
        values = ("-" if row[name] is None else f"{row[name]:.3f}" for name in _MODEL_NUMBERS)
        took = "-"
        if row["latency_ms"] is not None:
            took = f"{row['latency_ms']:.1f} ({row['latency_p95_ms']:.1f}), {row['latency_threads']}"
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
