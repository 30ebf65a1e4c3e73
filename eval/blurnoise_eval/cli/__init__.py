"""The ``blurnoise`` command: a table of commands, a file each. Heavy imports happen inside them."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Collection, Sequence
from importlib import import_module, metadata
from inspect import cleandoc
from typing import Annotated, Any

import typer
from typer import Option
from typer.main import get_command

from blurnoise_eval.grid.axes import AXES
from blurnoise_eval.system.terminal import accept_all_text, plain_warnings, say, shortened

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
    "validate": "simulated frames beside your camera's: what agrees, what differs",
    "chart": "render a test target",
    "motion": "road speed -> px/s and blur",
    "cameras": "the cameras there are, their figures and where these come from",
    "cameras fit": "your own camera, from dark and flat frames or a DNG",
    "train": "train the stop-sign detector, and write it as ONNX",
}
"""Every command, and what it does; its function has its name, in a module of that name."""
_ABOUT = """\
What exposure time should this camera use, and how does my detector hold up
when the picture gets dark, noisy and blurred?

  blurnoise sweep -o run                     the whole job on built-in signs
  blurnoise sweep --model M.onnx --images DIR -o run           ... on your own
  blurnoise simulate IMAGE -o out.png --exposure-ms 30 --lux 50 --dx 1000
  blurnoise COMMAND --help                   its options, and examples

Commands:
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line. Returns 0, 2 for bad input, 130 when interrupted.

    Raises ``SystemExit`` of code 2 for what no command understands.
    """
    words = [*(sys.argv[1:] if arguments is None else arguments)]
    words = words[words[:1] == ["--"] :]
    name = next((each for each in (" ".join(words[:2]), *words[:1]) if each in COMMANDS), "")
    if name:
        return run_alone(function(name), f"blurnoise {name}", words[len(name.split()) :])
    asked = words[:1] in (["-h"], ["--help"])
    return run_alone(_overview, "blurnoise", words[asked:]) or 2 * (not words)


def _overview(
    version: Annotated[bool, Option("--version", help="print the version, no help")] = False,
) -> None:
    if version:
        say(f"blurnoise {metadata.version('blurnoise')}")
    else:
        say(*_ABOUT.splitlines(), *(f"  {name:11}  {about}" for name, about in COMMANDS.items()))


def function(name: str) -> Callable[..., None]:
    """That of a command."""
    path = name.replace(" ", "_")
    found: Callable[..., None] = getattr(import_module(f"blurnoise_eval.cli.{path}"), path)
    return found


def run_alone(run: Callable[..., None], name: str, words: Sequence[str]) -> int:
    """Run a command that is no part of a program: ``blurnoise sweep``, ``python -m blurnoise_eval.bench``."""
    return _run(command(run), name, words)


def command(run: Callable[..., None]) -> Any:
    """Typer's command of a function."""
    app = typer.Typer(
        rich_markup_mode="rich",
        pretty_exceptions_enable=False,
        add_completion=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.command(help=described(run.__doc__ or ""))(run)
    return get_command(app)


def described(text: str) -> str:
    """A docstring for help: prose in lines of any length, examples (indented) line by line, brackets no markup."""
    parts = cleandoc(text).replace("[", r"\[").split("\n\n")
    return "\n\n".join(
        "\n".join(map(str.strip, part.splitlines())) if part.startswith(" ") else " ".join(part.split())
        for part in parts
    )


def _run(program: Any, name: str, words: Sequence[str]) -> int:
    accept_all_text()
    options = [option for each in program.params for option in each.opts]
    os.environ.setdefault("OPENCV_LOG_LEVEL", "OFF")  # errors are told below
    try:
        with plain_warnings():
            code = program.main(args=[*words], prog_name=name, standalone_mode=False)
            sys.stdout.flush()
    except typer.TyperException as error:
        _say(_usage(error))
        raise SystemExit(2) from None
    except BrokenPipeError:  # whoever read the output has gone
        _forget_output()
        return 1
    except OSError as error:
        text = f"{error.filename}: {error.strerror}" if error.strerror and error.filename else str(error)
        _say(in_options(text, options))
        _forget_output()
        return 2
    except (ValueError, TypeError) as error:
        _say(in_options(str(error), options))
        return 2
    except (MemoryError, RuntimeError) as error:
        from blurnoise_eval.system.machine import is_out_of_memory

        if not is_out_of_memory(error):
            raise
        _say("out of memory: smaller pictures, or fewer of --threads, need less")
        return 2
    if code == 130:
        say("blurnoise: interrupted; what was finished is kept", error=True)
    return int(code or 0)


def _say(text: str) -> None:
    """An error, in a line."""
    from blurnoise_eval.system.urls import without_secrets

    say(f"blurnoise: error: {shortened(without_secrets(' '.join(text.split())))}", error=True)


def in_options(text: str, options: Collection[str]) -> str:
    """An error "name = value: ..." or "name, name: ..." with the options of those names."""
    limit = "--model-timeout-s" if "--model-timeout-s" in options else "model_timeout_s in --plan FILE.yaml"
    text = text.replace("; timeout_s allows", f"; {limit} allows")
    known = {each.lstrip("-").replace("-", "_"): each for each in options}
    known |= {axis.name: axis.option for axis in AXES if axis.option in options}
    subject = text.partition(":")[0].partition(" = ")[0]
    named = [known.get(each, "") for each in subject.split(", ")]
    return ", ".join(named) + text[len(subject) :] if all(named) else text


def _usage(error: typer.TyperException) -> str:
    """What is wrong with the options themselves, and where to look; of a setting that is no option, its file."""
    path = getattr(getattr(error, "ctx", None), "command_path", "")
    option = str(getattr(error, "option_name", ""))
    command_name = path.removeprefix("blurnoise ")
    file, kind = getattr(COMMANDS.get(command_name) and function(command_name), "settings", ("", None))
    if kind and (name := option.lstrip("-").replace("-", "_")) in kind.names():
        return f"no such option: {option}; it is the setting '{name}: ...' in --{file} FILE.yaml"
    text = error.format_message().rstrip(".").replace("Value error, ", "")
    for fault in getattr(error.__cause__, "errors", list)():
        text += f", got {fault['input']!r}" if repr(fault["input"]) not in text else ""
    return text + (f"; see '{path} --help'" if path else "")


def _forget_output() -> None:
    """Drop what cannot be written to standard output, which Python would try again when it ends."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
