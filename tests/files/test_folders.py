"""Results that are whole or not there, whatever fails."""

import errno
import os
import subprocess
import sys

import pytest

from rock2d.errors import InputError
from rock2d.files.folders import RESULT_MARKER, atomic_file, atomic_folder, check_file, check_folder, write_whole


def full_disk(path=None):
    return OSError(errno.ENOSPC, "No space left on device", *([path] if path else []))


@pytest.mark.parametrize("named", [False, True])
def test_a_full_disk_names_the_result_and_leaves_nothing(tmp_path, named):
    with pytest.raises(OSError) as caught, atomic_folder(tmp_path / "out") as folder:
        raise full_disk(str(folder / "table.csv") if named else None)
    assert caught.value.filename == str(tmp_path / "out") and caught.value.errno == errno.ENOSPC
    with pytest.raises(OSError) as caught, atomic_file(tmp_path / "table.csv"):
        raise full_disk()
    assert caught.value.filename == str(tmp_path / "table.csv")
    assert not list(tmp_path.iterdir())


def test_an_error_of_another_file_keeps_its_name(tmp_path):
    with pytest.raises(OSError) as caught, atomic_folder(tmp_path / "out"):
        raise full_disk("/elsewhere/film.avi")
    assert caught.value.filename == "/elsewhere/film.avi"


def test_what_cannot_be_written_is_said_before_the_work(tmp_path):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "mine.txt").write_text("mine")
    for folder in ("file", "file/below", "notes"):
        with pytest.raises(InputError):
            check_folder(tmp_path / folder)
    for file in ("notes", "file/below.csv"):
        with pytest.raises(InputError):
            check_file(tmp_path / file)
    check_folder(tmp_path / "new" / "folder")
    check_file(tmp_path / "new" / "file.csv")
    assert {path.name for path in tmp_path.iterdir()} == {"file", "notes"}


def test_missing_folders_of_a_file_are_made(tmp_path):
    write_whole(tmp_path / "new" / "text.txt", "text")
    assert (tmp_path / "new" / "text.txt").read_text() == "text"


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.parametrize("fails", [False, True])
def test_a_process_that_is_forked_in_mid_write_touches_nothing(tmp_path, fails):
    parent = os.getpid()
    try:
        with atomic_folder(tmp_path / "out") as folder, atomic_file(tmp_path / "table.csv") as partial:
            partial.write_text("half")
            if child := os.fork():
                os.waitpid(child, 0)
                assert folder.is_dir() and partial.is_file()
                assert not (tmp_path / "out").exists() and not (tmp_path / "table.csv").exists()
                partial.write_text("whole")
            elif fails:
                raise KeyboardInterrupt
    finally:
        if os.getpid() != parent:
            os._exit(0)
    assert (tmp_path / "out" / RESULT_MARKER).is_file()
    assert (tmp_path / "table.csv").read_text() == "whole"


def test_a_result_is_replaced_only_by_one_of_its_kind(tmp_path):
    """A comparison must not replace a tracked film that took an hour. A folder that says no kind may be replaced."""
    for kind in ("", "tracked film", "tracked film"):
        with atomic_folder(tmp_path / "out", kind) as folder:
            (folder / "kept").write_text(kind)
    with pytest.raises(InputError, match=r"another kind of result \(tracked film\)"):
        check_folder(tmp_path / "out", "comparison")
    with pytest.raises(InputError, match="another kind"), atomic_folder(tmp_path / "out", "comparison"):
        pass
    assert (tmp_path / "out" / "kept").read_text() == "tracked film"


def test_the_current_folder_is_not_replaced(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for path in (".", "", tmp_path):
        with pytest.raises(InputError, match="is the current folder; choose another"):
            check_folder(path)


WRITES = """
import sys, time
from pathlib import Path
from rock2d.files import folders
with getattr(folders, sys.argv[1])(Path(sys.argv[2])) as partial:
    (partial / "half" if partial.is_dir() else partial).write_text("x")
    print(flush=True)
    time.sleep(60)
"""


@pytest.mark.parametrize("write", [atomic_folder, atomic_file])
def test_the_next_result_removes_what_a_killed_process_left_but_not_what_another_one_writes(tmp_path, write):
    out = tmp_path / "out.csv"
    killed, alive = (
        subprocess.Popen([sys.executable, "-c", WRITES, write.__name__, str(out)], stdout=subprocess.PIPE)
        for _ in range(2)
    )
    try:
        for process in (killed, alive):
            assert process.stdout is not None and process.stdout.readline()
        killed.kill()
        killed.wait()
        assert len(list(tmp_path.iterdir())) == 2
        with write(out) as partial:
            (partial / "whole" if partial.is_dir() else partial).write_text("x")
        assert (out / "whole").is_file() or out.read_text() == "x"
        assert len(list(tmp_path.glob(".out.csv.*"))) == 1
    finally:
        alive.kill()
        alive.wait()


def test_a_result_removes_older_ones_that_a_killed_process_moved_away(tmp_path):
    (tmp_path / ".out.replaced-0123abcd").mkdir()
    with pytest.raises(KeyboardInterrupt), atomic_folder(tmp_path / "out"):
        raise KeyboardInterrupt
    assert (tmp_path / ".out.replaced-0123abcd").is_dir()  # it may be the only result
    with atomic_folder(tmp_path / "out"):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
