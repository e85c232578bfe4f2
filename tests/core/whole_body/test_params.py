"""Refusals of parameters of whole-body control; bounds: parameters.txt."""

import pytest

from nadia_balance.core.whole_body.params import WholeBodyQpParams
from nadia_balance.parameters.bounds import check


def test_the_unloaded_foot_carries_more_than_the_least_force():
    check(WholeBodyQpParams(unloaded_force=2.1, min_normal_force=2.0))
    with pytest.raises(ValueError, match="unloaded_force = 2.0"):
        check(WholeBodyQpParams(unloaded_force=2.0, min_normal_force=2.0))
