"""Calls that are refused in one line that holds some words."""

import re

import pytest

import rnc_pin as rnc


def refusal(call, error=rnc.RncError):
    """The message of the error that a call raises."""
    with pytest.raises(error) as caught:
        call()
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    # The user wrote YAML and need not know what reads it.
    assert not any(word in message for word in ("pydantic", "after validation", "Input should"))
    return message


def refused(cases, call=lambda case: case(), error=rnc.RncError):
    """A test of cases (case, words) or (case, error, words): the call of a case raises the error with these words."""

    @pytest.mark.parametrize("case", cases, ids=[each[-1] for each in cases])
    def test(case):
        message = refusal(lambda: call(case[0]), case[1] if case[2:] else error)
        assert case[-1] in message or re.search(case[-1], message), message

    return test
