"""The controller reads an estimate from an IMU, encoders and foot forces."""

import nadia_balance as nb

run = nb.simulate("push", sensors="consumer", at="standing", delta_v=0.6)
print(run.summary["outcome"])
for name, value in run.summary["estimate"].items():
    print(f"{name}: {value:.4f}")
