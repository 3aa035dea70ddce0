"""The decision tree and what one does with it: NumPy only."""
