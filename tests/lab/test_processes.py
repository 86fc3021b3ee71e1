"""Work in other processes that is interrupted."""

import os
import signal
import subprocess
import sys
import time

import pytest

MANY = """
import contextlib, sys, time
from tse.impl import processes

if __name__ == "__main__":
    try:
        with contextlib.closing(processes.each(time.sleep, [0.004] * 3000, 2)) as results:
            for i, _ in enumerate(results):
                if i == 3:
                    print("busy", flush=True)
    except KeyboardInterrupt:
        sys.exit(130)
"""


@pytest.mark.skipif(os.name == "nt", reason="no signals to a process")
def test_an_interrupt_between_many_short_tasks_ends_all(tmp_path):
    """Four of ten hung while a lock of each future was taken for every result, so six moments tell (1 - 0.6^6 = 95 %)."""
    (tmp_path / "many.py").write_text(MANY)
    for moment in range(6):
        run = subprocess.Popen(
            [sys.executable, str(tmp_path / "many.py")],
            stdout=subprocess.PIPE,
            start_new_session=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a test run in the background ignores it
        )
        assert run.stdout is not None and run.stdout.readline() == b"busy\n"
        time.sleep(0.037 * moment)
        os.killpg(run.pid, signal.SIGINT)
        try:
            run.communicate(timeout=30)  # ends when the last worker has closed its copy
        finally:
            run.poll() is None and os.killpg(run.pid, signal.SIGKILL)
        assert run.returncode == 130
