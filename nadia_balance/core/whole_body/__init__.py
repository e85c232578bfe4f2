"""Joint torques: the command, its tasks and limits, one QP."""
