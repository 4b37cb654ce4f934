"""Other ways to compute the same motion, beside rnc_pin. Run ``python -m benchmarks.peers``."""
