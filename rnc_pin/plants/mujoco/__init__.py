"""MuJoCo as the machine: the loaded robot in somebody else's simulator. Needs ``pip install 'rnc_pin[mujoco]'``."""
