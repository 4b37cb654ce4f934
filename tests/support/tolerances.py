"""Every tolerance that more than one test uses, named once."""

CONSTRAINT = 1e-12  # A R = 0, rows scaled to unit length
LEMMA_1 = 1e-6  # Hdot = V + V^T against central differences, relative
FINITE_DIFFERENCE = 1e-6  # other central differences, relative
KKT = 1e-9  # reduced acceleration against the KKT solution, relative
REFERENCE = 1e-9  # symbolic reference data, relative
REFERENCE_SIMULATION = 1e-8  # reference trajectories
ROUNDING = 1e-10  # the same number computed in two ways
