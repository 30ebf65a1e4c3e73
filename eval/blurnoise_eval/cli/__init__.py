"""The ``blurnoise`` command: a table of commands, a file each. Heavy imports happen inside them."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import typer
from typer.main import get_command

from blurnoise_eval.cli import (
    bench,
    cameras,
    cameras_fit,
    chart,
    compare,
    decide,
    detections,
    explore,
    gallery,
    inspect,
    maps,
    measure,
    merge,
    motion,
    paper,
    program,
    quality,
    report,
    scenes,
    simulate,
    sweep,
    train,
)
from blurnoise_eval.cli._errors import in_a_line, usage
from blurnoise_eval.cli._help import HELP_NAMES, Command, Program, described
from blurnoise_eval.system.layout import PROSE
from blurnoise_eval.system.machine import is_out_of_memory
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import accept_all_text, plain_warnings, say, width

COMMANDS: tuple[tuple[Callable[..., None], str], ...] = (
    (sweep.sweep, "detector x exposures x lights x speeds -> curves and report"),
    (decide.decide, "the same answers from a fraction of the conditions, by a search"),
    (program.program, "a finished run -> exposure and gain for every light"),
    (maps.maps, "which image-quality metric tells how a run's detectors do"),
    (merge.merge, "join runs of parts: other pictures, repeats or conditions"),
    (report.report, "write a run's figures, tables and page again"),
    (detections.detections, "write what a run's models found as COCO results files"),
    (inspect.inspect, "what a model takes and gives, and how it would be read"),
    (simulate.simulate, "one picture as a camera would take it"),
    (explore.explore, "sliders: what conditions do to a picture and a detector"),
    (gallery.gallery, "what ranges of conditions do to a picture, as tiles"),
    (quality.quality, "charts -> every image-quality metric, over exposure and blur"),
    (measure.measure, "slanted edges of a picture -> sharpness, noise, information"),
    (compare.compare, "a simulated picture beside a real one of the same chart"),
    (chart.chart, "render a test target"),
    (motion.motion, "road speed -> px/s and blur; a map of the exposures it allows"),
    (cameras.cameras, "the cameras there are, their figures and where these come from"),
    (cameras_fit.cameras_fit, "your own camera, from dark and flat frames or a DNG"),
    (paper.paper, "the paper of Lin et al. 2024, rerun, item by item"),
    (train.train, "train the stop-sign detector, and write it as ONNX"),
    (scenes.scenes, "render labelled road-sign scenes, as COCO"),
    (bench.bench, "measure: speed beside accuracy; what a training gains"),
)
_QUESTION = """\
What exposure time should this camera use, and how does my detector hold up
when the picture gets dark, noisy and blurred?
"""
_FIRST = """
Begin with one of these:

  blurnoise sweep -o run                        the whole job on built-in signs
  blurnoise sweep --model M.onnx --images DIR -o run       ... on your own
  blurnoise simulate IMAGE -o out.png --exposure-ms 30 --lux 50 --dx 1000
"""
_NEXT = """
Every command: blurnoise --help; its usual options: blurnoise sweep --help
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line. Returns 0, 1 where ``paper`` does not agree, 2 for bad input, 130 when interrupted.

    Raises ``SystemExit`` of code 2 for what no command understands.
    """
    words = _with_usual_values(_named(sys.argv[1:] if arguments is None else arguments))
    _complete_two_words()
    accept_all_text()
    ProgressBar.command_begins()
    os.environ.setdefault("OPENCV_LOG_LEVEL", "OFF")  # errors are told below
    try:
        with plain_warnings():
            app = _program(words)
            code = app.main(args=words, prog_name="blurnoise", standalone_mode=False)
            sys.stdout.flush()
    except typer.TyperException as error:
        first = described(_QUESTION + _FIRST + _NEXT, width() or PROSE)
        say(*[usage(error)] if words else first, error=True)
        raise SystemExit(2) from None
    except BrokenPipeError:  # whoever read the output has gone
        _forget_output()
        return 1
    except (ValueError, TypeError, OSError) as error:
        own = [each for word in words if word in app.commands for each in app.commands[word].params]
        say(in_a_line(error, [option for each in own for option in each.opts]), error=True)
        if isinstance(error, OSError):
            _forget_output()
        return 2
    except (MemoryError, RuntimeError) as error:
        if not is_out_of_memory(error):
            raise
        say("blurnoise: error: out of memory: smaller pictures, or fewer of --threads, need less", error=True)
        return 2
    if code == 130:
        say("blurnoise: interrupted; what was finished is kept", error=True)
    return code or 0


def _forget_output() -> None:
    """Drop what cannot be written to standard output, which Python would try again when it ends."""
    with suppress(OSError, ValueError, AttributeError):
        sys.stdout.flush()
        return
    with suppress(OSError, ValueError, AttributeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _program(arguments: Sequence[str]) -> Any:
    """The program; where a command is named, with that alone: options that nobody asks for take time to make."""
    named = [entry for entry in COMMANDS if [_name(entry[0])] == [*arguments[:1]]]
    app = typer.Typer(
        cls=Program,
        help=_QUESTION + _FIRST,
        no_args_is_help=True,
        add_completion=not named,
        add_help_option=not named,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        context_settings={
            "help_option_names": HELP_NAMES,
            "terminal_width": min(width() or PROSE, PROSE),
            "obj": "--help-all" in arguments,
        },
    )
    app.callback()(lambda: None)  # without it, one command would have no name
    for run, about in named or COMMANDS:
        app.command(_name(run), cls=Command, short_help=about)(run)
    return get_command(app)


def _name(run: Callable[..., None]) -> str:
    """A command's name: that of its function, in two words where that has two."""
    return run.__name__.replace("_", " ")


def _named(arguments: Sequence[str]) -> list[str]:
    """The arguments with a command's name of two words as the one that it is here."""
    both = " ".join(arguments[:2])
    return [both, *arguments[2:]] if both in {_name(run) for run, _ in COMMANDS} else [*arguments]


def _complete_two_words() -> None:
    """Where bash asks what may follow a command of two words, have its name as one."""
    words = os.environ.get("COMP_WORDS", "").split()
    place = int(os.environ.get("COMP_CWORD", "0"))
    if place > 2 and _named(words[1:]) != words[1:]:
        os.environ["COMP_WORDS"] = " ".join([words[0], f"'{words[1]} {words[2]}'", *words[3:]])
        os.environ["COMP_CWORD"] = str(place - 1)


def _with_usual_values(arguments: Sequence[str]) -> list[str]:
    """Say "crop" where ``--ocr`` stands alone, and an empty name where ``--save-contract`` does: an option here has
    a value, or never has."""
    followed = zip(arguments, (*arguments[1:], ""), strict=False)  # of no arguments nothing
    return [
        "--ocr=crop"
        if argument == "--ocr" and following not in ("crop", "find")
        else "--save-contract="
        if argument == "--save-contract" and not following.endswith((".json", ".yaml", ".yml"))
        else argument
        for argument, following in followed
    ]
