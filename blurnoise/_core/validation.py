"""For one step."""

from blurnoise._core.checks import Characters, Figure, Text, check_fields

__all__ = ["Characters", "Figure", "Text", "check_fields"]
