"""README and guide: their commands are the parser's, their Python runs, and the guide is built without network."""

import ast
import functools
import re
import shutil
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec

import blurnoise_eval
import documented
import made_files
import pytest
import torchvision_ops
from blurnoise_eval import cli, datasets
from documented import PAGES, ROOT
from typer.core import TyperCommand

import blurnoise

EXAMPLES = sorted(path.name for path in (ROOT / "examples").glob("*.py"))
_ABROAD = re.compile(
    r"<(?:script|link|img|iframe)\b[^>]*\b(?:src|href)=[\"']?(?:https?:)?//[^\s>]*|url\(['\"]?https?:"
)


@pytest.fixture
def parse(tmp_path, monkeypatch):
    """The command line, which parses all that it is given and runs none of it; '--save-plan' writes all the same."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(TyperCommand, "invoke", lambda self, ctx: None)
    return cli.main


@pytest.mark.parametrize("page", PAGES)
def test_every_command_is_one(page, parse):
    """Named rightly, with options that there are and values that they take; nothing else stands in the blocks."""
    for words in documented.commands(page):
        if "://" in " ".join(words):
            pytest.importorskip("upath")
        if words[0] == "blurnoise":
            assert parse(words[1:]) == 0
        elif words[:2] == ["python", "-m"]:
            assert find_spec(words[2])
        elif words[0] == "python":
            assert (ROOT / words[1]).is_file()
        else:
            assert " ".join(words).startswith(documented.NO_COMMAND_OF_OURS), words


@pytest.mark.parametrize("words", [["sweep", "--luxx", "1", "-o", "run"], ["swep", "-o", "run"]])
def test_a_command_that_is_none_is_seen(words, parse):
    with pytest.raises(SystemExit, match="2"):
        parse(words)


def test_python_compiles():
    for page in PAGES:
        for number, block in enumerate(documented.blocks(page, "python"), 1):
            compile(block, f"{page}, block {number}", "exec")


def _public() -> set[str]:
    """What the two packages export, and what the pages of the Python reference show."""
    packages = (blurnoise, blurnoise_eval)
    exported = {f"{package.__name__}.{name}" for package in packages for name in package.__all__}
    pages = [(ROOT / page).read_text(encoding="utf-8") for page in PAGES if "/api/" in page]
    return exported | {name for page in pages for name in re.findall(r"^::: (\S+)$", page, re.MULTILINE)}


def test_the_reference_shows_what_there_is():
    """Without building the guide: every name of its pages is a module's, or an attribute of one."""
    for name in sorted(_public()):
        module, _, last = name.rpartition(".")
        assert hasattr(import_module(module), last) or find_spec(name), name


def test_what_is_shown_imports_public_names_only():
    """A name is public, or it or its module is in the reference."""
    shown = {page: "\n".join(documented.blocks(page, "python")) for page in PAGES}
    scripts = (ROOT / "examples").glob("*.py")
    shown |= {
        path.name: path.read_text(encoding="utf-8") for path in scripts
    }  # the training has the shipped one's parts
    public = _public()
    for where, text in shown.items():
        for each in (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ImportFrom)):
            if str(each.module).startswith("blurnoise") and each.module not in public:
                for name in (f"{each.module}.{name.name}" for name in each.names):
                    assert any(f"{known}.".startswith(f"{name}.") for known in public), f"{where}: {name}"


def test_every_example_is_in_the_guide():
    shown = "".join((ROOT / page).read_text(encoding="utf-8") for page in PAGES)
    assert all(f'--8<-- "examples/{name}"' in shown for name in EXAMPLES)
    assert "`examples/studies/does_training_help.py`" in shown


@pytest.fixture
def prepared(tmp_path, monkeypatch):
    """A folder with all files that are named, which is the working one.

    Rendered signs are one picture of each size, and no page is drawn, which takes longer than all that leads to it.
    """
    made_files.write_all(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        "blurnoise_eval.report.page.write_report", lambda data, folder, *_, **_options: folder / "report.html"
    )
    for name in ("rendered_signs", "rendered_texts"):
        monkeypatch.setattr(datasets, name, functools.partial(getattr(datasets, name), count=1))
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in PAGES if documented.ours(page)])
def test_commands_run(page, prepared, capsys):
    """In their order, in one folder; a run is begun anew by each command that makes it."""
    for name, text in documented.settings(page).items():
        kept = [line.replace("car:", "stop sign:") for line in text.splitlines() if "person:" not in line]
        (prepared / name).write_text("\n".join(kept))
    for words in documented.ours(page):
        if documented.is_long(words):
            continue
        if "ppocr" in words:
            pytest.importorskip("rapidocr")
        if words[0] in ("sweep", "decide", "merge"):
            shutil.rmtree(prepared / words[words.index("-o") + 1], ignore_errors=True)
        assert cli.main(documented.substituted(words, prepared)) == 0, f"{words}: {capsys.readouterr().err}"


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in PAGES if documented.blocks(page, "python")])
def test_python_runs(page, prepared):
    for number, block in enumerate(documented.blocks(page, "python"), 1):
        if "torchvision" in block:
            torchvision_ops.detectors()  # skips where it is missing
        if "albumentations" in block:
            pytest.importorskip("albumentations", reason="albumentations is not installed")
        exec(compile(block, f"{page}, block {number}", "exec"), {"__name__": "documented"})


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_run(name, tmp_path):
    """As a user runs them, and each says something."""
    command = [sys.executable, str(ROOT / "examples" / name)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()


@pytest.mark.slow
def test_the_guide_is_built_and_loads_nothing_from_abroad(tmp_path):
    pytest.importorskip("mkdocs")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-d", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for path in [*tmp_path.rglob("*.html"), *tmp_path.rglob("*.css")]:
        assert not _ABROAD.findall(path.read_text(encoding="utf-8")), path
    physics = (tmp_path / "physics.html").read_text(encoding="utf-8")
    assert "<math" in physics
    assert "arithmatex" not in physics
    assert '<span class="option">--moves</span>' in (tmp_path / "motion.html").read_text(encoding="utf-8")
