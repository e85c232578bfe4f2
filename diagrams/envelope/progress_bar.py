"""The bar that shows how far a sweep is, and how long it still takes."""

import contextlib
import sys
from collections.abc import Callable, Iterator

from tqdm import tqdm

from diagrams.envelope.agenda import Progress


@contextlib.contextmanager
def progress_bar(start: Progress) -> Iterator[Callable[[Progress], None]]:
    """Yields what shows how far a sweep is on stderr.

    The time left is the mean time of this run's trials times the number of
    trials foreseen.  It is too short at first: a fall ends a trial early, and
    the many trials that confirm a limit come last, and do not fall.
    """
    with tqdm(
        total=start.total,
        initial=start.done,
        unit="trial",
        smoothing=0.0,
        dynamic_ncols=True,
        mininterval=0.5 if sys.stderr.isatty() else 30.0,
    ) as bar:

        def show(now: Progress) -> None:
            bar.total = now.total
            words = f"{now.complete}/{now.cells} limits found"
            bar.set_postfix_str(words, refresh=False)
            bar.update(now.done - bar.n)

        yield show
