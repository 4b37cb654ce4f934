"""A verdict decides by the weight of its findings, and by what the user accepts."""

import json

import pytest

import rnc_pin as rnc
from rnc_pin.verdict import Finding, FindingKind, Severity, Verdict, finding_kind


def finding(kind, severity, message="something"):
    return Finding(kind, "here", 1.0, "m", 0.5, severity, message)


MISSED = finding(FindingKind.GOAL, Severity.FAILS, "missed")
HIT = finding(FindingKind.COLLISION, Severity.FAILS, "hit")
AT_A_BOUND = finding(FindingKind.SATURATION, Severity.DEGRADES, "saturated")
TOLD = finding(FindingKind.MODEL, Severity.NOTE, "rounded")


@pytest.mark.parametrize(("findings", "accepted", "word", "first"), [
    ((), (), "succeeded", None),
    ((TOLD,), (), "succeeded", None),
    ((TOLD, AT_A_BOUND), (), "degraded", AT_A_BOUND),
    ((AT_A_BOUND, MISSED), (), "failed", MISSED),
    ((AT_A_BOUND, MISSED), ("goal",), "degraded", MISSED),
    ((MISSED, HIT), ("goal",), "failed", HIT),
    ((MISSED, HIT), ("goal", "collision"), "degraded", MISSED),
])  # fmt: skip
def test_the_first_failure_decides_unless_it_is_accepted(findings, accepted, word, first):
    verdict = Verdict.of(findings, accepted)
    assert (verdict.word, verdict.first) == (word, first)
    assert verdict.succeeded == (word != "failed")


def test_findings_that_fail_come_first_in_the_order_in_which_they_were_found():
    assert Verdict.of([TOLD, AT_A_BOUND, HIT, MISSED]).findings == (HIT, MISSED, AT_A_BOUND, TOLD)


def test_an_unknown_kind_is_refused_with_the_nearest_name():
    with pytest.raises(rnc.ConfigurationError, match="no kind of finding 'colision'; did you mean 'collision'"):
        Verdict.of([], ["colision"])
    assert finding_kind("lift_off") is FindingKind.LIFT_OFF


def test_an_amount_without_a_number_is_none_as_in_json():
    endless = Finding(FindingKind.GOAL, "x", float("nan"), "m", None, Severity.FAILS, "lost")
    assert endless.amount is None
    assert json.loads(json.dumps(endless.to_json(), allow_nan=False))["amount"] is None
