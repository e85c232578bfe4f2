"""Bad values of the Python API: an error that names the field, no dead Python.

Every value is bad by its making, which is the oracle.  What may end the
interpreter is tried in one of its own.
"""

import math

import numpy as np
import pytest

import nadia_balance as nb
from tests.scripts.running import ended, python

NAN = math.nan
SQUARE = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]

# A call, and how its error begins.
CALLS = {
    "nb.simulate('push', -1)": "duration = -1: must be in",
    "nb.simulate('push', math.nan)": "duration = nan: must be in",
    "nb.simulate('push', math.inf)": "duration = inf: must be in",
    "nb.simulate(5)": "diagram = 5: must be a ClosedLoop, or",
    "nb.simulate('walk_on_water')": "scenario_name = 'walk_on_water': must",
    "nb.simulate('push', directoin=3)": "directoin: must be a field",
    "nb.load_scenario('push', seed='x')": "seed = 'x': must be an integer",
    "nb.load_scenario('push', robot=3)": "robot = 3: must be text",
    "nb.load_scenario('push', robot='a' * 100_000)": "robot = 'aaa",
    "nb.load_scenario('push').with_push(at='now')": "at = 'now': must be",
    "nb.load_scenario('push').changed(gait=3)": "gait = 3: must be a mapping",
    "nb.load_scenario('push').changed(sed=3)": "sed: unknown field",
    "nb.load_robot('')": "robot = '': must be one of",
    "nb.load_robot('g1', 'perfect')": "fidelity = 'perfect': must be one of",
    "PLANT(time_step=-1)": "time_step = -1: must be",
    "PLANT(time_step=0.0)": "time_step = 0.0: must be",
    "PLANT(time_step=math.nan)": "time_step = nan: must be",
    "nb.BalanceController(PARAMS, ROBOT, delay=-1)": "delay = -1: must be",
    "nb.BalanceController(PARAMS, ROBOT, start=nb.Gait())": "start = Gait(",
    "nb.BalanceController(PARAMS, nb.load_robot('g1'))": "foot_front = ",
    "nb.CapturePointController(PARAMS, 3)": "model = 3: must be",
    "nb.PushSource([], mass=-1, period=0.004)": "mass = -1: must be",
    "nb.PushSource([], mass=80, period=0)": "period = 0: must be",
    "nb.FootPose([math.nan, 0, 0], 0)": "p_WF = [nan, 0.0, 0.0], yaw = 0: must",
    "nb.FootPose([0, 0, 0], math.inf)": "p_WF = [0.0, 0.0, 0.0], yaw = inf",
    "nb.FootPose([0, 0], 0)": "",
    "nb.Ground((), SOLE)": "regions = (): must",
    "nb.Ground((nb.Region(vertices=SQUARE[:2]),), SOLE)": "vertices = [[0.0",
    "nb.walking_start(nb.Gait(), ROBOT)": "model = ",
    "nb.Push(directoin_deg=3)": "",
    "nb.VelocityCommands([(0, 1, 2)])": "rows[0] = (0.0, 1.0, 2.0): must",
    "nb.Imperfections(dely=1)": "",
    # Fields of another type, which no YAML could hold.
    "LOAD('stand', commands=[nb.Command(forward='3')])": "commands[0].forward",
    "LOAD('stand', commands=[nb.Command(left=None)])": "commands[0].left = N",
    "LOAD('stand', pushes=[nb.Push(delta_v='1')])": "pushes[0].delta_v = '1'",
    "LOAD('stand', gait=nb.Gait(num_steps=2.5))": "gait.num_steps = 2.5: must",
    "LOAD('stand', gait=nb.Gait(step=3))": "gait.step = 3: must be a StepVec",
    "LOAD('stand').changed(duration='1')": "duration = '1': must be a number",
    # Fields that loading derives, or draws.
    "LOAD('push').changed(robot='g1')": "robot = 'g1': must be given to load_",
    "LOAD('push').changed(random_commands=0.5)": "random_commands = 0.5: must",
    "nb.HumanoidDiagram(nb.Scenario(random_delta_v=0.5))": "random_delta_v = ",
    "nb.simulate('stand', gait=nb.Gait(step_width=0.1))": "gait.step_width = ",
    "nb.simulate('stand', gait=nb.Gait(step_width=0.9))": "gait.step_width = ",
    "nb.ContactClock(300.0, -0.004)": "period = -0.004: must be > 0 s",
    "nb.FootForceEstimator(ROBOT, None, 0.0)": "period = 0.0: must be > 0",
    "nb.FrictionEstimator(PARAMS.whole_body, ROBOT.point_mass, NAN)": "period",
    "nb.BalanceController(None, ROBOT)": "params = None: must be a Controll",
    "nb.BalanceController(PARAMS, ROBOT, ground=3)": "ground = 3: must be a",
    "nb.BalanceController(PARAMS, ROBOT, sensors='x')": "sensors = 'x': must",
    "nb.HumanoidDiagram(LOAD('stand'), controller=3)": "controller = 3: must",
    "nb.HumanoidDiagram(LOAD('stand'), sources={'velocity_command': 3})": (
        "sources['velocity_command'] = 3: must be a System"
    ),
    "nb.envelope('x', workers=1.5)": "workers = 1.5: must be in [1, ",
    "nb.envelope('x', contract=3)": "contract = 3: must be a list",
}
NAMES = """
import math
import nadia_balance as nb
from pydrake.systems.framework import DiagramBuilder
PARAMS = nb.load_scenario('stand').controller
ROBOT = nb.load_robot('nadia')
SOLE = ROBOT.sole
NAN = math.nan
LOAD = nb.load_scenario
SQUARE = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
def PLANT(**given): return ROBOT.add_plant_to(DiagramBuilder(), **given)
"""


@pytest.fixture(scope="module")
def answers() -> dict[str, str]:
    """The error of each call, from one interpreter that survives all."""
    code = f"""{NAMES}
for call in {list(CALLS)!r}:
    try:
        eval(call)
    except Exception as error:
        print(call, type(error).__name__, error, sep='\\t')
    else:
        print(call, 'accepted', '', sep='\\t')
print('alive')
"""
    done = ended(python("-c", code))
    assert done.code == 0, done.err
    *lines, last = done.out
    assert last == "alive"
    rows = [line.split("\t") for line in lines]
    return {call: f"{kind}: {message}" for call, kind, message in rows}


@pytest.mark.parametrize("call", CALLS)
def test_a_bad_call_is_refused_by_the_name_of_what_is_bad(answers, call):
    kind, _, message = answers[call].partition(": ")
    assert kind in ("ValueError", "TypeError", "FileNotFoundError")
    assert message.startswith(CALLS[call]), message


@pytest.mark.parametrize(
    "params",
    [
        nb.Push(),
        nb.Gait(),
        nb.ControllerParams(),
        nb.load_scenario("push"),
        nb.load_scenario("push").controller.step_adjuster,
    ],
    ids=lambda params: type(params).__name__,
)
def test_a_misspelt_field_is_refused(params):
    """Oracle: Python's slots, or a frozen dataclass."""
    with pytest.raises((AttributeError, TypeError)):
        params.directoin_deg = 3


def test_a_state_of_zeros_is_told(tmp_path):
    """Oracle: by hand: the quaternion of a posture is not 0."""
    params = nb.load_scenario("stand").controller
    controller = nb.BalanceController(params, nb.load_robot("nadia"))
    context = controller.CreateDefaultContext()
    port = controller.GetInputPort("estimated_state")
    port.FixValue(context, np.zeros(port.size()))
    with pytest.raises(RuntimeError, match="estimated_state. has the quater"):
        controller.GetOutputPort("actuation").Eval(context)
