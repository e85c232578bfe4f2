"""What a terminal shows of a run while it goes on."""

import contextlib
from collections.abc import Callable, Iterator
from typing import TextIO

from pydrake.systems.framework import Context
from tqdm import tqdm

from nadia_balance.diagrams.closed_loop import ClosedLoop
from nadia_balance.diagrams.live import CALM_STEPS
from nadia_balance.diagrams.verdict import gait_and_error, push_signal
from nadia_balance.results.story import LiveStory
from nadia_balance.systems.signals import WalkingSignal, read

SHOWN = 0.1  # time between two looks at a run [s]


@contextlib.contextmanager
def progress(
    diagram: ClosedLoop, stream: TextIO | None
) -> Iterator[Callable[[Context], None]]:
    """Shows a bar of simulated time, and a line for each push and recovery.

    Args:
        diagram: what is simulated.
        stream: where it is shown, if that is a terminal.

    Yields:
        A function that takes the diagram's Context, once a tick.
    """
    if stream is None or not stream.isatty():
        yield lambda context: None
        return
    scenario = diagram.scenario
    story = LiveStory(scenario.calm_steps or CALM_STEPS)
    signal = diagram.signals.get("walking_signal")
    with tqdm(
        total=scenario.duration,
        file=stream,
        leave=False,
        bar_format="{l_bar}{bar}| {n:.1f} of {total:.0f} s, {elapsed}",
    ) as bar:

        def show(context: Context) -> None:
            now = context.get_time()
            if now < bar.n + SHOWN:
                return
            bar.update(now - bar.n)
            if signal is None or not diagram.HasOutputPort("icp"):
                return  # a policy has no plan
            for line in story.update(
                now,
                walking=WalkingSignal(read(signal, context)),
                push=push_signal(diagram, context),
                error=gait_and_error(diagram, context)[1],
            ):
                bar.write(f"t={now:.1f} s  {line}", file=stream)

        yield show
