"""How help looks: descriptions as they stand, examples unwrapped, options in their sections; plain text."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand, TyperGroup


class Command(TyperCommand):
    """A command whose options stand under the title of their panel."""

    def format_help_text(self, ctx: Any, formatter: Any) -> None:
        """Write the description as it is."""
        formatter.write(f"\n{self.help}\n")

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments, then options, a section per panel."""
        sections: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        for param in self.get_params(ctx):
            record = param.get_help_record(ctx)
            if record is not None:
                usual = "Arguments" if param.param_type_name == "argument" else "Options"
                sections.setdefault(getattr(param, "rich_help_panel", None) or usual, []).append(record)
        sections["Options"] = sections.pop("Options")  # the others first, as they are said
        for title, records in sections.items():
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)


class Program(TyperGroup):
    """The program itself."""

    def format_help_text(self, ctx: Any, formatter: Any) -> None:
        """Write the description as it is."""
        formatter.write(f"\n{self.help}\n")
