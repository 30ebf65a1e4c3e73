"""How help looks: prose in the terminal's width, examples as they stand, options in their sections; plain text.

Commands of many options show the usual ones, and name the rest; ``--help-all`` explains every one.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from typer.core import TyperCommand, TyperGroup

from blurnoise_eval.system.layout import paragraph

HELP_NAMES = ["-h", "--help", "--help-all"]
USUAL: dict[str, tuple[str, ...]] = {
    "sweep": (
        "model", "images", "coco", "target", "limit", "exposure_s", "illuminance_lux", "velocity_x_px_s", "keep",
        "camera", "threads", "output", "as_json",
    ),
    "decide": (
        "model", "images", "coco", "target", "limit", "exposure_ms", "lux", "dx", "keep", "regret", "camera",
        "threads", "output", "as_json",
    ),
    "simulate": (
        "image", "output", "exposure_ms", "lux", "dx", "dy", "camera", "gain_db", "f_number", "seed", "explain",
        "as_json",
    ),
}  # fmt: skip
"""Of commands with more options than a screen has lines: the parameters that the first screen explains."""


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

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments, then options, a section per panel; the names alone of what only some need."""
        usual = None if ctx.find_root().obj else USUAL.get(ctx.info_name)
        sections: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        others: dict[str, list[str]] = {}
        for param in self.get_params(ctx):
            record = param.get_help_record(ctx)
            if record is None:
                continue
            section = "Arguments" if param.param_type_name == "argument" else "Options"
            section = getattr(param, "rich_help_panel", None) or section
            if usual is None or param.name in usual or "--help" in param.opts:
                sections.setdefault(section, []).append(record)
            else:
                others.setdefault(section, []).append(param.opts[-1])
        sections["Options"] = sections.pop("Options")  # the others first, as they are said
        for title, records in sections.items():
            if records:
                with _section(formatter, title):
                    formatter.write_dl(records)
        if others:
            with _section(formatter, f"More, explained by 'blurnoise {ctx.info_name} --help-all'"):
                for title, names in others.items():
                    text = f"{title.partition(',')[0].partition(' (')[0]}: {', '.join(names)}"
                    formatter.write("".join(f"{line}\n" for line in paragraph(text, formatter.width, 2, 6)))


def _section(formatter: Any, title: str) -> Any:
    return formatter.section("\n".join(paragraph(title, formatter.width - 1)))


class Program(_Described, TyperGroup):
    """The program itself."""


def described(text: str, width: int) -> Iterator[str]:
    """Lines of a description: prose is wrapped; an example that does not fit has its comment below it."""
    for number, part in enumerate(text.strip("\n").split("\n\n")):
        lines = part.splitlines()
        if number:
            yield ""
        if not part.startswith("  "):
            yield from paragraph(" ".join(lines), width)
        for line in lines if part.startswith("  ") else ():
            example, gap, comment = line.strip().partition("  ")
            if len(line) <= width or not gap:
                yield line
            else:
                yield f"  {example}"
                yield from paragraph(comment.strip(), width, 6, 6)
