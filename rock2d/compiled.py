"""`njit` for the laws and engines: nothing is compiled twice, and the disk cache can never be stale.

numba keys its cache by the file of the outer function alone, so an edited law would live on inside a cached
engine. Here the cache folder carries a hash of every compiled source file of the package: any edit compiles anew.

Numba also optimizes each function together with all that it calls, and makes machine code of it, once more in every
caller. Here compiled functions are parts, which are optimized in the functions that Python calls.
"""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cached_property, lru_cache, partial
from itertools import count, pairwise
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core import event
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.registry import CPUDispatcher

from rock2d import compiling

_PACKAGE = Path(__file__).resolve().parent
_parts = count()
PARTS_PER_THREAD = 16  # parts of the work per thread: many, so that no thread waits long for the slowest part
_KEPT = 4  # older caches are removed, newest first


def _digest() -> str:
    digest = hashlib.sha256(f"{numba.__version__}{_PACKAGE}".encode())
    for source in sorted(_PACKAGE.rglob("*.py")):
        text = source.read_bytes()
        if b"rock2d.compiled" in text or source.name == "compiled.py" or source.parent.name == "effects":
            digest.update(text)
    return digest.hexdigest()[:16]


def _cache_folder(root: Path) -> Path:
    """The folder of this code below `root`; OSError if there can be none."""
    folder = root / _digest()
    for part in (root.parent, root, folder):
        part.mkdir(parents=True, exist_ok=True, mode=0o700)
    for part in (root.parent, root):  # an earlier version left them open where the umask did
        with contextlib.suppress(PermissionError):
            part.chmod(0o700)
    os.utime(folder)
    for old in sorted(root.iterdir(), key=lambda p: p.stat().st_mtime, reverse=True)[_KEPT:]:
        shutil.rmtree(old, ignore_errors=True)
    return folder


def _open_to_others(folder: Path) -> Path | None:
    """The folder itself or the one above it in which another user could place code; None if there is none."""
    if not hasattr(os, "getuid"):
        return None
    for part in (folder, *folder.parents):
        found = part.stat()
        shared = found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
        if (
            shared and part != folder and found.st_mode & stat.S_ISVTX
        ):  # like /tmp: others cannot rename what is in it
            shared = 0
        if shared or found.st_uid not in (os.getuid(), 0):
            return part
    return None


def _choose_cache() -> None:
    """Set the folder of compiled code; a temporary one, for this process and its workers, if others can write it."""
    root = compiling.cache_root() / "numba"
    with contextlib.suppress(OSError):  # nowhere to write: numba falls back to its own default
        folder = _cache_folder(root.resolve())
        if (found := _open_to_others(folder)) is not None:
            sys.stderr.write(
                f"warning: {found}: other users can write here; code is compiled anew for this run\n"
            )
            folder = Path(tempfile.mkdtemp(prefix="rock2d_"))
            os.environ["NUMBA_CACHE_DIR"] = str(folder)  # for workers
            atexit.register(shutil.rmtree, folder, ignore_errors=True)
        setattr(numba.config, "CACHE_DIR", str(folder))  # noqa: B010 (numba makes its settings at run time)


if "NUMBA_CACHE_DIR" not in os.environ:
    _choose_cache()


class _Compiling(event.Listener):
    """Hears of every function that is compiled; numba does not send this event for one that the cache holds."""

    def on_start(self, event):
        compiling.begins()

    def on_end(self, event):
        compiling.ends()


event.register("numba:compile", _Compiling())


class _PartLibrary(JITCodeLibrary):
    """Code that is not optimized, nor made machine code: both happen once, in each function that Python calls."""

    def finalize(self):
        for library in dict.fromkeys(self._linking_libraries):
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalized = True

    def get_pointer_to_function(self, name):
        return 0

    @property
    def codegen(self):
        return _NoEnvironment


class _WholeLibrary(JITCodeLibrary):
    """Code of a function that Python calls, in which nothing else is visible from outside. So the optimizer may drop
    arguments that a part does not read. Numba passes every length and stride of every array on every call."""

    def finalize(self):
        self._visible = {f.name for f in self._final_module.functions if not f.is_declaration}
        super().finalize()

    def _optimize_final_module(self):
        for function in self._final_module.functions:
            if not function.is_declaration and function.name not in self._visible:
                function.linkage = "internal"
        super()._optimize_final_module()


class _NoEnvironment:
    """Environment of code that does not run by itself."""

    @staticmethod
    def set_env(name, env):
        pass


class _PartCompiler(Compiler):
    """Compiles a function as a part of others."""

    def __init__(self, typingctx, targetctx, library, args, return_type, flags, locals):
        flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
        super().__init__(typingctx, targetctx, library, args, return_type, flags, locals)
        codegen = self.state.targetctx.codegen()
        self.state.library = _PartLibrary(codegen, f"part{next(_parts)}")


class _WholeCompiler(Compiler):
    """Compiles a function that Python calls."""

    def __init__(self, typingctx, targetctx, library, args, return_type, flags, locals):
        super().__init__(typingctx, targetctx, library, args, return_type, flags, locals)
        self.state.library = _WholeLibrary(self.state.targetctx.codegen(), f"whole{next(_parts)}")
        self.state.library.enable_object_caching()


class _Whole(CPUDispatcher):
    """A function that Python calls. One process compiles it; others wait for the code and read it."""

    def compile(self, sig):
        with _alone(f"{self.py_func.__module__}.{self.py_func.__qualname__}"):
            return super().compile(sig)


@contextlib.contextmanager
def _alone(name: str) -> Iterator[None]:
    """Hold the lock `name` of the folder of compiled code, which ends with the process at the latest. Parts have no
    locks of their own, so no process waits while it holds one that another waits for."""
    handle = None
    # on no POSIX system, or in a folder without locks, two processes may compile the same function
    with contextlib.suppress(ImportError, OSError):
        import fcntl

        path = Path(getattr(numba.config, "CACHE_DIR")) / f"{name}.lock"  # noqa: B009 (made at run time)
        handle = os.open(path, os.O_CREAT | os.O_RDWR, 0o600)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            with compiling.compiling():
                fcntl.flock(handle, fcntl.LOCK_EX)
    try:
        yield
    finally:
        if handle is not None:
            os.close(handle)


class _Compiled(CPUDispatcher):
    """A function that compiled code takes as a part, and that Python calls as a whole, with all its parts."""

    def __call__(self, *args):
        return self.whole(*args)

    def like(self, *given):
        """The function for arguments of the types of these, which no call looks up again: that can take longer than the
        function. Other types are undefined behaviour."""
        return self.whole.compile(tuple(map(numba.typeof, given)))

    @cached_property
    def whole(self):
        """The function for Python, with its code on disk."""
        made = numba.jit(self.py_func, cache=True, pipeline_class=_WholeCompiler, **self.targetoptions)
        made.__class__ = _Whole
        return made


def njit(function: Any = None, **options: Any) -> Any:
    """Decorator of compiled functions, with numba's options."""
    if function is None:
        return partial(njit, **options)
    made = numba.njit(error_model="numpy", pipeline_class=_PartCompiler, **options)(function)
    made.__class__ = _Compiled
    return made


# For code that allocates no arrays: without reference counts, which numba keeps for every view and tuple of arrays by
# calls and atomic instructions that take longer than the arithmetic of a contact step.
kernel: Any = partial(njit, _nrt=False)


@kernel
def copy(source, target):
    """Copy a vector; the slice assignment of compiled code would allocate."""
    for i in range(source.size):
        target[i] = source[i]


@lru_cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)  # its threads stay behind


def in_threads(work: Any, n: int, given: tuple[Any, ...], least: int = 1) -> None:
    """Do work(low, high, *given) for parts of range(n) on the threads of numba; `work` is compiled without the lock of
    the interpreter (nogil). Below `least` jobs on one thread."""
    threads = numba.get_num_threads()
    if threads == 1 or n < max(least, 2):
        work(0, n, *given)
        return
    work(0, 0, *given)  # compiled before it is shared
    ends = np.linspace(0, n, min(n, PARTS_PER_THREAD * threads) + 1).astype(int).tolist()
    # each thread takes the next part; that is one step under the lock of the interpreter
    parts = pairwise(ends)

    def take_parts() -> None:
        for low, high in parts:
            work(low, high, *given)

    taking = [_pool(threads - 1).submit(take_parts) for _ in range(threads - 1)]
    try:
        take_parts()
        for own in taking:
            own.result()
    finally:
        for _ in parts:  # Ctrl-C waits for the parts at hand alone
            pass
        wait(taking)
