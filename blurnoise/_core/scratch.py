"""For one step."""

from blurnoise._core.threads import borrowed

__all__ = ["borrowed"]
