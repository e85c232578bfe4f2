"""A controller for LeRobot's G1, which asks for joint targets by class and name.

LeRobot's UnitreeG1 calls `run_step` in a thread of its own once a `control_dt`,
and sends q targets with the gains kp and kd, but no torques: what is asked of
the drives is put into the targets.  Its states have no time, so that a call is
a period; a call that is late is not known.
"""
