"""What a run states about itself as JSON, whoever made the run."""

from __future__ import annotations

import json
from typing import Any

_NEEDED = {
    "manifest": ("title", "models", "camera", "images"),
    "identity": ("model", "camera", "plan", "pictures"),
}


class Stated(dict[str, Any]):
    """An object that names the key that it lacks, where other software made the run."""

    def __missing__(self, key: str) -> Any:
        raise ValueError(f"run: was made by other software (states no {key!r})")


def read(key: str, text: str) -> Any:
    """The document of that name. Raises ``ValueError`` for text that is no JSON, or states too little."""
    try:
        value = json.loads(text, object_hook=Stated)
    except RecursionError:
        raise ValueError("is nested too deeply") from None
    for name in _NEEDED.get(key, ()):
        if not isinstance(value, dict) or name not in value:
            raise ValueError(f"states no {name!r}")
    return value
