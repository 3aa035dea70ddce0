"""Gymnasium's classic control in JAX: the same steps as in its own program."""
