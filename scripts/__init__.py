"""The programs of this package: `push`, `simulate`, `envelope` and others.

Importing this first lets Ctrl-C end a program without a traceback while it
still imports all the rest.
"""

import os
import sys
from types import TracebackType

INTERRUPTED = 130  # exit code after Ctrl-C


def _end(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    """What Python calls for an exception that nobody has taken."""
    if issubclass(kind, KeyboardInterrupt):
        os._exit(INTERRUPTED)
    sys.__excepthook__(kind, error, trace)


sys.excepthook = _end
