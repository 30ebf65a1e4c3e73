"""The ``blurnoise`` script, which also starts where the harness is not installed."""

from __future__ import annotations

from blurnoise_eval.system.interrupts import in_order


def main() -> int:
    """Run the command line. Returns its exit code, 2 where a package that it needs is missing."""
    return in_order(_started, own_process=True)


def _started() -> int:
    try:
        from blurnoise_eval.cli import main as run
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("blurnoise"):
            raise
        from blurnoise_eval.system.terminal import say

        say(f"blurnoise: error: needs {error.name}: pip install 'blurnoise[eval]'", error=True)
        return 2
    return run()
