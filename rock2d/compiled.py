"""`njit` for the laws and engines: nothing is compiled twice, and the disk cache is never stale.

The key of numba's cache is the file of the outer function only, so a cached engine would still use an old version of an
edited law. Therefore the name of the cache folder contains a hash of all compiled source files of the package, and of
the rooms whose constants they hold.

Numba also optimizes each function, with everything that it calls, once more in every caller. Here compiled functions
are parts, which are optimized only in the functions that Python calls."""

import atexit
import contextlib
import gc
import hashlib
import os
import shutil
import stat
import sys
import tempfile
import time
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
PARTS_PER_THREAD = 16  # many parts of the work per thread, so that no thread waits long for the slowest part
_ROOMS = {"effects", "engines", "records", "scene"}  # compiled code holds their constants
_KEPT, _KEPT_S = 4, 86_400  # newest caches that are kept, and the time since its last use for which any other is


def _digest() -> str:
    digest = hashlib.sha256(f"{numba.__version__}{_PACKAGE}".encode())
    for source in sorted(_PACKAGE.rglob("*.py")):
        text = source.read_bytes()
        if b"rock2d.compiled" in text or source.name == "compiled.py" or source.parent.name in _ROOMS:
            digest.update(text)
    return digest.hexdigest()[:16]


def _cache_folder(root: Path) -> Path:
    """The cache folder of this version of the code below `root`; raises OSError if it cannot be created."""
    folder = root / _digest()
    for part in (root.parent, root, folder):
        part.mkdir(parents=True, exist_ok=True, mode=0o700)
    for part in (root.parent, root):  # existing folders may have other permissions
        with contextlib.suppress(PermissionError):
            part.chmod(0o700)
    os.utime(folder)
    for old in sorted(root.iterdir(), key=lambda p: p.stat().st_mtime, reverse=True)[_KEPT:]:
        if time.time() - old.stat().st_mtime > _KEPT_S:
            shutil.rmtree(old, ignore_errors=True)
    return folder


def _open_to_others(folder: Path) -> Path | None:
    """The folder, or a parent of it, in which another user could place code; None if there is none."""
    if not hasattr(os, "getuid"):
        return None
    for part in (folder, *folder.parents):
        found = part.stat()
        shared = found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
        if shared and part != folder and found.st_mode & stat.S_ISVTX:  # like /tmp: others cannot rename files
            shared = 0
        if shared or found.st_uid not in (os.getuid(), 0):
            return part
    return None


def _choose_cache() -> None:
    """Set the folder of compiled code. If other users can write to it, use a temporary folder for this process and its
    workers."""
    root = compiling.cache_root() / "numba"
    with contextlib.suppress(OSError):  # nowhere to write: numba falls back to its own default
        folder = _cache_folder(root.resolve())
        if (found := _open_to_others(folder)) is not None:
            sys.stderr.write(f"warning: {found}: other users can write here; code is compiled anew for this run\n")
            folder = Path(tempfile.mkdtemp(prefix="rock2d_"))
            os.environ["NUMBA_CACHE_DIR"] = str(folder)  # for workers
            atexit.register(shutil.rmtree, folder, ignore_errors=True)
        setattr(numba.config, "CACHE_DIR", str(folder))  # noqa: B010 (numba makes its settings at run time)


if "NUMBA_CACHE_DIR" not in os.environ:
    _choose_cache()


class _Compiling(event.Listener):
    """Listens to numba's compile events, which are not sent for functions from the cache."""

    def on_start(self, event):
        compiling.begins()

    def on_end(self, event):
        compiling.ends()


event.register("numba:compile", _Compiling())


class _PartLibrary(JITCodeLibrary):
    """Code that is neither optimized nor translated to machine code: both happen in the functions that Python calls."""

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
    """Code of a function that Python calls. Its parts are not visible from outside, so the optimizer may drop arguments
    that a part does not read, such as the lengths and strides of arrays."""

    def finalize(self):
        self._visible = {f.name for f in self._final_module.functions if not f.is_declaration}
        super().finalize()

    def _optimize_final_module(self):
        for function in self._final_module.functions:
            if not function.is_declaration and function.name not in self._visible:
                function.linkage = "internal"
        super()._optimize_final_module()


class _NoEnvironment:
    """Environment of code that never runs by itself."""

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
    """A function that Python calls. One process compiles it; others wait and read the code from the cache."""

    def compile(self, sig):
        with _alone(f"{self.py_func.__module__}.{self.py_func.__qualname__}"):
            return super().compile(sig)


@contextlib.contextmanager
def _alone(name: str) -> Iterator[None]:
    """Hold the lock `name` in the folder of compiled code; it ends with the process at the latest. Parts have no locks,
    so there is no deadlock. Nobody looks for garbage, of which a compiler makes little."""
    handle, collected = None, gc.isenabled()
    # without POSIX, or in a folder without locks, two processes may compile the same function
    with contextlib.suppress(ImportError, OSError):
        import fcntl

        path = Path(getattr(numba.config, "CACHE_DIR")) / f"{name}.lock"  # noqa: B009 (made at run time)
        handle = os.open(path, os.O_CREAT | os.O_RDWR, 0o600)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            with compiling.compiling():
                fcntl.flock(handle, fcntl.LOCK_EX)
    gc.disable()
    try:
        yield
    finally:
        if collected:
            gc.enable()
        if handle is not None:
            os.close(handle)


class _Compiled(CPUDispatcher):
    """A function that is a part for compiled callers, and is compiled as a whole for Python."""

    def __call__(self, *args):
        return self.whole(*args)

    def like(self, *given):
        """The compiled function for the types of these arguments. Calls do not look up types, which can take longer
        than the function; other types are undefined behaviour."""
        return self.whole.compile(tuple(map(numba.typeof, given)))

    def compile(self, sig):
        """As a part, once for all values of an argument: numba would compile it again for each constant in a call."""
        return super().compile(tuple(map(numba.types.unliteral, sig)))

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


# For code that allocates no arrays: without reference counts of views and tuples of arrays, which take longer than the
# arithmetic of a contact step.
kernel: Any = partial(njit, _nrt=False)


@kernel
def copy(source, target):
    """Copy a vector, without the allocation of a slice assignment."""
    for i in range(source.size):
        target[i] = source[i]


@lru_cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)  # threads do not exist in the child


def in_threads(work: Any, n: int, given: tuple[Any, ...], least: int = 1) -> None:
    """Call work(low, high, *given) for parts of range(n) on the threads of numba; `work` must be compiled with nogil.
    With fewer than `least` jobs, on one thread."""
    threads = numba.get_num_threads()
    if threads == 1 or n < max(least, 2):
        work(0, n, *given)
        return
    work(0, 0, *given)  # compile before the threads start
    ends = np.linspace(0, n, min(n, PARTS_PER_THREAD * threads) + 1).astype(int).tolist()
    parts = pairwise(ends)  # threads take the next part; the lock of the interpreter makes this safe

    def take_parts() -> None:
        for low, high in parts:
            work(low, high, *given)

    taking = [_pool(threads - 1).submit(take_parts) for _ in range(threads - 1)]
    try:
        take_parts()
        for task in taking:
            task.result()
    finally:
        for _ in parts:  # after Ctrl-C, only the present parts are completed
            pass
        wait(taking)
