"""Work for a process of the fleet that costs it the life. A module of its own: the process imports the module of a function that it
is given, and could not import that of a test, which needs this folder's conftest where another folder's may be found first."""

import os
import signal

from tse.impl.fleet.work import Outcome, Task


def kill_this_process(task: Task) -> Outcome:
    """A log called deadly is as one that is too long for the memory."""
    if "deadly" in task.log.name:
        os.kill(os.getpid(), signal.SIGKILL)
    return Outcome(seconds=1.0)
