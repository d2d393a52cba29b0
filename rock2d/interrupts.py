"""How the command line answers Ctrl-C and a request to end (SIGTERM)."""

from __future__ import annotations

import signal


class _Interrupt(KeyboardInterrupt):
    """Ctrl-C. If a plain KeyboardInterrupt leaves exec("..."), as imports call it, Python notes that and kills itself
    at the end, whatever the exit code; it does not do so for a type of its own."""


def _interrupt(number: int, frame: object) -> None:
    raise _Interrupt


def answer_signals() -> list[int]:
    """Answer Ctrl-C by _Interrupt, and a request to end (SIGTERM) by what Ctrl-C does; the list gets the request."""
    received: list[int] = []

    def end(number: int, frame: object) -> None:
        received.append(number)
        interrupt = signal.getsignal(signal.SIGINT)
        # not callable where Ctrl-C is ignored: started in the background by a shell
        (interrupt if callable(interrupt) else _interrupt)(signal.SIGINT, None)

    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)
    signal.signal(signal.SIGTERM, end)
    return received


def ignore_signals() -> None:
    """Neither ends the process from now on."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
