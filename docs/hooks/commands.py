"""The pages of the commands, made from the command line's own parser when the guide is built."""

from __future__ import annotations

import html
import re
from collections.abc import Iterator
from dataclasses import fields
from inspect import cleandoc
from typing import Any

from blurnoise_eval import cli
from blurnoise_eval.cli import COMMANDS
from blurnoise_eval.plan.files import PlanFile, ProgramFile, SceneFile
from blurnoise_eval.plan.settings import SettingInfo
from mkdocs.structure.files import File, Files


def on_config(config: Any) -> None:
    """A place in the navigation for every command."""
    section = next(entry for entry in config.nav if "Commands" in entry)
    section["Commands"] = ["commands/index.md", *({name: _path(name)} for name in COMMANDS)]


def on_files(files: Files, *, config: Any) -> None:
    """The pages themselves."""
    files.append(File.generated(config, "commands/index.md", content=_index()))
    files.append(File.generated(config, "files.md", content=_files()))
    for name in COMMANDS:
        files.append(File.generated(config, _path(name), content=_page(name)))


def _path(name: str) -> str:
    return f"commands/{name.replace(' ', '-')}.md"


def _index() -> str:
    lines = ["# Commands", "", "What `blurnoise COMMAND --help` says, from the same source.", ""]
    lines += ["| command | what it does |", "|---|---|"]
    lines += [
        f"| [`{name}`]({_path(name).removeprefix('commands/')}) | {about} |"
        for name, about in COMMANDS.items()
    ]
    return "\n".join([*lines, ""])


def _files() -> str:
    """What files of settings may hold, field by field."""
    lines = [
        "# Files of settings",
        "",
        "Rare settings stand in a file, YAML or JSON; what is left out is as usual.",
    ]
    lines += ["An option on the command line overrides the file.", ""]
    lines += ["```bash", "blurnoise sweep --save-plan plan.yaml   # every setting with its default, to edit"]
    lines += ["blurnoise sweep --plan plan.yaml --lux 1,10 -o run", "```"]
    for kind, title in (
        (PlanFile, "Plans of sweeps"),
        (SceneFile, "Scenes"),
        (ProgramFile, "Exposure programs"),
    ):
        lines += [
            "",
            f"## {title}",
            "",
            f"`{kind.KIND}`",
            "",
            "| setting | default | what it is |",
            "|---|---|---|",
        ]
        lines += [_setting(each) for each in kind.settings().values()]
    lines += ["", "## Records", "", "Settings that are mappings, with the fields of these records."]
    for record in PlanFile.records():
        names = ", ".join(f"`{each.name}`" for each in fields(record))
        about = cleandoc(record.__doc__ or "").split("\n\n")
        lines += [
            "",
            f"### {record.__name__}",
            "",
            f"{names}.",
            "",
            *(" ".join(part.split()) for part in about),
        ]
    return "\n".join([*lines, ""])


def _setting(setting: SettingInfo) -> str:
    default = "" if setting.default in (None, ()) else f"`{setting.default}`"
    return f"| `{setting.name}` | {default} | {_cell(setting.about)} |"


def _page(name: str) -> str:
    run = cli.function(name)
    command = cli.command(run)
    context = command.make_context(name, [], resilient_parsing=True)
    lines = [f"# blurnoise {name}", "", *_described(cleandoc(run.__doc__ or ""))]
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
        told = parameter.get_help_record(context)
        if told is not None:
            usual = "Arguments" if parameter.param_type_name == "argument" else "Options"
            found.setdefault(getattr(parameter, "rich_help_panel", None) or usual, []).append(told)
    found["Options"] = found.pop("Options")
    return {title: records for title, records in found.items() if records}


def _cell(text: str) -> str:
    return html.escape(" ".join(text.split())).replace("|", "&#124;").replace("*", "&#42;")
