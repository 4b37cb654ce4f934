"""Place of a joint with one degree of freedom in q and v."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin


class SingleJoint(NamedTuple):
    """Joint with one degree of freedom, as plain numbers: joint models of Pinocchio cannot be pickled or copied."""

    idx_q: int
    """Index of its first value in q."""
    idx_v: int
    """Index in v."""
    continuous: bool
    """True if q holds the cosine and the sine of its angle."""
    unit: str
    """Unit of its velocity: "rad/s" or "m/s"."""

    @classmethod
    def of(cls, joint: pin.JointModel) -> SingleJoint:
        """Return the place of a joint, which has one degree of freedom."""
        unit = "rad/s" if joint.shortname().startswith("JointModelR") else "m/s"
        return cls(joint.idx_q, joint.idx_v, joint.nq == 2, unit)

    def position(self, q: np.ndarray) -> np.ndarray:
        """Position (...,) [rad or m] at q (..., nq)."""
        if self.continuous:
            return np.asarray(np.arctan2(q[..., self.idx_q + 1], q[..., self.idx_q]))
        return np.asarray(q[..., self.idx_q])
