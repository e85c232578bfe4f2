"""The same controller moves a point mass, which shows its steps at once."""

import nadia_balance as nb
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.results.story import telling_lines

scenario = nb.load_scenario("push").with_push("outward", delta_v=0.6)
run = nb.simulate(LipmDiagram(scenario))
for line in telling_lines(run.logs, run.summary):
    print(line)
