"""Nadia at another size moves as Nadia does, in lengths and times of its own.

Oracle: Froude's similarity, of the equations of motion in the same gravity.
"""

import math

import numpy as np
import pytest
from pydrake.common.yaml import yaml_dump_typed

from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.diagrams.simulation import simulate
from nadia_balance.results.log import COM, com
from tests.scaled_robot import scaled_nadia
