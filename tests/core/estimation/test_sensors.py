"""Oracle: by hand."""

from dataclasses import replace

import pytest

from nadia_balance.core.estimation.sensors import SensorParams
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.scenario import SENSORS, load_scenario
from nadia_balance.parameters.bounds import check
from nadia_balance.robot.params import load_sensors


def test_refuses_a_place_without_three_numbers():
    params = SensorParams(imu_position=[0.0, 1.0])
    with pytest.raises(ValueError, match=r"^imu_position = \[0\.0, 1\.0\]: mu"):
        check(params)


def test_the_figures_are_of_the_data_sheets():
    """Oracle: 0.01 deg/s and 300 ug, of MPU-9250; 0.007 and 120 of MTi-1."""
    for name, gyro, force in (
        ("consumer", 0.01, 300),
        ("industrial", 0.007, 120),
    ):
        found = load_sensors(name)
        assert found.gyro_noise == pytest.approx(gyro * 0.0174533, rel=5e-3)
        assert found.force_noise == pytest.approx(force * 9.81e-6, rel=5e-3)
    names = {"perfect", "consumer", "industrial", "proprioceptive"}
    assert set(SENSORS) == names


def test_a_robot_without_sensors_in_its_feet_has_all_others():
    """Oracle: the sensors with them."""
    measured = replace(load_sensors("proprioceptive"), foot_forces="measured")
    assert measured == load_sensors("consumer")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{sensors: good}", "sensors = 'good': must be one of perfect"),
        (
            "{sensors: consumer, imperfections: {joint_noise: 0.001}}",
            "sensors = 'consumer': must be 'perfect' with noise",
        ),
        (
            "{sensors: consumer, controller: {control_period: 0.003}}",
            "sensors = 'consumer': its delay = 0.004: must be a multiple",
        ),
        (
            "{sensors: proprioceptive, fidelity: ideal}",
            "sensors = 'proprioceptive': must measure foot forces if ideal",
        ),
    ],
)
def test_a_scenario_tells_what_does_not_fit(text, message):
    with pytest.raises(ValueError, match=message):
        load_scenario("walk_in_place", text=text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{sensors: consumer}", "^sensors = 'consumer': must be perfect"),
        (
            "{imperfections: {joint_noise: 0.01}}",
            "^imperfections = .*joint_noise=0.01.*: must be none",
        ),
        (
            "{pushes: [{delta_v: 0.1, at: 1 s, point: [0.1, 0.0, 0.2]}]}",
            r"^point = \[0.1, 0.0, 0.2\]: must not be given",
        ),
    ],
)
def test_a_point_mass_has_neither_sensors_nor_a_body(text, message):
    scenario = load_scenario("walk_in_place", text=text)
    with pytest.raises(ValueError, match=message):
        LipmDiagram(scenario)
