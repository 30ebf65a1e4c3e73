"""What is written replaces nothing of the user's: what was written before, and that alone."""

import json
import os
import signal
import socket
import stat
from contextlib import nullcontext
from pathlib import Path

import pytest

from blurnoise import Camera
from blurnoise._core.manifest import MANIFEST
from blurnoise._core.writing import (
    check_own_folder,
    check_writable,
    note_inputs,
    remove,
    remove_made,
    write_whole,
    writing,
    written_whole,
)

THEIRS = "did not write, or that was changed since; overwrite=True replaces it"


def refused(path, why, data=b"new"):
    """Neither check nor write let it be replaced; it stays as it was."""
    before = path.read_bytes() if path.is_file() else None
    for attempt in (lambda: check_writable(path), lambda: write_whole(path, data)):
        with pytest.raises(OSError, match=why) as error:
            attempt()
        assert error.value.filename == str(path)
    assert before is None or path.read_bytes() == before


def names(folder):
    return sorted(path.name for path in folder.iterdir() if path.name != MANIFEST)


def forked(work):
    """The number of a process that does it and ends, with 0 where nothing was raised."""
    if child := os.fork():
        return child
    signal.alarm(60)  # it outlives a test that fails, but not for long
    try:
        work()
        os._exit(0)
    finally:
        os._exit(1)


def test_an_error_names_the_file_that_it_is_about(tmp_path):
    """Where the pieces of one file write, or read, another one."""
    (tmp_path / "picture.png").write_bytes(b"mine")

    def pieces(work):
        yield b"["
        work(tmp_path / "picture.png")

    for work, why in ((lambda path: write_whole(path, b"new"), THEIRS), (os.listdir, "Not a directory")):
        with pytest.raises(OSError, match=why) as error:
            write_whole(tmp_path / "list.json", pieces(work))
        assert error.value.filename == str(tmp_path / "picture.png")
    assert names(tmp_path) == ["picture.png"]


def test_a_file_is_replaced_that_holds_what_was_written(tmp_path):
    path = tmp_path / "a.yaml"
    for data in (b"one", b"two", b"one"):
        write_whole(path, data)
        assert path.read_bytes() == data
    for edited in (b"one, edited", b"eno"):
        path.write_bytes(edited)
        refused(path, THEIRS)
    (tmp_path / "b.yaml").write_bytes(b"one")
    refused(tmp_path / "b.yaml", THEIRS)
    with writing(overwrite=True):
        write_whole(path, b"three")
    write_whole(path, b"four")
    assert (path.read_bytes(), names(tmp_path)) == (b"four", ["a.yaml", "b.yaml"])


def test_overwriting_ends_with_the_call(tmp_path):
    camera, path = Camera.preset("imx250"), tmp_path / "mine.yaml"
    camera.save(path)
    camera.save(path)
    path.write_text("# mine\n" + path.read_text())
    with pytest.raises(FileExistsError, match=THEIRS):
        camera.save(path)
    camera.save(path, overwrite=True)
    path.write_text("# mine\n" + path.read_text())
    refused(path, THEIRS)


@pytest.mark.parametrize("overwrite", [False, True])
def test_an_input_is_never_replaced(tmp_path, overwrite):
    """By whatever name, and though it was written before."""
    path, name = tmp_path / "a.png", tmp_path / "b.png"
    write_whole(path, b"picture")
    name.hardlink_to(path)
    (tmp_path / "c.png").symlink_to(path)
    with writing(overwrite=overwrite), writing():
        note_inputs([tmp_path / "missing", path])
        for each in (path, name, tmp_path / "c.png"):
            refused(each, "is an input of this command")
    write_whole(path, b"later")


def test_overwriting_keeps_the_kind(tmp_path):
    text, picture = tmp_path / "a.csv", tmp_path / "b.csv"
    text.write_bytes(b"1,2\n")
    picture.write_bytes(b"\x89PNG\0\0")
    (tmp_path / "c.png").symlink_to(text)
    with writing(overwrite=True):
        for path, data in ((text, b"\0\1"), (picture, b"1,2"), (tmp_path / "c.png", b"\0\1")):
            with pytest.raises(FileExistsError, match="of another kind"):
                write_whole(path, data)
        refused(tmp_path, "is a folder|Is a directory")
        write_whole(text, b"3,4\n")
    assert (text.read_bytes(), picture.read_bytes()) == (b"3,4\n", b"\x89PNG\0\0")


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "home").mkdir()
    link, target = tmp_path / "a.csv", tmp_path / "home" / "b.csv"
    link.symlink_to(target)
    write_whole(link, b"1")
    write_whole(link, b"2")
    assert (link.is_symlink(), target.read_bytes(), names(target.parent)) == (True, b"2", ["b.csv"])
    target.write_bytes(b"mine")
    refused(link, THEIRS)


def test_devices_and_pipes_are_written_to(tmp_path):
    for device in (Path("/dev/null"), tmp_path / "null"):
        if device.parent == tmp_path:
            device.symlink_to("/dev/null")
        check_writable(device)
        write_whole(device, b"swallowed")
        assert stat.S_ISCHR(device.stat().st_mode)
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    write_whole(tmp_path / "pipe", [b"through ", b"it"])
    assert os.read(reader, 99) == b"through it"
    os.close(reader)
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(tmp_path / "socket"))
        refused(tmp_path / "socket", "disk or a socket")
    assert names(tmp_path) == ["null", "pipe", "socket"]


def test_standard_output_is_written_to_wherever_it_goes(tmp_path):
    with (tmp_path / "log").open("wb") as log:

        def work():
            os.dup2(log.fileno(), 1)
            os.write(1, b"before ")
            check_writable(Path("/dev/fd/1"))
            write_whole(Path("/dev/fd/1"), b"it ")
            os.write(1, b"after")

        assert os.waitpid(forked(work), 0)[1] == 0
    assert (tmp_path / "log").read_bytes() == b"before it after"


@pytest.mark.parametrize("rubbish", [b"mine\n", b'{"wrote": [\n{"wrote": "a"}\n[]\n1\n', b"", b"[" * 100_000])
def test_rubbish_in_a_list_says_nothing(tmp_path, rubbish):
    (tmp_path / "a.csv").write_bytes(b"1")
    (tmp_path / MANIFEST).write_bytes(rubbish)
    refused(tmp_path / "a.csv", THEIRS)
    write_whole(tmp_path / "b.csv", b"1")
    assert (tmp_path / MANIFEST).read_bytes().startswith(rubbish), "a file of that name is the user's own"


def test_a_list_is_a_file_of_its_folder(tmp_path):
    """No link, pipe or folder, and it names no other folder's files."""
    (tmp_path / "below").mkdir()
    write_whole(tmp_path / "below" / "a.csv", b"1")
    held = json.loads((tmp_path / "below" / MANIFEST).read_text())
    (tmp_path / MANIFEST).write_text(json.dumps({**held, "wrote": "other/a.csv"}) + "\n")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "a.csv").write_bytes(b"1")
    refused(tmp_path / "other" / "a.csv", THEIRS)
    (tmp_path / "other" / MANIFEST).symlink_to(tmp_path / "below" / MANIFEST)
    refused(tmp_path / "other" / "a.csv", THEIRS)
    (tmp_path / "other" / MANIFEST).unlink()
    os.mkfifo(tmp_path / "other" / MANIFEST)
    refused(tmp_path / "other" / "a.csv", THEIRS)
    write_whole(tmp_path / "other" / "b.csv", b"1")


@pytest.mark.parametrize("make", [Path.mkdir, os.mkfifo, lambda path: path.symlink_to("theirs")])
def test_where_no_list_can_be_all_counts_as_the_users(tmp_path, make):
    make(tmp_path / MANIFEST)
    write_whole(tmp_path / "a.csv", b"1")
    refused(tmp_path / "a.csv", THEIRS)
    assert names(tmp_path) == ["a.csv"]


def test_a_folder_is_ones_own_as_long_as_nobody_adds_to_it(tmp_path):
    (tmp_path / "data").mkdir()
    write_whole(tmp_path / "data" / "a.png", b"1")
    check_own_folder(tmp_path)
    (tmp_path / "data" / ".DS_Store").write_bytes(b"")
    check_own_folder(tmp_path)
    (tmp_path / "data" / "b.png").write_bytes(b"1")
    with pytest.raises(FileExistsError, match=r"did not write \(data/b.png\); choose another folder"):
        check_own_folder(tmp_path)


def test_what_was_made_is_undone_and_no_more(tmp_path):
    (tmp_path / "theirs").write_bytes(b"1")
    write_whole(tmp_path / "before", b"1")
    with writing() as own:
        since = len(own.made)
        for name in ("before", "a", "b"):
            write_whole(tmp_path / name, b"2")
        (tmp_path / "b").write_bytes(b"edited")
        remove_made(own, since)
    assert names(tmp_path) == ["b", "before", "theirs"]
    refused(tmp_path / "theirs", THEIRS)
    with pytest.raises(FileExistsError, match=THEIRS):
        remove(tmp_path / "theirs")
    remove(tmp_path / "before")
    assert names(tmp_path) == ["b", "theirs"]


def test_copies_of_ended_processes_are_swept(tmp_path):
    """Those of living ones, of other machines and files of that look are not."""

    def work():
        with written_whole(tmp_path / "run") as folder:
            (folder / "below").mkdir(parents=True)
            signal.pause()

    other = forked(work)
    while not (found := list(tmp_path.glob(".*/below"))):
        pass
    left = found[0].parent.name
    _, host, pid, _, _ = left.split("-")
    assert pid == str(other)
    elsewhere, later = left.replace(host, "0" * 8), left.replace(f"-{pid}-", f"-{os.getpid()}-")
    for name in (elsewhere, later, ".mine.partial"):
        (tmp_path / name).mkdir()
    write_whole(tmp_path / "a", b"1")
    assert names(tmp_path) == sorted([left, elsewhere, later, ".mine.partial", "a"]), "a call is no command"
    with writing():
        write_whole(tmp_path / "a", b"1")
    assert names(tmp_path) == sorted([left, elsewhere, ".mine.partial", "a"]), "the number of a later process"
    os.kill(other, signal.SIGKILL)
    os.waitpid(other, 0)
    with writing():
        check_writable(tmp_path / "b")
    assert names(tmp_path) == sorted([elsewhere, ".mine.partial", "a"])


def test_two_processes_write_the_same_files(tmp_path):
    def work():
        for number in range(30):
            write_whole(tmp_path / f"{number % 5}.csv", f"{os.getpid()} {number}".encode() * 99)

    both = [forked(work) for _ in range(2)]
    assert [os.waitpid(each, 0)[1] for each in both] == [0, 0]
    assert names(tmp_path) == [f"{number}.csv" for number in range(5)]
    for name in names(tmp_path):
        write_whole(tmp_path / name, b"ours still")


def test_a_folder_takes_the_place_of_an_empty_one_only(tmp_path):
    for place, full in ((tmp_path / "new", False), (tmp_path / "empty", False), (tmp_path / "full", True)):
        if place.name != "new":
            place.mkdir()
        if full:
            (place / "theirs").write_bytes(b"1")
        outcome = pytest.raises(OSError, match="not empty") if full else nullcontext()
        with outcome, written_whole(place) as unfinished:
            unfinished.mkdir()
            (unfinished / "a").write_bytes(b"2")
    assert [names(tmp_path / name) for name in names(tmp_path)] == [["a"], ["theirs"], ["a"]]
