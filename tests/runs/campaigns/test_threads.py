"""Campaigns of light releases, of which each thread takes a chunk: the same bytes, interruptions and errors."""

import _thread
import errno
import signal
import threading

import numba
import pytest

from rock2d.runs.campaigns import chunks
from rock2d.runs.campaigns.campaign import Workers
from tests.runs.campaigns.test_campaign import campaign, digest, written

pytestmark = pytest.mark.skipif(numba.get_num_threads() < 2, reason="there is one thread")


def test_several_threads_write_what_one_writes(tmp_path):
    campaign(tmp_path / "one", engine="point_mass", workers=Workers(1))
    campaign(tmp_path / "all", engine="point_mass")
    assert digest(tmp_path / "one") == digest(tmp_path / "all")


@pytest.mark.parametrize("caught", [KeyboardInterrupt, OSError])
def test_threads_end_with_the_campaign(tmp_path, monkeypatch, caught):
    many = {"engine": "point_mass", "releases": 20_000, "chunk": 1000}
    campaign(tmp_path / "whole", **many)
    whole, threads = chunks.run_chunk, threading.active_count()

    def stopped(job, chunk, on_progress):
        if chunk.number == 6:
            if caught is OSError:
                raise OSError(errno.ENOSPC, "No space left on device")
            _thread.interrupt_main()
        return whole(job, chunk, on_progress)

    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    with monkeypatch.context() as patched, pytest.raises(caught, match=r"\d of 60 chunks are done"):
        patched.setattr(chunks, "run_chunk", stopped)
        campaign(tmp_path / "cut", **many)
    signal.signal(signal.SIGINT, handler)
    assert written(tmp_path / "cut") < 60 and threading.active_count() == threads
    assert not list((tmp_path / "cut").rglob(".*"))
    campaign(tmp_path / "cut", **many)
    assert digest(tmp_path / "cut") == digest(tmp_path / "whole")
