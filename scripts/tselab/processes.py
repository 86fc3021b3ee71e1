"""Work in other processes: what Ctrl-C means to them, and how a Dask cluster is reached."""

from __future__ import annotations

import contextlib
import signal
import socket
import threading
from collections.abc import Iterator
from typing import Any

from tselab.errors import UserError

CONNECT = 10  # s, for an answer of a scheduler


def dask(scheduler: str) -> Any:
    """A client of the cluster at this address."""
    try:
        import distributed
    except ImportError:
        raise UserError("option --scheduler needs Dask: pip install 'tse[cluster]'") from None
    try:
        if not scheduler.startswith("inproc://"):  # a client that finds nobody makes much noise
            socket.create_connection(distributed.comm.get_address_host_port(scheduler), CONNECT).close()
        return distributed.Client(scheduler, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise UserError(f"option --scheduler: no Dask scheduler answers at {scheduler}: {error}") from None


@contextlib.contextmanager
def killed_as_interrupted() -> Iterator[None]:
    """A plain kill ends as Ctrl-C does: the workers go, too."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextlib.contextmanager
def without_interrupts() -> Iterator[None]:
    """Ctrl-C goes to all processes of a terminal; what it means is decided by the first. Processes that are started in
    here take no notice of it."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
