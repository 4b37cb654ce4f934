"""Files: safe reading of untrusted ones, atomic writing, and data that JSON can represent."""
