"""The words of a moment.  Oracle: the words themselves, there and back."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from diagrams.envelope.moment import Moment


@pytest.mark.parametrize(
    ("words", "moment"),
    [
        ("right swing 25 %", Moment("swing", "right", 0.25)),
        ("left transfer 50 %", Moment("transfer", "left", 0.5)),
        ("left swing 12.5 %", Moment("swing", "left", 0.125)),
        ("right transfer 0 %", Moment("transfer", "right", 0.0)),
        ("right swing 100 %", Moment("swing", "right", 1.0)),
        ("left swing 7 %", Moment("swing", "left", 0.07)),
    ],
)
def test_a_moment_is_read_and_written(words, moment):
    assert Moment.parse(words) == moment
    assert str(moment) == words


@pytest.mark.parametrize("words", [" right swing 25%\n", "right swing 25. %"])
def test_blanks_and_points_that_say_nothing_are_left_out(words):
    assert str(Moment.parse(words)) == "right swing 25 %"


@given(
    st.sampled_from(["swing", "transfer"]),
    st.sampled_from(["left", "right"]),
    st.decimals(0, 100, places=9).map(abs),
)
def test_a_moment_comes_back_from_its_own_words(phase, side, percent):
    moment = Moment.parse(f"{side} {phase} {percent:f} %")
    assert moment == Moment(phase, side, float(percent) / 100.0)
    assert Moment.parse(str(moment)) == moment


@pytest.mark.parametrize(
    "words",
    [
        "",
        "noon",
        "swing 25 %",
        "right flight 25 %",
        "middle swing 25 %",
        "right swing",
        "right swing 25",
        "right swing -5 %",
        "right swing nan %",
        "right swing 1e1 %",
        "right swing 25 % or so",
    ],
)
def test_other_words_are_refused(words):
    message = f'at = {words!r}: must be like "right swing 25 %"'
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        Moment.parse(words)


def test_no_phase_lasts_beyond_its_end():
    with pytest.raises(ValueError, match=r"^fraction = 1.3: must be in \[0, 1"):
        Moment.parse("right swing 130 %")


def test_moments_have_an_order():
    """Oracle: the alphabet, then the fraction."""
    words = ["left swing 50 %", "right swing 5 %", "right swing 25 %"]
    words += ["left transfer 0 %"]
    assert [str(m) for m in sorted(map(Moment.parse, words[::-1]))] == words
