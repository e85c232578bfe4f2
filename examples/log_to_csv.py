"""Signals of a run as named columns of a CSV file, such as pandas reads.

python examples/log_to_csv.py [FILE.csv]
"""

import sys

import numpy as np

import nadia_balance as nb
from nadia_balance.results.log import signal_view

log = nb.simulate("push", 3.0, delta_v=0.2).logs
com = signal_view(log, "com_state")
walking = signal_view(log, "walking_signal")
columns = {
    "t": log["t"],
    "icp_x": log["icp"][:, 0],
    "icp_y": log["icp"][:, 1],
    "com_height": com.z,
    "phase": walking.phase,
    "steps_taken": walking.steps_taken,
}
path = sys.argv[1] if sys.argv[1:] else "push.csv"
np.savetxt(
    path,
    np.column_stack([*columns.values()]),
    fmt="%.6g",
    delimiter=",",
    header=",".join(columns),
    comments="",
)
print(f"wrote {path}: {len(log['t'])} rows of {', '.join(columns)}")
