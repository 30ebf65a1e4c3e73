"""Signatures of documents that this user has written, made with a secret of the account, so that files of others
are recognised.

The secret is a file in BLURNOISE_STATE, else in $XDG_STATE_HOME/blurnoise or ~/.local/state/blurnoise. If it can be
neither read nor written, no document counts as the user's.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import secrets
from contextlib import suppress
from pathlib import Path

from blurnoise._core.writing import write_whole

_BYTES = 32


def signed(text: str) -> str | None:
    """The signature of a text; None if there is no secret."""
    secret = _secret(make=True)
    return _of(text, secret) if secret else None


def is_own(text: str, signature: str | None) -> bool:
    """Whether this user has signed this text."""
    secret = _secret()
    if not secret or not signature:
        return False
    # In constant time: how long a comparison takes must not tell how much of a guess is right.
    return hmac.compare_digest(_of(text, secret).encode(), signature.encode("utf-8", "surrogatepass"))


def _of(text: str, secret: bytes) -> str:
    return hmac.new(secret, text.encode("utf-8", "surrogatepass"), hashlib.sha256).hexdigest()


def _secret(*, make: bool = False) -> bytes | None:
    with suppress(OSError, RuntimeError):  # no home
        state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
        path = Path(os.environ.get("BLURNOISE_STATE") or Path(state, "blurnoise")) / "secret"
        if make and not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            made = path.with_name(f"{path.name}.{os.getpid()}")
            write_whole(made, secrets.token_bytes(_BYTES))
            made.chmod(0o600)
            with suppress(FileExistsError):
                os.link(made, path)  # of several processes, the first one's secret is used by all
            made.unlink()
        secret = path.read_bytes()
        return secret if len(secret) == _BYTES else None
    return None
