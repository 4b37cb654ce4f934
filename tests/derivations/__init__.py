"""Derivation of the numbers in tests/data with SymPy from Lagrangians, evaluated with 50 digits.

Nothing of Pinocchio and nothing of the package is imported. ``python -m tests.derivations`` derives every number that
the tests read, and prints how far the files are from it.
"""
