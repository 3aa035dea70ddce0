"""Proofs about trees by the boxes of their leaves: what is said holds for every observation, or here is one."""
