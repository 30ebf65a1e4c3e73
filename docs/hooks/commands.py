"""The pages of the commands, made from the command line's own parser when the guide is built."""

from __future__ import annotations

import html
import re
from collections.abc import Callable, Iterator
from typing import Any

import typer
from blurnoise_eval.cli import COMMANDS
from blurnoise_eval.cli._help import record
from mkdocs.structure.files import File, Files
from typer.main import get_command


def on_config(config: Any) -> None:
    """A place in the navigation for every command."""
    section = next(entry for entry in config.nav if "Commands" in entry)
    section["Commands"] = ["commands/index.md", *({_name(run): _path(run)} for run, _ in COMMANDS)]


def on_files(files: Files, *, config: Any) -> None:
    """The pages themselves."""
    files.append(File.generated(config, "commands/index.md", content=_index()))
    for run, _ in COMMANDS:
        files.append(File.generated(config, _path(run), content=_page(run)))


def _name(run: Callable[..., None]) -> str:
    return run.__name__.replace("_", " ")


def _path(run: Callable[..., None]) -> str:
    return f"commands/{run.__name__.replace('_', '-')}.md"


def _index() -> str:
    lines = ["# Commands", "", "What `blurnoise COMMAND --help` says, from the same source.", ""]
    lines += ["| command | what it does |", "|---|---|"]
    lines += [
        f"| [`{_name(run)}`]({_path(run).removeprefix('commands/')}) | {about} |" for run, about in COMMANDS
    ]
    return "\n".join([*lines, ""])


def _page(run: Callable[..., None]) -> str:
    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    app.command()(run)
    command = get_command(app)
    context = command.make_context(_name(run), [], resilient_parsing=True)
    lines = [f"# blurnoise {_name(run)}", "", *_described(command.help or "")]
    for title, records in _sections(command, context).items():
        lines += ["", f"## {title}", "", "| | |", "|---|---|"]
        lines += [f"| <code>{_cell(option)}</code> | {_cell(about)} |" for option, about in records]
    return "\n".join([*lines, ""])


def _described(text: str) -> Iterator[str]:
    """Paragraphs as they are; what is indented is an example, with its remark behind two spaces or more."""
    inside = False
    for line in text.splitlines():
        example = line.startswith("  ")
        if example != inside:
            yield "```bash" if example else "```\n"
        inside = example
        yield re.sub(r"(?<=\S) {2,}(?=\S)", "   # ", line[2:]) if example else line
    if inside:
        yield "```"


def _sections(command: Any, context: Any) -> dict[str, list[tuple[str, str]]]:
    found: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
    for parameter in command.get_params(context):
        told = record(parameter, context)
        if told is not None:
            usual = "Arguments" if parameter.param_type_name == "argument" else "Options"
            found.setdefault(getattr(parameter, "rich_help_panel", None) or usual, []).append(told)
    found["Options"] = found.pop("Options")
    return {title: records for title, records in found.items() if records}


def _cell(text: str) -> str:
    return html.escape(" ".join(text.split())).replace("|", "&#124;").replace("*", "&#42;")
