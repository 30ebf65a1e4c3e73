"""For one step."""

from blurnoise._core.threads import uncompiled

__all__ = ["uncompiled"]
