"""NaN and infinite values in what a network answers: counted, and warned of once."""

from __future__ import annotations

import threading
import warnings


class NonFinite:
    """How many such values a file's network has answered with so far: in ``total``, and ``here``."""

    def __init__(self, file: str) -> None:
        self.total = 0
        self._file = file
        self._lock = threading.Lock()
        self._own = threading.local()

    @property
    def here(self) -> int:
        """Those of the calling thread."""
        return int(getattr(self._own, "count", 0))

    def add(self, count: int, stacklevel: int) -> None:
        """Count ``count`` more, at least 1; the first ones are warned of. stacklevel: of the caller's warning."""
        self._own.count = self.here + count
        with self._lock:
            first = self.total == 0
            self.total += count
        if first:
            warnings.warn(
                f"{self._file}: outputs contain NaN or Inf; dropped",
                RuntimeWarning,
                stacklevel=stacklevel + 1,
            )
