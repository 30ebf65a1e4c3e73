"""The ``blurnoise`` command: a table of commands, a file each. Heavy imports happen inside them."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import wraps
from importlib import import_module, metadata
from inspect import Parameter, cleandoc, signature
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Option
from typer.main import get_command

from blurnoise_eval.plan.axes import AXES
from blurnoise_eval.system.interrupts import in_order
from blurnoise_eval.system.terminal import accept_all_text, plain_warnings, say, shortened

COMMANDS: dict[str, str] = {
    "sweep": "evaluate detectors over exposures, lights and speeds",
    "decide": "find the exposure that works, with fewer pictures than a sweep",
    "program": "compute exposure and gain for each light level, from a run",
    "merge": "join the runs of parts into one run",
    "report": "write the report of a run again, or its detections as COCO",
    "inspect": "show the inputs, outputs and contract of a model",
    "simulate": "simulate how a camera takes a picture",
    "explore": "change the conditions with sliders, see picture and detections",
    "measure": "measure image quality: edges of a picture, or simulated charts",
    "validate": "compare simulated with real frames, or pictures of a chart",
    "chart": "render a test chart",
    "motion": "convert a road speed to px/s and blur length",
    "cameras": "list the camera presets, or show the values of one camera",
    "lights": "list the named lights: lux, spectrum and headlamps",
    "cameras fit": "make a camera file from dark and flat frames, or from a DNG",
    "train": "train the stop-sign detector and write it as ONNX",
}
"""The commands, each with a line about it. The function of a command has its name, in a module of that name."""
_INTERRUPTED = 130  # what Typer makes of an interrupt
_READ_ONLY = ("_overview", "motion")
_OVERWRITE = Annotated[
    bool,
    Option(
        "--overwrite",
        help="replace files that blurnoise did not write, or that were changed since; never an input",
    ),
]
_ABOUT = """\
What exposure time should this camera use, and how does my detector hold up
when the picture gets dark, noisy and blurred?

  blurnoise sweep -o run                              built-in model and signs
  blurnoise sweep --model M.onnx --images DIR -o run  your model and pictures
  blurnoise simulate IMAGE -o out.png --exposure-ms 30 --lux 50 --dx 1000
  blurnoise COMMAND --help                            options and examples

Commands:
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line. Returns 0, 2 for bad input, 128 + its number where a signal ends it (130 for Ctrl-C).

    Raises ``SystemExit`` with code 2 for an unknown command or option.
    """
    words = [*(sys.argv[1:] if arguments is None else arguments)]
    words = words[words[:1] == ["--"] :]
    name = next((each for each in (" ".join(words[:2]), *words[:1]) if each in COMMANDS), "")
    if name:
        return run_alone(function(name), f"blurnoise {name}", words[len(name.split()) :])
    help_only = words[:1] in (["-h"], ["--help"])
    return run_alone(_overview, "blurnoise", words[help_only:]) or 2 * (not words)


def _overview(
    version: Annotated[bool, Option("--version", help="print the version")] = False,
) -> None:
    if version:
        say(f"blurnoise {metadata.version('blurnoise')}")
    else:
        say(*_ABOUT.splitlines(), *(f"  {name:11}  {about}" for name, about in COMMANDS.items()))


def function(name: str) -> Callable[..., None]:
    """The function of a command."""
    path = name.replace(" ", "_")
    found: Callable[..., None] = getattr(import_module(f"blurnoise_eval.cli.{path}"), path)
    return found


def run_alone(run: Callable[..., None], name: str, words: Sequence[str]) -> int:
    """Run the command of one function, such as ``blurnoise sweep`` or ``python -m blurnoise_eval.bench``."""
    return in_order(lambda: _run(run, name, words))


def command(run: Callable[..., None]) -> Any:
    """The Typer command of a function. Its help has no column of types where the name of the value says enough."""
    app = typer.Typer(
        rich_markup_mode="rich",
        pretty_exceptions_enable=False,
        add_completion=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.command(help=described(run.__doc__ or ""))(run if run.__name__ in _READ_ONLY else _overwriting(run))
    made: Any = get_command(app)
    for each in made.params:
        named = each.param_type_name == "argument" and not each.type_descriptor.is_choice
        if named or getattr(each, "is_flag", False):
            each.display_type_rich = lambda ctx: None
    return made


def _overwriting(run: Callable[..., None]) -> Callable[..., None]:
    """The function with the option --overwrite, which :func:`_beginning` has read: some options write, too."""

    @wraps(run)
    def overwriting(overwrite: bool = False, **given: Any) -> None:
        from blurnoise_eval.cli._options import BEGIN

        BEGIN.get()()
        run(**given)

    own = signature(run, eval_str=True)
    added = Parameter("overwrite", Parameter.KEYWORD_ONLY, default=False, annotation=_OVERWRITE)
    overwriting.__signature__ = own.replace(parameters=[*own.parameters.values(), added])  # type: ignore[attr-defined]
    return overwriting


@contextmanager
def _beginning(run: Callable[..., None], params: Sequence[Any], words: Sequence[str]) -> Iterator[None]:
    """While a command runs: what it may replace. Its inputs are all files that it names, but those that it writes."""
    if run.__name__ in _READ_ONLY:
        yield
        return
    from blurnoise_eval.cli._options import BEGIN, WRITTEN

    kinds = signature(run, eval_str=True).parameters.items()
    names = {
        name for name, each in kinds for about in getattr(each.annotation, "__metadata__", ())
        if getattr(about, "parser", None) in WRITTEN
    }  # fmt: skip
    written = {option for each in params if each.name in names | {"saved_to"} for option in each.opts}
    inputs: list[Path] = []
    for before, word in pairwise(["", *words]):
        option, _, value = word.partition("=")
        if before not in written and option not in written:
            inputs += map(Path, {word, value, *word.split(","), word.partition(":")[2]})

    with ExitStack() as entered:

        def begin() -> None:
            from blurnoise_eval.system.files import writing

            BEGIN.set(lambda: None)
            entered.enter_context(writing(overwrite="--overwrite" in words, inputs=inputs))

        token = BEGIN.set(begin)
        entered.callback(BEGIN.reset, token)
        yield


def described(text: str) -> str:
    """The help text of a docstring: paragraphs become one line each, indented examples keep their lines."""
    parts = cleandoc(text).replace("[", r"\[").split("\n\n")
    return "\n\n".join(
        "\n".join(map(str.strip, part.splitlines())) if part.startswith(" ") else " ".join(part.split())
        for part in parts
    )


def _run(run: Callable[..., None], name: str, words: Sequence[str]) -> int:
    accept_all_text()
    program = command(run)
    options = option_names(program.params, words)
    os.environ.setdefault("OPENCV_LOG_LEVEL", "OFF")  # errors are reported below
    try:
        with plain_warnings(), _beginning(run, program.params, words):
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
        _say(in_options(text.replace("overwrite=True", "--overwrite"), options))
        _forget_output()
        return 2
    except (ValueError, TypeError) as error:
        _say(in_options(str(error).replace("overwrite=True", "--overwrite"), options))
        return 2
    except (MemoryError, RuntimeError) as error:
        from blurnoise_eval.system.machine import is_out_of_memory

        if not is_out_of_memory(error):
            raise
        _say("out of memory; use smaller pictures or fewer --threads")
        return 2
    if code == _INTERRUPTED:
        raise KeyboardInterrupt
    return int(code or 0)


def _say(text: str) -> None:
    """Print an error as one line."""
    from blurnoise_eval.system.urls import without_secrets

    say(f"blurnoise: error: {shortened(without_secrets(' '.join(text.split())))}", error=True)


def option_names(params: Sequence[Any], words: Sequence[str]) -> dict[str, str]:
    """The option of each parameter and axis; with a file of settings, the setting unless its option is used."""
    used = {word.partition("=")[0] for word in words if word.startswith("--")}
    has_file = bool(used & {"--plan", "--scene"})
    found: dict[str, str] = {}
    for each in params:
        names = [option.lstrip("-").replace("-", "_") for option in each.opts]
        longest = max(names if has_file else each.opts, key=len)
        found |= dict.fromkeys(names, next((option for option in each.opts if option in used), longest))
    return found | {axis.name: found[axis.key] for axis in AXES if axis.key in found}


def in_options(text: str, options: Mapping[str, str]) -> str:
    """An error "name = value: ..." or "name, name: ..." with the options of these names."""
    limit = options.get("model_timeout_s", "model_timeout_s in --plan FILE.yaml")
    text = text.replace("; timeout_s allows", f"; {limit} allows")
    subject = text.partition(":")[0].partition(" = ")[0]
    named = [options.get(each, "") for each in subject.split(", ")]
    if not all(named):
        return text
    axes = "|".join(axis.name for axis in AXES)
    rest = re.sub(rf"(?<!-)\b({axes})\b", lambda found: options.get(found[0], found[0]), text[len(subject) :])
    return ", ".join(named) + rest


def _usage(error: typer.TyperException) -> str:
    """The message for a wrong option, and where to look; for a setting without an option, the file that takes it."""
    path = getattr(getattr(error, "ctx", None), "command_path", "")
    option = str(getattr(error, "option_name", ""))
    command_name = path.removeprefix("blurnoise ")
    file, kind = getattr(COMMANDS.get(command_name) and function(command_name), "settings", ("", None))
    if kind and (name := option.lstrip("-").replace("-", "_")) in kind.settings():
        return f"no such option: {option}; set '{name}: ...' in a file and pass it as --{file} FILE.yaml"
    text = error.format_message().rstrip(".").replace("Value error, ", "")
    for fault in getattr(error.__cause__, "errors", list)():
        text += f", got {fault['input']!r}" if repr(fault["input"]) not in text else ""
    return text + (f"; see '{path} --help'" if path else "")


def _forget_output() -> None:
    """Discard output that cannot be written; otherwise Python tries again when it ends."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
