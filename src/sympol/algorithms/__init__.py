"""Algorithms that train policies, and the loop that runs them."""
