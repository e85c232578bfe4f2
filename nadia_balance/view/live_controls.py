"""Buttons and sliders in Meshcat, for the user while the robot walks."""

from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, EventStatus, LeafSystem

from nadia_balance.core.walking.vocabulary import Mechanisms

PUSH, PUSH_KEY = "Push", "KeyP"
SIZE = "size [m/s]"
DIRECTION = "direction [deg]"
LENGTH = "length [s]"
# Sliders: minimum, maximum, step and initial value of each.
SLIDERS = {
    SIZE: (0.0, 1.5, 0.01, 0.3),
    DIRECTION: (0.0, 355.0, 5.0, 90.0),
    LENGTH: (0.02, 1.0, 0.02, 0.1),
}
# The fields of Mechanisms, with the names of their buttons.
LABELS = {
    "step": "step adjustment",
    "swing": "swing timing",
    "transfer": "transfer timing",
    "cross_over": "cross-over",
}


class LiveControls(LeafSystem):
    """Turns buttons and sliders in Meshcat into signals.

    `live_push` is [clicks on Push, delta_v [m/s], direction [deg], length [s]];
    0 deg is forward, 90 left.  `mechanisms` is 1 or 0 for each of Mechanisms;
    each has a toggle button.  The outputs are the discrete state.

    .. pydrake_system::

        name: LiveControls
        input_ports: []
        output_ports: [live_push, mechanisms]
    """

    def __init__(self, meshcat: Meshcat, on: Mechanisms, period: float = 0.02):
        """Polls every `period` [s]; begins with these mechanisms."""
        super().__init__()
        self._meshcat = meshcat
        meshcat.AddButton(PUSH, PUSH_KEY)
        for name, (*limits, value) in SLIDERS.items():
            if name not in meshcat.GetSliderNames():
                meshcat.AddSlider(name, *limits, value)
            meshcat.SetSliderValue(name, value)
        self._show_mechanisms(on.as_vector())
        self._push = self.DeclareDiscreteState([0.0, *self._sliders()])
        self._on = self.DeclareDiscreteState(on.as_vector())
        self._before = self.DeclareDiscreteState(1)  # clicks before this run
        self.DeclareStateOutputPort("live_push", self._push)
        self.DeclareStateOutputPort("mechanisms", self._on)
        self.DeclareInitializationDiscreteUpdateEvent(self._begin)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._poll)

    def keep_mechanisms(self, old: Context, new: Context) -> None:
        """Copies the mechanisms that are on from Context `old` to `new`."""
        on = self.GetMyContextFromRoot(old).get_discrete_state(self._on)
        mine = self.GetMyMutableContextFromRoot(new)
        mine.SetDiscreteState(self._on, on.value())

    def _sliders(self) -> list[float]:
        return [self._meshcat.GetSliderValue(s) for s in SLIDERS]

    def _show_mechanisms(self, on) -> None:
        """Replaces all toggle buttons, which resets their clicks."""
        # All are replaced: a single new label would change their order.
        for name in LABELS:
            for label in _label(name, False), _label(name, True):
                self._meshcat.DeleteButton(label, strict=False)
        for name, is_on in zip(LABELS, on, strict=True):
            self._meshcat.AddButton(_label(name, is_on))

    def _begin(self, context, state):
        """Shows what is on, and forgets the clicks on Push, for a new run."""
        # A button that is added again comes last, and hears its key twice.
        state.set_value(self._before, [self._meshcat.GetButtonClicks(PUSH)])
        self._show_mechanisms(context.get_discrete_state(self._on).value())
        state.get_mutable_vector(self._push)[0] = 0.0
        return EventStatus.Succeeded()

    def _poll(self, context, state):
        (before,) = context.get_discrete_state(self._before).value()
        pushes = self._meshcat.GetButtonClicks(PUSH) - before
        state.set_value(self._push, [pushes, *self._sliders()])
        on = context.get_discrete_state(self._on).value()
        labels = map(_label, LABELS, on)
        clicks = [self._meshcat.GetButtonClicks(label) for label in labels]
        if any(clicks):
            state.set_value(self._on, (on + clicks) % 2.0)
            self._show_mechanisms((on + clicks) % 2.0)
        return EventStatus.Succeeded()


def _label(name: str, on: float) -> str:
    return f"{LABELS[name]}: {'on' if on else 'off'}"
