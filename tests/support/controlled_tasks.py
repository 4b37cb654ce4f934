"""Tasks, references and controllers that several tests share."""

import numpy as np

START, GOAL = np.array([-8.0, 3.0, 0.0]), np.zeros(3)
