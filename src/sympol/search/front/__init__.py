"""The front: the best trees of every size, searched, chosen, tested once and written as folders."""
