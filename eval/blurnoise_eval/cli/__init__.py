"""The ``blurnoise`` command: a table of commands, a file each. Heavy imports happen inside them."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from importlib import import_module, metadata
from inspect import cleandoc
from typing import Annotated, Any

import typer
from typer import Option
from typer.main import get_command

from blurnoise_eval.cli._errors import in_a_line, usage
from blurnoise_eval.system.terminal import accept_all_text, plain_warnings, say

COMMANDS: dict[str, str] = {
    "sweep": "detector x exposures x lights x speeds -> curves and report",
    "decide": "the same answers from a fraction of the conditions, by a search",
    "program": "a finished run -> exposure and gain for every light",
    "merge": "join runs of parts: other pictures, repeats or conditions",
    "report": "write a run's figures, tables and page again; its boxes as COCO",
    "inspect": "what a model takes and gives, and how it would be read",
    "simulate": "one picture as a camera would take it",
    "explore": "sliders: what conditions do to a picture and a detector",
    "quality": "charts -> every image-quality metric, over exposure and blur",
    "measure": "slanted edges of a picture -> sharpness, noise, information",
    "compare": "a simulated picture beside a real one of the same chart",
    "chart": "render a test target",
    "motion": "road speed -> px/s and blur; a map of the exposures it allows",
    "cameras": "the cameras there are, their figures and where these come from",
    "cameras fit": "your own camera, from dark and flat frames or a DNG",
    "train": "train the stop-sign detector, and write it as ONNX",
}
"""Every command, and what it does; its function has its name, in a module of that name."""
_ABOUT = """\
What exposure time should this camera use, and how does my detector hold up
when the picture gets dark, noisy and blurred?

Begin with one of these:

  blurnoise sweep -o run                     the whole job on built-in signs
  blurnoise sweep --model M.onnx --images DIR -o run           ... on your own
  blurnoise simulate IMAGE -o out.png --exposure-ms 30 --lux 50 --dx 1000
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line. Returns 0, 2 for bad input, 130 when interrupted.

    Raises ``SystemExit`` of code 2 for what no command understands.
    """
    words = [*(sys.argv[1:] if arguments is None else arguments)]
    words = words[words[:1] == ["--"] :]
    name = next((each for each in (" ".join(words[:2]), *words[:1]) if each in COMMANDS), "")
    if name and "_BLURNOISE_COMPLETE" not in os.environ:
        return run_alone(function(name), f"blurnoise {name}", words[len(name.split()) :])
    return _run(get_command(_program()), "blurnoise", words or ["--help"], 0 if words else 2)


def function(name: str) -> Callable[..., None]:
    """That of a command."""
    path = name.replace(" ", "_")
    found: Callable[..., None] = getattr(import_module(f"blurnoise_eval.cli.{path}"), path)
    return found


def run_alone(run: Callable[..., None], name: str, words: Sequence[str]) -> int:
    """Run a command that is no part of a program: ``blurnoise sweep``, ``python -m blurnoise_eval.bench``."""
    return _run(command(run), name, words, 0)


def command(run: Callable[..., None]) -> Any:
    """Typer's command of a function."""
    app = _app()
    app.command(help=described(run.__doc__ or ""))(run)
    return get_command(app)


def described(text: str) -> str:
    """A docstring for help: prose in lines of any length, examples (indented) line by line, brackets no markup."""
    parts = cleandoc(text).replace("[", r"\[").split("\n\n")
    return "\n\n".join(
        "\n".join(map(str.strip, part.splitlines())) if part.startswith(" ") else " ".join(part.split())
        for part in parts
    )


def _app(**options: Any) -> typer.Typer:
    return typer.Typer(
        rich_markup_mode="rich",
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
        **{"add_completion": False, **options},
    )


def _program() -> typer.Typer:
    """All commands: their names and what they do; their options, too, where a shell completes them."""
    app = _app(help=described(_ABOUT), no_args_is_help=True, add_completion=True)
    app.callback()(_of_program)
    for name, about in COMMANDS.items():
        run = function(name) if "_BLURNOISE_COMPLETE" in os.environ else (lambda: None)
        app.command(name, short_help=about)(run)
    return app


def _version(wanted: bool) -> None:
    if wanted:
        say(f"blurnoise {metadata.version('blurnoise')}")
        raise typer.Exit


def _of_program(
    version: Annotated[
        bool, Option("--version", callback=_version, is_eager=True, help="print the version and exit")
    ] = False,
) -> None:
    pass


def _run(program: Any, name: str, words: Sequence[str], done: int) -> int:
    accept_all_text()
    os.environ.setdefault("OPENCV_LOG_LEVEL", "OFF")  # errors are told below
    try:
        with plain_warnings():
            code = program.main(args=[*words], prog_name=name, standalone_mode=False)
            sys.stdout.flush()
    except typer.TyperException as error:
        say(usage(error), error=True)
        raise SystemExit(2) from None
    except BrokenPipeError:  # whoever read the output has gone
        _forget_output()
        return 1
    except (ValueError, TypeError, OSError) as error:
        say(in_a_line(error, [option for each in program.params for option in each.opts]), error=True)
        if isinstance(error, OSError):
            _forget_output()
        return 2
    except (MemoryError, RuntimeError) as error:
        from blurnoise_eval.system.machine import is_out_of_memory

        if not is_out_of_memory(error):
            raise
        say("blurnoise: error: out of memory: smaller pictures, or fewer of --threads, need less", error=True)
        return 2
    if code == 130:
        say("blurnoise: interrupted; what was finished is kept", error=True)
    return code or done


def _forget_output() -> None:
    """Drop what cannot be written to standard output, which Python would try again when it ends."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
