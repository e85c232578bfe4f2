"""Two pushes of one's own: a long one on the torso, a blow on its edge."""

import nadia_balance as nb

pushes = [
    nb.Push(
        body="TORSO_LINK",
        force=60.0,  # [N], the peak
        shape="half_sine",
        duration=0.6,  # [s]
        direction_deg=180.0,  # backward
        at="1 s",
    ),
    nb.Push(
        body="TORSO_LINK",
        point=[0.0, 0.2, 0.3],  # [m] in its frame: turns the robot, too
        delta_v=0.1,  # [m/s], of the whole robot in 0.1 s
        direction_deg=0.0,
        at="2 s",
    ),
]
run = nb.simulate("stand", pushes=pushes, duration=4.0)
for push in run.summary["pushes"]:
    print(f"t={push['time_s']:.2f} s: {push['impulse_n_s']:.1f} N s")
print(run.summary["outcome"])
