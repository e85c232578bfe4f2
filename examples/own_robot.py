"""A folder made from a URDF is a robot, which is pushed while it stands.

python examples/own_robot.py [FILE.urdf]   # by default Unitree's G1
"""

import sys
import tempfile
from pathlib import Path

import nadia_balance as nb
from nadia_balance.new_robot.make import make_robot

urdf = Path(sys.argv[1]) if sys.argv[1:] else nb.load_robot("g1").urdf
folder = Path(tempfile.mkdtemp())
notes = make_robot(urdf, folder)
print(*notes.lines(), sep="\n")
robot = nb.load_robot(str(folder / "robot.yaml"))
print(f"{robot.mass:.1f} kg, CoM at {robot.point_mass.com_height:.3f} m")
run = nb.simulate("push_standing", robot=str(folder / "robot.yaml"))
print(run.summary["outcome"])
