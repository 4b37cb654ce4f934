"""Decisions of a draft, with evidence, confidence and alternatives."""

from __future__ import annotations

from dataclasses import dataclass

SURE = 0.95
"""Confidence in what the file or the user states."""
LIKELY = 0.8
"""Confidence in what geometry or efforts show."""
GUESSED = 0.5
"""Confidence in what names or habit suggest."""
ASKS = 0.6
"""Confidence below which ``rnc-pin init`` asks."""


@dataclass(frozen=True)
class Alternative:
    """Another answer.

    Attributes:
        answer: the answer, in words.
        options: options of ``rnc-pin init`` that choose it, such as ("--base", "planar").
    """

    answer: str
    options: tuple[str, ...]

    @property
    def command(self) -> str:
        """Options as typed."""
        return " ".join(self.options)


@dataclass(frozen=True)
class DraftDecision:
    """One decision of a draft.

    Attributes:
        question: what was decided, as a question.
        answer: the answer of the draft.
        confidence: confidence between 0 and 1.
        evidence: what the answer rests on.
        alternatives: other answers, with the options that choose them.
        is_answered: True if the user gave this answer to the question.
    """

    question: str
    answer: str
    confidence: float
    evidence: str
    alternatives: tuple[Alternative, ...] = ()
    is_answered: bool = False

    @property
    def is_open(self) -> bool:
        """True if ``rnc-pin init`` asks, because the confidence is low."""
        return self.confidence < ASKS and bool(self.alternatives) and not self.is_answered

    def __str__(self) -> str:
        others = "; ".join(f"{each.answer}: {each.command}" for each in self.alternatives)
        sure = "your answer" if self.is_answered else f"{100 * self.confidence:.0f} % sure: {self.evidence}"
        said = f"{self.question} {self.answer} ({sure})"
        return f"{said}. Otherwise {others}" if others else said
