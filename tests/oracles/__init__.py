"""Independent answers to compare with: plain NumPy arrays, no code shared with the library."""
