"""For one step."""

from blurnoise._core.threads import no_torch_compile as uncompiled

__all__ = ["uncompiled"]
