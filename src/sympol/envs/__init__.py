"""Environments in JAX, and Gymnasium's through the host."""
