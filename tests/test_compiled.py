"""Compiled code is loaded only from folders that no other user can write; each set of types is compiled once."""

import os
import time

import pytest

from rock2d import compiled

needs_owners = pytest.mark.skipif(not hasattr(os, "getuid"), reason="needs owners of files")


@pytest.fixture
def root(tmp_path, monkeypatch):
    """A cache in an empty home, and the settings as they were after the test."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    monkeypatch.setattr(compiled.numba.config, "CACHE_DIR", "")
    return tmp_path / "rock2d" / "numba"


@needs_owners
def test_the_folder_is_private(root, capsys):
    old = os.umask(0)
    try:
        compiled._choose_cache()
    finally:
        os.umask(old)
    chosen = compiled.numba.config.CACHE_DIR
    assert chosen.startswith(str(root)) and not capsys.readouterr().err
    for folder in (chosen, root, root.parent):
        assert os.stat(folder).st_mode & 0o777 == 0o700


@needs_owners
def test_a_folder_that_others_can_write_is_not_used(root, capsys):
    compiled._choose_cache()
    os.chmod(compiled.numba.config.CACHE_DIR, 0o777)
    compiled._choose_cache()
    assert not compiled.numba.config.CACHE_DIR.startswith(str(root))
    assert os.environ["NUMBA_CACHE_DIR"] == compiled.numba.config.CACHE_DIR
    assert "other users can write" in capsys.readouterr().err


@needs_owners
def test_a_folder_below_one_that_others_can_write_is_not_used(root, capsys):
    root.parent.parent.chmod(0o777)
    compiled._choose_cache()
    assert not compiled.numba.config.CACHE_DIR.startswith(str(root))


@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="needs root to give a folder away")
def test_a_folder_of_another_user_is_not_used(root, capsys):
    compiled._choose_cache()
    os.chown(compiled.numba.config.CACHE_DIR, 1234, 1234)
    compiled._choose_cache()
    assert not compiled.numba.config.CACHE_DIR.startswith(str(root))


def test_old_caches_are_removed_but_not_those_of_other_versions_in_use(root):
    days = [0.0, 0.1, 0.2, 0.3, 0.4, 2.0, 3.0]
    for days_ago in days:
        (root / f"{days_ago}").mkdir(parents=True)
        os.utime(root / f"{days_ago}", (time.time() - 86_400 * days_ago,) * 2)
    compiled._choose_cache()
    assert {f"{days_ago}" for days_ago in days if days_ago < 1.0} == {p.name for p in root.iterdir() if "." in p.name}


def test_another_place_of_a_column_is_compiled_anew(tmp_path, monkeypatch):
    (tmp_path / "records").mkdir()
    monkeypatch.setattr(compiled, "_PACKAGE", tmp_path)
    found = set()
    for place in ("X, Y = 0, 1", "X, Y = 1, 0"):
        (tmp_path / "records" / "columns.py").write_text(place)
        found.add(compiled._digest())
    assert len(found) == 2


def test_constants_in_calls_do_not_compile_a_part_again():
    @compiled.kernel
    def turned(x, back):
        return -x if back else x

    @compiled.kernel
    def both(x):
        return turned(x, True) + 2.0 * turned(x, False)

    assert both(3.0) == 3.0
    assert len(turned.overloads) == 1
