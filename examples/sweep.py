"""The largest push to either side, with steps as planned and adjusted.

It is that of a point mass; `plant="humanoid"` takes minutes.
"""

import nadia_balance as nb
from nadia_balance.sweep.run_trial import search
from nadia_balance.sweep.search import SearchParams, Sweep, limit
from nadia_balance.sweep.trials import results_of

sweep = Sweep(
    scenarios={"push": nb.load_scenario("push")},
    plant="lipm",
    directions=(90.0, 270.0),  # [deg]: inward, outward
    mechanisms=("icp_only", "step"),
    search=SearchParams(resolution=0.1, stride=4, replicas=1),
)
sweep.validate()
for cell in sweep.cells():
    rows = search(sweep, sweep.identity(), cell, {})
    largest = limit(results_of(rows), sweep.search).recovered
    print(f"{cell.mechanisms:8} {cell.direction_deg:3.0f} deg: {largest} m/s")
