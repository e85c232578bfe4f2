"""Where to walk and when: gait, CoP and ICP plans, the walking clock."""
