"""The ``blurnoise`` command. Heavy imports happen inside the commands, so that ``--help`` is immediate."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from blurnoise_eval.cli import benches, commands, inspecting, measuring, networks, quality, sweeping
from blurnoise_eval.cli.arguments import parse


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line. Returns 0, 2 for bad input, 130 when interrupted."""
    options = parse(COMMANDS, sys.argv[1:] if arguments is None else arguments)
    try:
        return int(options.command(options))
    except (ValueError, TypeError, OSError) as error:
        print(f"blurnoise: error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("blurnoise: interrupted; what was finished is kept", file=sys.stderr)
        return 130


COMMANDS = {
    "sweep": sweeping.sweep,
    "simulate": commands.simulate,
    "gallery": commands.gallery,
    "measure": measuring.measure,
    "quality": quality.quality,
    "motion": commands.motion,
    "chart": commands.chart,
    "report": sweeping.report,
    "detections": sweeping.detections,
    "inspect": inspecting.inspect,
    "bench": benches.bench,
    "train": networks.train,
    "scenes": networks.scenes,
    "cameras": commands.cameras,
}
