"""How help looks: prose and options in the terminal's width, examples to be copied; plain text.

Commands of many options show the usual ones, and name the rest; ``--help-all`` explains every one.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any

from typer.core import TyperCommand, TyperGroup

from blurnoise_eval.system.layout import cell_len, paragraph

HELP_NAMES = ["-h", "--help", "--help-all"]
USUAL: dict[str, tuple[str, ...]] = {
    "sweep": (
        "model", "images", "coco", "target", "limit", "exposure_s", "illuminance_lux", "velocity_x_px_s", "keep",
        "camera", "threads", "output", "as_json",
    ),
    "decide": (
        "model", "images", "coco", "target", "limit", "exposure_s", "illuminance_lux", "velocity_x_px_s", "keep",
        "regret", "camera", "threads", "output", "as_json",
    ),
    "simulate": (
        "image", "output", "exposure_ms", "lux", "dx", "dy", "camera", "gain_db", "f_number", "seed", "explain",
        "as_json",
    ),
}  # fmt: skip
"""Of commands with more options than a screen has lines: the parameters that the first screen explains."""
_BESIDE = 64
"""Columns from which on what is said of an option stands beside it."""


class _Described:
    """Help with the description as :func:`described` has it."""

    help: str | None

    def get_help_option_names(self, ctx: Any) -> list[str]:
        """In this order."""
        return HELP_NAMES

    def format_help_text(self, ctx: Any, formatter: Any) -> None:
        """Write the description."""
        formatter.write("".join(f"\n{line}" for line in described(self.help or "", formatter.width)) + "\n")


class Command(_Described, TyperCommand):
    """A command whose options stand under the title of their panel."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Arguments by their names alone."""
        return [re.sub(r"[{}]|\\.{3}$", "", piece) for piece in super().collect_usage_pieces(ctx)]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments, then options, a section per panel; the names alone of what only some need."""
        usual = None if ctx.find_root().obj else USUAL.get(ctx.info_name)
        sections: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        others: dict[str, list[str]] = {}
        for param in self.get_params(ctx):
            told = record(param, ctx)
            if told is None:
                continue
            section = "Arguments" if param.param_type_name == "argument" else "Options"
            section = getattr(param, "rich_help_panel", None) or section
            if usual is None or param.name in usual or "--help" in param.opts:
                sections.setdefault(section, []).append(told)
            else:
                others.setdefault(section, []).append(param.opts[-1])
        sections["Options"] = sections.pop("Options")  # the others first, as they are said
        for title, records in sections.items():
            if records:
                with _section(formatter, title):
                    _write(formatter, records)
        if others:
            with _section(formatter, f"More, explained by 'blurnoise {ctx.info_name} --help-all'"):
                for title, names in others.items():
                    text = f"{re.split('[,;]| [(]', title)[0]}: {', '.join(names)}"
                    formatter.write("".join(f"{line}\n" for line in paragraph(text, formatter.width, 2, 6)))


def record(param: Any, ctx: Any) -> tuple[str, str] | None:
    """An option or argument as it is typed, and what is said of it; of types of arguments only their choices."""
    told: tuple[str, str] | None = param.get_help_record(ctx)
    if told is None or param.param_type_name != "argument":
        return told
    return re.sub(r" <[\w\[\]]+>$", "", told[0]), told[1]


def _write(formatter: Any, records: Sequence[tuple[str, str]]) -> None:
    """In two columns, or in a narrow terminal each option above what is said of it."""
    indent = formatter.current_indent
    typed = ["\n".join(_typed(name, formatter.width, indent)) for name, _ in records]
    if formatter.width >= _BESIDE:
        formatter.write_dl([(name, about) for name, (_, about) in zip(typed, records, strict=True)])
        return
    for name, (_, about) in zip(typed, records, strict=True):
        lines = paragraph(" ".join(about.split()), formatter.width, 6, 6) if about else []
        formatter.write("".join(f"{line}\n" for line in [" " * indent + name, *lines]))


def _typed(name: str, width: int, indent: int) -> list[str]:
    """An option with its choices, in more lines where they do not fit into one."""
    lines = [""]
    for part in re.findall(r"[^|]+\|?", name):
        if lines[-1] and indent + cell_len(lines[-1] + part) > width:
            lines.append(" " * (indent + 4))
        lines[-1] += part
    return lines


def _section(formatter: Any, title: str) -> Any:
    return formatter.section("\n".join(paragraph(title, formatter.width - 1)))


class Program(_Described, TyperGroup):
    """The program itself."""


def described(text: str, width: int) -> Iterator[str]:
    """Lines of a description: prose is wrapped; an example that does not fit has its comment below it, and is broken
    as a shell reads it."""
    for number, part in enumerate(text.strip("\n").split("\n\n")):
        lines = part.splitlines()
        if number:
            yield ""
        if not part.startswith("  "):
            yield from paragraph(" ".join(lines), width)
        for line in lines if part.startswith("  ") else ():
            example, gap, comment = line.strip().partition("  ")
            if len(line) <= width:
                yield line
                continue
            beside = line.rfind(comment.strip()) if gap else width
            if beside <= width // 3 and not example.startswith("blurnoise "):
                yield from paragraph(line, width, hanging=beside)
                continue
            yield from _broken(line if not gap else f"  {example}", width)
            if gap:
                yield from paragraph(comment.strip(), width, 6, 6)


def _broken(example: str, width: int) -> Iterator[str]:
    """A command in lines, each but the last continued, options beside their values where these fit."""
    options = re.split(r"(?<=\S) (?=--?[a-z])", example)
    fitting = [[each] if len(each) <= width - 8 else re.split(r"(?<=\S) (?=\S)", each) for each in options]
    line, *words = [word for each in fitting for word in each]
    for word in words:
        if len(f"{line} {word} \\") > width:
            yield f"{line} \\"
            line = f"      {word}"
        else:
            line += f" {word}"
    yield line
