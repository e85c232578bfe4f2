"""How many trials a search will still need: a forecast, for the progress."""

from diagrams.envelope.limit_search import (
    Results,
    SearchParams,
    limit,
    next_batch,
)

TYPICAL = 0.6  # the limit of a cell that has not been tried yet [m/s]


def trials_left(results: Results, search: SearchParams) -> int:
    """Returns how many trials the search makes if all goes as foreseen.

    It is played to its end with the limit in the middle of where `results`
    leave it: recovered from below, not above.
    """
    middle = _guess(results, search) / search.resolution
    foreseen = dict(results)
    while batch := next_batch(foreseen, search):
        for level, replica in batch:
            foreseen[level, replica] = level <= middle
    return len(foreseen) - len(results)


def _guess(results: Results, search: SearchParams) -> float:
    """The likely limit [m/s]."""
    known = limit(results, search)
    if known.failed is not None:
        return 0.5 * (known.recovered + known.failed)
    step = search.stride * search.resolution
    return max(TYPICAL, known.recovered + 0.5 * step)
